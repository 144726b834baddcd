"""`ocptip export`: a plan's robot on its base, and its motion, for rigid-body simulators.

Of a cycle each segment is a file of its own, with what the robot holds then.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, naming
from ocptip.basics.outputs import require_replaceable_file
from ocptip.basics.write import versions, write_text
from ocptip.cli.command import Report
from ocptip.cli.layout import named, under
from ocptip.standing.parts import Part
from ocptip.standing.simulation.mjcf import remarks, to_mjcf
from ocptip.standing.simulation.urdf import to_urdf
from ocptip.task_files.plan_folder import read_plan_folder


def run(options: Namespace) -> ExportReport:
    """Write the model."""
    if options.mjcf is None and options.urdf is None:
        raise InputError("export: name a file, --mjcf FILE or --urdf FILE")
    plan = read_plan_folder(options.plan)
    parts, name = plan.parts("export writes"), plan.task.name
    files = {}
    with naming(options.plan):
        for number, part in enumerate(parts, 1):
            own = {"name": f"{name}, {part.name}" if part.name else name}
            segment = number if len(parts) > 1 else None
            if options.mjcf is not None:
                model = to_mjcf(part.robot, part.motion, begin=part.begin, **own)
                files[_path(options.mjcf, segment)] = model
            if options.urdf is not None:
                files[_path(options.urdf, segment)] = to_urdf(part.robot, **own)
    for path in files:
        require_replaceable_file(path, overwrite=options.overwrite)
    return ExportReport(name, parts, files)


def _path(name: str, segment: int | None) -> Path:
    """The file; of a segment of a cycle with its number before the ending."""
    path = Path(name)
    return path if segment is None else path.with_stem(f"{path.stem}-{segment}")


@dataclass
class ExportReport(Report):
    """What was written.

    Attributes:
        name: of the task.
        parts: that were written.
        files: their texts.
    """

    name: str
    parts: tuple[Part, ...]
    files: dict[Path, str]

    good = True

    def to_dict(self) -> dict[str, Any]:
        """Files and what is to be known of them."""
        return {
            "task": self.name,
            "files": [f"{path}" for path in self.files],
            **self.parts[0].robot.masses_to_dict(),
            "remarks": remarks(self.parts),
            "versions": versions(),
        }

    def to_text(self) -> str:
        """The same."""
        rows = under("written", self.written) + under("note", remarks(self.parts))
        return "\n".join([f"{self.name}: exported.", *named(rows)])

    def write(self) -> Iterator[Path]:
        """The files."""
        for path, text in self.files.items():
            write_text(path, text)
            yield path
