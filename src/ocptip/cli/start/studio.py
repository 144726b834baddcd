"""`ocptip studio`: a robot at rest on a page with sliders, in a browser."""

from __future__ import annotations

import sys
from argparse import Namespace

from ocptip.api.studio import studio
from ocptip.cli.command import Answer, Report
from ocptip.cli.options import output_directory
from ocptip.pictures.browser.view import library_viser


def run(options: Namespace) -> Report:
    """Serve the page until Ctrl-C."""
    library_viser()
    result = studio(options.task)
    name = result.name
    folder = output_directory(options, name)
    result.serve(lambda address: print(f"{name}: {address}", file=sys.stderr), folder)
    return Answer(f"{name}: shown.", {"name": name})
