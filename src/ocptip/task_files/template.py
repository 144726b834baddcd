"""A task file for a URDF, with everything that the URDF knows, and marked places for what it cannot know."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ocptip.basics.text import some
from ocptip.basics.toml import MARK
from ocptip.basics.toml_text import toml_value
from ocptip.robots.collision.urdf import PACKAGE, missing_meshes
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf import arm_from_urdf
from ocptip.robots.urdf_file import UrdfFile, read_urdf
from ocptip.task_files.arm import FULL_SPEED

_WIDTH = 44  # columns before a comment


@dataclass(frozen=True, eq=False)
class TaskTemplate:
    """A task file to be filled in.

    Attributes:
        text: its content.
        arm: the arm that it describes.
        base_link, tool_frame: names that were given or found.
        missing: mesh files of its collision geometry that were not found; None: it has no such geometry.
    """

    text: str
    arm: ArmModel
    base_link: str
    tool_frame: str
    missing: list[str] | None

    @property
    def to_fill(self) -> list[str]:
        """Keys of the marked lines."""
        lines = (line for line in self.text.splitlines() if line.startswith(MARK))
        return [line.removeprefix(MARK).split("=")[0].strip() for line in lines]


def task_template(
    urdf: str | os.PathLike[str], folder: Path, *, base_link: str | None = None, tool_frame: str | None = None
) -> TaskTemplate:
    """The file of a motion task for the arm of a URDF.

    Args:
        urdf: the URDF file.
        folder: where the task file will be.
        base_link, tool_frame: see `arm_from_urdf`.

    Raises:
        InputError: the URDF cannot be used; see `arm_from_urdf`.
    """
    file = read_urdf(urdf)
    base = file.base_link(base_link)
    tool = file.tool_frame(tool_frame, base)
    arm = arm_from_urdf(urdf, base_link=base, tool_frame=tool)
    missing = missing_meshes(urdf)
    of_arm = (*_arm(file, arm, base, tool, folder), *_geometry(missing))
    sections = (_base(file, arm), of_arm, _limits(arm), _motion(arm))
    head = [
        f"# Task for `ocptip plan`, written by `ocptip init` from {file.path.name}.",
        f"# The lines that begin with {MARK} are examples: put your numbers there and take the mark away.",
        "# SI units; keys in degrees say so. All keys: docs/motion-planner.md.",
        f"name = {toml_value(file.name)}",
    ]
    text = "\n\n".join("\n".join(lines) for lines in (head, *sections)) + "\n"
    return TaskTemplate(text, arm, base, tool, missing)


def _base(file: UrdfFile, arm: ArmModel) -> Iterator[str]:
    resting = file.mass - float(arm.masses.sum())
    yield "[base]  # what the arm stands on, without the arm; its origin is where you like, z upwards"
    hint = f"kg; {resting:.3g} kg of it are in the URDF: links that rest" if resting > 1e-9 else "kg"
    yield _line(f"mass = {max(80.0, np.ceil(resting)):.1f}", hint, mark=True)
    yield _line("center_of_mass = [0.0, 0.0, 0.3]", "m", mark=True)
    feet = "[[0.3, 0.25, 0.0], [0.3, -0.25, 0.0], [-0.3, -0.25, 0.0], [-0.3, 0.25, 0.0]]"
    yield _line(f"feet = {feet}", "m", mark=True)
    yield _line("friction = 0.5", "of all feet; castors and clamps: [[contact]]", mark=True)


def _arm(file: UrdfFile, arm: ArmModel, base: str, tool: str, folder: Path) -> Iterator[str]:
    yield f"[arm]  # {arm.n} joints, {arm.masses.sum():.4g} kg, reach from joint 1 below {arm.reach:.3g} m"
    path = Path(os.path.relpath(file.path.resolve(), folder.resolve())).as_posix()
    yield f"urdf = {toml_value(path)}"
    yield _line(f"base_link = {toml_value(base)}", "the link that rests")
    others = [link for link in file.ends(base) if link != tool]
    yield _line(
        f"tool_frame = {toml_value(tool)}", f"others: {some(others)}" if others else "the gripper frame"
    )
    yield _line("mount_position = [0.0, 0.0, 0.5]", "m: base origin to the frame of base_link", mark=True)
    yield from (f"# {note}" for note in arm.notes)


def _geometry(missing: list[str] | None) -> Iterator[str]:
    """What collisions need that the URDF does not give."""
    if missing is None:
        yield "# sphere_radius = 0.06  # m; no collision geometry in the URDF: else nothing is checked"
    elif any(name.startswith(PACKAGE) for name in missing):
        yield _line('package_dirs = ["."]', f"where packages are; not found: {some(missing, 2)}", mark=True)
    elif missing:
        yield _line("collision = false", f"or get what is not found: {some(missing, 2)}", mark=True)


def _limits(arm: ArmModel) -> Iterator[str]:
    """Accelerations, which no URDF has, and what this one lacks; its own limits as comments."""
    limits, width = arm.limits, max(map(len, arm.joint_names))
    shown = *map(arm.in_degrees, (limits.angle_min, limits.angle_max, limits.speed)), limits.torque
    yield "[arm.limits]  # the URDF's own count, unless keys here replace them:"
    for j, name in enumerate(arm.joint_names):
        low, high, speed, torque = (_limit(values[j]) for values in shown)
        units = ("m", "m/s", "N") if arm.prismatic[j] else ("deg", "deg/s", "N m")
        yield f"#   {name:<{width}}  {low} to {high} {units[0]}, {speed} {units[1]}, {torque} {units[2]}"
    for slides, keys, examples in (
        (False, ("speed_deg_s", "torque_Nm", "acceleration_deg_s2"), (90, 100)),
        (True, ("speed_m_s", "force_N", "acceleration_m_s2"), (0.2, 500)),
    ):
        own = np.flatnonzero(arm.prismatic == slides)
        for key, values, example in zip(keys, (limits.speed, limits.torque), examples, strict=False):
            if lacking := [arm.joint_names[j] for j in own if not np.isfinite(values[j])]:
                table = ", ".join(f"{toml_value(name)} = {example}" for name in lacking)
                yield _line(f"{key} = {{ {table} }}", "not in the URDF", mark=True)
        if own.size and np.isfinite(limits.speed[own]).all():
            values = arm.in_degrees(limits.speed / FULL_SPEED)[own]
            yield _line(f"{keys[2]} = {_list(values)}", f"an assumption: full speed in {FULL_SPEED:g} s")
    yield "\n[motors]"
    yield _line('kind = "estimated"', 'from torque and speed limits; "dc" with motor data')


def _motion(arm: ArmModel) -> Iterator[str]:
    low, high = arm.limits.angle_min, arm.limits.angle_max
    start = np.clip(np.zeros(arm.n), low, high)
    step = np.where(arm.prismatic, 0.1, np.deg2rad(30))
    goal = np.where(start + step <= high, start + step, np.maximum(start - step, low))
    places = {"start": arm.in_degrees(start), "goal": arm.in_degrees(goal)}
    yield "[motion]"
    for slides, key in ((False, "deg"), (True, "m")):
        own = np.flatnonzero(arm.prismatic == slides)
        if own.size:
            names = ", ".join(arm.joint_names[j] for j in own)
            for place, values in places.items():
                yield _line(f"{place}_{key} = {_list(values[own])}", names, mark=True)
    yield "# or start_pose = { position = [0.5, 0.0, 0.8], rpy_deg = [180, 0, 0] }: of tool_frame, base axes"
    first = ", ".join(map(toml_value, arm.joint_names[:3]))
    yield f"# optimised = [{first}]  # only these; the others move in one ramp each"


def _line(text: str, comment: str, *, mark: bool = False) -> str:
    text = f"{MARK} {text}" if mark else text
    return f"{text:<{_WIDTH}}  # {comment}"


def _limit(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "none"


def _list(values: np.ndarray) -> str:
    return f"[{', '.join(f'{value:.6g}' for value in values + 0.0)}]"
