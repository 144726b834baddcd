"""Contact states of a support: modes, forces and accelerations under given wrenches.

`solve` takes one wrench, `solve_many` an array of them. Both run the automaton-governed Lemke kernel and
return frozen results that carry their evidence: the natural residual recomputed on the original data, the
pivots, and a status with advice where there is no solution.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, bounded_array, finite_array, whole_number
from ocptip.contact import mode_search, pivoting
from ocptip.contact.states import ARRAYS, BEYOND_RESOLUTION, NO_SOLUTION, ContactState, ContactStates
from ocptip.contact.support import LARGEST_WRENCH, Support

_LAWFUL = 1e-6
_RESOLVED = 1e9  # ratio of the inertia to the usual one, or its inverse, up to which motions are computed
_ATTEMPTS = 80
_FIRST_RANDOM = 4
_CHUNK = 4096  # states that one thread solves in one go
_MEMORY = 32  # bases that are tried before pivoting
_FROM_SCRATCH = (False, 0, 1, _ATTEMPTS, LARGEST_WRENCH)
_ONE_SEED, _NO_SIDES = np.ones(1, np.uint64), np.empty((3, 0, 0))


def solve(support: Support, wrench: ArrayLike) -> ContactState:
    """Solve the contact problem under one wrench.

    Args:
        support: the base on its contacts.
        wrench: (6,) force (N) and moment about the centre of mass (N m) on the base, base axes, with its
            weight (`support.wrench(loads)` adds it); (3,) for a planar support.

    Raises:
        InputError: wrong shape, NaN, infinity or a number above 1e24.
    """
    system = support.system
    shape, integers, floats = system.one
    # arrays that fit are checked by the kernel, in a tenth of the time; it leaves to others what it cannot do
    if (
        isinstance(wrench, np.ndarray)
        and wrench.dtype == np.float64
        and wrench.shape == shape
        and support.conditioned is support
        and support.elastic is None
    ):
        codes, numbers = np.empty(integers, np.int64), np.empty(floats)
        numbers[: len(wrench)] = wrench
        if pivoting.solve_batch(*system.tables, *_FROM_SCRATCH, _ONE_SEED, _NO_SIDES, codes, numbers):
            return ContactState(partial(_from_kernel, support, codes, numbers), 0)
    wrench = bounded_array("wrench", wrench, (support.wrench_size,), largest=LARGEST_WRENCH)
    return solve_many(support, wrench[None])[0]


def solve_many(
    support: Support,
    wrenches: ArrayLike,
    *,
    warm_start: bool | Literal["any"] = True,
    initial: ContactState | None = None,
    search: bool = True,
    threads: int | None = None,
) -> ContactStates:
    """Solve the contact problem under many wrenches of one support.

    Where the base rests on compliant feet, the forces are those of their springs (`contact.elastic`). Modes,
    and whether it rests, are those of rigid contacts.

    Args:
        support: the base on its contacts.
        wrenches: (N, 6) or planar (N, 3), see `solve`.
        warm_start: start each state from the basis of the one before (faster along a path; with more than one
            solution neighbours then get similar ones). "any": from any basis that solved one of the states
            before, the fastest choice for states in no order; which of several solutions a state gets then
            depends on the states before it in its chunk of 4096. False: every state from scratch, so that a
            state does not depend on its neighbours.
        initial: a solved state of the same support from whose basis the first one starts.
        search: where pivoting finds no solution (possible with clamps only), search all modes by
            branch-and-bound: slower, but it ends with a solution or with the proof that there is none.
        threads: maximum number that solve chunks of states at the same time, unless each starts from the one
            before; None: as many as there are processor cores. The results do not depend on it.

    Raises:
        InputError: wrong shape, NaN or infinity, or an `initial` of another support.
    """
    if not isinstance(warm_start, bool) and warm_start != "any":
        raise InputError(f"warm_start: must be True, False or 'any', got {warm_start!r}")
    if threads is not None:
        threads = whole_number("threads", threads, 1)
    wrenches = finite_array("wrenches", wrenches, (None, support.wrench_size))
    start = support.no_subsets
    if initial is not None:
        if initial.support is not support:
            raise InputError("initial: is a state of another support")
        start = initial.states.subsets[initial.index].astype(np.int64)
    return on_springs(_solve(support, wrenches, warm_start, start, search, threads))


def on_springs(states: ContactStates) -> ContactStates:
    """The same states, with the forces of the springs where the base rests on compliant feet.

    Forces stay what they are where no set of pressing feet carries the load without friction cones, which
    takes normals that differ.
    """
    elastic = states.support.elastic
    resting = np.flatnonzero(states.persistent) if elastic else ()
    if elastic is None or not len(resting):
        return states
    shared = elastic.share(states.wrenches[resting])
    return states.changed(resting[shared.balanced], {"contact_forces": shared.forces[shared.balanced]})


def _solve(support, wrenches, warm_start, start, search, threads) -> ContactStates:
    """Solve with rigid contacts."""
    if support.conditioned is support:
        return _solve_all(support, wrenches, warm_start, start, search, threads)
    # a base that rests does so with any inertia: the given one decides only how the others move
    states = _solve_all(support.conditioned, wrenches, warm_start, start, search, threads)
    moving = np.flatnonzero(~states.persistent)
    states = replace(states, support=support)
    if len(moving) == 0:
        return states
    others = None  # where an unusual inertia is beyond what can be resolved
    if support.inertia_is_within(_RESOLVED):
        with suppress(InputError):  # a contact's own equations are singular at the given inertia
            others = _solve_all(support, wrenches[moving], warm_start, start, False, threads)
    if others is None:
        return _without_answer(states, moving[states.solved[moving]])
    # rounding, magnified by the ratio of inertias: laws are broken, or no contact is seen to move that does
    unseen = np.all(others.at_rest, axis=1) & ~others.persistent & ~np.all(states.at_rest[moving], axis=1)
    unlawful = others.law_violation() > _LAWFUL
    lost = np.flatnonzero(others.solved & states.solved[moving] & (unseen | unlawful))
    others = _without_answer(others, lost)
    return states.changed(moving, {name: getattr(others, name) for name in ARRAYS})


def _solve_all(support, wrenches, warm_start, start, search, threads) -> ContactStates:
    """Solve with the inertia as it is, by pivoting and, if asked for, by search."""
    seeds = np.ones(len(wrenches), dtype=np.uint64)
    states = _pivot_all(support, wrenches, warm_start, start, 1, seeds, threads)
    return _search_unsolved(states) if search else states


def _without_answer(states: ContactStates, indices: np.ndarray) -> ContactStates:
    """The same states with those at the indices marked as beyond the numerical resolution."""
    return states.changed(
        indices,
        {
            "solved": False, "status_codes": BEYOND_RESOLUTION, "subsets": -1, "basic": np.nan,
            "residual": np.inf, "contact_forces": np.nan, "contact_accelerations": np.nan,
        },
    )  # fmt: skip


def solve_randomly(support: Support, wrench: ArrayLike, count: int) -> ContactStates:
    """Solve the contact problem under one wrench `count` times from random start bases.

    Where the contact laws have more than one solution, different starts may end in different ones. States
    without a solution are marked as not solved.
    """
    wrench = finite_array("wrench", wrench, (support.wrench_size,))
    seeds = np.random.default_rng(0).integers(2**63, size=count, dtype=np.uint64)
    start = support.no_subsets
    return _pivot_all(support, np.tile(wrench, (count, 1)), False, start, _FIRST_RANDOM, seeds)


def _from_kernel(support: Support, codes: np.ndarray, numbers: np.ndarray) -> ContactStates:
    """The results of `pivoting.solve_batch`."""
    n, d, w, m = support.n_contacts, support.dimension, support.wrench_size, len(support.system.rhs_offset)
    count = len(codes) // (n + 3)
    subsets, status, pivots, attempts = np.split(codes, [count * n, count * (n + 1), count * (n + 2)])
    wrenches, basic, residual, forces, accelerations = np.split(
        numbers, np.cumsum([count * w, count * m, count, count * n * d])
    )
    return ContactStates(
        support=support,
        wrenches=wrenches.reshape(count, w),
        solved=status == pivoting.SOLVED,
        status_codes=status,
        subsets=subsets.reshape(count, n),
        basic=basic.reshape(count, m),
        pivots=pivots,
        attempts=attempts,
        residual=residual,
        contact_forces=forces.reshape(count, n, d),
        contact_accelerations=accelerations.reshape(count, n, d),
    )


def _pivot_all(support, wrenches, warm_start, start, first_attempt, seeds, threads=1) -> ContactStates:
    """Run the kernel, where states do not follow each other chunk by chunk."""
    memory = _MEMORY if warm_start == "any" else 0
    how = (bool(warm_start), memory, first_attempt, _ATTEMPTS, np.inf)
    count = len(wrenches)
    if warm_start is True or count <= _CHUNK:
        return _pivot(support, how, start, wrenches, seeds)
    chunks = [slice(i, i + _CHUNK) for i in range(0, count, _CHUNK)]
    with ThreadPoolExecutor(min(threads or os.cpu_count() or 1, len(chunks))) as pool:
        run = partial(_pivot, support, how, start)
        parts = list(pool.map(run, [wrenches[one] for one in chunks], [seeds[one] for one in chunks]))
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS}
    return ContactStates(support, **joined)


def _pivot(support, how, start, wrenches, seeds) -> ContactStates:
    """Run the kernel on some wrenches, the first one from the subsets `start`."""
    system, count = support.system, len(wrenches)
    force = wrenches @ system.rhs_matrix.T
    rhs = force + system.rhs_offset
    plain = rhs if system.plain_rhs_offset is system.rhs_offset else force + system.plain_rhs_offset
    sides = np.stack([rhs, wrenches @ system.hint_matrix.T, plain])
    _, integers, floats = system.one
    codes, numbers = np.empty(count * integers, np.int64), np.empty(count * floats)
    codes[: len(start)] = start[: len(codes)]
    numbers[: wrenches.size] = wrenches.ravel()
    pivoting.solve_batch(*system.tables, *how, seeds, sides, codes, numbers)
    return _from_kernel(support, codes, numbers)


def _search_unsolved(states: ContactStates) -> ContactStates:
    """The same states, with those that pivoting left open decided by the search over all modes."""
    unsolved = np.flatnonzero(~states.solved)
    if len(unsolved) == 0:
        return states
    table: dict[int, ContactStates] = {}
    excluded = []
    for i in unsolved.tolist():
        result = mode_search.find_solution(states.support.system, states.wrenches[i])
        if result.status == mode_search.FOUND:
            table[i] = solution_from_search(states.support, states.wrenches[i], result).states
        elif result.status == mode_search.EXHAUSTED:
            excluded.append(i)
    states = states.changed(unsolved, {"attempts": -1})
    states = states.changed(np.array(excluded, dtype=int), {"status_codes": NO_SOLUTION})
    if not table:
        return states
    decided = [name for name in ARRAYS if name not in ("wrenches", "pivots")]
    parts = {name: np.concatenate([getattr(one, name) for one in table.values()]) for name in decided}
    return states.changed(np.array(list(table)), parts)


def solution_from_search(
    support: Support, wrench: np.ndarray, search_result: mode_search.SearchResult
) -> ContactState:
    """Wrap a solution of `mode_search` as a state.

    Raises:
        ValueError: the search ended without one.
    """
    if search_result.subsets is None or search_result.basic is None:
        raise ValueError(f"solution: the search has none, it ended as {search_result.status!r}")
    system, shape = support.system, (1, support.n_contacts, support.dimension)
    columns = system.active_columns(search_result.subsets[None])[0]
    forces = system.force_matrix[:, columns] @ search_result.basic + system.force_offset
    accelerations = system.acceleration_matrix[:, columns] @ search_result.basic / support.mass
    return ContactStates(
        support=support,
        wrenches=wrench[None],
        solved=np.array([True]),
        status_codes=np.array([pivoting.SOLVED]),
        subsets=search_result.subsets[None],
        basic=search_result.basic[None],
        pivots=np.array([0]),
        attempts=np.array([-1]),
        residual=np.array([search_result.residual]),
        contact_forces=forces.reshape(shape),
        contact_accelerations=accelerations.reshape(shape),
    )[0]
