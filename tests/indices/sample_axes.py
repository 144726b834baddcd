"""Axes, motions and moves for the tests of the arm indices."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import singularity_distance
from ocptip.indices.lines import spear
from ocptip.indices.metric import OperationEllipsoid
from ocptip.numerics.vectors import skew
from ocptip.published.arms import irb_2000


def random_axes(rng: np.random.Generator, count: int = 6) -> np.ndarray:
    """(6, count): spears of random axes near the origin, as columns."""
    return spear(rng.normal(size=(count, 3)), rng.normal(size=(count, 3))).T


def random_pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and position (3,)."""
    return Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), rng.normal(size=3)


def random_ellipsoid(rng: np.random.Generator) -> OperationEllipsoid:
    axes, center = random_pose(rng)
    return OperationEllipsoid(center, axes, rng.uniform(0.1, 1.0, 3))


def distance_to_point(line: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Distance of a point (3,) from spears (..., 6), m."""
    return np.linalg.norm(line[..., 3:] - np.cross(point, line[..., :3]), axis=-1)


def klein_form(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a·b̂ + â·b along the last axis; zero if two lines meet, or a line belongs to a complex."""
    return np.sum(a[..., :3] * b[..., 3:] + a[..., 3:] * b[..., :3], axis=-1)


def point_metric(points: np.ndarray) -> np.ndarray:
    """(6, 6): q' W q is the sum of the squared velocities of N points (N, 3), m, under a screw q."""
    total = skew(points.sum(axis=0))
    moments = (points**2).sum() * np.eye(3) - points.T @ points
    return np.block([[moments, total], [-total, len(points) * np.eye(3)]])


def published_motion(t: float) -> np.ndarray:
    """(6,) rad: the motion of the IRB 2000 in [Naw07] 3.5."""
    degrees = [0, 210 * t - 110, 120 * t**2 - 60, 180 * t - 90, 240 * t - 120, 0]
    return np.radians(degrees)


def published_rates(t: float) -> np.ndarray:
    """(6,) its derivative."""
    return np.radians([0, 210, 240 * t, 180, 240, 0])


def turned(spears: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """(6, n): axes (6, n) after the joints turned by the angles, by a product of rotations of the space."""
    columns = spears.T.copy()
    for i, angle in reversed(list(enumerate(angles))):
        rotation = Rotation.from_rotvec(angle * spears[:3, i]).as_matrix()
        foot = np.cross(spears[:3, i], spears[3:, i])
        shift = foot - rotation @ foot
        for k in range(i + 1, len(angles)):
            direction = rotation @ columns[k, :3]
            columns[k] = np.concatenate([direction, rotation @ columns[k, 3:] + np.cross(shift, direction)])
    return columns.T


def stationary_pose() -> np.ndarray:
    """(6,) rad: joint angles of the IRB 2000 where the gradient of det J vanishes, by Newton's method."""

    def slope(x: np.ndarray) -> np.ndarray:
        q = np.array([0.4, x[0], x[1], -0.7, np.pi / 2, 1.1])
        return singularity_distance(arm_pose(irb_2000(), q).jacobian).gradient[:2]

    point = np.array([0.88638233, -0.19062529])
    for _ in range(4):
        matrix = np.array([(slope(point + e) - slope(point - e)) / 2e-5 for e in np.eye(2) * 1e-5]).T
        point = point - np.linalg.solve(matrix, slope(point))
    return np.array([0.4, *point, -0.7, np.pi / 2, 1.1])
