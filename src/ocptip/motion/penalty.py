"""The motion problem as a function of ramp parameters, with limits as linear penalties (5.38).

The formulation of the source (5.6, 5.7), which searches without derivatives; the planner of this package does
not use it. Here it serves to compare search methods on one and the same fast model.

Parameters p, for each optimised joint with K commands: target, speed, acceleration of commands 1 .. K - 1,
then speed and acceleration of the last one, whose target is the goal: 3 K - 1 numbers, all in units of their
bounds: 0 at the lower, 1 at the upper one. Bounds are

- targets: between start and goal and at most `DETOUR` beyond, inside the joint's limits;
- speeds: `LEAST_SPEED` to 100 % of the joint's limit;
- accelerations: `LEAST_ACCELERATION` to 100 % of the joint's limit.

They contain every motion of :func:`ocptip.motion.starts.random_start`. Cost G is the electric energy in J.
Limits are C(p) <= 0, one entry for GN and for GT (pure numbers), one for each pair of collision spheres (m),
two for each joint's torque (N m) and two for each optimised joint's angle (rad). The last ones replace
(5.36): the greatest and least angle of the motion, reversals included, are known exactly, and that they keep
the limits is the same as that the acceleration is large enough to turn in time.

Of quantities that vary in time the maximum is asked for. Two ways to find it:

- "sides": values at the Gauss nodes of the cost and at the ends of each interval between events, from
  inside;
- "spline" (5.6.2): values at the Gauss nodes, and the maxima of a cubic spline through all of them, from
  start to end (torques, which jump at events: one cubic for each interval between events). Reserves jump at
  events, too: the spline overshoots there, and refuses motions that are near the limits but keep them.

Neither is a proof. GT comes from an exact solver for contacts in one plane, see `_PlanarSlip`; where that
does not apply (contacts lift off, slip, carry nothing, or do not lie in one plane), from
`ocptip.reserves.Slip`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.optimize import Bounds

from ocptip.compiled import compiled
from ocptip.contact import ContactStates, Support
from ocptip.errors import InputError, finite_array, positive_number
from ocptip.motion.passive import ArmMotion, earliest_end, passive_command
from ocptip.motion.proof import INSIDE
from ocptip.motion.ramps import JointRamps, RampCommand
from ocptip.motion.starts import DETOUR, random_start
from ocptip.motion.task import MotionTask, require_plannable
from ocptip.reserves.force_sets import LOAD_TOLERANCE, ForceSets, force_scale
from ocptip.robots import BatchFunction

LEAST_SPEED = 0.001
"""Lower bound of speeds as a share of the joint's limit; the planner lets joints all but rest."""

LEAST_ACCELERATION = 0.002
"""Lower bound of accelerations as a share of the joint's limit; random starts go down to 1 / 360."""

WEIGHT = 1e3
"""S of (5.38); the source gives 1e3 to 1e4. In trials the lower one served Nelder-Mead better."""

Between = Literal["spline", "sides"]

_ORDER = 4  # Gauss nodes per interval
_NEAR = 0.02  # m: sphere pairs that stay farther apart than this at all nodes are not interpolated
_UNSOLVED = 10.0  # GN and GT where no contact state is known
_GAP = 1e-8  # of GT, relative: between the bounds of a certified value
_STEPS = 60  # Newton steps
_NOISE = 1e-10  # relative


@dataclass(frozen=True, eq=False)
class PenaltyValue:
    """The problem at one p.

    Attributes:
        energy: G, J.
        limits: C, (m,); kept where <= 0; order and units see the module.
        cost: G + S sum max(0, C).
        duration: s.
    """

    energy: float
    limits: np.ndarray
    cost: float
    duration: float

    @property
    def feasible(self) -> bool:
        """All limits are kept, as far as this formulation sees."""
        return bool(np.all(self.limits <= 0))


class MotionPenalty:
    """Cost and limits of a task as functions of p; calling it gives the penalised cost (5.38).

    Args:
        task: a plannable task.
        weight: S, J per unit of the limits.
        between: how maxima in time are found, see the module.

    Attributes:
        size: number of parameters.
        bounds: of p: 0 and 1.
        lower, upper: (size,), the parameters' bounds in rad, rad/s, rad/s^2.

    Raises:
        InputError: the task cannot be planned, or an argument cannot be used.
    """

    def __init__(self, task: MotionTask, *, weight: float = WEIGHT, between: Between = "sides") -> None:
        require_plannable(task)
        if between not in get_args(Between):
            raise InputError(f"between: expected one of {get_args(Between)}, got {between!r}")
        self.task, self.weight, self.between = task, positive_number("weight", weight), between
        self.robot = task.robot
        self.lower, self.upper = self._parameter_bounds()
        self.size = len(self.lower)
        self.bounds = Bounds(np.zeros(self.size), np.ones(self.size))
        limit = self.robot.arm.limits
        self._passive = [j for j in range(self.robot.arm.n) if j not in task.optimised]
        self._end_at_least = float(
            np.max(
                earliest_end(
                    (task.goal - task.start)[self._passive],
                    limit.speed[self._passive],
                    limit.acceleration[self._passive],
                ),
                initial=0.0,
            )
        )
        collision = self.robot.collision
        self._gaps = BatchFunction(collision.function) if collision.labels else None
        self._planar_slip = _PlanarSlip.of(self.robot.support)

    # --- parameters and motions ---------------------------------------------------------------------------

    def motion(self, p: ArrayLike) -> ArmMotion:
        """The motion of parameters p, (size,); beyond 0 and 1 they are taken at their bound."""
        task, limit = self.task, self.robot.arm.limits
        p = np.clip(finite_array("p", p, (self.size,)), 0.0, 1.0)
        values = (self.lower + p * (self.upper - self.lower)).reshape(len(task.optimised), -1).tolist()
        joints: list[JointRamps | None] = [None] * self.robot.arm.n
        for joint, own in zip(task.optimised, values, strict=True):
            own.insert(len(own) - 2, float(task.goal[joint]))
            commands = [RampCommand(*own[k : k + 3]) for k in range(0, len(own), 3)]
            joints[joint] = JointRamps.from_commands(float(task.start[joint]), commands)
        end = max(self._end_at_least, *(joint.end for joint in joints if joint is not None))
        for j in self._passive:
            start, goal = float(task.start[j]), float(task.goal[j])
            command = passive_command(start, goal, end, float(limit.speed[j]), float(limit.acceleration[j]))
            joints[j] = JointRamps.from_commands(start, [command])
        return ArmMotion(tuple(joints))

    def parameters(self, motion: ArmMotion) -> np.ndarray:
        """The parameters of a motion's commands, (size,), not cut at the bounds; the inverse of `motion`.

        Raises:
            InputError: an optimised joint of the motion has another number of commands.
        """
        values: list[float] = []
        for joint in self.task.optimised:
            commands = motion.joints[joint].commands
            if len(commands) != self.task.commands:
                raise InputError(
                    f"motion: joint {joint + 1} has {len(commands)} commands, must be {self.task.commands}"
                )
            own = [number for c in commands for number in (c.phi_e, c.speed, c.acceleration)]
            del own[-3]
            values += own
        return (np.array(values) - self.lower) / (self.upper - self.lower)

    def random_start(self, number: int, seed: int) -> np.ndarray:
        """Parameters of the planner's random start of that number, (size,); see `ocptip.motion.starts`."""
        task = self.task
        rng = np.random.default_rng([seed, number])
        motion = random_start(
            task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng
        )
        return np.clip(self.parameters(motion), 0.0, 1.0)

    def _parameter_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        task, limit = self.task, self.robot.arm.limits
        lower: list[float] = []
        upper: list[float] = []
        for j in task.optimised:
            ends = task.start[j], task.goal[j]
            low = max(limit.angle_min[j], min(ends) - DETOUR)
            high = min(limit.angle_max[j], max(ends) + DETOUR)
            slow = [LEAST_SPEED * limit.speed[j], LEAST_ACCELERATION * limit.acceleration[j]]
            fast = [limit.speed[j], limit.acceleration[j]]
            lower += (task.commands - 1) * [low, *slow] + slow
            upper += (task.commands - 1) * [high, *fast] + fast
        return np.array(lower), np.array(upper)

    # --- cost and limits ----------------------------------------------------------------------------------

    def __call__(self, p: ArrayLike) -> float:
        """Penalised cost (5.38), J."""
        return self.evaluate(p).cost

    def evaluate(self, p: ArrayLike) -> PenaltyValue:
        """Cost and limits at p, (size,)."""
        return self.of_motion(self.motion(p))

    def of_motion(self, motion: ArmMotion) -> PenaltyValue:
        """Cost and limits of any motion of the task."""
        robot, bound = self.robot, self.task.limits
        nodes, weights = motion.quadrature(_ORDER)
        times = nodes
        if self.between == "sides":
            left, right = motion.intervals.T
            inside = np.minimum(INSIDE, 0.25 * (right - left))
            times = np.concatenate([nodes, left + inside, right - inside])
        if not len(times):  # a task whose goal is its start, done without moving
            times, weights = np.zeros(1), np.zeros(0)
        q, qd, qdd = motion.states(times)
        torques, wrenches = robot.loads(q, qd, qdd)
        count = len(weights)
        energy = float(weights @ np.sum(robot.motors.power(torques[:count], qd[:count]), axis=1))
        states = robot.contact_states(wrenches)
        GN, GT = robot.tip_over.evaluate(states).GN, self._slip(states)
        gaps = self._gaps(q)[0] if self._gaps else np.empty((len(times), 0))
        columns = np.column_stack([np.nan_to_num(GN, nan=_UNSOLVED), GT, -gaps])
        if self.between == "spline" and count:
            worst = _spline_maxima(times, columns, motion.end, -bound.clearance - _NEAR)
            high, low = _piecewise_maxima(torques)
        else:
            worst, high, low = columns.max(axis=0), torques.max(axis=0), torques.min(axis=0)
        allowed = bound.torque_ratio * robot.arm.limits.torque
        joints = list(self.task.optimised)
        least, greatest = np.array([motion.joints[joint].angle_range for joint in joints]).T
        limits = np.concatenate(
            [
                worst - np.array([bound.GN, bound.GT, *[-bound.clearance] * gaps.shape[1]]),
                high - allowed,
                -low - allowed,
                greatest - robot.arm.limits.angle_max[joints],
                robot.arm.limits.angle_min[joints] - least,
            ]
        )
        cost = energy + self.weight * float(np.sum(np.maximum(limits, 0.0)))
        return PenaltyValue(energy, limits, cost, motion.end)

    def _slip(self, states: ContactStates) -> np.ndarray:
        """GT, (N,)."""
        GT = np.full(len(states), np.nan)
        if self._planar_slip:
            GT = self._planar_slip(states)
        rest = np.flatnonzero(~np.isfinite(GT))
        if len(rest):
            GT[rest] = self.robot.slip.evaluate(states.select(rest), derivatives=False).GT
        return np.nan_to_num(GT, nan=_UNSOLVED)


def _spline_maxima(times: np.ndarray, columns: np.ndarray, end: float, near: float) -> np.ndarray:
    """Maxima over [0, end] of cubic splines through the columns (N, m); columns below `near` as they are."""
    worst = columns.max(axis=0)
    used = np.flatnonzero(worst > near)
    pieces = CubicSpline(times, columns[:, used])
    edges = np.maximum(pieces(np.array([0.0, end])).max(axis=0), worst[used])
    a, b, c, d = pieces.c
    length = np.diff(times)[:, None]
    root = b * b - 3 * a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        # the root of the derivative at which it falls, in the form without cancellation
        x = np.where(b <= 0, c / (-b + np.sqrt(root)), (-b - np.sqrt(root)) / (3 * a))
        inner = np.where((x > 0) & (x < length), d + x * (c + x * (b + x * a)), -np.inf)
    worst[used] = np.maximum(edges, np.fmax.reduce(inner, axis=0))
    return worst


def _node_cubics() -> np.ndarray:
    """Values at the Gauss nodes to coefficients of 1, x, x^2, x^3 on [-1, 1], (4, 4)."""
    x, _ = np.polynomial.legendre.leggauss(_ORDER)
    return np.linalg.inv(np.vander(x, increasing=True))


_CUBICS = _node_cubics()


def _piecewise_maxima(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Maxima and minima (n,) of the cubics through the four nodes of each interval; values (4 S, n)."""
    d, c, b, a = np.tensordot(_CUBICS, values.reshape(-1, _ORDER, values.shape[1]), axes=(1, 1))
    edges = d + b + c + a, d + b - c - a
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - 3 * a * c)
        big = -b - np.where(b < 0, -root, root)
        inner = []
        for x in (big / (3 * a), c / big):
            inner.append(np.where(np.abs(x) < 1, d + x * (c + x * (b + x * a)), np.nan))
    points = np.concatenate([values, *edges, *inner])
    return np.fmax.reduce(points, axis=0), np.fmin.reduce(points, axis=0)


class _PlanarSlip:
    """GT of standing states on contacts in one plane that all carry friction, exact.

    Tangential forces f_i (2,) at n contacts balance a load h of three components: sum J_i' f_i = h with J_i
    (2, 3). The least largest usage |f_i| / l_i is, by duality, the largest ratio of h . u to sum l_i |J_i u|
    over planar motions u: the power of the load against the friction of contacts that all slide. The maximum
    is at a rotation about a contact or at a smooth point, found by Newton steps on half the square of the
    friction's power minus h . u, which is convex. The value is returned if the two sides meet.
    """

    def __init__(self, support: Support, basis: np.ndarray) -> None:
        self.basis = basis
        self._sets = ForceSets(support)
        pivots = np.cross(basis[:, 0], basis[:, 1])
        self._pivots = pivots / np.linalg.norm(pivots, axis=1, keepdims=True)

    @classmethod
    def of(cls, support: Support) -> _PlanarSlip | None:
        """For this support, None where its contacts are not of that kind."""
        if support.dimension != 3:
            return None
        scaling = np.repeat([1.0, 1.0 / support.length], 3)
        matrix = (scaling[:, None] * support.wrench_matrix).reshape(6, -1, 3)[:, :, 1:].reshape(6, -1)
        _, s, vt = np.linalg.svd(matrix)
        if np.sum(s > 1e-9 * s[0]) != 3:
            return None
        basis = np.ascontiguousarray(vt[:3].T.reshape(-1, 2, 3))
        lengths = np.linalg.norm(np.cross(basis[:, 0], basis[:, 1]), axis=1)
        return cls(support, basis) if np.all(lengths > 1e-9) else None

    def __call__(self, states: ContactStates) -> np.ndarray:
        """GT, (N,), NaN where this method does not apply or its value is not certified."""
        GT = np.full(len(states), np.nan)
        rows = np.flatnonzero(states.persistent)
        forces = states.contact_forces[rows]
        scale = force_scale(states)[rows]
        limits = self._sets.limits(forces[:, :, 0], scale).value
        good = np.all(limits > LOAD_TOLERANCE * np.maximum(scale, limits.max(axis=1))[:, None], axis=1)
        if good.any():
            rows, forces, limits = rows[good], forces[good, :, 1:], limits[good]
            loads = np.einsum("sik,ikr->sr", forces, self.basis)
            GT[rows] = _least_usages(loads, limits, self.basis, self._pivots)
        return GT


@compiled
def _least_usages(loads, limits, basis, pivots):
    """Least largest usage for loads (N, 3), friction limits (N, n), basis J (n, 2, 3), pivots (n, 3).

    NaN where the bounds did not meet.
    """
    count, n = limits.shape
    result = np.full(count, np.nan)
    hessian, gradient, error = np.empty((3, 3)), np.empty(3), np.empty(3)
    u, d, v = np.empty(3), np.empty(3), np.empty((n, 3))
    for s in range(count):
        load, limit = loads[s], limits[s]
        size, largest = 0.0, 0.0
        for r in range(3):
            size += load[r] * load[r]
        for i in range(n):
            largest = max(largest, limit[i])
        if np.sqrt(size) <= 1e-12 * largest:
            result[s] = 0.0
            continue
        if _best_pivot(load, limit, basis, pivots, v, u, d):
            result[s] = _slide(limit, basis, u, v)
            continue
        # leave the pivot the way its contact is pulled, as far as the value falls
        value = _value(load, limit, basis, u, v)
        factor = np.sqrt(_power(u, u))
        for _ in range(60):
            _add(u, factor, d)
            below = _value(load, limit, basis, u, v) < value
            if below:
                break
            _add(u, -factor, d)
            factor *= 0.5
        for _ in range(_STEPS):
            friction = _slide(limit, basis, u, v)
            gradient[:] = 0.0
            hessian[:] = 0.0
            least = np.inf
            for i in range(n):
                speed = v[i, 2]
                least = min(least, speed)
                if speed == 0.0:
                    break
                x, y = v[i, 0] / speed, v[i, 1] / speed
                for r in range(3):
                    gradient[r] += limit[i] * (x * basis[i, 0, r] + y * basis[i, 1, r])
                    across = limit[i] / speed * (x * basis[i, 1, r] - y * basis[i, 0, r])
                    for c in range(3):
                        hessian[r, c] += across * (x * basis[i, 1, c] - y * basis[i, 0, c])
            if least == 0.0:
                break
            lower, upper = _power(load, u) / friction, 0.0
            for r in range(3):
                error[r] = friction * gradient[r] - load[r]
                for c in range(3):
                    hessian[r, c] = friction * hessian[r, c] + gradient[r] * gradient[c]
            # all forces at the usage `friction`, then corrected (J is orthonormal) to balance the load
            for i in range(n):
                x = friction * limit[i] * v[i, 0] / v[i, 2] - _power(basis[i, 0], error)
                y = friction * limit[i] * v[i, 1] / v[i, 2] - _power(basis[i, 1], error)
                upper = max(upper, np.sqrt(x * x + y * y) / limit[i])
            if upper - lower <= _GAP * max(1.0, upper):
                result[s] = upper
                break
            _solve_3(hessian, error, d)
            slope = _power(error, d)
            value = 0.5 * friction * friction - _power(load, u)
            factor = 1.0
            _add(u, -1.0, d)
            if slope > _NOISE * abs(value):  # nearer to the optimum the value cannot tell a good step
                while factor > 1e-9 and _value(load, limit, basis, u, v) > value - 0.2 * factor * slope:
                    factor *= 0.5
                    _add(u, factor, d)
    return result


@compiled
def _best_pivot(load, limit, basis, pivots, v, u, pull):
    """Puts into u the best rotation about a contact; True if it is the optimum, else pull is the way out.

    u is scaled so that the friction's power is the usage.
    """
    n = len(limit)
    best, at, side = -1.0, 0, 1.0
    for i in range(n):
        friction = _slide(limit, basis, pivots[i], v)
        power = _power(load, pivots[i])
        if abs(power) > best * friction:
            best, at, side = abs(power) / friction, i, 1.0 if power >= 0 else -1.0
    for r in range(3):
        u[r] = side * pivots[at, r]
    friction = _slide(limit, basis, u, v)
    for r in range(3):
        pull[r] = load[r]
    for i in range(n):
        if i != at:
            share = best * limit[i] / v[i, 2]
            for r in range(3):
                pull[r] -= share * (v[i, 0] * basis[i, 0, r] + v[i, 1] * basis[i, 1, r])
    # the contact turned about has to hold the rest of the load with no more than the others' usage
    first, second = basis[at, 0], basis[at, 1]
    a, b, c = _power(first, first), _power(first, second), _power(second, second)
    x, y = _power(first, pull), _power(second, pull)
    x, y = (c * x - b * y) / (a * c - b * b), (a * y - b * x) / (a * c - b * b)
    force = np.sqrt(x * x + y * y)
    x, y = (c * x - b * y) / (a * c - b * b), (a * y - b * x) / (a * c - b * b)  # moves it along the force
    for r in range(3):
        u[r] *= best / friction
        pull[r] = (x * first[r] + y * second[r]) / max(force, 1e-300)
    return force <= best * limit[at] * (1 + _GAP)


@compiled
def _slide(limit, basis, u, v):
    """Power of the friction in motion u; velocities and speeds of the contacts go to v (n, 3)."""
    total = 0.0
    for i in range(len(limit)):
        v[i, 0], v[i, 1] = _power(basis[i, 0], u), _power(basis[i, 1], u)
        v[i, 2] = np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1])
        total += limit[i] * v[i, 2]
    return total


@compiled
def _value(load, limit, basis, u, v):
    friction = _slide(limit, basis, u, v)
    return 0.5 * friction * friction - _power(load, u)


@compiled
def _power(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _add(u, factor, d):
    for r in range(3):
        u[r] += factor * d[r]


@compiled
def _solve_3(A, b, x):
    """Puts the solution of three equations into x (Cramer's rule)."""
    c0 = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    c1 = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    c2 = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    det = A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2
    e0, e1, e2 = (
        A[1, 2] * b[2] - b[1] * A[2, 2],
        A[1, 1] * b[2] - b[1] * A[2, 1],
        A[1, 0] * b[2] - b[1] * A[2, 0],
    )
    x[0] = (b[0] * c0 + A[0, 1] * e0 - A[0, 2] * e1) / det
    x[1] = (-A[0, 0] * e0 + b[0] * c1 + A[0, 2] * e2) / det
    x[2] = (A[0, 0] * e1 - A[0, 1] * e2 + b[0] * c2) / det
