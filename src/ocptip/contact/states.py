"""Solved contact states of a support, one per wrench, with the evidence in them.

`ContactStates` holds a batch of them as arrays, `ContactState` is a view of one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.contact import pivoting
from ocptip.contact.bindings import laws
from ocptip.contact.support import ContactSystem, Support
from ocptip.numerics.vectors import distinct_rows

REST_TOLERANCE = 1e-9
"""Accelerations below this, relative to the free acceleration of the contacts, count as rest."""

_FULL = 1 - 1e-6  # of the force of a drive or brake: from there on a wheel that moves along rolls

NO_SOLUTION, BEYOND_RESOLUTION = -1, -2

ARRAYS = (
    "wrenches", "solved", "status_codes", "subsets", "basic", "pivots", "attempts", "residual",
    "contact_forces", "contact_accelerations",
)  # fmt: skip
"""Attributes of `ContactStates` with one entry per state."""

STATUS = {
    pivoting.SOLVED: "solved",
    NO_SOLUTION: "no solution exists: no combination of modes satisfies the contact laws",
    BEYOND_RESOLUTION: "it moves, but how is beyond the numerical resolution: the inertia is too far from "
    "mass times the support's length squared",
    pivoting.RAY: "no solution: every path ended in a ray",
    pivoting.PIVOT_LIMIT: "no solution: pivot limit reached",
    pivoting.SINGULAR: "no solution: singular basis",
    pivoting.INACCURATE: "no solution: the residual stayed above the tolerance",
}
ADVICE = (
    "Rigid bodies on clamps that cannot move along their normal need not have a solution (compare "
    "Painleve's paradox): use a clamp that yields, smaller friction, or `stability` for a verdict. "
    "With ordinary contacts only, check that positions, inertia and friction are of plausible size."
)


@dataclass(frozen=True)
class ContactStates:
    """Solved states of one support, one per wrench.

    Attributes:
        support: the support.
        wrenches: (N, 6) or planar (N, 3), N and N m about the centre of mass.
        solved: (N,) True where there is a verified solution.
        status_codes: (N,) kernel status, see `status`.
        subsets: (N, n) admissible subset of each contact, -1 where not solved.
        basic: (N, m) values of the basic variables, contact by contact in the subset's order, N
            (accelerations are multiplied with the mass).
        pivots: (N,) basis exchanges over all attempts.
        attempts: (N,) which attempt succeeded: 0 warm, 1 cold, more: other starts; -1 search of all modes.
        residual: (N,) natural residual relative to the largest right-hand side, on the original data.
        contact_forces: (N, n, d) forces on the base in contact axes (n, t1, t2), N; NaN where not solved.
        contact_accelerations: (N, n, d) accelerations of the contact points in contact axes, m/s^2.
    """

    support: Support
    wrenches: np.ndarray
    solved: np.ndarray
    status_codes: np.ndarray
    subsets: np.ndarray
    basic: np.ndarray
    pivots: np.ndarray
    attempts: np.ndarray
    residual: np.ndarray
    contact_forces: np.ndarray
    contact_accelerations: np.ndarray

    def __len__(self) -> int:
        return len(self.wrenches)

    def __getitem__(self, index: int) -> ContactState:
        return ContactState(self, range(len(self))[index])

    def select(self, indices: ArrayLike | slice) -> ContactStates:
        """The selected states (any index of a NumPy array) as a separate batch."""
        return ContactStates(self.support, **{name: getattr(self, name)[indices] for name in ARRAYS})

    def changed(self, indices: np.ndarray, values: Mapping[str, ArrayLike]) -> ContactStates:
        """The same states with the named attributes replaced at the indices."""
        parts = {}
        for name, value in values.items():
            parts[name] = getattr(self, name).copy()
            parts[name][indices] = value
        return replace(self, **parts)

    def status(self, index: int) -> str:
        """Status of one state as a sentence."""
        return STATUS[int(self.status_codes[index])]

    @cached_property
    def forces(self) -> np.ndarray:
        """(N, n, d) forces on the base in base axes, N."""
        return np.einsum("kij,skj->ski", self.support.frames, self.contact_forces)

    @cached_property
    def acceleration(self) -> np.ndarray:
        """(N, 6) acceleration of the base: of its centre of mass (m/s^2) and angular (rad/s^2)."""
        return self._acceleration(self.support)

    def _acceleration(self, support: Support) -> np.ndarray:
        """(N, 6) acceleration that the forces would give to a base with the inertia of `support`."""
        flat = self.contact_forces.reshape(len(self), support.n_contacts * support.dimension)
        return (self.wrenches + flat @ support.wrench_matrix.T) @ support.inverse_mass

    @cached_property
    def persistent(self) -> np.ndarray:
        """(N,) True where the base stands: nothing slips, nothing lifts off.

        With contacts on one line, the base may turn about that line while no contact point accelerates;
        it does not stand then.
        """
        d = self.support.dimension
        usual = self.support.conditioned
        acceleration = self.acceleration if usual is self.support else self._acceleration(usual)
        turning = np.max(np.abs(acceleration[:, d:]), axis=1)
        turns = turning * self.support.length > self.rest_limit
        return self.solved & np.all(self.at_rest, axis=1) & ~turns

    @cached_property
    def scale(self) -> np.ndarray:
        """(N,) acceleration to which rest and violations are compared, m/s^2.

        The largest of the right-hand sides and of the accelerations of the free base, whose inertia is taken
        within the usual range (`Support.conditioned`).
        """
        support, d = self.support.conditioned, self.support.dimension
        rhs = np.max(np.abs(support.system.rhs(self.wrenches)), axis=1) / support.mass
        free = self.wrenches @ support.inverse_mass
        free[:, d:] *= support.length
        return np.maximum(rhs, np.max(np.abs(free), axis=1))

    @property
    def rest_limit(self) -> np.ndarray:
        """(N,) accelerations up to this count as rest, m/s^2."""
        return REST_TOLERANCE * self.scale

    @cached_property
    def at_rest(self) -> np.ndarray:
        """(N, n) True where a contact point does not accelerate."""
        largest = np.max(np.abs(self.contact_accelerations), axis=2)
        return largest <= self.rest_limit[:, None]

    def modes(self, index: int) -> list[str]:
        """Modes of the contacts in one state, by accelerations: stick, slide, roll, separate, yield."""
        if not self.solved[index]:
            return ["unknown"] * self.support.n_contacts
        limit = self.rest_limit[index]
        names = []
        for k, contact in enumerate(self.support.contacts):
            a = self.contact_accelerations[index, k]
            if self.at_rest[index, k]:
                names.append("stick")
            elif abs(a[0]) <= limit:
                weak = abs(self.contact_forces[index, k, 1]) >= _FULL * laws.largest_along(contact)
                names.append("roll" if weak and abs(a[-1]) <= limit else "slide")
            else:
                name = contact.automaton.names[self.subsets[index, k]]
                names.append(name if name not in ("stick", "slide", "roll") else "separate")
        return names

    def law_violation(self) -> np.ndarray:
        """Independent check: how far the states are from the contact laws and the equation of motion.

        Knows nothing of pools and bases: the base's acceleration follows from the forces, the contacts'
        accelerations from the base's, and forces and accelerations are put into `laws.law_violation`.

        Returns:
            (N,) largest violation relative to the largest right-hand side; NaN where not solved.
        """
        support, d = self.support, self.support.dimension
        unit = np.maximum(self.scale * support.mass, np.finfo(float).tiny)
        moved = (self.acceleration @ support.wrench_matrix).reshape(len(self), support.n_contacts, d)
        difference = np.max(np.abs(moved - self.contact_accelerations), axis=(1, 2))
        worst = difference * support.mass / unit
        for k, contact in enumerate(support.contacts):
            violation = laws.law_violation(
                contact, self.contact_forces[:, k], self.contact_accelerations[:, k], unit, support.mass
            )
            worst = np.maximum(worst, violation)
        return np.where(self.solved, worst, np.nan)

    @property
    def without_basis(self) -> np.ndarray:
        """(N,) True where forces that balance the wrench are known, but no basis of them, see `resting`."""
        return self.solved & (self.subsets[:, 0] < 0)

    @cached_property
    def force_maps(self) -> np.ndarray:
        """Exact derivative of the contact forces with respect to the wrench in the active basis.

        (N, n, d, 6) in contact axes: change of force (N) per unit of wrench (N, N m). NaN where not
        solved. Within one basis forces are affine in the wrench; where a basic variable is zero the map
        is a one-sided derivative. Where the base rests on compliant feet: of the springs' forces.
        """
        maps, elastic = self._shaped_maps(self.support.conditioned.system.force_matrix), self.support.elastic
        without = np.flatnonzero(self.without_basis)
        if len(without):
            carrying = self.support.wrench_matrix * laws.carries(self.support.contacts).ravel()
            maps[without] = -np.linalg.pinv(carrying).reshape(maps.shape[1:])
        resting = np.flatnonzero(self.persistent) if elastic else ()
        if elastic and len(resting):
            shared = elastic.share(self.wrenches[resting])
            maps[resting[shared.balanced]] = shared.maps[shared.balanced]
        return maps

    @cached_property
    def acceleration_maps(self) -> np.ndarray:
        """Exact derivative of the contact accelerations, (N, n, d, 6) in contact axes; as `force_maps`."""
        system = self.support.conditioned.system
        maps = self._shaped_maps(system.acceleration_matrix / self.support.mass)
        maps[self.without_basis] = 0.0
        return maps

    def _shaped_maps(self, quantity: np.ndarray) -> np.ndarray:
        """(N, n, d, 6) derivatives of `quantity @ x` in the active bases."""
        support = self.support
        columns, solutions, which = self._basis_solutions
        maps = np.moveaxis(quantity[:, columns], 1, 0) @ solutions
        return maps[which].reshape(len(self), support.n_contacts, support.dimension, support.wrench_size)

    @cached_property
    def _basis_solutions(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distinct bases: columns (U, m), d(basic)/d(wrench) (U, m, 6), and the basis of each state (N,)."""
        support = self.support
        # where the base rests, the derivatives do not depend on the inertia: take the one that rounds least
        resting = self.persistent if support.conditioned is not support else np.zeros(len(self), dtype=bool)
        unique, which = distinct_rows(np.column_stack([self.subsets, resting]))
        subsets, rests = unique[:, :-1], unique[:, -1] == 1
        columns = support.conditioned.system.active_columns(np.maximum(subsets, 0))
        solutions = np.full((*columns.shape, support.wrench_size), np.nan)
        for one, rows in ((support.conditioned, rests), (support, (subsets[:, 0] >= 0) & ~rests)):
            if np.any(rows):
                solutions[rows] = _derivatives(one.system, columns[rows])
        return columns, solutions, which


def _derivatives(system: ContactSystem, columns: np.ndarray) -> np.ndarray:
    """(U, m, 6) derivatives of the basic variables with respect to the wrench; bases of columns (U, m)."""
    bases = np.moveaxis(system.matrix[:, columns], 1, 0)
    try:
        return np.linalg.solve(bases, system.rhs_matrix)
    except np.linalg.LinAlgError:
        # a basis found by the search over all modes may be singular: take the smallest change
        return np.linalg.pinv(bases, rcond=1e-11) @ system.rhs_matrix


class ContactState:
    """One solved (or honestly unsolved) state; see :class:`ContactStates` for shapes and units.

    Args:
        states: the batch that holds it, or what makes that at the first look into the state.
        index: its place in the batch.
    """

    def __init__(self, states: ContactStates | Callable[[], ContactStates], index: int) -> None:
        self._states, self.index = states, index

    @property
    def states(self) -> ContactStates:
        """The batch that holds the state."""
        if not isinstance(self._states, ContactStates):
            self._states = self._states()
        return self._states

    @property
    def support(self) -> Support:
        return self.states.support

    @property
    def wrench(self) -> np.ndarray:
        """(6,) the wrench, N and N m about the centre of mass."""
        return self.states.wrenches[self.index]

    @property
    def solved(self) -> bool:
        """True if there is a verified solution."""
        return bool(self.states.solved[self.index])

    @property
    def status(self) -> str:
        """Status as a sentence, with advice where there is no solution."""
        text = self.states.status(self.index)
        beyond = self.states.status_codes[self.index] == BEYOND_RESOLUTION
        return text if self.solved or beyond else f"{text}. {ADVICE}"

    @property
    def persistent(self) -> bool:
        """True if the base stands in this solution: nothing slips, nothing lifts off, nothing turns."""
        return bool(self.states.persistent[self.index])

    @property
    def modes(self) -> list[str]:
        """The mode of each contact: stick, slide, separate or yield."""
        return self.states.modes(self.index)

    @property
    def forces(self) -> np.ndarray:
        """(n, d) contact forces on the base in base axes, N."""
        return self.states.forces[self.index]

    @property
    def contact_forces(self) -> np.ndarray:
        """(n, d) contact forces in contact axes (n, t1, t2), N."""
        return self.states.contact_forces[self.index]

    @property
    def contact_accelerations(self) -> np.ndarray:
        """(n, d) contact point accelerations in contact axes, m/s^2."""
        return self.states.contact_accelerations[self.index]

    @property
    def acceleration(self) -> np.ndarray:
        """(6,) acceleration of the base, m/s^2 and rad/s^2."""
        return self.states.acceleration[self.index]

    @property
    def pivots(self) -> int:
        """Basis exchanges."""
        return int(self.states.pivots[self.index])

    @property
    def residual(self) -> float:
        """Natural residual relative to the largest right-hand side."""
        return float(self.states.residual[self.index])

    @property
    def force_map(self) -> np.ndarray:
        """(n, d, 6) exact derivative of `contact_forces` with respect to the wrench."""
        return self.states.select([self.index]).force_maps[0]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "solved": self.solved,
            "status": self.status,
            "persistent": self.persistent,
            "modes": self.modes,
            "forces": self.forces.tolist(),
            "contact_forces": self.contact_forces.tolist(),
            "contact_accelerations": self.contact_accelerations.tolist(),
            "acceleration": self.acceleration.tolist(),
            "pivots": self.pivots,
            "residual": self.residual,
        }
