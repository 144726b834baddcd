"""A recording beside the plan that was run: errors, and what would explain them.

Two regressions, see `regression`: of joint angles and the gripper on delays, elasticity and zeros; then of
torques, force-torque sensor and power, predicted for the motion with the estimated delays and bends, on
masses, centres of mass, friction, losses, delays and zeros. Both are repeated at their result, so that causes
that act together are right to second order as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from ocptip.basics.errors import InputError, share_of_one
from ocptip.measured import causes
from ocptip.measured.base_motion import base_motion
from ocptip.measured.causes import BEND, CLOCK, DAMP, DELAY, Loose, Possible, Swinging, loosened
from ocptip.measured.clocks import AROUND, FOLLOWING, distance, find_clock
from ocptip.measured.comparison import Comparison, beside, energies, foot_forces, gripper_deviation
from ocptip.measured.prediction import DAMPING, Elasticity, KnownRobot, Predictor, State
from ocptip.measured.recording import ANGLE, KINDS, POWER, SPEED, TORQUE, WRENCH, Recording, Signal
from ocptip.measured.regression import Block, Explanation, explain, whitened
from ocptip.measured.signals import (
    Finding,
    absent,
    clipped,
    dead,
    lost_contacts,
    noisy,
    resolution,
    uncovered,
)
from ocptip.numerics.threads import one_thread

LEVEL = 1e-3
"""Probability of any finding in the recording of the nominal robot."""

_TESTS = 5  # that share the level: motion, loads, clipped, noisy, base
_ROUNDS, _MOST_ROUNDS = 3, 12
_NEAR = 0.05  # of standard errors: sizes of springs that change by less are found
_ENOUGH = 20  # samples of loads per possible cause: with fewer, chance is taken for causes
_LIGHTEST = -0.9  # relative change of masses: more is no body
_TINY = 0.25  # samples: step of slopes over time
_GROUPS = (ANGLE, SPEED, TORQUE, WRENCH)


class _Comparing:
    """The work, in its order."""

    def __init__(self, recording: Recording, predictor: Predictor, level: float, same_clock: bool) -> None:
        self.recording, self.predictor, self.same_clock = recording, predictor, same_clock
        self.level = share_of_one("level", level) / _TESTS
        self.findings: list[Finding] = absent(recording, predictor.robot.n)
        self.kept: dict[str, np.ndarray] = {}
        self.left: dict[str, np.ndarray] = {}
        self.unexplained: dict[str, float] = {}
        self.taken = 0  # causes in the motion
        begin, self.single = find_clock(recording, predictor)
        n, links = predictor.robot.n, predictor.robot.arm.links
        self.joint_columns = causes.joint_columns(n)
        self.known = KnownRobot(
            0.0 if same_clock else begin, np.inf, np.zeros(n), Elasticity.none(n),
            np.zeros(2 + 4 * links + 3 * n + 3), np.zeros(0), np.zeros(0),
        )  # fmt: skip
        self.nominal = self._nominal()
        self._check_signals()

    def _nominal(self) -> State:
        n, links = self.predictor.robot.n, self.predictor.robot.arm.links
        times = self.recording.times - self.known.clock
        return self.predictor.state(times, np.zeros(n), np.zeros(4 * links + 1))

    def _check_signals(self) -> None:
        """Leave out samples that say nothing, and name them."""
        following = [one for one in self.recording.signals if one.kind in FOLLOWING]
        for one in self.recording.signals:
            self.kept[one.name] = np.isfinite(one.values)
        for one in following:
            predicted = self._predicted_by_itself(one)
            if dead(one, predicted):
                self.kept[one.name] = np.zeros(len(one.values), dtype=bool)
                self.findings.append(
                    Finding("dead", f"{one.name} dead", text="never changes though it should")
                )
                continue
            cut = clipped(one, predicted, self.level / (2 * len(following)))
            if cut.any():
                self.kept[one.name] &= ~cut
                text = f"{cut.sum()} samples stay at {one.values[cut][0]:.6g} though more is expected"
                share = 100 * cut.sum() / len(cut)
                self.findings.append(Finding("clipped", f"{one.name} clipped", share, unit="%", text=text))

    def _predicted_by_itself(self, one: Signal) -> np.ndarray:
        """Prediction of the plan, by the clock of this signal."""
        predicted = self.predictor.signal(one.kind, one.index, self.nominal)
        if not np.isfinite(self.single.get(one.name, np.nan)):
            return predicted
        lag = self.single[one.name] - self.known.clock
        return np.interp(self.recording.times - lag, self.recording.times, predicted)

    def usable(self, signals: Sequence[Signal]) -> list[Signal]:
        """Those that have samples left."""
        return [one for one in signals if self.kept[one.name].sum() >= 0.25 * len(one.values)]

    def explain(self) -> None:
        """Motion, then loads; both again where springs swing, which depends on masses."""
        before = list(self.findings)
        self.explain_motion()
        self.explain_loads()
        if (self.known.elastic.bends > 0).any():
            self.findings = before
            self.explain_motion()
            self.explain_loads()

    # --- the motion ---------------------------------------------------------------------------------------

    def explain_motion(self) -> None:
        """Delays, elasticity and zeros from angles and the gripper.

        Causes are taken in one by one, springs fitted in between: beside a spring that swings with a wrong
        frequency much else seems to be wrong.
        """
        signals = self.usable(causes.moving(self.recording.signals))
        if not signals:
            return
        possible = causes.of_motion(self.predictor, signals)
        result, (late, _, _, damping) = self.known, self.joint_columns
        theta = result.motion if len(result.motion) else np.zeros(len(possible))
        explained, blocks, tuned, first = None, [], set[int](), 1 + self.taken
        for turn in range(_MOST_ROUNDS):
            before = theta
            inside = np.zeros(len(possible))
            inside[late] = result.delays
            inside[CLOCK] = result.clock if self.same_clock else 0.0
            springs = np.flatnonzero(result.elastic.bends > 0)
            damped = damping[springs].tolist()
            inside[self._bent_columns()[springs]] = result.elastic.bends[springs]
            inside[damped] = result.elastic.damping[springs]
            blocks = self._motion_blocks(signals, inside)
            always = damped if self.same_clock else [CLOCK, *damped]
            white = [whitened(block) for block in blocks]
            explained = explain(white, self.level, always=always, most=first + turn)
            theta = explained.values
            result.clock = theta[CLOCK] if self.same_clock else result.clock + theta[CLOCK]
            result.delays = theta[late]
            result.elastic = self._springs(theta)
            chosen = {cause.index for cause in explained.causes}
            swings = (result.elastic.bends > 0).any()
            if swings and chosen != tuned:
                theta, tuned = self._tuned(signals, blocks, theta, chosen), chosen
            near = np.abs(theta - before)[1:] <= _NEAR * np.where(theta[1:] != 0, explained.errors[1:], 0.0)
            full = len(chosen) == first + turn  # perhaps there is more
            if turn >= _ROUNDS - 1 and not full and (not swings or near.all()):
                break
        assert explained is not None
        self.taken = len(explained.causes)
        result.error, result.motion, result.errors = float(explained.errors[CLOCK]), theta, explained.errors
        self._note("motion", signals, possible, blocks, explained)

    def _tuned(
        self, signals: Sequence[Signal], blocks: Sequence[Block], theta: np.ndarray, chosen: set[int]
    ) -> np.ndarray:
        """Sizes of `causes.of_motion` with springs fitted from a distant start, which become the result."""
        result, (_, *of_springs) = self.known, self.joint_columns
        others = chosen if self.same_clock else chosen | {CLOCK}
        free = sorted(others - set(np.ravel(of_springs).tolist()))
        columns, kept = [block.columns[:, free] for block in blocks], [block.kept for block in blocks]
        times = self.recording.times - result.clock
        swinging = Swinging(self.predictor, signals, kept, times, result.delays, self._changes(), columns)
        result.elastic = swinging.fitted(result.elastic)
        theta, springs = theta.copy(), np.flatnonzero(result.elastic.bends > 0)
        theta[self._bent_columns()[springs]] = result.elastic.bends[springs]
        theta[of_springs[-1][springs]] = result.elastic.damping[springs]
        return theta

    def _springs(self, theta: np.ndarray) -> Elasticity:
        """Springs of the joints by sizes of `causes.of_motion`; dampings stay below critical damping."""
        _, seen, beyond, damping = theta[self.joint_columns]
        damping = np.clip(np.where(damping == 0, DAMPING, damping), 1e-3, 1.0)
        return Elasticity(seen + beyond, damping, seen != 0)

    def _bent_columns(self, other: bool = False) -> np.ndarray:
        """(n,) of `causes.of_motion`: springs of joints as encoders see them; those of the other kind."""
        _, seen, beyond, _ = self.joint_columns
        return np.where(self.known.elastic.seen != other, seen, beyond)

    def _motion_blocks(self, signals: Sequence[Signal], inside: np.ndarray) -> list[Block]:
        """Residuals of the motion, to which what the prediction holds already is added again."""
        state, blocks = self.state(), []
        springs = self.known.elastic.bends != 0
        bent, damped = self._bending(state)
        for k, one in enumerate(signals):
            columns = causes.columns_of_motion(self.predictor, signals, k, state, bent, damped)
            columns[:, self._bent_columns(other=True)[springs]] = 0.0  # one side of the encoder, not both
            kept = self.kept[one.name] & self._away(self.known.clock, one.kind == SPEED)
            values = one.values - self.predictor.signal(one.kind, one.index, state) + columns @ inside
            blocks.append(Block(values, columns, kept, resolution(one.values)))
        return blocks

    def _bending(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """(N, n, n) each: what bends and dampings of joints change in all joints."""
        result, n = self.known, self.predictor.robot.n
        times, changes = self.recording.times - result.clock, self._changes()
        bent = -state.torques[:, :, None] * np.eye(n)
        damped = np.zeros_like(bent)
        springs = np.flatnonzero(result.elastic.bends > 0)
        if not springs.size:
            return bent, damped
        first = self.predictor.swing(times, result.delays, changes, result.elastic)[0]
        for j in springs:
            for into, name in ((bent, "bends"), (damped, "damping")):
                values = getattr(result.elastic, name).copy()
                step = 1e-4 * values[j]
                values[j] += step
                other = replace(result.elastic, **{name: values})
                into[:, :, j] = (self.predictor.swing(times, result.delays, changes, other)[0] - first) / step
        return bent, damped

    def _away(self, clock: float, wanted: bool = True) -> np.ndarray:
        """(N,) True away from acceleration steps, if that is wanted."""
        times = self.recording.times
        if not wanted:
            return np.ones(len(times), dtype=bool)
        events = clock + self.predictor.events(self.known.delays)
        return distance(times, events) > AROUND * self.recording.period

    # --- the loads ----------------------------------------------------------------------------------------

    def state(self, lag: float = 0.0, shift: float = 0.0) -> State:
        """The robot with all causes in the result, as a delayed signal sees it."""
        result, predictor = self.known, self.predictor
        times = self.recording.times - result.clock - lag + shift
        return predictor.state(times, result.delays, self._changes(), result.elastic)

    def _changes(self) -> np.ndarray:
        """Masses and centres of mass, see `robots.dynamics.mass_sensitivities`."""
        changes = self.known.loads[causes.mass_columns(self.predictor)].copy()
        links = self.predictor.robot.arm.links
        changes[:links] = np.maximum(changes[:links], _LIGHTEST)
        return changes

    def explain_loads(self) -> None:
        """Masses, centres of mass, friction, losses, delays and zeros from torques, sensor and power."""
        signals = self.usable(causes.loaded(self.recording.signals))
        if not signals:
            return
        predictor, result, first = self.predictor, self.known, self.known.clock
        possible = causes.of_loads(predictor, signals)
        theta = np.zeros(len(possible))
        before = slice(causes.mass_columns(predictor).start, causes.friction_columns(predictor).stop)
        theta[before] = result.loads[before]
        for kind in {one.kind for one in signals}:
            values = [
                self.single[one.name] for one in signals if one.kind == kind and one.name in self.single
            ]
            if np.isfinite(values).any():
                theta[causes.lag_column(predictor, kind)] = float(np.nanmedian(values)) - result.clock
        loose = self._loose()
        K = len(possible)
        prior, known = np.zeros(K + len(loose)), np.isfinite(result.error)
        if known:
            prior[CLOCK] = 1 / max(result.error, 1e-9) ** 2
        prior[K:] = [1 / max(one.error, 1e-12) ** 2 for one in loose]
        always = [CLOCK] if known or not self.same_clock else []
        always += range(K, K + len(loose))
        begun, off = (result.delays, result.elastic), np.zeros(len(loose))
        explained, blocks = None, []
        for _ in range(_ROUNDS + bool(loose)):
            inside = np.concatenate([theta, off])
            inside[CLOCK] = result.clock - first
            blocks = self._load_blocks(signals, inside, loose)
            white = [whitened(block) for block in blocks]
            explained = explain(white, self.level, always=always, prior=prior)
            theta, off = explained.values[:K], explained.values[K:]
            result.clock = first + theta[CLOCK]
            result.loads = theta
            result.delays, result.elastic = loosened(*begun, loose, off.tolist())
        assert explained is not None
        if not np.isfinite(result.error):
            result.error = float(explained.errors[CLOCK])
        self._note("loads", signals, possible, blocks, explained)

    def _loose(self) -> list[Loose]:
        """Delays and springs that angles and gripper have shown: loads may correct them."""
        result, (late, _, _, damping) = self.known, self.joint_columns
        places = [(DELAY, j, late) for j in np.flatnonzero(result.delays).tolist()]
        for j in np.flatnonzero(result.elastic.bends > 0).tolist():
            places += [(BEND, j, self._bent_columns()), (DAMP, j, damping)]
        errors = [(kind, j, float(result.errors[columns[j]])) for kind, j, columns in places]
        return [Loose(*one) for one in errors if one[-1] > 0]

    def _either(self, lag: float, loose: Sequence[Loose]) -> list[tuple[float, State, State]]:
        """Per delay and spring a step, and the robot with half of it less and more, see `state`."""
        result, times = self.known, self.recording.times - self.known.clock - lag
        most, ends = {DELAY: _TINY * self.recording.period, BEND: 1e-7, DAMP: 1e-3}, []
        for one in loose:
            step = min(0.1 * one.error, most[one.kind])
            given = [loosened(result.delays, result.elastic, [one], [sign * step]) for sign in (-0.5, 0.5)]
            states = [
                self.predictor.state(times, delays, self._changes(), elastic, slopes=False)
                for delays, elastic in given
            ]
            ends.append((step, *states))
        return ends

    def _load_blocks(
        self, signals: Sequence[Signal], inside: np.ndarray, loose: Sequence[Loose]
    ) -> list[Block]:
        """Residuals of loads, to which what the prediction holds already is added again."""
        predictor, blocks = self.predictor, []
        masses, step = causes.mass_columns(predictor), _TINY * self.recording.period
        rubbing = causes.friction_columns(predictor)
        for kind in (TORQUE, WRENCH, POWER):
            members = [k for k, one in enumerate(signals) if one.kind == kind]
            if not members:
                continue
            lag = inside[causes.lag_column(predictor, kind)]
            held = np.zeros(len(inside))
            held[masses], held[rubbing], held[CLOCK] = inside[masses], inside[rubbing], inside[CLOCK]
            held[len(held) - len(loose) :] = inside[len(held) - len(loose) :]
            held[causes.lag_column(predictor, kind)] = lag
            state, before, after = self._rubbing([self.state(lag, shift) for shift in (0.0, -step, step)])
            away, either = self._away(self.known.clock + lag), self._either(lag, loose)
            for k in members:
                one = signals[k]
                ends = [predictor.signal(kind, one.index, instant) for instant in (before, after)]
                later = -(ends[1] - ends[0]) / (2 * step)
                columns = causes.columns_of_loads(predictor, signals, k, state, later)
                columns = np.column_stack([columns, *self._slopes(kind, one.index, either)])
                values = one.values - predictor.signal(kind, one.index, state) + columns @ held
                blocks.append(Block(values, columns, self.kept[one.name] & away, resolution(one.values)))
        counts = [int(block.kept.sum()) for block in blocks]
        seen = int(np.any([block.columns.any(axis=0) for block in blocks], axis=0).sum())
        if not all(counts) or sum(counts) < _ENOUGH * seen:
            raise InputError(
                f"recording: {sum(counts)} samples of loads away from acceleration steps are too few "
                f"for {seen} possible causes; record more often, or leave out torques, sensor and power"
            )
        return blocks

    def _slopes(
        self, kind: str, index: int, either: Sequence[tuple[float, State, State]]
    ) -> list[np.ndarray]:
        """(N,) each: of a signal over delays and springs."""
        signal = self.predictor.signal
        return [(signal(kind, index, more) - signal(kind, index, less)) / step for step, less, more in either]

    def _rubbing(self, states: Sequence[State]) -> list[State]:
        """These states with the estimated friction in torques; the first state's drives give its sign."""
        columns, drives = causes.friction_columns(self.predictor), states[0].drives
        coulomb, viscous = np.split(self.known.loads[columns], 2)
        friction = coulomb * np.sign(drives) + viscous * drives
        return [replace(state, torques=state.torques + friction) for state in states]

    # --- results ------------------------------------------------------------------------------------------

    def _note(
        self, what: str, signals: Sequence[Signal], possible: Sequence[Possible], blocks: Sequence[Block],
        explained: Explanation,
    ) -> None:  # fmt: skip
        self.unexplained[what] = explained.unexplained
        ordered = signals
        if what == "loads":
            ordered = [one for kind in (TORQUE, WRENCH, POWER) for one in signals if one.kind == kind]
        for one, block in zip(ordered, blocks, strict=True):
            left = block.values - block.columns @ explained.values
            self.left[one.name] = np.where(block.kept, left, np.nan)
        width = float(stats.t.isf(0.025, explained.freedom))
        for cause in explained.causes:
            named = possible[cause.index]
            if cause.index == CLOCK:
                named = Possible("delay", "delay of all signals", named.unit, named.scale)
            self.findings.append(
                Finding(
                    named.kind, named.name, named.scale * cause.value, named.scale * width * cause.error,
                    named.unit, cause.explained, tuple(possible[k].name for k in cause.rivals if k != CLOCK),
                )
            )  # fmt: skip

    def result(self) -> Comparison:
        """All of it."""
        recording, predictor, outcome = self.recording, self.predictor, self.known
        nominal = self.nominal = self._nominal()
        times, compared = recording.times - outcome.clock, []
        for one in recording.signals:
            if one.kind in FOLLOWING:
                lag = self.single.get(one.name, np.nan) - outcome.clock
                still = self._away(outcome.clock, one.kind in (SPEED, TORQUE, WRENCH, POWER))
                predicted = predictor.signal(one.kind, one.index, nominal)
                compared.append(beside(one, predicted, times, lag, still, self.left.get(one.name)))
        noises = {one.name: one.noise for one in compared}
        compared += foot_forces(recording, predictor, nominal, times, self._away(outcome.clock))
        groups = [[one.name for one in recording.of(kind)] for kind in _GROUPS]
        count = max(sum(len(group) for group in groups), 1)
        self.findings += noisy(noises, groups, self.level / count)
        contacts = np.array([contact.position for contact in predictor.robot.support.contacts])
        self.findings += uncovered(recording, outcome.clock, outcome.clock + predictor.motion.end)
        end = outcome.clock + predictor.motion.end + float(np.max(outcome.delays, initial=0.0))
        moved = base_motion(recording, contacts, outcome.clock, end, self.level)
        if moved is not None:
            self.findings += moved.findings
        losses = tuple(one.after(outcome.clock) for one in recording.contact_losses)
        self.findings += lost_contacts(losses)
        there = {one.kind for one in recording.signals}
        return Comparison(
            times, outcome.clock, 1.96 * outcome.error, tuple(compared),
            gripper_deviation(recording, predictor, nominal.q),
            energies(compared, times, predictor.motion.end),
            moved, losses, tuple(self.findings), tuple(kind for kind in KINDS if kind not in there),
            recording.unknown, self.unexplained, self.level * _TESTS, recording.thinned,
        )  # fmt: skip


@one_thread
def compare(
    recording: Recording, predictor: Predictor, *, level: float = LEVEL, same_clock: bool = False
) -> Comparison:
    """Compare a recording with the plan that was run.

    Args:
        recording: of it.
        predictor: of what it should show.
        level: probability of any finding in a recording of the nominal robot; each test has a share, and each
            cause in a regression a share of that.
        same_clock: time 0 of the recording is the begin of the motion; else that is what most joints say.

    Raises:
        InputError: no signal follows the motion.
    """
    work = _Comparing(recording, predictor, level, same_clock)
    if not work.usable([one for one in recording.signals if one.kind in FOLLOWING]):
        raise InputError("recording: no signal is left that could be compared")
    work.explain()
    return work.result()
