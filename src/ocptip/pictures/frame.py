"""What all figures share: colours, the canvas, and files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull, QhullError

from ocptip.basics.write import atomic_file

# Okabe and Ito's palette, told apart with any colour vision; its yellow is too pale for lines on white.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")


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


def save_figures(
    directory: str | os.PathLike[str], figures: Mapping[str, Callable[[], Figure]], dpi: int
) -> list[Path]:
    """Draw figures one by one into a directory as PNG; files of the same name are replaced.

    Args:
        directory: made if it does not exist; the one above it must.
        figures: what draws each, by the names of the files without ending.
        dpi: pixels per inch.

    Returns:
        The paths.

    Raises:
        OSError: a file or the directory cannot be written; names it.
    """
    directory, paths = Path(directory), []
    directory.mkdir(exist_ok=True)
    for name, draw in figures.items():
        paths.append(directory / f"{name}.png")
        with atomic_file(paths[-1]) as stream:
            draw().savefig(stream, format="png", dpi=dpi)
    return paths
