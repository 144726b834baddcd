"""Whether a robot at rest keeps its contacts in the worst case of an uncertainty, arm and payload
included.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.posture import bodies
from ocptip.standing.within.rest import (
    Push,
    RestCase,
    WithinAtRest,
    base_pushes,
    base_weight,
    found_within,
)
from ocptip.standing.within.tolerable import AT_REST

if TYPE_CHECKING:  # what commands on motions need of this loads no placements
    from ocptip.placement.problem import TaskLoad
    from ocptip.placement.result import Placement

SEARCHED = ("base_mass", "center_of_mass", "friction")
"""Quantities that the search for placements includes."""


def searched(tolerance: Uncertainty) -> Uncertainty:
    """The part that the search includes."""
    return tolerance.only(*(name for name in SEARCHED if name in tolerance.given))


def placement_within(placement: Placement, tolerance: Uncertainty) -> WithinAtRest:
    """The worst of all poses and load cases that count in the constraints; process loads are nominal.

    Args:
        placement: checked.
        tolerance: of floor, base, arm and payload; what needs motion is left out, with a remark.
    """
    cases = [partial(rest_case, placement, case) for case in placement.problem.cases if case.constrained]
    return found_within(cases, tolerance.of(placement.problem.robot.payload), AT_REST)


def rest_case(placement: Placement, case: TaskLoad, tolerance: Uncertainty) -> RestCase:
    """The robot at a placement in one pose under one load."""
    problem = placement.problem
    robot, back = problem.robot, placement.base_rotation.T
    placed = problem.stands[placement.patch].footing(placement.parameters).support.contacts
    contacts = [
        replace(c, position=position.position, normal=position.normal, tangent=position.tangent)
        for c, position in zip(robot.support.contacts, placed, strict=True)
    ]
    support = robot.support.varied(contacts, gravity=back @ np.asarray(problem.gravity, dtype=float))
    weights, tool = bodies(robot, placement.angles[case.task], tolerance, robot.payload)
    force, moment = back @ case.force, back @ case.moment
    fixed = np.concatenate([force, moment + np.cross(tool, force)])
    pushes = [Push("gripper", tolerance.push, tool)] if tolerance.push else []
    pushes += base_pushes(tolerance)
    weights = [base_weight(support, tolerance), *weights]
    reference = robot.tip_over.reference_moment
    return RestCase(support, weights, fixed, tolerance, pushes, reference, case.name)
