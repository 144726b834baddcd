"""Files that appear complete or not at all, data for strict JSON, and the versions behind a result."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import platform
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.version import version

PACKAGES = ("casadi", "numpy", "scipy", "llvmlite", "clarabel", "pin")
"""The packages that decide the numbers of plans and placements."""
MARK = "written by ocptip"
"""In files whose format has room for it: such a file may be replaced by the next run."""


@contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file for writing that takes the place of `path` only when the block ends without an error.

    Raises:
        OSError: it cannot be written; names `path`.
    """
    path, stream = Path(path), None
    temporary = _temporary(path)
    try:
        with temporary.open("xb") as stream:
            yield stream
        os.replace(temporary, path)
    except BaseException as error:
        if stream is not None:
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


def write_files(folder: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write several files into a folder; none takes its place before all are on the disk.

    Args:
        folder: made if it does not exist; the one above it must.
        contents: by name, relative, with "/"; they take their places in this order.

    Returns:
        The paths.

    Raises:
        OSError: a file or folder cannot be written; names it.
    """
    folder.mkdir(exist_ok=True)
    path, ready = folder, dict[Path, Path]()
    try:
        for name, content in contents.items():
            path = folder / name
            ready[path] = _temporary(folder / "any")
            with ready[path].open("xb") as stream:
                stream.write(content)
        for path in list(ready):
            path.parent.mkdir(parents=True, exist_ok=True)
            os.replace(ready[path], path)
            del ready[path]
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        for temporary in ready.values():
            temporary.unlink(missing_ok=True)
    return [folder / name for name in contents]


def _temporary(path: Path) -> Path:
    """A new name beside a file, short enough for every file system that takes the name of the file."""
    return path.parent / f".ocptip-{secrets.token_hex(8)}.part"


def file_target(path: str | os.PathLike[str], suffixes: Sequence[str]) -> Path:
    """A path that can be written.

    Args:
        path: of the file.
        suffixes: endings that its name may have.

    Raises:
        InputError: another ending, or the folder does not exist.
    """
    target = Path(path)
    if target.suffix not in suffixes:
        names = " or ".join(f"NAME{suffix}" for suffix in suffixes)
        raise InputError(f"path: expected a file {names}, got {str(path)!r}")
    if not target.parent.is_dir():
        raise InputError(f"path: the folder {str(target.parent)!r} does not exist")
    return target


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text as UTF-8; an interruption leaves either the old file or the new one.

    Raises:
        OSError: the file cannot be written; names it.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """The same with bytes."""
    with atomic_file(path) as stream:
        stream.write(content)


def write_json(path: str | os.PathLike[str], data: Any, *, indent: int | None = 2) -> None:
    """Write data, made :func:`plain`, as strict JSON; an interruption leaves the old file or the new one.

    Args:
        path: of the file.
        data: anything that `plain` takes.
        indent: spaces per level; None for a single line.

    Raises:
        OSError: the file cannot be written; names it.
    """
    write_text(path, json.dumps(plain(data), indent=indent, allow_nan=False) + "\n")


@dataclasses.dataclass(frozen=True, eq=False)
class Record:
    """Base of data classes that are results: they become plain data.

    `_plain` names the fields and properties that count, in their order; default: all fields.
    """

    _plain: ClassVar[tuple[str, ...]] = ()

    def to_dict(self) -> dict[str, Any]:
        """The result made :func:`plain`."""
        names = self._plain or [field.name for field in dataclasses.fields(self)]
        return {name: plain(getattr(self, name)) for name in names}


def plain(value: Any) -> Any:
    """Return dictionaries, lists, texts and numbers that JSON knows; what is not finite becomes None.

    Data classes become dictionaries; objects of other kinds their `str`.
    """
    if isinstance(value, Record):
        return value.to_dict()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of Python, ocptip and these packages; "not installed" for the missing ones."""
    table = {"python": platform.python_version(), "ocptip": version()}
    for package in packages:
        try:
            table[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            table[package] = "not installed"
    return table
