"""A scene file: a support and its loads in TOML, see docs/scenes.md.

Contacts and loads are counted from 1 in every message, as in the printed table. Every error is one
:class:`InputError` that starts with the file and the key, e.g.
`scene.toml: contact[2].friction: must be > 0, got -0.5`.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from typing import Any

import numpy as np

from ocptip.basics.toml import Source, Table
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Load, Support, refuse_impossible_inertia
from ocptip.standing.tolerance import NONE, Tolerance
from ocptip.task_files.doubts import doubt_units
from ocptip.task_files.kinds import require_kind
from ocptip.task_files.tolerance import tolerance_of

SCENE = ("gravity", "base", "contact")
"""What :func:`read_support` reads of a file."""

_DAMPING = ("damping_ratio", "damping")
_COMMON = ("friction", "stiffness", "tangential_stiffness", *_DAMPING)  # of all contacts without their own


@dataclass(frozen=True)
class Scene:
    """A base on its contacts with everything that acts on it.

    Attributes:
        name: for messages and titles; that of the file by default.
        support: the base on its contacts.
        loads: the loads besides the base's own weight.
        wrench: weight and loads about the base's centre of mass, N and N m, base axes; (6,), planar (3,).
        tolerance: how far base and floor may be off.
    """

    name: str
    support: Support
    loads: tuple[Load, ...]
    wrench: np.ndarray
    tolerance: Tolerance = NONE

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
    with Table.read(source, name) as data:
        require_kind(data, "stand")
        doubt_units(data)
        data.close("name", *SCENE, "load", "tolerance")
        name, support = data.text("name", data.file), read_support(data)
        loads = tuple(_load(table, support.dimension) for table in data.tables("load"))
        tolerance = tolerance_of(data)
        return Scene(name, support, loads, support.wrench(loads), tolerance)


def read_support(data: Table) -> Support:
    """The support of a file, out of `SCENE`.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    base = data.table("base")
    common = {name: base.raw_numbers(name, None) for name in _COMMON}
    contacts: list[Binding] = _feet(base, common) if "feet" in base else []
    tables = data.tables("contact")
    if not contacts and not tables:
        for key in ("mass", "center_of_mass"):
            base.value(key)
        base.require("feet", "where it stands, m; or [[contact]]")
        base.close("inertia")
    for table in tables:
        contacts.append(_contact(table, common, contacts[0].dimension if contacts else None))
    d = contacts[0].dimension
    support = base.make(
        Support,
        contacts,
        mass=base.number("mass", bound="> 0"),
        center_of_mass=base.vector("center_of_mass", d),
        inertia=base.raw_numbers("inertia", None),
        gravity=data.vector("gravity", d, None),
    )
    with base.at():
        refuse_impossible_inertia(support)
    return support


def _feet(base: Table, common: dict[str, Any]) -> list[Binding]:
    """Ordinary contacts at the positions `feet` of `[base]`."""
    base.require("friction", "of the feet")
    feet = base.raw_numbers("feet")
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


def _contact(table: Table, common: dict[str, Any], dimension: int | None) -> Binding:
    """One contact.

    Args:
        table: of it.
        common: parameters of contacts that have none of their own, by key.
        dimension: that of the contacts before it, None for the first.
    """
    kind = table.choice("kind", sorted(Binding.registry), "unilateral")
    cls = Binding.registry[kind]
    own = {key: None for key in _DAMPING if any(other in table for other in _DAMPING)}
    parameters = {field.name: {**common, **own}.get(field.name) for field in fields(cls)}
    for field in fields(cls):
        needed = field.default is MISSING and field.default_factory is MISSING
        if field.init and needed and parameters.get(field.name) is None:
            table.require(field.name, f"needed by {kind}")
        if field.init:
            words = {"bool", "str"} & set(str(field.type).replace("|", " ").split())
            read = table.value if words else table.raw_numbers
            parameters[field.name] = read(field.name, parameters.get(field.name))
    table.close()
    parameters = _given(parameters)
    position = parameters["position"]
    size = len(position) if isinstance(position, list) else None
    if dimension is not None and size not in (None, dimension):
        raise table.error(f"expected {dimension} numbers like contact[1], got {size}", "position")
    if size == 2:
        parameters.setdefault("normal", [0.0, 1.0])
    return table.make(cls, **parameters)


def _load(table: Table, d: int) -> Load:
    if "force" not in table and "moment" not in table:
        table.require("force", "a load needs a force or a moment")
    if "force" in table:
        table.require("point", "where the force acts, m")
    zero = np.zeros(d)
    moment = table.vector("moment", 3, np.zeros(3)) if d == 3 else table.number("moment", 0.0)
    return table.make(
        Load, force=table.vector("force", d, zero), moment=moment, point=table.vector("point", d, zero)
    )
