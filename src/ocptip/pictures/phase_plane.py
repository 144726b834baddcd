"""Figure of a timing: speed along the path over the place on it, below what each limit allows by itself."""

from __future__ import annotations

import os
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.pictures import style
from ocptip.pictures.frame import new_figure, save_figures
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

if TYPE_CHECKING:
    from ocptip.motion.motion_plan import MotionPlan
    from ocptip.retiming.retime import Retimed

_SAME = 5e-4  # s
HEIGHT = 1.6  # times the largest speed, up to which the limits are drawn
SAMPLES = 400
_QUANTITIES = {
    "tip-over": style.TIPPING,
    "slip": style.FRICTION,
    "torque": style.TORQUE,
    "acceleration": style.ACCELERATION,
    "speed": style.SPEED,
}
_NONE, _OTHERS = "#c4c4c4", style.MEMBERS  # of limits that are no quantity above


def draw_phase_plane(
    directory: str | os.PathLike[str], plan: MotionPlan, timed: Retimed, name: str = "phase_plane"
) -> list[Path]:
    """Draw `phase_plane.png`, or that of another name, into a directory; a file of that name is replaced.

    Raises:
        OSError: the file or the directory cannot be written; names it.
    """
    return save_figures(directory, {name: lambda: phase_plane(plan, timed)})


def phase_plane(plan: MotionPlan, timed: Retimed) -> Figure:
    """A Matplotlib figure of the phase plane.

    The speed is ds/dt, with s from 0 to 1; the timing is coloured by the limit that ends it, and so is the
    curve that the limits at a place allow. The timing that the path came with is dotted.
    """
    figure = new_figure(10.5, 5.2)
    ax = figure.subplots()
    timing = timed.motion.timing
    assert timing is not None
    rates = np.sqrt(timing.x)
    top = HEIGHT * float(rates.max())
    seen = {name for name, pace in zip(timed.curve_limits, timed.curve, strict=False) if pace <= top}
    coloured = len(timed.active) == len(timing.s) - 1 and timed.cheapest is None and timed.jerk is None
    seen |= set(timed.active) if coloured else set()
    names = sorted(seen - {""}, key=_rank)
    kinds = {name: _kind(name) for name in names}
    others = [name for name in names if kinds[name] not in _QUANTITIES]
    colors = {
        name: _QUANTITIES[kind].color if kind in _QUANTITIES else _OTHERS[others.index(name) % len(_OTHERS)]
        for name, kind in kinds.items()
    }
    begins = timing.s[:-1]
    _by_name(ax, begins, timed.curve, timed.curve_limits, colors, lw=1.2, alpha=0.55, gid="limit")
    if not coloured:
        ax.plot(timing.s, rates, color="#000000", lw=2.6, gid="timing", label="timing")
    else:
        _by_name(ax, timing.s, rates, timed.active, colors, lw=2.6, alpha=1.0, gid="active")
    if (given := plan.task.segments[0].task.reference) is not None:
        places, speeds = _pace(timing.path, given)
        ax.plot(places, speeds, color="#000000", **style.REFERENCE, label="as given", gid="given")
    for k in timing.path.corners:
        ax.axvline(float(timing.path.breakpoints[k]), color=style.EVENT, lw=0.8, zorder=0)
    for name in names:
        ax.plot([], [], color=colors[name], lw=2.6, label=f"limit: {name}")
    if "" in seen:
        ax.plot([], [], color=_NONE, lw=2.6, label="no single limit", gid="none")
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(0.0, top)
    style.finish(
        ax,
        "Thick: the timing; thin: the speed that each place allows alone",
        "speed along the path ds/dt [1/s]",
        "place s on the path, 0: start, 1: goal [-]",
    )  # fmt: skip
    word = "" if timed.check.verified else ", NOT verified"
    run = plan.check.duration
    word += f"; as it is run {run:.3f} s" if abs(run - timed.motion.end) > _SAME else ""
    style.head(figure, f"{plan.task.name}: speed along the path, {timed.motion.end:.3f} s{word}")
    return figure


def _kind(name: str) -> str:
    """The quantity of a limit's name, or the name."""
    return next((known for known in _QUANTITIES if name.startswith(known)), name)


def _rank(name: str) -> tuple[int, str]:
    known, kind = list(_QUANTITIES), _kind(name)
    return (known.index(kind) if kind in known else len(known)), name


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
        members = list(group)
        upto = slice(members[0], min(members[-1] + 2, len(values)))
        ax.plot(s[upto], values[upto], color=colors.get(name, _NONE), gid=f"{gid}-{name}", **style)


def _pace(path: JointPath, given: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Places on the path and ds/dt, (M,) each, of the motion that the path was taken from.

    Its postures are located on the path one after the other; the speed is that along the path there.
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
