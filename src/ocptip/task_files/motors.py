"""The `[motors]` table of task files; format: docs/motion-planner.md."""

from __future__ import annotations

from ocptip.basics.toml import REQUIRED, Table
from ocptip.published.arms import modular_motors
from ocptip.robots.model import ArmModel
from ocptip.robots.motors import DCMotors, Motors

_DATASHEET = ("resistance", "torque_constant", "gear_ratio")


def arm_motors(data: Table, arm: ArmModel) -> Motors:
    """The motors of an arm; modular arms may leave the table out.

    Args:
        data: the file.
        arm: of its `[arm]`.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    modular = "name" in data.table("arm")
    hint = '; give kind = "dc" with motor data, or kind = "estimated"'
    table = data.table("motors", optional=modular, hint=hint)
    kinds = ("modular", "estimated", "dc")
    kind = table.choice("kind", kinds, "modular" if modular else REQUIRED)
    if kind == "dc":
        return dc_motors(table, arm.n)
    if kind == "estimated":
        return table.make(DCMotors.estimated, arm, **table.numbers("standby", "regeneration"))
    if not modular:
        raise table.error("the power maps 'modular' are for the modular arms only", "kind")
    return modular_motors()


def dc_motors(table: Table, n: int) -> DCMotors:
    """DC motors of n joints, by `motor_constant` or by the values of a datasheet."""
    needed = ("motor_constant",) if "motor_constant" in table else _DATASHEET
    keys = (*needed, "coulomb", "viscous", "standby")
    values = {key: table.per_joint(key, n, bound=">= 0") for key in keys}
    make = DCMotors if "motor_constant" in table else DCMotors.from_datasheet
    return table.make(make, **values, **table.numbers("regeneration"))
