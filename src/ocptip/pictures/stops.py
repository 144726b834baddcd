"""Figure of stops: the largest safe share of the planned speed over time, and how long stops take."""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib.figure import Figure

from ocptip.motion.stops import Stops
from ocptip.pictures.frame import COLORS, new_figure, save_figures

_LABELS = {"path": "along the path", "brakes": "by brakes", "cancel": "on cancel"}


def draw_stops(directory: str | os.PathLike[str], stops: Stops) -> list[Path]:
    """Draw `stops.png` into a directory; a file of that name is replaced.

    Raises:
        OSError: the file or the directory cannot be written; names it.
    """
    return save_figures(directory, {"stops": lambda: stops_figure(stops)})


def stops_figure(stops: Stops) -> Figure:
    """The same as a matplotlib figure."""
    figure = new_figure(9.5, 6.5)
    speed, time = figure.subplots(2, 1, sharex=True)
    if stops.curve is not None:
        speed.plot(*stops.curve, color=COLORS[0], lw=1.6, label="along the path", gid="path-speed")
    for color, (kind, label) in zip(COLORS, _LABELS.items(), strict=False):
        if kind not in stops.speeds:
            continue
        speeds = None if kind == "path" else stops.speeds[kind]
        for ax, values, what in ((speed, speeds, "speed"), (time, stops.durations[kind], "time")):
            if values is not None:
                style = {"color": color, "marker": "o", "ms": 4, "label": label}
                ax.plot(stops.times, values, **style, gid=f"{label}-{what}")
    speed.set_ylim(-0.03, 1.08)
    speed.set_ylabel("safe share of the planned speed")
    time.set_ylabel("a stop takes [s]")
    time.set_ylim(bottom=0.0)
    time.set_xlabel("stopped at [s] of the motion")
    for ax in (speed, time):
        ax.grid(axis="y", color="#ececec", lw=0.8)
        ax.set_axisbelow(True)
        ax.legend(frameon=False, fontsize=8.5)
    verdict = "every stop keeps the margins" if stops.verified else "NOT every stop keeps the margins"
    figure.suptitle(f"Stopped at any instant: {verdict}", fontsize=13, fontweight="bold")
    return figure
