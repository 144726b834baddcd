"""What one change of the robot or its base does to the margins: tipping margin, friction used, foot force.

Each quantity alone is changed by a step that means something (1 kg, 10 mm) and all instants are solved again,
within an uncertainty in its worst case. Besides, there are the slopes of the nominal values at their worst
instants. Where only the wrench changes, they come from exact derivatives, else (positions, friction) from
central differences of the exact solver. At a worst instant of two contacts or axes they are those of one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from ocptip.contact.bindings.binding import Binding
from ocptip.contact.support import Load, Support
from ocptip.numerics.inertia import union
from ocptip.numerics.threads import one_thread
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.reserves.tipping import moment_at
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.model import ArmModel
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.footing import Footing
from ocptip.standing.instants import Loaded
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.standing.within.rest import SEARCHED, CaseWithin, scene_case

KILOGRAM, MILLIMETRES, FRICTION, SPEED, GRIPPER = 1.0, 0.01, 0.1, 0.01, 0.1
ONE_KILOGRAM = Payload(1.0)
_DIFFERENCE = 1e-5  # of a step, for slopes
_SMALL = 1e-4  # m: radius of gyration of a mass at the TCP
_NEAR = 1e-3  # m: for the direction in which a shift of the centre of mass helps in the worst case


@dataclass(frozen=True)
class Reserves:
    """Worst values over some instants.

    Attributes:
        GN, GT: largest; NaN where not known.
        force: minimum distance of a normal force from the end at which its contact lets go, N; of equally
            compliant feet where the sharing is open, negative where one would pull. NaN: not known.
        moment: minimum tipping margin, N m, negative where the base tips; NaN where nothing does.
        friction: factor on the friction that holds the base, up to 1 GT; infinite: no friction does.
    """

    TITLES: ClassVar = ("tipping [N m]", "friction [%]", "foot [N]")

    GN: float
    GT: float
    force: float
    moment: float = np.nan
    friction: float = np.nan

    @classmethod
    def of(cls, GN: float, GT: float, force: float, reference: float | None, factor: float) -> Reserves:
        """From M0 of GN, N m (None where nothing tips), and from the factor where GT is above 1."""
        moment = moment_at(GN, reference) if reference else np.nan
        return cls(GN, GT, force, moment, factor if GT > 1 else GT)

    def cells(self) -> list[str]:
        """Tipping margin, friction used and minimum foot force as people read them."""
        values = np.round([self.moment, 100 * self.friction, self.force], 9) + 0.0  # noise is 1e-14
        cells = [f"{value:.3g}" if np.isfinite(value) else "-" for value in values]
        return [cells[0], "none holds" if np.isinf(self.friction) else cells[1], cells[2]]


def reserves_at_rest(case: CaseWithin, reference: float | None) -> Reserves:
    """The worst values of a base at rest within an uncertainty, M0 given; foot forces are not known."""
    (GN, _), (GT, off) = case.tip(), case.slip()
    factor = case.demand(off).factor if GT > 1 else GT
    return Reserves.of(GN, GT, np.nan, reference, factor)


Worst = Callable[[Any, float], Reserves]
"""Worst values of a robot (of a scene: its support) within an uncertainty, with a factor on the speed."""


@dataclass(frozen=True)
class Sensitivity:
    """The effect of one change on the margins.

    Attributes:
        change: in words, such as "1 kg more base mass".
        quantity: what is changed, such as "base_mass".
        step: its size.
        unit: of the step: "kg", "m" or "" (a share).
        before, after: the change; within an uncertainty both of the worst case.
        slopes: of nominal GN, GT and minimum force (N) per unit, at their worst instants before the change.
        exact: slopes are derivatives, not differences.
        worst_case: `before` and `after` are of the worst case within an uncertainty.
    """

    change: str
    quantity: str
    step: float
    unit: str
    before: Reserves
    after: Reserves
    slopes: Reserves
    exact: bool
    worst_case: bool = False

    def __str__(self) -> str:
        return f"{self.change}: " + ", ".join(
            map(" ".join, zip(self.after.TITLES, self.after.cells(), strict=True))
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; what is not finite is None."""

        def plain(reserves: Reserves) -> dict[str, float | None]:
            names = {"GN": "GN", "GT": "GT", "force": "least_normal_force_N"}
            values = {key: getattr(reserves, name) for name, key in names.items()}
            values |= {"tipping_margin_Nm": reserves.moment, "friction_used": reserves.friction}
            return {key: value if np.isfinite(value) else None for key, value in values.items()}

        names = ("change", "quantity", "step", "unit", "exact", "worst_case")
        parts = {name: plain(getattr(self, name)) for name in ("before", "after")}
        slopes = plain(self.slopes)
        del slopes["tipping_margin_Nm"], slopes["friction_used"]
        return {**{name: getattr(self, name) for name in names}, **parts, "slopes_per_unit": slopes}


class _Stand(Loaded):
    """A base on its contacts under N wrenches, (N, 6) or planar (N, 3)."""

    @cached_property
    def values(self) -> np.ndarray:
        """(N, 4): GN, GT, minus the minimum normal and tipping margins, so that the maxima are the worst."""
        moments = np.min(self.tip.margins, axis=1, initial=np.inf)
        return np.column_stack([self.tip.GN, self.slip.GT, -np.min(self._foot_forces, axis=1), -moments])

    @property
    def _foot_forces(self) -> np.ndarray:
        """(N, n) distances of the normal forces from the end at which a contact lets go, N."""
        shares = equal_normal_map(self.footing.support)
        return self.tip.normal_reserves if shares is None else self.wrenches @ shares.T

    @property
    def worst(self) -> Reserves:
        """The worst values of all instants; not known where an instant is not."""
        values = np.where(np.isnan(self.values), np.inf, self.values)
        row, (GN, GT, lost, moment) = int(np.argmax(values[:, 1])), np.max(values, axis=0)
        factor = float(GT)
        if 1 < GT < np.inf:
            factor = FrictionDemand.of(self.footing.support, self.wrenches[row]).factor
        margin = 0.0 - float(moment) if np.isfinite(moment) else np.nan
        return Reserves(float(GN), float(GT), 0.0 - float(lost), margin, factor)

    def at(self, rows: np.ndarray) -> _Stand:
        """At some of the instants."""
        return _Stand(self.footing, self.wrenches[rows])

    def slopes(self, rows: np.ndarray, per_unit: np.ndarray, reference: float) -> np.ndarray:
        """Derivatives (3,) of the worst values, at row k of the k-th.

        Args:
            rows: (3,).
            per_unit: (N, 6), of the wrenches.
            reference: of the logarithm of the reference moment.
        """
        worst, along = self.at(rows), per_unit[rows]
        states, tip, slip = worst.states, worst.tip, self.footing.slip.evaluate(worst.states)
        assert slip.gradient is not None  # it was asked for
        contact = int(np.argmin(worst._foot_forces[2]))
        if (shares := equal_normal_map(self.footing.support)) is not None:
            force = shares[contact]
        else:
            normal = states.contact_forces[2, contact, 0]
            sign = 1.0 if self._lets_go_below(contact, normal, tip.normal_reserves[2, contact]) else -1.0
            force = sign * states.force_maps[2, contact, 0]
        ratio = tip.tip_ratio[0]  # M0 / (M0 + M)
        GN = tip.gradient[0] @ along[0] + (reference * ratio * (1 - ratio) if ratio < 1 else 0.0)
        return np.array([GN, slip.gradient[1] @ along[1], -force @ along[2]])

    def _lets_go_below(self, contact: int, force: float, margin: float) -> bool:
        """Whether the nearer end of a contact's normal force is the lower one."""
        pieces = self.footing.support.contacts[contact].force_pieces()
        return abs(force - min(piece.normal_min for piece in pieces) - margin) <= 1e-9 * (1 + abs(force))


@dataclass(frozen=True, eq=False)
class _Change:
    """One quantity.

    Attributes:
        words, quantity, step, unit: see `Sensitivity`.
        varied: robot (of a scene: its support) and factor on the speed with the quantity larger by the
            argument.
        per_unit: (N, 6), derivative of the wrenches, where contacts stay as they are; else None.
    """

    words: str
    quantity: str
    step: float
    unit: str
    varied: Callable[[float], tuple[Any, float]]
    per_unit: np.ndarray | None = None


def _measured(
    stand: Callable[[Any, float], _Stand], what: Any, changes: list[_Change], worst: Worst | None
) -> tuple[Sensitivity, ...]:
    """The effects of changes of a robot or a support, which `stand` gives a base under its wrenches."""
    case = worst or (lambda other, speed: stand(other, speed).worst)
    nominal, before = stand(what, 1.0), case(what, 1.0)
    rows = np.argmax(np.where(np.isnan(nominal.values), -np.inf, nominal.values), axis=0)[:3]
    results = []
    for change in changes:
        h = _DIFFERENCE * change.step
        if change.per_unit is not None:
            moments = [
                robot.footing.tip_over.reference_moment or 1.0
                for robot in (stand(*change.varied(h)), nominal)
            ]
            slopes = nominal.slopes(rows, change.per_unit, float(np.log(moments[0] / moments[1])) / h)
        else:
            ends = [stand(*change.varied(e)).at(rows).values[range(3), range(3)] for e in (h, -h)]
            slopes = (ends[0] - ends[1]) / (2 * h)
        after, per_unit = case(*change.varied(change.step)), Reserves(*map(float, slopes * [1, 1, -1]))
        named = change.words, change.quantity, change.step, change.unit
        exact = change.per_unit is not None
        results.append(Sensitivity(*named, before, after, per_unit, exact, worst is not None))
    return tuple(results)


On = Callable[[Support], tuple[Any, float]]
"""The robot, or a scene's support, on another support; and the factor 1 on the speed."""


def _support_changes(support: Support, on: On) -> list[_Change]:
    """Changes of the contacts of a base."""
    d = support.dimension
    down = support.gravity / max(float(np.linalg.norm(support.gravity)), 1e-300)
    places = np.array([contact.position for contact in support.contacts])
    level = places - places.mean(axis=0)
    level -= np.outer(level @ down, down)
    sizes = np.linalg.norm(level, axis=1)
    outwards = level / np.where(sizes > 0, sizes, 1.0)[:, None]

    def moved(which: np.ndarray) -> Callable[[float], tuple[Any, float]]:
        def change(way: float) -> tuple[Any, float]:
            contacts = [
                replace(c, position=c.position + way * moves * out)
                for c, moves, out in zip(support.contacts, which, outwards, strict=True)
            ]
            return on(support.varied(contacts))

        return change

    mm = f"{1e3 * MILLIMETRES:g} mm"
    support_changes = [
        _Change(f"all feet {mm} further out", "feet_outwards", MILLIMETRES, "m", moved(np.ones(len(places)))),
    ]
    if d == 3:
        support_changes += [
            _Change(
                f"contact {k + 1} {mm} further out", f"contact_{k + 1}_outwards", MILLIMETRES, "m", moved(e)
            )
            for k, e in enumerate(np.eye(len(places)))
            if sizes[k] > 0
        ]
    if any(_has_friction(contact) for contact in support.contacts):

        def rougher(more: float) -> tuple[Any, float]:
            contacts = [
                replace(c, friction=c.friction * (1 + more)) if _has_friction(c) else c  # pyright: ignore
                for c in support.contacts
            ]
            return on(support.varied(contacts))

        words = f"{100 * FRICTION:g} % more friction of all contacts"
        support_changes.append(_Change(words, "friction", FRICTION, "", rougher))
    return support_changes


def _has_friction(contact: Binding) -> bool:
    return getattr(contact, "friction", 0.0) > 0


def _base_changes(stand: _Stand, on: On, worst: Worst | None) -> list[_Change]:
    """A mass at the base's centre of mass, and shifts of that: down, and where the base tips last."""
    support, mm = stand.footing.support, f"{1e3 * MILLIMETRES:g} mm"
    d = support.dimension
    pull = support.mass * support.gravity
    down = support.gravity / max(float(np.linalg.norm(support.gravity)), 1e-300)

    def heavier(more: float) -> tuple[Any, float]:
        return on(support.varied(mass=support.mass + more))

    def shift(words: str, name: str, way: np.ndarray) -> _Change:
        per_unit = np.zeros_like(stand.wrenches)
        per_unit[:, d:] = np.cross(way, pull) if d == 3 else way[0] * pull[1] - way[1] * pull[0]

        def moved(length: float) -> tuple[Any, float]:
            return on(support.varied(center_of_mass=support.center_of_mass + length * way))

        return _Change(f"centre of mass {mm} {words}", name, MILLIMETRES, "m", moved, per_unit)

    weight = np.zeros_like(stand.wrenches)
    weight[:, :d] = support.gravity
    words = f"{KILOGRAM:g} kg more base mass"
    base_changes = [_Change(words, "base_mass", KILOGRAM, "kg", heavier, weight)]
    axes = [shift("", "", axis) for axis in np.eye(d)]
    if worst is None:
        row = np.full(3, np.argmax(np.nan_to_num(stand.values[:, 0], nan=-np.inf)))
        slopes = [-stand.slopes(row, axis.per_unit, 0.0)[0] for axis in axes if axis.per_unit is not None]
    else:
        here = worst(*on(support)).moment
        slopes = [(worst(*axis.varied(_NEAR)).moment - here) / _NEAR for axis in axes]
    level = np.nan_to_num(slopes) - (np.nan_to_num(slopes) @ down) * down
    if (size := float(np.linalg.norm(level))) > 1e-9:
        where = ", ".join(f"{x:.2g}" for x in np.round(level / size, 2) + 0.0)
        base_changes.append(shift(f"to ({where})", "center_of_mass_sideways", level / size))
    return [*base_changes, shift("lower", "center_of_mass_down", down)]


@one_thread
def scene_sensitivities(
    support: Support,
    loads: tuple[Load, ...],
    reference_moment: float | None = None,
    tolerance: Uncertainty = NONE,
) -> tuple[Sensitivity, ...]:
    """The effects of changes on the margins of a scene; loads stay where they are.

    Args:
        support: the base.
        loads: on it.
        reference_moment: M0, N m, if it is given.
        tolerance: what a scene cannot have of it is left out.
    """
    counts = tolerance.only(*(name for name in SEARCHED if name in tolerance.given))

    def worst(other: Support, _: float) -> Reserves:
        within = counts.heavier(other.mass - support.mass)
        moment = Footing(other, reference_moment).tip_over.reference_moment
        return reserves_at_rest(scene_case(other, loads, moment, within), moment)

    def stand(other: Support, _: float) -> _Stand:
        return _Stand(Footing(other, reference_moment), other.wrench(loads)[None])

    def on(other: Support) -> tuple[Support, float]:
        return other, 1.0

    case = worst if counts.given else None
    changes = _base_changes(stand(support, 1.0), on, case) + _support_changes(support, on)
    return _measured(stand, support, changes, case)


@lru_cache(maxsize=8)
def _holding(arm: ArmModel, held: Payload | None) -> ArmModel:
    """The arm with this and nothing else in its gripper; its functions are built once."""
    return arm.with_payload(held)


def _held(robot: Robot, held: Payload, *states: np.ndarray) -> np.ndarray:
    """The share of a payload in the wrench on the base, (N, 6)."""
    about, gravity = robot.support.center_of_mass, robot.support.gravity
    with_it, bare = (
        evaluate_dynamics(_holding(robot.arm, one), *states, gravity=gravity, about=about).wrench
        for one in (held, None)
    )
    return with_it - bare


def payload_torques(robot: Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) torques of a point mass of 1 kg at the TCP, at rest in postures (N, n), N m per kg."""
    still, gravity = np.zeros_like(q), robot.support.gravity
    with_it, bare = (
        evaluate_dynamics(_holding(robot.arm, one), q, still, still, gravity=gravity).torque
        for one in (ONE_KILOGRAM, None)
    )
    return with_it - bare


@one_thread
def motion_sensitivities(
    robot: StandingMechanism, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, worst: Worst | None = None
) -> tuple[Sensitivity, ...]:
    """The effects of changes on the margins of a robot at N states of a motion, (N, n) each.

    Args:
        robot: on its base.
        q, qd, qdd: the states, nominal.
        worst: of a robot, within an uncertainty; None: the nominal values.
    """

    def stand(other: StandingMechanism, speed: float) -> _Stand:
        return _Stand(other, other.loads(q, speed * qd, speed**2 * qdd)[1])

    def on(support: Support) -> tuple[StandingMechanism, float]:
        return robot.varied(support=support), 1.0

    nominal, still = stand(robot, 1.0), np.zeros_like(q)
    changes = _base_changes(nominal, on, worst) + _support_changes(robot.support, on)
    inertial = nominal.wrenches - robot.loads(q, still, still)[1]
    words = f"{100 * SPEED:g} % faster"
    changes.append(_Change(words, "speed", SPEED, "", lambda more: (robot, 1 + more), 2 * inertial))
    if robot.arm is not None:
        arm_robot = Robot.of(robot)
        held = robot.payload

        def gripping(more: float) -> tuple[Robot, float]:
            return arm_robot.varied(arm=_holding(arm_robot.arm, _with_point_mass(held, more))), 1.0

        named = f"{GRIPPER:g} kg more at the TCP", "gripper_mass", GRIPPER, "kg"
        changes.append(_Change(*named, gripping, _held(arm_robot, ONE_KILOGRAM, q, qd, qdd)))
        if held is not None:

            def heavier(more: float) -> tuple[Robot, float]:
                other = Payload((1 + more) * held.mass, held.center_of_mass, (1 + more) * held.inertia)
                return arm_robot.varied(arm=_holding(arm_robot.arm, other)), 1.0

            load = _held(arm_robot, held, q, qd, qdd)
            changes.append(_Change("10 % heavier payload", "payload_mass", 0.1, "", heavier, load))
    return _measured(stand, robot, changes, worst)


def _with_point_mass(held: Payload | None, mass: float) -> Payload:
    """A payload, if any, and a point mass at the TCP."""
    if held is None:
        return Payload(mass)
    # Two point masses are a rod without inertia about itself, which no body is.
    point = mass, np.zeros(3), mass * _SMALL**2 * np.eye(3)
    return Payload(*union((held.mass, np.asarray(held.center_of_mass), np.asarray(held.inertia)), point))
