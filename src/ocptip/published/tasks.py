"""The tasks of the eight published cases: the modular arm on its base, start, goal and printed solution."""

from __future__ import annotations

from functools import lru_cache

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.files.source import TaskSource
from ocptip.motion.task import MotionTask
from ocptip.published.arms import load_arm, modular_motors, published_data
from ocptip.published.cases import MotionCase, motion_case
from ocptip.robots.geometry import floor
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits

BASES = ("printed", "effective")
JOINTS = (0, 1, 2)  # with three commands each; the others follow in one ramp


PRINTED_LIMITS = Limits(clearance=0.0)
"""Thesis M asks for no collision, (4.29) to (4.32), and for no distance beyond that."""

ADAPTER_MASS = published_data("base")["KMS_adapter_mass_g"] / 1000
"""kg: of the adapter between the force-torque sensor and the first module (6.13)."""

_FACETS = 12


@lru_cache(maxsize=32)  # what is built for a robot, above all its collision model, serves all tasks with it
def experiment_robot(case: MotionCase, base: str = "printed", *, facets: int = _FACETS) -> Robot:
    """The modular arm of a case on its base (6.14 to 6.17), base axes with the origin in Q_1.

    Args:
        case: one of the eight cases.
        base: "printed" (6.582 kg, contacts 140 mm below Q_1) or "effective" (3.45 kg, 298 mm, fitted so that
            the printed motions come close to the limits as thesis M reports).
        facets: of the friction pyramids.

    Raises:
        InputError: there is no such base.
    """
    data = published_data("base")
    if base not in BASES:
        raise InputError(f"base: there is no {base!r}; there are {', '.join(BASES)}")
    variant = data["variants"][base]
    side = case.triangle_side
    height = variant["contact_plane_below_Q1_mm"] / 1000
    com = data["r_Q1B_mm"]
    contacts = []
    for name, (x, y) in data["triangle"]["K_xy_over_l"].items():
        place = {"position": [x * side, y * side, -height], "facets": facets}
        if name == "K3" and case.clamped:
            clamp = data["clamp_K3"]
            friction = {"friction_upper": clamp["mu_o"], "friction_lower": clamp["mu_u"]}
            contacts.append(ForceConstantHalfRigidClamp(**friction, clamp_force=clamp["F_N"], **place))
        else:
            contacts.append(UnilateralContact(friction=data["mu0"], **place))
    support = Support(
        contacts,
        mass=variant["mass_kg"],
        center_of_mass=[com["x0"] / 1000 + com["x_per_l"] * side, com["y"] / 1000, com["z"] / 1000],
        gravity=[0.0, 0.0, -data["gravity_m_s2"]],
    )
    # d_W is the same in both variants
    ground = -data["variants"]["printed"]["contact_plane_below_Q1_mm"] / 1000
    return Robot(load_arm(case.arm), support, modular_motors(), obstacles=[floor(ground)])


def experiment_task(name: str, base: str = "effective", limits: Limits | None = None) -> MotionTask:
    """The task of a printed case, with its printed solution as reference.

    Args:
        name: "A" to "H".
        base: "printed" or "effective", see `experiment_robot`.
        limits: default `PRINTED_LIMITS`: 0.9 for GN and GT, the arm's torques, no collision.

    Raises:
        InputError: there is no such case or base.
    """
    case = motion_case(name)
    robot = experiment_robot(case, base)
    reference = case.reference_motion(robot.limits.speed, robot.limits.acceleration)
    source = TaskSource({"case": name, "base": base}, robot)
    limits = limits or PRINTED_LIMITS
    return MotionTask(name, robot, case.start, case.goal, limits, JOINTS, reference=reference, source=source)
