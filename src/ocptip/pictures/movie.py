"""Frames as a GIF, an MP4 or a page that needs nothing else; all play `RATE` frames per second."""

from __future__ import annotations

import io
import os
import subprocess
import tempfile
from base64 import b64encode
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK

SUFFIXES = (".gif", ".mp4", ".html")
RATE = 20  # frames per second: 50 ms each, which GIF can say
_HELD = 12  # frames: how long the last one is shown
_COLORS = 128  # of frames in pages, which makes them a third as large
_SHORTEST, _LONGEST = 1.0, 7.5  # s of an animation without the last frame
_ROUND = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


def speed_of(span: float) -> float:
    """Seconds of a motion per second of its animation: 1, or a round factor for short and long motions."""
    if span <= 0:
        return 1.0
    factors = [1.0, *(1 / one for one in _ROUND), *_ROUND]
    return min(factors, key=lambda one: (max(_SHORTEST - span / one, 0.0), max(span / one - _LONGEST, 0.0)))


def speed_text(speed: float) -> str:
    """In words."""
    if speed == 1:
        return "in real time"
    return (
        f"{speed:g} times faster than real time"
        if speed > 1
        else f"{1 / speed:g} times slower than real time"
    )


def frame_times(span: float, finer: int = 1) -> np.ndarray:
    """(T,) times, s, from 0 to the end of a motion, of frames, or of `finer` instants per frame."""
    step = speed_of(span) / RATE / finer
    return np.append(np.arange(0.0, span - 1e-3 * step, step), span)


def require_format(path: Path) -> str:
    """The ending of a file that can be written, in small letters.

    Raises:
        InputError: another one, or what writes MP4 is missing.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"expected a file name ending in .gif, .mp4 or .html, got {str(path)!r}")
    if suffix == ".mp4":
        _ffmpeg()
    return suffix


def write_movie(path: Path, frames: Sequence[Any], title: str) -> None:
    """Write images of Pillow, all of one size, into a file, which appears complete or not at all.

    Raises:
        InputError: see `require_format`.
        OSError: the file cannot be written.
    """
    suffix = require_format(path)
    with tempfile.TemporaryDirectory(dir=path.resolve().parent, prefix=".ocptip-") as folder:
        made = Path(folder) / f"movie{suffix}"
        if suffix == ".html":
            made.write_text(_page(frames, title), encoding="utf-8")
        elif suffix == ".gif":
            times = [1000 // RATE] * (len(frames) - 1) + [_HELD * 1000 // RATE]
            frames[0].save(made, save_all=True, append_images=frames[1:], duration=times, loop=0)
            with made.open("ab") as stream:  # readers of GIF stop before it
                stream.write(f"\n<!-- {MARK} -->\n".encode())
        else:
            _encode(made, [*frames, *[frames[-1]] * _HELD])
        os.replace(made, path)


def _ffmpeg() -> str:
    """The path of the program."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        raise InputError(".mp4: needs ffmpeg (pip install 'ocptip[video]'); .gif and .html do not") from None
    return get_ffmpeg_exe()


def _encode(path: Path, frames: Sequence[Any]) -> None:
    # Players take YUV 4:2:0 alone, which needs even sides.
    width, height = (2 * (side // 2) for side in frames[0].size)
    given = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {RATE} -i -"
    made = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18", "-metadata", f"comment={MARK}"]
    command = [_ffmpeg(), "-loglevel", "error", *given.split(), *made, f"{path}"]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        for frame in frames:
            process.stdin.write(np.asarray(frame.convert("RGB"))[:height, :width].tobytes())
    if process.returncode:
        raise OSError(f"ffmpeg ended with {process.returncode}")


def _page(frames: Sequence[Any], title: str) -> str:
    images = []
    for frame in frames:
        stream = io.BytesIO()
        frame.convert("P", palette=1, colors=_COLORS).save(stream, format="png", optimize=True)
        images.append(f"'data:image/png;base64,{b64encode(stream.getvalue()).decode('ascii')}'")
    page = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    known = {"TITLE": escape(title), "MARK": MARK, "STEP": f"{1000 // RATE}", "HELD": f"{_HELD}"}
    for name, value in {**known, "FRAMES": ",\n".join(images)}.items():
        page = page.replace(f"{{{name}}}", value)
    return page
