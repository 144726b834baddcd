"""The file of a placement: placement.json. It appears complete or not at all.

Inside the library: SI units and rad; in the file lengths in m, and angles in degrees as their keys say.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.write import plain, versions, write_json
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.placement.result import NoPlacementError, Placement, PlacementResult

PLACEMENT = "placement.json"


def result_to_dict(name: str, result: PlacementResult) -> dict[str, Any]:
    """Return a result as plain data for strict JSON; what is not finite is None.

    `best` and `alternatives` hold placements, see :func:`placement_to_dict`; `starts` what became of each.

    Args:
        name: of the task.
        result: from `place`.
    """
    best, *others = (placement_to_dict(p) for p in result.placements)
    return plain(
        {
            "task": name,
            "found": True,
            "best": best,
            "alternatives": others,
            **_problem(result.problem),
            "starts": result.starts,
            "sampled": result.sampled,
            "reached": result.reached,
            "seed": result.seed,
            "seconds": result.seconds,
            "versions": versions(),
        }
    )


def refusal_to_dict(name: str, error: NoPlacementError) -> dict[str, Any]:
    """Return why there is no placement: `reason`, and `nearest`, the least-infeasible one found."""
    return plain(
        {
            "task": name,
            "found": False,
            "reason": str(error),
            "nearest": placement_to_dict(error.nearest),
            **_problem(error.nearest.problem),
            "starts": error.starts,
            "versions": versions(),
        }
    )


def placement_to_dict(placement: Placement) -> dict[str, Any]:
    """Return one placement as plain data.

    `parameters` are those of the terrain, angles in degrees with `_deg` in their key; `base` is the pose of
    the base frame in the world (`rotation` base to world axes, `rpy_deg` the same as roll, pitch, yaw about
    the fixed world axes), `ground` that of the ground point. `angles_deg` are the joint angles by task.
    `criteria` holds per criterion value, reference, weight and `share` of the total. `margins` are all
    constraints, the tightest first, `active` those at their limits.
    """
    problem = placement.problem
    terrain = problem.terrain[placement.patch]
    parameters = {
        f"{name}_deg" if angular else name: np.rad2deg(value) if angular else value
        for name, value, angular in zip(
            terrain.parameters, placement.parameters, terrain.angular, strict=True
        )
    }
    ground = terrain.poses(placement.parameters)[0][0]
    weights = problem.weights.array()
    criteria = {}
    for name, weight in zip(CRITERIA, weights, strict=True):
        value, reference = placement.criteria[name], problem.references[name]
        share = weight * value / reference if weight else 0.0
        criteria[name] = {"value": value, "reference": reference, "weight": weight, "share": share}
    return plain(
        {
            "terrain": terrain.name,
            "parameters": parameters,
            "ground": ground,
            "base": {
                "position": placement.base_position,
                "rotation": placement.base_rotation,
                "rpy_deg": Rotation.from_matrix(placement.base_rotation).as_euler("xyz", degrees=True),
            },
            "angles_deg": {
                task.name: np.rad2deg(q) for task, q in zip(problem.tasks, placement.angles, strict=True)
            },
            "feasible": placement.feasible,
            "total": placement.total,
            "criteria": criteria,
            "active": [margin.name for margin in placement.active],
            "margins": [
                {**margin.to_dict(), "task": problem.tasks[margin.task].name if margin.task >= 0 else None}
                for margin in placement.margins
            ],
            "pose_error": placement.pose_error,
            "start": placement.start,
        }
    )


def write_placement(directory: str | os.PathLike[str], data: Mapping[str, Any]) -> Path:
    """Write placement.json; a file of the same name is replaced.

    Args:
        directory: made if it does not exist; the one above it must.
        data: from :func:`result_to_dict` or :func:`refusal_to_dict`.

    Raises:
        OSError: the file or the directory cannot be written; names it.
    """
    directory = Path(directory)
    directory.mkdir(exist_ok=True)
    write_json(directory / PLACEMENT, data)
    return directory / PLACEMENT


def _problem(problem: PlacementProblem) -> dict[str, Any]:
    return {
        "weights": asdict(problem.weights),
        "references": problem.references,
        "limits": asdict(problem.limits),
        "unloaded": problem.unloaded,
        "tasks": [
            {
                "name": task.name,
                "position": task.position,
                "rotation": task.rotation,
                "orientation": task.orientation,
                "loads": [{"name": p.name, "force": p.force, "moment": p.moment} for p in task.loads],
            }
            for task in problem.tasks
        ],
    }
