"""One leg of a parallel robot in its link frames: joint rates from the coupling point, and the forces back to
it.

Every vector is kept in the frame of its link and passed on by planar rotations. The motion of the coupling
point determines the joint rates (the leg's Jacobian is square). So origins near the platform can take their
acceleration from it instead of from the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as cs

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.symbolic.spatial_sx import (
    BlockSystem,
    Rotation,
    Vector,
    acceleration_matrix,
    dot,
    minus,
    plus,
    scaled,
    spin_moment,
    times,
    unit,
    zero,
)


@dataclass(frozen=True)
class ChainState:
    """Motion of a chain of bodies.

    Attributes:
        rates, accelerations: q' and q''.
        omegas, alphas, matrices, origins: per body, in its frame: angular velocity and acceleration, Om of
            both, and acceleration of the origin minus gravity.
    """

    rates: list[cs.SX]
    accelerations: list[cs.SX]
    omegas: list[Vector]
    alphas: list[Vector]
    matrices: list[list[Vector]]
    origins: list[Vector]


@dataclass(frozen=True)
class DrivenForce:
    """A leg's load, split so that its unactuated joints are free of moments.

    The force F on the platform side cancels the passive moments; `effort` remains at the driven joint. A
    force lambda along `direction` at the coupling point adds `lever` lambda to it.

    Attributes:
        force, direction: world axes.
        effort, lever: of the driven joint.
    """

    force: Vector
    direction: Vector
    effort: cs.SX
    lever: cs.SX


@dataclass
class CouplingLeg:
    """A leg up to its coupling point, which moves its joints.

    Attributes:
        model: the leg; plan: how its code is written.
        arm: of the coupling point on the platform, world axes.
        jacobian, rows: coupling-point velocity (components `rows` in the plan's frame) from the joint rates.
        motion: of all bodies, once moved.
    """

    model: LegModel
    plan: LegPlan
    arm: Vector = field(default_factory=zero)
    motion: ChainState = field(init=False)

    def __post_init__(self) -> None:
        self.jacobian, self.rows = leg_jacobian(self.model, self.plan.frame)

    def move(self, velocity: Vector, acceleration: Vector, gravity: Vector) -> None:
        """Joint rates (3.42) and accelerations from the coupling point, and the motion of all bodies.

        Args:
            velocity, acceleration: of the coupling point, world axes.
            gravity: acceleration of gravity, world axes.
        """
        leg, frame = self.model, self.plan.frame
        to_frame = leg.rotation(frame, 0)
        velocity = to_frame(velocity)
        rates = self.jacobian.solve([velocity[row] for row in self.rows])
        omegas, carried = _angular_velocities(leg, rates)
        still = [cs.SX(0.0)] * leg.size
        coasting = _angular_accelerations(leg, rates, still, carried)
        drift = _drift(leg, rates, omegas, coasting, frame)
        acceleration = to_frame(acceleration)
        accelerations = self.jacobian.solve([acceleration[row] - drift[row] for row in self.rows])
        alphas = _angular_accelerations(leg, rates, accelerations, carried)
        matrices = [acceleration_matrix(w, a) for w, a in zip(omegas, alphas, strict=True)]
        falls = []
        for one in leg.turns:
            gravity = one.inverse(gravity)
            falls.append(gravity)
        tip = minus(acceleration, falls[frame - 1])
        origins = _origins(leg, rates, accelerations, omegas, matrices, falls[0], tip, self.plan)
        self.motion = ChainState(rates, accelerations, omegas, alphas, matrices, origins)

    def force(self) -> Vector:
        """J_B^-T tau_i in world axes: the leg's load as a force at its coupling point, (3.48)."""
        return self._balanced(leg_efforts(self.model, self.motion))

    def row(self, joint: int) -> Vector:
        """Row `joint` of J_B^-1 in world axes: the joint's rate per velocity of the coupling point."""
        return self._balanced([cs.SX(float(j == joint)) for j in range(self.model.size)])

    def driven(self) -> DrivenForce:
        """The load of a leg with one driven joint, split into motor effort and force on the platform.

        No division by the leg's determinant: the lever goes to zero in a singularity of the leg.
        """
        leg, frame = self.model, self.plan.frame
        (driven,) = leg.actuated
        row = self.jacobian.own_row(driven)
        if row is None:
            efforts = leg_efforts(leg, self.motion)
            effort, efforts[driven] = efforts[driven], cs.SX(0.0)
            return DrivenForce(self._balanced(efforts), self.row(driven), effort, cs.SX(1.0))
        matrix = self.jacobian.matrix
        others = [r for r in range(leg.size) if r != row]
        passive = [j for j in range(leg.size) if j != driven]
        column = [matrix[r][driven] for r in range(leg.size)]

        def cancel(moments: Sequence[cs.SX], along: float) -> list[cs.SX]:
            sxes: list[cs.SX] = [cs.SX(along)] * leg.size
            if passive:
                system = BlockSystem([[matrix[r][j] for j in passive] for r in others])
                for r, value in zip(others, system.solve_transposed(moments), strict=True):
                    sxes[r] = value
            return sxes

        direction = cancel([-matrix[row][j] for j in passive], 1.0)
        lever = dot(direction, column)
        if self.plan.inject and can_inject(leg):
            efforts, outer = _backward(leg, self.motion, leg.size, 2, (zero(), zero()))
            force = self._spread(cancel(efforts[1:], 0.0))
            relieved = minus(outer[0], leg.rotation(2, frame)(force))
            (effort, *_), _ = _backward(leg, self.motion, 1, 1, (relieved, zero()))
        else:
            efforts = leg_efforts(leg, self.motion)
            components = cancel([efforts[j] for j in passive], 0.0)
            force = self._spread(components)
            effort = efforts[driven] - dot(column, components)
        to_world = leg.rotation(0, frame)
        return DrivenForce(to_world(force), to_world(self._spread(direction)), effort, lever)

    def _balanced(self, efforts: Sequence[cs.SX]) -> Vector:
        """Force at the coupling point, world axes, that joint efforts balance."""
        force = self._spread(self.jacobian.solve_transposed(efforts))
        return self.model.rotation(0, self.plan.frame)(force)

    def _spread(self, components: Sequence[cs.SX]) -> Vector:
        spread = zero()
        for row, value in zip(self.rows, components, strict=True):
            spread[row] = value
        return spread


def chain_motion(
    leg: LegModel, rates: Sequence[cs.SX], accelerations: Sequence[cs.SX], gravity: Vector
) -> ChainState:
    """Motion of all bodies from joint rates and accelerations; gravity: world axes."""
    omegas, carried = _angular_velocities(leg, rates)
    alphas = _angular_accelerations(leg, rates, accelerations, carried)
    matrices = [acceleration_matrix(w, a) for w, a in zip(omegas, alphas, strict=True)]
    fall, free = leg.turns[0].inverse(gravity), LegPlan(1, leg.size + 1)
    origins = _origins(leg, rates, accelerations, omegas, matrices, fall, zero(), free)
    return ChainState(list(rates), list(accelerations), omegas, alphas, matrices, origins)


def chain_drift(leg: LegModel, rates: Sequence[cs.SX], frame: int) -> tuple[Vector, Vector]:
    """Accelerations at q'' = 0 in the axes of a link frame: of the coupling point, and angular of the last
    body."""
    omegas, carried = _angular_velocities(leg, rates)
    coasting = _angular_accelerations(leg, rates, [cs.SX(0.0)] * leg.size, carried)
    turned = leg.rotation(frame, leg.size)(coasting[-1])
    return _drift(leg, rates, omegas, coasting, frame), turned


def leg_efforts(leg: LegModel, motion: ChainState) -> list[cs.SX]:
    """tau_i of all joints by backward Newton-Euler recursion, (3.14), friction and drives included."""
    return efforts_and_base(leg, motion)[0]


def efforts_and_base(leg: LegModel, motion: ChainState) -> tuple[list[cs.SX], tuple[Vector, Vector]]:
    """The same, and force and moment about link frame 1's origin, in that frame, that the base gives."""
    return _backward(leg, motion, leg.size, 1, (zero(), zero()))


def can_inject(leg: LegModel) -> bool:
    """True if only joint 1 is driven and joint 2 turns about a parallel axis."""
    parallel = leg.size > 1 and all(one.axis == 2 for one in leg.turns[1].turns)
    return leg.actuated == (0,) and parallel and leg.revolute[0] and leg.revolute[1]


def _angular_velocities(leg: LegModel, rates: Sequence[cs.SX]) -> tuple[list[Vector], list[Vector]]:
    """Per body its angular velocity, and before that the previous body's, both in its frame."""
    omega, omegas, carried = zero(), [], []
    for j in range(leg.size):
        before = leg.turns[j].inverse(omega) if j else zero()
        omega = plus(before, scaled(rates[j], unit(2))) if leg.revolute[j] else before
        carried.append(before)
        omegas.append(omega)
    return omegas, carried


def _angular_accelerations(
    leg: LegModel, rates: Sequence[cs.SX], accelerations: Sequence[cs.SX], carried: Sequence[Vector]
) -> list[Vector]:
    alpha, alphas = zero(), []
    for j in range(leg.size):
        alpha = leg.turns[j].inverse(alpha) if j else zero()
        if leg.revolute[j]:
            x, y, _ = carried[j]
            alpha = [alpha[0] + y * rates[j], alpha[1] - x * rates[j], alpha[2] + accelerations[j]]
        alphas.append(alpha)
    return alphas


def _sliding(leg: LegModel, j: int, rate: cs.SX, acceleration: cs.SX, omega: Vector) -> Vector:
    """Acceleration of the origin of frame j (from 0) relative to the point of body j - 1 under it."""
    if leg.revolute[j]:
        return zero()
    return [2 * (omega[1] * rate), -(2 * (omega[0] * rate)), acceleration]


def _drift(
    leg: LegModel, rates: Sequence[cs.SX], omegas: Sequence[Vector], alphas: Sequence[Vector], frame: int
) -> Vector:
    """J_B' q' in the axes of a link frame: acceleration of the coupling point without joint accelerations."""
    still = cs.SX(0.0)
    matrices = [acceleration_matrix(w, a) for w, a in zip(omegas, alphas, strict=True)]
    swing = [times(matrices[j], leg.segments[j]) for j in range(leg.size)]
    slides = [_sliding(leg, j, rates[j], still, omegas[j]) for j in range(leg.size)]
    inward = slides[0]
    for j in range(1, frame):
        inward = plus(leg.turns[j].inverse(plus(inward, swing[j - 1])), slides[j])
    outward = swing[leg.size - 1]
    for j in range(leg.size - 1, frame - 1, -1):
        outward = plus(leg.turns[j](plus(outward, slides[j])), swing[j - 1])
    return plus(inward, outward)


def _origins(
    leg: LegModel,
    rates: Sequence[cs.SX],
    accelerations: Sequence[cs.SX],
    omegas: Sequence[Vector],
    matrices: Sequence[list[Vector]],
    fall: Vector,
    tip: Vector,
    plan: LegPlan,
) -> list[Vector]:
    slides = [_sliding(leg, j, rates[j], accelerations[j], omegas[j]) for j in range(leg.size)]
    origins: list[Vector] = [zero()] * leg.size
    current = plus(scaled(-1, fall), slides[0])
    for j in range(leg.size):
        if j:
            outer = plus(current, times(matrices[j - 1], leg.segments[j - 1]))
            current = plus(leg.turns[j].inverse(outer), slides[j])
        origins[j] = current
    current = leg.rotation(leg.size, plan.frame)(tip)
    for j in range(leg.size - 1, plan.tip - 2, -1):
        current = minus(current, times(matrices[j], leg.segments[j]))
        origins[j] = current
        if j:
            current = leg.turns[j](minus(current, slides[j]))
    return origins


def _backward(
    leg: LegModel, motion: ChainState, start: int, stop: int, outer: tuple[Vector, Vector]
) -> tuple[list[cs.SX], tuple[Vector, Vector]]:
    """Efforts of joints start..stop (from 1, inwards); `outer`: force and moment of body start + 1."""
    force, moment = outer
    efforts: list[cs.SX] = [cs.SX(0.0)] * leg.size
    for j in range(start - 1, stop - 2, -1):
        own_force, own_moment = body_wrench(leg.inertia[j], motion, j)
        if j + 1 < leg.size:
            passed = leg.turns[j + 1](force)
            moment = plus(own_moment, leg.turns[j + 1](moment), cross(leg.segments[j], passed))
            force = plus(own_force, passed)
        else:
            force, moment = own_force, own_moment
        effort = moment[2] if leg.revolute[j] else force[2]
        effort = effort + leg.rotor[j] * motion.accelerations[j] + leg.viscous[j] * motion.rates[j]
        if not leg.coulomb[j].is_zero():
            effort = effort + leg.coulomb[j] * cs.sign(motion.rates[j])
        efforts[j] = effort
    return efforts, (force, moment)


def body_wrench(inertia: Sequence[cs.SX], motion: ChainState, body: int) -> tuple[Vector, Vector]:
    """Force, and moment about the frame's origin, that move and carry one body, in its frame."""
    first, mass = list(inertia[6:9]), inertia[9]
    force = plus(scaled(mass, motion.origins[body]), times(motion.matrices[body], first))
    moment = spin_moment(inertia, motion.omegas[body], motion.alphas[body], motion.matrices[body])
    return force, plus(moment, cross(first, motion.origins[body]))


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

    @property
    def end(self) -> Vector:
        """Coupling point, world axes."""
        end = self.origin
        for j, segment in enumerate(self.segments, start=1):
            end = plus(end, self.rotation(0, j)(segment))
        return end

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
                column = cross(leg.rotation(j, joint)(unit(2)), leg.segments[j - 1])
                swept = leg.turns[j].inverse(plus(swept, column))
            columns.append(plus(swept, cross(axis, beyond)))
    return columns
