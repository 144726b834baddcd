"""A path of joints, which postures follow each other; and its timing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy  # subpackages load on first use
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, naming, positive_number
from ocptip.basics.frozen import settle
from ocptip.trajectories.pieces import Pieces

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


GAP = 1e-9  # rad or m: jumps of positions at breakpoints that are rounding
CORNER = 1e-6
"""A step of the first derivative by more than this share of itself is a corner."""

BEND = 1e-6
"""A step of the second derivative by more than this share of its maximum is a step of the curvature."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path of n joints in K polynomial pieces.

    Attributes:
        breakpoints: (K + 1,), increasing from 0 to 1: ends of the pieces, where the second derivative may
            have a step.
        coefficients: (D + 1, K, n), rad or m, of the powers D, ..., 0 of s - breakpoints[k] in piece k.
    """

    breakpoints: np.ndarray
    coefficients: np.ndarray

    def __post_init__(self) -> None:
        """Raise InputError if shapes do not fit, positions have a gap, or a piece stands still."""
        ends = finite_array("breakpoints", self.breakpoints, (None,))
        if len(ends) < 2 or ends[0] != 0 or ends[-1] != 1 or np.any(np.diff(ends) <= 0):
            raise InputError("breakpoints: expected at least two, increasing from 0 to 1")
        given = finite_array("coefficients", self.coefficients, (None, len(ends) - 1, None))
        if len(given) < 2 or not given.shape[2]:
            raise InputError(f"coefficients: expected (D + 1, K, n), D and n >= 1, got {given.shape}")
        settle(self, breakpoints=ends, coefficients=given)
        gaps = np.max(np.abs(self._at_ends(0)[1][:-1] - self._at_ends(0)[0][1:]), axis=1, initial=0.0)
        if np.any(gaps > GAP * (1 + np.abs(given).max())):
            k = int(np.argmax(gaps))
            raise InputError(f"path: has a gap of {gaps[k]:.3g} at s = {ends[k + 1]:.6g}")

    def require_motion(self) -> None:
        """Raise InputError if nothing moves in a piece, which then has no timing."""
        still, ends = np.flatnonzero(~np.any(self.coefficients[:-1], axis=(0, 2))), self.breakpoints
        if still.size:
            k = int(still[0])
            raise InputError(f"path: does not move between s = {ends[k]:.6g} and {ends[k + 1]:.6g}")

    def some(self, columns: slice) -> JointPath:
        """The path of some of the joints."""
        return JointPath(self.breakpoints, self.coefficients[:, :, columns])

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.coefficients.shape[2]

    @property
    def start(self) -> np.ndarray:
        """Positions at s = 0, (n,), rad or m."""
        return self.coefficients[-1, 0]

    @property
    def goal(self) -> np.ndarray:
        """Positions at s = 1, (n,), rad or m."""
        return self._at_ends(0)[1][-1]

    def at(
        self, s: ArrayLike, *, side: Literal["left", "right"] = "right"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions q (rad or m), dq/ds and d2q/ds2 at N places: three arrays (N, n).

        Args:
            s: (N,), in [0, 1]; a single one gives (n,).
            side: "right": at a breakpoint the derivatives after it; "left": those before it.

        Raises:
            InputError: a place is not in [0, 1].
        """
        places = np.asarray(s, dtype=float)
        if not np.all((places >= 0) & (places <= 1)):
            raise InputError("s: must be in [0, 1]")
        piece = np.clip(np.searchsorted(self.breakpoints, places, side=side) - 1, 0, self.pieces - 1)
        beyond = (places - self.breakpoints[piece])[..., None]
        coefficient = self.coefficients[:, piece]
        return (
            derivatives(coefficient, beyond, 0),
            derivatives(coefficient, beyond, 1),
            derivatives(coefficient, beyond, 2),
        )

    @property
    def pieces(self) -> int:
        """Number of pieces K."""
        return len(self.breakpoints) - 1

    @cached_property
    def corners(self) -> np.ndarray:
        """Breakpoints, counted from 0, at which the direction turns at once; a motion has to stop there."""
        begins, ends = self._at_ends(1)
        size = np.maximum(np.linalg.norm(begins[1:], axis=1), np.linalg.norm(ends[:-1], axis=1))
        return 1 + np.flatnonzero(np.linalg.norm(begins[1:] - ends[:-1], axis=1) > CORNER * size)

    @cached_property
    def bends(self) -> np.ndarray:
        """Breakpoints, counted from 0, at which the curvature has a step and a motion need not stop.

        No motion that passes them keeps a jerk limit.
        """
        begins, ends = self._at_ends(2)
        steps = np.max(np.abs(begins[1:] - ends[:-1]), axis=1, initial=0.0)
        size = np.max(np.abs([begins, ends]))
        return np.setdiff1d(1 + np.flatnonzero(steps > BEND * size), self.corners)

    @cached_property
    def curve(self) -> PPoly:
        """The path as SciPy has it."""
        return scipy.interpolate.PPoly(self.coefficients, self.breakpoints)

    @cached_property
    def ranges(self) -> np.ndarray:
        """Minimum and maximum position of each joint, exact, (n, 2), rad or m."""
        results = []
        for joint, turns in enumerate(self.curve.derivative().roots(discontinuity=False, extrapolate=False)):
            places = np.concatenate([self.breakpoints, np.clip(turns[np.isfinite(turns)], 0, 1)])
            values = self.at(places)[0][:, joint]
            results.append((values.min(), values.max()))
        return np.array(results)

    def _at_ends(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of that order at begin and end of every piece, (K, n) each."""
        widths = np.diff(self.breakpoints)[:, None]
        begins, ends = (
            derivatives(self.coefficients, widths_from, order) for widths_from in (0 * widths, widths)
        )
        return begins, ends


def derivatives(coefficients: np.ndarray, places: np.ndarray, order: int) -> np.ndarray:
    """Derivatives (N, n) of N polynomials (D + 1, N, n) at N places (N, 1), one for each."""
    for _ in range(order):
        powers = np.arange(len(coefficients) - 1, 0, -1).reshape(-1, *[1] * (coefficients.ndim - 1))
        coefficients = coefficients[:-1] * powers
    result = np.zeros(coefficients.shape[1:])
    for row in coefficients:
        result = row + places * result
    return result


BACK = 1e-7  # of the greatest ds/dt: so far below 0 is rounding


@dataclass(frozen=True, eq=False)
class PathTiming:
    """When a motion is where on its path.

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

    @cached_property
    def node_times(self) -> np.ndarray:
        """When the nodes are passed, (N + 1,), s."""
        if self.times is not None:
            return self.times
        speeds = np.sqrt(self.x)
        return np.append(0.0, np.cumsum(2 * np.diff(self.s) / (speeds[:-1] + speeds[1:])))

    def passes(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """When it passes places (N,), s, and how fast, ds/dt, (N,); between nodes with constant d2s/dt2."""
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        way, width = s - self.s[k], self.s[k + 1] - self.s[k]
        before = np.sqrt(self.x[k])
        here = np.sqrt(np.maximum(self.x[k] + way / width * (self.x[k + 1] - self.x[k]), 0.0))
        late = np.divide(2 * way, before + here, out=np.zeros_like(way), where=way > 0)
        return self.node_times[k] + late, here

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

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """Polynomials of time between nodes: those of s of the path, of which s is one of time."""
        h = np.diff(self.node_times)
        middle = 0.5 * (self.s[:-1] + self.s[1:])
        piece = np.searchsorted(self.path.breakpoints, middle) - 1
        beyond = (self.s[:-1] - self.path.breakpoints[piece])[:, None]
        of_place = self.path.coefficients[:, piece]
        degree = len(of_place) - 1
        law = np.stack([np.sqrt(self.x[:-1]), 0.5 * self.u, self.third / 6])  # of t, t^2, t^3
        law = law[: 2 if self.times is None else 3]
        power = np.ones((1, len(h)))  # coefficients of the powers of the way since the node
        orders = degree * len(law)
        values = np.zeros((orders + 1, len(h), self.path.joints))
        for k in range(degree + 1):
            values[: len(power)] += power[:, :, None] * (derivatives(of_place, beyond, k) / factorial(k))
            longer = np.zeros((len(power) + len(law), len(h)))
            for shift, row in enumerate(law, 1):
                longer[shift : shift + len(power)] += row * power
            power = longer
        values *= np.array([float(factorial(k)) for k in range(orders + 1)])[:, None, None]
        return (Pieces(self.node_times, values, self.path.goal),)

    def time_scaled(self, factor: float) -> PathTiming:
        """Return the same path with all times multiplied by `factor` > 0 (below 1: faster)."""
        factor = positive_number("factor", factor)
        times = None if self.times is None else factor * self.times
        return PathTiming(self.path, self.s, self.x / factor**2, times)

    @property
    def _least_speed(self) -> float:
        """Minimum ds/dt between nodes, before it is taken as 0."""
        u, third, h = self.u, self.third, np.diff(self.node_times)
        t = np.clip(np.divide(-u, third, out=np.zeros_like(u), where=third != 0), 0.0, h)
        return float(np.min(np.sqrt(self.x[:-1]) + t * (u + 0.5 * t * third)))

    def to_dict(self, units: Sequence[str] = ()) -> dict[str, Any]:
        """Return `start` (degrees; m where `units` says so) and `path`, pieces and timing, rad and s."""
        turning = np.array(units or ["rad"] * self.path.joints) == "rad"
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
            "start": np.where(turning, np.rad2deg(self.path.start), self.path.start).tolist(),
            "path": path,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PathTiming:
        """Return the timing written by :meth:`to_dict`, to the last bit.

        Raises:
            InputError: a key is missing, or its value cannot be used; names it.
        """
        path_data = data.get("path")
        keys = ("breakpoints", "coefficients_rad", "s", "x_1_s2")
        if not isinstance(path_data, Mapping) or any(key not in path_data for key in keys):
            raise InputError(f"path: expected a table with {', '.join(keys)}")
        with naming("path"):
            shapes = (None,), (None, None, None), (None,), (None,)
            values = [
                finite_array(key, path_data[key], shape) for key, shape in zip(keys, shapes, strict=True)
            ]
            times = finite_array("times_s", path_data["times_s"], (None,)) if "times_s" in path_data else None
            return cls(JointPath(*values[:2]), values[2], values[3], times)
