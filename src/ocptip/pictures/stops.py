"""Figure of stops: the largest safe share of the planned speed over time, and how long stops take."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from ocptip.motion.stops.check import Stops
from ocptip.pictures import style
from ocptip.pictures.frame import new_figure, save_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LABELS = {"path": "path-maintaining", "brakes": "by brakes", "cancel": "on cancel"}


def draw_stops(directory: str | os.PathLike[str], stops: Stops) -> list[Path]:
    """Draw `stops.png` into a directory; a file of that name is replaced.

    Raises:
        OSError: the file or the directory cannot be written; names it.
    """
    return save_figures(directory, {"stops": lambda: stops_figure(stops)})


def stops_figure(stops: Stops) -> Figure:
    """A Matplotlib figure of stops."""
    figure = new_figure(10.5, 6.0)
    speed, time = figure.subplots(2, 1, sharex=True)
    for number, (kind, label) in enumerate(_LABELS.items()):
        if kind not in stops.speeds:
            continue
        marks = {**style.member(number), "marker": "o", "ms": 4, "label": label}
        speed.plot(stops.times, 100 * stops.speeds[kind], **marks, gid=f"{label}-speed")
        time.plot(stops.times, stops.durations[kind], **marks, gid=f"{label}-time")
    if stops.curve is not None:
        times, shares = stops.curve
        finer = {**style.member(0), "lw": 0.9, "label": "path-maintaining, every place"}
        speed.plot(times, 100 * shares, **finer, gid="path-speed")
    speed.set_ylim(-3.0, 108.0)
    time.set_ylim(bottom=0.0)
    style.finish(speed, "Largest speed from which a stop is safe", "safe / planned speed [%]")
    style.finish(time, "Duration of a stop", "duration [s]", "stopped at [s] of the motion")
    verdict = "every stop keeps the margins" if stops.verified else "NOT every stop keeps the margins"
    style.head(figure, f"Stopped at any instant: {verdict}")
    return figure
