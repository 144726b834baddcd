"""The one reader of users' files: regular files of limited size; JSON, TOML, YAML and XML of limited depth.

A folder that a stranger may have made is read inside :func:`only_inside`: nothing outside of it is opened,
and no symbolic link is followed. Pipes and devices are refused everywhere: reading one may never end.
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from ocptip.basics.errors import InputError

MOST_BYTES = 2**29
"""Size of the largest file that is read: 57 s of 60 signals at 1 kHz take a tenth of it."""
MOST_LEVELS = 100
"""Lists and tables in each other: of the deepest data that are accepted."""
MOST_VALUES = 10_000_000
"""Values of the largest YAML document, each alias counted as what it stands for."""

NO_SPACE = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOSPC, errno.EDQUOT)
"""Errors of the system that the file does not cause."""

_ENCODING = re.compile(rb"""\s*<\?xml[^>]*?encoding\s*=\s*(["'])([A-Za-z][\w.-]*)\1""")
_BYTE_ORDER_MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (lambda mode: stat.S_ISCHR(mode) or stat.S_ISBLK(mode), "a device"),
)
_TOO_DEEP = f"nested too deeply (at most {MOST_LEVELS} levels)"
_folder: ContextVar[Path | None] = ContextVar("folder", default=None)


@contextmanager
def only_inside(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Refuse, in this block, files outside of a folder and links in it; the folder itself may be a link."""
    token = _folder.set(Path(folder))
    try:
        yield
    finally:
        _folder.reset(token)


def read_bytes(path: str | os.PathLike[str], most: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file.

    Args:
        path: of the file.
        most: bytes that are accepted.

    Raises:
        InputError: it cannot be read; one line that names it.
        OSError: the system has no file handle or no memory left; names the file.
    """
    path = Path(path)
    with _opened(path, most) as descriptor, os.fdopen(descriptor, "rb", closefd=False) as stream:
        try:
            content = stream.read(most + 1)
        except OSError as error:
            raise _refusal(path, error) from None
    if len(content) > most:  # grew, or has no size, as files of the system's state
        raise InputError(_too_large(most), "", str(path))
    return content


def require_readable(path: str | os.PathLike[str], most: int = MOST_BYTES) -> None:
    """Raise the errors of :func:`read_bytes` for a file that a library opens afterwards."""
    with _opened(Path(path), most):
        pass


def read_text(path: str | os.PathLike[str], most: int = MOST_BYTES) -> str:
    """Return the content of a text file in UTF-8; raises as :func:`read_bytes`."""
    try:
        return read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"not a text file in UTF-8 (byte {error.start})", "", str(path)) from None


def read_xml_text(path: str | os.PathLike[str]) -> str:
    """Return the content of an XML file; its declaration then says UTF-8, whichever encoding it named before.

    Bytes that are no UTF-8, in a file that declares nothing else, are taken for ISO-8859-1: older robot
    descriptions have them in comments and names of authors.

    Raises:
        InputError: it cannot be read, or declares an unknown encoding; names it.
    """
    content = read_bytes(path)
    declared = _ENCODING.match(content)
    marked = next((name for mark, name in _BYTE_ORDER_MARKS if content.startswith(mark)), None)
    name = marked or (declared[2].decode("ascii") if declared else "utf-8-sig")
    try:
        text = content.decode(name)
    except LookupError:
        raise InputError(f"broken XML: unknown encoding {name!r}", "", str(path)) from None
    except UnicodeDecodeError as error:
        if marked or (declared and name.lower().replace("-", "") != "utf8"):
            raise InputError(f"not a text file in {name} (byte {error.start})", "", str(path)) from None
        text = content.decode("iso-8859-1")
    return re.sub(r"""\A(\s*<\?xml[^>]*?encoding\s*=\s*)(["'])[^"']*\2""", r"\1\2UTF-8\2", text)


def read_json(path: str | os.PathLike[str]) -> Any:
    """Return the data of a JSON file; InputError names it."""
    try:
        return parse_json(read_text(path))
    except InputError as error:
        raise error if error.file else InputError(error.text, "", str(path)) from None


def parse_json(text: str) -> Any:
    """Return the data of a JSON text; InputError if it is broken, or nested too deeply."""
    try:
        data = json.loads(text)
    except RecursionError:
        raise InputError(f"broken JSON: {_TOO_DEEP}", "") from None
    except ValueError as error:  # a number of too many digits, too
        raise InputError(f"broken JSON: {error}", "") from None
    return _shallow(data, "JSON")


def parse_toml(text: str) -> dict[str, Any]:
    """Return the data of a TOML text; InputError if it is broken, or nested too deeply."""
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"broken TOML: {_TOO_DEEP}", "") from None
    except ValueError as error:
        raise InputError(f"broken TOML: {error}", "") from None
    return _shallow(data, "TOML")


def parse_yaml(text: str) -> Any:
    """Return the first document of a YAML text; InputError if it is broken, too deep or too large.

    An alias costs nothing until its value is printed or copied, so that ten lines can stand for 10^9 values.
    Therefore the values are counted first and built afterwards.
    """
    try:
        loader = yaml.SafeLoader(text)
        try:
            if not loader.check_node():
                return None
            node = loader.get_node()
            _count(node, {}, 0)
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        problem = " ".join(str(error).split())
    except RecursionError:
        problem = _TOO_DEEP
    except (ValueError, TypeError, OverflowError) as error:  # of dates and numbers that are none
        problem = error.text if isinstance(error, InputError) else str(error)
    raise InputError(f"broken YAML: {problem}", "")


def parse_xml(text: str | bytes) -> ElementTree.Element:
    """Return the outermost element of an XML text.

    Raises:
        InputError: it defines entities, or is nested too deeply.
        ElementTree.ParseError: it is no XML.
    """
    if (b"<!ENTITY" if isinstance(text, bytes) else "<!ENTITY") in text:  # type: ignore[operator]
        raise InputError("defines entities (<!ENTITY>), which are refused; write out what they stand for", "")
    root = ElementTree.fromstring(text)
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > MOST_LEVELS:
            raise InputError(f"broken XML: {_TOO_DEEP}", "")
        level = [child for element in level for child in element]
    return root


@contextmanager
def _opened(path: Path, most: int) -> Iterator[int]:
    """A descriptor of a regular file that is not too large."""
    try:
        descriptor = _descriptor(path)
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise _refusal(path, error) from None
    try:
        about = os.fstat(descriptor)
        kind = next((name for is_it, name in _KINDS if is_it(about.st_mode)), "")
        if kind:
            raise InputError(f"is {kind}; expected a file", "", str(path))
        if about.st_size > most:
            raise InputError(_too_large(most, about.st_size), "", str(path))
        yield descriptor
    finally:
        os.close(descriptor)


def _descriptor(path: Path) -> int:
    """Open without waiting; inside a folder of strangers step by step, so that no step can be a link."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    folder = _folder.get()
    if folder is None:
        return os.open(path, flags)
    *above, name = _inside(path, folder)
    if os.open not in os.supports_dir_fd:  # Windows
        steps = [folder.joinpath(*above[: k + 1]) for k in range(len(above))]
        if any(step.is_symlink() for step in [*steps, path]):
            raise OSError(errno.ELOOP, "", str(path))
        return os.open(path, flags)
    parent = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for step in above:
            below = os.open(step, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=parent)
            os.close(parent)
            parent = below
        return os.open(name, flags | os.O_NOFOLLOW, dir_fd=parent)
    finally:
        os.close(parent)


def _inside(path: Path, folder: Path) -> tuple[str, ...]:
    """The steps from a folder to a file in it, or an InputError."""
    target = Path(os.path.abspath(path))
    for root in (Path(os.path.abspath(folder)), folder.resolve()):
        if target != root and target.is_relative_to(root):
            return target.relative_to(root).parts
    raise InputError(f"is outside of the folder {folder}, which has to hold all that it names", "", str(path))


def _refusal(path: Path, error: OSError | ValueError) -> Exception:
    """The error for a file that cannot be opened."""
    code = getattr(error, "errno", None)
    if code in NO_SPACE:
        return OSError(code, os.strerror(code), str(path))
    if isinstance(error, FileNotFoundError):
        problem = "no such file"
    elif code == errno.ELOOP or (code == errno.ENOTDIR and _folder.get() is not None):
        problem = "is or is below a symbolic link, which is not followed here"
        problem = problem if _folder.get() is not None else "is a circle of symbolic links"
    elif isinstance(error, IsADirectoryError):
        problem = "is a folder; expected a file"
    else:
        problem = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    return InputError(problem, "", str(path))


def _too_large(most: int, size: int | None = None) -> str:
    got = "" if size is None else f", got {size / 2**20:.0f}"
    return f"is too large: expected at most {most / 2**20:.0f} MiB{got}"


def _shallow(data: Any, language: str) -> Any:
    level, depth = [data], 0
    while level := [one for one in level if isinstance(one, dict | list)]:
        depth += 1
        if depth > MOST_LEVELS:
            raise InputError(f"broken {language}: {_TOO_DEEP}", "")
        level = [item for one in level for item in (one.values() if isinstance(one, dict) else one)]
    return data


def _count(node: Any, known: dict[int, int], depth: int) -> int:
    """Values that a YAML node stands for; a node that contains itself stands for too many."""
    if depth > MOST_LEVELS:
        raise InputError(_TOO_DEEP, "")
    if id(node) not in known:
        known[id(node)] = MOST_VALUES + 1  # while it is being counted
        below = node.value if isinstance(node.value, list) else []
        parts = [part for item in below for part in (item if isinstance(item, tuple) else (item,))]
        known[id(node)] = 1 + sum(_count(part, known, depth + 1) for part in parts)
    if known[id(node)] > MOST_VALUES:
        raise InputError(f"its aliases stand for more than {MOST_VALUES:,} values, or for themselves", "")
    return known[id(node)]
