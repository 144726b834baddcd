"""A cursor that reads tables of users' files: what is wrong is named with file, key and value.

    BASE = Keys("base", "The base.", {"mass": number("Mass.", "kg", bound="> 0")})
    SCENE = Keys("scene", "A base.", {"base": table(BASE)})

    with Table.read(path, SCENE) as data:
        base = data.table("base")
        body = base.make(Body, mass=base["mass"])

What a key may hold is declared once, see :mod:`ocptip.basics.schema`. Every complaint is one line, an
:class:`InputError`: "robot.toml: base.mass: must be > 0, got -3". One message names all unknown keys of a
table and of those below it, or else all missing ones. A key that no reader asked for is unknown. Missing keys
are reported when their table is closed. Thus `mas = 3` is called unknown (did you mean 'mass'?), and `mass`
is not called missing. Until then a stand-in (NaN, an empty text) is in its place. Therefore close a table, or
let :meth:`Table.make` do it, before its values are used.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date, datetime, time
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.read import parse_toml, read_text
from ocptip.basics.schema import REQUIRED, Key, Keys, either
from ocptip.basics.text import of_known

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
        table = {}
        for key, item in value.items():
            path = self.files.get((id(value), key))
            if path is not None:
                table[key] = rename(path, self.parts.get(path, {}))
            elif (id(value), key) not in self.folders:
                table[key] = self.copied(item, rename)
        return table


_MOST_COMPLAINTS = 8  # shown at once
_UNKNOWN = "unknown key"
_DECLARED: Any = object()

T = TypeVar("T")


MARK = "#>"
"""Begins the lines of a template that have to be filled in; without it they are TOML."""

Source = str | os.PathLike[str] | Mapping[str, Any]
"""Path of a TOML file, or its content as `tomllib` returns it."""


class Table:
    """A table of a file, and which of its keys have been read.

    `table["mass"]` is the value of a key as it is declared. As a context manager a table puts the file in
    front of every InputError, and is closed where the block ends without one.

    Args:
        data: nested dictionaries and lists as `tomllib` returns them.
        file: its name, for messages.
        keys: what the table may hold.
        path: of the table within the file.
        folder: of the file, to which the files that it names are relative.
    """

    def __init__(
        self, data: Mapping[str, Any], file: str, keys: Keys, path: str = "", folder: Path | None = None
    ) -> None:
        self.file, self.path, self._data, self._keys = file, path, data, keys.of(data)
        self._folder, self._uses = folder or Path(), NamedFiles()
        self._known: dict[str, None] = {}
        self._missing: dict[str, str] = {}
        self._tables: dict[str, Table] = {}
        self._top: Sequence[str] = ()  # keys above the first table, often put below one by mistake

    @classmethod
    def read(cls, source: Source, keys: Keys, name: str = "data") -> Table:
        """Open a TOML file; of content that has been read already, `name` stands for the file in messages.

        Raises:
            InputError: it cannot be read, or is no TOML.
        """
        if isinstance(source, Mapping):
            return cls(source, name, keys)
        path = Path(source)
        text = read_text(path)
        try:
            return cls(parse_toml(text), path.name, keys, folder=path.parent)
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

    def __getitem__(self, key: str) -> Any:
        return self.get(key)

    def get(self, key: str, default: Any = _DECLARED, *, size: int | None = None) -> Any:
        """The value of a key as it is declared.

        Args:
            key: of this table.
            default: instead of the declared one, where that depends on the context; REQUIRED: none.
            size: how many numbers are expected, or the largest one of them, where the context gives it.
        """
        declared = self._declared(key)
        if key not in self._data:
            return self._absent(key, declared, default, size)
        with self.at(key, value=key):
            value = declared.convert(self._data[key], size)
        if declared.names_file:
            return self.named_file(key)
        if declared.names_folders:
            self._uses.folders.add((id(self._data), key))
            value = [self._folder / name for name in value]
        return value

    def named_file(self, key: str) -> Path:
        """The file that a text names, relative to the folder of this one; part of :meth:`copied`."""
        path = self._uses.files[id(self._data), key] = self._folder / self._data[key]
        return path

    def _absent(self, key: str, declared: Key, default: Any, size: int | None) -> Any:
        if default is not _DECLARED and default is not REQUIRED:
            return default
        if default is _DECLARED and declared.default is not REQUIRED:
            return None if declared.default is None else declared.convert(declared.default, size)
        if declared.absent:
            raise self.error(declared.absent, key)
        self._missing.setdefault(key, "missing")
        return declared.standin(size)

    def _declared(self, key: str) -> Key:
        declared = self._keys.find(key)
        if declared is None:
            raise KeyError(f"{key!r} is not declared in {self._keys.name!r}")
        self._known[key] = None
        return declared

    @property
    def content(self) -> Mapping[str, Any]:
        """All keys and what stands there, whether it has been read or not."""
        return self._data

    def given(self, *keys: str) -> dict[str, Any]:
        """Values of those of the keys that are there."""
        values = {key: self.get(key, None) for key in keys}
        return {key: values[key] for key in keys if key in self._data}

    def value(self, key: str, default: Any = None) -> Any:
        """The value of a key, of any type; the default for keys that are not declared."""
        if self._keys.find(key) is None:
            return default
        self._known[key] = None
        return self._data.get(key, default)

    def leaves(self) -> Iterator[tuple[str, Any]]:
        """Place and value of every key, here and in all tables below, that is no table."""
        yield from _leaves(self._data, self.path)

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
                hint = misplaced if key in self._top else of_known(key, self._known, self._keys.selectors)
                yield self.error(f"{_UNKNOWN}{hint}", key)
        for key, text in self._missing.items():
            yield self.error(text, key)
        for table in self._tables.values():
            yield from table.complaints()

    def close(self, *, early: bool = False) -> None:
        """Refuse keys that have not been read, and missing ones; close the tables that were opened.

        Args:
            early: keys that are declared will be read after this.
        """
        if early:
            self._known.update(dict.fromkeys(self._keys.keys))
            self._known.update((key, None) for key in self._data if self._keys.find(key) is not None)
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

    def table(self, key: str) -> Table:
        """The table under a key, an empty one if it is optional and missing."""
        declared = self._declared(key)
        if key not in self._data and declared.default is REQUIRED:
            raise self.error(f"missing table [{self.place(key)}]", key)
        value = self._data.get(key, {})
        if not isinstance(value, dict):
            raise self.error(f"expected a table [{self.place(key)}], got {value!r}", key)
        return self._below(key, value, declared)

    def tables(self, key: str) -> list[Table]:
        """The tables in double brackets under a key, counted from 1; at least one if they are required."""
        declared = self._declared(key)
        value, place = self._data.get(key, []), re.sub(r"\[\d+\]", "", self.place(key))
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.error(f"expected tables in double brackets, [[{place}]], got {value!r}", key)
        if declared.default is REQUIRED and not value:
            raise self.error(f"at least one [[{place}]] is needed", key)
        return [self._below(f"{key}[{number}]", item, declared) for number, item in enumerate(value, 1)]

    def _below(self, key: str, data: Mapping[str, Any], declared: Key) -> Table:
        if key not in self._tables:
            assert declared.keys is not None
            table = Table(data, self.file, declared.keys, self.place(key), self._folder)
            table._top, table._uses = self._top or list(self._known), self._uses
            self._tables[key] = table
        return self._tables[key]

    def require(self, key: str, why: str) -> None:
        """Complain, when the table is closed, if a key is missing; `why` it is needed."""
        self._known[key] = None
        if key not in self._data:
            self._missing[key] = f"missing ({why})"

    def rotation(self, prefix: str = "", default: Any = _DECLARED) -> np.ndarray:
        """(3, 3) rotation matrix under one of the four keys with a prefix such as "mount_".

        Without a default one of them is required.
        """
        keys = self._keys.group(f"{prefix}rpy_deg")
        key = self.one_of(keys[0])
        if key is None and default is _DECLARED:
            self._missing[keys[0]] = f"expected either {either(keys)}, got none"
            return np.eye(3)
        return default if key is None else self[key]

    def one_of(self, *keys: str) -> str | None:
        """The one of several keys that is there; None if there is none, and none has to be.

        Args:
            keys: of which one has to be there; or a single one, which stands for its declared group.
        """
        optional = len(keys) == 1 and self._keys.group(keys[0]) not in self._keys.one_of
        keys = self._keys.group(keys[0]) if len(keys) == 1 else keys
        self._known.update(dict.fromkeys(keys))
        given = [key for key in keys if key in self._data]
        if len(given) > 1 or not (given or optional):
            # Keys that only variants know are no mistakes yet.
            unknown = [] if given or self._keys.by else [k for k in self._data if self._keys.find(k) is None]
            if unknown:
                raise self.error(f"{_UNKNOWN}; expected either {either(keys)}", unknown[0])
            got = " and ".join(given) or "none"
            raise self.error(f"expected either {either(keys)}, got {got}", keys[0])
        return given[0] if given else None

    def note_parts(self, path: Path, parts: Mapping[str, Path]) -> None:
        """Say which files a file that is named here names in turn, and where they are."""
        self._uses.parts[path] = dict(parts)

    def copied(self, rename: Rename) -> dict[str, Any]:
        """The content with other names of the files that have been read, and without folders of files."""
        return self._uses.copied(self._data, rename)


def _leaves(data: Mapping[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    for key, value in data.items():
        place = f"{path}.{key}" if path else key
        items = {place: value}
        if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
            items = {f"{place}[{number}]": item for number, item in enumerate(value, 1)}
        for name, item in items.items():
            if isinstance(item, dict):
                yield from _leaves(item, name)
            else:
                yield name, item


_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(data: Mapping[str, Any]) -> str:
    """A TOML file with this content; `tomllib.loads` gives it back.

    Args:
        data: texts, numbers, dates, and dictionaries and lists of such.

    Raises:
        TypeError: a value that TOML has no form for, such as None.
    """
    return "\n".join(_lines(data, ())).lstrip("\n") + "\n"


def toml_value(value: Any) -> str:
    """A value on one line; tables in braces.

    Raises:
        TypeError: TOML has no form for it.
    """
    if isinstance(value, str):  # a text of JSON is one of TOML, but for DEL
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{_key(key)} = {toml_value(item)}" for key, item in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    raise TypeError(f"TOML has no form for {value!r}")


def _lines(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    """Lines of a table. Its plain keys come first: what follows a header belongs to that table."""
    below = {}
    for key, value in table.items():
        if isinstance(value, Mapping) or _are_tables(value):
            below[key] = value
        else:
            yield f"{_key(key)} = {toml_value(value)}"
    for key, value in below.items():
        full_path = (*path, key)
        name = ".".join(map(_key, full_path))
        for one in value if isinstance(value, list) else [value]:
            yield from ("", f"[[{name}]]" if isinstance(value, list) else f"[{name}]")
            yield from _lines(one, full_path)


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, Mapping) for item in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else toml_value(key)
