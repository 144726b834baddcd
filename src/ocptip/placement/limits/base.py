"""Limits of where the base alone stands, and distances of all solids wherever it stands, for check and
program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import casadi as cs
import numpy as np

from ocptip.placement.limits.forces import Twice
from ocptip.placement.limits.layout import Variables
from ocptip.placement.limits.limit import (
    ANGLE_UNIT,
    LENGTH_UNIT,
    CaseRows,
    ConstraintRows,
    PlacedBase,
    PlacementLimit,
    RowLabel,
    Symbols,
    TaskEvaluation,
)
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.stand import GAP_TOLERANCE
from ocptip.robots.collision.distances import RESTING, Distances
from ocptip.robots.collision.model import ShapeCollisions, geometry_of_spheres, link_frames_function
from ocptip.robots.geometry import Floor, in_closed_form
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


class BaseLimit(PlacementLimit):
    """A limit that no arm has a part in."""

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        """How far it is kept at N candidates."""
        raise NotImplementedError

    def expressions(self, symbols: Symbols) -> list[tuple[cs.SX, str]]:
        """Values, m, that must be >= 0, with names; none: variables' bounds keep it."""
        return []


class ParameterBounds(BaseLimit):
    """Bounds of the terrain's parameters."""

    kind = "bounds"

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        terrain, rows = evaluation.terrain, []
        for bound, upper, word in ((terrain.lower, False, "lower"), (terrain.upper, True, "upper")):
            for i in np.flatnonzero(np.isfinite(bound)):
                unit, scale = ("rad", ANGLE_UNIT) if terrain.angular[i] else ("m", LENGTH_UNIT)
                label = f"{terrain.parameters[i]}: {word} bound"
                rows.append(self.row([label], evaluation.parameters[:, [i]], bound[[i]], upper, unit, scale))
        return rows


class ContactArea(BaseLimit):
    """The bounds of a plane hold for every contact."""

    kind = "contact area"

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        area, rows = evaluation.terrain.contact_area, []
        if area is None:
            return rows
        world = evaluation.world(evaluation.contacts)
        for axis, name in enumerate("xy"):
            labels = [f"contact {k + 1}: {name}" for k in range(world.shape[1])]
            for limit, upper in zip(area[:, axis], (False, True), strict=True):
                if np.isfinite(limit):
                    rows.append(self.row(labels, world[:, :, axis], limit, upper, "m", LENGTH_UNIT))
        return rows

    def expressions(self, symbols: Symbols) -> list[tuple[cs.SX, str]]:
        area, rows = symbols.terrain.contact_area, []
        if area is None:
            return rows
        for k in range(symbols.contacts.size2()):
            point = symbols.world(symbols.contacts[:, k])
            for axis, name in enumerate("xy"):
                for limit, sign in zip(area[:, axis], (1.0, -1.0), strict=True):
                    if np.isfinite(limit):
                        rows.append((sign * (point[axis] - limit), f"contact {k + 1}: {name}"))
        return rows


class BaseClearance(BaseLimit):
    """The contacts, as points, and the balls of the base against obstacles and keep-out zones of the world.

    Spheres of the arm that do not move with its first joint are balls of the base. Balls are left to
    :class:`ocptip.placement.limits.arm.Clearance` where it checks all solids.
    """

    kind = "base clearance"
    many = True

    def __init__(self, problem: PlacementProblem) -> None:
        super().__init__(problem)
        around = (*problem.obstacles, *problem.keep_out)
        self._around = [obstacle for obstacle in around if not isinstance(obstacle, Floor)]
        arm = problem.robot.arm
        shapes = [] if arm.geometry else geometry_of_spheres(arm).shapes
        mount = arm.mount_rotation, arm.mount_position
        mounted = [replace(s, shape=s.shape.placed(*mount)) for s in shapes if not s.body]
        balls = [s for s in (*problem.robot.shapes, *mounted) if in_closed_form(s)]
        contacts = np.array([contact.position for contact in problem.robot.support.contacts])
        bare = [
            k
            for k, point in enumerate(contacts)
            if not any(np.linalg.norm(point - s.shape.position) <= s.shape.thickness for s in balls)
        ]
        balls = [] if needs_solids(problem) else balls
        self._names = [*(f"contact {k + 1}" for k in bare), *(s.name for s in balls)]
        self._centres = np.array([*contacts[bare], *(s.shape.position for s in balls)]).reshape(-1, 3)
        self._radii = np.array([*np.zeros(len(bare)), *(s.shape.thickness for s in balls)])

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        least, rows = self.problem.limits.base_clearance, []
        world = evaluation.world(self._centres)
        for obstacle in self._around:
            labels = [f"{name} and {obstacle.name}" for name in self._names]
            rows.append(self.row(labels, obstacle.gaps(world, self._radii), least, False, "m", LENGTH_UNIT))
        return rows

    def expressions(self, symbols: Symbols) -> list[tuple[cs.SX, str]]:
        least, rows = self.problem.limits.base_clearance, []
        for name, local_centre, radius in zip(self._names, self._centres, self._radii, strict=True):
            centre = symbols.world(local_centre)
            for obstacle in self._around:
                rows.append((obstacle.gap(centre, radius) - least, f"{name} and {obstacle.name}"))
        return rows


class Strokes(BaseLimit):
    """Legs within their strokes."""

    kind = "stroke"

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        conforming = evaluation.terrain.conforming
        if conforming is None or conforming.stroke is None:
            return []
        labels = [f"leg {k + 1}" for k in range(evaluation.strokes.shape[1])]
        ends = zip(conforming.stroke, (False, True), strict=True)
        return [self.row(labels, evaluation.strokes, limit, upper, "m", LENGTH_UNIT) for limit, upper in ends]

    def expressions(self, symbols: Symbols) -> list[tuple[cs.SX, str]]:
        if symbols.terrain.conforming is None or symbols.terrain.conforming.stroke is None:
            return []
        ends = list(zip(symbols.terrain.conforming.stroke, (1.0, -1.0), strict=True))
        return [
            (sign * (stroke - limit), f"leg {k}")
            for k, stroke in enumerate(cs.vertsplit(symbols.strokes), 1)
            for limit, sign in ends
        ]


class OnGround(BaseLimit):
    """All feet touch uneven ground; the program's expressions take it for granted."""

    kind = "feet"
    has_margin = False

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        if evaluation.terrain.conforming is None:
            return []
        labels = ["distance from the ground"]
        return [self.row(labels, evaluation.missed[:, None], GAP_TOLERANCE, True, "m", LENGTH_UNIT)]


class TerrainLimit(BaseLimit):
    """The constraints of the terrain (4.26)."""

    kind = "terrain"

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        names = evaluation.terrain.constraint_names
        if not names:
            return []
        values = evaluation.terrain.constraint_values(evaluation.parameters)
        return [self.row(names, values, 0.0, False, "", LENGTH_UNIT)]

    def expressions(self, symbols: Symbols) -> list[tuple[cs.SX, str]]:
        if symbols.terrain.constraints is None:
            return []
        return list(
            zip(
                cs.vertsplit(symbols.terrain.constraints(symbols.p)),
                symbols.terrain.constraint_names,
                strict=True,
            )
        )


class Ground(PlacementLimit):
    """All limits of the base alone, which are one function of the terrain's parameters.

    Args:
        problem: the problem.
        kinds: of its limits.
    """

    def __init__(self, problem: PlacementProblem, kinds: tuple[type[BaseLimit], ...]) -> None:
        super().__init__(problem)
        self.parts = tuple(kind(problem) for kind in kinds)

    def margins(self, evaluation: PlacedBase) -> list[ConstraintRows]:
        """How far all of them are kept at N candidates."""
        return [rows for part in self.parts for rows in part.margins(evaluation)]

    def functions(self, symbols: Symbols) -> list[Twice]:
        rows = [(part.kind, *row) for part in self.parts for row in part.expressions(symbols)]
        if not rows:
            return []
        labels = [RowLabel(kind, name) for kind, _, name in rows]
        return [
            Twice.of(
                symbols.p,
                [],
                cs.vertcat(*(value for _, value, _ in rows)) / LENGTH_UNIT,
                labels,
                local=symbols.local,
            )
        ]

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        return [
            CaseRows(-1, layout.p, function.labels, 0.0, np.inf, function=function) for function in functions
        ]
