"""Does it stand? Three answers of different strength.

* The pivot solver's answer: one solution of the contact laws, in which the base stands or moves.
* *Weak* stability: some solution stands, i.e. admissible contact forces balance the wrench. A convex
  program (Clarabel), once with Coulomb's true cones and once with the friction pyramids; clamps whose set
  of forces is not convex are treated piece by piece.
* *Strong* stability: every solution stands. Proved or refuted by a search for one that moves; a refutation
  comes with the moving solution. For ordinary contacts the search keeps Coulomb's true cones, so that the
  verdict does not depend on facets (`planar_verdict` for feet in one plane, `cone_search` for others); with
  clamps it goes over all modes of the pyramids (`mode_search.find_motion`).

The words are those of Pang and Trinkle (2000). For three feet on a plane and friction that is not large
all three agree; with four or more feet, contacts that face each other, or clamps they need not.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import bounded_array
from ocptip.contact import mode_search
from ocptip.contact.bindings import laws
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.cone_motion import LAW_TOLERANCE, ConeProblem, MotionSearch, clearly_moving
from ocptip.contact.cone_search import find_cone_motion
from ocptip.contact.force_programs import largest_margin
from ocptip.contact.pivoting import SOLVED
from ocptip.contact.planar_verdict import feet_share_a_plane, find_planar_motion
from ocptip.contact.solver import on_springs, solution_from_search, solve, solve_randomly
from ocptip.contact.states import REST_TOLERANCE, ContactState
from ocptip.contact.support import LARGEST_WRENCH, Support

MARGIN_TOLERANCE = 1e-7
"""Margins above minus this (relative to the force unit) count as standing."""

_RANDOM_STARTS = 64
_GUESSES = 8
_ALL_COMBINATIONS = 64
_BALANCE = 1e-8


@dataclass(frozen=True)
class Equilibrium:
    """Outcome of the convex test whether admissible forces balance the wrench.

    Attributes:
        stands: True if they do.
        margin: largest force (N) by which all contact forces can stay inside their limits at once, at
            most the largest component of the wrench or preload (with more than 64 combinations of pieces a
            lower bound of it); negative: by how much the limits would have to be widened; -inf: no forces
            balance the wrench.
        forces: (n, d) the balancing forces in contact axes with that margin, N; None if there are none.
        certificate: (6,) if it does not stand and the force sets are convex: a velocity of the base
            (m/s, rad/s; largest element 1 in units of the support's length) at which the wrench has more
            power than any admissible contact forces can take up.
        programs: number of convex programs solved.
    """

    stands: bool
    margin: float
    forces: np.ndarray | None
    certificate: np.ndarray | None
    programs: int


@dataclass(frozen=True)
class StabilityVerdict:
    """All that is known about whether a support stands under a wrench.

    Attributes:
        verdict: "strong" (every solution of the contact laws stands), "weak" (some do), "none".
        decided: False if the search for a moving solution hit its limit; the verdict is then "weak"
            because "strong" was not proved.
        state: the pivot solver's state.
        pyramid, cone: the convex test with the friction pyramids and with the true cones.
        counterexample: a solution that moves, where the verdict is "weak". For ordinary contacts it lies on
            the true cones and is written as a state of another support, whose pyramids touch the cones from
            inside at the solution's forces (`cone_motion`).
        nodes: convex programs solved in the search for a moving solution; 0 if a start led to one at once.
        explanation: one or two sentences for people.
    """

    verdict: str
    decided: bool
    state: ContactState
    pyramid: Equilibrium
    cone: Equilibrium
    counterexample: ContactState | None
    nodes: int
    explanation: str

    @property
    def strong(self) -> bool:
        """True if every solution stands."""
        return self.verdict == "strong"

    @property
    def weak(self) -> bool:
        """True if at least one solution stands."""
        return self.verdict != "none"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "verdict": self.verdict,
            "decided": self.decided,
            "pyramid_margin": self.pyramid.margin,
            "cone_margin": self.cone.margin,
            "counterexample": None if self.counterexample is None else self.counterexample.modes,
            "nodes": self.nodes,
            "explanation": self.explanation,
        }


def stability(support: Support, wrench: ArrayLike, *, max_nodes: int = 5000) -> StabilityVerdict:
    """Strong or weak stability of a support under a wrench, or none.

    Args:
        support: the base on its contacts.
        wrench: (6,) force (N) and moment about the centre of mass (N m), base axes, with its weight; (3,) for
            a planar support.
        max_nodes: limit of the search for a moving solution.

    Raises:
        InputError: wrong shape, NaN, infinity or a number above 1e24.
        SolverError: a convex program ended without a verdict.
    """
    wrench = bounded_array("wrench", wrench, (support.wrench_size,), largest=LARGEST_WRENCH)
    state = solve(support, wrench)
    pyramid = equilibrium(support, wrench, cone=False)
    cone = equilibrium(support, wrench, cone=True)

    def verdict(word, explanation, *, decided=True, counterexample=None, nodes=0):
        return StabilityVerdict(
            word,
            decided,
            state,
            pyramid,
            cone,
            counterexample,
            nodes,
            explanation + _cone_remark(pyramid, cone),
        )

    scaled = support.conditioned
    ordinary = support.dimension == 3 and all(type(c) is UnilateralContact for c in support.contacts)
    if not cone.stands:
        return verdict("none", "No admissible contact forces balance the load: the base moves.")
    if ordinary:
        motion_search = _motion_on_cones(scaled, wrench, state, max_nodes)
    else:
        motion_search = _motion_on_pyramids(scaled, wrench, state, max_nodes)
    if motion_search.status == mode_search.EXHAUSTED:
        return verdict("strong", "Every solution of the contact laws stands.", nodes=motion_search.programs)
    if motion_search.status == mode_search.LIMIT:
        why = f"is beyond the numerical resolution ({motion_search.programs} programs)"
        if motion_search.programs >= max_nodes or motion_search.resolution:
            why = f"was not decided within {motion_search.programs} programs"
        if motion_search.resolution:
            why += f" (directions of motion resolved to {np.degrees(motion_search.resolution):.2g} degrees)"
        return verdict(
            "weak",
            f"A standing solution exists; whether a moving one does {why}.",
            decided=False,
            nodes=motion_search.programs,
        )
    modes = ", ".join(motion_search.state.modes) if motion_search.state else ""
    return verdict(
        "weak",
        "The contact laws have a solution that stands and one that moves "
        f"({modes}): rigid-body mechanics does not decide which one happens.",
        counterexample=motion_search.state,
        nodes=motion_search.programs,
    )


def state_remark(verdict: StabilityVerdict, largest_usage: float) -> str:
    """One sentence where the pivot solver's state does not look like the verdict; else empty.

    Args:
        verdict: the verdict.
        largest_usage: of the state's contacts, |tangential force| / limit on the true cones.
    """
    state = verdict.state
    pyramids = "The friction pyramids of the pivot solver"
    if verdict.strong and not state.persistent:
        return (
            f"{pyramids} slide: at their faces they are narrower than Coulomb's cones; the solution shown is "
            "on the cones."
        )
    if not verdict.weak and state.persistent:
        return (
            f"{pyramids} hold the base, reaching beyond Coulomb's cones at their edges; their forces are "
            "shown, which friction cannot bear."
        )
    if verdict.weak and state.persistent and largest_usage > 1 + _BALANCE:
        return (
            f"{100 * largest_usage:.0f} % of the friction is counted on Coulomb's cones at the normal forces "
            "of the pivot solver; the stability verdict asks for any admissible forces."
        )
    return ""


def standing_state(verdict: StabilityVerdict) -> ContactState | None:
    """The solution that stands with the largest margin, on the true cones; None if there is none.

    It has forces only: no subset of the pivot solver's variables belongs to it.
    """
    support, forces = verdict.state.support, verdict.cone.forces
    if not verdict.cone.stands or forces is None:
        return None
    states = verdict.state.states.select([verdict.state.index])
    return on_springs(states.changed(np.array([0]), standing_values(support, states.wrenches, forces[None])))[
        0
    ]


def standing_values(support: Support, wrenches: np.ndarray, forces: np.ndarray) -> dict[str, Any]:
    """What changes in states that stand with these forces (N, n, d); no bases belong to them."""
    balance = wrenches + forces.reshape(len(forces), -1) @ support.wrench_matrix.T
    size = np.max(np.abs(wrenches), axis=1, initial=1e-300)
    return {
        "contact_forces": forces, "contact_accelerations": 0.0, "solved": True, "status_codes": SOLVED,
        "subsets": -1, "basic": np.nan, "pivots": 0, "attempts": -1,
        "residual": np.max(np.abs(balance), axis=1) / size,
    }  # fmt: skip


def _motion_on_cones(
    support: Support, wrench: np.ndarray, state: ContactState, max_programs: int
) -> MotionSearch:
    """Search for a moving solution of ordinary contacts, whose facets do not count."""
    problem = ConeProblem.of(support, wrench)
    if max_programs and np.any(wrench):
        guesses = [state] if state.solved and not state.persistent else []
        for guess in [*guesses, *_moving_from_random_starts(support, wrench)[:_GUESSES]]:
            moving = problem.motion(guess.modes, guess.acceleration, guess.contact_forces)
            if moving is not None:
                return MotionSearch(mode_search.FOUND, moving, 0)
    if feet_share_a_plane(support):
        return find_planar_motion(problem, max_programs)
    return find_cone_motion(problem, max_programs)


def _motion_on_pyramids(
    support: Support, wrench: np.ndarray, state: ContactState, max_programs: int
) -> MotionSearch:
    """Search for a moving solution of any contacts, with their pyramids."""
    guesses = [state] if clearly_moving(state.states)[0] else _moving_from_random_starts(support, wrench)
    if guesses:
        return MotionSearch(mode_search.FOUND, guesses[0], 0)
    search = mode_search.find_motion(support.system, wrench, max_programs)
    moving, status = None, search.status
    if status == mode_search.FOUND:
        moving = solution_from_search(support, wrench, search)
        if not clearly_moving(moving.states)[0]:
            moving, status = None, mode_search.LIMIT
    return MotionSearch(status, moving, search.nodes)


def equilibrium(support: Support, wrench: ArrayLike, *, cone: bool = True) -> Equilibrium:
    """Test by convex programs whether admissible contact forces balance a wrench (weak stability).

    Args:
        support: the base on its contacts.
        wrench: (6,) or planar (3,), see `stability`.
        cone: Coulomb's true cones; False: the friction pyramids.

    Raises:
        InputError: wrong shape, NaN, infinity or a number above 1e24.
        SolverError: a program ended without a verdict.
    """
    wrench = bounded_array("wrench", wrench, (support.wrench_size,), largest=LARGEST_WRENCH)
    scaling = np.ones(len(wrench))
    scaling[support.dimension :] = 1.0 / support.length
    offsets = [c.force_offset() for c in support.contacts] + [
        list(c.auxiliary_rhs()) for c in support.contacts
    ]
    unit = max(
        float(np.max(np.abs(wrench * scaling))), max((abs(v) for o in offsets for v in o), default=0.0)
    )
    unit = unit or 1.0
    carrying = scaling[:, None] * support.wrench_matrix * laws.carries(support.contacts).ravel()
    u, s, _ = np.linalg.svd(carrying)
    basis = u[:, : len(s)][:, s > 1e-9]
    target = -(scaling * wrench) / unit
    unreachable = target - basis @ (basis.T @ target)
    if np.linalg.norm(unreachable) > REST_TOLERANCE * np.linalg.norm(target):
        motion = -unreachable * scaling
        return Equilibrium(False, -np.inf, None, motion / np.max(np.abs(unreachable)), 0)
    matrix = basis.T @ carrying
    outcomes: list[Equilibrium] = []
    pieces = [contact.force_pieces() for contact in support.contacts]
    for choice in itertools.product(*pieces):
        margin, forces, dual = largest_margin(support.contacts, choice, matrix, basis.T @ target, unit, cone)
        certificate = None
        if margin < -MARGIN_TOLERANCE and all(len(p) == 1 for p in pieces):
            motion = scaling * (basis @ dual)
            motion = motion if motion @ wrench > 0 else -motion
            certificate = motion / np.max(np.abs(motion / scaling))
        stands = margin >= -MARGIN_TOLERANCE
        outcomes.append(Equilibrium(stands, margin * unit, forces, certificate, 1))
        if len(outcomes) >= _ALL_COMBINATIONS and any(outcome.stands for outcome in outcomes):
            break
    return replace(max(outcomes, key=lambda outcome: outcome.margin), programs=len(outcomes))


def _moving_from_random_starts(support: Support, wrench: np.ndarray) -> list[ContactState]:
    """Verified solutions that move, by pivoting from random bases.

    Slower motion may be rounding: it is left to the search.
    """
    states = solve_randomly(support, wrench, _RANDOM_STARTS)
    lawful = states.law_violation() < LAW_TOLERANCE
    moving = np.flatnonzero(clearly_moving(states) & lawful)
    return [states[int(i)] for i in moving]


def _cone_remark(pyramid: Equilibrium, cone: Equilibrium) -> str:
    if pyramid.stands == cone.stands:
        return ""
    which = "pyramids" if pyramid.stands else "true cones"
    return f" The case lies between friction pyramid and cone: with the {which} admissible forces exist."
