"""Singular poses between the samples of a path: sign changes of the implicit pair (section 13).

A measure that is far from zero at every sample says nothing about what lies between them. The determinant of
A (type II) and the entries of b (type I) are smooth through a singular pose and change their sign there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.parallel.analysis.singularity import Singularity, singularity
from ocptip.parallel.kinematics.platform import Kinematics

_BISECTIONS = 30
_THERE = 1e-7


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

    Joint positions follow the path from sample to sample, so that a leg keeps its branch. A path that only
    touches a singular pose between two samples, without crossing it, is not seen.

    Args:
        kinematics: of a robot in coupling-point form with as many motors as coordinates.
        path: (N, m) coordinates.
        tolerance: measures below it at a sample count as singular there.

    Raises:
        InputError: another kind of robot, wrong shape, or a pose out of reach.
    """
    description = kinematics.description
    counts = f"{len(description.actuated)} motors move {description.m} coordinates"
    if not description.coupling_form or len(description.actuated) != description.m:
        raise InputError(
            "crossings: need legs with as many joints up to the coupling point as free translations, and as "
            f"many motors as coordinates, but {description.coupling_obstacle or counts}"
        )
    poses = finite_array("path", path, (None, kinematics.m))
    found: list[Crossing] = []
    before: Singularity | None = None
    q: Sequence[np.ndarray] | None = None
    for k, z in enumerate(poses):
        start, q = q, kinematics.point_joints(z, q).q
        now = singularity(kinematics, z, q, complete=False, tolerance=tolerance)
        if now.mechanical:
            found.append(Crossing(k, 0.0, now.mechanical, z))
        elif before is not None and not before.mechanical and start is not None:
            found += _between(kinematics, k - 1, poses[k - 1], z, start, _signs(before), _signs(now))
        before = now
    return tuple(found)


def _between(
    kinematics: Kinematics,
    sample: int,
    a: np.ndarray,
    b: np.ndarray,
    q: Sequence[np.ndarray],
    first: np.ndarray,
    last: np.ndarray,
) -> list[Crossing]:
    """One crossing per sign that differs, found by bisection."""
    result = []
    for index in np.flatnonzero(first != last):
        low, high, joints = 0.0, 1.0, q
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            z = a + middle * (b - a)
            at = kinematics.point_joints(z, joints).q
            if _signs(singularity(kinematics, z, at, complete=False))[index] == first[index]:
                low, joints = middle, at
            else:
                high = middle
        kind = "platform (type II)"
        if index > 0:
            leg = kinematics.description.actuated[index - 1][0]
            kind = f"leg {leg + 1} (type I)"
        result.append(Crossing(sample, high, (kind,), a + high * (b - a)))
    return result


def _signs(measures: Singularity) -> np.ndarray:
    """Signs of det A, then of b."""
    return np.sign([np.linalg.det(measures.pair.A), *measures.pair.b])
