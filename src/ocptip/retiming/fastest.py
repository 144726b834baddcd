"""The fastest timing of a path: reachability on a grid of nodes (Pham and Pham 2018), rows at both ends.

Backward, from which x at each node the rest of the path can be done; then forward, the maximum x. Rows hold
at both ends of every interval, so that there is no singularity where a coefficient of u vanishes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.text import joint_words
from ocptip.retiming.kernels import MOST, controllable, greatest, reduced
from ocptip.retiming.rows import HalfPlanes, PathClock, Places, TimingLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.path import JointPath

NODES = 100
_RAMP = 0.25  # share of the time of a stretch in which nodes get farther apart
_SAME = 1e-6  # of x: rooms that differ by less are the same
_TURNS, _MOST_TIMES = 5, 10  # for which a count is enough; of it at most
_PER_PIECE, _TURNING = 8, 1e-3  # places per piece of a path; of the greatest derivative: slower is none
_BETWEEN = np.array([0.25, 0.5, 0.75])
_BEYOND = 1e-7  # excess of rows between nodes, in units of the limits, that is none
_CLOSE = 0.2  # of the next step: nearer to a breakpoint there are no further nodes


@dataclass(frozen=True, eq=False)
class Polygons:
    """The feasible sets of N intervals: convex polygons in (p, q), the values of x at both ends.

    Attributes:
        counts: (N,) edges; 0: there is nothing.
        rows: (N, MOST, 3), a p + b q <= c.
        numbers: (N, MOST) of the rows, see `kernels.reduced`.
        corners: (N, MOST, 2).
    """

    counts: np.ndarray
    rows: np.ndarray
    numbers: np.ndarray
    corners: np.ndarray

    def all_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Intervals (R,) and rows (R, 3) of all of them."""
        i, k = np.nonzero(np.arange(self.rows.shape[1]) < self.counts[:, None])
        return i, self.rows[i, k]


@dataclass(frozen=True, eq=False)
class ExtraRows:
    """Further rows a p + b q <= c of intervals: tangents, and rows between the nodes.

    Attributes:
        intervals: (E,), sorted.
        rows: (E, 3).
        names: (E,) of the limits.
    """

    intervals: np.ndarray
    rows: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def none(cls) -> ExtraRows:
        """No rows."""
        return cls(np.empty(0, dtype=int), np.empty((0, 3)), ())

    def with_more(
        self,
        intervals: np.ndarray,
        share: np.ndarray,
        widths: np.ndarray,
        block: np.ndarray,
        names: list[str],
    ) -> ExtraRows:
        """And rows alpha u + beta x <= gamma, block (3, R), at shares (R,) of intervals (R,)."""
        alpha, beta, gamma = block
        u = alpha / (2 * widths[intervals])
        rows = np.column_stack([beta * (1 - share) - u, beta * share + u, gamma])
        every = np.concatenate([self.intervals, intervals])
        order = np.argsort(every, kind="stable")
        known = (*self.names, *names)
        return ExtraRows(every[order], np.vstack([self.rows, rows])[order], tuple(known[k] for k in order))


class Grid:
    """The nodes of a path with the rows of all limits.

    Args:
        robot, path, limits: whose.
        s: (N + 1,) nodes, all breakpoints among them.
        ends: x at start and end, 1/s^2.
        clocks: of what acts over time; rows hold by each of them.

    Attributes:
        every: nodes by each clock; those at which derivatives have steps occur twice.
        left, right: (N,), the places at both ends of the intervals.
        widths: (N,).
        bounds: (N + 1, 2), minimum and maximum x at the nodes.
    """

    def __init__(
        self,
        robot: StandingMechanism,
        path: JointPath,
        limits: TimingLimits,
        s: np.ndarray,
        ends: tuple[float, float] = (0.0, 0.0),
        clocks: Sequence[PathClock] = (),
    ) -> None:
        self.robot, self.path, self.limits, self.s, self.widths = robot, path, limits, s, np.diff(s)
        self.clocks: Sequence[PathClock | None] = clocks or (None,)
        count = len(s) - 1
        double = np.isin(s, path.breakpoints[1:-1])
        first = np.arange(count + 1) + np.cumsum(double) - double
        self.right, self.left = first[1:], (first + double)[:-1]
        places = np.repeat(s, 1 + double)
        before = np.zeros(len(places), dtype=bool)
        before[self.right] = True
        before[self.left] = False
        self.every = self.by_clock(places, before)
        self.planes = HalfPlanes.joined(map(limits.half_planes, self.every))
        self.bounds = np.tile([0.0, np.inf], (count + 1, 1))
        self.bounds[[0, -1]] = np.array(ends)[:, None]
        self.bounds[np.isin(s, path.breakpoints[path.corners])] = 0.0

    @property
    def places(self) -> Places:
        """The nodes by the first clock."""
        return self.every[0]

    def by_clock(self, s: np.ndarray, left: np.ndarray) -> list[Places]:
        """Places of the path, see `Places.of`, by each clock."""
        return [Places.of(self.robot, self.path, s, left, clock) for clock in self.clocks]

    def acting(self, s: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(P, k): what acts at places (P,), see `StandingMechanism.acting`, by a timing x (N + 1,)."""
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.widths) - 1)
        step = np.diff(x)[k] / self.widths[k]
        here = np.maximum(x[k] + (s - self.s[k]) * step, 0.0)
        return self.by_clock(s, np.zeros(len(s), dtype=bool))[0].acting(0.5 * step, here)

    def polygons(self, extra: ExtraRows) -> Polygons:
        """The feasible set of each interval under all rows."""
        count, planes = len(self.widths), self.planes
        result = Polygons(
            np.zeros(count, dtype=np.int64),
            np.zeros((count, MOST, 3)),
            np.zeros((count, MOST), dtype=np.int64),
            np.zeros((count, MOST, 2)),
        )
        ends = np.searchsorted(extra.intervals, np.arange(count + 1))
        reduced(
            planes.alpha, planes.beta, planes.gamma, self.places.caps, self.left, self.right, self.widths,
            ends, extra.rows, result.counts, result.rows, result.numbers, result.corners,
        )  # fmt: skip
        return result

    def name(self, number: int, extra: ExtraRows, interval: int) -> str:
        """Name of the limit of a row of an interval."""
        size = len(self.planes.names)
        if number >= 2 * size:
            return extra.names[int(np.searchsorted(extra.intervals, interval)) + number - 2 * size]
        return self.planes.names[number % size] if number >= 0 else "speed" if number in (-3, -4) else ""


class Between:
    """Places between the nodes of a grid, and its ends: where rows are evaluated again.

    Args:
        grid: the nodes.
    """

    def __init__(self, grid: Grid) -> None:
        count, shares = len(grid.widths), len(_BETWEEN)
        self._grid, self._intervals = grid, np.repeat(np.arange(count), shares)
        self._shares = np.tile(_BETWEEN, count)
        s = grid.s[self._intervals] + self._shares * grid.widths[self._intervals]
        limits = grid.limits
        inside = grid.by_clock(s, np.zeros(len(s), dtype=bool))
        self._planes = HalfPlanes.joined(map(limits.half_planes, inside))
        self._places = inside[0]
        self._sides = [(rows_inside, self._intervals, self._shares) for rows_inside in inside]
        if limits.curved:
            every = np.arange(count)
            for rows_inside, share in ((grid.left, 0.0), (grid.right, 1.0)):
                shares_there = np.full(count, share)
                self._sides += [(places.some(rows_inside), every, shares_there) for places in grid.every]

    def broken(self, x: np.ndarray, rows: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
        """Intervals, shares of them, rows (3, R) alpha u + beta x <= gamma, and names of what is broken.

        Args:
            x: (N + 1,), the timing.
            rows: evaluate all rows, not only tangents.
        """
        results = [self._broken_rows(x)] if rows else []
        for places, intervals, shares in self._sides if self._grid.limits.curved else []:
            u, here = self._at(x, intervals, shares)
            tangents = self._grid.limits.tangents(places, u, here)
            tangent_places = tangents.places
            excess = (
                tangents.alpha * u[tangent_places] + tangents.beta * here[tangent_places] - tangents.gamma
            )
            bad = excess > _BEYOND
            block = np.stack([tangents.alpha, tangents.beta, tangents.gamma - _BEYOND])[:, bad]
            names = [tangents.names[k] for k in np.flatnonzero(bad)]
            results.append((intervals[tangent_places[bad]], shares[tangent_places[bad]], block, names))
        if not results:
            return np.empty(0, dtype=int), np.empty(0), np.empty((3, 0)), []
        intervals, shares, blocks, lists = zip(*results, strict=True)
        every = [name for names in lists for name in names]
        return np.concatenate(intervals), np.concatenate(shares), np.concatenate(blocks, axis=1), every

    def _broken_rows(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
        u, here = self._at(x, self._intervals, self._shares)
        planes, caps = self._planes, self._places.caps
        excess = planes.alpha * u[:, None] + planes.beta * here[:, None] - planes.gamma
        k, row = np.nonzero(excess > _BEYOND)
        fast = np.flatnonzero(here > caps * (1 + _BEYOND))
        block = np.stack([planes.alpha[k, row], planes.beta[k, row], planes.gamma[k, row]])
        caps = np.stack([np.zeros(len(fast)), np.ones(len(fast)), caps[fast]])
        names = [planes.names[r] for r in row] + ["speed"] * len(fast)
        every = np.concatenate([k, fast])
        return self._intervals[every], self._shares[every], np.hstack([block, caps]), names

    def _at(self, x: np.ndarray, intervals: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        step = np.diff(x)[intervals]
        return step / (2 * self._grid.widths[intervals]), np.maximum(x[intervals] + shares * step, 0.0)


@dataclass(frozen=True, eq=False)
class FastestTiming:
    """x at the nodes, and why it is not larger.

    Attributes:
        x: (N + 1,), 1/s^2.
        polygons: in which it lies.
        controllable: (N + 1, 2), minimum and maximum x from which the rest can be done.
        grid, extra: the nodes and further rows.
    """

    x: np.ndarray
    polygons: Polygons
    controllable: np.ndarray
    grid: Grid
    extra: ExtraRows

    @cached_property
    def active(self) -> tuple[str, ...]:
        """(N,) names of the limits that decide in the intervals: those with the minimum room."""
        return _deciding(self.grid, self.extra, self.polygons, self.x)


def spaced(path: JointPath, count: int = NODES) -> np.ndarray:
    """About `count` intervals between nodes; nearer to each other at ends and corners, where it is slow."""
    stops = np.concatenate([[0.0], path.breakpoints[path.corners], [1.0]])
    results = [path.breakpoints]
    for begin, end in pairwise(stops):
        cells = max(8, round(count * (end - begin)))
        t = np.linspace(0.0, 1.0, cells + 1)
        results.append(begin + (end - begin) * _eased(t))
    return _merged(path, np.unique(np.concatenate(results)))


def enough(path: JointPath, count: int) -> int:
    """Intervals between nodes with which a path is timed about as well as one of few turns with `count`.

    A timing on a grid loses time wherever a joint turns back, and the joint that does so most decides.
    """
    ends = path.breakpoints
    shares = np.linspace(0.0, 1.0, _PER_PIECE, endpoint=False)
    s = np.append((ends[:-1, None] + shares * np.diff(ends)[:, None]).ravel(), 1.0)
    slopes = path.at(s)[1]
    signs = np.sign(np.where(np.abs(slopes) > _TURNING * np.abs(slopes).max(), slopes, 0.0))
    turns = max(int(np.sum(np.diff(sign_changes[sign_changes != 0]) != 0)) for sign_changes in signs.T)
    return round(count * min(max(1.0, turns / _TURNS), _MOST_TIMES))


def _eased(t: np.ndarray) -> np.ndarray:
    """Distance after a time t in [0, 1] of a trapezoidal velocity profile."""
    speed = 1 / (1 - _RAMP)
    early = np.minimum(t, 1 - t)
    half = np.where(early < _RAMP, 0.5 * speed * early**2 / _RAMP, speed * (early - 0.5 * _RAMP))
    return np.where(t <= 0.5, half, 1 - half)


def _merged(path: JointPath, s: np.ndarray) -> np.ndarray:
    """Without nodes that are much nearer to a breakpoint than to the node on their other side."""
    is_breakpoint = np.isin(s, path.breakpoints)
    steps = np.diff(s)
    kept = np.ones(len(s), dtype=bool)
    inner = np.arange(1, len(s) - 1)
    for near, far, beside in (
        (steps[:-1], steps[1:], is_breakpoint[:-2]),
        (steps[1:], steps[:-1], is_breakpoint[2:]),
    ):
        kept[inner] &= is_breakpoint[inner] | ~beside | (near > _CLOSE * far)
    return s[kept]


def fastest(grid: Grid, extra: ExtraRows) -> FastestTiming:
    """The maximum x at all nodes.

    Raises:
        InputError: the path cannot be timed; says where and why.
    """
    polygons = grid.polygons(extra)
    count = len(grid.widths)
    values = np.empty((count + 1, 2))
    stuck = controllable(polygons.counts, polygons.corners, grid.bounds, values)
    if stuck >= 0:
        raise InputError(_refusal(grid, extra, polygons, values, stuck))
    x, active = np.empty(count + 1), np.zeros(count, dtype=np.int64)
    x[0] = values[0, 1]
    stuck = greatest(polygons.counts, polygons.rows, polygons.numbers, values, x, active)
    still = np.flatnonzero(np.maximum(x[1:], x[:-1]) <= 0) if stuck < 0 else np.array([stuck])
    if still.size:
        place, name = grid.s[still[0]], grid.name(int(active[still[0]]), extra, int(still[0]))
        raise InputError(f"path: at s = {place:.4f} it cannot go on" + (f" ({name})" if name else ""))
    return FastestTiming(x, polygons, values, grid, extra)


def _deciding(grid: Grid, extra: ExtraRows, polygons: Polygons, x: np.ndarray) -> tuple[str, ...]:
    """Which limit has the minimum room in each interval; of nearly equal ones the one before it."""
    names: list[str] = []
    for i, count in enumerate(polygons.counts):
        numbers, (a, b, c) = polygons.numbers[i, :count], polygons.rows[i, :count].T
        margins = (c - a * x[i] - b * x[i + 1]) / np.hypot(a, b)  # distances of x at both ends
        margins = np.where(
            np.isin(numbers, (-1, -2)), np.inf, margins
        )  # no limits: the speed is not negative
        near = np.flatnonzero(margins <= margins.min() + _SAME * max(x[i], x[i + 1]))
        row_names = [grid.name(int(numbers[k]), extra, i) for k in near[np.argsort(margins[near])]]
        names.append(names[-1] if names and names[-1] in row_names else row_names[0])
    return tuple(names)


def _refusal(grid: Grid, extra: ExtraRows, polygons: Polygons, result: np.ndarray, stuck: int) -> str:
    """Why no timing exists, with place, limit and amount."""
    place = grid.s[stuck]
    for places in grid.every:
        if (why := grid.limits.why_not_at_rest(places)) is not None:
            advice = "move the path there" + (places.clock is not None) * ", or drive more gently"
            return f"path: cannot be timed: at {why[0]}: {'; '.join(why[1])}; {advice}"
    if polygons.counts[stuck] == 0:
        name = grid.name(int(polygons.numbers[stuck, 0]), extra, stuck)
        return f"path: cannot be timed: no speed keeps all limits at {where(grid, place)} ({name})"
    if stuck == 0 and result[0, 0] == grid.bounds[0, 0]:
        least, most = np.sqrt(np.maximum(polygons.corners[0, : polygons.counts[0], 0], 0.0))[[0, -1]]
        asked = np.sqrt(grid.bounds[0, 0])
        return f"path: cannot begin with ds/dt = {asked:.4g} 1/s, its limits allow {least:.4g} to {most:.4g}"
    return f"path: cannot be timed: what follows {where(grid, place)} cannot be reached within the limits"


def where(grid: Grid, place: float) -> str:
    """A place of the path, and the joint values there."""
    places = grid.every[0]
    q = places.q[np.argmin(np.abs(places.s - place))]
    robot = grid.limits.robot
    return f"s = {place:.4f} of {grid.s[-1]:.4g}, {joint_words(robot.names, robot.units, q)}"
