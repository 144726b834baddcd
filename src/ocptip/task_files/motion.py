"""Motion tasks from TOML files: any arm, or a parallel robot, on any support.

Format: docs/motion-planner.md. If a pose has several IK solutions, the task holds all pairs of start and goal
that stand at rest within all limits. Its nominal start and goal are the pair with the shortest joint path.
"""

from __future__ import annotations

import os
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import InputError, is_whole
from ocptip.basics.schema import Key, Keys
from ocptip.basics.toml import Table
from ocptip.motion.choices import posture_pairs
from ocptip.motion.files.source import speed_table
from ocptip.motion.objective import objective_of
from ocptip.motion.stops.rules import Kinds, StopRules
from ocptip.motion.task import FIRST_SEVEN, MotionTask, check_commands
from ocptip.published.cases import case_names
from ocptip.published.tasks import ADAPTER_MASS, BASES, experiment_task
from ocptip.robots.collision.model import ShapeCollisions
from ocptip.robots.collision.opened import opened
from ocptip.standing.arm import Robot
from ocptip.standing.limits import LIMIT_KEYS, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_cancel import LONGEST
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.doubts import doubt_masses, doubt_units, doubt_way, require_kind
from ocptip.task_files.scene import SCENE
from ocptip.task_files.source import task_source
from ocptip.task_files.tables.joints import end_keys, joint_values, read_end
from ocptip.task_files.tables.motors import GEARS, read_gears
from ocptip.task_files.tables.objects import OBJECT, with_objects
from ocptip.task_files.tables.payload import PROCESS, SENSOR, read_process, read_sensor
from ocptip.task_files.tables.tolerance import tolerance_of
from ocptip.task_files.task_scene import (
    COMMON_LIMITS,
    SPEED_LIMITS,
    TaskScene,
    limits_of,
    speed_limits,
    task_keys,
)
from ocptip.trajectories.drive_profile import in_words, load_drive_profile
from ocptip.trajectories.velocity_profiles import SHORTEST_RISE, checked_rise_times

_KIND = schema.choice("Stops.", get_args(Kinds))
_RATES = {"cancel_deceleration_deg_s2": False, "cancel_deceleration_m_s2": True}
"""Keys of decelerations: whether these are of sliding joints."""
_OF_CANCELS = ("stopj", "share", "reaction", "longest", "base_deceleration")
"""Further keys of cancels, without their beginning."""
_TORQUE = "torque of each brake; sliding joints: N."
STOPS = Keys(
    "stops",
    "How the robot is stopped.",
    {
        "safe": schema.anything(
            "Stops that plans and checks keep; true: along the path, with torques also by brakes.",
            "`path`, `brakes`, `both`, `cancel`, `all`, or true",
            {"enum": [True, False, *get_args(Kinds)]},
            default=False,
        ),
        "GN": schema.number("Largest tip-over index during stops, see [limits].", otherwise="of [limits]"),
        "GT": schema.number("Largest share of the friction in use during stops.", otherwise="of [limits]"),
        "time": schema.number(
            "Shortest time of a stop along the path.", "s", otherwise="what the drives can"
        ),
        "brake_torque_min_Nm": schema.per_joint(
            f"Minimum {_TORQUE}", "N m", bound="> 0", otherwise="no brakes"
        ),
        "brake_torque_max_Nm": schema.per_joint(
            f"Maximum {_TORQUE}", "N m", bound="> 0", otherwise="no brakes"
        ),
        "brake_delay": schema.vector("Minimum and maximum delay of the brakes.", "s", 2, default=[0, 0]),
        **{
            key: schema.by_joint(
                f"Deceleration of {'sliding' if slides else 'turning'} joints of a cancelled controller.",
                "m/s^2" if slides else "deg/s^2",
                bound="> 0",
                otherwise="the acceleration limits",
            )
            for key, slides in _RATES.items()
        },
        "cancel_stopj": schema.number(
            "Instead: rate of the leading joint; all stop together (`stopj` of a UR).",
            "rad/s^2",
            bound="> 0",
            otherwise="none",
        ),
        "cancel_share": schema.number("Share of that deceleration.", bound="> 0", default=1),
        "cancel_reaction": schema.number(
            "Maximum time from a cancel until the joints decelerate.", "s", bound=">= 0", default=0
        ),
        "cancel_longest": schema.number(
            "Maximum time from a cancel until everything rests.", "s", bound="> 0", default=LONGEST
        ),
        "cancel_base_deceleration": schema.number(
            "Of a base that drives, from when the joints decelerate; 0: it drives on.",
            "m/s^2",
            bound=">= 0",
            default=0,
        ),
    },
)


def _safe(table: Table) -> Kinds | Literal[""] | None:
    """Stops that plans have to keep: of which kinds, "" where that is left open; None: of none."""
    value = table.value("safe", False)
    if isinstance(value, bool):
        return "" if value else None
    with table.at("safe"):
        return cast(Kinds, _KIND.convert(value, None))


def with_stops(data: Table, task: MotionTask) -> MotionTask:
    """The task with the file's rules of stops; where they say `safe`, stops along the path are its limits."""
    if "stops" not in data:
        return task
    table = data.table("stops")
    n = task.robot.n
    ends = [table.get(f"brake_torque_{end}_Nm", size=n) for end in ("min", "max")]
    delay = tuple(table["brake_delay"].tolist())
    rules = table.given("GN", "GT", "time")
    cancel = {name: table[f"cancel_{name}"] for name in _OF_CANCELS}
    cancel["deceleration"] = _decelerations(table, task.robot)
    safe = _safe(table)
    table.close()
    names = {"brake_min": "brake_torque_min_Nm", "brake_max": "brake_torque_max_Nm", "delay": "brake_delay"}
    names |= {name: f"cancel_{name}" for name in _OF_CANCELS}
    with table.at(**names, deceleration="cancel_deceleration_deg_s2"):
        stop_rules = StopRules(**rules, brake_min=ends[0], brake_max=ends[1], delay=delay, **cancel)
        if any(end is not None for end in ends):
            stop_rules.brakes(task.robot)
        limits = stop_rules.safe(task.limits, task.robot, safe or None) if safe is not None else task.limits
    return replace(task, stops=stop_rules, limits=limits)


def _decelerations(table: Table, robot: StandingMechanism) -> np.ndarray | None:
    """(n,), rad/s^2 and m/s^2; of joints that are not named the acceleration limits; None: of all."""
    given = [key for key in _RATES if table.value(key) is not None]
    if not given:
        return None
    if table["cancel_stopj"] is not None:
        raise table.error("not beside cancel_stopj, which is another law", given[0])
    if (arm := robot.arm) is None:
        raise table.error("cancels are not computed for parallel robots", given[0])
    values = robot.limits.acceleration.copy()
    for key in given:
        rates = joint_values(table, key, arm, slides=_RATES[key])
        indices = np.flatnonzero(np.array(arm.prismatic) == _RATES[key])
        assert rates is not None
        values[indices] = np.where(np.isnan(rates), values[indices], rates)
    return values


_OF_CASES = ("sensor", "process", "motors")
"""Tables of a printed case."""

JERK = {
    "jerk": schema.per_joint(
        "Jerk limit; those of the joints also count.", "SI units", bound="> 0", otherwise="none"
    )
}
_RISE_KEYS = {
    "rise_time": schema.per_joint(
        "Duration of changes of acceleration; 0: steps.",
        "s",
        bound=">= 0",
        otherwise="long enough for jerk limits, else 0",
    ),
    **JERK,
}
COURSE = {
    "optimised": schema.anything(
        "Names, patterns or numbers of the joints whose commands are optimised.",
        "list of joints",
        {"type": "array", "items": {"type": ["string", "integer"]}, "minItems": 1},
        otherwise="all up to the seventh",
    ),
    "commands": schema.anything(
        "Commands for each optimised joint.", "whole number", {"type": "integer", "minimum": 1}, default=3
    ),
}
AIM = {
    "objective": schema.text("Minimum of `energy`, `time` or `both`.", otherwise="`energy`"),
    "price_per_second": schema.number("Energy that a second costs, for `both`.", "J/s", otherwise="none"),
}
DURATION = {
    "duration": schema.number("The motion takes exactly so long.", "s", bound="> 0", otherwise="free"),
    "max_duration": schema.number("The motion takes at most so long.", "s", bound="> 0", otherwise="free"),
}
_PROFILE = "Drive profile: CSV of velocities (v, w) or a course (x, y, yaw), or `2 m, 0.8 m/s, 1 m/s^2`."
DRIVE = {
    "drive_profile": replace(
        schema.text(_PROFILE, default=None, otherwise="the base rests"), words="file or text"
    )
}
_ONE_DURATION = [("duration", "max_duration")]


def motion_keys(name: str, ends: dict[str, Key], *, cycle: bool = False) -> Keys:
    """Keys of [motion]; those of a cycle leave goals and durations to the segments."""
    return Keys(
        name,
        "The motion: from where to where, and what is optimised.",
        {**ends, **COURSE, **AIM, **({} if cycle else DURATION)},
        at_most_one=[] if cycle else _ONE_DURATION,
    )


def coordinates(end: str) -> dict[str, Key]:
    return {end: schema.vector(f"Coordinates of the platform at the {end}, m and rad.")}


CASE = Keys(
    "published case",
    "A published case with other limits and aims: `ocptip plan`.",
    {
        "case": schema.choice("The case.", case_names()),
        "base": schema.choice("Data of the base.", BASES, default="effective"),
        "motion": schema.table(
            Keys("aims", "What is optimised.", {**AIM, **DURATION}, at_most_one=_ONE_DURATION), default=None
        ),
        "limits": schema.table(
            Keys("limits of a case", "Limits.", {**LIMIT_KEYS, **SPEED_LIMITS, **_RISE_KEYS}),
            default=None,
        ),
        "motors": schema.table(GEARS, default=None),
        "sensor": schema.table(SENSOR, default=None),
        "process": PROCESS,
        "tolerance": SCENE.keys["tolerance"],
        "stops": schema.table(STOPS, default=None),
    },
)
MOTION = task_keys(
    "motion task",
    "A motion of a robot on its base: `ocptip plan`.",
    {
        "limits": schema.table(
            Keys("limits", "Limits of a motion.", {**COMMON_LIMITS, **_RISE_KEYS}), default=None
        ),
        "stops": schema.table(STOPS, default=None),
    },
    {
        "arm": {
            "object": schema.tables(OBJECT, "Objects that only contacts hold."),
            "motion": schema.table(
                motion_keys(
                    "motion of an arm", {**end_keys("start", "start"), **end_keys("goal", "goal"), **DRIVE}
                )
            ),
        },
        "robot": {
            "motion": schema.table(
                motion_keys("motion of a platform", {**coordinates("start"), **coordinates("goal")})
            )
        },
    },
)
TASK = Keys(
    "task",
    "A motion task, or a published case.",
    by=("case", "motion"),
    variants={"case": CASE, "motion": MOTION},
    usual="motion",
)


def load_task(path: str | os.PathLike[str], otherwise: Uncertainty = NONE) -> MotionTask:
    """Read a task file, format: docs/motion-planner.md. Whether it can be planned: :func:`refusals`.

    Args:
        path: of the file.
        otherwise: the tolerance of an arm if the file has none.

    Raises:
        InputError: the file cannot be read or describes no task, or a pose is out of reach (by how much); one
            line that names file and key.

    Warns: InputWarning: suspicious values, such as angles in radians.
    """
    path = Path(path)
    with Table.read(path, TASK) as data:
        require_kind(data, "plan")
        if "case" in data:
            return _published(data, otherwise)
        doubt_units(data)
        if "segment" in data:
            raise data.error("several motions are a cycle: ocptip.task_files.cycle.read_task", "segment")
        data.close(early=True)
        task = with_stops(data, _with_jerk(data.table("limits"), _task(data, path, otherwise)))
        task = replace(task, source=task_source(data, task.robot))
        doubt_masses(data, task.robot)
        doubt_way(data, task.start, task.goal)
        return task


def _published(data: Table, otherwise: Uncertainty) -> MotionTask:
    """A printed case, with limits, objective and duration of the file."""
    name, base = data["case"], data["base"]
    motion, table = data.table("motion"), data.table("limits")
    task = _published_task(data, name, base)
    numbers = limits_of(table, task.robot.support, data.table("motors"))
    table.given("rise_time", "jerk")  # see _with_jerk
    limits = table.make(replace, task.limits, **numbers, **_durations(motion))
    limits = replace(limits, tolerance=tolerance_of(data, otherwise))
    wanted = motion["objective"], motion["price_per_second"]
    objective = motion.make(objective_of, *wanted)
    return with_stops(data, _with_jerk(table, replace(task, limits=limits, objective=objective)))


def _published_task(data: Table, name: str, base: str) -> MotionTask:
    """A printed case with the sensor, the process and the gears of the file."""
    task = experiment_task(name, base)
    robot = Robot.of(task.robot)
    speeds = speed_limits(data.table("limits"))
    if not (speeds or any(key in data for key in _OF_CASES)):
        return task
    arm = robot.arm.with_process(read_process(data))
    sensor = read_sensor(data, robot.sensor.position, ADAPTER_MASS)
    with data.table("motors") as motors:
        arm = arm.with_gears(read_gears(motors, arm))
    with data.table("limits").at(speed_limits="point_speed"):
        robot = robot.varied(arm=arm, sensor=sensor, speed_limits=speeds)
    source = task_source(data, robot)
    keys = {key: value for key, value in source.data.items() if key in _OF_CASES}
    if speeds:
        keys["limits"] = speed_table(speeds)
    return replace(task, robot=robot, source=replace(source, data={"case": name, "base": base, **keys}))


def _task(data: Table, path: Path, otherwise: Uncertainty) -> MotionTask:
    scene = TaskScene(data, otherwise)
    name, motion = data.get("name", path.stem), data.table("motion")
    robot = with_objects(data, scene.robot())
    ends = [read_end(robot, motion, key, scene.limits) for key in ("start", "goal")]
    starts, goals = (postures for postures, _ in ends)
    if robot.arm is None:
        return ramp_task(name, robot, starts[0], goals[0], scene.limits, motion)
    robot = Robot.of(robot)
    given = [posture[0] for posture, pose in ends if pose is None]
    robot = _with_finer_solids(robot, np.reshape(given, (-1, robot.n)), scene.limits.clearance)
    if (profile := motion["drive_profile"]) is not None:
        source = profile if in_words(profile) else motion.named_file("drive_profile")
        with motion.at("drive_profile" if source is profile else None):
            robot = robot.driving(load_drive_profile(source))
    pairs = posture_pairs(robot, scene.limits, starts, goals)
    task = ramp_task(name, robot, *pairs[0], scene.limits, motion)
    targets = ends[0][1], ends[1][1]
    return replace(task, targets=targets, choices=tuple(pairs) if len(pairs) > 1 else ())


def _with_finer_solids(robot: Robot, postures: np.ndarray, gap: float) -> Robot:
    """The robot with more convex solids for meshes that are farther apart than their solids show.

    Args:
        robot: itself the result where more solids do not help.
        postures: (k, n) in which all pairs should be so far apart.
        gap: m.
    """
    if not isinstance(robot.collision, ShapeCollisions):
        return robot
    finer = opened(robot.collision, postures, gap)
    if finer is None:
        return robot
    before = [shape.name for shape in robot.arm.geometry.shapes] if robot.arm.geometry else []
    after = [shape.name for shape in finer.shapes]
    more = [f"{after.count(name)} for {name}" for name in dict.fromkeys(after)
            if after.count(name) != before.count(name)]  # fmt: skip
    note = f"convex solids so that start and goal are as free as their meshes: {', '.join(more)}"
    return robot.varied(arm=replace(robot.arm, geometry=finer).with_notes(note))


def ramp_task(
    name: str, robot: StandingMechanism, start: np.ndarray, goal: np.ndarray, limits: Limits, table: Table
) -> MotionTask:
    """The task with the optimised joints, commands, objective and durations of [motion]."""
    key, commands = "optimised", table.value("commands", 3)
    limits = replace(limits, **_durations(table))
    wanted = table["objective"], table["price_per_second"]
    optimised = table.value(key, [j + 1 for j in FIRST_SEVEN[: robot.n]])
    table.close()
    if not isinstance(optimised, list):
        raise table.error(f"expected a list of joints, got {optimised!r}", key)
    with table.at(key):
        joints = [joint for item in optimised for joint in _joints(item, robot.names)]
    if not joints or len(set(joints)) != len(joints):
        raise table.error(f"expected different joints, at least one, got {optimised!r}", key)
    with table.at():
        check_commands(commands)
        objective = objective_of(*wanted)
    chosen = tuple(sorted(joints))
    rises = _rises_of_jerk(robot, limits)
    return MotionTask(name, robot, start, goal, limits, chosen, commands, objective, rise_times=rises)


def _durations(table: Table) -> dict[str, float]:
    """Minimum and maximum duration, of [motion]."""
    key = table.one_of("duration")
    if key is None:
        return {}
    seconds = table[key]
    return {"min_duration": seconds if key == "duration" else 0.0, "max_duration": seconds}


def jerk_limited(table: Table, limits: Limits, n: int) -> Limits:
    """Limits with the jerk limit of [limits], of n joints, if it has such a key."""
    if table.value("jerk") is None:
        return limits
    return replace(limits, jerk=tuple(table.get("jerk", size=n).tolist()))


def _with_jerk(table: Table, task: MotionTask) -> MotionTask:
    """The task with the jerk limit of [limits], and its rise times or those that keep all jerk limits."""
    robot, limits = task.robot, jerk_limited(table, task.limits, task.robot.n)
    if table["rise_time"] is None:
        rises = _rises_of_jerk(robot, limits)
    else:
        with table.at():
            rises = checked_rise_times(table.get("rise_time", size=robot.n), robot.n)
    return replace(task, limits=limits, rise_times=rises)


def _rises_of_jerk(robot: StandingMechanism, limits: Limits) -> tuple[float, ...] | None:
    """Rise times with which no jerk limit can be exceeded; None: there is no such limit.

    Within a rise time an acceleration changes by no more than from its limit to the opposite one.
    """
    if not np.isfinite(jerks := limits.jerks(robot.limits)).any():
        return None
    rises = 2 * robot.limits.acceleration / jerks
    return checked_rise_times(np.where(rises > 0, np.maximum(rises, SHORTEST_RISE), 0.0), robot.n, "jerk")


def _joints(item: Any, names: tuple[str, ...]) -> list[int]:
    """Numbers of joints, from 0, given by name, by pattern ("joint_*") or by number from 1."""
    if is_whole(item) and 1 <= item <= len(names):
        return [item - 1]
    every = names if isinstance(item, str) else ()
    if fitting := [j for j, name in enumerate(every) if name == item or fnmatchcase(name, item)]:
        return fitting
    raise InputError(f"no joint {item!r}; there are 1 to {len(names)}: {', '.join(names)}")
