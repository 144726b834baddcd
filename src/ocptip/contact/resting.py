"""States that stand wherever forces of the contacts can hold the base (the weak verdict of `verdict`).

With four and more feet, or much friction, the contact laws may have a solution that stands and one that
moves; which of them pivoting finds depends on where it begins, so on the state before. Where a standing one
is wanted if there is any, whether a base stands must be a function of the wrench alone.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import SolverError
from ocptip.contact.bindings import laws
from ocptip.contact.solver import on_springs, solve_many
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, standing_values

_BALANCED = 1e-9  # relative: what forces of a neighbour may leave of a wrench
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

    One convex program per state; fewer where one result decides several states. Forces that hold one wrench,
    well inside their limits, hold others after the smallest change that balances them. A velocity at which
    contacts cannot take up the power of one wrench, the proof that the base moves, proves the same of others,
    now or later.
    """
    support, left = states.support, np.flatnonzero(~states.persistent)
    left = left[~_moved(support, states.wrenches[left], support.proofs)]
    rows, held = [np.empty(0, dtype=int)], [np.empty((0, *states.contact_forces.shape[1:]))]
    neighbours = _Neighbours(support)
    while len(left):
        first, left = left[:1], left[1:]
        wrench = states.wrenches[first[0]]
        try:
            result = equilibrium(support, wrench)
        except SolverError:  # no verdict: it stays as it is
            continue
        if result.stands and result.forces is not None:
            forces, holds = neighbours.held(result.forces, wrench, states.wrenches[left])
            rows += [first, left[holds]]
            held += [result.forces[None], forces[holds]]
            left = left[~holds]
        elif (velocity := result.certificate) is not None:
            proof = velocity, _taken_up(support, velocity)
            support.proofs.append(proof)
            left = left[~_moved(support, states.wrenches[left], [proof])]
    owners, forces = np.concatenate(rows), np.concatenate(held)
    if not len(owners):
        return states
    return on_springs(states.changed(owners, standing_values(support, states.wrenches[owners], forces)))


class _Neighbours:
    """Which wrenches contact forces hold that are near to forces which hold another one.

    Args:
        support: the base on its contacts; those with several convex pieces of forces have no neighbours.
    """

    def __init__(self, support: Support) -> None:
        pieces = [contact.force_pieces() for contact in support.contacts]
        self._pieces = [piece[0] for piece in pieces] if all(len(piece) == 1 for piece in pieces) else []
        carrying = support.wrench_matrix * laws.carries(support.contacts).ravel()
        self._matrix, self._change = support.wrench_matrix, -np.linalg.pinv(carrying)

    def held(
        self, forces: np.ndarray, wrench: np.ndarray, others: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Forces (N, n, d) under wrenches (N, 6), and whether they hold these, (N,), inside their limits."""
        moved = forces + ((others - wrench) @ self._change.T).reshape(-1, *forces.shape)
        if not (self._pieces and len(others)):
            return moved, np.zeros(len(others), dtype=bool)
        low, high, radius, slope, along = np.array(
            [
                (piece.normal_min, piece.normal_max, piece.radius, piece.slope, piece.along)
                for piece in self._pieces
            ]
        ).T
        normal, size = moved[:, :, 0], np.linalg.norm(moved[:, :, 1:], axis=2)
        inside = (normal >= low) & (normal <= high) & (size <= radius + slope * normal)
        inside &= np.abs(moved[:, :, 1]) <= along
        balance = others + moved.reshape(len(others), -1) @ self._matrix.T
        balanced = np.max(np.abs(balance), axis=1) <= _BALANCED * np.max(np.abs(others), axis=1)
        return moved, balanced & np.all(inside, axis=1)


def _moved(
    support: Support, wrenches: np.ndarray, proofs: Collection[tuple[np.ndarray, float]]
) -> np.ndarray:
    """(N,) whether one of such proofs excludes that contact forces balance wrenches (N, 6)."""
    if not (len(wrenches) and proofs):
        return np.zeros(len(wrenches), dtype=bool)
    d = support.dimension
    units = np.r_[np.ones(d), np.full(support.wrench_size - d, support.length)]
    velocities, most = (
        np.array([velocity for velocity, _ in proofs]),
        np.array([power for _, power in proofs]),
    )
    size = np.max(np.abs(wrenches / units), axis=1)[:, None] * np.max(np.abs(velocities * units), axis=1)
    return np.any(wrenches @ velocities.T >= most + _CLEARLY * size, axis=1)


def _taken_up(support: Support, velocity: np.ndarray) -> float:
    """The most power that contacts, whose forces are convex sets, can take up at a velocity that proves."""
    total = 0.0
    moved = (velocity @ support.wrench_matrix).reshape(support.n_contacts, -1)
    moved = moved * laws.carries(support.contacts)  # along other directions there is no force
    for contact, (away, *along) in zip(support.contacts, moved, strict=True):
        (piece,) = contact.force_pieces()
        sliding = float(np.linalg.norm(along))
        # where forces have no end they take up nothing there, or the velocity would be no proof
        ends = [end for end in (piece.normal_min, piece.normal_max) if np.isfinite(end)]
        most = max((end * (piece.slope * sliding - away) for end in ends), default=0.0)
        if piece.along < np.inf and piece.slope * sliding > away:  # the limit along ends it, not the friction
            most = piece.along * abs(along[0])
        total += piece.radius * sliding + most
    return total


_VERBS = {
    "slide": ("slides", "slide"),
    "roll": ("rolls", "roll"),
    "separate": ("lifts off", "lift off"),
    "yield": ("yields", "yield"),
}
_STRAIGHT = 1e-6  # of the support's length: contacts nearer than this to a line are on it


def what_moves(support: Support, modes: Sequence[str]) -> str:
    """The contacts that slide, lift off or yield; if all stick, about what the base tips nevertheless.

    Args:
        support: the base.
        modes: of its contacts in a state that does not maintain all contacts.
    """
    parts = []
    for mode in dict.fromkeys(modes):
        if mode != "stick":
            numbers = [k for k, m in enumerate(modes, 1) if m == mode]
            one, many = _VERBS.get(mode, (mode, mode))
            parts.append(f"{_contacts(numbers)} {many if len(numbers) > 1 else one}")
    return "; ".join(parts) or _without_area(support)


def _without_area(support: Support) -> str:
    """Why a base may turn while all its contacts stick: they span nothing that could resist."""
    positions = np.array([contact.position for contact in support.contacts])
    spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    everyone = _contacts(list(range(1, len(positions) + 1)))
    where = "are on one line" if spread[0] > _STRAIGHT * support.length else "are at one point"
    if len(positions) == 1:
        where = "is the only one"
    return f"{everyone} {where}, about which nothing keeps it from tipping"


def _contacts(numbers: Sequence[int]) -> str:
    *others, last = map(str, numbers)
    return f"contacts {', '.join(others)} and {last}" if others else f"contact {last}"
