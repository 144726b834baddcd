"""Limits that a standing mechanism has to keep; limits of joints come from the mechanism."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import InputError, positive_number, share_of_one
from ocptip.robots.collision.gaps import CLEARANCE
from ocptip.robots.model import JointLimits
from ocptip.standing.stops.along_path import PathStops
from ocptip.standing.stops.by_brakes import Brakes
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.tolerance import NONE, Uncertainty, overshoot_of

NEARLY_LOST = 0.999
"""Maximum GN and GT of samples within an uncertainty; at 1 a contact is lost."""

TIP_WITHIN, SLIP_WITHIN = "GN_worst_case", "GT_worst_case"
TORQUE_WITHIN, CLEARANCE_WITHIN = "torque_ratio_worst_case", "clearance_worst_case"
"""Limits within an uncertainty, and results of it: the result of the clearance has the unit, "_m", behind."""

WITHIN_OF = {"GN": TIP_WITHIN, "GT": SLIP_WITHIN}
"""Results of the contacts within an uncertainty, by those of the nominal motion."""


def _key(default: float, meaning: str, unit: str = "", otherwise: str = "") -> Any:
    """A field that is a key of `[limits]` in files, in SI units."""
    key = schema.number(meaning, unit, otherwise=otherwise or f"{default:g}")
    return field(default=default, metadata={"key": key})


@dataclass(frozen=True)
class Limits:
    """Limits a motion has to keep; limits of joints come from the arm.

    Attributes:
        GN: largest tip-over index, at most 1, at which the base tips.
        GT: largest friction utilisation, at most 1, at which the base slips.
        torque_ratio: largest |torque| / limit of any joint.
        clearance: smallest distance of what may collide, m.
        angle_margin: smallest distance of turning joints from their angle limits, rad.
        jerk: (n,), rad/s^3 (m/s^3), beside the limits that joints have; empty: only these count.
        min_duration, max_duration: of the motion, s; equal for a motion that must take just so long.
        damping: damping ratio of feet and elastic joints, or of a parallel robot's structure, with which
            loads overshoot at acceleration steps of the nominal motion; 1: steps do not count; see
            `ocptip.standing.limit_kinds.jumps`. Arms also have that of `tolerance`.
        foot_lift: largest height above the ground, m, of a compliant foot, while the base swings.
        foot_force: minimum normal force of a compliant foot, as springs share the load at rest on them, N.
        jump_foot_force: the same of the loads after acceleration steps with their overshoot, N.
        jump_tip_over, jump_slip: largest GN and GT of these loads, at most 1, where a contact is lost.
        tolerance: the uncertainty.
        GN_worst_case, GT_worst_case: largest values in the worst case of the uncertainty, planned, and
            evaluated by the sampled check; proofs keep smaller limits as they are, and instead of the default
            that no contact is lost: below 1.
        clearance_worst_case: smallest distance, m, with joints that are delayed within the tolerance.
        stops: what stops along the path, begun at any instant, have to keep; None: they are not checked.
        brakes: the same of stops by brakes.
        cancel: the same of stops by a controller that is cancelled.
    """

    GN: float = _key(0.9, "Largest tip-over index.")
    GT: float = _key(0.9, "Largest share of the friction in use.")
    torque_ratio: float = _key(1.0, "Largest torque over its limit, of any joint.")
    clearance: float = _key(
        CLEARANCE, "Minimum distance of what must not touch.", "m", "0.01, or less if links are nearer"
    )
    angle_margin: float = 0.0
    jerk: tuple[float, ...] = ()
    min_duration: float = 0.0
    max_duration: float = math.inf
    damping: float = 1.0
    jump_tip_over: float = 1.0
    jump_slip: float = 1.0
    tolerance: Uncertainty = NONE
    GN_worst_case: float = _key(NEARLY_LOST, "The same as GN, within the uncertainty.")
    GT_worst_case: float = _key(NEARLY_LOST, "The same as GT, within the uncertainty.")
    clearance_worst_case: float = _key(0.0, "The same as clearance, with delayed joints.", "m")
    foot_lift: float = _key(0.0, "Largest height of a compliant foot above the ground.", "m")
    foot_force: float = _key(0.0, "Minimum force on compliant feet.", "N")
    jump_foot_force: float = _key(0.0, "Minimum force on compliant feet after acceleration steps.", "N")
    stops: PathStops | None = None
    brakes: Brakes | None = None
    cancel: Cancel | None = None

    def __post_init__(self) -> None:
        for name in ("GN", "GT", "jump_tip_over", "jump_slip", TIP_WITHIN, SLIP_WITHIN):
            share_of_one(name, getattr(self, name))
        positive_number("torque_ratio", self.torque_ratio)
        for name in ("clearance", CLEARANCE_WITHIN, "angle_margin", "min_duration", "foot_lift"):
            positive_number(name, getattr(self, name), zero_allowed=True)
        overshoot_of(self.damping)  # refuses what is none
        if not self.max_duration > 0:
            raise InputError(f"max_duration: must be > 0 s, got {self.max_duration!r}")
        if self.min_duration > self.max_duration:
            raise InputError(
                f"max_duration: must be >= min_duration, {self.min_duration} s, got {self.max_duration} s"
            )

    @property
    def in_files(self) -> dict[str, float]:
        """Numbers that are keys of `[limits]`."""
        return {name: getattr(self, name) for name in LIMIT_KEYS}

    def jerks(self, joints: JointLimits) -> np.ndarray:
        """Jerk limits (n,) of a mechanism with limits of its joints; infinite where there is none."""
        return np.minimum(joints.jerk, self.jerk or np.inf)

    @property
    def overshoot(self) -> float:
        """Share of every step of the load that is added to the load after it."""
        return overshoot_of(self.damping)

    @property
    def torque_ratio_worst_case(self) -> float:
        """Torque limit within the uncertainty, as share of the drives': 1, or `torque_ratio` if larger."""
        return max(1.0, self.torque_ratio)

    @property
    def stoppable(self) -> bool:
        """Whether stops of any category are checked."""
        return any(getattr(self, name) is not None for name in _OF_STOPS)

    @property
    def without_stops(self) -> Limits:
        """These limits without those on stops."""
        return replace(self, **dict.fromkeys(_OF_STOPS))

    def to_dict(self) -> dict[str, Any]:
        """Plain data; what is about tolerance and stops only where such are given."""
        values: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}
        if not self.jerk:
            del values["jerk"]
        stops = {name: asdict(values[name]) for name in _OF_STOPS if values[name]}
        if not self.tolerance.given:
            return {
                name: value for name, value in values.items() if name not in (*_OF_TOLERANCE, *_OF_STOPS)
            } | stops
        kept = {name: value for name, value in values.items() if name not in _OF_STOPS or name in stops}
        return {**kept, "tolerance": self.tolerance.to_dict(), **stops}


LIMIT_KEYS: dict[str, schema.Key] = {
    one.name: one.metadata["key"] for one in fields(Limits) if "key" in one.metadata
}
"""Keys of `[limits]` in files that are fields of `Limits`."""

_OF_STOPS = ("stops", "brakes", "cancel")
_OF_TOLERANCE = ("tolerance", TIP_WITHIN, SLIP_WITHIN, CLEARANCE_WITHIN)
