"""Paths of motions and of points: smooth curves within a tolerance of what is given.

Accelerations along a path are its second derivatives, so these have to mean something. Samples are not
differentiated: a spline with as few knots as a tolerance allows is fitted to them. Noise larger than the
tolerance is refused, for the curvature of a path through noise is that of the noise.

The parameter of all curves here is close to the length of the path, with 1 rad as long as 1 m, so that the
first derivative never vanishes. A motion that rests on its way has a corner there, at which it rests again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import factorial

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PPoly
from scipy.linalg import solveh_banded

from ocptip.basics.errors import InputError, finite_array
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.points import Fit
from ocptip.trajectories.trajectory import Trajectory

FINE = 5e-5  # rad or m: distance of a path from a motion that is known exactly
SAMPLES = 4000  # of a motion between two rests
IN_RAMP = 100  # samples between two events of ramps
STILL = 1e-6  # rad/s or m/s: a motion that is slower rests
LEAST = 1e-9  # rad or m: points that are nearer to each other are the same
_MERGED = 0.1  # of the tolerance: points that are nearer to each other are nearly the same
BACK = 0.2
"""Lines whose unit vectors add up to less than this have no blend between them: the way turns back."""

_DEGREE = 5
_MET = 1e-5  # s: events of ramps that are nearer to each other are one
_AT_REST = 1e-5  # s: events nearer to begin or end are there; a joint goes less than 1e-9 rad in between
_TURNS = 1e-5  # of the greatest speed: where all joints are slower, the way turns back
_SAME = 1e-7  # of the length: samples that are nearer to each other are one
_FEWEST = 12  # twice as many samples as a piece has at least
_NEARLY = 0.3  # of the tolerance: pieces that are farther off are divided, if any is too far off
_FIRST = 4  # pieces to begin with
_SLOWER = 0.01  # of the time: fits that the pace of the motion suits worse are refined
_TOO_SLOW = 0.1  # of the time: those that it still suits worse are refused
_REFINED = 4  # times at most; the tolerance is a quarter of the one before
_SMALL = 0.05  # of the greatest acceleration: that of a joint counts as at least so much


@dataclass(frozen=True, eq=False)
class FittedPath:
    """A path, and how far it is from what it was made of.

    Attributes:
        path: the path.
        how: what was made of what, in words.
        places: (M,), in [0, 1]: where on the path the samples are.
        samples: (M, n), rad or m: what the path was made of.
    """

    path: JointPath
    how: str
    places: np.ndarray
    samples: np.ndarray

    @property
    def distance(self) -> np.ndarray:
        """Largest distance of each joint from the samples, (n,), rad or m."""
        return np.max(np.abs(self.path.at(self.places)[0] - self.samples), axis=0)


def path_of_motion(motion: Trajectory, tolerance: float | np.ndarray | None = None) -> FittedPath:
    """The path that a motion takes; its times are forgotten.

    Args:
        motion: of ramps, or samples. Samples of positions alone (those of a joint trajectory without
            velocities) are points: a smooth curve goes through them, or within a tolerance straight lines.
        tolerance: rad or m, or (n,): how far the path may be from it; default: almost not at all.

    Raises:
        InputError: it does not move, its samples are noisy beyond the tolerance, or a curve within the
            tolerance cannot be followed at nearly its pace with its accelerations.
    """
    if motion.timing is not None:
        path, ends = motion.timing.path, motion.timing.path.breakpoints
        return FittedPath(path, "the path of a timing as it is", ends, path.at(ends)[0])
    if motion.points is not None and motion.points.speeds is None:
        points = motion.points.angles
        return spline_through(points) if tolerance is None else blended_lines(points, tolerance)
    wanted = np.full(motion.n, FINE) if tolerance is None else np.broadcast_to(tolerance, motion.n)
    if motion.fit is not None:
        _refuse_noise(motion.fit, wanted)
        wanted = np.maximum(wanted, motion.fit.tolerance)
    legs, ramps = [], motion.profiles is not None
    for begin, end in _moving(motion):
        leg = Leg.of_ramps(motion, begin, end) if ramps else None
        if leg is not None:
            legs.append(leg)
            continue
        events = motion.event_times
        events = events[(events >= begin) & (events <= end)]
        counts = np.ceil(SAMPLES / (end - begin) * np.diff(events)).astype(int)
        counts = np.maximum(counts, IN_RAMP if ramps else 2)
        owner = np.repeat(np.arange(len(counts)), counts)
        first = np.append(0, np.cumsum(counts))
        share = (np.arange(first[-1]) - first[owner]) / counts[owner]
        times = np.append(events[owner] + share * np.diff(events)[owner], end)
        legs.append(_of_pace(motion, times, wanted, first[1:-1] if ramps else ()))
    if not legs:
        raise InputError("path: the motion does not move")
    return joined(legs, "smooth curve along the motion")


def _of_pace(
    motion: Trajectory, times: np.ndarray, tolerance: np.ndarray, breaks: Sequence[int] | np.ndarray
) -> Leg:
    """The curve within a tolerance of a motion at times (M,), s, that can be followed at its pace, nearly."""
    q, v, a = motion.states(times)
    least = motion.fit.tolerance if motion.fit else np.zeros(motion.n)
    leg = Leg.fitted(q, tolerance, breaks)
    slower = leg.slower(times, v, a)
    for _ in range(_REFINED):
        finer = np.maximum(tolerance / 4, np.minimum(least, tolerance))
        if slower <= _SLOWER or np.array_equal(finer, tolerance):
            break
        try:
            other = Leg.fitted(q, finer, breaks)
        except InputError:
            break  # there are too few samples
        tolerance, own = finer, other.slower(times, v, a)
        if own < slower:
            leg, slower = other, own
    if slower > _TOO_SLOW:
        raise InputError(
            f"path: with the accelerations of the motion a smooth curve along it from {times[0]:.6g} to "
            f"{times[-1]:.6g} s takes at least {100 * slower:.0f} % longer: its curvature is not that of the "
            "motion; give another --path-tolerance, or waypoints"
        )
    return leg


def spline_through(points: np.ndarray, tolerance: float | np.ndarray = 0.0) -> FittedPath:
    """The cubic spline through N points (N, n), rad or m, free at its ends.

    Args:
        points: what it passes; of points that are nearly the same, see `distinct`, the first one.
        tolerance: rad or m, or (n,): how far the path may be from what is given.

    Raises:
        InputError: there are fewer than two points that differ.
    """
    given, kept = _checked(points, tolerance)
    points = given[kept]
    lengths = _lengths(points)
    curve = CubicSpline(lengths, points, bc_type="natural")
    leg = Leg(curve, lengths, points, np.arange(len(points)))
    return _with_left_out(joined([leg], f"smooth curve through {len(points)} points"), given, kept)


def blended_lines(points: np.ndarray, tolerance: float | np.ndarray = 0.0) -> FittedPath:
    """Straight lines between N points (N, n), rad or m, whose corners are rounded.

    Args:
        points: the ends of the lines.
        tolerance: rad or m, or (n,): how far each joint may be from the lines at corners; 0: corners stay.
            Curvature is continuous everywhere. Where the way turns back there is no blend.

    Raises:
        InputError: there are fewer than two points that differ.
    """
    given, kept = _checked(points, tolerance)
    points = given[kept]
    legs = _line_legs(points, np.broadcast_to(tolerance, points.shape[1]))
    how = f"straight lines between {len(points)} points"
    if np.any(np.asarray(tolerance) > 0):
        how += ", corners blended"
    return _with_left_out(joined(legs, how), given, kept)


def _line_legs(points: np.ndarray, tolerance: np.ndarray) -> list[Leg]:
    """Lines and blends between corners that stay."""
    lengths = _lengths(points)
    ways = np.diff(points, axis=0) / np.diff(lengths)[:, None]
    room = 0.5 * np.diff(lengths)
    legs, knots, rows, first = [], [0.0], [], 0
    for k in range(1, len(points)):
        knots.append(lengths[k])
        rows.append(_line(points[k - 1], ways[k - 1], knots[-2] - lengths[k - 1]))
        if k == len(points) - 1:
            continue
        bend = ways[k] - ways[k - 1]
        reach = min(blend_reach(np.abs(bend), tolerance), room[k - 1], room[k])
        if not np.any(np.abs(bend) > LEAST):
            continue  # straight on
        if reach > 0 and np.linalg.norm(ways[k] + ways[k - 1]) >= BACK:
            knots[-1:] = [lengths[k] - reach, lengths[k] + reach]
            rows.append(blend_rows(points[k] - reach * ways[k - 1], ways[k - 1], bend, reach))
            continue
        legs.append(Leg.of_rows(rows, knots, lengths, points, slice(first, k + 1)))
        knots, rows, first = [lengths[k]], [], k
    return [*legs, Leg.of_rows(rows, knots, lengths, points, slice(first, len(points)))]


def _line(point: np.ndarray, way: np.ndarray, beyond: float) -> np.ndarray:
    """Coefficients (5, n) of a line from `beyond` its first point on."""
    rows = np.zeros((5, len(point)))
    rows[3], rows[4] = way, point + beyond * way
    return rows


def blend_reach(bend: float | np.ndarray, tolerance: float | np.ndarray) -> float:
    """Half length of a blend that stays within the tolerance of its corner."""
    return float(np.min(np.divide(tolerance, 3 / 16 * np.maximum(bend, LEAST))))


def blend_rows(begin: np.ndarray, way: np.ndarray, bend: np.ndarray, reach: float) -> np.ndarray:
    """Coefficients (5, n): direction from `way` to `way + bend` over 2 `reach`, curvature 0 at both ends.

    With y the distance from the begin and h = 2 reach: q' = way + bend (3 (y/h)^2 - 2 (y/h)^3).
    """
    h = 2 * reach
    return np.stack([-bend / (2 * h**3), bend / h**2, 0 * bend, way, begin])


def _checked(points: np.ndarray, tolerance: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, n), and the numbers of those that a path is to pass."""
    points = finite_array("points", points, (None, None))
    if len(points) < 2:
        raise InputError(f"points: at least two are needed for a path, got {len(points)}")
    apart = np.maximum(FINE, _MERGED * np.asarray(tolerance))
    kept = distinct(points, apart)
    if len(kept) < 2:
        raise InputError(
            f"points: none of {len(points)} differs from the others by more than {np.max(apart):.2g} (rad or "
            "m); a path needs two that do"
        )
    return points, kept


def distinct(points: np.ndarray, apart: float | np.ndarray) -> np.ndarray:
    """Numbers of points (N, n) that differ from the one kept before by more than `apart`; both ends stay.

    A curve through two points that are nearly the same would go where rounding points.
    """
    kept = [0]
    for k in range(1, len(points)):
        if np.any(np.abs(points[k] - points[kept[-1]]) > apart):
            kept.append(k)
    if kept[-1] < len(points) - 1:  # nearly the last one
        kept[len(kept) - (len(kept) > 1) :] = [len(points) - 1]
    near = len(kept) == 2 and not np.any(np.abs(points[kept[1]] - points[kept[0]]) > apart)
    return np.array(kept[:1] if near else kept)


def _with_left_out(fit: FittedPath, points: np.ndarray, kept: np.ndarray) -> FittedPath:
    """The path with the points (N, n) that were left out: they count for its distance, and are named."""
    others = np.setdiff1d(np.arange(len(points)), kept)
    if not others.size:
        return fit
    same = kept[np.clip(np.searchsorted(kept, others, side="right") - 1, 0, None)]
    lengths = _lengths(points[kept])
    last = others > kept[-2] if len(kept) > 1 else np.zeros(len(others), dtype=bool)
    near = np.abs(points[others] - points[same]).max(axis=1) > np.abs(points[others] - points[-1]).max(axis=1)
    same = np.where(last & near, kept[-1], same)
    places = lengths[np.searchsorted(kept, same)] / lengths[-1]
    repeats = int(np.sum(np.max(np.abs(points[others] - points[same]), axis=1) <= LEAST))
    words = [f"{repeats} repeated"] * bool(repeats)
    words += [f"{len(others) - repeats} nearly the same as the one before"] * (repeats < len(others))
    return FittedPath(
        fit.path,
        f"{fit.how}, without {' and '.join(words)}",
        np.concatenate([fit.places, places]),
        np.concatenate([fit.samples, points[others]]),
    )


def _lengths(points: np.ndarray) -> np.ndarray:
    """Length of the polygon up to each point, (N,)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _refuse_noise(fit: Fit, tolerance: np.ndarray) -> None:
    """Refuse noise that the tolerance does not cover."""
    loud = np.flatnonzero(fit.noisy & (fit.tolerance > tolerance))
    if loud.size:
        joint = int(loud[np.argmax(fit.tolerance[loud])])
        raise InputError(
            f"path: the samples of joint {joint + 1} are noisy, by up to {fit.tolerance[joint]:.2g} (rad "
            "or m): the curvature of a path through them is that of the noise; say by how much the path may "
            "be off (--path-tolerance), or give waypoints"
        )


def _moving(motion: Trajectory) -> list[tuple[float, float]]:
    """Intervals (s) between rests in which the motion moves."""
    events = motion.event_times
    rests = np.max(np.abs(motion.states(events)[1]), axis=1) <= STILL
    rests[[0, -1]] = True
    ends, found = events[rests], []
    for begin, end in pairwise(ends):
        way = motion.states(np.linspace(begin, end, 9))[0]
        if np.max(np.ptp(way, axis=0)) > LEAST:
            found.append((float(begin), float(end)))
    return found


@dataclass(frozen=True, eq=False)
class Leg:
    """A smooth piece of a path by its length.

    Attributes:
        curve: of the length, (n,).
        lengths: (M,): where the samples are.
        samples: (M, n).
        numbers: (M,): which of the samples that were given these are.
    """

    curve: PPoly
    lengths: np.ndarray
    samples: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of_rows(
        cls, rows: list[np.ndarray], knots: list[float], lengths: np.ndarray, points: np.ndarray, own: slice
    ) -> Leg:
        """Of the polynomials between knots."""
        kept = np.append(np.diff(knots) > LEAST * knots[-1], True)  # blends may leave no line between them
        curve = PPoly(np.stack(rows, axis=1)[:, kept[:-1]], np.array(knots)[kept])
        return cls(curve, lengths[own], points[own], np.arange(len(points))[own])

    @classmethod
    def of_ramps(cls, motion: Trajectory, begin: float, end: float) -> Leg | None:
        """The path of ramps as it is, its parameter their time; None of S-curves, and where they turn back.

        Between its first two events, and its last two, it is a straight line: there the parameter is half the
        square of the time from rest.
        """
        if any(motion.rise_times):
            return None
        inner = motion.event_times
        inner = inner[(inner > begin + _AT_REST) & (inner < end - _AT_REST)]
        if not len(inner):
            return None
        times = np.concatenate([[begin], inner[np.append(True, np.diff(inner) > _MET)], [end]])
        q, v, _ = motion.states(times)
        if np.any(np.max(np.abs(v[1:-1]), axis=1) < _TURNS * np.max(np.abs(v))):
            return None
        v[0], v[-1], widths = v[1], v[-2], np.diff(times)
        widths[[0, -1]] /= 2
        w, first, last = widths[:, None], v[:-1], v[1:]
        pace = np.diff(q, axis=0) / w
        rows = [(first + last - 2 * pace) / w**2, (3 * pace - 2 * first - last) / w, first, q[:-1]]
        knots = np.append(0.0, np.cumsum(widths))
        return cls(PPoly(np.stack(rows), knots), knots, q, np.arange(len(q)))

    @classmethod
    def fitted(
        cls, samples: np.ndarray, tolerance: np.ndarray, breaks: Sequence[int] | np.ndarray = ()
    ) -> Leg:
        """The spline with few knots that passes samples within a tolerance, exactly at both ends.

        Args:
            samples: (M, n), close to each other.
            tolerance: (n,).
            breaks: numbers of samples at which the curvature may jump.

        Raises:
            InputError: the samples have corners that no smooth curve passes within the tolerance.
        """
        lengths = _lengths(samples)
        kept = np.append(np.diff(lengths) > _SAME * lengths[-1], True)
        kept[0], kept[-2] = (
            True,
            len(samples) == 2 or (kept[-2] and lengths[-1] - lengths[-2] > _SAME * lengths[-1]),
        )
        at, values = lengths[kept], samples[kept]
        places = np.clip(np.searchsorted(np.flatnonzero(kept), breaks), 0, len(at) - 1)
        jumps = at[_apart(places.tolist(), len(at))]
        knots = _supported(at, np.union1d(np.linspace(0, at[-1], _FIRST + 1)[1:-1], jumps), jumps)
        while True:
            curve = _least_squares(at, values, knots, jumps)
            off = np.max(np.abs(curve(at) - values) / tolerance, axis=1)
            if off.max() <= 1:
                return cls(curve, at, values, np.flatnonzero(kept))
            owner = np.searchsorted(knots, at, side="right")
            bad = np.unique(owner[off > _NEARLY])  # neighbours pull at each other
            middles = [float(np.median(at[owner == k])) for k in bad]
            more = _supported(at, np.union1d(knots, middles), jumps)
            if len(more) <= len(knots):
                break
            knots = more
        share = at[int(np.argmax(off))] / at[-1]
        miss = np.max(np.abs(curve(at) - values))
        raise InputError(
            f"path: no smooth curve keeps within {tolerance.min():.2g} (rad or m) of it: at "
            f"{100 * share:.0f} % of its length it is {miss:.2g} off; is there a corner? Say by how much the "
            "path may be off (--path-tolerance)"
        )

    def slower(self, times: np.ndarray, speeds: np.ndarray, accelerations: np.ndarray) -> float:
        """By what share of the time, at least, it is slower than a motion, with accelerations as great.

        At the pace of the motion they are q' u + q'' (ds/dt)^2 with the ds/dt and u that come nearest; where
        they are f > 1 times the greatest of the motion, it has to be passed sqrt(f) times slower.

        Args:
            times: (M,), s, of all samples that were given; so are the others.
            speeds: (M, n), rad/s or m/s.
            accelerations: (M, n), rad/s^2 or m/s^2.
        """
        most = np.max(np.abs(accelerations), axis=0)
        most = np.maximum(most, max(_SMALL * most.max(), 1e-300))
        t, v, a = (part[self.numbers] for part in (times, speeds, accelerations))
        way, bend = self.curve(self.lengths, nu=1), self.curve(self.lengths, nu=2)
        square = np.sum(way**2, axis=1)
        across = bend * (np.sum(way * v, axis=1) / square)[:, None] ** 2
        own = way * (np.sum(way * (a - across), axis=1) / square)[:, None] + across
        factors = np.sqrt(np.max(np.abs(own) / most, axis=1))
        return float(np.trapezoid(np.maximum(factors, 1.0) - 1.0, t) / (t[-1] - t[0]))


def _apart(places: Sequence[int], count: int) -> list[int]:
    """Those of sorted numbers of samples that have enough others between them and before both ends."""
    kept = [0]
    for place in places:
        if place - kept[-1] >= 2 * _FEWEST and count - place > 2 * _FEWEST:
            kept.append(place)
    return kept[1:]


def _supported(at: np.ndarray, knots: np.ndarray, jumps: np.ndarray) -> np.ndarray:
    """Knots (k,) with enough samples between them; those at jumps stay."""
    kept: list[float] = []
    fixed = np.concatenate([[0.0], jumps, at[-1:]])
    for knot in knots:
        last = kept[-1] if kept else 0.0
        after = fixed[np.searchsorted(fixed, knot, side="right")]
        room = min(np.count_nonzero((at > low) & (at <= high)) for low, high in ((last, knot), (knot, after)))
        if room >= _FEWEST // 2 or knot in jumps:
            kept.append(float(knot))
    return np.array(kept)


def _least_squares(at: np.ndarray, values: np.ndarray, knots: np.ndarray, jumps: np.ndarray) -> PPoly:
    """The quintic spline nearest to values (M, n), exact at both ends; at jumps its slope is continuous."""
    inner = np.sort(np.concatenate([knots, np.repeat(jumps, _DEGREE - 2)]))
    edge = np.full(_DEGREE + 1, at[-1])
    t = np.concatenate([np.zeros(_DEGREE + 1), inner, edge])
    design = BSpline.design_matrix(at, t, _DEGREE).tocsr()
    count = len(t) - _DEGREE - 1
    weights = np.gradient(at)
    coefficients = np.zeros((count, values.shape[1]))
    coefficients[0], coefficients[-1] = values[0], values[-1]
    left = values - design @ coefficients
    free = design[:, 1:-1]
    normal = (free.T @ free.multiply(weights[:, None])).toarray()
    bands = np.zeros((_DEGREE + 1, count - 2))
    for k in range(_DEGREE + 1):
        bands[_DEGREE - k, k:] = np.diagonal(normal, k)
    coefficients[1:-1] = solveh_banded(bands, free.T @ (weights[:, None] * left))
    spline, ends = BSpline(t, coefficients, _DEGREE), np.unique(t)
    rows = [spline(ends[:-1], nu=k) / factorial(k) for k in range(_DEGREE, -1, -1)]
    return PPoly(np.stack(rows), ends)


def joined(legs: Sequence[Leg], how: str) -> FittedPath:
    """One path of all legs."""
    whole = sum(leg.curve.x[-1] - leg.curve.x[0] for leg in legs)
    degree = max(len(leg.curve.c) for leg in legs)
    powers = whole ** np.arange(degree - 1, -1, -1.0)
    ends, rows, places, begin = [0.0], [], [], 0.0
    for leg in legs:
        shift = begin - leg.curve.x[0]
        own = np.zeros((degree, *leg.curve.c.shape[1:]))
        own[degree - len(leg.curve.c) :] = leg.curve.c
        rows.append(own * powers[:, None, None])
        ends += ((leg.curve.x[1:] + shift) / whole).tolist()
        places.append((leg.lengths + shift) / whole)
        begin = leg.curve.x[-1] + shift
    ends[-1] = 1.0
    path = JointPath(np.array(ends), np.concatenate(rows, axis=1))
    samples = np.concatenate([leg.samples for leg in legs])
    return FittedPath(path, how, np.clip(np.concatenate(places), 0.0, 1.0), samples)
