"""`ocptip examples`: copies the example files out of the package."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.outputs import require_files
from ocptip.basics.read import read_bytes
from ocptip.basics.write import atomic_file
from ocptip.cli.command import Report


@dataclass
class ExamplesReport(Report):
    """The example files.

    Attributes:
        directory: where they go.
        missing: content of those that are not there yet.
        present: those that are.
    """

    directory: Path
    missing: dict[Path, bytes]
    present: list[Path]

    def write(self) -> Iterator[Path]:
        """Write those that are missing."""
        for path, content in self.missing.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_file(path) as stream:
                stream.write(content)
            yield path

    def to_dict(self) -> dict[str, Any]:
        """The files that were written, and those that existed before."""
        return {"directory": self.directory, "written": self.written, "present": self.present}

    def to_text(self) -> str:
        """One line per file."""
        head = f"{self.directory}: {len(self.written)} files written, {len(self.present)} were there."
        return "\n".join([head, *(f"{path}" for path in sorted([*self.written, *self.present]))])


def run(options: Namespace) -> ExamplesReport:
    """Find out what is missing; InputError if a file that differs is in its place."""
    directory, missing, present, different = Path(options.directory), {}, [], []
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: not a directory")
    examples = list(_tree(directory, files("ocptip").joinpath("examples")))
    require_files(directory, (path.relative_to(directory).as_posix() for path, _ in examples))
    for path, example in examples:
        content = example.read_bytes()
        if not path.exists():
            missing[path] = content
        elif read_bytes(path) == content:
            present.append(path)
        else:
            different.append(f"{path.relative_to(directory)}")
    if different:
        raise InputError(f"{directory}: would replace files that differ: {', '.join(different)}")
    return ExamplesReport(directory, missing, present)


def _tree(directory: Path, folder: Traversable) -> Iterator[tuple[Path, Traversable]]:
    """All files of a folder, with their places in a directory."""
    for one in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if one.is_dir():
            yield from _tree(directory / one.name, one)
        else:
            yield directory / one.name, one
