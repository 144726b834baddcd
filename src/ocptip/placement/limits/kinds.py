"""The list of all limits. A new kind is one class, and one line here."""

from __future__ import annotations

from ocptip.placement.limits.arm import Clearance, JointAngles, Manipulability, Reach, Torque
from ocptip.placement.limits.base import BaseClearance, Bounds, ContactArea, OnGround, Strokes, TerrainLimit
from ocptip.placement.limits.contact import (
    HeldForces,
    Persistence,
    Slip,
    SlipReserve,
    TipOver,
    TipOverReserve,
)
from ocptip.placement.limits.criteria import ForceSpace, TorqueAmounts
from ocptip.placement.limits.limit import Limit

TASK_LIMITS: tuple[type[Limit], ...] = (
    Reach,
    JointAngles,
    TipOver,
    Slip,
    HeldForces,
    Torque,
    ForceSpace,
    TorqueAmounts,
    TipOverReserve,
    SlipReserve,
    Persistence,
    Clearance,
    Manipulability,
)
"""Of a task; in this order they are rows of the program."""

BASE_LIMITS = (Bounds, ContactArea, OnGround, Strokes, BaseClearance, TerrainLimit)
"""Of the base alone."""

KINDS: dict[str, type[Limit]] = {limit.kind: limit for limit in (*TASK_LIMITS, *BASE_LIMITS)}
"""All limits by their names in results."""
