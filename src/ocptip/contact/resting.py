"""States that stand wherever forces of the contacts can hold the base (the weak verdict of `verdict`).

With four and more feet, or much friction, the contact laws may have a solution that stands and one that
moves; which of them pivoting finds depends on where it begins, so on the state before. Where a standing one
is wanted if there is any, whether a base stands must be a function of the wrench alone.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import SolverError
from ocptip.contact.solver import on_springs, solve_many
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, standing_values

_CLEARLY = 1e-6  # relative: so much more power than forces can take up excludes a wrench without a program


def solve_resting(support: Support, wrenches: ArrayLike, **how: Any) -> ContactStates:
    """As `solve_many`, but a state that stands, on the true cones, wherever there is one.

    Args:
        support: the base on its contacts.
        wrenches: (N, 6) or planar (N, 3), see `solve`.
        how: further arguments of `solve_many`.
    """
    return resting(solve_many(support, wrenches, **how))


def resting(states: ContactStates) -> ContactStates:
    """The same states; of those that move, or are not solved, the standing ones that there are instead.

    One convex program per state; fewer where a velocity at which contacts cannot take up the power of one
    wrench, the proof that the base moves, proves the same of others, now or later.
    """
    support, left, stands = states.support, np.flatnonzero(~states.persistent), False
    left = left[~_moved(support, states.wrenches[left], support.proofs)]
    while len(left):
        first, left = left[:1], left[1:]
        wrench = states.wrenches[first[0]]
        try:
            found = equilibrium(support, wrench)
        except SolverError:  # no verdict: it stays as it is
            continue
        if found.stands and found.forces is not None:
            states, stands = states.changed(first, standing_values(support, wrench, found.forces)), True
        elif (velocity := found.certificate) is not None:
            proof = velocity, _taken_up(support, velocity)
            support.proofs.append(proof)
            left = left[~_moved(support, states.wrenches[left], [proof])]
    return on_springs(states) if stands else states


def _moved(
    support: Support, wrenches: np.ndarray, proofs: Collection[tuple[np.ndarray, float]]
) -> np.ndarray:
    """(N,) whether one of such proofs excludes that contact forces balance wrenches (N, 6)."""
    if not (len(wrenches) and proofs):
        return np.zeros(len(wrenches), dtype=bool)
    d = support.dimension
    units = np.r_[np.ones(d), np.full(support.wrench_size - d, support.length)]
    velocities, most = np.array([own for own, _ in proofs]), np.array([power for _, power in proofs])
    size = np.max(np.abs(wrenches / units), axis=1)[:, None] * np.max(np.abs(velocities * units), axis=1)
    return np.any(wrenches @ velocities.T >= most + _CLEARLY * size, axis=1)


def _taken_up(support: Support, velocity: np.ndarray) -> float:
    """The most power that contacts, whose forces are convex sets, can take up at a velocity that proves."""
    total = 0.0
    moved = (velocity @ support.wrench_matrix).reshape(support.n_contacts, -1)
    for contact, (away, *along) in zip(support.contacts, moved, strict=True):
        (piece,) = contact.force_pieces()
        sliding = float(np.linalg.norm(along))
        # where forces have no end they take up nothing there, or the velocity would be no proof
        ends = [end for end in (piece.normal_min, piece.normal_max) if np.isfinite(end)]
        most = max((end * (piece.slope * sliding - away) for end in ends), default=0.0)
        total += piece.radius * sliding + most
    return total
