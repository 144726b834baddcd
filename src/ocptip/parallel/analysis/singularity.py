"""Singular poses: of a leg (type I), of the platform (type II), of the Euler angles (thesis P, 5.5.3).

Type I: the Jacobian of one leg loses rank, the platform loses a motion. Type II: locked motors no longer hold
the platform, motor forces grow without bound. Both measures are made comparable by a characteristic length L:
angles count as lengths L times angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ocptip.basics.errors import InputError, OcptipError, SolverError
from ocptip.parallel.description.robot_description import REVOLUTE, RobotDescription
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion

SINGULAR = 1e-3
"""Measures below this count as singular.

The measures are ratios of speeds at the size of the platform, near a singular pose the angle to it in rad. At
1e-3, 0.06 degrees or a millimetre per metre, motor forces or joint rates are a thousand times those of a
well-conditioned pose: clearances and tolerances of a machine then decide, not this model.
"""


_ABOUT = 0.3
_POSES = 12
_SEED = 11


@dataclass(frozen=True, eq=False)
class ImplicitPair:
    """A s' = diag(b) q_a', smooth through singular poses of both types.

    Attributes:
        A: (n_a, m); det A = 0 is type II.
        b: (n_a,); b_i = 0 is type I of motor i's leg.
    """

    A: np.ndarray
    b: np.ndarray


@dataclass(frozen=True, eq=False)
class Screw:
    """A motion of the platform, world axes.

    Attributes:
        direction: (3,), unit vector of the rotation axis, or of a pure translation.
        point: (3,), m, of the axis nearest the platform's origin; None for a translation.
        pitch: m per rad along the axis; infinite for a translation.
    """

    direction: np.ndarray
    point: np.ndarray | None
    pitch: float

    def __str__(self) -> str:
        direction = (np.round(self.direction, 3) + 0.0).tolist()
        if self.point is None:
            return f"translation along {direction}"
        point = (np.round(self.point, 3) + 0.0).tolist()
        return f"rotation about {direction} through {point} m, pitch {round(self.pitch, 4) + 0.0:g} m/rad"


@dataclass(frozen=True, eq=False)
class Singularity:
    """The distance of a pose from singularities.

    Attributes:
        legs: per leg the smallest singular value of its Jacobian, revolute columns divided by L: type I.
        platform: smallest singular value of J_a, angles weighted with L: type II. If a leg is singular, that
            of A with rows of length 1 instead, or infinite without a pair.
        conditioning: smallest to largest singular value of J_a, weighted alike; 0 if a leg is singular.
        representation: smallest singular value of the moving columns of E: Euler angles.
        held: of a platform with dependent coordinates the smallest singular value of what the legs demand of
            its rates: near 0 they no longer hold all others (constraint singularity); else infinite.
        determined: the same of the dependent coordinates' columns: near 0 the free ones do not fix them.
        length: L, m.
        pair: the implicit pair, or None where motors do not act on one force line of their leg.
        kinds: names of what is singular: "leg 2 (type I)", "constraint", "coordinates", "platform (type II)",
            "representation".
    """

    legs: np.ndarray
    platform: float
    conditioning: float
    representation: float
    held: float
    determined: float
    length: float
    pair: ImplicitPair | None
    kinds: tuple[str, ...]

    @property
    def mechanical(self) -> tuple[str, ...]:
        """The kinds of the mechanism, not those of its Euler angles."""
        return tuple(kind for kind in self.kinds if kind != "representation")

    @property
    def regular(self) -> bool:
        """True if nothing is singular."""
        return not self.kinds

    def to_dict(self) -> dict[str, object]:
        """Plain data."""
        measures = {
            name: getattr(self, name) for name in ("platform", "representation", "held", "determined")
        }
        return {
            "legs": self.legs.tolist(),
            **{name: value if np.isfinite(value) else None for name, value in measures.items()},
            "length": self.length,
            "A": None if self.pair is None else self.pair.A.tolist(),
            "b": None if self.pair is None else self.pair.b.tolist(),
            "singular": list(self.kinds),
        }


def characteristic_length(kinematics: Kinematics) -> float:
    """L, m: mean distance of the coupling points from the platform's origin; 1 if all are there."""
    distances = [np.linalg.norm(kappa) for leg in kinematics.legs for kappa in leg.couplings]
    mean = float(np.mean(distances))
    return mean if mean > 0 else 1.0


def singularity(
    kinematics: Kinematics,
    z: np.ndarray,
    q: Sequence[np.ndarray],
    *,
    complete: bool,
    tolerance: float = SINGULAR,
) -> Singularity:
    """Measures of a pose.

    Args:
        kinematics: of the robot.
        z: (m,).
        q: joint positions per leg: all, or up to the coupling points.
        complete: whether `q` holds all joints.
        tolerance: below it a measure counts as singular.
    """
    length = characteristic_length(kinematics)
    legs = np.array([_leg_measure(kinematics, i, q[i], length, complete) for i in range(len(q))])
    moving = kinematics.moving(z, q)
    representation = kinematics.platform.conditioning(moving)
    kinds = [f"leg {i + 1} (type I)" for i in np.flatnonzero(legs < tolerance)]
    platform, held, determined, conditioning = np.inf, np.inf, np.inf, 0.0
    if kinematics.along is not None:
        restraint = kinematics.along.restraint(moving, q, kinematics.platform.pose(moving)[1], length)
        held, determined = restraint.held, restraint.determined
        if held < tolerance:
            kinds.append("constraint")
        elif determined < tolerance:
            kinds.append("coordinates")
    if not kinds:
        motion = kinematics.motion(z, np.zeros(kinematics.m), q, complete=complete)
        platform, largest = platform_measures(kinematics, motion, length)
        conditioning = platform / largest if largest > 0 else 0.0
    pair = implicit_pair(kinematics, z, q) if kinematics.description.coupling_form else None
    if kinds and pair is not None and pair.A.shape[0] == pair.A.shape[1]:
        scaled = pair.A @ _unit_speeds(kinematics, length)
        scaled = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-300)
        platform = float(np.linalg.svd(scaled, compute_uv=False)[-1])
    if platform < tolerance:
        kinds.append("platform (type II)")
    if representation < tolerance:
        kinds.append("representation")
    return Singularity(
        legs, platform, conditioning, representation, held, determined, length, pair, tuple(kinds)
    )


def platform_measures(kinematics: Kinematics, motion: RobotMotion, length: float) -> tuple[float, float]:
    """Smallest and largest of the m singular values of J_a, angles weighted with L.

    With fewer motors than coordinates the smallest is 0.
    """
    J = kinematics.actuated_jacobian(motion)
    weighted = _weighted(kinematics, J @ _unit_speeds(kinematics, length, motion), length)
    values = np.linalg.svd(weighted, compute_uv=False)
    return float(values[-1]) if J.shape[0] >= J.shape[1] else 0.0, float(values[0])


def implicit_pair(kinematics: Kinematics, z: np.ndarray, q: Sequence[np.ndarray]) -> ImplicitPair:
    """A and b of A s' = diag(b) q_a' for robots in coupling-point form.

    With u the force direction against which no other joint of the leg works: A_i = u' U_i, b_i = u' J_B e.
    """
    description = kinematics.description
    _, R = kinematics.pose(z)
    T = kinematics.platform.selection(z)
    rows_used = list(description.position_rows)
    A, b = [], []
    for index, joint in description.actuated:
        leg = kinematics.legs[index]
        J = leg.point_jacobian(q[index], rows_used)
        u = _force_direction(np.delete(J, joint, axis=1))
        A.append(u @ leg.platform_side(R)[rows_used] @ T)
        b.append(u @ J[:, joint])
    return ImplicitPair(np.array(A), np.array(b))


def free_screw(kinematics: Kinematics, z: np.ndarray, q: Sequence[np.ndarray], *, complete: bool) -> Screw:
    """The platform motion of the smallest singular value of J_a, which locked motors resist with minimum
    force.

    Args:
        kinematics, z, q, complete: as for :func:`singularity`; legs must be regular.
    """
    length = characteristic_length(kinematics)
    motion = kinematics.motion(z, np.zeros(kinematics.m), q, complete=complete)
    units = _unit_speeds(kinematics, length, motion)
    weighted = _weighted(kinematics, kinematics.actuated_jacobian(motion) @ units, length)
    s = units @ np.linalg.svd(weighted)[2][-1]
    v, omega = np.split(motion.T @ s, 2)
    spin, speed = np.linalg.norm(omega), np.linalg.norm(v)
    if spin * length <= 1e-6 * speed:
        return Screw(_upright(v / speed), None, np.inf)
    if spin == 0:  # redundant joints alone
        return Screw(np.zeros(3), None, np.inf)
    point = motion.r + np.cross(omega, v) / spin**2
    return Screw(_upright(omega / spin), point, float(omega @ v / spin**2))


def _upright(direction: np.ndarray) -> np.ndarray:
    """The unit vector or its negative: the largest entry positive."""
    return direction * np.sign(direction[np.argmax(np.abs(direction))])


def require_regular(
    kinematics: Kinematics,
    z: np.ndarray,
    q: Sequence[np.ndarray],
    *,
    complete: bool,
    legs_only: bool = False,
) -> None:
    """Refuse a pose in which the dynamics would divide by zero, or nearly so, see `SINGULAR`.

    Args:
        kinematics, z, q, complete: as for :func:`singularity`.
        legs_only: type II is no obstacle (forward dynamics).

    Raises:
        SolverError: naming the leg, or the screw that the motors do not hold, and the measures.
    """
    result = singularity(kinematics, z, q, complete=complete)
    kinds = [kind for kind in result.mechanical if not (legs_only and kind.startswith("platform"))]
    if kinds:
        what = ", ".join(kinds) + _not_held(kinematics, z, q, result, complete=complete)
        raise SolverError(
            f"{kinematics.description.name}: singular pose {np.round(z, 6).tolist()}: {what}; measures: legs "
            f"{result.legs.min():.2g}, platform {result.platform:.2g} (singular: < {SINGULAR:g})"
        )


def singular_everywhere(kinematics: Kinematics) -> str:
    """Why a robot is of no use if no pose about home is regular; "" if one is.

    Checks home, and if that is singular random poses about it, up to 0.3 rad and 0.3 L away.
    """
    home = kinematics.description.home
    rng = np.random.default_rng(_SEED)
    width = np.full(kinematics.m, _ABOUT)
    width[[k for k, i in enumerate(kinematics.platform.indices) if i < 3]] *= characteristic_length(
        kinematics
    )
    start = [leg.home for leg in kinematics.legs]
    q, z, reason = start, home, ""
    for k in range(_POSES):
        if k:
            z = home + width * rng.uniform(-1, 1, kinematics.m)
            try:
                q = kinematics.joints(z, start).q
            except InputError:
                continue
        result = singularity(kinematics, z, q, complete=True)
        if not result.mechanical:
            return ""
        if not k:
            reason = ", ".join(result.mechanical) + _not_held(kinematics, z, q, result, complete=True)
    return f"singular in every checked pose: at home {np.round(home, 6).tolist()} {reason}"


def elimination_order(description: RobotDescription, *, complete: bool = False) -> tuple[int, ...]:
    """The three motors whose forces are most independent at home first, then the others.

    Generated code solves J_a^T tau_a = tau_s by a Schur complement after three motors and three force
    components; both pivots should be far from zero. The natural order for up to three motors, or if the home
    pose cannot be assembled. `complete`: of legs with all their joints.
    """
    m, motors = description.platform.m, len(description.actuated)
    natural = tuple(range(motors))
    if m != motors or m <= 3:
        return natural
    try:
        kinematics = Kinematics(description)
        q = (kinematics.joints if complete else kinematics.point_joints)(description.home).q
    except OcptipError:
        return natural
    motion = kinematics.motion(description.home, np.zeros(m), q, complete=complete)
    columns = kinematics.actuated_jacobian(motion).T
    free = sum(description.platform.mask[:3])
    columns = columns / np.array([1.0] * free + [characteristic_length(kinematics)] * (m - free))[:, None]
    columns = columns / np.linalg.norm(columns, axis=0)
    # The product of both pivots is the whole determinant: neither should be small.
    whole = abs(np.linalg.det(columns))

    def balance(first: tuple[int, ...]) -> float:
        pivot = abs(np.linalg.det(columns[:3, list(first)]))
        return min(pivot, whole / pivot) if pivot > 0 else 0.0

    best = max(combinations(natural, 3), key=balance)
    return (*best, *(k for k in natural if k not in best))


def _not_held(
    kinematics: Kinematics,
    z: np.ndarray,
    q: Sequence[np.ndarray],
    singularity: Singularity,
    *,
    complete: bool,
) -> str:
    """The screw of a type II singularity in words, where the legs are regular."""
    if singularity.platform >= SINGULAR or singularity.legs.min() < SINGULAR:
        return ""
    return f": the motors do not hold the {free_screw(kinematics, z, q, complete=complete)}"


def _leg_measure(kinematics: Kinematics, i: int, q: np.ndarray, length: float, complete: bool) -> float:
    leg = kinematics.legs[i]
    if complete:
        J = leg.jacobian(q)[0].copy()
        columns = leg.free
        if leg.leg.serial:
            J[3:] *= length
    else:
        J = leg.point_jacobian(q, kinematics.description.position_rows)
        columns = list(range(leg.point))
    joints = leg.leg.joint_rows
    scale = [length if joints[c].sigma == REVOLUTE else 1.0 for c in columns]
    singular_values = np.linalg.svd(J[:, columns] / scale, compute_uv=False)
    count = len(columns) - leg.idle
    return float(singular_values[count - 1]) if len(singular_values) >= count else 0.0


def _unit_speeds(kinematics: Kinematics, length: float, motion: RobotMotion | None = None) -> np.ndarray:
    """(m, m): quasi-velocities s' of orthonormal motions, angles counted as lengths by `length`, m.

    `motion` counts for platforms with dependent coordinates only.
    """
    if kinematics.along is not None and motion is not None:
        scale = np.array([1.0] * 3 + [length] * 3)
        return np.linalg.inv(np.linalg.qr(scale[:, None] * motion.T)[1])
    turning = [i >= 3 for i in kinematics.platform.indices]
    redundant = [1.0] * (kinematics.m - len(turning))
    return np.diag([*np.where(turning, 1.0 / length, 1.0), *redundant])


def _weighted(kinematics: Kinematics, J: np.ndarray, length: float) -> np.ndarray:
    """Rows of revolute motors as lengths."""
    turning = [row.sigma == REVOLUTE for row in kinematics.description.motor_rows]
    return J * np.where(turning, length, 1.0)[:, None]


def _force_direction(passive: np.ndarray) -> np.ndarray:
    """A vector orthogonal to the columns (n, n-1): the perpendicular in the plane, or the cross product."""
    n = passive.shape[0]
    if n == 1:
        return np.ones(1)
    if n == 2:
        return np.array([-passive[1, 0], passive[0, 0]])
    return np.cross(passive[:, 0], passive[:, 1])
