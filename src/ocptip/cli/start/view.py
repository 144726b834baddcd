"""`ocptip view`: a plan, a scene or a placement in three dimensions, in a browser."""

from __future__ import annotations

import sys
from argparse import Namespace
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
    if options.html is not None and options.movie is not None:
        raise InputError("--movie: not together with --html")
    with naming_options("task"):
        found = view(options.what, options.second, task=options.task)
    if options.movie is not None:
        with naming("--movie"):
            return ViewReport(found, file_target(options.movie, (".gif", ".mp4")))
    if options.html is None:
        found.serve(lambda address: print(f"{found.name}: {address}", file=sys.stderr))
        return ViewReport(found, None)
    found.html  # noqa: B018 # what cannot be drawn is refused before files are written
    return ViewReport(found, Path(options.html))


@dataclass
class ViewReport(ResultReport):
    """A page or an animation; without file it was served."""

    found: View

    def to_dict(self) -> dict[str, Any]:
        """The name of the view and its file."""
        return self.found.to_dict(None if self.out is None else Path(self.out))

    def to_text(self) -> str:
        """The name of the view and its file."""
        found = self.found
        if self.out is None:
            return f"{found.name}: shown."
        return f"{found.name}: {self.out} ({Path(self.out).stat().st_size / 1e6:.2f} MB)"
