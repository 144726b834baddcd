"""Requirements such as `tilt >= 5 deg, friction used <= 80 %`: are they met, and what is the value?

They make a check of a robot description fail in a pipeline, before anybody drives the robot.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite, isnan, pi
from typing import Any
from xml.etree import ElementTree

from ocptip.basics.errors import InputError
from ocptip.basics.text import did_you_mean, quantity
from ocptip.basics.write import MARK
from ocptip.standing.tolerance import Uncertainty

AT_LEAST, AT_MOST = ">=", "<="
PAYLOAD = "additional payload"
"""Beyond what is held; the payload in total is another number."""
UNITS = {
    "tilt": ("deg", AT_LEAST),
    PAYLOAD: ("kg", AT_LEAST),
    "push": ("N", AT_LEAST),
    "base push": ("N", AT_LEAST),
    "friction loss": ("%", AT_LEAST),
    "overspeed": ("%", AT_LEAST),
    "delay": ("ms", AT_LEAST),
    "tipping margin": ("N m", AT_LEAST),
    "friction used": ("%", AT_MOST),
    "foot force": ("N", AT_LEAST),
    "zmp to edge": ("mm", AT_LEAST),
    "torque used": ("%", AT_MOST),
    "clearance": ("mm", AT_LEAST),
    "duration": ("s", AT_MOST),
    "energy": ("J", AT_MOST),
}
"""Unit and comparison by name of the quantity. The first seven are deviations, each alone."""

_AT_REST: dict[str, Callable[[float], Uncertainty]] = {
    "tilt": lambda x: Uncertainty(tilt=x * pi / 180),
    PAYLOAD: lambda x: Uncertainty(extra_mass=x),
    "push": lambda x: Uncertainty(push=x),
    "base push": lambda x: Uncertainty(base_push=x),
    "friction loss": lambda x: Uncertainty(friction=x / 100),
}
"""The uncertainty of a base at rest that has this deviation only."""

_ONE = re.compile(
    r"\s*(?P<name>[A-Za-z][A-Za-z ]*?)\s*(?P<sign>[<>]=?|=+)\s*"
    r"(?P<value>[+-]?[\d.]+(?:[eE][+-]?\d+)?|\w+)\s*(?P<unit>%|[A-Za-z][A-Za-z /^\d]*)?\s*"
)


@dataclass(frozen=True)
class Requirement:
    """A bound on a quantity.

    Attributes:
        name: one of `UNITS`.
        bound: in the unit of that.
    """

    name: str
    bound: float

    def __str__(self) -> str:
        unit, sign = UNITS[self.name]
        return f"{self.name} {sign} {self.bound:g} {unit}"

    def compared(self, value: float | None, *, at_least: bool = False, note: str = "") -> Outcome:
        """Whether a value meets it; None: the value is not known, which does not."""
        if value is None or isnan(value):
            return Outcome(self, None, False, note or "not known")
        met = value >= self.bound if UNITS[self.name][1] == AT_LEAST else value <= self.bound
        return Outcome(self, value, met, note, at_least)


@dataclass(frozen=True)
class Outcome:
    """The result of testing a requirement.

    Attributes:
        requirement: that.
        value: of the quantity, in its unit; None: not known.
        met: whether it is met.
        note: where the value is, or what is missing.
        at_least: the quantity is at least `value`; more was not checked.
    """

    requirement: Requirement
    value: float | None
    met: bool
    note: str = ""
    at_least: bool = False

    def __str__(self) -> str:
        unit = UNITS[self.requirement.name][0]
        value = "-" if self.value is None else f"{'>= ' * self.at_least}{quantity(self.value, unit, 3)}"
        note = f" ({self.note})" if self.note else ""
        return f"{self.requirement}: {value}{note}   {'met' if self.met else 'NOT MET'}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        (unit, sign), name = UNITS[self.requirement.name], self.requirement.name
        bound = {"name": name, "sign": sign, "bound": self.requirement.bound, "unit": unit}
        return {**bound, "value": self.value, "at_least": self.at_least, "met": self.met, "note": self.note}


def read_requirements(text: str) -> tuple[Requirement, ...]:
    """Requirements in a text, with commas or semicolons between them.

    Raises:
        InputError: it has none, or one with an unknown quantity, another unit or another comparison.
    """
    parts = [part for part in re.split(r"[,;]", text) if part.strip()]
    if not parts:
        raise InputError("require: is empty; expected for example 'tilt >= 5 deg, push >= 20 N'")
    return tuple(map(_requirement, parts))


def _requirement(text: str) -> Requirement:
    match = _ONE.fullmatch(text)
    if match is None:
        names = ", ".join(UNITS)
        raise InputError(f"require: expected NAME >= NUMBER UNIT, got {text.strip()!r}; names: {names}")
    name = " ".join(match["name"].lower().split())
    if name not in UNITS:
        raise InputError(
            f"require: no quantity {name!r}{did_you_mean(name, UNITS)}; known: {', '.join(UNITS)}"
        )
    unit, sign = UNITS[name]
    if match["sign"] != sign:
        raise InputError(f"require: {name}: expected {sign}, got {match['sign']}")
    if (match["unit"] or "").replace(" ", "") != unit.replace(" ", ""):
        raise InputError(f"require: {name}: expected the unit {unit}, got {match['unit'] or 'none'}")
    try:
        bound = float(match["value"])
    except ValueError:
        raise InputError(f"require: {name}: expected a number, got {match['value']!r}") from None
    if not (isfinite(bound) and bound >= 0):
        raise InputError(f"require: {name}: must be finite and >= 0, got {match['value']}")
    return Requirement(name, bound)


def deviation(requirement: Requirement) -> Uncertainty:
    """The uncertainty of a base at rest that is the deviation of a requirement alone.

    Raises:
        InputError: the quantity is none of a base at rest, or its bound is none of an uncertainty.
    """
    if requirement.name not in _AT_REST:
        raise InputError(f"require: {requirement.name}: not of a base at rest")
    return _AT_REST[requirement.name](requirement.bound)


def outcomes_to_dict(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The entry of answers in JSON; empty where nothing is required."""
    return {"requirements": [one.to_dict() for one in outcomes]} if outcomes else {}


def junit(name: str, verdict: str, good: bool, outcomes: Sequence[Outcome]) -> str:
    """A report for pipelines: one test case for the verdict, one per requirement.

    Args:
        name: of what was checked.
        verdict: headline.
        good: whether it is stable and keeps its limits.
        outcomes: of the requirements.
    """
    cases = [("verdict", good, verdict), *((str(o.requirement), o.met, str(o)) for o in outcomes)]
    failures = sum(not met for _, met, _ in cases)
    suite = ElementTree.Element("testsuite", name=name, tests=str(len(cases)), failures=str(failures))
    ElementTree.SubElement(ElementTree.SubElement(suite, "properties"), "property", name="by", value=MARK)
    for title, met, text in cases:
        case = ElementTree.SubElement(suite, "testcase", classname=name, name=title)
        if not met:
            ElementTree.SubElement(case, "failure", message=" ".join(text.split()))
        ElementTree.SubElement(case, "system-out").text = text
    ElementTree.indent(suite)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(suite, encoding="unicode")}\n'
