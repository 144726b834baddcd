"""Collision spheres of an arm against floor, walls, pillars and each other: signed distances (4.29 to 4.32).

A signed distance is the free gap in metres, negative in collision. The source demands the negated value <= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.kinematics import chain
from ocptip.robots.model import ArmModel, SphereSet, joint_states


@dataclass(frozen=True, eq=False)
class Wall:
    """A plane; free are the points with normal . p <= distance (4.30).

    Attributes:
        normal: (3,), unit vector into the wall, base axes.
        distance: m, from the base origin along the normal.
        name: for messages.
    """

    normal: np.ndarray
    distance: float
    name: str = "wall"

    def __post_init__(self) -> None:
        normal = finite_array(f"{self.name}: normal", self.normal, (3,))
        if abs(np.linalg.norm(normal) - 1) > 1e-9:
            raise InputError(f"{self.name}: normal must have length 1, got {normal.tolist()}")
        normal.flags.writeable = False
        object.__setattr__(self, "normal", normal)
        number_from(f"{self.name}: distance", self.distance)

    def gap(self, centre: cs.SX, radius: float) -> cs.SX:
        """Signed distance of a sphere, m; centre (3,), m, base frame."""
        return self.distance - cs.dot(cs.DM(self.normal), centre) - radius

    def gaps(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """`gap` (..., k) of many spheres: centres (..., k, 3) and radii (k,), m."""
        return self.distance - centres @ self.normal - radii


@dataclass(frozen=True, eq=False)
class Floor(Wall):
    """A wall that only the sets `ArmModel.floor_sets` are checked against; see :func:`floor`."""

    name: str = "floor"


def floor(height: float) -> Floor:
    """A horizontal floor: free are the points above z = `height` (m, base frame)."""
    return Floor(np.array([0.0, 0.0, -1.0]), -number_from("floor height", height))


@dataclass(frozen=True, eq=False)
class Pillar:
    """An endless cylinder (4.31), vertical by default; free are the points outside.

    Attributes:
        point: (3,), m, base frame: any point on its axis.
        radius: m.
        axis: (3,), unit vector, base axes.
        name: for messages.
    """

    point: np.ndarray
    radius: float
    axis: np.ndarray = (0.0, 0.0, 1.0)
    name: str = "pillar"

    def __post_init__(self) -> None:
        for field in ("point", "axis"):
            value = finite_array(f"{self.name}: {field}", getattr(self, field), (3,))
            value.flags.writeable = False
            object.__setattr__(self, field, value)
        if abs(np.linalg.norm(self.axis) - 1) > 1e-9:
            raise InputError(f"{self.name}: axis must have length 1, got {self.axis.tolist()}")
        positive_number(f"{self.name}: radius", self.radius)

    def gap(self, centre: cs.SX, radius: float) -> cs.SX:
        """Signed distance of a sphere, m; centre (3,), m, base frame."""
        across = np.eye(3) - np.outer(self.axis, self.axis)
        return _length(cs.DM(across) @ (centre - cs.DM(self.point))) - self.radius - radius

    def gaps(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """`gap` (..., k) of many spheres: centres (..., k, 3) and radii (k,), m."""
        arms = centres - self.point
        across = arms - (arms @ self.axis)[..., None] * self.axis
        return np.linalg.norm(across, axis=-1) - self.radius - radii


Obstacle = Wall | Pillar


@dataclass(frozen=True)
class GapLabel:
    """What a signed distance is between.

    Attributes:
        first: sphere set and number of its sphere, counted from 1, e.g. "5[2]".
        second: another such, or the obstacle's name.
    """

    first: str
    second: str

    def __str__(self) -> str:
        return f"{self.first} and {self.second}"


class CollisionModel:
    """All signed distances of an arm among obstacles, as CasADi function and for many states in NumPy.

    Args:
        model: the arm with its sphere sets and pairs.
        obstacles: floor (checked against `model.floor_sets`), walls and pillars (`model.obstacle_sets`).

    Attributes:
        labels: one per signed distance.
        function: CasADi function, in: q (n,), rad; out: `gaps` (m,), m.
    """

    def __init__(self, model: ArmModel, obstacles: Sequence[Obstacle] = ()) -> None:
        q = cs.SX.sym("q", model.n)
        centres = _centres(model, q)
        sets = {s.name: s for s in model.sphere_sets}
        gaps, labels = [], []
        for obstacle in obstacles:
            if not isinstance(obstacle, Wall | Pillar):
                raise InputError(f"obstacles: expected Wall, floor(...) or Pillar, got {obstacle!r}")
            for name in model.floor_sets if isinstance(obstacle, Floor) else model.obstacle_sets:
                for k, (centre, radius) in enumerate(zip(centres[name], sets[name].radii, strict=True), 1):
                    gaps.append(obstacle.gap(centre, radius))
                    labels.append(GapLabel(f"{name}[{k}]", obstacle.name))
        for first, second in model.collision_pairs:
            for k, (a, radius_a) in enumerate(zip(centres[first], sets[first].radii, strict=True), 1):
                for m, (b, radius_b) in enumerate(zip(centres[second], sets[second].radii, strict=True), 1):
                    gaps.append(_length(a - b) - radius_a - radius_b)  # (4.32)
                    labels.append(GapLabel(f"{first}[{k}]", f"{second}[{m}]"))
        self.model = model
        self.labels = tuple(labels)
        self.function = cs.Function("gaps", [q], [cs.vertcat(*gaps)], ["q"], ["gaps"])
        self._batch = BatchFunction(self.function) if gaps else None

    def gaps(self, q: np.ndarray) -> np.ndarray:
        """Signed distances (N, m) or (m,), m, at q (N, n) or (n,), rad, in the order of `labels`.

        Raises:
            InputError: wrong shape or not finite.
        """
        states, single = joint_states("q", q, self.model.n)
        result = self._batch(states)[0] if self._batch else np.empty((len(states), 0))
        return result[0] if single else result

    def worst(self, q: np.ndarray) -> tuple[float, GapLabel | None, int]:
        """Smallest signed distance (m) over all states, what it is between, and the state's index.

        Infinite and without label if there is nothing to collide with.
        """
        gaps = np.atleast_2d(self.gaps(q))
        if not gaps.size:
            return np.inf, None, 0
        state, index = np.unravel_index(np.argmin(gaps), gaps.shape)
        return float(gaps[state, index]), self.labels[index], int(state)


def spheres_along_links(
    model: ArmModel, radius: float, *, links: Sequence[int] | None = None
) -> tuple[SphereSet, ...]:
    """Sphere sets that cover the straight lines Q_i to Q_{i+1} (last: to G) as tubes, for arms without data.

    Args:
        radius: m, of every sphere; neighbours are at most one radius apart, so the tube covered is 0.86 radii
            thick.
        links: 1..n; all with a length above zero by default.

    Raises:
        InputError: no such link, or a radius that is not positive.
    """
    positive_number("radius", radius)
    chosen = range(1, model.n + 1) if links is None else links
    sets = []
    for link in chosen:
        if not 1 <= link <= model.n:
            raise InputError(f"links: must be 1..{model.n}, got {link}")
        offset = model.offsets[link - 1]
        length = np.linalg.norm(offset)
        if length == 0 and links is None:
            continue
        steps = np.linspace(0, 1, int(np.ceil(length / radius)) + 1)
        sets.append(SphereSet(f"link {link}", link, steps[:, None] * offset, np.full(len(steps), radius)))
    return tuple(sets)


def sphere_centres(model: ArmModel) -> cs.Function:
    """CasADi function of all sets' sphere centres in order (4.29): q (n,), rad, to (3, k), m, base frame."""
    q = cs.SX.sym("q", model.n)
    columns = [centre for centres in _centres(model, q).values() for centre in centres]
    return cs.Function("sphere_centres", [q], [cs.horzcat(*columns)], ["q"], ["centres"])


def _centres(model: ArmModel, q: cs.SX) -> dict[str, list[cs.SX]]:
    rotations, origins = chain(model, q)
    frames = [
        (cs.SX(model.mount_rotation), cs.SX(model.mount_position)),
        *zip(rotations, origins, strict=True),
    ]
    result = {}
    for spheres in model.sphere_sets:
        rotation, origin = frames[spheres.link]
        result[spheres.name] = [origin + rotation @ cs.SX(centre) for centre in spheres.centres]
    return result


def _length(vector: cs.SX) -> cs.SX:
    # The tiny term keeps the derivative finite where two centres coincide; it changes lengths by less than
    # 1e-15 m.
    return cs.sqrt(cs.sumsqr(vector) + 1e-30)
