"""The keys of all files as a JSON Schema for editors, and as a page for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any

from ocptip.basics import schema
from ocptip.basics.schema import REQUIRED, Key, Keys
from ocptip.basics.toml import toml_value
from ocptip.task_files.cell import CELL
from ocptip.task_files.cycle import CYCLE
from ocptip.task_files.motion import CASE, MOTION
from ocptip.task_files.option_files import COLUMNS_FILE, LOAD_CASES
from ocptip.task_files.parallel import PARALLEL
from ocptip.task_files.path import PATH
from ocptip.task_files.placement import PLACEMENT
from ocptip.task_files.platform_points import PLATFORM
from ocptip.task_files.scene import SCENE
from ocptip.task_files.tables.arm import ARM
from ocptip.task_files.tables.tolerance import TOLERANCE

FILES = (
    SCENE,
    MOTION,
    CASE,
    CYCLE,
    PLACEMENT,
    CELL,
    PATH,
    PARALLEL,
    PLATFORM,
    LOAD_CASES,
    COLUMNS_FILE,
    Keys("tolerance file", "An uncertainty alone: `--tolerance`.", {"tolerance": schema.table(TOLERANCE)}),
    Keys("arm file", "An arm alone: `ocptip rate`, `ocptip parallel`.", {"arm": schema.table(ARM)}),
)
"""All kinds of files."""

_HEAD = """\
# Reference of files

Every key of every file that ocptip reads. `ocptip schema --page` prints this page from the declarations that
the reader uses. `ocptip schema > task.schema.json` prints them as a JSON Schema for editors. With the first
line `#:schema ./task.schema.json` an editor completes the keys of a file and marks mistakes (VS Code: Even
Better TOML). Messages count contacts, segments and other tables from 1.
"""


def json_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of all kinds of files."""
    tables = {keys.ref["$ref"].rpartition("/")[2]: keys for keys in _all_tables()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Files of ocptip",
        "anyOf": [keys.ref for keys in FILES],
        "$defs": {name: _table_schema(keys) for name, keys in tables.items()},
    }


def reference_page() -> str:
    """The page of docs/ with every key, as Markdown."""
    tables = [keys for keys in _all_tables() if keys not in FILES]
    parts = [_HEAD, "## Files\n", *map(_section, FILES), "## Tables\n", *map(_section, tables)]
    return "\n".join(parts)


def _all_tables() -> list[Keys]:
    """The files and all tables below them, each once."""
    all_tables: dict[str, Keys] = {}

    def add(keys: Keys) -> None:
        if keys.name in all_tables:
            assert all_tables[keys.name] is keys, keys.name
            return
        all_tables[keys.name] = keys
        for variant, _ in _flat(keys):
            for key in (*variant.keys.values(), *filter(None, [variant.others])):
                if below := _below(key):
                    add(below)

    for keys in FILES:
        add(keys)
    return list(all_tables.values())


def _below(key: Key) -> Keys | None:
    """The table that a key holds; None for values, and for values by names."""
    others = None if key.keys is None else key.keys.others
    if key.keys is None or not key.schema or key.several or others is None:
        return key.keys
    return others.keys


def _flat(keys: Keys) -> Iterator[tuple[Keys, dict[str, Any]]]:
    """The variants of a table with all their keys, and the values of keys (None: any) that tell them."""
    variants = keys.known_variants
    if keys.usual not in variants:
        yield keys, {}
    for value, chosen in variants.items():
        for variant, described in _flat(chosen):
            which = (
                {keys.by: value} if isinstance(keys.by, str) else {value: None} if value in keys.by else {}
            )
            yield keys.joined(variant), {**which, **described}


def _table_schema(keys: Keys) -> dict[str, Any]:
    head = {"title": keys.name, "description": keys.meaning}
    forms = [_variant_schema(variant, described, keys.usual) for variant, described in _flat(keys)]
    if len(forms) > 1 and isinstance(keys.by, str) and keys.usual not in keys.known_variants:
        forms = forms[1:]  # the key that tells the variant is required
    return {**head, **forms[0]} if len(forms) == 1 else {**head, "anyOf": forms}


def _variant_schema(keys: Keys, described: dict[str, Any], usual: str) -> dict[str, Any]:
    properties = {name: _key_schema(key) for name, key in keys.keys.items()}
    required = [name for name, key in keys.keys.items() if key.default is REQUIRED]
    for name, value in described.items():
        if value is not None:
            properties[name] = {**properties[name], "const": value}
        if value != usual and name not in required:
            required.append(name)
    groups = [
        {"oneOf": [{"required": [name]} for name in names]} for names in keys.one_of if names[0] in properties
    ]
    for names in keys.groups:
        pairs = combinations([name for name in names if name in properties], 2)
        groups += [{"not": {"required": list(pair)}} for pair in pairs]
    return {
        "type": "object",
        "properties": properties,
        **({"required": required} if required else {}),
        **({"allOf": groups} if groups else {}),
        "additionalProperties": False if keys.others is None else _key_schema(keys.others),
    }


def _key_schema(key: Key) -> dict[str, Any]:
    unit = f" ({key.unit})" if key.unit else ""
    form = dict(key.schema)
    if not form and key.keys is not None:
        some = {"minItems": 1} if key.default is REQUIRED else {}
        form = {"type": "array", "items": key.keys.ref, **some} if key.several else dict(key.keys.ref)
    default = {} if key.default is None or key.default is REQUIRED else {"default": key.default}
    return {**form, "description": f"{key.meaning}{unit}", **default}


def _section(keys: Keys) -> str:
    lines = [f"### {keys.name}\n", f"{keys.meaning}\n"]
    variants = list(_flat(keys))
    rows = [{name: _row(name, key) for name, key in variant.keys.items()} for variant, _ in variants]
    common = {name for name, row in rows[0].items() if all(other.get(name) == row for other in rows)}
    shared = {name: key for name, key in variants[0][0].keys.items() if name in common}
    if shared or len(variants) == 1:
        lines += _rows(keys if len(variants) == 1 else variants[0][0], shared)
    for variant, described in variants if len(variants) > 1 else ():
        if extra_keys := {name: key for name, key in variant.keys.items() if name not in shared}:
            which = [
                f"`{key}`" if value is None else f"`{key} = {toml_value(value)}`"
                for key, value in described.items()
            ]
            lines += [f"With {' and '.join(which)}:\n" if which else "Else:\n", *_rows(variant, extra_keys)]
    return "\n".join(lines)


def _rows(keys: Keys, shown: Mapping[str, Key]) -> list[str]:
    rows = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    rows += [_row(f"`{name}`", key) for name, key in shown.items()]
    if keys.others is not None:
        rows.append(_row("any other name", keys.others))
    groups = [("One of", names) for names in keys.one_of] + [
        ("At most one of", names) for names in keys.groups
    ]
    notes = [f"{word} {', '.join(f'`{n}`' for n in names)}.\n" for word, names in groups if names[0] in shown]
    return [*rows, "", *notes]


def _row(name: str, key: Key) -> str:
    default = key.otherwise or ("required" if key.default is REQUIRED else "")
    if not default and key.default is not None:
        default = f"`{toml_value(key.default)}`" if key.default != [] else "none"
    words, below = key.words, _below(key)
    if below is not None:
        words += f": [{below.name}](#{below.name.replace(' ', '-').lower()})"
    cells = (name, words, key.unit, default or "none", key.meaning)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
