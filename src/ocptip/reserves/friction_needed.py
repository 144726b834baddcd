"""The friction or the force that a sliding base lacks: GT above 1 counts its acceleration instead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import clarabel
import numpy as np

from ocptip.basics.text import percent, quantity
from ocptip.contact.bindings.binding import LARGEST_FRICTION
from ocptip.contact.bindings.laws import carries
from ocptip.contact.resting import solve_resting
from ocptip.contact.support import Support
from ocptip.numerics.cone_program import INFEASIBLE, USABLE, quiet_settings, solve_cones
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.slip import Slip

_TIMES = (1.0, 4.0, 16.0, 64.0, 256.0)  # times as much friction, to tell how much is enough
_TOLERANCE = 1e-9  # of the cone program, relative to the load


def friction_needed(support: Support, wrench: np.ndarray) -> float:
    """Factor on the friction of all contacts with which a support just holds a wrench (6,).

    Below 1 it is GT. Infinite where no friction holds the wrench; NaN where not all contacts are feet or
    wheels.
    """
    contacts = support.contacts
    if not ForceSets(support).cones:
        return np.nan
    roughest = max((contact.friction for contact in contacts), default=0.0)  # pyright: ignore
    for times in _TIMES:
        if times * roughest > LARGEST_FRICTION:
            break
        rough = support.varied([replace(c, friction=times * c.friction) for c in contacts])  # pyright: ignore
        states = solve_resting(rough, wrench[None], warm_start=False)
        if states.persistent[0]:
            needed = times * float(Slip(rough).evaluate(states, derivatives=False).GT[0])
            if needed <= times:  # pyramids reach beyond the cones
                return needed
    return np.inf


def missing_force(support: Support, wrench: np.ndarray) -> float:
    """The tangential force, N, that the friction of the contacts lacks to hold a wrench (6,) or planar (3,).

    Further tangential forces at the contacts and forces within the friction cones together hold the base.
    The result is the smallest sum of the further ones; 0 where the base does not slide. Infinite where none
    hold the wrench, because the base tips; NaN where not all contacts are feet or wheels.
    """
    if not (sets := ForceSets(support)).cones:
        return np.nan
    d, n, size = support.dimension, support.n_contacts, support.wrench_size
    scaling = np.r_[np.ones(d), np.full(size - d, 1 / support.length)]
    load, W = scaling * wrench, scaling[:, None] * support.wrench_matrix
    unit = float(np.max(np.abs(load))) or 1.0
    tangential = np.arange(n * d).reshape(n, d)[:, 1:]
    # Unknown are contact forces (n d), further tangential forces (n (d - 1)) and bounds of their sizes (n).
    further = n * d + np.arange(n * (d - 1)).reshape(n, d - 1)
    bound = n * (2 * d - 1) + np.arange(n)
    A = np.zeros((size + 2 * n * d, n * 2 * d))
    A[:size, : n * d], A[:size, further.ravel()] = (
        W * carries(support.contacts).ravel(),
        W[:, tangential.ravel()],
    )
    friction_rows = size + np.arange(n * d).reshape(n, d)
    A[friction_rows[:, 0], d * np.arange(n)] = -sets.friction
    A[friction_rows[:, 1:], tangential] = -1.0
    bound_rows = friction_rows + n * d
    A[bound_rows[:, 0], bound] = -1.0
    A[bound_rows[:, 1:], further] = -1.0
    wheels = np.flatnonzero((sets.along > 0) & np.isfinite(sets.along))
    held = np.zeros((2 * len(wheels), A.shape[1]))  # forces along of drives and brakes
    for row, k in enumerate(np.repeat(wheels, 2)):
        held[row, tangential[k, 0]] = 1.0 if row % 2 else -1.0
    A = np.vstack([A, held])
    b, cost = np.zeros(len(A)), np.zeros(A.shape[1])
    b[:size], cost[bound] = -load / unit, 1.0
    b[len(b) - len(held) :] = np.repeat(sets.along[wheels], 2) / unit
    cones = [clarabel.ZeroConeT(size), *[clarabel.SecondOrderConeT(d)] * (2 * n)]
    cones += [clarabel.NonnegativeConeT(len(held))] * (len(held) > 0)
    solution = solve_cones(cost, A, b, cones, quiet_settings(_TOLERANCE))
    status = str(solution.status)
    if status in INFEASIBLE:
        return np.inf
    return unit * max(float(solution.obj_val), 0.0) if status in USABLE else np.nan


@dataclass(frozen=True)
class FrictionDemand:
    """The friction that a wrench on a base needs, also beyond what there is.

    Attributes:
        factor: on the friction, see `friction_needed`.
        missing: N, see `missing_force`.
    """

    factor: float
    missing: float

    @classmethod
    def of(cls, support: Support, wrench: np.ndarray) -> FrictionDemand:
        """Of a wrench (6,) or planar (3,), N and N m about the centre of mass."""
        return cls(friction_needed(support, wrench), missing_force(support, wrench))

    @property
    def used(self) -> str:
        """The share of the friction: "164 %: 58.6 N of tangential force are missing"."""
        share = percent(self.factor) if np.isfinite(self.factor) else "more than all of it"
        return f"{share}: {self.remark}" if self.remark else share

    @property
    def remark(self) -> str:
        """What is missing, in words; empty where nothing is known to be."""
        if np.isfinite(self.missing):
            return f"{quantity(self.missing, 'N', 3)} of tangential force are missing" * (self.missing > 0)
        return "no friction keeps it from tipping" if np.isinf(self.factor) else ""
