"""Rigid feet whose sharing of a load is not determined, as if all were equally compliant.

Rigid bodies leave open how four and more feet share a load. Real feet and floors are compliant, mostly about
equally. Reports show that sharing, and it is checked beside the best one: a foot may lift, or the friction
may be used up, where other normal forces would still hold the base.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ocptip.contact.bindings.laws import normal_range
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.reserves.slip import Slip, SlipReserve

ENOUGH = 0.95
"""Share of the friction: where it is enough along and about fine axes, all of it is about every axis."""

_SIDES = 16  # directions in which a base may slide, and about which points beside its middle
_RADII = 0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0  # how far these are, in lengths of the support
_UNIQUE = 3  # contacts on a plane whose normal forces equilibrium determines; as many balances
_SINGULAR = 1e-9
_LIFTED = 1e-6  # of the weight: a foot that would pull so little is at rounding


@dataclass(frozen=True, eq=False)
class EqualSharing:
    """Loads of N wrenches shared by equally compliant feet; NaN where the base moves.

    Attributes:
        normal_forces: (N, n) N, 0 for feet that lift.
        if_all_pressed: (N, n) N: normal forces if every foot could pull, also where the base moves; negative
            for feet that lift.
        tangential_forces: (N, n, d - 1) N, contact axes, shared optimally under these normal forces.
        usage: (N, n) |tangential force| / limit.
        GT: (N,) largest usage; 1 and more: the friction of these normal forces is not enough.
    """

    normal_forces: np.ndarray
    if_all_pressed: np.ndarray
    tangential_forces: np.ndarray
    usage: np.ndarray
    GT: np.ndarray

    @property
    def stands(self) -> np.ndarray:
        """(N,) True where equally compliant feet hold the base, whether or not some of them lift."""
        return self.GT < 1.0

    @property
    def lifts(self) -> np.ndarray:
        """(N, n) True for feet that lift."""
        size = np.sum(np.abs(self.if_all_pressed), axis=1, keepdims=True)
        return self.if_all_pressed < -_LIFTED * size


def equal_sharing(states: ContactStates) -> EqualSharing | None:
    """The forces of equally compliant feet under the wrenches of states.

    None where normal forces are unique or follow from declared springs, where not all contacts are feet, or
    where feet face each other: how much those squeeze is no matter of compliance.
    """
    if (slip := _equal_slip(states.support)) is None:
        return None
    rows, forces = _on_equal_springs(states, slip)
    stick_states = replace(states.select(rows), support=slip.support).changed(
        np.arange(len(rows)), {"contact_forces": forces}
    )
    reserve = slip.evaluate(stick_states, derivatives=False)

    def scattered(values: np.ndarray) -> np.ndarray:
        every = np.full((len(states), *values.shape[1:]), np.nan)
        every[rows] = values
        return every

    normal_map = equal_normal_map(states.support)
    assert normal_map is not None  # there are such feet
    return EqualSharing(
        scattered(forces[:, :, 0]),
        states.wrenches @ normal_map.T,
        *map(scattered, (reserve.tangential_forces, reserve.usage, reserve.GT)),
    )


def reported_slip(states: ContactStates, slip: SlipReserve) -> SlipReserve:
    """The result to show: GT of the best sharing, forces and usage of equally compliant feet."""
    if (equal := equal_sharing(states)) is None:
        return slip
    known, names = np.isfinite(equal.GT), ("normal_forces", "tangential_forces", "usage")
    shown = {name: getattr(slip, name).copy() for name in names}
    for name, values in shown.items():
        values[known] = getattr(equal, name)[known]
    return replace(slip, **shown)


def reported_normal_forces(states: ContactStates) -> np.ndarray:
    """(N, n) N: of equally compliant feet where rigid ones at rest leave them open, else of the states."""
    normal = states.contact_forces[:, :, 0]
    if (slip := _equal_slip(states.support)) is not None:
        rows, forces = _on_equal_springs(states, slip)
        normal = normal.copy()
        normal[rows] = forces[:, :, 0]
    return normal


def equal_normal_map(support: Support) -> np.ndarray | None:
    """(n, w): normal forces, N, per wrench if equally compliant feet all pressed; None as `equal_sharing`."""
    slip = _equal_slip(support)
    return slip and slip.support.elastic and slip.support.elastic.normal_map


def normal_map_of(support: Support) -> np.ndarray | None:
    """(n, 6) normal forces, N, per wrench, of declared springs or of equally compliant wheels.

    While all press. None where only one sharing is possible, or where it is not known.
    """
    if support.elastic:
        return support.elastic.normal_map
    known = equal_normal_map(support)
    return _map_on_a_plane(support) if known is None else known


def _map_on_a_plane(support: Support) -> np.ndarray | None:
    """The map for wheels of any model on one plane: tangential forces do not change normal ones."""
    presses = all(normal_range(contact) == (0.0, np.inf) for contact in support.contacts)
    if support.dimension != 3 or not presses or len(support.contacts) <= _UNIQUE:
        return None
    columns = support.wrench_matrix.reshape(6, -1, 3)
    scale = np.r_[np.ones(3), np.full(3, 1 / support.length)]
    u, s, _ = np.linalg.svd(scale[:, None] * columns[:, :, 1:].reshape(6, -1))
    free = (u[:, np.count_nonzero(s > _SINGULAR * s[0]) :]).T * scale  # what no tangential force changes
    return -np.linalg.pinv(free @ columns[:, :, 0]) @ free if len(free) == _UNIQUE else None


def equally_compliant(support: Support) -> Support | None:
    """The same feet with equal stiffness; None where all have the same friction, where only one sharing of
    the load is possible, and with clamps.
    """
    slip = _equal_slip(support)
    return slip.support if slip and friction_differs(support) else None


def friction_differs(support: Support) -> bool:
    """Whether contacts differ in friction; else each sharing slides at the same tangential force."""
    slopes = [contact.force_pieces()[0].slope for contact in support.contacts]
    return max(slopes) - min(slopes) > _SINGULAR * max(slopes)


def slides_beyond(
    support: Support, normal_map: np.ndarray, share: float = 1.0, *, fine: bool = False
) -> np.ndarray:
    """(k, 6) functions of the wrench, positive where the base slides along or about some axes.

    Sliding with these velocities takes at least the friction of each contact times its speed. Motions between
    these are not looked at: where no function is positive the base may slide nevertheless.

    Args:
        support: spatial.
        normal_map: (n, 6) normal forces, N, per wrench.
        share: of the friction that is enough.
        fine: turns about some 100 more points: then friction is known to 5 % (4 % in 9,000 random states).
    """
    normal, *tangents = support.frames[0].T
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    along = np.column_stack([np.cos(angles), np.sin(angles)]) @ np.array(tangents)
    middle = support.arms.mean(axis=0)
    radii = support.length * np.array(_RADII if fine else ())
    centres = np.vstack([middle, support.arms, *(middle + radius * along for radius in radii)])
    about = [np.r_[-np.cross(sign * normal, arm), sign * normal] for arm in centres for sign in (1, -1)]
    twists = np.vstack([np.hstack([along, np.zeros_like(along)]), about])
    velocities = np.einsum("rw,wkc->rkc", twists, support.wrench_matrix.reshape(6, -1, 3))
    slopes = np.array([contact.force_pieces()[0].slope for contact in support.contacts])
    return twists - share * (np.linalg.norm(velocities[:, :, 1:], axis=2) * slopes) @ normal_map


def face_each_other(support: Support) -> bool:
    """Whether two contacts press against each other, so that their forces need no load."""
    normals = support.frames[:, :, 0]
    return bool(np.min(normals @ normals.T) <= 0)


@lru_cache(maxsize=8)
def _equal_slip(support: Support) -> Slip | None:
    """Friction utilisation on the same feet with equal stiffness, whose value has no influence."""
    feet = all(isinstance(contact, UnilateralContact) for contact in support.contacts)
    if not feet or face_each_other(support) or Slip(support).redistribution == "tangential":
        return None
    equal = {"stiffness": 1.0, "tangential_stiffness": None}
    return Slip(support.varied([replace(contact, **equal) for contact in support.contacts]))


def _on_equal_springs(states: ContactStates, slip: Slip) -> tuple[np.ndarray, np.ndarray]:
    """The rows of the states that rest on these compliant feet, and their forces (rows, n, d), N."""
    elastic = slip.support.elastic
    assert elastic is not None  # its feet have a stiffness
    rows = np.flatnonzero(states.persistent)
    shared = elastic.share(states.wrenches[rows])
    return rows[shared.balanced], shared.forces[shared.balanced]
