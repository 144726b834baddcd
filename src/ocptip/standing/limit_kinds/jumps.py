"""Acceleration steps, and the load with which an elastic ground answers them.

At an acceleration step, as velocity profiles have at every switching time, the load on the base has a step. A
base on compliant feet swings: after a single step of the load from w_before to w_after the forces reach those
of

    w_after + kappa (w_after - w_before) ,   kappa = exp(-zeta pi / sqrt(1 - zeta^2))

with the damping ratio zeta of the ground (kappa = 1 without damping), whatever its stiffness. Angles and
speeds are continuous and the load is affine in the accelerations, so that this is the load of the same
instant with the accelerations after + kappa (after - before). Swings that have not died out at the next step
are not added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import JUMP, WHOLE, AskedLimit, Limit, Sampled, Worst
from ocptip.standing.limit_kinds.nominal import NominalLimit
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import INSIDE, Trajectory

SMALLEST = 1e-3  # of a joint's greatest acceleration: less is no jump, but a change within 0.3 us


@dataclass(frozen=True, eq=False)
class Jumps:
    """The E acceleration steps of a motion, start and end of the motion included.

    Attributes:
        times: (E,), s.
        angles, speeds: (E, n), rad, rad/s; they are continuous.
        before, after: (E, n) accelerations on both sides, rad/s^2; equal where a joint has no step.
    """

    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @classmethod
    def of(cls, motion: Trajectory) -> Jumps:
        """Steps of any motion: velocity profiles, or samples with a polynomial between them."""
        times = motion.event_times
        angles, speeds, _ = motion.states(times)
        before, after = (motion.states(times + side)[2] for side in (-INSIDE, INSIDE))
        jumping = np.abs(after - before) > SMALLEST * motion.acceleration_peaks
        result = jumping.any(axis=1)
        parts = angles, speeds, before, np.where(jumping, after, before)
        return cls(times[result], *(part[result] for part in parts))

    def __len__(self) -> int:
        """Number of acceleration steps."""
        return len(self.times)

    def loads(self, robot: StandingMechanism, overshoot: float) -> Instants:
        """The instants at the acceleration steps, loaded as after each step with its overshoot.

        The (E,) instants have wrenches, contact states and margins like any others.

        Args:
            robot: on its support.
            overshoot: kappa, 0 (the load after the step) to 1; -1 gives the load before it.

        Raises:
            InputError: the motion does not fit the mechanism.
        """
        robot.require_fit(self.angles.shape[1])
        accelerations = self.after + overshoot * (self.after - self.before)
        return Instants.of_states(robot, self.angles, self.speeds, accelerations, self.times)

    def words(self, index: int) -> str:
        """Which joints have a step."""
        joints = np.flatnonzero(self.after[index] != self.before[index]) + 1
        return f"joint{'s' * (len(joints) > 1)} {', '.join(map(str, joints))}"


class AtJumps(AskedLimit):
    """A limit of the loads at acceleration steps with their overshoot, not of those at ordinary instants.

    In programs its rows are at separate nodes, whose accelerations are those with overshoot.
    """

    node_kinds = (JUMP,)
    scenario = WHOLE

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        within = asked.tolerance.overshoot if robot.arm else 0.0
        return asked.overshoot > within  # else jumps count within the tolerance, with all else that is off

    def measure(self, instants: Instants) -> np.ndarray:
        return Limit.measure(self, instants)

    def refusals(self, instants: Instants) -> list[str]:
        return []

    def path_excess(self, instants: Instants) -> float:
        return -np.inf

    def kept(self, instants: Instants) -> bool:
        return True


class JumpLimit(AtJumps, NominalLimit):
    """A quantity of the contacts under the loads at acceleration steps with their overshoot."""

    words = "{} at acceleration steps", "jump_{}"
    after_steps = True

    def near(self, instants: Instants, share: float) -> np.ndarray:
        return Limit.near(self, instants, share)

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        jumps = Jumps.of(sampled.motion)
        if not len(jumps):
            return [self.worst_value(0.0, np.nan, "no acceleration steps")]
        values = self.quantity.measure_still(self._loads(jumps.loads(self.robot, self.asked.overshoot)))
        values = np.where(np.isnan(values), np.inf, values)
        k = int(np.argmax(values))
        return [self.worst_value(float(values[k]), float(jumps.times[k]), jumps.words(k))]
