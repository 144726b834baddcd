"""A plan as a controller runs it: the points that are written, and the check of the motion between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ocptip.motion.check import MotionCheck, check_motion
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.controllers import Controller, controller_points
from ocptip.trajectories.sampled import SampledMotion

SLOWEST = 1.25  # a motion that has to be slowed down by more is another motion
STEPS = (1.0, 1.0005, 1.002, 1.005, 1.01, 1.02, 1.05, 1.1, SLOWEST)
CLOSE = 1e-4  # of the factor


@dataclass(frozen=True, eq=False)
class Execution:
    """What a controller makes of a ramp motion.

    Attributes:
        controller: how it interpolates.
        points: what it gets, and the motion that it makes of them.
        check: of that motion.
        slower: factor of all times of the ramps, with which all limits are kept.
        options: step and rise time, s.
    """

    controller: Controller
    points: SampledMotion
    check: MotionCheck
    slower: float
    options: dict[str, float]

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

    def tried(factor: float) -> tuple[SampledMotion, MotionCheck]:
        points = controller_points(motion.time_scaled(factor), controller, **options)
        return points, check_motion(robot, points, limits)

    first, kept, low = tried(1.0), None, 1.0
    if first[1].verified:
        return Execution(controller, *first, 1.0, options)
    for high in STEPS[1:]:
        found = tried(high)
        if found[1].verified:
            kept = found
            break
        low = high
    if kept is None:
        return Execution(controller, *first, 1.0, options)
    while high - low > max(CLOSE, 0.1 * (high - 1)):
        middle = 0.5 * (low + high)
        found = tried(middle)
        if found[1].verified:
            kept, high = found, middle
        else:
            low = middle
    return Execution(controller, *kept, high, options)
