"""A recording beside the plan that was run: errors, and what would explain them.

Two regressions, see `regression`: of joint angles and the gripper on delays, elasticity and zeros; then of
torques, force-torque sensor and power, predicted for the motion with the delays and bends that were found, on
masses, centres of mass, friction, losses, delays and zeros. Both are repeated at what was found, so that
causes that act together are right to second order, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from ocptip.basics.errors import InputError, share_of_one
from ocptip.measured import causes
from ocptip.measured.base_motion import base_motion
from ocptip.measured.causes import CLOCK, Possible
from ocptip.measured.clocks import AROUND, FOLLOWING, distance, find_clock
from ocptip.measured.comparison import Compared, Comparison
from ocptip.measured.prediction import DAMPING, Elasticity, Predictor, State
from ocptip.measured.recording import ANGLE, GRIPPER, KINDS, POWER, SPEED, TORQUE, WRENCH, Recording, Signal
from ocptip.measured.regression import Block, Explanation, explain, whitened
from ocptip.measured.signals import Finding, absent, clipped, dead, noise_of, noisy, resolution

LEVEL = 1e-3
"""Probability of finding anything in the recording of a robot that is as described."""

_TESTS = 5  # that share the level: motion, loads, clipped, noisy, base
_ROUNDS, _MOST_ROUNDS = 3, 12
_NEAR = 0.05  # of standard errors: sizes of springs that change by less are found
_LIGHTEST = -0.9  # relative change of masses: more is no body
_DELAY, _BEND, _DAMPING = "delay", "bend", "damping"
_TINY = 0.25  # samples: step of slopes over time
_GROUPS = (ANGLE, SPEED, TORQUE, WRENCH)


@dataclass
class _Found:
    """What is known of a robot and of clocks so far.

    Attributes:
        clock: s.
        error: standard error of it; infinite: unknown.
        delays: (n,), s, of joints.
        elastic: springs of joints.
        loads: (K,) of `causes.of_loads`, and of `causes.of_motion`.
        motion: the same of `causes.of_motion`.
        errors: standard errors of these.
    """

    clock: float
    error: float
    delays: np.ndarray
    elastic: Elasticity
    loads: np.ndarray
    motion: np.ndarray
    errors: np.ndarray


@dataclass(frozen=True)
class _Loose:
    """A delay, a bend or a damping of a joint, which is known with a standard error."""

    kind: str
    joint: int
    error: float


def _loosened(
    delays: np.ndarray, elastic: Elasticity, loose: Sequence[_Loose], off: Sequence[float]
) -> tuple[np.ndarray, Elasticity]:
    """Delays and springs that differ by so much."""
    delays, bends, damping = delays.copy(), elastic.bends.copy(), elastic.damping.copy()
    for one, more in zip(loose, off, strict=True):
        {_DELAY: delays, _BEND: bends, _DAMPING: damping}[one.kind][one.joint] += more
    return delays, Elasticity(np.maximum(bends, 0.0), np.clip(damping, 1e-3, 1.0), elastic.seen)


class _Comparing:
    """The work, in its order."""

    def __init__(self, recording: Recording, predictor: Predictor, level: float, same_clock: bool) -> None:
        self.recording, self.predictor, self.same_clock = recording, predictor, same_clock
        self.level = share_of_one("level", level) / _TESTS
        self.findings: list[Finding] = absent(recording, predictor.robot.n)
        self.kept: dict[str, np.ndarray] = {}
        self.left: dict[str, np.ndarray] = {}
        self.unexplained: dict[str, float] = {}
        begin, self.single = find_clock(recording, predictor)
        n, links = predictor.robot.n, predictor.robot.arm.links
        self.found = _Found(
            0.0 if same_clock else begin, np.inf, np.zeros(n), Elasticity.none(n),
            np.zeros(2 + 4 * links + 3 * n + 3), np.zeros(0), np.zeros(0),
        )  # fmt: skip
        self.nominal = self._nominal()
        self._judge_signals()

    def _nominal(self, shift: float = 0.0) -> State:
        n, links = self.predictor.robot.n, self.predictor.robot.arm.links
        times = self.recording.times - self.found.clock + shift
        return self.predictor.state(times, np.zeros(n), np.zeros(4 * links + 1))

    def _judge_signals(self) -> None:
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
        """Of the plan, by the signal's own clock."""
        predicted = self.predictor.signal(one.kind, one.index, self.nominal)
        if not np.isfinite(self.single.get(one.name, np.nan)):
            return predicted
        lag = self.single[one.name] - self.found.clock
        return np.interp(self.recording.times - lag, self.recording.times, predicted)

    def usable(self, signals: Sequence[Signal]) -> list[Signal]:
        """Those that have samples left."""
        return [one for one in signals if self.kept[one.name].sum() >= 0.25 * len(one.values)]

    def explain(self) -> None:
        """Motion, then loads; both again where springs swing, which depends on masses."""
        before = list(self.findings)
        self.explain_motion()
        self.explain_loads()
        if (self.found.elastic.bends > 0).any():
            self.findings = before
            self.explain_motion()
            self.explain_loads()

    # --- the motion ---------------------------------------------------------------------------------------

    def explain_motion(self) -> None:
        """Delays, elasticity and zeros from angles and the gripper."""
        signals = self.usable(causes.moving(self.recording.signals))
        if not signals:
            return
        possible = causes.of_motion(self.predictor, signals)
        n, found = self.predictor.robot.n, self.found
        theta = found.motion if len(found.motion) else np.zeros(len(possible))
        explained, blocks = None, []
        for turn in range(_MOST_ROUNDS):
            before = theta
            inside = np.zeros(len(possible))
            inside[1 : 1 + n] = found.delays
            inside[CLOCK] = found.clock if self.same_clock else 0.0
            springs = found.elastic.bends > 0
            for first in (1 + n, 1 + 2 * n):  # seen by encoders, or not
                inside[first : first + n] = np.where(springs, theta[first : first + n], 0.0)
            inside[1 + 3 * n : 1 + 4 * n] = np.where(springs, found.elastic.damping, 0.0)
            blocks = self._motion_blocks(signals, inside)
            damped = [1 + 3 * n + int(j) for j in np.flatnonzero(springs)]
            explained, theta = self._explained(blocks, damped if self.same_clock else [CLOCK, *damped])
            found.clock = theta[CLOCK] if self.same_clock else found.clock + theta[CLOCK]
            found.delays = theta[1 : 1 + n]
            found.elastic = self._springs(theta)
            swings = (found.elastic.bends > 0).any()
            near = np.abs(theta - before)[1:] <= _NEAR * np.where(theta[1:] != 0, explained.errors[1:], 0.0)
            if turn >= _ROUNDS - 1 and (not swings or near.all()):
                break
        assert explained is not None
        found.error, found.motion, found.errors = float(explained.errors[CLOCK]), theta, explained.errors
        self._note("motion", signals, possible, blocks, explained)

    def _springs(self, theta: np.ndarray) -> Elasticity:
        """Of the joints, by sizes of `causes.of_motion`; dampings stay within what swings."""
        n = self.predictor.robot.n
        seen, beyond, damping = (theta[1 + k * n : 1 + (k + 1) * n] for k in (1, 2, 3))
        damping = np.clip(np.where(damping == 0, DAMPING, damping), 1e-3, 1.0)
        return Elasticity(seen + beyond, damping, seen != 0)

    def _motion_blocks(self, signals: Sequence[Signal], inside: np.ndarray) -> list[Block]:
        """Residuals of the motion, to which what the prediction holds already is added again."""
        state, blocks = self.state(), []
        elastic, n = self.found.elastic, self.predictor.robot.n
        bent, damped = self._bending(state)
        for k, one in enumerate(signals):
            columns = causes.columns_of_motion(self.predictor, signals, k, state, bent, damped)
            for j in np.flatnonzero(elastic.bends):  # in front of its encoder or behind it, not both
                columns[:, 1 + (2 if elastic.seen[j] else 1) * n + j] = 0.0
            kept = self.kept[one.name] & self._away(self.found.clock, one.kind == SPEED)
            values = one.values - self.predictor.signal(one.kind, one.index, state) + columns @ inside
            blocks.append(Block(values, columns, kept, resolution(one.values)))
        return blocks

    def _bending(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """(N, n, n) each: what bends and dampings of joints change in all joints."""
        found, n = self.found, self.predictor.robot.n
        times, changes = self.recording.times - found.clock, self._changes()
        bent = -state.torques[:, :, None] * np.eye(n)
        damped = np.zeros_like(bent)
        springs = np.flatnonzero(found.elastic.bends > 0)
        if not springs.size:
            return bent, damped
        first = self.predictor.swing(times, found.delays, changes, found.elastic)[0]
        for j in springs:
            for into, name in ((bent, "bends"), (damped, "damping")):
                values = getattr(found.elastic, name).copy()
                step = 1e-4 * values[j]
                values[j] += step
                other = replace(found.elastic, **{name: values})
                into[:, :, j] = (self.predictor.swing(times, found.delays, changes, other)[0] - first) / step
        return bent, damped

    def _explained(
        self, blocks: list[Block], always: Sequence[int], prior: np.ndarray | None = None
    ) -> tuple[Explanation, np.ndarray]:
        white = [whitened(block) for block in blocks]
        explained = explain(white, self.level, always=always, prior=prior)
        return explained, explained.values.copy()

    def _away(self, clock: float, wanted: bool = True) -> np.ndarray:
        """(N,) True away from instants at which accelerations jump, if that is wanted."""
        times = self.recording.times
        if not wanted:
            return np.ones(len(times), dtype=bool)
        events = clock + self.predictor.events(self.found.delays)
        return distance(times, events) > AROUND * self.recording.period

    # --- the loads ----------------------------------------------------------------------------------------

    def state(self, lag: float = 0.0, shift: float = 0.0) -> State:
        """The robot with all that was found, as a signal sees it that is late."""
        found, predictor = self.found, self.predictor
        times = self.recording.times - found.clock - lag + shift
        return predictor.state(times, found.delays, self._changes(), found.elastic)

    def _changes(self) -> np.ndarray:
        """Masses and centres of mass, see `robots.dynamics.mass_sensitivities`."""
        changes = self.found.loads[causes.mass_columns(self.predictor)].copy()
        links = self.predictor.robot.arm.links
        changes[:links] = np.maximum(changes[:links], _LIGHTEST)
        return changes

    def explain_loads(self) -> None:
        """Masses, centres of mass, friction, losses, delays and zeros from torques, sensor and power."""
        signals = self.usable(causes.loaded(self.recording.signals))
        if not signals:
            return
        predictor, found, first = self.predictor, self.found, self.found.clock
        possible = causes.of_loads(predictor, signals)
        theta = np.zeros(len(possible))
        before = slice(causes.mass_columns(predictor).start, causes.friction_columns(predictor).stop)
        theta[before] = found.loads[before]
        for kind in {one.kind for one in signals}:
            own = [self.single[one.name] for one in signals if one.kind == kind and one.name in self.single]
            if np.isfinite(own).any():
                theta[causes.lag_column(predictor, kind)] = float(np.nanmedian(own)) - found.clock
        loose = self._loose()
        K = len(possible)
        prior, known = np.zeros(K + len(loose)), np.isfinite(found.error)
        if known:
            prior[CLOCK] = 1 / max(found.error, 1e-9) ** 2
        prior[K:] = [1 / max(one.error, 1e-12) ** 2 for one in loose]
        always = [CLOCK] if known or not self.same_clock else []
        always += range(K, K + len(loose))
        begun, off = (found.delays, found.elastic), np.zeros(len(loose))
        explained, blocks = None, []
        for _ in range(_ROUNDS + bool(loose)):
            inside = np.concatenate([theta, off])
            inside[CLOCK] = found.clock - first
            blocks = self._load_blocks(signals, inside, loose)
            explained, every = self._explained(blocks, always, prior)
            theta, off = every[:K], every[K:]
            found.clock = first + theta[CLOCK]
            found.loads = theta
            found.delays, found.elastic = _loosened(*begun, loose, off.tolist())
        assert explained is not None
        if not np.isfinite(found.error):
            found.error = float(explained.errors[CLOCK])
        self._note("loads", signals, possible, blocks, explained)

    def _loose(self) -> list[_Loose]:
        """Delays and springs that angles and gripper have shown: what loads show of them, too, is free."""
        n, found = self.predictor.robot.n, self.found
        places = [(_DELAY, int(j), 1 + int(j)) for j in np.flatnonzero(found.delays)]
        for j in np.flatnonzero(found.elastic.bends > 0).tolist():
            places.append((_BEND, j, 1 + (1 if found.elastic.seen[j] else 2) * n + j))
            places.append((_DAMPING, j, 1 + 3 * n + j))
        return [_Loose(kind, j, float(found.errors[at])) for kind, j, at in places if found.errors[at] > 0]

    def _either(self, lag: float, loose: Sequence[_Loose]) -> list[tuple[float, State, State]]:
        """Of each delay and spring a step, and the robot with half of it less and more, as of `state`."""
        found, times = self.found, self.recording.times - self.found.clock - lag
        most, ends = {_DELAY: _TINY * self.recording.period, _BEND: 1e-7, _DAMPING: 1e-3}, []
        for one in loose:
            step = min(0.1 * one.error, most[one.kind])
            given = [_loosened(found.delays, found.elastic, [one], [sign * step]) for sign in (-0.5, 0.5)]
            states = [
                self.predictor.state(times, delays, self._changes(), elastic, slopes=False)
                for delays, elastic in given
            ]
            ends.append((step, *states))
        return ends

    def _load_blocks(
        self, signals: Sequence[Signal], inside: np.ndarray, loose: Sequence[_Loose]
    ) -> list[Block]:
        """Residuals of loads, to which what the prediction holds already is added again."""
        predictor, blocks = self.predictor, []
        masses, step = causes.mass_columns(predictor), _TINY * self.recording.period
        rubbing = causes.friction_columns(predictor)
        for kind in (TORQUE, WRENCH, POWER):
            own = [k for k, one in enumerate(signals) if one.kind == kind]
            if not own:
                continue
            lag = inside[causes.lag_column(predictor, kind)]
            held = np.zeros(len(inside))
            held[masses], held[rubbing], held[CLOCK] = inside[masses], inside[rubbing], inside[CLOCK]
            held[len(held) - len(loose) :] = inside[len(held) - len(loose) :]
            held[causes.lag_column(predictor, kind)] = lag
            state, before, after = self._rubbing([self.state(lag, shift) for shift in (0.0, -step, step)])
            away, either = self._away(self.found.clock + lag), self._either(lag, loose)
            for k in own:
                one = signals[k]
                ends = [predictor.signal(kind, one.index, at) for at in (before, after)]
                later = -(ends[1] - ends[0]) / (2 * step)
                columns = causes.columns_of_loads(predictor, signals, k, state, later)
                columns = np.column_stack([columns, *self._slopes(kind, one.index, either)])
                values = one.values - predictor.signal(kind, one.index, state) + columns @ held
                blocks.append(Block(values, columns, self.kept[one.name] & away, resolution(one.values)))
        return blocks

    def _slopes(
        self, kind: str, index: int, either: Sequence[tuple[float, State, State]]
    ) -> list[np.ndarray]:
        """(N,) each: of a signal over delays and springs."""
        at = self.predictor.signal
        return [(at(kind, index, more) - at(kind, index, less)) / step for step, less, more in either]

    def _rubbing(self, states: Sequence[State]) -> list[State]:
        """The same with the friction that was found in torques, as the first one's drives turn."""
        columns, drives = causes.friction_columns(self.predictor), states[0].drives
        coulomb, viscous = np.split(self.found.loads[columns], 2)
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
            own = possible[cause.index]
            if cause.index == CLOCK:
                own = Possible("delay", "delay of all signals", own.unit, own.scale)
            self.findings.append(
                Finding(
                    own.kind, own.name, own.scale * cause.value, own.scale * width * cause.error, own.unit,
                    cause.explained, tuple(possible[k].name for k in cause.rivals if k != CLOCK),
                )
            )  # fmt: skip

    def result(self) -> Comparison:
        """All of it."""
        recording, predictor, found = self.recording, self.predictor, self.found
        self.nominal = self._nominal()
        times = recording.times - found.clock
        compared = tuple(self._compared(one, times) for one in recording.signals if one.kind in FOLLOWING)
        noises = {one.name: one.noise for one in compared}
        groups = [[one.name for one in recording.of(kind)] for kind in _GROUPS]
        count = max(sum(len(group) for group in groups), 1)
        self.findings += noisy(noises, groups, self.level / count)
        contacts = np.array([contact.position for contact in predictor.robot.support.contacts])
        end = found.clock + predictor.motion.end + float(np.max(found.delays, initial=0.0))
        moved = base_motion(recording, contacts, found.clock, end, self.level)
        if moved is not None:
            self.findings += moved.findings
        there = {one.kind for one in recording.signals}
        return Comparison(
            times, found.clock, 1.96 * found.error, compared, self._gripper(), self._energy(compared, times),
            moved, tuple(self.findings), tuple(kind for kind in KINDS if kind not in there),
            recording.unknown, self.unexplained, self.level * _TESTS, recording.thinned,
        )  # fmt: skip

    def _compared(self, one: Signal, times: np.ndarray) -> Compared:
        predicted = self.predictor.signal(one.kind, one.index, self.nominal)
        away = one.values - predicted
        good = np.isfinite(away)
        looked = good & self._away(self.found.clock, one.kind in (SPEED, TORQUE, WRENCH, POWER))
        good = looked if looked.any() else good
        size = np.where(good, np.abs(away), -1.0)
        left = self.left.get(one.name)
        own = away if left is None else left
        return Compared(
            one.name, one.kind, one.index, one.values, predicted,
            self.single.get(one.name, np.nan) - self.found.clock,
            float(size.max()) if good.any() else float("nan"), float(times[np.argmax(size)]),
            float(np.sqrt(np.mean(away[good] ** 2))) if good.any() else float("nan"),
            float(np.ptp(predicted)), noise_of(np.nan_to_num(own), looked & np.isfinite(own)),
            float("nan") if left is None else float(np.sqrt(np.nanmean(left**2))),
        )  # fmt: skip

    def _gripper(self) -> np.ndarray | None:
        """(N,), m."""
        recording, predictor = self.recording, self.predictor
        measured, angles = recording.of(GRIPPER), recording.of(ANGLE)
        planned = predictor.gripper(self.nominal.q)[0]
        if len(measured) == 3:
            return np.linalg.norm(np.stack([one.values for one in measured], axis=1) - planned, axis=1)
        if len(angles) == predictor.robot.n:
            q = np.stack([one.values for one in angles], axis=1)
            good = np.isfinite(q).all(axis=1)
            found = np.full(len(q), np.nan)
            found[good] = np.linalg.norm(predictor.gripper(q[good])[0] - planned[good], axis=1)
            return found
        return None

    def _energy(self, compared: Sequence[Compared], times: np.ndarray) -> tuple[float, float] | None:
        """Of the motion, J, as far as it was recorded: both by the trapezoidal rule over the samples."""
        own = next((one for one in compared if one.kind == POWER and one.index == 0), None)
        if own is None:
            return None
        good = np.isfinite(own.measured) & (times >= 0) & (times <= self.predictor.motion.end)
        both = (own.measured[good], own.predicted[good])
        return float(np.trapezoid(both[0], times[good])), float(np.trapezoid(both[1], times[good]))


def compare(
    recording: Recording, predictor: Predictor, *, level: float = LEVEL, same_clock: bool = False
) -> Comparison:
    """Compare a recording with the plan that was run.

    Args:
        recording: of it.
        predictor: of what it should show.
        level: probability of any finding in a recording of a robot that is as described; each test has a
            share, and each cause in a regression a share of that.
        same_clock: time 0 of the recording is the begin of the motion; else that is what most joints say.

    Raises:
        InputError: no signal follows the motion.
    """
    work = _Comparing(recording, predictor, level, same_clock)
    if not work.usable([one for one in recording.signals if one.kind in FOLLOWING]):
        raise InputError("recording: no signal is left that could be compared")
    work.explain()
    return work.result()
