"""Limits that a standing mechanism has to keep; the joints' own limits come from the mechanism."""

from __future__ import annotations

from dataclasses import dataclass

from ocptip.basics.errors import positive_number, share_of_one


@dataclass(frozen=True)
class MotionLimits:
    """Limits a motion has to keep; the joints' own limits come from the arm.

    Attributes:
        GN: largest tip-over reserve value, at most 1, which tips.
        GT: largest slip reserve value, at most 1, which slips.
        torque_ratio: largest |torque| / limit of any joint.
        clearance: smallest distance of collision spheres, m.
    """

    GN: float = 0.9
    GT: float = 0.9
    torque_ratio: float = 1.0
    clearance: float = 0.0

    def __post_init__(self) -> None:
        for name in ("GN", "GT"):
            share_of_one(name, getattr(self, name))
        positive_number("torque_ratio", self.torque_ratio)
        positive_number("clearance", self.clearance, zero_allowed=True)
