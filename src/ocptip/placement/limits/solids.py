"""Distances of the arm's and the base's solids wherever the base stands, for check and program."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as cs
import numpy as np

from ocptip.placement.limits.limit import LENGTH_UNIT, RowLabel, Symbols, TaskEvaluation
from ocptip.placement.problem import PlacementProblem
from ocptip.robots.collision.distances import RESTING, Distances
from ocptip.robots.collision.model import ShapeCollisions, link_frames_function
from ocptip.robots.geometry import in_closed_form
from ocptip.robots.model import ArmModel

_FAR = 0.2  # m beyond the least distance: how far a pair may be so that its distance is computed exactly


class WorldSolids:
    """All pairs of solids of a problem.

    Pairs of arm and base are those of the robot; with obstacles of the world all solids of the arm are
    checked, with these and the keep-out zones all solids of the base: its shapes, and what the arm's file
    puts on links before the first joint that moves.

    Args:
        problem: the problem.

    Attributes:
        names: of the pairs.
        least: (m,), m: minimum distances.
    """

    def __init__(self, problem: PlacementProblem) -> None:
        robot, limits = problem.robot, problem.limits
        gaps = robot.collision
        if not isinstance(gaps, ShapeCollisions):
            gaps = ShapeCollisions(robot.arm, robot.around, robot.shapes)
        self.arm = robot.arm
        self._solids = [
            (robot.arm.links if body == RESTING else body, shape) for _, body, shape in gaps.solids
        ]
        names = [name for name, _, _ in gaps.solids]
        pairs, every = list(gaps.pairs), range(gaps.of_arm + gaps.of_base)
        resting = {s for s in every if gaps.solids[s][1] == RESTING}
        for obstacles, of_arm in ((problem.obstacles, True), (problem.keep_out, False)):
            for obstacle in obstacles:
                pairs += [(s, len(self._solids)) for s in every if of_arm or s in resting]
                self._solids.append((RESTING, obstacle.shape))
                names.append(obstacle.name)
        self._pairs = pairs
        self.names = [f"{names[a]} and {names[b]}" for a, b in pairs]
        of_base = [a in resting and b >= len(gaps.solids) for a, b in pairs]
        self.least = np.where(of_base, limits.base_clearance, limits.clearance)
        self._checked_distances = Distances(_placed_frames(self.arm), self._solids, pairs)

    def gaps(self, evaluation: TaskEvaluation) -> tuple[list[str], np.ndarray, np.ndarray]:
        """Names, distances (N, names), m, and their required minima (names,); solids of one name are one."""
        poses = np.concatenate([evaluation.base.reshape(-1, 9), evaluation.origin], axis=1)
        below = float(self.least.max(initial=0.0)) + _FAR
        names = list(dict.fromkeys(self.names))
        groups = np.array([names.index(name) for name in self.names], dtype=int)
        smallest = self._checked_distances.smallest(
            np.concatenate([evaluation.q, poses], axis=1), groups, below
        )
        return names, smallest, self.least[np.unique(groups, return_index=True)[1]]

    def functions(self, symbols: Symbols, kind: str) -> list[SolidGaps]:
        """One of all gaps, for all tasks."""
        if not self._pairs:
            return []
        pose = cs.vertcat(cs.vec(symbols.base.T), symbols.origin)
        frames = cs.Function("frames", [symbols.y], [_placed_frames(self.arm)(cs.vertcat(symbols.q, pose))])
        distances = Distances(frames, self._solids, self._pairs)
        return [SolidGaps(distances, self.least, [RowLabel(kind, name) for name in self.names])]


class SolidGaps:
    """Distances minus their minimum values, in `LENGTH_UNIT`, with two derivatives, as `Twice` has them."""

    dropped = 0.0

    def __init__(self, distances: Distances, least: np.ndarray, labels: Sequence[RowLabel]) -> None:
        self._distances, self._least, self.labels = distances, least, tuple(labels)
        self.size = len(self.labels)

    def values(self, y: np.ndarray) -> np.ndarray:
        """Values (m,)."""
        return (self._distances.gaps(y[None])[0] - self._least) / LENGTH_UNIT

    def jacobian(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (m,) and Jacobian (m, ny)."""
        every = np.arange(self.size)
        contact, slopes = self._distances.at(y[None], np.zeros_like(every), every)
        return (contact.distances - self._least) / LENGTH_UNIT, slopes / LENGTH_UNIT

    def hessian(self, y: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(ny, ny), of the product of multipliers (m,) and values."""
        used = np.flatnonzero(multipliers)
        if not used.size:
            return np.zeros((len(y), len(y)))
        contact, _ = self._distances.at(y[None], np.zeros_like(used), used)
        return self._distances.curvature(y[None], contact, multipliers[used])[0] / LENGTH_UNIT


def needs_solids(problem: PlacementProblem) -> bool:
    """Whether distances of a problem are more than those of spheres from floor, walls, pillars and balls."""
    robot = problem.robot
    around = (*problem.obstacles, *problem.keep_out)
    round_base = all(map(in_closed_form, robot.shapes))
    solid = bool(around) and not (all(map(in_closed_form, around)) and round_base)
    result = solid and (bool(robot.arm.sphere_sets) or not round_base)
    return result or isinstance(robot.collision, ShapeCollisions)


@lru_cache(maxsize=4)
def _placed_frames(arm: ArmModel) -> cs.Function:
    """Axes and origins of links and base in the world, from q (n,) and those of the base (row by row, 12)."""
    y = cs.SX.sym("y", arm.n + 12)
    function = link_frames_function(arm)(y[: arm.n])
    base, origin = cs.reshape(y[arm.n : arm.n + 9], 3, 3).T, y[arm.n + 9 :]
    frames = []
    for i in range(arm.links):
        axes, translation = (
            cs.reshape(function[12 * i : 12 * i + 9], 3, 3).T,
            function[12 * i + 9 : 12 * i + 12],
        )
        frames.append(cs.vertcat(cs.vec((base @ axes).T), origin + base @ translation))
    return cs.Function("placed_frames", [y], [cs.vertcat(*frames, y[arm.n :])])
