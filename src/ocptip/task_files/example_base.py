"""The base of an example task: that of the URDF if it has one, else one that carries the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.robots.collision.shapes import ArmGeometry
from ocptip.robots.model import ArmModel
from ocptip.robots.resting import resting_body, resting_links
from ocptip.robots.urdf_file import UrdfFile

_SHARE = 0.5
"""Links that rest are a base if they weigh at least this share of the arm; lighter ones are its foot."""

_PART = 0.01
"""A base has two links and more of at least this share of its mass; a single one is the foot of the arm."""

_HEAVIER, _LEAST_MASS = 3.0, 80.0
"""An invented base weighs this many times the arm, and at least so many kg."""

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
            return "mass, centre of mass, feet and height are invented, for the URDF has no base of its own"
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
