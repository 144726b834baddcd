"""Figures of what a robot at rest on its base holds: load charts, drive envelopes, tilts and payloads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.pictures import style
from ocptip.pictures.frame import new_figure, png
from ocptip.standing.at_rest.chart_cells import ChartCell, ReachBySector
from ocptip.standing.at_rest.drive_envelope import LargestManoeuvres
from ocptip.standing.at_rest.manoeuvres import LARGEST
from ocptip.standing.within.design import BALLAST, FOOT_WIDTH, SPEED, DesignLevels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EMPTY, _LESS = "#e8e8e8", "#ffffff"  # cells without postures; those that hold less than the smallest level
_SHADES = ((250, 253, 206), (185, 227, 181), (64, 181, 195), (34, 104, 173), (17, 36, 107))  # of levels
_ARC, _RINGS = 24, 5  # points of a sector; circles of reach, at most
_FEW = 20  # postures: what holds in all of so few says little of the others


Edges = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Ends of cells: azimuth, rad, reach and height, m."""

Words = tuple[str, str, str, str]
"""Task, what is charted, its unit, and the scope."""

_VIEWS = (("any_posture", "any posture"), ("best_posture", "the best posture"))


def chart_figure(
    words: Words, edges: Edges, side: Sequence[ChartCell], reaches: Sequence[ReachBySector], feet: np.ndarray
) -> Figure:
    """From above the reach of each level by azimuth, from the side the cells: any and the best posture.

    Args:
        words: for titles.
        edges: of the cells.
        side: cells of all azimuths.
        reaches: of levels, in ascending order.
        feet: (n, 3), m: the contacts.
    """
    figure = new_figure(11.0, 9.6)
    name, title, unit, scope = words
    levels = np.array([one.level for one in reaches])
    colors = _colors(len(levels))
    for column, (key, words_of_key) in enumerate(_VIEWS):
        above = figure.add_subplot(2, 2, column + 1, projection="polar")
        _above(above, edges, reaches, key, colors, feet, unit)
        above.set_title(f"In {words_of_key}: reach of each value, from above", loc="left", fontsize=10.5)
        beside = figure.add_subplot(2, 2, column + 3)
        _beside(beside, edges, side, key, levels, colors)
        beside.set_title(f"In {words_of_key} [{unit}], from the side", loc="left", fontsize=10.5)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside right center", frameon=False, **style.TEXT)
    style.head(figure, f"{name}: {title} [{unit}]", scope)
    style.note(
        figure,
        "any posture: all sampled ones hold the value, from above all up to that reach; best posture: one "
        f"does; grey from above: no posture, or {levels[0]:.3g} {unit} is not held; "
        f"0.0 from the side: 0 {unit}, or not even that; hatched: fewer than {_FEW} postures sampled",
    )
    return figure


def _colors(count: int) -> np.ndarray:
    """(count, 3): from the lightest to the darkest."""
    places, ends = np.linspace(0.0, 1.0, len(_SHADES)), np.array(_SHADES).T / 255
    return np.column_stack([np.interp(np.linspace(0.0, 1.0, count), places, end) for end in ends])


def _above(
    ax: Any,
    edges: Edges,
    reaches: Sequence[ReachBySector],
    key: str,
    colors: np.ndarray,
    feet: np.ndarray,
    unit: str,
) -> None:
    """Sectors up to the reach of each level: a larger level has no larger reach and lies on the smaller."""
    ax.set_facecolor(_EMPTY)
    if (least := reaches[0].level) > 0:
        ax.fill(np.nan, np.nan, fc=_LESS, ec="black", lw=0.6, label=f"less than {least:.3g} {unit}")
    # Ends of sectors are arcs only where there are points between their corners.
    turns = np.concatenate([np.linspace(*pair, _ARC) for pair in pairwise(edges[0])])
    for number, (one, color) in enumerate(zip(reaches, colors, strict=True)):
        reach = np.repeat([end or 0.0 for end in getattr(one, key)], _ARC)
        named = {"label": f"at least {one.level:.3g} {unit}", "gid": f"reach-{number}"}
        ax.fill_between(turns, 0.0, reach, color=color, lw=0, **named)
    ax.fill(np.nan, np.nan, color=_EMPTY, label="no posture")
    feet = feet[:, :2] - feet[:, :2].mean(axis=0)
    ax.plot(np.arctan2(feet[:, 1], feet[:, 0]), np.hypot(*feet.T), "s", color="black", ms=5, label="contacts")
    ax.set_ylim(0.0, 1.05 * max(float(edges[1][-1]), float(np.hypot(*feet.T).max())))
    ends = edges[1][1:]
    every = (len(ends) + _RINGS - 1) // _RINGS
    ax.set_yticks(ends[::-every][::-1])
    _readable_ticks(ax, " m")


def _readable_ticks(ax: Any, unit: str = "") -> None:
    """Small labels of polar axes; those of radii are texts, as lines are above labels of ticks."""
    ax.tick_params(labelcolor=style.NOTE, labelsize=8)
    ends = [end for end in ax.get_yticks() if 0 < end <= ax.get_ylim()[1]]
    ax.set_yticks(ends, labels=[""] * len(ends))
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.8}
    for end in ends:
        text = {"color": style.NOTE, "fontsize": 8, "ha": "center", "va": "center", "zorder": 8, "bbox": box}
        ax.text(np.pi / 8, end, f"{end:.3g}{unit}", **text)


def _beside(
    ax: Any, edges: Edges, cells: Sequence[ChartCell], key: str, levels: np.ndarray, colors: np.ndarray
) -> None:
    """Cells by reach and height in the colour of the largest level that they hold, with their value."""
    reaches, heights = edges[1:]
    ax.set_facecolor(_EMPTY)
    for one in cells:
        assert one.height is not None  # of a side view
        value, low = getattr(one, key), (one.reach[0], one.height[0])
        size = one.reach[1] - low[0], one.height[1] - low[1]
        band = int(np.searchsorted(levels, value, side="right")) - 1
        shade = colors[band] if band >= 0 else _LESS
        few = {"hatch": "///"} if one.postures < _FEW else {}
        ax.bar(low[0], size[1], size[0], low[1], align="edge", color=shade, ec="white", lw=0.6, **few)
        digits = 1 if value < 100 else 0
        text = f"{np.floor(value * 10**digits + 1e-9) / 10**digits:.{digits}f}"
        color = "white" if band > 0.55 * (len(levels) - 1) else "black"
        middle = low[0] + 0.5 * size[0], low[1] + 0.5 * size[1]
        box = {"facecolor": shade, "edgecolor": "none", "pad": 1.5}  # keeps the hatch away
        ax.text(*middle, text, ha="center", va="center", color=color, fontsize=8.5, bbox=box)
    ax.set(xlim=reaches[[0, -1]], ylim=heights[[0, -1]], aspect="equal")
    ax.set_xlabel("reach from the centre of the contacts [m]")
    ax.set_ylabel("height above the lowest contact [m]")


_DESIGNS = {
    BALLAST: ("ballast", "ballast at the centre of mass of the base [kg]"),
    FOOT_WIDTH: ("foot width", "foot width / present width"),
    SPEED: ("speed", "speed override"),
}


def design_picture(words: Words, reaches: np.ndarray, designs: Sequence[DesignLevels]) -> bytes:
    """Draw a PNG of levels over ballast, foot width and speed, one line per reach.

    Args:
        words: for titles.
        reaches: (k + 1,), m, ends of the cells of the designs.
        designs: of changed bases and speeds.
    """
    name, title, unit, scope = words
    quantities = list(dict.fromkeys(design.quantity for design in designs))
    figure = new_figure(1.2 + 5.2 * len(quantities), 4.2)
    for ax, design in zip(figure.subplots(1, len(quantities), squeeze=False)[0], quantities, strict=True):
        rows = sorted((one for one in designs if one.quantity == design), key=lambda one: one.value)
        values = [one.value for one in rows]
        widths = np.linspace(4.5, 1.2, len(reaches) - 1)  # lines often lie on each other
        for k, (end, width) in enumerate(zip(reaches[1:], widths, strict=True)):
            held = np.array([one.levels[k] for one in rows], dtype=float)
            if np.isfinite(held).any():
                ax.plot(
                    values,
                    held,
                    marker="o",
                    ms=4,
                    lw=width,
                    **style.member(k),
                    label=f"to {end:.3g} m",
                    gid=f"reach-{k}",
                )
        ax.set_ylim(bottom=0.0)
        style.finish(
            ax,
            f"{title.capitalize()} that all postures keep, by reach",
            f"{title} [{unit}]",
            _DESIGNS[design][1],
        )
    varied = " and ".join(_DESIGNS[design][0] for design in quantities)
    style.head(figure, f"{name}: {title} by {varied}", scope)
    style.note(figure, f"from the {title} on the left to a line, then down: the {varied} that keeps it")
    return png(figure)


_WHEELS = {"color": "black", "ms": 4, "label": "contacts, not to scale"}
_WIDEST = 1.6  # times the median limit: what lies farther out is not drawn


def envelope_figure(
    name: str,
    scope: str,
    angles: np.ndarray,
    nominal: LargestManoeuvres,
    within: LargestManoeuvres | None,
    feet: np.ndarray,
    objects: Mapping[str, LargestManoeuvres],
) -> Figure:
    """The tip and the slip limit around the base, nominal and in the worst case.

    Of objects the smaller limit, in the worst case if there is one. What keeps all is shaded.

    Args:
        name, scope: for the title.
        angles: (D,) rad, directions of the first D results.
        nominal, within: results.
        feet: (n, 3), m: the contacts.
        objects: results by name.
    """
    figure = new_figure(6.6, 6.2)
    ax: Any = figure.add_subplot(projection="polar")
    ax.set_theta_zero_location("N")  # forward is up, as from above
    count, around = len(angles), np.append(angles, angles[0])
    known = [carried.largest[:count] for carried in (nominal, within) if carried is not None]
    top = _WIDEST * float(np.median(np.minimum(known[0], LARGEST))) or 1.0
    cases = [("nominal", nominal, style.NOMINAL)]
    if within is not None:
        cases.append(("worst case", within, style.WORST_CASE))
    for title, carried, line in cases:
        friction = np.minimum(carried.slip, carried.alike)
        slips = np.where(friction < carried.tip, friction, np.nan)[:count]
        for word, values, color in (
            ("the base tips", carried.tip[:count], style.TIPPING.color),
            ("wheels slide", slips, style.FRICTION.color),
        ):
            drawn = np.where(values < LARGEST, values, np.nan)
            if np.isfinite(drawn).any():
                least = float(np.nanmin(drawn))
                beyond = f": beyond {least:.3g} m/s^2" if least > top else ""
                label = f"{word}, {title}{beyond}"
                ax.plot(around, np.append(drawn, drawn[0]), color=color, label=label, **line)
    for number, (word, carried) in enumerate(objects.items()):
        drawn = np.where(carried.largest < LARGEST, carried.largest, np.nan)[:count]
        closed = np.append(drawn, drawn[0])
        ax.plot(around, closed, **style.member(number), lw=1.4, label=f"{word} tips or slides")
    least = np.min([known[-1], *(carried.largest[:count] for carried in objects.values())], axis=0)
    ax.fill(around, np.append(least, least[0]), color=style.SHADE, zorder=0, gid="envelope")
    places = feet[:, :2] - feet[:, :2].mean(axis=0)
    shown = 0.25 * top * places / max(float(np.hypot(*places.T).max()), 1e-9)
    ax.plot(np.arctan2(shown[:, 1], shown[:, 0]), np.hypot(*shown.T), "s", **_WHEELS)
    ax.set_ylim(0.0, top)
    _readable_ticks(ax)
    ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(-0.18, 0.06), **style.TEXT)
    style.head(figure, f"{name}: drive envelope", scope)
    style.note(figure, "largest acceleration of the base [m/s^2] by direction; up: forward (x axis)")
    return figure


def tilt_figure(result: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Largest tilts over the direction downhill, seen from above.

    Args:
        found: by pose: directions (k, 3), base axes, and tilts (k,), rad.
    """
    figure = new_figure(6.0, 5.6)
    ax = figure.add_subplot(projection="polar")
    widths = np.linspace(6.0, 1.5, max(len(result), 2))  # curves often lie on each other
    for number, ((name, (sides, tilts)), width) in enumerate(zip(result.items(), widths, strict=False)):
        turns = np.arctan2(sides[:, 1], sides[:, 0])
        order = np.argsort(turns)
        order = np.append(order, order[0])
        ax.plot(
            turns[order],
            np.degrees(tilts)[order],
            **style.member(number),
            lw=width,
            label=name,
            gid=f"tilt-{name}",
        )
    ax.set_ylim(bottom=0.0)
    _readable_ticks(ax)
    ax.set_title("Largest tilt of the floor at rest [deg], by direction downhill (0: x, 90: y)", fontsize=9.5)
    figure.legend(frameon=False, loc="outside lower center", ncols=2, **style.TEXT)
    return figure


def payload_figure(times: np.ndarray, masses: np.ndarray, drives: float | None = None) -> Figure:
    """Largest further payload (N,), kg, in the postures at times (N,), s, of a motion, at rest there.

    Args:
        times, masses: of the postures; what contacts hold.
        drives: kg that the drives move in the whole motion; what is above it is of no use and not drawn.
    """
    figure = new_figure(8.0, 3.2)
    ax = figure.subplots()
    ax.plot(times, masses, color=style.PAYLOAD.color, **style.NOMINAL, label="contacts", gid="payload")
    top = float(np.max(masses))
    if drives is not None and drives < top:
        ax.axhline(drives, **style.LIMIT, label="drives", gid="drives")
        top = max(drives, float(np.min(masses)))
    least = f"at least {float(np.min(masses)):.3g} kg more"
    style.finish(
        ax, f"Largest payload at rest: {least}", style.PAYLOAD.label, "posture at time [s] of the motion"
    )
    ax.set_ylim(0.0, 1.15 * max(top, 1e-9))
    return figure


def speed_figure(speeds: np.ndarray, moments: np.ndarray, friction: np.ndarray) -> Figure:
    """Minimum tipping margin (S,), N m, and maximum friction used (S,) over the speed of a motion."""
    figure = new_figure(8.0, 3.2)
    panels = figure.subplots(1, 2)
    for ax, quantity, values in zip(
        panels, (style.TIPPING, style.FRICTION), (moments, friction), strict=True
    ):
        known = quantity.scale * np.where(np.isfinite(values), values, np.nan)
        ax.plot(speeds, known, color=quantity.color, marker="o", ms=3, **style.NOMINAL, gid=quantity.name)
        ax.axvline(1.0, color=style.EVENT, lw=1.2, zorder=0)
        style.finish(ax, quantity.name.capitalize(), quantity.label, "speed / planned speed")
    panels[0].set_ylim(bottom=0.0)
    panels[1].axhline(100.0, **style.LIMIT)
    panels[1].set_ylim(0.0, 150.0)
    style.note(figure, "from a margin on the left to the line, then down: the speed that keeps it")
    return figure
