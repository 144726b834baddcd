"""`ocptip.drive`: how hard a mobile base may accelerate, brake and turn with its arm at rest."""

from __future__ import annotations

import os
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from ocptip.api.chart import halton_postures
from ocptip.api.inputs.given import MotionLike, given_motion
from ocptip.api.inputs.postures import RestingPosture, resting_posture
from ocptip.api.results.drive import DriveEnvelope
from ocptip.api.results.drive_arguments import DriveArguments
from ocptip.api.tasks import TaskLike
from ocptip.basics.errors import InputError, positive_number, whole_number
from ocptip.motion.cycles.task import Task
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.refusals import own_refusals
from ocptip.standing.at_rest.stow_pose import StowSearch
from ocptip.standing.instants import Instants
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.tolerable import AT_REST
from ocptip.task_files.plan_folder import is_plan_folder
from ocptip.task_files.tables.tolerance import load_tolerance

DIRECTIONS, SPEED, TURNING, SLOPE, SAMPLES = 36, 1.0, 0.5, np.radians(5.0), 4000
STOW = "stow"
"""Name of the posture that is searched."""

_STARTS = 6  # postures that are improved


def drive(
    what: Task | StandingMechanism | RestingPosture | str | os.PathLike[str],
    q: ArrayLike | str | None = None,
    *,
    motion: MotionLike | None = None,
    uncertainty: Uncertainty | str | None = None,
    directions: int = DIRECTIONS,
    speed: float = SPEED,
    turning: float = TURNING,
    slope: float = SLOPE,
    deceleration: float | None = None,
    payload: float | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    holonomic: bool = False,
) -> DriveEnvelope:
    """Return the largest accelerations with which a mobile base neither tips nor slides.

    Example::

        found = ocptip.drive("examples/tasks/ur5_cart.toml", "start", speed=1.0)
        print(found)
        found.save("drive")

    Forward is the x axis of the base. Accelerations are those of the origin of the base frame.

    Args:
        what: a task of an arm, its file, or a robot; or the folder of a plan: of its
            motion, or with `q` in a posture of it.
        q: its posture: (n,), rad (prismatic joints: m), or a name in the task ("start", "goal", a segment);
            default: the start of a task. "stow" searches the posture, clear of collisions, with the largest
            acceleration in its worst direction.
        motion: of the arm, instead of a posture: the limits are those of its worst instants.
        uncertainty: what the limits hold within, an object, a preset ("workshop", "none") or a TOML file with
            a table `[tolerance]`. Default: that of the task, else "workshop". Its `damping` says by how much
            an acceleration overshoots that sets in or ends at once.
        directions: of acceleration on level ground.
        speed: m/s, forward, of turning and of the emergency stop.
        turning: rad/s, of the emergency stop in a turn.
        slope: rad, on which the base brakes.
        deceleration: m/s^2, of the emergency stop whose largest speed is wanted; default: 80 % of the
            largest at low speed in its curve on level ground.
        payload: kg, instead of that of the task.
        samples, seed: of the search for a stow pose: postures that are drawn, and which.
        holonomic: whether the parameters for navigation have sideways acceleration.

    Raises:
        InputError: the robot is no arm, or a value cannot be used.
    """
    whole_number("directions", directions, 4)
    speed, turning = positive_number("speed", speed), positive_number("turning", turning)
    if not 0 <= (slope := positive_number("slope", slope, zero_allowed=True)) < np.pi / 4:
        raise InputError(f"slope: must be below 45 degrees, got {np.degrees(slope):.4g} degrees")
    for name, value, least in (("samples", samples, 1), ("seed", seed, 0)):
        whole_number(name, value, least)
    stow, moves = isinstance(q, str) and q == STOW, None
    if motion is None and q is None and isinstance(what, str | os.PathLike) and is_plan_folder(what):
        _, what, moves = given_motion(what, None)
    elif motion is not None:
        _, what, moves = given_motion(motion, cast(TaskLike, what))
    if moves is not None and (q is not None or cast(Task, what).is_cycle):
        raise InputError(
            "motion: envelopes are of a posture or of one motion, not of both, and not of a cycle"
        )
    posture = resting_posture(what, None if stow else q)
    robot = posture.robot if moves is None else cast(Task, what).robot
    robot = Robot.of(robot, "task: drive envelopes are for arms; this robot is a parallel one")
    if stow:
        robot.require_no_objects("posture stow")
    if payload is not None:
        robot.require_no_objects("payload")
        held = robot.payload.center_of_mass if robot.payload else np.zeros(3)
        load = Payload(positive_number("payload", payload), held)
        robot = robot.varied(arm=robot.arm.with_payload(load))
    tolerance = posture.limits.tolerance if uncertainty is None else load_tolerance(uncertainty)
    counts = (*AT_REST, "drive_speed", "damping", *(("speed", "delay") if moves is not None else ()))
    counting = tolerance.only(*(name for name in tolerance.given if name in counts))
    given = DriveArguments(directions, speed, turning, slope, deceleration, holonomic)
    if moves is not None:
        name = f"{cast(Task, what).name} in motion"
        return DriveEnvelope(name, robot.driving(None), moves.start, tolerance, counting, given, moves)
    if not stow:
        rests = Instants.at_rest(robot, posture.q[None])
        about = posture.scene.name, robot, posture.q, tolerance, counting, given
        broken = tuple(own_refusals(robot, posture.limits, rests))
        return DriveEnvelope(*about, choice=posture.choice, broken=broken)
    search = StowSearch(robot, posture.limits)
    drawn = np.vstack([posture.q, halton_postures(robot, posture.limits, samples, seed)])
    name = posture.scene.name.removesuffix(f" at {posture.name}") + " in its stow pose"
    results = [
        DriveEnvelope(name, robot, best, tolerance, counting, given)
        for best in search.best(drawn, _STARTS, np.random.default_rng(seed))
    ]
    if not results:
        raise InputError("stow: every posture drawn collides, or comes nearer than the clearance")
    return max(results, key=lambda one: one.worst_direction[0])
