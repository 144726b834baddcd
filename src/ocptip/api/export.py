"""`ocptip.export`: a plan's robot on its base, and its motion, for rigid-body simulators.

Each segment of a cycle is a separate file, with what the robot holds then.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, naming
from ocptip.basics.outputs import require_replaceable_file
from ocptip.basics.write import versions, write_text
from ocptip.standing.parts import Part
from ocptip.standing.simulation.mjcf import remarks, to_mjcf
from ocptip.standing.simulation.urdf import to_urdf
from ocptip.task_files.plan_folder import PlanFolder, read_plan_folder


def export(
    plan: PlanFolder | str | os.PathLike[str],
    *,
    mjcf: str | os.PathLike[str] | None = None,
    urdf: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
) -> Exported:
    """Return the models of a plan as texts for files that are named; `save()` writes them.

    Example::

        ocptip.export("ocptip-plan-A", mjcf="a.xml").save()

    Args:
        plan: the folder of a plan or a cycle of an arm, or what was read from it.
        mjcf: file of a MuJoCo model with the motion; of a cycle with the segments' numbers before the ending.
        urdf: file of a URDF of robot and base, likewise.
        overwrite: replace files there that ocptip did not write.

    Raises:
        InputError: no file is named, the plan cannot be used, or a file would be replaced.
    """
    if mjcf is None and urdf is None:
        raise InputError("mjcf, urdf: name a file for at least one of them", "")
    folder = read_plan_folder(plan)
    parts, name = folder.parts("export writes", objects=urdf is None), folder.task.name
    files = {}
    with naming(str(folder.path)):
        for number, part in enumerate(parts, 1):
            description = {"name": f"{name}, {part.name}" if part.name else name}
            segment = number if len(parts) > 1 else None
            if mjcf is not None:
                files[_path(mjcf, segment)] = to_mjcf(
                    part.robot, part.motion, begin=part.begin, **description
                )
            if urdf is not None:
                files[_path(urdf, segment)] = to_urdf(part.robot, **description)
    for path in files:
        require_replaceable_file(path, overwrite=overwrite)
    return Exported(name, parts, files)


def _path(name: str | os.PathLike[str], segment: int | None) -> Path:
    """The file; of a segment of a cycle with its number before the ending."""
    path = Path(name)
    return path if segment is None else path.with_stem(f"{path.stem}-{segment}")


@dataclass(frozen=True, eq=False, repr=False)
class Exported:
    """Models of a plan.

    Attributes:
        name: of the task.
        parts: the motion, or those of the segments.
        files: their texts.
    """

    name: str
    parts: tuple[Part, ...]
    files: dict[Path, str]

    @property
    def remarks(self) -> list[str]:
        """The differences between the robot's data and the exported models, one sentence each."""
        return remarks(self.parts)

    def __repr__(self) -> str:
        """The files."""
        return f"<Exported {self.name}: {', '.join(map(str, self.files))}>"

    def to_dict(self) -> dict[str, Any]:
        """Files and what is to be known of them."""
        return {
            "task": self.name,
            "files": [f"{path}" for path in self.files],
            **self.parts[0].robot.masses_to_dict(),
            "remarks": self.remarks,
            "versions": versions(),
        }

    def save(self) -> list[Path]:
        """Write the files; returns their paths."""
        return list(self.write())

    def write(self) -> Iterator[Path]:
        """Write the files and yield each path when its file is complete."""
        for path, text in self.files.items():
            write_text(path, text)
            yield path
