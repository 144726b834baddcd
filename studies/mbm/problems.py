"""Problems of MotionBenchMaker (scene and request, YAML) as task files of ocptip, with a stated base."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ocptip.basics.toml_text import toml_text

FAMILIES = (
    "bookshelf_small", "bookshelf_tall", "bookshelf_thin", "box", "cage", "table_pick", "table_under_pick",
)  # fmt: skip
DECK = 0.75
"""m: height of the deck that the arm stands on; the scenes, which have no floor, are raised by that."""
BASE = {
    "mass": 400.0,
    "center_of_mass": [0.0, 0.0, 0.3],
    "feet": [[0.4, 0.3, 0.0], [0.4, -0.3, 0.0], [-0.4, -0.3, 0.0], [-0.4, 0.3, 0.0]],
    "friction": 0.5,
}
"""The base of all problems: a heavy cart on four braked wheels."""


def task_of(folder: Path, family: str, robot: str, number: int, arm: dict[str, Any]) -> str:
    """The task file of one problem.

    Args:
        folder: `problems` of the data set.
        family: of `FAMILIES`.
        robot: "panda", "ur5" or "fetch".
        number: 1 to 100.
        arm: keys of the table [arm], without the position of its mount.
    """
    own = folder / f"{family}_{robot}"
    scene = yaml.safe_load((own / f"scene{number:04d}.yaml").read_text())
    request = yaml.safe_load((own / f"request{number:04d}.yaml").read_text())
    asked = {
        row["joint_name"]: row["position"] for row in request["goal_constraints"][0]["joint_constraints"]
    }
    state = request["start_state"]["joint_state"]
    start = dict(zip(state["name"], state["position"], strict=True))
    names = list(asked)
    data = {
        "name": f"{family} {robot} {number}",
        "base": BASE,
        "arm": {**arm, "mount_position": [0.0, 0.0, DECK]},
        "motors": {"kind": "estimated"},
        "obstacle": [_solid(one) for one in scene["world"]["collision_objects"]],
        "motion": {
            "start_deg": {name: float(np.rad2deg(start[name])) for name in names},
            "goal_deg": {name: float(np.rad2deg(asked[name])) for name in names},
        },
    }
    return toml_text(data)


def _solid(item: dict[str, Any]) -> dict[str, Any]:
    """An obstacle of one primitive."""
    (primitive,), (pose,) = item["primitives"], item["primitive_poses"]
    place = {
        "name": item["id"],
        "position": [pose["position"][0], pose["position"][1], pose["position"][2] + DECK],
        "quaternion": pose["orientation"],
    }
    size = primitive["dimensions"]
    if primitive["type"] == "box":
        return {"kind": "box", "size": size, **place}
    if primitive["type"] == "cylinder":  # height, radius
        return {"kind": "cylinder", "length": size[0], "radius": size[1], **place}
    return {"kind": "sphere", "radius": size[0], **place}
