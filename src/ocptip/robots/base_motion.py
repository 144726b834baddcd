"""The motion of a base that drives, and the inertial wrench on the base itself.

A mass element at p of a base whose origin has the acceleration a is accelerated by a + al x p + w x (w x p).
The velocity of the origin itself does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.frozen import settle
from ocptip.contact.support import Support


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """How a base, or what else carries bodies, moves, at one instant or at N; all in its axes.

    Attributes:
        acceleration: (3,) or (N, 3), m/s^2, of the origin of the base frame.
        angular_velocity: (3,) or (N, 3), rad/s.
        angular_acceleration: (3,) or (N, 3), rad/s^2.

    Raises:
        InputError: other shapes, numbers of instants that differ, or values that are not finite.
    """

    acceleration: ArrayLike = (0.0, 0.0, 0.0)
    angular_velocity: ArrayLike = (0.0, 0.0, 0.0)
    angular_acceleration: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            shape = (None, 3) if np.ndim(value) == 2 else (3,)
            settle(self, **{item.name: finite_array(f"base_motion.{item.name}", value, shape)})
        counts = {len(part) for part in self._parts if part.ndim == 2}
        if len(counts) > 1:
            raise InputError(f"base_motion: numbers of instants differ: {sorted(counts)}")

    @property
    def _parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The attributes as arrays."""
        a, w, al = (np.asarray(getattr(self, item.name)) for item in fields(self))
        return a, w, al

    @property
    def turns(self) -> bool:
        """Whether the base has an angular velocity or acceleration."""
        return bool(np.any(self.angular_velocity) or np.any(self.angular_acceleration))

    def rows(self, count: int) -> np.ndarray:
        """(N, 9): acceleration, angular velocity and angular acceleration at N instants.

        Raises:
            InputError: another number of instants was given.
        """
        for part in self._parts:
            if part.ndim == 2 and len(part) != count:
                raise InputError(
                    f"base_motion: expected {count} instants, one of each state, got {len(part)}"
                )
        return np.hstack([np.broadcast_to(part, (count, 3)) for part in self._parts])

    def some(self, rows: np.ndarray) -> BaseMotion:
        """At some of the instants; what is the same at all of them stays."""
        return BaseMotion(*(part[rows] if part.ndim == 2 else part for part in self._parts))

    def to_dict(self) -> dict[str, list]:
        """Plain data: m/s^2, rad/s, rad/s^2."""
        return {item.name: part.tolist() for item, part in zip(fields(self), self._parts, strict=True)}

    def acceleration_at(self, point: np.ndarray) -> np.ndarray:
        """(3,) or (N, 3), m/s^2: of a point of the base, (3,), m, base frame."""
        a, w, al = self._parts
        return a + np.cross(al, point) + np.cross(w, np.cross(w, point))

    def inertial_wrench(self, support: Support) -> np.ndarray:
        """(6,) or (N, 6), N and N m: of the inertia of the base about its centre of mass."""
        _, w, al = self._parts
        force = -support.mass * self.acceleration_at(support.center_of_mass)
        moment = -(al @ support.inertia + np.cross(w, w @ support.inertia))
        return np.concatenate(np.broadcast_arrays(force, moment), axis=-1)


def acceleration_of(motion: Sequence[cs.SX], point: cs.SX) -> cs.SX:
    """(3,), m/s^2: see `BaseMotion.acceleration_at`, of expressions of its three parts."""
    a, w, al = motion
    return a + cs.cross(al, point) + cs.cross(w, cs.cross(w, point))


def inertial_wrench_of(
    motion: Sequence[cs.SX], support: Support, share: cs.SX | float = 1.0, shift: cs.SX | None = None
) -> cs.SX:
    """(6,): see `BaseMotion.inertial_wrench`, of expressions of its three parts.

    The base may have a share of its mass, and its centre of mass a shift, m, from the point of the moment.
    """
    _, w, al = motion
    place, inertia = cs.SX.zeros(3) if shift is None else shift, cs.SX(support.inertia)
    force = -support.mass * share * acceleration_of(motion, cs.SX(support.center_of_mass) + place)
    turning = inertia @ al + cs.cross(w, inertia @ w)
    return cs.vertcat(force, cs.cross(place, force) - share * turning)
