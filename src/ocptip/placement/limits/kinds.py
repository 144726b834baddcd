"""The list of all limits. A new kind is one class, and one line here."""

from __future__ import annotations

from ocptip.placement.limits.arm import Clearance, JointAngles, Manipulability, Reach, Torque
from ocptip.placement.limits.base import (
    BaseClearance,
    ContactArea,
    OnGround,
    ParameterBounds,
    Strokes,
    TerrainLimit,
)
from ocptip.placement.limits.contact import (
    HeldForces,
    Persistence,
    SlipIndexLimit,
    SlipLimit,
    TipOverIndexLimit,
    TipOverLimit,
)
from ocptip.placement.limits.criteria import ForceSpace, TorqueAmounts
from ocptip.placement.limits.limit import PlacementLimit

TASK_LIMITS: tuple[type[PlacementLimit], ...] = (
    Reach,
    JointAngles,
    TipOverLimit,
    SlipLimit,
    HeldForces,
    Torque,
    ForceSpace,
    TorqueAmounts,
    TipOverIndexLimit,
    SlipIndexLimit,
    Persistence,
    Clearance,
    Manipulability,
)
"""Kinds of limits of a task, in the order of the program's rows."""

BASE_LIMITS = (ParameterBounds, ContactArea, OnGround, Strokes, BaseClearance, TerrainLimit)
"""Kinds of limits of the base alone."""

KINDS: dict[str, type[PlacementLimit]] = {limit.kind: limit for limit in (*TASK_LIMITS, *BASE_LIMITS)}
"""All limits by their names in results."""
