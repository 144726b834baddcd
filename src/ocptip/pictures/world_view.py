"""A robot where it stands, with obstacles, ground and process forces, projected into a picture's plane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.patches import Circle, Polygon
from numpy.typing import ArrayLike

from ocptip.pictures import frame, style
from ocptip.placement.ground import HeightField
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.result import Placement
from ocptip.placement.stand import Stood
from ocptip.robots.collision.distances import RESTING
from ocptip.robots.collision.model import solids_of
from ocptip.robots.collision.shapes import Shape
from ocptip.robots.geometry import Obstacle, Solid, Wall
from ocptip.robots.kinematics import link_frames

COLORS = style.MEMBERS  # of tasks
BASE, OTHER, LOAD, SOLID, FORBIDDEN, GROUND = (
    "#3a3a3a",
    "#9a9a9a",
    style.LOAD,
    "#8c8c8c",
    "#e07b00",
    "#6b4f2a",
)

_PROFILE = 200  # points
_ARROW = 0.16  # length of a process force, share of the picture
_ALONG = 0.05  # sine of the angle up to which a wall or an axis counts as seen edge-on


@dataclass(frozen=True, eq=False)
class WorldView:
    """A parallel projection of the world.

    Attributes:
        axes: (2, 3) unit vectors to the right and up, world axes.
        through: (3,), m: a point of the plane in which walls and ground are cut.
    """

    axes: np.ndarray
    through: np.ndarray

    @property
    def depth(self) -> np.ndarray:
        """(3,) unit vector out of the picture."""
        return np.cross(*self.axes)

    def flat(self, points: ArrayLike) -> np.ndarray:
        """(..., 2), m."""
        return np.asarray(points) @ self.axes.T

    def limits(self, placements: Sequence[Placement]) -> tuple[tuple[float, float], tuple[float, float]]:
        """A square about bases, arms and process forces."""
        points = []
        for placement in placements:
            contacts = [c.position for c in placement.problem.robot.support.contacts]
            points += [in_world(placement, contacts), *(s.outline() for s in base_solids(placement))]
            points += [chain for chain, _ in chains(placement)]
        flat = self.flat(np.concatenate(points))
        arrows = self.arrows(placements[0].problem, float(np.ptp(flat, axis=0).max()))
        flat = np.vstack([flat, *(end for arrow in arrows for end in arrow)])
        middle, half = (flat.max(axis=0) + flat.min(axis=0)) / 2, 0.58 * np.ptp(flat, axis=0).max() + 0.05
        x, y = middle
        return (float(x - half), float(x + half)), (float(y - half), float(y + half))

    def arrows(self, problem: PlacementProblem, span: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """Tips, in G, and tails (2,) of the process forces; the longest one is a share of the span, m."""
        forces = [(task, load.force) for task in problem.tasks for load in task.loads]
        longest = max((float(np.linalg.norm(force)) for _, force in forces), default=0.0)
        if not longest:
            return []
        scale = _ARROW * span / longest
        ends = [(np.asarray(task.position), scale * np.asarray(force)) for task, force in forces]
        return [(self.flat(tip), self.flat(tip - force)) for tip, force in ends]

    def base(
        self, ax: Any, placement: Placement, color: str, *, solids: bool = False, label: str = ""
    ) -> None:
        """Outline and positions of the contacts; with the way to the mount and the solids of the base."""
        problem = placement.problem
        contacts = self.flat(in_world(placement, _stood(placement).contacts[0]))
        mount = self.flat(in_world(placement, [problem.ground_frame[0], problem.robot.arm.mount_position]))
        outline = contacts[frame.hull(contacts)]
        ax.add_patch(Polygon(outline, closed=True, fc="none", ec=color, lw=1.6 if solids else 1.0))
        size = 6 if solids else 3
        ax.plot(*contacts.T, ls="", marker="s", ms=size, color=color, gid=f"contacts-{label or 'best'}")
        if solids:
            ax.add_patch(Polygon(outline, closed=True, fc=color, alpha=0.12, ec="none"))
            ax.plot(*mount.T, color=color, lw=4, solid_capstyle="round")
            for shape in base_solids(placement):
                self.solid(ax, shape, fc="none", ec=color, lw=0.8)
        if label:
            ax.annotate(label, outline[0], (4, 4), textcoords="offset points", color=color, fontsize=10)

    def arms(self, ax: Any, placement: Placement, *, faint: bool = False) -> None:
        """The arm in every task."""
        radii = [r for spheres in placement.problem.robot.arm.sphere_sets for r in spheres.radii]
        for number, (q, (chain, centres)) in enumerate(zip(placement.angles, chains(placement), strict=True)):
            color = OTHER if faint else COLORS[number % len(COLORS)]
            style = (
                {"lw": 0.8, "alpha": 0.5} if faint else {"lw": 4.0, "marker": "o", "ms": 6, "mfc": "white"}
            )
            gid = "other-arm" if faint else f"arm-{number + 1}"
            ax.plot(*self.flat(chain).T, color=color, **style, solid_capstyle="round", gid=gid)
            if not faint:
                for centre, radius in zip(self.flat(centres), radii, strict=True):
                    ax.add_patch(Circle(centre, radius, fc=color, ec="none", alpha=0.10))
                for shape in arm_solids(placement, q):
                    self.solid(ax, shape, fc=color, ec="none", alpha=0.10)

    def loads(self, ax: Any, placement: Placement, limits: Any) -> None:
        """Process forces, as arrows that end in G."""
        for tip, tail in self.arrows(placement.problem, limits[0][1] - limits[0][0]):
            if np.linalg.norm(tip - tail) > 1e-3:
                arrow = {"arrowstyle": "-|>", "color": LOAD, "lw": 1.8, "shrinkA": 0, "shrinkB": 4}
                ax.annotate("", tip, tail, arrowprops=arrow, zorder=6)

    def obstacle(self, ax: Any, obstacle: Obstacle, limits: Any, *, forbidden: bool) -> None:
        """The part of a wall, pillar or solid that the picture shows."""
        style = {"fc": SOLID, "ec": "#5a5a5a", "alpha": 0.5, "lw": 1.2}
        if forbidden:
            style = {"fc": "none", "ec": FORBIDDEN, "hatch": "///", "lw": 1.0, "alpha": 0.6}
        if isinstance(obstacle, Wall):
            if abs(obstacle.normal @ self.depth) > 1 - _ALONG:
                return  # seen from the front
            level = obstacle.distance - obstacle.normal @ self.depth * (self.through @ self.depth)
            corners = half_plane(self.flat(obstacle.normal), level, limits)
            if len(corners):
                ax.add_patch(Polygon(corners, closed=True, **style))
            return
        if isinstance(obstacle, Solid):
            self.solid(ax, obstacle.shape, **style)
            return
        axis, point = self.flat(obstacle.axis), self.flat(obstacle.point)
        if np.linalg.norm(axis) < _ALONG:
            ax.add_patch(Circle((point[0], point[1]), obstacle.radius, **style))
            return
        along = axis / np.linalg.norm(axis)
        side = obstacle.radius * np.array([-along[1], along[0]])
        far = 10 * (limits[0][1] - limits[0][0]) * along
        ax.add_patch(
            Polygon([point - far - side, point - far + side, point + far + side, point + far - side], **style)
        )

    def solid(self, ax: Any, shape: Shape, **style: Any) -> None:
        """The outline of a solid in world axes."""
        corners = self.flat(shape.outline())
        if shape.thickness:
            angles = np.linspace(0, 2 * np.pi, 33)
            circle = shape.thickness * np.array([np.cos(angles), np.sin(angles)]).T
            corners = (corners[:, None] + circle).reshape(-1, 2)
        ax.add_patch(Polygon(corners[frame.hull(corners)], closed=True, **style))

    def ground(self, ax: Any, placement: Placement, limits: Any) -> None:
        """The tangent plane of the ground under the base; of uneven ground a profile through the base."""
        stand = placement.problem.stands[placement.patch]
        if (conforming := stand.patch.conforming) is not None:
            corners = self._profile(conforming.field, limits)
        else:
            origin, turn = stand.ground(placement.parameters[None])
            inward = -self.flat(turn[0] @ np.array([0.0, 0.0, 1.0]))
            corners = half_plane(inward, inward @ self.flat(origin[0]), limits)
        if len(corners):
            ax.add_patch(Polygon(corners, closed=True, fc=GROUND, alpha=0.18, ec=GROUND, lw=1.2, zorder=0))

    def _profile(self, field: HeightField, limits: Any) -> np.ndarray:
        """Outline (k, 2) of a height field cut along a picture whose second axis is the world's z."""
        (left, right), (bottom, _) = limits
        along = np.linspace(left, right, _PROFILE)
        across = self.through - self.axes[0] * (self.axes[0] @ self.through)
        heights = field.heights((across + np.outer(along, self.axes[0]))[:, :2])
        return np.column_stack([np.r_[along, right, left], np.r_[heights, bottom, bottom]])


def half_plane(normal: np.ndarray, level: Any, limits: Any) -> np.ndarray:
    """Corners (k, 2) of the picture's part with normal . point >= level."""
    (left, right), (bottom, top) = limits
    frame = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    corners = []
    for a, b in zip(frame, np.roll(frame, -1, axis=0), strict=True):
        u, v = normal @ a - level, normal @ b - level
        if u >= 0:
            corners.append(a)
        if u * v < 0:
            corners.append(a + (b - a) * u / (u - v))
    return np.array(corners)


def obstacles_of(problem: PlacementProblem) -> Iterator[tuple[Obstacle, bool]]:
    """Obstacles of the world, and whether they are for the base only."""
    for obstacle in problem.keep_out:
        yield obstacle, True
    for obstacle in problem.obstacles:
        yield obstacle, False


def _stood(placement: Placement) -> Stood:
    """The base at its place."""
    return placement.problem.stands[placement.patch].at(placement.parameters)


def in_world(placement: Placement, points: Any) -> np.ndarray:
    """Points (k, 3) in base axes, in the world."""
    return placement.base_position + np.asarray(points) @ placement.base_rotation.T


def chains(placement: Placement) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Per task the joints and G (n + 1, 3), and the centres of the arm's spheres (k, 3), in the world."""
    arm = placement.problem.robot.arm
    for q in placement.angles:
        frames = link_frames(arm, q)
        mount = arm.mount_rotation, arm.mount_position
        centres = []
        for spheres in arm.sphere_sets:
            turn, origin = (
                (frames.rotations[spheres.link - 1], frames.origins[spheres.link - 1])
                if spheres.link
                else mount
            )
            centres.append(origin + spheres.centres @ turn.T)
        flat = np.concatenate(centres) if centres else np.empty((0, 3))
        yield in_world(placement, frames.origins), in_world(placement, flat)


def base_solids(placement: Placement) -> Iterator[Shape]:
    """Shapes of the base and solids that are fixed to it, in world axes."""
    robot = placement.problem.robot
    fixed = [s.shape for s in robot.shapes]
    for shape in [*fixed, *(o.shape for o in robot.obstacles if isinstance(o, Solid))]:
        yield shape.placed(placement.base_rotation, placement.base_position)


def arm_solids(placement: Placement, q: np.ndarray) -> Iterator[Shape]:
    """Solids of the arm at q (n,), rad, in world axes."""
    arm = placement.problem.robot.arm
    if arm.geometry is None:
        return
    frames = link_frames(arm, q)
    for _, body, shape in solids_of(arm, arm.geometry):
        placed = shape if body == RESTING else shape.placed(frames.rotations[body], frames.origins[body])
        yield placed.placed(placement.base_rotation, placement.base_position)
