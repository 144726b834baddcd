"""Limits of the contacts: tip-over, slip, contacts maintained (4.21, 4.22).

On uneven ground contacts move within the base. The moments that can be added about an axis are optima of cone
programs over the contact forces (`reserves.tip_moments`). Their derivative by the contacts' places and
normals is that of the program's Lagrangian, with forces and multipliers held (envelope theorem).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.contact.support import Support
from ocptip.placement.limits.forces import ContactForces, Twice
from ocptip.placement.limits.layout import Hessian, Point, Variables, corner_maps
from ocptip.placement.limits.limit import (
    CaseRows,
    ConstraintRows,
    PlacementLimit,
    RowLabel,
    Symbols,
    TaskEvaluation,
)
from ocptip.placement.problem import PlacementProblem
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.slip import known
from ocptip.reserves.tip_moments import Addable, AddableMoments, TippingAxis
from ocptip.standing.instants import Loaded
from ocptip.standing.limit_kinds.quantities import SlipQuantity, TipOverQuantity


def wrench_of_forces(symbols: Symbols) -> Twice:
    """(p, contact forces (3 n,), N, contact axes) -> their wrench (6,) about the centre of mass."""
    forces = cs.SX.sym("F", 3 * symbols.contacts.size2())
    return Twice.of(cs.vertcat(symbols.p, forces), [], _wrench(symbols, forces), local=symbols.local)


def _wrench(symbols: Symbols, forces: cs.SX) -> cs.SX:
    """Wrench (6,) of forces (3 n,) about the centre of mass."""
    total = cs.SX.zeros(6)
    for k in range(symbols.contacts.size2()):
        force = cs.reshape(symbols.frames[:, k], 3, 3) @ forces[3 * k : 3 * k + 3]
        total += cs.vertcat(force, cs.cross(symbols.contacts[:, k] - cs.SX(symbols.center_of_mass), force))
    return total


@dataclass(frozen=True, eq=False)
class LeastMoments:
    """Moments about the axes in one load case, each at the corner of the tolerance where it is minimal.

    Attributes:
        moments: (axes,), N m.
        multipliers: (axes, 6), their derivatives by the wrench at that corner.
        corners: (axes, 6, 9), wrench at the corner per wrench and gravity, see `Layout.corners`.
        forces: (axes, 3 n), N, of the optimum; NaN where the moment is affine; None on rigid patches.
    """

    moments: np.ndarray
    multipliers: np.ndarray
    corners: np.ndarray
    forces: np.ndarray | None

    @cached_property
    def by_loads(self) -> np.ndarray:
        """(axes, 9), derivatives by wrench and gravity."""
        return np.einsum("aw,awg->ag", self.multipliers, self.corners)

    @property
    def numbers(self) -> tuple[np.ndarray, ...]:
        """Arguments of the function of `PlacedMoments` behind the variables."""
        assert self.forces is not None  # contacts move only on ground that they conform to
        affine = np.isnan(self.forces[:, 0]).astype(float)
        corners = np.concatenate(list(self.corners), axis=1)
        return self.multipliers.T, np.nan_to_num(self.forces).T, self.moments, affine, corners


class PlacedMoments:
    """Addable moments as functions of the place, and of wrench and gravity in base axes.

    Args:
        at: expressions of the contacts.
        pairs: (axes, 2) numbers of the contacts on each axis.
        count: of wrench and gravity: 9; 6 where gravity does not count, see `corner_maps`.
    """

    def __init__(self, symbols: Symbols, pairs: np.ndarray, count: int) -> None:
        axes, size = len(pairs), 3 * symbols.contacts.size2()
        loads, centre = cs.SX.sym("loads", count), cs.SX(symbols.center_of_mass)
        multipliers, forces = cs.SX.sym("multipliers", 6, axes), cs.SX.sym("forces", size, axes)
        moments, affine = cs.SX.sym("moments", axes), cs.SX.sym("affine", axes)
        corners, rows = cs.SX.sym("corners", 6, count * axes), []
        for i, (first, second) in enumerate(pairs):
            wrench = corners[:, count * i : count * i + count] @ loads
            point, span = (
                symbols.contacts[:, int(first)],
                symbols.contacts[:, int(second)] - symbols.contacts[:, int(first)],
            )
            e = span / cs.norm_2(span)
            about = -cs.dot(cs.vertcat(cs.cross(e, centre - point), e), wrench)
            balance = _wrench(symbols, forces[:, i]) + wrench + moments[i] * cs.vertcat(cs.SX.zeros(3), e)
            lagrangian = moments[i] + cs.dot(multipliers[:, i], balance)
            rows.append(affine[i] * about + (1 - affine[i]) * lagrangian)
        variables, numbers = cs.vertcat(symbols.p, loads), [multipliers, forces, moments, affine, corners]
        self._function = Twice.of(variables, numbers, cs.vertcat(*rows), local=symbols.local)

    def slope(self, p: np.ndarray, loads: np.ndarray, worst: LeastMoments) -> np.ndarray:
        """Derivatives (axes, k) of the moments by the place; loads (9,)."""
        return self._function.jacobian(np.concatenate([p, loads]), *worst.numbers)[1][:, : len(p)]

    def hessian(
        self, p: np.ndarray, loads: np.ndarray, worst: LeastMoments, multipliers: np.ndarray
    ) -> np.ndarray:
        """Second derivatives (k + 9, k + 9) of multipliers . moments by place and loads."""
        return self._function.hessian(np.concatenate([p, loads]), *worst.numbers, multipliers)


def addable(support: Support, pairs: np.ndarray, wrenches: np.ndarray) -> Addable:
    """Moments about lines through pairs (axes, 2) of contacts that wrenches (N, 6) leave to be added."""
    places, none, axes = support.arms + support.center_of_mass, np.zeros(support.n_contacts), []
    for i, j in pairs:
        span = places[j] - places[i]
        axes.append(TippingAxis((i, j), places[i], span / np.linalg.norm(span), none))
    return AddableMoments(support, ForceSets(support), tuple(axes)).addable(wrenches)


def least(
    moments: np.ndarray, slopes: np.ndarray, forces: np.ndarray | None, corners: np.ndarray
) -> list[LeastMoments]:
    """Per load case, of moments (cases K, axes) at K corners (K, 6, 9), those at the worst corners."""
    count, axes = len(corners), np.arange(moments.shape[1])
    result = []
    for first in range(0, len(moments), count):
        worst = np.argmin(moments[first : first + count], axis=0)
        index = first + worst, axes
        forces_there = None if forces is None else forces[index]
        result.append(LeastMoments(moments[index], slopes[index], corners[worst], forces_there))
    return result


_STEP = 1e-5  # of the largest wrench component, for the curvature of GT
_MOST_CURVATURE = 1e3  # per squared largest wrench: beyond it a kink lies between, which has no curvature


class TipOverLimit(PlacementLimit):
    """Moments of the normal margins about the tipping axes, behind GN; without solving the contacts.

    Attributes:
        pairs: (axes, 2) contacts on the axes, which stay the same where feet conform to the ground.
        quantity: as motions keep it, with the number asked for.
        moments: wrench (6,) -> moments about the axes, N m, of the nominal contacts.
    """

    kind = "tip-over"
    on_loads = True

    def __init__(self, problem: PlacementProblem) -> None:
        super().__init__(problem)
        tip = problem.footing.tip_over
        self.pairs = np.array([axis.contacts for axis in tip.axes], dtype=int).reshape(-1, 2)
        self.quantity = TipOverQuantity(problem.footing, problem.limits.GN or 1.0)
        self.moments = self.quantity.moments

    def ratio(self, moments: np.ndarray) -> np.ndarray:
        """GN from the moments (..., axes); exact on a plane as long as the base stands."""
        tip = self.problem.footing.tip_over
        if tip.free_rotation:
            return np.ones(moments.shape[:-1])
        if not moments.shape[-1]:
            return np.zeros(moments.shape[:-1])
        smallest = np.maximum(np.min(moments, axis=-1), 0.0)
        return tip.reference_moment / (tip.reference_moment + smallest)

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        if not self.moments.count:
            return []
        smallest = np.min(evaluation.moments[:, evaluation.constrained], axis=(2, 3))
        return [
            self.row(evaluation.names, smallest, self.quantity.least_moment, False, "N m", self.quantity.unit)
        ]

    def functions(self, symbols: Symbols) -> list[PlacedMoments]:
        """Moments also as functions of the place, where contacts move."""
        return (
            [PlacedMoments(symbols, self.pairs, corner_maps(self.problem).shape[2])]
            if symbols.moving and self.moments.count
            else []
        )

    def blocks(self, layout: Variables, functions: list[PlacedMoments]) -> list[CaseRows]:
        result = []
        for i, case in enumerate(layout.cases if self.moments.count else ()):
            slack = layout.slack.get("moment") if case.counts else None
            least = self.quantity.least_moment / self.quantity.unit if slack is None else 0.0
            labels = [RowLabel(self.kind, case.name)] * self.moments.count
            lower = least if case.constrained else -np.inf
            placed = functions[0] if functions else None
            result.append(CaseRows(i, layout.y[case.task], labels, lower, np.inf, slack, function=placed))
        return result

    def start(self, point: Point, x: np.ndarray) -> None:
        if (slack := point.layout.slack.get("moment")) is not None:
            least = min(np.min(self._at(point)[i].moments) for i in point.layout.counting)
            x[slack] = least / self.quantity.unit

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        values = self._at(point)[block.of].moments / self.quantity.unit
        return values if block.slack is None else values - point.x[block.slack]

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        worst, loads = self._at(point)[block.of], point.loads[block.of][point.layout.n :]
        slope = worst.by_loads @ point.slopes[block.of][point.layout.n :]
        if block.function is not None:
            slope[:, : point.layout.k] += block.function.slope(point.x[point.layout.p], loads, worst)
        slope = slope / self.quantity.unit
        return slope if block.slack is None else np.column_stack([slope, np.full(len(slope), -1.0)])

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        n, k = point.layout.n, point.layout.k
        for block in blocks:
            worst, on = self._at(point)[block.of], multipliers[block.rows] / self.quantity.unit
            sums.on_loads[block.of][n:] += on @ worst.by_loads
            if block.function is not None:
                y, loads = point.layout.y[point.layout.cases[block.of].task], point.loads[block.of][n:]
                block_hessian = block.function.hessian(point.x[point.layout.p], loads, worst, on)
                along = np.vstack([np.eye(k, len(y)), point.slopes[block.of][n:]])
                sums.add(y, along.T @ block_hessian @ along)

    def _at(self, point: Point) -> list[LeastMoments]:
        """Per load case the moments about the axes, each at the corner of the tolerance where it is
        minimal.
        """

        def evaluate() -> list[LeastMoments]:
            corners, forces = point.layout.corners, None
            if point.layout.stand.conforms:
                result = addable(point.footing.support, self.pairs, point.wrenches)
                moments, slopes, forces = result.moments, result.slopes, result.forces
            else:
                moments, slopes = self.moments(point.wrenches)
            return least(moments, slopes, forces, corners)

        return point.once(self, evaluate)


class SlipLimit(PlacementLimit):
    """Friction utilisation by the contact solver with its derivatives, unless contact forces are
    variables.

    Attributes:
        quantity: as motions keep it, with the number asked for.
    """

    kind = "slip"
    on_loads = True

    def __init__(self, problem: PlacementProblem) -> None:
        super().__init__(problem)
        self.quantity = SlipQuantity(problem.footing, problem.limits.GT or 1.0)

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        if layout.forces is not None:
            return []
        result = []
        for j in layout.held:
            i, _ = layout.contact_case(j)
            case, slack = layout.cases[i], layout.slack_of("slip", i)
            upper = self.quantity.number if slack is None else 0.0
            label = RowLabel(self.kind, case.name)
            result.append(CaseRows(j, layout.y[case.task], [label], -np.inf, upper, slack))
        return result

    def start(self, point: Point, x: np.ndarray) -> None:
        if (slack := point.layout.slack.get("slip")) is not None:
            cases = point.layout.contact_cases(point.layout.counting)
            x[slack] = np.max(known(Loaded(point.footing, point.wrenches[cases]).slip.GT))

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        value = self._at(point)[0][block.of]
        return np.array([value if block.slack is None else value - point.x[block.slack]])

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        slope = self._at(point)[1][block.of] @ point.wrench_slope(block.of)
        return (slope if block.slack is None else np.append(slope, -1.0))[None]

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        if not blocks:
            return
        slopes = self._at(point)[1]
        on = {block.of: float(multipliers[block.rows][0]) for block in blocks}
        weighty = [j for j, factor in on.items() if abs(factor) > 1e-9]
        bends = dict(zip(weighty, self._bends(point, weighty), strict=True))
        for j, factor in on.items():
            bend = bends.get(j)
            twice = None if bend is None else factor * (bend + bend.T) / 2
            sums.add_on_wrench(j, factor * slopes[j], twice)

    def _bends(self, point: Point, cases: list[int]) -> list[np.ndarray | None]:
        """Second derivatives (6, 6) of GT by the wrench, by differences of its exact gradient."""
        if not cases:
            return []
        length = point.footing.support.length
        wrenches, slopes = point.wrenches[cases], self._at(point)[1]
        size = np.max(np.abs(wrenches * np.r_[1, 1, 1, np.ones(3) / length]), axis=1)
        steps = _STEP * size[:, None] * np.r_[1, 1, 1, np.full(3, length)]
        moved = wrenches[:, None] + steps[:, :, None] * np.eye(6)
        gradients = self.quantity.exact_rows(Loaded(point.footing, moved.reshape(-1, 6)))[1].reshape(-1, 6, 6)
        result = []
        for i, step, gradient in zip(cases, steps, gradients, strict=True):
            bend = (gradient - slopes[i]) / step[:, None]
            relative = np.max(np.abs(bend * np.outer(step, step))) / _STEP**2
            result.append(bend if relative < _MOST_CURVATURE else None)
        return result

    def _at(self, point: Point) -> tuple[dict[int, float], dict[int, np.ndarray]]:
        """GT and its derivative (6,) by held contact case."""

        def evaluate() -> tuple[dict, dict]:
            held = point.layout.held
            if not held:
                return {}, {}
            GT, slopes = self.quantity.exact_rows(Loaded(point.footing, point.wrenches[held]))
            return dict(zip(held, GT[:, 0].tolist(), strict=True)), dict(zip(held, slopes[:, 0], strict=True))

        return point.once(self, evaluate)


class HeldForces(PlacementLimit):
    """Contact forces that are variables: they balance the wrench within their friction limits."""

    kind = "tip-over or slip"
    on_loads = True

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        if layout.forces is None or layout.pieces is None:
            return []
        n, result = self.problem.robot.support.n_contacts, []
        lower, upper = np.r_[np.zeros(6), np.full(n, -np.inf)], np.zeros(6 + n)
        for j, columns, piece in zip(layout.held, layout.held_forces, layout.pieces, strict=True):
            i, _ = layout.contact_case(j)
            case = layout.cases[i]
            labels = [RowLabel(self.kind, case.name)] * 6 + [RowLabel("slip", case.name)] * n
            columns, slack = np.r_[layout.y[case.task], columns], layout.slack_of("slip", i)
            result.append(CaseRows(j, columns, labels, lower, upper, slack, function=piece))
        return result

    def start(self, point: Point, x: np.ndarray) -> None:
        forces, held = point.layout.forces, point.layout.held
        if forces is not None and held:
            x[np.concatenate(point.layout.held_forces)] = forces.start(point.wrenches[held], point.footing)[
                0
            ].ravel()

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        forces, F, bound, _ = self._parts(point, block)
        balance = forces.balance(point.x[point.layout.p], F, point.wrenches[block.of])
        return np.concatenate([balance, block.function.rows(F, bound)[0]])

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        forces, F, bound, inside = self._parts(point, block)
        _, by_force, by_bound = block.function.rows(F, bound)
        result = np.zeros((len(block.labels), len(block.columns)))
        by_place, held = forces.slopes(point.x[point.layout.p], F)
        result[:6, : inside.start] = forces.per_wrench @ point.wrench_slope(block.of)
        result[:6, : point.layout.k] += by_place
        result[:6, inside], result[6:, inside] = held, by_force
        if block.slack is not None:
            result[6:, -1] = by_bound
        return result

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        for block in blocks:
            on, (forces, F, bound, inside) = multipliers[block.rows], self._parts(point, block)
            sums.add_on_wrench(block.of, on[:6] @ forces.per_wrench)
            p = point.layout.p
            if (moved := forces.hessian(point.x[p], F, on[:6])) is not None:
                sums.add(np.r_[p, block.columns[inside]], moved)
            block_hessian, mixed, twice = block.function.hessian(F, bound, on[6:])
            sums.add(block.columns[inside], block_hessian)
            if block.slack is not None:
                sums.add_mixed(block.slack, block.columns[inside], mixed)
                sums.matrix[block.slack, block.slack] += twice

    def _parts(self, point: Point, block: CaseRows) -> tuple[ContactForces, np.ndarray, float, slice]:
        """Contact forces, their values (3 n,), the maximum use of friction, and their place in columns."""
        forces, first = point.layout.forces, point.layout.k + point.layout.n
        assert forces is not None  # else there is no such block
        inside = slice(first, first + forces.size)
        bound = (self.problem.limits.GT or 1.0) if block.slack is None else float(point.x[block.slack])
        return forces, point.x[block.columns[inside]], bound, inside


class TipOverIndexLimit(PlacementLimit):
    """GN of the contact solver's states; the program keeps it by `TipOverLimit`."""

    kind = "GN"
    by_solver = True

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        most = getattr(self.problem.limits, self.kind)
        if evaluation.standing is None or most is None:
            return []
        values = getattr(evaluation, self.kind)[:, evaluation.constrained]
        return [self.row(evaluation.names, values, most, True, "", most)]


class SlipIndexLimit(TipOverIndexLimit):
    """GT of the contact solver's states; the program keeps it by `SlipLimit` or `HeldForces`."""

    kind = "GT"


class Persistence(PlacementLimit):
    """All contacts are maintained in the contact solver's solution."""

    kind = "persistence"
    has_margin = False
    by_solver = True
    verdicts = ("does not stand", "stands")

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        if evaluation.standing is None:
            return []
        standing = evaluation.standing[:, evaluation.constrained].astype(float)
        return [self.row(evaluation.names, standing, 1.0, False, "", 1.0)]
