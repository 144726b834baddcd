"""A limit of placements: its margins in the final check, and its rows in the nonlinear program.

The check (`margins`) evaluates many candidates in NumPy; the program (`blocks`, `values`, `jacobian`,
`add_hessian`) has separate expressions and derivatives, so that each checks the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import EllipsisType
from typing import Any, NamedTuple

import casadi as cs
import numpy as np

from ocptip.contact.states import ContactStates
from ocptip.placement.limits.forces import Local
from ocptip.placement.limits.layout import Hessian, Point, Variables
from ocptip.placement.problem import PlacementProblem, TaskLoad
from ocptip.placement.stand import Stood
from ocptip.placement.terrain import Patch


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Constraints of one kind at N candidates.

    Attributes:
        kind: of the limit.
        labels: m names.
        values: (N, m) in `unit`.
        limits: (m,).
        upper: values must be <= limits; else >=.
        unit: for people; one for all, or one per label.
        margins: (N, m) >= 0 where kept, in comparable units (0.1 m, 0.2 rad, the limit itself).
    """

    kind: str
    labels: tuple[str, ...]
    values: np.ndarray
    limits: np.ndarray
    upper: bool
    unit: str | tuple[str, ...]
    margins: np.ndarray


@dataclass(frozen=True, eq=False)
class PlacedBase(Stood):
    """Where the base stands at N candidates.

    Attributes, further to those of `Stood`:
        terrain: the patch.
        parameters: (N, k).
    """

    terrain: Patch
    parameters: np.ndarray

    def world(self, points: np.ndarray) -> np.ndarray:
        """(N, m, 3), m, of points (m, 3) or (N, m, 3) in base axes."""
        return self.origin[:, None] + points @ self.base.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class TaskEvaluation(PlacedBase):
    """One task at N candidates; C load cases of the task.

    Attributes:
        task: its number.
        cases: its load cases.
        q: (N, n), rad.
        torques: (N, C, n), N m.
        wrenches: (N, C, 6), N and N m, base axes: on the base about its centre of mass, weight included, of
            the nominal base.
        cornered: (N, C, K, 6), the same at the K corners of the problem's tolerance, about the same point;
            where contacts are not solved K is 1.
        moments: (N, C, K, axes), N m, about the tipping axes; where contacts are not solved the minimum over
            all corners.
        GN, GT: (N, C), the worst of all corners; NaN where not asked for.
        worst: by kind of limit (N, C): the corner at which it is worst.
        GK: (N, C): use of the force space (4.19), 0 without process load.
        GE: (N, C): holding power, W, or torque cost.
        standing: (N, C): the contacts are maintained, at all corners; None if not asked for.
        states: contact states, N C K of them; None if not asked for, or where feet conform.
        rows: constraints by kind.
    """

    task: int
    cases: list[TaskLoad]
    q: np.ndarray
    torques: np.ndarray
    wrenches: np.ndarray
    cornered: np.ndarray
    moments: np.ndarray
    GN: np.ndarray
    GT: np.ndarray
    GK: np.ndarray
    GE: np.ndarray
    worst: dict[str, np.ndarray]
    standing: np.ndarray | None
    states: ContactStates | None
    rows: tuple[ConstraintRows, ...] = ()

    @cached_property
    def counting(self) -> list[int]:
        """Numbers of the cases that count in the criteria."""
        return [c for c, case in enumerate(self.cases) if case.counts]

    @cached_property
    def constrained(self) -> list[int]:
        """Numbers of the cases that count in the constraints."""
        return [c for c, case in enumerate(self.cases) if case.constrained]

    @cached_property
    def names(self) -> list[str]:
        """Names of the constrained cases."""
        return [self.cases[c].name for c in self.constrained]

    def margin(self) -> np.ndarray:
        """(N,) smallest margin; NaN counts as broken."""
        return smallest_margin(self.rows, len(self.q))


def smallest_margin(rows: tuple[ConstraintRows, ...], count: int) -> np.ndarray:
    """(N,) smallest margin of all rows; minus infinity where one is NaN."""
    result = np.full(count, np.inf)
    for r in rows:
        if r.margins.shape[1]:
            result = np.minimum(result, np.min(np.nan_to_num(r.margins, nan=-np.inf), axis=1))
    return result


LENGTH_UNIT = 0.1  # m: gaps and bounds are compared with violations of other constraints in these units
ANGLE_UNIT = 0.2  # rad
LOG_UNIT = np.log(2.0)  # of condition numbers


class RowLabel(NamedTuple):
    """Kind and name of a row of the program."""

    kind: str
    name: str


@dataclass(eq=False)
class CaseRows:
    """Rows of one limit at one task or load case.

    Attributes:
        of: number of the task, load case or contact case (see `Variables`); -1 for the base alone.
        columns: numbers of the variables that the rows depend on; all others have no influence.
        labels: of the rows.
        lower, upper: bounds, one for all rows or one each.
        slack: the variable of the objective that bounds these rows, then the last of the columns; None: a
            number bounds them.
        function: of x[columns], a `Twice`, for limits that are smooth functions of poses; of others what the
            limit needs for its rows.
        chosen: which of its values take part; default all.
        rows: place among the rows of the program, which fills it in.
    """

    of: int
    columns: np.ndarray
    labels: Sequence[RowLabel]
    lower: float | np.ndarray
    upper: float | np.ndarray
    slack: int | None = None
    function: Any = None
    chosen: np.ndarray | EllipsisType = ...
    rows: slice = field(init=False)

    def __post_init__(self) -> None:
        if self.slack is not None:
            self.columns = np.append(self.columns, self.slack)


@dataclass(frozen=True, eq=False)
class Symbols:
    """The variables of one task on a patch, and what limits are expressed in.

    Attributes:
        y: p (k,), the patch's parameters, and q (n,), rad.
        terrain: the patch.
        origin: (3,), m, base origin in the world.
        base: (3, 3), base to world axes.
        contacts: (3, n), m, base axes.
        frames: (9, n), contact frames in base axes, column by column.
        strokes: (n,), m, of the legs.
        center_of_mass: (3,), m, of the nominal base.
        moving: contacts depend on p.
        local: numbers that go into the expressions, for `Twice.of`.
    """

    y: cs.SX
    p: cs.SX
    q: cs.SX
    terrain: Patch
    origin: cs.SX
    base: cs.SX
    contacts: cs.SX
    frames: cs.SX
    strokes: cs.SX
    center_of_mass: np.ndarray
    moving: bool
    local: Local

    def world(self, point: np.ndarray | cs.SX) -> cs.SX:
        """(3,), m, of a point in base axes."""
        return self.origin + self.base @ cs.SX(point)


class PlacementLimit:
    """One kind of limit of a problem.

    Subclasses give `margins` for the check, and `blocks` for the program; rows that are smooth functions of
    the poses give `functions`, all others `values`, `jacobian` and `add_hessian`.

    Attributes:
        kind: its name in results.
        has_margin: it can be kept with more or less room; False for equalities and for yes-or-no.
        many: it has a large number of names: results list only those that are near.
        together: in the search for the place of minimum violation all its rows are relaxed by one amount.
        counted_once: of its violations in one task only the worst counts in the sum of violations.
        by_solver: it says nothing where the contact solver finds no solution.
        verdicts: for yes-or-no: what to say for no and for yes.
        on_loads: its rows depend on the loads of load cases, see `Point.loads`.
    """

    kind = ""
    has_margin = True
    many = False
    together = False
    counted_once = False
    by_solver = False
    verdicts: tuple[str, str] | None = None
    on_loads = False

    def __init__(self, problem: PlacementProblem) -> None:
        self.problem = problem

    def row(
        self,
        labels: Sequence[str],
        values: np.ndarray,
        limits: np.ndarray | float,
        upper: bool,
        unit: str | tuple[str, ...],
        scale: np.ndarray | float,
    ) -> ConstraintRows:
        """Rows with margins in units of `scale`; `limits` (m,) or one for all."""
        limits = np.broadcast_to(limits, values.shape[1:])
        margins = (limits - values if upper else values - limits) / scale
        return ConstraintRows(self.kind, tuple(labels), values, limits, upper, unit, margins)

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        """How far it is kept at N candidates; none: it is a matter of the program alone."""
        return []

    def functions(self, symbols: Symbols) -> list[Any]:
        """Rows that are smooth functions of y, such as `Twice`, per task, or one for all tasks."""
        return []

    def blocks(self, layout: Variables, functions: list[Any]) -> list[CaseRows]:
        """Rows with their bounds; none: variables' bounds keep it, or only the final check has it."""
        return []

    def start(self, point: Point, x: np.ndarray) -> None:
        """Set variables of x that belong to this limit just as large as needed at a point."""

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        """(rows,)."""
        return self._smooth(point, block)[0][block.chosen]

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        """(rows, columns)."""
        return self._smooth(point, block)[1][block.chosen]

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        """Add second derivatives of the rows times their multipliers (of all rows of the program)."""
        for block in blocks:
            on = np.zeros(block.function.size)
            on[block.chosen] = multipliers[block.rows]
            sums.add(block.columns, block.function.hessian(point.x[block.columns], on))

    @staticmethod
    def _smooth(point: Point, block: CaseRows) -> tuple[np.ndarray, np.ndarray]:
        return point.once(block, lambda: block.function.jacobian(point.x[block.columns]))
