"""A force-torque sensor in the base: what the model says that it measures (6.13)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from ocptip.basics.errors import InputError, bounded_array, finite_array, refuse_huge, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.contact.support import Support
from ocptip.numerics.vectors import cross

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True, eq=False)
class WrenchSensor:
    """A sensor that rests with the base; the mechanism and some of the base rest on it.

    Attributes:
        position: (3,), m, base frame: the point its moments are about.
        name: begins the names of its columns; letters, digits, underscores.
        rotation: (3, 3), sensor axes to base axes.
        mass: kg: of what rests on the sensor beside the mechanism. Of a sensor between arm and base that is
            the adapter above it (6.13), of a force plate under the feet the whole base.
        center_of_mass: (3,), m, base frame: of that; default: the sensor's position.

    Raises:
        InputError: naming what cannot be used.
    """

    position: np.ndarray
    name: str = "sensor"
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    mass: float = 0.0
    center_of_mass: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise InputError(f"name: expected letters, digits and underscores, got {self.name!r}")
        position = bounded_array("position", self.position, (3,))
        centre = position if self.center_of_mass is None else self.center_of_mass
        mass = float(finite_array("mass", self.mass, ()))
        refuse_huge("mass", mass)
        if mass < 0:
            raise InputError(f"mass: must be >= 0, got {mass}")
        settle(
            self,
            position=position,
            rotation=rotation_matrix("rotation", self.rotation),
            mass=mass,
            center_of_mass=bounded_array("center_of_mass", centre, (3,)),
        )

    def reads(self, support: Support, wrenches: np.ndarray) -> np.ndarray:
        """(N, 6), N and N m, sensor axes: force and moment on the sensor by what rests on it.

        Args:
            support: the base at rest.
            wrenches: (N, 6) on the base about its centre of mass, its weight included, base axes.
        """
        measured, to_centre = wrenches - support.weight, support.center_of_mass - self.position
        weight = self.mass * support.gravity
        force = measured[:, :3] + weight
        moment = measured[:, 3:] + cross(np.broadcast_to(to_centre, force.shape), measured[:, :3])
        moment = moment + cross(np.asarray(self.center_of_mass) - self.position, weight)
        return np.hstack([force @ self.rotation, moment @ self.rotation])
