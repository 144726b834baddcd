"""The links of an arm as bodies that can exist, with separate fast rotors where they are needed.

Link inertias may be such as no body has: a drive's fast rotor, split between the links on both sides of its
joint, leaves a negative axial moment on one of them (6.11). Simulators refuse that. What a base feels of an
arm are its momenta, and these can be had with real bodies. Two changes leave them as they are:

- Mass on the axis of a joint (mass, first and second moments along the axis) belongs to either side of the
  joint: nothing at all changes.
- Spin: a rotor of axial moment I on the near side of a joint, which turns kappa times as fast as the joint,
  has the axial momentum I omega_near + kappa I qdot = I ((1 - kappa) omega_near + kappa omega_far). So the
  near link gets (kappa - 1) I, the far one loses kappa I, about the axis; kappa may be negative.

Bodies of a thin rod, a thin plate or a point need no rotors: they get a little thickness. Else the minimum
spin with which all bodies exist is a cone program. Mass, centre of mass, and momentum of the
whole are those of the model for every motion; the torque of a joint with a rotor is not: it also moves the
rotor, which takes kappa (kappa - 1) I qddot more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import clarabel
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones, triangle
from ocptip.numerics.inertia import RigidBody, parallel_axis, pseudo_inertia
from ocptip.robots.model import ArmModel

_MARGIN = 1e-3  # least second moment of a link along any axis, over its mass, (0.1 m)^2
_ROUNDED = 1e-9
_SMALL = 0.01  # mass of a rotor, and of a link without mass, over that of the link that it is taken from
_SPIN_SHARE = 0.1  # what a unit of a rotor's own moment is worth, in units of spin
_THICK = 0.6  # transverse over axial moment of a rotor
_FASTEST = 100.0  # ratio of a rotor
_NO_SPIN = 1e-4  # a rotor with less, as a share of the largest, is left out
_DAMPING = 1e-6  # of what is free otherwise
_LEAST = 1e-9  # kg m^2: moments of a link without any
_SCALE = np.array([0.1, 0.1, 0.1, 1.0])  # m
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Rotor:
    """A rotor on the near side of a joint, about the joint's axis, its centre in the joint's origin.

    Attributes:
        joint: whose drive it is, from 0.
        ratio: its speed over the joint's.
        mass: kg.
        axial, transverse: moments of inertia, kg m^2.
    """

    joint: int
    ratio: float
    mass: float
    axial: float
    transverse: float


@dataclass(frozen=True, eq=False)
class ArmBodies:
    """The bodies of an arm without payload.

    Attributes:
        links: mass, centre of mass and inertia about it of each link, in its frame.
        rotors: those that there have to be.
    """

    links: tuple[RigidBody, ...]
    rotors: tuple[Rotor, ...]


@lru_cache(maxsize=16)
def real_bodies(arm: ArmModel) -> ArmBodies:
    """The links of an arm without payload as bodies that can exist.

    Raises:
        InputError: no rotors make such bodies of them.
    """
    bare = arm.with_payload(None)
    links = [
        (float(mass), np.array(centre), np.array(inertia))
        for mass, centre, inertia in zip(bare.masses, bare.centres, bare.inertias, strict=True)
    ]
    links = [
        link if exists(link) or not _thin(link) else (*link[:2], link[2] + _LEAST * np.eye(3))
        for link in links
    ]
    if all(exists(link) for link in links):
        return ArmBodies(tuple(links), ())
    return _split(arm, links)


def exists(body: RigidBody) -> bool:
    """Whether a body has this mass and inertia, and a simulator takes it."""
    mass, _, inertia = body
    values = np.linalg.eigvalsh(inertia)
    return mass > 0 and values[0] > 0 and values[2] <= (values[0] + values[1]) * (1 + _ROUNDED)


def _thin(body: RigidBody) -> bool:
    """Whether a body exists but for its thickness: its mass is on a point, a line or a plane."""
    mass, _, inertia = body
    values = np.linalg.eigvalsh(inertia)
    size = _ROUNDED * values[2]
    return mass > 0 and values[0] >= -size and values[2] <= values[0] + values[1] + size


def _pseudo(body: RigidBody) -> np.ndarray:
    mass, centre, inertia = body
    return pseudo_inertia(mass, mass * centre, inertia + parallel_axis(mass, centre))


def _body(pseudo: np.ndarray) -> RigidBody:
    mass = float(pseudo[3, 3])
    centre = pseudo[:3, 3] / mass
    second = pseudo[:3, :3] - mass * np.outer(centre, centre)
    inertia = np.trace(second) * np.eye(3) - second
    return mass, centre, 0.5 * (inertia + inertia.T)


def _spun(axis: np.ndarray) -> np.ndarray:
    """What a moment of inertia of 1 about an axis through the origin adds, with no moment across it."""
    values = np.zeros((4, 4))
    values[:3, :3] = 0.5 * np.eye(3) - np.outer(axis, axis)
    return values


def _along(axis: np.ndarray, origin: np.ndarray) -> list[np.ndarray]:
    """Mass 1 on an axis by its moments along it: the zeroth, first and second one alone, (4, 4) each."""
    point, line = np.append(origin, 1.0), np.append(axis, 0.0)
    first = np.outer(point, line)
    return [np.outer(point, point), first + first.T, np.outer(line, line)]


def _split(arm: ArmModel, links: list[RigidBody]) -> ArmBodies:
    """Masses on axes, and rotors only where these alone do not make bodies of the links.

    A rotor loads its joint; one that is not needed changes what torques and springs feel.
    """
    drives = [(k, forward) for k in range(1, len(links)) if not arm.slides[k] for forward in (True, False)]
    for some in ([], [(k, forward) for k, forward in drives if links[k][0]]):
        if (bodies := _parted(arm, links, some)) is not None:
            return bodies
    raise InputError(
        f"arm {arm.name}: link inertias are such as no bodies have, with or without rotors "
        "behind gears: no model of it for a simulator"
    )


def _parted(arm: ArmModel, links: list[RigidBody], drives: list[tuple[int, bool]]) -> ArmBodies | None:
    """Solve for masses on axes and rotors of drives; scaled by the arm's mass and a length of 0.1 m."""
    scale = np.outer(_SCALE, _SCALE) * float(arm.masses.sum())
    given = [_pseudo(link) / scale for link in links]
    lacking = [k for k, link in enumerate(links) if not link[0]]
    small = {k: _SMALL * given[k - 1][3, 3] for k in range(1, len(links))}
    columns: list[dict[int, np.ndarray]] = []
    for k in (k for k in small if not arm.slides[k] and not {k - 1, k} & {*lacking}):
        near, far = _along(*_axis(arm, k)), _along(_Z, np.zeros(3))
        columns += [{k - 1: -out, k: into} for out, into in zip(near, far, strict=True)]
    moved = len(columns)
    for k, forward in drives:
        axis, origin = _axis(arm, k)
        sign = 1 if forward else -1
        thick = _THICK * _along(axis, origin)[2]
        columns.append({k - 1: sign * _spun(axis), k: -sign * _spun(_Z)})
        columns.append({k - 1: -thick, k: -_spun(_Z)} if forward else {k - 1: -thick - _spun(axis)})
    for k in [k for k, _ in drives] + lacking:
        if k == 0 or given[k - 1][3, 3] == 0:
            raise InputError(f"arm {arm.name}: link {k + 1} has no mass, nor has the one before it")
        given[k - 1] = given[k - 1] - small[k] * _along(*_axis(arm, k))[0]
    result = _solved(given, lacking, columns, moved)
    if result is None:
        return None
    for column, x in zip(columns, result, strict=True):
        for k, change in column.items():
            given[k] = given[k] + x * change
    rotors = []
    spins = result[moved:].reshape(-1, 2) * float(arm.masses.sum()) * _SCALE[0] ** 2
    for (k, forward), (spin, axial) in zip(drives, spins, strict=True):
        mass = small[k] * float(arm.masses.sum())
        if spin > _NO_SPIN * spins.max():
            ratio = 1 + spin / axial if forward else -spin / axial
            rotors.append(Rotor(k, ratio, mass, axial, _THICK * axial))
        else:
            given[k - 1] = given[k - 1] + small[k] * _along(*_axis(arm, k))[0]
    bodies = [_body(column * scale) if k not in lacking else links[k] for k, column in enumerate(given)]
    for k in lacking:
        bodies[k] = small[k] * float(arm.masses.sum()), np.zeros(3), _LEAST * np.eye(3)
    return ArmBodies(tuple(bodies), tuple(rotors))


def _axis(arm: ArmModel, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Axis of joint k > 0 and a point of it, in units of `_SCALE`, in the frame of the link before it."""
    return arm.rotations[k][:, 2], arm.offsets[k - 1] / _SCALE[0]


def _solved(
    given: list[np.ndarray], lacking: list[int], columns: list[dict[int, np.ndarray]], moved: int
) -> np.ndarray | None:
    """Minimum spin with all matrices positive definite; a rotor turns 2 to 100 times as fast as its joint."""
    size = len(columns)
    if not size:
        return None
    rows, right, cones = [], [], []
    for k, given_row in enumerate(given):
        if k not in lacking:
            none = np.zeros((4, 4))
            rows.append(-np.array([triangle(column.get(k, none)) for column in columns]).T)
            right.append(triangle(given_row - _MARGIN * given_row[3, 3] * np.eye(4)))
            cones.append(clarabel.PSDTriangleConeT(4))
    cost = np.zeros(size)
    cost[moved::2], cost[moved + 1 :: 2] = 1.0, -_SPIN_SHARE
    limits = []
    for j in range(moved, size, 2):
        slow, fast = np.zeros(size), np.zeros(size)
        slow[j], slow[j + 1] = -1, 1
        fast[j], fast[j + 1] = 1, -_FASTEST + 1
        limits += [slow, fast]
    rows.append(np.reshape(limits, (len(limits), size)))
    right.append(np.zeros(len(limits)))
    cones.append(clarabel.NonnegativeConeT(len(limits)))
    damping = _DAMPING * np.eye(size)
    solution = solve_cones(cost, np.vstack(rows), np.concatenate(right), cones, quiet_settings(), damping)
    return np.array(solution.x) if str(solution.status) in USABLE else None
