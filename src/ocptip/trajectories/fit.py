"""A motion fitted to samples that hold positions only, or rounded, or measured with noise.

Differences of rounded numbers are no accelerations, and splines through samples overshoot where the
accelerations of the true motion jump between two of them. What is wanted is the calmest motion that can
have been sampled: of all motions with piecewise constant accelerations, at rest at both ends, that pass the
samples within a tolerance, the one whose accelerations vary least in total (the sum of their jumps). It does
not overshoot: overshoot varies. The tolerance is half a unit of the last digit of the file, or what the noise
of so many samples does not exceed, where there is more of that.

What a fit cannot know: an acceleration that lasts so shortly that it moves the joint by less than the
tolerance (an excess a over a time T moves it by about a T^2 / 8), or that begins and ends between two
samples. The calmest motion has none of these.

Samples that stay within the tolerance for a while, all joints together, are a standstill: the motion rests
there, and what lies between two of them is fitted by itself. So cycles can be parted where they rest.

One linear program per joint, whose size grows with the number of samples; solved by Clarabel.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from ocptip.basics.errors import InputError
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones
from ocptip.trajectories.sampled import SampledMotion

PEAK_TOLERANCE = 0.01
"""Speeds and accelerations of a fit may exceed limits by this share of themselves."""

FINEST = 2e-6  # rad or m: least tolerance, a jump of 44 rad/s^2 in the middle of a piece
SPACING = 6e-4  # s: of the pieces of constant acceleration, about
MOST_PIECES = 60_000  # per joint
NOISE = (
    1.3  # times the rounding: noise from which on there is some beside it, which alone seems 1.24 at times
)
WHITE = 0.5  # ratio of what polynomials of degree 5 and 3 leave; of curvature the higher degree leaves less
REST_TIME = 0.1  # s, from which on samples within the tolerance of each other are a standstill
REST_EDGE = 0.25  # share of a standstill, at its begin and its end, in which the motion may yet move
HELD = 1e-3  # share of the tolerance by which a motion may miss where it stands still
STEPS = (0.99, 0.95)  # shares of the way to the boundary that the solver takes; the next where it gets stuck
ENOUGH = 20  # samples from which on noise is estimated
STILL = 0.3186  # quantile 0.25 of the absolute value of a standard normal variable


@dataclass(frozen=True, eq=False)
class FittedMotion(SampledMotion):
    """A motion through samples within a tolerance, see the module.

    `times`, `angles` and `speeds` are those of its pieces, not the samples.

    Attributes:
        samples: number of samples that it was fitted to.
        spacing: s, largest distance between them.
        distance: (n,), largest distance of each joint from its samples, rad or m.
        tolerance: (n,), that was meant to be kept, rad or m.
        rounding: (n,), half a unit of the last digit of the samples, rad or m; 0: unknown.
        speed_distance: (n,), largest distance from speeds that came with the samples, rad/s or m/s, or None.
    """

    samples: int = 0
    spacing: float = 0.0
    distance: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tolerance: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rounding: np.ndarray = field(default_factory=lambda: np.zeros(0))
    speed_distance: np.ndarray | None = None

    peak_rounding = PEAK_TOLERANCE

    @property
    def noisy(self) -> np.ndarray:
        """(n,): the tolerance comes from noise, not from rounding."""
        return self.tolerance > 1.5 * np.maximum(self.rounding, FINEST)

    def fit_to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: rad or m, and per second, per joint."""
        names = "samples", "spacing", "distance", "tolerance", "rounding", "noisy", "speed_distance"
        return {"limits_exceeded_by": PEAK_TOLERANCE, **{name: getattr(self, name) for name in names}}

    @property
    def interpolation(self) -> str:
        """What was made of the samples, for messages."""
        return "calmest motion that passes the samples within a tolerance"


def fitted(
    times: np.ndarray,
    positions: np.ndarray,
    *,
    rounding: np.ndarray | None = None,
    speeds: np.ndarray | None = None,
) -> FittedMotion:
    """Fit a motion to samples of positions.

    Args:
        times: (N,), s, increasing.
        positions: (N, n), rad or m.
        rounding: (n,), half a unit of the last digit that the file has, rad or m; default: exact.
        speeds: (N, n), rad/s or m/s, that came with the samples; only compared.

    Raises:
        InputError: there is no fit of a joint (numerical trouble).
    """
    times, n = times - times[0], positions.shape[1]
    rounding = np.zeros(n) if rounding is None else rounding
    noise = noise_of(times, positions)
    most = np.sqrt(2 * np.log(len(times))) + 0.5  # standard deviations, which hardly one in N exceeds
    tolerance = np.maximum(np.where(noise > NOISE * rounding, most * noise, 1.02 * rounding), FINEST)
    rests = rests_of(times, positions, tolerance)
    held = positions.copy()
    for first, last in rests:
        own = positions[first : last + 1]
        held[first : last + 1] = 0.5 * (own.min(axis=0) + own.max(axis=0))
    begins, ends = [0, *(last for _, last in rests)], [*(first for first, _ in rests), len(times) - 1]
    parts = [
        _part(times[a : b + 1], held[a : b + 1], tolerance, (a > 0, b < len(times) - 1))
        for a, b in zip(begins, ends, strict=True)
    ]
    knots, angles, rates, at_samples = (np.concatenate(values) for values in zip(*parts, strict=True))
    moving = np.concatenate([np.arange(a, b + 1) for a, b in zip(begins, ends, strict=True)])
    off = np.maximum(
        np.abs(at_samples[:, :n] - positions[moving]).max(axis=0), np.abs(held - positions).max(axis=0)
    )
    rates_off = None if speeds is None else np.abs(at_samples[:, n:] - speeds[moving]).max(axis=0)
    return FittedMotion(
        knots,
        angles,
        rates,
        samples=len(times),
        spacing=float(np.max(np.diff(times))),
        distance=off,
        tolerance=tolerance,
        rounding=rounding,
        speed_distance=rates_off,
    )


def rests_of(times: np.ndarray, positions: np.ndarray, tolerance: np.ndarray) -> list[tuple[int, int]]:
    """First and last samples of the standstills on the way, without their edges.

    Args:
        times: (N,), s.
        positions: (N, n), rad or m.
        tolerance: (n,), of these.
    """
    runs: list[list[int]] = []
    low = high = positions[0]
    for k, q in enumerate(positions):
        low, high = np.minimum(low, q), np.maximum(high, q)
        if not runs or np.any(high - low > 2 * tolerance):
            low = high = q
            runs.append([k, k])
        runs[-1][1] = k
    found = []
    for first, last in runs[1:-1]:
        edge = REST_EDGE * (times[last] - times[first])
        inside = (
            np.searchsorted(times, times[first] + edge),
            np.searchsorted(times, times[last] - edge, "right") - 1,
        )
        if times[last] - times[first] >= REST_TIME and inside[1] > inside[0]:
            found.append((int(inside[0]), int(inside[1])))
    return found


def _part(
    times: np.ndarray, positions: np.ndarray, tolerance: np.ndarray, held: tuple[bool, bool]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Knots, positions and speeds there, and both at the samples, (N, 2 n), of a motion from rest to rest.

    Args:
        times: (N,), s.
        positions: (N, n), rad or m.
        tolerance: (n,), of these.
        held: whether the first and the last one are to be met, nearly.
    """
    pieces = _Pieces.of(times)
    columns = []
    for joint, limit in enumerate(tolerance):
        at = positions[:, joint]
        if np.ptp(at) <= 0:
            columns.append((np.full(len(pieces.knots), at[0]), np.zeros(len(pieces.knots))))
            continue
        try:
            columns.append(pieces.calmest(at, limit, held))
        except ArithmeticError as error:
            raise InputError(f"no fit of joint {joint + 1} to the samples (Clarabel: {error})") from None
    angles, rates = (np.stack(values, axis=1) for values in zip(*columns, strict=True))
    return pieces.knots, angles, rates, np.hstack([angles, rates])[pieces.first]


def noise_of(times: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Standard deviation of white noise per column, (n,), of the unit of the positions (N, n).

    Each sample is compared with polynomials through its neighbours, of degree 3 and 5: what both leave alike
    is noise, otherwise it is curvature. The lower quartile counts, so that jumps of the acceleration do not.
    """
    if len(times) < ENOUGH:
        return np.zeros(positions.shape[1])
    found = []
    for reach in (2, 3):
        middle = np.arange(reach, len(times) - reach)
        others = np.array([k for k in range(-reach, reach + 1) if k])
        t = times[middle[:, None] + others] - times[middle][:, None]
        weights = np.ones_like(t)
        for k in range(len(others)):
            for other in range(len(others)):
                if other != k:
                    weights[:, k] *= t[:, other] / (t[:, other] - t[:, k])
        left = positions[middle] - np.einsum("ik,ikn->in", weights, positions[middle[:, None] + others])
        left /= np.sqrt(1 + np.sum(weights**2, axis=1))[:, None]
        found.append(np.quantile(np.abs(left), 0.25, axis=0) / STILL)
    return np.where(found[1] > WHITE * found[0], np.minimum(*found), 0.0)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces of constant acceleration: K in all, at the samples' times N.

    Attributes:
        times: (N,), s.
        knots: (K + 1,), s, the samples' times among them.
        first: (N,), knots at the samples.
    """

    times: np.ndarray
    knots: np.ndarray
    first: np.ndarray

    @classmethod
    def of(cls, times: np.ndarray) -> _Pieces:
        """Each interval between samples in equal pieces of about `SPACING`, two at least if it is longer."""
        widths = np.diff(times)
        spacing = max(SPACING, times[-1] / MOST_PIECES)
        counts = np.where(widths > 0.5 * spacing, np.maximum(2, np.ceil(widths / spacing)), 1).astype(int)
        first = np.concatenate([[0], np.cumsum(counts)])
        owner = np.repeat(np.arange(len(widths)), counts)
        number = np.arange(first[-1]) - first[owner]
        knots = np.append(times[owner] + number * (widths / counts)[owner], times[-1])
        return cls(times, knots, first)

    def calmest(
        self, positions: np.ndarray, tolerance: float, held: tuple[bool, bool] = (False, False)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions and speeds (K + 1,) at the knots of the motion whose accelerations vary least.

        Args:
            positions: (N,) at the samples.
            tolerance: of them.
            held: whether the first and the last one are to be met, nearly.

        Raises:
            ArithmeticError: the solver has no solution; its status.
        """
        unit = float(np.median(np.diff(self.times)))  # of time; that of positions is the tolerance
        knots = self.knots / unit
        widths, at = np.diff(knots), (positions - positions[0]) / tolerance
        slack = np.ones(len(at))
        slack[[0, -1]] = np.where(held, HELD, 1.0)
        problem = _Program(widths, self.first, at, slack)
        place, speed, acceleration = problem.solve()
        owner = np.repeat(np.arange(len(at) - 1), np.diff(self.first))
        # Within each interval from its own sample on, so that nothing accumulates.
        gain = np.concatenate([[0.0], np.cumsum(acceleration * widths)])
        rate = speed[owner] + gain[:-1] - gain[self.first[owner]]
        way = rate * widths + 0.5 * acceleration * widths**2
        total = np.concatenate([[0.0], np.cumsum(way)])
        where = place[owner] + total[:-1] - total[self.first[owner]]
        where, rate = np.append(where, place[-1]), np.append(rate, 0.0)
        rate[0] = 0.0
        return positions[0] + tolerance * where, tolerance / unit * rate


class _Program:
    """The linear program of one joint, in units of the tolerance and of the usual spacing.

    Variables: positions and speeds at the N samples, accelerations of the K pieces, jumps of these (K + 1,
    with those from and to rest). Two pieces between samples can pass any of them: there is a solution.
    """

    def __init__(self, widths: np.ndarray, first: np.ndarray, at: np.ndarray, slack: np.ndarray) -> None:
        self._n, self._k = len(at), len(widths)
        self._blocks = np.cumsum([0, self._n, self._n, self._k, self._k + 1])
        place, speed, push, jump = (self._block(i) for i in range(4))
        owner = np.repeat(np.arange(self._n - 1), np.diff(first))
        ends = np.concatenate([[0.0], np.cumsum(widths)])
        left = ends[first[1:]][owner] - ends[1:]  # from the end of a piece to the next sample
        gaps = np.diff(ends[first])
        rows = sp.csr_matrix((widths, (owner, np.arange(self._k))), (self._n - 1, self._k))
        moved = sp.csr_matrix(
            (widths * (left + 0.5 * widths), (owner, np.arange(self._k))), (self._n - 1, self._k)
        )
        before = sp.eye(self._n - 1, self._n)
        step = sp.eye(self._n - 1, self._n, k=1) - before
        differ = sp.eye(self._k + 1, self._k) - sp.eye(self._k + 1, self._k, k=-1)
        ends_of = sp.csr_matrix((np.ones(2), ([0, 1], [0, self._n - 1])), (2, self._n))
        equal = sp.vstack(
            [step @ place - sp.diags(gaps) @ before @ speed - moved @ push, step @ speed - rows @ push,
             ends_of @ speed]
        )  # fmt: skip
        below = sp.vstack([differ @ push - jump, -differ @ push - jump, place, -place])
        self._matrix = sp.csc_matrix(sp.vstack([equal, below]))
        equations, jumps = 2 * self._n, 2 * (self._k + 1)
        none = np.zeros(equations + jumps)
        self._bounds = np.concatenate([none, at + slack, slack - at])
        self._cones = [clarabel.ZeroConeT(equations), clarabel.NonnegativeConeT(jumps + 2 * self._n)]

    def _block(self, number: int) -> sp.csr_matrix:
        """Picks one kind of variables."""
        begin, end = (int(edge) for edge in self._blocks[number : number + 2])
        return sp.csr_matrix(sp.eye(end - begin, int(self._blocks[-1]), k=begin))

    def solve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions and speeds at the samples, accelerations of the pieces; ArithmeticError without any."""
        size = self._blocks[-1]
        price = np.zeros(size)
        price[self._blocks[3] :] = 1.0
        settings = quiet_settings()
        settings.tol_gap_rel = settings.tol_gap_abs = 1e-6
        status = ""
        for share in STEPS:
            setattr(settings, "max_step_fraction", share)  # noqa: B010  # missing in its stubs
            found = solve_cones(price, self._matrix, self._bounds, self._cones, settings)
            status = str(found.status)
            if status in USABLE:
                place, speed, push, _ = np.split(np.array(found.x), self._blocks[1:-1])
                return place, speed, push
        raise ArithmeticError(status)
