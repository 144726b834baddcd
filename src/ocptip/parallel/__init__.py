"""Parallel robots: from a table of the legs to inverse dynamics, its parts and generated code.

A robot in a few lines::

    from ocptip.parallel import ParallelRobot, delta

    robot = ParallelRobot(delta())
    print(robot.mobility().dof, robot.inverse_dynamics([0, 0, -0.45], [1, 0, 0], [0, 0, 5]).motors)
"""

from ocptip.parallel.analysis.crossings import Crossing, crossings
from ocptip.parallel.analysis.mobility import Mobility, mobility
from ocptip.parallel.analysis.singularity import ImplicitPair, Singularity
from ocptip.parallel.base_wrench import MountedRobot, MountedSamples, PlatformMotion, base_wrench, moving_mass
from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.counting import OperationCount, count_operations
from ocptip.parallel.code.lean import LeanFunction, lean_function
from ocptip.parallel.description.branched import BranchedLeg, LegEnd
from ocptip.parallel.description.ready_made import (
    KINDS,
    READY_MADE,
    delta,
    make_robot,
    prrr4,
    rpr3,
    rrr3,
    ups6,
)
from ocptip.parallel.description.robot_description import (
    BodyInertia,
    Leg,
    MDHRow,
    Parameter,
    Platform,
    RobotDescription,
)
from ocptip.parallel.dynamics.actuation import MotorForces, limited_motor_forces, motor_forces
from ocptip.parallel.dynamics.base_parameters import numeric_base_parameters
from ocptip.parallel.dynamics.sensitivities import ForceSensitivities, Sensitivities
from ocptip.parallel.dynamics.terms import Terms
from ocptip.parallel.formats.export import to_mjcf, to_urdf, urdf_cuts, urdf_home
from ocptip.parallel.formats.urdf import UrdfRobot, convert_parallel_urdf, read_parallel_urdf
from ocptip.parallel.formats.urdf_legs import Cut
from ocptip.parallel.kinematics.platform import JointPositions, Kinematics, PlatformPose
from ocptip.parallel.robot import Forces, JointRates, ParallelRobot
from ocptip.parallel.simulation import Trajectory, simulate

__all__ = [
    "KINDS",
    "READY_MADE",
    "BodyInertia",
    "BranchedLeg",
    "Crossing",
    "Cut",
    "ForceSensitivities",
    "Forces",
    "ImplicitPair",
    "JointPositions",
    "JointRates",
    "Kinematics",
    "LeanFunction",
    "Leg",
    "LegEnd",
    "MDHRow",
    "Mobility",
    "MotorForces",
    "MountedRobot",
    "MountedSamples",
    "OperationCount",
    "ParallelRobot",
    "Parameter",
    "Platform",
    "PlatformMotion",
    "PlatformPose",
    "RobotDescription",
    "Sensitivities",
    "Singularity",
    "Terms",
    "Trajectory",
    "UrdfRobot",
    "base_wrench",
    "convert_parallel_urdf",
    "count_operations",
    "crossings",
    "delta",
    "lean_function",
    "limited_motor_forces",
    "make_robot",
    "mobility",
    "motor_forces",
    "moving_mass",
    "numeric_base_parameters",
    "prrr4",
    "read_parallel_urdf",
    "rpr3",
    "rrr3",
    "simulate",
    "to_mjcf",
    "to_urdf",
    "ups6",
    "urdf_cuts",
    "urdf_home",
    "write_c",
]
