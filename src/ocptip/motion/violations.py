"""Titles of worst values, and sentences on broken limits: for people in N m, % and mm, for JSON with names.

A check says `GN_stop is 0.95 at 1.2 s, must be <= 0.9`, see `Worst.violation`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from ocptip.basics.text import quantity
from ocptip.reserves.tipping import moment_at
from ocptip.standing.limits import CLEARANCE_WITHIN, SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN
from ocptip.standing.mechanism import StandingMechanism

RESULT_TITLES = {
    "GN": "tip-over GN",
    "GT": "slip GT",
    "jump_GN": "GN at acceleration steps",
    "jump_GT": "GT at acceleration steps",
    TIP_WITHIN: "tip-over GN, worst case",
    SLIP_WITHIN: "slip GT, worst case",
    "GN_stop": "GN in stops on the path",
    "GT_stop": "GT in stops on the path",
    "GN_brakes": "GN in stops by brakes",
    "GT_brakes": "GT in stops by brakes",
    "GN_cancel": "GN when cancelled",
    "GT_cancel": "GT when cancelled",
    "GN_cancel_worst_case": "GN when cancelled, worst case",
    "GT_cancel_worst_case": "GT when cancelled, worst case",
    "angle_margin_deg_cancel": "angle margin when cancelled",
    "position_margin_m_cancel": "position margin when cancelled",
    "duration_s_cancel": "duration when cancelled",
    "torque_ratio": "torque / limit",
    TORQUE_WITHIN: "torque / limit, worst case",
    "clearance_m": "clearance",
    f"{CLEARANCE_WITHIN}_m": "clearance, worst case",
    "foot_force_N": "force on a compliant foot",
    "jump_foot_force_N": "the same at acceleration steps",
    "foot_lift_m": "lift of a compliant foot",
    "GN_gears": "GN, elastic joints",
    "GT_gears": "GT, elastic joints",
    "speed_ratio": "speed / limit",
    "acceleration_ratio": "acceleration / limit",
    "jerk_ratio": "jerk / limit",
    "angle_margin_deg": "angle margin",
    "position_margin_m": "position margin",
    "singularity": "distance from singular poses",
    "motor_speed": "motor speed",
    "tcp_speed_m_s": "TCP speed",
    "point_speed_m_s": "speed of a point",
}
"""Titles of worst values by their names in `MotionCheck.worst`."""


_CONTACT = re.compile(r"(?P<step>jump_)?(?P<symbol>GN|GT)(?P<scenario>_[a-z_]+)?")
_QUANTITIES = {"GN": "tipping margin", "GT": "friction used"}
_WHEN = {
    "": "",
    "_worst_case": " in the worst case",
    "_stop": " in stops on the path",
    "_brakes": " in stops by brakes",
    "_cancel": " in cancels",
    "_cancel_worst_case": " in cancels in the worst case",
    "_gears": " with elastic joints",
}
_UNITS = {
    "_ratio": ("%", 100.0),
    "_m_s": ("m/s", 1.0),
    "_deg": ("deg", 1.0),
    "_m": ("mm", 1e3),
    "_N": ("N", 1.0),
}
_SENTENCE = re.compile(
    r"(?P<name>\w+)(\[(?P<of>.+?)\])? is (?P<value>[^\s,]+)(?P<just> [+-] [^\s,]+)?(?P<where>.*), "
    r"must be (?P<sign>[<>]=) (?P<limit>[^\s,()]+)(?P<more>.*)"
)
_INDEX = re.compile(r"(?<![A-Za-z])(GN|GT)(?=(?:_[a-z_]+)? is\b)")
_STATED = {"GN": "tip_over_index", "GT": "friction_utilisation"}


def result_title(name: str) -> str:
    """The title of a worst value: of `GN[glass]` that of GN and of what."""
    name, _, of = name.partition("[")
    return f"{RESULT_TITLES.get(name, name)}{of and f' of {of[:-1]}'}"


def quantity_title(name: str) -> str:
    """The same, with the quantity that people read instead of its index: "tipping margin in cancels"."""
    result, _, of = name.partition("[")
    if (known := _CONTACT.fullmatch(result)) is None:
        return result_title(name)
    return f"{_QUANTITIES[known['symbol']]}{of and f' of {of[:-1]}'}{_when(known)}"


def stated(violations: Iterable[str]) -> list[str]:
    """Sentences on broken limits for JSON, with the names of the indices instead of their symbols."""
    return [_INDEX.sub(lambda found: _STATED[found[1]], text) for text in violations]


def broken_words(robot: StandingMechanism, violations: Iterable[str]) -> list[str]:
    """Sentences on broken limits for people, of a robot whose base and objects the indices are of.

    Beyond 1 an index measures no margin: then the sentence says what tips or slips.
    """
    return [_words(robot, text) for text in violations]


def _words(robot: StandingMechanism, text: str) -> str:
    if (found := _SENTENCE.fullmatch(text)) is None:
        return text
    value, limit, name, of = float(found["value"]), float(found["limit"]), found["name"], found["of"]
    where, more = found["where"], found["more"]
    known = _CONTACT.fullmatch(name)
    if known is None:
        title = result_title(name).removesuffix(" / limit").replace(" / limit,", ",")
        unit, scale = next((own for end, own in _UNITS.items() if end in name), ("", 1.0))
        values, sign = [scale * value, scale * limit], found["sign"]
    else:
        when = "" if where.startswith(" in a ") else _when(known)
        if value >= 1:
            does = "tips" if known["symbol"] == "GN" else "slips"
            return f"{of or 'the base'} {does}{when}{where}{more}"
        title = f"{_QUANTITIES[known['symbol']]}{f' of {of}' if of else ''}{when}"
        unit, values, sign = "%", [100 * value, 100 * limit], found["sign"]
        if known["symbol"] == "GN":
            footing = next((own for own in robot.interfaces if own.name == of), robot)
            reference = footing.tip_over.reference_moment
            unit, values, sign = "N m", [moment_at(index, reference) for index in (value, limit)], ">="
    digits = next((d for d in (4, 6) if _shown(values[0], unit, d) != _shown(values[1], unit, d)), 4)
    shown, asked = (_shown(own, unit, digits) for own in values)
    if found["just"] or shown == asked:
        shown = f"just {'below' if sign == '>=' else 'above'} {asked}"
    return f"{title} is {shown}{where}, must be {sign} {asked}{more}"


def _shown(value: float, unit: str, digits: int) -> str:
    return quantity(value, unit, digits).rstrip()


def _when(known: re.Match[str]) -> str:
    when = _WHEN.get(known["scenario"] or "", known["scenario"] or "")
    return f" at acceleration steps{when}" if known["step"] else when
