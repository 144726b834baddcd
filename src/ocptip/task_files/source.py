"""Files named by a task file, collected to be written elsewhere: see `ocptip.motion.files.source`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from ocptip.basics.read import read_bytes, read_xml_text
from ocptip.basics.toml import Table
from ocptip.motion.files.source import TASK, TaskSource
from ocptip.robots.urdf.file import with_files
from ocptip.standing.mechanism import StandingMechanism

_MESHES = "meshes"
_ODD = re.compile(r"[^\w .+()&,=@#~-]")  # line ends and what else lists of names cannot hold


def task_source(data: Table, robot: StandingMechanism) -> TaskSource:
    """The content of a task file that has been read, with all files that were read for it.

    Meshes are those of the collision geometry: visual ones are not needed, and stay named as they were.
    """
    collected = _Collection()
    return TaskSource(data.copied(collected.add), robot, collected.files)


class _Collection:
    """Contents by names, a different name for every file."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self._names: dict[Path, str] = {}
        self._taken = {PurePosixPath(TASK).name}

    def add(self, path: Path, parts: Mapping[str, Path]) -> str:
        """The new name of a file; those that it names in turn go into a folder beside it."""
        if path not in self._names:
            content = read_bytes(path)
            if parts:
                renamed = {name: self._put(part, read_bytes(part), _MESHES) for name, part in parts.items()}
                content = with_files(read_xml_text(path), renamed).encode("utf-8")
            self._put(path, content)
        return self._names[path]

    def _put(self, path: Path, content: bytes, folder: str = "") -> str:
        if path not in self._names:
            plain = PurePosixPath(_ODD.sub("_", path.name))
            name, number = (PurePosixPath(folder) / plain).as_posix(), 1
            while name.lower() in self._taken:
                number += 1
                name = (PurePosixPath(folder) / f"{plain.stem}-{number}{plain.suffix}").as_posix()
            self._taken.add(name.lower())
            self._names[path], self.files[name] = name, content
        return self._names[path]
