"""Payloads: a rigid body fixed to a gripper, or to the platform of a parallel robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, bounded_array, positive_number, refuse_huge
from ocptip.basics.frozen import settle
from ocptip.numerics.inertia import ROUNDED, RigidBody, symmetric_matrix, why_impossible


@dataclass(frozen=True, eq=False)
class Payload:
    """A rigid body in the gripper. The robot that holds it: `ArmModel.with_payload`.

    Attributes:
        mass: kg.
        center_of_mass: (3,), m, from G in gripper axes (parallel robots: from the platform's origin in its
            axes).
        inertia: (3, 3), kg m^2, about its centre of mass, gripper axes; also given as (6,) numbers xx, xy,
            xz, yy, yz, zz or three principal values. Zero: a point mass.

    Raises:
        InputError: not finite, no mass, or an inertia that no body has.
    """

    mass: float
    center_of_mass: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        values = {
            "mass": positive_number("mass", self.mass),
            "center_of_mass": bounded_array("center_of_mass", self.center_of_mass, (3,)),
            "inertia": symmetric_matrix(self.inertia),
        }
        refuse_huge("mass", values["mass"])
        matrix = values["inertia"]
        refuse_huge("inertia", matrix)
        if matrix.any():
            principal = np.linalg.eigvalsh(matrix)
            if principal[0] <= 0:
                raise InputError(
                    "inertia: must be positive definite (all zero: a point mass), got principal values "
                    f"{', '.join(f'{value:.4g}' for value in principal)} kg m^2"
                )
            if reason := why_impossible(matrix, ROUNDED * principal[-1]):
                raise InputError(f"inertia: {reason}")
        settle(self, **values)

    @classmethod
    def box(cls, mass: float, size: Sequence[float], center_of_mass: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
        """A homogeneous box.

        Args:
            mass: kg.
            size: (3,), m, along the gripper axes.
            center_of_mass: (3,), m, gripper frame: its middle.

        Raises:
            InputError: bad numbers.
        """
        mass, sides = positive_number("mass", mass), bounded_array("box", size, (3,))
        if (sides <= 0).any():
            raise InputError(f"box: dimensions must be > 0, got {sides.tolist()}")
        return cls(mass, np.asarray(center_of_mass), mass / 12 * (np.sum(sides**2) - sides**2))

    @property
    def is_point(self) -> bool:
        """No extension is known."""
        return not self.inertia.any()

    def seen_from(self, rotation: np.ndarray, origin: np.ndarray) -> RigidBody:
        """The body in a frame in which the gripper frame has this rotation (3, 3) and origin (3,), m."""
        centre = origin + rotation @ self.center_of_mass
        return self.mass, centre, rotation @ self.inertia @ rotation.T

    def to_dict(self) -> dict[str, Any]:
        """Plain data, the keys of the table `[payload]`."""
        inertia = {} if self.is_point else {"inertia": self.inertia.tolist()}
        return {"mass": self.mass, "center_of_mass": self.center_of_mass.tolist(), **inertia}

    def __str__(self) -> str:
        where = ", ".join(f"{x:.4g}" for x in self.center_of_mass + 0.0)
        if self.is_point:
            return f"point mass at ({where}) m"
        principal = ", ".join(f"{x:.3g}" for x in np.linalg.eigvalsh(self.inertia))
        return f"centre at ({where}) m, principal moments {principal} kg m^2"
