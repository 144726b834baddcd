"""Platforms from TOML files.

name = "flight simulator"
unit = "m"                      # or "mm", for all lengths in the file
base = [[x, y, z], ...]         # anchors in the base frame, one per leg
platform = [[x, y, z], ...]     # anchors in the platform frame

[home]                          # optional: the pose that is meant without another one
position = [x, y, z]
rotation_deg = [rx, ry, rz]     # rotation vector, degrees

[operation_ellipsoid]           # optional, platform frame
center = [x, y, z]
half_axes = [a, b, c]
axes_deg = [rx, ry, rz]         # rotation vector of its axes, degrees
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.toml import read_toml, refuse_unknown, required, subtable, text_at
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.platform import PlatformFile, StewartPlatform

_UNITS = {"m": 1.0, "mm": 1e-3}
_KEYS = ("name", "unit", "base", "platform", "home", "operation_ellipsoid")


def read_platform(path: str | os.PathLike[str]) -> PlatformFile:
    """Read a platform file.

    Raises:
        InputError: the file cannot be read or describes no platform; one line that names file and key.
    """
    path = Path(path)
    return platform_from_dict(read_toml(path), name=path.name)


def platform_from_dict(data: dict[str, Any], *, name: str = "platform") -> PlatformFile:
    """Build a platform from the content of a platform file.

    Args:
        data: nested dictionaries and lists as `tomllib` returns them.
        name: put in front of every message.

    Raises:
        InputError: one line that names the key.
    """
    try:
        return _platform(data, name)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _platform(data: dict[str, Any], name: str) -> PlatformFile:
    refuse_unknown(data, _KEYS, "")
    unit = data.get("unit", "m")
    if not isinstance(unit, str) or unit not in _UNITS:
        raise InputError(f"unit: expected one of {', '.join(_UNITS)}, got {unit!r}")
    scale = _UNITS[unit]
    for key in ("base", "platform"):
        if key not in data:
            raise InputError(f"{key}: missing")
    title = text_at("name", data.get("name", name))
    anchors = [finite_array(key, data[key], (None, 3)) * scale for key in ("base", "platform")]
    platform = StewartPlatform(*anchors, title)
    home = _table(data, "home", ("position", "rotation_deg"))
    position = finite_array("home.position", home.get("position", [0.0, 0.0, 0.0]), (3,)) * scale
    rotation = rotation_from_degrees("home.rotation_deg", home.get("rotation_deg", [0.0, 0.0, 0.0]))
    return PlatformFile(platform, position, rotation, _ellipsoid(data, scale))


def rotation_from_degrees(name: str, vector: object) -> np.ndarray:
    """(3, 3) rotation matrix of a rotation vector (3,) in degrees.

    Raises:
        InputError: no such vector.
    """
    return Rotation.from_rotvec(np.radians(finite_array(name, vector, (3,)))).as_matrix()


def _ellipsoid(data: dict[str, Any], scale: float) -> OperationEllipsoid | None:
    if "operation_ellipsoid" not in data:
        return None
    table = _table(data, "operation_ellipsoid", ("center", "half_axes", "axes_deg"))
    center = finite_array("operation_ellipsoid.center", table.get("center", [0.0, 0.0, 0.0]), (3,))
    half_axes = finite_array(
        "operation_ellipsoid.half_axes", required(table, "half_axes", "operation_ellipsoid"), (3,)
    )
    axes = rotation_from_degrees("operation_ellipsoid.axes_deg", table.get("axes_deg", [0.0, 0.0, 0.0]))
    try:
        return OperationEllipsoid(center * scale, axes, half_axes * scale)
    except InputError as error:
        raise InputError(f"operation_ellipsoid.{error}") from None


def _table(data: dict[str, Any], key: str, known: tuple[str, ...]) -> dict[str, Any]:
    table = subtable(data, key, optional=True)
    refuse_unknown(table, known, f"{key}.")
    return table
