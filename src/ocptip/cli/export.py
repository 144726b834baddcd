"""`ocptip export`: a plan's robot on its base, and its motion, for rigid-body simulators."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.api.export import Exported, export
from ocptip.basics.errors import InputError
from ocptip.cli.command import Report
from ocptip.cli.layout import named, under


def run(options: Namespace) -> ExportReport:
    """Make the models."""
    if options.mjcf is None and options.urdf is None:
        raise InputError("export: name a file, --mjcf FILE or --urdf FILE")
    found = export(options.plan, mjcf=options.mjcf, urdf=options.urdf, overwrite=options.overwrite)
    return ExportReport(found)


@dataclass
class ExportReport(Report):
    """The report on exported models.

    Attributes:
        found: the models.
    """

    found: Exported

    def to_dict(self) -> dict[str, Any]:
        """Files and what is to be known of them."""
        return self.found.to_dict()

    def to_text(self) -> str:
        """The written files and the remarks."""
        rows = under("written", self.written) + under("note", self.found.remarks)
        return "\n".join([f"{self.found.name}: exported.", *named(rows)])

    def write(self) -> Iterator[Path]:
        """The files."""
        yield from self.found.write()
