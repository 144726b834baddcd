"""Sensitivities of GN, GT and the minimum normal force to everything that a user can change.

Each quantity alone is changed by a step that means something (1 kg, 10 mm) and all instants are solved again.
So the worst may be at another instant, axis or contact. Besides, the slopes at the worst instants: where only
the wrench changes, from the exact derivatives of the contact forces and indices with respect to it, else
(positions, friction) by central differences of the exact solver. At a worst instant that two contacts or axes
share, slopes are those of one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from ocptip.contact.bindings.binding import Binding
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Load, Support
from ocptip.numerics.threads import one_thread
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.model import ArmModel
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.footing import Footing
from ocptip.standing.mechanism import StandingMechanism

KILOGRAM, MILLIMETRES, FRICTION, SPEED, GRIPPER = 1.0, 0.01, 0.1, 0.01, 0.1
ONE_KILOGRAM = Payload(1.0)
_DIFFERENCE = 1e-5  # of a step, for slopes


@dataclass(frozen=True)
class Reserves:
    """Worst values over some instants.

    Attributes:
        GN, GT: largest; NaN where not known.
        force: minimum distance of a normal force from the end at which its contact lets go, N; infinite where
            no contact can.
        moment: minimum tipping margin, N m, negative where the base tips; NaN where nothing does.
    """

    TITLES: ClassVar = ("tipping [N m]", "friction [%]", "foot [N]")

    GN: float
    GT: float
    force: float
    moment: float = np.nan

    def cells(self) -> list[str]:
        """Tipping margin, friction used and minimum foot force as people read them."""
        force = max(self.force, 0.0) if np.isfinite(self.force) else float("nan")
        values = np.round([self.moment, 100 * self.GT, force], 9) + 0.0  # friction of nothing is 1e-14
        return [f"{value:.3g}" if np.isfinite(value) else "-" for value in values]


@dataclass(frozen=True)
class Sensitivity:
    """The effect of one change on a margin.

    Attributes:
        change: in words, such as "1 kg more base mass".
        quantity: what is changed, such as "base_mass".
        step: its size.
        unit: of the step: "kg", "m" or "" (a share).
        before, after: the change.
        slopes: of GN, GT and the minimum force (N) per unit, at their worst instants before the change.
        exact: slopes are derivatives, not differences.
    """

    change: str
    quantity: str
    step: float
    unit: str
    before: Reserves
    after: Reserves
    slopes: Reserves
    exact: bool

    def __str__(self) -> str:
        return f"{self.change}: " + ", ".join(
            map(" ".join, zip(self.after.TITLES, self.after.cells(), strict=True))
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; what is not finite is None."""

        def plain(reserves: Reserves) -> dict[str, float | None]:
            names = {"GN": "GN", "GT": "GT", "force": "least_normal_force_N"}
            values = {key: getattr(reserves, name) for name, key in names.items()}
            values["tipping_margin_Nm"] = reserves.moment
            return {key: value if np.isfinite(value) else None for key, value in values.items()}

        own = {name: getattr(self, name) for name in ("change", "quantity", "step", "unit", "exact")}
        parts = {name: plain(getattr(self, name)) for name in ("before", "after")}
        slopes = plain(self.slopes)
        del slopes["tipping_margin_Nm"]
        return {**own, **parts, "slopes_per_unit": slopes}


@dataclass(frozen=True, eq=False)
class _Stand:
    """A base on its contacts under N wrenches, (N, 6) or planar (N, 3)."""

    footing: Footing
    wrenches: np.ndarray

    @property
    def support(self) -> Support:
        return self.footing.support

    @property
    def states(self) -> ContactStates:
        return self.footing.contact_states(self.wrenches)

    def values(self) -> np.ndarray:
        """(N, 4): GN, GT, minus the minimum normal and tipping margins, so that the maxima are the worst."""
        states = self.states
        tip = self.footing.tip_over.evaluate(states)
        GT = self.footing.slip.evaluate(states, derivatives=False).GT
        moments = np.min(tip.margins, axis=1, initial=np.inf)
        return np.column_stack([tip.GN, GT, -np.min(tip.normal_reserves, axis=1), -moments])

    def at(self, rows: np.ndarray) -> _Stand:
        """At some of the instants."""
        return replace(self, wrenches=self.wrenches[rows])

    def loaded(self, wrenches: np.ndarray, reference: float) -> _Stand:
        """With more on it, and a reference moment that is larger by this share."""
        footing = self.footing
        if (moment := footing.tip_over.reference_moment) and reference:
            footing = Footing(footing.support, moment * (1 + reference), footing.slip.redistribution)
        return _Stand(footing, self.wrenches + wrenches)

    def slopes(self, rows: np.ndarray, per_unit: np.ndarray, reference: float) -> np.ndarray:
        """Derivatives (3,) of the worst values, at row k of the k-th.

        Args:
            rows: (3,).
            per_unit: (N, 6), of the wrenches.
            reference: of the logarithm of the reference moment.
        """
        states = self.at(rows).states
        tip, slip = self.footing.tip_over.evaluate(states), self.footing.slip.evaluate(states)
        assert slip.gradient is not None  # it was asked for
        along = per_unit[rows]
        contact = int(np.argmin(tip.normal_reserves[2]))
        normal = states.contact_forces[2, contact, 0]
        sign = 1.0 if self._lets_go_below(contact, normal, tip.normal_reserves[2, contact]) else -1.0
        force = sign * states.force_maps[2, contact, 0]
        ratio = tip.tip_ratio[0]  # M0 / (M0 + M)
        GN = tip.gradient[0] @ along[0] + (reference * ratio * (1 - ratio) if ratio < 1 else 0.0)
        return np.array([GN, slip.gradient[1] @ along[1], -force @ along[2]])

    def _lets_go_below(self, contact: int, force: float, margin: float) -> bool:
        """Whether the nearer end of a contact's normal force is the lower one."""
        pieces = self.support.contacts[contact].force_pieces()
        return abs(force - min(piece.normal_min for piece in pieces) - margin) <= 1e-9 * (1 + abs(force))


Changed = Callable[[float], _Stand]


@dataclass(frozen=True, eq=False)
class _Change:
    """One quantity.

    Attributes:
        words, quantity, step, unit: see `Sensitivity`.
        changed: the robot with the quantity larger by the argument.
        per_unit: (N, 6), derivative of the wrenches, where contacts stay as they are; else None.
        reference: derivative of the logarithm of the reference moment then.
    """

    words: str
    quantity: str
    step: float
    unit: str
    changed: Changed
    per_unit: np.ndarray | None = None
    reference: float = 0.0


def _load_change(
    stand: _Stand, words: str, name: str, step: float, unit: str, per_unit: np.ndarray, reference: float
) -> _Change:
    """More of something to which the wrenches (N, 6) are affine."""

    def changed(more: float) -> _Stand:
        return stand.loaded(more * per_unit, more * reference)

    return _Change(words, name, step, unit, changed, per_unit, reference)


def _measured(stand: _Stand, changes: list[_Change]) -> tuple[Sensitivity, ...]:
    values = stand.values()
    known = np.where(np.isnan(values), -np.inf, values)
    rows = np.argmax(known, axis=0)
    before = _reserves(values[rows, range(4)])
    found = []
    for change in changes:
        other = change.changed(change.step)
        after = other.values()
        after = np.max(np.where(np.isnan(after), np.inf, after), axis=0)
        if change.per_unit is not None:
            slopes = stand.slopes(rows[:3], change.per_unit, change.reference)
        else:
            h = _DIFFERENCE * change.step
            ends = [change.changed(e).at(rows[:3]).values()[range(3), range(3)] for e in (h, -h)]
            slopes = (ends[0] - ends[1]) / (2 * h)
        own = change.words, change.quantity, change.step, change.unit
        exact = change.per_unit is not None
        found.append(Sensitivity(*own, before, _reserves(after), _reserves(slopes), exact))
    return tuple(found)


def _reserves(values: np.ndarray) -> Reserves:
    GN, GT, lost, *moment = (float(value) for value in values)
    return Reserves(GN, GT, 0.0 - lost, *(0.0 - one if np.isfinite(one) else np.nan for one in moment))


def _support_changes(support: Support, stand: Callable[[Support], _Stand]) -> list[_Change]:
    """Changes of a base and its contacts."""

    def other(**changes: Any) -> Support:
        own = {
            "contacts": support.contacts,
            "mass": support.mass,
            "center_of_mass": support.center_of_mass,
            "gravity": support.gravity,
        }
        return Support(**{**own, **changes})

    d = support.dimension
    down = support.gravity / max(float(np.linalg.norm(support.gravity)), 1e-300)
    places = np.array([contact.position for contact in support.contacts])
    level = places - places.mean(axis=0)
    level -= np.outer(level @ down, down)
    sizes = np.linalg.norm(level, axis=1)
    outwards = level / np.where(sizes > 0, sizes, 1.0)[:, None]

    def moved(which: np.ndarray) -> Callable[[float], _Stand]:
        def change(way: float) -> _Stand:
            contacts = [
                replace(c, position=c.position + way * own * out)
                for c, own, out in zip(support.contacts, which, outwards, strict=True)
            ]
            return stand(other(contacts=contacts))

        return change

    mm = f"{1e3 * MILLIMETRES:g} mm"
    found = [
        _Change(f"all feet {mm} further out", "feet_outwards", MILLIMETRES, "m", moved(np.ones(len(places)))),
    ]
    if d == 3:
        found += [
            _Change(
                f"contact {k + 1} {mm} further out", f"contact_{k + 1}_outwards", MILLIMETRES, "m", moved(e)
            )
            for k, e in enumerate(np.eye(len(places)))
            if sizes[k] > 0
        ]
    if any(_has_friction(contact) for contact in support.contacts):

        def rougher(more: float) -> _Stand:
            contacts = [
                replace(c, friction=c.friction * (1 + more)) if _has_friction(c) else c  # pyright: ignore
                for c in support.contacts
            ]
            return stand(other(contacts=contacts))

        words = f"{100 * FRICTION:g} % more friction of all contacts"
        found.append(_Change(words, "friction", FRICTION, "", rougher))
    return found


def _has_friction(contact: Binding) -> bool:
    return getattr(contact, "friction", 0.0) > 0


def _base_shifts(stand: _Stand) -> list[_Change]:
    """Shifts of the base's centre of mass in the direction in which GN falls fastest, and down."""
    support, d = stand.support, stand.support.dimension
    pull, mm = support.mass * support.gravity, f"{1e3 * MILLIMETRES:g} mm"
    down = support.gravity / max(float(np.linalg.norm(support.gravity)), 1e-300)

    def per_unit(way: np.ndarray) -> np.ndarray:
        found = np.zeros_like(stand.wrenches)
        found[:, d:] = np.cross(way, pull) if d == 3 else way[0] * pull[1] - way[1] * pull[0]
        return found

    worst = np.full(3, np.argmax(np.nan_to_num(stand.values()[:, 0], nan=-np.inf)))
    gradient = np.array([stand.slopes(worst, per_unit(axis), 0.0)[0] for axis in np.eye(d)])
    gradient -= (gradient @ down) * down
    found = []
    if (size := float(np.linalg.norm(gradient))) > 1e-9:
        best = -gradient / size
        where = ", ".join(f"{x:.2g}" for x in np.round(best, 2) + 0.0)
        words = f"centre of mass {mm} towards ({where})"
        own = words, "center_of_mass_sideways", MILLIMETRES, "m"
        found.append(_load_change(stand, *own, per_unit(best), 0.0))
    words = f"centre of mass {mm} lower", "center_of_mass_down", MILLIMETRES, "m"
    return [*found, _load_change(stand, *words, per_unit(down), 0.0)]


def _base_mass(stand: _Stand, reference: float) -> _Change:
    """Change by a mass at the base's centre of mass; `reference`: slope of the logarithm of M0 per kg."""
    support = stand.support
    per_unit = np.zeros_like(stand.wrenches)
    per_unit[:, : support.dimension] = support.gravity
    words = f"{KILOGRAM:g} kg more base mass"
    return _load_change(stand, words, "base_mass", KILOGRAM, "kg", per_unit, reference)


@one_thread
def scene_sensitivities(
    support: Support, loads: tuple[Load, ...], reference_moment: float | None = None
) -> tuple[Sensitivity, ...]:
    """The effects of changes on the margins of a scene; loads stay where they are.

    Args:
        support: the base.
        loads: on it.
        reference_moment: M0, N m, if it is given.
    """

    def stand(own: Support) -> _Stand:
        return _Stand(Footing(own, reference_moment), own.wrench(loads)[None])

    nominal = stand(support)
    heavier = _base_mass(nominal, 0.0 if reference_moment else 1 / support.mass)
    return _measured(nominal, [heavier, *_base_shifts(nominal), *_support_changes(support, stand)])


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
    robot: StandingMechanism, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> tuple[Sensitivity, ...]:
    """The effects of changes on the margins of a robot at N states of a motion, (N, n) each."""

    def stand(own: StandingMechanism, speed: float = 1.0) -> _Stand:
        return _Stand(own, own.loads(q, speed * qd, speed**2 * qdd)[1])

    nominal, still = stand(robot), np.zeros_like(q)
    per_kilogram = 0.0 if robot.argument("reference_moment") else 1 / robot.mass
    changes = [_base_mass(nominal, per_kilogram), *_base_shifts(nominal)]
    changes += _support_changes(robot.support, lambda support: stand(robot.varied(support=support)))
    inertial = nominal.wrenches - robot.loads(q, still, still)[1]
    words = f"{100 * SPEED:g} % faster"
    changes.append(_Change(words, "speed", SPEED, "", lambda e: stand(robot, 1 + e), 2 * inertial))
    if isinstance(robot, Robot):
        own = f"{GRIPPER:g} kg more at the TCP", "gripper_mass", GRIPPER, "kg"
        changes.append(_load_change(nominal, *own, _held(robot, ONE_KILOGRAM, q, qd, qdd), per_kilogram))
        if (held := robot.arm.payload) is not None:
            own = "10 % heavier payload", "payload_mass", 0.1, ""
            load, share = _held(robot, held, q, qd, qdd), per_kilogram * held.mass
            changes.append(_load_change(nominal, *own, load, share))
    return _measured(nominal, changes)
