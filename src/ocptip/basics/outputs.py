"""Which files commands write, and which of those in a folder ocptip itself wrote: only these are deleted.

Evidence that ocptip wrote a file is its hash in the folder's list, or a mark within the file. Without it a
file is replaced only where that was asked for, and never deleted. Symbolic links are neither replaced nor
followed.
"""

from __future__ import annotations

import hashlib
import html
import json
import os
import re
import stat
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from ocptip.basics.errors import InputError
from ocptip.basics.read import only_inside, parse_json, read_bytes, read_text
from ocptip.basics.text import some
from ocptip.basics.write import MARK, plain, write_files

SUMS = "SHA256SUMS"
_DIGEST = re.compile(r"[0-9a-f]{64}")
_LARGEST_LIST = 4  # files named at once


def read_sums(folder: Path) -> dict[str, str]:
    """Hashes by name.

    Raises:
        InputError: there is no such file, or it is broken.
    """
    table = {}
    with only_inside(folder):
        text = read_text(folder / SUMS)
    for number, line in enumerate(text.removesuffix("\n").split("\n"), 1):
        digest, _, name = line.partition("  ")
        path = PurePosixPath(name)
        outside = path.is_absolute() or ".." in path.parts or f"{path}" != name  # or written in another way
        if not _DIGEST.fullmatch(digest) or not name or outside or name in table:
            raise InputError(
                f"line {number}: expected a hash and a name, got {line!r}", "", f"{folder / SUMS}"
            )
        table[name] = digest
    return table


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
        raise InputError(f"{some(wrong, _LARGEST_LIST)} (hashes in {SUMS})", "", str(folder))


_PLAN = ("plan.json", "motion.csv", "trajectory.json", "certificate.json", "task/task.toml", SUMS)
_FIGURES = ("motion.png", "ground.png", "drives.png", "feet.png", "gears.png")
OUTPUTS = {
    "plan": (*_PLAN, *_FIGURES, "stops.png"),
    "retime": (*_PLAN, *_FIGURES, "phase_plane.png"),
    "place": ("placement.json", "placement.png", "map.png"),
    "cell": ("cell.json", "placement.png"),
    "chart": ("chart.json", "chart.csv", "chart.png", "design.csv", "design.png", SUMS),
    "studio": ("task/task.toml",),
    "drive": ("drive.json", "drive.csv", "nav2.yaml", "drive.png", SUMS),
}
"""Names of the files that commands write into a folder; of cycles some have a number before the ending."""

_CERTIFICATE = "ocptip certificate"
_NUMBERED = ("certificate.json", "phase_plane.png")
_TASK = "task"  # folder of the task and of what it names
_MOST = 4  # files named at once


def require_replaceable(
    folder: Path, command: str, further: Iterable[str] = (), *, overwrite: bool = False
) -> None:
    """Refuse a folder in which writing would lose what ocptip did not write there.

    Args:
        folder: it need not exist.
        command: that writes.
        further: names of files that are written beside those of the command, relative, with "/".
        overwrite: files that ocptip did not write may be replaced; links and folders never are.

    Raises:
        InputError: names the files.
    """
    sums = _known_sums(folder)
    names = dict.fromkeys([*OUTPUTS[command], *_numbered(folder, command), *further])
    require_files(folder, dict.fromkeys([*names, *sums]))
    if foreign := sorted(set(sums) - _writable(folder, sums)):
        raise InputError(
            f"{folder / SUMS} lists files that ocptip does not write: {_named(foreign)}; choose another "
            "directory, or move them and the list"
        )
    if overwrite:
        return
    there = [name for name in names if os.path.lexists(folder / name)]
    others = [
        f"{name} (changed since)" if name in sums else name
        for name in there
        if not _is_written_here(folder, name, sums)
    ]
    if others:
        raise InputError(
            f"{folder} holds files that ocptip {command} did not write and would replace: "
            f"{_named(others)}; choose another directory, or --overwrite"
        )


def require_files(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder in which one of these names, or a folder above it, is no regular file or folder.

    Raises:
        InputError: says which, and what it is.
    """
    if odd := list(_not_files(folder, names)):
        raise InputError(f"{folder}: {some(odd, _MOST)}; choose another directory, or move it")


def require_replaceable_file(path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Refuse a file that exists and was not written by ocptip, unless it may be overwritten.

    Raises:
        InputError: names it.
    """
    path = Path(path)
    if not os.path.lexists(path):
        return
    if odd := _odd(path):
        raise InputError(f"{path} is {odd}; choose another name")
    if not overwrite and not _has_our_mark(path):
        raise InputError(f"{path} exists and was not written by ocptip; choose another name, or --overwrite")


def replace_folder(folder: Path, contents: dict[str, bytes]) -> list[Path]:
    """Write files and the list of their hashes; delete those of the earlier list that are not among them.

    No file is replaced before all are on the disk. Of the earlier list only files are deleted that ocptip can
    have written and that have not changed since.

    Args:
        folder: made if it does not exist; the one above it must.
        contents: by name, relative, with "/".

    Returns:
        The paths, the list last.

    Raises:
        InputError: a file or folder in its place is a link, or the earlier list names other files.
        OSError: a file cannot be written; names it.
    """
    require_replaceable(folder, "plan", contents, overwrite=True)
    sums = _known_sums(folder)  # without links, by now
    recorded = {name for name in _writable(folder, sums) if _is_recorded(folder, name, sums)}
    digests = (f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in contents.items())
    paths = write_files(folder, {**contents, SUMS: "".join(digests).encode()})
    for name in sorted(recorded - set(contents)):
        (folder / name).unlink(missing_ok=True)
    return paths


class SavedFolder(ABC):
    """A result that is saved as a folder: its data as JSON, tables and figures.

    Attributes:
        data_file: name of the JSON file.
    """

    data_file: ClassVar[str]

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The result as plain data."""

    def contents(self, figures: bool) -> dict[str, bytes]:
        """The other files, by name."""
        return {}

    def save(self, folder: str | os.PathLike[str], *, figures: bool = True) -> list[Path]:
        """Write the files into a folder, made if it does not exist; returns their paths.

        Raises:
            OSError: a file cannot be written; names it.
        """
        return list(self.write(folder, figures=figures))

    def write(
        self, folder: str | os.PathLike[str], *, figures: bool = True, extra: Mapping[str, Any] | None = None
    ) -> Iterator[Path]:
        """Write the files with the list of their hashes, and yield their paths.

        Args:
            folder: made if it does not exist.
            figures: whether figures are among them.
            extra: further entries of the JSON file.
        """
        data = json.dumps(plain({**self.to_dict(), **(extra or {})}), indent=2, allow_nan=False)
        yield from replace_folder(
            Path(folder), {self.data_file: f"{data}\n".encode(), **self.contents(figures)}
        )


def remove_figures(folder: Path, command: str) -> None:
    """Delete the figures of an earlier run, which may not be drawn again; those of others stay."""
    for name in [*OUTPUTS[command], *_numbered(folder, command)]:
        path = folder / name
        if path.suffix == ".png" and os.path.lexists(path) and not _odd(path) and _has_our_mark(path):
            path.unlink(missing_ok=True)


def _known_sums(folder: Path) -> dict[str, str]:
    """Hashes by name; none where there is no list, or a broken one, which is not ocptip's."""
    try:
        return read_sums(folder)
    except InputError:
        return {}


def _writable(folder: Path, sums: dict[str, str]) -> set[str]:
    """Those of listed names that ocptip can have written: fixed ones, and what the task there names."""
    fixed = {name for command in OUTPUTS for name in OUTPUTS[command]}
    result = {name for name in sums if name in fixed or _unnumbered(name) in _NUMBERED}
    rest = {name for name in sums if PurePosixPath(name).parts[0] == _TASK} - result
    ahead = [name for name in result if name.startswith(f"{_TASK}/")]
    while ahead:  # the task names a URDF, which names meshes
        name = ahead.pop()
        try:
            text = read_bytes(folder / name).decode("utf-8", "replace")
        except InputError:  # it is gone
            continue
        named = {other for other in rest if _quotes(text, other.removeprefix(f"{_TASK}/"))}
        rest, result, ahead = rest - named, result | named, [*ahead, *named]
    return result


def _quotes(text: str, name: str) -> bool:
    """Whether a TOML file or URDF names a file."""
    return any(f in text for f in (json.dumps(name, ensure_ascii=False), f'"{html.escape(name)}"'))


def _is_written_here(folder: Path, name: str, sums: dict[str, str]) -> bool:
    """Whether a file in a folder is as ocptip wrote it."""
    if name == SUMS:
        return bool(sums)
    return _is_recorded(folder, name, sums) if name in sums else _has_our_mark(folder / name)


def _is_recorded(folder: Path, name: str, sums: dict[str, str]) -> bool:
    if any(_not_files(folder, [name])):
        return False
    try:
        return hashlib.sha256(read_bytes(folder / name)).hexdigest() == sums[name]
    except InputError:
        return False


def _has_our_mark(path: Path) -> bool:
    """Whether a file says that ocptip wrote it."""
    try:
        content = read_bytes(path)
        if MARK.encode() in content:
            return True
        data = parse_json(content.decode()) if path.suffix == ".json" else None
    except (InputError, UnicodeDecodeError):
        return False
    if not isinstance(data, dict):
        return False
    versions = data.get("versions")
    return (isinstance(versions, dict) and "ocptip" in versions) or _CERTIFICATE in str(data.get("format"))


def _not_files(folder: Path, names: Iterable[str]) -> Iterator[str]:
    """Messages about the names that are no regular files, or lie below something that is no folder."""
    seen = set()
    for name in names:
        for step in [*list(PurePosixPath(name).parents)[-2::-1], PurePosixPath(name)]:
            odd = _odd(folder / step, is_folder=step != PurePosixPath(name))
            if odd:
                if step not in seen:
                    yield f"{f'{step}'!r} is {odd}"
                seen.add(step)
                break


def _odd(path: Path, is_folder: bool = False) -> str:
    """The type of a path of another kind than expected; empty if it is as expected, or does not exist."""
    try:
        mode = path.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return ""
    if stat.S_ISLNK(mode):
        return "a symbolic link"
    right = stat.S_ISDIR(mode) if is_folder else stat.S_ISREG(mode)
    return "" if right else "no folder" if is_folder else "no file"


def _numbered(folder: Path, command: str) -> list[str]:
    """Names with a number that are in a folder."""
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    known = {name for name in _NUMBERED if name in OUTPUTS[command]}
    return sorted(name for name in names if name not in known and _unnumbered(name) in known)


def _unnumbered(name: str) -> str:
    return re.sub(r"-[1-9][0-9]*(\.[a-z]+)\Z", r"\1", name)


def _named(names: list[str]) -> str:
    return some([name if name.isprintable() else repr(name) for name in names], _MOST)
