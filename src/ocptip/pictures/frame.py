"""The canvas of all figures, and their files, which appear complete or not at all."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.basics.write import MARK, atomic_file, write_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image


DPI = 130
_LEFT, _FOOT, _BELOW = 0.85, 0.75, 0.65  # inches: beside panels, below all, below upper ones
_TITLE, _HEAD, _HEAD_LINE, _NOTE_LINE, _EDGE = 0.32, 0.35, 0.21, 0.15, 0.1  # inches high


def new_figure(width: float, height: float, layout: bool = True) -> Figure:
    """An empty figure of this size, inches, that needs no window; without layout see `place_panels`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained" if layout else None)
    FigureCanvasAgg(figure)
    return figure


def place_panels(upper: Sequence[Any], high: float, panels: Sequence[Any]) -> None:
    """Put panels of a figure with a title but no layout where their labels and legends have room.

    Only legends are measured. Matplotlib's layout measures every label twice, which took half the time of a
    figure.

    Args:
        upper: panels side by side below the title; those without legend have no axes.
        high: inches for these.
        panels: one below the other over one axis.
    """
    figure = panels[0].figure
    width, height = figure.get_size_inches()
    head, note = (text.count("\n") for text in (figure.get_suptitle(), figure.get_supxlabel()))
    top, low = height - _HEAD - _HEAD_LINE * head - high, _FOOT + _NOTE_LINE * note
    figure.texts[0].set_y(1 - _EDGE / height)
    beside = max(map(_legend_width, panels))
    step = (top - low) / len(panels)
    for k, ax in enumerate(reversed(panels)):
        _put(ax, _LEFT, low + step * k, width - beside - _LEFT, step - _TITLE)
    begins = [*(k * width / len(upper) for k in range(len(upper))), width]
    for ax, left, right in zip(upper, begins[:-1], begins[1:], strict=True):
        below = _EDGE
        if ax.get_legend():
            left, right, below = left - high / 2 + _LEFT, right - _legend_width(ax), _BELOW
        _put(ax, left, top + below, right - left, high - below - 1.5 * _TITLE)


def _put(ax: Any, left: float, low: float, width: float, height: float) -> None:
    size = ax.figure.get_size_inches()
    ax.set_position([left / size[0], low / size[1], width / size[0], height / size[1]])


def _legend_width(ax: Any) -> float:
    """Inches beside a panel."""
    legend = ax.get_legend()
    return 0.15 if legend is None else legend.get_window_extent().width / ax.figure.dpi + 0.15


def hull(points: np.ndarray) -> np.ndarray:
    """Indices of the corners of the convex hull of points (k, 2), in order; all where they lie on a line.

    Two monotone chains (A. M. Andrew, 1979): what SciPy has for this loads for 0.2 s.
    """
    order = np.lexsort(points.T[::-1])
    corners = np.array([*_turning_left(points, order)[:-1], *_turning_left(points, order[::-1])[:-1]])
    return corners if len(corners) > 2 else np.arange(len(points))


def _turning_left(points: np.ndarray, order: np.ndarray) -> list[int]:
    """Those of points (k, 2) in this order at which a path along their left side turns left."""
    kept: list[int] = []
    flat = 1e-12 * float(np.max(np.abs(points), initial=0.0)) ** 2
    for k in order:
        while len(kept) > 1:
            (ax, ay), (bx, by) = points[kept[-1]] - points[kept[-2]], points[k] - points[kept[-1]]
            if ax * by - ay * bx > flat:
                break
            kept.pop()
        kept.append(int(k))
    return kept


def save_figures(
    directory: str | os.PathLike[str], figures: Mapping[str, Callable[[], Figure]], dpi: int = DPI
) -> list[Path]:
    """Draw figures into a directory as PNG; files of the same name are replaced.

    Args:
        directory: made if it does not exist; the one above it must.
        figures: what draws each, by the names of the files without ending.
        dpi: pixels per inch.

    Returns:
        The paths.

    Raises:
        OSError: a file or the directory cannot be written; names it.
    """
    return write_files(Path(directory), png_files(figures, dpi))


def png_files(figures: Mapping[str, Callable[[], Figure]], dpi: int = DPI) -> dict[str, bytes]:
    """Contents of PNG files by their names; arguments are those of `save_figures`."""
    return {f"{name}.png": png(draw(), dpi) for name, draw in figures.items()}


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: int) -> Path:
    """Write a figure into a .png, .pdf or .svg file, which appears complete or not at all."""
    path = Path(path)
    kind = path.suffix[1:].lower()
    key = {"png": "Comment", "pdf": "Keywords", "svg": "Description"}.get(kind)
    about = {key: MARK} if key else None
    with atomic_file(path) as stream:
        figure.savefig(stream, format=kind, dpi=dpi, metadata=about)
    return path


def png(figure: Figure, dpi: int = DPI, *, small: bool = False) -> bytes:
    """Content of a PNG file, without the alpha channel and the hard search of `savefig`: in half the time.

    A small one has 256 colours: a third of the size.
    """
    from PIL import Image, PngImagePlugin

    stream, about, image = io.BytesIO(), PngImagePlugin.PngInfo(), drawn(figure, dpi)
    about.add_text("Comment", MARK)
    if small:
        image = image.quantize(256, dither=Image.Dither.NONE)
    image.save(stream, format="png", dpi=(dpi, dpi), compress_level=3, pnginfo=about)
    return stream.getvalue()


def drawn(figure: Figure, dpi: int) -> Image:
    """An image of Pillow.

    Letters are not hinted: at this size the difference is not visible, and hinting took a tenth of the time.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    with rc_context({"text.hinting": "none"}):
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
