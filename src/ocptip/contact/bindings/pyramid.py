"""The S-sided friction pyramid that replaces Coulomb's cone.

Symbols: `S` number of facets, `s_h` unit vectors normal to the faces in the tangent plane, `k_h` unit
vectors along the edges; face `h` lies between the edges `k_{h-1}` and `k_h`. The plane (S = 2) is the
special case with the two directions +t and -t. Source of the construction: equations (2.82), (2.84),
(3.12), (3.13).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, is_whole

MIN_FACETS, MAX_FACETS = 3, 256


def check_facets(facets: Any) -> int:
    """Return the facet count as an int, or raise InputError."""
    if not is_whole(facets) or not MIN_FACETS <= facets <= MAX_FACETS:
        raise InputError(f"facets: must be an integer from {MIN_FACETS} to {MAX_FACETS}, got {facets!r}")
    return int(facets)


def corrected_friction(friction: float, facets: int) -> float:
    """Slope of the pyramid's faces for which inner and outer error of the radius are equal (2.84).

    Args:
        friction: Coulomb coefficient mu, > 0.
        facets: number S of faces, >= 3.
    """
    c = np.cos(np.pi / facets)
    return float(friction * 2.0 * c / (1.0 + c))


def radius_error(facets: int) -> float:
    """Largest relative error of the pyramid's radius against the cone: 0.0718 for S = 6 (2.82)."""
    c = np.cos(np.pi / facets)
    return float((1.0 - c) / (1.0 + c))


def face_directions(facets: int) -> np.ndarray:
    """Unit vectors s_1..s_S in the tangent plane, shape (S, 2), components along t1 and t2."""
    angles = 2.0 * np.pi * np.arange(facets) / facets
    return np.column_stack([np.cos(angles), np.sin(angles)])


def edge_directions(facets: int) -> np.ndarray:
    """Tangential unit vectors of the edges k_1..k_S, shape (S, 2), components along t1 and t2."""
    angles = 2.0 * np.pi * (np.arange(facets) + 0.5) / facets
    return np.column_stack([np.cos(angles), np.sin(angles)])


def edges(friction: float, facets: int, side: float = 1.0) -> np.ndarray:
    """Unit edge vectors k_1..k_S of the pyramid (3.12, 3.13).

    Args:
        friction: Coulomb coefficient mu of the cone that the pyramid replaces.
        facets: number S of faces.
        side: +1 for the cone around +n, -1 for the one around -n (same tangential directions).

    Returns:
        Array (S, 3): components along n, t1, t2.
    """
    slope = corrected_friction(friction, facets)
    c = np.cos(np.pi / facets)
    length = np.hypot(c, slope)
    normal = np.full((facets, 1), side * c / length)
    return np.hstack([normal, slope / length * edge_directions(facets)])


def planar_edges(friction: float, side: float = 1.0) -> np.ndarray:
    """The two unit edge vectors of the planar friction cone, k_1 towards +t and k_2 towards -t.

    With this order the force k_1 resists sliding towards -t, as the mode lists assume.

    Returns:
        Array (2, 2): components along n, t.
    """
    length = np.hypot(1.0, friction)
    return np.array([[side, friction], [side, -friction]]) / length
