"""Figure of a timing: speed along the path over the place on it, below what each limit allows by itself."""

from __future__ import annotations

import os
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from ocptip.pictures.frame import COLORS, new_figure, save_figures
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from ocptip.motion.plan import MotionPlan
    from ocptip.retiming.retime import Retimed

ROOM = 1.6  # times the largest speed, up to which the limits are drawn
SAMPLES = 400
_NAMES = ("tip-over", "slip", "torque", "acceleration", "speed")
_OTHER = "#7f7f7f"


def draw_phase_plane(
    directory: str | os.PathLike[str], plan: MotionPlan, timed: Retimed, name: str = "phase_plane"
) -> list[Path]:
    """Draw `phase_plane.png`, or that of another name, into a directory; a file of that name is replaced.

    Raises:
        OSError: the file or the directory cannot be written; names it.
    """
    return save_figures(directory, {name: lambda: phase_plane(plan, timed)})


def phase_plane(plan: MotionPlan, timed: Retimed) -> Figure:
    """The same as a matplotlib figure.

    The speed is ds/dt, with s from 0 to 1; the timing is coloured by the limit that ends it, and so is the
    curve that the limits at a place allow. The timing that the path came with is dotted.
    """
    figure = new_figure(9.5, 5.5)
    ax = figure.subplots()
    timing = timed.motion.timing
    assert timing is not None
    rates = np.sqrt(timing.x)
    top = ROOM * float(rates.max())
    seen = (name for name, pace in zip(timed.curve_limits, timed.curve, strict=False) if pace <= top)
    names = sorted({*timed.active, *seen} - {""}, key=_rank)
    colors = {name: COLORS[k % len(COLORS)] for k, name in enumerate(names)}
    begins = timing.s[:-1]
    _by_name(ax, begins, timed.curve, timed.curve_limits, colors, lw=1.2, alpha=0.55, gid="limit")
    coloured = len(timed.active) == len(begins) and timed.cheapest is None and timed.jerk is None
    ax.plot(timing.s, rates, color=_OTHER, lw=2.0, gid="timing", label=None if coloured else "timing")
    if coloured:
        _by_name(ax, timing.s, rates, timed.active, colors, lw=2.6, alpha=1.0, gid="active")
    if (given := plan.task.reference) is not None:
        places, speeds = _pace(timing.path, given)
        ax.plot(places, speeds, color="#000000", ls=(0, (1, 1.5)), lw=1.4, label="as given", gid="given")
    for k in timing.path.corners:
        ax.axvline(float(timing.path.breakpoints[k]), color="#e3e3e3", lw=0.8, zorder=0)
    for name in names:
        ax.plot([], [], color=colors[name], lw=2.6, label=name)
    if "" in (*timed.curve_limits, *(timed.active if coloured else ())):
        ax.plot([], [], color=_OTHER, lw=2.6, label="none at this place", gid="none")
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(0.0, top)
    ax.set_xlabel("s, place on the path (0: start, 1: goal)")
    ax.set_ylabel("ds/dt, speed along the path [1/s]")
    ax.grid(axis="y", color="#ececec", lw=0.8)
    ax.set_axisbelow(True)
    ax.legend(
        frameon=False, fontsize=8.5, ncols=len(names) + 2, loc="lower center", bbox_to_anchor=(0.5, 1.0)
    )
    word = "" if timed.check.verified else ", NOT verified"
    title = f"{plan.task.name}: timing of {timed.motion.end:.3f} s before it becomes points{word}"
    figure.suptitle(title, fontsize=13, fontweight="bold")
    return figure


def _rank(name: str) -> tuple[int, str]:
    found = [k for k, known in enumerate(_NAMES) if name.startswith(known)]
    return (found[0] if found else len(_NAMES)), name


def _by_name(
    ax: Any,
    s: np.ndarray,
    values: np.ndarray,
    names: tuple[str, ...],
    colors: dict[str, str],
    **style: Any,
) -> None:
    """A curve in pieces of the colour of their names; values (N) or (N + 1) at s."""
    gid = style.pop("gid")
    for name, group in groupby(range(len(names)), key=lambda k: names[k]):
        own = list(group)
        upto = slice(own[0], min(own[-1] + 2, len(values)))
        ax.plot(s[upto], values[upto], color=colors.get(name, _OTHER), gid=f"{gid}-{name}", **style)


def _pace(path: JointPath, given: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Places on the path and ds/dt, (M,) each, of the motion that the path was taken from.

    Its postures are found on the path one after the other; the speed is that along the path there.
    """
    times = np.linspace(0.0, given.end, SAMPLES)
    q, rates, _ = given.states(times)
    grid = np.linspace(0.0, 1.0, 10 * SAMPLES)
    on_path = path.at(grid)[0]
    places, last, reach = [], 0, len(grid) // 20
    for posture in q:
        window = on_path[last : last + reach]
        last += int(np.argmin(np.sum((window - posture) ** 2, axis=1)))
        places.append(grid[last])
    slopes = path.at(np.array(places))[1]
    speeds = np.sum(slopes * rates, axis=1) / np.sum(slopes**2, axis=1)
    return np.array(places), np.maximum(speeds, 0.0)
