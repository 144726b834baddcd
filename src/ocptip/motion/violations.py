"""Titles of worst values, and sentences on broken limits: for people in N m, % and mm, for JSON with names.

A broken limit is a `Worst`. In JSON it is `GN_stop is 0.95 at 1.2 s, must be <= 0.9`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from ocptip.basics.text import quantity
from ocptip.reserves.tipping import moment_at
from ocptip.standing.limit_kinds.limit import Worst
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
    "jump_foot_force_N": "force on a compliant foot at acceleration steps",
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
_OF_CONTACTS = {
    f"{step}{index}{scenario}": (index, f"{at_steps}{when}")
    for step, at_steps in (("", ""), ("jump_", " at acceleration steps"))
    for index in _QUANTITIES
    for scenario, when in _WHEN.items()
}
"""Index and circumstances, by the names of results."""
_UNITS = {
    "_ratio": ("%", 100.0),
    "_m_s": ("m/s", 1.0),
    "_deg": ("deg", 1.0),
    "_m": ("mm", 1e3),
    "_N": ("N", 1.0),
}
_STATED = {"GN": "tip_over_index", "GT": "friction_utilisation"}


def result_unit(name: str) -> tuple[str, float]:
    """The unit of a result for people, and its factor; empty and 1 for pure numbers and further limits."""
    result = _parted(name)[0] if name.partition("[")[0] in RESULT_TITLES else ""
    return next(
        (unit_of for end, unit_of in _UNITS.items() if end in result and unit_of[0] != "%"), ("", 1.0)
    )


def result_title(name: str) -> str:
    """The title of a worst value: of `GN[glass]` that of GN and of what."""
    name, of = _parted(name)
    return f"{RESULT_TITLES.get(name, name)}{of and f' of {of}'}"


def quantity_title(name: str) -> str:
    """The same, with the quantity that people read instead of its index: "tipping margin in cancels"."""
    result, of = _parted(name)
    if result not in _OF_CONTACTS:
        return result_title(name)
    index, when = _OF_CONTACTS[result]
    return f"{_QUANTITIES[index]}{of and f' of {of}'}{when}"


def _parted(name: str) -> tuple[str, str]:
    """The result, and the object that it is of; empty: the base."""
    result, _, of = name.partition("[")
    return result, of[:-1]


def statement(text: str) -> Worst:
    """What is broken and has no value, in words."""
    return Worst("", math.nan, math.nan, math.nan, text, math.inf)


def stated(violations: Iterable[Worst]) -> list[str]:
    """Sentences on broken limits for JSON, with the names of the indices instead of their symbols."""
    return [sentence(violation, _OF_CONTACTS.get(violation.name, ("",))[0]) for violation in violations]


def sentence(broken: Worst, index: str = "") -> str:
    """A broken limit, by the name of its result, or with the name of this index instead of its symbol."""
    if not broken.name:
        return broken.detail
    sign, shown, limit = _sign(broken), _plain(broken, broken.value), _plain(broken, broken.limit)
    if shown == limit and not broken.unit:
        shown = f"{limit} {'-' if broken.least else '+'} {broken.excess:.1g}"
    name = broken.name.replace(index, _STATED[index]) if index else broken.name
    return f"{name} is {shown}{_where(broken)}, must be {sign} {limit}"


def broken_words(robot: StandingMechanism, violations: Iterable[Worst]) -> list[str]:
    """Sentences on broken limits for people, of a robot whose base and objects the indices are of.

    Beyond 1 an index measures no margin: then the sentence says what tips or slips.
    """
    return [_words(robot, broken) for broken in violations]


def _words(robot: StandingMechanism, broken: Worst) -> str:
    if not broken.name:
        return broken.detail
    (result, of), where, sign = _parted(broken.name), _where(broken), _sign(broken)
    values = [broken.value, broken.limit]
    if result not in _OF_CONTACTS:
        title = result_title(broken.name).removesuffix(" / limit").replace(" / limit,", ",")
        unit, scale = next((unit_of for end, unit_of in _UNITS.items() if end in result), (broken.unit, 1.0))
        values = [scale * value for value in values]
    else:
        index, when = _OF_CONTACTS[result]
        when = "" if broken.scenario else when
        if broken.value >= 1:
            return f"{of or 'the base'} {'tips' if index == 'GN' else 'slips'}{when}{where}"
        title = f"{_QUANTITIES[index]}{of and f' of {of}'}{when}"
        unit, values = "%", [100 * value for value in values]
        if index == "GN":
            footing = next((unit_of for unit_of in robot.interfaces if unit_of.name == of), robot)
            reference = footing.tip_over.reference_moment
            unit, sign = "N m", ">="
            values = [moment_at(value, reference) for value in (broken.value, broken.limit)]
    digits = next((d for d in (4, 6) if _shown(values[0], unit, d) != _shown(values[1], unit, d)), 4)
    shown, asked = (_shown(value, unit, digits) for value in values)
    if shown == asked or _plain(broken, broken.value) == _plain(broken, broken.limit):
        shown = f"just {'below' if sign == '>=' else 'above'} {asked}"
    return f"{title} is {shown}{where}, must be {sign} {asked}"


def _shown(value: float, unit: str, digits: int) -> str:
    return quantity(value, unit, digits).rstrip()


def _plain(broken: Worst, value: float) -> str:
    return f"{value:.1f} {broken.unit}" if broken.unit else f"{value:.4g}"


def _sign(broken: Worst) -> str:
    return ">=" if broken.least else "<="


def _where(broken: Worst) -> str:
    """When, and in which circumstances: " at 1.2 s (joint 2)", " in a cancel begun at 0.1 s"."""
    time = f"{broken.time:.4f} s" if math.isfinite(broken.time) else ""
    if broken.scenario:
        return f" in a {broken.scenario}{time and f' begun at {time}'}{broken.detail}"
    return f"{time and f' at {time}'}{broken.detail and f' ({broken.detail})'}"
