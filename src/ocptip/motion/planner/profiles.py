"""Joint motions as functions of the optimisation variables, with first and second derivatives.

Variables x, per optimised joint: signed cruise speeds w_1 .. w_K (rad/s), ramp durations d_1 .. d_K and the
brake duration d_{K+1} (s), cruise durations c_1 .. c_K (s); then the end t_E (s), a constant 1 (so that
affine expressions are linear in x), angles of start and goal (rad) where these are free, and the zero
crossings of speeds (s). A joint's acceleration is a sum of
steps alpha_k at its corner times tau_k, so that

    acceleration = sum alpha_k phi0(t - tau_k),  speed = sum alpha_k phi1,  angle = start + sum alpha_k phi2

with phi0 the unit step and phi1, phi2 its integrals (in S-curves: their means over the last rise time). The
steps alpha depend on speeds and durations, the times tau on durations only, node times t are linear in x: all
derivatives follow by hand. A smoothed step makes the motion a smooth function of x whatever the order of the
corners; with the order fixed the step is the exact one (`phi0` a mask of zeros and ones). The loops are in
`profile_kernels`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.motion.planner.profile_kernels import (
    add_corners_curvature,
    add_second_derivatives,
    joint_states,
    put_corners,
)
from ocptip.robots.process import PATH, TIME, ProcessWrench


class Layout:
    """Where the variables of `joints` optimised joints with `commands` ramp commands stand in x.

    Args:
        n: joints of the arm.
        joints: optimised joints, 0-based.
        commands: K, ramp commands of each.
        crossings: number of zero-crossing variables at the end of x.
        free: whether the optimised joints' angles at the start, and at the goal, are variables.

    Attributes:
        start, goal: these angles in x; empty where they are given.
        crossing: the first zero-crossing variable.
    """

    def __init__(
        self,
        n: int,
        joints: tuple[int, ...],
        commands: int,
        crossings: int = 0,
        free: tuple[bool, bool] = (False, False),
    ) -> None:
        self.n, self.joints, self.commands, self.crossings, self.free = n, joints, commands, crossings, free
        K = commands
        self.per_joint = 3 * K + 1
        self.end = self.per_joint * len(joints)
        self.one = self.end + 1
        at_goal = self.one + 1 + free[0] * len(joints)
        self.crossing = at_goal + free[1] * len(joints)
        self.start, self.goal = slice(self.one + 1, at_goal), slice(at_goal, self.crossing)
        self.size = self.crossing + crossings

    def w(self, j: int) -> slice:
        """Speeds of the j-th optimised joint."""
        return slice(j * self.per_joint, j * self.per_joint + self.commands)

    def d(self, j: int) -> slice:
        """Its ramp durations, the brake's last."""
        start = j * self.per_joint + self.commands
        return slice(start, start + self.commands + 1)

    def c(self, j: int) -> slice:
        """Its cruise durations."""
        start = j * self.per_joint + 2 * self.commands + 1
        return slice(start, start + self.commands)

    def extended(self, crossings: int) -> Layout:
        """The same with another number of crossings."""
        return Layout(self.n, self.joints, self.commands, crossings, self.free)


@dataclass(frozen=True, eq=False)
class Corners:
    """Steps and times of all joints' corners at one x; C corners per joint, unused ones with step 0.

    Attributes:
        steps, times: (n, C), rad/s^2 and s.
        d_steps, d_times: (n, C, P) derivatives with respect to the joint's own variables, `Profiles.columns`.
        ramps: (joints optimised, K + 1) accelerations of the ramps, for second derivatives.
        passive: (n, 2) second derivatives of acceleration and of t' with respect to t_E.
    """

    steps: np.ndarray
    times: np.ndarray
    d_steps: np.ndarray
    d_times: np.ndarray
    ramps: np.ndarray
    passive: np.ndarray


class Profiles:
    """Corner times and steps of all joints as functions of x.

    Args:
        layout: of x.
        start, goal: (n,), rad; where they are free, this is the passive joints'.
        speed_limits: (n,), rad/s; those of the passive joints are what their ramps aim at.
        rounding: s; width of the rounded transition of passive joints from triangle to trapezoid, 0 for
            the exact rule.
        rise_times: (n,), s, of the accelerations; default 0: ramps.
    """

    def __init__(
        self,
        layout: Layout,
        start: np.ndarray,
        goal: np.ndarray,
        speed_limits: np.ndarray,
        rounding: float = 0.0,
        rise_times: np.ndarray | None = None,
    ) -> None:
        self.layout, self.start, self.way = layout, start, goal - start
        self.rise_times = np.zeros(layout.n) if rise_times is None else np.asarray(rise_times, dtype=float)
        self.speed_limits, self.rounding = speed_limits, rounding
        n, K = layout.n, layout.commands
        self.corners = 2 * K + 2 if layout.joints else 4
        self.corners = max(self.corners, 4)
        self.columns = np.full((n, layout.per_joint), layout.end)
        self.counts = np.ones(n, dtype=np.int64)
        self._constant_d_times = np.zeros((n, self.corners, layout.per_joint))
        for j, joint in enumerate(layout.joints):
            self.columns[joint] = np.arange(j * layout.per_joint, (j + 1) * layout.per_joint)
            self.counts[joint] = layout.per_joint
            row = np.zeros(layout.per_joint)
            for k in range(2 * K + 2):
                self._constant_d_times[joint, k] = row
                if k < 2 * K + 1:
                    row[K + k // 2 if k % 2 == 0 else 2 * K + 1 + k // 2] = 1.0
        self._optimised = np.array(layout.joints, dtype=np.int64)
        self.passive_joints = [
            joint for joint in range(n) if joint not in layout.joints and abs(self.way[joint]) > 0
        ]

    def start_at(self, x: np.ndarray) -> np.ndarray:
        """(n,) The start, rad, with the angles that are free as they are in x."""
        if not self.layout.free[0]:
            return self.start
        start = self.start.copy()
        start[list(self.layout.joints)] = x[self.layout.start]
        return start

    def corner_time(self, joint: int, k: int) -> np.ndarray:
        """Time of a corner of an optimised joint as a row (nx,) times x."""
        row = np.zeros(self.layout.size)
        row[self.columns[joint]] = self._constant_d_times[joint, k]
        return row

    def edge(self, joint: int) -> float:
        """End time t_E, s, up to which a passive joint's ramp is a trapezoid; then it is a triangle."""
        return 2 * abs(self.way[joint]) / self.speed_limits[joint]

    def regime(self, end: float) -> dict[int, bool]:
        """Whether each moving passive joint's ramp is a trapezoid (else a triangle) at this t_E."""
        return {joint: bool(self.edge(joint) > end) for joint in self.passive_joints}

    def __call__(self, x: np.ndarray, regime: dict[int, bool] | None = None) -> Corners:
        """Corners at x ((nx,)); passive joints in the given regime, in the one that fits t_E by default."""
        layout = self.layout
        n, K, C, P = layout.n, layout.commands, self.corners, layout.per_joint
        steps, times = np.zeros((n, C)), np.zeros((n, C))
        d_steps, d_times = np.zeros((n, C, P)), self._constant_d_times.copy()
        ramps = np.zeros((len(layout.joints), K + 1))
        put_corners(x, self._optimised, K, ramps, steps, times, d_steps)
        end = x[layout.end]
        regime = self.regime(end) if regime is None else regime
        second = np.zeros((n, 2))
        for joint in self.passive_joints:
            p, p1, p2 = self._ramp_end(joint, end, regime)
            way = self.way[joint]
            g, g1 = p * (end - p), p1 * (end - p) + p * (1 - p1)
            g2 = p2 * (end - p) + 2 * p1 * (1 - p1) - p * p2
            a, a1 = way / g, -way * g1 / g**2
            second[joint] = way * (2 * g1**2 / g**3 - g2 / g**2), p2
            sign = np.array([1.0, -1.0, -1.0, 1.0])
            steps[joint, :4], times[joint, :4] = a * sign, [0.0, p, end - p, end]
            d_steps[joint, :4, 0] = a1 * sign
            d_times[joint, :4, 0] = [0.0, p1, 1 - p1, 1.0]
        return Corners(steps, times, d_steps, d_times, ramps, second)

    def _ramp_end(self, joint: int, end: float, regime: dict[int, bool]) -> tuple[float, float, float]:
        """t' of a passive joint and its first two derivatives with respect to t_E: (5.16), (5.17)."""
        cruise = abs(self.way[joint]) / self.speed_limits[joint]
        if self.rounding == 0:
            return (end - cruise, 1.0, 0.0) if regime[joint] else (end / 2, 0.5, 0.0)
        u, v, r = end / 2, end - cruise, self.rounding
        root = np.sqrt((u - v) ** 2 + r**2)
        slope = -0.5 * (u - v) / root
        return (u + v - root) / 2, (1.5 - slope) / 2, -0.5 * 0.25 * r**2 / root**3

    def second(
        self, hessian: np.ndarray, corners: Corners, x: np.ndarray, on_steps: np.ndarray, on_times: np.ndarray
    ) -> None:
        """Add sum of on_steps * (second derivative of steps) + on_times * (that of times), both (n, C)."""
        layout = self.layout
        add_corners_curvature(hessian, x, self._optimised, layout.commands, corners.ramps, on_steps)
        e = layout.end
        for joint in self.passive_joints:
            a2, p2 = corners.passive[joint]
            s, t = on_steps[joint], on_times[joint]
            hessian[e, e] += a2 * (s[0] - s[1] - s[2] + s[3]) + p2 * (t[1] - t[2])


@dataclass(frozen=True, eq=False)
class Course:
    """A process that varies over time, or over the share of the motion's duration, at nodes.

    Attributes:
        process: whose.
        end: (nx,), the duration is end @ x, s.
    """

    process: ProcessWrench
    end: np.ndarray

    @classmethod
    def of(cls, process: ProcessWrench | None, end: np.ndarray) -> Course | None:
        """None if nothing varies; tasks with a process over the way of the gripper are refused."""
        assert process is None or process.over != PATH
        return None if process is None else cls(process, end)

    def values(self, x: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force and moment (N, 6) at times @ x, times (N, nx), and slopes (N, 6, nx)."""
        at, on_x = self._places(x, times)
        return np.hstack(self.process.at(at)), self.process.slopes(at)[:, :, None] * on_x[:, None]

    def add_second(self, hessian: np.ndarray, x: np.ndarray, times: np.ndarray, weights: np.ndarray) -> None:
        """Add the sum of weights (N, 6) times the second derivatives."""
        if self.process.over == TIME:
            return
        at, _ = self._places(x, times)
        weight, length = np.sum(weights * self.process.slopes(at), axis=1), self.end @ x
        mixed = np.outer(weight @ times, self.end)
        hessian += (2 * (weight @ at) * np.outer(self.end, self.end) - mixed - mixed.T) / length**2

    def _places(self, x: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) what it varies with, and its slopes (N, nx)."""
        at = times @ x
        if self.process.over == TIME:
            return at, times
        length = self.end @ x
        return at / length, (times - np.outer(at / length, self.end)) / length


@dataclass(frozen=True, eq=False)
class NodeStates:
    """Joint states at N nodes and their derivatives with respect to x.

    Attributes:
        values: (N, 3 n): angles, speeds, accelerations; force and moment of a process that varies, 6 more.
        jacobian: (N, 3 n, nx), or 6 more.
    """

    values: np.ndarray
    jacobian: np.ndarray
    _steps: np.ndarray
    _corners: Corners


class Nodes:
    """Nodes at times linear in x.

    Args:
        profiles: the joints' motion.
        times: (N, nx): node times are times @ x.
        masks: (N, n, C) of 0 and 1, which corners have passed at each node; None with a smooth step.
        late: (N, n, C) the same a rise time later; needed for exact S-curves only.
        half_width: s, of the smooth step, see `profile_kernels`; 0 with masks.
        regime: of the passive joints, see `Profiles`.
        behind: (N, n), s, by how much joints are late at nodes, with masks of then; default: none is.
        kinds: (N,) of the nodes, see `standing.limit_kinds.limit`; at jumps masks are 1 + kappa at the
            event's corners; default all ordinary.
        course: of a process that varies.
    """

    def __init__(
        self,
        profiles: Profiles,
        times: np.ndarray,
        *,
        masks: np.ndarray | None = None,
        late: np.ndarray | None = None,
        half_width: float = 0.0,
        regime: dict[int, bool] | None = None,
        behind: np.ndarray | None = None,
        kinds: np.ndarray | None = None,
        course: Course | None = None,
    ) -> None:
        self.course = course
        self.behind = np.zeros((0, 0)) if behind is None else behind
        self.profiles, self.times, self.regime = profiles, np.ascontiguousarray(times), regime
        self.masks, self.late = (
            np.zeros((0, 0, 0)) if own is None else np.ascontiguousarray(own, dtype=float)
            for own in (masks, late)
        )
        self.half_width = half_width
        self.kinds = np.zeros(len(times), dtype=int) if kinds is None else kinds

    def states(self, x: np.ndarray) -> NodeStates:
        """States of all joints at all nodes."""
        profiles = self.profiles
        corners = profiles(x, self.regime)
        values, jacobian, steps = joint_states(
            self.times @ x,
            self.times,
            self.behind,
            self.masks,
            self.late,
            self.half_width,
            profiles.rise_times,
            profiles.start_at(x),
            *(corners.steps, corners.times, corners.d_steps, corners.d_times),
            *(profiles.columns, profiles.counts),
        )
        if profiles.layout.free[0]:
            joints = list(profiles.layout.joints)
            jacobian[:, joints, range(profiles.layout.start.start, profiles.layout.start.stop)] += 1.0
        if self.course is not None:
            force, slopes = self.course.values(x, self.times)
            values, jacobian = np.hstack([values, force]), np.concatenate([jacobian, slopes], axis=1)
        return NodeStates(values, jacobian, steps, corners)

    def second(self, hessian: np.ndarray, x: np.ndarray, states: NodeStates, weights: np.ndarray) -> None:
        """Add sum over nodes and states of weights ((N, 3 n)) times the states' second derivatives."""
        profiles, T = self.profiles, self.times
        corners = states._corners
        if self.course is not None:
            self.course.add_second(hessian, x, T, weights[:, -6:])
            weights = np.ascontiguousarray(weights[:, :-6])
        on_steps, on_times, on_t, mixed = add_second_derivatives(
            hessian,
            weights,
            states._steps,
            T.shape[1],
            *(corners.steps, corners.d_steps, corners.d_times, profiles.columns, profiles.counts),
        )
        profiles.second(hessian, corners, x, on_steps, on_times)
        mixed = T.T @ mixed
        hessian += T.T @ (on_t[:, None] * T) + mixed + mixed.T
