"""Platforms from TOML files.

name = "flight simulator"
unit = "m"                      # or "mm", for all lengths in the file
base = [[x, y, z], ...]         # anchors in the base frame, one per leg
platform = [[x, y, z], ...]     # anchors in the platform frame

[home]                          # optional: the pose that is meant without another one
position = [x, y, z]
rotation_vector_deg = [rx, ry, rz]  # or another form of an orientation, see docs/scenes.md

[operation_ellipsoid]           # optional, platform frame
center = [x, y, z]
half_axes = [a, b, c]
axes_rotation_vector_deg = [rx, ry, rz]  # or another form

Older files call these two `rotation_deg` and `axes_deg`.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import finite_array
from ocptip.basics.toml import Source, Table
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.platform import PlatformFile, StewartPlatform
from ocptip.task_files.kinds import require_kind

_UNITS = {"m": 1.0, "mm": 1e-3}


def read_platform(source: Source, name: str = "platform") -> PlatformFile:
    """Read a platform file.

    Args:
        source: the file, or its content.
        name: put in front of every message about content.

    Raises:
        InputError: the file cannot be read or describes no platform; one line that names file and key.
    """
    with Table.read(source, name) as data:
        require_kind(data, "rate")
        data.close("name", "unit", "base", "platform", "home", "operation_ellipsoid")
        scale, zero = _UNITS[data.choice("unit", _UNITS, "m")], np.zeros(3)
        anchors = [data.array(key, (None, 3)) * scale for key in ("base", "platform")]
        platform = data.make(StewartPlatform, *anchors, data.text("name", data.file))
        home = data.table("home", optional=True)
        position = home.vector("position", 3, zero, scale=scale)
        rotation = home.rotation(default=np.eye(3), also="rotation_deg")
        ellipsoid = None
        if "operation_ellipsoid" in data:
            table = data.table("operation_ellipsoid")
            center = table.vector("center", 3, zero, scale=scale)
            half_axes = table.vector("half_axes", 3, scale=scale)
            axes = table.rotation("axes_", np.eye(3), also="axes_deg")
            ellipsoid = table.make(OperationEllipsoid, center, axes, half_axes)
        return PlatformFile(platform, position, rotation, ellipsoid)


def rotation_from_degrees(name: str, vector: object) -> np.ndarray:
    """(3, 3) rotation matrix of a rotation vector (3,) in degrees.

    Raises:
        InputError: no such vector.
    """
    return Rotation.from_rotvec(np.radians(finite_array(name, vector, (3,)))).as_matrix()
