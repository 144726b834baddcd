"""The operation ellipsoid and the metric it puts on the motions of an end-effector.

How much a body moves is measured, to first order, by the sum of the squared velocities of some of its points.
The operation ellipsoid stands for the region of interest of an end-effector; its six vertices are those
points. The metric depends only on number, centroid and second moments of the points. Source: [Naw07] 3.2.1,
(3.12), (3.16), (3.23).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.basics.write import Record
from ocptip.numerics.vectors import skew

_FLATNESS = 1e-9


@dataclass(frozen=True, eq=False)
class OperationEllipsoid(Record):
    """An ellipsoid of non-zero volume fixed on an end-effector.

    Attributes:
        center: (3,), m, in the frame of the end-effector.
        axes: (3, 3) rotation matrix, its columns are the principal directions in that frame.
        half_axes: (3,), m, all > 0.

    Raises:
        InputError: no such numbers, no rotation matrix, or an ellipsoid without volume.
    """

    center: np.ndarray
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    half_axes: np.ndarray = field(default_factory=lambda: np.full(3, 0.1))

    def __post_init__(self) -> None:
        center = finite_array("center", self.center, (3,))
        axes = rotation_matrix("axes", self.axes)
        half_axes = finite_array("half_axes", self.half_axes, (3,))
        if not half_axes.min() > _FLATNESS * half_axes.max():
            raise InputError(
                f"half_axes: all must be > 0 and of comparable size, got {half_axes.tolist()}; "
                "an operation ellipsoid needs volume"
            )
        settle(self, center=center, axes=axes, half_axes=half_axes)

    @classmethod
    def sphere(cls, radius: float, center: object = (0.0, 0.0, 0.0)) -> OperationEllipsoid:
        """Sphere of a radius, m, about a point of the end-effector frame."""
        return cls(np.asarray(center), np.eye(3), np.full(3, positive_number("radius", radius)))

    @classmethod
    def from_points(cls, points: object) -> OperationEllipsoid:
        """The ellipsoid with the metric of N points of the end-effector, up to the factor 6 / N.

        `point_metric(points)` equals N / 6 times `W()` of the result.

        Args:
            points: (N, 3), m, end-effector frame.

        Raises:
            InputError: all points lie in one plane; add points or give the ellipsoid itself.
        """
        cloud = finite_array("points", points, (None, 3))
        if len(cloud) < 4:
            raise InputError(f"points: at least 4 that are not in one plane, got {len(cloud)}")
        center = cloud.mean(axis=0)
        moments, axes = np.linalg.eigh((cloud - center).T @ (cloud - center))
        if moments[0] <= _FLATNESS**2 * moments[-1] or moments[0] <= 1e-14 * moments[-1]:
            raise InputError("points: all lie in one plane; an operation ellipsoid needs volume")
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        return cls(center, axes, np.sqrt(3.0 * moments / len(cloud)))

    @property
    def characteristic_length(self) -> float:
        """R sqrt(2/3), m, of the sphere with the same sum of squared half-axes (3.24)."""
        return float(np.sqrt(2.0 / 9.0 * (self.half_axes @ self.half_axes)))

    @cached_property
    def principal_speeds(self) -> np.ndarray:
        """(6,) square roots of the diagonal of W in the frame of the ellipsoid: m, then 1 (3.23)."""
        squares = self.half_axes**2
        return np.sqrt(np.concatenate([2.0 * (squares.sum() - squares), np.full(3, 6.0)]))

    def vertices(self, rotation: object = None, translation: object = None) -> np.ndarray:
        """(6, 3), m: centre plus and minus the half-axes, in a frame in which the end-effector has the given
        pose (default: identity).
        """
        offsets = (self.axes * self.half_axes).T
        points = self.center + np.concatenate([offsets, -offsets])
        turned = points if rotation is None else points @ np.asarray(rotation, dtype=float).T
        return turned if translation is None else turned + np.asarray(translation, dtype=float)

    def factor(self, rotation: object = None, translation: object = None) -> np.ndarray:
        """F: (6, 6) with W = F' F; F q are velocities in m/s. Poses may carry leading dimensions.

        Working with singular values of F J instead of eigenvalues of J' W J keeps twice the digits.
        """
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        shift = np.zeros(3) if translation is None else np.asarray(translation, dtype=float)
        axes, center = np.swapaxes(turn @ self.axes, -1, -2), turn @ self.center + shift
        matrix = np.zeros((*axes.shape[:-2], 6, 6))
        matrix[..., :3, :3] = self.principal_speeds[:3, None] * axes
        matrix[..., 3:, 3:] = self.principal_speeds[3] * axes
        matrix[..., 3:, :3] = -matrix[..., 3:, 3:] @ skew(center)
        return matrix

    def W(self, rotation: object = None, translation: object = None) -> np.ndarray:
        """(6, 6): q' W q is the sum of the squared velocities of the vertices under a screw q (3.12).

        Args:
            rotation, translation: (3, 3) and (3,), m: pose of the end-effector in the frame of q.
        """
        factor = self.factor(rotation, translation)
        return np.swapaxes(factor, -1, -2) @ factor


def velocity_map(points: np.ndarray) -> np.ndarray:
    """(..., 3 k, 6): velocities of k points (..., k, 3), m, stacked, from a screw (1.16)."""
    rows = np.zeros((*points.shape, 6))
    rows[..., 3:] = np.eye(3)
    rows[..., :3] = -skew(points)
    return rows.reshape(*points.shape[:-2], -1, 6)
