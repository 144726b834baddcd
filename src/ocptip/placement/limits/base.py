"""Limits of where the base alone stands."""

from __future__ import annotations

from dataclasses import replace

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
)
from ocptip.placement.limits.solids import needs_solids
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.stand import GAP_TOLERANCE
from ocptip.robots.collision.model import geometry_of_spheres
from ocptip.robots.geometry import Floor, in_closed_form


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
