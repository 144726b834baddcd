"""Hashes of the files of a folder, in the format of `sha256sum -c`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from ocptip.basics.errors import InputError
from ocptip.basics.text import some
from ocptip.basics.toml import read_text
from ocptip.basics.write import write_text

SUMS = "SHA256SUMS"
_MOST = 4  # files named at once


def write_sums(folder: Path, names: Iterable[str]) -> Path:
    """Write the hashes of files of a folder into its file `SUMS`, and return that.

    Args:
        folder: where they are.
        names: relative to it, with "/".

    Raises:
        OSError: a file cannot be read or written; names it.
    """
    write_text(folder / SUMS, "".join(f"{_digest(folder / name)}  {name}\n" for name in names))
    return folder / SUMS


def read_sums(folder: Path) -> dict[str, str]:
    """Hashes by name.

    Raises:
        InputError: there is no such file, or it is broken.
    """
    found = {}
    for number, line in enumerate(read_text(folder / SUMS).splitlines(), 1):
        digest, _, name = line.partition("  ")
        outside = PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts
        if len(digest) != 64 or not name or outside:
            raise InputError(
                f"line {number}: expected a hash and a name, got {line!r}", "", f"{folder / SUMS}"
            )
        found[name] = digest
    return found


def written_names(folder: Path) -> list[str]:
    """Names of the files that have hashes; none where there is no list, or a broken one."""
    try:
        return list(read_sums(folder))
    except InputError:
        return []


def require_unchanged(folder: Path) -> None:
    """Refuse a folder of which a file is missing or another one than the one that was written.

    Raises:
        InputError: one line that names them.
    """
    wrong = []
    for name, digest in read_sums(folder).items():
        try:
            if _digest(folder / name) != digest:
                wrong.append(f"{name} is not what was written")
        except FileNotFoundError:
            wrong.append(f"{name} is missing")
        except OSError as error:
            wrong.append(f"{name} cannot be read ({error.strerror})")
    if wrong:
        raise InputError(f"{some(wrong, _MOST)} (hashes in {SUMS})", "", str(folder))


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
