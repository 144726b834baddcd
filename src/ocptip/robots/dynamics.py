"""Recursive Newton-Euler (2.32 to 2.45): joint torques of a serial arm and its wrench on the base.

Thesis M has turning joints only. A sliding joint i leaves the angular velocity of its link as it is; Q_i
gets the Coriolis and the sliding acceleration, 2 omega x z qd + z qdd, and the drive the force along z.
One definition as CasADi expressions, in link axes with the joint axis along z; NumPy evaluates the same
function for many states at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.kinematics import joint_rates, joint_values, relative_rotation, slide
from ocptip.robots.model import ArmModel, joint_states

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
_CACHED_MODELS = 64
_NONE = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Dynamics:
    """The loads of a motion at N states (no leading N for a single state).

    Attributes:
        torque: (N, n), N m: drive torques, acting on link i about +z_i from link i-1 (2.44); of sliding
            joints the forces along +z_i, N.
        wrench: (N, 6), N and N m, base axes: force, then moment about the given base point, that the arm
            exerts on the base; weight of the arm and process load included.
    """

    torque: np.ndarray
    wrench: np.ndarray


@lru_cache(maxsize=_CACHED_MODELS)
def inverse_dynamics(model: ArmModel, turning: bool = False) -> cs.Function:
    """CasADi function of the inverse dynamics; built once per model, inlines in SX graphs.

    In: `q`, `qd`, `qdd` (n,), rad, rad/s, rad/s^2 (sliding joints: m for rad); `gravity` (3,), m/s^2, base
    axes; `force`, `moment` (3,), N, N m, base axes: load on the gripper at G besides the process of the
    model; `about` (3,), m, base frame: reference point of the base moment; of a base that is `turning` also
    `spin` (3,), rad/s, and `spin_change` (3,), rad/s^2, base axes, and the mount is then accelerated by minus
    `gravity`. Out: `torque` (n,), N m (N); `wrench` (6,), on the base, see :class:`Dynamics`.
    """
    n = model.n
    q, qd, qdd = (cs.SX.sym(name, n) for name in ("q", "qd", "qdd"))
    gravity, force, moment, about = (cs.SX.sym(name, 3) for name in ("gravity", "force", "moment", "about"))
    spin, change = (cs.SX.sym(name, 3) if turning else None for name in ("spin", "spin_change"))
    torque, wrench = newton_euler(
        model, q, qd, qdd, gravity, force, moment, about, spin=spin, spin_change=change
    )
    names = ["q", "qd", "qdd", "gravity", "force", "moment", "about", *["spin", "spin_change"] * turning]
    inputs = [q, qd, qdd, gravity, force, moment, about, *[rate for rate in (spin, change) if turning]]
    return cs.Function("inverse_dynamics", inputs, [torque, wrench], names, ["torque", "wrench"])


def newton_euler(
    model: ArmModel,
    q: cs.SX,
    qd: cs.SX,
    qdd: cs.SX,
    gravity: cs.SX,
    force: cs.SX,
    moment: cs.SX,
    about: cs.SX,
    *,
    scales: cs.SX | None = None,
    shifts: cs.SX | None = None,
    carried: Sequence[tuple[cs.SX, cs.SX, np.ndarray]] = (),
    spin: cs.SX | None = None,
    spin_change: cs.SX | None = None,
) -> tuple[cs.SX, cs.SX]:
    """The recursion as expressions; arguments and results as in :func:`inverse_dynamics`.

    Further, `scales` (links,): factors of the links' masses and inertias; `shifts` (3, links): of their
    centres of mass, m, in their frames; `carried`: bodies fixed to the last link, each with mass, centre of
    mass (3,) and inertia (3, 3) about it in that link's frame. A base that turns has a `spin` (rad/s) and its
    change (rad/s^2), (3,) in base axes; Q_1 is then accelerated by minus `gravity`.
    """
    relative, levers, motions = _link_motions(model, q, qd, qdd, gravity, spin, spin_change)
    count = model.links
    inertial_force, inertial_moment = [], []
    chain_bodies, held = process_parts(model)
    load, load_moment = force + chain_bodies[:3], moment + chain_bodies[3:]
    for index, (A, (acceleration, omega, domega)) in enumerate(zip(relative, motions, strict=True)):
        centre, inertia = cs.SX(model.centres[index]), cs.SX(model.inertias[index])
        mass = model.masses[index]
        if scales is not None:
            mass, inertia = scales[index] * mass, scales[index] * inertia
        if shifts is not None:
            centre = centre + shifts[:, index]
        f, m = cs.SX.zeros(3), cs.SX.zeros(3)  # about Q_i
        for chain_bodies, place, tensor in (
            (mass, centre, inertia),
            *(carried if index == count - 1 else ()),
        ):
            inertial = chain_bodies * (acceleration + _rotating(omega, domega, place))  # (2.35)
            turning = tensor @ domega + cs.cross(omega, tensor @ omega)  # (2.42)
            f, m = f + inertial, m + turning + cs.cross(place, inertial)
        inertial_force.append(f)
        inertial_moment.append(m)
        load, load_moment = A.T @ load, A.T @ load_moment  # process load, now in frame i

    load, load_moment = load + held[:3], load_moment + held[3:]
    F, M = -load, -load_moment  # coupling load behind the last link: what G passes on to the process (2.45)
    needed = [cs.SX(0)] * count
    for index in reversed(range(count)):
        M = inertial_moment[index] + M + cs.cross(levers[index + 1], F)  # (2.43) about Q_i
        F = inertial_force[index] + F  # (2.40)
        needed[index] = (F if model.slides[index] else M)[2]
        F, M = relative[index] @ F, relative[index] @ M
    driven = needed if model.coupling is None else model.coupling.gathered(needed)
    torque = [driven[i] + model.armature[i] * qdd[i] for i in range(model.n)]  # (2.44)
    if model.has_springs:  # they act on the links beside them, so that the wrench is as without them
        torque = [
            torque[i] - model.spring_torque[i] + model.spring_stiffness[i] * q[i] for i in range(model.n)
        ]
    arm = cs.SX(model.mount_position) + levers[0] - about
    return cs.vertcat(*torque), cs.vertcat(-F, -M - cs.cross(arm, F))


def _link_motions(
    model: ArmModel,
    q: cs.SX,
    qd: cs.SX,
    qdd: cs.SX,
    gravity: cs.SX,
    spin: cs.SX | None,
    spin_change: cs.SX | None,
) -> tuple[list[cs.SX], list[cs.SX], list[tuple[cs.SX, cs.SX, cs.SX]]]:
    """A_{i-1,i}, Q_{i-1} to Q_i in frame i-1 (then Q_n to G), and the motions of all links in their frames.

    A motion is the acceleration of Q_i less gravity, then angular velocity and acceleration.
    """
    count, values = model.links, joint_values(model, q)
    speeds, changes = joint_rates(model, qd), joint_rates(model, qdd)
    relative = [relative_rotation(model, index, values[index]) for index in range(count)]
    omega, domega = (cs.SX.zeros(3) if turn is None else turn for turn in (spin, spin_change))
    # Gravity enters as an upward acceleration of the base, so m (r'' - g) of (2.40) needs no second term.
    acceleration = -gravity
    offsets = [cs.SX.zeros(3), *map(cs.SX, model.offsets)]
    levers = [offsets[i] + relative[i] @ slide(model, i, values[i]) for i in range(count)] + offsets[-1:]
    motions = []
    for index, A in enumerate(relative):
        acceleration = A.T @ (acceleration + _rotating(omega, domega, levers[index]))  # of Q_i
        omega, domega = A.T @ omega, A.T @ domega
        rate, change = cs.vertcat(0, 0, speeds[index]), cs.vertcat(0, 0, changes[index])
        if model.slides[index]:
            acceleration = acceleration + 2 * cs.cross(omega, rate) + change
        else:
            domega = domega + cs.cross(omega, rate) + change  # (2.36)
            omega = omega + rate
        motions.append((acceleration, omega, domega))
    return relative, levers, motions


@lru_cache(maxsize=_CACHED_MODELS)
def gripper_motion_function(model: ArmModel, turning: bool = False) -> cs.Function:
    """CasADi function of the motion of the gripper in gripper axes, as bodies in it feel it.

    In: `q`, `qd`, `qdd`, `gravity`, and of a base that is `turning` `spin` and `spin_change`, as in
    :func:`inverse_dynamics`. Out: (9,): acceleration of G less gravity, m/s^2; angular velocity, rad/s, and
    acceleration, rad/s^2.
    """
    q, qd, qdd = (cs.SX.sym(name, model.n) for name in ("q", "qd", "qdd"))
    gravity = cs.SX.sym("gravity", 3)
    spin, change = (cs.SX.sym(name, 3) if turning else None for name in ("spin", "spin_change"))
    _, levers, motions = _link_motions(model, q, qd, qdd, gravity, spin, change)
    acceleration, omega, domega = motions[-1]
    acceleration = acceleration + _rotating(omega, domega, levers[-1])
    turn = cs.SX(model.tool_rotation).T
    result = cs.vertcat(*(turn @ vector for vector in (acceleration, omega, domega)))
    inputs = [q, qd, qdd, gravity, *(vector for vector in (spin, change) if turning)]
    return cs.Function("gripper_motion", inputs, [result])


@lru_cache(maxsize=_CACHED_MODELS)
def _gripper_motions(model: ArmModel, turning: bool) -> BatchFunction:
    return BatchFunction(gripper_motion_function(model, turning))


@lru_cache(maxsize=_CACHED_MODELS)
def mass_sensitivities(model: ArmModel) -> BatchFunction:
    """Loads for other masses and centres of mass, and what they change per unit of each.

    In: `q`, `qd`, `qdd` (n,); `gravity` (3,), `about` (3,) as in :func:`inverse_dynamics`; `changes` (4 L +
    1,): relative changes of the links' masses and inertias, shifts of their centres of mass (x, y, z of link
    1, of link 2, ...), m, link frames, and a point mass at the TCP, kg. Out: `loads` (n + 6,): torques, then
    the wrench on the base; `slopes` (n + 6, 4 L + 1).
    """
    q, qd, qdd = (cs.SX.sym(name, model.n) for name in ("q", "qd", "qdd"))
    gravity, about = cs.SX.sym("gravity", 3), cs.SX.sym("about", 3)
    count = model.links
    changes = cs.SX.sym("changes", 4 * count + 1)
    none = cs.SX.zeros(3)
    torque, wrench = newton_euler(
        model, q, qd, qdd, gravity, none, none, about,
        scales=1 + changes[:count],
        shifts=cs.reshape(changes[count:-1], 3, count),
        carried=[(changes[-1], cs.SX(model.offsets[-1]), np.zeros((3, 3)))],
    )  # fmt: skip
    loads = cs.vertcat(torque, wrench)
    outputs = [loads, cs.jacobian(loads, changes)]
    names = ["q", "qd", "qdd", "gravity", "about", "changes"], ["loads", "slopes"]
    inputs = [q, qd, qdd, gravity, about, changes]
    return BatchFunction(cs.Function("mass_sensitivities", inputs, outputs, *names))


@lru_cache(maxsize=_CACHED_MODELS)
def small_motions(model: ArmModel, springs: tuple[int, ...] = ()) -> BatchFunction:
    """What it takes to move the base of an arm, and some of its joints, a little beside what they do.

    The d = 6 + m small motions are the base's (of the point `about`, then its turning, base axes) and those
    of the m joints `springs`, from 0. What they take, to first order, are force and moment on the base about
    `about` and torques of these joints.

    In: `q`, `qd`, `qdd` (n,), rad, rad/s, rad/s^2; `gravity` (3,), m/s^2, `about` (3,), m, base axes. Out:
    `inertia` (d, d), per acceleration; `gyration` (d, 3 + m), per angular velocity of the base and speed of
    the joints; `stiffening` (d, m), per motion of the joints. That weight turns with the base is not in it.
    """
    q, qd, qdd = (cs.SX.sym(name, model.n) for name in ("q", "qd", "qdd"))
    gravity, about, twist = cs.SX.sym("gravity", 3), cs.SX.sym("about", 3), cs.SX.sym("twist", 9)
    acceleration, spin_change, spin = twist[:3], twist[3:6], twist[6:]
    acceleration = acceleration + cs.cross(spin_change, cs.SX(model.mount_position) - about)
    none = cs.SX.zeros(3)
    torque, wrench = newton_euler(
        model, q, qd, qdd, gravity - acceleration, none, none, about, spin=spin, spin_change=spin_change
    )
    small_values = [cs.vertcat(*(values[j] for j in springs)) for values in (torque, qdd, qd, q)]
    slopes = cs.jacobian(cs.vertcat(-wrench, small_values[0]), cs.vertcat(twist, *small_values[1:]))
    slopes, m = cs.substitute(slopes, twist, cs.SX.zeros(9)), len(springs)
    inertia, gyration = cs.horzcat(slopes[:, :6], slopes[:, 9 : 9 + m]), slopes[:, 6:9]
    outputs = [inertia, cs.horzcat(gyration, slopes[:, 9 + m : 9 + 2 * m]), slopes[:, 9 + 2 * m :]]
    names = ["q", "qd", "qdd", "gravity", "about"], ["inertia", "gyration", "stiffening"]
    return BatchFunction(cs.Function("small_motions", [q, qd, qdd, gravity, about], outputs, *names))


def evaluate_dynamics(
    model: ArmModel,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    *,
    gravity: ArrayLike = STANDARD_GRAVITY,
    force: ArrayLike = (0.0, 0.0, 0.0),
    moment: ArrayLike = (0.0, 0.0, 0.0),
    about: ArrayLike = (0.0, 0.0, 0.0),
    base_motion: BaseMotion | None = None,
) -> Dynamics:
    """Joint torques and base wrench at many states.

    Args:
        q, qd, qdd: (N, n) or (n,), rad, rad/s, rad/s^2 (sliding joints: m for rad).
        gravity: (3,), m/s^2, base axes.
        force, moment: (3,) or (N, 3), N and N m, base axes: load on the gripper at G besides the process of
            the model.
        about: (3,), m, base frame: reference point of the base moment.
        base_motion: of the base; default: it rests.

    Raises:
        InputError: wrong shapes or not finite.
    """
    states, single = joint_states("q", q, model.n)
    count = len(states)
    rates = []
    for name, value in (("qd", qd), ("qdd", qdd)):
        array = joint_states(name, value, model.n)[0]
        if len(array) != count:
            raise InputError(f"{name}: expected {count} states as in q, got {len(array)}")
        rates.append(array)
    loads = []
    for name, value in (("force", force), ("moment", moment)):
        loads.append(finite_array(name, value, (3,) if np.ndim(value) < 2 else (count, 3)))
    down, point = finite_array("gravity", gravity, (3,)), finite_array("about", about, (3,))
    (speeds, accelerations), (push, turn) = rates, loads
    dynamics = dynamics_of_states(model, states, speeds, accelerations, down, point, push, turn, base_motion)
    return Dynamics(dynamics.torque[0], dynamics.wrench[0]) if single else dynamics


def dynamics_of_states(
    model: ArmModel,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    gravity: np.ndarray,
    about: np.ndarray,
    force: np.ndarray = _NONE,
    moment: np.ndarray = _NONE,
    base_motion: BaseMotion | None = None,
) -> Dynamics:
    """The same of N states (N, n) whose arrays are known to fit: checks take as long as a single state."""
    pull, spin = _at_mount(model, gravity, base_motion, len(q))
    torque, wrench = dynamics_batch(model, bool(spin))(q, qd, qdd, pull, force, moment, about, *spin)
    return Dynamics(torque, wrench)


def gripper_motion(
    model: ArmModel,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    gravity: np.ndarray,
    base_motion: BaseMotion | None = None,
) -> BaseMotion:
    """The motion of the gripper at states (N, n) in gripper axes, its acceleration less gravity.

    Its inertial wrench on a body in the gripper is then that of inertia and weight.

    Args:
        model: of the arm.
        q, qd, qdd: rad, rad/s, rad/s^2 (sliding joints: m for rad).
        gravity: (3,), m/s^2, base axes.
        base_motion: of the base; default: it rests.
    """
    pull, spin = _at_mount(model, gravity, base_motion, len(q))
    (result,) = _gripper_motions(model, bool(spin))(q, qd, qdd, pull, *spin)
    return BaseMotion(result[:, :3], result[:, 3:6], result[:, 6:])


def _at_mount(
    model: ArmModel, gravity: np.ndarray, base_motion: BaseMotion | None, count: int
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Gravity less the acceleration of the mount; spin and its change where the base turns."""
    if base_motion is None:
        return gravity, []
    rows = base_motion.rows(count)
    pull = gravity - base_motion.acceleration_at(model.mount_position)
    return pull, [rows[:, 3:6], rows[:, 6:]] if base_motion.turns else []


@lru_cache(maxsize=_CACHED_MODELS)
def dynamics_batch(model: ArmModel, turning: bool = False) -> BatchFunction:
    """`inverse_dynamics` for many states at once, without input checks."""
    return BatchFunction(inverse_dynamics(model, turning))


def process_parts(model: ArmModel) -> tuple[np.ndarray, np.ndarray]:
    """The model's process about G, (6,) each, N and N m: in base axes, and in those of the last link.

    Raises:
        InputError: it varies.
    """
    none, process = np.zeros(6), model.process
    if process is None:
        return none, none
    if not process.turns_with_tool:
        return process.wrench, none
    return none, (process.wrench.reshape(2, 3) @ model.tool_rotation.T).ravel()


def _rotating(omega: cs.SX, domega: cs.SX, lever: cs.SX) -> cs.SX:
    """Acceleration of a point at `lever` relative to the frame's origin."""
    return cs.cross(domega, lever) + cs.cross(omega, cs.cross(omega, lever))
