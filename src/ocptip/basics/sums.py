"""Hashes of the files of a folder, in the format of `sha256sum -c`."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path, PurePosixPath

from ocptip.basics.errors import InputError
from ocptip.basics.read import only_inside, read_bytes, read_text
from ocptip.basics.text import some

SUMS = "SHA256SUMS"
_DIGEST = re.compile(r"[0-9a-f]{64}")
_MOST = 4  # files named at once


def read_sums(folder: Path) -> dict[str, str]:
    """Hashes by name.

    Raises:
        InputError: there is no such file, or it is broken.
    """
    found = {}
    with only_inside(folder):
        text = read_text(folder / SUMS)
    for number, line in enumerate(text.removesuffix("\n").split("\n"), 1):
        digest, _, name = line.partition("  ")
        path = PurePosixPath(name)
        outside = path.is_absolute() or ".." in path.parts or f"{path}" != name  # or written in another way
        if not _DIGEST.fullmatch(digest) or not name or outside or name in found:
            raise InputError(
                f"line {number}: expected a hash and a name, got {line!r}", "", f"{folder / SUMS}"
            )
        found[name] = digest
    return found


def require_unchanged(folder: Path) -> None:
    """Refuse a folder of which a file is missing or another one than the one that was written.

    Raises:
        InputError: one line that names them.
    """
    wrong = []
    for name, digest in read_sums(folder).items():
        try:
            with only_inside(folder):
                content = read_bytes(folder / name)
            if hashlib.sha256(content).hexdigest() != digest:
                wrong.append(f"{name} is not what was written")
        except InputError as error:
            wrong.append(f"{name} is missing" if error.text == "no such file" else f"{name} {error.text}")
    if wrong:
        raise InputError(f"{some(wrong, _MOST)} (hashes in {SUMS})", "", str(folder))
