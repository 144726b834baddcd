"""Figures of a robot at rest: how far the floor may tilt in each direction, and what the gripper may hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ocptip.pictures import style
from ocptip.pictures.frame import new_figure


def tilt_figure(found: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Largest tilts over the direction downhill, seen from above.

    Args:
        found: by pose: directions (k, 3), base axes, and tilts (k,), rad.
    """
    figure = new_figure(6.0, 5.6)
    ax = figure.add_subplot(projection="polar")
    widths = np.linspace(6.0, 1.5, max(len(found), 2))  # curves often lie on each other
    for number, ((name, (sides, tilts)), width) in enumerate(zip(found.items(), widths, strict=False)):
        turns = np.arctan2(sides[:, 1], sides[:, 0])
        order = np.argsort(turns)
        order = np.append(order, order[0])
        ax.plot(
            turns[order],
            np.degrees(tilts)[order],
            **style.member(number),
            lw=width,
            label=name,
            gid=f"tilt-{name}",
        )
    ax.set_ylim(bottom=0.0)
    ax.tick_params(axis="y", labelcolor="#606060", labelsize=8, zorder=3)
    for label in ax.get_yticklabels():
        label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.8})
    ax.set_title("Largest tilt of the floor at rest [deg], by direction downhill (0: x, 90: y)", fontsize=9.5)
    figure.legend(frameon=False, loc="outside lower center", ncols=2, **style.TEXT)
    return figure


def payload_figure(times: np.ndarray, masses: np.ndarray) -> Figure:
    """Largest further payload (N,), kg, in the postures at times (N,), s, of a motion, at rest there."""
    figure = new_figure(8.0, 3.2)
    ax = figure.subplots()
    line_style = {"color": style.PAYLOAD.color, **style.NOMINAL}
    ax.plot(times, masses, **line_style, gid="payload")
    least = f"at least {float(np.min(masses)):.3g} kg more"
    style.finish(
        ax, f"Largest payload at rest: {least}", style.PAYLOAD.label, "posture at time [s] of the motion"
    )
    ax.set_ylim(0.0, 1.06 * max(float(np.max(masses)), 1e-9))
    return figure
