"""An arm at rest in a posture, within an uncertainty of floor, base, arm, payload and pushes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ocptip.contact.support import Support
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.kinematics import link_frames
from ocptip.robots.payload import Payload
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
    return found_within([posture_case(robot, q, of_payload, base_motion)], of_payload, AT_REST)


def posture_case(
    robot: Robot, q: np.ndarray, tolerance: Uncertainty, base_motion: BaseMotion | None = None
) -> Callable[[Uncertainty], CaseWithin]:
    """A robot in a posture, by parts of an uncertainty; arguments are those of `posture_within`."""
    if base_motion is not None:
        counting = tolerance.only(*(name for name in AT_REST if name in tolerance.given))
        return partial(MovingCase, driving_case_of(robot, counting), q, base_motion)
    still, support = np.zeros((1, robot.n)), robot.support
    wrench = robot.loads(q[None], still, still)[1][0]
    return partial(loaded_case, robot, support, support.gravity, q, robot.payload, wrench)


def loaded_case(
    robot: Robot,
    support: Support,
    gravity: np.ndarray,
    q: np.ndarray,
    held: Payload | None,
    wrench: np.ndarray,
    tolerance: Uncertainty,
) -> RestCase:
    """A robot in a posture under its whole nominal wrench, which may have more in it than its weight.

    Args:
        robot: whose arm it is.
        support: its base.
        gravity: (3,), m/s^2, that acts.
        q: (n,), rad (sliding joints: m).
        held: the payload.
        wrench: (6,), N and N m about the centre of mass of the base.
        tolerance: what is off.
    """
    weights, tool = bodies(robot, q, tolerance, held)
    carried = sum(w.mass * np.concatenate([gravity, np.cross(w.center, gravity)]) for w in weights)
    pushes = [Push("gripper", tolerance.push, tool)] if tolerance.push else []
    weights, pushes = [base_weight(support, tolerance), *weights], [*pushes, *base_pushes(tolerance)]
    own = support.mass * np.concatenate([gravity, np.zeros(3)])
    moment = robot.tip_over.reference_moment
    return RestCase(support, weights, wrench - own - carried, tolerance, pushes, moment, gravity=gravity)


def bodies(
    robot: Robot, q: np.ndarray, tolerance: Uncertainty, held: Payload | None
) -> tuple[list[Weight], np.ndarray]:
    """Links, a payload and what may be at the TCP, at angles (n,); and the TCP (3,), m.

    Places are from the base's centre of mass, base axes.
    """
    bare, about = robot.arm.with_payload(None), robot.support.center_of_mass
    frames = link_frames(robot.arm, q)  # made once per arm
    tool = frames.origins[-1] - about
    results = []
    links = zip(bare.masses, bare.centres, frames.rotations, frames.origins, strict=False)
    for number, (mass, centre, rotation, origin) in enumerate(links, 1):
        if mass > 0:
            off = tolerance.arm_mass * mass
            results.append(
                Weight(
                    f"link {number}", float(mass), origin + rotation @ centre - about, -off, off, link=number
                )
            )
    if held is not None:
        rotation, off = frames.rotations[-1], tolerance.payload_mass * held.mass
        half = np.abs(rotation) @ np.asarray(tolerance.payload_center, dtype=float)
        centre = tool + rotation @ held.center_of_mass
        results.append(Weight("payload", held.mass, centre, -off, off, half))
    if tolerance.extra_mass:
        results.append(Weight("mass at the TCP", 0.0, tool, 0.0, tolerance.extra_mass))
    return results, tool
