"""Limits of the contacts in the worst case of an uncertainty: no contact is lost. See
`standing.within.worst_case`.

Their values at instants are not measured one by one: `standing.within.in_motion` evaluates motions with
joints that are delayed or overshoot.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np

from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import (
    DEVIATING,
    ORDINARY,
    WITHIN,
    AskedLimit,
    Limit,
    Sampled,
    StateLimit,
    Worst,
)
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limit_kinds.quantity import ContactQuantity
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import TORQUE_WITHIN, WITHIN_OF, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.in_motion import WithinTolerance, worst_of_sampled
from ocptip.standing.within.tolerable import AT_REST, why_not
from ocptip.standing.within.worst_case import WorstCase, worst_case_of

MOVING = 0.1  # share of the friction that a tolerance takes besides, about


class WithinLimit(AskedLimit):
    """A number that a motion keeps at the worst of the uncertainty."""

    scenario = WITHIN

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return bool(asked.tolerance.given)

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        return self.within(worst_of_sampled(sampled, self.asked.tolerance))


class WorstCaseLimit(StateLimit, WithinLimit, ContactLimit):
    """A quantity of the contacts at the worst deviations; rows have its slopes over the state there."""

    words = "{} within tolerance", "{}_worst_case"
    node_kinds = (ORDINARY, DEVIATING)
    smallest_step, largest_step = 1e-4, 0.02
    rows_first = takes_objects = True

    def __init__(
        self,
        robot: StandingMechanism,
        asked: Limits,
        joints: tuple[int, ...],
        quantity: type[ContactQuantity],
        interface: int = 0,
    ) -> None:
        super().__init__(robot, asked, joints, quantity, interface)
        self.cases = worst_case_of(robot, asked.tolerance, interface)
        self._smooth, self._bound = self.quantity.smooth_within(self.cases)
        self._theta: np.ndarray | None = None  # (N, width, size) of the nodes of a program

    @classmethod
    def setting_of(cls, quantity: type[ContactQuantity]) -> str:
        return WITHIN_OF[quantity.symbol]

    def within(self, within_tolerance: WithinTolerance) -> list[Worst]:
        of_contacts = (
            within_tolerance.objects[self.quantity.footing.name] if self.interface else vars(within_tolerance)
        )
        worst = of_contacts[self.quantity.in_results]
        if worst is None:
            return []
        value, how = worst.most, worst.how
        return [self.worst_value(value, worst.time, f"{how}: {worst.left}" if value > 1 else how)]

    def kept(self, instants: Instants) -> bool:
        return self.quantity.kept_within(self._smooth, instants.s, self._bound)

    def refusals(self, instants: Instants) -> list[str]:
        def kept(cases: WorstCase) -> bool:
            return self.quantity.rests_within(cases, instants.s)

        if kept(self.cases):
            return []
        tolerance, (value, theta) = self.asked.tolerance, self.quantity.worst_at_rest(self.cases, instants.s)
        rest, _ = why_not(tolerance, AT_REST, lambda some: kept(self.cases.within(some)))
        what = self.quantity.lost_words(value, self.quantity.footing.name if self.interface else "")
        result = f"within the uncertainty at rest {what} ({self.cases.deviations.words(theta)}): {rest}"
        return [f"{result} (--tolerance none plans for the nominal model)"]

    def path_excess(self, instants: Instants) -> float:
        return self.quantity.path_excess_within(self.cases, instants.s)

    def uses(self, instants: Instants) -> np.ndarray:
        return self.quantity.uses_within(self._smooth, instants.s, self._bound)

    def chosen(self, instants: Instants) -> Limit:
        """With the deviations that are worst there."""
        other, count, width = copy(self), len(instants), self.width
        rows, places = np.repeat(np.arange(count), width), np.tile(np.arange(width), count)
        result = self.quantity.within(self._smooth, instants.s[rows], places)
        other._theta = result.theta.reshape(count, width, -1)
        return other

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        ends = np.full(self.width, self._bound / self.quantity.unit), np.full(self.width, np.inf)
        return ends if self.quantity.least else (-ends[1], ends[0])

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        theta = None if self._theta is None else self._theta[i, k]
        result, unit = self.quantity.within(self._smooth, row_nodes.s[i], k, theta), self.quantity.unit
        weights = result.slopes / unit
        slopes = self.cases.deviations.state_slopes(row_nodes.s[i], result.theta, weights)[0]
        bends = np.empty(0) if result.bends is None else result.bends / unit
        fixed = {"chosen": (result.theta,), "weights": weights, "bends": bends}
        return NodeRows(row_nodes, i, k, result.values / unit, slopes, **fixed)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        states, weights = rows.at.s[rows.nodes[some]], on[some, None] * rows.weights[some]
        deviations, theta = self.cases.deviations, rows.chosen[0][some]
        result = deviations.state_curvature(states, theta, weights)[0]
        if rows.bends.size:
            every = np.tile(np.eye(6), (len(some), 1))
            slopes = deviations.state_slopes(
                np.repeat(states, 6, axis=0), np.repeat(theta, 6, axis=0), every
            )[0]
            slopes = slopes.reshape(len(some), 6, states.shape[1])
            bent = np.matmul(on[some, None, None] * rows.bends[some], slopes)
            result = result + np.matmul(slopes.transpose(0, 2, 1), bent)
        return some, result


class WorstTorqueLimit(WithinLimit):
    """Torques within the uncertainty; programs know those of the nominal model, and are tightened."""

    name, result, setting = "torque within tolerance", *[TORQUE_WITHIN] * 2
    smallest_step, largest_step = 1e-3, 0.05

    def within(self, within_tolerance: WithinTolerance) -> list[Worst]:
        worst = within_tolerance.torque
        return [self.worst_value(worst.value, worst.time, self.robot.joint_label(worst.joint - 1))]

    def inner(self, asked: Limits) -> Limits:
        return asked

    def tightened(self, asked: Limits, excess: float) -> Limits:
        step = min(max(excess, self.smallest_step), self.largest_step)
        return replace(asked, torque_ratio=max(asked.torque_ratio - step, asked.torque_ratio / 2))


def left_at_rest(robot: StandingMechanism, tolerance: Uncertainty, rest: np.ndarray) -> float:
    """Share of the minimum moment about a tipping axis that an uncertainty leaves in postures (k, n) at
    rest.
    """
    cases = worst_case_of(robot, tolerance)
    if not cases.axes:
        return 1.0
    s = _at_rest(robot, rest)
    least, plain = (
        float(worst_case.all_moments(s).min()) for worst_case in (cases, cases.within(Uncertainty()))
    )
    return least / plain


def as_described(robot: StandingMechanism, asked: Limits, rest: np.ndarray, jumps: bool = True) -> Limits:
    """Limits without an uncertainty, tighter, so that motions of the nominal model keep about its margin.

    The cost of an uncertainty is that of the worst posture at rest. An acceleration step from a moment M
    about a tipping axis leads to M' >= kappa / (1 + kappa) M if that with its overshoot, M' + kappa (M' - M),
    is to vanish at most; M is the minimum at rest.

    Args:
        robot: whose.
        asked: of it.
        rest: (k, n) postures at rest.
        jumps: there are acceleration steps.
    """
    if not asked.tolerance.given:
        return asked
    cases, more = worst_case_of(robot, asked.tolerance), asked.tolerance.overshoot * jumps
    s = _at_rest(robot, rest)
    GN, GT = asked.GN, asked.GT
    if cases.axes and cases.reference:
        worst, plain = cases.all_moments(s), cases.within(Uncertainty()).all_moments(s)
        where = np.unravel_index(np.argmin(worst), worst.shape)
        least = float(plain[where] - worst[where]) + more / (1 + more) * max(float(worst[where]), 0.0)
        GN = min(GN, float(cases.tip_ratio(np.array(least))))
    if asked.tolerance.friction:
        GT = min(GT, 1 - asked.tolerance.friction - MOVING)
    return replace(asked, tolerance=Uncertainty(), GN=GN, GT=GT)


def _at_rest(robot: StandingMechanism, rest: np.ndarray) -> np.ndarray:
    """States of postures (k, n) from start to goal at rest; with a process there, if it varies.

    A base that drives rests as well.
    """
    still = np.zeros_like(rest)
    ends = [robot.resting(share).process_at_rest for share in np.linspace(0, 1, len(rest))]
    process = [np.array(ends)] if robot.varying is not None else []
    base = np.zeros((len(rest), robot.acts.size - 6 * len(process)))
    return np.hstack([rest, still, still, *process, base])
