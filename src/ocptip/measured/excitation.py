"""Motions from which an arm's parameters can be identified, and during which its base stands.

Every joint swings by a short Fourier series under a window that begins and ends at rest in the start. Of all
series that keep the limits of the task at some instants (contacts, clearance, torques, joints), the search
takes the one whose regressor of base parameters and frictions has the minimum condition number: random
series, made smaller where they break a limit, then random steps of single joints from the best. Rows are
scaled by the torque limits of joints (noise is a share of them), columns by their size at random states
within the joints' limits. The check decides in the end, within the tolerance of the task if it has one; what
it refuses is made slower and smaller.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ocptip.basics.errors import PlanningError, positive_number
from ocptip.measured.links import base_parameters, friction_columns, random_states, torque_columns
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.task import MotionTask
from ocptip.numerics.threads import one_thread
from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants
from ocptip.standing.tolerance import NONE
from ocptip.trajectories.trajectory import Trajectory

_WAVES = 4
_RANDOM, _HALVINGS = 40, 5
_SHARE = 0.9  # of all limits in the search
_FARTHEST = np.pi / 2  # rad, m: swing of a joint without near limits
_FULL = 0.5  # s to full speed, of joints without limit of acceleration
_INSTANTS, _RATE = 100, 20.0  # of the search; 1/s, of the samples
_SLOWER, _SMALLER = (1.0, 1.5, 2.0), (1.0, 0.8, 0.6, 0.4, 0.2)
_BROKEN = 1e6  # value of a series that breaks limits, and more


@dataclass(frozen=True, eq=False)
class Excitation:
    """A motion for identification.

    Attributes:
        motion: from and to the start of the task.
        check: of it; verified.
        condition: number of the scaled regressor along it.
        random: the same of the random series that kept the limits, their median; infinite if none did.
        slower, smaller: factors by which the check had it slowed down and made smaller.
    """

    motion: Trajectory
    check: MotionCheck
    condition: float
    random: float
    slower: float
    smaller: float


@one_thread
def excite(task: MotionTask, *, duration: float = 10.0, seed: int = 0, steps: int = 400) -> Excitation:
    """Find one.

    Args:
        task: robot, start and limits; its goal does not count.
        duration: s, before it is slowed down.
        seed: of the random series.
        steps: from the best of them.

    Raises:
        InputError: no arm, or the duration is no time.
        PlanningError: no such motion keeps the limits.
    """
    Robot.of(task.robot, f"motions for identification are for arms, not for a {task.robot.kind}")
    T, rng = positive_number("duration", duration), np.random.default_rng(seed)
    search = SeriesSearch(task, T)
    shape = task.robot.n, 2 * _WAVES + 1
    tried = [search.allowed(rng.normal(size=shape)) for _ in range(_RANDOM)]
    values = [value for _, value in tried]
    kept = [value for value in values if value < _BROKEN]
    best, least = tried[int(np.argmin(values))]
    step = 0.3
    for _ in range(steps):
        candidate = best.copy()
        candidate[rng.integers(len(candidate))] += step * np.abs(best).mean() * rng.normal(size=shape[1])
        if (value := search(candidate, least)) < least:
            best, least, step = candidate, value, min(1.5 * step, 1.0)
        else:
            step = max(0.95 * step, 0.02)
    for motion, slower, smaller in _tamed(search.start, best, T):
        check = check_motion(task.robot, motion, replace(task.limits, tolerance=NONE))
        if check.verified and task.limits.tolerance.given:
            check = check_motion(task.robot, motion, task.limits)
        if check.verified:
            random = float(np.median(kept)) if kept else float("inf")
            return Excitation(motion, check, search.condition(motion), random, slower, smaller)
    raise PlanningError(
        f"no motion about the start keeps the limits, even {_SLOWER[-1]:g} times as slow and "
        f"{_SMALLER[-1]:g} as large; choose a start that stands with more margin"
    )


def _tamed(start: np.ndarray, series: np.ndarray, T: float) -> Iterator[tuple[Trajectory, float, float]]:
    """The motion, then slower and smaller ones, with both factors."""
    for smaller in _SMALLER:
        for slower in _SLOWER:
            times = np.linspace(0.0, T, int(np.ceil(_RATE * T * slower)) + 1)
            q, qd, qdd = _curves(smaller * series, times, T)
            yield (
                Trajectory.from_points(slower * times, start + q, qd / slower, qdd / slower**2),
                slower,
                smaller,
            )


def _curves(series: np.ndarray, times: np.ndarray, T: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, n) each: angles from the start, speeds and accelerations of series (n, 1 + 2 waves)."""
    x = 2 * np.pi * times[:, None] / T
    k, one = np.arange(1, _WAVES + 1), np.ones_like(x)
    f = np.hstack([one, np.sin(k * x), np.cos(k * x)])
    f1 = np.hstack([0 * one, k * np.cos(k * x), -k * np.sin(k * x)])
    f2 = np.hstack([0 * one, -(k**2) * np.sin(k * x), -(k**2) * np.cos(k * x)])
    c, s = np.cos(x), np.sin(x)
    w, w1, w2 = (1 - c) ** 2 / 4, (1 - c) * s / 2, (s**2 + c - c**2) / 2  # window and its slopes
    rate = 2 * np.pi / T
    parts = w * f, rate * (w1 * f + w * f1), rate**2 * (w2 * f + 2 * w1 * f1 + w * f2)
    return tuple(part @ series.T for part in parts)  # pyright: ignore[reportReturnType]


class SeriesSearch:
    """Value of series of a robot: the condition number where limits are kept, else above `_BROKEN`."""

    def __init__(self, task: MotionTask, T: float) -> None:
        robot = self.robot = Robot.of(task.robot)
        self.bare, self.limits, self.T = robot.arm.with_payload(None), task.limits, T
        self.start, self.times = np.asarray(task.start), np.linspace(0.0, T, _INSTANTS)
        limits = robot.limits
        low = np.maximum(limits.angle_min, self.start - _FARTHEST)
        high = np.minimum(limits.angle_max, self.start + _FARTHEST)
        self.way = np.maximum(np.minimum(high - self.start, self.start - low), 1e-3)
        speed = np.where(np.isfinite(limits.speed), limits.speed, self.way)
        change = np.where(np.isfinite(limits.acceleration), limits.acceleration, speed / _FULL)
        self.most = self.way, speed, change
        q, qd, qdd = random_states(self.bare)
        loads = torque_columns(self.bare, robot.support.gravity, q, qd, qdd)
        self.independent = base_parameters(np.vstack(list(loads))).independent
        self.noise = np.where(np.isfinite(limits.torque), limits.torque, 1.0)
        qd, qdd = (values / np.abs(values).max() * most for values, most in ((qd, speed), (qdd, change)))
        size = np.sqrt(np.mean(self._rows(q, qd, qdd) ** 2, axis=0))
        self.size = np.where(size > 0, size, 1.0)

    def allowed(self, series: np.ndarray) -> tuple[np.ndarray, float]:
        """The series as large as joints allow, or halved until all limits are kept, and its value."""
        largest = (np.abs(x).max(axis=0) for x in _curves(series, self.times, self.T))
        ratios = [most / np.maximum(x, 1e-300) for most, x in zip(self.most, largest, strict=True)]
        series = series * (_SHARE * np.min(ratios, axis=0))[:, None]
        value = self(series)
        for _ in range(_HALVINGS):
            if value < _BROKEN:
                break
            series = 0.5 * series
            value = self(series)
        return series, value

    def __call__(self, series: np.ndarray, least: float = _BROKEN) -> float:
        """Value of a series; its condition number, whatever it breaks, where that is not below the minimum so
        far.
        """
        q, qd, qdd = _curves(series, self.times, self.T)
        use = [np.max(np.abs(x) / most) for x, most in zip((qd, qdd), self.most[1:], strict=True)]
        outside = np.max(np.abs(q) / self.way)
        excess = max([*use, outside]) / _SHARE - 1
        if excess > 0:
            return _BROKEN * (100 + excess)
        q = self.start + q
        if (condition := self._condition(q, qd, qdd)) >= least:
            return condition
        for left, share in self._shares(Instants.of_states(self.robot, q, qd, qdd, self.times)):
            if not share <= 1:
                return _BROKEN * (10 * left + np.fmin(share, 9.0))
        return condition

    def _shares(self, instants: Instants) -> Iterator[tuple[int, float]]:
        """How much of each limit is used, cheap ones first; before each how many are left."""
        gap = np.min(self.robot.collision.least(instants.angles))
        yield 3, 1 + (self.limits.clearance - gap) / _SHARE
        torques = np.max(np.abs(instants.torques) / self.robot.limits.torque)
        yield 2, torques / (_SHARE * self.limits.torque_ratio)
        yield 1, np.max(instants.tip.GN) / (_SHARE * self.limits.GN)
        yield 0, np.max(instants.slip.GT) / (_SHARE * self.limits.GT)

    def condition(self, motion: Trajectory) -> float:
        """Condition number of a motion."""
        return self._condition(*motion.states(np.linspace(0.0, motion.end, 4 * _INSTANTS)))

    def _rows(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        links = torque_columns(self.bare, self.robot.support.gravity, q, qd, qdd)[:, :, self.independent]
        rows = np.concatenate([links, friction_columns(qd)], axis=2) / self.noise[:, None]
        return np.vstack(list(rows))

    def _condition(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> float:
        return float(min(np.linalg.cond(self._rows(q, qd, qdd) / self.size), 0.9 * _BROKEN))
