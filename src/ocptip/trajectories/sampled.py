"""A motion given by samples, a cubic between each two of them; reading motions of either form from files.

A check is about every instant, samples are at some. Which curve is meant between them decides the verdict:

- Angles and speeds: the cubic Hermite polynomial of each interval, as trajectory controllers do with points
  that have positions and speeds. Speeds are continuous, accelerations jump at samples. A ramp motion comes
  back exactly if all its events are among the samples. Where its acceleration jumps between two samples, the
  curve overshoots by up to a third of the jump, however dense the samples are.
- Angles only: the cubic spline with rest at both ends. Accelerations are continuous. Where the true motion's
  jump, the spline oscillates around the jump.

So samples of a ramp motion without its events get a verdict of their own, as a rule a stricter one than the
commands. Of a robot that interpolates otherwise, or of a measurement's gaps, it says nothing.

Rounded numbers are differentiated twice: an error e of the angles becomes up to 6 e / h^2 in the
accelerations between samples h apart. Files should hold 12 digits; rows closer than 0.1 ms to another are
left out, and with them phases shorter than that.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.trajectories.arm_motion import MERGE, ArmMotion, gauss_legendre
from ocptip.trajectories.ramps import checked_times

REST = 1e-3
"""Speed, rad/s: a motion that begins or ends faster is only a piece of one."""

_STILL = 1e-9  # rad/s: a joint that never gets faster rests; changes of sign are rounding


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """The motion of n joints through N samples, see the module for what lies between them.

    It rests before the first and after the last sample. Serves wherever an :class:`ArmMotion` is checked.

    Attributes:
        times: (N,), s, increasing, N >= 2; counted from the first sample, which is at 0.
        angles: (N, n), rad.
        speeds: (N, n), rad/s, below 0.001 at both ends; None: rest at both ends, else from the spline.
    """

    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Raise InputError if shapes do not fit, times do not increase, or an end is not at rest."""
        times = finite_array("times", self.times, (None,))
        if len(times) < 2:
            raise InputError(f"times: at least two samples are needed, got {len(times)}")
        if (late := np.flatnonzero(np.diff(times) <= 0)).size:
            k = int(late[0])
            raise InputError(
                f"times: must increase, sample {k + 2} at {times[k + 1]:.9g} s follows {times[k]:.9g} s"
            )
        values = {
            "times": times - times[0],
            "angles": finite_array("angles", self.angles, (len(times), None)),
        }
        if not values["angles"].shape[1]:
            raise InputError("angles: at least one joint is needed, got none")
        if self.speeds is not None:
            values["speeds"] = finite_array("speeds", self.speeds, values["angles"].shape)
            for where, ends in (("first", values["speeds"][0]), ("last", values["speeds"][-1])):
                joint = int(np.argmax(np.abs(ends)))
                if abs(ends[joint]) > REST:
                    raise InputError(
                        f"speeds: joint {joint + 1} moves with {np.rad2deg(ends[joint]):.4g} deg/s at the "
                        f"{where} sample; a motion goes from rest to rest"
                    )
        for name, array in values.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.angles.shape[1]

    @property
    def interpolation(self) -> str:
        """What lies between the samples, for messages."""
        return "cubic spline" if self.speeds is None else "cubic Hermite polynomials"

    @property
    def start(self) -> np.ndarray:
        """Angles before the motion, (n,), rad."""
        return self.angles[0]

    @property
    def goal(self) -> np.ndarray:
        """Angles after the motion, (n,), rad."""
        return self.angles[-1]

    @property
    def end(self) -> float:
        """Time of the last sample, s."""
        return float(self.times[-1])

    @cached_property
    def angle_ranges(self) -> np.ndarray:
        """Least and greatest angle of each joint during the motion, exact, (n, 2), rad."""
        ranges = []
        for joint, turns in enumerate(self._turns):
            angles = np.concatenate([self.angles[:, joint], self.states(turns)[0][:, joint]])
            ranges.append((angles.min(), angles.max()))
        return np.array(ranges)

    @cached_property
    def speed_peaks(self) -> np.ndarray:
        """Greatest |speed| of each joint, exact, (n,), rad/s."""
        cubic, square, linear, _ = self._curve.c
        width = self._widths
        with np.errstate(divide="ignore", invalid="ignore"):
            inner = -square / (3 * cubic)  # where the acceleration vanishes
        inner = np.where((inner > 0) & (inner < width), inner, 0.0)
        peaks = [np.abs(linear + t * (2 * square + t * 3 * cubic)) for t in (0.0, inner, width)]
        return np.max(peaks, axis=(0, 1))

    @cached_property
    def acceleration_peaks(self) -> np.ndarray:
        """Greatest |acceleration| of each joint, exact, (n,), rad/s^2."""
        cubic, square = self._curve.c[:2]
        return np.max([np.abs(2 * square + t * 6 * cubic) for t in (0.0, self._widths)], axis=(0, 1))

    def states(
        self, times: ArrayLike, *, side: Literal["left", "right"] = "right"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles (rad), speeds (rad/s), accelerations (rad/s^2) at N times (s): three arrays (N, n).

        Args:
            times: when; a single time gives (n,).
            side: "right": at a sample the acceleration after it, "left": the one before it.

        Raises:
            InputError: a time is not finite, or side is another word.
        """
        t = checked_times(times, side)
        starts, coefficients = self._padded
        piece = np.searchsorted(self.times, t, side=side)  # 0: rest before, 1 .. N - 1: moving, N: rest
        elapsed = (t - starts[piece])[..., None]
        cubic, square, linear, constant = coefficients[:, piece]
        angles = constant + elapsed * (linear + elapsed * (square + elapsed * cubic))
        speeds = linear + elapsed * (2 * square + elapsed * 3 * cubic)
        return angles, speeds, 2 * square + elapsed * 6 * cubic

    @cached_property
    def event_times(self) -> np.ndarray:
        """Samples, and all instants at which a joint's speed changes sign, sorted, (S,), s.

        Instants within 1 ns of a sample or of each other are one.
        """
        kept = [0.0]
        for t in np.unique(np.concatenate(self._turns)):
            index = min(int(np.searchsorted(self.times, t)), len(self.times) - 1)
            nearest = np.min(np.abs(self.times[max(index - 1, 0) : index + 1] - t))
            if nearest > MERGE and t - kept[-1] > MERGE:
                kept.append(float(t))
        return np.unique(np.concatenate([kept, self.times]))

    @property
    def intervals(self) -> np.ndarray:
        """Intervals between events, (S - 1, 2), s: within each, torque and power are smooth."""
        return np.column_stack([self.event_times[:-1], self.event_times[1:]])

    def quadrature(self, order: int = 4) -> tuple[np.ndarray, np.ndarray]:
        """Return Gauss-Legendre nodes (s) inside all intervals and their weights (s), both (N,).

        Raises:
            InputError: order is not a whole number >= 1.
        """
        return gauss_legendre(self.intervals, order)

    def time_scaled(self, factor: float) -> SampledMotion:
        """Return the same path with all times multiplied by `factor` > 0 (below 1: faster)."""
        factor = positive_number("factor", factor)
        speeds = None if self.speeds is None else self.speeds / factor
        return SampledMotion(self.times * factor, self.angles, speeds)

    @cached_property
    def _curve(self) -> PPoly:
        if self.speeds is None:
            return CubicSpline(self.times, self.angles, bc_type="clamped")
        return CubicHermiteSpline(self.times, self.angles, self.speeds)

    @cached_property
    def _widths(self) -> np.ndarray:
        return np.diff(self.times)[:, None]

    @cached_property
    def _padded(self) -> tuple[np.ndarray, np.ndarray]:
        """Start times (N + 1,) and coefficients (4, N + 1, n), cubic first, with rest before and after."""
        rest = np.zeros((2, 4, 1, self.n))
        rest[:, 3, 0] = self.start, self.goal
        coefficients = np.concatenate([rest[0], self._curve.c, rest[1]], axis=1)
        return np.concatenate([self.times[:1], self.times]), coefficients

    @cached_property
    def _turns(self) -> list[np.ndarray]:
        """Per joint the instants at which its speed vanishes, s; none for a joint that rests."""
        roots = self._curve.derivative().roots(discontinuity=False, extrapolate=False)
        moving = self.speed_peaks > _STILL
        return [r[np.isfinite(r)] if moves else np.empty(0) for r, moves in zip(roots, moving, strict=True)]


Motion = ArmMotion | SampledMotion
