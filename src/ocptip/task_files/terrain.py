"""The table `[[terrain]]` of placement files; format: docs/placement.md."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.read import read_text
from ocptip.basics.toml import DEGREES, Table
from ocptip.placement.ground import Bump, HeightField, HeightGrid, Wave
from ocptip.placement.terrain import Attitude, Patch, plane, rough_ground

_STEEPEST = 80.0  # degrees
_UNEVEN = ("bump", "wave", "grid", "stroke", "attitude")


def read_terrain(data: Table) -> list[Patch]:
    """The patches of `[[terrain]]`; the horizontal floor without any.

    Args:
        data: the file.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    patches = data.tables("terrain")
    names = [f"plane {k}" for k in range(1, len(patches) + 1)] if len(patches) != 1 else ["floor"]
    return [_patch(*own) for own in zip(patches, names, strict=True)] or [plane()]


def _patch(table: Table, name: str) -> Patch:
    slope, height = _slope(table), table.number("height", 0.0)
    options: dict[str, Any] = {}
    for key, scale in (("x", 1.0), ("y", 1.0), ("angle_deg", DEGREES)):
        low, high = bound = table.vector(key, 2, (-np.inf, np.inf), scale=scale)
        if low > high:
            raise table.error(f"the first bound must not be above the second, got {table.value(key)}", key)
        if key in table:
            options[key.removesuffix("_deg")] = tuple(bound)
    options["contacts_inside"] = table.flag("contacts_inside", False)
    options["name"] = table.text("name", name)
    if not any(key in table for key in _UNEVEN):
        return table.make(plane, slope, height, **options)
    if "stroke" in table:
        options["stroke"] = stroke = table.vector("stroke", 2)
        if stroke[0] > stroke[1]:
            raise table.error(f"the first must not be above the second, got {stroke.tolist()}", "stroke")
    options["attitude"] = table.choice("attitude", get_args(Attitude), "ground")
    parts: list[Any] = [
        bump.make(Bump, bump.vector("at", 2), bump.number("height"), bump.number("radius"))
        for bump in table.tables("bump")
    ]
    for wave in table.tables("wave"):
        angles = (wave.number(key, 0.0, scale=DEGREES) for key in ("direction_deg", "phase_deg"))
        parts.append(wave.make(Wave, wave.number("amplitude"), wave.number("length"), *angles))
    if "grid" in table:
        parts.append(_grid(table.table("grid")))
    field = HeightField(*parts, height=height, slope=slope)
    return table.make(rough_ground, field, **options)


def _slope(table: Table) -> np.ndarray:
    """Slopes (2,) by x and y."""
    slope = table.vector("slope", 2, np.zeros(2))
    if table.one_of("incline_deg", "slope", optional=True) == "incline_deg":
        incline = table.number("incline_deg")
        if not 0 <= incline <= _STEEPEST:
            raise table.error(f"must be between 0 and {_STEEPEST:g}, got {incline:g}", "incline_deg")
        uphill = table.number("uphill_deg", 0.0, scale=DEGREES)
        slope = np.tan(np.deg2rad(incline)) * np.array([np.cos(uphill), np.sin(uphill)])
    elif "uphill_deg" in table:
        raise table.error("belongs to incline_deg, which is missing", "uphill_deg")
    return slope


def _grid(table: Table) -> HeightGrid:
    """Heights in rows of the same y, in the file or in one of comma-separated values."""
    ends = [table.vector(key, 2) for key in ("x", "y")]
    if table.one_of("heights", "file") == "file":
        text = read_text(table.path_of("file"))
        try:
            heights = np.array(
                [[float(v) for v in row.split(",")] for row in text.splitlines() if row.strip()]
            )
        except ValueError as error:
            raise table.error(f"expected rows of numbers of the same length: {error}", "file") from None
        if heights.ndim != 2:
            raise InputError(f"expected rows of numbers, got {text[:20]!r}", table.place("file"), table.file)
    else:
        heights = table.array("heights", (None, None))
    rows, columns = heights.shape
    x, y = (np.linspace(*end, count) for end, count in zip(ends, (columns, rows), strict=True))
    return table.make(HeightGrid, x, y, heights)
