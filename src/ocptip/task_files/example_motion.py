"""Start and goal of an example motion for an arm: near zero, and clear of the arm and of the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ocptip.robots.collision.gaps import Collisions, random_postures
from ocptip.robots.collision.model import ShapeCollisions
from ocptip.robots.collision.shapes import ArmGeometry
from ocptip.robots.geometry import floor
from ocptip.robots.model import ArmModel

TURN, SLIDE = np.deg2rad(30), 0.1
"""How far joints move at most in the example, rad and m."""

_CLEARANCES = (0.03, 0.01, 0.003, 0.0)
"""m: the first that some motion keeps counts. Some arms have links that are always within 10 mm."""

_POSTURES, _STARTS, _STEPS = 300, 20, 16


@dataclass(frozen=True)
class ExampleMotion:
    """Two postures between which a straight motion of all joints is possible.

    Attributes:
        start, goal: (n,), rad or m.
        clear: m, by how much the straight motion is known to be clear of all; None: it was not checked;
            negative: no clear motion was found.
    """

    start: np.ndarray
    goal: np.ndarray
    clear: float | None

    @property
    def source(self) -> str:
        """What is known about collisions of the example, one sentence."""
        if self.clear is None:
            return "start and goal are an example, not checked for collisions"
        if self.clear < 0:
            return "start and goal are an example in which links overlap: no clear one was found"
        return f"start and goal are an example {1e3 * self.clear:.2g} mm clear of arm and ground"


def example_motion(arm: ArmModel, geometry: ArmGeometry | None, height: float) -> ExampleMotion:
    """A motion that starts as near to zero as collisions allow.

    Args:
        arm: not mounted.
        geometry: its collision geometry; None: nothing is checked.
        height: m, of the arm's base frame above the ground.
    """
    low, high = arm.limits.angle_min, arm.limits.angle_max
    zero = np.clip(np.zeros(arm.n), low, high)
    default = next(_goals(arm, zero))
    if geometry is None:
        return ExampleMotion(zero, default, None)
    mounted = replace(arm, geometry=geometry).mounted(np.array([0.0, 0.0, height]), np.eye(3))
    collisions = ShapeCollisions(mounted, [floor(0.0)])
    starts = _starts(arm, zero)
    gaps = collisions.least(starts)
    for clearance in _CLEARANCES:
        for start in starts[gaps >= clearance][:_STARTS]:
            for goal in _goals(arm, start):
                gap = _line_gap(collisions, start, goal)
                if gap >= clearance:
                    return ExampleMotion(start, goal, gap)
    return ExampleMotion(zero, default, -1.0)


def _starts(arm: ArmModel, zero: np.ndarray) -> np.ndarray:
    """Postures (N, n), zero first, then those nearest to it; in whole degrees and centimetres."""
    drawn = random_postures(arm, _POSTURES)[1:]
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    near = zero + np.multiply.outer([0.25, 0.5, 1.0], drawn - zero).reshape(-1, arm.n)
    postures = np.vstack([zero, near])
    far = np.abs(postures - zero) / np.maximum(high - low, 1e-9)
    unit = np.where(arm.prismatic, 0.01, np.deg2rad(1))
    rounded = np.round(postures[np.argsort(far.max(axis=1), kind="stable")] / unit) * unit
    return np.clip(rounded, arm.limits.angle_min, arm.limits.angle_max)


def _goals(arm: ArmModel, start: np.ndarray) -> Iterator[np.ndarray]:
    """Goals near a start: all joints upwards within limits, then other directions and smaller steps."""
    low, high = arm.limits.angle_min, arm.limits.angle_max
    full = np.where(arm.prismatic, SLIDE, TURN)
    rng = np.random.default_rng(0)
    signs = [np.ones(arm.n), *rng.choice([-1.0, 1.0], (_STEPS, arm.n))]
    for share in (1.0, 0.5):
        for sign in signs:
            step = share * sign * full
            there = start + step
            back = np.clip(start - step, low, high)
            yield np.where((there <= high) & (there >= low), there, back)


def _line_gap(collisions: Collisions, start: np.ndarray, goal: np.ndarray) -> float:
    """Smallest distance, m, on the straight line between two postures."""
    share = np.linspace(0.0, 1.0, 21)[:, None]
    return float(collisions.least(start + share * (goal - start)).min())
