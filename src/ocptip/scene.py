"""A scene file: a support and its loads in TOML, see docs/scenes.md.

Contacts and loads are counted from 1 in every message, as in the printed table. Every error is one
:class:`InputError` that starts with the file and the key, e.g.
`scene.toml: contact[2].friction: must be > 0, got -0.5`.
"""

from __future__ import annotations

import difflib
import os
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.contact import Binding, Load, Support
from ocptip.errors import InputError, positive_number

_TABLES = ("gravity", "base", "contact", "load")
_BASE_KEYS = ("mass", "center_of_mass", "inertia")
_LOAD_KEYS = ("force", "moment", "point")


@dataclass(frozen=True)
class Scene:
    """A base on its contacts with everything that acts on it.

    Attributes:
        name: file name, for messages and titles.
        support: the base on its contacts.
        loads: the loads besides the base's own weight.
        wrench: weight and loads about the base's centre of mass, N and N m, base axes; (6,), planar (3,).
    """

    name: str
    support: Support
    loads: tuple[Load, ...]
    wrench: np.ndarray

    @property
    def planar(self) -> bool:
        """True for a scene in the plane."""
        return self.support.dimension == 2


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene file.

    Raises:
        InputError: the file cannot be read or describes no scene; one line that names file and key.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8 (byte {error.start})") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path.name}: broken TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path.name}: broken TOML: nested too deeply") from None
    return scene_from_dict(data, name=path.name)


def scene_from_dict(data: dict[str, Any], *, name: str = "scene") -> Scene:
    """Build a scene from the content of a scene file.

    Args:
        data: nested dictionaries and lists as `tomllib` returns them.
        name: put in front of every message.

    Raises:
        InputError: one line that names the key.
    """
    try:
        return _scene(data, name)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _scene(data: dict[str, Any], name: str) -> Scene:
    _refuse_unknown(data, _TABLES, "")
    contacts = _contacts(_tables(data, "contact"))
    dimension = contacts[0].dimension
    support = _support(data, contacts)
    loads = tuple(
        _load(table, f"load[{number}]", dimension)
        for number, table in enumerate(_tables(data, "load"), start=1)
    )
    return Scene(name, support, loads, support.wrench(loads))


def _support(data: dict[str, Any], contacts: Sequence[Binding]) -> Support:
    d = contacts[0].dimension
    if "base" not in data:
        raise InputError("base: missing table [base] with mass and center_of_mass")
    base = data["base"]
    if not isinstance(base, dict):
        raise InputError(f"base: expected a table [base], got {base!r}")
    _refuse_unknown(base, _BASE_KEYS, "base.")
    for key in ("mass", "center_of_mass"):
        if key not in base:
            raise InputError(f"base.{key}: missing")
    mass = positive_number("base.mass", _number("base.mass", base["mass"]))
    center_of_mass = _vector("base.center_of_mass", base["center_of_mass"], d)
    gravity = _vector("gravity", data["gravity"], d) if "gravity" in data else None
    inertia = base.get("inertia")
    if inertia is not None:
        _refuse_non_numbers("base.inertia", inertia)
    try:
        return Support(contacts, mass=mass, center_of_mass=center_of_mass, inertia=inertia, gravity=gravity)
    except InputError as error:
        message = str(error)
        raise InputError(f"base.{message}" if message.startswith("inertia") else message) from None


def _contacts(tables: list[dict[str, Any]]) -> list[Binding]:
    if not tables:
        raise InputError("contact: a scene needs at least one [[contact]]")
    contacts: list[Binding] = []
    for number, table in enumerate(tables, start=1):
        where = f"contact[{number}]"
        contact = _contact(table, where)
        if contacts and contact.dimension != contacts[0].dimension:
            raise InputError(
                f"{where}.position: expected {contacts[0].dimension} numbers like contact[1], "
                f"got {contact.dimension}"
            )
        contacts.append(contact)
    return contacts


def _contact(table: dict[str, Any], where: str) -> Binding:
    kinds = sorted(Binding.registry)
    if "kind" not in table:
        raise InputError(f"{where}.kind: missing; known: {', '.join(kinds)}")
    kind = table["kind"]
    if not isinstance(kind, str) or kind not in Binding.registry:
        raise InputError(f"{where}.kind: unknown kind {kind!r}{_suggestion(kind, kinds)}")
    cls = Binding.registry[kind]
    parameters = {key: value for key, value in table.items() if key != "kind"}
    known = {field.name: field for field in fields(cls) if field.name in cls.parameter_names()}
    _refuse_unknown(parameters, known, f"{where}.", also=("kind",))
    for key, field in known.items():
        if key not in parameters:
            if key == "position" or (field.default is MISSING and field.default_factory is MISSING):
                raise InputError(f"{where}.{key}: missing (needed by {kind})")
        elif not {"bool", "str"} & set(str(field.type).replace("|", " ").split()):
            _refuse_non_numbers(f"{where}.{key}", parameters[key])
    position = parameters["position"]
    if isinstance(position, list) and len(position) == 2:
        parameters.setdefault("normal", [0.0, 1.0])
    try:
        return cls(**parameters)
    except InputError as error:
        raise InputError(f"{where}.{error}") from None


def _load(table: dict[str, Any], where: str, dimension: int) -> Load:
    _refuse_unknown(table, _LOAD_KEYS, f"{where}.")
    if "force" not in table and "moment" not in table:
        raise InputError(f"{where}.force: missing (a load needs a force or a moment)")
    if "force" in table and "point" not in table:
        raise InputError(f"{where}.point: missing (where the force acts, m)")
    zero = np.zeros(dimension)
    force = _vector(f"{where}.force", table["force"], dimension) if "force" in table else zero
    point = _vector(f"{where}.point", table["point"], dimension) if "point" in table else zero
    if "moment" not in table:
        moment: Any = np.zeros(3) if dimension == 3 else 0.0
    elif dimension == 3:
        moment = _vector(f"{where}.moment", table["moment"], 3)
    else:
        moment = _number(f"{where}.moment", table["moment"])
    return Load(force=force, moment=moment, point=point)


def _tables(data: dict[str, Any], key: str) -> list[dict[str, Any]]:
    value = data.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise InputError(f"{key}: expected tables in double brackets, [[{key}]]")
    return value


def _number(where: str, value: object) -> float:
    if isinstance(value, list | dict):
        raise InputError(f"{where}: expected a single number, got {value!r}")
    _refuse_non_numbers(where, value)
    return float(value)  # type: ignore[arg-type]


def _vector(where: str, value: object, size: int) -> np.ndarray:
    if not isinstance(value, list):
        raise InputError(f"{where}: expected a list of {size} numbers, got {value!r}")
    if len(value) != size:
        raise InputError(f"{where}: expected {size} numbers, got {len(value)}")
    return np.array([_number(where, item) for item in value])


def _refuse_non_numbers(where: str, value: object) -> None:
    """Raise unless `value` is a finite number or lists of such (true is no number, "1" neither)."""
    if isinstance(value, list):
        for item in value:
            _refuse_non_numbers(where, item)
        return
    if isinstance(value, bool) or not isinstance(value, int | float):
        shown = str(value).lower() if isinstance(value, bool) else repr(value)
        raise InputError(f"{where}: expected a number, got {shown}")
    if isinstance(value, int) and abs(value) > 10**300:
        raise InputError(f"{where}: number too large")
    if not np.isfinite(float(value)):
        raise InputError(f"{where}: must be finite, got {value}")


def _refuse_unknown(
    table: Iterable[str], known: Iterable[str], prefix: str, also: Sequence[str] = ()
) -> None:
    names = [*also, *known]
    for key in table:
        if key not in names:
            if prefix and key in _TABLES:
                raise InputError(f"{prefix}{key}: unknown key; {key!r} belongs above the first table")
            raise InputError(f"{prefix}{key}: unknown key{_suggestion(key, names)}")


def _suggestion(word: object, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(str(word), known, n=1)
    guess = f"; did you mean {near[0]!r}?" if near else ";"
    return f"{guess} known: {', '.join(known)}"
