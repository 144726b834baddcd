"""Fast estimates of GN and GT of feet on uneven ground, for many places at once.

The search ranks thousands of places with different contacts; the contact solver and the cone programs would
take minutes. They check what the search returns.
"""

from __future__ import annotations

import numpy as np

from ocptip.contact.support import Support

NOT_HELD = 10.0
"""Value of GT where no forces hold the base."""

ROUNDS = 6
_PRESSING = 1e-2  # cost of normal forces relative to tangential ones
_TINY = 1e-12


def edge_moments(
    wrenches: np.ndarray, contacts: np.ndarray, pairs: np.ndarray, center_of_mass: np.ndarray
) -> np.ndarray:
    """Moments (N, M, axes), N m, that press the base down about lines through two contacts each.

    The addable moments (`reserves.tip_moments`) of axes that tip before friction ends.

    Args:
        wrenches: (N, M, 6), N and N m, on the base about its centre of mass.
        contacts: (N, n, 3), m.
        pairs: (axes, 2) numbers of the contacts on each axis.
        center_of_mass: (3,), m.
    """
    first, second = contacts[:, pairs[:, 0]], contacts[:, pairs[:, 1]]
    axes = second - first
    axes = axes / np.linalg.norm(axes, axis=2, keepdims=True)
    twists = np.concatenate([np.cross(axes, center_of_mass - first), axes], axis=2)
    return -np.einsum("nmw,naw->nma", wrenches, twists)


def friction_shares(
    wrenches: np.ndarray, contacts: np.ndarray, frames: np.ndarray, support: Support, rounds: int = ROUNDS
) -> np.ndarray:
    """Upper bounds (N, M) of GT; `NOT_HELD` where no pressing contact forces hold the base.

    Least squares of tangential forces over friction limits, weighted again in every round by how much each
    contact uses (Lawson's method for the minimax).

    Args:
        wrenches: (N, M, 6), N and N m, on the base about its centre of mass.
        contacts, frames: (N, n, 3), m, and (N, n, 3, 3) in base axes.
        support: with centre of mass and ordinary contacts, of which the friction counts.
        rounds: how often forces are weighted again.
    """
    N, M = wrenches.shape[:2]
    n, friction = contacts.shape[1], np.array([c.friction for c in support.contacts])  # pyright: ignore
    arms = contacts - support.center_of_mass
    moments = np.cross(arms[:, :, None], frames.transpose(0, 1, 3, 2)).transpose(0, 1, 3, 2)
    blocks = np.concatenate([frames, moments / support.length], axis=2)  # (N, n, 6, 3)
    G = blocks.transpose(0, 2, 1, 3).reshape(N, 1, 6, 3 * n)
    w = wrenches * np.r_[1, 1, 1, np.full(3, 1 / support.length)]
    size = np.maximum(np.linalg.norm(w[:, :, :3], axis=2) / n, _TINY)
    normal, weights = np.repeat(size[:, :, None], n, axis=2), np.full((N, M, n), 1 / n)
    best = np.full((N, M), NOT_HELD)
    rough = np.maximum(friction, _TINY)
    for _ in range(rounds):
        friction_limits = rough * np.maximum(normal, 1e-2 * size[:, :, None])
        cheap = np.empty((N, M, n, 3))  # inverse costs
        cheap[:, :, :, 0] = (size**2)[:, :, None] / _PRESSING
        cheap[:, :, :, 1:] = np.where(friction > 0, friction_limits**2 / np.maximum(weights, 1e-6), 0.0)[
            ..., None
        ]
        scaled = G * cheap.reshape(N, M, 1, 3 * n)
        matrix = scaled @ G.transpose(0, 1, 3, 2)
        matrix = matrix + 1e-12 * np.trace(matrix, axis1=2, axis2=3)[:, :, None, None] * np.eye(6)
        forces = -(scaled.transpose(0, 1, 3, 2) @ np.linalg.solve(matrix, w[..., None]))[..., 0]
        forces = forces.reshape(N, M, n, 3)
        normal, along = forces[..., 0], np.linalg.norm(forces[..., 1:], axis=3)
        used = along / np.maximum(rough * normal, _TINY * size[:, :, None])
        used = np.where((along > 0) | (normal < 0), used, 0.0)
        largest = np.max(used, axis=2)
        holds = np.all(normal >= 0, axis=2)
        best = np.where(holds, np.minimum(best, largest), best)
        weights = weights * np.clip(used, 1e-3, NOT_HELD)
        weights = weights / np.sum(weights, axis=2, keepdims=True)
    return best
