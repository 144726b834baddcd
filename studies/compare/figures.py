"""Figures of the comparison with Nelder-Mead: energies, convergence, best motions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, NullLocator

from ocptip.trajectories.trajectory import Trajectory
from studies.compare.methods import METHODS
from studies.compare.runs import Key

COLORS = {
    "ours": "#0072b2",
    "nelder-mead": "#d55e00",
    "nelder-mead-plain": "#e69f00",
    "cma": "#009e73",
    "slsqp": "#cc79a7",
}


def draw_energies(records: dict[Key, dict], path: Path) -> None:
    """Energy of the starts, and of what each method made of them, each sorted; one panel per case."""
    figure, panels = _panels(records, "start, sorted", "energy [J]")
    for case, axis in panels.items():
        starts = sorted(r["start_J"] for r in _one_per_start(records, case))
        axis.plot(range(1, len(starts) + 1), starts, color="#888888", lw=1.4, marker="o", ms=2.5)
        for method in _methods(records):
            own = [r for key, r in records.items() if key[0] == case and key[2] == method and r["slowed"]]
            energies = sorted(r["slowed"]["energy_J"] for r in own)
            axis.plot(range(1, len(own) + 1), energies, color=COLORS[method], lw=1.6, marker="o", ms=2.5)
        axis.set_yscale("log")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        _plain_log(axis.yaxis, axis.get_ylim())
    handles = [Line2D([], [], color="#888888", lw=1.6, label="start")]
    _legend(figure, handles, records, ", slowed until verified")
    figure.savefig(path, dpi=110)


def draw_convergence(records: dict[Key, dict], path: Path) -> None:
    """Median over the starts of the best penalised cost after given seconds; ours counts when it is done."""
    figure, panels = _panels(records, "CPU seconds", "median best cost [J]")
    for case, axis in panels.items():
        last = max(r["cpu_s"] for key, r in records.items() if key[0] == case)
        times = np.geomspace(0.05, max(1.2 * last, 0.1), 300)
        for method in _methods(records):
            own = [r for key, r in records.items() if key[0] == case and key[2] == method]
            if own:
                curve = np.median([best_after(r, times) for r in own], axis=0)
                axis.step(times, curve, where="post", color=COLORS[method], lw=1.8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        _plain_log(axis.yaxis, axis.get_ylim())
    _legend(figure, [], records)
    figure.savefig(path, dpi=110)


def best_after(record: dict, times: np.ndarray) -> np.ndarray:
    """Best cost a run had at these CPU seconds; before its first value the start's."""
    history = record["history"]
    if record["method"] == "ours" and record["energy_J"] is not None and record["verified"]:
        history = [*history, [record["cpu_s"], 0, record["energy_J"]]]
    moments, costs = np.array([h[0] for h in history]), np.array([h[2] for h in history])
    index = np.searchsorted(moments, times, side="right") - 1
    return np.where(index < 0, record["start_cost"], costs[np.maximum(index, 0)])


def draw_motions(records: dict[Key, dict], path: Path) -> None:
    """Angles and speeds of the best verified motion of each case."""
    best = {}
    for case in sorted({key[0] for key in records}):
        own = [r for key, r in records.items() if key[0] == case and r["verified"]]
        if own:
            best[case] = min(own, key=lambda r: r["energy_J"])
    if not best:
        return
    columns = min(4, len(best))
    bands = -(-len(best) // columns)
    figure = Figure(figsize=(1.2 + 3.7 * columns, 0.6 + 4.6 * bands), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2 * bands, columns, squeeze=False)
    for k, (case, record) in enumerate(best.items()):
        band, column = divmod(k, columns)
        motion = Trajectory.from_dict(record["motion"])
        times = np.union1d(np.linspace(0, motion.end, 400), motion.event_times)
        q, v, _ = motion.states(times)
        upper, lower = axes[2 * band, column], axes[2 * band + 1, column]
        for j in range(motion.n):
            look = {"color": f"C{j}", "lw": 1.8 if j < 3 else 1.0, "ls": "-" if j < 3 else "--"}
            upper.plot(times, np.rad2deg(q[:, j]), **look)
            lower.plot(times, np.rad2deg(v[:, j]), **look)
        upper.set_title(f"{case}: {record['energy_J']:.1f} J, {record['duration_s']:.2f} s", fontsize=10)
        lower.set_xlabel("time [s]")
        if column == 0:
            upper.set_ylabel("angle [deg]")
            lower.set_ylabel("speed [deg/s]")
    for axis in axes[2 * (bands - 1) :, len(best) - (bands - 1) * columns :].ravel():
        axis.set_visible(False)
    for axis in axes.ravel():
        _grid(axis)
    joints = [
        Line2D([], [], color=f"C{j}", lw=1.8, ls="-" if j < 3 else "--", label=f"joint {j + 1}")
        for j in range(6)
    ]
    figure.legend(handles=joints, loc="outside upper center", ncols=6 if columns > 1 else 3, fontsize=9)
    figure.savefig(path, dpi=110)


def _panels(records: dict[Key, dict], xlabel: str, ylabel: str) -> tuple[Figure, dict]:
    cases = sorted({key[0] for key in records})
    columns = min(4, len(cases))
    rows = -(-len(cases) // columns)
    figure = Figure(figsize=(max(1.2 + 3.6 * columns, 7.0), 0.9 + 3.0 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(cases) :]:
        axis.set_visible(False)
    for k, (case, axis) in enumerate(zip(cases, axes, strict=False)):
        axis.set_title(f"case {case}", fontsize=10)
        axis.set_xlabel(xlabel)
        if k % columns == 0:
            axis.set_ylabel(ylabel)
        _grid(axis)
    return figure, dict(zip(cases, axes, strict=False))


def _grid(axis) -> None:
    axis.grid(color="#e4e4e4", lw=0.6, which="both")
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=8)


def _plain_log(axis, limits: tuple[float, float]) -> None:
    """Ticks of a logarithmic axis as ordinary numbers, three at least."""
    ticks: list[float] = []
    for steps in ((1, 2, 5), (1, 1.5, 2, 3, 5, 7), (1, 1.2, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8)):
        every = [m * 10.0**e for e in range(0, 6) for m in steps]
        ticks = [s for s in every if limits[0] <= s <= limits[1]]
        if len(ticks) > 2:
            break
    axis.set_ticks(ticks)
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_locator(NullLocator())


def _legend(figure: Figure, handles: list[Line2D], records: dict[Key, dict], note: str = "") -> None:
    handles = handles + [
        Line2D([], [], color=COLORS[m], lw=1.8, label=m + (note if m != "ours" else ""))
        for m in _methods(records)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, fontsize=8.5)


def _methods(records: dict[Key, dict]) -> list[str]:
    return [method for method in METHODS if any(key[2] == method for key in records)]


def _one_per_start(records: dict[Key, dict], case: str) -> list[dict]:
    return list({key[1]: r for key, r in records.items() if key[0] == case}.values())
