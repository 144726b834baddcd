"""The table `[[terrain]]` of placement files; format: docs/placement.md."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import InputError
from ocptip.basics.read import read_text
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.placement.ground import Bump, HeightField, HeightGrid, Wave
from ocptip.placement.terrain import Attitude, Patch, plane, rough_ground

_STEEPEST = 80.0  # degrees
_UNEVEN = ("bump", "wave", "grid", "stroke", "attitude")

_BUMP = Keys(
    "bump",
    "A hill height exp(-r^2 / (2 radius^2)), r the distance from its middle.",
    {
        "at": schema.vector("Middle, world.", "m", 2),
        "height": schema.number("Height; negative: a hollow.", "m"),
        "radius": schema.number("Distance from the middle to the steepest point.", "m"),
    },
)
_WAVE = Keys(
    "wave",
    "A ripple amplitude sin(2 pi r / length + phase), r the distance along the direction.",
    {
        "amplitude": schema.number("Amplitude.", "m"),
        "length": schema.number("Wavelength.", "m"),
        "direction_deg": schema.number("Direction, from x of the world.", "deg", default=0.0),
        "phase_deg": schema.number("Phase at the origin.", "deg", default=0.0),
    },
)
_GRID = Keys(
    "grid",
    "Heights on an even grid, at least 4 by 4; in between cubic splines.",
    {
        "x": schema.vector("First and last x.", "m", 2),
        "y": schema.vector("First and last y.", "m", 2),
        "heights": schema.array("Rows of the same y.", "m", (None, None), otherwise="`file`"),
        "file": schema.file("The same rows as comma-separated values.", otherwise="`heights`"),
    },
    one_of=[("heights", "file")],
)
TERRAIN = Keys(
    "terrain",
    "Ground on which the base may stand.",
    {
        "name": schema.text("Title.", otherwise="plane and its number"),
        "slope": schema.vector("Rise per metre along x and y.", "", 2, otherwise="level"),
        "incline_deg": schema.number(f"Inclination, 0 to {_STEEPEST:g} degrees.", otherwise="`slope`"),
        "uphill_deg": schema.number("Uphill direction.", "deg", default=0.0),
        "height": schema.number("Height at the origin of the world.", "m", default=0.0),
        "x": schema.vector("Bounds of the ground point along x.", "m", 2, otherwise="none"),
        "y": schema.vector("Bounds of the ground point along y.", "m", 2, otherwise="none"),
        "angle_deg": schema.vector("Bounds of the angle about the normal.", "deg", 2, otherwise="any angle"),
        "contacts_inside": schema.flag("The bounds hold for every contact.", default=False),
        "bump": schema.tables(_BUMP),
        "wave": schema.tables(_WAVE),
        "grid": schema.table(_GRID, default=None),
        "stroke": schema.vector(
            "Shortest and longest leg: by how much each foot is below its place.",
            "m",
            2,
            otherwise="rigid feet",
        ),
        "attitude": schema.choice(
            "Attitude of a base on legs: parallel to the ground, or level.",
            get_args(Attitude),
            default="ground",
        ),
    },
    at_most_one=[("incline_deg", "slope")],
)


def read_terrain(data: Table) -> list[Patch]:
    """The patches of `[[terrain]]`; the horizontal floor without any.

    Args:
        data: the file.
    """
    patches = data.tables("terrain")
    names = [f"plane {k}" for k in range(1, len(patches) + 1)] if len(patches) != 1 else ["floor"]
    return [_patch(*patch) for patch in zip(patches, names, strict=True)] or [plane()]


def _patch(table: Table, name: str) -> Patch:
    slope, height = _slope(table), table["height"]
    options: dict[str, Any] = {}
    for key in ("x", "y", "angle_deg"):
        low, high = bound = table.get(key, (-np.inf, np.inf))
        if low > high:
            raise table.error(f"the first bound must not be above the second, got {table.value(key)}", key)
        if key in table:
            options[key.removesuffix("_deg")] = tuple(bound)
    options["contacts_inside"] = table["contacts_inside"]
    options["name"] = table.get("name", name)
    if not any(key in table for key in _UNEVEN):
        return table.make(plane, slope, height, **options)
    if "stroke" in table:
        options["stroke"] = stroke = table["stroke"]
        if stroke[0] > stroke[1]:
            raise table.error(f"the first must not be above the second, got {stroke.tolist()}", "stroke")
    options["attitude"] = table["attitude"]
    parts: list[Any] = [
        bump.make(Bump, bump["at"], bump["height"], bump["radius"]) for bump in table.tables("bump")
    ]
    for wave in table.tables("wave"):
        angles = (wave[key] for key in ("direction_deg", "phase_deg"))
        parts.append(wave.make(Wave, wave["amplitude"], wave["length"], *angles))
    if "grid" in table:
        parts.append(_grid(table.table("grid")))
    field = HeightField(*parts, height=height, slope=slope.tolist())
    return table.make(rough_ground, field, **options)


def _slope(table: Table) -> np.ndarray:
    """Slopes (2,) by x and y."""
    slope = table.get("slope", np.zeros(2))
    if table.one_of("slope") == "incline_deg":
        incline = table["incline_deg"]
        if not 0 <= incline <= _STEEPEST:
            raise table.error(f"must be between 0 and {_STEEPEST:g}, got {incline:g}", "incline_deg")
        uphill = table["uphill_deg"]
        slope = np.tan(np.deg2rad(incline)) * np.array([np.cos(uphill), np.sin(uphill)])
    elif "uphill_deg" in table:
        raise table.error("belongs to incline_deg, which is missing", "uphill_deg")
    return slope


def _grid(table: Table) -> HeightGrid:
    """Heights in rows of the same y, in the file or in one of comma-separated values."""
    ends = [table[key] for key in ("x", "y")]
    if table.one_of("file") == "file":
        text = read_text(table["file"])
        try:
            heights = np.array(
                [[float(v) for v in row.split(",")] for row in text.splitlines() if row.strip()]
            )
        except ValueError as error:
            raise table.error(f"expected rows of numbers of the same length: {error}", "file") from None
        if heights.ndim != 2:
            raise InputError(f"expected rows of numbers, got {text[:20]!r}", table.place("file"), table.file)
    else:
        heights = table["heights"]
    rows, columns = heights.shape
    (x_first, x_last), (y_first, y_last) = ends
    x, y = np.linspace(x_first, x_last, columns), np.linspace(y_first, y_last, rows)
    return table.make(HeightGrid, x, y, heights)
