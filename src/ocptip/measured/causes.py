"""Possible causes of deviations from the nominal robot, and the effect of each on the signals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from ocptip.measured.clocks import FOLLOWING
from ocptip.measured.prediction import Elasticity, Predictor, State
from ocptip.measured.recording import ANGLE, GRIPPER, POWER, SPEED, TORQUE, WRENCH, Signal
from ocptip.measured.signals import noise_of

CLOCK = 0
"""Number of the cause that is no cause: all signals are later than is thought."""

_LAGS = {TORQUE: "torques", WRENCH: "force-torque sensor", POWER: "power"}


@dataclass(frozen=True)
class Possible:
    """Something that may be different.

    Attributes:
        kind, name, unit: see `signals.Finding`.
        scale: unit per SI unit.
    """

    kind: str
    name: str
    unit: str
    scale: float = 1.0


def of_motion(predictor: Predictor, signals: Sequence[Signal]) -> list[Possible]:
    """Possible causes that angles, or speeds, and the gripper may show."""
    robot = predictor.robot
    results = [Possible("clock", "clock", "ms", 1e3)]
    results += [Possible("delay", f"delay of {name}", "ms", 1e3) for name in robot.names]
    scales = [("mdeg/Nm", 180e3 / np.pi) if unit == "rad" else ("mm/N", 1e3) for unit in robot.units]
    for where in ("", ", not seen by its encoder"):
        results += [
            Possible("elasticity", f"elasticity of {name}{where}", *scale)
            for name, scale in zip(robot.names, scales, strict=True)
        ]
    results += [Possible("elasticity", f"damping of {name}", "%", 100.0) for name in robot.names]
    for one in signals:
        unit = ("mm", 1e3) if one.kind == GRIPPER or robot.units[one.index] == "m" else ("deg", 180 / np.pi)
        results.append(Possible("zero", f"{one.name} shifted", unit[0] + "/s" * (one.kind == SPEED), unit[1]))
    return results


def columns_of_motion(
    predictor: Predictor,
    signals: Sequence[Signal],
    k: int,
    state: State,
    bent: np.ndarray,
    damped: np.ndarray,
) -> np.ndarray:
    """(N, K) what each cause of `of_motion` changes in signal k.

    `bent` and `damped` (N, n, n): what bends of joints, and dampings of their springs, change in all.
    """
    one, n = signals[k], predictor.robot.n
    delays, seen, beyond, damping = joint_columns(n)
    values = np.zeros((len(state.q), 1 + 4 * n + len(signals)))
    if one.kind == GRIPPER:
        J = predictor.gripper(state.q)[1][:, one.index]
        late = -J * state.qd
        bends, rates = (np.einsum("ni,nij->nj", J, part) for part in (bent, damped))
        values[:, beyond] = bends
    else:
        late = -(state.qd if one.kind == ANGLE else state.qdd) * (np.arange(n) == one.index)
        bends, rates = ((one.kind == ANGLE) * part[:, one.index] for part in (bent, damped))
    values[:, CLOCK] = late.sum(axis=1)
    values[:, delays], values[:, seen], values[:, damping] = late, bends, rates
    values[:, 1 + 4 * n + k] = 1.0
    return values


def joint_columns(n: int) -> np.ndarray:
    """(4, n) numbers of joints' delays, springs that encoders see, others, and dampings among `of_motion`."""
    return 1 + np.arange(4 * n).reshape(4, n)


def of_loads(predictor: Predictor, signals: Sequence[Signal]) -> list[Possible]:
    """Possible causes that torques, force-torque sensor and power may show."""
    robot, links = predictor.robot, range(1, predictor.robot.arm.links + 1)
    results = [Possible("clock", "clock", "ms", 1e3)]
    results += [Possible("mass", f"mass of link {k}", "%", 100.0) for k in links]
    results += [
        Possible("centre of mass", f"centre of mass of link {k}, {x}", "mm", 1e3)
        for k in links
        for x in "xyz"
    ]
    results.append(Possible("mass", "mass at the TCP", "kg"))
    for word in ("Coulomb", "viscous"):
        for name, unit, rate in zip(robot.names, robot.motor_units, robot.units, strict=True):
            per = f" s/{rate}" if word == "viscous" else ""
            results.append(Possible("friction", f"{word} friction of {name}", f"{unit}{per}"))
    results += [
        Possible("losses", f"friction of {name} in its power", unit)
        for name, unit in zip(robot.names, robot.motor_units, strict=True)
    ]
    results += [Possible("delay", f"delay of {name}", "ms", 1e3) for name in _LAGS.values()]
    results += [Possible("zero", f"{one.name} shifted", _unit(predictor, one)) for one in signals]
    return results


def _unit(predictor: Predictor, one: Signal) -> str:
    if one.kind == TORQUE:
        return predictor.robot.motor_units[one.index]
    return "W" if one.kind == POWER else "N" if one.index < 3 else "N m"


def lag_column(predictor: Predictor, kind: str) -> int:
    """Number of the delay of a kind of signals among `of_loads`."""
    return 1 + (4 * predictor.robot.arm.links + 1) + 3 * predictor.robot.n + list(_LAGS).index(kind)


def friction_columns(predictor: Predictor) -> slice:
    """Numbers of Coulomb, then viscous frictions among `of_loads`."""
    first = mass_columns(predictor).stop
    return slice(first, first + 2 * predictor.robot.n)


def mass_columns(predictor: Predictor) -> slice:
    """Numbers of masses and centres of mass among `of_loads`."""
    return slice(1, 2 + 4 * predictor.robot.arm.links)


def columns_of_loads(
    predictor: Predictor, signals: Sequence[Signal], k: int, state: State, later: np.ndarray
) -> np.ndarray:
    """(N, K) what each cause of `of_loads` changes in signal k; `later` (N,) is minus its slope over time."""
    one, n, links = signals[k], predictor.robot.n, predictor.robot.arm.links
    first = 2 + 4 * links  # of the frictions
    values = np.zeros((len(state.q), first + 3 * n + len(_LAGS) + len(signals)))
    turning = np.sign(state.drives)
    if one.kind == TORQUE:
        values[:, mass_columns(predictor)] = state.slopes[:, one.index]
        values[:, first + one.index] = turning[:, one.index]
        values[:, first + n + one.index] = state.drives[:, one.index]
    elif one.kind == WRENCH:
        values[:, mass_columns(predictor)] = state.slopes[:, n + one.index]
    else:
        drives = np.arange(n) if one.index == 0 else np.array([one.index - 1])
        slopes = predictor.power_slopes(state)[:, drives]
        values[:, mass_columns(predictor)] = np.einsum("nj,njk->nk", slopes, state.slopes[:, drives])
        values[:, first + 2 * n + drives] = slopes * turning[:, drives]
        measured = np.array([s.index for s in signals if s.kind == TORQUE], dtype=int)
        rubs = np.isin(drives, measured)  # what torques show is what drives deliver
        values[:, first + drives[rubs]] = (slopes * turning[:, drives])[:, rubs]
        values[:, first + n + drives[rubs]] = (slopes * state.drives[:, drives])[:, rubs]
    values[:, CLOCK] = values[:, lag_column(predictor, one.kind)] = later
    values[:, first + 3 * n + len(_LAGS) + k] = 1.0
    return values


def moving(signals: Sequence[Signal]) -> list[Signal]:
    """Those of the motion: angles, or speeds where there are none, and the gripper."""
    angles = [one for one in signals if one.kind == ANGLE]
    known = {one.index for one in angles}
    speeds = [one for one in signals if one.kind == SPEED and one.index not in known]
    return [*angles, *speeds, *(one for one in signals if one.kind == GRIPPER)]


def loaded(signals: Sequence[Signal]) -> list[Signal]:
    """Those of loads; powers of single drives where there is no total."""
    total = any(one.kind == POWER and one.index == 0 for one in signals)
    return [
        one for one in signals if one.kind in _LAGS and not (one.kind == POWER and total and one.index > 0)
    ]


assert set(_LAGS) <= set(FOLLOWING)


_FACTORS = np.geomspace(0.4, 2.5, 37)  # of the bend: 2.5 % of a frequency each
_TIMES = 2  # that each spring is tried
_DAMPING = 1e-3, 1.0
_MOST = 40  # evaluations of the fit of all
DELAY, BEND, DAMP = "delay", "bend", "damping"
"""What `Loose` is about."""


@dataclass(frozen=True, eq=False)
class Swinging:
    """The signals that springs have to explain.

    Attributes:
        predictor: of the robot.
        signals: angles and gripper; others do not count.
        kept: of each signal (N,), True where samples count.
        times: (N,), s, of the motion.
        delays, changes: as for `Predictor.swing`.
        free: of each signal (N, K), what other causes change, whose size is free.
    """

    predictor: Predictor
    signals: Sequence[Signal]
    kept: Sequence[np.ndarray]
    times: np.ndarray
    delays: np.ndarray
    changes: np.ndarray
    free: Sequence[np.ndarray]

    def fitted(self, elastic: Elasticity) -> Elasticity:
        """Springs with bends and dampings of least squares; those that are stiff stay so."""
        springs = np.flatnonzero(elastic.bends > 0)
        left = self._left(elastic, springs)
        x = np.concatenate([np.log(elastic.bends[springs]), elastic.damping[springs]])
        for _ in range(_TIMES):
            before = x.copy()
            for k in range(len(springs)):
                tried = [x + np.log(factor) * (np.arange(len(x)) == k) for factor in _FACTORS]
                x = min([x, *tried], key=lambda values: float(np.sum(left(values) ** 2)))
            if np.array_equal(x, before):
                break
        low = np.concatenate([x[: len(springs)] - 1.0, np.full(len(springs), 0.5 * _DAMPING[0])])
        high = np.concatenate([x[: len(springs)] + 1.0, np.full(len(springs), 1.01 * _DAMPING[1])])
        x = optimize.least_squares(left, x, bounds=(low, high), x_scale=0.05, max_nfev=_MOST).x
        return self._with(elastic, springs, x)

    def _with(self, elastic: Elasticity, springs: np.ndarray, x: np.ndarray) -> Elasticity:
        bends, damping = elastic.bends.copy(), elastic.damping.copy()
        bends[springs] = np.exp(x[: len(springs)])
        damping[springs] = np.clip(x[len(springs) :], *_DAMPING)
        return replace(elastic, bends=bends, damping=damping)

    def _left(self, elastic: Elasticity, springs: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """A function of logarithms of bends, and dampings: what is left over, in units of noise."""
        q = self.predictor.states(self.times, self.delays)[0]
        place, slopes = self.predictor.gripper(q)
        rows, targets, columns = [], [], []
        for one, kept, others in zip(self.signals, self.kept, self.free, strict=True):
            if one.kind not in (ANGLE, GRIPPER):
                continue
            shown = np.where(elastic.seen, np.eye(len(elastic.bends))[one.index], 0.0) + np.zeros_like(q)
            planned, turn = (
                (q[:, one.index], shown) if one.kind == ANGLE else (place[:, one.index], slopes[:, one.index])
            )
            away = np.where(kept, one.values - planned, 0.0)
            noise = max(noise_of(away, kept), 1e-12)
            targets.append(away[kept] / noise)
            rows.append((kept, turn[kept] / noise))
            columns.append(others[kept] / noise)
        target, free = np.concatenate(targets), np.vstack(columns)
        size = np.linalg.norm(free, axis=0)
        singular = np.linalg.svd(free[:, size > 0] / size[size > 0], full_matrices=False)
        basis = singular[0][:, singular[1] > 1e-8]

        def left(x: np.ndarray) -> np.ndarray:
            now = self._with(elastic, springs, x)
            bent = self.predictor.swing(self.times, self.delays, self.changes, now)[0]
            away = target - np.concatenate([np.sum(turn * bent[kept], axis=1) for kept, turn in rows])
            return away - basis @ (basis.T @ away)

        return left


@dataclass(frozen=True)
class Loose:
    """A delay, a bend or a damping of a joint, which is known with a standard error.

    Attributes:
        kind: `DELAY`, `BEND` or `DAMP`.
        joint: its number, from 0.
        error: s, rad / N m or a ratio.
    """

    kind: str
    joint: int
    error: float


def loosened(
    delays: np.ndarray, elastic: Elasticity, loose: Sequence[Loose], off: Sequence[float]
) -> tuple[np.ndarray, Elasticity]:
    """Delays and springs with the given differences."""
    delays, bends, damping = delays.copy(), elastic.bends.copy(), elastic.damping.copy()
    for one, more in zip(loose, off, strict=True):
        {DELAY: delays, BEND: bends, DAMP: damping}[one.kind][one.joint] += more
    return delays, Elasticity(np.maximum(bends, 0.0), np.clip(damping, *_DAMPING), elastic.seen)
