"""Robots, terrains and tasks shared by the tests of the placement."""

from __future__ import annotations

from functools import cache

import casadi as cs
import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import GripperTask, PlacementLimits, PlacementProblem, ProcessLoad, Weights
from ocptip.placement.result import Placement
from ocptip.placement.terrain import custom_terrain, plane
from ocptip.published.arms import load_arm, modular_motors
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.robots.geometry import Pillar, Wall
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.standing.arm import Robot
from studies.placement.for_path import robot_at

INTO_WALL = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # gripper z along the world's x


@cache
def modular_robot(case: str = "A") -> Robot:
    """A published arm on its three contacts."""
    return experiment_robot(motion_case(case), "effective")


@cache
def four_feet(redistribution: str = "full") -> Robot:
    """A modular arm on a cart of 15 kg with four feet."""
    feet = [
        UnilateralContact(position=[x, y, -0.3], friction=0.5, facets=8)
        for x, y in ((0.2, 0.15), (0.2, -0.15), (-0.2, -0.15), (-0.2, 0.15))
    ]
    support = Support(feet, mass=15.0, center_of_mass=[0.02, 0.0, -0.15])
    return Robot(load_arm("FP1W2F"), support, modular_motors(), redistribution=redistribution)


@cache
def tripod(friction: float = 0.7) -> Robot:
    """A modular arm on three feet."""
    feet = [
        UnilateralContact(position=[x, y, -0.3], friction=friction, facets=8)
        for x, y in ((0.2, 0.25), (0.2, -0.25), (-0.3, 0.0))
    ]
    support = Support(feet, mass=15.0, center_of_mass=[0.0, 0.0, -0.15])
    return Robot(load_arm("FP1W2F"), support, modular_motors())


@cache
def on_uneven_ground() -> Robot:
    """A modular arm on three feet whose normals lean towards each other."""
    feet = [
        UnilateralContact(position=[x, y, -0.3], normal=[-0.5 * x, -0.5 * y, 1.0], friction=0.7, facets=8)
        for x, y in ((0.2, 0.25), (0.2, -0.25), (-0.3, 0.0))
    ]
    support = Support(feet, mass=15.0, center_of_mass=[0.0, 0.0, -0.15])
    return Robot(load_arm("FP1W2F"), support, modular_motors())


@cache
def clamped(step: float = 0.0) -> Robot:
    """A modular arm on three contacts, one of them clamped, another one a step (m) higher than the rest."""
    common = {"facets": 8}
    contacts = [
        UnilateralContact(position=[0.2, 0.15, -0.3], friction=0.5, **common),
        UnilateralContact(position=[0.2, -0.15, step - 0.3], friction=0.5, **common),
        ForceConstantHalfRigidClamp(
            position=[-0.2, 0.0, -0.3], friction_upper=0.5, friction_lower=0.4, clamp_force=60.0, **common
        ),
    ]
    support = Support(contacts, mass=8.0, center_of_mass=[0.0, 0.0, -0.15])
    return Robot(load_arm("W1P1P2W2"), support, modular_motors())


def drilling(robot: Robot | None = None, **options: object) -> PlacementProblem:
    """A hole drilled into a wall at x = 0 from a slightly inclined floor."""
    task = GripperTask(
        [0.0, 0.0, 0.55], INTO_WALL, [ProcessLoad([-6.0, 0.0, 1.0], [0.1, 0.0, 0.0], "thrust")]
    )
    settings: dict = {
        "tasks": task,
        "terrain": plane((0.04, -0.02)),
        "limits": PlacementLimits(condition=40.0),
        "keep_out": [Wall(np.array([1.0, 0.0, 0.0]), -0.05, "wall"), Pillar([-0.4, 0.6, 0.0], 0.2)],
        **options,
    }
    return PlacementProblem(robot or four_feet(), **settings)


def planar_arm() -> ArmModel:
    """Two links of length 4.8 and weights 12.4 and 3.6 in the plane of x and z, angles from x towards z."""
    onto_plane = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    none = np.full(2, np.inf)
    return ArmModel(
        name="planar",
        joint_names=("shoulder", "elbow"),
        rotations=np.array([onto_plane, np.eye(3)]),
        offsets=np.array([[4.8, 0, 0], [4.8, 0, 0]]),
        masses=np.array([12.4, 3.6]),
        centres=np.array([[2.4, 0, 0], [2.4, 0, 0]]),
        inertias=np.zeros((2, 3, 3)),
        limits=JointLimits(
            np.deg2rad([20.0, -170.0]), np.deg2rad([160.0, -10.0]), none, none, np.array([35.0, 30.0])
        ),
        mount_position=np.array([0.0, 0.0, 2.0]),
    )


@cache
def planar_problem(force: float = 5.0) -> PlacementProblem:
    """The planar example (4.6) with gravity 1: parameters are the gripper's place relative to the base."""
    feet = [
        UnilateralContact(position=[x, y, 0.0], friction=10.0, facets=4)
        for x in (-2.5, 2.5)
        for y in (-20.0, 20.0)
    ]
    support = Support(feet, mass=30.0, center_of_mass=[0.0, 0.0, 1.0], gravity=[0.0, 0.0, -1.0])
    p = cs.SX.sym("p", 2)
    lift = cs.Function("lift", [p], [cs.vertcat(-p[0], 0, -p[1]), cs.SX.eye(3)])
    return PlacementProblem(
        Robot(planar_arm(), support, modular_motors()),
        GripperTask([0.0, 0.0, 0.0], loads=[ProcessLoad([-force, 0.0, 0.0])], orientation="free"),
        custom_terrain(lift, [-12.0, 2.0], [12.0, 13.0], name="lift"),
        weights=Weights(GN=0.25, GT=0.0, GK=0.0, GE=0.75),
        limits=PlacementLimits(GN=None, GT=None),
        energy=TorqueCost([1.0, 1.2]),
    )


def hills() -> object:
    """Ground that rises and falls with x."""
    p = cs.SX.sym("p", 3)
    slope = 0.1 * cs.cos(2 * p[0])
    length = cs.sqrt(1 + slope**2)
    c, s = cs.cos(p[2]), cs.sin(p[2])
    axes = cs.horzcat(cs.vertcat(1, 0, slope) / length, cs.SX([0, 1, 0]), cs.vertcat(-slope, 0, 1) / length)
    turn = cs.vertcat(cs.horzcat(c, -s, 0), cs.horzcat(s, c, 0), cs.horzcat(0, 0, 1))
    position = cs.vertcat(p[0], p[1], 0.05 * cs.sin(2 * p[0]))
    return custom_terrain(
        cs.Function("hills", [p], [position, axes @ turn]),
        [-1.5, -1.5, -np.inf],
        [1.5, 1.5, np.inf],
        parameters=("x", "y", "angle"),
        angular=(False, False, True),
        constraints=cs.Function("ditch", [p], [(p[0] + 0.1) ** 2 + p[1] ** 2 - 0.01]),
        constraint_names=("ditch",),
        name="hills",
    )


def random_task(seed: int) -> PlacementProblem:
    """A random pose and force for a modular arm on a plane of random slope."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
    down = Rotation.from_euler("y", rng.uniform(np.pi / 2, np.pi))
    force = rng.normal(size=3)
    force *= rng.uniform(2, 8) / np.linalg.norm(force)
    task = GripperTask(
        [0.0, 0.0, rng.uniform(0.2, 0.5)], (turn * down).as_matrix(), [ProcessLoad(force)], name="random"
    )
    slope = rng.uniform(-0.06, 0.06, 2)
    robot = modular_robot("AH"[seed % 2])
    return PlacementProblem(robot, task, plane(slope), limits=PlacementLimits(condition=40.0))


def placed_robot(placement: Placement) -> Robot:
    """The robot at its place."""
    return robot_at(placement.problem, placement.patch, placement.parameters)
