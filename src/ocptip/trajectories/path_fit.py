"""Paths of motions and of points: smooth curves within a tolerance of what is given.

Accelerations along a path are its second derivatives, so these have to mean something. Samples are not
differentiated: a spline with as few knots as a tolerance allows is fitted to them. Noise larger than the
tolerance is refused, for the curvature of a path through noise is that of the noise.

The parameter of all curves here is close to the length of the path, with 1 rad as long as 1 m, so that the
first derivative never vanishes. A motion that rests between its ends has a corner there, at which it rests
again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, finite_array
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.path_legs import LEAST, Leg, polygon_lengths
from ocptip.trajectories.points import Fit
from ocptip.trajectories.trajectory import Trajectory

FINE = 5e-5  # rad or m: distance of a path from a motion that is known exactly
SAMPLES = 4000  # of a motion between two rests
LINE_SAMPLES = 401  # of the line between two points, from which a spline is measured
BESIDE_LINES = 4  # samples of the line for one of the spline
IN_RAMP = 100  # samples between two events of ramps
STILL = 1e-6  # rad/s or m/s: a motion that is slower rests
_MERGED = 0.1  # of the tolerance: points that are nearer to each other are nearly the same
BACK = 0.2
"""Lines whose unit vectors add up to less than this have no blend between them: the path turns back."""

_SLOWER = 0.01  # of the time: fits that the pace of the motion suits worse are refined
_TOO_SLOW = 0.1  # of the time: those that it still suits worse are refused
_REFINED = 4  # times at most; the tolerance is a quarter of the one before


@dataclass(frozen=True, eq=False)
class FittedPath:
    """A path, and how far it is from what it was made of.

    Attributes:
        path: the path.
        how: what was made of what, in words.
        places: (M,), in [0, 1]: where on the path the samples are.
        samples: (M, n), rad or m: what the path was made of.
        keeps_to_lines: of a spline through points: what to give for the straight lines between them.
    """

    path: JointPath
    how: str
    places: np.ndarray
    samples: np.ndarray
    keeps_to_lines: str = field(default="", kw_only=True)

    def some(self, columns: slice) -> FittedPath:
        """The path of some of the joints."""
        return replace(self, path=self.path.some(columns), samples=self.samples[:, columns])

    @property
    def distance(self) -> np.ndarray:
        """Largest distance of each joint from the samples, (n,), rad or m."""
        return np.max(np.abs(self.path.at(self.places)[0] - self.samples), axis=0)

    def beside_lines(
        self, position: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> tuple[np.ndarray, float]:
        """Largest distance of a spline from the straight lines in joint space between its points.

        Each line is compared with the piece of the spline between the same points, at dense samples.

        Args:
            position: of the TCP, m, (N, 3), in postures (N, n), rad or m; None: there is none.

        Returns:
            distance of each joint, (n,), rad or m, from the nearest posture of the line, with 1 rad as 1 m;
            that of the TCP, m, from its nearest position on the line.
        """
        joints, tool, n = np.zeros(self.samples.shape[1]), 0.0, self.samples.shape[1]
        shares, ends = np.linspace(0, 1, LINE_SAMPLES)[:, None], self.path.breakpoints
        places = ends[:-1, None] + shares[::BESIDE_LINES, 0] * np.diff(ends)[:, None]
        curves = self.path.at(places.ravel())[0].reshape(*places.shape, n)
        # No point of a curve is farther from its line than from the line's point of the same share: what is
        # nearer to that than the farthest so far is not compared with the others.
        beside = curves[:, :1] + shares[::BESIDE_LINES] * (curves[:, -1:] - curves[:, :1])
        far, tools = np.abs(curves - beside).max(axis=2), curves
        far_tool = np.zeros(far.shape)
        if position is not None:
            tools, on_line = (position(q.reshape(-1, n)).reshape(*far.shape, -1) for q in (curves, beside))
            far_tool = np.linalg.norm(tools - on_line, axis=2)
        for k in np.argsort(-far.max(axis=1), kind="stable"):
            line = curves[k, 0] + shares * (curves[k, -1] - curves[k, 0])
            if (rows := far[k] > joints.min()).any():
                off = np.abs(curves[k, rows, None] - line)
                nearest = np.argmin(off.max(axis=2), axis=1)
                joints = np.maximum(joints, off[np.arange(len(off)), nearest].max(axis=0))
            if position is not None and (rows := far_tool[k] > tool).any():
                between = np.linalg.norm(tools[k, rows, None] - position(line), axis=2)
                tool = max(tool, float(between.min(axis=1).max()))
        return joints, tool


def path_of_motion(
    motion: Trajectory, tolerance: float | np.ndarray | None = None, *, smooth: bool = False
) -> FittedPath:
    """The path that a motion takes; its times are forgotten.

    Args:
        motion: of trapezoidal velocity profiles, or samples. Samples of positions alone (those of a joint
            trajectory without velocities) are points: a smooth curve goes through them, or within a tolerance
            straight lines.
        tolerance: rad or m, or (n,): how far the path may be from it; default: nearly 0.
        smooth: the curvature has no steps where accelerations of profiles have, as jerk limits need it.

    Raises:
        InputError: it does not move, its samples are noisy beyond the tolerance, or a curve within the
            tolerance cannot be followed at nearly its speed with its accelerations.
    """
    if motion.timing is not None:
        path, ends = motion.timing.path, motion.timing.path.breakpoints
        return FittedPath(path, "the path of a timing as it is", ends, path.at(ends)[0])
    if motion.points is not None and motion.points.speeds is None:
        points = motion.points.angles
        if tolerance is None:
            return replace(spline_through(points), keeps_to_lines="--path-tolerance")
        return blended_lines(points, tolerance)
    wanted = np.full(motion.n, FINE) if tolerance is None else np.broadcast_to(tolerance, motion.n)
    if motion.fit is not None:
        _refuse_noise(motion.fit, wanted)
        wanted = np.maximum(wanted, motion.fit.tolerance)
    legs, ramps = [], motion.profiles is not None and not smooth
    for begin, end in _moving(motion):
        leg = Leg.of_ramps(motion, begin, end) if ramps else None
        if leg is not None:
            legs.append(leg)
            continue
        events = motion.event_times
        events = events[(events >= begin) & (events <= end)]
        counts = np.ceil(SAMPLES / (end - begin) * np.diff(events)).astype(int)
        counts = np.maximum(counts, 2 if motion.profiles is None else IN_RAMP)
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
    """The curve within a tolerance of a motion at times (M,), s, that can be followed at nearly its speed."""
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
        tolerance, slowed = finer, other.slower(times, v, a)
        if slowed < slower:
            leg, slower = other, slowed
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
    lengths = polygon_lengths(points)
    curve = scipy.interpolate.CubicSpline(lengths, points, bc_type="natural")
    leg = Leg(curve, lengths, points, np.arange(len(points)))
    fit = joined([leg], f"smooth curve through {len(points)} points")
    return _with_left_out(replace(fit, keeps_to_lines='between = "lines"'), given, kept)


def blended_lines(points: np.ndarray, tolerance: float | np.ndarray = 0.0) -> FittedPath:
    """Straight lines between N points (N, n), rad or m, whose corners are rounded.

    Args:
        points: the ends of the lines.
        tolerance: rad or m, or (n,): how far each joint may be from the lines at corners; 0: corners stay.
            Curvature is continuous everywhere. Where the path turns back there is no blend.

    Raises:
        InputError: there are fewer than two points that differ.
    """
    given, kept = _checked(points, tolerance)
    points = given[kept]
    bends = np.diff(_directions(points), axis=0)
    legs = _line_legs(points, [blend_reach(np.abs(bend), tolerance) for bend in bends])
    how = f"straight lines between {len(points)} points"
    if np.any(np.asarray(tolerance) > 0):
        how += ", corners blended"
    return _with_left_out(joined(legs, how), given, kept)


def rounded_lines(points: np.ndarray, reaches: Sequence[float]) -> FittedPath:
    """Straight lines between N points (N, n), rad or m, with a blend of given half length at each corner.

    Args:
        points: the ends of the lines, all different.
        reaches: (N - 2,), rad or m, at most half of the shorter line; see `blend_rows`.
    """
    how = f"straight lines between {len(points)} points, corners blended"
    return joined(_line_legs(points, reaches), how)


def _directions(points: np.ndarray) -> np.ndarray:
    """Unit vectors (N - 1, n) of the lines between points."""
    return np.diff(points, axis=0) / np.diff(polygon_lengths(points))[:, None]


def _line_legs(points: np.ndarray, reaches: Sequence[float]) -> list[Leg]:
    """Lines and blends, of these half lengths or as long as fits, between corners that stay."""
    lengths = polygon_lengths(points)
    directions, halves = _directions(points), 0.5 * np.diff(lengths)
    legs, knots, rows, first = [], [0.0], [], 0
    for k in range(1, len(points)):
        knots.append(lengths[k])
        rows.append(_line(points[k - 1], directions[k - 1], knots[-2] - lengths[k - 1]))
        if k == len(points) - 1:
            continue
        bend = directions[k] - directions[k - 1]
        reach = min(reaches[k - 1], halves[k - 1], halves[k])
        if not np.any(np.abs(bend) > LEAST):
            continue  # straight on
        if reach > 0 and np.linalg.norm(directions[k] + directions[k - 1]) >= BACK:
            knots[-1:] = [lengths[k] - reach, lengths[k] + reach]
            rows.append(blend_rows(points[k] - reach * directions[k - 1], directions[k - 1], bend, reach))
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

    With y the distance from the begin and h = 2 reach: `q' = way + bend (3 (y/h)^2 - 2 (y/h)^3)`.
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
    lengths = polygon_lengths(points[kept])
    last = others > kept[-2] if len(kept) > 1 else np.zeros(len(others), dtype=bool)
    near = np.abs(points[others] - points[same]).max(axis=1) > np.abs(points[others] - points[-1]).max(axis=1)
    same = np.where(last & near, kept[-1], same)
    places = lengths[np.searchsorted(kept, same)] / lengths[-1]
    repeats = int(np.sum(np.max(np.abs(points[others] - points[same]), axis=1) <= LEAST))
    words = [f"{repeats} repeated"] * bool(repeats)
    words += [f"{len(others) - repeats} nearly the same as the one before"] * (repeats < len(others))
    return replace(
        fit,
        how=f"{fit.how}, without {' and '.join(words)}",
        places=np.concatenate([fit.places, places]),
        samples=np.concatenate([fit.samples, points[others]]),
    )


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
    ends, results = events[rests], []
    for begin, end in pairwise(ends):
        way = motion.states(np.linspace(begin, end, 9))[0]
        if np.max(np.ptp(way, axis=0)) > LEAST:
            results.append((float(begin), float(end)))
    return results


def joined(legs: Sequence[Leg], how: str) -> FittedPath:
    """One path of all legs."""
    whole = sum(leg.curve.x[-1] - leg.curve.x[0] for leg in legs)
    degree = max(len(leg.curve.c) for leg in legs)
    powers = whole ** np.arange(degree - 1, -1, -1.0)
    ends, rows, places, begin = [0.0], [], [], 0.0
    for leg in legs:
        shift = begin - leg.curve.x[0]
        coefficients = np.zeros((degree, *leg.curve.c.shape[1:]))
        coefficients[degree - len(leg.curve.c) :] = leg.curve.c
        rows.append(coefficients * powers[:, None, None])
        ends += ((leg.curve.x[1:] + shift) / whole).tolist()
        places.append((leg.lengths + shift) / whole)
        begin = leg.curve.x[-1] + shift
    ends[-1] = 1.0
    path = JointPath(np.array(ends), np.concatenate(rows, axis=1))
    samples = np.concatenate([leg.samples for leg in legs])
    return FittedPath(path, how, np.clip(np.concatenate(places), 0.0, 1.0), samples)
