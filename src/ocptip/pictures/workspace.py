"""Figure of a workspace: dexterity inside, the singularity surface as a line, what is in the way outside."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ocptip.basics.write import atomic_file
from ocptip.parallel.analysis.workspace import Workspace
from ocptip.pictures.frame import new_figure

_PANELS = 9
_SINGULAR = "#d00000"
_OUTSIDE = ("#e8e8e8", "#f2c6de", "#c9dbee", "#f7e29b", "#b9a3cf", "#f0b27a", "#8fcfb0")


def workspace_figure(found: Workspace) -> Figure:
    """One curve over one coordinate; a map over two; up to nine slices along the third."""
    if len(found.names) == 1:
        return _curve(found)
    slices = [()] if len(found.names) == 2 else [(k,) for k in _chosen(found)]
    columns = min(3, len(slices))
    rows = -(-len(slices) // columns)
    figure = new_figure(4.2 * columns + 1.2, 3.8 * rows + 0.8)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    image = None
    for ax, own in zip(axes, slices, strict=False):
        image = _map(ax, found, own)
    for ax in axes[len(slices) :]:
        ax.set_axis_off()
    figure.colorbar(image, ax=list(axes), label="dexterity (0: singular, 1: motors at right angles)")
    figure.legend(handles=_legend(found), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def save_workspace(found: Workspace, path: str | os.PathLike[str]) -> Path:
    """Draw it into a .png, .pdf or .svg file."""
    path = Path(path)
    with atomic_file(path) as file:
        workspace_figure(found).savefig(file, format=path.suffix[1:], dpi=120)
    return path


def _chosen(found: Workspace) -> list[int]:
    """Slices along the third coordinate, evenly over those that have poses inside."""
    there = np.flatnonzero(found.inside.any(axis=(0, 1)))
    there = there if there.size else np.arange(len(found.values[2]))
    return sorted({int(there[round(k)]) for k in np.linspace(0, len(there) - 1, min(_PANELS, len(there)))})


def _most(found: Workspace) -> float:
    """End of the colour scale."""
    inside = np.abs(found.dexterity[found.inside])
    return float(np.nanmax(inside)) if np.isfinite(inside).any() else 1.0


def _shown(found: Workspace, k: int) -> np.ndarray:
    """Values of a coordinate, degrees or m."""
    return np.degrees(found.values[k]) if found.names[k].startswith("phi") else found.values[k]


def _label(found: Workspace, k: int) -> str:
    return f"{found.names[k]} [{'deg' if found.names[k].startswith('phi') else 'm'}]"


def _groups(found: Workspace) -> list[str]:
    """Causes without the leg: "out of reach", "joint 3", in the order of their colours."""
    return list(dict.fromkeys(name.partition(" joint ")[2] or name for name in found.causes))


def _map(ax: Any, found: Workspace, own: tuple[int, ...]) -> Any:
    at = (slice(None), slice(None), *own)
    x, y = _shown(found, 0), _shown(found, 1)
    groups = _groups(found)
    number = np.array([groups.index(name.partition(" joint ")[2] or name) for name in found.causes])
    cause = found.cause[at]
    colors = ListedColormap([_OUTSIDE[k % len(_OUTSIDE)] for k in range(len(groups))])
    outside = np.where(cause < 0, np.nan, number[np.maximum(cause, 0)])
    ax.pcolormesh(x, y, outside.T, cmap=colors, vmin=-0.5, vmax=len(groups) - 0.5, shading="nearest")
    values = found.dexterity[at]
    inside = np.where(cause < 0, np.abs(values), np.nan)
    image = ax.pcolormesh(x, y, inside.T, cmap="viridis", vmin=0, vmax=_most(found), shading="nearest")
    if np.nanmin(values, initial=1.0) < 0 < np.nanmax(values, initial=-1.0):
        ax.contour(x, y, np.ma.masked_invalid(values.T), levels=[0.0], colors=_SINGULAR, linewidths=1.2)
    ax.set_xlabel(_label(found, 0))
    ax.set_ylabel(_label(found, 1))
    if own:
        ax.set_title(f"{found.names[2]} = {_shown(found, 2)[own[0]]:.3g}", fontsize=9)
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
    ax.plot(_shown(found, 0), np.where(found.inside, found.dexterity, np.nan), label="inside")
    ax.plot(_shown(found, 0), found.dexterity, color="0.7", lw=0.8, zorder=0, label="outside")
    ax.axhline(0.0, color=_SINGULAR, lw=0.8)
    ax.set_xlabel(_label(found, 0))
    ax.set_ylabel("dexterity")
    ax.legend(frameon=False)
    return figure
