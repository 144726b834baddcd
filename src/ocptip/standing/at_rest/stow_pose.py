"""The posture in which a mobile base may accelerate hardest, whatever the direction.

The wrench on an accelerated base is affine in the acceleration. A half space of wrenches that the contacts
hold allows the acceleration (c - h . w) / |A'h| in its worst direction, with A the change of the wrench per
acceleration. The smallest over all half spaces, of tipping axes and of friction cones, is a closed form for
many postures at once. Postures are sampled, the best ones improved by steps that stay clear of collisions.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits

_STEPS = 0.4 / 2.0 ** np.arange(9)  # rad, m/2: of the improvement
_RANDOM = 24  # directions beside those of single joints
_TRIES = 12  # steps of one size, at most
_CHUNK = 64  # postures whose distances are computed at once


class StowSearch:
    """Postures with a large acceleration in their worst direction.

    Args:
        robot: on its base, with contacts on one plane.
        limits: clearance, angle margin and torques that postures keep.

    Raises:
        InputError: contacts without half spaces.
    """

    def __init__(self, robot: Robot, limits: Limits) -> None:
        affine = robot.tip_over.affine_moments
        if affine is None:
            raise InputError("contacts: a stow pose needs contacts on one plane that can tip")
        facets = robot.slip.half_spaces(1.0)
        none = np.empty((0, 6))
        self._rows = np.vstack([-affine[0], none if facets is None else facets])
        self._bounds = np.concatenate([affine[1], np.zeros(len(self._rows) - len(affine[1]))])
        self._robot, self._limits = robot, limits
        self._low, self._high = robot.arm.angle_range(limits.angle_margin)

    def accelerations(self, q: np.ndarray) -> np.ndarray:
        """(N,) m/s^2, of postures (N, n), in the worst direction; 0 where a torque is too large."""
        robot, still = self._robot, np.zeros(q.shape)
        torques, wrenches = robot.loads(q, still, still)
        pulled = [
            robot.loads(q, still, still, base_motion=BaseMotion(axis))[1] - wrenches for axis in np.eye(3)[:2]
        ]
        slopes = np.stack([pull @ self._rows.T for pull in pulled])
        with np.errstate(divide="ignore", invalid="ignore"):
            allowed = (self._bounds - wrenches @ self._rows.T) / np.linalg.norm(slopes, axis=0)
        held = np.all(np.abs(torques) <= self._limits.torque_ratio * robot.limits.torque, axis=1)
        return np.where(held, np.maximum(np.min(allowed, axis=1), 0.0), 0.0)

    def free(self, q: np.ndarray) -> np.ndarray:
        """(N,) whether postures keep the clearance and the joint limits."""
        inside = np.all((q >= self._low) & (q <= self._high), axis=1)
        gaps = self._robot.collision.gaps(q, self._limits.clearance)
        return inside & np.all(gaps >= self._limits.clearance, axis=1)

    def best(self, drawn: np.ndarray, starts: int, rng: np.random.Generator) -> np.ndarray:
        """(k, n) postures, at most one per start, the best first.

        Args:
            drawn: (N, n) postures to begin with.
            starts: how many of them are improved.
            rng: of the directions that are tried.
        """
        values = self.accelerations(drawn)
        results = []
        for begin in self._best_free(drawn[np.argsort(-values, kind="stable")], starts):
            results.append(self._improved(begin, rng))
        if not results:
            return np.empty((0, drawn.shape[1]))
        every = np.array(results)
        return every[np.argsort(-self.accelerations(every), kind="stable")]

    def _best_free(self, ordered: np.ndarray, count: int) -> Iterator[np.ndarray]:
        for begin in range(0, len(ordered), _CHUNK):
            chunk = ordered[begin : begin + _CHUNK]
            for q in chunk[self.free(chunk)]:
                if not count:
                    return
                count -= 1
                yield q

    def _improved(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        value, n = float(self.accelerations(q[None])[0]), len(q)
        units = np.where(np.array(self._robot.units) == "rad", 1.0, 0.5)
        for step in _STEPS:
            for _ in range(_TRIES):
                random = rng.normal(size=(_RANDOM, n))
                random /= np.linalg.norm(random, axis=1, keepdims=True)
                tried = q + step * units * np.vstack([np.eye(n), -np.eye(n), random])
                tried = np.clip(tried, self._low, self._high)
                values = self.accelerations(tried)
                better = np.flatnonzero(values > value + 1e-9)
                better = better[np.argsort(-values[better], kind="stable")]
                clear = better[self.free(tried[better])] if len(better) else better
                if not len(clear):
                    break
                q, value = tried[clear[0]], float(values[clear[0]])
        return q
