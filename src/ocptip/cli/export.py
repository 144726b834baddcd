"""`ocptip export`: a plan's robot on its base, and its motion, for rigid-body simulators."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, naming
from ocptip.basics.write import versions, write_text
from ocptip.cli.command import Report
from ocptip.cli.layout import named, under
from ocptip.standing.arm import StandingRobot
from ocptip.standing.simulation.mjcf import remarks, to_mjcf
from ocptip.standing.simulation.urdf import to_urdf
from ocptip.task_files.plan_folder import read_plan_folder


def run(options: Namespace) -> ExportReport:
    """Write the model."""
    if options.mjcf is None and options.urdf is None:
        raise InputError("export: name a file, --mjcf FILE or --urdf FILE")
    plan = read_plan_folder(options.plan)
    (robot, motion), name = plan.of_arm("export writes"), plan.task.name
    files = {}
    with naming(options.plan):
        if options.mjcf is not None:
            files[Path(options.mjcf)] = to_mjcf(robot, motion, name=name)
        if options.urdf is not None:
            files[Path(options.urdf)] = to_urdf(robot, name=name)
    return ExportReport(name, robot, files)


@dataclass
class ExportReport(Report):
    """What was written.

    Attributes:
        name: of the task.
        robot: that was written.
        files: their texts.
    """

    name: str
    robot: StandingRobot
    files: dict[Path, str]

    good = True

    def to_dict(self) -> dict[str, Any]:
        """Files and what is to be known of them."""
        return {
            "task": self.name,
            "files": [f"{path}" for path in self.files],
            **self.robot.masses_to_dict(),
            "remarks": remarks(self.robot),
            "versions": versions(),
        }

    def to_text(self) -> str:
        """The same."""
        rows = under("written", self.written) + under("note", remarks(self.robot))
        return "\n".join([f"{self.name}: exported.", *named(rows)])

    def write(self) -> Iterator[Path]:
        """The files."""
        for path, text in self.files.items():
            write_text(path, text)
            yield path
