"""Results of a placement: poses, criteria, margins of all constraints by name, what became of each start."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ocptip.basics.errors import PlanningError
from ocptip.basics.values import rotations
from ocptip.basics.write import plain
from ocptip.numerics.vectors import nearest_turn
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.kinds import KINDS
from ocptip.placement.limits.limit import ConstraintRows, TaskEvaluation
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.reserves.friction_needed import friction_needed

FEASIBLE = 1e-6
"""Margins above minus this (in the units of `PlacementMargin.relative`) count as kept."""

ACTIVE = 1e-4
"""Margins below this count as active."""

ONE_PLACE = 0.03
"""Parameters of placements nearer than this to each other, of their scales and in rad, are one."""


@dataclass(frozen=True)
class PlacementMargin:
    """One constraint at a placement.

    Attributes:
        kind: of the limit, one of `ocptip.placement.limits.kinds.KINDS`.
        name: which one.
        value: in `unit`.
        limit: what it is compared with.
        upper: value <= limit is wanted, else value >= limit.
        unit: m, rad, N m or nothing.
        relative: margin in comparable units: 0.1 m, 0.2 rad, the limit itself; negative if broken.
        task: number of the task, -1 for the base alone.
        worst: where the problem has a tolerance, the base for which `value` is: the worst that it allows.
    """

    kind: str
    name: str
    value: float
    limit: float
    upper: bool
    unit: str
    relative: float
    task: int
    worst: str = ""

    @property
    def full_name(self) -> str:
        """Which one, with the base for which it is worst; that a base stands holds for all bases."""
        holds = KINDS[self.kind].verdicts is not None and self.relative >= 0
        return f"{self.name} ({self.worst})" if self.worst and not holds else self.name

    @property
    def active(self) -> bool:
        """The constraint is at its limit or broken; equalities and yes-or-no are never at theirs."""
        return self.relative < (ACTIVE if KINDS[self.kind].has_margin else 0)

    def __str__(self) -> str:
        name = self.full_name
        if verdicts := KINDS[self.kind].verdicts:
            return f"{self.kind}: {name}: {verdicts[bool(self.value)]}"
        value, limit, unit = self.in_degrees
        sign, unit = "<=" if self.upper else ">=", f" {unit}" if unit else ""
        text = f"{self.kind}: {name}: {value:.4g}{unit}, must be {sign} {limit:.4g}{unit}"
        return text + (f" (off by {abs(value - limit):.3g}{unit})" if self.relative < -FEASIBLE else "")

    @property
    def in_degrees(self) -> tuple[float, float, str]:
        """Value, limit and unit; angles in degrees."""
        if self.unit == "rad":
            return float(np.degrees(self.value)), float(np.degrees(self.limit)), "deg"
        return self.value, self.limit, self.unit

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "active": self.active}


@dataclass(frozen=True, eq=False)
class Placement:
    """A checked placement.

    Attributes:
        problem: what it is for.
        patch: number of the terrain's patch.
        parameters: (k,) of the patch; angles in rad, lengths in m.
        base_position: (3,), m, base origin in the world.
        base_rotation: (3, 3), base to world axes.
        angles: (tasks, n), rad.
        criteria: GN, GT, GK, GE: the worst counting load case, for GE the mean.
        total: weighted sum of the normalised criteria.
        margins: of all constraints, the smallest relative margin first; of the clearances those below 0.1 m
            and the smallest of each task.
        pose_error: largest error of a gripper position (m) or orientation (rad).
        start: number of its start; -1 for none.
    """

    problem: PlacementProblem
    patch: int
    parameters: np.ndarray
    base_position: np.ndarray
    base_rotation: np.ndarray
    angles: np.ndarray
    criteria: dict[str, float]
    total: float
    margins: tuple[PlacementMargin, ...]
    pose_error: float
    start: int = -1

    @property
    def feasible(self) -> bool:
        """All constraints hold."""
        return self.margins[0].relative >= -FEASIBLE

    def shares_place(self, other: Placement) -> bool:
        """Whether both stand at one place, however the base is turned there (where that is all: alike)."""
        if self.patch != other.patch:
            return False
        terrain = self.problem.terrain[self.patch]
        apart = self.parameters - other.parameters
        angular = np.array(terrain.angular)
        apart = np.where(angular, nearest_turn(apart), apart / self.problem.scales(self.patch))
        counting = angular if angular.all() else ~angular
        return bool(np.max(np.abs(apart[counting])) < ONE_PLACE)

    @property
    def active(self) -> tuple[PlacementMargin, ...]:
        """Constraints at their limits."""
        return tuple(m for m in self.margins if m.active)

    @property
    def violations(self) -> tuple[PlacementMargin, ...]:
        """Broken constraints."""
        return tuple(m for m in self.margins if m.relative < -FEASIBLE)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for strict JSON, with None for what is not finite.

        `parameters` are those of the terrain, angles in degrees with `_deg` in their key; `base` is the pose
        of the base frame in the world (`rotation` base to world axes, `rpy_deg` the same as roll, pitch, yaw
        about the fixed world axes), `ground` that of the ground point. `angles_deg` are the joint angles by
        task; if some joints slide, theirs are positions in m, and `units` says which. `criteria` holds per
        criterion value, reference, weight and `share` of the total. `margins` are all constraints, the
        tightest first, `active` those at their limits.
        """
        problem, arm = self.problem, self.problem.robot.arm
        terrain = problem.terrain[self.patch]
        parameters = {
            f"{name}_deg" if angular else name: np.rad2deg(value) if angular else value
            for name, value, angular in zip(terrain.parameters, self.parameters, terrain.angular, strict=True)
        }
        criteria = {}
        for name, weight in zip(CRITERIA, problem.weights.array(), strict=True):
            value, reference = self.criteria[name], problem.references[name]
            share = weight * value / reference if weight else 0.0
            criteria[name] = {"value": value, "reference": reference, "weight": weight, "share": share}
        return plain(
            {
                "terrain": terrain.name,
                "parameters": parameters,
                "ground": problem.stands[self.patch].ground(self.parameters[None])[0][0],
                "base": {
                    "position": self.base_position,
                    "rotation": self.base_rotation,
                    "rpy_deg": rotations().from_matrix(self.base_rotation).as_euler("xyz", degrees=True),
                },
                **self._feet(),
                "angles_deg": {
                    task.name: arm.in_degrees(q) for task, q in zip(problem.tasks, self.angles, strict=True)
                },
                **({"units": arm.file_units} if arm.prismatic.any() else {}),
                "feasible": self.feasible,
                "total": self.total,
                "criteria": criteria,
                "active": [margin.name for margin in self.active],
                "margins": [
                    {
                        **margin.to_dict(),
                        "task": problem.tasks[margin.task].name if margin.task >= 0 else None,
                    }
                    for margin in self.margins
                ],
                "pose_error": self.pose_error,
                "start": self.start,
            }
        )

    def _feet(self) -> dict[str, Any]:
        """On uneven ground places and normals of the feet in the world, and strokes of legs."""
        stand = self.problem.stands[self.patch]
        if not stand.conforms:
            return {}
        stood = stand.at(self.parameters)
        base, contacts, normals = stood.base[0], stood.contacts[0], stood.frames[0, :, :, 0]
        feet = {"positions": stood.origin[0] + contacts @ base.T, "normals": normals @ base.T}
        return {"feet": {**feet, "strokes": stood.strokes[0]} if stood.strokes.size else feet}


@dataclass(frozen=True)
class StartReport:
    """The result of the programs from one start.

    Attributes:
        number: of the start.
        status: Ipopt's word.
        iterations, seconds: of all its programs.
        total: objective reached; NaN if not feasible.
        feasible: the result was checked and keeps all constraints.
        worst: the most violated constraint if not.
    """

    number: int
    status: str
    iterations: int
    seconds: float
    total: float
    feasible: bool
    worst: str


@dataclass(frozen=True, eq=False)
class PlacementResult:
    """The result of :func:`place`.

    Attributes:
        problem: what was asked for.
        placements: distinct local optima, all checked as feasible, the best first; several may be at one
            place, with the base turned or other joint angles.
        starts: what became of each.
        sampled, reached: placements evaluated for starts, and how many of them reach all tasks.
        seed: of the sample.
        seconds: wall time.
    """

    problem: PlacementProblem
    placements: tuple[Placement, ...]
    starts: tuple[StartReport, ...]
    sampled: int
    reached: int
    seed: int
    seconds: float

    @property
    def best(self) -> Placement:
        """The placement with the minimum objective."""
        return self.placements[0]

    @property
    def places(self) -> tuple[Placement, ...]:
        """The best placement at each place, the best of all first.

        Other joint angles, or a symmetric base that is turned, make no other place.
        """
        kept: list[Placement] = []
        for placement in self.placements:
            if not any(placement.shares_place(other) for other in kept):
                kept.append(placement)
        return tuple(kept)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for strict JSON: the placements, what was asked for, and how the search went."""
        best, *others = (placement.to_dict() for placement in self.places)
        return plain(
            {
                "best": best,
                "alternatives": others,
                **_asked(self.problem),
                "starts": self.starts,
                "sampled": self.sampled,
                "reached": self.reached,
                "seed": self.seed,
                "seconds": self.seconds,
            }
        )


class NoPlacementError(PlanningError):
    """No placement keeps all constraints.

    Attributes:
        nearest: the placement of minimum violation.
        starts: what became of each start.
    """

    def __init__(self, message: str, nearest: Placement, starts: tuple[StartReport, ...] = ()) -> None:
        super().__init__(message)
        self.nearest, self.starts = nearest, starts

    def __reduce__(self) -> tuple:
        """So that it comes out of another process."""
        return type(self), (str(self), self.nearest, self.starts)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for strict JSON: `reason`, and `nearest`, the placement of minimum violation."""
        nearest, asked = self.nearest.to_dict(), _asked(self.nearest.problem)
        return plain({"reason": str(self), "nearest": nearest, **asked, "starts": self.starts})


def _asked(problem: PlacementProblem) -> dict[str, Any]:
    """The requirements of a problem, as plain data for JSON."""
    limits = asdict(problem.limits)
    limits["angle_margin_deg"] = np.degrees(limits.pop("angle_margin"))
    tasks = [
        {
            "name": task.name,
            "position": task.position,
            "rotation": task.rotation,
            "orientation": task.orientation,
            "loads": [{"name": p.name, "force": p.force, "moment": p.moment} for p in task.loads],
        }
        for task in problem.tasks
    ]
    return {
        "weights": asdict(problem.weights),
        "references": problem.references,
        "limits": limits,
        "unloaded": problem.unloaded,
        "equally_compliant": problem.alike,
        "tolerance": problem.tolerance.to_dict(),
        "contact_cases": len(problem.cases) * len(problem.corners),
        "tasks": tasks,
        **problem.robot.masses_to_dict(),
        "collision": problem.collision,
    }


def evaluate_placement(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, angles: np.ndarray, start: int = -1
) -> Placement:
    """Evaluate one placement with all constraints, independently of the search.

    Args:
        evaluator: of the problem.
        patch: number of the patch.
        parameters: (k,).
        angles: (tasks, n), rad.
        start: number of the start.
    """
    problem = evaluator.problem
    parameters = problem.terrain[patch].wrapped(np.asarray(parameters, dtype=float))
    results = [evaluator.task(t, patch, parameters[None], q[None]) for t, q in enumerate(angles)]
    criteria = evaluator.criteria(results)
    margins: list[PlacementMargin] = []
    margins += _margins(evaluator.ground(patch, parameters), -1)
    for evaluation in results:
        worst = {
            kind: [problem.corners[c].name for c in corner_of[0, evaluation.constrained]]
            for kind, corner_of in evaluation.worst.items()
        }
        margins += _margins(evaluation.rows, evaluation.task, worst)
    placed = patch, parameters
    margins = [
        _in_friction(evaluator, results, placed, m) if m.kind == "GT" and m.value > 1 else m for m in margins
    ]
    margins.sort(key=lambda m: m.relative if np.isfinite(m.relative) else -np.inf)
    origin, base = evaluator.place(patch, parameters)
    return Placement(
        problem=problem,
        patch=patch,
        parameters=parameters,
        base_position=origin[0],
        base_rotation=base[0],
        angles=np.array(angles),
        criteria=dict(zip(CRITERIA, criteria[0].tolist(), strict=True)),
        total=float(evaluator.totals(criteria)[0]),
        margins=tuple(margins),
        pose_error=float(max(np.max(e.rows[0].values) for e in results)),
        start=start,
    )


def _in_friction(
    evaluator: Evaluator,
    task_evaluations: list[TaskEvaluation],
    placed: tuple[int, np.ndarray],
    margin: PlacementMargin,
) -> PlacementMargin:
    """Friction utilisation beyond 1 as the share of friction that would be needed, without accelerations."""
    evaluation = task_evaluations[margin.task]
    case = next(c for c in evaluation.constrained if evaluation.cases[c].name == margin.name)
    footing = evaluator.problem.stands[placed[0]].footing(placed[1])
    share = friction_needed(footing.support, evaluation.cornered[0, case, evaluation.worst["GT"][0, case]])
    if np.isnan(share):
        return margin
    return replace(margin, value=share, relative=(margin.limit - share) / margin.limit)


def _margins(
    rows: tuple[ConstraintRows, ...], task: int, worst: dict[str, list[str]] | None = None
) -> list[PlacementMargin]:
    result, worst = [], worst or {}
    for r in rows:
        shown = range(len(r.labels))
        if KINDS[r.kind].many and len(r.labels):
            order = np.argsort(r.margins[0])
            shown = [i for rank, i in enumerate(order) if rank == 0 or r.margins[0, i] < 1]
        result += [
            PlacementMargin(
                r.kind,
                r.labels[i],
                float(r.values[0, i]),
                float(r.limits[i]),
                r.upper,
                r.unit if isinstance(r.unit, str) else r.unit[i],
                float(np.nan_to_num(r.margins[0, i], nan=-np.inf)),
                task,
                worst[r.kind][i] if r.kind in worst else "",
            )
            for i in shown
        ]
    return result
