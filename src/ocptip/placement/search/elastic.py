"""The placement of minimum violation: constraints are relaxed, and the sum of their violations becomes
minimal.

Each kind of constraint of each load case has one violation e >= 0 in units of 0.1 m, 0.2 rad or its limit.
The sum of violations is small where few constraints are broken, so that its minimum names those that fail:
all others hold there.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ocptip.placement.limits.arm import JointAngles, Reach
from ocptip.placement.limits.limit import ANGLE_UNIT
from ocptip.placement.search.program import PlacementProgram


class ElasticProgram:
    """A program of constraints alone, with violations as further variables.

    Where the gripper pose cannot be reached, joint limits are rows that can also be relaxed; the bounds of
    the terrain stay.

    Args:
        program: made with `criteria=False`.
        reachable: the gripper pose and the joint limits are kept.
    """

    def __init__(self, program: PlacementProgram, reachable: bool = False) -> None:
        self.program = program
        lower, upper = program.bounds
        names = [
            (label.kind, "" if limit.together else label.name)
            for limit, blocks in program.limits
            for block in blocks
            for label in block.labels
        ]
        low, high = (bound.copy() for bound in program.x_bounds)
        self._joints = np.concatenate(program.q)
        angle_low, angle_high = low[self._joints], high[self._joints]
        low[self._joints] = np.where(np.isfinite(angle_low), angle_low - np.pi, -np.inf)
        high[self._joints] = np.where(np.isfinite(angle_high), angle_high + np.pi, np.inf)
        names += [(JointAngles.kind, "")] * len(self._joints)
        self.groups = list(dict.fromkeys(names))
        which = np.array([self.groups.index(name) for name in names])
        lower = np.concatenate([lower, angle_low / ANGLE_UNIT])
        upper = np.concatenate([upper, angle_high / ANGLE_UNIT])
        self._below, self._above = np.flatnonzero(np.isfinite(lower)), np.flatnonzero(np.isfinite(upper))
        nx, count = program.size, len(self.groups)
        self._extra = np.zeros((len(self._below) + len(self._above), count))
        if reachable:
            firm = np.isin([kind for kind, _ in self.groups], (Reach.kind, JointAngles.kind))
        else:
            firm = np.zeros(count, dtype=bool)
        self._extra[np.arange(len(self._below)), which[self._below]] = 1.0
        self._extra[len(self._below) + np.arange(len(self._above)), which[self._above]] = -1.0
        self.bounds = (
            np.concatenate([lower[self._below], np.full(len(self._above), -np.inf)]),
            np.concatenate([np.full(len(self._below), np.inf), upper[self._above]]),
        )
        self.x_bounds = np.r_[low, np.zeros(count)], np.r_[high, np.where(firm, 0.0, np.inf)]
        self._limits, self._which, self.size = (lower, upper), which, nx + count

    def start(self, x: np.ndarray) -> np.ndarray:
        """x with violations just as large as needed."""
        rows = self._stacked(self.program.values(x)[1], x)
        short = np.maximum(np.maximum(self._limits[0] - rows, rows - self._limits[1]), 0)
        violations = np.zeros(len(self.groups))
        np.maximum.at(violations, self._which, short)
        return np.concatenate([x, violations])

    def _stacked(self, rows: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.concatenate([rows, x[self._joints] / ANGLE_UNIT])

    def values(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Sum of violations, and all rows."""
        inner, violations = x[: self.program.size], x[self.program.size :]
        rows = self._stacked(self.program.values(inner)[1], inner)
        both = np.concatenate([rows[self._below], rows[self._above]])
        return float(np.sum(violations)), both + self._extra @ violations

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """(nx,)."""
        return np.r_[np.zeros(self.program.size), np.ones(len(self.groups))]

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """(rows, nx)."""
        slope = self.program.jacobian(x[: self.program.size])
        angles = np.zeros((len(self._joints), self.program.size))
        angles[np.arange(len(self._joints)), self._joints] = 1 / ANGLE_UNIT
        slope = np.concatenate([slope, angles])
        both = np.concatenate([slope[self._below], slope[self._above]])
        return np.hstack([both, self._extra])

    @cached_property
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the Jacobian (rows, nx) and the Hessian (nx, nx) may differ from zero."""
        inner, bends = self.program.pattern
        angles = np.zeros((len(self._joints), self.program.size), dtype=bool)
        angles[np.arange(len(self._joints)), self._joints] = True
        slopes = np.concatenate([inner, angles])
        both = np.concatenate([slopes[self._below], slopes[self._above]])
        result = np.zeros((self.size, self.size), dtype=bool)
        result[: len(bends), : len(bends)] = bends
        return np.hstack([both, self._extra != 0]), result

    def hessian(self, x: np.ndarray, sigma: float, multipliers: np.ndarray) -> np.ndarray:
        """(nx, nx)."""
        sums = np.zeros(len(self._which))
        sums[self._below] += multipliers[: len(self._below)]
        sums[self._above] += multipliers[len(self._below) :]
        size = self.program.size
        result = np.zeros((self.size, self.size))
        count = len(sums) - len(self._joints)
        result[:size, :size] = self.program.hessian(x[:size], 0.0, sums[:count])
        return result
