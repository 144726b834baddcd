"""`ocptip init`: writes a task file for the arm of a URDF, to be filled in where it is marked."""

from __future__ import annotations

import json
import os
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.outputs import require_replaceable_file
from ocptip.basics.text import some
from ocptip.basics.toml import MARK
from ocptip.basics.write import write_text
from ocptip.cli.command import Report
from ocptip.cli.layout import brief_notes, named
from ocptip.cli.options import naming_options, taken
from ocptip.robots.urdf.collision import package_folder
from ocptip.robots.urdf.conversion import Converted, converted
from ocptip.task_files.reference import json_schema
from ocptip.task_files.template import SCHEMA, TaskTemplate, task_template


@dataclass
class InitReport(Report):
    """A task file to be filled in.

    Attributes:
        path: of the file.
        template: its content.
        converted: the URDF of a xacro file or a MuJoCo model and its meshes, which have been written.
    """

    path: Path
    template: TaskTemplate
    converted: tuple[Path, ...] = ()

    def write(self) -> Iterator[Path]:
        """Write the file, and the schema that it names for editors, if none is there."""
        yield from self.converted
        schema = self.path.parent / SCHEMA
        if not os.path.lexists(schema):
            write_text(schema, json.dumps(json_schema(), indent=1) + "\n")
            yield schema
        write_text(self.path, self.template.text)
        yield self.path

    def to_dict(self) -> dict[str, Any]:
        """Names, joints, what has to be filled in."""
        template = self.template
        return {
            "base_link": template.base_link,
            "tool_frame": template.tool_frame,
            "joints": template.arm.joint_names,
            "units": template.arm.file_units,
            "assumed": self._assumed,
            "examples": [template.example],
            "base": {
                "from_urdf": template.base.of_urdf,
                "source": template.base.source,
                "mass": template.base.mass,
                "contacts": [
                    {"kind": contact.kind, "position": contact.position.tolist(), "reason": contact.reason}
                    for contact in template.base.contacts
                ],
            },
            "collision_geometry": template.missing is not None,
            "missing_meshes": template.missing or [],
            "to_fill": template.to_fill,
            "written": self.written,
        }

    def to_text(self) -> str:
        """A description of the arm, and the lines of the file that are still to be filled in."""
        template = self.template
        arm = template.arm
        lines = [
            ("arm", f"{template.base_link} to {template.tool_frame}: {', '.join(arm.joint_names)}"),
            *(("assumed", note) for note in brief_notes(self._assumed, self.verbose)),
            ("base", template.base.source),
            ("example", template.example),
            *self._geometry(),
            ("fill in", f"the lines that begin with {MARK}: {', '.join(template.to_fill)}"),
            ("then", f"ocptip plan {self.path}"),
        ]
        return "\n".join([f"{self.path}: written.", *named(lines)])

    @property
    def _assumed(self) -> tuple[str, ...]:
        """The assumptions of the file about the arm, as results of its task will name them."""
        return self.template.arm.with_usual_accelerations("the URDF").notes

    def _geometry(self) -> Iterator[tuple[str, str]]:
        """The row about collision geometry, if any is missing."""
        missing = self.template.missing
        if missing is None:
            yield "collision", "not checked, for the URDF has no collision geometry; see sphere_radius"
        elif missing:
            folder = package_folder(missing)
            hint = f"; --package-dirs or package_dirs names a folder that contains {folder}" if folder else ""
            yield "collision", f"{len(missing)} mesh files missing: {some(missing, 2)}{hint}"


def run(options: Namespace) -> InitReport:
    """Read the URDF; InputError if the file is there already, without `--overwrite`."""
    if Path(options.robot).suffix == ".toml":
        raise InputError(f"{options.robot}: expected a URDF")
    path = Path(options.out or f"{Path(options.robot).stem.removesuffix('.urdf')}.toml")
    _require_new(path, options)
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no directory {path.parent}")
    given = "base_link tool_frame joint_limits srdf package_dirs"
    with naming_options(*given.split()):
        named = taken(options, given)
        result = converted(Path(options.robot), path.parent, options.xacro) or Converted({})
        further = result.files
        for file in further:
            _require_new(file, options)
        for file, text in further.items():
            file.parent.mkdir(exist_ok=True)
            write_text(file, text)
        robot = next(iter(further), Path(options.robot))
        named |= {"armature": result.armature, "notes": result.notes}
        return InitReport(path, task_template(robot, path.parent, **named), tuple(further))


def _require_new(path: Path, options: Namespace) -> None:
    """Refuse to replace a file, filled in or not, without `--overwrite`."""
    if not options.overwrite and os.path.lexists(path):
        raise InputError(f"{path}: exists; give another place by --out, or --overwrite")
    require_replaceable_file(path, overwrite=True)
