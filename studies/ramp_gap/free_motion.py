"""Motions of free form: speeds that are piecewise quadratic in time, on equal intervals.

In an interval of length h the speed is the Bernstein polynomial of v0, b, v1. Hence

    q1 = q0 + h (v0 + b + v1) / 3,      acceleration from 2 (b - v0) / h to 2 (v1 - b) / h, linear,

and bounds on v0, b, v1 bound the speed at all instants. Speeds are continuous at the ends of the intervals,
accelerations may jump there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.trajectories.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """A motion with piecewise quadratic speeds on N equal intervals, n joints.

    Attributes:
        duration: s.
        angles, speeds: at the ends of the intervals, (N + 1, n), rad, rad/s.
        middles: middle Bernstein coefficients b of the speed, (N, n), rad/s.
    """

    duration: float
    angles: np.ndarray
    speeds: np.ndarray
    middles: np.ndarray

    @classmethod
    def through(cls, duration: float, angles: np.ndarray, speeds: np.ndarray) -> FreeMotion:
        """The motion with these angles and speeds at the ends of the intervals."""
        h = duration / (len(angles) - 1)
        middles = 3 / h * np.diff(angles, axis=0) - speeds[:-1] - speeds[1:]
        return cls(duration, angles, speeds, middles)

    @property
    def h(self) -> float:
        """Length of an interval, s."""
        return self.duration / len(self.middles)

    @property
    def signs(self) -> np.ndarray:
        """(N, n), in which direction each joint goes in each interval: +1 or -1."""
        return np.where(np.diff(self.angles, axis=0) < 0, -1.0, 1.0)

    def inside(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, speeds, accelerations at fractions x (K,) of all intervals: three arrays (N, K, n)."""
        v0, b, v1 = self.speeds[:-1, None], self.middles[:, None], self.speeds[1:, None]
        return curve(self.angles[:-1, None], v0, b, v1, self.h, np.asarray(x)[:, None])

    def refined(self) -> FreeMotion:
        """The same motion on twice as many intervals."""
        q, v, _ = self.inside(np.array([0.0, 0.5]))
        both = [np.concatenate([x.reshape(-1, x.shape[2]), end[-1:]]) for x, end in
                ((q, self.angles), (v, self.speeds))]  # fmt: skip
        return FreeMotion.through(self.duration, *both)

    def turning_points(self) -> np.ndarray:
        """Times at which a joint's speed passes zero inside an interval, (T,), s."""
        v0, b, v1 = self.speeds[:-1], self.middles, self.speeds[1:]
        found = []
        for k, j in np.argwhere(
            (np.minimum(np.minimum(v0, b), v1) < 0) & (np.maximum(np.maximum(v0, b), v1) > 0)
        ):
            roots = np.roots([v0[k, j] - 2 * b[k, j] + v1[k, j], 2 * (b[k, j] - v0[k, j]), v0[k, j]])
            roots = roots[np.isreal(roots)].real
            found += (self.h * (k + roots[(roots > 0) & (roots < 1)])).tolist()
        return np.array(found)

    def states(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, speeds, accelerations at times (T,), s, at jumps those after it: three arrays (T, n)."""
        k = np.clip((np.asarray(times) / self.h).astype(int), 0, len(self.middles) - 1)
        x = (times - k * self.h) / self.h
        return curve(self.angles[k], self.speeds[k], self.middles[k], self.speeds[k + 1], self.h, x[:, None])


def curve(q0, v0, b, v1, h, x):
    """Angle, speed, acceleration at fraction x of an interval; NumPy or CasADi."""
    q = q0 + h * x * (v0 + x * ((b - v0) + x * (v0 - 2 * b + v1) / 3))
    v = v0 + x * (2 * (b - v0) + x * (v0 - 2 * b + v1))
    a = 2 / h * ((b - v0) + x * (v0 - 2 * b + v1))
    return q, v, a


def minimum_jerk(start: np.ndarray, goal: np.ndarray, duration: float, intervals: int) -> FreeMotion:
    """The fifth-order polynomial from rest to rest."""
    return via_motion(start, goal, np.zeros_like(start), duration, intervals)


def via_motion(
    start: np.ndarray, goal: np.ndarray, detour: np.ndarray, duration: float, intervals: int
) -> FreeMotion:
    """Minimum jerk plus a detour (n,), rad, that is largest halfway."""
    s = np.linspace(0, 1, intervals + 1)[:, None]
    q = start + (goal - start) * s**3 * (10 - 15 * s + 6 * s**2) + detour * 64 * (s * (1 - s)) ** 3
    v = (goal - start) * 30 * (s * (1 - s)) ** 2 + detour * 192 * (s * (1 - s)) ** 2 * (1 - 2 * s)
    return FreeMotion.through(duration, q, v / duration)


def sampled(motion: Trajectory, intervals: int) -> FreeMotion:
    """A ramp motion at the ends of equal intervals."""
    q, v, _ = motion.states(np.linspace(0, motion.end, intervals + 1))
    v[[0, -1]] = 0.0
    return FreeMotion.through(motion.end, q, v)


def with_triangles(motion: FreeMotion, joints: Sequence[int]) -> FreeMotion:
    """The motion with these joints on symmetric triangles of speed, the passive ramp (5.17); N even."""
    if not joints:
        return motion
    ramps = [(motion.angles[0, j], motion.angles[-1, j], motion.duration) for j in joints]
    s = np.linspace(0, 1, len(motion.angles))
    q, v = motion.angles.copy(), motion.speeds.copy()
    for j, (first, last, duration) in zip(joints, ramps, strict=True):
        way = np.where(s < 0.5, 2 * s**2, 1 - 2 * (1 - s) ** 2)
        q[:, j] = first + (last - first) * way
        v[:, j] = (last - first) / duration * 4 * np.minimum(s, 1 - s)
    return FreeMotion.through(motion.duration, q, v)


def motion_dict(motion: FreeMotion) -> dict:
    """A motion as plain data, degrees."""
    columns = {"angles_deg": motion.angles, "speeds_deg_s": motion.speeds, "middles_deg_s": motion.middles}
    return {"duration_s": motion.duration, **{k: np.rad2deg(x).tolist() for k, x in columns.items()}}


def motion_from(data: dict) -> FreeMotion:
    """The inverse of `motion_dict`."""
    columns = (np.deg2rad(data[key]) for key in ("angles_deg", "speeds_deg_s", "middles_deg_s"))
    return FreeMotion(data["duration_s"], *columns)
