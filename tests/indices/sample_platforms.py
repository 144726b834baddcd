"""Random platforms and ellipsoids, and the platforms of the published examples."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.platform import PlatformPose

SEEDS = st.integers(0, 2**32 - 1)
LEGS = st.sampled_from([6, 7, 9])


def random_pose(rng: np.random.Generator, n: int = 6) -> PlatformPose:
    """A platform with random anchors, n legs, about 1 m in size."""
    return PlatformPose(rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) + np.array([0.0, 0.0, 1.5]))


def random_motion(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Rotation matrix and translation."""
    return Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)


def moved(pose: PlatformPose, R: np.ndarray, t: np.ndarray, factor: float = 1.0) -> PlatformPose:
    """The pose seen from another frame, after scaling by a factor."""
    return PlatformPose(factor * pose.base @ R.T + t, factor * pose.platform @ R.T + t)


def random_ellipsoid(rng: np.random.Generator) -> OperationEllipsoid:
    """An operation ellipsoid of 0.1 to 1 m near the origin."""
    axes = Rotation.random(random_state=rng).as_matrix()
    return OperationEllipsoid(rng.normal(size=3) * 0.5, axes, rng.uniform(0.1, 1.0, 3))


def flat_pose(rng: np.random.Generator, n: int = 6) -> PlatformPose:
    """Base and platform in one plane: rank 3, the platform can leave the plane freely."""
    base, platform = np.zeros((n, 3)), np.zeros((n, 3))
    base[:, :2], platform[:, :2] = rng.normal(size=(n, 2)), rng.normal(size=(n, 2)) + 2.0
    R, t = random_motion(rng)
    return PlatformPose(base @ R.T + t, platform @ R.T + t)


def example_main_anchors() -> PlatformPose:
    """The printed anchors of K_M for mu = pi/3 ([Naw07] 7.3.3), rescaled as there."""
    r2, r3, r6 = math.sqrt(2), math.sqrt(3), math.sqrt(6)
    b1, p1 = (1, r2, 0), (1, 0, 1)
    b2, p2 = (-(1 + r6) / 2, (r3 - r2) / 2, 0), (-0.5, r3 / 2, 1)
    b3, p3 = ((r6 - 1) / 2, -(r2 + r3) / 2, 0), (-0.5, -r3 / 2, 1)
    base = np.array([b1, b2, b3, np.negative(b3), np.negative(b1), np.negative(b2)])
    platform = np.array([p1, p2, p3, np.negative(p3), np.negative(p1), np.negative(p2)])
    return PlatformPose(base, platform)
