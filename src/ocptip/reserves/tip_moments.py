"""The largest moment that can be added about a tipping axis of contacts in general position.

Off a plane tangential forces also act about a tipping axis, so that normal forces alone do not determine how
far the base is from tipping. What counts is

    M_i(w) = max m  subject to  sum of contact wrenches + w + m e_i = 0,  contact forces in their true cones,

w the wrench on the base and e_i a couple about axis i: the moment by which any admissible sharing of the
forces can still be turned against the base, a max over forces; the margin is the min over the axes.

The rotation about axis k moves contact c with v_c. No friction can hold it if the normal part of every v_c is
at least friction times the tangential part. Then the contacts let go where the moment of w about the axis,
affine in w, vanishes. So the path w + m e_i ends where the first such axis k tips, if friction lasts till
then: if the two contacts on axis k carry the wrench there alone, which two quadratic inequalities in the one
free force along the axis decide (all wrenches that can be carried are a convex set). Then the affine moment
of axis i is valid, and the minimum over all axes is exact. Otherwise (an axis jams, friction ends first,
clamps) a second-order cone program decides, with its multipliers as derivative. Where no admissible forces
carry w + m e_i for any m, the affine moment is valid as well: either the base tips, or friction is used up.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import clarabel
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.support import Support
from ocptip.numerics.vectors import cross
from ocptip.reserves.force_sets import ForceLimits, ForceSets
from ocptip.reserves.minimax import ConeBatch

LARGEST_FORCE = 1e3
"""Bound of normal forces and added moments in a program, relative to the wrench (moments: times length)."""

_TOLERANCE = 1e-10
_PARALLEL = 1e-9
_MEETS = 1e-12  # relative: intervals of the force along the axis that miss each other by less meet


@dataclass(frozen=True, eq=False)
class Addable:
    """Addable moments of N wrenches.

    Attributes:
        moments: (N, axes), N m.
        slopes: (N, axes, 6), their derivatives by the wrench, the multipliers of its balance.
        forces: (N, axes, d n), N, contact axes: forces at the optimum; NaN where the moment is affine.
    """

    moments: np.ndarray
    slopes: np.ndarray
    forces: np.ndarray


class AddableMoments:
    """The moments M_i of a support about given axes, and their derivatives.

    Args:
        support: the base on its contacts.
        sets: of its contacts.
        axes: its potential tipping axes.

    Attributes:
        slope, offset: (axes, 6) and (axes,), N m: moment about each axis, slope . wrench + offset, against
            which contacts that all let go at the lower (or upper) ends of their normal forces do nothing.
    """

    def __init__(self, support: Support, sets: ForceSets, axes: tuple[TippingAxis, ...]) -> None:
        self._support, self._sets = support, sets
        d, size = support.dimension, support.wrench_size
        twists = np.array([_twist(support, axis) for axis in axes]).reshape(-1, size)
        self._couples = np.zeros_like(twists)
        self._couples[:, d:] = twists[:, d:]
        self.slope = -twists
        self.offset = np.array([_preload(axis.lift, sets) for axis in axes])
        self._on_axis = np.array([axis.contacts for axis in axes]).reshape(-1, 2)
        ordinary = sets.ordinary
        self._friction = sets.friction
        speeds = (twists @ support.wrench_matrix).reshape(len(axes), support.n_contacts, d)
        tangential = np.linalg.norm(speeds[:, :, 1:], axis=2)
        tolerance = _PARALLEL * support.length
        free = np.all(speeds[:, :, 0] >= self._friction * tangential - tolerance, axis=1)
        self._closed = free & ordinary & (d == 3)
        self._batch: ConeBatch | None = None

    @property
    def needs_states(self) -> bool:
        """Whether the force sets have several pieces, of which the state's normal forces choose one."""
        return not self._sets.single_pieces

    def __call__(
        self, wrenches: np.ndarray, normal_forces: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Moments (N, axes), N m, and derivatives (N, axes, 6), see `found`."""
        result = self.addable(wrenches, normal_forces)
        return result.moments, result.slopes

    def addable(self, wrenches: np.ndarray, normal_forces: np.ndarray | None = None) -> Addable:
        """Moments, derivatives and forces at the wrenches that the contacts balance.

        Args:
            wrenches: (N, 6) or planar (N, 3), N and N m about the centre of mass.
            normal_forces: (N, n), N; where a contact's force set has several pieces, those that hold these
                forces are used (a lower bound of the moment).
        """
        count, axes = len(wrenches), len(self.slope)
        moments = wrenches @ self.slope.T + self.offset
        slopes = np.broadcast_to(self.slope, (count, *self.slope.shape)).copy()
        forces = np.full((count, axes, self._support.dimension * self._support.n_contacts), np.nan)
        if not count or not axes:
            return Addable(moments, slopes, forces)
        certain = self.closed_form(wrenches)
        todo = np.argwhere(~certain)
        if len(todo):
            if len(wheels := np.flatnonzero(np.isfinite(self._sets.along))):
                k = int(wheels[0]) + 1
                raise InputError(f"contacts: contact {k} is a wheel; wheels need contacts on one plane")
            rows, axis = todo.T
            if normal_forces is None:
                normal_forces = np.zeros((count, self._support.n_contacts))
            scale = np.max(np.abs(normal_forces), axis=1, initial=0.0)
            limits = self._sets.limits(normal_forces, np.where(scale > 0, scale, 1.0))
            result, slope, force = self._solve(wrenches[rows], axis, limits, rows)
            known = np.isfinite(result)
            moments[rows[known], axis[known]] = result[known]
            slopes[rows[known], axis[known]] = slope[known]
            forces[rows[known], axis[known]] = force[known]
        return Addable(moments, slopes, forces)

    def closed_form(self, wrenches: np.ndarray) -> np.ndarray:
        """(N, axes) True where the path of an axis is known to end with the tipping about an axis.

        There the affine moments count, elsewhere a cone program decides. Also True for all axes of a state
        that tips already, and False for axes that jam.
        """
        moments = wrenches @ self.slope.T + self.offset
        certain = np.zeros(moments.shape, dtype=bool)
        if not np.any(self._closed):
            return certain
        turns = self._couples[:, 3:] @ self._couples[:, 3:].T  # of axis i (row) about axis k
        tips = np.any(moments[:, self._closed] < 0, axis=1)
        for i in np.flatnonzero(self._closed):
            # Adding a couple about axis i uses up the moment about axis k at this rate: the axis reached
            # first ends the path.
            reach = np.where(turns[i] > _PARALLEL, moments / np.maximum(turns[i], _PARALLEL), np.inf)
            first = np.argmin(np.where(self._closed, reach, np.inf), axis=1)
            for k in np.unique(first):
                indices = np.flatnonzero((first == k) & ~tips)
                ends = wrenches[indices] + reach[indices, k, None] * self._couples[i]
                certain[indices, i] = self._two_contacts_carry(k, ends)
        certain[np.ix_(tips, self._closed)] = True
        return certain

    def _two_contacts_carry(self, axis: int, wrenches: np.ndarray) -> np.ndarray:
        """(N,) whether the contacts on an axis alone carry wrenches (N, 6) that have no moment about it."""
        first, second = self._on_axis[axis]
        arms, e = self._support.arms, self._couples[axis, 3:]
        span = arms[second] - arms[first]
        length = span @ e
        force, moment = wrenches[:, :3], wrenches[:, 3:] - np.cross(arms[first], wrenches[:, :3])
        across = np.cross(e, moment) / length  # of the second contact's force; without part along e
        other = -force + np.outer(force @ e, e) - across
        along = force @ e
        low, high = np.full(len(wrenches), -np.inf), np.full(len(wrenches), np.inf)
        possible = np.ones(len(wrenches), dtype=bool)
        pairs = ((first, other, e), (second, across - np.outer(along, e), -e))
        for contact, base, direction in pairs:
            ends, inside = self._cone_interval(contact, base, direction)
            low, high = np.maximum(low, ends[0]), np.minimum(high, ends[1])
            possible &= inside
        size = np.linalg.norm(force, axis=1) + np.linalg.norm(moment, axis=1) / abs(length)
        return possible & (low <= high + _MEETS * size)

    def _cone_interval(
        self, contact: int, base: np.ndarray, direction: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Ends (N,) of the s for which base + s direction lies in a friction cone, and whether there are any.

        Only for directions outside the cone, along which it is bounded.
        """
        normal, stretch = self._support.frames[contact, :, 0], 1 + self._friction[contact] ** 2
        n0, n1 = base @ normal, direction @ normal
        a = 1 - stretch * n1**2
        b = base @ direction - stretch * n0 * n1
        c = np.einsum("sd,sd->s", base, base) - stretch * n0**2
        # Along a direction inside the cone the interval has no end, and the two inequalities do not decide.
        if a <= _PARALLEL:
            empty = np.zeros(len(base))
            return (empty, empty), np.zeros(len(base), dtype=bool)
        root = b**2 - a * c
        half = np.sqrt(np.maximum(root, 0.0)) / a
        return (-b / a - half, -b / a + half), (root >= 0) & (n0 - b / a * n1 >= 0)

    def _solve(
        self, wrenches: np.ndarray, axis: np.ndarray, limits: ForceLimits, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """M (P,), derivatives (P, 6), forces (P, d n) by cone programs; NaN where there are none.

        Unknown are -M and the contact forces, in units of the wrench or of the largest preload; moments over
        the support's length.
        """
        support = self._support
        d, n, size = support.dimension, support.n_contacts, support.wrench_size
        scaling = np.ones(size)
        scaling[d:] /= support.length
        G, couples = scaling[:, None] * support.wrench_matrix, scaling * self._couples * support.length
        unit = np.maximum(np.max(np.abs(scaling * wrenches), axis=1), limits.largest[rows])
        unit = np.where(unit > 0, unit, 1.0)
        lower, upper = limits.normal_min[rows] / unit[:, None], limits.normal_max[rows] / unit[:, None]
        A = np.zeros((len(rows), size + n * d + 2 * n + 1, 1 + n * d))
        b = np.zeros(A.shape[:2])
        A[:, :size, 0], A[:, :size, 1:] = -couples[axis], G
        b[:, :size] = -scaling * wrenches / unit[:, None]
        columns = 1 + d * np.arange(n)
        for k in range(n):
            row = size + k * d
            A[:, row, columns[k]] = -limits.slope[rows, k]
            b[:, row] = limits.radius[rows, k] / unit
            A[:, row + np.arange(1, d), columns[k] + np.arange(1, d)] = -1.0
        ends = size + n * d
        A[:, ends + np.arange(n), columns] = -1.0
        b[:, ends : ends + n] = -np.maximum(lower, -LARGEST_FORCE)
        A[:, ends + n + np.arange(n), columns] = 1.0
        b[:, ends + n : -1] = np.minimum(upper, LARGEST_FORCE)
        # Bounds on forces and moment keep the program bounded where contacts can squeeze each other without
        # limit.
        A[:, -1, 0], b[:, -1] = -1.0, LARGEST_FORCE
        x, multipliers, _ = self._programs(A).solve(A, b)
        slope = -multipliers[:, :size] * scaling * support.length
        return -x[:, 0] * unit * support.length, slope, x[:, 1:] * unit[:, None]

    def _programs(self, A: np.ndarray) -> ConeBatch:
        if self._batch is None:
            n, d, size = self._support.n_contacts, self._support.dimension, self._support.wrench_size
            structure = np.zeros(A.shape[1:], dtype=bool)
            structure[:size] = True
            for k in range(n):
                columns = 1 + k * d + np.arange(d)
                structure[size + k * d + np.arange(d), columns] = True
                structure[[size + n * d + k, size + n * d + n + k], columns[0]] = True
            structure[-1, 0] = True
            cones = [clarabel.ZeroConeT(size), *[clarabel.SecondOrderConeT(d)] * n]
            cones.append(clarabel.NonnegativeConeT(2 * n + 1))
            self._batch = ConeBatch(structure, cones, _TOLERANCE, equilibrate=True)
        return self._batch


def _twist(support: Support, axis: TippingAxis) -> np.ndarray:
    """Velocity of the centre of mass and angular velocity, (6,) or planar (3,), of a rotation about it."""
    lever = support.center_of_mass - axis.point
    if support.dimension == 2:
        turn = axis.direction[0]
        return np.array([-turn * lever[1], turn * lever[0], turn])
    return np.concatenate([cross(axis.direction, lever), axis.direction])


def _preload(lift: np.ndarray, sets: ForceSets) -> float:
    """Moment about an axis with which the contacts hold at the ends where they let go, N m."""
    up, down = lift > 0, lift < 0
    return float(-lift[up] @ sets.lower[up] - lift[down] @ sets.upper[down])


GEOMETRY_TOLERANCE = 1e-9
"""Lengths below this, relative to the extent of the contacts, are zero."""


@dataclass(frozen=True, eq=False)
class TippingAxis:
    """A line about which the base can start to tip.

    Attributes:
        contacts: the two contacts (i, j) on the line, the outermost if there are more; in the plane, where
            the axis is a point, the contact twice.
        point: (3,) contact i in base axes, m; (2,) in the plane.
        direction: (3,) unit vector of the angular velocity in base axes, from i to j; (1,) the sign of the
            rotation (from x to y) in the plane.
        lift: (n,) normal speed of each contact per angular velocity, m: zero on the axis, positive where
            the contact separates, negative where a two-sided clamp yields downwards.
    """

    contacts: tuple[int, int]
    point: np.ndarray
    direction: np.ndarray
    lift: np.ndarray

    @property
    def numbers(self) -> list[int]:
        """Numbers of its contacts, from 1, in ascending order."""
        return sorted(k + 1 for k in self.contacts)


def find_axes(support: Support, sets: ForceSets) -> tuple[bool, tuple[TippingAxis, ...]]:
    """Whether the base can rotate freely, and the potential tipping axes."""
    positions, normals = support.arms + support.center_of_mass, support.frames[:, :, 0]
    centred = positions - positions.mean(axis=0)
    stretches = np.linalg.svd(centred, compute_uv=False)
    extent = stretches[0]
    if extent <= GEOMETRY_TOLERANCE * support.length:
        return True, ()
    tolerance = GEOMETRY_TOLERANCE * extent
    if support.dimension == 2:
        return False, _planar_axes(positions, normals, sets, tolerance)
    if len(stretches) < 2 or stretches[1] <= tolerance:
        return True, _free_axes(positions, centred)
    return False, _spatial_axes(positions, normals, sets, tolerance)


def _can_tip(lift: np.ndarray, sets: ForceSets, tolerance: float) -> bool:
    """Whether contacts with these normal speeds all may move so, and one of them does."""
    up, down = lift > tolerance, lift < -tolerance
    blocked = (up & np.isinf(sets.lower)) | (down & np.isinf(sets.upper))
    return not np.any(blocked) and bool(np.any(up | down))


def _spatial_axes(
    positions: np.ndarray, normals: np.ndarray, sets: ForceSets, tolerance: float
) -> tuple[TippingAxis, ...]:
    spatial_axes = {}
    for i, j in combinations(range(len(positions)), 2):
        span = positions[j] - positions[i]
        if np.linalg.norm(span) <= tolerance:
            continue
        e = span / np.linalg.norm(span)
        arms = positions - positions[i]
        along = arms @ e
        on_line = np.linalg.norm(arms - np.outer(along, e), axis=1) <= tolerance
        lift = np.einsum("kd,kd->k", normals, cross(e, arms))
        lift[on_line | (np.abs(lift) <= tolerance)] = 0.0
        along = np.where(on_line, along, np.nan)
        first = int(np.flatnonzero(along <= np.nanmin(along) + tolerance)[0])
        last = int(np.flatnonzero(along >= np.nanmax(along) - tolerance)[0])
        for contacts, sign in (((first, last), 1.0), ((last, first), -1.0)):
            if contacts not in spatial_axes and _can_tip(sign * lift, sets, tolerance):
                spatial_axes[contacts] = TippingAxis(contacts, positions[contacts[0]], sign * e, sign * lift)
    return tuple(spatial_axes.values())


def _planar_axes(
    positions: np.ndarray, normals: np.ndarray, sets: ForceSets, tolerance: float
) -> tuple[TippingAxis, ...]:
    planar_axes = []
    for i, point in enumerate(positions):
        arms = positions - point
        if np.any(np.linalg.norm(arms[:i], axis=1) <= tolerance):
            continue
        lift = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
        lift[np.abs(lift) <= tolerance] = 0.0
        planar_axes += [
            TippingAxis((i, i), point, np.array([sign]), sign * lift)
            for sign in (1.0, -1.0)
            if _can_tip(sign * lift, sets, tolerance)
        ]
    return tuple(planar_axes)


def _free_axes(positions: np.ndarray, centred: np.ndarray) -> tuple[TippingAxis, ...]:
    """Both directions of the line through all contacts."""
    e = np.linalg.svd(centred)[2][0]
    first, last = int(np.argmin(centred @ e)), int(np.argmax(centred @ e))
    none = np.zeros(len(positions))
    return (
        TippingAxis((first, last), positions[first], e, none),
        TippingAxis((last, first), positions[last], -e, none),
    )
