"""Figures of a placement: the robot where it stands, and a map of what other places would be worth.

`placement.png` shows the base and the arm from above and from the side, in the world, with obstacles, process
loads and the alternatives. `map.png` shows the total and every criterion over the floor: in each cell the
best angle of the base and the best IK solution of the arm; without one that keeps all constraints, the limit
that fails for the one of minimum violation.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch as Swatch
from matplotlib.patches import Polygon

from ocptip.motion.check import scope_of
from ocptip.pictures.frame import new_figure, save_figures
from ocptip.pictures.style import FRICTION, TIPPING, head
from ocptip.pictures.world_view import (
    BASE,
    COLORS,
    FORBIDDEN,
    GROUND,
    LOAD,
    OTHER,
    SOLID,
    WorldView,
    base_solids,
    obstacles_of,
)
from ocptip.placement.maps import PlacementMap
from ocptip.placement.problem import CRITERIA
from ocptip.placement.result import Placement
from ocptip.placement.terrain import Patch

BEST = "#d00000"
CAUSES = {
    "reach": ("out of reach", "#e8e8e8"),
    "bounds": ("beyond the bounds of the place", "#cfcfcf"),
    "contact area": ("contact beyond the edge", "#cfcfcf"),
    "terrain": ("terrain", "#cfcfcf"),
    "base clearance": ("base in obstacle", "#a6a6a6"),
    "clearance": ("collision of the arm", "#b9a3cf"),
    "joint angle": ("joint angles", "#c5e0b4"),
    "torque": ("joint torques", "#e3bcd3"),
    "manipulability": ("manipulability", "#f7e29b"),
    "tip-over": ("tips over", "#7fb3d5"),
    "GN": ("tips over", "#7fb3d5"),
    "GT": ("slips", "#f0b58a"),
    "persistence": ("loses a contact", "#5f9ea0"),
}
DPI = 110

_OTHER_CAUSE = ("other", "#ffffff")
_NAMES = {
    "total": ("Weighted total", "total [-]"),
    "GN": ("Tipping margin", TIPPING.label),
    "GT": ("Friction used", FRICTION.label),
    "GK": ("Force space index", "GK [-]"),
    "GE": ("Power at rest", "GE"),
}
"""Title and label of the scale of each map."""

_SAME = 0.05  # m, rad: bases nearer than this are drawn once


def draw_placement(
    directory: str | os.PathLike[str], name: str, placements: Sequence[Placement], *, cells: int | None = None
) -> list[Path]:
    """Draw both figures into a directory as PNG; files of the same name are replaced.

    Args:
        directory: made if it does not exist; the one above it must.
        name: title.
        placements: of one problem, the best one first; or the one of minimum violation.
        cells: of the map, per axis.

    Returns:
        The paths.

    Raises:
        OSError: a file or the directory cannot be written; names it.
    """
    return save_figures(directory, _figures(name, placements, cells), DPI)


def draw_places(directory: str | os.PathLike[str], title: str, placements: Sequence[Placement]) -> list[Path]:
    """Draw `placement.png` alone, see :func:`draw_placement`: the ranked places, the best one first."""
    return save_figures(directory, {"placement": lambda: _robot_figure(title, placements)}, DPI)


def placement_figures(
    name: str, placements: Sequence[Placement], *, cells: int | None = None
) -> dict[str, Figure]:
    """Matplotlib figures of a placement, by the names of the files without ending."""
    return {key: draw() for key, draw in _figures(name, placements, cells).items()}


def _figures(
    name: str, placements: Sequence[Placement], cells: int | None
) -> dict[str, Callable[[], Figure]]:
    return {
        "placement": lambda: _robot_figure(name, placements),
        "map": lambda: _map_figure(name, placements, PlacementMap.of(placements[0], cells)),
    }


# --- map ------------------------------------------------------------


def _map_figure(name: str, placements: Sequence[Placement], chart: PlacementMap) -> Figure:
    best = placements[0]
    shown = [name for name in CRITERIA if np.isfinite(chart.values(name)).any()]
    panels = ["total", *shown] if shown else []
    if len(chart.axes) > 1 or not panels:
        panels.append("causes")
    rows = 1 if len(panels) <= 3 else 2
    sides = [float(np.ptp(axis)) for axis in chart.axes]
    shape = sides[-1] / sides[0] if chart.patch.horizontal else 0.8
    height = rows * (3.4 * float(np.clip(shape, 0.4, 1.5)) + 0.9) + 0.9
    figure = new_figure(15.0, height)
    axes = figure.subplots(rows, -(-len(panels) // rows), squeeze=False).ravel()
    others = [p for p in placements[1:] if p.patch == best.patch]
    for ax, panel in zip(axes, panels, strict=False):
        if len(chart.axes) > 1:
            _map_panel(figure, ax, panel, chart, best)
            for number, other in reversed(list(enumerate(others, 2))):
                ax.plot(*_shown(chart, other), "o", ms=8, mfc="white", mec=BASE, mew=1.2, gid=f"no-{number}")
            style = {"marker": "*", "ms": 17, "mfc": BEST, "mec": "white"} if best.feasible else _NEAREST
            ax.plot(*_shown(chart, best), ls="", **style, gid="best")
        else:
            _curve_panel(ax, panel, chart, best)
    for ax in axes[len(panels) :]:
        ax.remove()
    swatch = {"ec": "#7a7a7a", "lw": 0.5}
    handles: list[Any] = [Swatch(fc=color, label=text, **swatch) for text, color in _labels(chart)]
    if len(chart.axes) > 1:
        word, style = ("best placement", {"marker": "*", "ms": 14, "mfc": BEST, "mec": "white"})
        if not best.feasible:
            word, style = "minimum violation", _NEAREST
        handles.append(Line2D([], [], ls="", label=word, **style))
        if _apart(best, others):
            handles.append(
                Line2D([], [], ls="", marker="o", mfc="white", mec=BASE, ms=8, label="alternatives")
            )
    figure.legend(handles=handles, loc="outside lower center", ncol=min(len(handles), 8), frameon=False)
    hidden = [p for i, p in enumerate(chart.patch.parameters) if i not in chart.shown]
    by = f"best {' and '.join(hidden)} and joint angles" if hidden else "best joint angles"
    head(figure, f"{name}: {chart.patch.name}, {by} for each place (dark: worse)")
    return figure


_NEAREST = {"marker": "X", "ms": 12, "mfc": BEST, "mec": "white"}


def _map_panel(figure: Figure, ax: Any, panel: str, chart: PlacementMap, best: Placement) -> None:
    scales = [_scale(chart.patch, i) for i in chart.shown]
    x, y = (scale * axis for scale, axis in zip(scales, chart.axes, strict=True))
    colors = [color for _, color in _labels(chart)] or ["white"]
    ax.pcolormesh(
        x,
        y,
        _cause_numbers(chart),
        cmap=ListedColormap(colors),
        vmin=-0.5,
        vmax=len(colors) - 0.5,
        shading="nearest",
        gid="causes",
    )
    if panel != "causes":
        values, worse = (
            _in_units(panel, chart.values(panel), best),
            "viridis" if panel == "GN" else "viridis_r",
        )
        if np.isfinite(values).any():
            mesh = ax.pcolormesh(x, y, values, cmap=worse, shading="nearest", gid=panel)
            figure.colorbar(mesh, ax=ax, shrink=0.85, aspect=28, pad=0.02, label=_scale_label(panel, best))
    if chart.patch.horizontal:
        ax.set_aspect("equal")
        limits = (x[0], x[-1]), (y[0], y[-1])
        view = WorldView(np.eye(3)[:2], np.array([0.0, 0.0, best.base_position[2]]))
        for obstacle, forbidden in obstacles_of(best.problem):
            view.obstacle(ax, obstacle, limits, forbidden=forbidden)
        for number, task in enumerate(best.problem.tasks):
            ax.plot(*task.position[:2], "+", ms=11, mew=2.2, color=COLORS[number % len(COLORS)])
        ax.set_xlim(*limits[0])
        ax.set_ylim(*limits[1])
    ax.set_xlabel(_label(chart.patch, chart.shown[0]))
    ax.set_ylabel(_label(chart.patch, chart.shown[1]))
    ax.set_title(_title(panel, best), loc="left", fontsize=10)


def _curve_panel(ax: Any, panel: str, chart: PlacementMap, best: Placement) -> None:
    x = _scale(chart.patch, chart.shown[0]) * chart.axes[0]
    if panel != "causes":
        ax.plot(x, _in_units(panel, chart.values(panel), best), color=COLORS[0], gid=panel)
        ax.set_ylabel(_scale_label(panel, best))
    numbers = _cause_numbers(chart)
    for k, (_, color) in enumerate(_labels(chart)):
        ax.fill_between(
            x, 0, 1, where=np.ma.filled(numbers == k, False), color=color, transform=ax.get_xaxis_transform()
        )
    ax.axvline(*_shown(chart, best), color=BEST, lw=1.2)
    ax.set_xlabel(_label(chart.patch, chart.shown[0]))
    ax.set_title(_title(panel, best), loc="left", fontsize=10)


def _labels(chart: PlacementMap) -> list[tuple[str, str]]:
    """Texts and colours of the causes that occur."""
    present = set(chart.causes.ravel()) - {""}
    known = [CAUSES[cause] for cause in CAUSES if cause in present]
    return list(dict.fromkeys(known)) + ([_OTHER_CAUSE] if present - set(CAUSES) else [])


def _cause_numbers(chart: PlacementMap) -> np.ma.MaskedArray:
    """Number of the entry of `_labels` by cell, masked where there is a placement."""
    labels = _labels(chart)
    number = {
        cause: labels.index(CAUSES.get(cause, _OTHER_CAUSE)) for cause in set(chart.causes.ravel()) - {""}
    }
    return np.ma.masked_less(np.vectorize(lambda cause: number.get(cause, -1))(chart.causes), 0)


def _title(panel: str, best: Placement) -> str:
    if panel == "causes":
        return "Which limit fails"
    name, _ = _NAMES[panel]
    weight = "" if panel == "total" else f", weight {getattr(best.problem.weights, panel):.3g}"
    if not best.feasible:
        return f"{name}{weight}"
    value = _in_units(panel, np.array(best.total if panel == "total" else best.criteria[panel]), best)
    unit = _scale_label(panel, best).partition("[")[2].rstrip("-]")
    return f"{name}: {float(value):.3g} {unit}".rstrip() + f" at the star{weight}"


def _in_units(panel: str, values: np.ndarray, best: Placement) -> np.ndarray:
    """The tip-over index GN as a margin in N m, the friction used in %; other criteria as they are."""
    if panel == "GN":
        reference = best.problem.robot.tip_over.reference_moment or 0.0
        with np.errstate(divide="ignore"):  # a base that cannot tip has no margin to draw
            return np.maximum(reference * (1 / values - 1), 0.0)
    return FRICTION.scale * values if panel == "GT" else values


def _scale_label(panel: str, best: Placement) -> str:
    label, energy = _NAMES[panel][1], best.problem.energy
    return f"{label} [{energy.unit if energy is not None else '-'}]" if panel == "GE" else label


def _shown(chart: PlacementMap, placement: Placement) -> list[float]:
    return [_scale(chart.patch, i) * placement.parameters[i] for i in chart.shown]


def _scale(patch: Patch, i: int) -> float:
    return 180 / np.pi if patch.angular[i] else 1.0


def _label(patch: Patch, i: int) -> str:
    return f"{patch.parameters[i]} [{'deg' if patch.angular[i] else 'm'}]"


# --- robot ------------------------------------------------------------


def _robot_figure(name: str, placements: Sequence[Placement]) -> Figure:
    best = placements[0]
    figure = new_figure(15.0, 8.7)
    top, side = figure.subplots(1, 2)
    apart = np.abs(best.problem.tasks[0].position - best.base_position)
    across = 0 if apart[0] >= apart[1] else 1  # the horizontal axis of the side view
    away = 1 - across
    views = (
        (top, WorldView(np.eye(3)[:2], np.array([0.0, 0.0, best.base_position[2]])), "xy", "From above"),
        (
            side,
            WorldView(np.eye(3)[[across, 2]], best.base_position * np.eye(3)[away]),
            "xy"[across] + "z",
            f"From the side, along {'xy'[away]}",
        ),
    )
    for ax, view, axes, title in views:
        others = placements[1:] if ax is top else ()
        limits = view.limits([best, *others])
        if ax is top:
            _bounds(ax, best, limits)
        else:
            view.ground(ax, best, limits)
        for obstacle, forbidden in obstacles_of(best.problem):
            view.obstacle(ax, obstacle, limits, forbidden=forbidden)
        for other, label in _apart(best, others):
            view.base(ax, other, OTHER, label=label)
            view.arms(ax, other, faint=True)
        view.base(ax, best, BASE, solids=True)
        view.arms(ax, best)
        view.loads(ax, best, limits)
        ax.set_xlim(*limits[0])
        ax.set_ylim(*limits[1])
        ax.set_aspect("equal")
        ax.set_xlabel(f"{axes[0]} [m]")
        ax.set_ylabel(f"{axes[1]} [m]")
        ax.set_title(title, loc="left", fontsize=11)
    handles: list[Any] = [
        Line2D(
            [], [], color=COLORS[t % len(COLORS)], lw=3, marker="o", mfc="white", label=f"arm: {task.name}"
        )
        for t, task in enumerate(best.problem.tasks)
    ]
    handles += [
        Line2D([], [], color=BASE, marker="s", ms=7, ls="-", label="contacts and mount"),
        Line2D([], [], color=LOAD, marker=">", ls="-", label="process force on the gripper"),
    ]
    if any(base_solids(best)):
        handles.append(Swatch(fc="none", ec=BASE, lw=0.8, label="solids of the base"))
    if _apart(best, placements[1:]):
        handles.append(Line2D([], [], color=OTHER, lw=2, label="alternatives, by number"))
    if any(not forbidden for _, forbidden in obstacles_of(best.problem)):
        handles.append(Swatch(fc=SOLID, ec=SOLID, alpha=0.5, label="obstacle"))
    if best.problem.keep_out:
        handles.append(Swatch(fc="none", ec=FORBIDDEN, hatch="///", label="not for the base"))
    figure.legend(handles=handles, loc="outside lower center", ncol=min(len(handles), 7), frameon=False)
    verdict = _margins(best) if best.feasible else "NOT feasible, minimum violation"
    verdict += scope_of(best.problem.collision)
    head(figure, f"{name}: {verdict}")
    return figure


def _margins(best: Placement) -> str:
    """Margins of the contacts, where they are criteria, and the total."""
    known = [panel for panel in ("GN", "GT") if panel in best.criteria]
    texts = [_title(panel, best).split(" at the star")[0] for panel in known]
    return ", ".join([*(text[:1].lower() + text[1:] for text in texts), f"weighted total {best.total:.4f}"])


def _apart(best: Placement, others: Sequence[Placement]) -> list[tuple[Placement, str]]:
    """Alternatives whose base stands elsewhere, with the numbers of all that stand there."""
    groups: list[tuple[Placement, list[str]]] = [(best, [])]
    for number, other in enumerate(others, 2):
        for placement, numbers in groups:
            turn = np.linalg.norm(placement.base_rotation - other.base_rotation)
            if np.linalg.norm(placement.base_position - other.base_position) < _SAME and turn < _SAME:
                numbers.append(str(number))
                break
        else:
            groups.append((other, [str(number)]))
    return [(placement, ", ".join(numbers)) for placement, numbers in groups[1:]]


def _bounds(ax: Any, placement: Placement, limits: Any) -> None:
    """Edges of the patch in the view from above."""
    patch = placement.problem.terrain[placement.patch]
    if patch.horizontal is None:
        return
    (x0, x1), (y0, y1) = (
        np.clip([patch.lower[i], patch.upper[i]], limits[k][0] - 1, limits[k][1] + 1)
        for k, i in enumerate(patch.horizontal)
    )
    ax.add_patch(
        Polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], fc=GROUND, alpha=0.08, ec=GROUND, zorder=0)
    )
