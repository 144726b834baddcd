"""Problems of MotionBenchMaker (scene and request, YAML) as task files of ocptip, with a stated base."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ocptip.basics.toml import toml_text

FAMILIES = (
    "bookshelf_small", "bookshelf_tall", "bookshelf_thin", "box", "cage", "table_pick", "table_under_pick",
)  # fmt: skip
CART = {
    "base": {
        "mass": 400.0,
        "center_of_mass": [0.0, 0.0, 0.3],
        "feet": [[0.4, 0.3, 0.0], [0.4, -0.3, 0.0], [-0.4, -0.3, 0.0], [-0.4, 0.3, 0.0]],
        "friction": 0.5,
    }
}
"""The base of arms: a heavy cart on four braked wheels."""
FETCH = {
    "base": {
        "mass": 92.1255977,
        "center_of_mass": [-0.025529, 0.000826, 0.103959],
        "inertia": [6.54087, 0.0215524, 1.12072, 6.52588, -0.0329673, 1.68128],
        "friction": 0.5,
    },
    "contact": [
        {"position": [0.0013, -0.1874, 0.0]},
        {"position": [0.0013, 0.1874, 0.0]},
        {"position": [0.1735, 0.1262, 0.0], "friction": 0.0},
        {"position": [0.1731, -0.1255, 0.0], "friction": 0.0},
        {"position": [-0.2212, -0.1236, 0.0], "friction": 0.0},
        {"position": [-0.2208, 0.1252, 0.0], "friction": 0.0},
    ],
}
"""The own base of a Fetch, as `ocptip init` reads it from its URDF: two braked wheels and four casters."""


@dataclass(frozen=True)
class Robot:
    """A robot of the data set and what it stands on.

    Attributes:
        arm: keys of the table [arm], without the files.
        base: tables of the base and its contacts.
        deck: m, height of the arm's base above the floor; the scenes, which have no floor, are raised by it.
        fingers: m, position of joints with "finger" in their names.
    """

    arm: dict[str, Any]
    base: dict[str, Any]
    deck: float
    fingers: float = 0.0


ROBOTS = {
    "panda": Robot(
        {
            "base_link": "panda_link0",
            "tool_frame": "panda_hand_tcp",
            "locked_m": {"panda_finger_joint*": 0.065},
        },
        CART,
        0.75,
        0.065,
    ),
    "ur5": Robot({"base_link": "base_link", "tool_frame": "tool0"}, CART, 0.75),
    "fetch": Robot(
        {
            "base_link": "base_link",
            "tool_frame": "gripper_link",
            "locked_m": {"*_gripper_finger_joint": 0.05},
        },
        FETCH,
        0.0,
        0.05,
    ),
}
_SLIDES = ("torso_lift_joint",)


def task_of(folder: Path, family: str, robot: str, number: int, files: dict[str, str]) -> str:
    """The task file of one problem.

    Args:
        folder: `problems` of the data set.
        family: of `FAMILIES`.
        robot: of `ROBOTS`.
        number: 1 to 100.
        files: keys "urdf" and, if there is one, "srdf" of the table [arm].
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
    motion = {}
    for key, values in (("start", start), ("goal", asked)):
        motion[f"{key}_deg"] = {n: float(np.rad2deg(values[n])) for n in names if n not in _SLIDES}
        if slides := {n: float(values[n]) for n in names if n in _SLIDES}:
            motion[f"{key}_m"] = slides
    own_robot = ROBOTS[robot]
    data = {
        "name": f"{family} {robot} {number}",
        **own_robot.base,
        "arm": {**own_robot.arm, **files, "mount_position": [0.0, 0.0, own_robot.deck]},
        "motors": {"kind": "estimated"},
        "obstacle": [_solid(one, own_robot.deck) for one in scene["world"]["collision_objects"]],
        "motion": motion,
    }
    return toml_text(data)


def _solid(item: dict[str, Any], deck: float) -> dict[str, Any]:
    """An obstacle of one primitive, raised by the height of the deck, m."""
    (primitive,), (pose,) = item["primitives"], item["primitive_poses"]
    place = {
        "name": item["id"],
        "position": [pose["position"][0], pose["position"][1], pose["position"][2] + deck],
        "quaternion": pose["orientation"],
    }
    size = primitive["dimensions"]
    if primitive["type"] == "box":
        return {"kind": "box", "size": size, **place}
    if primitive["type"] == "cylinder":  # height, radius
        return {"kind": "cylinder", "length": size[0], "radius": size[1], **place}
    return {"kind": "sphere", "radius": size[0], **place}
