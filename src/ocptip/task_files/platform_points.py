"""Platforms from TOML files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Source, Table
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.platform import StewartPlatform
from ocptip.indices.platforms.reviewed import PlacedPlatform
from ocptip.task_files.doubts import require_kind

_UNITS = {"m": 1.0, "mm": 1e-3}


def _older(keys: dict[str, schema.Key], name: str) -> dict[str, schema.Key]:
    """The forms of an orientation, and the name that a rotation vector has in older files."""
    vector = keys["rotation_vector_deg" if name == "rotation_deg" else "axes_rotation_vector_deg"]
    return {**keys, name: replace(vector, meaning=f"{vector.meaning[:-1]}; in older files.")}


_HOME = schema.rotation("Axes of the platform to those of the base", default="parallel to the base")
_AXES = schema.rotation("Axes of the ellipsoid to those of the platform", "axes_", default="parallel")
PLATFORM = Keys(
    "platform of anchors",
    "The anchors of a Stewart platform: `ocptip rate`.",
    {
        "name": schema.text("Title.", otherwise="name of the file"),
        "unit": schema.choice("Unit of all lengths in the file.", _UNITS, default="m"),
        "base": schema.array("Anchors on the base, one for each leg.", "`unit`", (None, 3)),
        "platform": schema.array("Anchors on the platform, platform axes.", "`unit`", (None, 3)),
        "home": schema.table(
            Keys(
                "home",
                "The pose that is meant without another one.",
                {
                    "position": schema.vector("Origin of the platform.", "`unit`", 3, default=[0, 0, 0]),
                    **_older(_HOME, "rotation_deg"),
                },
                at_most_one=[(*_HOME, "rotation_deg")],
            ),
            default=None,
        ),
        "operation_ellipsoid": schema.table(
            Keys(
                "operation ellipsoid",
                "The operation ellipsoid, platform axes.",
                {
                    "center": schema.vector("Centre.", "`unit`", 3, default=[0, 0, 0]),
                    "half_axes": schema.vector("Half axes.", "`unit`", 3),
                    **_older(_AXES, "axes_deg"),
                },
                at_most_one=[(*_AXES, "axes_deg")],
            ),
            default=None,
        ),
    },
)


def read_platform(source: Source, name: str = "platform") -> PlacedPlatform:
    """Read a platform file.

    Args:
        source: the file, or its content.
        name: put in front of every message about content.

    Raises:
        InputError: the file cannot be read or describes no platform; one line that names file and key.
    """
    with Table.read(source, PLATFORM, name) as data:
        require_kind(data, "rate")
        data.close(early=True)
        scale = _UNITS[data["unit"]]
        anchors = [data[key] * scale for key in ("base", "platform")]
        platform = data.make(StewartPlatform, *anchors, data.get("name", data.file))
        home = data.table("home")
        position = scale * home["position"]
        rotation = home.rotation(default=np.eye(3))
        ellipsoid = None
        if "operation_ellipsoid" in data:
            table = data.table("operation_ellipsoid")
            center = scale * table["center"]
            half_axes = scale * table["half_axes"]
            axes = table.rotation("axes_", np.eye(3))
            ellipsoid = table.make(OperationEllipsoid, center, axes, half_axes)
        return PlacedPlatform(platform, position, rotation, ellipsoid)
