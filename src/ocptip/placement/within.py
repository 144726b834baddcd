"""Whether a robot at rest keeps its contacts in the worst case of an uncertainty, arm and payload
included.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.kinematics import link_frames
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.slope import Weight
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.moving import MovingCase, driving_case_of
from ocptip.standing.within.rest import (
    CaseWithin,
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
    return _within(cases, tolerance.of(placement.problem.robot.payload))


def posture_within(
    robot: Robot, q: np.ndarray, tolerance: Uncertainty, base_motion: BaseMotion | None = None
) -> WithinAtRest:
    """The worst of a robot at rest in a posture; what the gripper's process does then is nominal.

    Args:
        robot: on its support, as it rests.
        q: (n,), rad (sliding joints: m).
        tolerance: of floor, base, arm and payload; what needs motion of the arm is left out, and reported.
        base_motion: of a base that drives, at one instant.
    """
    of_payload = tolerance.of(robot.payload)
    return _within([posture_case(robot, q, of_payload, base_motion)], of_payload)


def posture_case(
    robot: Robot, q: np.ndarray, tolerance: Uncertainty, base_motion: BaseMotion | None = None
) -> Callable[[Uncertainty], CaseWithin]:
    """A robot in a posture, by parts of an uncertainty; arguments are those of `posture_within`."""
    if base_motion is not None:
        counting = tolerance.only(*(name for name in AT_REST if name in tolerance.given))
        return partial(MovingCase, driving_case_of(robot, counting), q, base_motion)
    still, support, gravity = np.zeros((1, robot.n)), robot.support, robot.support.gravity
    wrench = robot.loads(q[None], still, still)[1][0]

    def case(some: Uncertainty) -> RestCase:
        weights, tool = bodies(robot, q, some)
        carried = sum(w.mass * np.concatenate([gravity, np.cross(w.center, gravity)]) for w in weights)
        pushes = [Push("gripper", some.push, tool)] if some.push else []
        weights, pushes = [base_weight(support, some), *weights], [*pushes, *base_pushes(some)]
        fixed, moment = wrench - support.weight - carried, robot.tip_over.reference_moment
        return RestCase(support, weights, fixed, some, pushes, moment)

    return case


def _within(cases: Sequence[Callable[[Uncertainty], CaseWithin]], tolerance: Uncertainty) -> WithinAtRest:
    """The worst of cases within the part of an uncertainty that counts at rest."""
    return found_within(cases, tolerance, AT_REST)


def rest_case(placement: Placement, case: TaskLoad, tolerance: Uncertainty) -> RestCase:
    """The robot at a placement in one pose under one load."""
    problem = placement.problem
    robot, back = problem.robot, placement.base_rotation.T
    placed = problem.stands[placement.patch].footing(placement.parameters).support.contacts
    contacts = [
        replace(c, position=at.position, normal=at.normal, tangent=at.tangent)
        for c, at in zip(robot.support.contacts, placed, strict=True)
    ]
    support = robot.support.varied(contacts, gravity=back @ np.asarray(problem.gravity, dtype=float))
    weights, tool = bodies(robot, placement.angles[case.task], tolerance)
    force, moment = back @ case.force, back @ case.moment
    fixed = np.concatenate([force, moment + np.cross(tool, force)])
    pushes = [Push("gripper", tolerance.push, tool)] if tolerance.push else []
    pushes += base_pushes(tolerance)
    weights = [base_weight(support, tolerance), *weights]
    reference = robot.tip_over.reference_moment
    return RestCase(support, weights, fixed, tolerance, pushes, reference, case.name)


def bodies(robot: Robot, q: np.ndarray, tolerance: Uncertainty) -> tuple[list[Weight], np.ndarray]:
    """Links, payload and what may be at the gripper, at angles (n,); and the TCP (3,), m.

    Places are from the base's centre of mass, base axes.
    """
    bare, held, about = robot.arm.with_payload(None), robot.arm.payload, robot.support.center_of_mass
    frames = link_frames(bare, q)
    tool = frames.origins[-1] - about
    found = []
    links = zip(bare.masses, bare.centres, frames.rotations, frames.origins, strict=False)
    for number, (mass, centre, rotation, origin) in enumerate(links, 1):
        if mass > 0:
            off = tolerance.arm_mass * mass
            found.append(Weight(f"link {number}", float(mass), origin + rotation @ centre - about, -off, off))
    if held is not None:
        rotation, off = frames.rotations[-1], tolerance.payload_mass * held.mass
        half = np.abs(rotation) @ np.asarray(tolerance.payload_center, dtype=float)
        centre = tool + rotation @ held.center_of_mass
        found.append(Weight("payload", held.mass, centre, -off, off, half))
    if tolerance.extra_mass:
        found.append(Weight("mass at the gripper", 0.0, tool, 0.0, tolerance.extra_mass))
    return found, tool
