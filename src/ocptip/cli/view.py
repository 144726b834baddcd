"""`ocptip view`: a plan, a scene or a placement in three dimensions, in a browser."""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.api.view import View, view
from ocptip.basics.errors import InputError
from ocptip.cli.command import ResultReport
from ocptip.cli.options import naming_options
from ocptip.pictures.view import library_viser


def run(options: Namespace) -> ViewReport:
    """Make the page; without --html serve it until Ctrl-C."""
    library_viser()
    if options.html is not None and not Path(options.html).resolve().parent.is_dir():
        raise InputError(f"--html: no such directory: {Path(options.html).parent}")
    with naming_options("task"):
        found = view(options.what, options.second, task=options.task)
    if options.html is None:
        found.serve(lambda address: print(f"{found.name}: {address}", file=sys.stderr))
        return ViewReport(found, None)
    found.html  # noqa: B018 # what cannot be drawn is said before files are written
    return ViewReport(found, Path(options.html))


@dataclass
class ViewReport(ResultReport):
    """A page; without file it was served."""

    found: View

    def to_dict(self) -> dict[str, Any]:
        """The name of the view and its file."""
        return self.found.to_dict(None if self.out is None else Path(self.out))

    def to_text(self) -> str:
        """The name of the view and its file."""
        found = self.found
        if self.out is None:
            return f"{found.name}: shown."
        size = len(found.html.encode()) / 1e6
        return f"{found.name}: {self.out} ({size:.2f} MB, {found.frames} frames)"
