"""The rules by which a robot is stopped: table `[stops]` of task files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number, share_of_one
from ocptip.basics.frozen import settle
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import PathStops
from ocptip.standing.stops.by_brakes import Brakes
from ocptip.standing.stops.by_cancel import LONGEST, Cancel

Kinds = Literal["path", "brakes", "both", "cancel", "all"]

SCENARIOS: dict[Kinds, tuple[str, ...]] = {
    "path": ("path",),
    "brakes": ("brakes",),
    "both": ("path", "brakes"),
    "cancel": ("cancel",),
    "all": ("path", "brakes", "cancel"),
}
"""The scenarios of each kind: along the path, by brakes, by a controller that is cancelled."""


def kinds_of(scenarios: Iterable[str]) -> Kinds:
    """The kinds that ask for these scenarios, or else for all."""
    asked = tuple(scenarios)
    for kinds, scenario in SCENARIOS.items():
        if scenario == asked:
            return kinds
    return "all"


BRAKES = (0.5, 2.0)
"""Brake torques as shares of the torque limits where none are given: a round interval. A brake that just
holds the arm has about the rated torque; a new one, or one that gears help, may have several times that."""

HOLDING = 1.3
"""A brake that is not given holds at least this share of what gravity asks in any posture: makers of drives
ask for it in tests of holding brakes (docs/stops.md)."""

NO_DATA = "stops by brakes (category 0) not checked: no brake data"


@dataclass(frozen=True, eq=False)
class StopRules:
    """The limits of stops, and the parameters by which they are computed.

    Attributes:
        GN, GT: maximum during stops, at most 1; None: those of the motion.
        time: s, that the time law of a stop along the path takes at least from the planned speed to rest; 0:
            as little as the drives can.
        brake_min, brake_max: (n,), N m (sliding joints: N): minimum and maximum torque with which each brake
            acts; None: `BRAKES` of the torque limits, at least `HOLDING` times what gravity asks.
        delay: s, minimum and maximum time from when the drives lose their torque until the brakes act.
        deceleration: (n,), rad/s^2 (sliding joints: m/s^2), of a controller that is cancelled; None: the
            acceleration limits.
        stopj: rad/s^2; instead, all joints come to rest together, the leading one at this rate, as `stopj` of
            Universal Robots commands it.
        share: of `deceleration` or `stopj` that it uses.
        reaction: s, at most from a cancel until the joints decelerate.
        longest: s, at most from a cancel until everything rests.
        base_deceleration: m/s^2, of a base that drives, when the motion is cancelled; 0: it drives on.
        STOPJ: rad/s^2 of `stopj` as the driver of Universal Robots calls it, see
            `ocptip.standing.stops.by_cancel`.
    """

    STOPJ: ClassVar[float] = 4.0
    GN: float | None = None
    GT: float | None = None
    time: float = 0.0
    brake_min: np.ndarray | None = None
    brake_max: np.ndarray | None = None
    delay: tuple[float, float] = (0.0, 0.0)
    deceleration: np.ndarray | None = None
    stopj: float | None = None
    share: float = 1.0
    reaction: float = 0.0
    longest: float = LONGEST
    base_deceleration: float = 0.0

    @property
    def guessed(self) -> bool:
        """Brake torques are not given."""
        return self.brake_min is None or self.brake_max is None

    @property
    def of_limits(self) -> bool:
        """Cancels decelerate at a share of the acceleration limits."""
        return self.deceleration is None and self.stopj is None

    def __post_init__(self) -> None:
        for name in ("GN", "GT"):
            if getattr(self, name) is not None:
                share_of_one(name, getattr(self, name))
        positive_number("time", self.time, zero_allowed=True)
        for name in ("share", "longest", *(("stopj",) if self.stopj is not None else ())):
            positive_number(name, getattr(self, name))
        for name in ("reaction", "base_deceleration"):
            positive_number(name, getattr(self, name), zero_allowed=True)
        for name in ("brake_min", "brake_max", "deceleration"):
            if (value := getattr(self, name)) is not None:
                value = finite_array(name, value, (None,))
                if not (value > 0).all():
                    raise InputError(f"{name}: must be > 0, got {value}")
                settle(self, **{name: value})
        low, high = self.brake_min, self.brake_max
        if low is not None and high is not None and (len(low) != len(high) or (low > high).any()):
            raise InputError(f"brake_max: must be >= the minimum, {low.tolist()}, got {high.tolist()}")
        least, most = self.delay
        positive_number("delay", least, zero_allowed=True)
        if not least <= positive_number("delay", most, zero_allowed=True):
            raise InputError(f"delay: expected [minimum, maximum], s, got [{least}, {most}]")

    def asked(self, limits: Limits) -> Limits:
        """The limits with stops along the path."""
        stops = PathStops(self.GN or limits.GN, self.GT or limits.GT, self.time)
        return replace(limits, stops=stops)

    def safe(self, limits: Limits, robot: StandingMechanism, kinds: Kinds | None = None) -> Limits:
        """The limits with stops of these kinds.

        Args:
            limits: of a motion.
            robot: whose.
            kinds: along the path, by brakes, or both; default both where the brakes' torques are given, else
                along the path.

        Raises:
            InputError: see `brakes`; or a parallel robot's brakes are asked for.
        """
        if kinds is None:
            kinds = "path" if self.brake_min is None and self.brake_max is None else "both"
        if "path" in SCENARIOS[kinds]:
            limits = self.asked(limits)
        if robot.arm is None:
            if kinds == "path":
                return limits
            raise InputError("stops by brakes (category 0) and cancels are not computed for parallel robots")
        GN, GT = self.GN or limits.GN, self.GT or limits.GT
        if "brakes" in SCENARIOS[kinds]:
            least, greatest = (tuple(ends.tolist()) for ends in self.brakes(robot))
            limits = replace(limits, brakes=Brakes(least, greatest, self.delay, GN, GT))
        if "cancel" in SCENARIOS[kinds]:
            limits = replace(limits, cancel=self.cancel(Robot.of(robot), limits))
        return limits

    def cancel(self, robot: Robot, limits: Limits, share: float | None = None) -> Cancel:
        """How a controller of this robot stops, with a share of its deceleration; default: `share`.

        Raises:
            InputError: the number of decelerations is not the robot's, or none are given and a joint has no
                acceleration limit; or a joint slides, which `stopj` does not know.
        """
        if self.stopj is not None and "m" in robot.units:
            raise InputError(f"stopj: is about turning joints; {robot.names[robot.units.index('m')]} slides")
        full = robot.limits.acceleration if self.deceleration is None else self.deceleration
        full = full if self.stopj is None else np.full(robot.n, self.stopj)
        if len(full) != robot.n:
            raise InputError(f"deceleration: expected {robot.n} decelerations, got {len(full)}")
        if not np.isfinite(full).all():
            joint = int(np.argmin(np.isfinite(full))) + 1
            raise InputError(
                f"deceleration: joint {joint} has no acceleration limit to take it from; give "
                "cancel_deceleration_deg_s2 in [stops]"
            )
        rates = tuple(((self.share if share is None else share) * full).tolist())
        GN, GT = self.GN or limits.GN, self.GT or limits.GT
        together = self.stopj is not None
        return Cancel(rates, self.reaction, self.longest, GN, GT, together, self.base_deceleration)

    def lacking(self, robot: StandingMechanism) -> str:
        """Why brake torques can be neither taken from the task nor assumed; empty: they can."""
        unlimited = np.flatnonzero(~np.isfinite(robot.limits.torque))
        if not self.guessed or not len(unlimited):
            return ""
        return (
            f"{NO_DATA}, and joint {unlimited[0] + 1} has no torque limit to assume them from; give "
            "brake_torque_min_Nm, _max_Nm in [stops]"
        )

    def brakes(self, robot: StandingMechanism) -> tuple[np.ndarray, np.ndarray]:
        """Minimum and maximum brake torques, (n,) each, N m.

        Raises:
            InputError: their number is not the robot's, or they are not given and a torque limit is infinite.
        """
        results, holds = [], np.zeros(robot.n)
        if self.guessed:
            # A brake whose greatest torque is given has no more than that, even if gravity asks for more.
            most = np.inf if self.brake_max is None else self.brake_max
            holds = np.minimum(HOLDING * robot.gravity_torques(), most)
        for name, share in zip(("brake_min", "brake_max"), BRAKES, strict=True):
            value = getattr(self, name)
            if value is None:
                value = np.maximum(share * robot.limits.torque, holds)
            if len(value) != robot.n:
                raise InputError(f"{name}: expected {robot.n} torques, got {len(value)}")
            if not np.isfinite(value).all():
                joint = int(np.argmin(np.isfinite(value))) + 1
                raise InputError(f"{name}: joint {joint} has no torque limit; give its brake's torque")
            results.append(value)
        if (results[0] > results[1]).any():
            joint = int(np.argmax(results[0] > results[1]))
            least, most = (f"{ends[joint]:.6g}" for ends in results)
            brakes_here = [
                "" if ends is not None else f", {share:g} times the torque limit, as none is given"
                for ends, share in zip((self.brake_min, self.brake_max), BRAKES, strict=True)
            ]
            name = "brake_min" if self.brake_max is None else "brake_max"
            raise InputError(
                f"{name}: joint {joint + 1}: the minimum, {least}{brakes_here[0]}, is above the maximum, "
                f"{most}{brakes_here[1]}"
            )
        return results[0], results[1]
