"""The contact forces that can be redistributed: those that cancel each other, as orthonormal bases."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ocptip.contact.support import Support
from ocptip.numerics.vectors import distinct_rows
from ocptip.reserves.force_sets import ForceSets

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

        Rows (R,), contacts (R, m), bases (R, m, d, nz), and the orthonormal complements of the tangential
        ones (R, m, 2, 3) where all of the group have them.
        """
        if len(rows) == 0:
            return
        patterns, which = distinct_rows(carries[rows])
        bases = [self.basis(pattern, with_normals) for pattern in patterns]
        shapes = [(basis.shape, J is not None) for _, basis, J in bases]
        for shape in sorted(set(shapes)):
            members = [p for p, own in enumerate(shapes) if own == shape]
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
        the complement of the tangential ones (m, 2, 3) where that has three columns, as on a plane.

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
                free[self._sets.rolls, 1] = False
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
            both = matrix.shape[2] == 3 and not np.any(self._sets.rolls[taking_part])
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
