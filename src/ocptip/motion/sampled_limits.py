"""Values of limits at instants of a motion, and further instants around the worst ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from ocptip.standing.contact_margins import ContactMargins
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import Limit
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory

MIN_POINTS = 5  # of an interval
_PART = 10_000  # instants that are evaluated at once
_NEAREST = 6
_FRESH = 9
_RELATIVE_TOLERANCE = 1e-9
_CONTINUOUS = 1e-3
"""Maximum relative change (of itself, or of 1) of a continuous quantity across a switching time (0.3 us)."""


class IntervalValues:
    """Sampled values of one interval, (N, m), in the order of the limits."""

    def __init__(self, left: float, right: float, step: float) -> None:
        if right <= left:
            self.times = np.array([0.5 * (left + right)])
        else:
            points = max(MIN_POINTS, int(np.ceil((right - left) / step)) + 1)
            self.times = np.linspace(left, right, points)
        self.values = np.empty((0, 0))

    def add(self, times: np.ndarray, values: np.ndarray) -> None:
        """Put new values among the old ones, sorted by time."""
        if len(self.values):
            times, values = np.concatenate([self.times, times]), np.vstack([self.values, values])
        order = np.argsort(times, kind="stable")
        self.times, self.values = times[order], values[order]


@dataclass
class GridValues:
    """Values (N, m) at instants; `ends` are the columns at which the limits' values are split.

    Attributes:
        lost: names of base and objects that lose a contact.
        contacts: of base and objects.
        unsolved: times without a contact state, s.
        uncertified: times at which GT is an upper bound beyond the limit, s.
    """

    values: np.ndarray
    ends: np.ndarray
    unsolved: list[float]
    uncertified: list[float]
    lost: tuple[str, ...]
    contacts: tuple[ContactMargins, ...]

    def split(self, todo: list[np.ndarray]) -> list[np.ndarray]:
        """By the instants' grids."""
        return np.split(self.values, np.cumsum([len(times) for times in todo])[:-1])


def instants_of(robot: StandingMechanism, motion: Trajectory, times: np.ndarray) -> Instants:
    return Instants.of_states(robot, *motion.states(times), times)


def evaluate_limits(
    robot: StandingMechanism,
    motion: Trajectory,
    limits: tuple[Limit, ...],
    todo: list[np.ndarray],
    most: float,
) -> GridValues:
    """Values at the listed instants of all grids, in parts that fit into memory; GT may be `most`."""
    times = np.concatenate(todo)
    parts = np.array_split(times, 1 + len(times) // _PART)
    results = [_evaluated(robot, motion, limits, part, most) for part in parts]
    return GridValues(
        values=np.vstack([one.values for one in results]),
        ends=results[0].ends,
        unsolved=[time for one in results for time in one.unsolved],
        uncertified=[time for one in results for time in one.uncertified],
        lost=tuple(name for one in results for name in one.lost),
        contacts=reduce(worse_contacts, [one.contacts for one in results]),
    )


def _evaluated(
    robot: StandingMechanism, motion: Trajectory, limits: tuple[Limit, ...], times: np.ndarray, most: float
) -> GridValues:
    instants = instants_of(robot, motion, times)
    measured = [limit.measure(instants) for limit in limits]
    values, ends = np.hstack(measured), np.cumsum([interface.shape[1] for interface in measured])[:-1]
    values[np.isnan(values)] = np.inf
    unsolved, uncertified, lost = [], [], []
    for interface in instants.interfaces:
        GT, certified = interface.largest_slip.GT, interface.largest_slip.solved
        kept = certified | (most >= GT)  # an upper bound within the limit keeps it
        uncertified += times[interface.states.persistent & ~kept].tolist()
        unsolved += times[~interface.states.solved].tolist()
        lost += [interface.footing.name] * bool(
            np.any(interface.states.solved & ~interface.states.persistent)
        )
    contacts = tuple(ContactMargins.of(interface, times) for interface in instants.interfaces)
    return GridValues(values, ends, unsolved, uncertified, tuple(lost), contacts)


def worse_contacts(
    first: tuple[ContactMargins, ...], second: tuple[ContactMargins, ...]
) -> tuple[ContactMargins, ...]:
    """The worse of both, interface by interface."""
    return tuple(one.worse(other) for one, other in zip(first, second, strict=True))


def refinements(grids: list[IntervalValues]) -> list[np.ndarray]:
    """New instants around the largest local maxima of each quantity, where neighbours still differ.

    An end of an interval is none where the quantity goes on rising continuously in the next interval.
    """
    new: list[list[np.ndarray]] = [[] for _ in grids]
    first, last = (np.array([grid.values[end] for grid in grids]) for end in (0, -1))
    with np.errstate(invalid="ignore"):  # infinite values
        joined = np.abs(first[1:] - last[:-1]) <= _CONTINUOUS * np.maximum(1.0, np.abs(last[:-1]))
    nothing = np.full((1, first.shape[1]), -np.inf)
    sizes = np.array([len(grid.times) for grid in grids])
    starts = np.concatenate([[0], np.cumsum(sizes)])
    values = np.concatenate([grid.values for grid in grids])
    before, after = np.vstack([nothing, values[:-1]]), np.vstack([values[1:], nothing])
    before[starts[:-1]] = np.concatenate([nothing, np.where(joined, last[:-1], -np.inf)])
    after[starts[1:] - 1] = np.concatenate([np.where(joined, first[1:], -np.inf), nothing])
    peaks = (values >= before) & (values >= after) & np.isfinite(values)
    for column, v in enumerate(values.T):
        rows = np.flatnonzero(peaks[:, column])
        for row in rows[np.argsort(-v[rows], kind="stable")[:_NEAREST]]:
            g = int(np.searchsorted(starts, row, side="right")) - 1
            grid, i = grids[g], int(row - starts[g])
            lo, hi = max(i - 1, 0), min(i + 1, len(grid.times) - 1)
            spread = v[row] - min(grid.values[lo, column], grid.values[hi, column])
            wide = grid.times[hi] - grid.times[lo] > 1e-7
            if wide and spread > _RELATIVE_TOLERANCE * max(1.0, abs(v[row])):
                new[g].append(np.linspace(grid.times[lo], grid.times[hi], _FRESH + 2)[1:-1])
    return [
        np.setdiff1d(np.concatenate(parts), grid.times) if parts else np.empty(0)
        for grid, parts in zip(grids, new, strict=True)
    ]
