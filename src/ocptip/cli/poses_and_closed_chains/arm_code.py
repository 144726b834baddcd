"""`ocptip parallel ARM`: what the dynamics of a serial arm cost as lean code, and its C source."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as cs

from ocptip.basics.errors import InputError, naming
from ocptip.basics.schema import ANY_FILE
from ocptip.basics.text import table
from ocptip.basics.toml import Table
from ocptip.basics.write import versions
from ocptip.cli.command import Report
from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.lean_arm import lean_arm
from ocptip.parallel.code.leg_plans import OperationCount, count_operations
from ocptip.published.arms import arm_by_name, known_arms
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.task_files.tables.arm import arm_of_file

_TEXTS = ("urdf", "mjcf", "matlab", "latex")
_OF_PARALLEL = (*_TEXTS, "modes", "workspace", "at", "range", "plot", "dynpar", "form")


def is_arm(name: str) -> bool:
    """Whether a robot is a serial arm: a published one, a URDF, or a file with a table `[arm]`."""
    path = Path(name)
    if path.suffix.lower() in (".urdf", ".xml") or name.lower() in map(str.lower, known_arms()):
        return True
    return path.suffix.lower() == ".toml" and path.is_file() and "arm" in Table.read(path, ANY_FILE)


def arm_code(options: Namespace, target: Path | None) -> ArmCodeReport:
    """Generate the code of an arm.

    Raises:
        InputError: an option for parallel robots is given, or the arm has no such code; says which.
    """
    for option in _OF_PARALLEL:
        if getattr(options, option) is not None:
            raise InputError(f"--{option}: not for serial arms, which have one form of code")
    path = Path(options.robot)
    with naming(path.name):
        if path.suffix.lower() == ".toml":
            arm = arm_of_file(path)
        elif path.suffix:
            arm = arm_from_urdf(path, accept_inertia=True)
        else:
            arm = arm_by_name(options.robot)
        if not arm.masses.any():
            raise InputError("code: its links have no masses, so that nothing needs torque")
        return ArmCodeReport(arm, lean_arm(arm), target)


def count_table(counts: Iterable[tuple[str, OperationCount]]) -> list[str]:
    """Operations by title."""
    rows = [["operations", "+-", "x", "/", "sin cos", ":=", "weighted"]]
    for title, one in counts:
        numbers = one.additions, one.multiplications, one.divisions, one.trigonometric, one.assignments
        rows.append([title, *map(str, numbers), str(one.weighted)])
    return table(rows, left=(0,))


@dataclass
class ArmCodeReport(Report):
    """Lean code of an arm.

    Attributes:
        arm: the arm.
        function: joint torques and wrench on the base.
        target: where its C source goes; None for nowhere.
    """

    arm: ArmModel
    function: cs.Function
    target: Path | None

    @property
    def count(self) -> OperationCount:
        """Operations."""
        return count_operations(self.function)

    def write(self) -> Iterator[Path]:
        """The C file and its header."""
        if self.target:
            files = write_c(self.function, self.target)
            yield from (files.source, files.header)

    def to_dict(self) -> dict[str, Any]:
        """Operations and files."""
        return {
            "arm": self.arm.name,
            "joints": self.arm.n,
            "operations": {self.function.name(): self.count.to_dict()},
            "written": self.written,
            "versions": versions(),
        }

    def to_text(self) -> str:
        """A table of operation counts, and the written files."""
        lines = [f"{self.arm.name}: serial arm of {self.arm.n} joints.", ""]
        lines += count_table([("torque, wrench", self.count)])
        if self.written:
            lines += ["", f"wrote {' and '.join(map(str, self.written))}"]
        return "\n".join(lines)
