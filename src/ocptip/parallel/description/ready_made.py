"""Five well-known parallel robots: 3RRR, 3RPR, Delta, 4(P)RRR and 6UPS (tables 5.1 to 5.5, MDH side).

:func:`make_robot` builds a robot of one of the five kinds with any geometry, all of it named parameters; the
functions `rrr3`, `rpr3`, `delta`, `prrr4` and `ups6` give concrete designs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.parallel.description.platform import (
    BodyInertia,
    Entry,
    Parameter,
    Platform,
    elementary_rotation,
    product_of,
)
from ocptip.parallel.description.robot_description import PRISMATIC, MDHRow, RobotDescription, SerialLeg

_QUARTER = math.pi / 2
_PLANAR, _SPATIAL = (0.0, -9.81, 0.0), (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Kind:
    """The data that robots of one kind have in common.

    Attributes:
        rows: makes the leg table from the link lengths.
        lengths: number of link lengths.
        n: joints up to the coupling point.
        actuated: the motor's joint (from 0), leg by leg.
        mask: free platform coordinates.
        base_rotation: elementary rotations of a base frame from its one free angle.
        gravity: m/s^2, world axes.
        planar: True if coupling points and bases lie in the plane z = 0.
    """

    rows: Callable[..., tuple[MDHRow, ...]]
    lengths: int
    n: int
    actuated: tuple[int, ...]
    mask: tuple[int, ...]
    base_rotation: Callable[[Entry], tuple[tuple[str, Entry], ...]]
    gravity: tuple[float, float, float]
    planar: bool = False


_ROW, _TURNED, _SLIDING = MDHRow(), MDHRow(alpha=_QUARTER), MDHRow(PRISMATIC, alpha=_QUARTER)
_ROWS: dict[str, Callable[..., tuple[MDHRow, ...]]] = {
    "RRR": lambda l1, l2: (_ROW, MDHRow(d=l1), MDHRow(d=l2)),
    "RPR": lambda: (_ROW, _SLIDING, _TURNED),
    "RUU": lambda l1, l2: (_ROW, MDHRow(d=l1), _TURNED, MDHRow(d=l2), _TURNED),
    "PRRR": lambda l1, l2: (MDHRow(PRISMATIC), _ROW, MDHRow(d=l1), MDHRow(d=l2)),
    "UPS": lambda: (_ROW, _TURNED, _SLIDING, _ROW, _TURNED, _TURNED),
}


def _about_z(angle: Entry) -> tuple[tuple[str, Entry], ...]:
    return (("z", angle),)


def _tangential(angle: Entry) -> tuple[tuple[str, Entry], ...]:
    return ("x", -_QUARTER), ("y", angle), ("z", -_QUARTER)


KINDS = {
    "3RRR": Kind(_ROWS["RRR"], 2, 2, (0,) * 3, (1, 1, 0, 0, 0, 1), _about_z, _PLANAR, planar=True),
    "3RPR": Kind(_ROWS["RPR"], 0, 2, (1,) * 3, (1, 1, 0, 0, 0, 1), _about_z, _PLANAR, planar=True),
    "Delta": Kind(_ROWS["RUU"], 2, 3, (0,) * 3, (1, 1, 1, 0, 0, 0), _tangential, _SPATIAL),
    "4PRRR": Kind(_ROWS["PRRR"], 2, 3, (0, 1, 1, 1), (1, 1, 1, 0, 0, 1), _about_z, _SPATIAL),
    "6UPS": Kind(_ROWS["UPS"], 0, 3, (2,) * 6, (1, 1, 1, 1, 1, 1), _about_z, _SPATIAL),
}
"""The five kinds by name."""


def make_robot(
    kind: str,
    *,
    lengths: Sequence[float] = (),
    base_angles: Sequence[float] | np.ndarray,
    base_positions: ArrayLike,
    coupling_points: ArrayLike,
    bodies: Sequence[BodyInertia],
    platform: BodyInertia,
    home: Sequence[float],
    name: str | None = None,
    convention: str = "xyz",
    gravity: Sequence[float] | None = None,
) -> RobotDescription:
    """A robot of one of the five kinds with N equal legs.

    Args:
        kind: "3RRR", "3RPR", "Delta", "4PRRR" or "6UPS".
        lengths: link lengths l1, l2, m (none for 3RPR and 6UPS).
        base_angles: (N,), rad: Rz(gamma_i), or beta_i of Rx(-pi/2) Ry(beta_i) Rz(-pi/2) for the Delta.
        base_positions: (N, 3), m, world axes.
        coupling_points: (N, 3), m, platform axes.
        bodies: inertias of the leg's bodies up to the coupling point, the same for all legs.
        platform: inertia of the platform.
        home: free coordinates of a pose in the workspace.
        name: default the kind.
        convention: of the platform's rotations.
        gravity: m/s^2; default -y for the planar kinds, -z for the others.

    Raises:
        InputError: unknown kind, wrong shapes.
    """
    if kind not in KINDS:
        raise InputError(f"kind: must be one of {', '.join(KINDS)}, got {kind!r}")
    k = KINDS[kind]
    count = len(k.actuated)
    numbers = finite_array("lengths", lengths, (k.lengths,))
    angles = finite_array("base_angles", base_angles, (count,))
    positions = finite_array("base_positions", base_positions, (count, 3))
    points = finite_array("coupling_points", coupling_points, (count, 3))
    rows = k.rows(*(Parameter(f"l{i}", v) for i, v in enumerate(numbers, start=1)))
    legs = []
    for i in range(count):
        rotation = k.base_rotation(Parameter(f"gamma{i + 1}", angles[i]))
        legs.append(
            SerialLeg(
                rows,
                k.n,
                tuple(bodies),
                base_rotation=rotation,
                base_position=_point(f"base{i + 1}", positions[i], k.planar),
                coupling=_point(f"kappa{i + 1}", points[i], k.planar),
                end_rotation=delta_end_rotation(product_of(rotation)) if kind == "Delta" else None,
            )
        )
    return RobotDescription(
        name or kind,
        tuple(legs),
        Platform(tuple(map(bool, k.mask)), convention, platform),
        tuple(enumerate(k.actuated)),
        np.asarray(home, dtype=float),
        np.asarray(k.gravity if gravity is None else gravity, dtype=float),
    )


def delta_end_rotation(base: np.ndarray) -> np.ndarray:
    """(3, 3) platform axes to the last frame of an RUU leg whose last axis is parallel to its first one."""
    return (base @ elementary_rotation("x", math.pi)).T


def rrr3(
    *, links: Sequence[float] = (0.6, 0.6), base: float = 1.0, platform: float = 0.3
) -> RobotDescription:
    """3RRR: planar, motors at the base; z = (x, y, phi3).

    Args:
        links: l1, l2, m.
        base, platform: radii of the circles of the base and coupling joints, m.
    """
    angles = np.deg2rad([90.0, 210.0, 330.0])
    return make_robot(
        "3RRR",
        lengths=links,
        base_angles=angles + math.pi,
        base_positions=_circle(base, angles),
        coupling_points=_circle(platform, angles),
        bodies=(_rod(1.5, links[0]), _rod(1.2, links[1])),
        platform=_disc(2.0, platform),
        home=(0.0, 0.0, 0.0),
    )


def rpr3(*, base: float = 1.0, platform: float = 0.3, twist: float = 0.7) -> RobotDescription:
    """3RPR: planar, linear motors; z = (x, y, phi3).

    Args:
        base, platform: radii of the circles of the base and coupling joints, m.
        twist: angle between the triangles of base and platform in the home pose, rad; at 0 all legs would
            meet in one point, which is a singularity.
    """
    angles = np.deg2rad([90.0, 210.0, 330.0])
    return make_robot(
        "3RPR",
        base_angles=angles + 1.5 * math.pi,
        base_positions=_circle(base, angles),
        coupling_points=_circle(platform, angles + twist),
        bodies=(_rod(2.0, -0.4, axis=1), _rod(1.0, -0.4, axis=2)),
        platform=_disc(2.0, platform),
        home=(0.0, 0.0, 0.0),
    )


def delta(
    *, links: Sequence[float] = (0.3, 0.5), base: float = 0.2, platform: float = 0.15
) -> RobotDescription:
    """Delta robot, base above, platform below; z = (x, y, z).

    The parallelogram of a leg is one rod on two universal joints here, which is exact if each real rod
    carries half of its mass.

    Args:
        links: arm and rod, m.
        base, platform: radii of the circles of the motor axes and of the rods' lower ends, m.
    """
    angles = np.deg2rad([0.0, 120.0, 240.0])
    plate = BodyInertia.about_center(0.5, (0.0, 0.0, 0.0), (1e-3, 1e-3, 2e-3))
    return make_robot(
        "Delta",
        lengths=links,
        base_angles=angles,
        base_positions=_circle(base, -angles),
        coupling_points=_circle(platform, -angles),
        bodies=(_rod(0.8, links[0]), BodyInertia(), _rod(0.2, links[1])),
        platform=plate,
        home=(0.0, 0.0, -0.45),
    )


def prrr4(
    *, links: Sequence[float] = (0.5, 0.5), base: float = 0.8, platform: float = 0.2
) -> RobotDescription:
    """4(P)RRR: four legs on vertical guides, motor 1 lifts; z = (x, y, z, phi3).

    Args:
        links: l1, l2, m.
        base, platform: radii of the circles of the guides and of the coupling joints, m.
    """
    angles = np.deg2rad([45.0, 135.0, 225.0, 315.0])
    return make_robot(
        "4PRRR",
        lengths=links,
        base_angles=angles + math.pi,
        base_positions=_circle(base, angles),
        coupling_points=_circle(platform, angles),
        bodies=(
            BodyInertia.about_center(1.0, (0, 0, 0), (2e-3, 2e-3, 2e-3)),
            _rod(1.2, links[0]),
            _rod(1.0, links[1]),
        ),
        platform=_disc(2.0, platform),
        home=(0.0, 0.0, 0.3, 0.0),
    )


def ups6(
    *, base: float = 0.5, platform: float = 0.2, gap: float = 0.2, height: float = 0.6
) -> RobotDescription:
    """6UPS hexapod: regular base hexagon, coupling points in pairs; z = (x, y, z, phi1, phi2, phi3).

    Args:
        base, platform: radii of the circles of the base joints and of the coupling joints, m.
        gap: angle between the coupling points of a pair, rad; at pi/3 the hexagons of base and platform are
            similar, which is singular in every pose.
        height: of the platform in the home pose, m.
    """
    base_angles = np.deg2rad(30.0 + 60.0 * np.arange(6))
    pairs = np.deg2rad([60.0, 60.0, 180.0, 180.0, 300.0, 300.0])
    angles = pairs + gap / 2 * np.array([-1, 1, -1, 1, -1, 1])
    return make_robot(
        "6UPS",
        base_angles=base_angles,
        base_positions=_circle(base, base_angles),
        coupling_points=_circle(platform, angles),
        bodies=(
            BodyInertia.about_center(0.3, (0, 0, 0), (3e-4, 3e-4, 3e-4)),
            _rod(2.0, -0.35, axis=1),
            _rod(1.0, -0.35, axis=2),
        ),
        platform=_disc(4.0, platform),
        home=(0.0, 0.0, height, 0.0, 0.0, 0.0),
    )


READY_MADE: dict[str, Callable[[], RobotDescription]] = {
    "3RRR": rrr3,
    "3RPR": rpr3,
    "Delta": delta,
    "4PRRR": prrr4,
    "6UPS": ups6,
}
"""The concrete designs by name."""


def _point(name: str, values: np.ndarray, planar: bool) -> tuple[Entry, ...]:
    if planar and abs(values[2]) > 1e-9:
        raise InputError(f"{name}: must lie in the plane z = 0, got z = {values[2]} m")
    entries: list[Entry] = [Parameter(f"{name}_{c}", v) for c, v in zip("xyz", values, strict=True)]
    return (*entries[:2], 0.0) if planar else tuple(entries)


def _circle(radius: float, angles: np.ndarray) -> np.ndarray:
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])


def _rod(mass: float, length: float, *, axis: int = 0) -> BodyInertia:
    """A cylinder of radius 2 cm from the origin along one axis; a negative length points against the axis."""
    center, radius = np.zeros(3), 0.02
    center[axis] = length / 2
    principal = np.full(3, mass * (length**2 / 12 + radius**2 / 4))
    principal[axis] = mass * radius**2 / 2
    return BodyInertia.about_center(mass, center, principal)


def _disc(mass: float, radius: float) -> BodyInertia:
    """A thin disc in the plane z = 0 about the origin."""
    return BodyInertia.about_center(mass, (0, 0, 0), mass * radius**2 * np.array([0.25, 0.25, 0.5]))
