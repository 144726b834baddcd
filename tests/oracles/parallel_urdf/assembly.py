"""The home pose of a robot read from URDF: closed exactly, its free coordinates found, its platform frame."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.parallel.analysis.mobility import stacked_closures
from ocptip.parallel.description.frames import Frame, PlatformCoordinates
from ocptip.parallel.description.platform import COORDINATES, Platform
from ocptip.parallel.kinematics.closures import LegClosure

_ITERATIONS = 20
_RANK = 1e-7
_FREE = 1e-6
_LOCKED = 1e-7
_CONDITIONED = 0.1


def closed_home(
    legs: Sequence[LegClosure], q: Sequence[np.ndarray], platform: Frame
) -> tuple[list[np.ndarray], Frame]:
    """Joint positions and platform frame nearest to given ones at which all closures hold (Gauss-Newton).

    Args:
        legs: of the robot.
        q: (n,) joint positions per leg, rad or m.
        platform: frame, world axes.
    """
    q, (R, r) = [np.array(values) for values in q], platform
    starts = np.cumsum([0, *(leg.n for leg in legs)])
    for _ in range(_ITERATIONS):
        errors = np.concatenate([leg.residual(values, r, R) for leg, values in zip(legs, q, strict=True)])
        if np.abs(errors).max() < 1e-14:
            break
        step = np.linalg.lstsq(stacked_closures(legs, q, R), -errors, rcond=_RANK)[0]
        q = [values + step[a:b] for values, a, b in zip(q, starts[:-1], starts[1:], strict=True)]
        r, R = r + step[-6:-3], Rotation.from_rotvec(step[-3:]).as_matrix() @ R
    return q, (R, r)


def free_coordinates(
    legs: Sequence[LegClosure], q: Sequence[np.ndarray], platform: Frame, convention: str
) -> tuple[bool, ...]:
    """Which of x, y, z, phi1, phi2, phi3 the closures leave free.

    Raises:
        InputError: the possible twists are not spanned by coordinate directions.
    """
    matrix = stacked_closures(legs, q, platform[0])
    _, values, right = np.linalg.svd(matrix)
    rank = int(np.sum(values > _RANK * values[0]))
    _, sizes, twists = np.linalg.svd(right[rank:, -6:], full_matrices=False)
    twists = twists[sizes > _FREE]
    # A unit twist is possible if its projection on the possible ones is itself.
    free = [bool(abs(np.linalg.norm(twists[:, i]) - 1.0) < _FREE) for i in range(6)]
    turning = [i for i in range(3) if free[3 + i]]
    if sum(free) != len(twists) or len(turning) == 2 or not any(free):
        raise InputError(
            f"free: the platform has {len(twists)} degrees of freedom in the home pose, but not along single "
            f"ones of {', '.join(COORDINATES)}; name the free ones"
        )
    angles = [len(turning) == 3] * 3
    if len(turning) == 1:
        angles[convention.index("xyz"[turning[0]])] = True
    return (*free[:3], *angles)


def platform_frame(link: Frame, mask: Sequence[bool], convention: str) -> tuple[Frame, np.ndarray]:
    """The frame in the platform whose locked coordinates are zero in the home pose, and its coordinates.

    It is the platform link's, as far as it can be: its origin is moved along locked directions, and its axes
    are the world's where the link's do not fit the free angles.

    Args:
        link: frame of the platform's link in the home pose, world axes.
        mask: free ones of x, y, z, phi1, phi2, phi3.
        convention: of the platform's rotations.

    Returns:
        The frame in the home pose, world axes; its free coordinates (m,).

    Raises:
        InputError: the link's origin would have to be moved although the platform tilts.
    """
    R, p = link
    _require_movable(p, mask, convention)
    angles = np.zeros(3)
    for turn in (R, np.eye(3)):
        angles = _angles(turn, convention)
        locked = np.abs(np.where(mask[3:], 0.0, angles)).max()
        full = np.concatenate([p, angles])[list(mask)]
        conditioned = PlatformCoordinates(Platform(tuple(mask), convention)).conditioning(full)
        if locked < _LOCKED and conditioned > _CONDITIONED:
            break
    angles = np.where(mask[3:], angles, 0.0)
    z = np.concatenate([p, angles])[list(mask)]
    r, turned = PlatformCoordinates(Platform(tuple(mask), convention)).pose(z)
    return (np.asarray(turned, dtype=float), np.asarray(r, dtype=float)), z


def _require_movable(p: np.ndarray, mask: Sequence[bool], convention: str) -> None:
    """Raise if the platform's turns would move a point that is shifted to zero along locked directions."""
    shift = np.where(mask[:3], 0.0, p)
    axes = [letter for free, letter in zip(mask[3:], convention, strict=True) if free]
    if len(axes) == 1:
        shift["xyz".index(axes[0])] = 0.0
    if axes and np.abs(shift).max() > _LOCKED:
        raise InputError(
            f"platform: its link is at {np.round(p, 6).tolist()} m in the home pose, but not all of x, y, z "
            "are free and it tilts; choose a link whose locked coordinates are zero"
        )


def _angles(R: np.ndarray, convention: str) -> np.ndarray:
    with warnings.catch_warnings():  # of a singular attitude; the caller looks at its conditioning
        warnings.simplefilter("ignore", UserWarning)
        return Rotation.from_matrix(R).as_euler(convention.upper())
