"""The motion of a platform near a singularity: screws of minimum control, lines that its legs are close to.

Near a singularity the legs nearly are path normals of the screw of minimum control e_+, i.e. lines of its
linear complex. If more eigenvalues lambda are about as large as lambda_+, the legs are close to the lines
that all complexes of the spanned pencil or bundle have in common. Source: [Naw07] 6.3.3, (6.10).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, number_from
from ocptip.indices.lines import (
    BUNDLE_TYPES,
    COMPLEX_TOLERANCE,
    PENCIL_TYPES,
    ScrewMotion,
    bundle_type,
    pencil_type,
    screw_decompose,
)
from ocptip.indices.platforms.controllability import ControlNumber, control_number
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.indices.reviewed import RANK_TOLERANCE

NEAR = 0.1
"""Poses with a larger control number are not near a singularity: their legs are close to no line system."""

_FAR = "none: the pose is far from a singularity"
_TRANSLATION = 1e-9
"""Angular velocity, times the platform's extent, below this share of the linear velocity is none."""

_DIMENSIONS = {1: "complex", 2: "pencil", 3: "bundle"}


@dataclass(frozen=True, eq=False)
class SingularMotion:
    """The motion of minimum control of a platform pose.

    Attributes:
        control: the control number of the pose.
        screw: (6,) the screw of minimum control e_+, base frame; an exact self-motion in a singular pose.
        motion: its axis and pitch.
        screws: (6, k) all screws whose lambda is close to lambda_+, e_+ first.
        kind: "complex" (k = 1), "pencil" (2), "bundle" (3) or "more"; "none" far from a singularity.
        type: type of the pencil or bundle, see `PENCIL_TYPES` and `BUNDLE_TYPES`; for one complex "singular"
            (a rotation or a translation: the legs nearly meet its axis) or "regular"; "none" far from a
            singularity.
        lines: the lines the legs are close to, in words.
    """

    control: ControlNumber
    screw: np.ndarray
    motion: ScrewMotion
    screws: np.ndarray
    kind: str
    type: str
    lines: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "control_number": self.control.to_dict(),
            "screw": self.screw.tolist(),
            "motion": self.motion.to_dict(),
            "kind": self.kind,
            "type": self.type,
            "lines": self.lines,
        }


def singular_motion(
    pose: PlatformPose, *, closeness: float = 0.25, tolerance: float | None = None, near: float = NEAR
) -> SingularMotion:
    """Screw of minimum control of a pose and the type of the line system its legs are close to (7.5).

    Args:
        pose: the platform.
        closeness: eigenvalues lambda >= closeness * lambda_+ count as close to lambda_+; in a singular pose
            the infinite ones do.
        tolerance: of the classification, see :func:`ocptip.indices.lines.pencil_type`; default about the
            control number, for the type that holds in the limit.
        near: largest control number at which line systems are named.

    Raises:
        InputError: no platform pose, or closeness not between 0 and 1.
    """
    if not isinstance(pose, PlatformPose):
        raise InputError(f"pose: expected a PlatformPose, got {type(pose).__name__}")
    closeness = number_from("closeness", closeness)
    if not 0.0 < closeness <= 1.0:
        raise InputError(f"closeness: expected 0 < closeness <= 1, got {closeness}")
    control = control_number(pose)
    screw = control.least_controllable
    if control.value > near and screw is not None:
        motion = screw_decompose(screw, tolerance=_TRANSLATION / pose.scale[1])
        return SingularMotion(control, screw, motion, screw[:, None], "none", "none", _FAR)
    if tolerance is None:
        tolerance = max(COMPLEX_TOLERANCE, control.value)
    screws = _kernel(pose) if control.screws is None else _close(control.lambdas, control.screws, closeness)
    count = screws.shape[1]
    # The Klein form is compared in the scaled frame, where angles and lengths weigh alike.
    scaled = [_in_scaled_frame(pose, screws[:, k]) for k in range(count)]
    motion = screw_decompose(screws[:, 0], tolerance=_TRANSLATION / pose.scale[1])
    if count == 1:
        kind, lines = _complex(scaled[0], motion, tolerance)
    elif count == 2:
        kind = pencil_type(*scaled, tolerance=tolerance)
        lines = PENCIL_TYPES[kind]
    elif count == 3:
        kind = bundle_type(*scaled, tolerance=tolerance)
        lines = BUNDLE_TYPES[kind]
    else:
        kind, lines = "degenerate", "fewer lines than a ruled quadric"
    return SingularMotion(control, screws[:, 0], motion, screws, _DIMENSIONS.get(count, "more"), kind, lines)


def _close(lambdas: np.ndarray, screws: np.ndarray, closeness: float) -> np.ndarray:
    top = lambdas[-1]
    chosen = np.isinf(lambdas) if np.isinf(top) else lambdas >= closeness * top
    return screws[:, chosen][:, ::-1]


def _kernel(pose: PlatformPose) -> np.ndarray:
    _, values, rows = np.linalg.svd(pose.scaled.jacobian)
    return pose.screw_from_scaled(rows[values <= RANK_TOLERANCE * values[0]].T)[:, ::-1]


def _in_scaled_frame(pose: PlatformPose, screw: np.ndarray) -> np.ndarray:
    centre, extent = pose.scale
    return np.concatenate([screw[:3], (screw[3:] + np.cross(screw[:3], centre)) / extent])


def _complex(screw: np.ndarray, motion: ScrewMotion, tolerance: float) -> tuple[str, str]:
    norm = screw @ screw
    if motion.is_translation:
        return "singular", "lines orthogonal to one direction"
    if abs(2.0 * screw[:3] @ screw[3:]) <= tolerance * norm:
        return "singular", "lines that meet one line"
    return "regular", "path normals of one screw motion"
