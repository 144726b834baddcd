"""The minimum distance of a motion over time, with the names of the pair that is nearest at each instant."""

from __future__ import annotations

from typing import Any

import numpy as np

from ocptip.pictures.style import MEMBERS, NOMINAL
from ocptip.standing.mechanism import MotionSamples, StandingMechanism

_REST = "#7a7a7a"
_SHOWN = len(MEMBERS)  # pairs with colours of their own; the others are one


def nearest_pairs(robot: StandingMechanism, samples: MotionSamples) -> tuple[np.ndarray, list[str]]:
    """Numbers (N,) of the nearest pairs at all instants, and their names, those nearest for longest first."""
    found = robot.collision.nearest(samples.angles)
    names = np.array([str(label) for label in robot.collision.labels])[found.pairs]
    unique, first, counts = np.unique(names, return_index=True, return_counts=True)
    order = np.lexsort((first, -counts))
    rank = np.empty(len(order), dtype=int)
    rank[order] = np.arange(len(order))
    return rank[np.searchsorted(unique, names)], [str(name) for name in unique[order]]


def draw_clearance(ax: Any, robot: StandingMechanism, samples: MotionSamples) -> bool:
    """Minimum distances, mm, in the colour of the pair; False, and a note, where nothing was checked."""
    if not np.isfinite(samples.clearances).any():
        ax.text(0.5, 0.5, "collision not checked", ha="center", va="bottom", transform=ax.transAxes)
        return False
    which, names = nearest_pairs(robot, samples)
    gaps = 1e3 * samples.clearances
    for k, name in enumerate([*names[:_SHOWN], "other pairs"]):
        own = which == k if k < _SHOWN and k < len(names) else which >= _SHOWN
        if name == "other pairs" and not own.any():
            continue
        ends = own | np.roll(own, 1) & (np.arange(len(own)) > 0)  # up to where the next pair begins
        color = _REST if name == "other pairs" else MEMBERS[k]
        line_style = {
            **NOMINAL,
            "color": color,
            "label": name if name == "other pairs" else f"between {name}",
            "gid": f"clearance-{k + 1}",
        }
        ax.plot(samples.times, np.where(ends, gaps, np.nan), **line_style)
    return True
