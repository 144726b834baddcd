"""`ocptip view`: a plan, a scene or a placement in three dimensions, in a browser."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.api.view import View, view
from ocptip.basics.errors import InputError, naming
from ocptip.basics.write import file_target
from ocptip.cli.command import ResultReport
from ocptip.cli.options import naming_options


def run(options: Namespace) -> ViewReport:
    """Make the page or the animation; without a file serve the page until Ctrl-C."""
    for name in ("html", "movie"):
        file = getattr(options, name)
        if file is not None and not Path(file).resolve().parent.is_dir():
            raise InputError(f"--{name}: no such directory: {Path(file).parent}")
    with naming_options("task"):
        result = view(options.what, options.second, task=options.task)
    files = list[Path]()
    if options.html is not None:
        result.html  # noqa: B018 # what cannot be drawn is refused before files are written
        files.append(Path(options.html))
    if options.movie is not None:
        with naming("--movie"):
            files.append(file_target(options.movie, (".gif", ".mp4")))
    if not files:
        result.serve(lambda address: print(f"{result.name}: {address}", file=sys.stderr))
    return ViewReport(result, *files)


@dataclass
class ViewReport(ResultReport):
    """A page, an animation, or both; without file it was served."""

    result: View
    second: Path | None = None

    def write(self) -> Iterator[Path]:
        """The files that were asked for."""
        yield from super().write()
        if self.second is not None:
            self.result.save(self.second)
            yield self.second

    def to_dict(self) -> dict[str, Any]:
        """The name of the view and its file."""
        return self.result.to_dict(None if self.out is None else Path(self.out))

    def to_text(self) -> str:
        """The name of the view and its file."""
        files = [Path(file) for file in (self.out, self.second) if file is not None]
        sizes = [f"{file} ({file.stat().st_size / 1e6:.2f} MB)" for file in files]
        return f"{self.result.name}: {', '.join(sizes)}" if files else f"{self.result.name}: shown."
