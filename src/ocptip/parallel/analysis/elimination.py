"""Order in which symbolic code eliminates the motors of a robot with many coupled coordinates."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.parallel.analysis.singularity import characteristic_length
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.kinematics.platform import Kinematics


def elimination_order(description: RobotDescription, *, complete: bool = False) -> tuple[int, ...]:
    """The three motors whose forces are most independent at home first, then the others.

    Generated code solves J_a^T tau_a = tau_s by a Schur complement after three motors and three force
    components; both pivots should be far from zero. The natural order for up to three motors, or if the home
    pose cannot be assembled. `complete`: of legs with all their joints.
    """
    m, motors = description.platform.m, len(description.actuated)
    natural = tuple(range(motors))
    if m != motors or m <= 3:
        return natural
    try:
        kinematics = Kinematics(description)
        q = (kinematics.joints if complete else kinematics.point_joints)(description.home).q
    except OcptipError:
        return natural
    motion = kinematics.motion(description.home, np.zeros(m), q, complete=complete)
    columns = kinematics.actuated_jacobian(motion).T
    free = sum(description.platform.mask[:3])
    columns = columns / np.array([1.0] * free + [characteristic_length(kinematics)] * (m - free))[:, None]
    columns = columns / np.linalg.norm(columns, axis=0)
    # The product of both pivots is the whole determinant: neither should be small.
    whole = abs(np.linalg.det(columns))

    def balance(first: tuple[int, ...]) -> float:
        pivot = abs(np.linalg.det(columns[:3, list(first)]))
        return min(pivot, whole / pivot) if pivot > 0 else 0.0

    best = max(combinations(natural, 3), key=balance)
    return (*best, *(k for k in natural if k not in best))
