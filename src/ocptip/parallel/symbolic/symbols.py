"""Symbols of a parallel robot: from its description to the legs and inertias of the symbolic engine.

Numbers of the description stay numbers (zeros and right angles are exact), named parameters become symbols.
Legs with equal tables and equal bodies share one set of inertia parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.frames import central_inertia
from ocptip.parallel.description.platform import BodyInertia, Entry, Parameter
from ocptip.parallel.description.robot_description import (
    DYNPAR2,
    PRISMATIC,
    MDHRow,
    RobotDescription,
    SerialLeg,
)
from ocptip.parallel.symbolic.leg_dynamics import LegModel
from ocptip.parallel.symbolic.spatial_sx import Rotation, Turn, Vector, plus, turn, vector

CENTRAL = ("JXX", "JXY", "JXZ", "JYY", "JYZ", "JZZ", "CX", "CY", "CZ", "M")
"""Parameters of a body in DynPar 1: inertia about the centre of mass, centre of mass, mass."""

JOINT_TERMS = ("drive_inertia", "viscous", "coulomb")


@dataclass(frozen=True)
class InertiaLayout:
    """Where the inertia parameters of the bodies stand in the parameter vector.

    Attributes:
        groups: legs that share their parameters.
        bodies: number of bodies per leg of each group.
    """

    groups: tuple[tuple[int, ...], ...]
    bodies: int

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 10 * (len(self.groups) * self.bodies + 1)

    def names(self, of_body: Sequence[str] = DYNPAR2) -> list[str]:
        """Names of the parameters: XX1 .. M1, XX2 .. MP; with several groups leg1_XX1 and so on."""
        named = []
        for group in self.groups:
            prefix = f"leg{group[0] + 1}_" if len(self.groups) > 1 else ""
            named += [f"{prefix}{name}{body + 1}" for body in range(self.bodies) for name in of_body]
        return named + [f"{name}P" for name in of_body]

    def leg_slice(self, leg: int) -> slice:
        """The entries of one leg."""
        (index,) = [k for k, group in enumerate(self.groups) if leg in group]
        return slice(10 * self.bodies * index, 10 * self.bodies * (index + 1))

    @property
    def platform_slice(self) -> slice:
        """The entries of the platform."""
        return slice(self.size - 10, self.size)


def inertia_layout(description: RobotDescription, *, complete: bool = False) -> InertiaLayout:
    """Group the legs that have equal tables and equal bodies.

    Args:
        description: the robot.
        complete: with all bodies of the legs, of any robot; a leg with fewer than others has massless ones
            behind. Default: with those up to the coupling points, of a robot the lean formulation applies to.

    Raises:
        InputError: the lean formulation does not apply.
    """
    if not complete:
        require_coupling_form(description)
    count = max(len(leg.bodies) for leg in description.legs) if complete else description.legs[0].n
    groups: list[list[int]] = []
    for index, leg in enumerate(description.legs):
        for group in groups:
            if _same_bodies(leg, description.legs[group[0]], complete):
                group.append(index)
                break
        else:
            groups.append([index])
    return InertiaLayout(tuple(tuple(group) for group in groups), count)


def inertia_values(description: RobotDescription, dynpar: int = 2, *, complete: bool = False) -> np.ndarray:
    """The parameter vector of the robot in the order of its layout.

    Args:
        description: the robot.
        dynpar: 2, about the frames' origins; 1, about the centres of mass.
        complete: as for :func:`inertia_layout`.

    Raises:
        InputError: DynPar 1 of a body that has a first moment but no mass.
    """
    layout = inertia_layout(description, complete=complete)
    bodies: list[BodyInertia] = []
    for group in layout.groups:
        leg_bodies = description.legs[group[0]].bodies[: layout.bodies]
        bodies += [*leg_bodies, *[BodyInertia()] * (layout.bodies - len(leg_bodies))]
    bodies.append(description.platform.inertia)
    return np.concatenate([_central(body) if dynpar == 1 else body.vector for body in bodies])


def joint_term_values(description: RobotDescription) -> np.ndarray:
    """(3, n N) drive inertia, viscous and Coulomb friction up to the coupling points, leg by leg."""
    legs = description.legs
    return np.array([[v for leg in legs for v in getattr(leg, which)[: leg.n]] for which in JOINT_TERMS])


def require_coupling_form(description: RobotDescription) -> None:
    """Raise InputError unless the lean formulation applies."""
    if not description.coupling_form:
        rows = len(description.position_rows)
        raise InputError(
            f"{description.name}: the lean formulation needs legs of {rows} joints up to the coupling point "
            f"and motors on those joints, but {description.coupling_obstacle}; use the general engine, "
            "`ParallelRobot`, or for code `complete_function`"
        )
    for number, leg in enumerate(description.legs, start=1):
        if not all(body.massless for body in leg.bodies[leg.n :]):
            raise InputError(
                f"{description.name}: leg {number} has coupling bodies with mass; use the general engine"
            )


def geometry_symbols(description: RobotDescription, numeric: bool = False) -> dict[str, cs.SX]:
    """The named parameters as symbols, or as numbers."""
    values = description.parameters.items()
    return {name: cs.SX(value) if numeric else cs.SX.sym(name) for name, value in values}


def leg_model(
    description: RobotDescription,
    index: int,
    q: cs.SX,
    geometry: dict[str, cs.SX],
    inertia: cs.SX,
    joint_terms: cs.SX,
    *,
    complete: bool = False,
) -> LegModel:
    """A leg in symbols.

    Args:
        description: the robot.
        index: of the leg, from 0.
        q: (n,) its joint variables.
        geometry: symbols of the named parameters.
        inertia: (10 n,) parameters about the frames' origins, zeros where eliminated.
        joint_terms: (3, n) drive inertia, viscous and Coulomb friction.
        complete: with all joints, also those behind the coupling point; else up to it.
    """
    leg = description.legs[index]
    count = leg.n_joints if complete else leg.n
    joints = [q[j] for j in range(count)]
    sliding = [row.sigma == PRISMATIC for row in leg.rows[:count]]

    def symbol(entry: Entry) -> cs.SX:
        return symbol_of(entry, geometry)

    chains: list[list[tuple[int, cs.SX]]] = []
    segments: list[Vector] = []
    for j, row in enumerate((*leg.rows, MDHRow())[: count + 1]):
        moves = j < count
        theta, r = symbol(row.theta), symbol(row.r)
        if moves and sliding[j]:
            r = r + joints[j]
        elif moves:
            theta = theta + joints[j]
        gamma, alpha = symbol(row.gamma), symbol(row.alpha)
        offset = turn(0, alpha).apply(vector([0.0, 0.0, r]))
        offset = [offset[0] + symbol(row.d), offset[1], offset[2] + symbol(row.b)]
        segments.append(turn(2, gamma).apply(offset))
        chains.append([(2, gamma), (0, alpha), (2, theta)])
    bases = _base_angles(leg, geometry)
    position, rotation = leg_base(leg, geometry)
    origin = plus(position, rotation(segments.pop(0)))
    chains[0] = bases + chains[0]
    given = inertia.numel() // 10
    bodies = [[inertia[10 * j + k] if j < given else cs.SX(0.0) for k in range(10)] for j in range(count)]
    _pass_on(chains, segments, sliding, bodies)
    terms = [[joint_terms[k, j] for j in range(count)] for k in range(3)]
    return LegModel(
        q=joints,
        revolute=[not s for s in sliding],
        turns=[Rotation(_turns(chain)) for chain in chains[:count]],
        origin=origin,
        segments=segments,
        inertia=bodies,
        rotor=terms[0],
        viscous=terms[1],
        coulomb=terms[2],
        actuated=tuple(joint for owner, joint in description.actuated if owner == index),
        axes=description.position_rows,
    )


def origin_inertia(central: cs.SX) -> cs.SX:
    """Parameters about the frames' origins (DynPar 2) from those about the centres of mass (DynPar 1)."""
    converted = []
    for start in range(0, central.numel(), 10):
        xx, xy, xz, yy, yz, zz, cx, cy, cz, m = (central[start + k] for k in range(10))
        mx, my, mz = m * cx, m * cy, m * cz
        converted += [xx + my * cy + mz * cz, xy - mx * cy, xz - mx * cz]
        converted += [yy + mx * cx + mz * cz, yz - my * cz, zz + mx * cx + my * cy, mx, my, mz, m]
    return cs.vertcat(*converted)


def _turns(chain: Sequence[tuple[int, cs.SX]]) -> list[Turn]:
    """Turns of a chain; neighbouring symbolic angles about one axis become one angle."""
    added: list[tuple[int, cs.SX]] = []
    for axis, angle in chain:
        if angle.is_zero():
            continue
        joined = added and added[-1][0] == axis and not (added[-1][1].is_constant() or angle.is_constant())
        added.append((axis, added.pop()[1] + angle) if joined else (axis, angle))
    return [turn(axis, angle) for axis, angle in added]


def _pass_on(
    chains: list[list[tuple[int, cs.SX]]],
    segments: Sequence[Vector],
    sliding: Sequence[bool],
    bodies: Sequence[Sequence[cs.SX]],
) -> None:
    """Leave a rotation about the axis of a sliding point mass to the next joint, where it joins an angle."""
    for j in range(len(sliding) - 1):
        only_mass = all(value.is_zero() for value in bodies[j][:9])
        if not sliding[j] or not only_mass or not all(value.is_zero() for value in segments[j][:2]):
            continue
        while chains[j] and (chains[j][-1][0] == 2 or chains[j][-1][1].is_zero()):
            chains[j + 1].insert(0, chains[j].pop())


def symbol_of(entry: Entry, geometry: dict[str, cs.SX]) -> cs.SX:
    """The symbol of a named parameter; a number as it is."""
    return geometry[entry.name] if isinstance(entry, Parameter) else cs.SX(entry)


def leg_base(leg: SerialLeg, geometry: dict[str, cs.SX]) -> tuple[Vector, Rotation]:
    """Origin of a leg's base frame, world axes, and the rotation of its axes to world axes, in symbols."""
    position = [symbol_of(entry, geometry) for entry in leg.base_position]
    return position, Rotation(_turns(_base_angles(leg, geometry)))


def _base_angles(leg: SerialLeg, geometry: dict[str, cs.SX]) -> list[tuple[int, cs.SX]]:
    return [("xyz".index(axis), symbol_of(angle, geometry)) for axis, angle in leg.base_rotation]


def coupling_entries(leg: SerialLeg, geometry: dict[str, cs.SX]) -> Vector:
    """kappa of a leg in symbols."""
    return [symbol_of(entry, geometry) for entry in leg.coupling]


def _same_bodies(leg: SerialLeg, other: SerialLeg, complete: bool) -> bool:
    if complete:
        same_table, count = type(leg) is type(other) and leg.rows == other.rows, None
        same_table = same_table and len(leg.bodies) == len(other.bodies)
        same_table = same_table and getattr(leg, "parents", ()) == getattr(other, "parents", ())
    else:
        same_table, count = leg.n == other.n and leg.rows[: leg.n + 1] == other.rows[: leg.n + 1], leg.n
    if not same_table:
        return False
    pairs = zip(leg.bodies[:count], other.bodies[:count], strict=True)
    return all(np.array_equal(a.vector, b.vector) for a, b in pairs)


def _central(body: BodyInertia) -> np.ndarray:
    """(10,) DynPar 1."""
    if body.mass == 0 and body.first_moment.any():
        raise InputError(
            "DynPar 1: a body without mass has no centre of mass, but its first moment is not zero"
        )
    center, about = central_inertia(body)
    return np.concatenate([about[np.triu_indices(3)], center, [body.mass]])
