"""Placement problems: gripper tasks with process loads, terrain, limits, weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, get_args

import numpy as np

from ocptip.basics.errors import (
    InputError,
    finite_array,
    number_from,
    positive_number,
    rotation_matrix,
    share_of_one,
    whole_number,
)
from ocptip.basics.frozen import settle
from ocptip.numerics.vectors import perpendicular
from ocptip.placement.cone import FEWEST, enclosure, enough
from ocptip.placement.power import HoldingPower, TorqueCost
from ocptip.placement.stand import Feet, Stand
from ocptip.placement.terrain import Patch
from ocptip.robots.collision.gaps import CLEARANCE
from ocptip.robots.geometry import Obstacle
from ocptip.robots.inverse.pose_search import Orientation
from ocptip.standing.arm import Robot
from ocptip.standing.footing import Footing
from ocptip.standing.tolerance import Corner, Uncertainty

CRITERIA = ("GN", "GT", "GK", "GE")
INDICES = ("dm_2", "pi_oe", "inv_cdn_oe", "manipulability")
_SAME_LEVEL = 1e-9  # relative to the support's length
_ROTATION_TOLERANCE = 1e-8
_PROBES = 16


@dataclass(frozen=True, eq=False)
class ProcessLoad:
    """A process load on the gripper at G.

    Attributes:
        force: (3,), N, world axes.
        moment: (3,), N m, world axes.
        name: for messages and results.
    """

    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    name: str = "process load"

    def __post_init__(self) -> None:
        for key in ("force", "moment"):
            settle(self, **{key: finite_array(f"{self.name}: {key}", getattr(self, key), (3,))})


def sampled_loads(
    magnitude: float,
    count: int | None = None,
    *,
    axis: Sequence[float] = (0.0, 0.0, 1.0),
    half_angle: float = np.pi,
) -> tuple[ProcessLoad, ...]:
    """Forces that stand for all forces of one magnitude in a cone about an axis, or in all directions (4.19).

    They are corners of a convex polyhedron that contains all forces of the cone. What contacts and joints can
    carry is convex as long as no contact has several force sets, as clamps may have: limits kept by the
    corners are kept everywhere in the cone, and no force in it has a larger GN, GT or GK than the worst
    corner. So the corners are longer than the magnitude; by how much depends on their number.

    Args:
        magnitude: N.
        count: number of corners, at least 4; default: enough that none is longer by more than 2 %.
        axis: (3,), world axes, of any length.
        half_angle: rad, of the cone; pi for all directions.

    Raises:
        InputError: too few corners, a zero axis, an angle outside (0, pi].
    """
    positive_number("magnitude", magnitude)
    if not 0 < number_from("half_angle", half_angle) <= np.pi:
        raise InputError(f"half_angle: must be above 0 and at most pi rad, got {half_angle!r}")
    whole_number("count", FEWEST if count is None else count, FEWEST)
    z = finite_array("axis", axis, (3,))
    if not (length := np.linalg.norm(z)) > 0:
        raise InputError("axis: must not be zero")
    z = z / length
    x = perpendicular(z)
    half_angle = float(half_angle)
    corners = enclosure(enough(half_angle) if count is None else int(count), half_angle)
    forces = magnitude * corners @ np.array([x, np.cross(z, x), z])
    return tuple(ProcessLoad(f, name=f"force {i + 1} of {len(forces)}") for i, f in enumerate(forces))


@dataclass(frozen=True, eq=False)
class GripperTask:
    """A gripper pose in the world and the loads that act there.

    Attributes:
        position: (3,), m, of G in the world.
        rotation: (3, 3), gripper to world axes.
        loads: process loads, one at a time; none: the arm only holds itself.
        orientation: "full"; "axis": only the direction of `tool_axis` counts (drilling); "free": only the
            position.
        tool_axis: (3,), unit vector, gripper axes.
        name: for messages and results.
    """

    position: Sequence[float]
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    loads: Sequence[ProcessLoad] = ()
    orientation: Orientation = "full"
    tool_axis: Sequence[float] = (0.0, 0.0, 1.0)
    name: str = "task"

    def __post_init__(self) -> None:
        shapes = {"position": (3,), "rotation": (3, 3), "tool_axis": (3,)}
        for key, shape in shapes.items():
            settle(self, **{key: finite_array(f"{self.name}: {key}", getattr(self, key), shape)})
        rotation_matrix(f"{self.name}: rotation", self.rotation, tolerance=_ROTATION_TOLERANCE)
        if abs(np.linalg.norm(self.tool_axis) - 1) > 1e-9:
            axis = np.asarray(self.tool_axis).tolist()
            raise InputError(f"{self.name}: tool_axis: must have length 1, got {axis}")
        if self.orientation not in get_args(Orientation):
            raise InputError(
                f"{self.name}: orientation: expected one of {', '.join(get_args(Orientation))}, got "
                f"{self.orientation!r}"
            )
        settle(self, loads=tuple(self.loads))
        for load in self.loads:
            if not isinstance(load, ProcessLoad):
                raise InputError(f"{self.name}: loads: expected ProcessLoad, got {load!r}")
        names = [load.name for load in self.loads]
        if len(set(names)) != len(names):
            raise InputError(f"{self.name}: loads: names must differ, got {', '.join(names)}")


@dataclass(frozen=True)
class PlacementLimits:
    """Constraints of 4.4 with a number; joint limits come from the arm, bounds from the terrain.

    Attributes:
        GN, GT: largest tip-over index and friction utilisation (4.22), 1 tips or slips; None: the base only
            has to stand in the contact solver's solution (4.21), which the search keeps by 1 in place of the
            value.
        torque_ratio: largest |torque| / limit (4.33).
        clearance: m, smallest distance of the arm from itself and from obstacles.
        base_clearance: m, the same for the base's contacts and shapes.
        condition: largest Frobenius condition number |J| |J^-1| (4.35), usually 10 to 40; None: no limit.
        singular_ratio: largest ratio of the extreme singular values of J (4.37); None: no limit.
        jacobian_length: m, length by which the translational rows of J are divided for both.
        index: a performance index of the pose to be kept above `index_min`, of `INDICES`: "dm_2" (rad),
            "pi_oe", "inv_cdn_oe" or "manipulability" (m^3), see `ocptip.indices`; six-axis arms only.
        index_min: its minimum; the search keeps a smooth bound from below of "pi_oe" and "inv_cdn_oe".
        tool_radius: m, of the ball about the TCP that "pi_oe" and "inv_cdn_oe" take as the tool.
        angle_margin: rad, smallest distance of turning joints from their limits.
    """

    GN: float | None = 0.9
    GT: float | None = 0.9
    torque_ratio: float = 1.0
    clearance: float = CLEARANCE
    base_clearance: float = 0.0
    condition: float | None = None
    singular_ratio: float | None = None
    jacobian_length: float = 1.0
    index: str | None = None
    index_min: float | None = None
    tool_radius: float = 0.1
    angle_margin: float = 0.0

    def __post_init__(self) -> None:
        for name in ("torque_ratio", "jacobian_length", "tool_radius"):
            positive_number(name, getattr(self, name))
        for name in ("clearance", "base_clearance", "angle_margin"):
            positive_number(name, getattr(self, name), zero_allowed=True)
        for name in ("GN", "GT"):
            if getattr(self, name) is not None:
                share_of_one(name, getattr(self, name))
        for name in ("condition", "singular_ratio", "index_min"):
            if getattr(self, name) is not None:
                value = positive_number(name, getattr(self, name))
                if name != "index_min" and value <= 1:
                    raise InputError(f"{name}: must be > 1, which no pose falls below, got {value:g}")
        if self.index is not None and self.index not in INDICES:
            raise InputError(f"index: expected one of {', '.join(INDICES)}, got {self.index!r}")
        if (self.index is None) != (self.index_min is None):
            raise InputError(f"index, index_min: give both or none, got {self.index!r}, {self.index_min!r}")


@dataclass(frozen=True)
class Weights:
    """Weights of the criteria (4.38), scaled to the sum 1.

    Attributes:
        GN: tip-over. GT: slip. GK: use of the force space. GE: electric power at standstill, or torque cost.
    """

    GN: float = 0.25
    GT: float = 0.25
    GK: float = 0.25
    GE: float = 0.25

    def __post_init__(self) -> None:
        for name in CRITERIA:
            positive_number(f"weights.{name}", getattr(self, name), zero_allowed=True)
        total = sum(getattr(self, name) for name in CRITERIA)
        if total <= 0:
            raise InputError("weights: at least one must be > 0")
        for name in CRITERIA:
            settle(self, **{name: getattr(self, name) / total})

    def array(self) -> np.ndarray:
        """(4,) in the order GN, GT, GK, GE."""
        return np.array([getattr(self, name) for name in CRITERIA])


@dataclass(frozen=True, eq=False)
class TaskLoad:
    """One load of one task.

    Attributes:
        task: number of the task.
        load: its number, -1 without process load.
        force, moment: (3,), N, N m, world axes.
        counts: it counts in the criteria.
        constrained: it counts in the constraints.
        name: e.g. "drill: thrust" or "drill: without process load".
    """

    task: int
    load: int
    force: np.ndarray
    moment: np.ndarray
    counts: bool
    constrained: bool
    name: str


@dataclass(frozen=True, eq=False)
class PlacementProblem:
    """Where should the base stand? (4.38, 4.39)

    Attributes:
        robot: the arm on its support, in base axes; its obstacles (a deck) and shapes move with the base.
        tasks: one placement serves them all, one after the other.
        terrain: one patch or several.
        weights: of the criteria.
        limits: constraints.
        obstacles: walls, pillars and solids in the world, for the arm and for the base.
        keep_out: such for the base only (4.27): for its shapes, and for its contacts as points.
        unloaded: all constraints also hold without the process load: the arm has to get into place first.
        energy: model of GE; default the holding power of the robot's motors.
        references: values by which criteria are divided; default 1, for GE the power with all joints at their
            torque limits (1 for a `TorqueCost`).
        gravity: (3,), m/s^2, world axes; default the support's magnitude, along -z.
        ground_frame: position (3,) and rotation (3, 3) of the ground frame in base axes; default the point
            of the contacts' plane on the base's z axis, for contacts in a plane z = const.
        tolerance: of the base; contact limits and criteria hold for, and are of, the worst that it allows.
        alike: the robot's contacts have the springs of `if_alike`.
        footing: the base on its nominal contacts, with the minimum friction (filled in).
        stands: how the base stands on each patch (filled in).
        corners: what the tolerance allows at worst, one entry without tolerance (filled in).
    """

    robot: Robot
    tasks: Sequence[GripperTask]
    terrain: Sequence[Patch]
    weights: Weights = field(default_factory=Weights)
    limits: PlacementLimits = field(default_factory=PlacementLimits)
    obstacles: Sequence[Obstacle] = ()
    keep_out: Sequence[Obstacle] = ()
    unloaded: bool = True
    energy: HoldingPower | TorqueCost = None  # pyright: ignore[reportAssignmentType] # filled in
    references: dict[str, float] = field(default_factory=dict)
    gravity: Sequence[float] = None  # pyright: ignore[reportAssignmentType] # filled in
    ground_frame: tuple[np.ndarray, np.ndarray] = None  # pyright: ignore[reportAssignmentType] # filled in
    tolerance: Uncertainty = field(default_factory=Uncertainty)
    alike: bool = False

    footing: Footing = field(init=False)
    stands: tuple[Stand, ...] = field(init=False)
    corners: tuple[Corner, ...] = field(init=False)

    def __post_init__(self) -> None:
        settle(self, tasks=(self.tasks,) if isinstance(self.tasks, GripperTask) else tuple(self.tasks))
        settle(self, terrain=(self.terrain,) if isinstance(self.terrain, Patch) else tuple(self.terrain))
        for name, kind in (("tasks", GripperTask), ("terrain", Patch)):
            values = getattr(self, name)
            if not values or not all(isinstance(v, kind) for v in values):
                raise InputError(f"{name}: expected {kind.__name__}, at least one, got {values!r}")
            names = [v.name for v in values]
            if len(set(names)) != len(names):
                raise InputError(f"{name}: names must differ, got {', '.join(names)}")
        if not isinstance(self.robot, Robot):
            raise InputError(f"robot: expected a Robot, got {self.robot!r}")
        if self.robot.arm.process is not None:
            raise InputError("robot: what acts on its gripper belongs to the tasks; give them loads instead")
        for name in ("obstacles", "keep_out"):
            settle(self, **{name: tuple(getattr(self, name))})
            for shape in getattr(self, name):
                if not isinstance(shape, Obstacle):
                    raise InputError(f"{name}: expected Wall, Pillar or Solid in world axes, got {shape!r}")
        n, arm = self.robot.arm.n, self.robot.arm.name
        if self.limits.index is not None and n != 6:
            raise InputError(f"limits: index: {self.limits.index} is for six axes, arm {arm!r} has {n}")
        for task in self.tasks:
            free = n + min(patch.size for patch in self.terrain)
            rows = {"full": 6, "axis": 5, "free": 3}[task.orientation]
            if rows > free:
                raise InputError(
                    f"{task.name}: orientation: {task.orientation!r} needs {rows} free parameters, "
                    f"arm {arm!r} on this terrain has {free}; use 'axis' or 'free'"
                )
        low, high = self.robot.arm.angle_range(self.limits.angle_margin)
        for j in np.flatnonzero(low >= high):
            name, margin = self.robot.arm.joint_names[j], np.degrees(self.limits.angle_margin)
            raise InputError(f"limits: angle_margin_deg: {margin:g} deg leave {name} no angle")
        self._fill_in()

    @property
    def if_alike(self) -> PlacementProblem | None:
        """This problem with equally compliant contacts; None unless rigid ones that differ in friction leave
        the sharing of loads open.
        """
        robot = self.robot.if_alike
        return None if robot is None else replace(self, robot=robot, alike=True)

    @property
    def collision_checked(self) -> bool:
        """Whether collisions of the arm are a matter of this problem: its geometry is known."""
        return self.robot.arm.may_collide

    @property
    def collision(self) -> dict[str, Any]:
        """The scope of the collision check, as plain data for JSON, see `Collisions.to_dict`."""
        return self.robot.collision.to_dict() if self.collision_checked else {"checked": False}

    def _fill_in(self) -> None:
        support = self.robot.support
        if self.gravity is None:
            settle(self, gravity=[0.0, 0.0, -float(np.linalg.norm(support.gravity))])
        settle(self, gravity=finite_array("gravity", self.gravity, (3,)))
        if self.ground_frame is None:
            heights = np.array([c.position[2] for c in support.contacts])
            if np.ptp(heights) > _SAME_LEVEL * support.length:
                raise InputError(
                    "ground_frame: the contacts have different heights in the base "
                    f"({heights.min():.4g} to {heights.max():.4g} m); say where the ground frame is"
                )
            settle(self, ground_frame=(np.array([0.0, 0.0, heights.mean()]), np.eye(3)))
        position, rotation = self.ground_frame
        rotation = rotation_matrix("ground_frame[1]", rotation, tolerance=_ROTATION_TOLERANCE)
        settle(self, ground_frame=(finite_array("ground_frame[0]", position, (3,)), rotation))
        if self.energy is None:
            settle(self, energy=HoldingPower(self.robot.motors, support.power))
        if not isinstance(self.energy, HoldingPower | TorqueCost):
            raise InputError(f"energy: expected HoldingPower or TorqueCost, got {self.energy!r}")
        if isinstance(self.energy, TorqueCost) and len(self.energy.cost) != self.robot.arm.n:
            raise InputError(
                f"energy: the arm has {self.robot.arm.n} joints, the torque cost {len(self.energy.cost)}"
            )
        for name, value in self.references.items():
            if name not in CRITERIA:
                raise InputError(f"references: no criterion {name!r}; there are {', '.join(CRITERIA)}")
            positive_number(f"references.{name}", value)
        references = {"GN": 1.0, "GT": 1.0, "GK": 1.0, **self.references}
        if "GE" not in references:
            references["GE"] = self._energy_reference()
        settle(self, references=references)
        self.tolerance.require_only("base_mass", "center_of_mass", "friction", where="in placements")
        feet = Feet(self.robot, self.tolerance)
        settle(self, footing=feet.usual)
        stands = tuple(Stand(patch, feet, self.ground_frame) for patch in self.terrain)
        settle(self, stands=stands)
        settle(self, corners=self._corners())

    def _corners(self) -> tuple[Corner, ...]:
        """Corners of the tolerance; directions of gravity in base axes are known from a sample of places."""
        rng, seen = np.random.default_rng(0), []
        for patch, stand in enumerate(self.stands):
            low, high = self.terrain[patch].box(self.tasks[0].position, self.reach)
            parameters = low + rng.random((_PROBES, len(low))) * (high - low)
            seen.append(stand.at(parameters).base.transpose(0, 2, 1) @ self.gravity)
        return self.tolerance.corners(self.robot.support, np.concatenate(seen))

    def _energy_reference(self) -> float:
        if isinstance(self.energy, TorqueCost):
            return 1.0
        torque = self.robot.arm.limits.torque
        if not np.isfinite(torque).all():
            if self.weights.GE == 0:
                return 1.0
            raise InputError(
                "references: GE needs a reference power (W) for an arm without torque limits; give "
                "references={'GE': ...}"
            )
        return float(self.energy.values(torque[None])[0])

    @cached_property
    def cases(self) -> tuple[TaskLoad, ...]:
        """All load cases, task by task, each task's unloaded one first."""
        several, none, result = len(self.tasks) > 1, np.zeros(3), []
        for t, task in enumerate(self.tasks):
            prefix = f"{task.name}: " if several else ""
            load_rows = [(np.asarray(load.force), np.asarray(load.moment), load.name) for load in task.loads]
            loads = [(i, *load) for i, load in enumerate(load_rows) if load[0].any() or load[1].any()]
            counts = len(loads) < max(len(task.loads), 1)
            unloaded = f"{prefix}without process load"
            result.append(TaskLoad(t, -1, none, none, counts, counts or self.unloaded, unloaded))
            result += [
                TaskLoad(t, i, force, moment, True, True, f"{prefix}{name}")
                for i, force, moment, name in loads
            ]
        return tuple(result)

    @cached_property
    def most_torque(self) -> np.ndarray:
        """(n,) largest torque amounts, N m (sliding joints: N); infinite where there is none."""
        return self.limits.torque_ratio * self.robot.arm.limits.torque

    @cached_property
    def limited_joints(self) -> np.ndarray:
        """Numbers of the joints with a torque limit."""
        return np.flatnonzero(np.isfinite(self.most_torque))

    @property
    def reach(self) -> float:
        """Upper bound, m, of the distance between the base's ground point and G."""
        arm, (position, _) = self.robot.arm, self.ground_frame
        return float(arm.reach + np.linalg.norm(arm.mount_position - position))

    def scales(self, patch: int) -> np.ndarray:
        """(k,) by how much parameters of a patch may change for the arm to take another posture.

        Angles in radians count as they are; others in units of the arm's reach, or of the patch if that is
        smaller.
        """
        terrain = self.terrain[patch]
        span = terrain.upper - terrain.lower
        return np.where(terrain.angular, 1.0, np.minimum(self.reach, np.where(span > 0, span, np.inf)))

    def base_pose(self, patch: int, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Base origins (N, 3), m, and rotations base to world (N, 3, 3) at parameters (N, k) of a patch."""
        stood = self.stands[patch].at(parameters)
        return stood.origin, stood.base
