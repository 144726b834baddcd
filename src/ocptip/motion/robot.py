"""An arm on a base that only stands, and the arm of the printed experiments on its base."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files

import casadi as cs
import numpy as np

from ocptip.contact import ForceConstantHalfRigidClamp, Support, UnilateralContact
from ocptip.errors import InputError
from ocptip.motion.cases import MotionCase
from ocptip.motion.standing import MotionSamples, StandingMechanism
from ocptip.reserves.slip import Redistribution
from ocptip.robots import (
    ArmModel,
    CollisionModel,
    Motors,
    Pillar,
    PowerMaps,
    Wall,
    evaluate_dynamics,
    floor,
    inverse_dynamics,
    load_arm,
)

__all__ = ["BASES", "MotionSamples", "StandingRobot", "experiment_robot"]

BASES = ("printed", "effective")
_FACETS = 12


class StandingRobot(StandingMechanism):
    """An arm mounted on a base that stands on a support.

    Args:
        arm: its mount (`mount_position`, `mount_rotation`) in the base axes of the support.
        support: the base with its contacts; its mass and centre of mass without the arm.
        motors: drives of the joints.
        obstacles: floor, walls, pillars in base axes, against which the arm's spheres are checked.
        reference_moment, redistribution: see `StandingMechanism`.

    Attributes:
        arm, obstacles: as given.

    Raises:
        InputError: a planar support, or no gravity and no reference moment.
    """

    def __init__(
        self,
        arm: ArmModel,
        support: Support,
        motors: Motors,
        *,
        obstacles: Sequence[Wall | Pillar] = (),
        reference_moment: float | None = None,
        redistribution: Redistribution | None = None,
    ) -> None:
        if support.dimension != 3:
            raise InputError("support: an arm needs a spatial support, got a planar one")
        self.arm = arm
        self.obstacles, self._made_with = tuple(obstacles), (reference_moment, redistribution)
        super().__init__(
            support,
            motors,
            arm.limits,
            CollisionModel(arm, obstacles),
            float(np.sum(arm.masses)),
            reference_moment,
            redistribution,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(self.arm.joint_names)

    def loads(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Joint torques (N, n), N m, and the total wrench (N, 6) on the base about its centre of mass."""
        support = self.support
        dynamics = evaluate_dynamics(
            self.arm, q, qd, qdd, gravity=support.gravity, about=support.center_of_mass
        )
        return dynamics.torque, dynamics.wrench + support.weight

    def load_expressions(self, q: cs.SX, qd: cs.SX, qdd: cs.SX) -> tuple[cs.SX, cs.SX]:
        """The same as CasADi columns."""
        support = self.support
        torque, wrench = inverse_dynamics(self.arm)(
            q, qd, qdd, support.gravity, [0, 0, 0], [0, 0, 0], support.center_of_mass
        )
        return torque, wrench + support.weight

    def with_motors(self, motors: Motors) -> StandingRobot:
        """The same robot with other drives."""
        return _restored(self.arm, self.support, motors, self.obstacles, self._made_with)

    def __reduce__(self) -> tuple:
        """Pickle by what it was made of: CasADi's functions are built anew on the other side."""
        return _restored, (self.arm, self.support, self.motors, self.obstacles, self._made_with)


def experiment_robot(case: MotionCase, base: str = "printed", *, facets: int = _FACETS) -> StandingRobot:
    """The modular arm of a case on its base (6.14 to 6.17), base axes with the origin in Q_1.

    Args:
        case: one of the eight cases.
        base: "printed" (6.582 kg, contacts 140 mm below Q_1) or "effective" (3.45 kg, 298 mm, fitted so that
            the printed motions come close to the limits as the source reports).
        facets: of the friction pyramids.

    Raises:
        InputError: there is no such base.
    """
    data = json.loads(files("ocptip.motion").joinpath("data/base.json").read_text(encoding="utf-8"))
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
            contacts.append(
                ForceConstantHalfRigidClamp(
                    friction_upper=clamp["mu_o"],
                    friction_lower=clamp["mu_u"],
                    clamp_force=clamp["F_N"],
                    **place,
                )
            )
        else:
            contacts.append(UnilateralContact(friction=data["mu0"], **place))
    support = Support(
        contacts,
        mass=variant["mass_kg"],
        center_of_mass=[com["x0"] / 1000 + com["x_per_l"] * side, com["y"] / 1000, com["z"] / 1000],
        gravity=[0.0, 0.0, -data["gravity_m_s2"]],
    )
    ground = (
        -data["variants"]["printed"]["contact_plane_below_Q1_mm"] / 1000
    )  # d_W is the same in both variants
    return StandingRobot(load_arm(case.arm), support, PowerMaps.modular(), obstacles=[floor(ground)])


def _restored(
    arm: ArmModel,
    support: Support,
    motors: Motors,
    obstacles: tuple[Wall | Pillar, ...],
    made_with: tuple[float | None, Redistribution | None],
) -> StandingRobot:
    return StandingRobot(
        arm, support, motors, obstacles=obstacles, reference_moment=made_with[0], redistribution=made_with[1]
    )
