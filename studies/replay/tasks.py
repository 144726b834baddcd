"""Tasks for plans within a tolerance, and their plans, kept in a file."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.write import write_json
from ocptip.certificate.checks import certified
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask
from ocptip.published.tasks import experiment_task
from ocptip.robots.payload import Payload
from ocptip.standing.tolerance import PRESETS
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from studies.common import EXAMPLES

BASES = ((3, 10.0, 0.25), (3, 12.0, 0.25), (3, 15.0, 0.25), (4, 8.0, 0.16))
"""Feet, mass, kg, and half their distance, m: so little that within `workshop` the contacts decide."""

STIFFNESS, DAMPING = 1e6, 0.05  # N/m, ratio
SHARED = "arm of G, 4 feet, 8 kg", "UR5 on a cart, 0 kg, workshop", "UR5 on a cart, 5 kg, workshop"
"""On four feet of which one carries nothing for a while on springs, if planned without a stiffness."""


def on_feet(case: str, mass: float, half: float, feet: int) -> MotionTask:
    """The arm of a published case on three or four feet under another base."""
    task = experiment_task(case, "effective")
    own = task.robot.support
    height = float(own.contacts[0].position[2])
    corners = {3: ((1, 0.8), (1, -0.8), (-1.2, 0)), 4: ((1, 1), (-1, 1), (-1, -1), (1, -1))}[feet]
    contacts = [UnilateralContact(position=[x * half, y * half, height], friction=0.6) for x, y in corners]
    support = Support(contacts, mass=mass, center_of_mass=[0, 0, height / 2], gravity=own.gravity)
    robot = task.robot.varied(support=support)
    return replace(task, robot=robot, reference=None, source=None)


def ur5(payload: float) -> MotionTask:
    """The UR5 of the examples on its cart, with a payload, kg."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    arm = task.robot.arm.with_payload(Payload(payload) if payload else None)
    return replace(task, robot=task.robot.varied(arm=arm), source=None)


def on_springs(task: MotionTask) -> MotionTask:
    """The task with all feet on springs, so that it is known how they share a load."""
    own = task.robot.support
    contacts = [replace(contact, stiffness=STIFFNESS, damping_ratio=DAMPING) for contact in own.contacts]
    return replace(task, robot=task.robot.varied(support=own.varied(contacts)), source=None)


def tasks() -> dict[str, tuple[Callable[[], MotionTask], str]]:
    """How to make every task, by name, and the name of its tolerance."""
    found: dict[str, tuple[Callable[[], MotionTask], str]] = {}
    for feet, mass, half in BASES:
        for case in ("A", "D", "G"):
            name = f"arm of {case}, {feet} feet, {mass:g} kg"
            make = lambda case=case, mass=mass, half=half, feet=feet: on_feet(case, mass, half, feet)  # noqa: E731
            found[name] = make, "workshop"
    for case in "ABDEG":  # C and F have clamps that a simulator has no model of
        found[case] = (lambda case=case: experiment_task(case, "effective")), "workshop"
    for payload, preset in ((0.0, "workshop"), (0.0, "site"), (5.0, "workshop"), (5.0, "site")):
        make = lambda payload=payload: ur5(payload)  # noqa: E731
        found[f"UR5 on a cart, {payload:g} kg, {preset}"] = make, preset
    for name in SHARED:
        rigid, preset = found[name]
        found[f"{name}, stiffness declared"] = (lambda rigid=rigid: on_springs(rigid())), preset
    return found


def plan_file(name: str, folder: Path) -> Path:
    """Where the plan of a task is kept."""
    return folder / f"{name.replace(' ', '_').replace(',', '')}.json"


def planned(name: str, folder: Path, starts: int) -> tuple[MotionTask, Trajectory] | str:
    """The task within its tolerance and its plan, from the file or made now; or why there is none."""
    make, preset = tasks()[name]
    task = make()
    task = replace(task, limits=replace(task.limits, tolerance=PRESETS[preset]))
    path = plan_file(name, folder)
    if not path.is_file():
        data: dict[str, Any] = {"task": name, "preset": preset, "starts": starts}
        try:
            plan = plan_motion(task, starts=starts, jobs=1, prove=certified)
            data |= {"energy_J": plan.energy, "verified": plan.verified, "motion": plan.motion.to_dict()}
        except (InputError, PlanningError) as error:
            data["refused"] = f"{error}"
        write_json(path, data)
    data = json.loads(path.read_text())
    if "refused" in data or not data["verified"]:
        return data.get("refused", "not verified")
    return task, Trajectory.from_dict(data["motion"])


def all_planned(
    folder: Path, names: Sequence[str], starts: int
) -> dict[str, tuple[MotionTask, Trajectory] | str]:
    """The plans of several tasks."""
    folder.mkdir(parents=True, exist_ok=True)
    return {name: planned(name, folder, starts) for name in names}
