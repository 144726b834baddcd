"""A motion fitted to samples that hold positions only, or rounded, or measured with noise.

Differences of rounded numbers are no accelerations, and splines overshoot at acceleration steps. So the fit
is the calmest motion: of all with piecewise constant accelerations, at rest at both ends, that pass the
samples within a tolerance, the one with the minimum total variation of acceleration. The tolerance is half a
unit of the last digit of the file, or what the noise of as many samples does not exceed.

It cannot contain an acceleration that moves the joint by less than the tolerance (an excess a over a time T:
about a T^2 / 8), or that begins and ends between two samples.

Samples that stay within the tolerance for a while are a standstill; what lies between two of them is fitted
by itself. Each joint has one linear program (Clarabel). Pieces are as long as an acceleration step in the
middle of one stays within the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import clarabel
import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError
from ocptip.numerics.cone_program import INFEASIBLE, USABLE, quiet_settings, solve_cones
from ocptip.trajectories.points import FINEST, PEAK_TOLERANCE, Fit, Points
from ocptip.trajectories.trajectory import Trajectory

SPACING = 6e-4  # s: of the pieces of constant acceleration, about, at the finest tolerance
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


def fitted(
    times: np.ndarray,
    positions: np.ndarray,
    *,
    rounding: np.ndarray | None = None,
    speeds: np.ndarray | None = None,
) -> Trajectory:
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
        position = positions[first : last + 1]
        held[first : last + 1] = 0.5 * (position.min(axis=0) + position.max(axis=0))
    spacing = SPACING * float(np.sqrt(np.min(tolerance) / FINEST))
    if np.any(noise > NOISE * rounding):
        spacing = max(spacing, float(np.median(np.diff(times))))
    begins, ends = [0, *(last for _, last in rests)], [*(first for first, _ in rests), len(times) - 1]
    parts = [
        _part(times[a : b + 1], held[a : b + 1], tolerance, (a > 0, b < len(times) - 1), spacing)
        for a, b in zip(begins, ends, strict=True)
    ]
    knots, angles, rates, at_samples = (np.concatenate(values) for values in zip(*parts, strict=True))
    moving = np.concatenate([np.arange(a, b + 1) for a, b in zip(begins, ends, strict=True)])
    off = np.maximum(
        np.abs(at_samples[:, :n] - positions[moving]).max(axis=0), np.abs(held - positions).max(axis=0)
    )
    rates_off = None if speeds is None else np.abs(at_samples[:, n:] - speeds[moving]).max(axis=0)
    points = Points(knots, angles, rates, steps_from=PEAK_TOLERANCE)
    spacing, jerk = float(np.max(np.diff(times))), least_jerk(times, positions, tolerance)
    return Trajectory(points=points, fit=Fit(len(times), spacing, off, tolerance, rounding, jerk, rates_off))


def least_jerk(times: np.ndarray, positions: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """(n,): every motion within the tolerance of the samples has a jerk this large somewhere.

    A third divided difference times 6 is a mean of the third derivative, with the positive weights of a
    B-spline. The tolerance may change it by at most that times the sum of its absolute weights. Differences
    of samples farther apart are less sensitive to it, and of longer means: all doublings are tried.
    """
    values, stride = np.zeros(positions.shape[1]), 1
    while 3 * stride < len(times):
        first = np.arange(len(times) - 3 * stride)
        chosen = first[:, None] + stride * np.arange(4)
        apart = times[chosen][:, :, None] - times[chosen][:, None, :]
        weights = 6 / np.prod(apart + np.eye(4), axis=2)
        means = np.abs(np.einsum("ik,ikn->in", weights, positions[chosen]))
        sure = means - np.sum(np.abs(weights), axis=1)[:, None] * tolerance
        values, stride = np.maximum(values, sure.max(axis=0)), 2 * stride
    return values


def rests_of(times: np.ndarray, positions: np.ndarray, tolerance: np.ndarray) -> list[tuple[int, int]]:
    """First and last samples of the standstills during the motion, without their edges.

    Args:
        times: (N,), s.
        positions: (N, n), rad or m.
        tolerance: (n,), of these.
    """
    runs: list[list[int]] = []
    low, high, most = [np.inf], [-np.inf], (2 * tolerance).tolist()
    for k, q in enumerate(positions.tolist()):  # numbers of Python: a tenth of the time of small arrays
        low, high = list(map(min, low, q)), list(map(max, high, q))
        if not runs or any(top - bottom > by for top, bottom, by in zip(high, low, most, strict=True)):
            low = high = q
            runs.append([k, k])
        runs[-1][1] = k
    rests = []
    for first, last in runs[1:-1]:
        edge = REST_EDGE * (times[last] - times[first])
        inside = (
            np.searchsorted(times, times[first] + edge),
            np.searchsorted(times, times[last] - edge, "right") - 1,
        )
        if times[last] - times[first] >= REST_TIME and inside[1] > inside[0]:
            rests.append((int(inside[0]), int(inside[1])))
    return rests


def _part(
    times: np.ndarray, positions: np.ndarray, tolerance: np.ndarray, held: tuple[bool, bool], spacing: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Knots, positions and speeds there, and both at the samples, (N, 2 n), of a motion from rest to rest.

    Args:
        times: (N,), s.
        positions: (N, n), rad or m.
        tolerance: (n,), of these.
        held: whether the first and the last one are to be met, nearly.
        spacing: s, of the pieces, about.
    """
    tried = {}
    for knots in (_knots_near(times, spacing), _knots_amid(times)):
        spline, columns = _Spline.of(times, knots), []
        for joint, limit in enumerate(tolerance):
            try:
                columns.append(spline.calmest(positions[:, joint], limit, held))
            except ArithmeticError as error:
                tried[joint] = error
                break
        if len(columns) == len(tolerance):
            angles, rates, *at_samples = (np.stack(values, axis=1) for values in zip(*columns, strict=True))
            return knots, angles, rates, np.hstack(at_samples)
    joint = max(tried)
    raise InputError(f"no fit of joint {joint + 1} to the samples (Clarabel: {tried[joint]})")


def _knots_near(times: np.ndarray, spacing: float) -> np.ndarray:
    """Ends of pieces of about this length, s, for samples at times (N,).

    Of samples farther apart each interval has equal pieces, two at least unless it is much shorter than
    usual: two pieces pass any samples. Of denser samples a piece has one sample or several.
    """
    widths = np.diff(times)
    if spacing >= np.median(widths):
        knots = _knots_amid(times)
        return np.append(knots[: -1 : int(spacing / np.median(widths))], knots[-1])
    spacing = max(spacing, (times[-1] - times[0]) / MOST_PIECES)
    counts = np.where(widths > 0.5 * spacing, np.maximum(2, np.ceil(widths / spacing)), 1).astype(int)
    owner = np.repeat(np.arange(len(widths)), counts)
    number = np.arange(len(owner)) - np.concatenate([[0], np.cumsum(counts)[:-1]])[owner]
    return np.append(times[owner] + number * (widths / counts)[owner], times[-1])


def _knots_amid(times: np.ndarray) -> np.ndarray:
    """Ends of pieces that have one of the samples each: such pieces pass any samples."""
    return np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])


def noise_of(times: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Standard deviation of white noise per column, (n,), of the unit of the positions (N, n).

    Each sample is compared with polynomials through its neighbours, of degree 3 and 5: what both leave alike
    is noise, otherwise it is curvature. The lower quartile counts, so that acceleration steps do not.
    """
    if len(times) < ENOUGH:
        return np.zeros(positions.shape[1])
    noise = []
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
        noise.append(np.quantile(np.abs(left), 0.25, axis=0) / STILL)
    return np.where(noise[1] > WHITE * noise[0], np.minimum(*noise), 0.0)


@dataclass(frozen=True, eq=False)
class _Spline:
    """Motions of constant acceleration in K pieces, as quadratic splines with K + 2 coefficients.

    Attributes:
        times: (N,), of the samples, in units of their usual distance.
        unit: s, that distance.
        knots: (K + 1,), ends of the pieces, in the same unit.
        places: (K + 2,), where the coefficients belong.
        at_samples, at_knots: (N, K + 2), (K + 1, K + 2): positions per coefficient.
        speeds: (K + 1, K + 2), at the knots.
        jumps: (K + 1, K + 2), of the accelerations, with those from and to rest.
    """

    times: np.ndarray
    unit: float
    knots: np.ndarray
    places: np.ndarray
    at_samples: scipy.sparse.csr_matrix
    at_knots: scipy.sparse.csr_matrix
    speeds: scipy.sparse.csr_matrix
    jumps: scipy.sparse.csr_matrix

    @classmethod
    def of(cls, times: np.ndarray, ends: np.ndarray) -> _Spline:
        """With pieces between these ends, s."""
        unit = float(np.median(np.diff(times)))
        scaled_times, knots = times / unit, ends / unit
        whole = np.concatenate([knots[[0, 0]], knots, knots[[-1, -1]]])
        count = len(knots)
        speeds = scipy.sparse.diags(2 / (whole[3 : count + 3] - whole[1 : count + 1])) @ _differences(count)
        accelerations = scipy.sparse.diags(1 / np.diff(knots)) @ _differences(count - 1) @ speeds
        none = scipy.sparse.csr_matrix((1, count + 1))
        return cls(
            scaled_times,
            unit,
            knots,
            0.5 * (whole[1 : count + 2] + whole[2 : count + 3]),
            scipy.sparse.csr_matrix(scipy.interpolate.BSpline.design_matrix(scaled_times, whole, 2)),
            scipy.sparse.csr_matrix(scipy.interpolate.BSpline.design_matrix(knots, whole, 2)),
            scipy.sparse.csr_matrix(speeds),
            scipy.sparse.csr_matrix(_differences(count) @ scipy.sparse.vstack([none, accelerations, none])),
        )

    def calmest(
        self, positions: np.ndarray, tolerance: float, held: tuple[bool, bool] = (False, False)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The motion with minimum variation of acceleration: positions and speeds at the knots, then at the
        samples.

        Args:
            positions: (N,) at the samples.
            tolerance: of them.
            held: whether the first and the last one are to be met, nearly.

        Raises:
            ArithmeticError: the solver has no solution; its status.
        """
        if np.ptp(positions) <= 0:
            rest = np.zeros(len(self.knots)), np.zeros(len(positions))
            return positions[0] + rest[0], rest[0], positions[0] + rest[1], rest[1]
        scaled = (positions - positions[0]) / tolerance
        slack = np.ones(len(scaled))
        slack[[0, -1]] = np.where(held, HELD, 1.0)
        near = np.interp(self.places, self.times, scaled)  # the program adds what is missing, a few units
        coefficients = near + self._added(near, scaled, slack)
        speeds = self.speeds @ coefficients
        speeds[[0, -1]] = 0.0
        return (
            positions[0] + tolerance * (self.at_knots @ coefficients),
            tolerance / self.unit * speeds,
            positions[0] + tolerance * (self.at_samples @ coefficients),
            tolerance / self.unit * np.interp(self.times, self.knots, speeds),
        )

    @cached_property
    def _rows(self) -> scipy.sparse.csc_matrix:
        """Of the linear program, the same for all joints: ends at rest, acceleration steps, distances."""
        count = len(self.knots)
        none, each = scipy.sparse.csr_matrix((len(self.times), count)), scipy.sparse.identity(count)
        rows = [
            [self.speeds[[0, -1]], scipy.sparse.csr_matrix((2, count))],
            [self.jumps, -each],
            [-self.jumps, -each],
            [self.at_samples, none],
            [-self.at_samples, none],
        ]
        return scipy.sparse.bmat(rows, format="csc")

    def _added(self, near: np.ndarray, places: np.ndarray, slack: np.ndarray) -> np.ndarray:
        """The change of coefficients, from the linear program: minimum sum of acceleration steps within the
        slack.
        """
        size, count = len(near), len(self.knots)
        jumps, missing = self.jumps @ near, places - self.at_samples @ near
        ends = self.speeds[[0, -1]] @ near
        bounds = np.concatenate([-ends, -jumps, jumps, slack + missing, slack - missing])
        cones = [clarabel.ZeroConeT(2), clarabel.NonnegativeConeT(2 * (count + len(places)))]
        price = np.concatenate([np.zeros(size), np.ones(count)])
        settings = quiet_settings()
        settings.tol_gap_rel = settings.tol_gap_abs = 1e-6
        status = ""
        for share in STEPS:
            setattr(settings, "max_step_fraction", share)  # noqa: B010  # missing in its stubs
            result = solve_cones(price, self._rows, bounds, cones, settings)
            status = str(result.status)
            if status in USABLE:
                return np.array(result.x[:size])
            if status in INFEASIBLE:
                break
        raise ArithmeticError(status)


def _differences(count: int) -> scipy.sparse.csr_matrix:
    """(count, count + 1): each number from the next one."""
    return scipy.sparse.csr_matrix(
        scipy.sparse.eye(count, count + 1, k=1) - scipy.sparse.eye(count, count + 1)
    )
