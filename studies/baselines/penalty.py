"""The motion problem as a function of ramp parameters, with limits as linear penalties (5.38).

The formulation of the source (5.6, 5.7), which searches without derivatives; the planner of this package does
not use it. Here it serves to compare search methods on one and the same fast model.

Parameters p, for each optimised joint with K commands: target, speed, acceleration of commands 1 .. K - 1,
then speed and acceleration of the last one, whose target is the goal: 3 K - 1 numbers, all in units of their
bounds: 0 at the lower, 1 at the upper one. Bounds are

- targets: between start and goal and at most `DETOUR` beyond, inside the joint's limits;
- speeds: `LEAST_SPEED` to 100 % of the joint's limit;
- accelerations: `LEAST_ACCELERATION` to 100 % of the joint's limit.

They contain every motion of `ocptip.motion.planner.random_start`. Cost G is the electric energy in J.
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

Neither checks a motion. GT comes from `ocptip.reserves.slip.Slip`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.optimize import Bounds

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.motion.planner.random_start import DETOUR, random_start
from ocptip.motion.task import MotionTask, require_plannable
from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants
from ocptip.trajectories.ramps import JointRamps, RampCommand
from ocptip.trajectories.trajectory import INSIDE, Trajectory
from ocptip.trajectories.velocity_profiles import VelocityProfiles, earliest_end, passive_command

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
        if not isinstance(task.robot, Robot):
            raise InputError(f"task: the penalised cost is that of an arm, got a {task.robot.kind}")
        if between not in get_args(Between):
            raise InputError(f"between: expected one of {get_args(Between)}, got {between!r}")
        self.task, self.weight, self.between = task, positive_number("weight", weight), between
        self.robot = task.robot
        self.lower, self.upper = self._parameter_bounds()
        self.size = len(self.lower)
        self.bounds = Bounds(np.zeros(self.size), np.ones(self.size))
        limit = self.robot.limits
        self._passive = [j for j in range(self.robot.n) if j not in task.optimised]
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

    # --- parameters and motions ---------------------------------------------------------------------------

    def motion(self, p: ArrayLike) -> Trajectory:
        """The motion of parameters p, (size,); beyond 0 and 1 they are taken at their bound."""
        task, limit = self.task, self.robot.limits
        p = np.clip(finite_array("p", p, (self.size,)), 0.0, 1.0)
        values = (self.lower + p * (self.upper - self.lower)).reshape(len(task.optimised), -1).tolist()
        joints: list[JointRamps | None] = [None] * self.robot.n
        for joint, own in zip(task.optimised, values, strict=True):
            own.insert(len(own) - 2, float(task.goal[joint]))
            commands = [RampCommand(*own[k : k + 3]) for k in range(0, len(own), 3)]
            joints[joint] = JointRamps.from_commands(float(task.start[joint]), commands)
        end = max(self._end_at_least, *(joint.end for joint in joints if joint is not None))
        for j in self._passive:
            start, goal = float(task.start[j]), float(task.goal[j])
            command = passive_command(start, goal, end, float(limit.speed[j]), float(limit.acceleration[j]))
            joints[j] = JointRamps.from_commands(start, [command])
        return Trajectory(profiles=VelocityProfiles(tuple(joints)))

    def parameters(self, motion: Trajectory) -> np.ndarray:
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
        """Parameters of the planner's random start of that number, (size,)."""
        task = self.task
        rng = np.random.default_rng([seed, number])
        motion = random_start(
            task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng
        )
        return np.clip(self.parameters(motion), 0.0, 1.0)

    def _parameter_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        task, limit = self.task, self.robot.limits
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

    def of_motion(self, motion: Trajectory) -> PenaltyValue:
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
        at = Instants.of_states(robot, q, qd, qdd)
        torques, gaps, count = at.torques, at.gaps(np.inf), len(weights)
        energy = float(weights @ np.sum(robot.motors.power(torques[:count], qd[:count]), axis=1))
        GN, GT = (np.nan_to_num(reserve, nan=_UNSOLVED) for reserve in (at.tip.GN, at.slip.GT))
        columns = np.column_stack([GN, GT, -gaps])
        if self.between == "spline" and count:
            worst = _spline_maxima(times, columns, motion.end, -bound.clearance - _NEAR)
            high, low = _piecewise_maxima(torques)
        else:
            worst, high, low = columns.max(axis=0), torques.max(axis=0), torques.min(axis=0)
        allowed = bound.torque_ratio * robot.limits.torque
        joints = list(self.task.optimised)
        least, greatest = np.array([motion.joints[joint].pieces.angle_ranges[0] for joint in joints]).T
        limits = np.concatenate(
            [
                worst - np.array([bound.GN, bound.GT, *[-bound.clearance] * gaps.shape[1]]),
                high - allowed,
                -low - allowed,
                greatest - robot.limits.angle_max[joints],
                robot.limits.angle_min[joints] - least,
            ]
        )
        cost = energy + self.weight * float(np.sum(np.maximum(limits, 0.0)))
        return PenaltyValue(energy, limits, cost, motion.end)


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
