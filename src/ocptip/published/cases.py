"""The eight cases A to H of the modular-arm experiment (table 5.1), their printed solutions (E.1, E.2).

The data files are transcriptions in degrees and millimetres; here they become SI units and radians, once. Two
traps are handled here and nowhere else: the columns A/B, D/E and G/H of tables E.1 and E.2 are interchanged
against table 5.1 (`column_to_table51_case`), and parameter 20 of column B lost its sign in print
(`E1_misprints`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError
from ocptip.basics.frozen import read_only
from ocptip.published.arms import GripperPose, experiment_poses, published_data, start_and_goal
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class PrintedTime:
    """An entry of table E.2.

    Attributes:
        seconds: as printed, s.
        half_unit: half a unit of the last printed digit, s.
    """

    seconds: float
    half_unit: float


@dataclass(frozen=True, eq=False)
class MotionCase:
    """One case of table 5.1 with its printed solution.

    Attributes:
        name: "A" to "H", as in table 5.1.
        column: column of tables E.1 and E.2 that holds its solution.
        arm: name of the arm.
        triangle_side: side of the base's equilateral contact triangle, m.
        clamped: a force-constant clamp holds the base at K3.
        start_pose, goal_pose: of the gripper.
        start, goal: joint angles, (6,), rad, see `ocptip.published.arms.start_and_goal`.
        reference_commands: three commands for each of joints 1 to 3 (table E.1); the last target is the goal.
        printed_times: table E.2, by the names `t1_1p` (t' of joint 1, command 1), `t1_1pp` (t''), `t1_E`,
            `t4_p`, `t4_pp`, `t_E`, `z1_2` (zero crossing of joint 1 in acceleration phase 2; absent if there
            is none).
        printed_duration: s, two decimals.
    """

    name: str
    column: str
    arm: str
    triangle_side: float
    clamped: bool
    start_pose: GripperPose
    goal_pose: GripperPose
    start: np.ndarray
    goal: np.ndarray
    reference_commands: tuple[tuple[RampCommand, ...], ...]
    printed_times: Mapping[str, PrintedTime]
    printed_duration: float

    def reference_motion(self, speed_limits: ArrayLike, acceleration_limits: ArrayLike) -> Trajectory:
        """Return the printed solution with joints 4 to 6 passive.

        Args:
            speed_limits: of the six joints (only those of joints 4 to 6 matter), (6,), rad/s.
            acceleration_limits: likewise, (6,), rad/s^2.
        """
        commands = [*self.reference_commands, None, None, None]
        return Trajectory.ending_together(self.start, self.goal, commands, speed_limits, acceleration_limits)


@cache
def motion_case(name: str) -> MotionCase:
    """Return the case of that name.

    Raises:
        InputError: there is no such case; lists those there are.
    """
    table, solutions = published_data("cases"), published_data("reference_solutions")
    if name not in table["cases"]:
        raise InputError(f"case: there is no {name!r}; there are {', '.join(case_names())}")
    columns = {case: column for column, case in solutions["column_to_table51_case"].items()}
    entry, column = table["cases"][name], columns[name]
    start_pose, goal_pose = experiment_poses()
    start, goal = _shortest(*start_and_goal(entry["arm"]))
    return MotionCase(
        name=name,
        column=column,
        arm=entry["arm"],
        triangle_side=entry["l_mm"] / 1000,
        clamped=entry["clamp_K3"],
        start_pose=start_pose,
        goal_pose=goal_pose,
        start=start,
        goal=goal,
        reference_commands=_commands(solutions, column, np.rad2deg(goal[:3]).tolist()),
        printed_times=MappingProxyType(
            {key: _time(x) for key, x in solutions["E2"][column].items() if x is not None}
        ),
        printed_duration=entry["duration_s"],
    )


def case_names() -> tuple[str, ...]:
    """Return the names of the eight cases, A to H."""
    return tuple(published_data("cases")["cases"])


def motion_cases() -> Mapping[str, MotionCase]:
    """Return the eight cases by name."""
    return MappingProxyType({name: motion_case(name) for name in case_names()})


def _shortest(start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal with the last joint, whose roll the experiment leaves open, turning by the smaller
    angle.
    """
    goal = goal.copy()
    goal[-1] = start[-1] + math.remainder(goal[-1] - start[-1], math.tau)
    return read_only(start.copy()), read_only(goal)


def _commands(
    solutions: Mapping[str, Any], column: str, goal_deg: list[float]
) -> tuple[tuple[RampCommand, ...], ...]:
    """Table E.1: per joint phi_e, speed, acceleration of commands 1 and 2, then speed, acceleration of 3."""
    values = dict(zip(solutions["parameter_names"], solutions["E1"][column], strict=True))
    for name, misprint in solutions["E1_misprints"].get(column, {}).items():
        values[name] = misprint["correct"]
    return tuple(
        tuple(
            RampCommand(
                math.radians(goal if k == 3 else values[f"phi_e_{joint}_{k}"]),
                math.radians(values[f"phidot_{joint}_{k}"]),
                math.radians(values[f"phiddot_{joint}_{k}"]),
            )
            for k in (1, 2, 3)
        )
        for joint, goal in enumerate(goal_deg, 1)
    )


def _time(seconds: float) -> PrintedTime:
    """Most entries have four decimals, eight have five."""
    return PrintedTime(seconds, 5e-5 if round(seconds, 4) == seconds else 5e-6)
