"""The interface of kinds of limits of a standing mechanism.

A limit has three sides. Each method's default says "nothing here", so that a kind has those it needs:

- what happens: values at sampled instants (`measure`), the worst of a motion in the limit's scenario
  (`worst`), of a posture at rest (`refusals`), of a path (`path_excess`);
- rows of a nonlinear program: at each node `width` of them, of which those near the limit take part (`uses`,
  `bounds`, `rows_at`, `jacobian`, `add_to_quantities`, `add_hessian`);
- search: numbers asked for that can be tightened (`AskedLimit`).

The kinds and their list are in `kinds`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ocptip.standing.instants import Instants, NodeColumns
from ocptip.standing.limit_kinds.rows import Curvature, NodeRows, RowNodes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory

TOLERANCE = 1e-9  # a limit exceeded by less than this, in its units, is kept
ORDINARY, JUMP, DEVIATING = range(3)
"""Kinds of nodes: of the motion; after an acceleration step with its overshoot, see
`standing.limit_kinds.jumps`; with joints that are delayed or overshoot, each by itself, see
`motion.planner.deviating`.
"""

FAR_FROM_SLIPPING = 0.25  # share of GT's limit that no row of a program looks at
INNER = 1e-4  # an asked number is tightened by this share where rounding must not break it

WHOLE, SAMPLED, WITHIN, LATE = range(4)
"""Scenarios in which a limit is evaluated, in the order of reports: the whole motion, exactly; its sampled
instants; these within the uncertainty; and with delayed joints, each by itself."""

InstantAt = Callable[[float], Instants]
"""A function from a time, s, to the instant then."""


@dataclass(frozen=True)
class Worst:
    """The worst instant of one quantity; where its limit is broken, a violation.

    Attributes:
        name: of the quantity; empty: `detail` states in words what is broken and has no value.
        value: in the quantity's unit.
        time: s; NaN where it is of the whole motion.
        limit: what it is compared with.
        detail: where or what, e.g. "joint 2".
        excess: by how much the limit is broken; negative where it is kept.
        least: the limit is a minimum, not a maximum.
        scenario: what was begun at that time, "cancel"; empty: the motion itself. Then `detail` follows the
            time in sentences.
        unit: in which sentences give value and limit; empty: that of the name.
        share: of the instants from which what was begun breaks the limit; NaN: not known.
    """

    name: str
    value: float
    time: float
    limit: float
    detail: str
    excess: float
    least: bool = False
    scenario: str = ""
    unit: str = ""
    share: float = math.nan

    @property
    def broken(self) -> bool:
        """Whether the limit is broken."""
        return not self.excess <= TOLERANCE  # NaN breaks it

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {name: getattr(self, name) for name in ("value", "time", "limit", "detail")}


@dataclass(frozen=True, eq=False)
class Sampled:
    """A motion at the instants of a check.

    Attributes:
        robot: as given, before a process that varies over the path is one over the motion's time.
        motion: of it.
        times: (N,), s.
        instant_at: what happens at one time.
        memo: what limits compute of the motion for each other.
    """

    robot: StandingMechanism
    motion: Trajectory
    times: np.ndarray
    instant_at: InstantAt
    memo: dict[object, Any] = field(default_factory=dict)


class Limit:
    """One kind of limit. This one limits nothing.

    Args:
        robot: whose.
        asked: the task's numbers.
        joints: coordinates that are optimised; the others stay between start and goal.

    Attributes:
        name: of the kind.
        of_contacts: a matter of the contact forces: without meaning where the contacts do not hold.
        node_kinds: of nodes of a program that it is about.
        scenario: in which it is evaluated.
        of_motion: evaluates the motion itself, not its deviations.
        of_place: a matter of the angles only, whatever the timing.
        affine: rows of a program are affine in torques and wrench, and know nothing else of a state.
        width: number of rows at a node.
        reach: rows take part from a use of 1 - (1 - share) reach on, where `share` is asked for.
        interface: of the robot's `interfaces`, whose contacts it is about; 0: the base.
    """

    name = ""
    of_contacts = False
    node_kinds: tuple[int, ...] = (ORDINARY,)
    scenario = SAMPLED
    of_motion = True
    of_place = affine = False
    width = interface = 0
    reach = 1.0

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        self.robot, self.asked, self.joints = robot, asked, list(joints)

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        """Whether the robot and the task's numbers ask for this kind at all."""
        return True

    @classmethod
    def of(cls, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> tuple[Limit, ...]:
        """All limits of this kind."""
        return (cls(robot, asked, joints),)

    # --- what happens -------------------------------------------------------------------------------------

    def measure(self, instants: Instants) -> np.ndarray:
        """Values (N, m) whose maxima are the worst; NaN where unknown."""
        return np.empty((len(instants), 0))

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        """The worst of a motion: of values (N, m) at its instants, or of what else the scenario is about."""
        return []

    def within(self, within_tolerance: Any) -> list[Worst]:
        """The worst of a motion within an uncertainty, from a `WithinTolerance`."""
        return []

    def kept(self, instants: Instants) -> bool:
        """At all instants."""
        return True

    def refusals(self, instants: Instants) -> list[str]:
        """Why the mechanism cannot rest so (a single instant), with numbers."""
        return []

    def path_excess(self, instants: Instants) -> float:
        """By how much a path, taken at rest, misses the limit, with some margin; in about its units."""
        return -np.inf

    # --- timing of a given path ---------------------------------------------------------------------------

    def half_spaces(self) -> np.ndarray | None:
        """Rows a (m, 6): the limit is kept under wrenches w with a . w <= 0; None: there are no such."""
        return None

    # --- rows of a program --------------------------------------------------------------------------------

    def chosen(self, instants: Instants) -> Limit:
        """The limit for rows of a program near these instants of its nodes, smooth where it has kinks."""
        return self

    def uses(self, instants: Instants) -> np.ndarray:
        """(N, width): use of the limit by each row, 1 at the limit, more beyond."""
        return np.full((len(instants), self.width), -np.inf)

    def use(self, instants: Instants) -> np.ndarray:
        """(N,): worst use of the limit, 1 at the limit, more beyond."""
        return np.max(self.uses(instants), axis=1, initial=-np.inf)

    def near(self, instants: Instants, share: float) -> np.ndarray:
        """(N, width) True where rows take part: their use of the limit is at least about `share`."""
        return ~(self.uses(instants) < 1 - (1 - share) * self.reach)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the rows of a node, (width,) each."""
        return np.empty(0), np.empty(0)

    def bounds_of(self, rows: NodeRows) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of rows at nodes of a path, each (R,)."""
        low, high = self.bounds()
        return low[rows.places], high[rows.places]

    def rows(self, row_nodes: RowNodes, mask: np.ndarray) -> NodeRows:
        """The rows that take part: where mask (N, width) is True, node by node."""
        return self.rows_at(row_nodes, *np.nonzero(mask))

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        """Rows at nodes i with numbers k among the limit's rows there, (R,) each."""
        raise NotImplementedError(f"{self.name}: no rows")

    def jacobian(self, rows: NodeRows) -> np.ndarray:
        """Slopes (rows, nx) of the rows over x."""
        raise NotImplementedError(f"{self.name}: no rows")

    def add_to_quantities(self, rows: NodeRows, on: np.ndarray, on_y: np.ndarray) -> None:
        """Add the slopes of on . rows over the quantities y to on_y (N, ny)."""

    def add_hessian(self, rows: NodeRows, on: np.ndarray, H: Curvature, on_s: np.ndarray) -> None:
        """Add second derivatives of on . rows to H, and slopes that do not depend on y to on_s (N, S)."""


class WrenchLimit(Limit):
    """Rows that are functions of the wrench on the limit's interface, divided by `unit`."""

    unit = 1.0

    def jacobian(self, rows: NodeRows) -> np.ndarray:
        first = rows.at.columns.wrenches[self.interface].start
        return rows.at.by_quantities(rows.nodes, first, rows.slopes / self.unit)

    def add_to_quantities(self, rows: NodeRows, on: np.ndarray, on_y: np.ndarray) -> None:
        slopes = on[:, None] * rows.slopes / self.unit
        np.add.at(on_y[:, rows.at.columns.wrenches[self.interface]], rows.nodes, slopes)

    def add_hessian(self, rows: NodeRows, on: np.ndarray, H: Curvature, on_s: np.ndarray) -> None:
        if rows.bends.size:
            bends = (on / self.unit)[:, None, None] * rows.bends
            H.add_over_quantities(rows.nodes, rows.at.columns.wrenches[self.interface].start, bends)


class QuantityLimit(Limit):
    """Rows that are quantities of a node as they are: `width` columns of y, divided by `units`, (width,)."""

    units: np.ndarray

    def first(self, columns: NodeColumns) -> int:
        """The first of the columns."""
        raise NotImplementedError

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        return NodeRows(row_nodes, i, k, row_nodes.y[i, self.first(row_nodes.columns) + k] / self.units[k])

    def jacobian(self, rows: NodeRows) -> np.ndarray:
        columns = self.first(rows.at.columns) + rows.places
        return rows.at.by_quantities(rows.nodes, columns, 1 / self.units[rows.places, None])

    def add_to_quantities(self, rows: NodeRows, on: np.ndarray, on_y: np.ndarray) -> None:
        on_y[rows.nodes, self.first(rows.at.columns) + rows.places] += on / self.units[rows.places]


class StateLimit(Limit):
    """Rows that are functions of the states; `NodeRows.slopes` are (rows, S)."""

    def jacobian(self, rows: NodeRows) -> np.ndarray:
        return rows.at.by_states(rows.nodes, rows.slopes)

    def add_hessian(self, rows: NodeRows, on: np.ndarray, H: Curvature, on_s: np.ndarray) -> None:
        np.add.at(on_s, rows.nodes, on[:, None] * rows.slopes)
        some, bends = self.curvature(rows, on)
        H.add(rows.nodes[some], bends)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which rows bend (k,), and the second derivatives (k, S, S) of on . rows over the states."""
        raise NotImplementedError(f"{self.name}: no rows")


class AskedLimit(Limit):
    """One quantity that must not exceed, or fall below, one number of `Limits`.

    Attributes:
        result: its name in results.
        setting: the field of `Limits`.
        least: the number is a minimum.
        rows_first: not tightened at once where it is broken by more than a step: then rows were missing.
        smallest_step, largest_step: by how much the number is tightened at once, at least and at most.
    """

    result = setting = ""
    least = False
    smallest_step, largest_step = 0.0, 2e-3
    rows_first = False

    @property
    def number(self) -> float:
        """Asked for."""
        return getattr(self.asked, self.setting)

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        k = int(np.argmax(values[:, 0]))
        value, time = float(-values[k, 0] if self.least else values[k, 0]), float(sampled.times[k])
        return [self.worst_value(value, time, self.detail(sampled.instant_at, time))]

    def worst_value(self, value: float, time: float, detail: str) -> Worst:
        """A worst value and by how much it breaks the limit."""
        excess = self.number - value if self.least else value - self.number
        return Worst(self.result, value, time, self.number, detail, excess, self.least)

    def detail(self, instant_at: InstantAt, time: float) -> str:
        """Where or what the worst value is."""
        return ""

    def kept(self, instants: Instants) -> bool:
        values = self.measure(instants)
        return bool(np.all(-values >= self.number if self.least else values <= self.number))

    def inner(self, asked: Limits) -> Limits:
        """These limits, with this one slightly tighter."""
        return replace(asked, **{self.setting: getattr(asked, self.setting) * (1 - INNER)})

    def tightened(self, asked: Limits, excess: float) -> Limits:
        """These limits, with this one tighter by about its `excess`, at most by half."""
        value = getattr(asked, self.setting)
        step = min(max(excess, self.smallest_step), self.largest_step)
        return replace(asked, **{self.setting: max(value - step, value / 2)})


def tightened(asked: Limits, faults: Iterable[tuple[AskedLimit, float]]) -> Limits:
    """Numbers asked for, tighter by about their excess; one that several interfaces share by the largest."""
    largest: dict[tuple[type[AskedLimit], str], tuple[AskedLimit, float]] = {}
    for limit, excess in sorted(faults, key=lambda fault: fault[1]):
        largest[type(limit), limit.setting] = limit, excess
    for limit, excess in largest.values():
        asked = limit.tightened(asked, excess)
    return asked


class WholeMotionLimit(AskedLimit):
    """A number of the whole motion; programs know nothing of it."""

    scenario = WHOLE

    def kept(self, instants: Instants) -> bool:
        return True

    def inner(self, asked: Limits) -> Limits:
        return asked


class TableLimit(AskedLimit):
    """A number of a table of `Limits`, such as `stops`.

    Attributes:
        table: the field of `Limits`.
        inner_share: relative amount by which programs are tighter.
        of_arms: of arms alone.
    """

    table = ""
    inner_share = INNER
    of_arms = False

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return getattr(asked, cls.table) is not None and (robot.arm is not None or not cls.of_arms)

    @property
    def number(self) -> float:
        return self._own(self.asked)

    def inner(self, asked: Limits) -> Limits:
        return self._changed(asked, self._own(asked) * (1 - self.inner_share))

    def tightened(self, asked: Limits, excess: float) -> Limits:
        value = self._own(asked)
        return self._changed(asked, max(value - min(excess, self.largest_step), value / 2))

    def _own(self, asked: Limits) -> float:
        return getattr(getattr(asked, self.table), self.setting)

    def _changed(self, asked: Limits, value: float) -> Limits:
        settings = replace(getattr(asked, self.table), **{self.setting: value})
        return replace(asked, **{self.table: settings})
