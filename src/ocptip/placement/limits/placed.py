"""Contacts that move within the base as it moves over uneven ground: their wrench, moments about their axes.

The moments that can be added about an axis are optima of cone programs over the contact forces (see
`reserves.tip_moments`). Their derivative by the contacts' places and normals is that of the program's
Lagrangian, with forces and multipliers held (envelope theorem).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.contact.support import Support
from ocptip.placement.limits.limit import Symbols
from ocptip.placement.limits.twice import Twice
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.tip_moments import AddableMoments, TippingAxis


def wrench_of_forces(at: Symbols) -> Twice:
    """(p, contact forces (3 n,), N, contact axes) -> their wrench (6,) about the centre of mass."""
    forces = cs.SX.sym("F", 3 * at.contacts.size2())
    return Twice.of(cs.vertcat(at.p, forces), [], _wrench(at, forces), local=at.local)


def _wrench(at: Symbols, forces: cs.SX) -> cs.SX:
    """Wrench (6,) of forces (3 n,) about the centre of mass."""
    total = cs.SX.zeros(6)
    for k in range(at.contacts.size2()):
        force = cs.reshape(at.frames[:, k], 3, 3) @ forces[3 * k : 3 * k + 3]
        total += cs.vertcat(force, cs.cross(at.contacts[:, k] - cs.SX(at.center_of_mass), force))
    return total


@dataclass(frozen=True, eq=False)
class Held:
    """Addable moments at one point, and what belongs to them.

    Attributes:
        moments: (axes,), N m.
        multipliers: (6, axes), their derivatives by the wrench.
        forces: (3 n, axes), N, of the program's optimum; zero where the moment is affine.
        affine: (axes,), 1 where the moment is that of the wrench about the axis, else 0.
    """

    moments: np.ndarray
    multipliers: np.ndarray
    forces: np.ndarray
    affine: np.ndarray

    @property
    def numbers(self) -> tuple[np.ndarray, ...]:
        """Arguments of the function of `PlacedMoments` behind the variables."""
        return self.multipliers, self.forces, self.moments, self.affine


class PlacedMoments:
    """Addable moments as functions of place and wrench.

    Args:
        at: expressions of the contacts.
        pairs: (axes, 2) numbers of the contacts on each axis.
    """

    def __init__(self, at: Symbols, pairs: np.ndarray) -> None:
        axes, size = len(pairs), 3 * at.contacts.size2()
        wrench, centre = cs.SX.sym("w", 6), cs.SX(at.center_of_mass)
        multipliers, forces = cs.SX.sym("multipliers", 6, axes), cs.SX.sym("forces", size, axes)
        moments, affine = cs.SX.sym("moments", axes), cs.SX.sym("affine", axes)
        rows = []
        for i, (first, second) in enumerate(pairs):
            point, span = at.contacts[:, int(first)], at.contacts[:, int(second)] - at.contacts[:, int(first)]
            e = span / cs.norm_2(span)
            about = -cs.dot(cs.vertcat(cs.cross(e, centre - point), e), wrench)
            balance = _wrench(at, forces[:, i]) + wrench + moments[i] * cs.vertcat(cs.SX.zeros(3), e)
            lagrangian = moments[i] + cs.dot(multipliers[:, i], balance)
            rows.append(affine[i] * about + (1 - affine[i]) * lagrangian)
        variables, numbers = cs.vertcat(at.p, wrench), [multipliers, forces, moments, affine]
        self._function = Twice.of(variables, numbers, cs.vertcat(*rows), local=at.local)

    def slope(self, p: np.ndarray, wrench: np.ndarray, held: Held) -> np.ndarray:
        """Derivatives (axes, k) of the moments by the place."""
        return self._function.jacobian(np.concatenate([p, wrench]), *held.numbers)[1][:, : len(p)]

    def hessian(self, p: np.ndarray, wrench: np.ndarray, held: Held, multipliers: np.ndarray) -> np.ndarray:
        """Second derivatives (k + 6, k + 6) of multipliers . moments by place and wrench."""
        return self._function.hessian(np.concatenate([p, wrench]), *held.numbers, multipliers)


def addable(support: Support, pairs: np.ndarray, wrenches: np.ndarray) -> list[Held]:
    """Moments about lines through pairs (axes, 2) of contacts that wrenches (N, 6) leave to be added."""
    places, none, axes = support.arms + support.center_of_mass, np.zeros(support.n_contacts), []
    for i, j in pairs:
        span = places[j] - places[i]
        axes.append(TippingAxis((i, j), places[i], span / np.linalg.norm(span), none))
    found = AddableMoments(support, ForceSets(support), tuple(axes)).found(wrenches)
    return [
        Held(moments, slopes.T, np.nan_to_num(forces).T, np.isnan(forces[:, 0]).astype(float))
        for moments, slopes, forces in zip(found.moments, found.slopes, found.forces, strict=True)
    ]
