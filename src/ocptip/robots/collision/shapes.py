"""Convex solids fixed to bodies. A new one is one class with `corners`, and its keys in task files.

Distances between solids are computed by coal, which comes with Pinocchio; here are the solids' measures, in
NumPy.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.robots.pinocchio import load_coal

_SAME_HEIGHT = 1e-6  # corners this much (share of the solid's size) below the highest one are as high
_THIN = 1e-3  # m, given to meshes that are flat
_ROUND = 32  # corners of the polygon about a circle


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """A convex solid in the axes of the body that it is fixed to.

    Attributes:
        rotation: (3, 3), axes of the solid to those of the body.
        position: (3,), m, of its origin in the body's axes.
    """

    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        rotation_matrix("rotation", self.rotation, tolerance=1e-6)
        settle(self, position=finite_array("position", self.position, (3,)))

    @property
    def thickness(self) -> float:
        """m, by which the hull of the corners is thickened."""
        return 0.0

    def solid(self) -> Any:
        """The geometry for coal, in axes of the solid; by default the hull of the corners."""
        coal = load_coal()
        points = coal.StdVec_Vec3s()
        for point in self.corners():
            points.append(point)
        return coal.Convex.convexHull(points, True, "Qt")

    def corners(self) -> np.ndarray:
        """(k, 3), m, axes of the solid: points whose convex hull, thickened, is the solid or encloses it
        closely.
        """
        raise NotImplementedError

    def placed(self, rotation: np.ndarray, position: np.ndarray) -> Self:
        """This shape in other axes, in which the present body's axes have this pose."""
        return dataclasses.replace(
            self, rotation=rotation @ self.rotation, position=position + rotation @ self.position
        )

    def outline(self) -> np.ndarray:
        """(k, 3), m, body axes: the corners; those of a thickened solid stand for balls of that radius."""
        return self.position + self.corners() @ self.rotation.T

    def touched(self, directions: np.ndarray) -> np.ndarray:
        """How the point, edge or face extends, below the thickness, that is farthest in some directions.

        Args:
            directions: (r, 3), unit vectors, axes of the solid.

        Returns:
            (r, 3, 2) directions along that feature, orthonormal; zero columns where it has fewer.
        """
        corners = self.corners()
        heights = directions @ corners.T
        equal = _SAME_HEIGHT * (np.ptp(corners) + self.thickness)
        top = heights >= heights.max(axis=1, keepdims=True) - equal
        along = np.zeros((len(directions), 3, 2))
        for r in np.flatnonzero(top.sum(axis=1) > 1):
            highest = corners[top[r]]
            _, sizes, rows = np.linalg.svd(highest[1:] - highest[0], full_matrices=False)
            count = min(2, int(np.sum(sizes > 1e-3 * sizes[0])))
            along[r, :, :count] = rows[:count].T
        return along


@dataclass(frozen=True, eq=False)
class Ball(Shape):
    """A sphere about the origin; radius in m."""

    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_number("radius", self.radius)

    @property
    def thickness(self) -> float:
        return self.radius

    def solid(self) -> Any:
        return load_coal().Sphere(self.radius)

    def corners(self) -> np.ndarray:
        return np.zeros((1, 3))


@dataclass(frozen=True, eq=False)
class Capsule(Ball):
    """A line of some length (m) along z about the origin, thickened by the radius (m)."""

    length: float

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_number("length", self.length)

    def solid(self) -> Any:
        return load_coal().Capsule(self.radius, self.length)

    def corners(self) -> np.ndarray:
        return 0.5 * self.length * np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True, eq=False)
class Cylinder(Shape):
    """A cylinder of a radius and length (m) along z about the origin; a prism about it (0.5 % of the radius).

    On a true rim coal's search for the nearest points ends too early for derivatives.
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("radius", "length"):
            positive_number(name, getattr(self, name))

    def corners(self) -> np.ndarray:
        angles = 2 * np.pi * np.arange(_ROUND) / _ROUND
        circle = self.radius / np.cos(np.pi / _ROUND) * np.array([np.cos(angles), np.sin(angles)]).T
        ends = [np.full((_ROUND, 1), end) for end in (0.5 * self.length, -0.5 * self.length)]
        return np.vstack([np.hstack([circle, end]) for end in ends])


@dataclass(frozen=True, eq=False)
class Box(Shape):
    """A box with edges `size` (3,), m, about the origin."""

    size: Sequence[float] | np.ndarray

    def __post_init__(self) -> None:
        super().__post_init__()
        size = finite_array("size", self.size, (3,))
        settle(self, size=size)
        if not (size > 0).all():
            raise InputError(f"size: must be > 0, got {size.tolist()}")

    def solid(self) -> Any:
        return load_coal().Box(*self.size)

    def corners(self) -> np.ndarray:
        signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
        return signs * self.size


@dataclass(frozen=True, eq=False)
class Hull(Shape):
    """The convex hull of points (k, 3), m, such as a mesh's vertices; one that is flat is made 1 mm thick."""

    points: np.ndarray

    def __post_init__(self) -> None:
        super().__post_init__()
        points = finite_array("points", self.points, (None, 3))
        try:
            kept = points[scipy.spatial.ConvexHull(points).vertices]
        except (scipy.spatial.QhullError, ValueError):
            if not len(points):
                raise InputError("points: a mesh without vertices") from None
            across = _principal_axes(points)
            thick = [points + sign * 0.5 * _THIN * axis for axis in across for sign in (-1, 1)]
            kept = np.vstack(thick)
            kept = kept[scipy.spatial.ConvexHull(kept).vertices]
        settle(self, points=kept)

    def corners(self) -> np.ndarray:
        return self.points


@dataclass(frozen=True, eq=False)
class HalfSpace(Shape):
    """The points with normal . p >= distance (m); normal (3,), unit vector into it. It has no corners."""

    normal: np.ndarray
    distance: float

    def __post_init__(self) -> None:
        super().__post_init__()
        number_from("distance", self.distance)

    def solid(self) -> Any:
        return load_coal().Halfspace(-np.asarray(self.normal), -float(self.distance))

    def corners(self) -> np.ndarray:
        return np.empty((0, 3))

    def touched(self, directions: np.ndarray) -> np.ndarray:
        plane = np.linalg.svd(np.reshape(self.normal, (1, 3)))[2][1:].T
        return np.tile(plane, (len(directions), 1, 1))


@dataclass(frozen=True, eq=False)
class BodyShape:
    """A solid on a body.

    Attributes:
        name: of what it belongs to, such as a link of the URDF; several may share it.
        body: 1..L, a link of the arm; 0: what rests.
        shape: in the link's frame; on body 0 of an arm in its mount frame, else in base axes.
        carried: by the last link, not part of it.
    """

    name: str
    body: int
    shape: Shape
    carried: bool = False


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh that convex solids enclose.

    Attributes:
        name, body: see `BodyShape`.
        file: its path.
        scale: (3,), of the file's lengths to m.
        rotation, position: (3, 3) and (3,), m: its pose in the link's frame; of body 0 in the mount frame.
    """

    name: str
    body: int
    file: str
    scale: tuple[float, ...]
    rotation: np.ndarray
    position: np.ndarray


@dataclass(frozen=True, eq=False)
class ArmGeometry:
    """What an arm is made of where distances count.

    Attributes:
        shapes: of the arm and what it carries.
        apart: pairs of names that need not be checked, with the reason.
        source: in words, e.g. "collision geometry of ur5.urdf".
        on_meshes: of pairs of names, some of whose solids never part: in how many of the random postures
            their meshes, which the solids enclose, touch.
        meshes: files of the meshes among the geometry.
    """

    shapes: tuple[BodyShape, ...]
    apart: dict[frozenset[str], str] = field(default_factory=dict)
    source: str = ""
    on_meshes: dict[frozenset[str], int] = field(default_factory=dict)
    meshes: tuple[MeshFile, ...] = ()


def enclosing_capsule(shape: Shape) -> tuple[np.ndarray, float]:
    """Ends (2, 3), m, body axes, and radius (m) of a capsule that contains a solid with corners.

    Its line is along one of the principal axes of the corners; of the three the one of minimum volume.
    """
    corners = shape.outline()
    centre = corners.mean(axis=0)
    axes = _principal_axes(corners)
    results = []
    for k in range(3):
        lengths = (corners - centre) @ np.roll(axes, -k, axis=0).T
        middle = 0.5 * (lengths.min(axis=0) + lengths.max(axis=0))
        off = np.sum((lengths[:, 1:] - middle[1:]) ** 2, axis=1)
        radius = float(np.sqrt(off.max()))
        half = np.sqrt(np.maximum(radius**2 - off, 0))
        low, high = (lengths[:, 0] + half).min(), (lengths[:, 0] - half).max()
        if low > high:  # one ball will do
            low = high = 0.5 * (low + high)
        ends = np.array([[low, *middle[1:]], [high, *middle[1:]]]) @ np.roll(axes, -k, axis=0) + centre
        volume = np.pi * radius**2 * (high - low + 4 / 3 * radius)
        results.append((volume, k, ends, radius + shape.thickness + 1e-9))
    return min(results, key=lambda entry: entry[:2])[2:]


def _principal_axes(points: np.ndarray) -> np.ndarray:
    """Rows (3, 3): directions in order of decreasing spread of points (k, 3)."""
    few = len(points) < 3  # only then the whole matrices are needed, whose first is (k, k)
    return np.linalg.svd(points - points.mean(axis=0), full_matrices=few)[2]
