"""A path with its timing: x = (ds/dt)^2 is linear in s between nodes, so that d2s/dt2 is constant there.

Time is then known in closed form: ds/dt is linear in t between nodes. Accelerations jump at nodes, as those
of ramps do at their events. Where the times of the nodes are given, s is the cubic in t between them that has
these times and speeds: then accelerations need not jump.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, naming, positive_number
from ocptip.basics.frozen import settle
from ocptip.trajectories.arm_motion import MERGE, EventfulMotion
from ocptip.trajectories.path import JointPath, derivatives
from ocptip.trajectories.ramps import checked_times

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

BACK = 1e-7  # of the greatest ds/dt: so far below 0 is rounding
_HALVINGS = 60  # of intervals, for times at places
_SAMPLES, _ZOOMS, _NEAREST = 17, 5, 4  # per interval; rounds; intervals with the greatest values


@dataclass(frozen=True, eq=False)
class TimedPath(EventfulMotion):
    """A motion along a path. Serves wherever an `ArmMotion` is checked.

    It rests before its start and after its end.

    Attributes:
        path: whose breakpoints are among the nodes.
        s: (N + 1,), increasing from 0 to 1: the nodes.
        x: (N + 1,), 1/s^2, >= 0: squares of ds/dt at the nodes; never 0 at two neighbours.
        times: (N + 1,), s, increasing from 0: when it passes the nodes; None: d2s/dt2 is constant between
            them, which says when.
    """

    path: JointPath
    s: np.ndarray
    x: np.ndarray
    times: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Raise InputError if shapes do not fit, nodes do not increase or miss breakpoints, or it stops."""
        s = finite_array("s", self.s, (None,))
        x = finite_array("x", self.x, s.shape)
        if len(s) < 2 or s[0] != 0 or s[-1] != 1 or np.any(np.diff(s) <= 0):
            raise InputError("s: expected at least two nodes, increasing from 0 to 1")
        if missed := np.setdiff1d(self.path.breakpoints, s).tolist():
            raise InputError(f"s: the path's breakpoint {missed[0]:.9g} is no node")
        if np.any(x < 0):
            raise InputError(f"x: must be >= 0, got {x.min():.6g}")
        if (stuck := np.flatnonzero(np.maximum(x[:-1], x[1:]) == 0)).size:
            raise InputError(f"x: is 0 from s = {s[stuck[0]]:.6g} to {s[stuck[0] + 1]:.6g}: it never goes on")
        settle(self, s=s, x=x)
        if self.times is not None:
            times = finite_array("times", self.times, s.shape)
            if times[0] != 0 or np.any(np.diff(times) <= 0):
                raise InputError("times: expected increasing ones from 0")
            settle(self, times=times)
            if (least := self._least_speed) < -BACK * np.sqrt(x.max()):
                raise InputError(f"times: between nodes it goes backwards, ds/dt is {least:.3g}")

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.path.joints

    @property
    def start(self) -> np.ndarray:
        """Angles before the motion, (n,), rad."""
        return self.path.start

    @property
    def goal(self) -> np.ndarray:
        """Angles after the motion, (n,), rad."""
        return self.path.goal

    @cached_property
    def node_times(self) -> np.ndarray:
        """When the nodes are passed, (N + 1,), s."""
        if self.times is not None:
            return self.times
        speeds = np.sqrt(self.x)
        return np.append(0.0, np.cumsum(2 * np.diff(self.s) / (speeds[:-1] + speeds[1:])))

    @property
    def end(self) -> float:
        """Time of rest after the motion, s."""
        return float(self.node_times[-1])

    @property
    def u(self) -> np.ndarray:
        """d2s/dt2 after the nodes, (N,), 1/s^2; without given times it is constant between nodes."""
        if self.times is None:
            return 0.5 * np.diff(self.x) / np.diff(self.s)
        h, speeds = np.diff(self.times), np.sqrt(self.x)
        return 2 * (3 * np.diff(self.s) / h - 2 * speeds[:-1] - speeds[1:]) / h

    @property
    def third(self) -> np.ndarray:
        """d3s/dt3 between the nodes, (N,), 1/s^3."""
        if self.times is None:
            return np.zeros(len(self.s) - 1)
        h, speeds = np.diff(self.times), np.sqrt(self.x)
        return 6 * (speeds[:-1] + speeds[1:] - 2 * np.diff(self.s) / h) / h**2

    @property
    def angle_ranges(self) -> np.ndarray:
        """Least and greatest angle of each joint during the motion, exact, (n, 2), rad."""
        return self.path.ranges

    @cached_property
    def speed_peaks(self) -> np.ndarray:
        """Greatest |speed| of each joint, exact, (n,), rad/s: at nodes or where accelerations vanish."""
        if self.times is not None:
            return self._sampled_peaks(1)
        return self._peaks(1, self._accelerations)

    @cached_property
    def acceleration_peaks(self) -> np.ndarray:
        """Greatest |acceleration| of each joint, exact, (n,), rad/s^2."""
        if self.times is not None:
            return self._sampled_peaks(2)
        return self._peaks(2, self._accelerations.derivative())

    @cached_property
    def jerk_peaks(self) -> np.ndarray:
        """Greatest |jerk| of each joint between nodes, (n,), rad/s^3; infinite without given times."""
        return np.full(self.n, np.inf) if self.times is None else self._sampled_peaks(3)

    @property
    def acceleration_jumps(self) -> np.ndarray:
        """Greatest jump of each joint's acceleration at nodes, ends at rest included, (n,), rad/s^2."""
        own = self.x == 0
        own[1:-1] = True
        times = self.node_times[own]
        after, before = self.states(times)[2], self.states(times, side="left")[2]
        return np.max(np.abs(after - before), axis=0, initial=0.0)

    def states(
        self, times: ArrayLike, *, side: Literal["left", "right"] = "right"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles (rad), speeds (rad/s), accelerations (rad/s^2) at N times (s): three arrays (N, n).

        Args:
            times: when; a single time gives (n,).
            side: "right": at a node the acceleration after it, "left": the one before it.

        Raises:
            InputError: a time is not finite, or side is another word.
        """
        t = checked_times(times, side)
        nodes = self.node_times
        interval = np.searchsorted(nodes, t, side=side) - 1
        moving = ((interval >= 0) & (interval < len(self.s) - 1))[..., None]
        interval = np.clip(interval, 0, len(self.s) - 2)
        elapsed = np.clip(t - nodes[interval], 0.0, np.diff(nodes)[interval])
        s, rate, u = self._law(interval, elapsed)
        q, dq, ddq = self.path.at(s, side=side)
        rate = rate[..., None]
        qdd = dq * u[..., None] + ddq * rate**2
        return q, np.where(moving, dq * rate, 0.0), np.where(moving, qdd, 0.0)

    def places(self, times: ArrayLike) -> np.ndarray:
        """s at N times, (N,)."""
        t, nodes = np.clip(times, 0.0, self.end), self.node_times
        interval = np.clip(np.searchsorted(nodes, t, side="right") - 1, 0, len(self.s) - 2)
        return self._law(interval, t - nodes[interval])[0]

    def times_at(self, s: ArrayLike) -> np.ndarray:
        """When places (N,) in [0, 1] are passed, (N,), s."""
        s = np.asarray(s, dtype=float)
        interval = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        way, begin = s - self.s[interval], self.x[interval]
        here = np.sqrt(np.maximum(begin + 2 * self.u[interval] * way, 0.0))
        pace = np.sqrt(begin) + here
        if self.times is not None:
            low, high = self.times[interval], self.times[interval + 1]
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                early = self._law(interval, middle - self.times[interval])[0] < s
                low, high = np.where(early, middle, low), np.where(early, high, middle)
            return 0.5 * (low + high)
        return self.node_times[interval] + np.divide(2 * way, pace, out=np.zeros_like(way), where=pace > 0)

    @cached_property
    def event_times(self) -> np.ndarray:
        """Nodes, and all instants at which a joint's speed changes sign, sorted, (S,), s.

        Instants within 0.1 us of the one before are one with it.
        """
        turns = self.path.curve.derivative()
        places = np.concatenate(turns.roots(discontinuity=False, extrapolate=False))
        places = places[np.isfinite(places) & (places > 0) & (places < 1)]
        kept = [0.0]
        for t in np.unique(np.concatenate([self.node_times, self.times_at(places)])):
            if t - kept[-1] > MERGE and self.end - t > MERGE:
                kept.append(float(t))
        return np.array([*kept, self.end])

    def time_scaled(self, factor: float) -> TimedPath:
        """Return the same path with all times multiplied by `factor` > 0 (below 1: faster)."""
        factor = positive_number("factor", factor)
        times = None if self.times is None else factor * self.times
        return TimedPath(self.path, self.s, self.x / factor**2, times)

    def _law(self, interval: np.ndarray, elapsed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """s, ds/dt and d2s/dt2 some time after the begins of intervals."""
        u, speed, third = self.u[interval], np.sqrt(self.x[interval]), self.third[interval]
        s = self.s[interval] + elapsed * (speed + elapsed * (0.5 * u + elapsed * third / 6))
        rate = np.maximum(speed + elapsed * (u + 0.5 * elapsed * third), 0.0)
        return np.clip(s, self.s[interval], self.s[interval + 1]), rate, u + elapsed * third

    @property
    def _least_speed(self) -> float:
        """Least ds/dt between nodes, before it is taken as 0."""
        u, third, h = self.u, self.third, np.diff(self.node_times)
        t = np.clip(np.divide(-u, third, out=np.zeros_like(u), where=third != 0), 0.0, h)
        return float(np.min(np.sqrt(self.x[:-1]) + t * (u + 0.5 * t * third)))

    @cached_property
    def _accelerations(self) -> PPoly:
        """Of the joints as functions of s, polynomials between nodes."""
        curve, begins = self.path.curve, self.s[:-1]
        degree = len(self.path.coefficients) - 1
        x, u = self.x[:-1, None], self.u[:, None]
        derivatives = [curve(begins, nu=k) / factorial(k - 1) for k in range(1, degree + 1)]
        parts = np.zeros((degree, *derivatives[0].shape))  # of the powers 0, 1 ...
        for k, value in enumerate(derivatives):  # q' = sum value y^k, q'' = sum k value y^(k - 1), x + 2 u y
            parts[k] += u * value + 2 * u * k * value
            if k:
                parts[k - 1] += x * k * value
        return type(curve)(parts[::-1], self.s)

    def slowed(self, factor: float) -> TimedPath:
        """The same as `time_scaled`, as other motions have it."""
        return self.time_scaled(factor)

    def to_dict(self, units: Sequence[str] = ()) -> dict[str, Any]:
        """Return `start` (degrees; m where `units` says so) and `path`, pieces and timing, rad and s."""
        turning = np.array(units or ["rad"] * self.n) == "rad"
        named = {} if turning.all() else {"units": ["deg" if turns else "m" for turns in turning]}
        path = {
            "breakpoints": self.path.breakpoints.tolist(),
            "coefficients_rad": self.path.coefficients.tolist(),
            "s": self.s.tolist(),
            "x_1_s2": self.x.tolist(),
            **({} if self.times is None else {"times_s": self.times.tolist()}),
        }
        return {
            **named,
            "start": np.where(turning, np.rad2deg(self.start), self.start).tolist(),
            "path": path,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TimedPath:
        """Return the motion written by :meth:`to_dict`, to the last bit.

        Raises:
            InputError: a key is missing, or its value cannot be used; names it.
        """
        own = data.get("path")
        keys = ("breakpoints", "coefficients_rad", "s", "x_1_s2")
        if not isinstance(own, Mapping) or any(key not in own for key in keys):
            raise InputError(f"path: expected a table with {', '.join(keys)}")
        with naming("path"):
            shapes = (None,), (None, None, None), (None,), (None,)
            values = [finite_array(key, own[key], shape) for key, shape in zip(keys, shapes, strict=True)]
            times = finite_array("times_s", own["times_s"], (None,)) if "times_s" in own else None
            return cls(JointPath(*values[:2]), values[2], values[3], times)

    def _sampled_peaks(self, order: int) -> np.ndarray:
        """Greatest absolute speeds (order 1), accelerations (2), jerks (3): samples, refined around these."""
        h, third = np.diff(self.node_times), self.third
        shares = np.linspace(0.0, 1.0, _SAMPLES)
        peaks = np.zeros(self.n)
        for joint in range(self.n):
            interval, low, high = np.arange(len(h)), np.zeros(len(h)), np.ones(len(h))
            for _ in range(_ZOOMS):
                share = low[:, None] + (high - low)[:, None] * shares
                elapsed = (share * h[interval, None]).ravel()
                owner = np.repeat(interval, _SAMPLES)
                values = np.abs(self._derivative(owner, elapsed, third[owner], order, joint))
                values = values.reshape(share.shape)
                peaks[joint] = max(peaks[joint], float(values.max()))
                best = np.argmax(values, axis=1)
                chosen = np.argsort(-values.max(axis=1))[:_NEAREST]
                at = best[chosen]
                rows = np.arange(len(share))[chosen]
                interval = interval[chosen]
                low = share[rows, np.maximum(at - 1, 0)]
                high = share[rows, np.minimum(at + 1, _SAMPLES - 1)]
        return peaks

    def _derivative(
        self, interval: np.ndarray, elapsed: np.ndarray, third: np.ndarray, order: int, joint: int
    ) -> np.ndarray:
        """Of one joint over time, inside intervals: at a breakpoint that of the interval's own piece."""
        s, rate, u = self._law(interval, elapsed)
        middle = 0.5 * (self.s[interval] + self.s[interval + 1])
        piece = np.searchsorted(self.path.breakpoints, middle) - 1
        beyond = s - self.path.breakpoints[piece]
        own = self.path.coefficients[:, piece, joint]
        d1, d2, d3 = (derivatives(own, beyond, k) for k in (1, 2, 3))
        if order == 1:
            return d1 * rate
        return d1 * u + d2 * rate**2 if order == 2 else d3 * rate**3 + 3 * d2 * rate * u + d1 * third

    def _peaks(self, order: int, slope: PPoly) -> np.ndarray:
        """Greatest absolute speeds (order 1) or accelerations (2), whose slopes vanish where `slope` does."""
        x, u = np.repeat(self.x, 2)[1:-1], np.repeat(self.u, 2)
        sides = [self.path.at(self.s[1:], side="left"), self.path.at(self.s[:-1], side="right")]
        ends = np.stack(sides[::-1], axis=2).reshape(3, -1, self.n)
        at_ends = self._rates(ends, x, u)[order - 1]
        peaks = np.max(np.abs(at_ends), axis=0)
        for joint, places in enumerate(slope.roots(discontinuity=False, extrapolate=False)):
            inner = places[np.isfinite(places) & (places > 0) & (places < 1)]
            if inner.size:
                interval = np.clip(np.searchsorted(self.s, inner, side="right") - 1, 0, len(self.s) - 2)
                x = self.x[interval] + 2 * self.u[interval] * (inner - self.s[interval])
                found = self._rates(np.array(self.path.at(inner)), np.maximum(x, 0.0), self.u[interval])
                peaks[joint] = max(peaks[joint], np.max(np.abs(found[order - 1][:, joint])))
        return peaks

    @staticmethod
    def _rates(path: np.ndarray, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speeds and accelerations from q, q', q'' (3, N, n), x and u (N,)."""
        return path[1] * np.sqrt(x)[:, None], path[1] * u[:, None] + path[2] * x[:, None]
