"""Limits of the contacts while a motion is cancelled, in the worst case of an uncertainty.

Checks are those of `standing.within.cancelled`. Rows of a program are those of the worst state of the stop
that begins at a node, with the worst deviations. A joint may be delayed, or overshoot, at each step of its
acceleration: that of the motion, the beginning of the stop, the rest of the joint. Where a solve begins, it
is chosen which state that is, what the joints do then, their accelerations before a step of the motion, and
the deviations. So rows are smooth, with exact derivatives (the curvature of GT over the wrench is left out).
"""

from __future__ import annotations

import numpy as np

from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import ORDINARY, Sampled, Worst
from ocptip.standing.limit_kinds.stops import CancelLimit, StoppedLimit, cancel_of, worst_by_owner
from ocptip.standing.limit_kinds.worst_case import WorstCaseLimit
from ocptip.standing.limits import WITHIN_OF, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_cancel import CancelSlopes, StopStates, cancel_slopes, cancel_times
from ocptip.standing.stops.joint_stops import without_creep
from ocptip.standing.within.cancelled import worst_of_cancels
from ocptip.standing.within.in_motion import WithinTolerance
from ocptip.standing.within.worst_case import worst_case_of

_STEP = 1e-9  # s, or rad/s^2
_Chosen = tuple[np.ndarray, ...]
"""Sign, moves, weights, share, fixed, theta: see `CancelSlopes`."""


class WorstCancelLimit(StoppedLimit, WorstCaseLimit):
    """One quantity in cancelled motions within the uncertainty."""

    words = "{} in cancels within tolerance", "{}_cancel_worst_case"
    node_kinds: tuple[int, ...] = (ORDINARY,)

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return bool(asked.tolerance.given) and CancelLimit.wanted(robot, asked)

    def within(self, within_tolerance: WithinTolerance) -> list[Worst]:
        return []

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        robot, cancel = cancel_of(sampled.robot, self.asked)
        if (key := (cancel, self.interface)) not in sampled.memo:
            cases = worst_case_of(robot, self.asked.tolerance, self.interface)
            worst_instants = worst_of_cancels(cases, sampled.motion, cancel, cancel_times(sampled.motion))
            sampled.memo[key] = dict(zip(WITHIN_OF, worst_instants, strict=True))
        worst = sampled.memo[key][self.quantity.symbol]
        if worst is None:
            return []
        return [self.worst_value(worst.most, worst.time, worst.how)]

    def refusals(self, instants: Instants) -> list[str]:
        return []  # at rest nothing is cancelled

    # --- rows of a program --------------------------------------------------------------------------------

    @property
    def _slopes(self) -> CancelSlopes:
        robot, cancel = cancel_of(self.robot, self.asked)
        return cancel_slopes(robot, cancel.decelerations, self.cases.deviations)

    def _worst(self, s: np.ndarray, before: np.ndarray | None = None) -> tuple[np.ndarray, _Chosen]:
        """Values (N, width) at the worst of the stops that begin in states (N, 3 n), and what is chosen.

        Args:
            s: states.
            before: see `Instants.before`.
        """
        robot, cancel = cancel_of(self.robot, self.asked)
        (q, qd, qdd), acting, n = np.split(s[:, : 3 * robot.n], 3, axis=1), s[:, 3 * robot.n :], robot.n
        states = cancel.states(q, qd)
        options, parts = self._options(states, qd, qdd, cancel.rates(qd), qdd if before is None else before)
        badness, number = self.quantity.worst_of_options(self.cases, options, acting[states.owner])
        state = worst_by_owner(badness, states.owner, len(s))[1]
        number = number[state, np.arange(self.width)]  # (N, width, n)
        steps = state[:, :, None], np.arange(n), number
        sign = np.repeat(np.sign(without_creep(qd))[:, None], self.width, axis=1)
        share, fixed = np.moveaxis(parts[steps], -1, 0)
        chosen = sign, states.moves[state].astype(float), states.weights[state], share, fixed
        node, k = (part.ravel() for part in np.indices(state.shape))
        flat = tuple(part.reshape(len(node), n) for part in chosen)
        size = self.cases.deviations.size
        stopped = self._slopes.states(s[node], *flat, np.zeros((len(node), size)))
        late = options[steps][..., 3].reshape(len(node), n)
        theta = self.quantity.worst_within(self.cases, stopped, k, late)
        values = self.quantity.within(self._smooth, stopped, k, theta).values
        return values.reshape(state.shape), (*chosen, theta.reshape(*state.shape, size))

    def _options(
        self, stop_states: StopStates, qd: np.ndarray, qdd: np.ndarray, rates: np.ndarray, before: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What joints may do in states of stops, (M, n, K, 4), see `worst_options`; the share of the
        acceleration where the stop begins and what is added to it, (M, n, K, 2).

        They are on time; at a step of their acceleration within the delay before, delayed or overshooting.
        That step is that of the motion, that where the stop begins, both, or that where a joint rests.
        """
        owner, more, late = stop_states.owner, self.asked.tolerance.overshoot, self.asked.tolerance.late
        speeds = without_creep(qd)
        slower, rests = (-np.sign(speeds) * rates)[owner], (np.abs(speeds) / rates)[owner]
        begun, earlier, after = qdd[owner], before[owner], stop_states.after[:, None]
        soon = after <= late + _STEP
        starts, stepped = (soon & (np.abs(step) > _STEP) for step in (slower - begun, begun - earlier))
        ends = (speeds[owner] != 0) & ~stop_states.moves & (after <= rests + late + _STEP)
        none, one = np.zeros_like(slower), np.ones_like(slower)
        kinds = [
            (one > 0, none, np.where(stop_states.moves, slower, 0.0)),
            (starts & (late > 0), one, none),
            (starts & (more > 0), -more * one, (1 + more) * slower),
            (stepped & (late > 0), none, earlier),
            (stepped & (more > 0), (1 + more) * one, -more * earlier),
            (stepped & (more > 0), none, (1 + more) * slower - more * earlier),
            (ends & (late > 0), none, slower),
            (ends & (more > 0), none, -more * slower),
        ]
        given, share, fixed = (np.stack(part, axis=2) for part in zip(*kinds, strict=True))
        max_delay = np.zeros_like(share)
        since = after - np.where(stop_states.moves | (speeds[owner] == 0), 0.0, np.minimum(rests, after))
        max_delay[:, :, 0] = np.clip(since, 0.0, late)
        state = [np.repeat(part[:, :, None], len(kinds), axis=2) for part in (stop_states.q, stop_states.qd)]
        options = np.stack([*state, share * begun[:, :, None] + fixed, max_delay], axis=3)
        order = np.argsort(~given, axis=2, kind="stable")[..., None]
        options = np.where(given[..., None], options, np.nan)
        parts = np.stack([share, fixed], axis=3)
        return np.take_along_axis(options, order, axis=2), np.take_along_axis(parts, order, axis=2)

    def uses(self, instants: Instants) -> np.ndarray:
        key = self.name, self.asked.cancel, self.number
        if key not in instants.memo:
            beyond = (self._worst(instants.s, instants.before)[0] - self._bound) / self.quantity.unit
            instants.memo[key] = 1 + (-beyond if self.quantity.least else beyond)
        return instants.memo[key]

    def _choose(self, s: np.ndarray, before: np.ndarray | None = None) -> _Chosen:
        return self._worst(s, before)[1]

    def _values(self, s: np.ndarray, k: np.ndarray, chosen: _Chosen) -> tuple[np.ndarray, np.ndarray]:
        result = self.quantity.within(self._smooth, self._slopes.states(s, *chosen), k, chosen[-1])
        return result.values, result.slopes
