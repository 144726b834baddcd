"""A plan as it is run: the points that are written, and the check of the motion between them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

from ocptip.motion.check import MotionCheck, check_motion
from ocptip.numerics.bisection import bisected
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.controllers import Controller, controller_points
from ocptip.trajectories.sampled import Motion, SampledMotion

SLOWEST = 1.25  # a motion that has to be slowed down by more is another motion
STEPS = (1.0, 1.0005, 1.002, 1.005, 1.01, 1.02, 1.05, 1.1, SLOWEST)
CLOSE = 1e-4  # of the factor


@dataclass(frozen=True, eq=False)
class Execution:
    """What runs a ramp motion, and what it makes of it.

    Attributes:
        controller: how it interpolates; "ramps": drives that take the commands as they are.
        motion: that is run.
        points: of trajectory.json; a controller makes `motion` of them.
        check: of `motion`.
        slower: factor of all times of the ramps, with which all limits are kept.
        options: step and rise time, s.
    """

    controller: Controller | Literal["ramps"]
    motion: Motion
    points: SampledMotion
    check: MotionCheck
    slower: float
    options: dict[str, float]

    @classmethod
    def of_ramps(cls, motion: ArmMotion, check: MotionCheck) -> Execution:
        """Of drives with ramps, whose check is known; the points are for controllers that draw cubics."""
        return cls("ramps", motion, controller_points(motion, "cubic"), check, 1.0, {})

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "name": self.controller,
            **{f"{name}_s": value for name, value in self.options.items()},
            "slower": self.slower,
            "points": len(self.points.times),
            **self.check.to_dict(),
        }


def execute(
    robot: StandingMechanism,
    motion: ArmMotion,
    limits: MotionLimits,
    controller: Controller,
    *,
    step: float = 0.01,
    rise_time: float = 0.02,
) -> Execution:
    """Points for a controller whose motion keeps all limits, slower than the ramps if need be.

    What it makes of the ramps differs from them a little and may break limits that they just keep. Then all
    times are stretched by the least factor that helps, up to 1.25; beyond, the motion as it is is returned,
    with its violations.

    Args:
        robot, motion, limits: as for `check_motion`.
        controller, step, rise_time: see `ocptip.trajectories.controllers.controller_points`.
    """
    options = {"step": step, "rise_time": rise_time}

    def tried(factor: float) -> Execution:
        points = controller_points(motion.time_scaled(factor), controller, **options)
        return Execution(controller, points, points, check_motion(robot, points, limits), factor, options)

    def verified(factor: float) -> Execution | None:
        found = tried(factor)
        return found if found.check.verified else None

    first = tried(1.0)
    if first.check.verified:
        return first
    for low, high in pairwise(STEPS):
        if kept := verified(high):
            return bisected(verified, low, high, kept, _near)[1]
    return first


def _near(low: float, high: float) -> bool:
    """Factors that differ by too little to be worth a check, measured by what they slow down."""
    return high - low <= max(CLOSE, 0.1 * (high - 1))
