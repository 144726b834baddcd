"""The margins of a motion, in N m, N, m and shares: nominal, in the worst case, and the required ones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

from ocptip.motion.check import MotionCheck
from ocptip.reserves.tipping import moment_at
from ocptip.standing.footing import Footing
from ocptip.standing.further_limits import POINT_SPEED, TCP_SPEED
from ocptip.standing.limit_kinds.nominal import of_object
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.within.in_motion import WorstInstant

_CLEARANCE_WITHIN = "clearance_worst_case_m"


@dataclass(frozen=True)
class At:
    """A value.

    Attributes:
        value: in the unit of its margin; friction used is infinite where no friction holds the base.
        time: s; None where it is not of one instant.
        contacts: that it is about, counted from 1.
    """

    value: float
    time: float | None = None
    contacts: tuple[int, ...] = ()


@dataclass(frozen=True)
class MotionMargin:
    """The smallest margin of one kind in a motion, or the largest use of a limit.

    Attributes:
        name: of the quantity, with its unit.
        nominal: in the nominal model; None where it has no meaning.
        worst_case: with all deviations of the uncertainty at once; None without uncertainty, or not computed.
        limit: of the nominal value; None for forces that depend on the sharing of the load.
        limit_worst_case: of the other.
        minimum: the limits are minima, not maxima.
        used: share of the limit that is in use, of the one that decides; 1: at the limit.
        object: whose contacts it is about; empty: those of the base.
    """

    name: str
    nominal: At | None
    worst_case: At | None
    limit: float | None
    limit_worst_case: float | None
    minimum: bool
    used: float
    object: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; `object` only where it is about one."""
        return {name: value for name, value in asdict(self).items() if name != "object" or value}


TIPPING, FRICTION, FOOT_FORCE = "tipping_margin_Nm", "friction_used", "foot_force_N"
ZERO_MOMENT_POINT, TORQUE, CLEARANCE = "zero_moment_point_to_edge_m", "torque_used", "clearance_m"


def motion_margins(robot: StandingMechanism, checked: MotionCheck) -> tuple[MotionMargin, ...]:
    """The margins of a checked motion.

    The tip-over index GN = M0 / (M0 + M) of a margin M is turned back into N m with M0 of the base. Beyond
    the limits a tipping margin is negative. The friction used is then the factor on it that would hold.

    Args:
        robot: on its base; of a cycle that of any segment.
        checked: of the motion.
    """
    return tuple(row for row in _rows(robot, checked) if row.nominal or row.worst_case)


def critical(margins: Iterable[MotionMargin]) -> MotionMargin | None:
    """The one whose limit is used most; None where none is near."""
    return max((row for row in margins if math.isfinite(row.used)), key=lambda row: row.used, default=None)


def _rows(robot: StandingMechanism, checked: MotionCheck) -> Iterable[MotionMargin]:
    worst, contacts, reference = checked.worst, checked.contacts, robot.tip_over.reference_moment

    def moment(index: float) -> float:
        return moment_at(index, reference)

    def used(*names: str) -> float:
        shares = [worst[name].value / worst[name].limit for name in names if name in worst]
        return max(shares, default=-math.inf)

    def of(name: str, change: Any = float) -> At | None:
        if (own := worst.get(name)) is None:
            return None
        return At(change(own.value), own.time if math.isfinite(own.time) else None)

    def limit(name: str, change: Any = float) -> float | None:
        return change(worst[name].limit) if name in worst else None

    tip, force, edge = contacts.moment, contacts.force, contacts.edge
    if reference and "GN" in worst:
        yield MotionMargin(
            TIPPING,
            tip and At(tip.value, tip.time, tip.contacts),
            of(TIP_WITHIN, moment),
            moment(worst["GN"].limit),
            limit(TIP_WITHIN, moment),
            True,
            used("GN", TIP_WITHIN),
        )
    slip = contacts.friction
    nominal = slip and At(slip.value, slip.time, slip.contacts)
    worst_slip = of(SLIP_WITHIN)
    if worst_slip and checked.within:
        worst_slip = _as_factor(worst_slip, checked.within.slip)
    if "GT" in worst:
        limits = worst["GT"].limit, limit(SLIP_WITHIN)
        yield MotionMargin(FRICTION, nominal, worst_slip, *limits, False, used("GT", SLIP_WITHIN))
    # Rigid feet that can share the load differently: as if equally compliant, where one may have to pull.
    force, within = contacts.alike or force, checked.within
    worst_force = within and (within.alike or within.foot_force)
    yield MotionMargin(
        FOOT_FORCE,
        force and At(force.value, force.time, force.contacts),
        worst_force and At(worst_force.value, worst_force.time, worst_force.contacts),
        0.0 if contacts.unique else None,
        None,
        True,
        -math.inf,
    )
    yield MotionMargin(
        ZERO_MOMENT_POINT,
        edge and At(edge.value, edge.time),
        None,
        0.0,
        None,
        True,
        math.inf if edge and edge.value < 0 and "GN" in worst and worst["GN"].broken else -math.inf,
    )
    if "torque_ratio" in worst:
        limits = worst["torque_ratio"].limit, limit(TORQUE_WITHIN)
        shares = used("torque_ratio", TORQUE_WITHIN)
        yield MotionMargin(TORQUE, of("torque_ratio"), of(TORQUE_WITHIN), *limits, False, shares)
    if CLEARANCE in worst:
        pairs = [worst[name] for name in (CLEARANCE, _CLEARANCE_WITHIN) if name in worst]
        share = max((own.limit / own.value if own.value > 0 else math.inf) for own in pairs)
        limits = worst[CLEARANCE].limit, limit(_CLEARANCE_WITHIN)
        yield MotionMargin(CLEARANCE, of(CLEARANCE), of(_CLEARANCE_WITHIN), *limits, True, share)
    for name in (TCP_SPEED, POINT_SPEED):
        yield MotionMargin(name, of(name), None, limit(name), None, False, used(name))
    for footing in robot.interfaces[1:]:
        yield from _of_object(footing, checked)


def _as_factor(at: At, worst: WorstInstant | None) -> At:
    """The worst friction used; GT above 1 counts an acceleration, a factor on the friction tells more."""
    if worst is None or at.value <= 1:
        return at
    return replace(at, value=1.0 if math.isnan(worst.factor) else worst.factor)


def _of_object(footing: Footing, checked: MotionCheck) -> Iterable[MotionMargin]:
    """The margins of the contacts of an object."""
    name, contacts = footing.name, checked.objects[footing.name]
    reference = footing.tip_over.reference_moment
    kinds = (
        (TIPPING, contacts.moment, ("GN", TIP_WITHIN), lambda index: moment_at(index, reference)),
        (FRICTION, contacts.friction, ("GT", SLIP_WITHIN), float),
    )
    for title, own, symbols, change in kinds:
        known = [checked.worst.get(of_object(symbol, name)) for symbol in symbols]
        used = max((worst.value / worst.limit for worst in known if worst), default=-math.inf)
        within = known[1] and At(change(known[1].value), known[1].time)
        if within and checked.within and title == FRICTION:
            within = _as_factor(within, checked.within.objects[name]["slip"])
        limit, other = (worst and change(worst.limit) for worst in known)
        at = own and At(own.value, own.time, own.contacts)
        yield MotionMargin(title, at, within, limit, other, title == TIPPING, used, name)
    alone = contacts.alike or contacts.force  # as of the base
    force = alone and At(alone.value, alone.time, alone.contacts)
    least = 0.0 if contacts.unique else None
    yield MotionMargin(FOOT_FORCE, force, None, least, None, True, -math.inf, name)
