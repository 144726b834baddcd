"""Pinocchio's model of a URDF file that was read and checked here; what its C++ parsers print is collected.

What the parsers do not understand they say on the standard streams, several lines for one fault.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.read import require_readable
from ocptip.basics.text import some
from ocptip.robots.pinocchio import PinocchioModel, load_coal, load_pinocchio
from ocptip.robots.urdf.document import require_shallow, xml_of

_PLACE = re.compile(r"\s+at line \d+ in \S+")
_MOST = 3  # lines shown


def pinocchio_model(file: Path) -> PinocchioModel:
    """The model of a URDF file.

    Raises:
        InputError: it cannot be read, or Pinocchio refuses it; one line.
    """
    pin_module, (root, text) = load_pinocchio(), xml_of(file)
    require_shallow(root, file)
    with printed() as lines:
        try:
            return pin_module.buildModelFromXML(text)
        except (ValueError, RuntimeError) as error:
            problem = " ".join(str(error).split())
    raise InputError(f"not a readable URDF: {some(lines, _MOST) or problem}", "", str(file))


def load_mesh(path: str | os.PathLike[str], scale: Sequence[float]) -> Any:
    """Coal's model of a mesh file, its lengths in m times `scale`.

    Raises:
        InputError: it is no file that can be read.
        ValueError, RuntimeError: it is no mesh.
    """
    require_readable(path)
    with printed():
        return load_coal().MeshLoader().load(os.fspath(path), np.asarray(scale, dtype=float))


@contextmanager
def printed() -> Iterator[list[str]]:
    """Collect what C++ code prints in this block on stdout and stderr: a line per message, without its place.

    The list is filled when the block ends. Where the system has no more file handles nothing is collected.
    """
    lines: list[str] = []
    saved: list[tuple[int, int]] = []
    with ExitStack() as stack:
        target = None
        with suppress(OSError):
            target = stack.enter_context(tempfile.TemporaryFile())
        try:
            with suppress(OSError, AttributeError):  # there may be no stream
                for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
                    if target is None:
                        break
                    stream.flush()
                    saved.append((number, os.dup(number)))
                    os.dup2(target.fileno(), number)
            yield lines
        finally:
            for number, copy in saved:
                os.dup2(copy, number)
                os.close(copy)
            if target is not None:
                target.seek(0)
                text = _PLACE.sub("", target.read().decode("utf-8", "replace"))
                results = [re.sub(r"^(Error|Warning):\s*", "", line).strip() for line in text.splitlines()]
                lines += dict.fromkeys(line for line in results if line)
