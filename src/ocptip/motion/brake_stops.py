"""Stops by brakes (category 0): drives lose their torque, every joint brakes by itself, the path is left.

From every instant looked at, a few stops are computed by forward dynamics: with the least and with the
greatest torques of all brakes, and with those ends of the intervals that load the nearest tipping axis most
when the brakes close. At every state on the way all combinations of torques within the intervals count: the
wrench on the base is affine in them, so that the least moments about the tipping axes are exact. For slip the
worst of three combinations is taken: that of the nearest axis, all least, all greatest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.reserves.tipping import TipMap
from ocptip.robots.braking import Braked, brake, terms
from ocptip.standing.arm import StandingRobot

POSTURES = 300  # looked at for collisions, at most
MOMENTS = 40  # of each stop, about; more of those that take much longer than others are left out


@dataclass(frozen=True, eq=False)
class BrakeStops:
    """Worst values of stops from N states of a motion.

    Attributes:
        GN, GT: (N,), during the stop.
        after: (N,), s, since the drives went off: when the larger of the two is met.
        torques: (N, n), N m: of the brakes then; 0 for joints that rest.
        rests: (N,), s, until all joints rest; infinite if they do not.
        ways: (N, n), rad (sliding joints: m): how far a joint gets at most.
        outside: how far an angle is beyond its limits at most, rad (m), and the joint, 0-based; at most 0
            where none is.
        clearance: m, smallest distance of what may collide in `postures` postures; infinite if not known.
        postures: looked at.
    """

    GN: np.ndarray
    GT: np.ndarray
    after: np.ndarray
    torques: np.ndarray
    rests: np.ndarray
    ways: np.ndarray
    outside: tuple[float, int]
    clearance: float
    postures: int


class BrakeCheck:
    """Checks stops by the brakes of an arm.

    Args:
        robot: the arm on its support.
        brakes: least and greatest torque of each brake, (n,) each, N m.
        delay: s, least and greatest time until they act.
    """

    def __init__(
        self, robot: StandingRobot, brakes: tuple[np.ndarray, np.ndarray], delay: tuple[float, float]
    ) -> None:
        self._robot, self._brakes, self._delay = robot, brakes, delay
        self._map = TipMap(robot.tip_over)

    def stops(self, q: np.ndarray, qd: np.ndarray) -> BrakeStops:
        """From angles and speeds, (N, n) each."""
        low, high = self._brakes
        worst = self._box(q, qd, np.full(len(q), self._delay[1]))[3]
        ways = [(low, self._delay[1]), (high, self._delay[0]), (worst, self._delay[1])]
        if self._delay[1] > self._delay[0]:
            ways.append((high, self._delay[1]))
        torques = np.concatenate([np.broadcast_to(torque, q.shape) for torque, _ in ways])
        delays = np.repeat([delay for _, delay in ways], len(q))
        many = np.tile(q, (len(ways), 1)), np.tile(qd, (len(ways), 1))
        run = brake(self._robot.arm, *many, self._robot.support.gravity, torques, delay=delays)
        return self._judged(q, run, np.tile(np.arange(len(q)), len(ways)))

    def _judged(self, q: np.ndarray, run: Braked, owner: np.ndarray) -> BrakeStops:
        count, n = q.shape
        going = np.any(run.speeds != 0, axis=2)
        going[np.arange(len(going)) % max(1, len(going) // MOMENTS) != 0] = False
        k, i = np.nonzero(going)
        wrenches, torques = self._wrenches(run.angles[k, i], run.speeds[k, i], run.times[k])
        states = self._robot.contact_states(wrenches.reshape(-1, 6))
        GN = _large(self._robot.tip_over.evaluate(states).GN)
        GT = _large(self._robot.slip.evaluate(states, derivatives=False).GT)
        row, time = np.repeat(owner[i], wrenches.shape[1]), np.repeat(run.times[k], wrenches.shape[1])
        worst = [np.zeros(count), np.zeros(count)]
        for found, values in zip(worst, (GN, GT), strict=True):
            np.maximum.at(found, row, values)
        at, greatest = np.full(count, -1), np.maximum(*worst)
        hit = np.flatnonzero(np.maximum(GN, GT) == greatest[row])[::-1]
        at[row[hit]] = hit
        known = at >= 0
        rests, ways = np.zeros(count), np.zeros((count, n))
        np.maximum.at(rests, owner, run.rests)
        np.maximum.at(ways, owner, np.max(np.abs(run.angles - q[owner]), axis=0))
        limits = self._robot.limits
        over = np.max(np.maximum(limits.angle_min - run.angles, run.angles - limits.angle_max), axis=(0, 1))
        joint = int(np.argmax(over))
        postures = np.concatenate([run.angles[-1], run.angles[k, i]])
        postures = postures[:: max(1, -(-len(postures) // POSTURES))]
        return BrakeStops(
            *worst,
            after=np.where(known, time[at], 0.0),
            torques=np.where(known[:, None], torques.reshape(-1, n)[at], 0.0),
            rests=rests,
            ways=ways,
            outside=(float(over[joint]), joint),
            clearance=float(np.min(self._robot.collision.least(postures))),
            postures=len(postures),
        )

    def _wrenches(self, q: np.ndarray, qd: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Three wrenches (M, 3, 6) on the base per state, and the brakes' torques (M, 3, n)."""
        rest, by_torque, (low, high), corner = self._box(q, qd, after)
        moving = qd != 0
        torques = np.stack([corner, low, high], axis=1) * moving[:, None]
        return rest[:, None] + np.einsum("sij,stj->sti", by_torque, torques), torques

    def _box(
        self, q: np.ndarray, qd: np.ndarray, after: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Wrench without brakes (M, 6), its slope over their torques (M, 6, n), their ends and worst corner.

        Joints that rest stay at rest. The worst corner loads the nearest tipping axis most.
        """
        support, moving = self._robot.support, qd != 0
        found = terms(self._robot.arm, q, qd, support.gravity, support.center_of_mass)
        inertia = found.inertia * (moving[:, :, None] & moving[:, None])
        inertia[:, np.arange(q.shape[1]), np.arange(q.shape[1])] += ~moving
        response = np.linalg.inv(inertia) * (moving[:, :, None] & moving[:, None])
        per_torque = found.per_acceleration @ response
        rest = found.rest + support.weight - np.einsum("sij,sj->si", per_torque, found.bias)
        by_torque = -per_torque * np.sign(qd)[:, None]
        none = np.zeros_like(q)
        acts, surely = (after[:, None] >= self._delay[0]), (after[:, None] >= self._delay[1])
        low, high = np.where(surely, self._brakes[0], none), np.where(acts, self._brakes[1], none)
        if not self._map.count:
            return rest, by_torque, (low, high), high
        middle = 0.5 * (low + high)
        moments, slopes = self._map(rest + np.einsum("sij,sj->si", by_torque, middle))
        pull = np.einsum("sai,sij->saj", slopes, by_torque)
        least = moments - np.sum(np.abs(pull) * 0.5 * (high - low)[:, None], axis=2)
        nearest = pull[np.arange(len(q)), np.argmin(least, axis=1)]
        return rest, by_torque, (low, high), np.where(nearest < 0, high, low)


def _large(values: np.ndarray) -> np.ndarray:
    """What is not known counts as infinite."""
    return np.where(np.isnan(values), np.inf, values)
