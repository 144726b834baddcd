"""The `[motors]` table of task files; format: docs/motion-planner.md."""

from __future__ import annotations

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import REQUIRED, Keys
from ocptip.basics.toml import Table
from ocptip.published.arms import modular_motors
from ocptip.robots.gears import DAMPING_RATIO, Gears
from ocptip.robots.model import ArmModel
from ocptip.robots.motors import DCMotors, Motors, PowerMaps
from ocptip.robots.spring_chain import spring_chain
from ocptip.task_files.tables.arm import read_arm
from ocptip.task_files.tables.joints import joint_values
from ocptip.task_files.tables.payload import load_table, read_payload, read_process
from ocptip.task_files.tables.shapes import carrying, read_shapes, require_geometry

_DATASHEET = ("resistance", "torque_constant", "gear_ratio")


def _motor(meaning: str, unit: str, otherwise: str = "") -> schema.Key:
    return schema.per_joint(meaning, unit, bound=">= 0", otherwise=otherwise)


_REGENERATION = schema.number("Share of braking energy that is recovered, 0 to 1.", otherwise="none")
_DC = Keys(
    "DC motors",
    "DC motors by motor constant, or by the values of a datasheet.",
    {
        "motor_constant": _motor("Torque per square root of copper loss.", "N m/W^0.5", "from the datasheet"),
        "resistance": _motor("Resistance of the winding.", "ohm", "needed without `motor_constant`"),
        "torque_constant": _motor("Torque per current.", "N m/A", "needed without `motor_constant`"),
        "gear_ratio": _motor("Ratio of the gear.", "", "needed without `motor_constant`"),
        "coulomb": _motor("Dry friction at the joint.", "N m"),
        "viscous": _motor("Viscous friction at the joint.", "N m s/rad"),
        "standby": _motor("Power at rest.", "W"),
        "regeneration": _REGENERATION,
    },
)
_KINDS = {
    "modular": Keys("modular motors", "Measured power maps of the modular arms.", {}),
    "estimated": Keys(
        "estimated motors",
        "Motors estimated from the limits of torque and speed.",
        {
            "standby": schema.number("Power of each joint at rest.", "W", otherwise="estimated"),
            "regeneration": _REGENERATION,
        },
    ),
    "dc": _DC,
    "map": Keys(
        "power maps",
        "Measured power maps, as `ocptip identify power` writes them.",
        {
            "coefficients": schema.array("Twelve coefficients for each joint.", "", (None, 12)),
            "voltage": schema.number("Supply voltage.", "V", bound="> 0"),
            "torque_reading": schema.choice(
                "What the torque of a map is.", ("load", "drive"), default="load"
            ),
        },
    ),
}
GEARS = Keys(
    "gears",
    "How much the gears of turning joints give.",
    {
        "gear_stiffness": schema.by_joint(
            "Stiffness of gears of turning joints.", "N m/rad", bound="> 0", otherwise="rigid"
        ),
        "gear_damping": schema.by_joint(
            "Damping of these gears.", "N m s/rad", bound=">= 0", otherwise="by ratio"
        ),
        "gear_damping_ratio": schema.number(
            "Damping ratio of each joint alone, all others held, below 1.",
            bound=">= 0",
            default=DAMPING_RATIO,
        ),
    },
    at_most_one=[("gear_damping", "gear_damping_ratio")],
)
MOTORS = Keys(
    "motors",
    "The motors of an arm, and how much its gears give.",
    {
        "kind": schema.choice(
            "The model of the motors.", _KINDS, otherwise="`modular` for modular arms, else `estimated`"
        ),
        **GEARS.keys,
    },
    at_most_one=GEARS.at_most_one,
    by="kind",
    variants=_KINDS,
    usual="estimated",
)
PLATFORM_MOTORS = Keys(
    "motors of a parallel robot",
    "The motors of a parallel robot.",
    {"kind": schema.choice("The model of the motors.", ("dc",)), **_DC.keys},
)


def arm_and_motors(
    data: Table, segment: Table | None = None, arm: ArmModel | None = None
) -> tuple[ArmModel, Motors]:
    """The arm of a file and its motors, by default measured ones of modular arms, estimated ones of others.

    Args:
        data: the file.
        segment: of a cycle, which may say what is held and where the gripper's joints stand.
        arm: what `read_arm` has read from them, if it has.
    """
    arm = arm or read_arm(data.table("arm"), segment)
    load = load_table(data, segment)
    held = [] if load is None else read_shapes(load, "payload", carried=True)
    require_geometry(data, arm, {"payload.shape": held})
    arm = carrying(arm.with_payload(read_payload(load)), held).with_process(read_process(data, segment))
    modular = "name" in data.table("arm")
    table = data.table("motors")
    arm = arm.with_gears(read_gears(table, arm))
    if load is not None and not held and arm.may_collide:
        arm = arm.with_notes("payload: its collisions are not checked; [payload.shape] is its solid")
    kind = table.get("kind", "modular" if modular else "estimated")
    if kind == "dc":
        return arm, dc_motors(table, arm.n)
    if kind == "map":
        return arm, power_maps(table, arm.n)
    if kind == "estimated":
        _require_limits(data, arm)
        motors = table.make(DCMotors.estimated, arm, **table.given("standby", "regeneration"))
        return arm.with_notes("energy: motors are estimated from limits of torque and speed"), motors
    if not modular:
        raise table.error("the power maps 'modular' are for the modular arms only", "kind")
    return arm, modular_motors()


def read_gears(table: Table, arm: ArmModel) -> Gears | None:
    """Springs and dampers of turning joints, of [motors]; None if there are none."""
    result = joint_values(table, "gear_stiffness", arm, slides=False)
    key = table.one_of("gear_damping")
    if result is None:
        if key is not None:
            raise table.error("needs gear_stiffness; give that as well", key)
        return None
    stiffness = np.full(arm.n, np.inf)
    stiffness[~arm.prismatic] = np.where(np.isnan(result), np.inf, result)
    damping = None
    if key == "gear_damping":
        values = joint_values(table, key, arm, slides=False)
        assert values is not None  # the key is there
        damping = np.zeros(arm.n)
        damping[~arm.prismatic] = values
        lacking = np.isnan(damping) & np.isfinite(stiffness)
        if lacking.any():
            raise table.error(f"no value for {', '.join(np.array(arm.joint_names)[lacking])}", key)
        damping = np.nan_to_num(damping)
    with table.at():
        gears = Gears(stiffness, damping, gear_damping_ratio(table))
        spring_chain(arm.with_gears(gears))
    return gears


def gear_damping_ratio(table: Table) -> float:
    """Damping ratio of the gears in [motors]."""
    ratio = table["gear_damping_ratio"]
    if ratio >= 1:
        raise table.error(f"must be below 1 (5 %: 0.05), got {ratio:g}", "gear_damping_ratio")
    return ratio


def _require_limits(data: Table, arm: ArmModel) -> None:
    """Refuse to estimate motors without limits of torque and speed; says which keys give them."""
    keys = {"torque": ("torque_Nm", "force_N"), "speed": ("speed_deg_s", "speed_m_s")}
    require_limits = []
    for limit, (turning, sliding) in keys.items():
        for slides, key in ((False, turning), (True, sliding)):
            lacking = (arm.prismatic == slides) & ~np.isfinite(getattr(arm.limits, limit))
            if lacking.any():
                names = ", ".join(np.array(arm.joint_names)[lacking])
                require_limits.append(f"the URDF has no {limit} limit of {names}; give {key}")
    if require_limits:
        raise data.table("arm").error("; ".join(require_limits), "limits")


def power_maps(table: Table, n: int) -> PowerMaps:
    """Measured maps of n joints, by their coefficients, as `ocptip identify power` writes them."""
    coefficients = table.get("coefficients", size=n)
    return table.make(PowerMaps, coefficients, table["voltage"], table["torque_reading"])


def dc_motors(table: Table, n: int) -> DCMotors:
    """DC motors of n joints, by `motor_constant` or by the values of a datasheet."""
    needed = ("motor_constant",) if "motor_constant" in table else _DATASHEET
    keys = (*needed, "coulomb", "viscous", "standby")
    values = {key: table.get(key, REQUIRED, size=n) for key in keys}
    make = DCMotors if "motor_constant" in table else DCMotors.from_datasheet
    return table.make(make, **values, **table.given("regeneration"))
