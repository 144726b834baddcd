"""Singular poses between the samples of a path: sign changes of the implicit pair.

A measure that is far from zero at every sample says nothing about what lies between them. The determinant of
A (type II) and the entries of b (type I) are smooth through a singular pose and change their sign there.
Robots without an implicit pair have the determinants of J_a and of the legs' Jacobians instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.parallel.analysis.singularity import Singularity, implicit_pair, singularity
from ocptip.parallel.kinematics.platform import JointPositions, Kinematics

_BISECTIONS = 30
_THERE = 1e-7
_PLATFORM = "platform (type II)"


@dataclass(frozen=True, eq=False)
class Crossing(Record):
    """A singular pose on a path.

    Attributes:
        sample: the crossing lies between samples `sample` and `sample + 1` (or at `sample`).
        share: where between them, 0..1, the path taken straight in z.
        kinds: "leg 2 (type I)", "platform (type II)".
        z: (m,) the pose there.
    """

    sample: int
    share: float
    kinds: tuple[str, ...]
    z: np.ndarray


def crossings(kinematics: Kinematics, path: ArrayLike, tolerance: float = _THERE) -> tuple[Crossing, ...]:
    """Singular poses on a path, those between its samples included.

    Joint positions follow the path from sample to sample, so that a leg keeps its IK solution. A path that
    only touches a singular pose between two samples, without crossing it, is not seen; nor is type I of
    complete legs with fewer than six joints.

    Args:
        kinematics: of a robot with as many motors as coordinates.
        path: (N, m) coordinates.
        tolerance: measures below it at a sample count as singular there.

    Raises:
        InputError: another kind of robot, wrong shape, or a pose out of reach.
    """
    description = kinematics.description
    if len(description.actuated) != description.m:
        raise InputError(
            "crossings: need as many motors as coordinates, but "
            f"{len(description.actuated)} motors move {description.m} coordinates"
        )
    complete = not description.coupling_form
    find = kinematics.joints if complete else kinematics.point_joints
    poses = finite_array("path", path, (None, kinematics.m))
    result: list[Crossing] = []
    before: Singularity | None = None
    q: Sequence[np.ndarray] | None = None
    signs: dict[str, float] = {}
    for k, z in enumerate(poses):
        start, q = q, find(z, q).q
        now = singularity(kinematics, z, q, complete=complete, tolerance=tolerance)
        signs, last = _signs(kinematics, z, q, now), signs
        if now.mechanical:
            result.append(Crossing(k, 0.0, now.mechanical, z))
        elif before is not None and not before.mechanical and start is not None:
            result += _between(kinematics, find, k - 1, (poses[k - 1], z), start, (last, signs))
        before = now
    return tuple(result)


def _between(
    kinematics: Kinematics,
    find: Callable[[np.ndarray, Sequence[np.ndarray]], JointPositions],
    sample: int,
    ends: tuple[np.ndarray, np.ndarray],
    q: Sequence[np.ndarray],
    signs: tuple[dict[str, float], dict[str, float]],
) -> list[Crossing]:
    """One crossing per sign that differs, by bisection."""
    result = []
    a, b = ends
    for kind, first in signs[0].items():
        if first == signs[1][kind]:
            continue
        low, high, joints = 0.0, 1.0, q
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            z = a + middle * (b - a)
            joints_there = find(z, joints).q
            if _signs(kinematics, z, joints_there)[kind] == first:
                low, joints = middle, joints_there
            else:
                high = middle
        result.append(Crossing(sample, high, (kind,), a + high * (b - a)))
    return result


def _signs(
    kinematics: Kinematics, z: np.ndarray, q: Sequence[np.ndarray], result: Singularity | None = None
) -> dict[str, float]:
    """Signs of det A and of b, or of the determinants of J_a and of the square leg Jacobians, by what is
    singular where they change."""
    if kinematics.description.coupling_form:
        pair = implicit_pair(kinematics, z, q) if result is None else result.pair
        assert pair is not None
        b = zip(kinematics.description.actuated, pair.b, strict=True)
        return {_PLATFORM: _sign(pair.A)} | {f"leg {leg + 1} (type I)": np.sign(v) for (leg, _), v in b}
    motion = kinematics.motion(z, np.zeros(kinematics.m), q, complete=True)
    signs = {_PLATFORM: _sign(kinematics.actuated_jacobian(motion))}
    for number, (leg, joints) in enumerate(zip(kinematics.legs, q, strict=True), start=1):
        J = leg.jacobian(joints)[0][:, leg.free]
        if J.shape[0] == J.shape[1]:
            signs[f"leg {number} (type I)"] = _sign(J)
    return signs


def _sign(matrix: np.ndarray) -> float:
    return float(np.sign(np.linalg.det(matrix)))
