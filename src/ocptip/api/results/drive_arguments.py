"""What is asked of a drive envelope: its arguments, and the manoeuvres that they mean."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ocptip.standing.at_rest.manoeuvres import Manoeuvre


@dataclass(frozen=True)
class DriveArguments:
    """Arguments of `drive`."""

    directions: int
    speed: float
    turning: float
    slope: float
    deceleration: float | None
    holonomic: bool

    @cached_property
    def manoeuvres(self) -> tuple[Manoeuvre, ...]:
        """Those beside the directions."""
        slope, turn = f"{np.degrees(self.slope):.4g} deg", f"{self.speed:.4g} m/s"
        on_slopes = (
            Manoeuvre("brake_downhill", f"brake downhill, {slope}"),
            Manoeuvre("brake_uphill", f"brake uphill, {slope}"),
            Manoeuvre("brake_across_left", f"brake, left {slope} down"),
            Manoeuvre("brake_across_right", f"brake, right {slope} down"),
        )
        return (
            Manoeuvre("accelerate", "accelerate forward"),
            Manoeuvre("brake", "brake"),
            Manoeuvre("left", "accelerate to the left"),
            Manoeuvre("right", "accelerate to the right"),
            *(on_slopes if self.slope else ()),
            Manoeuvre("turn_left", f"turn left at {turn}", "rad/s"),
            Manoeuvre("turn_right", f"turn right at {turn}", "rad/s"),
            Manoeuvre("start_turning_left", "start to turn left", "rad/s^2"),
            Manoeuvre("start_turning_right", "start to turn right", "rad/s^2"),
            Manoeuvre("stop_left", "stop in a left turn"),
            Manoeuvre("stop_right", "stop in a right turn"),
            Manoeuvre("stop_speed_left", "speed for a stop, left", "m/s"),
            Manoeuvre("stop_speed_right", "speed for a stop, right", "m/s"),
        )
