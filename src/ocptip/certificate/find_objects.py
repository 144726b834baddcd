"""Find what proves that objects on contacts stay where they are, as `find_within` does for the base.

Nothing here has to be trusted: `checker` checks the result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ocptip.certificate.claimed import goal_within, limit_within
from ocptip.certificate.describe import contacts_data
from ocptip.certificate.find_within import SearchedClaims, SearchWithin
from ocptip.certificate.trusted.checker import CLAIMS_WITHIN, claims_of
from ocptip.certificate.trusted.plain import NOTHING
from ocptip.reserves.force_sets import ForceSets
from ocptip.standing.arm import Robot
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import Limits
from ocptip.standing.objects import GRIPPER, CarriedObject

_NEAR = 0.9  # share of a limit, of sampled values, from which on no close bound is searched


@dataclass(eq=False)
class ObjectClaims:
    """Objects that are proved: their parts of the model, what proves them, bounds; and what is short."""

    model: list[dict[str, Any]] = field(default_factory=list)
    proofs: list[dict[str, Any]] = field(default_factory=list)
    bounds: dict[str, float] = field(default_factory=dict)
    short: list[tuple[float, float, str, float]] = field(default_factory=list)


def object_claims(
    robot: Robot,
    model: Mapping[str, Any],
    motion: Mapping[str, Any],
    tolerance: Mapping[str, Any] | None,
    limits: Limits,
    worst: Mapping[str, Worst],
    knots: np.ndarray,
) -> ObjectClaims:
    """Bounds and covers of the contacts of objects, nominal and within a tolerance; arguments as of
    `find_cancels.cancel_claims`.
    """
    every = ObjectClaims()
    for carried in (_in_link(robot, body) for body in robot.carried):
        footing, data = carried.footing, object_data(robot, carried)
        kinds = {"cover": (False, NOTHING)} | ({"cover_within": (True, tolerance)} if tolerance else {})
        bounds, short = dict[str, float](), list[tuple[float, float, str, float]]()
        proof: dict[str, Any] = {"cover_within": None}
        rolls = np.any(np.isfinite(ForceSets(footing.support).along))
        if rolls or data["base"]["reference_moment"] is None or footing.tip_over.free_rotation:
            continue
        for key, (within, world) in kinds.items():
            names = claims_of(data, within)
            if any(name not in worst or not worst[name].value < 1 for name in names):
                break
            goals = {
                claim: goal_within(limits, worst, name)
                for claim, name in zip(CLAIMS_WITHIN, names, strict=True)
            }
            held = footing.weakest(limits.tolerance) if within else footing
            loose = {
                claim: max(goals[claim], limit_within(limits, name))
                for claim, name in zip(CLAIMS_WITHIN, names, strict=True)
            }
            result: SearchedClaims | None = None
            near = any(worst[name].value > _NEAR * limit_within(limits, name) for name in names)
            # A bound may be coarse where the limit leaves room for it; near the limit a close one takes long.
            for tried in (loose,) if near else (goals, loose):
                result = SearchWithin(held, model, motion, world, tried, knots, data).claims()
                if result is not None and not result.short:
                    break
            if result is None or result.short:
                short = [] if result is None else result.short
                if not within:
                    short = [(a, b, claim.replace(" within tolerance", ""), by) for a, b, claim, by in short]
                break
            proof[key] = result.cover
            bounds |= {name: result.bounds[claim] for claim, name in zip(CLAIMS_WITHIN, names, strict=True)}
        else:
            every.model.append(data)
            every.proofs.append(proof)
            every.bounds |= bounds
        every.short += [(a, b, f"{data['name']}: {claim}", by) for a, b, claim, by in short]
    return every


def object_data(robot: Robot, carried: CarriedObject) -> dict[str, Any]:
    """An object of a certificate's model."""
    footing, gripper = carried.footing, carried.carrier == GRIPPER
    return {
        "name": carried.object.name,
        "link": len(robot.arm.masses) if gripper else 0,
        "axes": (robot.arm.tool_rotation if gripper else np.eye(3)).tolist(),
        "bodies": [
            {
                "mass": float(mass),
                "center": np.asarray(center).tolist(),
                "inertia": np.asarray(inertia).tolist(),
            }
            for mass, center, inertia in carried.bodies.values()
        ],
        **contacts_data(footing),
    }


def _in_link(robot: Robot, carried: CarriedObject) -> CarriedObject:
    """The object in axes of the last link instead of the gripper's; on the base it stays."""
    if carried.carrier != GRIPPER:
        return carried
    turn, place = robot.arm.tool_rotation, robot.arm.offsets[-1]
    bodies = {
        name: (mass, place + turn @ center, turn @ inertia @ turn.T)
        for name, (mass, center, inertia) in carried.bodies.items()
    }
    return replace(
        carried, rotation=turn @ carried.rotation, origin=place + turn @ carried.origin, bodies=bodies
    )
