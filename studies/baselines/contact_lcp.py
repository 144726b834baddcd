"""Two conventional LCP formulations of a rigid base on ordinary unilateral contacts.

Both describe the same physics as the set-complementary formulation of the package, so that their answers
can be compared with it:

    M qdd = h + W lam,     a = W' qdd                                                          (2.64)

with `h` the wrench on the base (6: force [N]; moment about the centre of mass [N m], base axes), `lam` the
contact forces (components n, t1, t2 for each contact [N]), `a` the accelerations of the contact points
(same components [m/s^2]) and `qdd` the acceleration of the base (6: linear [m/s^2]; angular [rad/s^2]).
The friction cone is replaced by the package's pyramid, whose cross-section at normal force 1 is the regular
polygon with face normals `s_h` and inradius mu_S (2.84).

:class:`PairwiseContactProblem` is the formulation with friction reserves of thesis M, 2.5.3,
whose pivot matrices lose rank; :class:`StewartTrinkleContactProblem` is that of D. E. Stewart and
J. C. Trinkle, Int. J. Numer. Methods Eng. 39, 1996, whose matrix is copositive, so that Lemke's method solves
it in exact arithmetic.

In both, accelerations are multiplied by a reference mass m_r (the reciprocal of the contacts' mean mobility),
so that the whole LCP is in newtons and its matrix of order 1. The tolerances of the pivot rules are absolute:
with accelerations in m/s^2 the pivots of a heavy base would drown in them.
"""

from __future__ import annotations

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.contact.bindings.pyramid import check_facets, corrected_friction, edge_directions, face_directions


class _ContactProblem:
    """Data common to both formulations; see their constructors' arguments."""

    def __init__(self, W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int) -> None:
        self.friction = finite_array("friction", friction, (None,))
        n = self.friction.shape[0]
        if n == 0 or np.any(self.friction <= 0.0):
            raise InputError(f"friction: needs at least one coefficient, all > 0, got {friction!r}")
        self.W = finite_array("W", W, (6, 3 * n))
        self.inverse_mass = finite_array("inverse_mass", inverse_mass, (6, 6))
        self.facets = check_facets(facets)
        self.contacts = n
        self.slope = np.array([corrected_friction(mu, self.facets) for mu in self.friction])
        mean_mobility = np.trace(self.W.T @ self.inverse_mass @ self.W) / (3 * n)
        if not mean_mobility > 0.0:
            raise InputError("inverse_mass: W' inverse_mass W must have a positive trace, got 0 or less")
        self.reference_mass = float(1.0 / mean_mobility)
        """Mass m_r [kg] by which all accelerations in the LCP are multiplied."""
        self.inertial_force_per_wrench = self.reference_mass * self.W.T @ self.inverse_mass
        """(3n, 6): accelerations of the contacts of the free base, times m_r, for a wrench."""
        self.delassus = self.inertial_force_per_wrench @ self.W
        """(3n, 3n): accelerations of the contacts, times m_r, for contact forces; entries of order 1."""

    def _set_lcp(self, matrix: np.ndarray, q_map: np.ndarray, force_map: np.ndarray) -> None:
        """Store the LCP's matrix, the map of wrenches to its vector and that of its unknowns to forces."""
        self._matrix = matrix
        self._q_map = q_map
        self._force_map = force_map

    def lcp_matrix(self) -> np.ndarray:
        """Matrix M of the LCP w = M z + q."""
        return self._matrix.copy()

    def q(self, wrenches: np.ndarray) -> np.ndarray:
        """Vector q for a wrench (6,), or one per row for wrenches (k, 6)."""
        single = np.ndim(wrenches) == 1
        wrenches = finite_array("wrenches", wrenches, (6,) if single else (None, 6))
        return wrenches @ self._q_map.T

    def recover(self, z: np.ndarray, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact forces and base acceleration that belong to a solution of the LCP.

        Args:
            z: Solution of the LCP for this wrench.
            wrench: (6,) force [N] and moment about the centre of mass [N m] on the base, base axes.

        Returns:
            Forces (n, 3) [N], contact axes n, t1, t2; acceleration of the base (6,) [m/s^2; rad/s^2].
        """
        z = finite_array("z", z, (self._matrix.shape[0],))
        wrench = finite_array("wrench", wrench, (6,))
        forces = self._force_map @ z
        return forces.reshape(self.contacts, 3), self.inverse_mass @ (wrench + self.W @ forces)


class PairwiseContactProblem(_ContactProblem):
    """Friction-reserve formulation: S + 1 complementary pairs per contact (2.5.3).

    The pairs are gn / lam_n and, for every face h of the pyramid, the radial acceleration g_h and the
    friction reserve lamhat_h = mu_S lam_n - s_h' K_t, where a_n = gn and a_t = - sum_h s_h g_h. The
    tangential force K_t is eliminated by the reserves of the faces 1 and 2. For each contact the LCP
    y = A x + b holds, accelerations times m_r,

        y = (gn, g_1, g_2, lamhat_3 .. lamhat_S),     x = (lam_n, lamhat_1, lamhat_2, g_3 .. g_S).

    Args:
        W: (6, 3n) map of contact forces to wrenches; per contact the columns n, t1, t2.
        inverse_mass: (6, 6) inverse of the base's mass matrix about its centre of mass [1/kg, 1/(kg m^2)].
        friction: (n,) Coulomb coefficients, > 0.
        facets: Number S of the pyramid's faces, >= 3.

    Raises:
        InputError: Shapes do not fit or numbers cannot be used.
    """

    def __init__(self, W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int) -> None:
        super().__init__(W, inverse_mass, friction, facets)
        n, S = self.contacts, self.facets
        directions = face_directions(S)
        # The faces 1 and 2 are neighbours, 2 pi / S apart: neither parallel nor opposite for any S >= 3.
        self._pair = directions[:2]
        self._pair_inverse = np.linalg.inv(self._pair)
        self._others = directions[2:]

        # x of one contact to its force: K_t solves s_h' K_t = mu_S lam_n - lamhat_h, h = 1, 2.
        force = np.zeros((3 * n, (S + 1) * n))
        # Contact accelerations, less the part of the radial accelerations g_3 .. g_S that stand in x, to the
        # rows gn, g_1, g_2 of y.
        rows = np.zeros(((S + 1) * n, 3 * n))
        direct = np.zeros(((S + 1) * n, (S + 1) * n))
        for k in range(n):
            f = slice(3 * k, 3 * k + 3)
            x = slice((S + 1) * k, (S + 1) * (k + 1))
            block = np.zeros((3, S + 1))
            block[0, 0] = 1.0
            block[1:, 0] = self._pair_inverse @ np.full(2, self.slope[k])
            block[1:, 1:3] = -self._pair_inverse
            force[f, x] = block
            motion = np.zeros((S + 1, 3))
            motion[0, 0] = 1.0
            motion[1:3, 1:] = -self._pair_inverse.T
            rows[x, f] = motion
            relation = np.zeros((S + 1, S + 1))
            relation[1:3, 3:] = -self._pair_inverse.T @ self._others.T
            relation[3:] = -self._others @ block[1:]
            relation[3:, 0] += self.slope[k]
            direct[x, x] = relation
        self._set_lcp(
            matrix=rows @ self.delassus @ force + direct,
            q_map=rows @ self.inertial_force_per_wrench,
            force_map=force,
        )


class StewartTrinkleContactProblem(_ContactProblem):
    """Stewart and Trinkle's formulation at the level of accelerations: S + 2 pairs per contact.

    The unknowns z are grouped by kind: all normal forces f_n; S magnitudes beta per contact along the unit
    edge directions; one slip acceleration lambda (times m_r) per contact:

        w = [[P' D P, E], [mu .. -1 .. -1, 0]] z + (m_r P' W' inv(M) h; 0),     D = m_r W' inv(M) W.

    The coefficient is mu_S / cos(pi / S): with it the polygon spanned by the edge directions is exactly the
    cross-section of the package's pyramid.

    Args:
        W: (6, 3n) map of contact forces to wrenches; per contact the columns n, t1, t2.
        inverse_mass: (6, 6) inverse of the base's mass matrix about its centre of mass [1/kg, 1/(kg m^2)].
        friction: (n,) Coulomb coefficients, > 0.
        facets: Number S of the pyramid's faces, >= 3.

    Raises:
        InputError: Shapes do not fit or numbers cannot be used.
    """

    def __init__(self, W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int) -> None:
        super().__init__(W, inverse_mass, friction, facets)
        n, S = self.contacts, self.facets
        self.vertex_friction = self.slope / np.cos(np.pi / S)
        directions = edge_directions(S)

        force = np.zeros((3 * n, (S + 1) * n))
        slip = np.zeros(((S + 1) * n, n))
        limit = np.zeros((n, (S + 1) * n))
        for k in range(n):
            beta = slice(n + S * k, n + S * (k + 1))
            force[3 * k, k] = 1.0
            force[3 * k + 1 : 3 * k + 3, beta] = directions.T
            slip[beta, k] = 1.0
            limit[k, k] = self.vertex_friction[k]
            limit[k, beta] = -1.0
        self._set_lcp(
            matrix=np.block([[force.T @ self.delassus @ force, slip], [limit, np.zeros((n, n))]]),
            q_map=np.vstack([force.T @ self.inertial_force_per_wrench, np.zeros((n, 6))]),
            force_map=np.hstack([force, np.zeros((3 * n, n))]),
        )
