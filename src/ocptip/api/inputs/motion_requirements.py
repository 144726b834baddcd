"""Requirements of motions: which value of a checked motion or plan a requirement is about."""

from __future__ import annotations

from ocptip.api.inputs.requirements import Outcome, Requirement, read_requirements
from ocptip.basics.errors import InputError
from ocptip.motion.margins import (
    CLEARANCE,
    FOOT_FORCE,
    FRICTION,
    TIPPING,
    TORQUE,
    ZERO_MOMENT_POINT,
    MotionMargin,
)
from ocptip.motion.summary import CheckedMotion
from ocptip.standing.contact_margins import Margin

_DEVIATIONS = {
    "tilt": "tilt",
    "additional payload": "extra_mass",
    "push": "push",
    "friction loss": "friction",
    "overspeed": "faster",
    "delay": "delay",
}
_MARGINS = {
    "tipping margin": (TIPPING, 1.0),
    "friction used": (FRICTION, 100.0),
    "foot force": (FOOT_FORCE, 1.0),
    "zmp to edge": (ZERO_MOMENT_POINT, 1e3),
    "torque used": (TORQUE, 100.0),
    "clearance": (CLEARANCE, 1e3),
}
"""Margin by required quantity, and the unit of the requirement per unit of the margin."""


def motion_outcomes(checked_motion: CheckedMotion, text: str) -> tuple[Outcome, ...]:
    """Which requirements in a text a checked motion meets.

    Raises:
        InputError: one of them cannot be understood, or is not of a motion.
    """
    return tuple(_outcome(checked_motion, wanted) for wanted in read_requirements(text))


def _decides(margin: MotionMargin) -> Margin:
    """The value that counts: the worst case if it is known."""
    worst_case = margin.worst_case or margin.nominal
    assert worst_case is not None  # others are left out
    return worst_case


def _outcome(checked_motion: CheckedMotion, wanted: Requirement) -> Outcome:
    if wanted.name in ("duration", "energy"):
        return wanted.compared(getattr(checked_motion.check, wanted.name))
    if wanted.name in _MARGINS:
        name, scale = _MARGINS[wanted.name]
        known = [
            one for one in checked_motion.margins if one.name == name and (one.worst_case or one.nominal)
        ]
        if name == FOOT_FORCE:
            known = [one for one in known if not one.object]
        # Of base and objects the worst counts.
        sign = 1.0 if all(one.minimum for one in known) else -1.0
        margin = min(known, key=lambda one: sign * _decides(one).value, default=None)
        if margin is None:
            return wanted.compared(None)
        value, of = _decides(margin), f" of {margin.object}" if margin.object else ""
        note = f"{'worst case' if margin.worst_case else 'nominal'}{of}"
        time = "" if value.time is None else f", {max(value.time, 0.0):.3f} s"
        return wanted.compared(scale * value.value, note=note + time)
    if wanted.name not in _DEVIATIONS:
        raise InputError(f"require: {wanted.name}: not of a motion")
    checked_motion.task.robot.require_no_objects(f"require {wanted.name}")
    deviations = {one.quantity: one for one in checked_motion.robustness}
    one = deviations.get(_DEVIATIONS[wanted.name])
    if one is None:
        return wanted.compared(None)
    value = 100 * (1 - one.value) if wanted.name == "friction loss" else one.value
    note = "" if one.at_most else f"{one.how}, {one.time:.3f} s".removeprefix(", ")
    return wanted.compared(value, at_least=one.at_most, note=note)
