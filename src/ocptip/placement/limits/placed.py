"""Contacts that move within the base as it moves over uneven ground: their wrench, moments about their axes.

The moments that can be added about an axis are optima of cone programs over the contact forces (see
`reserves.tip_moments`). Their derivative by the contacts' places and normals is that of the program's
Lagrangian, with forces and multipliers held (envelope theorem).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.contact.support import Support
from ocptip.placement.limits.limit import Symbols
from ocptip.placement.limits.twice import Twice
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.tip_moments import Addable, AddableMoments, TippingAxis


def wrench_of_forces(symbols: Symbols) -> Twice:
    """(p, contact forces (3 n,), N, contact axes) -> their wrench (6,) about the centre of mass."""
    forces = cs.SX.sym("F", 3 * symbols.contacts.size2())
    return Twice.of(cs.vertcat(symbols.p, forces), [], _wrench(symbols, forces), local=symbols.local)


def _wrench(symbols: Symbols, forces: cs.SX) -> cs.SX:
    """Wrench (6,) of forces (3 n,) about the centre of mass."""
    total = cs.SX.zeros(6)
    for k in range(symbols.contacts.size2()):
        force = cs.reshape(symbols.frames[:, k], 3, 3) @ forces[3 * k : 3 * k + 3]
        total += cs.vertcat(force, cs.cross(symbols.contacts[:, k] - cs.SX(symbols.center_of_mass), force))
    return total


@dataclass(frozen=True, eq=False)
class LeastMoments:
    """Moments about the axes in one load case, each at the corner of the tolerance where it is minimal.

    Attributes:
        moments: (axes,), N m.
        multipliers: (axes, 6), their derivatives by the wrench at that corner.
        corners: (axes, 6, 9), wrench at the corner per wrench and gravity, see `Layout.corners`.
        forces: (axes, 3 n), N, of the optimum; NaN where the moment is affine; None on rigid patches.
    """

    moments: np.ndarray
    multipliers: np.ndarray
    corners: np.ndarray
    forces: np.ndarray | None

    @cached_property
    def by_loads(self) -> np.ndarray:
        """(axes, 9), derivatives by wrench and gravity."""
        return np.einsum("aw,awg->ag", self.multipliers, self.corners)

    @property
    def numbers(self) -> tuple[np.ndarray, ...]:
        """Arguments of the function of `PlacedMoments` behind the variables."""
        assert self.forces is not None  # contacts move only on ground that they conform to
        affine = np.isnan(self.forces[:, 0]).astype(float)
        corners = np.concatenate(list(self.corners), axis=1)
        return self.multipliers.T, np.nan_to_num(self.forces).T, self.moments, affine, corners


class PlacedMoments:
    """Addable moments as functions of the place, and of wrench and gravity in base axes.

    Args:
        at: expressions of the contacts.
        pairs: (axes, 2) numbers of the contacts on each axis.
        count: of wrench and gravity: 9; 6 where gravity does not count, see `corner_maps`.
    """

    def __init__(self, symbols: Symbols, pairs: np.ndarray, count: int) -> None:
        axes, size = len(pairs), 3 * symbols.contacts.size2()
        loads, centre = cs.SX.sym("loads", count), cs.SX(symbols.center_of_mass)
        multipliers, forces = cs.SX.sym("multipliers", 6, axes), cs.SX.sym("forces", size, axes)
        moments, affine = cs.SX.sym("moments", axes), cs.SX.sym("affine", axes)
        corners, rows = cs.SX.sym("corners", 6, count * axes), []
        for i, (first, second) in enumerate(pairs):
            wrench = corners[:, count * i : count * i + count] @ loads
            point, span = (
                symbols.contacts[:, int(first)],
                symbols.contacts[:, int(second)] - symbols.contacts[:, int(first)],
            )
            e = span / cs.norm_2(span)
            about = -cs.dot(cs.vertcat(cs.cross(e, centre - point), e), wrench)
            balance = _wrench(symbols, forces[:, i]) + wrench + moments[i] * cs.vertcat(cs.SX.zeros(3), e)
            lagrangian = moments[i] + cs.dot(multipliers[:, i], balance)
            rows.append(affine[i] * about + (1 - affine[i]) * lagrangian)
        variables, numbers = cs.vertcat(symbols.p, loads), [multipliers, forces, moments, affine, corners]
        self._function = Twice.of(variables, numbers, cs.vertcat(*rows), local=symbols.local)

    def slope(self, p: np.ndarray, loads: np.ndarray, worst: LeastMoments) -> np.ndarray:
        """Derivatives (axes, k) of the moments by the place; loads (9,)."""
        return self._function.jacobian(np.concatenate([p, loads]), *worst.numbers)[1][:, : len(p)]

    def hessian(
        self, p: np.ndarray, loads: np.ndarray, worst: LeastMoments, multipliers: np.ndarray
    ) -> np.ndarray:
        """Second derivatives (k + 9, k + 9) of multipliers . moments by place and loads."""
        return self._function.hessian(np.concatenate([p, loads]), *worst.numbers, multipliers)


def addable(support: Support, pairs: np.ndarray, wrenches: np.ndarray) -> Addable:
    """Moments about lines through pairs (axes, 2) of contacts that wrenches (N, 6) leave to be added."""
    places, none, axes = support.arms + support.center_of_mass, np.zeros(support.n_contacts), []
    for i, j in pairs:
        span = places[j] - places[i]
        axes.append(TippingAxis((i, j), places[i], span / np.linalg.norm(span), none))
    return AddableMoments(support, ForceSets(support), tuple(axes)).addable(wrenches)


def least(
    moments: np.ndarray, slopes: np.ndarray, forces: np.ndarray | None, corners: np.ndarray
) -> list[LeastMoments]:
    """Per load case, of moments (cases K, axes) at K corners (K, 6, 9), those at the worst corners."""
    count, axes = len(corners), np.arange(moments.shape[1])
    result = []
    for first in range(0, len(moments), count):
        worst = np.argmin(moments[first : first + count], axis=0)
        index = first + worst, axes
        forces_there = None if forces is None else forces[index]
        result.append(LeastMoments(moments[index], slopes[index], corners[worst], forces_there))
    return result
