"""Limits of joints from a `joint_limits.yaml` of MoveIt, named states from an SRDF."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ocptip.basics.errors import InputError, doubt, number_from
from ocptip.basics.read import parse_xml, parse_yaml, read_text, read_xml_text
from ocptip.basics.text import some
from ocptip.robots.model import ArmModel

_LIMITS = {  # of a joint in the file: has_..._limits, whose numbers
    "position": ("min_position", "max_position"),
    "velocity": ("max_velocity",),
    "acceleration": ("max_acceleration", "max_deceleration"),
    "jerk": ("max_jerk",),
    "effort": ("max_effort",),
}
_NAMES = {"velocity": "speed", "acceleration": "acceleration", "jerk": "jerk", "effort": "torque"}
_SCALES = {"default_velocity_scaling_factor": "speed", "default_acceleration_scaling_factor": "acceleration"}

_APART = 1e-3
"""rad or m, by which joints that do not move may stand elsewhere in a named state."""


def with_joint_limits(arm: ArmModel, path: str | os.PathLike[str]) -> ArmModel:
    """The arm with the limits of a `joint_limits.yaml`, which replace those of its file.

    Of acceleration and deceleration the smaller one counts. A position limit counts where it is narrower. The
    default scaling factors of the file are for requests of MoveIt; a note says that they do not count here.

    Raises:
        InputError: the file cannot be read, or a value cannot be used; names the joint and its key.
    """
    file = Path(path)
    data = parse_yaml(read_text(file))
    table = data.get("joint_limits") if isinstance(data, dict) else None
    if not isinstance(table, dict):
        raise InputError(f"{file.name}: expected a table joint_limits, as in files of MoveIt")
    limits = arm.limits
    values = {name: np.array(getattr(limits, name)) for name in (*_NAMES.values(), "angle_min", "angle_max")}
    wider = []
    for joint in sorted(set(table) & set(arm.joint_names)):
        j = arm.joint_names.index(joint)
        given = {key: _numbers(table[joint], key, f"{file.name}: joint_limits.{joint}") for key in _LIMITS}
        if ends := given.pop("position"):
            values["angle_min"][j] = max(values["angle_min"][j], ends.get("min_position", -np.inf))
            values["angle_max"][j] = min(values["angle_max"][j], ends.get("max_position", np.inf))
        for key, numbers in given.items():
            if numbers:
                value = min(numbers.values())
                if not value > 0:
                    raise InputError(f"{file.name}: joint_limits.{joint}: {key} must be > 0, got {value:g}")
                wider += [f"{_NAMES[key]} of {joint}"] if value > values[_NAMES[key]][j] else []
                values[_NAMES[key]][j] = value
    notes = []
    if missing := [name for name in arm.joint_names if name not in table]:
        notes.append(f"{file.name} does not name {some(missing)}")
    if wider:
        notes.append(f"limits of {file.name} that are wider than the URDF's: {some(wider)}")
    for key, what in _SCALES.items():
        if (factor := data.get(key, 1.0)) != 1.0:
            notes.append(f"{key} {factor} of {file.name} does not count: the {what} limits are unscaled")
    return arm.with_limits(**values).with_notes(*notes)


def _numbers(joint: Any, key: str, where: str) -> dict[str, float]:
    """The numbers of a kind of limit that a joint has, by name; none if it does not say that it has them."""
    if not isinstance(joint, dict):
        raise InputError(f"{where}: expected a table, got {joint!r}")
    has = joint.get(f"has_{key}_limits", False)
    if not isinstance(has, bool):
        raise InputError(f"{where}.has_{key}_limits: expected true or false, got {has!r}")
    if not has:
        return {}
    numbers = {name: number_from(f"{where}.{name}", joint[name]) for name in _LIMITS[key] if name in joint}
    if not numbers:
        raise InputError(
            f"{where}: has_{key}_limits is true, but there is no {' and no '.join(_LIMITS[key])}"
        )
    return numbers


def named_states(path: str | os.PathLike[str]) -> dict[str, dict[str, float]]:
    """Joint values by name, rad or m, of each `group_state` of an SRDF; those of one name are united.

    Raises:
        InputError: the file cannot be read, or a value is no number.
    """
    try:
        tree = parse_xml(read_xml_text(path))
    except (InputError, ElementTree.ParseError) as error:
        raise InputError(f"{path}: not a readable SRDF: {getattr(error, 'text', error)}") from None
    states: dict[str, dict[str, float]] = {}
    for state in tree.iterfind("group_state"):
        values = states.setdefault(state.get("name", ""), {})
        for joint in state.iterfind("joint"):
            name, text = joint.get("name", ""), joint.get("value", "")
            try:
                values[name] = number_from("value", float(text))
            except ValueError:
                where = f"{Path(path).name}: group_state {state.get('name')!r}, joint {name!r}"
                raise InputError(f"{where}: expected one number, got {text!r}") from None
    return states


def values_of_state(arm: ArmModel, states: Mapping[str, Mapping[str, float]], name: str) -> np.ndarray:
    """(n,) rad or m, of the arm's joints in a named state.

    Raises:
        InputError: there is no such state, or it lacks a joint of the arm.

    Warns:
        InputWarning: joints that do not move stand elsewhere in this state.
    """
    if name not in states:
        listed = ", ".join(states) or "none; the key srdf in [arm] names the file that has them"
        raise InputError(f"no state {name!r}; there are {listed}")
    if lacking := [joint for joint in arm.joint_names if joint not in states[name]]:
        raise InputError(f"state {name!r} has no value for {', '.join(lacking)}")
    apart = [
        f"{joint} at {value:.4g}, locked at {arm.resting[joint]:.4g}"
        for joint, value in states[name].items()
        if abs(arm.resting.get(joint, value) - value) > _APART
    ]
    if apart:
        doubt(f"state {name!r} has {some(apart)} (rad, sliding joints m); give locked_deg, locked_m in [arm]")
    return np.array([states[name][joint] for joint in arm.joint_names])
