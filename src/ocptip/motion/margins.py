"""The margins of a motion, in N m, N, m and shares: nominal, in the worst case, and the required ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

from ocptip.motion.check import MotionCheck
from ocptip.reserves.tipping import moment_at
from ocptip.standing.contact_margins import ContactMargins, Margin
from ocptip.standing.footing import Footing
from ocptip.standing.further_limits import POINT_SPEED, TCP_SPEED
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.within.in_motion import WorstInstant

_CLEARANCE_WITHIN = "clearance_worst_case_m"


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
    nominal: Margin | None
    worst_case: Margin | None
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
    worst, edge = checked.worst, checked.contacts.edge

    def of(name: str) -> Margin | None:
        return _changed(worst.get(name), float)

    def limit(name: str) -> float | None:
        return worst[name].limit if name in worst else None

    within, force = checked.within, None
    if within:
        force = within.alike or within.foot_force
    base, *objects = robot.interfaces
    yield from _of_contacts(base, checked, checked.contacts, force)
    beyond = edge and edge.value < 0 and "GN" in worst and worst["GN"].broken
    yield MotionMargin(ZERO_MOMENT_POINT, edge, None, 0.0, None, True, math.inf if beyond else -math.inf)
    if "torque_ratio" in worst:
        limits = worst["torque_ratio"].limit, limit(TORQUE_WITHIN)
        shares = _used(worst.get("torque_ratio"), worst.get(TORQUE_WITHIN))
        yield MotionMargin(TORQUE, of("torque_ratio"), of(TORQUE_WITHIN), *limits, False, shares)
    if CLEARANCE in worst:
        pairs = [worst[name] for name in (CLEARANCE, _CLEARANCE_WITHIN) if name in worst]
        share = max((pair.limit / pair.value if pair.value > 0 else math.inf) for pair in pairs)
        limits = worst[CLEARANCE].limit, limit(_CLEARANCE_WITHIN)
        nominal, late = of(CLEARANCE), of(_CLEARANCE_WITHIN)
        # A distance that the motion does not change is of no instant, and nothing to plan with.
        if checked.collision.get("least", {}).get("constant"):
            nominal, late = (one and replace(one, time=None) for one in (nominal, late))
            share = share if share > 1 else -math.inf
        yield MotionMargin(CLEARANCE, nominal, late, *limits, True, share)
    for name in (TCP_SPEED, POINT_SPEED):
        yield MotionMargin(name, of(name), None, limit(name), None, False, _used(worst.get(name)))
    for footing in objects:
        yield from _of_contacts(footing, checked, checked.objects[footing.name], None, footing.name)


def _of_contacts(
    footing: Footing, checked: MotionCheck, contacts: ContactMargins, worst_force: Margin | None, of: str = ""
) -> Iterable[MotionMargin]:
    """The margins of the contacts of the base, or of an object of this name."""
    reference, within = footing.tip_over.reference_moment, checked.within

    def result(symbol: str) -> Worst | None:
        return checked.worst.get(footing.result(symbol))

    def moment(index: float) -> float:
        return moment_at(index, reference)

    tip, tip_within = result("GN"), result(TIP_WITHIN)
    if of or (reference and tip):
        limits = tip and moment(tip.limit), tip_within and moment(tip_within.limit)
        worst = _changed(tip_within, moment)
        yield MotionMargin(TIPPING, contacts.moment, worst, *limits, True, _used(tip, tip_within), of)
    slip, slip_within = result("GT"), result(SLIP_WITHIN)
    worst = _changed(slip_within, float)
    if worst and within:
        worst = _as_factor(worst, within.objects[of]["slip"] if of else within.slip)
    if of or slip:
        limits = slip and slip.limit, slip_within and slip_within.limit
        yield MotionMargin(FRICTION, contacts.friction, worst, *limits, False, _used(slip, slip_within), of)
    # Rigid feet that can share the load differently: as if equally compliant, where one may have to pull.
    force, least = contacts.alike or contacts.force, 0.0 if contacts.unique else None
    yield MotionMargin(FOOT_FORCE, force, worst_force, least, None, True, -math.inf, of)


def _used(*results: Worst | None) -> float:
    """The largest share of a limit that results use."""
    return max((result.value / result.limit for result in results if result), default=-math.inf)


def _changed(result: Worst | None, change: Callable[[float], float]) -> Margin | None:
    """A result in the unit of its margin."""
    if result is None:
        return None
    return Margin(change(result.value), result.time if math.isfinite(result.time) else None)


def _as_factor(margin_at: Margin, worst: WorstInstant | None) -> Margin:
    """The worst friction used; GT above 1 counts an acceleration, a factor on the friction tells more."""
    if worst is None or margin_at.value <= 1:
        return margin_at
    return replace(margin_at, value=1.0 if math.isnan(worst.factor) else worst.factor)
