"""The lines about which a base on contacts in any position can start to tip."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ocptip.contact.support import Support
from ocptip.reserves.force_sets import ForceSets

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
    found = {}
    for i, j in combinations(range(len(positions)), 2):
        span = positions[j] - positions[i]
        if np.linalg.norm(span) <= tolerance:
            continue
        e = span / np.linalg.norm(span)
        arms = positions - positions[i]
        along = arms @ e
        on_line = np.linalg.norm(arms - np.outer(along, e), axis=1) <= tolerance
        lift = np.einsum("kd,kd->k", normals, np.cross(e, arms))
        lift[on_line | (np.abs(lift) <= tolerance)] = 0.0
        along = np.where(on_line, along, np.nan)
        first = int(np.flatnonzero(along <= np.nanmin(along) + tolerance)[0])
        last = int(np.flatnonzero(along >= np.nanmax(along) - tolerance)[0])
        for contacts, sign in (((first, last), 1.0), ((last, first), -1.0)):
            if contacts not in found and _can_tip(sign * lift, sets, tolerance):
                found[contacts] = TippingAxis(contacts, positions[contacts[0]], sign * e, sign * lift)
    return tuple(found.values())


def _planar_axes(
    positions: np.ndarray, normals: np.ndarray, sets: ForceSets, tolerance: float
) -> tuple[TippingAxis, ...]:
    found = []
    for i, point in enumerate(positions):
        arms = positions - point
        if np.any(np.linalg.norm(arms[:i], axis=1) <= tolerance):
            continue
        lift = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
        lift[np.abs(lift) <= tolerance] = 0.0
        found += [
            TippingAxis((i, i), point, np.array([sign]), sign * lift)
            for sign in (1.0, -1.0)
            if _can_tip(sign * lift, sets, tolerance)
        ]
    return tuple(found)


def _free_axes(positions: np.ndarray, centred: np.ndarray) -> tuple[TippingAxis, ...]:
    """Both directions of the line through all contacts."""
    e = np.linalg.svd(centred)[2][0]
    first, last = int(np.argmin(centred @ e)), int(np.argmax(centred @ e))
    none = np.zeros(len(positions))
    return (
        TippingAxis((first, last), positions[first], e, none),
        TippingAxis((last, first), positions[last], -e, none),
    )
