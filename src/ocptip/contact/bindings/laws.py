"""The contact laws themselves, as a check that knows nothing of pools, modes or bases.

A contact force K = (K_n, K_t) and a contact acceleration a = (a_n, a_t) obey the laws if

* K_n lies in the range of the contact model, a_n > 0 only at its lower and a_n < 0 only at its upper end;
* K_t lies in the polygon (the pyramid's cross-section) that belongs to K_n;
* no other force in that polygon would dissipate more: -a_t' K_t is the polygon's support function.

Source: thesis M, 2.4 and chapter 3. Maximum dissipation is the polyhedral form of "friction opposes sliding".
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ocptip.basics.frozen import read_only
from ocptip.contact.bindings import pyramid
from ocptip.contact.bindings.binding import Binding


def normal_range(binding: Binding) -> tuple[float, float]:
    """Minimum and maximum normal force (N) that the contact can carry; infinite where it cannot yield."""
    pieces = binding.force_pieces()
    return min(p.normal_min for p in pieces), max(p.normal_max for p in pieces)


def carries(bindings: Sequence[Binding]) -> np.ndarray:
    """(n, d) True for the components of contact forces, normal first, that are not always zero.

    A contact without friction, such as a caster, has a normal force alone; a wheel that rolls has no force
    along t1. They never take part in what holds such loads, not even by a rounding error, which a cone of
    width zero would count as slip.
    """
    values = np.ones((len(bindings), bindings[0].dimension if bindings else 0), dtype=bool)
    for k, binding in enumerate(bindings):
        pieces = binding.force_pieces()
        values[k, 1:] = any(piece.radius or piece.slope for piece in pieces)
        values[k, 1] &= largest_along(binding) > 0
    return values


def largest_along(binding: Binding) -> float:
    """Largest force along t1, N; infinite for contacts that are not wheels."""
    return max(piece.along for piece in binding.force_pieces())


def friction_limit(binding: Binding, normal_force: np.ndarray) -> np.ndarray:
    """Radius (N) of the true friction cone's cross-section at the given normal forces (N)."""
    normal_force = np.asarray(normal_force, dtype=float)
    limit = np.zeros_like(normal_force)
    nearest = np.full_like(normal_force, np.inf)
    for piece in binding.force_pieces():
        inside = np.clip(normal_force, piece.normal_min, piece.normal_max)
        distance = np.abs(normal_force - inside)
        radius = np.maximum(piece.radius + piece.slope * inside, 0.0)
        limit = np.where(distance < nearest, radius, limit)
        nearest = np.minimum(distance, nearest)
    return limit


def polygon(binding: Binding) -> tuple[np.ndarray, np.ndarray]:
    """Face normals (S, d-1) and vertices (S, d-1) of the pyramid's cross-section for a limit of 1 N."""
    if largest_along(binding) == 0:
        across = np.array([[0.0, 1.0], [0.0, -1.0]])
        return across, across
    return _polygon(binding.planar, binding.facets)


@lru_cache(maxsize=64)
def _polygon(planar: bool, facets: int) -> tuple[np.ndarray, np.ndarray]:
    if planar:
        faces = vertices = np.array([[1.0], [-1.0]])
    else:
        inner = pyramid.corrected_friction(1.0, facets)
        faces = pyramid.face_directions(facets) / inner
        vertices = pyramid.edge_directions(facets) * (inner / np.cos(np.pi / facets))
    return read_only(faces), read_only(vertices)


def law_violation(
    binding: Binding,
    force: np.ndarray,
    acceleration: np.ndarray,
    force_unit: float | np.ndarray,
    mass: float,
) -> np.ndarray:
    """How far forces and accelerations of one contact are from obeying its laws.

    Args:
        binding: the contact.
        force: (N, d) contact forces in contact axes, N.
        acceleration: (N, d) contact point accelerations in contact axes, m/s^2.
        force_unit: (N,) or number: force by which violations are divided, N.
        mass: kg; accelerations are compared as forces mass * a.

    Returns:
        (N,) the largest relative violation.
    """
    normal, tangential = force[:, 0] / force_unit, force[:, 1:] / np.reshape(force_unit, (-1, 1))
    a = acceleration * mass / np.reshape(force_unit, (-1, 1))
    low, high = (bound / force_unit for bound in normal_range(binding))
    violation = np.maximum(np.maximum(low - normal, normal - high), 0.0)
    at_low = np.minimum(np.maximum(a[:, 0], 0.0), np.maximum(normal - low, 0.0))
    at_high = np.minimum(np.maximum(-a[:, 0], 0.0), np.maximum(high - normal, 0.0))
    violation = np.maximum(violation, np.maximum(at_low, at_high))
    faces, vertices = polygon(binding)
    limit = friction_limit(binding, force[:, 0]) / force_unit
    along = largest_along(binding) / force_unit if len(faces) > 2 and force.shape[1] > 2 else np.inf
    outside = np.max(tangential @ faces.T, axis=1) - limit
    outside = np.maximum(outside, np.abs(tangential[:, 0]) - along)
    never = np.abs(np.hstack([normal[:, None], tangential])[:, ~carries([binding])[0]])
    violation = np.maximum(np.maximum(violation, outside), np.max(never, axis=1, initial=0.0))
    corners = np.reshape(limit, (-1, 1, 1)) * vertices  # of squares along t1 and t2, where `along` cuts them
    most = np.reshape(along, (-1, 1))
    corners[:, :, 0] = np.clip(corners[:, :, 0], -most, most)
    best = np.max(np.einsum("kd,kvd->kv", -a[:, 1:], corners), axis=1)
    shortfall = best + np.sum(a[:, 1:] * tangential, axis=1)
    # power is a product: its excess over the dissipation is the violation of the smaller factor
    size = np.maximum(1.0, np.maximum(np.max(np.abs(a), axis=1), limit))
    return np.maximum(violation, shortfall / size)
