"""An arm on a base that only stands: everything that happens while it moves, at any instant.

Here `robots` and `contact` meet: the arm's base wrench plus the base's weight is the wrench under which
the support has to stand.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

import numpy as np

from ocptip.contact import (
    ContactStates,
    ForceConstantHalfRigidClamp,
    Support,
    UnilateralContact,
    solve_many,
)
from ocptip.errors import InputError, positive_number
from ocptip.motion.cases import MotionCase
from ocptip.motion.sampled import Motion
from ocptip.reserves import Slip, SlipReserve, TipOver, TipOverReserve
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
    load_arm,
)

BASES = ("printed", "effective")
_FACETS = 12


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """What happens at N instants of a motion.

    Attributes:
        times: (N,), s.
        angles, speeds, accelerations: (N, n), rad, rad/s, rad/s^2.
        torques: (N, n), N m, joint torques.
        powers: (N, n), W, electric power of the joints.
        wrenches: (N, 6), N and N m: on the base about its centre of mass, its weight included.
        states: contact states under these wrenches.
        tip, slip: reserves GN and GT of these states.
        clearances: (N,), m, smallest distance of collision spheres; infinite without any.
    """

    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray
    torques: np.ndarray
    powers: np.ndarray
    wrenches: np.ndarray
    states: ContactStates
    tip: TipOverReserve
    slip: SlipReserve
    clearances: np.ndarray


class StandingRobot:
    """An arm mounted on a base that stands on a support.

    Args:
        arm: its mount (`mount_position`, `mount_rotation`) in the base axes of the support.
        support: the base with its contacts; its mass and centre of mass without the arm.
        motors: drives of the joints.
        obstacles: floor, walls, pillars in base axes, against which the arm's spheres are checked.
        reference_moment: M0 of the tip-over reserve, N m; default: a tenth of the best moment reserve of the
            base loaded with the weight of base and arm.
        redistribution: of the slip reserve, see `ocptip.reserves.Slip`; default "tangential" for up to three
            contacts and "full" for more, where the normal forces are one choice of many and only the best
            choice is a property of the load.

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
        self.arm, self.support, self.motors = arm, support, motors
        self._obstacles, self._made_with = tuple(obstacles), (reference_moment, redistribution)
        self.collision = CollisionModel(arm, obstacles)
        if reference_moment is None:
            own = TipOver(support).reference_moment
            reference_moment = None if own is None else own * self.mass / support.mass
        else:
            reference_moment = positive_number("reference_moment", reference_moment)
        self.tip_over = TipOver(support, reference_moment)
        self.slip = Slip(support, redistribution or ("tangential" if support.n_contacts <= 3 else "full"))

    @property
    def mass(self) -> float:
        """Mass of base and arm, kg."""
        return self.support.mass + float(np.sum(self.arm.masses))

    def samples(
        self, motion: Motion, times: np.ndarray, *, side: Literal["left", "right"] = "right"
    ) -> MotionSamples:
        """Everything that happens at the given instants ((N,), s) of a motion.

        Args:
            motion: of as many joints as the arm has.
            times: s.
            side: where accelerations jump, the limit from this side.

        Raises:
            InputError: the motion has another number of joints.
        """
        times = np.asarray(times, dtype=float)
        q, qd, qdd = motion.states(times, side=side)
        if q.shape[-1] != self.arm.n:
            raise InputError(f"motion: has {q.shape[-1]} joints, the arm has {self.arm.n}")
        torques, wrenches = self.loads(q, qd, qdd)
        states = self.contact_states(wrenches)
        gaps = self.collision.gaps(q)
        return MotionSamples(
            times=times,
            angles=q,
            speeds=qd,
            accelerations=qdd,
            torques=torques,
            powers=self.motors.power(torques, qd),
            wrenches=wrenches,
            states=states,
            tip=self.tip_over.evaluate(states),
            slip=self.slip.evaluate(states, derivatives=False),
            clearances=np.min(gaps, axis=1, initial=np.inf),
        )

    def loads(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Joint torques (N, n), N m, and the total wrench (N, 6) on the base about its centre of mass."""
        support = self.support
        dynamics = evaluate_dynamics(
            self.arm, q, qd, qdd, gravity=support.gravity, about=support.center_of_mass
        )
        return dynamics.torque, dynamics.wrench + support.weight

    def contact_states(self, wrenches: np.ndarray) -> ContactStates:
        """States of the contacts under total wrenches (N, 6) on the base."""
        return solve_many(self.support, wrenches)

    def __reduce__(self) -> tuple:
        """Pickle by what it was made of: CasADi's functions are built anew on the other side."""
        return _restored, (self.arm, self.support, self.motors, self._obstacles, self._made_with)

    def energy(self, motion: Motion, *, order: int = 4) -> float:
        """Electric energy of a motion, J: Gauss-Legendre quadrature between the events (5.25)."""
        times, weights = motion.quadrature(order)
        if len(times) == 0:
            return 0.0
        q, qd, qdd = motion.states(times)
        torques, _ = self.loads(q, qd, qdd)
        return float(weights @ np.sum(self.motors.power(torques, qd), axis=1))


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
