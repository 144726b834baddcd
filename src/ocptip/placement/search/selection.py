"""Which gaps, load cases and pieces of force sets take part in a program around a point."""

from __future__ import annotations

import numpy as np

from ocptip.contact.solver import solve_many
from ocptip.placement.limits.forces import Piece
from ocptip.placement.search.physics import PatchPhysics


def near_gaps(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, distance: float) -> list[np.ndarray]:
    """Per task, which gaps are within `distance` (in 0.1 m) of their limit at p (k,) and q (tasks, n)."""
    if physics.gaps is None:
        return [np.zeros(0, dtype=bool) for _ in q]
    return [physics.gaps.first(np.concatenate([p, angles]))[0] < distance for angles in q]


def held_cases(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, share: float) -> list[int]:
    """Load cases whose slip reserve counts, or uses `share` of its limit or more at p (k,), q (tasks, n)."""
    problem = physics.problem
    robot, limit = problem.robot, problem.limits.GT or 1.0
    constrained = [i for i, case in enumerate(problem.cases) if case.constrained]
    states = solve_many(robot.support, wrenches(physics, p, q)[constrained], warm_start=False)
    usage = physics.evaluator.fast_slip.evaluate(states, derivatives=False).GT
    counts = problem.weights.GT > 0
    return [
        i
        for i, u in zip(constrained, usage, strict=True)
        if (counts and problem.cases[i].counts) or not u < share * limit
    ]


def pieces(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, held: list[int]) -> list[Piece] | None:
    """Pieces of the force sets in which the contact solver's forces lie, per held case."""
    if physics.forces is None or not held:
        return None if physics.forces is None else []
    return physics.forces.start(wrenches(physics, p, q)[held])[1]


def wrenches(physics: PatchPhysics, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(cases, 6) wrenches on the base, N and N m."""
    at = [(np.concatenate([p, q[case.task]]), case) for case in physics.problem.cases]
    return np.array([physics.loads.first(y, c.force, c.moment)[0][physics.n :] for y, c in at])
