"""Limits of the contacts at the worst of a tolerance: no contact is lost. See `standing.within.worst_case`.

Their values at instants are not measured one by one: `standing.within.in_motion` says what joints that are
late or overshoot do to a motion.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import (
    DEVIATING,
    ORDINARY,
    WITHIN,
    AskedLimit,
    Sampled,
    StateLimit,
    Worst,
)
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.in_motion import WithinTolerance, WorstInstant, worst_of_sampled
from ocptip.standing.within.tolerable import AT_REST, why_not
from ocptip.standing.within.worst_case import WorstCase, WorstDeviations, worst_case_of

ROOM = 0.5  # share of M0 within which, at a use of zero, rows of moments would take part
MOVING = 0.1  # share of the friction that a tolerance takes besides, about
PATH_MARGIN = 0.05  # share of M0 that a path at rest keeps


@dataclass(frozen=True, eq=False)
class WorstRows(NodeRows):
    """Rows with the deviations and the slopes over the wrench at which they are evaluated.

    Attributes:
        theta: (rows, size).
        weights: (rows, 6), slopes over the wrench.
    """

    theta: np.ndarray = field(default_factory=lambda: np.empty(0))
    weights: np.ndarray = field(default_factory=lambda: np.empty(0))


class WithinLimit(AskedLimit):
    """A number that a motion keeps at the worst of the uncertainty."""

    scenario = WITHIN

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return bool(asked.tolerance.given)

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        return self.within(worst_of_sampled(at, self.asked.tolerance))

    def within(self, found: WithinTolerance) -> list[Worst]:
        """Of a motion at the worst of an uncertainty."""
        raise NotImplementedError

    def _of(self, worst: WorstInstant) -> Worst:
        return self.found(worst.value if worst.bound is None else worst.bound, worst.time, worst.how)


class WorstCaseLimit(StateLimit, WithinLimit):
    """What both have in common: rows are functions of the state, sloped as at the worst deviations."""

    of_contacts = True
    node_kinds = (ORDINARY, DEVIATING)
    smallest_step, largest_step = 1e-4, 0.02
    rows_first = True
    unit = 1.0

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self.cases = worst_case_of(robot, asked.tolerance)
        self._theta: np.ndarray | None = None  # (N, width, size) of the nodes of a program

    def _refusal(
        self, what: str, value: float, at: Instants, theta: np.ndarray, kept: Callable[[WorstCase], bool]
    ) -> str:
        own = self.asked.tolerance
        rest = why_not(own, AT_REST, lambda tolerance: kept(self.cases.within(tolerance)))
        words = self.cases.deviations.words(theta)
        found = f"within the uncertainty {what} reaches {value:.4g} at rest ({words}): {rest}"
        return f"{found} (--tolerance none plans for the nominal model)"

    def use(self, at: Instants) -> np.ndarray:
        return np.max(self.uses(at), axis=1, initial=-np.inf)

    def near(self, at: Instants, share: float) -> np.ndarray:
        return ~(self.uses(at) < share)

    def chosen(self, at: Instants) -> WorstCaseLimit:
        """With the deviations that are worst there."""
        other = copy(self)
        other._theta = self._worst_theta(at)
        return other

    def _worst_theta(self, at: Instants) -> np.ndarray:
        """(N, width, size)."""
        raise NotImplementedError

    def _rows(self, at: RowNodes, nodes: np.ndarray, places: np.ndarray, found: WorstDeviations) -> WorstRows:
        weights = found.slopes / self.unit
        slopes = self.cases.deviations.state_slopes(at.s[nodes], found.theta, weights)[0]
        bends = np.empty(0) if found.bends is None else found.bends / self.unit
        return WorstRows(
            *(at, nodes, places, found.values / self.unit, slopes, found.theta, weights), bends=bends
        )

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(rows, WorstRows)
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        at, weights = rows.at.s[rows.nodes[some]], on[some, None] * rows.weights[some]
        deviations, theta = self.cases.deviations, rows.theta[some]
        found = deviations.state_curvature(at, theta, weights)[0]
        if rows.bends.size:
            every = np.tile(np.eye(6), (len(some), 1))
            slopes = deviations.state_slopes(np.repeat(at, 6, axis=0), np.repeat(theta, 6, axis=0), every)[0]
            slopes = slopes.reshape(len(some), 6, at.shape[1])
            bent = np.matmul(on[some, None, None] * rows.bends[some], slopes)
            found = found + np.matmul(slopes.transpose(0, 2, 1), bent)
        return some, found


class WorstTorqueLimit(WithinLimit):
    """Torques within the uncertainty; programs know those of the world as described, and are tightened."""

    name, result, setting = "torque within tolerance", *[TORQUE_WITHIN] * 2
    smallest_step, largest_step = 1e-3, 0.05

    def within(self, found: WithinTolerance) -> list[Worst]:
        worst = found.torque
        return [self.found(worst.value, worst.time, f"joint {worst.joint}")]

    def inner(self, asked: Limits) -> Limits:
        return asked

    def tightened(self, asked: Limits, excess: float) -> Limits:
        step = min(max(excess, self.smallest_step), self.largest_step)
        return replace(asked, torque_ratio=max(asked.torque_ratio - step, asked.torque_ratio / 2))


class WorstTipOverLimit(WorstCaseLimit):
    """Least moments about the tipping axes."""

    name, result, setting = "tip-over within tolerance", TIP_WITHIN, TIP_WITHIN

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self.width = self.cases.axes
        self.unit = 2 * (self.cases.reference or 1.0)
        self._least = self.cases.reference * (1 / self.number - 1)  # N m

    def within(self, found: WithinTolerance) -> list[Worst]:
        return [] if found.tip is None else [self._of(found.tip)]

    def kept(self, at: Instants) -> bool:
        return bool(np.all(self.cases.estimated_moments(at.s) >= self._least))

    def refusals(self, at: Instants) -> list[str]:
        if not self.width:
            return []
        axis = int(np.argmin(self.cases.all_moments(at.s)[0]))
        found = self.cases.moments(at.s, np.array([axis]))
        if found.values[0] >= self._least:
            return []

        def kept(cases: WorstCase) -> bool:
            return bool(np.all(cases.all_moments(at.s) >= self._least))

        value = float(self.cases.tip_ratio(found.values)[0])
        return [self._refusal("tip-over GN", value, at, found.theta[0], kept)]

    def path_excess(self, at: Instants) -> float:
        if not self.width:
            return -np.inf
        missing = self._least - float(np.min(self.cases.estimated_moments(at.s)))
        return missing / self.cases.reference + PATH_MARGIN

    def uses(self, at: Instants) -> np.ndarray:
        room = ROOM * (self.cases.reference or 1.0)
        return 1 + (self._least - self.cases.estimated_moments(at.s)) / room

    def _worst_theta(self, at: Instants) -> np.ndarray:
        count, axes = len(at), self.width
        rows, axis = np.repeat(np.arange(count), axes), np.tile(np.arange(axes), count)
        return self.cases.moments(at.s[rows], axis).theta.reshape(count, axes, -1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(self.width, self._least / self.unit), np.full(self.width, np.inf)

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        theta = None if self._theta is None else self._theta[i, k]
        return self._rows(at, i, k, self.cases.moments(at.s[i], k, theta))


class WorstSlipLimit(WorstCaseLimit):
    """Greatest slip reserve GT."""

    name, result, setting = "slip within tolerance", SLIP_WITHIN, SLIP_WITHIN
    width = 1

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self._smooth, self._most = self.cases.smooth(self.number)

    def within(self, found: WithinTolerance) -> list[Worst]:
        return [self._of(found.slip)]

    def kept(self, at: Instants) -> bool:
        return bool(np.all(self._smooth.slip(at.s).values <= self._most))

    def refusals(self, at: Instants) -> list[str]:
        if self.cases.keeps_slip(at.s, self.number):
            return []
        found = self.cases.slip(at.s, starts=9)
        if found.values[0] <= self.number:
            return []

        def kept(cases: WorstCase) -> bool:
            return cases.keeps_slip(at.s, self.number) or bool(
                np.all(cases.slip(at.s, starts=9).values <= self.number)
            )

        return [self._refusal("slip GT", float(found.values[0]), at, found.theta[0], kept)]

    def uses(self, at: Instants) -> np.ndarray:
        return self._smooth.estimated_slip(at.s)[:, None] / self._most

    def _worst_theta(self, at: Instants) -> np.ndarray:
        return self._smooth.slip(at.s).theta[:, None]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([-np.inf]), np.array([self._most])

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        theta = None if self._theta is None else self._theta[i, k]
        return self._rows(at, i, k, self._smooth.slip(at.s[i], theta=theta))


def left_at_rest(robot: StandingMechanism, tolerance: Uncertainty, rest: np.ndarray) -> float:
    """Share of the least moment about a tipping axis that a tolerance leaves in postures (k, n) at rest."""
    cases = worst_case_of(robot, tolerance)
    if not cases.axes:
        return 1.0
    s = _at_rest(robot, rest)
    least, plain = (float(own.all_moments(s).min()) for own in (cases, cases.within(Uncertainty())))
    return least / plain


def as_described(robot: StandingMechanism, asked: Limits, rest: np.ndarray, jumps: bool = True) -> Limits:
    """Limits without a tolerance, tighter, so that motions of the world as described have about its room.

    What a tolerance costs is taken as at rest where it is worst. A jump from a moment M
    about a tipping axis leads to M' >= kappa / (1 + kappa) M if that with its overshoot, M' + kappa (M' - M),
    is to vanish at most; M is the least at rest.

    Args:
        robot: whose.
        asked: of it.
        rest: (k, n) postures at rest.
        jumps: accelerations jump.
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
    """States (k, 3 n) of postures (k, n) from start to goal at rest; with what acts there, if that varies."""
    still = np.zeros_like(rest)
    ends = [robot.resting(share).process_at_rest for share in np.linspace(0, 1, len(rest))]
    return np.hstack([rest, still, still, *([np.array(ends)] if robot.varying is not None else [])])
