"""Bodies of an arm within a tolerance, over intervals of time: how heavy they may be, and what they need.

Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.certificate.trusted.arm import Arm, Motion, crossed, inertial, times_rows, turned
from ocptip.certificate.trusted.forms import Form


@dataclass(frozen=True, eq=False)
class Body:
    """Something on link k: its weight is from low to high; what it needs per weight, forms (3, N), base axes.

    Attributes:
        k: of which link.
        low, high: of its weight.
        mass: kg.
        lever: mass times place, kg m, from the reference point.
        force, moment: that its motion needs, about that point.
    """

    k: int
    low: float
    high: float
    mass: float
    lever: Form
    force: Form
    moment: Form


def bodies(
    arm: Arm,
    payload: Mapping[str, Any] | None,
    tolerance: Mapping[str, Any],
    frames: list[tuple[Form, Form]],
    moved: list[Motion],
) -> tuple[list[Body], list[Form]]:
    """Links, payload, its centre of mass anywhere in its box, axis by axis, and last the further mass at the
    gripper; and moments (3, N) that are of second order in the place of that centre.

    Args:
        arm: whose `about` is the reference point.
        payload, tolerance: of a certificate.
        frames: of all links.
        moved: of them, without gravity.
    """
    last, e, found = arm.n - 1, tolerance["arm_mass"], []
    still, second = np.zeros((3, 3)), []

    def body(k: int, low: float, high: float, mass: float, centre: np.ndarray, inertia: np.ndarray) -> Body:
        R, p = frames[k]
        origin = p - arm.about[:, None]
        force, moment = (turned(R, part) for part in inertial(mass, centre, inertia, moved[k]))
        lever = (origin + times_rows(R, centre)) * mass
        return Body(k, low, high, mass, lever, force, moment + crossed(origin, force))

    for k, (mass, centre, inertia) in enumerate(zip(arm.masses, arm.centres, arm.inertias, strict=True)):
        found.append(body(k, 1 - e, 1 + e, mass, centre, inertia))
    if payload is not None:
        mass, h = float(payload["mass"]), tolerance["payload_mass"]
        centre, inertia = (np.array(payload[key], dtype=float) for key in ("center", "inertia"))
        held, whole = body(last, 1 - h, 1 + h, mass, centre, inertia), found[-1]
        rest = (getattr(whole, key) - getattr(held, key) for key in ("mass", "lever", "force", "moment"))
        found[-1] = Body(last, 1 - e, 1 + e, *rest)
        found.append(held)
        half = np.array(tolerance["payload_center"], dtype=float)
        if np.any(half):
            (R, p), most = frames[last], mass * (1 + h)
            place = p - arm.about[:, None] + times_rows(R, centre)
            needs = turned(R, inertial(1.0, centre, still, moved[last])[0])
            adds = Form.of(np.zeros(place.r.shape)), *moved[last][1:]  # what shifts add to the acceleration
            axes = np.array(payload["axes"], dtype=float).T
            sides = [times_rows(R, axis) for axis in axes]
            swings = [turned(R, inertial(1.0, axis, still, adds)[0]) for axis in axes]
            for i in np.flatnonzero(half):
                force = swings[i] * most
                moment = crossed(place, force) + crossed(sides[i], needs) * most
                found.append(Body(last, -half[i], half[i], 0.0, sides[i] * most, force, moment))
                second += [
                    crossed(sides[i], swings[j]) * (most * half[i] * half[j]) for j in np.flatnonzero(half)
                ]
    found.append(body(last, 0.0, tolerance["extra_mass"], 1.0, arm.offsets[-1], still))
    return found, second
