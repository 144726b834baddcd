"""Elastic joints: a spring and a damper between the drive of a joint and what it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.frozen import settle

DAMPING_RATIO = 0.05
"""Damping ratio of a gear that gives where none is given."""


@dataclass(frozen=True, eq=False)
class Gears:
    """Gears of n joints.

    Attributes:
        stiffness: (n,), N m/rad of joint (sliding joints: N/m), infinite of joints that do not give.
        damping: (n,), N m s/rad (N s/m), >= 0; None: by the ratio.
        damping_ratio: 0 to below 1: of each joint alone, drives and all others held, at the start of a
            motion.
    """

    stiffness: np.ndarray
    damping: np.ndarray | None = None
    damping_ratio: float = DAMPING_RATIO

    def __post_init__(self) -> None:
        """Raise InputError, which names what cannot be used."""
        stiffness = np.array(self.stiffness, dtype=float)
        if stiffness.ndim != 1 or not (stiffness > 0).all():
            raise InputError(f"gear_stiffness: must be > 0 of every joint, got {self.stiffness!r}")
        if not np.isfinite(stiffness).any():
            raise InputError("gear_stiffness: infinite of all joints: then leave it out")
        settle(self, stiffness=stiffness)
        if self.damping is not None:
            damping = finite_array("gear_damping", self.damping, stiffness.shape)
            if (damping < 0).any():
                raise InputError(f"gear_damping: must be >= 0, got {damping}")
            settle(self, damping=damping)
        if not 0 <= self.damping_ratio < 1:  # NaN, too
            raise InputError(f"gear_damping_ratio: must be >= 0 and below 1, got {self.damping_ratio!r}")

    @property
    def elastic(self) -> np.ndarray:
        """Numbers, from 0, of the joints that give, (m,)."""
        return np.flatnonzero(np.isfinite(self.stiffness))

    def dampers(self, inertias: ArrayLike) -> np.ndarray:
        """(m,), N m s/rad, of the elastic joints, with the diagonal inertias (m,) at the start, kg m^2."""
        if self.damping is not None:
            return self.damping[self.elastic]
        return 2 * self.damping_ratio * np.sqrt(self.stiffness[self.elastic] * np.asarray(inertias))
