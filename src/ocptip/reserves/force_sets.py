"""The sets of contact forces of a support as arrays, and the forces that can be redistributed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ocptip.contact.bindings.laws import carries, largest_along, normal_range
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.numerics.vectors import distinct_rows

LOAD_TOLERANCE = 1e-9
"""Forces below this, relative to the largest force in the state, count as none."""

_TINY_FRICTION = 1e-2


@dataclass(frozen=True)
class ForceLimits:
    """Tangential limits of the contacts of N states in the force piece that holds the normal force.

    Attributes:
        radius: (N, n) tangential limit at zero normal force, N.
        slope: (N, n) change of the limit per normal force.
        normal_min: (N, n) lower end of the piece, N; minus infinity for none.
        normal_max: (N, n) upper end of the piece, N; infinity for none.
        value: (N, n) the limit, radius + slope K_n, never negative, N.
    """

    radius: np.ndarray
    slope: np.ndarray
    normal_min: np.ndarray
    normal_max: np.ndarray
    value: np.ndarray

    @property
    def largest(self) -> np.ndarray:
        """(N,) largest preload: of the finite ends and the limits at zero normal force, N."""
        known = np.abs(np.hstack([self.radius, self.normal_min, self.normal_max]))
        return np.max(np.where(np.isfinite(known), known, 0.0), axis=1)


class ForceSets:
    """Force sets of all contacts of a support (Coulomb's true cones, `Binding.force_pieces`).

    Attributes:
        lower: (n,) smallest normal force of each contact, N; minus infinity if it cannot separate upwards.
        upper: (n,) largest normal force, N; infinity unless the contact yields downwards.
        single_pieces: True if no contact's set has several pieces.
        cones: True if all contacts have friction cones from zero force on.
        ordinary: True if all of them are ordinary ones: none has a limit along t1.
        friction: (n,) friction coefficient of the first piece.
        radius: (n,) tangential limit of the first piece at zero normal force, N.
        along: (n,) largest force along t1, N: 0 of a wheel that rolls freely, infinite where it is no wheel.
        held: True if some wheel has such a force, from a drive or a brake.
        frictionless: (n,) True where a contact never carries a tangential force.
        grip: (n,) unit of the tangential forces, so that the friction counted in it is not tiny; 1 as a rule.
    """

    def __init__(self, support: Support) -> None:
        pieces = [contact.force_pieces() for contact in support.contacts]
        self.lower, self.upper = np.array([normal_range(contact) for contact in support.contacts]).T
        most = max(len(contact_pieces) for contact_pieces in pieces)
        padded = [
            [contact_pieces[min(p, len(contact_pieces) - 1)] for p in range(most)]
            for contact_pieces in pieces
        ]
        self._minimum, self._maximum, self._radius, self._slope = (
            np.array([[getattr(piece, name) for piece in contact_pieces] for contact_pieces in padded])
            for name in ("normal_min", "normal_max", "radius", "slope")
        )
        self.single_pieces = most == 1
        self.friction, self.radius = self._slope[:, 0], self._radius[:, 0]
        self.along = np.array([largest_along(contact) for contact in support.contacts])
        self.held = bool(np.any((self.along > 0) & np.isfinite(self.along)))
        self.cones = (
            self.single_pieces
            and not np.any(self._radius)
            and not np.any(self._minimum)
            and bool(np.all(np.isinf(self._maximum)))
        )
        self.ordinary = self.cones and bool(np.all(np.isinf(self.along)))
        self.frictionless = ~carries(support.contacts)[:, -1]
        steepest = np.max(np.abs(self._slope), axis=1)
        self.grip = np.where(steepest > 0, np.minimum(1.0, steepest / _TINY_FRICTION), 1.0)

    def distances(self, normal_forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances of normal forces (N, n) from the lower and from the upper ends of their sets, N."""
        return normal_forces - self.lower, self.upper - normal_forces

    def limits(self, normal_forces: np.ndarray, scale: np.ndarray) -> ForceLimits:
        """Tangential limits at normal forces.

        Where two pieces meet, the one with the larger limit counts (the first if they are equal).

        Args:
            normal_forces: (N, n), N.
            scale: (N,) largest force of each state, N; what is outside a piece by a rounding error of
                this size counts as inside.
        """
        K = normal_forces[:, :, None]
        nearest = np.clip(K, self._minimum, self._maximum)
        outside = np.abs(K - nearest) - LOAD_TOLERANCE * scale[:, None, None]
        limit = self._radius + self._slope * nearest
        choice = np.argmax(np.where(outside <= 0, limit, -1.0 - np.maximum(outside, 0)), axis=2)
        rows = np.arange(len(self.lower))
        return ForceLimits(
            radius=self._radius[rows, choice],
            slope=self._slope[rows, choice],
            normal_min=self._minimum[rows, choice],
            normal_max=self._maximum[rows, choice],
            value=np.maximum(np.take_along_axis(limit, choice[:, :, None], axis=2)[:, :, 0], 0.0),
        )


def force_scale(states: ContactStates) -> np.ndarray:
    """(N,) largest contact force component of each state, N; 1 where there is none."""
    largest = np.max(np.abs(states.contact_forces), axis=(1, 2))
    return np.where(largest > 0, largest, 1.0)


_RANK_TOLERANCE = 1e-9


class FreeForces:
    """The free forces of a support, by the contacts that take part; each basis is computed once.

    Args:
        support: the base on its contacts.
        sets: the force sets of the contacts.

    Attributes:
        matrix: (6, d n) wrench per contact force, moments in units of the support's length, N.
    """

    def __init__(self, support: Support, sets: ForceSets) -> None:
        d = support.dimension
        scaling = np.ones(support.wrench_size)
        scaling[d:] /= support.length
        self.matrix = scaling[:, None] * support.wrench_matrix
        self._sets = sets
        self._bases: dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray | None]] = {}

    def groups(
        self, rows: np.ndarray, carries: np.ndarray, with_normals: bool
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]]:
        """States `rows` in groups of one problem size.

        Rows (R,), contacts (R, m), bases (R, m, d, nz), and their complements, see `basis`, where all of the
        group have them.
        """
        if len(rows) == 0:
            return
        patterns, which = distinct_rows(carries[rows])
        bases = [self.basis(pattern, with_normals) for pattern in patterns]
        shapes = [(basis.shape, () if J is None else J.shape) for _, basis, J in bases]
        for shape in sorted(set(shapes)):
            members = [p for p, shape_of_piece in enumerate(shapes) if shape_of_piece == shape]
            place = np.full(len(patterns), -1)
            place[members] = np.arange(len(members))
            inside = place[which] >= 0
            index = place[which[inside]]
            yield (
                rows[inside],
                np.array([bases[p][0] for p in members])[index],
                np.array([bases[p][1] for p in members])[index],
                np.array([bases[p][2] for p in members])[index] if shape[1] else None,
            )

    def basis(
        self, carries: np.ndarray, with_normals: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Contacts that take part and an orthonormal basis (m, d, nz) of the forces that cancel each other.

        Tangential forces are counted in units of `ForceSets.grip` if normal forces are free as well. Third:
        the orthonormal complement, what the forces balance. Of tangential ones alone (m, 2, 3) where it has
        three columns, of all (m, d, r) where both balance apart, as on a plane; else None.

        Free are the tangential forces of the contacts that carry, or all forces of all contacts but of
        unloaded ones whose normal force is the same in all solutions.
        """
        key = np.packbits(np.r_[carries, with_normals]).tobytes()
        if key not in self._bases:
            matrix = self.matrix.reshape(len(self.matrix), len(carries), -1)
            if with_normals:
                matrix = matrix * force_units(self._sets.grip, matrix.shape[2])
            taking_part = carries | with_normals
            while True:
                free = np.repeat(taking_part[:, None], matrix.shape[2], axis=1)
                free[:, 0] &= with_normals
                free[self._sets.frictionless, 1:] = False
                free[self._sets.along == 0, 1] = False
                _, s, vt = np.linalg.svd(matrix[:, free])
                rank = int(np.sum(s > _RANK_TOLERANCE * np.max(s, initial=0.0)))
                null = vt[rank:].T
                basis = np.zeros((*free.shape, null.shape[1]))
                basis[free] = null
                basis[np.abs(basis) < _RANK_TOLERANCE] = 0.0
                stuck = taking_part & ~carries & np.all(basis[:, 0] == 0, axis=1)
                if not np.any(stuck):
                    break
                taking_part &= ~stuck
            J = None
            if with_normals:
                balances = np.zeros((*free.shape, rank))
                balances[free] = vt[:rank].T
                normal = balances[:, 0].T @ balances[:, 0]  # a projection where they are apart
                if np.max(np.abs(normal @ normal - normal)) < _RANK_TOLERANCE:
                    J = balances[taking_part]
            both = matrix.shape[2] == 3 and not np.any(self._sets.along[taking_part] == 0)
            if not with_normals and rank == 3 and both:
                J = vt[:3].T.reshape(-1, 2, 3)
                if np.any(np.linalg.norm(np.cross(J[:, 0], J[:, 1]), axis=1) < _RANK_TOLERANCE):
                    J = None
            self._bases[key] = np.flatnonzero(taking_part), basis[taking_part], J
        return self._bases[key]


def force_units(grip: np.ndarray, d: int) -> np.ndarray:
    """(..., n, d) units of normal and tangential forces."""
    return np.concatenate(
        [np.ones_like(grip)[..., None], np.repeat(grip[..., None], d - 1, axis=-1)], axis=-1
    )
