"""A robot at rest while posture, payload, friction, floor, push and acceleration of its base change.

Wrenches and torques at rest are linear in gravity, payload and push. Their parts are computed once per
posture, so that an answer takes milliseconds. An acceleration of the base without turning acts like gravity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.frozen import settle
from ocptip.basics.text import percent, quantity
from ocptip.contact.verdict import StabilityVerdict, stability
from ocptip.reserves.equal_compliance import reported_slip
from ocptip.reserves.slip import SlipReserve
from ocptip.reserves.tipping import moment_at
from ocptip.robots.inverse.pose_search import Orientation, search
from ocptip.robots.kinematics import gripper_batch
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.alike_friction import AlikeFriction
from ocptip.standing.at_rest.directions import pushes, slopes, tilted
from ocptip.standing.at_rest.load_cases import RestLoads
from ocptip.standing.at_rest.loss_search import Deviation, LossSearch
from ocptip.standing.at_rest.refusals import own_refusals
from ocptip.standing.at_rest.slope import MOST_TILT
from ocptip.standing.footing import Footing
from ocptip.standing.instants import Instants, Loaded
from ocptip.standing.limits import Limits
from ocptip.standing.margins import Margins
from ocptip.standing.tolerance import with_friction
from ocptip.standing.within.posture import loaded_case
from ocptip.standing.within.tolerable import AT_REST

_REACHED = 1e-4  # m and rad
_STEP = 0.05  # m, of a TCP that moves
_FULL = 6  # joints from which on an arm keeps the orientation of its TCP
_MOST_PUSH = 2.0  # weights of the robot
_SUPPORTS = 32  # with other frictions, of which tip-over and slip are kept


@dataclass(frozen=True, eq=False)
class Conditions:
    """A posture at rest and what acts there.

    Attributes:
        q: (n,), rad (sliding joints: m).
        payload: kg in all, with the centre of mass of the task's payload; without one a point at the TCP.
        friction: factor on the friction of all contacts.
        tilt, downhill: rad, of the floor, and the direction downhill from x to y of the base.
        push, towards: N, horizontal at the TCP, and its direction, rad, likewise.
        acceleration: (2,), m/s^2, of the base along its axes x and y.
    """

    q: np.ndarray
    payload: float = 0.0
    friction: float = 1.0
    tilt: float = 0.0
    downhill: float = 0.0
    push: float = 0.0
    towards: float = 0.0
    acceleration: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Raise InputError for numbers that no condition has."""
        settle(self, q=np.array(self.q, dtype=float))
        numbers = (*self.q, *(v for k, v in vars(self).items() if k not in ("q", "acceleration")))
        if not np.all(np.isfinite([*numbers, *self.acceleration])):
            raise InputError("conditions: all numbers must be finite")
        for name in ("payload", "friction", "push"):
            if getattr(self, name) < 0:
                raise InputError(f"{name}: must not be negative, got {getattr(self, name):g}")


@dataclass(frozen=True, eq=False, repr=False)
class PostureAnswer:
    """A posture under conditions.

    Attributes:
        conditions: that were asked about.
        loaded: the contacts under their load.
        margins: of the contacts.
        slip: forces of the contacts, as reports show them.
        torque_used: share of the torque limit of each joint, (n,).
        broken: why the arm itself cannot be there: angles, collisions, torques.
    """

    conditions: Conditions
    loaded: Loaded
    margins: Margins
    slip: SlipReserve
    torque_used: np.ndarray
    broken: tuple[str, ...]

    @property
    def stable(self) -> bool:
        """Forces within the friction cones keep all contacts, with a margin; see `verdict`."""
        margins = self.margins
        return bool(margins.stable) and float(margins.GN) < 1 and float(margins.GT) < 1

    @cached_property
    def verdict(self) -> StabilityVerdict:
        """Whether every solution of the contact laws keeps them; takes longer than the margins."""
        return stability(self.loaded.footing.support, self.loaded.wrenches[0])

    @property
    def headline(self) -> str:
        """The verdict in a few words."""
        if not self.stable:
            losses = [
                word for word, does in (("TIPS", self.margins.tips), ("SLIDES", self.margins.slips)) if does
            ]
            return " and ".join(losses) or "NOT STABLE"
        return "STABLE, but the arm cannot be there" if self.broken else "STABLE"

    @property
    def forces(self) -> np.ndarray:
        """(n,) normal forces, N; of rigid feet with several solutions those of equal compliance."""
        shared = self.slip.normal_forces[0]
        return shared if np.all(np.isfinite(shared)) else self.margins.normal_forces

    @property
    def lines(self) -> list[tuple[str, str]]:
        """Names and values of the margins."""
        margins, (first, second) = self.margins, self.margins.tipping_contacts
        about = f" about contacts {first} and {second}" if first else ""
        joint = int(np.argmax(self.torque_used))
        return [
            ("tipping margin", f"{quantity(float(margins.tipping_moment), 'N m', 3)}{about}"),
            ("friction used", percent(float(margins.GT))),
            ("minimum foot force", quantity(float(self.forces.min()), "N", 3)),
            ("torque used", f"{percent(float(self.torque_used[joint]))} of joint {joint + 1}"),
        ]

    def __repr__(self) -> str:
        """Verdict and margins."""
        return f"{self.headline}: " + ", ".join(f"{name} {value}" for name, value in self.lines)


@dataclass(frozen=True)
class Robustness:
    """The largest deviations beyond the conditions that lose no contact, each alone, at rest.

    Attributes:
        payload: kg in all, with which no contact is lost.
        held: kg in all, which the drives hold.
        tilt: rad, further tilt of the floor in any direction.
        push: N, further push at the TCP in any direction.
        friction: factor on the present friction that is just enough; NaN where it is not known.
    """

    payload: float
    held: float
    tilt: float
    push: float
    friction: float

    def __str__(self) -> str:
        lost = "until a contact is lost, each alone (the payload of ocptip stand keeps limits: less)"
        return "\n".join([lost, *(f"{name}: {value}" for name, value in self.lines)])

    @property
    def lines(self) -> list[tuple[str, str]]:
        """Names and values."""
        held = "any" if np.isinf(self.held) else f"<= {quantity(self.held, 'kg', 3)} in total"
        return [
            ("payload, contacts", f"<= {quantity(self.payload, 'kg', 3)} in total"),
            ("payload, drives", held),
            ("further tilt", f"{np.degrees(self.tilt):.3g} deg in any direction"),
            ("further push", f"{quantity(self.push, 'N', 3)} in any direction"),
            ("friction", f">= {percent(self.friction)} of the present"),
        ]


@dataclass(frozen=True)
class WorstPosture:
    """The worst of a posture within an uncertainty.

    Attributes:
        tipping_moment: N m, the minimum moment about a tipping axis; negative where the base tips.
        GT: of the friction used.
        tips_with, slips_with: what is off there, in words.
    """

    tipping_moment: float
    GT: float
    tips_with: str
    slips_with: str

    @property
    def stable(self) -> bool:
        """No contact is lost."""
        return self.tipping_moment > 0 and self.GT < 1

    @property
    def lines(self) -> list[tuple[str, str]]:
        """Names and values."""
        return [
            ("tipping margin", quantity(self.tipping_moment, "N m", 3)),
            ("friction used", percent(self.GT)),
        ]

    @property
    def words(self) -> str:
        """What is off where the tipping margin is smallest, and where most friction is used."""
        tips, slips = self.tips_with or "nominal", self.slips_with or "nominal"
        return f"with {tips}" if tips == slips else f"tipping: with {tips}; friction: with {slips}"


class PostureStudy:
    """An arm on its base, at rest in any posture under any conditions.

    Args:
        robot: as it rests.
        limits: of angles, torques and clearance.
    """

    def __init__(self, robot: Robot, limits: Limits) -> None:
        robot.require_no_objects("studio")
        self.robot, self.limits, held = robot, limits, robot.payload
        self._centre = np.zeros(3) if held is None else held.center_of_mass
        payloads = None, Payload(1.0, self._centre)
        self._robots = [robot.varied(arm=robot.arm.with_payload(payload)) for payload in payloads]
        self._footing = lru_cache(_SUPPORTS)(self._with_friction)
        self._at: tuple[np.ndarray, tuple[RestLoads, RestLoads]] | None = None

    def answer(self, conditions: Conditions) -> PostureAnswer:
        """Margins, contact forces and torques; the nominal model without uncertainty.

        Raises:
            InputError: the posture has another number of joints.
        """
        self.robot.require_fit(len(conditions.q))
        gravity, push = self._acting(conditions)
        wrench = self._wrenches(conditions, gravity, conditions.payload, push)
        footing, torques = self._footing(conditions.friction), self._torques(conditions, gravity, push)
        loaded = Loaded(footing, wrench)
        q, still = conditions.q[None], np.zeros((1, self.robot.n))
        instant = Instants(self.robot, q, torques, wrench, self.robot.further(q, still), still, still)
        return PostureAnswer(
            conditions=conditions,
            loaded=loaded,
            margins=Margins.under(wrench, footing.tip_over, footing.slip)[0],
            slip=reported_slip(loaded.states, loaded.slip),
            torque_used=np.abs(torques[0]) / self.robot.limits.torque,
            broken=tuple(own_refusals(self.robot, self.limits, instant)),
        )

    def worst(self, conditions: Conditions) -> WorstPosture | None:
        """The worst within the uncertainty of the task; None without one.

        The floor's tilt turns gravity and the inertial force of an accelerated base together.
        """
        held = Payload(conditions.payload, self._centre) if conditions.payload else None
        given = self.limits.tolerance.of(held)
        tolerance = given.only(*(name for name in AT_REST if name in given.given))
        if not tolerance.given:
            return None
        gravity, push = self._acting(conditions)
        wrench = self._wrenches(conditions, gravity, conditions.payload, push)[0]
        support = self._footing(conditions.friction).support
        case = loaded_case(self.robot, support, gravity, conditions.q, held, wrench, tolerance)
        (GN, tip), (GT, slip) = case.tip(), case.slip()
        reference = self.robot.tip_over.reference_moment
        return WorstPosture(
            moment_at(GN, reference) if reference else np.inf, GT, case.words(tip), case.words(slip)
        )

    def robustness(self, conditions: Conditions) -> Robustness:
        """The robustness beyond the conditions; nominal, with sampled directions of tilt and push."""
        footing, (gravity, push) = self._footing(conditions.friction), self._acting(conditions)
        payload = conditions.payload
        wrench = self._wrenches(conditions, gravity, payload, push)
        margins = Margins.under(wrench, footing.tip_over, footing.slip)[0]
        contacts = LossSearch(footing, AlikeFriction.if_held(footing, wrench))

        def tilts(sides: np.ndarray) -> list[Deviation]:
            floors = partial(tilted, gravity, sides)
            return [Deviation(lambda tilt: self._wrenches(conditions, floors(tilt), payload, push), sides)]

        def forces(sides: np.ndarray) -> list[Deviation]:
            return [
                Deviation(
                    lambda more: self._wrenches(conditions, gravity, payload, push + more * sides), sides
                )
            ]

        heavier = Deviation(lambda mass: self._wrenches(conditions, gravity, mass, push))
        most_push = _MOST_PUSH * self.robot.mass * float(np.linalg.norm(gravity))
        return Robustness(
            payload=contacts.largest(self.robot.mass, lambda _: [heavier]).level,
            held=self._held(conditions, gravity, push),
            tilt=contacts.largest(MOST_TILT, tilts, slopes(gravity)).level,
            push=contacts.largest(most_push, forces, pushes(self.robot.support.gravity)).level,
            friction=float(margins.GT),
        )

    def posture(self, position: np.ndarray, *, near: np.ndarray) -> tuple[np.ndarray, float]:
        """The posture (n,) nearest to another with the TCP at a place, m, base axes, and how far it turned.

        The orientation, of arms with six joints and more, is that of the other posture where the arm can keep
        it; the angle by which it differs, rad, is 0 then.

        Args:
            position: (3,), m.
            near: (n,) the other posture.

        Raises:
            InputError: the search from there ends at no such posture; the message has the nearest miss.
        """
        arm, (place, rotation) = self.robot.arm, self.tcp(near)
        # In small steps, so that the posture follows and does not jump to another branch.
        steps = np.linspace(0.0, 1.0, 1 + int(np.ceil(np.linalg.norm(position - place) / _STEP)))[1:]
        kept: tuple[Orientation, ...] = ("full", "free") if arm.n >= _FULL else ("free",)
        error = np.zeros(1)
        for orientation in kept:
            q = near[None]
            for share in steps:
                there = place + share * (position - place)
                q, error = search(arm, q, there[None], rotation[None], orientation)
            if error[0] <= _REACHED:
                cosine = (np.sum(rotation * self.tcp(q[0])[1]) - 1) / 2
                return q[0], 0.0 if orientation == kept[0] else float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        raise InputError(
            f"TCP: cannot be reached from this posture; the nearest one misses by {1e3 * error[0]:.3g} mm"
        )

    def tcp(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,), m, and rotation (3, 3) of the TCP in base axes, at q (n,)."""
        position, rotation, _ = gripper_batch(self.robot.arm)(q[None])
        return position[0], rotation[0]

    # --- loads ----------------------------------------------------------------------------------------------

    def _with_friction(self, factor: float) -> Footing:
        if factor == 1.0:
            return self.robot
        return self.robot.on(self.robot.support.varied(with_friction(self.robot.support.contacts, factor)))

    def _acting(self, conditions: Conditions) -> tuple[np.ndarray, np.ndarray]:
        """Gravity as the accelerated base on its floor feels it, (3,), m/s^2, and the push (1, 3), N."""
        nominal = self.robot.support.gravity
        gravity = tilted(nominal, _level(conditions.downhill), conditions.tilt) - np.array(
            [*conditions.acceleration, 0.0]
        )
        return gravity, conditions.push * _level(conditions.towards)[None]

    def _rests(self, q: np.ndarray) -> tuple[RestLoads, RestLoads]:
        """Loads without payload and with 1 kg."""
        if self._at is None or not np.array_equal(self._at[0], q):
            empty, held = (RestLoads(robot, q[None]) for robot in self._robots)
            self._at = q, (empty, held)
        return self._at[1]

    def _wrenches(
        self, conditions: Conditions, gravity: np.ndarray, payload: float | np.ndarray, push: np.ndarray
    ) -> np.ndarray:
        """(N, 6) under gravity (3,) or (N, 3), a payload, kg, and pushes (N, 3)."""
        empty, held = self._rests(conditions.q)
        per_kilogram = held.per_gravity[0] - empty.per_gravity[0]
        total = np.atleast_2d(gravity) @ (empty.per_gravity[0] + payload * per_kilogram).T
        return total + empty.process + np.hstack([push, np.cross(empty.tool, push)])

    def _torques(self, conditions: Conditions, gravity: np.ndarray, push: np.ndarray) -> np.ndarray:
        """(1, n)."""
        empty, per_kilogram = self._torque_parts(conditions, gravity, push)
        return empty + conditions.payload * per_kilogram

    def _torque_parts(
        self, conditions: Conditions, gravity: np.ndarray, push: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Torques (1, n) without payload, and per kg of payload."""
        q, still = conditions.q[None], np.zeros((1, self.robot.n))
        about = self.robot.support.center_of_mass
        empty, held = (
            robot.pushed(robot.arm, q, still, still, None, gravity=gravity, about=about).torque
            for robot in self._robots
        )
        jacobian = gripper_batch(self.robot.arm)(q)[2]
        pushed = np.einsum("nki,nk->ni", jacobian[:, :3], push)
        return empty - pushed, held - empty

    def _held(self, conditions: Conditions, gravity: np.ndarray, push: np.ndarray) -> float:
        """kg in all that the drives hold."""
        (empty,), (more,) = self._torque_parts(conditions, gravity, push)
        limit = self.limits.torque_ratio * self.robot.limits.torque
        with np.errstate(divide="ignore", invalid="ignore"):
            masses = np.where(more == 0, np.inf, (np.sign(more) * limit - empty) / more)
        return max(float(np.min(np.where(np.abs(empty) > limit, 0.0, masses), initial=np.inf)), 0.0)


def _level(angle: float) -> np.ndarray:
    """(3,) direction from x to y of the base."""
    return np.array([np.cos(angle), np.sin(angle), 0.0])
