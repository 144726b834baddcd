"""Start and goal that may be any posture of a gripper pose: seven axes, symmetric grippers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as cs
import numpy as np

from ocptip.motion.planner.profiles import Layout
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.model import ArmModel

FOUND_MARGIN = float(np.deg2rad(2.0))
"""Distance from the angle limits that postures of poses keep where they can, rad."""


class FreeEnds:
    """Which ends of a motion are free, and what they have to fulfil.

    An end is free if the optimised joints have more angles than its pose has equations; the other joints keep
    the angles of the given posture.

    Args:
        arm: whose gripper; None for mechanisms without one.
        postures: start and goal (n,) at hand, rad (sliding joints: m).
        targets: poses they are postures of; None: of none, the angles are what is wanted.
        joints: optimised ones, 0-based.
        margin: rad, from the angle limits.
    """

    def __init__(
        self,
        arm: ArmModel | None,
        postures: tuple[np.ndarray, np.ndarray],
        targets: tuple[PoseTarget | None, PoseTarget | None],
        joints: Sequence[int],
        margin: float = 0.0,
    ) -> None:
        self._arm, self._postures, self._joints = arm, postures, list(joints)
        self._targets = [
            None
            if arm is None
            or target is None
            or len(joints) <= target.conditions
            or target.independent(arm) < target.conditions  # equations that no program can fulfil
            else target.nearest(arm, posture)
            for target, posture in zip(targets, postures, strict=True)
        ]
        self.free = self._targets[0] is not None, self._targets[1] is not None
        self._margin = max(margin, FOUND_MARGIN)

    def __bool__(self) -> bool:
        return any(self.free)

    def values(self, layout: Layout, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Start and goal (n,) of variables x."""
        start, goal = (posture.copy() for posture in self._postures)
        for posture, place, free in zip((start, goal), (layout.start, layout.goal), self.free, strict=True):
            if free:
                posture[self._joints] = x[place]
        return start, goal

    def expressions(self, layout: Layout, x: cs.SX) -> tuple[cs.SX, cs.SX]:
        """Start and goal (n,) as CasADi expressions of the variables x."""
        start, goal = (cs.SX(posture) for posture in self._postures)
        for posture, place, free in zip((start, goal), (layout.start, layout.goal), self.free, strict=True):
            if free:
                posture[self._joints] = x[place]
        return start, goal

    def equations(self, layout: Layout, x: cs.SX) -> Iterator[cs.SX]:
        """Expressions that have to be zero."""
        for target, posture in zip(self._targets, self.expressions(layout, x), strict=True):
            if target is not None:
                assert self._arm is not None
                yield target.equations(self._arm, posture)

    def bound(self, layout: Layout, lower: np.ndarray, upper: np.ndarray) -> None:
        """Set bounds of the free angles: the limits with the margin, or where the posture at hand is."""
        if not self:
            return
        assert self._arm is not None
        limits, joints = self._arm.limits, self._joints
        margin = np.where(self._arm.prismatic, 0.0, self._margin)
        for posture, place, free in zip(self._postures, (layout.start, layout.goal), self.free, strict=True):
            if free:
                lower[place] = np.minimum(limits.angle_min + margin, posture)[joints]
                upper[place] = np.maximum(limits.angle_max - margin, posture)[joints]

    def miss(self, start: np.ndarray, goal: np.ndarray) -> float:
        """By how much free ends miss their poses, m and rad."""
        results = [0.0]
        for target, posture in zip(self._targets, (start, goal), strict=True):
            if target is not None:
                assert self._arm is not None
                results.append(float(target.residuals(self._arm, posture[None])[0]))
        return max(results)
