"""TOML out of nested dictionaries and lists: the writer that `tomllib` lacks."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from datetime import date, datetime, time
from typing import Any

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
        own = (*path, key)
        name = ".".join(map(_key, own))
        for one in value if isinstance(value, list) else [value]:
            yield from ("", f"[[{name}]]" if isinstance(value, list) else f"[{name}]")
            yield from _lines(one, own)


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, Mapping) for item in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else toml_value(key)
