"""Rows for delayed joints, and joints that overshoot acceleration steps, each by itself, on a path.

`within.late_joints` gives the possible states of joints at a node, up to the longest delay after it. On a
path all of that is affine in x at a few neighbouring nodes. So are rows of the wrench with the worst of them:
the limits stay convex, but join more than two nodes, which reachability cannot have and a cone program can.

Rows of friction are half spaces of the loads that contacts hold (`Slip.half_spaces`), as those of tip-over
are: valid for every timing, also where they are taken from one whose base slides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # subpackages load on first use

from ocptip.retiming.fastest import Grid, Polygons, where
from ocptip.retiming.whole_body import BasePath
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.late_joints import delay_cases
from ocptip.standing.within.worst_case import WorstCase, worst_cases_of
from ocptip.standing.within.worst_options import worst_beyond, worst_options
from ocptip.trajectories.trajectory import INSIDE

NAMES = ("tip-over within tolerance", "slip within tolerance")
_NEAR = 0.03  # of M0, or of GT: rows that are missed by less than this are taken, too
_FAR = 0.2  # of M0, or of GT: rows that are farther from it are no more looked at
_PLANES = 6  # half spaces of friction at an instant of which rows are taken in one round
_SLIDES = 0.01  # of GT: what is missed by more has slopes of a base that slides
_HALVINGS = 8  # of the speed-up of a timing until it just reaches a limit
_PROVABLE = 0.95  # share of the friction of objects: proofs miss what is sampled by up to 5 %
_LEAST = 1e-6  # of M0, or of GT: rows that are missed by less are kept
_SLOWEST = 1e-3  # of the mean of x: slopes of sqrt(x) are taken there, or where it is faster


@dataclass(frozen=True, eq=False)
class Couplings:
    """Rows A x <= b of x at the nodes.

    Attributes:
        A: (R, N + 1).
        b: (R,).
        names: (R,) of the limits.
    """

    A: scipy.sparse.csr_matrix
    b: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def none(cls, nodes: int) -> Couplings:
        """No rows."""
        return cls(scipy.sparse.csr_matrix((0, nodes)), np.empty(0), ())

    def __len__(self) -> int:
        return len(self.b)

    def joined(self, other: Couplings) -> Couplings:
        """Both."""
        A = scipy.sparse.csr_matrix(scipy.sparse.vstack([self.A, other.A]))
        return Couplings(A, np.concatenate([self.b, other.b]), (*self.names, *other.names))

    def why_not(self, grid: Grid, polygons: Polygons, unit: float) -> str:
        """Why no timing keeps these rows and those of the path: place, limit, amount; empty: one does.

        A linear program finds the timing with the minimum of the maximum excess over these rows.

        Args:
            grid, polygons: of the path.
            unit: 1/s^2, of a typical timing.
        """
        count, (i, rows) = len(grid.s), polygons.all_rows()
        each, a, b, c = np.arange(len(i)), *rows.T
        size = np.maximum(np.maximum(np.abs(a), np.abs(b)) * unit, np.abs(c))
        entries = np.concatenate([a, b]) * unit / np.tile(size, 2)
        path = scipy.sparse.csr_matrix(
            (entries, (np.tile(each, 2), np.append(i, i + 1))), (len(i), count + 1)
        )
        matrix = scipy.sparse.hstack([unit * self.A, np.full((len(self), 1), -1.0)])
        result = scipy.optimize.linprog(
            np.append(np.zeros(count), 1.0),
            scipy.sparse.vstack([path, matrix]),
            np.append(c / size, self.b),
            bounds=[*(grid.bounds / unit), (0.0, None)],
        )
        if not result.success or result.fun < _LEAST:
            return ""
        row = int(np.argmin(result.ineqlin.marginals[len(i) :]))
        place = grid.s[int(np.argmax(np.abs(self.A[row].toarray())))]
        advice = "move the path there, or carry less, or reduce the uncertainty"
        return (
            f"path: cannot be timed: {self.names[row]} exceeds its limit by {100 * result.fun:.3g} % of its "
            f"reference or more, however fast it is passed, near {where(grid, place)}; {advice}"
            + (grid.places.clock is not None)
            * ", or drive more gently"
        )


class LateJoints:
    """Where joints that are delayed or overshoot break a limit of the contacts.

    Args:
        grid: the nodes, and limits with a tolerance.
    """

    def __init__(self, grid: Grid) -> None:
        asked = grid.limits.asked
        self._grid = grid
        cases_of_all = worst_cases_of(grid.robot, asked.tolerance)
        self._interfaces = [_Interface.of(cases, asked, k > 0) for k, cases in enumerate(cases_of_all)]
        self._delay = asked.tolerance.delay * (1 + asked.tolerance.speed)
        self._more = asked.tolerance.overshoot
        places, left, right = grid.places, grid.left, grid.right
        self._q = np.vstack([places.q[left], places.q[right[-1:]]])
        self._dq = np.vstack([places.dq[left], places.dq[right[-1:]]])
        turn = 1 / (2 * grid.widths)[:, None]
        none = np.zeros((1, grid.robot.n))
        # over x at the node before, there, and at the next, (3, N + 1, n): accelerations after and before it
        after = [-places.dq[left] * turn + places.ddq[left], places.dq[left] * turn]
        before = [-places.dq[right] * turn, places.dq[right] * turn + places.ddq[right]]
        still = np.zeros((len(grid.s), grid.robot.n))
        self._after = np.stack([still, *(np.vstack([part, none]) for part in after)])
        self._before = np.stack([*(np.vstack([none, part]) for part in before), still])
        self._base = None if places.base is None else BaseNodes.of(places.base, grid)
        acts = grid.robot.acts
        self._steps = acts.knots if acts.end and self._more and self._base is None else np.empty(0)
        after, before = (grid.robot.acting(self._steps + side) for side in (INSIDE, -INSIDE))
        self._overshooting = after + self._more * (after - before)

    @staticmethod
    def wanted(tolerance: Uncertainty) -> bool:
        """Whether joints may be delayed, or overshoot."""
        return bool(tolerance.delay or tolerance.overshoot)

    def broken(self, x: np.ndarray) -> tuple[float, Couplings]:
        """By how much the worst row is missed, in units of M0, of GT or of the weight, and the rows that are,
        or nearly.

        Where loads that contacts hold have no half spaces, rows of friction are slopes of GT. Where the base
        slides, GT counts its acceleration, and its slopes say nothing of the limit. Rows are then those of a
        slower timing that just reaches it.

        Args:
            x: (N + 1,), the timing.
        """
        excess, slips, rows = self._broken(x)
        slow, fast = 0.0, 1.0
        for _ in range(_HALVINGS if slips > _SLIDES else 0):
            if -_NEAR < slips <= _SLIDES:
                break
            middle = 0.5 * (slow + fast)
            _, slips, result = self._broken(middle * x)
            slow, fast = (slow, middle) if slips > _SLIDES else (middle, fast)
            rows = result if slips <= _SLIDES and len(result) else rows
        return excess, rows

    def _broken(self, x: np.ndarray) -> tuple[float, float, Couplings]:
        """By how much the worst row is missed, and GT where slopes of it are rows, and rows that are, or
        nearly.
        """
        options, made, places, bases = self._options(x)
        acting = self._grid.acting(places, x) if self._base is None else self._base.rows(x, bases)
        steps = [k for k, made_of in enumerate(bases) if made_of is None]
        acting[steps] = self._overshooting[: len(steps)]
        found = [interface.broken(options, acting) for interface in self._interfaces]
        slips = max(one.slips for one in found)
        names = tuple(name for one in found for name in one.names)
        instants, numbers, slopes, excess = (
            np.concatenate([getattr(one, part) for one in found])
            for part in ("instants", "numbers", "slopes", "excess")
        )
        n = self._grid.robot.n
        on, on_base = slopes[:, : 3 * n].reshape(len(instants), 3, n), slopes[:, 3 * n :]
        A = np.zeros((len(instants), len(x)))
        pace = 0.5 / np.sqrt(np.maximum(x, _SLOWEST * np.mean(x)))
        for row, (instant, block) in enumerate(zip(instants, numbers, strict=True)):
            for joint, way in enumerate(block):
                speeds, accelerations = made[instant][way]
                for node, factor in speeds:
                    A[row, node] += factor * on[row, 1, joint] * self._dq[node, joint] * pace[node]
                for node, part, factor in accelerations:
                    first, last = max(node - 1, 0), min(node + 2, len(x))
                    over = (self._after if part else self._before)[first - node + 1 : last - node + 1]
                    A[row, first:last] += factor * on[row, 2, joint] * over[:, node, joint]
            if self._base is not None and (acts := bases[instant]) is not None:
                A[row] += self._base.slopes(x, pace, acts, on_base[row])
        rows = Couplings(scipy.sparse.csr_matrix(A), A @ x - excess, names)
        return float(np.max(excess, initial=-_NEAR)), slips, rows

    def _options(self, x: np.ndarray) -> tuple[np.ndarray, list[list[_Made]], np.ndarray, list[_Made | None]]:
        """(D, n, K, 4) of what joints may be doing at nodes and the delay after them; what it is made of;
        where on the path, (D,); what a base on its path is doing; None at steps of a drive profile.
        """
        pace = np.sqrt(x)
        t = np.append(0.0, np.cumsum(2 * self._grid.widths / (pace[1:] + pace[:-1])))
        padded = np.concatenate([[0.0], x, [0.0]])
        near = np.stack([padded[:-2], x, padded[2:]])[:, :, None]
        nodes = _Nodes(
            t, self._dq * pace[:, None], *(np.sum(c * near, axis=0) for c in (self._after, self._before))
        )
        results, made, s, places, bases = [], [], self._grid.s, [], list[_Made | None]()
        for node in range(len(x)):
            results.append(self._at(nodes, node, t[node], 0.0))
            places.append(s[node])
            ends, on_time = ((node, 1.0),), ((node, True, 1.0),)
            bases.append((ends, on_time))
            if self._base is not None and self._more:  # its acceleration step overshoots
                results.append(results[-1])
                places.append(s[node])
                bases.append((ends, ((node, True, 1 + self._more), (node, False, -self._more))))
            time = t[node] + self._delay
            if self._delay and time < t[-1]:
                last = int(np.searchsorted(t, time, side="right")) - 1
                share = (time - t[last]) / (t[last + 1] - t[last])
                results.append(self._at(nodes, last, time, share))
                places.append(s[last] + share * (s[last + 1] - s[last]))
                ends = (last, 1 - share), (last + 1, share)
                bases.append((ends, ((last, True, 1 - share), (last + 1, False, share))))
        for time in self._steps[self._steps < t[-1]]:  # of a drive profile, whose steps overshoot
            last = int(np.searchsorted(t, time, side="right")) - 1
            share = (time - t[last]) / (t[last + 1] - t[last])
            results.append(self._at(nodes, last, time, share))
            places.append(s[last] + share * (s[last + 1] - s[last]))
            bases.append(None)
        made = [[way for _, way in pairs] for pairs in results]
        options = np.full((len(results), self._q.shape[1], max(map(len, made)), 4), np.nan)
        for instant, pairs in enumerate(results):
            options[instant, :, : len(pairs)] = np.array([state for state, _ in pairs]).transpose(2, 0, 1)
        return options, made, np.array(places), bases

    def _at(self, nodes: _Nodes, node: int, time: float, share: float) -> list[tuple[tuple, _Made]]:
        """The possible delayed states (4, n) of the joints at a share of the interval after a node, with
        their origin.
        """
        first = int(np.searchsorted(nodes.t, time - self._delay - INSIDE))
        result = self._before_all(nodes, time - self._delay) if self._delay else []
        for case in delay_cases(nodes.t[first : node + 1], time, self._delay, self._more > 0):
            if case.event is None:
                ends = ((node, 1 - share), (node + 1, share))[: 2 if share else 1]
                parts = ((node, True, 1 - share), (node + 1, False, share))[: len(ends)]
            else:
                event = first + case.event
                ends, parts = ((event, 1.0),), ((event, case.steps > 0, 1.0),)
                for begin in range(event, event - case.steps, -1):
                    parts = (*parts, (begin, True, self._more), (begin, False, -self._more))
            result.append(self._made(nodes, ends, parts, case.max_delay))
        return result

    def _before_all(self, nodes: _Nodes, time: float) -> list[tuple[tuple, _Made]]:
        """The state with the maximum delay, within an interval, where accelerations are continuous."""
        if time <= 0:
            return []
        node = int(np.searchsorted(nodes.t, time, side="right")) - 1
        share = float((time - nodes.t[node]) / (nodes.t[node + 1] - nodes.t[node]))
        ends = (node, 1 - share), (node + 1, share)
        parts = (node, True, 1 - share), (node + 1, False, share)
        return [self._made(nodes, ends, parts, 0.0)]

    def _made(
        self,
        nodes: _Nodes,
        ends: tuple[tuple[int, float], ...],
        parts: tuple[tuple[int, bool, float], ...],
        max_delay: float,
    ) -> tuple[tuple, _Made]:
        q, qd = (sum(part * values[end] for end, part in ends) for values in (self._q, nodes.qd))
        qdd = sum(factor * (nodes.after if part else nodes.before)[end] for end, part, factor in parts)
        return (q, qd, qdd, np.full_like(self._q[0], max_delay)), (ends, parts)


class _Broken(NamedTuple):
    """R limits of an interface that are missed, or nearly.

    Attributes:
        instants: (R,) numbers of them.
        numbers: (R, n) of the worst states of the joints there.
        slopes: (R, 3 n or more) of the limit over the state, in its unit.
        excess: (R,) by how much it is missed, in its unit.
        names: of the limits.
        slips: the largest excess of GT where slopes of it are rows; else -inf.
    """

    instants: np.ndarray
    numbers: np.ndarray
    slopes: np.ndarray
    excess: np.ndarray
    names: tuple[str, ...]
    slips: float


@dataclass(frozen=True, eq=False)
class _Interface:
    """Limits of the contacts of the base, or of an object.

    Attributes:
        cases: the worst case of it.
        planes: half spaces of friction; None: there are none.
        weight: on it, N, the unit of these.
        units, most: (F,) units of moments about tipping axes and of GT, and what these may be in them.
        names: of the limits of tipping and slipping.
    """

    cases: WorstCase
    planes: np.ndarray | None
    weight: float
    units: np.ndarray
    most: np.ndarray
    names: tuple[str, str]

    @classmethod
    def of(cls, cases: WorstCase, asked: Limits, of_object: bool) -> _Interface:
        """With the limits asked for."""
        axes, whose = cases.axes, f" of {cases.footing.name}" * of_object
        GT = asked.GT_worst_case * (_PROVABLE if of_object else 1.0)
        return cls(
            cases,
            cases.footing.slip.half_spaces(GT),
            float(np.linalg.norm(cases.footing.support.weight)),
            np.append(np.full(axes, cases.reference or 1.0), GT),
            np.append(np.full(axes, 1 - 1 / asked.GN_worst_case), 1.0),
            (NAMES[0] + whose, NAMES[1] + whose),
        )

    def broken(self, options: np.ndarray, acting: np.ndarray) -> _Broken:
        """What is missed at D instants, with options and acting as of `worst_options`."""
        axes = self.cases.axes
        functions = range(axes + (self.planes is None))
        matters = (self.most - _FAR) * self.units
        number, values, slopes = worst_options(options, self.cases, acting, matters, functions)
        block = np.s_[: len(functions)]
        beyond = values / self.units[block] - self.most[block]  # (D, F)
        i, k = np.nonzero(beyond > -_NEAR)
        parts = [(i, number[i, k], slopes[i, k] / self.units[k][:, None], beyond[i, k])]
        names = [self.names[int(function == axes)] for function in k]
        slips = -np.inf
        if self.planes is None:
            slips = float(np.max(beyond[:, -1]))
        else:
            near = -_NEAR * self.weight
            result = worst_beyond(options, self.cases, acting, self.planes, near, _PLANES)
            parts.append((*result[:2], result[2] / self.weight, result[3] / self.weight))
            names += [self.names[1]] * len(result[0])
        instants, numbers, slopes, excess = (np.concatenate(part) for part in zip(*parts, strict=True))
        return _Broken(instants, numbers, slopes, excess, tuple(names), slips)


@dataclass(frozen=True, eq=False)
class BaseNodes:
    """A base on its path at the nodes of a grid.

    Attributes:
        turning: (N + 1,), d yaw / ds.
        after, before: (3, N + 1, 9) rows of its motion after and before nodes, over x at the node before,
            there, and at the next; without angular velocities, which grow with ds/dt.
    """

    turning: np.ndarray
    after: np.ndarray
    before: np.ndarray

    @classmethod
    def of(cls, base: BasePath, grid: Grid) -> BaseNodes:
        """Of places at the nodes, see `Grid.places`."""
        one, none, turn = np.ones(len(base.d)), np.zeros(len(base.d)), 1 / (2 * grid.widths)[:, None]
        of_u, of_x = base.rows(one, none), base.rows(none, one)
        of_x[:, 5] = 0.0
        left, right, still = grid.left, grid.right, np.zeros((len(grid.s), 9))
        after = [-of_u[left] * turn + of_x[left], of_u[left] * turn]
        before = [-of_u[right] * turn, of_u[right] * turn + of_x[right]]
        return cls(
            np.append(base.d[left, 2], base.d[right[-1], 2]),
            np.stack([still, *(np.vstack([part, still[:1]]) for part in after)]),
            np.stack([*(np.vstack([still[:1], part]) for part in before), still]),
        )

    def rows(self, x: np.ndarray, made: list[_Made | None]) -> np.ndarray:
        """(D, 9) rows of `BaseMotion` at instants, of what they are made of, at x (N + 1,)."""
        padded = np.concatenate([[0.0], x, [0.0]])
        near = np.stack([padded[:-2], x, padded[2:]])[:, :, None]
        after, before = (np.sum(weights * near, axis=0) for weights in (self.after, self.before))
        values = np.zeros((len(made), 9))
        for row, weights in zip(values, made, strict=True):
            ends, parts = weights or ((), ())
            row += sum(factor * (after if part else before)[node] for node, part, factor in parts)
            row[5] = sum(factor * self.turning[node] * np.sqrt(x[node]) for node, factor in ends)
        return values

    def slopes(self, x: np.ndarray, of_root: np.ndarray, made: _Made, on: np.ndarray) -> np.ndarray:
        """(N + 1,) slopes over x of a function with slopes (9,) over the rows, and of sqrt(x)."""
        values = np.zeros(len(x))
        for node, factor in made[0]:
            values[node] += factor * on[5] * self.turning[node] * of_root[node]
        for node, part, factor in made[1]:
            first, last = max(node - 1, 0), min(node + 2, len(x))
            over = (self.after if part else self.before)[first - node + 1 : last - node + 1, node]
            values[first:last] += factor * (over @ on)
        return values


class _Nodes(NamedTuple):
    """Times (N + 1,) of nodes; speeds there, and accelerations after and before them, (N + 1, n)."""

    t: np.ndarray
    qd: np.ndarray
    after: np.ndarray
    before: np.ndarray


_Made = tuple[tuple[tuple[int, float], ...], tuple[tuple[int, bool, float], ...]]
"""Terms of a displacement: speeds at nodes, with factors; accelerations after (True) or before nodes."""
