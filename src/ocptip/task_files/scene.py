"""A scene file: a support and its loads in TOML, see docs/scenes.md.

Contacts and loads are counted from 1 in every message, as in the printed table. Every error is one
:class:`InputError` that starts with the file and the key, e.g.
`scene.toml: contact[2].friction: must be > 0, got -0.5`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.toml import (
    TOP_KEYS,
    number_at,
    read_toml,
    refuse_non_numbers,
    refuse_unknown,
    subtables,
    suggestion,
    vector_at,
)
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.support import Load, Support, refuse_impossible_inertia

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
    data = read_toml(path)
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
    refuse_unknown(data, TOP_KEYS, "")
    contacts = _contacts(subtables(data, "contact"))
    dimension = contacts[0].dimension
    support = _support(data, contacts)
    loads = tuple(
        _load(table, f"load[{number}]", dimension)
        for number, table in enumerate(subtables(data, "load"), start=1)
    )
    return Scene(name, support, loads, support.wrench(loads))


def _support(data: dict[str, Any], contacts: Sequence[Binding]) -> Support:
    d = contacts[0].dimension
    if "base" not in data:
        raise InputError("base: missing table [base] with mass and center_of_mass")
    base = data["base"]
    if not isinstance(base, dict):
        raise InputError(f"base: expected a table [base], got {base!r}")
    refuse_unknown(base, _BASE_KEYS, "base.")
    for key in ("mass", "center_of_mass"):
        if key not in base:
            raise InputError(f"base.{key}: missing")
    mass = positive_number("base.mass", number_at("base.mass", base["mass"]))
    center_of_mass = vector_at("base.center_of_mass", base["center_of_mass"], d)
    gravity = vector_at("gravity", data["gravity"], d) if "gravity" in data else None
    inertia = base.get("inertia")
    if inertia is not None:
        refuse_non_numbers("base.inertia", inertia)
    try:
        support = Support(
            contacts, mass=mass, center_of_mass=center_of_mass, inertia=inertia, gravity=gravity
        )
        refuse_impossible_inertia(support)
    except InputError as error:
        message = str(error)
        raise InputError(f"base.{message}" if message.startswith(("inertia", "mass")) else message) from None
    return support


def _contacts(tables: list[dict[str, Any]]) -> list[Binding]:
    if not tables:
        raise InputError("contact: a scene needs at least one [[contact]]")
    contacts: list[Binding] = []
    for number, table in enumerate(tables, start=1):
        where = f"contact[{number}]"
        contacts.append(_contact(table, where, contacts[0].dimension if contacts else None))
    return contacts


def _contact(table: dict[str, Any], where: str, dimension: int | None) -> Binding:
    """One contact; dimension: that of the contacts before it, None for the first."""
    kinds = sorted(Binding.registry)
    if "kind" not in table:
        raise InputError(f"{where}.kind: missing; known: {', '.join(kinds)}")
    kind = table["kind"]
    if not isinstance(kind, str) or kind not in Binding.registry:
        raise InputError(f"{where}.kind: unknown kind {kind!r}{suggestion(kind, kinds)}")
    cls = Binding.registry[kind]
    parameters = {key: value for key, value in table.items() if key != "kind"}
    known = {field.name: field for field in fields(cls) if field.name in cls.parameter_names()}
    refuse_unknown(parameters, known, f"{where}.", also=("kind",))
    for key, field in known.items():
        if key not in parameters:
            if key == "position" or (field.default is MISSING and field.default_factory is MISSING):
                raise InputError(f"{where}.{key}: missing (needed by {kind})")
        elif not {"bool", "str"} & set(str(field.type).replace("|", " ").split()):
            refuse_non_numbers(f"{where}.{key}", parameters[key])
    position = parameters["position"]
    if dimension is not None and isinstance(position, list) and len(position) != dimension:
        raise InputError(
            f"{where}.position: expected {dimension} numbers like contact[1], got {len(position)}"
        )
    if isinstance(position, list) and len(position) == 2:
        parameters.setdefault("normal", [0.0, 1.0])
    try:
        return cls(**parameters)
    except InputError as error:
        raise InputError(f"{where}.{error}") from None


def _load(table: dict[str, Any], where: str, dimension: int) -> Load:
    refuse_unknown(table, _LOAD_KEYS, f"{where}.")
    if "force" not in table and "moment" not in table:
        raise InputError(f"{where}.force: missing (a load needs a force or a moment)")
    if "force" in table and "point" not in table:
        raise InputError(f"{where}.point: missing (where the force acts, m)")
    zero = np.zeros(dimension)
    force = vector_at(f"{where}.force", table["force"], dimension) if "force" in table else zero
    point = vector_at(f"{where}.point", table["point"], dimension) if "point" in table else zero
    if "moment" not in table:
        moment: Any = np.zeros(3) if dimension == 3 else 0.0
    elif dimension == 3:
        moment = vector_at(f"{where}.moment", table["moment"], 3)
    else:
        moment = number_at(f"{where}.moment", table["moment"])
    return Load(force=force, moment=moment, point=point)
