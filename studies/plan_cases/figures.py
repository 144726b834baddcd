"""Figures of the eight cases: energies of all starts, ratios to the printed motions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from studies.plan_cases.journal import SETS
from studies.plan_cases.tables import LARGEST_RATIO, NEAR, average

COLORS = ("#0072b2", "#d55e00", "#009e73")  # of the sets


def draw_starts(group: list[dict], path: Path) -> None:
    """Energies of all starts of a set, sorted, above the best of their case; one panel per case."""
    columns = min(4, len(group))
    lines = -(-len(group) // columns)
    figure = Figure(figsize=(0.6 + 2.9 * columns, 0.7 + 2.5 * lines), layout="constrained")
    FigureCanvasAgg(figure)
    figure.get_layout_engine().set(wspace=0.04)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
    above = [_above(r) for r in group]
    top = max([20.0, *(1.3 * x.max() for x in above if len(x))])
    for axis, r, excess in zip(axes, group, above, strict=False):
        axis.axhspan(0, 100 * NEAR, color="#e3f1ea", lw=0)
        if len(excess):
            share = 100 * (np.arange(len(excess)) + 0.5) / r["starts"]
            axis.plot(share, excess, "o", ms=4, mew=0, color=COLORS[0], clip_on=False, zorder=3)
        note = f"{r['near']} of {r['starts']} within {100 * NEAR:.0f} %"
        if missing := r["starts"] - len(excess):
            axis.axvspan(100 * len(excess) / r["starts"], 100, color="#dddddd", lw=0)
            note += f"\n{missing} without a verified motion"
        axis.text(0.03, 0.96, note, transform=axis.transAxes, va="top", fontsize=8.5)
        best = "no plan" if r["plan"] is None else f"best {r['plan']['energy_J']:.1f} J"
        axis.set_title(f"case {r['case']}, {best}", fontsize=10)
        axis.set_yscale("symlog", linthresh=100 * NEAR, linscale=1.0)
        axis.set_ylim(0, top)
        axis.set_xlim(0, 100)
        ticks = [t for t in (0, 1, 2, 5, 10, 20, 50, 100, 200, 500) if t <= top]
        axis.set_yticks(ticks, [str(t) for t in ticks])
        axis.set_yticks([], minor=True)
        axis.grid(color="#e4e4e4", lw=0.6)
        axis.set_axisbelow(True)
    for axis in axes[len(group) :]:
        axis.set_visible(False)
    figure.suptitle(SETS[group[0]["set"]].title, fontsize=11)
    figure.supxlabel("starts, sorted by energy [%]", fontsize=10)
    figure.supylabel("energy above the best [%]", fontsize=10)
    figure.savefig(path, dpi=110)


def _above(r: dict) -> np.ndarray:
    """Energies of the verified starts above the best, per cent, sorted."""
    energies = np.sort([x for x in r["energies_J"] if x is not None])
    return 100 * np.maximum(energies / energies[0] - 1, 0) if len(energies) else energies


def draw_ratios(groups: dict[str, list[dict]], cases: Sequence[str], path: Path) -> None:
    """Energy of our best to that of the printed motion, per case and set."""
    figure = Figure(figsize=(max(7.0, 2.6 + 0.75 * len(cases)), 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.subplots()
    width = 0.8 / len(SETS)
    for k, (name, one) in enumerate(SETS.items()):
        group = [r for r in groups.get(name, []) if r["ratio"] is not None]
        if not group:
            continue
        places = [cases.index(r["case"]) + (k - 1) * width for r in group]
        mean = average([r["ratio"] for r in group])
        label = f"{one.title}: average {mean:.3f} (target {one.target:.2f})"
        bars = axis.bar(places, [r["ratio"] for r in group], 0.92 * width, color=COLORS[k], label=label)
        axis.bar_label(bars, fmt="%.2f", rotation=90, padding=-26, fontsize=8, color="white")
    axis.axhline(1, color="black", lw=0.9)
    axis.axhline(LARGEST_RATIO, color="#8b0000", lw=1.1, ls=(0, (6, 2)))
    place = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points", "xytext": (4, 0)}
    for y, text, color in (
        (1, "printed motion", "black"),
        (LARGEST_RATIO, f"target {LARGEST_RATIO}", "#8b0000"),
    ):
        axis.annotate(text, (1, y), va="bottom" if y == 1 else "top", color=color, fontsize=8, **place)
    axis.set_xticks(range(len(cases)), [f"case {case}" for case in cases])
    axis.set_xlim(-0.6, len(cases) - 0.4)
    axis.set_ylim(0, 1.05 * max([1.0, *(r["ratio"] or 0.0 for group in groups.values() for r in group)]))
    axis.set_ylabel("energy / energy of the printed motion")
    axis.grid(axis="y", color="#e4e4e4", lw=0.6)
    axis.set_axisbelow(True)
    if axis.containers:
        figure.legend(loc="outside lower center", fontsize=8.5, frameon=False)
    figure.savefig(path, dpi=110)
