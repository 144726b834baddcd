"""A motion given by samples, with polynomials between them.

A check is about every instant, so the curve between the samples decides the verdict:

- Angles and speeds: cubic Hermite polynomials, as trajectory controllers have them. Accelerations step at
  samples. After a step between two samples the curve overshoots by up to a third of it.
- Angles, speeds and accelerations: quintic polynomials. They overshoot at such steps as well.
- Angles only: the cubic spline with rest at both ends. It oscillates around such steps.
- Angles and a controller's period: straight lines. The drives are assumed to spread each step of the speed
  over one period, half of it before the corner. So the motion begins half a period before the first sample.

Rounded numbers are differentiated twice: an error e of the angles becomes up to 6 e / h^2 in the
accelerations between samples h apart. Samples of files are therefore fitted (`ocptip.trajectories.fit`)
unless they have accelerations that fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.basics.frozen import settle
from ocptip.trajectories.pieces import MERGE, STANDSTILL, Pieces

REST = 1e-3
"""Speed, rad/s: a motion that begins or ends faster is only a piece of one."""

PEAK_TOLERANCE = 0.01
"""Speeds and accelerations of a fit may exceed limits by this share of themselves."""

FINEST = 2e-6  # rad or m: least tolerance of a fit, a jump of 44 rad/s^2 in the middle of a piece
SHORT = 3e-4  # s: of intervals whose positions are not differentiated where accelerations are given
LONGEST = 0.05  # s: of the pieces of straight lines, over which power is integrated by a few nodes


@dataclass(frozen=True, eq=False)
class Points:
    """N samples of n joints, and which curve lies between them, see the module.

    The joints rest before the first and after the last sample.

    Attributes:
        times: (N,), s, increasing, N >= 2; counted from the first sample, which is at 0.
        angles: (N, n), rad.
        speeds: (N, n), rad/s, below 0.001 at both ends; None: rest at both ends, else from the spline.
        accelerations: (N, n), rad/s^2, with speeds only; None: not given.
        before: (N, n), rad/s^2, those just before the samples, where there are acceleration steps; None:
            there are none.
        period: s, between two updates of a controller that draws straight lines between samples; only
            without speeds.
        steps_from: breaks at which accelerations step by less than this share of the largest one are no
            switching times; None: all breaks are, except amid a standstill.
    """

    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray | None = None
    accelerations: np.ndarray | None = None
    period: float | None = None
    before: np.ndarray | None = None
    steps_from: float | None = None

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
                        f"{where} sample; a motion goes from rest to rest: check a blended one as a whole, "
                        "as one trajectory with what comes before and after"
                    )
        if self.accelerations is not None:
            if self.speeds is None:
                raise InputError("accelerations: without speeds they say nothing")
            shape = values["angles"].shape
            values["accelerations"] = finite_array("accelerations", self.accelerations, shape)
            before = self.accelerations if self.before is None else self.before
            values["before"] = finite_array("before", before, shape)
        if self.period is not None:
            if self.speeds is not None:
                raise InputError("period: straight lines between samples have no speeds at them")
            positive_number("period", self.period)
        settle(self, **values)

    @property
    def interpolation(self) -> str:
        """The interpolation between the samples, in words for messages."""
        if self.period is not None:
            update = f"{1e3 * self.period:.4g} ms ({1 / self.period:.4g} Hz)"
            return f"straight lines, whose corners last one update of the controller, {update}"
        if self.speeds is None:
            return "cubic spline"
        return f"{'cubic' if self.accelerations is None else 'quintic'} Hermite polynomials"

    @property
    def passing_times(self) -> np.ndarray:
        """When the motion is at its samples, (N,), s: straight lines are delayed by half a period."""
        return (
            self.times
            if self.period is None
            else np.append(self.times[:-1] + 0.5 * self.period, self.pieces[0].breaks[-1])
        )

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The polynomials between the samples, of all joints at once."""
        if self.period is not None:
            breaks, derivatives = self._rounded_lines(self.period)
        else:
            breaks, derivatives = self.times, self._between_samples()
        return (Pieces(breaks, derivatives, self.angles[-1], self._switching(derivatives)),)

    def _switching(self, derivatives: np.ndarray) -> np.ndarray:
        """(breaks,) True at breaks between pieces at which the motion changes, and at both ends."""
        if self.steps_from is None:
            still = np.all(derivatives[1:] == 0, axis=(0, 2))
            changes = ~(still[1:] & still[:-1])
        else:
            steps = np.abs(np.diff(derivatives[2], axis=0))
            large = self.steps_from * np.max(np.abs(derivatives[2]), axis=0)
            changes = np.any(steps > large, axis=1)
        return np.concatenate([[True], changes, [True]])

    def time_scaled(self, factor: float) -> Points:
        """Return the same curve with all times multiplied by `factor` > 0 (below 1: faster)."""
        factor = positive_number("factor", factor)
        powers = {"times": 1, "period": 1, "speeds": -1, "accelerations": -2, "before": -2}
        powers_of: dict[str, Any] = {name: getattr(self, name) for name in powers}
        scaled = {name: x * factor ** powers[name] for name, x in powers_of.items() if x is not None}
        return replace(self, **scaled)

    def _between_samples(self) -> np.ndarray:
        """Derivatives (D + 1, N - 1, n) of the interpolation at the samples."""
        if self.speeds is None:
            spline = scipy.interpolate.CubicSpline(self.times, self.angles, bc_type="clamped")
            return spline.c[::-1] * np.array([1.0, 1.0, 2.0, 6.0])[:, None, None]
        if self.accelerations is None:
            return self._cubic(self.speeds)
        return self._quintic(self.speeds, self.accelerations, self.before)

    def _cubic(self, speeds: np.ndarray) -> np.ndarray:
        """Derivatives of cubic Hermite polynomials at the samples."""
        h = np.diff(self.times)[:, None]
        rate = np.diff(self.angles, axis=0) / h
        second = (3 * rate - 2 * speeds[:-1] - speeds[1:]) / h
        third = (speeds[:-1] + speeds[1:] - 2 * rate) / h**2
        return np.stack([self.angles[:-1], speeds[:-1], 2 * second, 6 * third])

    def _quintic(
        self, speeds: np.ndarray, accelerations: np.ndarray, before: np.ndarray | None
    ) -> np.ndarray:
        """Derivatives of quintic Hermite polynomials at the samples; exactly at rest where these are.

        In intervals so short that rounding would decide them, accelerations change evenly instead.
        """
        before = accelerations if before is None else before
        h, begin, bends = np.diff(self.times)[:, None], accelerations[:-1], before[1:] - accelerations[:-1]
        way = np.diff(self.angles, axis=0) - h * (speeds[:-1] + 0.5 * h * begin)
        rate = h * (np.diff(speeds, axis=0) - h * begin)
        bend = h**2 * bends
        fifth = (6 * way - 3 * rate + 0.5 * bend) / h**5
        fourth = (-15 * way + 7 * rate - bend) / h**4
        third = (10 * way - 4 * rate + 0.5 * bend) / h**3
        short = h < SHORT
        fifth, fourth, third = (
            np.where(short, even, coefficient)
            for even, coefficient in ((0.0, fifth), (0.0, fourth), (bends / (6 * h), third))
        )
        return np.stack([self.angles[:-1], speeds[:-1], begin, 6 * third, 24 * fourth, 120 * fifth])

    def _rounded_lines(self, period: float) -> tuple[np.ndarray, np.ndarray]:
        """Straight lines between the samples, averaged over one period: each corner becomes a parabola.

        Returns:
            The breaks between the pieces, and the derivatives at their begins.
        """
        corners = _corners(self.times, self.angles)
        times, places = self.times[corners], self.angles[corners]
        rates = np.zeros(
            (len(times) + 1, self.angles.shape[1])
        )  # rest before the first and after the last one, too
        rates[1:-1] = np.diff(places, axis=0) / np.diff(times)[:, None]
        breaks = np.unique(np.concatenate([times, times + period]))  # half a period later than the corners
        kept = np.append(np.diff(breaks) > MERGE, True)  # corners one period apart have no line between them
        breaks = breaks[kept]
        parts = np.maximum(np.ceil(np.diff(breaks) / LONGEST), 1).astype(int)  # short ones, for integrals
        shares = np.arange(np.sum(parts)) - np.repeat(np.cumsum(parts) - parts, parts)
        inner = np.repeat(breaks[:-1], parts) + shares * np.repeat(np.diff(breaks) / parts, parts)
        breaks = np.append(inner, breaks[-1])
        ends = np.concatenate([[-np.inf], times, [np.inf]])
        begin, end = _snapped(breaks - period, times), _snapped(breaks, times)
        first = np.searchsorted(times, begin, side="right")  # lines on which the periods begin
        last = np.searchsorted(times, end, side="left")
        begins, speeds = np.zeros((2, len(breaks), places.shape[1]))
        for line in range(int(np.max(last - first)) + 1):
            row = np.minimum(first + line, len(times))
            low, high = np.maximum(begin, ends[row]), np.minimum(end, ends[row + 1])
            share = (np.where(first + line <= last, high - low, 0.0) / (end - begin))[:, None]
            corner = np.clip(row - 1, 0, None)
            middle = places[corner] + rates[row] * (0.5 * (low + high) - times[corner])[:, None]
            begins, speeds = begins + share * middle, speeds + share * rates[row]
        middles = 0.5 * (breaks[:-1] + breaks[1:])
        after, before = (np.searchsorted(times, t, side="right") for t in (middles, middles - period))
        return breaks, np.stack([begins[:-1], speeds[:-1], (rates[after] - rates[before]) / period])


@dataclass(frozen=True, eq=False)
class Fit:
    """How a trajectory was fitted to samples, and how near to them it is, see `ocptip.trajectories.fit`.

    Attributes:
        samples: number of samples that it was fitted to.
        spacing: s, largest distance between them.
        distance: (n,), largest distance of each joint from its samples, rad or m.
        tolerance: (n,), that was meant to be kept, rad or m.
        rounding: (n,), half a unit of the last digit of the samples, rad or m; 0: unknown.
        jerk: (n,), rad/s^3 or m/s^3: any motion within the tolerance of the samples has this somewhere.
        speed_distance: (n,), largest distance from speeds that came with the samples, rad/s or m/s, or None.
    """

    samples: int
    spacing: float
    distance: np.ndarray
    tolerance: np.ndarray
    rounding: np.ndarray
    jerk: np.ndarray
    speed_distance: np.ndarray | None = None

    @property
    def noisy(self) -> np.ndarray:
        """(n,): the tolerance comes from noise, not from rounding."""
        return self.tolerance > 1.5 * np.maximum(self.rounding, FINEST)

    def time_scaled(self, factor: float) -> Fit:
        """Return the fit to the same samples with all times multiplied by `factor` > 0."""
        speeds = None if self.speed_distance is None else self.speed_distance / factor
        return replace(self, spacing=factor * self.spacing, jerk=self.jerk / factor**3, speed_distance=speeds)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: rad or m, and per second, per joint."""
        names = "samples", "spacing", "distance", "tolerance", "rounding", "noisy", "speed_distance"
        return {"limits_exceeded_by": PEAK_TOLERANCE, **{name: getattr(self, name) for name in names}}


def _snapped(instants: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Instants at the corners that they only miss by rounding: a line begins with exactly the speed of this
    line.
    """
    after = np.clip(np.searchsorted(corners, instants), 1, len(corners) - 1)
    near = np.where(
        np.abs(instants - corners[after - 1]) < np.abs(instants - corners[after]),
        corners[after - 1],
        corners[after],
    )
    return np.where(np.abs(instants - near) <= MERGE, near, instants)


def _corners(times: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Numbers of the samples at which straight lines (N, n) bend, and of both ends."""
    rates = np.diff(angles, axis=0) / np.diff(times)[:, None]
    kept, rate = [0], rates[0]
    for k, after in enumerate(rates[1:], 1):
        if np.max(np.abs(after - rate)) > STANDSTILL:
            kept.append(k)
            rate = after
    return np.array([*kept, len(times) - 1])


def stamped(times: np.ndarray) -> np.ndarray:
    """Times (N,), s, as whole nanoseconds: to the last bit those that are read from a message's stamps."""
    seconds, nanoseconds = np.divmod(np.rint(times * 1e9), 1e9)
    return seconds + 1e-9 * nanoseconds
