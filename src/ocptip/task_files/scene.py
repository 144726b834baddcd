"""A scene file: a support and its loads in TOML, see docs/scenes.md.

Contacts and loads are counted from 1 in every message, as in the printed table. Every error is one
:class:`InputError` that starts with the file and the key, e.g.
`scene.toml: contact[2].friction: must be > 0, got -0.5`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, replace
from functools import cache
from inspect import getdoc
from typing import Any

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import REQUIRED, Key, Keys
from ocptip.basics.toml import Source, Table
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Load, Support, refuse_impossible_inertia
from ocptip.numerics.inertia import ROUNDED, symmetric_matrix, union, why_impossible
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.doubts import doubt_units, require_kind
from ocptip.task_files.tables.tolerance import TOLERANCE, tolerance_of

_DAMPING = ("damping_ratio", "damping")
_COMMON = ("friction", "stiffness", "tangential_stiffness", *_DAMPING)  # of all contacts without their own
_TYPES = {"bool": "boolean", "str": "string", "Sequence": "array", "int": "integer"}  # else number
_TYPE_WORDS = {
    "boolean": "true or false",
    "string": "text",
    "array": "list of numbers",
    "integer": "whole number",
    "number": "number",
}


@cache
def contact_keys(model: type[Binding]) -> dict[str, Key]:
    """Keys of a contact, which are the fields of its contact model; their meanings stand in its docstring."""
    meanings: dict[str, str] = {}
    for cls in reversed(model.__mro__):
        _, _, attributes = (getdoc(cls) or "").partition("Attributes:\n")
        for names, meaning in re.findall(r"^    ([a-z_, ]+): ((?:.|\n     )+)", attributes, re.MULTILINE):
            meanings |= dict.fromkeys(names.split(", "), re.split(r"[.;] ", " ".join(meaning.split()))[0])
    return {
        field.name: _contact_key(field, meanings.get(field.name, field.name))
        for field in fields(model)
        if field.init
    }


def _contact_key(field: Field[Any], meaning: str) -> Key:
    kind = next((kind for word, kind in _TYPES.items() if word in str(field.type)), "number")
    needed = field.default is MISSING and field.default_factory is MISSING
    default = REQUIRED if needed and field.name not in _COMMON else None
    otherwise = "" if needed or field.default in (None, MISSING) else f"{field.default}".strip("()")
    meaning = f"{meaning[0].upper()}{meaning[1:].rstrip('.')}."
    form: dict[str, Any] = {"type": kind, "items": {"type": "number"}} if kind == "array" else {"type": kind}
    if kind in ("boolean", "string"):
        return schema.anything(meaning, _TYPE_WORDS[kind], form, default=default, otherwise=otherwise)
    key = schema.numbers(meaning, words=_TYPE_WORDS[kind], default=default, otherwise=otherwise)
    return replace(key, schema=form)


def _contact_kinds() -> Mapping[str, Keys]:
    """Keys by contact model; third-party models register while a program runs."""
    kind = {"kind": schema.choice("The contact model.", sorted(Binding.registry), default="unilateral")}
    return {
        name: Keys(
            f"contact {name}", (getdoc(model) or name).splitlines()[0], {**kind, **contact_keys(model)}
        )
        for name, model in sorted(Binding.registry.items())
    }


GRAVITY = schema.vector(
    "Acceleration of gravity, base axes; a slope is a tilted gravity.",
    "m/s^2",
    default=None,
    otherwise="9.81 against the last axis",
)
_ADDED = Keys(
    "added mass",
    "A mass fixed to the base, such as a battery or a control cabinet.",
    {
        "mass": schema.number("Mass.", "kg", bound="> 0"),
        "center_of_mass": schema.vector("Centre of mass, base axes.", "m", 3),
        "inertia": schema.numbers("Inertia about its centre of mass.", "kg m^2", otherwise="point mass"),
    },
)
BASE = Keys(
    "base of a scene",
    "What stands on the contacts; its origin is free, z points upwards.",
    {
        "mass": schema.number("Mass of the base with the links that do not move.", "kg", bound="> 0"),
        "center_of_mass": schema.vector("Centre of mass; two numbers make a planar scene.", "m"),
        "inertia": schema.numbers(
            "About the centre of mass: principal values, xx xy xz yy yz zz, or matrix.",
            "kg m^2",
            default=None,
            otherwise="estimated",
        ),
        "feet": schema.numbers(
            "Positions of ordinary contacts, before those of [[contact]].",
            "m",
            words="list of positions",
            default=None,
            otherwise="[[contact]]",
        ),
        **{
            key: replace(contact_keys(UnilateralContact)[key], otherwise="of each contact") for key in _COMMON
        },
        "added": schema.tables(_ADDED),
    },
)
CONTACT = Keys(
    "contact",
    "A contact of the base with the ground.",
    by="kind",
    variants=_contact_kinds,
    usual="unilateral",
)
_PLANAR_MOMENT = schema.number("Moment, planar.", "N m")
_SPATIAL_MOMENT = schema.vector("Moment; planar: a number, positive from x to y.", "N m", 3, default=None)
LOAD = Keys(
    "load",
    "A load on the base besides its weight.",
    {
        "force": schema.vector("Force, base axes.", "N", otherwise="none"),
        "point": schema.vector("Point where the force acts, base axes.", "m", default=None),
        "moment": replace(
            _SPATIAL_MOMENT,
            words="list of 3 numbers; planar: a number",
            schema={"anyOf": [_PLANAR_MOMENT.schema, _SPATIAL_MOMENT.schema]},
            convert=lambda value, d: (_PLANAR_MOMENT if d == 2 else _SPATIAL_MOMENT).convert(value, None),
            otherwise="none",
        ),
    },
)
SCENE = Keys(
    "scene",
    "A base on its contacts with the loads on it: `ocptip stand`.",
    {
        "name": schema.text("Title.", otherwise="name of the file"),
        "gravity": GRAVITY,
        "base": schema.table(BASE),
        "contact": schema.tables(CONTACT),
        "load": schema.tables(LOAD),
        "tolerance": schema.table(TOLERANCE, default=None),
    },
)


@dataclass(frozen=True)
class Scene:
    """A base on its contacts with everything that acts on it.

    Attributes:
        name: for messages and titles; that of the file by default.
        support: the base on its contacts.
        loads: the loads besides the weight of the base.
        wrench: weight and loads about the base's centre of mass, N and N m, base axes; (6,), planar (3,).
        tolerance: how far base and floor may be off.
    """

    name: str
    support: Support
    loads: tuple[Load, ...]
    wrench: np.ndarray
    tolerance: Uncertainty = NONE

    @property
    def planar(self) -> bool:
        """True for a scene in the plane."""
        return self.support.dimension == 2


def read_scene(source: Source, name: str = "scene") -> Scene:
    """Read a scene file.

    Args:
        source: the file, or its content.
        name: put in front of every message about content.

    Raises:
        InputError: the file cannot be read or describes no scene; one line that names file and key.
    """
    with Table.read(source, SCENE, name) as data:
        require_kind(data, "stand")
        doubt_units(data)
        data.close(early=True)
        name, support = data.get("name", data.file), read_support(data)
        loads = tuple(_load(table, support.dimension) for table in data.tables("load"))
        tolerance = tolerance_of(data)
        return Scene(name, support, loads, support.wrench(loads), tolerance)


def read_support(data: Table) -> Support:
    """The support of a file: `gravity`, `[base]` and `[[contact]]`."""
    base = data.table("base")
    common = {name: base[name] for name in _COMMON}
    contacts: list[Binding] = _feet(base, common) if "feet" in base else []
    tables = data.tables("contact")
    if not contacts and not tables:
        for key in ("mass", "center_of_mass"):
            base.get(key)
        base.require("feet", "where it stands, m; or [[contact]]")
        base.close(early=True)
    for table in tables:
        contacts.append(_contact(table, base, common, contacts[0].dimension if contacts else None))
    d = contacts[0].dimension
    mass, centre, inertia = base["mass"], base.get("center_of_mass", size=d), base["inertia"]
    for table in base.tables("added"):
        with base.at("inertia"):
            mass, centre, inertia = _with_added(table, mass, centre, inertia)
    support = base.make(
        Support,
        contacts,
        mass=mass,
        center_of_mass=centre,
        inertia=inertia,
        gravity=data.get("gravity", size=d),
    )
    with base.at():
        refuse_impossible_inertia(support)
    return support


def _with_added(table: Table, mass: float, centre: np.ndarray, inertia: Any) -> tuple[float, np.ndarray, Any]:
    """Mass, centre of mass and inertia, if it is given, of a base with one more mass."""
    if len(centre) != 3:
        raise table.error("masses can be added to spatial bases only")
    added, about = (table["mass"], table["center_of_mass"]), table.get("inertia", np.zeros(3))
    about = table.make(symmetric_matrix, about)
    if reason := why_impossible(about, ROUNDED * np.abs(about).max()):
        raise table.error(reason, "inertia")
    before = np.zeros((3, 3)) if inertia is None else symmetric_matrix(inertia)
    whole, middle, result = union((mass, centre, before), (*added, about))
    return whole, middle, None if inertia is None else result


def _feet(base: Table, common: dict[str, Any]) -> list[Binding]:
    """Ordinary contacts at the positions `feet` of `[base]`."""
    base.require("friction", "of the feet")
    feet = base["feet"]
    if not isinstance(feet, list) or not feet or not all(isinstance(position, list) for position in feet):
        raise base.error(f"expected a list of positions, got {feet!r}", "feet")
    given = {"friction": 1.0, **_given(common)}  # missing: refused when the table is closed
    with base.at("feet"):
        return [
            UnilateralContact(position=position, normal=[0.0] * (len(position) - 1) + [1.0], **given)
            for position in feet
        ]


def _given(parameters: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in parameters.items() if value is not None}


def _contact(table: Table, base: Table, common: dict[str, Any], dimension: int | None) -> Binding:
    """One contact.

    Args:
        table: of it.
        base: that of the base, whose keys are named where the contact has none of that name.
        common: parameters of contacts that do not set them, by key.
        dimension: that of the contacts before it, None for the first.
    """
    kind = table["kind"]
    cls = Binding.registry[kind]
    damping = {key: None for key in _DAMPING if any(other in table for other in _DAMPING)}
    parameters = {field.name: {**common, **damping}.get(field.name) for field in fields(cls)}
    for field in fields(cls):
        needed = field.default is MISSING and field.default_factory is MISSING
        if field.init and needed and parameters.get(field.name) is None:
            table.require(field.name, f"needed by {kind}")
        if field.init:
            parameters[field.name] = table.get(field.name, parameters.get(field.name))
    table.close()
    parameters = _given(parameters)
    position = parameters["position"]
    size = len(position) if isinstance(position, list) else None
    if dimension is not None and size not in (None, dimension):
        raise table.error(f"expected {dimension} numbers like contact[1], got {size}", "position")
    if size == 2:
        parameters.setdefault("normal", [0.0, 1.0])
    with table.at(), base.at(None), table.at(None):
        return cls(**parameters)


def _load(table: Table, d: int) -> Load:
    if "force" not in table and "moment" not in table:
        table.require("force", "a load needs a force or a moment")
    if "force" in table:
        table.require("point", "where the force acts, m")
    zero = np.zeros(d)
    moment = table.get("moment", np.zeros(3) if d == 3 else 0.0, size=d)
    force, point = (table.get(key, zero, size=d) for key in ("force", "point"))
    return table.make(Load, force=force, moment=moment, point=point)
