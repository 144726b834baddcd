"""`ocptip export`: a plan's robot on its base, and its motion, for rigid-body simulators."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ocptip.api.export import Exported, export
from ocptip.basics.errors import InputError
from ocptip.cli.command import ResultReport
from ocptip.cli.layout import named, under


def run(options: Namespace) -> ExportReport:
    """Make the models."""
    if options.mjcf is None and options.urdf is None:
        raise InputError("export: name a file, --mjcf FILE or --urdf FILE")
    exported = export(options.plan, mjcf=options.mjcf, urdf=options.urdf, overwrite=options.overwrite)
    return ExportReport(exported)


@dataclass
class ExportReport(ResultReport):
    """The report on exported models."""

    result: Exported

    def to_text(self) -> str:
        """The written files and the remarks."""
        rows = under("written", self.written) + under("note", self.result.remarks)
        return "\n".join([f"{self.result.name}: exported.", *named(rows)])

    def write(self) -> Iterator[Path]:
        """The files."""
        yield from self.result.write()
