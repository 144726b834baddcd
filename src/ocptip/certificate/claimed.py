"""Which bounds a certificate claims: near the sampled worst values, and within the limits if these hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ocptip.certificate.find_within import HIGHEST, LOSS_WITHIN
from ocptip.certificate.result import AT_LIMIT, Undecided
from ocptip.certificate.trusted.checker import CLAIMS_WITHIN
from ocptip.certificate.trusted.described import CLEARANCE, SPEED_OF_POINTS, TORQUES
from ocptip.reserves.force_sets import ForceSets
from ocptip.standing.further_limits import POINT_SPEED, TCP_SPEED
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import NEARLY_LOST, SLIP_WITHIN, TIP_WITHIN, Limits
from ocptip.standing.mechanism import StandingMechanism

LOSS = 2e-4
"""How far claims are from the sampled worst values, relative (distances: 0.1 mm), where limits allow."""

_LEAST_LOSS, _LOSS_LATE = 1e-4, 1e-3  # m; of late joints
_SLIP_SLACK = 0.02  # of what is left of friction within an uncertainty: so much higher is claimed
_LOST = 1.01  # of sampled reserves within a tolerance: beyond proof; those of GN may be a little too high
_CLAIMED_WITHIN = {
    TIP_WITHIN: "tip-over within tolerance",
    SLIP_WITHIN: "contacts within tolerance",
}
_OF_DRIVES = ("torque_ratio", TORQUES)


def bounds_near(limits: Limits, worst: Mapping[str, Worst], collides: bool) -> dict[str, float]:
    """The bounds to claim: slightly weaker than the sampled values, but within the limits if these hold."""
    bounds = {}
    used = {
        name: (worst[name].value, getattr(limits, name))
        for name in ("GN", "GT", *_OF_DRIVES)
        if name in worst
    }
    if speeds := [worst[name] for name in (TCP_SPEED, POINT_SPEED) if name in worst]:
        used[SPEED_OF_POINTS] = max(speed.value / speed.limit for speed in speeds), 1.0
    for name, (value, limit) in used.items():
        bound = value + LOSS * max(value, 0.1)
        if bound > limit and value <= limit * (1 + 0.1 * AT_LIMIT):
            bound = limit * (1 + AT_LIMIT)
        bounds[name] = float(min(bound, HIGHEST) if name in ("GN", "GT") else bound)
    for name, loss in (("clearance", _LEAST_LOSS), (CLEARANCE, _LOSS_LATE)) if collides else ():
        if f"{name}_m" not in worst:
            continue
        value, limit = worst[f"{name}_m"].value, getattr(limits, name)
        bound = value - loss
        at_limit = bound < limit <= value + 0.1 * AT_LIMIT
        bounds[name] = float(min(limit, value - AT_LIMIT) if at_limit else bound)
    return bounds


def limit_within(limits: Limits, name: str) -> float:
    """The limit of an index within an uncertainty; contacts that are just not lost have the highest."""
    limit = getattr(limits, name.partition("[")[0])
    return HIGHEST if limit >= NEARLY_LOST else limit


def goal_within(limits: Limits, worst: Mapping[str, Worst], name: str) -> float:
    """The bound to claim of an index within an uncertainty; close to a limit that is kept."""
    if name not in worst:
        return HIGHEST
    value, limit = worst[name].value, limit_within(limits, name)
    near, most = value * (1 + LOSS_WITHIN), max(limit, value * (1 + LOSS))
    if "[" in name and value <= limit * (1 + 0.1 * AT_LIMIT):
        most = limit * (1 + AT_LIMIT)
    if name.partition("[")[0] in (
        SLIP_WITHIN,
        "GT",
    ):  # far from the limit a close bound takes most of the time
        near = max(near, value + _SLIP_SLACK * (most - value))
    return min(near, most, HIGHEST)


def lost_as_sampled(worst: Mapping[str, Worst]) -> list[Undecided]:
    """Where contacts are lost within the tolerance already as sampled."""
    claims = [(worst[name], claim) for name, claim in _CLAIMED_WITHIN.items() if name in worst]
    return [Undecided(w.time, w.time, claim, w.value - 1) for w, claim in claims if not w.value < _LOST]


def kept(limits: Limits, bounds: Mapping[str, float]) -> bool:
    """Whether bounds keep the limits."""
    asked = [name for name in ("GN", "GT", *_OF_DRIVES) if name in bounds]
    most = all(bounds[name] <= getattr(limits, name) * (1 + 2 * AT_LIMIT) for name in asked)
    most &= bounds.get(SPEED_OF_POINTS, 0.0) <= 1 + 2 * AT_LIMIT
    for name in CLAIMS_WITHIN:
        most &= bounds.get(name, 0.0) <= limit_within(limits, name)
    of_objects = [name for name in bounds if "[" in name]
    most &= all(bounds[name] <= limit_within(limits, name) * (1 + 2 * AT_LIMIT) for name in of_objects)
    return most and all(
        bounds.get(name, np.inf) >= getattr(limits, name) - 2 * AT_LIMIT for name in ("clearance", CLEARANCE)
    )


def why_none(robot: StandingMechanism, worst: Mapping[str, Worst]) -> str:
    """Why no certificate can be made; empty if one can."""
    if robot.tip_over.free_rotation:
        return "contacts on one line"
    if np.any(np.isfinite(ForceSets(robot.support).along)):
        return "proofs do not cover wheels that roll"
    lost = [name for name in ("GN", "GT") if not worst[name].value < HIGHEST]
    return f"{lost[0]} is {worst[lost[0]].value:.4g}: a contact is lost" if lost else ""
