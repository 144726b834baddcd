"""A cursor that reads tables of users' files: what is wrong is named with file, key and value.

    with Table.read(path) as data:
        base = data.table("base")
        body = base.make(Body, mass=base.number("mass", bound="> 0"), center=base.vector("center", 3))

Every complaint is one line, an :class:`InputError`: "robot.toml: base.mass: must be > 0, got -3". All
that is unknown in a table and those below it is said together, or else all that is missing. A key that no
reader asked for is unknown. That a required key is missing is said when its table is closed, so that
`mas = 3` is called unknown (did you mean 'mass'?) rather than `mass` missing; until then a stand-in (NaN, an
empty text) is in its place. Therefore close a table, or let :meth:`Table.make` do it, before its values are
used.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ocptip.basics.errors import (
    InputError,
    finite_array,
    number_from,
    refuse_huge,
    rotation_matrix,
    whole_number,
)
from ocptip.basics.named_files import NamedFiles, Rename
from ocptip.basics.read import parse_toml, read_text
from ocptip.basics.text import did_you_mean, of_known

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

DEGREES = np.pi / 180
"""Scale of keys in degrees."""

REQUIRED: Any = object()
"""Default of keys that have to be there."""

_MOST_COMPLAINTS = 8  # shown at once
_UNKNOWN = "unknown key"

T = TypeVar("T")


MARK = "#>"
"""Begins the lines of a template that have to be filled in; without it they are TOML."""

Source = str | os.PathLike[str] | Mapping[str, Any]
"""Path of a TOML file, or its content as `tomllib` returns it."""


class Table:
    """A table of a file, and which of its keys have been read.

    The reading methods take a key and what to return if it is missing, by default a complaint. `scale` is the
    SI unit per unit of the file; `bound` is "> 0", ">= 0" or none. As a context manager a table puts the file
    in front of every InputError, and is closed where the block ends without one.

    Args:
        data: nested dictionaries and lists as `tomllib` returns them.
        file: its name, for messages.
        path: of the table within the file.
        folder: of the file, to which the files that it names are relative.
    """

    def __init__(
        self, data: Mapping[str, Any], file: str, path: str = "", folder: Path | None = None
    ) -> None:
        self.file, self.path, self._data = file, path, data
        self._folder, self._uses = folder or Path(), NamedFiles()
        self._known: dict[str, None] = {}
        self._missing: dict[str, str] = {}
        self._tables: dict[str, Table] = {}
        self._top: Sequence[str] = ()  # keys above the first table, often put below one by mistake

    @classmethod
    def read(cls, source: Source, name: str = "data") -> Table:
        """Open a TOML file; of content that has been read already, `name` stands for the file in messages.

        Raises:
            InputError: it cannot be read, or is no TOML.
        """
        if isinstance(source, Mapping):
            return cls(source, name)
        path = Path(source)
        text = read_text(path)
        try:
            return cls(parse_toml(text), path.name, folder=path.parent)
        except InputError as error:
            raise InputError(error.text, "", path.name) from None

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def __enter__(self) -> Table:
        return self

    def __exit__(self, _: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if error is None:
            self.close()
        elif isinstance(error, InputError):
            raise self._placed(error, "", {}) from None

    def leaves(self) -> Iterator[tuple[str, Any]]:
        """Place and value of every key, here and in all tables below, that is no table."""
        for key, value in self._data.items():
            items = {key: value}
            if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
                items = {f"{key}[{number}]": item for number, item in enumerate(value, 1)}
            for name, item in items.items():
                if isinstance(item, dict):
                    yield from Table(item, self.file, self.place(name)).leaves()
                else:
                    yield self.place(name), item

    def place(self, key: str) -> str:
        """Path of a key within the file."""
        return ".".join(part for part in (self.path, key) if part)

    def error(self, text: str, key: str = "") -> InputError:
        """A complaint about a key, or about the table."""
        return InputError(text, self.place(key), self.file)

    @contextmanager
    def at(self, key: str | None = "", **arguments: str) -> Iterator[None]:
        """Name the place of errors of library functions, which know but the names of their arguments.

        An error about an argument that is called like a key of this table is about that key; any other
        is about `key`.

        Args:
            key: of this table; "": the table itself; None: such errors are passed on as they are.
            arguments: key (or "", the table) per argument that has another name in the file.
        """
        try:
            yield
        except InputError as error:
            raise self._placed(error, key, arguments) from None

    def _placed(self, error: InputError, key: str | None, arguments: Mapping[str, str]) -> InputError:
        if error.file == self.file:
            return error
        name = "" if error.file else re.split(r"[.\[]", error.path)[0]
        if name in self._data or name in arguments:
            return self.error(error.text, arguments.get(name, name) + error.path[len(name) :])
        return error if key is None else self.error(str(error), key)

    def complaints(self) -> Iterator[InputError]:
        """All keys that are unknown, then all that are missing; here, then in the tables below."""
        for key in self._data:
            if key not in self._known:
                misplaced = f"; {key!r} belongs above the first table"
                hint = misplaced if key in self._top else of_known(key, self._known)
                yield self.error(f"{_UNKNOWN}{hint}", key)
        for key, text in self._missing.items():
            yield self.error(text, key)
        for table in self._tables.values():
            yield from table.complaints()

    def close(self, *later: str) -> None:
        """Refuse keys that have not been read, and missing ones; tables that were opened are closed, too.

        Args:
            later: keys that will be read after this.
        """
        self._known.update(dict.fromkeys(later))
        complaints = list(self.complaints())
        unknown = [complaint for complaint in complaints if complaint.text.startswith(_UNKNOWN)]
        if complaints:
            complaints = unknown or complaints  # a missing key may be one of the unknown ones, misspelled
            first, *rest = complaints[:_MOST_COMPLAINTS]
            texts = [first.text, *(f"{complaint.path}: {complaint.text}" for complaint in rest)]
            more = len(complaints) - len(texts)
            raise InputError("; ".join(texts) + (f"; and {more} more" if more else ""), first.path, self.file)

    def make(self, function: Callable[..., T], *arguments: Any, **options: Any) -> T:
        """Close the table, then call a library function with values read from it; errors name their key."""
        self.close()
        with self.at():
            return function(*arguments, **options)

    def table(self, key: str, *, optional: bool = False) -> Table:
        """The table under a key, an empty one if it is optional and missing."""
        self._known[key] = None
        if key not in self._data and not optional:
            raise self.error(f"missing table [{self.place(key)}]", key)
        value = self._data.get(key, {})
        if not isinstance(value, dict):
            raise self.error(f"expected a table [{self.place(key)}], got {value!r}", key)
        return self._below(key, value)

    def tables(self, key: str, *, required: bool = False) -> list[Table]:
        """The tables in double brackets under a key, counted from 1; at least one if they are required."""
        self._known[key] = None
        value, place = self._data.get(key, []), re.sub(r"\[\d+\]", "", self.place(key))
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.error(f"expected tables in double brackets, [[{place}]], got {value!r}", key)
        if required and not value:
            raise self.error(f"at least one [[{place}]] is needed", key)
        return [self._below(f"{key}[{number}]", item) for number, item in enumerate(value, 1)]

    def _below(self, key: str, data: Mapping[str, Any]) -> Table:
        table = self._tables.setdefault(key, Table(data, self.file, self.place(key)))
        table._top, table._folder, table._uses = self._top or list(self._known), self._folder, self._uses
        return table

    def require(self, key: str, why: str) -> None:
        """Complain, when the table is closed, if a key is missing; `why` it is needed."""
        self._known[key] = None
        if key not in self._data:
            self._missing[key] = f"missing ({why})"

    def _read(self, key: str, default: Any, standin: Any, convert: Callable[[Any], Any]) -> Any:
        self._known[key] = None
        if key in self._data:
            with self.at(key, value=key):
                return convert(self._data[key])
        if default is REQUIRED:
            self._missing.setdefault(key, "missing")
        return standin if default is REQUIRED else default

    def value(self, key: str, default: Any = REQUIRED) -> Any:
        """Whatever stands there."""
        return self._read(key, default, None, lambda value: value)

    def raw_numbers(self, key: str, default: Any = REQUIRED) -> Any:
        """A finite number, not huge, or lists of such, as they stand there; of any shape."""
        return self._read(key, default, None, _numbers)

    def array(self, key: str, shape: tuple[int | None, ...], default: Any = REQUIRED) -> np.ndarray:
        """Numbers of this shape (None: any length)."""
        standin = np.zeros([length or 0 for length in shape])
        return self._read(key, default, standin, lambda value: finite_array("value", _numbers(value), shape))

    def number(self, key: str, default: Any = REQUIRED, *, scale: float = 1.0, bound: str = "") -> float:
        """A finite number."""
        return self._read(key, default, np.nan, lambda value: scale * number_of(value, bound))

    def numbers(self, *keys: str) -> dict[str, float]:
        """Those of the keys that are there, all of them numbers."""
        found = {key: self.number(key, None) for key in keys}
        return {key: number for key, number in found.items() if number is not None}

    def vector(
        self, key: str, size: int | None, default: Any = REQUIRED, *, scale: float = 1.0
    ) -> np.ndarray:
        """(size,) finite numbers, of any size if it is None."""
        standin = np.full(size or 0, np.nan)
        return self._read(key, default, standin, lambda value: scale * _vector(value, size))

    def per_joint(
        self, key: str, n: int, default: Any = REQUIRED, *, scale: float = 1.0, bound: str = ""
    ) -> np.ndarray:
        """(n,): one number for all joints, or a list of n."""

        def convert(value: Any) -> np.ndarray:
            return scale * _vector(value if isinstance(value, list) else [value] * n, n, bound)

        return self._read(key, default, np.full(n, np.nan), convert)

    def direction(self, key: str, default: Any = REQUIRED) -> np.ndarray:
        """(3,) unit vector, in the file of any length."""
        return self._read(key, default, np.full(3, np.nan), _direction)

    def rotation(self, prefix: str = "", default: Any = REQUIRED, *, also: str = "") -> np.ndarray:
        """(3, 3) rotation matrix under one of the keys `ROTATIONS`, all with a prefix such as "mount_".

        `also` is a further key of a rotation vector in degrees.
        """
        forms = {prefix + form: convert for form, convert in ROTATIONS.items()}
        if also:
            forms[also] = ROTATIONS["rotation_vector_deg"]
        key = self.one_of(*forms, optional=True)
        if key is None and default is REQUIRED:
            self._missing[f"{prefix}rpy_deg"] = f"expected either {_either(forms)}, got none"
            return np.eye(3)
        return default if key is None else self._read(key, REQUIRED, None, forms[key])

    def text(self, key: str, default: Any = REQUIRED) -> str:
        """A text that is not blank."""
        return self._read(key, default, "", _text)

    def path_of(self, key: str, default: Any = REQUIRED) -> Path:
        """The file that is named, relative to the folder of this one; part of :meth:`copied`."""
        found = self._read(key, default, Path(), lambda value: self._folder / _text(value))
        if key in self._data:
            self._uses.files[id(self._data), key] = found
        return found

    def folders(self, key: str) -> list[Path]:
        """Folders in which named files are looked for, one or a list; :meth:`copied` goes without them."""
        value = self.value(key, [])
        folders = value if isinstance(value, list) else [value]
        if not all(isinstance(item, str) for item in folders):
            raise self.error(f"expected folders, got {value!r}", key)
        self._uses.folders.add((id(self._data), key))
        return [self._folder / item for item in folders]

    def note_parts(self, path: Path, parts: Mapping[str, Path]) -> None:
        """Say which files a file that is named here names in turn, and where they are."""
        self._uses.parts[path] = dict(parts)

    def copied(self, rename: Rename) -> dict[str, Any]:
        """The content with other names of the files that have been read, and without `folders`."""
        return self._uses.copied(self._data, rename)

    def flag(self, key: str, default: Any = REQUIRED) -> bool:
        """True or false."""
        return self._read(key, default, False, _flag)

    def whole(self, key: str, default: Any = REQUIRED, *, least: int, most: int | None = None) -> int:
        """A whole number between two bounds."""
        return self._read(key, default, least, lambda value: whole_number("value", value, least, most))

    def wholes(self, key: str, default: Any = REQUIRED, *, least: int, most: int) -> list[int]:
        """A list of whole numbers between two bounds."""

        def convert(value: Any) -> list[int]:
            if not isinstance(value, list):
                raise InputError(f"expected a list of whole numbers, got {value!r}", "")
            return [whole_number("value", item, least, most) for item in value]

        return self._read(key, default, [], convert)

    def choice(self, key: str, names: Iterable[str], default: Any = REQUIRED) -> str:
        """One of some names."""
        names, value = list(names), self.value(key, default)
        if isinstance(value, str) and value in names:
            return value
        got = f"got {value!r}{did_you_mean(value, names)}" if key in self._data else "but it is missing"
        raise self.error(f"expected one of {', '.join(names)}, {got}", key)

    def one_of(self, *keys: str, optional: bool = False) -> str | None:
        """The one of several keys that is there; None if none has to be."""
        self._known.update(dict.fromkeys(keys))
        given = [key for key in keys if key in self._data]
        if len(given) > 1 or not (given or optional):
            got = " and ".join(given) or "none"
            raise self.error(f"expected either {_either(keys)}, got {got}", keys[0])
        return given[0] if given else None


def number_of(value: Any, bound: str = "") -> float:
    """A number as TOML has it, finite and not huge (true and "1" are none), or an InputError without path."""
    if isinstance(value, list):
        raise InputError(f"expected a single number, got {value!r}", "")
    if isinstance(value, bool):
        raise InputError(f"expected a number, got {str(value).lower()}", "")
    if isinstance(value, int) and abs(value) > 10**300:
        raise InputError("number too large", "")
    number = number_from("value", value)
    refuse_huge("value", number)
    if (bound == "> 0" and number <= 0) or (bound == ">= 0" and number < 0):
        raise InputError(f"must be {bound}, got {value!r}", "")
    return number


def _numbers(value: Any) -> Any:
    """The value, if it is a number or lists of numbers, those side by side of one length."""
    if not isinstance(value, list):
        number_of(value)
    elif len({np.shape(_numbers(item)) for item in value}) > 1:
        raise InputError(f"expected lists of the same length, got {value!r}", "")
    return value


def _vector(value: Any, size: int | None, bound: str = "") -> np.ndarray:
    if not isinstance(value, list):
        raise InputError(f"expected a list of {f'{size} ' if size else ''}numbers, got {value!r}", "")
    if size is not None and len(value) != size:
        raise InputError(f"expected {size} numbers, got {len(value)}", "")
    return np.array([number_of(item, bound) for item in value])


def _direction(value: Any) -> np.ndarray:
    vector = _vector(value, 3)
    if not (length := np.linalg.norm(vector)) > 0:
        raise InputError("must not be zero", "")
    return vector / length


def _quaternion(value: Any) -> np.ndarray:
    quaternion = _vector(value, 4)
    if not abs(np.linalg.norm(quaternion) - 1) < 1e-3:  # people round
        raise InputError(f"must have length 1 (x, y, z, w), got {value!r}", "")
    return _rotations().from_quat(quaternion).as_matrix()


def _rotations() -> type[Rotation]:
    from scipy.spatial.transform import Rotation  # loads for 0.3 s, and most files hold none

    return Rotation


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"expected a text, got {value!r}", "")
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"expected true or false, got {value!r}", "")
    return value


def _either(keys: Iterable[str]) -> str:
    *others, last = keys
    return f"{', '.join(others)} or {last}"


ROTATIONS: dict[str, Callable[[Any], np.ndarray]] = {
    "rpy_deg": lambda value: _rotations().from_euler("xyz", _vector(value, 3), degrees=True).as_matrix(),
    "quaternion": _quaternion,
    "rotation_vector_deg": lambda value: _rotations().from_rotvec(np.radians(_vector(value, 3))).as_matrix(),
    "rotation": lambda value: rotation_matrix("value", _numbers(value), tolerance=1e-8),
}
"""Forms of an orientation in files, by key: docs/scenes.md. Roll, pitch, yaw turn about fixed axes."""
