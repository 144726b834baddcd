"""Texts of a picture that find free places beside their anchors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d import proj3d

_GAPS = (5, 14, 26)  # points between a label and its anchor
_TURNS = (0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6, 2.4, -2.4, 3.1)  # rad away from its preferred direction


@dataclass
class Labels:
    """Texts that find free places beside their anchors once the layout of the figure is known."""

    wanted: list[tuple[Any, np.ndarray, np.ndarray, str, str, str]] = field(default_factory=list)
    obstacles: list[tuple[Any, np.ndarray]] = field(default_factory=list)

    def add(self, ax: Any, anchor: Any, towards: Any, text: str, color: str = "black", gid: str = "") -> None:
        """A text at `anchor`, in the direction of `towards` if there is room (both data coordinates)."""
        self.wanted.append((ax, np.asarray(anchor, float), np.asarray(towards, float), text, color, gid))

    def avoid(self, ax: Any, start: Any, end: Any) -> None:
        """Keep texts off the line from `start` to `end` (data coordinates)."""
        steps = np.linspace(0.0, 1.0, 24)[:, None]
        self.obstacles.append((ax, (1 - steps) * np.asarray(start, float) + steps * np.asarray(end, float)))

    def place(self, figure: Figure) -> None:
        """Write all texts."""
        canvas: Any = figure.canvas  # of `new_figure`
        renderer = canvas.get_renderer()
        per_point = figure.dpi / 72.0
        points = np.vstack([np.empty((0, 2)), *(on_screen(ax, line) for ax, line in self.obstacles)])
        boxes: list[np.ndarray] = []
        for ax, anchor, towards, text, color, gid in self.wanted:
            start, ahead = on_screen(ax, np.array([anchor, anchor + towards]))
            moved = np.any(np.abs(ahead - start) > 1e-6)
            preferred = math.atan2(*(ahead - start)[::-1]) if moved else 0.5 * np.pi
            artist = figure.text(0, 0, text, color=color, fontsize=9.5, ha="center", va="center", gid=gid)
            artist.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
            extent = artist.get_window_extent(renderer)
            half = 0.5 * np.array([extent.width, extent.height])
            frame = ax.get_window_extent(renderer)
            best_cost, best_center = np.inf, start
            for gap, turn in product(_GAPS, _TURNS):
                u = np.array([math.cos(preferred + turn), math.sin(preferred + turn)])
                reach = min(half / np.maximum(np.abs(u), 1e-9))  # from the text's centre to its rim
                center = start + (reach + gap * per_point) * u
                box = np.array([center - half - 4, center + half + 4])
                outside = np.any(box[0] < [frame.x0, frame.y0]) or np.any(box[1] > [frame.x1, frame.y1])
                hits = sum(bool(np.all(box[0] < b[1]) and np.all(b[0] < box[1])) for b in boxes)
                covered = int(np.sum(np.all((points > box[0]) & (points < box[1]), axis=1)))
                cost = 100 * hits + 60 * outside + 3 * covered + abs(turn) + 0.1 * gap
                if cost < best_cost:
                    best_cost, best_center = cost, center
            boxes.append(np.array([best_center - half, best_center + half]))
            x, y = figure.transFigure.inverted().transform(best_center)
            artist.set_position((x, y))


def on_screen(ax: Any, points: np.ndarray) -> np.ndarray:
    """Display coordinates (pixels) of data points of a two- or three-dimensional panel."""
    if ax.name == "3d":
        xs, ys, zs = points.T
        x, y, _ = proj3d.proj_transform(xs, ys, zs, ax.get_proj())
        points = np.column_stack([x, y])
    return ax.transData.transform(points)
