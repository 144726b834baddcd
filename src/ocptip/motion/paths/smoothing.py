"""Makes a path among obstacles shorter and smoother, and keeps its clearance.

Corners of straight lines are the variables. The cost is quadratic: speeds and accelerations along the lines,
each joint relative to its maximum speed. Distances near the path are linear rows, renewed after each step. A
step counts only if all lines are proved to be clear. So the result is as safe as the path that was given.
"""

from __future__ import annotations

import time

import clarabel
import numpy as np

from ocptip.motion.paths.search import EXTRA, AllowedLines, joint_bounds, rounded
from ocptip.motion.task import MotionTask
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.path_fit import FittedPath

_LINES = 16, 32, 64  # that replace the path: the first number with which all are clear
_BEND = 0.2  # weight of accelerations relative to speeds, times the square of the path's length
_SHARES = np.array([0.25, 0.5, 0.75, 1.0])  # of each line: where distances have rows
_NEAR = 0.1  # m: distances beyond the clearance that have rows
_SPARE = 1e-3  # m: the rows ask for more than the clearance, which changes between them
_LARGEST, _SMALLEST = 0.2, 0.01  # rad or m: largest change of a corner in one step; below, no more steps
_STEPS, _GAIN = 25, 1e-3  # steps at most; share of the cost by which one has to be better to go on


def smoothed_path(task: MotionTask, path: JointPath, *, deadline: float = np.inf) -> FittedPath | None:
    """A path with the same ends that costs less; None: this search has none.

    Args:
        task: of the motion.
        path: that keeps the clearance.
        deadline: of `time.perf_counter`, s, after which no further step begins.
    """
    for extra in (EXTRA, 0.0):
        lines = AllowedLines(task, extra)
        for count in _LINES:
            corners = path.at(np.linspace(0, 1, count + 1))[0]
            if lines.all_clear(corners):
                shorter = _shortened(task, corners, lines, deadline)
                return None if shorter is None or lines.broken(shorter) else rounded(shorter, lines)
    return None


def _shortened(
    task: MotionTask, corners: np.ndarray, lines: AllowedLines, deadline: float
) -> np.ndarray | None:
    """Corners (N, n) of lines that are clear and cost less than those given; None: no step does."""
    cost = _Cost(task, corners)
    low, high = np.array(list(joint_bounds(task, corners))).T
    largest, value, moved = _LARGEST, cost.of(corners), False
    for _ in range(_STEPS):
        if largest < _SMALLEST or time.perf_counter() > deadline:
            break
        rows, right = _rows(task, corners, lines.clearance + _SPARE)
        inner = corners[1:-1]
        lowest = np.minimum(np.maximum(low - inner, -largest), 0.0).ravel()
        highest = np.maximum(np.minimum(high - inner, largest), 0.0).ravel()
        step = cost.step(corners, rows, right, lowest, highest)
        if step is None:
            break
        other = corners.copy()
        other[1:-1] += step
        gain = 1 - cost.of(other) / value
        if not lines.all_clear(other):
            largest *= 0.5
            continue
        if gain > 0:
            corners, value, moved = other, cost.of(other), True
        if gain < _GAIN:
            break
    return corners if moved else None


class _Cost:
    """The cost of corners, x' P x / 2 by joint, with shares of the time as the given lines have them."""

    def __init__(self, task: MotionTask, corners: np.ndarray) -> None:
        speed = np.where(np.isfinite(task.robot.limits.speed), task.robot.limits.speed, 1.0)
        self._weights = 1 / speed**2
        h = np.linalg.norm(np.diff(corners, axis=0) / speed, axis=1)
        h /= np.sum(h)
        count = len(corners)
        rates = np.diff(np.eye(count), axis=0) / h[:, None]
        bends = np.diff(rates, axis=0) / np.sqrt(0.5 * (h[1:] + h[:-1]))[:, None]
        self._matrix = rates.T @ (h[:, None] * rates) + _BEND * bends.T @ bends

    def of(self, corners: np.ndarray) -> float:
        """The cost of corners (N, n)."""
        return float(np.einsum("ij,ik,kj,j", corners, self._matrix, corners, self._weights))

    def step(
        self, corners: np.ndarray, rows: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> np.ndarray | None:
        """The change (N - 2, n) of minimum cost with rows @ change >= right, low and high; None: none."""
        quadratic = np.kron(self._matrix[1:-1, 1:-1], np.diag(self._weights))
        linear = ((self._matrix @ corners)[1:-1] * self._weights).ravel()
        one = np.eye(len(linear))
        bounds = np.concatenate([-right, -low, high])
        cones = [clarabel.NonnegativeConeT(len(bounds))]
        every = np.vstack([-rows, -one, one])
        result = solve_cones(linear, every, bounds, cones, quiet_settings(), np.triu(quadratic))
        if str(result.status) not in USABLE:
            return None
        return np.array(result.x).reshape(-1, corners.shape[1])


def _rows(task: MotionTask, corners: np.ndarray, clearance: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (r, (N - 2) n) and (r,) of what is near: rows @ change >= right keeps the clearance, nearly.

    What is nearer already, as ends may be, comes no nearer.
    """
    collision, n = task.robot.collision, corners.shape[1]
    line = np.repeat(np.arange(len(corners) - 1), len(_SHARES))
    share = np.tile(_SHARES, len(corners) - 1)
    q = corners[line] + share[:, None] * np.diff(corners, axis=0)[line]
    states, pairs = np.nonzero(collision.gaps(q, clearance + _NEAR) < clearance + _NEAR)
    if not len(states):
        return np.zeros((0, (len(corners) - 2) * n)), np.zeros(0)
    gaps, slopes = collision.slopes(q, states, pairs, once=True)
    rows = np.zeros((len(states), len(corners), n))
    every = np.arange(len(states))
    rows[every, line[states]] += (1 - share[states])[:, None] * slopes
    rows[every, line[states] + 1] += share[states][:, None] * slopes
    return rows[:, 1:-1].reshape(len(states), -1), np.minimum(clearance - gaps, 0.0)
