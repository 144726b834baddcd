"""Parallel robots: from a table of the legs to inverse dynamics, its parts and generated code.

A robot in a few lines::

    from ocptip.parallel import ParallelRobot, delta

    robot = ParallelRobot(delta())
    print(robot.mobility().dof, robot.inverse_dynamics([0, 0, -0.45], [1, 0, 0], [0, 0, 5]).motors)

Equation numbers such as (3.42) are those of thesis P (docs/bibliography.md).
"""

from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.description.branched import BranchedLeg
from ocptip.parallel.description.ready_made import delta, make_robot, rrr3
from ocptip.parallel.dynamics.terms import limited_motor_forces, motor_forces
from ocptip.parallel.export import to_urdf
from ocptip.parallel.mjcf import to_mjcf
from ocptip.parallel.robot import ParallelRobot, base_wrench
from ocptip.parallel.simulation import simulate

__all__ = [
    "BranchedLeg",
    "ParallelRobot",
    "base_wrench",
    "delta",
    "lean_function",
    "limited_motor_forces",
    "make_robot",
    "motor_forces",
    "rrr3",
    "simulate",
    "to_mjcf",
    "to_urdf",
    "write_c",
]
