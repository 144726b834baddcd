"""What all figures share: colours, the canvas, and files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull, QhullError

from ocptip.basics.write import atomic_file
from ocptip.numerics.workers import ready, worker_pool

# Okabe and Ito's palette, told apart with any colour vision; its yellow is too pale for lines on white.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
SEGMENT = "#f4f7fb"


LEGEND_SIZE, LEGEND_HANDLE, LEGEND_GAP = 8.5, 1.8, 1.2
"""Points; the others in units of it."""


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size, inches, that needs no window."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def hull(points: np.ndarray) -> np.ndarray:
    """Indices of the corners of the convex hull of points (k, 2), in order; all where they lie on a line."""
    try:
        return ConvexHull(points).vertices
    except (QhullError, ValueError):
        return np.arange(len(points))


def legend_columns(ax: Any, labels: list[str]) -> int:
    """Most columns that are not wider than the panel; a wider legend would squeeze all panels."""
    panel = 72 * ax.figure.get_figwidth() / ax.get_subplotspec().get_gridspec().ncols - 70
    widths = [LEGEND_SIZE * (0.6 * len(text) + LEGEND_HANDLE + 0.8 + LEGEND_GAP) for text in labels]
    for columns in range(len(labels), 1, -1):
        if sum(max(own) for own in np.array_split(widths, columns)) <= panel:
            return columns
    return 1


def save_figures(
    directory: str | os.PathLike[str], figures: Mapping[str, Callable[[], Figure]], dpi: int
) -> list[Path]:
    """Draw figures into a directory as PNG; files of the same name are replaced.

    Several at a time where processes start at once.

    Args:
        directory: made if it does not exist; the one above it must.
        figures: what draws each, by the names of the files without ending.
        dpi: pixels per inch.

    Returns:
        The paths.

    Raises:
        OSError: a file or the directory cannot be written; names it.
    """
    directory = Path(directory)
    directory.mkdir(exist_ok=True)
    files = {directory / f"{name}.png": draw for name, draw in figures.items()}
    if ready() and len(files) > 1:
        with worker_pool(None, None, len(files)) as pool:
            return list(pool.map(_save, files, files.values(), repeat(dpi)))
    return [_save(path, draw, dpi) for path, draw in files.items()]


def _save(path: Path, draw: Callable[[], Figure], dpi: int) -> Path:
    with atomic_file(path) as stream:
        draw().savefig(stream, format="png", dpi=dpi)
    return path


def mark_segments(ax: Any, segments: Iterable[tuple[float, float, str]]) -> None:
    """Shade the motions of a cycle on a time axis, and name them: begin and end, s, and name of each."""
    for begin, end, name in segments:
        ax.axvspan(begin, end, color=SEGMENT, zorder=-1, lw=0)
        at = {"xy": (begin, 0.0), "xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        ax.annotate(name, xytext=(2, 3), fontsize=7, color="#404040", annotation_clip=False, **at)
