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


def workspace_figure(workspace: Workspace) -> Figure:
    """One curve over one coordinate; a map over two; up to nine slices along the third."""
    if len(workspace.names) == 1:
        return _curve(workspace)
    slices = [()] if len(workspace.names) == 2 else [(k,) for k in _chosen(workspace.inside, _PANELS)]
    columns = min(3, len(slices))
    rows = -(-len(slices) // columns)
    figure = new_figure(4.2 * columns + 1.2, 3.8 * rows + 0.8)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    image: Any = None
    for ax, section in zip(axes, slices, strict=False):
        image = _map(ax, workspace, section)
    for ax in axes[len(slices) :]:
        ax.set_axis_off()
    figure.colorbar(image, ax=list(axes), label="dexterity (0: singular, 1: motors at right angles)")
    figure.legend(handles=_legend(workspace), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def save_workspace(result: Workspace | IndexMaps, path: str | os.PathLike[str]) -> Path:
    """Draw it, or indices over it, into a .png, .pdf or .svg file."""
    figure = index_maps_figure(result) if isinstance(result, IndexMaps) else workspace_figure(result)
    return save_figure(figure, path, _DPI)


def index_maps_figure(index_maps: IndexMaps) -> Figure:
    """Each index: one curve over one coordinate, a map over two, or a row of slices along the third."""
    if len(index_maps.names) == 1:
        return _index_curves(index_maps)
    count, slices = len(index_maps.maps), [()]
    if len(index_maps.names) == 3:
        slices = [(k,) for k in _chosen(index_maps.inside, _SLICES)]
    columns = (2 if count == 4 else min(3, count)) if slices == [()] else len(slices)
    rows = count if len(slices) > 1 else -(-count // columns)
    figure = new_figure(4.0 * columns + 0.6, 3.4 * rows + 0.9)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax in grid.ravel()[count * len(slices) :]:
        ax.set_axis_off()
    for number, name in enumerate(index_maps.maps):
        panels = grid[number] if len(slices) > 1 else [grid.ravel()[number]]
        images = [
            _index_map(ax, index_maps, name, section) for ax, section in zip(panels, slices, strict=True)
        ]
        figure.colorbar(
            images[0], ax=list(panels), label=_index_label(index_maps, name), extend=_beyond(index_maps, name)
        )
    style.head(figure, _index_title(index_maps))
    handles: list[Any] = [Patch(color=_OUTSIDE[0], label="out of reach, or beyond a joint's range")]
    if _changes_sign(index_maps.signed):
        handles.append(Line2D([], [], color=_SINGULAR, label="singular"))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def _index_map(ax: Any, index_maps: IndexMaps, name: str, plane: tuple[int, ...]) -> Any:
    index = (slice(None), slice(None), *plane)
    x, y = (_shown(index_maps.names[k], index_maps.values[k]) for k in range(2))
    values = np.where(index_maps.inside, index_maps.maps[name], np.nan)[index]
    ax.set_facecolor(_OUTSIDE[0])
    shown = np.ma.masked_invalid(np.minimum(values, _end(index_maps, name)))
    image = ax.pcolormesh(
        x, y, shown.T, cmap="viridis", vmin=0, vmax=_end(index_maps, name), shading="nearest"
    )
    _draw_singular(ax, x, y, index_maps.signed[index])
    _label_map(ax, index_maps, plane)
    if plane:
        ax.label_outer()
    return image


def _index_curves(index_maps: IndexMaps) -> Figure:
    figure = new_figure(7.0, 1.9 * len(index_maps.maps) + 0.6)
    x = _shown(index_maps.names[0], index_maps.values[0])
    panels = figure.subplots(len(index_maps.maps), 1, sharex=True, squeeze=False)[:, 0]
    turns = np.flatnonzero(index_maps.signed[1:] * index_maps.signed[:-1] < 0)
    singular = (x[turns] + x[turns + 1]) / 2
    for ax, name in zip(panels, index_maps.maps, strict=True):
        ax.plot(x, np.minimum(index_maps.maps[name], _end(index_maps, name)))
        ax.vlines(singular, 0.0, _end(index_maps, name), color=_SINGULAR, lw=0.8, label="singular")
        ax.set_ylim(bottom=0.0)
        ax.set_ylabel(_index_label(index_maps, name))
    if turns.size:
        panels[0].legend(frameon=False)
    panels[-1].set_xlabel(_label(index_maps.names[0]))
    style.head(figure, _index_title(index_maps))
    return figure


def _index_label(index_maps: IndexMaps, name: str) -> str:
    one = index_maps.meanings[name]
    unit = " [-]" if one.unit == "1" else f" [{one.unit}]"
    return f"{one.symbol}{unit}, {one.lower:.3g} to {one.upper:.3g}".replace("to inf", "and up")


def _index_title(index_maps: IndexMaps) -> str:
    best = ", best of all IK solutions" if index_maps.solutions.max(initial=0) > 1 else ""
    return f"{index_maps.robot}: indices{best}"


def _end(index_maps: IndexMaps, name: str) -> float:
    """End of the colour scale: the largest value, of angles at most two radians: they may be infinite."""
    index_map = index_maps.maps[name][np.isfinite(index_maps.maps[name])]
    largest = float(index_map.max(initial=0.0)) or 1.0
    return min(largest, _LARGEST_ANGLE) if index_maps.meanings[name].unit == "rad" else largest


def _beyond(index_maps: IndexMaps, name: str) -> str:
    return "max" if np.any(index_maps.maps[name] > _end(index_maps, name)) else "neither"


def _chosen(inside: np.ndarray, count: int) -> list[int]:
    """Slices along the third coordinate, evenly over those that have poses inside."""
    there = np.flatnonzero(inside.any(axis=(0, 1)))
    there = there if there.size else np.arange(inside.shape[2])
    return sorted({int(there[round(k)]) for k in np.linspace(0, len(there) - 1, min(count, len(there)))})


def _most(workspace: Workspace) -> float:
    """End of the colour scale."""
    inside = np.abs(workspace.dexterity[workspace.inside])
    return float(np.nanmax(inside)) if np.isfinite(inside).any() else 1.0


def _shown(name: str, values: np.ndarray) -> np.ndarray:
    """Values of a coordinate, degrees or m."""
    return values if name in LENGTHS else np.degrees(values)


def _label(name: str) -> str:
    return f"{name} [{'m' if name in LENGTHS else 'deg'}]"


def _label_map(ax: Any, result: Workspace | IndexMaps, plane: tuple[int, ...]) -> None:
    """Axes with units, lengths on both alike, and where the slice is."""
    ax.set_xlabel(_label(result.names[0]))
    ax.set_ylabel(_label(result.names[1]))
    if set(result.names[:2]) <= set(LENGTHS):
        ax.set_aspect("equal")
    if plane:
        name = result.names[2]
        unit = "m" if name in LENGTHS else "deg"
        ax.set_title(f"{name} = {_shown(name, result.values[2])[plane[0]]:.3g} {unit}", fontsize=9)


def _changes_sign(signed: np.ndarray) -> bool:
    return bool(np.nanmin(signed, initial=1.0) < 0 < np.nanmax(signed, initial=-1.0))


def _draw_singular(ax: Any, x: np.ndarray, y: np.ndarray, signed: np.ndarray) -> None:
    """The line (n1, n2) where the sign changes."""
    if _changes_sign(signed):
        ax.contour(x, y, np.ma.masked_invalid(signed.T), levels=[0.0], colors=_SINGULAR, linewidths=1.2)


def _groups(workspace: Workspace) -> list[str]:
    """Causes without the leg: "out of reach", "joint 3", in the order of their colours."""
    return list(dict.fromkeys(name.partition(" joint ")[2] or name for name in workspace.causes))


def _map(ax: Any, workspace: Workspace, plane: tuple[int, ...]) -> Any:
    index = (slice(None), slice(None), *plane)
    x, y = (_shown(workspace.names[k], workspace.values[k]) for k in range(2))
    groups = _groups(workspace)
    number = np.array([groups.index(name.partition(" joint ")[2] or name) for name in workspace.causes])
    cause = workspace.cause[index]
    colors = ListedColormap([_OUTSIDE[k % len(_OUTSIDE)] for k in range(len(groups))])
    outside = np.where(cause < 0, np.nan, number[np.maximum(cause, 0)])
    ax.pcolormesh(x, y, outside.T, cmap=colors, vmin=-0.5, vmax=len(groups) - 0.5, shading="nearest")
    values = workspace.dexterity[index]
    inside = np.where(cause < 0, np.abs(values), np.nan)
    image = ax.pcolormesh(x, y, inside.T, cmap="viridis", vmin=0, vmax=_most(workspace), shading="nearest")
    _draw_singular(ax, x, y, values)
    _label_map(ax, workspace, plane)
    return image


def _legend(workspace: Workspace) -> list[Any]:
    handles: list[Any] = [
        Patch(color=_OUTSIDE[k % len(_OUTSIDE)], label=name if k == 0 else f"range of joint {name}")
        for k, name in enumerate(_groups(workspace))
    ]
    return [*handles, Line2D([], [], color=_SINGULAR, label="singular (type II)")]


def _curve(workspace: Workspace) -> Figure:
    figure = new_figure(7.0, 3.6)
    ax = figure.subplots()
    x = _shown(workspace.names[0], workspace.values[0])
    ax.plot(x, np.where(workspace.inside, workspace.dexterity, np.nan), label="inside")
    ax.plot(x, workspace.dexterity, color="0.7", lw=0.8, zorder=0, label="outside")
    ax.axhline(0.0, color=_SINGULAR, lw=0.8)
    ax.set_xlabel(_label(workspace.names[0]))
    ax.set_ylabel("dexterity")
    ax.legend(frameon=False)
    return figure


def save_indices(
    robot: str, times: np.ndarray, values: Mapping[str, np.ndarray], path: str | os.PathLike[str]
) -> Path:
    """Draw indices (N,) over times (N,), s, minima marked, into a .png, .pdf or .svg."""
    figure = new_figure(7.5, 1.6 * len(values) + 0.6)
    for ax, (name, value) in zip(
        figure.subplots(len(values), 1, sharex=True, squeeze=False)[:, 0], values.items(), strict=True
    ):
        ax.plot(times, value, color=style.MEMBERS[0])
        if np.isfinite(value).any():
            least = int(np.nanargmin(value))
            ax.plot(times[least], value[least], "o", color=style.MEMBERS[1])
        if not (value < 0.0).any():  # only sigma has negative values
            ax.set_ylim(bottom=0.0)
        ax.set_ylabel(name)
        ax.set_xlabel("time [s]" if ax.get_subplotspec().is_last_row() else "")
    style.head(figure, f"{robot}: indices along the motion, minima marked")
    return save_figure(figure, path, _DPI)
