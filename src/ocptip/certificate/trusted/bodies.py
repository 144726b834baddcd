"""Bodies of an arm and its base within a tolerance, over intervals of time: how heavy they may be, and what
they need.

Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from ocptip.certificate.trusted.arm import Arm, Driven, Motion, crossed, inertial, times_rows, turned
from ocptip.certificate.trusted.forms import Form, U, joined
from ocptip.certificate.trusted.plain import DRIVE_SPEED

Part = tuple[Form, Form, Form]
"""Of a body: mass times place, kg m, from the reference point; force and moment that its motion needs."""


@dataclass(frozen=True, eq=False)
class Body:
    """Something on link k: its weight is from low to high; what it needs per weight, forms (3, N), base axes.

    Attributes:
        k: of which link; -1: of the base.
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
    last, e, results = arm.n - 1, tolerance["arm_mass"], []
    still, second = np.zeros((3, 3)), []

    def body(k: int, low: float, high: float, mass: float, centre: np.ndarray, inertia: np.ndarray) -> Body:
        part = part_of(frames[k], moved[k], arm.about, mass, centre, inertia)
        return Body(k, low, high, mass, *part)

    for k, (mass, centre, inertia) in enumerate(zip(arm.masses, arm.centres, arm.inertias, strict=True)):
        results.append(body(k, 1 - e, 1 + e, mass, centre, inertia))
    if payload is not None:
        mass, h = float(payload["mass"]), tolerance["payload_mass"]
        centre, inertia = (np.array(payload[key], dtype=float) for key in ("center", "inertia"))
        held, whole = body(last, 1 - h, 1 + h, mass, centre, inertia), results[-1]
        rest = (getattr(whole, key) - getattr(held, key) for key in ("mass", "lever", "force", "moment"))
        results[-1] = Body(last, 1 - e, 1 + e, *rest)
        results.append(held)
        half = np.array(tolerance["payload_center"], dtype=float)
        if np.any(half):
            axes, sides = np.array(payload["axes"], dtype=float).T, np.flatnonzero(half)
            body_of_tool = frames[last], moved[last], arm.about, mass * (1 + h), centre
            parts, products = shifted(*body_of_tool, axes[sides], half[sides])
            second += products
            for size, part in zip(half[sides], parts, strict=True):
                results.append(Body(last, -size, size, 0.0, *part))
    results.append(body(last, 0.0, tolerance["extra_mass"], 1.0, arm.offsets[-1], still))
    return results, second


def base_bodies(
    base: Mapping[str, Any],
    tolerance: Mapping[str, Any],
    shifts: np.ndarray,
    driven: Driven | None,
    none: Form,
) -> tuple[list[Body], list[Form]]:
    """The base and, last, its centre of mass anywhere in its box, axis by axis, about its nominal place; and
    moments (3, N) that are of second order in that.

    Args:
        base, tolerance: of a certificate.
        shifts: (axes, 3), m, half sides of the box.
        driven: how it drives; None: it rests.
        none: (3, N), zero.
    """
    (low, high), mass = tolerance["base_mass"], float(base["mass"])
    most, second = mass * (1 + high), []
    levers = [Form.of(np.broadcast_to(most * shift[:, None], none.r.shape)) for shift in shifts]
    parts: list[Part] = [(lever, none, none) for lever in (none, *levers)]
    if driven is not None:
        place, inertia = (np.array(base[key], dtype=float) for key in ("center_of_mass", "inertia"))
        still = Form.of(np.broadcast_to(np.eye(3)[:, :, None], (3, *none.r.shape)))
        base_terms = (still, none), driven[1], place
        _, force, moment = part_of(*base_terms, mass, place, inertia)
        moved, second = shifted(*base_terms, most, place, shifts, np.ones(len(shifts)))
        parts = [(none, force, moment), *moved]
    weights = [(1 + low, 1 + high, mass), *[(-1.0, 1.0, 0.0)] * len(shifts)]
    rows = zip(weights, parts, strict=True)
    return [Body(-1, least, most, share, *part) for (least, most, share), part in rows], second


def carried_bodies(
    carried: Mapping[str, Any], tolerance: Mapping[str, Any], moved: Motion
) -> tuple[list[Body], list[Form]]:
    """Bodies of an object on contacts, with shifts of their centres of mass, in axes of its link.

    The last is a place: where their weight acts, with nominal masses. Also moments as of `bodies`.

    Args:
        carried, tolerance: of a certificate.
        moved: of the link.
    """
    about = np.array(carried["base"]["center_of_mass"], dtype=float)
    none = Form.of(np.zeros(moved[0].r.shape))
    still = Form.of(np.broadcast_to(np.eye(3)[:, :, None], (3, *none.r.shape)))
    h, half = float(tolerance["payload_mass"]), np.array(tolerance["payload_center"], dtype=float)
    axes, sides = np.array(carried["axes"], dtype=float).T, np.flatnonzero(half)
    results, second = [], []
    for body in carried["bodies"]:
        mass, frame = float(body["mass"]), ((still, none), moved, about)
        centre, inertia = (np.array(body[key], dtype=float) for key in ("center", "inertia"))
        results.append(Body(carried["link"], 1 - h, 1 + h, mass, *part_of(*frame, mass, centre, inertia)))
        parts, products = shifted(*frame, mass * (1 + h), centre, axes[sides], half[sides])
        second += products
        results += [
            Body(carried["link"], -x, x, 0.0, *part) for x, part in zip(half[sides], parts, strict=True)
        ]
    masses, levers = _levers(carried)
    place = Form.of(np.broadcast_to((masses @ levers / np.sum(masses))[:, None], none.r.shape))
    return [*results, Body(carried["link"], 0.0, 0.0, 0.0, place, none, none)], second


def tilted(carried: Mapping[str, Any], tolerance: Mapping[str, Any]) -> tuple[float, float]:
    """Of an object on contacts, per unit by which gravity changes: by how much its weight does at most, kg.

    And by how much the moment differs from that of this force at the place of `carried_bodies`, kg m.
    """
    (masses, levers), h = _levers(carried), float(tolerance["payload_mass"])
    shift = float(np.linalg.norm(tolerance["payload_center"]))
    far = 2 * h * masses @ np.linalg.norm(levers, axis=1) + (1 + h) * np.sum(masses) * shift
    return float((1 + h) * np.sum(masses) * (1 + U)), float(far * (1 + U)) + U * float(np.sum(masses))


def _levers(carried: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Masses (k,) and places (k, 3) of bodies from the reference point."""
    masses, centres = (np.array([body[key] for body in carried["bodies"]]) for key in ("mass", "center"))
    return masses.astype(float), centres - np.array(carried["base"]["center_of_mass"], dtype=float)


def term_of(*shares: Body) -> tuple[float, float, float, Form]:
    """Ends of its weight, mass and parts, see `within.Terms`, of a body whose motion is given in shares."""
    body = shares[0]
    needs = [x for share in shares for x in (-share.force, -share.moment)]
    return body.low, body.high, body.mass, joined(body.lever, *needs)


def part_of(
    frame: tuple[Form, Form],
    moved: Motion,
    about: np.ndarray,
    mass: float,
    centre: np.ndarray,
    inertia: np.ndarray,
) -> Part:
    """Of a body in a frame that moves so, about a reference point (3,)."""
    R, p = frame
    origin = p - about[:, None]
    force, moment = (turned(R, part) for part in inertial(mass, centre, inertia, moved))
    return (origin + times_rows(R, centre)) * mass, force, moment + crossed(origin, force)


def shifted(
    frame: tuple[Form, Form],
    moved: Motion,
    about: np.ndarray,
    mass: float,
    centre: np.ndarray,
    axes: np.ndarray,
    half: np.ndarray,
) -> tuple[list[Part], list[Form]]:
    """What a shift of a centre of mass by 1 m along each of some axes (k, 3) adds to a body.

    Also moments (3, N) that are of second order in shifts of up to half, (k,), m.
    """
    (R, p), still = frame, np.zeros((3, 3))
    place = p - about[:, None] + times_rows(R, centre)
    needs = turned(R, inertial(1.0, centre, still, moved)[0])
    adds = Form.of(np.zeros(place.r.shape)), *moved[1:]  # what shifts add to the acceleration
    sides = [times_rows(R, axis) for axis in axes]
    swings = [turned(R, inertial(1.0, axis, still, adds)[0]) for axis in axes]
    parts, second = [], []
    for i, side in enumerate(sides):
        force = swings[i] * mass
        parts.append((side * mass, force, crossed(place, force) + crossed(side, needs) * mass))
        second += [crossed(side, swings[j]) * (mass * half[i] * half[j]) for j in range(len(half))]
    return parts, second


def paces(tolerance: Mapping[str, Any], drives: bool) -> tuple[np.ndarray, np.ndarray]:
    """Factors on the shares of `Arm.shares` at ends of the speed factors of arm and base, (ends, shares), and
    by how much (shares,) they may differ from means of these.

    The factor of the second share is a product x y of both speed factors. Over x^2 and y^2 it is more than
    what is linear between the ends, by at most this.
    """
    speed, base = float(tolerance["speed"]), float(tolerance.get(DRIVE_SPEED, 0.0))
    if not drives:
        return np.array([[(1 - speed) ** 2], [(1 + speed) ** 2]]), np.zeros(1)
    ends = product({1 - speed, 1 + speed}, {1 - base, 1 + base})
    bent = 0.5 * (1 + speed) * base**2 + 0.5 * (1 + base) * speed**2
    return np.array([[x * x, x * y, y * y] for x, y in ends]), np.array([0.0, 1.01 * bent, 0.0])
