"""Figure of load charts: reach by azimuth from above, payload over reach and height from the side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ocptip.pictures import style
from ocptip.pictures.frame import new_figure, png
from ocptip.standing.largest_payload import ChartCell, ReachBySector

_EMPTY, _COLORS = "#e8e8e8", "YlGnBu"
_ARC = 24  # points of a sector


Edges = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Ends of cells: azimuth, rad, reach and height, m."""


def chart_picture(
    name: str,
    scope: str,
    edges: Edges,
    side: Sequence[ChartCell],
    plan: Sequence[ChartCell],
    reaches: Sequence[ReachBySector],
    feet: np.ndarray,
) -> bytes:
    """Draw a PNG from above, with reaches by azimuth, and from the side: any and the best posture.

    Args:
        name, scope: for the title.
        edges: of the cells.
        side, plan: cells of all azimuths, and of all heights.
        reaches: of payloads.
        feet: (n, 3), m: the contacts.
    """
    figure = new_figure(13.0, 5.2)
    grid = figure.add_gridspec(1, 3, width_ratios=(1.15, 1, 1))
    top = max((one.best_posture for one in side), default=0.0) or 1.0
    image = _plan(figure.add_subplot(grid[0], projection="polar"), edges, plan, reaches, feet, top)
    panels = [figure.add_subplot(grid[k]) for k in (1, 2)]
    for ax, key, title in (
        (panels[0], "any_posture", "From the side: any posture"),
        (panels[1], "best_posture", "From the side: best posture"),
    ):
        _side(ax, edges, side, key, top)
        ax.set_title(title, loc="left", fontsize=10.5)
    figure.colorbar(image, ax=panels, label="largest payload [kg]", shrink=0.8)
    style.head(figure, f"{name}: load chart at rest", scope)
    style.note(figure, "payloads [kg] of sampled postures that collide with nothing; grey: no posture")
    return png(figure)


def _plan(
    ax: Any,
    ends: Edges,
    cells: Sequence[ChartCell],
    lines: Sequence[ReachBySector],
    feet: np.ndarray,
    top: float,
) -> Any:
    """Payload in any posture; lines: the reach of each payload in any posture, dashed: in the best one."""
    edges, reaches = ends[:2]
    values = np.full((len(reaches) - 1, len(edges) - 1), np.nan)
    for one in cells:
        assert one.azimuth is not None  # of a view from above
        at = np.searchsorted(reaches, one.reach[0]), np.searchsorted(edges, one.azimuth[0])
        values[at] = one.any_posture
    ax.set_facecolor(_EMPTY)
    # Sides of cells are arcs only where there are points between their corners.
    fine = np.concatenate([np.linspace(*pair, _ARC, endpoint=False) for pair in pairwise(edges)])
    turns = np.append(fine, edges[-1])
    spread = np.ma.masked_invalid(np.repeat(values, _ARC, axis=1))
    image = ax.pcolormesh(turns, reaches, spread, cmap=_COLORS, vmin=0.0, vmax=top)
    widths = np.linspace(4.5, 1.2, len(lines))  # lines often lie on each other
    for number, (one, width) in enumerate(zip(lines, widths, strict=True)):
        for limits, dashes in ((one.any_posture, "-"), (one.best_posture, (0, (2, 1)))):
            reach = np.repeat([np.nan if end is None else end for end in limits], _ARC)
            line = {"color": style.MEMBERS[number % len(style.MEMBERS)], "ls": dashes, "lw": width}
            label = f"{one.payload:.3g} kg" if dashes == "-" else None
            ax.plot(turns, np.append(reach, reach[0]), **line, label=label, gid=f"reach-{number}")
    feet = feet[:, :2] - feet[:, :2].mean(axis=0)
    ax.plot(np.arctan2(feet[:, 1], feet[:, 0]), np.hypot(*feet.T), "s", color="black", ms=5, label="contacts")
    ax.set_ylim(0.0, 1.05 * max(float(reaches[-1]), float(np.hypot(*feet.T).max())))
    ax.set_title(
        "From above: payload in any posture; lines:\nlargest reach of a payload (dashed: best posture)",
        loc="left",
        fontsize=10.5,
    )
    ax.tick_params(labelsize=8, labelcolor=style.NOTE)
    ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(-0.3, 0.22), **style.TEXT)
    return image


def _side(ax: Any, edges: Edges, cells: Sequence[ChartCell], key: str, top: float) -> None:
    reaches, heights = edges[1:]
    values = np.full((len(heights) - 1, len(reaches) - 1), np.nan)
    for one in cells:
        assert one.height is not None  # of a side view
        at = np.searchsorted(heights, one.height[0]), np.searchsorted(reaches, one.reach[0])
        values[at] = getattr(one, key)
    ax.set_facecolor(_EMPTY)
    ax.pcolormesh(reaches, heights, np.ma.masked_invalid(values), cmap=_COLORS, vmin=0.0, vmax=top)
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            middle = (reaches[column : column + 2].mean(), heights[row : row + 2].mean())
            color = "white" if value > 0.6 * top else "black"
            digits = 1 if value < 100 else 0
            text = f"{np.floor(value * 10**digits + 1e-9) / 10**digits:.{digits}f}"
            ax.text(*middle, text, ha="center", va="center", color=color, fontsize=8.5)
    ax.set_aspect("equal")
    ax.set_xlabel("reach from the centre of the contacts [m]")
    ax.set_ylabel("height above the lowest contact [m]")
