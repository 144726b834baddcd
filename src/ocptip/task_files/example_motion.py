"""Start and goal of an example motion for an arm: near zero, clear of arm and ground, and held at rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ocptip.robots.collision.gaps import Collisions, random_postures
from ocptip.robots.collision.model import ShapeCollisions
from ocptip.robots.collision.shapes import ArmGeometry
from ocptip.robots.dynamics import STANDARD_GRAVITY, evaluate_dynamics
from ocptip.robots.geometry import floor
from ocptip.robots.model import ArmModel
from ocptip.task_files.example_base import ExampleBase, inside_feet

TURN, SLIDE = np.deg2rad(30), 0.1
"""How far joints move at most in the example, rad and m."""

_CLEARANCES = (0.03, 0.01, 0.003, 0.0)
"""m: the first that some motion keeps counts. Some arms have links that are always within 10 mm."""

_TORQUE = 0.7
"""Share of the torque limits that gravity may need in the example."""

_INSIDE = 0.4
"""The centre of all masses keeps this share of the distance from the middle of the feet to their edges."""

_INSET = 2e-5
"""rad or m, from the limits of joints: the file has six digits."""

_POSTURES, _STARTS, _STEPS = 300, 50, 16


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
        if not np.isfinite(self.clear):
            return "start and goal are an example; no two solids can collide that do not always touch"
        if self.clear < 0:
            return "start and goal are an example in which links overlap: no clear one was found"
        return f"start and goal are an example {1e3 * self.clear:.2g} mm clear of arm and ground"


def example_motion(arm: ArmModel, geometry: ArmGeometry | None, base: ExampleBase) -> ExampleMotion:
    """A motion that starts as near to zero as collisions, torques at rest and the base allow.

    Args:
        arm: not mounted.
        geometry: its collision geometry; None: collisions are not checked.
        base: on which it stands.
    """
    zero = np.clip(np.zeros(arm.n), *_limits(arm))
    mounted = replace(arm, geometry=geometry).mounted(np.array([0.0, 0.0, base.height]), np.eye(3))
    collisions = Collisions(arm.n) if geometry is None else ShapeCollisions(mounted, [floor(0.0)])
    starts = _starts(arm, zero)
    gaps, held = collisions.least(starts), _held(mounted, base, starts)
    for must_hold in (True, False):
        for clearance in _CLEARANCES:
            for start in starts[(gaps >= clearance) & (held | (not must_hold))][:_STARTS]:
                goals = np.array(list(_goals(arm, start)))
                for goal in goals[collisions.least(goals) >= clearance]:
                    line = start + np.linspace(0.0, 1.0, 21)[:, None] * (goal - start)
                    gap = float(collisions.least(line).min())
                    if gap >= clearance and not (must_hold and not _held(mounted, base, line).all()):
                        return ExampleMotion(start, goal, None if geometry is None else gap)
    return ExampleMotion(zero, next(_goals(arm, zero)), -1.0)


def _held(arm: ArmModel, base: ExampleBase, q: np.ndarray) -> np.ndarray:
    """(N,) True where drives hold the arm at rest and the centre of all masses is well above the feet."""
    rest = np.zeros_like(q)
    load = evaluate_dynamics(arm, q, rest, rest)
    strong = (np.abs(load.torque) <= _TORQUE * arm.limits.torque).all(axis=1)
    force, moment = load.wrench[:, :3], load.wrench[:, 3:]
    weight = np.maximum(-force[:, 2], 1e-9)
    carried = np.column_stack([moment[:, 1], -moment[:, 0]]) / weight[:, None]
    masses = weight / -STANDARD_GRAVITY[2]
    whole = (masses[:, None] * carried + base.mass * base.center_of_mass[:2]) / (masses + base.mass)[:, None]
    middle = base.feet[:, :2].mean(axis=0)
    return strong & (inside_feet(base.feet, whole) >= _INSIDE * inside_feet(base.feet, middle[None]))


def _starts(arm: ArmModel, zero: np.ndarray) -> np.ndarray:
    """Postures (N, n), zero first, then those nearest to it; in whole degrees and centimetres."""
    drawn = random_postures(arm, _POSTURES)[1:]
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    near = zero + np.multiply.outer([0.25, 0.5, 1.0], drawn - zero).reshape(-1, arm.n)
    postures = np.vstack([zero, near])
    far = np.abs(postures - zero) / np.maximum(high - low, 1e-9)
    unit = np.where(arm.prismatic, 0.01, np.deg2rad(1))
    rounded = np.round(postures[np.argsort(far.max(axis=1), kind="stable")] / unit) * unit
    return np.clip(rounded, *_limits(arm))


def _limits(arm: ArmModel) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest joint values (n,) of the example."""
    low, high = arm.limits.angle_min, arm.limits.angle_max
    inset = np.minimum(_INSET, 0.1 * (high - low))
    return low + inset, high - inset


def _goals(arm: ArmModel, start: np.ndarray) -> Iterator[np.ndarray]:
    """Goals near a start: all joints upwards within limits, then other directions and smaller steps."""
    low, high = _limits(arm)
    full = np.where(arm.prismatic, SLIDE, TURN)
    rng = np.random.default_rng(0)
    signs = [np.ones(arm.n), *rng.choice([-1.0, 1.0], (_STEPS, arm.n))]
    for share in (1.0, 0.5):
        for sign in signs:
            step = share * sign * full
            there = start + step
            back = np.clip(start - step, low, high)
            yield np.where((there <= high) & (there >= low), there, back)
