"""An example task for an arm: its base, and a motion near zero, clear of all, that the drives hold at rest.

The base is that of the URDF if it has one, else one that carries the arm.
"""

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
from ocptip.robots.resting import resting_body, resting_links
from ocptip.robots.urdf_file import UrdfFile

_SHARE = 0.5
"""Links that rest are a base if they weigh at least this share of the arm; lighter ones are its foot."""

_PART = 0.01
"""A base has two links and more of at least this share of its mass; a single one is the foot of the arm."""

_HEAVIER, _LEAST_MASS = 3.0, 80.0
"""Mass of an invented base: a multiple of that of the arm, and a minimum, kg."""

_WIDE, _LEAST_HALF = 0.25, np.array([0.3, 0.25])
"""Feet of an invented base are this share of the arm's reach from its middle, and at least so far, m."""

_CENTRED = 0.2
"""The centre of mass of a base keeps this share of the distance of the feet's middle from their edges."""

_UP = np.array([0.0, 0.0, 1.0])
_HEIGHT = 0.5
"""m, of an invented base."""

_LEVEL, _BELOW = 0.02, 0.005
"""m: solids within `_LEVEL` of the lowest one touch the ground, within `_BELOW` of their ends."""


@dataclass(frozen=True)
class ExampleBase:
    """A base whose origin is on the ground below the origin of the arm's base link.

    Attributes:
        mass: kg.
        center_of_mass: (3,), m.
        feet: (k, 3), m.
        height: m, of the base link's frame.
        of_urdf: mass and centre of mass are those of the URDF's links that rest.
        feet_of_urdf: feet and height follow from the URDF's collision geometry.
        foot_mass: kg, of resting links that an invented base has to contain.
    """

    mass: float
    center_of_mass: np.ndarray
    feet: np.ndarray
    height: float
    of_urdf: bool
    feet_of_urdf: bool
    foot_mass: float = 0.0

    @property
    def source(self) -> str:
        """Where the numbers come from, one sentence."""
        if not self.of_urdf:
            return "mass, centre of mass, feet and height are invented, for the URDF has no base"
        feet = "those of its lowest solids" if self.feet_of_urdf else "invented, for no solid shows them"
        return f"mass and centre of mass are those of the URDF's links that rest; feet and height are {feet}"


def example_base(file: UrdfFile, arm: ArmModel, geometry: ArmGeometry | None) -> ExampleBase:
    """The base for an arm.

    Args:
        file: the URDF.
        arm: read from it, not mounted.
        geometry: its collision geometry, if there is any.
    """
    carried = float(arm.masses.sum())
    mass, centre = resting_body(file.path, arm)
    parts = sum(file.masses.get(link, 0.0) > _PART * mass for link in resting_links(file, arm))
    half = np.maximum(_LEAST_HALF, np.round(_WIDE * arm.reach * np.array([1.0, 0.8]), 2))
    feet = np.array([[x, y, 0.0] for x, y in half * [[1, 1], [1, -1], [-1, -1], [-1, 1]]])
    ground = None if geometry is None else _ground_points(arm, geometry)
    if mass < _SHARE * carried or parts < 2 or (ground is not None and not _stands(ground, centre)):
        heavy = max(_LEAST_MASS, 10 * np.round(_HEAVIER * carried / 10), np.ceil(mass))
        return ExampleBase(heavy, np.array([0.0, 0.0, 0.3]), feet, _HEIGHT, False, False, mass)
    height = _HEIGHT if ground is None else -float(ground[0, 2])
    if ground is not None:
        feet = ground * [1.0, 1.0, 0.0]
    return ExampleBase(mass, centre + height * _UP, feet, height, True, ground is not None)


def _ground_points(arm: ArmModel, geometry: ArmGeometry) -> np.ndarray | None:
    """Points (k, 3), m, base link, where resting solids touch a level ground, at its height; None: no area.

    Of all such points these are the outermost in four directions: what stands on them stands on all.
    """
    outlines = []
    for item in geometry.shapes:
        if item.body == 0:
            shape = item.shape.placed(arm.mount_rotation, arm.mount_position)
            outlines.append(shape.outline() - [0.0, 0.0, shape.thickness])
    if not outlines:
        return None
    level = min(points[:, 2].min() for points in outlines)
    touching = [points for points in outlines if points[:, 2].min() < level + _LEVEL]
    low = np.vstack([points[points[:, 2] < points[:, 2].min() + _BELOW] for points in touching])
    diagonals = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    chosen = list(dict.fromkeys(np.argmax(low[:, :2] @ diagonals.T, axis=0).tolist()))
    corners = low[chosen]
    x, y = corners[:, 0], corners[:, 1]
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    return np.column_stack([x, y, np.full(len(corners), level)]) if area > 1e-3 else None


def _stands(feet: np.ndarray, centre: np.ndarray) -> bool:
    middle = feet[:, :2].mean(axis=0)
    inside = inside_feet(feet, np.array([centre[:2], middle]))
    return bool(inside[0] >= _CENTRED * inside[1])


def inside_feet(feet: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) m, how far points (N, 2) are inside the convex polygon of the feet (k, 3)."""
    corners = feet[:, :2]
    turned = corners - corners.mean(axis=0)
    corners = corners[np.argsort(np.arctan2(turned[:, 1], turned[:, 0]))]
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    return np.min(np.einsum("nkj,kj->nk", points[:, None] - corners, normals), axis=1)


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
            negative: the search has no clear motion.
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
            return "start and goal are an example in which links overlap: the search has no clear one"
        return f"start and goal are an example {1e3 * self.clear:.2g} mm clear of arm and ground"


def example_motion(arm: ArmModel, geometry: ArmGeometry | None, base: ExampleBase) -> ExampleMotion:
    """A motion that starts as near to zero as collisions, torques at rest and the base allow.

    Args:
        arm: not mounted.
        geometry: its collision geometry; None: collisions are not checked.
        base: on which it stands.
    """
    zero = np.clip(np.zeros(arm.n), *_limits(arm))
    mounted = replace(arm, geometry=geometry).mounted([0.0, 0.0, base.height], np.eye(3))
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
