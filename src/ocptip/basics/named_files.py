"""Which keys of a file name other files, so that a copy of it can name them otherwise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Rename = Callable[[Path, Mapping[str, Path]], str]
"""New name of a file, given where it is, and where the files are that it names in turn, by those names."""


class NamedFiles:
    """Keys of nested dictionaries that name files or folders; a key is known by its table's identity."""

    def __init__(self) -> None:
        self.files: dict[tuple[int, str], Path] = {}
        self.folders: set[tuple[int, str]] = set()
        self.parts: dict[Path, dict[str, Path]] = {}

    def copied(self, value: Any, rename: Rename) -> Any:
        """The same data with other names of files, and without folders in which to search them."""
        if isinstance(value, list):
            return [self.copied(item, rename) for item in value]
        if not isinstance(value, Mapping):
            return value
        found = {}
        for key, item in value.items():
            path = self.files.get((id(value), key))
            if path is not None:
                found[key] = rename(path, self.parts.get(path, {}))
            elif (id(value), key) not in self.folders:
                found[key] = self.copied(item, rename)
        return found
