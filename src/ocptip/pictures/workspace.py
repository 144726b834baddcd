"""Figures of workspaces: an index inside, the singularity surface as a line, the limit that fails outside.

And of indices along a motion.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ocptip.indices.workspace_maps import IndexMaps
from ocptip.parallel.analysis.workspace import LENGTHS, Workspace
from ocptip.pictures import style
from ocptip.pictures.frame import new_figure, save_figure

_PANELS, _SLICES = 9, 4
_DPI = 120
_LARGEST_ANGLE = 2.0  # rad
_SINGULAR = "#d00000"
_OUTSIDE = ("#e8e8e8", "#f2c6de", "#c9dbee", "#f7e29b", "#b9a3cf", "#f0b27a", "#8fcfb0")


def workspace_figure(found: Workspace) -> Figure:
    """One curve over one coordinate; a map over two; up to nine slices along the third."""
    if len(found.names) == 1:
        return _curve(found)
    slices = [()] if len(found.names) == 2 else [(k,) for k in _chosen(found.inside, _PANELS)]
    columns = min(3, len(slices))
    rows = -(-len(slices) // columns)
    figure = new_figure(4.2 * columns + 1.2, 3.8 * rows + 0.8)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    image: Any = None
    for ax, own in zip(axes, slices, strict=False):
        image = _map(ax, found, own)
    for ax in axes[len(slices) :]:
        ax.set_axis_off()
    figure.colorbar(image, ax=list(axes), label="dexterity (0: singular, 1: motors at right angles)")
    figure.legend(handles=_legend(found), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def save_workspace(found: Workspace | IndexMaps, path: str | os.PathLike[str]) -> Path:
    """Draw it, or indices over it, into a .png, .pdf or .svg file."""
    figure = index_maps_figure(found) if isinstance(found, IndexMaps) else workspace_figure(found)
    return save_figure(figure, path, _DPI)


def index_maps_figure(found: IndexMaps) -> Figure:
    """Each index: one curve over one coordinate, a map over two, or a row of slices along the third."""
    if len(found.names) == 1:
        return _index_curves(found)
    count, slices = len(found.maps), [()]
    if len(found.names) == 3:
        slices = [(k,) for k in _chosen(found.inside, _SLICES)]
    columns = (2 if count == 4 else min(3, count)) if slices == [()] else len(slices)
    rows = count if len(slices) > 1 else -(-count // columns)
    figure = new_figure(4.0 * columns + 0.6, 3.4 * rows + 0.9)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax in grid.ravel()[count * len(slices) :]:
        ax.set_axis_off()
    for number, name in enumerate(found.maps):
        panels = grid[number] if len(slices) > 1 else [grid.ravel()[number]]
        images = [_index_map(ax, found, name, own) for ax, own in zip(panels, slices, strict=True)]
        figure.colorbar(
            images[0], ax=list(panels), label=_index_label(found, name), extend=_beyond(found, name)
        )
    style.head(figure, _index_title(found))
    handles: list[Any] = [Patch(color=_OUTSIDE[0], label="out of reach, or beyond a joint's range")]
    if _changes_sign(found.signed):
        handles.append(Line2D([], [], color=_SINGULAR, label="singular"))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def _index_map(ax: Any, found: IndexMaps, name: str, own: tuple[int, ...]) -> Any:
    at = (slice(None), slice(None), *own)
    x, y = (_shown(found.names[k], found.values[k]) for k in range(2))
    values = np.where(found.inside, found.maps[name], np.nan)[at]
    ax.set_facecolor(_OUTSIDE[0])
    shown = np.ma.masked_invalid(np.minimum(values, _end(found, name)))
    image = ax.pcolormesh(x, y, shown.T, cmap="viridis", vmin=0, vmax=_end(found, name), shading="nearest")
    _draw_singular(ax, x, y, found.signed[at])
    _label_map(ax, found, own)
    if own:
        ax.label_outer()
    return image


def _index_curves(found: IndexMaps) -> Figure:
    figure = new_figure(7.0, 1.9 * len(found.maps) + 0.6)
    x = _shown(found.names[0], found.values[0])
    panels = figure.subplots(len(found.maps), 1, sharex=True, squeeze=False)[:, 0]
    turns = np.flatnonzero(found.signed[1:] * found.signed[:-1] < 0)
    singular = (x[turns] + x[turns + 1]) / 2
    for ax, name in zip(panels, found.maps, strict=True):
        ax.plot(x, np.minimum(found.maps[name], _end(found, name)))
        ax.vlines(singular, 0.0, _end(found, name), color=_SINGULAR, lw=0.8, label="singular")
        ax.set_ylim(bottom=0.0)
        ax.set_ylabel(_index_label(found, name))
    if turns.size:
        panels[0].legend(frameon=False)
    panels[-1].set_xlabel(_label(found.names[0]))
    style.head(figure, _index_title(found))
    return figure


def _index_label(found: IndexMaps, name: str) -> str:
    one = found.meanings[name]
    unit = " [-]" if one.unit == "1" else f" [{one.unit}]"
    return f"{one.symbol}{unit}, {one.lower:.3g} to {one.upper:.3g}".replace("to inf", "and up")


def _index_title(found: IndexMaps) -> str:
    best = ", best of all IK solutions" if found.solutions.max(initial=0) > 1 else ""
    return f"{found.robot}: indices{best}"


def _end(found: IndexMaps, name: str) -> float:
    """End of the colour scale: the largest value, of angles at most two radians: they may be infinite."""
    own = found.maps[name][np.isfinite(found.maps[name])]
    largest = float(own.max(initial=0.0)) or 1.0
    return min(largest, _LARGEST_ANGLE) if found.meanings[name].unit == "rad" else largest


def _beyond(found: IndexMaps, name: str) -> str:
    return "max" if np.any(found.maps[name] > _end(found, name)) else "neither"


def _chosen(inside: np.ndarray, count: int) -> list[int]:
    """Slices along the third coordinate, evenly over those that have poses inside."""
    there = np.flatnonzero(inside.any(axis=(0, 1)))
    there = there if there.size else np.arange(inside.shape[2])
    return sorted({int(there[round(k)]) for k in np.linspace(0, len(there) - 1, min(count, len(there)))})


def _most(found: Workspace) -> float:
    """End of the colour scale."""
    inside = np.abs(found.dexterity[found.inside])
    return float(np.nanmax(inside)) if np.isfinite(inside).any() else 1.0


def _shown(name: str, values: np.ndarray) -> np.ndarray:
    """Values of a coordinate, degrees or m."""
    return values if name in LENGTHS else np.degrees(values)


def _label(name: str) -> str:
    return f"{name} [{'m' if name in LENGTHS else 'deg'}]"


def _label_map(ax: Any, found: Workspace | IndexMaps, own: tuple[int, ...]) -> None:
    """Axes with units, lengths on both alike, and where the slice is."""
    ax.set_xlabel(_label(found.names[0]))
    ax.set_ylabel(_label(found.names[1]))
    if set(found.names[:2]) <= set(LENGTHS):
        ax.set_aspect("equal")
    if own:
        name = found.names[2]
        unit = "m" if name in LENGTHS else "deg"
        ax.set_title(f"{name} = {_shown(name, found.values[2])[own[0]]:.3g} {unit}", fontsize=9)


def _changes_sign(signed: np.ndarray) -> bool:
    return bool(np.nanmin(signed, initial=1.0) < 0 < np.nanmax(signed, initial=-1.0))


def _draw_singular(ax: Any, x: np.ndarray, y: np.ndarray, signed: np.ndarray) -> None:
    """The line (n1, n2) where the sign changes."""
    if _changes_sign(signed):
        ax.contour(x, y, np.ma.masked_invalid(signed.T), levels=[0.0], colors=_SINGULAR, linewidths=1.2)


def _groups(found: Workspace) -> list[str]:
    """Causes without the leg: "out of reach", "joint 3", in the order of their colours."""
    return list(dict.fromkeys(name.partition(" joint ")[2] or name for name in found.causes))


def _map(ax: Any, found: Workspace, own: tuple[int, ...]) -> Any:
    at = (slice(None), slice(None), *own)
    x, y = (_shown(found.names[k], found.values[k]) for k in range(2))
    groups = _groups(found)
    number = np.array([groups.index(name.partition(" joint ")[2] or name) for name in found.causes])
    cause = found.cause[at]
    colors = ListedColormap([_OUTSIDE[k % len(_OUTSIDE)] for k in range(len(groups))])
    outside = np.where(cause < 0, np.nan, number[np.maximum(cause, 0)])
    ax.pcolormesh(x, y, outside.T, cmap=colors, vmin=-0.5, vmax=len(groups) - 0.5, shading="nearest")
    values = found.dexterity[at]
    inside = np.where(cause < 0, np.abs(values), np.nan)
    image = ax.pcolormesh(x, y, inside.T, cmap="viridis", vmin=0, vmax=_most(found), shading="nearest")
    _draw_singular(ax, x, y, values)
    _label_map(ax, found, own)
    return image


def _legend(found: Workspace) -> list[Any]:
    handles: list[Any] = [
        Patch(color=_OUTSIDE[k % len(_OUTSIDE)], label=name if k == 0 else f"range of joint {name}")
        for k, name in enumerate(_groups(found))
    ]
    return [*handles, Line2D([], [], color=_SINGULAR, label="singular (type II)")]


def _curve(found: Workspace) -> Figure:
    figure = new_figure(7.0, 3.6)
    ax = figure.subplots()
    x = _shown(found.names[0], found.values[0])
    ax.plot(x, np.where(found.inside, found.dexterity, np.nan), label="inside")
    ax.plot(x, found.dexterity, color="0.7", lw=0.8, zorder=0, label="outside")
    ax.axhline(0.0, color=_SINGULAR, lw=0.8)
    ax.set_xlabel(_label(found.names[0]))
    ax.set_ylabel("dexterity")
    ax.legend(frameon=False)
    return figure


def save_indices(
    robot: str, times: np.ndarray, values: Mapping[str, np.ndarray], path: str | os.PathLike[str]
) -> Path:
    """Draw indices (N,) over times (N,), s, minima marked, into a .png, .pdf or .svg."""
    figure = new_figure(7.5, 1.6 * len(values) + 0.6)
    for ax, (name, own) in zip(
        figure.subplots(len(values), 1, sharex=True, squeeze=False)[:, 0], values.items(), strict=True
    ):
        ax.plot(times, own, color=style.MEMBERS[0])
        if np.isfinite(own).any():
            least = int(np.nanargmin(own))
            ax.plot(times[least], own[least], "o", color=style.MEMBERS[1])
        if not (own < 0.0).any():  # only sigma has negative values
            ax.set_ylim(bottom=0.0)
        ax.set_ylabel(name)
        ax.set_xlabel("time [s]" if ax.get_subplotspec().is_last_row() else "")
    style.head(figure, f"{robot}: indices along the motion, minima marked")
    return save_figure(figure, path, _DPI)
