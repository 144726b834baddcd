"""Ten motions that were made for attacks on proofs: ordinary bases with something uneven about each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.task import MotionTask
from ocptip.published.tasks import experiment_task
from ocptip.retiming.retime import retime
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import SITE, WORKSHOP, Uncertainty
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory

CUSTOM = Uncertainty(
    tilt=np.radians(1.0),
    base_mass=0.1,
    arm_mass=0.02,
    payload_mass=0.2,
    payload_center=(0.02, 0.02, 0.02),
    center_of_mass=(0.01, 0.01, 0.03),
    friction=0.1,
    push=5.0,
    base_push=20.0,
    speed=0.02,
)


def feet(
    places: list[tuple[float, float, float]], friction: float, lean: float = 0.0, **more: float
) -> list[Binding]:
    """Ordinary contacts at places, m, whose normals lean inwards."""
    return [
        UnilateralContact(position=[x, y, z], normal=[-lean * x, -lean * y, 1.0], friction=friction, **more)
        for x, y, z in places
    ]


def on_base(case: str, contacts: list[Binding], mass: float, center: list[float]) -> MotionTask:
    """The task of a published arm on another base."""
    task = experiment_task(case)
    support = Support(contacts, mass=mass, center_of_mass=center)
    return replace(task, robot=Robot(task.robot.arm, support, task.robot.motors))


def swing(task: MotionTask, way: float = 0.4, speed: float = 0.25, share: float = 0.8) -> Trajectory:
    """Every joint by itself a share of its way."""
    commands = [
        [RampCommand(a + way * w, speed * v, share)]
        for a, w, v in zip(task.start, task.goal - task.start, task.robot.limits.speed, strict=True)
    ]
    return Trajectory.from_profiles(task.start, commands)


_SQUARE = [(0.3, 0.25, 0.0), (0.3, -0.25, 0.0), (-0.3, -0.25, 0.0), (-0.3, 0.25, 0.0)]
_TRIPOD = [(0.35, 0.0, 0.0), (-0.2, 0.3, 0.0), (-0.2, -0.3, 0.0)]


def five_uneven(case: str = "B") -> MotionTask:
    """Five feet, none of them at the height of another."""
    places = [
        (0.35, 0.0, 0.0),
        (0.1, 0.33, 0.03),
        (-0.28, 0.2, -0.02),
        (-0.28, -0.2, 0.01),
        (0.1, -0.33, 0.05),
    ]
    return on_base(case, feet(places, 0.6), 60.0, [0.0, 0.0, 0.3])


def leaning_tripod(case: str = "B", lean: float = 0.5) -> MotionTask:
    """Three feet whose normals lean inwards."""
    return on_base(case, feet(_TRIPOD, 0.6, lean), 60.0, [0.0, 0.0, 0.3])


def clamped(case: str = "A") -> MotionTask:
    """Three clamps that press with constant force."""
    clamps: list[Binding] = [
        ForceConstantHalfRigidClamp(position=place, friction_lower=0.3, friction_upper=0.3, clamp_force=150.0)
        for place in map(list, _TRIPOD)
    ]
    return on_base(case, clamps, 15.0, [0.0, 0.0, 0.2])


def casters(case: str = "B") -> MotionTask:
    """Two drive wheels amid four casters."""
    wheels = feet([(0.0, 0.3, 0.0), (0.0, -0.3, 0.0)], 0.6)
    corners = [(0.35, 0.28, 0.0), (0.35, -0.28, 0.0), (-0.35, -0.28, 0.0), (-0.35, 0.28, 0.0)]
    return on_base(case, wheels + feet(corners, 0.0), 80.0, [0.05, 0.0, 0.3])


def retimed(task: MotionTask, tolerance: Uncertainty) -> Trajectory:
    """A path of three points at its fastest within a tolerance."""
    middle = task.start + 0.25 * (task.goal - task.start) + 0.1 * np.sin(np.arange(task.robot.n))
    end = task.start + 0.4 * (task.goal - task.start)
    ends = np.array([0.0, 0.6, 1.0])
    path = JointPath(ends, CubicSpline(ends, np.array([task.start, middle, end])).c)
    return retime(task.robot, path, Limits(tolerance=tolerance)).motion


def new_motions() -> Iterator[tuple[str, Robot, Trajectory, Uncertainty]]:
    """Name, robot, motion and tolerance of each."""
    four = on_base("B", feet(_SQUARE, 0.5), 40.0, [0.03, 0.0, 0.25])
    held = four.robot.arm.with_payload(Payload(0.5, [0.02, 0.0, 0.05], [1e-3, 2e-3, 2.5e-3]))
    loaded = replace(four, robot=four.robot.varied(arm=held))
    yield "four feet, payload", loaded.robot, swing(loaded), CUSTOM
    yield "four feet, site", four.robot, swing(four), replace(SITE, base_push=20.0)
    tall = on_base("G", feet(_SQUARE, 0.8), 50.0, [0.0, 0.0, 0.7])
    tilting = replace(WORKSHOP, center_of_mass=(0.02, 0.02, 0.1), base_push=60.0)
    yield "tall base pushed", tall.robot, swing(tall), tilting
    own = five_uneven()
    yield "five uneven feet", own.robot, swing(own), WORKSHOP
    own = leaning_tripod()
    yield "tripod, leaning normals", own.robot, swing(own), WORKSHOP
    own = clamped()
    points = controller_points(swing(own).with_rise_times(0.02), "linear")
    yield "clamps, linear controller", own.robot, points, replace(WORKSHOP, delay=0.0, damping=None)
    own = casters()
    yield "two wheels and four casters", own.robot, swing(own), CUSTOM
    yield (
        "S-curves, custom",
        four.robot,
        swing(four).with_rise_times(0.05),
        replace(CUSTOM, delay=0.01, damping=0.05),
    )
    yield "retimed path", four.robot, retimed(four, WORKSHOP), WORKSHOP
    six = feet([(0.4 * np.cos(a), 0.4 * np.sin(a), 0.0) for a in np.arange(6) * np.pi / 3], 0.4)
    many = on_base("D", six, 45.0, [0.02, -0.02, 0.2])
    yield (
        "six feet, quintic controller",
        many.robot,
        controller_points(swing(many).with_rise_times(0.05), "quintic"),
        CUSTOM,
    )
