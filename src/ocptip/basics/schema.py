"""Declarations of the tables in users' files: each key once, with type, unit, range, default and meaning.

    BASE = Keys("base", "The base without the robot.", {
        "mass": number("Mass.", "kg", bound="> 0"),
        "feet": numbers("Positions of ordinary contacts.", "m", default=None),
    })

Readers (:class:`ocptip.basics.toml.Table`), the reference page and the JSON Schema all follow from them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, finite_array, whole_number
from ocptip.basics.frozen import settle
from ocptip.basics.text import did_you_mean
from ocptip.basics.values import (
    ROTATIONS,
    direction_of,
    flag_of,
    folders_of,
    number_of,
    numbers_of,
    text_of,
    vector_of,
)

REQUIRED: Any = object()
"""Default of keys that have to be there."""

DEGREES = np.pi / 180
"""Scale of keys in degrees."""

_SCALES = {"deg": DEGREES, "deg/s": DEGREES, "deg/s^2": DEGREES, "ms": 1e-3}  # SI units per unit of the file
_NUMBER = {"type": "number"}


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key of a table: what its value may be, and what it means.

    Attributes:
        meaning: one sentence, for the reference page, templates and editors.
        words: the type, for people.
        schema: JSON Schema of the value.
        convert: what a reader gets for a value of the file, and a size that the context gives or None; raises
            InputError without a path.
        unit: of the file.
        default: as in a file; REQUIRED; or None: readers get None, and `otherwise` says what holds.
        otherwise: what holds without the key, where no default says it; the key is optional.
        standin: in place of a required value until its absence is reported, for a size or None.
        absent: message for a missing required key, raised at once and not when the table is closed.
        keys: of the table or tables below the key.
        several: tables in double brackets.
        names_file, names_folders: a file, or folders with files, relative to the folder of this one.
    """

    meaning: str
    words: str
    schema: Mapping[str, Any] = field(default_factory=dict)
    convert: Callable[[Any, int | None], Any] = lambda value, _: value
    unit: str = ""
    default: Any = None
    otherwise: str = ""
    standin: Callable[[int | None], Any] = lambda _: None
    absent: str = ""
    keys: Keys | None = None
    several: bool = False
    names_file: bool = False
    names_folders: bool = False

    def __post_init__(self) -> None:
        if self.otherwise and self.default is REQUIRED:
            settle(self, default=None)


@dataclass(frozen=True)
class Keys:
    """The keys of a table.

    Attributes:
        name: of the table, unique among all that are declared.
        meaning: one sentence.
        keys: by name.
        others: what keys with any other name hold; None: there are none.
        one_of: groups of keys of which exactly one is there.
        at_most_one: groups of keys of which one may be there.
        by: the key whose value, or the keys of which the one that is there, decides which of the `variants`
            the table is.
        variants: further keys by value of `by`; a function, where they are not known before they are read.
        usual: the variant without any of `by`.
    """

    name: str
    meaning: str
    keys: Mapping[str, Key] = field(default_factory=dict)
    others: Key | None = None
    one_of: Sequence[tuple[str, ...]] = ()
    at_most_one: Sequence[tuple[str, ...]] = ()
    by: str | tuple[str, ...] = ()
    variants: Mapping[str, Keys] | Callable[[], Mapping[str, Keys]] = field(default_factory=dict)
    usual: str = ""

    @property
    def ref(self) -> dict[str, str]:
        """The reference to the table within the JSON Schema."""
        return {"$ref": f"#/$defs/{self.name.replace(' ', '-')}"}

    @property
    def known_variants(self) -> Mapping[str, Keys]:
        """Variants by value of `by`."""
        return self.variants() if callable(self.variants) else self.variants

    def of(self, data: Mapping[str, Any]) -> Keys:
        """The same with the keys of the variant that a table is."""
        if isinstance(self.by, str):
            value = data.get(self.by, self.usual)
        else:
            value = next((key for key in self.by if key in data), self.usual)
        variants = self.known_variants
        chosen = variants.get(value if isinstance(value, str) else "", variants.get(self.usual))
        return self if chosen is None else self.joined(chosen.of(data))

    def joined(self, chosen: Keys) -> Keys:
        """The keys of a table together with those of a variant of it."""
        return Keys(
            self.name,
            self.meaning,
            {**self.keys, **chosen.keys},
            chosen.others or self.others,
            (*self.one_of, *chosen.one_of),
            (*self.groups, *chosen.groups),
            (*self.selectors, *chosen.selectors),
        )

    @property
    def selectors(self) -> tuple[str, ...]:
        """Keys of which the one that is there decides which variant the table is."""
        return () if isinstance(self.by, str) else self.by

    @cached_property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups of keys of which at most one may be there, forms of orientations among them."""
        prefixes = [key.removesuffix("rpy_deg") for key in self.keys if key.endswith("rpy_deg")]
        forms = [tuple(prefix + form for form in ROTATIONS) for prefix in prefixes]
        return (*self.at_most_one, *forms)

    def find(self, key: str) -> Key | None:
        """The declaration of a key; None if the key is unknown."""
        return self.keys.get(key, self.others)

    def group(self, key: str) -> tuple[str, ...]:
        """The group that a key is in."""
        return next(names for names in (*self.one_of, *self.groups) if key in names)


def anything(
    meaning: str, words: str, schema: Mapping[str, Any], *, default: Any = None, otherwise: str = ""
) -> Key:
    """A value that its reader checks."""
    return Key(meaning=meaning, words=words, schema=schema, default=default, otherwise=otherwise)


ANY_FILE = Keys("file", "Any file.", others=anything("Any key.", "anything", {}))


def number(
    meaning: str, unit: str = "", *, bound: str = "", default: Any = REQUIRED, otherwise: str = ""
) -> Key:
    """A finite number in SI units, or in degrees or ms; `bound` is "> 0", ">= 0" or none."""
    scale = _SCALES.get(unit, 1.0)
    return Key(
        meaning=meaning,
        words=f"number {bound}".rstrip(),
        schema=_bounded(bound),
        convert=lambda value, _: scale * number_of(value, bound),
        unit=unit,
        default=default,
        otherwise=otherwise,
        standin=lambda _: np.nan,
    )


def vector(
    meaning: str,
    unit: str = "",
    size: int | None = None,
    *,
    bound: str = "",
    default: Any = REQUIRED,
    otherwise: str = "",
) -> Key:
    """A list of numbers; without a size the context gives it, or any will do."""
    scale = _SCALES.get(unit, 1.0)
    return Key(
        meaning=meaning,
        words=f"list of {f'{size} ' if size else ''}numbers",
        schema=_list(_NUMBER, size),
        convert=lambda value, n: scale * vector_of(value, size or n, bound),
        unit=unit,
        default=default,
        otherwise=otherwise,
        standin=lambda n: np.full(size or n or 0, np.nan),
    )


def per_joint(
    meaning: str, unit: str = "", *, bound: str = "", default: Any = REQUIRED, otherwise: str = ""
) -> Key:
    """One number for all joints, or a list; the context gives how many there are."""
    scale = _SCALES.get(unit, 1.0)

    def convert(value: Any, n: int | None) -> np.ndarray:
        return scale * vector_of(value if isinstance(value, list) else [value] * (n or 1), n, bound)

    return Key(
        meaning=meaning,
        words=f"{f'number {bound}'.rstrip()}, or list of one per joint",
        schema={"anyOf": [_bounded(bound), _list(_bounded(bound))]},
        convert=convert,
        unit=unit,
        default=default,
        otherwise=otherwise,
        standin=lambda n: np.full(n or 0, np.nan),
    )


def by_joint(
    meaning: str, unit: str = "", *, bound: str = "", single: bool = True, otherwise: str = ""
) -> Key:
    """One number for all joints, a list, or a table by names of joints and patterns such as "wrist_*".

    Without `single` a number alone is refused. The key is optional.
    """
    each = number("Value of these joints.", unit, bound=bound)
    names = Keys("values by joint", "Values by names of joints, or patterns such as `wrist_*`.", others=each)
    key = (per_joint if single else vector)(meaning, unit, bound=bound)
    shapes = [each.schema] if single else []
    by_name = {"type": "object", "additionalProperties": each.schema}
    return Key(
        meaning=meaning,
        words=f"{f'number {bound}'.rstrip()}, list, or table by joint"
        if single
        else "list, or table by joint",
        schema={"anyOf": [*shapes, _list(each.schema), by_name]},
        convert=key.convert,
        unit=unit,
        otherwise=otherwise,
        keys=names,
    )


def numbers(
    meaning: str, unit: str = "", *, words: str = "", default: Any = REQUIRED, otherwise: str = ""
) -> Key:
    """A finite number, or lists of such of any shape, as they stand in the file."""
    return Key(
        meaning=meaning,
        words=words or "number, or lists of numbers",
        schema={"type": ["number", "array"]},
        convert=lambda value, _: numbers_of(value),
        unit=unit,
        default=default,
        otherwise=otherwise,
    )


def array(
    meaning: str, unit: str, shape: tuple[int | None, ...], *, default: Any = REQUIRED, otherwise: str = ""
) -> Key:
    """Rows of numbers of this shape (None: any length; "n": the context gives it)."""
    return Key(
        meaning=meaning,
        words=f"list of lists of {shape[-1] or ''} numbers".replace("  ", " "),
        schema=_list(_list(_NUMBER, shape[-1])),
        convert=lambda value, n: finite_array("value", numbers_of(value), (n or shape[0], *shape[1:])),
        unit=unit,
        default=default,
        otherwise=otherwise,
        standin=lambda n: np.zeros([length or 0 for length in (n or shape[0], *shape[1:])]),
    )


def direction(meaning: str, *, default: Any = REQUIRED, otherwise: str = "") -> Key:
    """Three numbers of any length, of which the direction counts."""
    return Key(
        meaning=meaning,
        words="list of 3 numbers",
        schema=_list(_NUMBER, 3),
        convert=lambda value, _: direction_of(value),
        default=default,
        otherwise=otherwise,
        standin=lambda _: np.full(3, np.nan),
    )


def whole(
    meaning: str, *, least: int, most: int | None = None, default: Any = REQUIRED, otherwise: str = ""
) -> Key:
    """A whole number between two bounds; the context may give the largest one."""
    upper = {} if most is None else {"maximum": most}
    return Key(
        meaning=meaning,
        words=f"whole number >= {least}" if most is None else f"whole number, {least} to {most}",
        schema={"type": "integer", "minimum": least, **upper},
        convert=lambda value, n: whole_number("value", value, least, most if n is None else n),
        default=default,
        otherwise=otherwise,
        standin=lambda _: least,
    )


def wholes(meaning: str, *, least: int, default: Any = REQUIRED) -> Key:
    """A list of whole numbers; the context gives the largest one."""

    def convert(value: Any, most: int | None) -> list[int]:
        if not isinstance(value, list):
            raise InputError(f"expected a list of whole numbers, got {value!r}", "")
        return [whole_number("value", item, least, most) for item in value]

    return Key(
        meaning=meaning,
        words=f"list of whole numbers >= {least}",
        schema=_list({"type": "integer", "minimum": least}),
        convert=convert,
        default=default,
        standin=lambda _: [],
    )


def text(meaning: str, *, default: Any = REQUIRED, otherwise: str = "") -> Key:
    """A text that is not blank."""
    return Key(
        meaning=meaning,
        words="text",
        schema={"type": "string", "pattern": r"\S"},
        convert=lambda value, _: text_of(value),
        default=default,
        otherwise=otherwise,
        standin=lambda _: "",
    )


def file(meaning: str, *, default: Any = REQUIRED, otherwise: str = "") -> Key:
    """The name of a file, relative to the folder of the one that names it."""
    key = text(meaning, default=default, otherwise=otherwise)
    return replace(key, words="file", standin=lambda _: None, names_file=True)


def folders(meaning: str) -> Key:
    """A folder, or a list of folders, in which files are searched."""
    schema = {"type": "string"}
    return Key(
        meaning=meaning,
        words="folder, or list of folders",
        schema={"anyOf": [schema, _list(schema)]},
        convert=folders_of,
        default=[],
        names_folders=True,
    )


def flag(meaning: str, *, default: Any = REQUIRED) -> Key:
    """True or false."""
    return Key(
        meaning=meaning,
        words="true or false",
        schema={"type": "boolean"},
        convert=lambda value, _: flag_of(value),
        default=default,
        standin=lambda _: False,
    )


def choice(meaning: str, names: Iterable[str], *, default: Any = REQUIRED, otherwise: str = "") -> Key:
    """One of some names."""
    names = list(names)

    def convert(value: Any, _: int | None) -> str:
        if isinstance(value, str) and value in names:
            return value
        raise InputError(f"expected one of {', '.join(names)}, got {value!r}{did_you_mean(value, names)}", "")

    return Key(
        meaning=meaning,
        words=", ".join(f"`{name}`" for name in names),
        schema={"enum": names},
        convert=convert,
        default=default,
        otherwise=otherwise,
        absent=f"expected one of {', '.join(names)}, but it is missing",
    )


def table(keys: Keys, meaning: str = "", *, default: Any = REQUIRED) -> Key:
    """A table, optional where `default` is None."""
    return Key(meaning=meaning or keys.meaning, words="table", keys=keys, default=default)


def tables(keys: Keys, meaning: str = "", *, required: bool = False) -> Key:
    """Tables in double brackets, at least one if they are required."""
    default = REQUIRED if required else None
    return Key(meaning=meaning or keys.meaning, words="tables", keys=keys, several=True, default=default)


def rotation(meaning: str, prefix: str = "", *, default: str = "none") -> dict[str, Key]:
    """Four keys of which one gives an orientation: roll, pitch and yaw, a quaternion, a vector, a matrix."""
    shapes = {"rpy_deg": 3, "quaternion": 4, "rotation_vector_deg": 3, "rotation": 3}
    words_of = {
        "rpy_deg": "roll, pitch, yaw",
        "quaternion": "quaternion x, y, z, w",
        "rotation_vector_deg": "axis times angle",
        "rotation": "3 x 3 matrix",
    }
    return {
        prefix + form: Key(
            meaning=f"{meaning}: {words_of[form]}.",
            words="list of 3 lists of 3 numbers" if form == "rotation" else f"list of {size} numbers",
            schema=_list(_list(_NUMBER, 3) if form == "rotation" else _NUMBER, size),
            convert=ROTATIONS[form],
            unit="deg" if form.endswith("deg") else "",
            otherwise=default,
        )
        for form, size in shapes.items()
    }


def either(keys: Iterable[str]) -> str:
    """Names of alternatives: "a, b or c"."""
    *others, last = keys
    return f"{', '.join(others)} or {last}"


def _bounded(bound: str) -> dict[str, Any]:
    limits = {"> 0": {"exclusiveMinimum": 0}, ">= 0": {"minimum": 0}, "": {}}
    return {**_NUMBER, **limits[bound]}


def _list(items: Mapping[str, Any], size: int | None = None) -> dict[str, Any]:
    sizes = {} if size is None else {"minItems": size, "maxItems": size}
    return {"type": "array", "items": items, **sizes}
