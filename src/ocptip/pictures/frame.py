"""What all figures share: colours, the canvas, and files that appear complete or not at all."""

from __future__ import annotations

import io
import os
import pickle
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.basics.write import MARK, atomic_file, write_bytes
from ocptip.numerics.fork_server import cores, ready
from ocptip.numerics.workers import Workers

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Okabe and Ito's palette, told apart with any colour vision; its yellow is too pale for lines on white.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
SEGMENT = "#f4f7fb"

DPI = 130

LEGEND_SIZE, LEGEND_HANDLE, LEGEND_GAP = 8.5, 1.8, 1.2
"""Points; the others in units of it."""


def new_figure(width: float, height: float, layout: Any = "constrained") -> Figure:
    """An empty figure of this size, inches, that needs no window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


_LEFT, _RIGHT, _TWIN, _BELOW = 0.85, 0.15, 0.75, 0.52  # inches beside a panel: labels, none, those of a twin
_TOP, _BOTTOM = 0.42, 0.24  # inches for the title of the figure, and for its note
_POINT = 1 / 72


def place_panels(figure: Figure) -> None:
    """Place the panels of a grid, each with a title and a legend on top, side by side.

    Sizes are known here, so that nothing has to be drawn in order to be measured: Matplotlib's constrained
    layout takes as long as drawing does.
    """
    width, height = figure.get_size_inches()
    places: list[tuple[Any, Any]] = [(ax, ax.get_subplotspec()) for ax in figure.axes]
    rows, columns = places[0][1].get_gridspec().get_geometry()
    over, right = np.zeros(rows), np.full(columns, _RIGHT)
    taken = Counter((spec.rowspan.start, spec.colspan.start) for _, spec in places)
    for ax, spec in places:
        k, title = spec.rowspan.start, ax.get_title("left")
        lines = title.count("\n") + 1 if title else 0
        pad = 72 * ax.titleOffsetTrans.transform((0, 0))[1] / figure.dpi
        over[k] = max(over[k], _POINT * (pad + 13.5 * lines))
        if taken[k, spec.colspan.start] > 1:
            right[spec.colspan.start] = _TWIN
    bottom = _BOTTOM if figure.get_supxlabel() else 0.0
    high = (height - _TOP - bottom - over.sum() - rows * _BELOW) / rows
    wide = (width - right.sum() - columns * _LEFT) / columns
    for ax, spec in places:
        k, column = spec.rowspan.start, spec.colspan.start
        x = (column + 1) * _LEFT + column * wide + right[:column].sum()
        y = height - _TOP - over[: k + 1].sum() - (k + 1) * high - k * _BELOW
        ax.set_position((x / width, y / height, wide / width, high / height))


def hull(points: np.ndarray) -> np.ndarray:
    """Indices of the corners of the convex hull of points (k, 2), in order; all where they lie on a line.

    Two monotone chains (A. M. Andrew, 1979): what SciPy has for this loads for 0.2 s.
    """
    order = np.lexsort(points.T[::-1])
    corners = np.array([*_turning_left(points, order)[:-1], *_turning_left(points, order[::-1])[:-1]])
    return corners if len(corners) > 2 else np.arange(len(points))


def _turning_left(points: np.ndarray, order: np.ndarray) -> list[int]:
    """Those of points (k, 2) in this order at which a way along their left side turns left."""
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


def legend_columns(ax: Any, labels: list[str]) -> int:
    """Most columns that are not wider than the panel; a wider legend would squeeze all panels."""
    panel = 72 * ax.figure.get_figwidth() / ax.get_subplotspec().get_gridspec().ncols - 70
    widths = [LEGEND_SIZE * (0.6 * len(text) + LEGEND_HANDLE + 0.8 + LEGEND_GAP) for text in labels]
    for columns in range(len(labels), 1, -1):
        if sum(max(own) for own in np.array_split(widths, columns)) <= panel:
            return columns
    return 1


class Drawing:
    """Figures that are being drawn: by processes, where these start at once; else when they are saved.

    Also a context: where that ends by an exception, the processes end, too.

    Args:
        figures: what draws each, by the names of the files without ending.
        dpi: pixels per inch.
    """

    def __init__(self, figures: Mapping[str, Callable[[], Figure]], dpi: int = DPI) -> None:
        self._figures, self._dpi = figures, dpi
        self._pool: Workers | None = None
        self._drawn: dict[str, Future[bytes]] = {}
        if ready() and len(figures) > 1:
            self._pool = Workers(min(cores(), len(figures)))
            payload = pickle.dumps(dict(figures))
            self._drawn = {name: self._pool.submit(_png_of, payload, name, dpi) for name in figures}

    def save(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write the figures as PNG into a directory; files of the same name are replaced.

        Args:
            directory: made if it does not exist; the one above it must.

        Returns:
            The paths.

        Raises:
            OSError: a file or the directory cannot be written; names it.
        """
        directory = Path(directory)
        paths = []
        with self:
            directory.mkdir(exist_ok=True)
            for name, draw in self._figures.items():
                drawn = self._drawn.get(name)
                paths.append(directory / f"{name}.png")
                write_bytes(paths[-1], _png(draw, self._dpi) if drawn is None else drawn.result())
            if self._pool is not None:
                self._pool.shutdown(wait=False)
        return paths

    def __enter__(self) -> None:
        pass

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is not None and self._pool is not None:
            self._pool.end()


def save_figures(
    directory: str | os.PathLike[str], figures: Mapping[str, Callable[[], Figure]], dpi: int = DPI
) -> list[Path]:
    """Draw figures into a directory, see `Drawing`."""
    return Drawing(figures, dpi).save(directory)


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: int) -> Path:
    """Write a figure into a .png, .pdf or .svg file, which appears complete or not at all."""
    path = Path(path)
    kind = path.suffix[1:].lower()
    key = {"png": "Comment", "pdf": "Keywords", "svg": "Description"}.get(kind)
    about = {key: MARK} if key else None
    with atomic_file(path) as stream:
        figure.savefig(stream, format=kind, dpi=dpi, metadata=about)
    return path


def _png_of(payload: bytes, name: str, dpi: int) -> bytes:
    """In a process: one of pickled figures."""
    return _png(_unpickled(payload)[name], dpi)


@lru_cache(maxsize=1)
def _unpickled(payload: bytes) -> dict[str, Callable[[], Figure]]:
    return pickle.loads(payload)


def _png(draw: Callable[[], Figure], dpi: int) -> bytes:
    """Without the alpha channel and the hard search of `savefig`: files are smaller, in half the time.

    Letters are not hinted, which at this size is hardly seen and took a tenth of the time.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    figure = draw()
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    with rc_context({"text.hinting": "none"}):
        canvas.draw()
    stream = io.BytesIO()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    about = PngInfo()
    about.add_text("Comment", MARK)
    picture.save(stream, format="png", dpi=(dpi, dpi), compress_level=3, pnginfo=about)
    return stream.getvalue()


def mark_segments(ax: Any, segments: Iterable[tuple[float, float, str]]) -> None:
    """Shade the motions of a cycle on a time axis, and name them: begin and end, s, and name of each."""
    for begin, end, name in segments:
        ax.axvspan(begin, end, color=SEGMENT, zorder=-1, lw=0)
        at = {"xy": (begin, 0.0), "xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        ax.annotate(name, xytext=(2, 3), fontsize=7, color="#404040", annotation_clip=False, **at)
