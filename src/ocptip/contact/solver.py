"""Contact states of a support: modes, forces and accelerations under given wrenches.

`solve` takes one wrench, `solve_many` an array of them. Both run the automaton-governed Lemke kernel and
return frozen results that carry their own evidence: the natural residual recomputed on the original
data, the pivots, and a status with advice where there is no solution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, bounded_array, finite_array
from ocptip.contact import mode_search, pivoting
from ocptip.contact.bindings import laws
from ocptip.contact.support import LARGEST_WRENCH, ContactSystem, Support

RESIDUAL_TOLERANCE = 1e-9
"""Largest natural residual, relative to the largest right-hand side, of a state called solved."""

REST_TOLERANCE = 1e-9
"""Accelerations below this, relative to the free acceleration of the contacts, count as rest."""

NO_SOLUTION, BEYOND_RESOLUTION = -1, -2
_LAWFUL = 1e-6
_RESOLVED = 1e9  # ratio of the inertia to the usual one, or its inverse, up to which motions are computed
_ATTEMPTS = 80
_FIRST_RANDOM = 4
_MAX_PIVOTS = 2000

_ARRAYS = (
    "wrenches", "solved", "status_codes", "subsets", "basic", "pivots", "attempts", "residual",
    "contact_forces", "contact_accelerations",
)  # fmt: skip

STATUS = {
    pivoting.SOLVED: "solved",
    NO_SOLUTION: "no solution exists: no combination of modes satisfies the contact laws",
    BEYOND_RESOLUTION: "it moves, but how is beyond the numerical resolution: the inertia is too far from "
    "mass times the support's length squared",
    pivoting.RAY: "no solution found: every path ended in a ray",
    pivoting.PIVOT_LIMIT: "no solution found: pivot limit reached",
    pivoting.SINGULAR: "no solution found: singular basis",
    pivoting.INACCURATE: "no solution found: the residual stayed above the tolerance",
}
ADVICE = (
    "Rigid bodies on clamps that cannot move along their normal need not have a solution (compare "
    "Painleve's paradox): use a clamp that yields, smaller friction, or `stability` for what can be said. "
    "With ordinary contacts only, check that positions, inertia and friction are of plausible size."
)


@dataclass(frozen=True)
class ContactStates:
    """Solved states of one support, one per wrench.

    Attributes:
        support: the support.
        wrenches: (N, 6) or planar (N, 3), N and N m about the centre of mass.
        solved: (N,) True where a verified solution was found.
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

    def select(self, indices: object) -> ContactStates:
        """The selected states (any index of a NumPy array) as a batch of their own."""
        return ContactStates(self.support, **{name: getattr(self, name)[indices] for name in _ARRAYS})

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
        return self.solved & np.all(self._at_rest, axis=1) & ~turns

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
    def _at_rest(self) -> np.ndarray:
        largest = np.max(np.abs(self.contact_accelerations), axis=2)
        return largest <= self.rest_limit[:, None]

    def modes(self, index: int) -> list[str]:
        """What each contact does in one state, by its accelerations: stick, slide, separate, yield."""
        if not self.solved[index]:
            return ["unknown"] * self.support.n_contacts
        limit = self.rest_limit[index]
        names = []
        for k, contact in enumerate(self.support.contacts):
            a = self.contact_accelerations[index, k]
            if self._at_rest[index, k]:
                names.append("stick")
            elif abs(a[0]) <= limit:
                names.append("slide")
            else:
                name = contact.automaton.names[self.subsets[index, k]]
                names.append(name if name not in ("stick", "slide") else "separate")
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

    @cached_property
    def force_maps(self) -> np.ndarray:
        """Exact derivative of the contact forces with respect to the wrench in the active basis.

        (N, n, d, 6) in contact axes: change of force (N) per unit of wrench (N, N m). NaN where not
        solved. Within one basis forces are affine in the wrench; where a basic variable is zero the map
        is a one-sided derivative.
        """
        return self._shaped_maps(self.support.conditioned.system.force_matrix)

    @cached_property
    def acceleration_maps(self) -> np.ndarray:
        """Exact derivative of the contact accelerations, (N, n, d, 6) in contact axes; as `force_maps`."""
        system = self.support.conditioned.system
        return self._shaped_maps(system.acceleration_matrix / self.support.mass)

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
        unique, which = np.unique(np.column_stack([self.subsets, resting]), axis=0, return_inverse=True)
        subsets, rests = unique[:, :-1], unique[:, -1] == 1
        columns = support.conditioned.system.active_columns(np.maximum(subsets, 0))
        solutions = np.full((*columns.shape, support.wrench_size), np.nan)
        for one, rows in ((support.conditioned, rests), (support, (subsets[:, 0] >= 0) & ~rests)):
            if np.any(rows):
                solutions[rows] = _derivatives(one.system, columns[rows])
        return columns, solutions, which.reshape(-1)


def _derivatives(system: ContactSystem, columns: np.ndarray) -> np.ndarray:
    """(U, m, 6) derivatives of the basic variables with respect to the wrench; bases of columns (U, m)."""
    bases = np.moveaxis(system.matrix[:, columns], 1, 0)
    try:
        return np.linalg.solve(bases, system.rhs_matrix)
    except np.linalg.LinAlgError:
        # a basis found by the search over all modes may be singular: take the smallest change
        return np.linalg.pinv(bases, rcond=1e-11) @ system.rhs_matrix


@dataclass(frozen=True)
class ContactState:
    """One solved (or honestly unsolved) state; see :class:`ContactStates` for shapes and units."""

    states: ContactStates
    index: int

    @property
    def support(self) -> Support:
        return self.states.support

    @property
    def wrench(self) -> np.ndarray:
        """(6,) the wrench, N and N m about the centre of mass."""
        return self.states.wrenches[self.index]

    @property
    def solved(self) -> bool:
        """True if a verified solution was found."""
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
        """What each contact does: stick, slide, separate or yield."""
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


def solve(support: Support, wrench: object) -> ContactState:
    """Solve the contact problem under one wrench.

    Args:
        support: the base on its contacts.
        wrench: (6,) force (N) and moment about the centre of mass (N m) on the base, base axes, own
            weight included (`support.wrench(loads)` adds it); (3,) for a planar support.

    Raises:
        InputError: wrong shape, NaN, infinity or a number above 1e24.
    """
    wrench = bounded_array("wrench", wrench, (support.wrench_size,), largest=LARGEST_WRENCH)
    return solve_many(support, wrench[None])[0]


def solve_many(
    support: Support,
    wrenches: object,
    *,
    warm_start: bool = True,
    initial: ContactState | None = None,
    search: bool = True,
) -> ContactStates:
    """Solve the contact problem under many wrenches of one support.

    Args:
        support: the base on its contacts.
        wrenches: (N, 6) or planar (N, 3), see `solve`.
        warm_start: start each state from the basis of the one before (faster along a path; with more
            than one solution the branch is then followed). False: every state from scratch, so that a
            state does not depend on its neighbours.
        initial: a solved state of the same support from whose basis the first one starts.
        search: where pivoting finds no solution (possible with clamps only), search all modes by
            branch and bound: slower, but it ends with a solution or with the proof that there is none.

    Raises:
        InputError: wrong shape, NaN or infinity, or an `initial` of another support.
    """
    wrenches = finite_array("wrenches", wrenches, (None, support.wrench_size))
    start = np.full(support.n_contacts, -1, dtype=np.int64)
    if initial is not None:
        if initial.support is not support:
            raise InputError("initial: is a state of another support")
        start = initial.states.subsets[initial.index].astype(np.int64)
    if support.conditioned is support:
        return _solve_all(support, wrenches, warm_start, start, search)
    # a base that rests does so with any inertia: the given one decides only how the others move
    states = _solve_all(support.conditioned, wrenches, warm_start, start, search)
    moving = np.flatnonzero(~states.persistent)
    states = replace(states, support=support)
    if len(moving) == 0:
        return states
    try:
        others = _solve_moving(support, wrenches[moving], warm_start, start)
    except InputError:  # a contact's own equations are singular at the given inertia
        others = None
    if others is None:
        return _without_answer(states, moving[states.solved[moving]])
    # rounding, magnified by the ratio of inertias: laws are broken, or no contact is seen to move that does
    unseen = np.all(others._at_rest, axis=1) & ~others.persistent & ~np.all(states._at_rest[moving], axis=1)
    unlawful = others.law_violation() > _LAWFUL
    lost = np.flatnonzero(others.solved & states.solved[moving] & (unseen | unlawful))
    return _replaced(states, moving, _without_answer(others, lost))


def _solve_moving(support, wrenches, warm_start, start) -> ContactStates | None:
    """Solve with an unusual inertia as it is; None if it is beyond what can be resolved."""
    if not support.inertia_is_within(_RESOLVED):
        return None
    return _solve_all(support, wrenches, warm_start, start, search=False)


def _solve_all(support, wrenches, warm_start, start, search) -> ContactStates:
    """Solve with the inertia as it is, by pivoting and, if asked for, by search."""
    states = _pivot_all(support, wrenches, warm_start, start, 1, np.ones(len(wrenches), dtype=np.uint64))
    return _search_unsolved(states) if search else states


def _without_answer(states: ContactStates, indices: np.ndarray) -> ContactStates:
    """The same states with those at the indices marked as beyond the numerical resolution."""
    changes = {
        "solved": False, "status_codes": BEYOND_RESOLUTION, "subsets": -1, "basic": np.nan,
        "residual": np.inf, "contact_forces": np.nan, "contact_accelerations": np.nan,
    }  # fmt: skip
    parts = {}
    for name, value in changes.items():
        parts[name] = getattr(states, name).copy()
        parts[name][indices] = value
    return ContactStates(**{**{name: getattr(states, name) for name in ("support", *_ARRAYS)}, **parts})


def _replaced(states: ContactStates, indices: np.ndarray, others: ContactStates) -> ContactStates:
    """The same states with those at the indices taken from others."""
    parts = {name: getattr(states, name).copy() for name in _ARRAYS}
    for name, part in parts.items():
        part[indices] = getattr(others, name)
    return ContactStates(states.support, **parts)


def solve_randomly(support: Support, wrench: object, count: int, seed: int = 0) -> ContactStates:
    """Solve the contact problem under one wrench `count` times from random start bases.

    Where the contact laws have more than one solution, different starts may end in different ones. States
    in which no solution is found are simply not solved.
    """
    wrench = finite_array("wrench", wrench, (support.wrench_size,))
    seeds = np.random.default_rng(seed).integers(2**63, size=count, dtype=np.uint64)
    start = np.full(support.n_contacts, -1, dtype=np.int64)
    return _pivot_all(support, np.tile(wrench, (count, 1)), False, start, _FIRST_RANDOM, seeds)


def _pivot_all(support, wrenches, warm_start, start, first_attempt, seeds) -> ContactStates:
    """Run the kernel and wrap its output."""
    system = support.system
    count, n, m = len(wrenches), support.n_contacts, len(system.rhs_offset)
    subsets = np.full((count, n), -1, dtype=np.int64)
    basic = np.full((count, m), np.nan)
    status, pivots, attempts = (np.zeros(count, dtype=np.int64) for _ in range(3))
    residual = np.full(count, np.inf)
    forces, accelerations = (np.full((count, n, support.dimension), np.nan) for _ in range(2))
    force_columns, acceleration_columns = system.local_columns
    force = wrenches @ system.rhs_matrix.T
    pivoting.solve_batch(
        system.columns_by_row, system.column_extent, system.first_column, system.row_start,
        system.subsets, system.subset_start, system.successor, system.entering,
        system.start_count, system.start_first, system.start_subset, system.start_inverse,
        system.block_start, system.lifts,
        force + system.rhs_offset, wrenches @ system.hint_matrix.T, system.gauge, warm_start, start,
        _MAX_PIVOTS, first_attempt, _ATTEMPTS, seeds,
        system.plain_columns_by_row, force + system.plain_rhs_offset, RESIDUAL_TOLERANCE,
        force_columns, system.force_offset.reshape(n, -1), acceleration_columns,
        subsets, basic, status, pivots, attempts, residual, forces, accelerations,
    )  # fmt: skip
    return ContactStates(
        support=support,
        wrenches=wrenches,
        solved=status == pivoting.SOLVED,
        status_codes=status,
        subsets=subsets,
        basic=basic,
        pivots=pivots,
        attempts=attempts,
        residual=residual,
        contact_forces=forces,
        contact_accelerations=accelerations,
    )


def _search_unsolved(states: ContactStates) -> ContactStates:
    """The same states, with those that pivoting left open decided by the search over all modes."""
    unsolved = np.flatnonzero(~states.solved)
    if len(unsolved) == 0:
        return states
    parts = {
        name: getattr(states, name).copy()
        for name in (
            "solved", "status_codes", "subsets", "basic", "attempts", "residual",
            "contact_forces", "contact_accelerations",
        )
    }  # fmt: skip
    parts["attempts"][unsolved] = -1
    for i in unsolved:
        found = mode_search.find_solution(states.support.system, states.wrenches[i])
        if found.status == mode_search.FOUND:
            state = solution_from_search(states.support, states.wrenches[i], found)
            for name, part in parts.items():
                part[i] = getattr(state.states, name)[0]
        elif found.status == mode_search.EXHAUSTED:
            parts["status_codes"][i] = NO_SOLUTION
    return replace(states, **parts)


def solution_from_search(
    support: Support, wrench: np.ndarray, found: mode_search.SearchResult
) -> ContactState:
    """Wrap a solution found by `mode_search` as a state."""
    system, shape = support.system, (1, support.n_contacts, support.dimension)
    columns = system.active_columns(found.subsets[None])[0]
    forces = system.force_matrix[:, columns] @ found.basic + system.force_offset
    accelerations = system.acceleration_matrix[:, columns] @ found.basic / support.mass
    return ContactStates(
        support=support,
        wrenches=wrench[None],
        solved=np.array([found.status == mode_search.FOUND]),
        status_codes=np.array([pivoting.SOLVED]),
        subsets=found.subsets[None],
        basic=found.basic[None],
        pivots=np.array([0]),
        attempts=np.array([-1]),
        residual=np.array([found.residual]),
        contact_forces=forces.reshape(shape),
        contact_accelerations=accelerations.reshape(shape),
    )[0]
