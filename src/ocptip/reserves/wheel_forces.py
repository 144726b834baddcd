"""Friction utilisation of a base on wheels whose drives or brakes hold up to a torque.

On one plane normal and tangential forces balance apart. So the load across may grow until a wheel slides or
its drive is too weak: the reciprocal of that factor is the smallest largest usage of all limits, a cone
program.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.force_programs import LoadRays
from ocptip.contact.support import Support
from ocptip.numerics.vectors import skew
from ocptip.reserves.force_sets import LOAD_TOLERANCE, ForceSets

_MOST = 1e4  # times the load across: a usage below its reciprocal counts as none
_ON_PLANE = 1e-9  # of the support's length


class WheelForces:
    """Forces of the contacts of a base, wheels with drives or brakes among them.

    Args:
        support: its contacts, on one plane.
        sets: their forces.

    Raises:
        InputError: they are not on one plane.
    """

    def __init__(self, support: Support, sets: ForceSets) -> None:
        self._sets, self._rays = sets, LoadRays(support)
        normals, places = (
            support.frames[:, :, 0],
            np.array([contact.position for contact in support.contacts]),
        )
        n, first = normals[0], places[0]
        heights = (places - first) @ n
        if np.max(np.abs(heights)) > _ON_PLANE * support.length or np.max(np.abs(normals - n)) > _ON_PLANE:
            raise InputError("contacts: wheels with a drive or a brake need contacts on one plane")
        arm, along = skew(first - support.center_of_mass), np.outer(n, n)
        # Forces across, and the moment about the normal through a point of the plane.
        forces = np.hstack([np.eye(3) - along, np.zeros((3, 3))])
        moments = np.hstack([-along @ arm, along]) + arm @ forces
        self._across = np.vstack([forces, moments])

    def redistribute(self, work: Any) -> None:
        """Usage, forces and slopes of states that stand; those that move use at least all.

        Args:
            work: see `Slip`.
        """
        for row in np.flatnonzero(work.states.solved):
            result = self.usage(work.states.wrenches[row]) if work.states.persistent[row] else None
            if result is None:
                work.ratio[row] = max(work.ratio[row], 1.0)
                continue
            work.ratio[row], work.slopes[row], work.forces[row], work.usage[row] = result
            work.pull[row], work.gap[row], work.status[row] = 0.0, 0.0, "solved"

    def usage(self, wrench: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray] | None:
        """Usage, its slopes (6,), forces (n, 3), N, and the usage of each contact, (n,).

        None where normal forces do not hold the load.

        Args:
            wrench: (6,), N and N m.
        """
        across = self._across @ wrench
        start = wrench - across
        share, normal, forces = self._rays.with_forces(start, start + _MOST * across)
        if forces is None or share <= 0:
            return None
        factor = min(share, 1.0) * _MOST
        forces[:, 1:] /= factor
        limits = np.maximum(self._sets.friction * forces[:, 0], 0.0)
        loaded = limits > LOAD_TOLERANCE * max(float(np.max(limits)), LOAD_TOLERANCE)
        used = np.linalg.norm(forces[:, 1:], axis=1) / np.where(loaded, limits, np.inf)
        driven = np.isfinite(self._sets.along) & (self._sets.along > 0)
        used = np.maximum(used, np.abs(forces[:, 1]) / np.where(driven, self._sets.along, np.inf))
        slopes, rate = np.zeros(6), float(normal @ across)
        if share < 1 and rate > 0:  # the limit moves with the load: normal (start + factor across) = constant
            slopes = (normal + (factor - 1) * self._across.T @ normal) / (factor**2 * rate)
        ratio = 0.0 if share >= 1 else 1 / factor
        return ratio, slopes, forces, np.where(loaded, used, np.nan)
