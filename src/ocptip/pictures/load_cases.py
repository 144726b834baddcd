"""Figures of a robot at rest: how far the floor may tilt in each direction, and what the gripper may hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ocptip.pictures.frame import COLORS, new_figure


def tilt_figure(found: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Largest tilts over the direction downhill, seen from above.

    Args:
        found: by pose: directions (k, 3), base axes, and tilts (k,), rad.
    """
    figure = new_figure(6.0, 5.6)
    ax = figure.add_subplot(projection="polar")
    widths = np.linspace(6.0, 1.5, max(len(found), 2))  # curves often lie on each other
    for (name, (sides, tilts)), color, width in zip(found.items(), COLORS * len(found), widths, strict=False):
        turns = np.arctan2(sides[:, 1], sides[:, 0])
        order = np.argsort(turns)
        order = np.append(order, order[0])
        ax.plot(turns[order], np.degrees(tilts)[order], color=color, lw=width, label=name, gid=f"tilt-{name}")
    ax.set_ylim(bottom=0.0)
    ax.tick_params(axis="y", labelcolor="#606060", labelsize=8, zorder=3)
    for label in ax.get_yticklabels():
        label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.8})
    ax.set_title("largest tilt of the floor [deg] at rest, by direction downhill (0: x, 90: y)", fontsize=9)
    ax.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(-0.18, -0.12))
    return figure


def payload_figure(times: np.ndarray, masses: np.ndarray) -> Figure:
    """Largest further payload (N,), kg, in the postures at times (N,), s, of a motion, at rest there."""
    figure = new_figure(8.0, 3.2)
    ax = figure.subplots()
    ax.plot(times, masses, color=COLORS[0], gid="payload")
    ax.set_xlabel("posture at [s] of the motion")
    ax.set_ylabel("more at the gripper [kg]")
    ax.set_ylim(0.0, 1.06 * max(float(np.max(masses)), 1e-9))
    ax.grid(color="#ececec", lw=0.8)
    return figure
