"""Which gaps, load cases and pieces of force sets take part in a program around a point."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ocptip.placement.limits.forces import Piece
from ocptip.placement.limits.layout import corner_maps
from ocptip.placement.problem import TaskLoad
from ocptip.placement.search.physics import PatchPhysics

_NEAR_WORST = 0.95  # share of the worst corner's usage
_CORNERS = 2  # of a load case that are taken for near the worst, at most


def near_gaps(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, distance: float) -> list[np.ndarray]:
    """Per task, which gaps are within `distance` (in 0.1 m) of their limit at p (k,) and q (tasks, n)."""
    if physics.gaps is None:
        return [np.zeros(0, dtype=bool) for _ in q]
    return [physics.gaps.values(np.concatenate([p, angles])) < distance for angles in q]


def held_cases(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, share: float) -> list[int]:
    """Contact cases whose friction utilisation counts, or uses `share` of its limit or more at p (k,), q
    (tasks, n).

    Of a load case that counts those at the corners of the tolerance that are about as bad as the worst.
    """
    problem = physics.problem
    limit, counts = problem.limits.GT or 1.0, problem.weights.GT > 0
    return [
        j
        for j, case, usage, near_worst in _usages(physics, p, q)
        if (near_worst and counts and case.counts) or not usage < share * limit
    ]


def worst_cases(physics: PatchPhysics, p: np.ndarray, q: np.ndarray) -> list[int]:
    """Numbers of the contact cases that are nearly the worst of their constrained load case."""
    return [j for j, _, _, near_worst in _usages(physics, p, q) if near_worst]


def _usages(
    physics: PatchPhysics, p: np.ndarray, q: np.ndarray
) -> Iterator[tuple[int, TaskLoad, float, bool]]:
    """Number, load case, friction utilisation of every constrained contact case, and whether it is near the
    worst.
    """
    problem, stand = physics.problem, physics.stand
    constrained = [i for i, case in enumerate(problem.cases) if case.constrained]
    at = wrenches(physics, p, q).reshape(len(problem.cases), -1, 6)[constrained]
    usage = physics.evaluator.fast_usage(stand, stand.at(p), at.reshape(1, -1, 6)).reshape(at.shape[:2])
    for i, own in zip(constrained, usage, strict=True):
        near = ~(own < _NEAR_WORST * np.max(own)) & (np.argsort(np.argsort(-own, kind="stable")) < _CORNERS)
        for c, value in enumerate(own):
            yield len(own) * i + c, problem.cases[i], float(value), bool(near[c])


def pieces(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, held: list[int]) -> list[Piece] | None:
    """Pieces of the force sets in which the contact solver's forces lie, per held case."""
    if physics.forces is None or not held:
        return None if physics.forces is None else []
    return physics.forces.start(wrenches(physics, p, q)[held], physics.stand.footing(p))[1]


def wrenches(physics: PatchPhysics, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(contact cases, 6) wrenches on the base, N and N m."""
    at = [(np.concatenate([p, q[case.task]]), case) for case in physics.problem.cases]
    loads = np.array([physics.loads.values(y, c.force, c.moment)[physics.n :] for y, c in at])
    return np.einsum("kwg,ig->ikw", corner_maps(physics.problem), loads).reshape(-1, 6)
