"""The `[motors]` table of task files."""

from __future__ import annotations

from typing import Any

from ocptip.basics.toml import number_at, per_joint_at, refuse_unknown, required, with_place
from ocptip.robots.motors import DCMotors

MOTOR_KEYS = {
    "modular": (),
    "estimated": ("standby", "regeneration"),
    "dc": (
        "motor_constant",
        "resistance",
        "torque_constant",
        "gear_ratio",
        "coulomb",
        "viscous",
        "standby",
        "regeneration",
    ),
}


def dc_motors(table: dict[str, Any], n: int) -> DCMotors:
    """DC motors of n joints."""
    values = {
        key: number_at(f"motors.{key}", value)
        if key == "regeneration"
        else per_joint_at(f"motors.{key}", value, n, zero_allowed=True)
        for key, value in table.items()
        if key != "kind"
    }
    datasheet = "motor_constant" not in values
    needed = ("resistance", "torque_constant", "gear_ratio") if datasheet else ("motor_constant",)
    for key in (*needed, "coulomb", "viscous", "standby"):
        required(values, key, "motors")
    refuse_unknown(values, (*needed, "coulomb", "viscous", "standby", "regeneration"), "motors.")
    return with_place("motors", DCMotors.from_datasheet if datasheet else DCMotors, **values)
