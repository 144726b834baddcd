"""`ocptip stand TASK.toml --posture`: the scene of a robot that rests in a posture."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.text import did_you_mean, percent, quantity
from ocptip.cli.layout import under
from ocptip.contact.support import Load
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.task import MotionTask
from ocptip.placement.within import posture_within
from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.rest import own_refusals
from ocptip.standing.tolerance import WORKSHOP, Tolerance
from ocptip.standing.within.rest import WithinAtRest
from ocptip.task_files.cycle import read_task
from ocptip.task_files.scene import Scene

_ELSEWHERE = {"sensitivities": "ocptip check", "gn_reference": "reference_moment in [limits]"}


@dataclass(frozen=True, eq=False)
class RestingPosture:
    """A robot at rest.

    Attributes:
        name: "start", "goal", the name of a segment whose goal it is, or "given".
        robot: on its support, with what it holds and what acts on its gripper at rest.
        q: (n,), rad (straight coordinates: m).
        limits: of the task.
        scene: the support, with what the robot does to it as the only load.
    """

    name: str
    robot: StandingMechanism
    q: np.ndarray
    limits: MotionLimits
    scene: Scene

    @classmethod
    def of(
        cls, task: str, name: str, robot: StandingMechanism, q: np.ndarray, limits: MotionLimits
    ) -> RestingPosture:
        """The posture with its scene."""
        still, support = np.zeros((1, robot.n)), robot.support
        wrench = robot.loads(q[None], still, still)[1][0]
        own = wrench - support.weight
        load = Load(own[:3], own[3:], support.center_of_mass)
        where = "in the given posture" if name == "given" else f"at {name}"
        scene = Scene(f"{task} {where}", support, (load,), wrench, limits.tolerance)
        return cls(name, robot, q, limits, scene)

    @property
    def _instant(self) -> Instants:
        return Instants.at_rest(self.robot, self.q[None])

    @property
    def refusals(self) -> list[str]:
        """Why the robot itself cannot be there: angles, clearance, torques."""
        return own_refusals(self.robot, self.limits, self._instant)

    def within(self, tolerance: Tolerance) -> WithinAtRest | None:
        """The worst of a tolerance; None without one, and for parallel robots, which have none."""
        if not tolerance.given or not isinstance(self.robot, Robot):
            return None
        return posture_within(self.robot, self.q, tolerance)

    def rows(self) -> list[tuple[str, str]]:
        """Joint values, torques at rest, and what the posture breaks."""
        robot, torques = self.robot, self._instant.torques[0]
        values = [
            quantity(np.rad2deg(value) if unit == "rad" else value, "deg" if unit == "rad" else unit)
            for value, unit in zip(self.q, robot.units, strict=True)
        ]
        rows = [("posture", ", ".join(f"{n} {v}" for n, v in zip(robot.names, values, strict=True)))]
        shares = np.abs(torques) / robot.limits.torque
        joint = int(np.argmax(shares))
        if shares[joint] > 0:
            holds = quantity(torques[joint], robot.motor_units[joint] if robot.motor_units else "N m")
            rows.append(("torque", f"{holds}, {percent(shares[joint])} of the limit ({robot.names[joint]})"))
        return rows + under("but", self.refusals)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; joint values in rad and m."""
        return {
            "name": self.name,
            "joints": dict(zip(self.robot.names, self.q.tolist(), strict=True)),
            "units": list(self.robot.units),
            "torques": self._instant.torques[0].tolist(),
            "broken": self.refusals,
        }


def read_posture(options: Namespace) -> RestingPosture:
    """The robot of a task file in the posture that is asked for.

    Raises:
        InputError: no such posture, the task cannot be read, or options that robots do not have here.
    """
    for name, instead in _ELSEWHERE.items():
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')}: not with --posture; use {instead}")
    task, asked = read_task(options.scene, WORKSHOP), options.posture
    rests = _rests(task)
    if asked in rests:
        robot, q, limits = rests[asked]
        return RestingPosture.of(task.name, asked, robot, q, limits)
    robot, _, limits = rests["start"]
    return RestingPosture.of(task.name, "given", robot, _values(robot, asked, list(rests)), limits)


def _rests(task: MotionTask | CycleTask) -> dict[str, tuple[StandingMechanism, np.ndarray, MotionLimits]]:
    """Postures at rest that a task names: start, goal, goals of segments."""
    if isinstance(task, MotionTask):
        ends = {"start": (0, task.start), "goal": (1, task.goal)}
        return {name: (task.robot.resting(share), q, task.limits) for name, (share, q) in ends.items()}
    first = task.segments[0].task
    rests = {"start": (first.robot.resting(0), first.start, first.limits)}
    for segment in task.segments:
        own = segment.task
        rests[segment.name] = own.robot.resting(1), own.goal, own.limits
    return rests


def _values(robot: StandingMechanism, text: str, names: list[str]) -> np.ndarray:
    """Joint values (n,), rad and m, from text in the units of task files."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise InputError(
            f"--posture: expected {robot.n} numbers with commas, or one of {', '.join(names)}; got {text!r}"
            f"{did_you_mean(text, names)}"
        ) from None
    if len(values) != robot.n or not np.isfinite(values).all():
        raise InputError(
            f"--posture: expected {robot.n} finite numbers ({', '.join(robot.names)}), got {text!r}"
        )
    in_degrees = isinstance(robot, Robot) & (np.array(robot.units) == "rad")
    return np.where(in_degrees, np.deg2rad(values), values)
