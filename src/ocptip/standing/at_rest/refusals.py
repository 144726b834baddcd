"""Whether a standing mechanism can rest in a posture; if not, why, with numbers."""

from __future__ import annotations

import numpy as np

from ocptip.contact.resting import what_moves
from ocptip.standing.instants import Instants, Loaded
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism


def posture_refusals(robot: StandingMechanism, limits: Limits, q: np.ndarray) -> list[str]:
    """Why the mechanism cannot rest at angles or coordinates q, (n,)."""
    resting, kinds = Instants.at_rest(robot, q[None]), limits_of(robot, limits)
    result = own_refusals(robot, limits, resting)
    if moving := list(filter(None, map(_moving, resting.interfaces))):
        return [*result, *moving]
    return result + [reason for limit in kinds if limit.of_contacts for reason in limit.refusals(resting)]


def own_refusals(robot: StandingMechanism, limits: Limits, instants: Instants, *, but: str = "") -> list[str]:
    """Why the mechanism itself cannot be there, whatever its contacts: angles, clearance, torques.

    The limit named `but` is left out.
    """
    kinds = [limit for limit in limits_of(robot, limits) if limit.name != but]
    others = [limit for limit in reversed(kinds) if not limit.of_contacts]
    return [reason for limit in others for reason in limit.refusals(instants)]  # the posture before its load


def _moving(loaded: Loaded) -> str:
    """Why a base or an object does not rest in its (single) contact state; empty if it does."""
    state, footing = loaded.states[0], loaded.footing
    if not state.solved:
        return f"no verified contact state of the {footing.name} at rest: {state.status}"
    if state.persistent:
        return ""
    return f"the {footing.name} does not stand at rest: {what_moves(footing.support, state.modes)}"
