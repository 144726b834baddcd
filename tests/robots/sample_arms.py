"""Arms for the tests that nobody would build."""

from __future__ import annotations

import numpy as np

from ocptip.robots.model import ArmModel, JointLimits


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    u, _, vt = np.linalg.svd(rng.normal(size=(3, 3)))
    return u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt


def random_arm(seed: int, joints: int) -> ArmModel:
    """An arm with no regularity whatever: indefinite inertias, armature, a turned tool and mount."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(joints, 3, 3))
    return ArmModel(
        name="random",
        joint_names=tuple(f"j{i}" for i in range(joints)),
        rotations=np.array([random_rotation(rng) for _ in range(joints)]),
        offsets=rng.normal(size=(joints, 3)),
        masses=rng.uniform(0, 4, joints),
        centres=rng.normal(size=(joints, 3)),
        inertias=half + half.transpose(0, 2, 1),
        limits=JointLimits.unlimited(joints),
        tool_rotation=random_rotation(rng),
        mount_position=rng.normal(size=3),
        mount_rotation=random_rotation(rng),
        armature=rng.uniform(0, 1, joints),
    )
