"""Results of `place` on the planar example, shared by the tests of files, figures and command line."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from ocptip.placement.place import place
from ocptip.placement.problem import PlacementLimits
from ocptip.placement.result import NoPlacementError, PlacementResult
from studies.placement.planar import planar_problem

ROBOT = """
[base]
mass = 10.0
center_of_mass = [0.0, 0.0, 0.1]

[[contact]]
kind = "unilateral"
position = [0.2, 0.2, 0.0]
friction = 0.5

[[contact]]
kind = "unilateral"
position = [0.2, -0.2, 0.0]
friction = 0.5

[[contact]]
kind = "unilateral"
position = [-0.2, 0.0, 0.0]
friction = 0.5

[arm]
name = "FP1W2F"
mount_position = [0.0, 0.0, 0.3]
"""

TASK = (
    ROBOT
    + """
[[task]]
name = "press"
position = [0.1, 0.0, 0.5]
rpy_deg = [180, 0, 0]

[[task.load]]
force = [0.0, 0.0, 10.0]
"""
)


@cache
def found() -> PlacementResult:
    """The planar example solved."""
    return place(planar_problem(), starts=2, samples=200)


@cache
def refused() -> NoPlacementError:
    """The planar example with joints that can hardly hold anything."""
    problem = replace(planar_problem(), limits=PlacementLimits(GT=None, torque_ratio=0.01))
    try:
        place(problem, starts=1, samples=100)
    except NoPlacementError as error:
        return error
    raise AssertionError("the joints of the example hold with 1 % of their torque")
