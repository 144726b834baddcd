"""Drives whose electric power is quadratic: what makes the cheapest timing a convex program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.robots.motors import DCMotors, Motors


@dataclass(frozen=True, eq=False)
class QuadraticDrives:
    """P = standby + f(loss m^2 + m w), m = torque + coulomb sign(w) + viscous w; f(e) = r e where e < 0.

    Attributes:
        loss: (n,), W per (N m)^2.
        coulomb: (n,), N m.
        viscous: (n,), N m s/rad.
        standby: W, of all drives.
        regeneration: r, 0 to 1.
    """

    loss: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    standby: float
    regeneration: float

    @classmethod
    def of(cls, motors: Motors) -> QuadraticDrives | None:
        """The same drives; None where they are others."""
        if not isinstance(motors, DCMotors):
            return None
        standby = float(np.sum(motors.standby))
        return cls(motors.motor_constant**-2, motors.coulomb, motors.viscous, standby, motors.regeneration)
