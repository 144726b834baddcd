"""Size of the operation ellipsoid and time: an ABB IRB 2000 along the published motion.

    python -m studies.indices.ellipsoid_size --out FOLDER [--grid 121]

The source moves the arm along one motion, time 0 to 1, and lets the ellipsoid grow from 50 to 300 mm: as a
sphere, prolate along the tool axis, and oblate. Its figures 3.2 to 3.7 (PI_OE and 1/CDN_OE) and 4.6 (MPB, DM
and the angle sigma of the motion) are lost, but for the values of their highest level lines. Writes
ellipsoid_size.png, .json and .md: the same figures, and the largest values beside those level lines.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ocptip.basics.write import versions, write_json, write_text
from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.published.arms import irb_2000
from studies.common import ended, software, table

SINGULAR = (0.413466849, 0.5, 0.985464775)
"""Times of singular poses; the maps lie between the last two."""

SIZES = (0.05, 0.3)  # m
SHAPES = {
    "sphere": lambda r: (r, r, r),
    "prolate": lambda r: (SIZES[0], SIZES[0], r),
    "oblate": lambda r: (r, r, SIZES[0]),
}
"""Half-axes in the gripper frame, whose z is axis 6."""

LEVELS = {"pi_oe": (0.7, 0.9, 0.7), "inv_cdn_oe": (0.12, 0.04, 0.1)}
"""Highest level lines of the source's figures."""

STEPS = {"pi_oe": 0.1, "inv_cdn_oe": 0.02}
NAMES = {"pi_oe": "PI_OE", "inv_cdn_oe": "1/CDN_OE"}


def motion(t: np.ndarray) -> np.ndarray:
    """(N, 6) joint angles, rad, of the published motion at times t (N,)."""
    zero = np.zeros_like(t)
    degrees = [zero, 210 * t - 110, 120 * t**2 - 60, 180 * t - 90, 240 * t - 120, zero]
    return np.radians(np.column_stack(degrees))


def rates(t: np.ndarray) -> np.ndarray:
    """(N, 6) derivatives of :func:`motion`, rad per unit of time."""
    one = np.ones_like(t)
    return np.radians(np.column_stack([0 * one, 210 * one, 240 * t, 180 * one, 240 * one, 0 * one]))


def maps(grid: int) -> dict[str, Any]:
    """Per shape and index (grid, grid) over size (columns) and time (rows)."""
    model, t, sizes = irb_2000(), np.linspace(*SINGULAR[1:], grid), np.linspace(*SIZES, grid)
    q, found = motion(t), {}
    for shape, half_axes in SHAPES.items():
        columns = [
            index_values(
                model, q, ellipsoid=OperationEllipsoid(np.zeros(3), half_axes=half_axes(r)), names=NAMES
            )
            for r in sizes
        ]
        found[shape] = {name: np.column_stack([one[name] for one in columns]) for name in NAMES}
    return {"t": t, "size": sizes, "maps": found}


def along(count: int) -> dict[str, np.ndarray]:
    """Indices that no tool changes, and sigma, over the whole motion."""
    t = np.linspace(0.0, 1.0, count)
    names = ("manipulability", "dm_inf", "dm_2", "sigma")
    return {"t": t, **index_values(irb_2000(), motion(t), rates=rates(t), names=names)}


def highest(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Largest value of each map, where it is, and the source's highest level line."""
    rows = []
    for k, (shape, own) in enumerate(found["maps"].items()):
        for name, values in own.items():
            row, column = np.unravel_index(np.argmax(values), values.shape)
            ends = values.max(axis=0)[[0, -1]]
            rows.append(
                {
                    "shape": shape,
                    "index": name,
                    "largest": float(values.max()),
                    "at_size_m": float(found["size"][column]),
                    "at_time": float(found["t"][row]),
                    "of_the_smallest": float(ends[0]),
                    "of_the_largest": float(ends[1]),
                    "highest_level_line_of_the_source": LEVELS[name][k],
                }
            )
    return rows


def draw(found: dict[str, Any], line: dict[str, np.ndarray], path: Path) -> None:
    """Two rows of maps, and the curves over time."""
    figure = Figure(figsize=(13, 10.5), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 1, height_ratios=[1, 1, 0.8])
    for row, (name, symbol) in enumerate(NAMES.items()):
        panels = grid[row].subgridspec(1, 3).subplots(sharey=True)
        for axes, (shape, own) in zip(panels, found["maps"].items(), strict=True):
            values = own[name]
            top = STEPS[name] * np.ceil(values.max() / STEPS[name])
            levels = np.linspace(0.0, top, round(top / STEPS[name]) * 4 + 1)
            place = (1e3 * found["size"], found["t"], values)
            filled = axes.contourf(*place, levels=levels, cmap="viridis")
            axes.clabel(axes.contour(*place, levels=levels[4::4], colors="k", linewidths=0.6), fontsize=7)
            axes.set_ylabel("time t of the motion")
            axes.label_outer()
            axes.set_xlabel(f"R, {shape} [mm]")
            figure.colorbar(filled, ax=axes, label=f"{symbol}, 0 to 1", ticks=levels[::8])
    _draw_curves(grid[2].subgridspec(1, 3).subplots(), line)
    figure.suptitle("IRB 2000 along the published motion: size of the tool, and time (dashed: singular)")
    figure.savefig(path, dpi=90)


def _draw_curves(panels: Any, line: dict[str, np.ndarray]) -> None:
    panels[0].plot(line["t"], line["manipulability"], color="#0072b2")
    panels[0].set_ylabel("MPB [m^3]")
    for name, color, label in (("dm_2", "#d55e00", "DM_2"), ("dm_inf", "#009e73", "DM_inf")):
        panels[1].plot(line["t"], line[name], color=color, label=label)
    panels[1].set_ylabel("distance from a singularity [rad]")
    panels[1].legend(frameon=False)
    panels[2].plot(line["t"], np.degrees(line["sigma"]), color="#cc79a7")
    panels[2].set(ylabel="sigma [deg], -90: towards it", ylim=(-90, 90), yticks=[-90, -45, 0, 45, 90])
    for axes in panels:
        axes.set(xlabel="time t of the motion", xlim=(0, 1))
        for singular in SINGULAR:
            axes.axvline(singular, color="0.6", lw=0.8, ls="--")
    panels[0].set_ylim(bottom=0.0)
    panels[1].set_ylim(0.0, 1.8)


def report(data: dict[str, Any]) -> str:
    """The results as Markdown."""
    head = ["ellipsoid", "index", "largest", "at R [mm]", "at t", "best of R = 50 mm", "best of R = 300 mm"]
    rows = [
        [
            one["shape"],
            NAMES[one["index"]],
            f"{one['largest']:.4f}",
            f"{1e3 * one['at_size_m']:.0f}",
            f"{one['at_time']:.3f}",
            f"{one['of_the_smallest']:.4f}",
            f"{one['of_the_largest']:.4f}",
            f"{one['highest_level_line_of_the_source']:g}",
        ]
        for one in data["highest"]
    ]
    lines = [
        "# Size of the operation ellipsoid, and time",
        "",
        "An IRB 2000 along the published motion, between its singular poses at t = 0.5 and 0.985; prolate: R",
        "along the tool axis, 50 mm across; oblate: 50 mm along it, R across.",
        "",
        *table([*head, "highest level line of the source"], rows, left=2),
        "",
        f"{data['options']['grid']} sizes and times; {software(data['versions'])}.",
    ]
    return "\n".join(lines) + "\n"


def run(out: Path, grid: int) -> str:
    """Compute, write all files, return the Markdown text."""
    out.mkdir(parents=True, exist_ok=True)
    found, line = maps(grid), along(5 * grid)
    data = {"options": {"grid": grid}, "versions": versions(("numpy",)), "highest": highest(found)}
    draw(found, line, out / "ellipsoid_size.png")
    text = report(data)
    write_json(out / "ellipsoid_size.json", data, indent=1)
    write_text(out / "ellipsoid_size.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for figure, table and data")
    parser.add_argument("--grid", type=int, default=121, help="sizes and times")
    given = parser.parse_args(argv)
    if given.grid < 3:
        parser.error("--grid must be at least 3")
    return ended("ellipsoid_size", lambda: run(given.out, given.grid))


if __name__ == "__main__":
    sys.exit(main())
