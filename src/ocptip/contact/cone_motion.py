"""Moving solutions on Coulomb's true cones: Newton's method on the contact laws, and their proof.

A solution of the laws with friction pyramids does not solve those with cones, nor conversely. Here a guess
(from pyramids, or from a relaxation) becomes a solution on the cones. It is then written as a state of a
support whose pyramids touch the cones from inside at exactly the forces of the solution. Where a foot slides,
an edge of its pyramid points against its velocity. So the check of all other states
(`ContactStates.law_violation`) also checks these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ocptip.contact.bindings.unilateral import LEAST_FRICTION, UnilateralContact
from ocptip.contact.mode_search import FOUND, SearchResult
from ocptip.contact.solver import solution_from_search
from ocptip.contact.states import ContactState, ContactStates
from ocptip.contact.support import Support
from ocptip.numerics.non_negative import non_negative

STICK, SLIDE, SEPARATE = "stick", "slide", "separate"

CLEAR_MOTION = 1e-6
"""Acceleration, relative to the free base's, from which a solution counts as moving."""

_CLEAR_OF_ROUNDING = 1e-9
"""Mass times acceleration, relative to the largest contact force, from which it is no rounding of forces."""

LAW_TOLERANCE = 1e-8
_STEPS = 40
_DAMPING = 1e-3
_BALANCE = 1e-11
_FACETS = 24  # a multiple of three: the middle of the pyramid lies inside one triangle of the mode list


@dataclass(frozen=True)
class MotionSearch:
    """Outcome of a search for a moving solution on true cones.

    Attributes:
        status: `"exhausted"` (no solution moves), `"found"`, or `"node limit"` (undecided).
        state: the moving solution, if there is one.
        programs: number of convex programs solved.
        resolution: where undecided, directions of motion or of sliding nearer than this (rad) are one.
    """

    status: str
    state: ContactState | None
    programs: int
    resolution: float = 0.0


def ordinary_contacts(support: Support) -> list[UnilateralContact]:
    """The contacts of a support that has no others."""
    return [contact for contact in support.contacts if isinstance(contact, UnilateralContact)]


@dataclass(frozen=True)
class ConeProblem:
    """A support of ordinary spatial contacts under a wrench in units of its length, its mass and a force.

    Attributes:
        support: the support; wrench: (6,) about its centre of mass, N, N m.
        unit: force, N.
        mass_matrix: (6, 6); load: (6,) with largest element 1.
        contact_wrenches: (n, 6, 3) wrench per force in contact axes (n, t1, t2).
        friction: (n,).
        free: (6,) acceleration without contacts.
    """

    support: Support
    wrench: np.ndarray
    unit: float
    mass_matrix: np.ndarray
    load: np.ndarray
    contact_wrenches: np.ndarray
    friction: np.ndarray
    free: np.ndarray

    @classmethod
    def of(cls, support: Support, wrench: np.ndarray) -> ConeProblem:
        scaling = np.r_[np.ones(3), np.full(3, 1 / support.length)]
        load = scaling * wrench
        unit = float(np.max(np.abs(load))) or 1.0
        mass_matrix = np.linalg.inv(support.inverse_mass * support.mass / np.outer(scaling, scaling))
        blocks = (scaling[:, None] * support.wrench_matrix).reshape(6, -1, 3)
        return cls(
            support=support,
            wrench=wrench,
            unit=unit,
            mass_matrix=mass_matrix,
            load=load / unit,
            contact_wrenches=blocks.swapaxes(0, 1),
            friction=np.array([c.friction for c in ordinary_contacts(support)]),
            free=np.linalg.solve(mass_matrix, load / unit),
        )

    def motion(
        self, what: Sequence[str], acceleration: np.ndarray, forces: np.ndarray
    ) -> ContactState | None:
        """A proved moving solution near a guess, in which each contact does what the list says; or None.

        Args:
            what: stick, slide or separate for each contact.
            acceleration: (6,) guess of the base's acceleration, m/s^2, rad/s^2.
            forces: (n, 3) guess of the contact forces in contact axes, N.
        """
        lengths = np.r_[np.ones(3), np.full(3, self.support.length)]
        scaled = acceleration * lengths * self.support.mass / self.unit
        result = self._refined(np.array(what), scaled, forces / self.unit)
        return None if result is None else self._state(result * self.unit)

    def _refined(self, what: np.ndarray, acceleration: np.ndarray, forces: np.ndarray) -> np.ndarray | None:
        """Newton's method in the problem's units: forces (n, 3)."""
        sliding, sticking = np.flatnonzero(what == SLIDE), np.flatnonzero(what == STICK)
        W, mu = self.contact_wrenches, self.friction[sliding]
        normals, planes = W[sliding, :, 0], W[sliding, :, 1:]
        held = W[sticking].transpose(1, 0, 2).reshape(6, -1)
        a, N, K = acceleration, np.maximum(forces[sliding, 0], 0.0), forces[sticking].ravel()
        m, s = len(sliding), K.size
        still = np.vstack([normals, held.T])  # directions in which nothing accelerates
        slowest = CLEAR_MOTION * np.linalg.norm(self.free)
        for _ in range(_STEPS):
            u = np.einsum("kic,i->kc", planes, a)
            speed = np.linalg.norm(u, axis=1)
            if np.linalg.norm(a) <= slowest or np.min(speed, initial=np.inf) <= 1e-9 * np.linalg.norm(a):
                return None
            t = u / speed[:, None]
            pushes = normals.T - np.einsum("k,kic,kc->ik", mu, planes, t)
            error = self.load + pushes @ N + held @ K - self.mass_matrix @ a
            loose = -still @ a
            size = max(np.max(np.abs(error)), np.max(np.abs(loose), initial=0.0))
            if size <= _BALANCE:
                return self._admissible(what, a, N, K, t)
            # The direction of sliding turns with the acceleration: its derivative is across the direction,
            # over the speed.
            across = (np.eye(2) - t[:, :, None] * t[:, None]) / speed[:, None, None]
            per_a = self.mass_matrix + np.einsum("k,kic,kcd,kjd->ij", mu * N, planes, across, planes)
            # of the steps that satisfy the equations a short one: they leave some forces open
            weight = min(_DAMPING, size)
            step = np.hstack([held, -per_a])
            A = np.zeros((6 + m + s + m + s + 6, m + s + 6))
            A[:6, :m], A[:6, m:], A[6 : 6 + m + s, m + s :] = pushes, step, still
            A[6 + m + s :] = weight * np.eye(m + s + 6)
            b = np.r_[self.mass_matrix @ a - self.load - held @ K, loose, weight * N, np.zeros(s + 6)]
            try:
                x, _ = non_negative(A, b, signed=s + 6)
            except RuntimeError:  # its limit of iterations
                return None
            change = x[m:]
            N, K, a = x[:m], K + change[:s], a + change[s:]
        return None

    def _admissible(self, what, a, N, K, t) -> np.ndarray | None:
        forces = np.zeros((len(what), 3))
        forces[what == SLIDE, 0] = N
        forces[what == SLIDE, 1:] = -(self.friction[what == SLIDE] * N)[:, None] * t
        forces[what == STICK] = K.reshape(-1, 3)
        lifts = self.contact_wrenches[what == SEPARATE, :, 0] @ a
        spare = self.friction * forces[:, 0] - np.linalg.norm(forces[:, 1:], axis=1)
        kept = np.min(spare[what == STICK], initial=0.0) >= -_BALANCE
        return forces if kept and np.min(lifts, initial=0.0) >= -_BALANCE else None

    def _state(self, forces: np.ndarray) -> ContactState | None:
        """The state with contact forces (n, 3), N, if it obeys the laws and moves."""
        support = self.support
        acceleration = support.inverse_mass @ (self.wrench + support.wrench_matrix @ forces.ravel())
        contact_accelerations = (acceleration @ support.wrench_matrix).reshape(-1, 3)
        # Slower contacts count as resting: below this a direction of motion is a rounding error.
        rest = 1e-10 * np.linalg.norm(self.free) * self.unit / support.mass
        contacts, elements = [], []
        for contact, force, u in zip(ordinary_contacts(support), forces, contact_accelerations, strict=True):
            lifts, slides = u[0] > rest, np.linalg.norm(u[1:]) > rest
            against = -u[1:] if slides else force[1:]
            contacts.append(_with_edge_along(contact, against))
            if lifts:
                elements.append({"gn", "g1", "g2"})
            elif slides or contact.friction == 0:
                elements.append({"g1", "g2", "l1"})
            else:
                third = _FACETS // 3
                elements.append({"l1", f"l{1 + third}", f"l{1 + 2 * third}"})
        aligned = support.varied(contacts)
        subsets, basic = [], []
        for k, contact in enumerate(contacts):
            automaton, columns = contact.automaton, contact.columns
            names = [{columns.names[i] for i in subset} for subset in automaton.subsets]
            subsets.append(names.index(elements[k]))
            active = automaton.subsets[subsets[-1]]
            turn = contact.frame.T @ support.contacts[k].frame
            both = np.vstack([columns.force[:, active], columns.acceleration[:, active]])
            target = np.r_[turn @ forces[k], turn @ contact_accelerations[k] * support.mass]
            basic.append(np.maximum(np.linalg.lstsq(both, target, rcond=None)[0], 0.0))
        basic = np.concatenate(basic)
        system = aligned.system
        rhs = system.rhs_matrix @ self.wrench + system.plain_rhs_offset
        columns = system.active_columns(np.array([subsets]))[0]
        residual = np.max(np.abs(system.plain_matrix[:, columns] @ basic - rhs)) / np.max(np.abs(rhs))
        search_result = SearchResult(FOUND, np.array(subsets), basic, float(residual), 0)
        state = solution_from_search(aligned, self.wrench, search_result)
        lawful = state.states.law_violation()[0] < LAW_TOLERANCE
        return state if lawful and clearly_moving(state.states)[0] else None


def clearly_moving(states: ContactStates) -> np.ndarray:
    """(N,) True where a solution moves by more than rounding of its forces could make believe."""
    support = states.support
    turning = np.abs(states.acceleration[:, support.dimension :]) * support.length
    fastest = np.maximum(np.abs(states.contact_accelerations).max(axis=(1, 2)), turning.max(axis=1))
    largest = np.abs(states.contact_forces).max(axis=(1, 2)) / support.mass
    least = np.maximum(CLEAR_MOTION * states.scale, _CLEAR_OF_ROUNDING * largest)
    return states.solved & ~states.persistent & (fastest > least)


def _with_edge_along(contact: UnilateralContact, direction: np.ndarray) -> UnilateralContact:
    """The contact with a pyramid inside its cone, one edge of it along a direction (2,), contact axes."""
    half = np.pi / _FACETS
    angle = np.arctan2(direction[1], direction[0]) - half if np.any(direction) else 0.0
    tangent = contact.frame[:, 1:] @ [np.cos(angle), np.sin(angle)]
    inside = contact.friction * (1 + np.cos(half)) / 2
    if inside < LEAST_FRICTION:
        inside = contact.friction
    return replace(contact, facets=_FACETS, tangent=tangent, friction=inside)
