"""Figure of a motion on compliant feet: their forces beside those without swings, and the gaps below them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.pictures.frame import COLORS, new_figure
from ocptip.standing.elastic.feet import FeetMotion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_POINTS = 4000


def feet_figure(title: str, found: FeetMotion, times: np.ndarray, shared: np.ndarray) -> Figure:
    """Normal forces and gaps over time.

    Args:
        title: above all.
        found: the motion on its feet.
        times: (N,), s, of `shared`.
        shared: (N, n) normal forces without swings, N.
    """
    figure, course = new_figure(9.5, 8.5), found.course
    figure.suptitle(title, fontsize=13, fontweight="bold")
    forces, gaps = figure.subplots(2, 1, sharex=True)
    some = np.unique(np.linspace(0, len(course.times) - 1, _MOST_POINTS).astype(int))
    for k in range(shared.shape[1]):
        color = COLORS[k % len(COLORS)]
        forces.plot(times, shared[:, k], color=color, lw=1.0, ls=(0, (4, 2)), gid=f"shared-{k + 1}")
        own = course.forces[some, k, 0]
        forces.plot(course.times[some], own, color=color, lw=1.2, label=f"{k + 1}", gid=f"force-{k + 1}")
        gap = 1e3 * course.gaps[some, k]
        gaps.plot(course.times[some], gap, color=color, lw=1.2, label=f"{k + 1}", gid=f"gap-{k + 1}")
    first, second = found.lines()[:2]
    _finish(forces, found, f"Normal forces of feet: {first};\n{second}", "force on the base [N]")
    title = "Gaps below feet" if found.lifts or found.falls else "Gaps below feet: no foot lifts"
    _finish(gaps, found, title, "height above the ground [mm]")
    gaps.set_xlabel("time [s]")
    figure.supxlabel("dashed: without swings; grey line: end of the motion", fontsize=9, color="#6f6f6f")
    return figure


def _finish(ax: Any, found: FeetMotion, title: str, label: str) -> None:
    ax.axvline(found.end, color="#c8c8c8", lw=1.0, zorder=0)
    ax.set_title(title, loc="left", fontsize=11)
    ax.set_ylabel(label)
    ax.set_ylim(bottom=0.0)
    ax.grid(axis="y", color="#ececec", lw=0.8)
    ax.legend(loc="upper right", ncol=4, frameon=False, fontsize=8.5)
