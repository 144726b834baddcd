"""An arm out of what users have: the path of a URDF, its text, or a model of Pinocchio."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, rotation_matrix, too_light
from ocptip.numerics.inertia import RigidBody
from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import PinocchioModel
from ocptip.robots.urdf.arm import arm_from_pinocchio, arm_from_urdf
from ocptip.robots.urdf.collision import geometry_from_urdf
from ocptip.robots.urdf.resting import resting_body

_TEXT = "robot.urdf"
"""Name of the file, in messages, for a URDF that is given as text."""


def arm_from(
    source: str | os.PathLike[str] | PinocchioModel,
    *,
    base_link: str | None = None,
    tool_frame: str | None = None,
    locked_joints: Mapping[str, float] | None = None,
    collision: bool = True,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
) -> ArmModel:
    """Read an arm with its collision geometry; joints without an acceleration limit get a usual one.

    Args:
        source: path of a URDF, its text, or a Pinocchio model, which has no collision geometry.
        base_link, tool_frame: see `arm_from_urdf`; for a Pinocchio model "universe" by default, and required.
        locked_joints: joint name to angle, rad (sliding joints: m), of joints that do not move.
        collision: whether the URDF's collision geometry is read.
        package_dirs: folders with the packages that mesh names refer to.

    Raises:
        InputError: `source` cannot be used; one line that says why.
    """
    names = {"base_link": base_link, "tool_frame": tool_frame, "locked_joints": locked_joints}
    if not isinstance(source, str | os.PathLike):
        return _from_model(source, **names).with_usual_accelerations("the model")
    with file_of(source) as path:
        arm = arm_from_urdf(path, **names)
        if collision:
            arm = replace(arm, geometry=geometry_from_urdf(path, arm, package_dirs=package_dirs))
    return arm.with_usual_accelerations("the URDF")


def base_of(
    source: str | os.PathLike[str] | PinocchioModel,
    arm: ArmModel,
    mass: float | None,
    center_of_mass: ArrayLike | None,
    mount_position: ArrayLike,
    mount_rotation: np.ndarray | None,
) -> tuple[float, ArrayLike]:
    """Mass, kg, and centre of mass, m, base axes, of the base; by default of all links that rest.

    Raises:
        InputError: one is missing and no link that rests has a mass, or such links have more mass.
    """
    if mass is None or center_of_mass is None:
        result, centre, _ = _resting_links(source, arm)
        if not result:
            name = "base_mass" if mass is None else "base_com"
            raise InputError(f"{name}: missing; the links of the arm's file that rest have no mass")
        turn = np.eye(3) if mount_rotation is None else rotation_matrix("mount_rotation", mount_rotation)
        mass = result if mass is None else mass
        center_of_mass = np.add(mount_position, turn @ centre) if center_of_mass is None else center_of_mass
    if reason := too_light(mass, arm.base_mass):
        raise InputError(f"base_mass: {reason}")
    return mass, center_of_mass


def _resting_links(source: str | os.PathLike[str] | PinocchioModel, arm: ArmModel) -> RigidBody:
    """All links of `source` that rest, as one body in the frame of `base_link`; zeros: it has none."""
    if not isinstance(source, str | os.PathLike):
        return 0.0, np.zeros(3), np.zeros((3, 3))
    with file_of(source) as path:
        return resting_body(path, arm)


def _from_model(
    model: PinocchioModel, *, base_link: str | None, tool_frame: str | None, **others: Any
) -> ArmModel:
    if not (hasattr(model, "jointPlacements") and hasattr(model, "inertias")):
        kind = type(model).__name__
        raise InputError(f"source: expected the path of a URDF, its text, or a pinocchio.Model, got {kind}")
    if tool_frame is None:
        known = ", ".join([frame.name for frame in model.frames][-3:])
        raise InputError(f"tool_frame: missing; a Pinocchio model needs it, its last frames are {known}")
    return arm_from_pinocchio(model, base_link=base_link or "universe", tool_frame=tool_frame, **others)


@contextmanager
def file_of(source: str | os.PathLike[str]) -> Iterator[Path]:
    """The file of a path, or a temporary one of a text; messages do not name its folder."""
    if not (isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")):
        yield Path(source)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, _TEXT)
        path.write_text(source, encoding="utf-8")
        try:
            yield path
        except InputError as error:
            raise InputError(f"{error}".replace(str(path), _TEXT), "") from None
