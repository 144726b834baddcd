"""Robots beyond the five named ones: a published 3PRR, a 3T2R machine, a redundant leg, a false Delta."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ocptip.parallel.description.platform import BodyInertia, Platform, elementary_rotation
from ocptip.parallel.description.ready_made import delta, rrr3, ups6
from ocptip.parallel.description.robot_description import PRISMATIC, MDHRow, RobotDescription, SerialLeg

QUARTER = math.pi / 2


def prr3() -> RobotDescription:
    """3PRR of Orsino, Hess-Coelho and Malvezzi (2021): sliders on one line, rods, a bar as platform."""
    home = published_motion(0.0)[0]
    legs = []
    for b, side, slider in zip((0.5, 0.4, 0.5), (-0.5, 0.0, 0.5), (0.646, 1.358, 1.646), strict=True):
        rod = BodyInertia.about_center(b, (b, 0, 0), (0, 0, b * b**2 / 3))
        angle = math.atan2(home[1], home[0] + side - slider)
        legs.append(
            SerialLeg(
                (MDHRow(PRISMATIC), MDHRow(gamma=-QUARTER, alpha=QUARTER), MDHRow(d=2 * b)),
                2,
                (BodyInertia.about_center(1.0), rod),
                base_rotation=(("y", QUARTER),),
                coupling=(side, 0, 0),
                guess=(slider, angle),
            )
        )
    platform = Platform(
        (1, 1, 0, 0, 0, 1), "xyz", BodyInertia.about_center(2.0, (0, 0, 0), (0, 0, 2 * 0.25 / 3))
    )
    motors = ((0, 0), (1, 0), (2, 0))
    return RobotDescription("3PRR", tuple(legs), platform, motors, home, np.array([0, -9.8, 0]))


def published_motion(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z, z', z'' of the published case."""
    w, k = 4 * math.pi, 8 * math.pi
    c, s, ck, sk = math.cos(w * t), math.sin(w * t), math.cos(k * t), math.sin(k * t)
    z = [2 + 0.1 * c, 0.3 + 0.1 * s, math.pi / 9 * sk]
    zd = [-0.1 * w * s, 0.1 * w * c, math.pi / 9 * k * ck]
    zdd = [-0.1 * w * w * c, -0.1 * w * w * s, -math.pi / 9 * k * k * sk]
    return np.array(z), np.array(zd), np.array(zdd)


def five_axes(*, coupling_mass: bool = False) -> RobotDescription:
    """3T2R with five equal legs of five joints, (P)RRRR; rotations about z, then about the moved y."""
    rows = (MDHRow(PRISMATIC), MDHRow(), MDHRow(d=0.5), MDHRow(d=0.5), MDHRow(alpha=QUARTER))
    bodies = [
        BodyInertia.about_center(1.0, (0, 0, 0), (0.01, 0.01, 0.01)),
        BodyInertia.about_center(1.0, (0.25, 0.02, 0), (0.01, 0.02, 0.03)),
        BodyInertia.about_center(0.7, (0.2, 0.1, 0), (0.01, 0.02, 0.03)),
    ]
    if coupling_mass:
        bodies.append(BodyInertia.about_center(0.4, (0.01, 0.02, 0.03), (0.004, 0.003, 0.002)))
    legs = []
    for i in range(5):
        a = 2 * math.pi * i / 5 + 0.3
        c, s = math.cos(a), math.sin(a)
        legs.append(
            SerialLeg(
                rows,
                3,
                tuple(bodies),
                base_rotation=(("z", a + math.pi),),
                base_position=(0.8 * c, 0.8 * s, 0.0),
                coupling=(0.25 * c, 0.25 * s, 0.15 * math.sin(3 * i + 1)),
                end_rotation=elementary_rotation("x", -QUARTER),
            )
        )
    inertia = BodyInertia.about_center(2.0, (0.02, 0.01, 0.05), (0.1, 0.12, 0.2))
    motors = ((0, 0), (1, 0), (2, 1), (3, 1), (4, 1))
    home = np.array([0.02, 0.01, 0.3, 0.1, 0.2])
    return RobotDescription("3T2R", tuple(legs), Platform((1, 1, 1, 1, 1, 0), "zyx", inertia), motors, home)


def redundant_leg() -> RobotDescription:
    """3RRR whose first leg has one link more; its first joint is a coordinate and has a motor."""
    base = rrr3()
    first = base.legs[0]
    longer = SerialLeg(
        (MDHRow(), MDHRow(d=0.3), MDHRow(d=0.6), MDHRow(d=0.6)),
        3,
        (first.bodies[0], *first.bodies),
        base_rotation=first.base_rotation,
        base_position=first.base_position,
        coupling=first.coupling,
        guess=(0.2, -0.9, 1.5),
    )
    return dataclasses.replace(
        base,
        legs=(longer, *base.legs[1:]),
        actuated=((0, 0), (0, 1), (1, 0), (2, 0)),
        redundant=((0, 0),),
        home=np.array([0.0, 0.0, 0.0, 0.2]),
    )


def vertical_delta() -> RobotDescription:
    """A "Delta" with all first axes vertical, which has four degrees of freedom."""
    true = delta()
    legs = tuple(
        dataclasses.replace(leg, base_rotation=(("z", angle),), end_rotation=None)
        for leg, angle in zip(true.legs, (0.0, 2.1, 4.2), strict=True)
    )
    return dataclasses.replace(true, name="vertical", legs=legs, home=np.array([0.03, 0.02, -0.4]))


def extra_leg() -> RobotDescription:
    """4RRR: a 3RRR with a fourth leg and motor (redundant actuation)."""
    base = rrr3()
    angle = math.radians(30.0)
    c, s = math.cos(angle), math.sin(angle)
    fourth = dataclasses.replace(
        base.legs[0],
        base_rotation=(("z", angle + math.pi),),
        base_position=(c, s, 0.0),
        coupling=(0.3 * c, 0.3 * s, 0.0),
    )
    return dataclasses.replace(base, legs=(*base.legs, fourth), actuated=((0, 0), (1, 0), (2, 0), (3, 0)))


def spu6() -> RobotDescription:
    """6UPS with legs the other way round: ball joint, slider, universal joint; four joints to the coupling.

    The slider's axis is the ball joint's last one. Guesses are those of the legs that push, at home.
    """
    hexapod = ups6()
    rows = (
        MDHRow(),
        MDHRow(alpha=QUARTER),
        MDHRow(alpha=QUARTER),
        MDHRow(PRISMATIC),
        MDHRow(alpha=QUARTER),
        MDHRow(alpha=QUARTER),
    )
    legs = []
    for leg in hexapod.legs:
        x, y, z = leg.base_matrix.T @ (hexapod.home[:3] + leg.coupling_point - leg.origin)
        length, flat = math.hypot(x, y, z), math.hypot(x, y)
        # Axis 3 is Rz(q1) Rx(90) Rz(q2) (0, -1, 0) = Rz(q1) (sin q2, 0, -cos q2).
        guess = (math.atan2(y, x), math.atan2(flat, -z), 0.0, length)
        bodies = (BodyInertia(), BodyInertia(), leg.bodies[1], leg.bodies[2])
        legs.append(
            SerialLeg(
                rows,
                4,
                bodies,
                base_rotation=leg.base_rotation,
                base_position=leg.base_position,
                coupling=leg.coupling,
                guess=(*guess, 0.3, 0.8),
            )
        )
    return dataclasses.replace(
        hexapod, name="6SPU", legs=tuple(legs), actuated=tuple((k, 3) for k in range(6))
    )
