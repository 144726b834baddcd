"""A leg of a parallel robot in symbols, and the Jacobian of its coupling point (3.43)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.symbolic.block_solver import BlockSystem
from ocptip.parallel.symbolic.spatial_sx import Rotation, Vector, plus, unit, zero


@dataclass(frozen=True)
class LegModel:
    """A leg up to its coupling point, in symbols.

    Attributes:
        q: joint variables, n of them.
        revolute: per joint; False is prismatic.
        turns: rotation that takes components in link frame j to frame j - 1, j = 1..n; frame 0 is the world.
        origin: of link frame 1, world axes.
        segments: from the origin of link frame j to that of frame j + 1 (n: coupling point), in frame j.
        inertia: per body XX, XY, XZ, YY, YZ, ZZ, MX, MY, MZ, M; zero where eliminated.
        rotor, viscous, coulomb: per joint drive inertia, viscous and Coulomb friction.
        actuated: indices of the driven joints.
        axes: world directions (0, 1, 2) in which the coupling point can move, n of them.
    """

    q: list[cs.SX]
    revolute: list[bool]
    turns: list[Rotation]
    origin: Vector
    segments: list[Vector]
    inertia: list[list[cs.SX]]
    rotor: list[cs.SX]
    viscous: list[cs.SX]
    coulomb: list[cs.SX]
    actuated: tuple[int, ...]
    axes: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of joints n."""
        return len(self.q)

    def rotation(self, to: int, of: int) -> Rotation:
        """Rotation that takes components in frame `of` to components in frame `to`; 0 is the world."""
        if of < to:
            return self.rotation(of, to).inverse
        chain = Rotation()
        for one in self.turns[to:of]:
            chain = chain @ one
        return chain


@dataclass(frozen=True)
class LegPlan:
    """How the code of a leg is written; every plan gives the same values.

    Attributes:
        frame: link frame (1..n) in whose axes the Jacobian is solved.
        tip: the origins of frames tip..n take their acceleration from the coupling point (n + 1: none).
        inject: passive moments are cancelled inside the backward recursion where that is possible.
    """

    frame: int
    tip: int
    inject: bool = False


def leg_jacobian(leg: LegModel, frame: int) -> tuple[BlockSystem, list[int]]:
    """Jacobian of the coupling point in the axes of a link frame, (3.43).

    Args:
        leg: the leg, n joints.
        frame: 1..n.

    Returns:
        The n x n system, and which components of the frame's axes are its rows.

    Raises:
        InputError: the directions in which the coupling point moves are not axes of the frame.
    """
    to_frame = leg.rotation(frame, 0)
    moved = [to_frame(unit(axis)) for axis in leg.axes]
    rows = [k for k in range(3) if any(not v[k].is_zero() for v in moved)]
    if len(rows) != leg.size:
        raise InputError(
            f"leg with {leg.size} joints: the {leg.size} directions of its coupling point must be axes of "
            f"link frame {frame}; give the angles between planar joints as multiples of pi/2, not "
            "as parameters"
        )
    columns = point_columns(leg, frame)
    return BlockSystem([[column[row] for column in columns] for row in rows]), rows


def point_columns(leg: LegModel, frame: int) -> list[Vector]:
    """Velocity of the coupling point per joint rate, in the axes of a link frame (1..n), one per joint."""
    beyond = zero()
    for j in range(leg.size, frame - 1, -1):
        beyond = plus(leg.turns[j](beyond) if j < leg.size else beyond, leg.segments[j - 1])
    columns = []
    for joint in range(1, leg.size + 1):
        axis = leg.rotation(frame, joint)(unit(2))
        if not leg.revolute[joint - 1]:
            columns.append(axis)
        elif joint >= frame:
            reach = zero()
            for j in range(leg.size, joint - 1, -1):
                reach = plus(leg.turns[j](reach) if j < leg.size else reach, leg.segments[j - 1])
            columns.append(leg.rotation(frame, joint)(cross(unit(2), reach)))
        else:
            swept = zero()
            for j in range(joint, frame):
                own = cross(leg.rotation(j, joint)(unit(2)), leg.segments[j - 1])
                swept = leg.turns[j].inverse(plus(swept, own))
            columns.append(plus(swept, cross(axis, beyond)))
    return columns
