"""Distances of spheres from each other and from obstacles, with slopes, each pair in a separate posture.

With n the direction in which a distance grows, its slope over a joint that turns about z through Q and moves
the sphere at c is z . ((c - Q) x n), over one that slides z . n. It is the same with the other sphere's
centre, which lies along n: so joints before both spheres change nothing, those between them do.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.vectors import cross
from ocptip.robots.kinematics import LinkFrames, link_frames
from ocptip.robots.model import ArmModel

NOTHING = -1
"""The other sphere of a pair with an obstacle, and the obstacle of a pair of spheres."""

TINY = 1e-30  # m^2, keeps slopes finite where centres coincide


class SphereGaps:
    """Signed distances of pairs.

    Args:
        model: the arm with its spheres, counted through all sets.
        around: signed distances of a point from the obstacles, m.
        point: (3,), m, base frame.
        pairs: numbers of a sphere, of another or NOTHING, and, with NOTHING, of an obstacle.
    """

    def __init__(
        self, model: ArmModel, around: Sequence[cs.SX], point: cs.SX, pairs: Sequence[tuple[int, int, int]]
    ) -> None:
        self._model, self._pairs = model, np.array(pairs, dtype=int).reshape(-1, 3)
        sets = model.sphere_sets
        self._links = np.repeat([s.link for s in sets], [len(s.radii) for s in sets])
        self._centres = np.concatenate([s.centres for s in sets])
        self._radii = np.concatenate([s.radii for s in sets])
        gaps = cs.vertcat(*around)
        self._around = BatchFunction(cs.Function("around", [point], [gaps, cs.jacobian(gaps, point).T]))

    def __call__(self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (r,), m, and slopes (r, n) over q (N, n) in rows of states and numbers of pairs (r,)."""
        frames = link_frames(self._model, q)
        first, second, obstacle = self._pairs[pairs].T
        centres = self._placed(frames, states, first)
        gaps, directions = np.empty(len(pairs)), np.empty((len(pairs), 3))
        alone, two = np.flatnonzero(second == NOTHING), np.flatnonzero(second != NOTHING)
        if alone.size:
            distances, over = self._around(centres[alone])
            rows, spheres_here = np.arange(alone.size), obstacle[alone]
            gaps[alone], directions[alone] = (
                distances[rows, spheres_here],
                over.reshape(alone.size, 3, -1)[rows, :, spheres_here],
            )
        between = centres[two] - self._placed(frames, states[two], second[two])
        lengths = np.sqrt(np.sum(between**2, axis=1) + TINY)
        gaps[two], directions[two] = lengths - self._radii[second[two]], between / lengths[:, None]
        joints, (before, behind) = (
            np.arange(self._model.links),
            (self._links[some] for some in (first, second)),
        )
        moving = 1.0 * (joints < before[:, None])
        moving[two] -= joints < behind[two, None]
        wrenches = np.hstack([cross(centres, directions), directions])
        slopes = moving * np.einsum("rjk,rk->rj", self._screws(frames)[states], wrenches)
        coupling = self._model.coupling
        return gaps - self._radii[first], slopes if coupling is None else slopes @ coupling.matrix

    def _screws(self, frames: LinkFrames) -> np.ndarray:
        """(N, L, 6): what joints do with moments and forces about the origin of the base frame."""
        links, slides = self._model.links, self._model.slides[:, None]
        axes, places = frames.rotations[:, :links, :, 2], frames.origins[:, :links]
        return np.concatenate(
            [np.where(slides, 0.0, axes), np.where(slides, axes, cross(places, axes))], axis=2
        )

    def _placed(self, frames: LinkFrames, states: np.ndarray, spheres: np.ndarray) -> np.ndarray:
        """Centres (r, 3), m."""
        links, centres = self._links[spheres], self._centres[spheres]
        frame = states, links - 1  # of what does not move the last, which is replaced
        result = frames.origins[frame] + np.einsum("rij,rj->ri", frames.rotations[frame], centres)
        still = links == 0
        result[still] = self._model.mount_position + centres[still] @ self._model.mount_rotation.T
        return result
