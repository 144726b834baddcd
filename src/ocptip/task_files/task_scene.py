"""The data that all motions of a file share: the robot on its base, obstacles, limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ocptip.basics import schema
from ocptip.basics.schema import Key, Keys
from ocptip.basics.toml import Table
from ocptip.contact.support import Support
from ocptip.robots.kinematics import TCP, checked_points
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.limits import LIMIT_KEYS, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.scene import BASE, SCENE, read_support
from ocptip.task_files.tables.arm import ARM, MOUNT, read_arm, require_base_mass
from ocptip.task_files.tables.joints import LOCKED
from ocptip.task_files.tables.motors import (
    MOTORS,
    PLATFORM_MOTORS,
    arm_and_motors,
    gear_damping_ratio,
)
from ocptip.task_files.tables.payload import (
    PAYLOAD,
    PROCESS,
    SENSOR,
    read_sensor,
)
from ocptip.task_files.tables.shapes import (
    OBSTACLE,
    read_base_shapes,
    read_obstacles,
    require_geometry,
    shape_key,
)
from ocptip.task_files.tables.tolerance import tolerance_of


def _coordinate_limit(meaning: str, unit: str = "m, rad", bound: str = "", otherwise: str = "") -> schema.Key:
    return schema.per_joint(meaning, unit, bound=bound, otherwise=otherwise)


_LIMITS = Keys(
    "limits of a parallel robot",
    "Limits of the coordinates of the platform and of the motors.",
    {
        "lower": _coordinate_limit("Lower limit of the coordinates."),
        "upper": _coordinate_limit("Upper limit of the coordinates."),
        "speed": _coordinate_limit("Speed limit of the coordinates.", "m/s, rad/s", "> 0"),
        "acceleration": _coordinate_limit("Acceleration limit of the coordinates.", "m/s^2, rad/s^2", "> 0"),
        "motor_force": _coordinate_limit("Limit of the forces or torques of the motors.", "N, N m", "> 0"),
        "motor_speed": _coordinate_limit("Speed limit of the motors.", "m/s, rad/s", "> 0", "none"),
        "singularity": schema.number(
            "Minimum distance from singular poses, 0 to 1.", otherwise="the usual one"
        ),
    },
)
PLATFORM_ROBOT = Keys(
    "robot",
    "A parallel robot, instead of an arm.",
    {
        "parallel": schema.text("A ready-made robot such as `Delta`, or a robot file, relative to this one."),
        **MOUNT,
        "limits": schema.table(_LIMITS),
    },
)


ROBOT_BASE = Keys(
    "base",
    BASE.meaning,
    {
        **BASE.keys,
        "accept_mass": schema.flag(
            "The base may be lighter than the fixed links of the URDF.", default=False
        ),
        "floor": schema.flag("What the contacts stand on is an obstacle.", default=True),
        "shape": shape_key("Solids of the base, base axes."),
    },
)


NO_BASE_SHAPE = "the base has no [[base.shape]]: collisions of the arm with it are not checked"
SPEED_LIMITS = {
    "tcp_speed": schema.number("Maximum speed of the TCP.", "m/s", bound="> 0", otherwise="none"),
    "point_speed": schema.anything(
        "Maximum speeds, m/s, by joint, where its link begins.",
        "table of numbers",
        {"type": "object", "additionalProperties": {"type": "number", "exclusiveMinimum": 0}},
        otherwise="none",
    ),
}
COMMON_LIMITS = {
    **LIMIT_KEYS,
    **SPEED_LIMITS,
    "reference_moment": schema.number(
        "Reference moment of the tip-over index.",
        "N m",
        bound="> 0",
        otherwise="a tenth of the margin at rest",
    ),
    "angle_margin_deg": schema.number(
        "Minimum distance from the limits of turning joints.", "deg", bound=">= 0", default=0.0
    ),
}
_ROBOTS = {
    "arm": {
        "arm": schema.table(ARM),
        "motors": schema.table(MOTORS, default=None),
        "obstacle": schema.tables(OBSTACLE, "Obstacles, base axes."),
    },
    "robot": {"robot": schema.table(PLATFORM_ROBOT), "motors": schema.table(PLATFORM_MOTORS)},
}
_SCENE_KEYS = {
    "name": SCENE.keys["name"],
    "gravity": SCENE.keys["gravity"],
    "base": schema.table(ROBOT_BASE),
    "contact": SCENE.keys["contact"],
    "payload": PAYLOAD,
    "process": PROCESS,
    "sensor": schema.table(SENSOR, default=None),
    "tolerance": SCENE.keys["tolerance"],
}


def task_keys(
    name: str, meaning: str, common: Mapping[str, Key], further: Mapping[str, Mapping[str, Key]]
) -> Keys:
    """Keys of a file with a robot on its base.

    Args:
        name: of the kind of file.
        meaning: of it.
        common: further keys.
        further: the same by kind of robot, "arm" or "robot".
    """
    return Keys(
        name,
        meaning,
        {**_SCENE_KEYS, **common},
        by=("robot", "arm"),
        variants={
            robot: Keys(f"{name} with {robot}", f"{meaning} With [{robot}].", {**_ROBOTS[robot], **keys})
            for robot, keys in further.items()
        },
        usual="arm",
    )


class TaskScene:
    """The data that all motions of a file share: the place of the robot, obstacles, limits.

    Args:
        data: the file.
        otherwise: the tolerance of an arm if the file has none.

    Attributes:
        limits: of `[limits]`.
    """

    def __init__(self, data: Table, otherwise: Uncertainty = NONE) -> None:
        self._data, self._arms = data, dict[str, ArmModel]()
        self._shapes, base = read_base_shapes(data), data.table("base")
        self._floor, self._accept_mass = base["floor"], base["accept_mass"]
        self._support = read_support(data)
        table = data.table("limits")
        self._moment = table["reference_moment"]
        margin = table["angle_margin_deg"]
        self._usual_clearance = "clearance" not in table
        numbers = limits_of(table, self._support, None if "robot" in data else data.table("motors"))
        for key in ("rise_time", "jerk"):  # where there are such keys, they are read with the motion
            table.value(key)
        self._speeds = speed_limits(table)
        limits = table.make(Limits, angle_margin=margin, **numbers)
        parallel = "robot" in data
        tolerance = tolerance_of(data, NONE if parallel else otherwise)
        if parallel and tolerance.given == ("damping",):
            self.limits = replace(
                limits, damping=tolerance.damping
            )  # nothing else is looked at: no worst case
        else:
            self.limits = replace(limits, tolerance=tolerance)

    def robot(self, segment: Table | None = None) -> StandingMechanism:
        """The robot on its support, with what it holds in a segment of a cycle."""
        data = self._data
        if "robot" in data:
            if self._speeds:
                raise data.error("speed limits of points are for arms", "limits")
            from ocptip.task_files.parallel import read_platform_robot  # loads for 0.1 s

            return read_platform_robot(data, self._support, self._moment, segment)
        gripper = "" if segment is None else repr([segment.content.get(key) for key in LOCKED])
        if gripper not in self._arms:
            self._arms[gripper] = read_arm(data.table("arm"), segment)
        arm, motors = arm_and_motors(data, segment, self._arms[gripper])
        require_base_mass(data, arm, self._support.mass, accepted=self._accept_mass)
        require_geometry(data, arm, {"base.shape": self._shapes, "obstacle": data.tables("obstacle")})
        obstacles = read_obstacles(data, "obstacle")
        at_rest = {one.name for one in (arm.geometry.shapes if arm.geometry else ()) if one.body == 0}
        if not self._shapes and arm.may_collide and len(at_rest) <= 1:  # the link that the arm stands on
            arm = arm.with_notes(NO_BASE_SHAPE)
        with data.table("limits").at(speed_limits="point_speed"):
            checked_points(arm, self._speeds)
        robot = Robot(
            arm,
            self._support,
            motors,
            obstacles=obstacles,
            shapes=self._shapes,
            floor=self._floor,
            speed_limits=self._speeds,
            reference_moment=self._moment,
            sensor=read_sensor(data, arm.mount_position),
        )
        if self._usual_clearance:  # of a cycle the smallest of all segments
            self.limits = replace(self.limits, clearance=min(self.limits.clearance, robot.usual_clearance))
        return robot


def limits_of(table: Table, support: Support, motors: Table | None) -> dict[str, float]:
    """Numbers of [limits]; acceleration steps count with the minimum damping ratio of feet and elastic
    joints.
    """
    ratios = [spring.ratio for spring in support.elastic.springs] if support.elastic else []
    if motors is not None and "gear_stiffness" in motors:
        ratios += [0.0 if "gear_damping" in motors else gear_damping_ratio(motors)]
    return {"damping": min(ratios, default=1.0), **limit_numbers(table)}


def speed_limits(table: Table) -> dict[str, float]:
    """Speed limits of points of an arm in [limits], m/s, by their names, see `Robot`."""
    tcp, points = table["tcp_speed"], table["point_speed"] or {}
    if not isinstance(points, dict):
        raise table.error(f"expected a table of joints and speeds, got {points!r}", "point_speed")
    return {**({} if tcp is None else {TCP: tcp}), **points}


def limit_numbers(table: Table) -> dict[str, float]:
    """Numbers of a table [limits] as they are."""
    if "damping" in table:
        raise table.error("is now damping in [tolerance], for all robots", "damping")
    return table.given(*LIMIT_KEYS)
