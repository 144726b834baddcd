"""From a solution of the smooth programs to an exact one.

The order of switching times is fixed in each solve. Those that nearly coincide are simultaneous, so that no
empty interval between them adds constraints. Between solves, instants between the nodes at which a limit is
broken become further nodes (an exchange method for the semi-infinite constraints).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.motion.planner.deviating import (
    MEET,
    Deviating,
    Place,
    deviating_places,
    kept_at_worst,
    worst_places,
)
from ocptip.motion.planner.event_order import EventOrder, order_of
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.planner.program import MotionProgram
from ocptip.numerics.ipopt import SOLVED, Solution
from ocptip.standing.limits import Limits
from ocptip.trajectories.trajectory import Trajectory

SHARES = np.linspace(0.0, 1.0, 17)  # where intervals are looked at between nodes
NEAR, FIRST = 0.75, 0.3  # use of a limit from which a row takes part, and a further node is made at the start
FEASIBLE = 1e-5
PACES = 1.1 ** np.arange(15)  # how much slower a path is made
ROUNDS, LATE_ROUNDS = 4, 6
PUSH = 1e-4
MET = 5e-5  # s: so far apart an interior-point method leaves switching times that meet in the optimum
AT_EDGE, BEYOND = 1e-4, 1.01  # s: a program that ends so near to its regime's edge goes on so much beyond
WORSE = 3e-3  # share of the cost by which some more rows may well raise it


@dataclass(eq=False)
class Exact:
    """An exact solution with a given order.

    Attributes:
        order: of the switching times.
        program, solution: of the last solve.
        extra: nodes added to the quadrature's.
    """

    order: EventOrder
    program: MotionProgram
    solution: Solution
    extra: list[Place]

    @property
    def cost(self) -> float:
        """About that of the motion, in units of the objective."""
        return self.program.values(self.solution.x)[0]


class Refiner:
    """Solves ordered programs of one formulation and counts what they cost.

    Args:
        formulation: of the task.
        limits: tightened as the caller likes.
    """

    def __init__(self, formulation: Formulation, limits: Limits) -> None:
        self.formulation, self.limits = formulation, limits
        self.iterations, self.solves = 0, 0

    def first(self, x: np.ndarray, merge: float) -> Exact:
        """The exact solution with the order at x; switching times within `merge` seconds become
        simultaneous.
        """
        exact = self._solved(x, merge)
        if (beyond := self._beyond_edge(exact)) is not None:
            other = self._solved(beyond, merge)
            if (
                other.solution.violation <= max(FEASIBLE, exact.solution.violation)
                and other.cost < exact.cost
            ):
                return other
        return exact

    def _solved(self, x: np.ndarray, merge: float) -> Exact:
        order, x = order_of(self.formulation, x, merge)
        return self.solve_order(order, x, start_mu=1e-3)

    def _beyond_edge(self, exact: Exact) -> np.ndarray | None:
        """Variables beyond the end time at which the profile of a non-optimised joint becomes a triangle, or
        a trapezoid.

        Only for a solution that lies just there, because its program goes no further; else None.
        """
        order, x = exact.order, exact.solution.x
        profiles, end = self.formulation.profiles(order.layout), order.layout.end
        for joint, trapezoid in order.regime.items():
            if abs(x[end] - profiles.edge(joint)) < AT_EDGE:
                return self.formulation.slowed(x, BEYOND if trapezoid else 1 / BEYOND)
        return None

    def slowed_cost(self, x: np.ndarray) -> float:
        """About the cost of the path of x, slowed down until it has the tolerance; infinite if never."""
        formulation, limits = self.formulation, self.limits
        for pace in PACES:
            order, begin = order_of(formulation, formulation.slowed(x, pace))
            places: list[Place] = [(i, share) for i in range(len(order.rows) - 1) for share in (0.0, 1.0)]
            places += deviating_places(order, begin, limits.tolerance)
            program = formulation.ordered_program(limits, order, begin, places)
            if kept_at_worst(program, begin):
                return program.values(begin)[0]
        return np.inf

    def again(self, exact: Exact, instants: list[float]) -> Exact:
        """This program with further nodes at the given times (s) of its motion."""
        x = self.formulation.polished(exact.order, exact.program.structure, exact.solution.x)
        times = exact.order.rows @ x
        extra = list(exact.extra)
        for t in instants:
            i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
            length = times[i + 1] - times[i]
            extra.append((i, float(np.clip((t - times[i]) / length, 0, 1)) if length > 0 else 0.5))
        return self.solve_order(exact.order, x, start_mu=1e-5, extra=extra)

    def solve_order(
        self,
        order: EventOrder,
        x: np.ndarray,
        start_mu: float,
        extra: list[Place] | None = None,
    ) -> Exact:
        """Solve with rows and nodes added until none is missing."""
        formulation, limits = self.formulation, self.limits
        intervals = len(order.rows) - 1
        tolerance = limits.tolerance
        if tolerance.delay and not order.rises:  # joints that are not late together do not become so
            order = order.kept_apart(x, tolerance.delay * (1 + tolerance.speed) + 2 * MEET)
        watch: list[Place] = [(i, float(s)) for i in range(intervals) for s in SHARES]
        deviating = deviating_places(order, x, tolerance)
        watched = formulation.ordered_program(limits, order, x, [*watch, *deviating])
        n_nodes = watched.n_nodes - len(watch) - len(deviating)
        share = FIRST if extra is None else 1 + FEASIBLE
        near_by = set(deviating)  # joints that are no longer late together need no row
        extra = [place for place in extra or [] if not isinstance(place, Deviating) or place in near_by]
        rows = multipliers = None
        kept: Exact | None = None
        anchor = x
        for _ in range(LATE_ROUNDS if deviating else ROUNDS):
            if kept is not None and deviating:  # other joints may be late together by now
                deviating = deviating_places(order, x, limits.tolerance)
                watched = formulation.ordered_program(limits, order, anchor, [*watch, *deviating])
            fresh = self._watch_out(watched, n_nodes, watch, x, share)
            fresh += worst_places(
                watched, x, deviating, n_nodes + len(watch), NEAR if rows is None else share
            )
            fresh = [place for place in fresh if place not in extra]
            program = formulation.ordered_program(limits, order, anchor, extra + fresh)
            near = program.near_rows(x, NEAR)
            if rows is None:
                program = program.with_rows(near, near=x)
            else:
                if not fresh and not program.near_rows(x, 1 - FEASIBLE) - rows and kept_at_worst(program, x):
                    break
                program = program.with_rows(near.including(rows), near=x)
                assert multipliers is not None  # there are rows of a program that was solved
                multipliers = program.carried(multipliers[0], rows), multipliers[1]
            extra += fresh
            rows = program.rows
            solution = program.solve(
                x,
                multipliers=multipliers,
                start_mu=start_mu,
                tolerance=1e-5,
                max_iterations=60,
                push=PUSH,
            )
            self.iterations, self.solves = self.iterations + solution.iterations, self.solves + 1
            if kept is not None and limits.stoppable and self._lost(solution, kept.solution, program):
                return kept
            multipliers = solution.multipliers, solution.bound_multipliers
            x, share, start_mu, kept = solution.x, 1 + FEASIBLE, 1e-6, Exact(order, program, solution, extra)
            if solution.violation > 0.1:
                break
        assert kept is not None  # there is a first round
        return kept

    @staticmethod
    def _lost(new: Solution, old: Solution, program: MotionProgram) -> bool:
        """Whether a solve diverged: rows of stops have corners, at which Newton steps may fail."""
        if old.violation > FEASIBLE or new.status in SOLVED:
            return False
        costs = [program.values(solution.x)[0] for solution in (new, old)]
        return new.violation > FEASIBLE or costs[0] > costs[1] * (1 + WORSE)

    @staticmethod
    def _watch_out(
        watched: MotionProgram, n_nodes: int, watch: list[Place], x: np.ndarray, share: float
    ) -> list[Place]:
        """Points that should become nodes: where a limit is broken most in each interval.

        At the first look (share below 1) the ends of intervals that use at least this share of a limit.
        """
        nodes = slice(n_nodes, n_nodes + len(watch))
        if share < 1:
            hit = watched.near_rows(x, share, nodes).at_nodes
            return [place for place, h in zip(watch, hit, strict=True) if h and place[1] in (0.0, 1.0)]
        use = watched.use(x, nodes).reshape(-1, len(SHARES))
        chosen, step = [], SHARES[1]
        for i, u in enumerate(use):
            padded = np.concatenate([[-np.inf], u, [-np.inf]])
            for k in np.flatnonzero((u > share) & (u >= padded[:-2]) & (u >= padded[2:])):
                place = SHARES[k]
                if 0 < k < len(u) - 1 and (bend := 2 * u[k] - u[k - 1] - u[k + 1]) > 0:
                    place += step * np.clip(0.5 * (u[k + 1] - u[k - 1]) / bend, -1, 1)
                chosen.append((i, float(place)))
        return chosen

    def motion(self, exact: Exact) -> Trajectory:
        """The motion of an exact solution; switching times that it leaves nearer than `MET` are one, if there
        is such a motion.
        """
        given = exact.order, exact.program.structure, exact.solution.x
        try:
            return self.formulation.motion(self.formulation.polished(*given, MET))
        except InputError:  # joints that are not optimised do not reach their goals so early
            return self.formulation.motion(self.formulation.polished(*given))
