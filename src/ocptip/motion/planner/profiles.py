"""Joint motions as functions of the optimisation variables, with first and second derivatives.

Variables x, per optimised joint: signed cruise speeds w_1 .. w_K (rad/s), acceleration durations d_1 .. d_K
and the brake duration d_{K+1} (s), cruise durations c_1 .. c_K (s); then the end t_E (s), a constant 1 (so
that affine expressions are linear in x), angles of start and goal (rad) where these are free, and the zero
crossings of speeds (s). A joint's acceleration is a sum of steps alpha_k at its corner times tau_k, so that

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
    add_curvature,
    add_second_derivatives,
    joint_states,
    over_all_variables,
    put_corners,
    put_passive_corners,
    slopes_at_all_nodes,
)
from ocptip.robots.process import PATH, TIME
from ocptip.standing.acting import BASE, Acting


class Layout:
    """Where the variables of `joints` optimised joints with `commands` profile commands stand in x.

    Args:
        n: joints of the arm.
        joints: optimised joints, 0-based.
        commands: K, profile commands of each.
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
        """Its acceleration durations, the brake's last."""
        start = j * self.per_joint + self.commands
        return slice(start, start + self.commands + 1)

    def c(self, j: int) -> slice:
        """Its cruise durations."""
        start = j * self.per_joint + 2 * self.commands + 1
        return slice(start, start + self.commands)

    def extended(self, crossings: int) -> Layout:
        """This layout with another number of crossings."""
        return Layout(self.n, self.joints, self.commands, crossings, self.free)


@dataclass(frozen=True, eq=False)
class Corners:
    """Steps and times of all joints' corners at one x; C corners per joint, unused ones with step 0.

    Attributes:
        steps, times: (n, C), rad/s^2 and s.
        d_steps, d_times: (n, C, P) derivatives with respect to the variables of the joint,
            `Profiles.columns`.
        ramps: (joints optimised, K + 1) accelerations of the phases, for second derivatives.
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
        start, goal: (n,), rad; where they are free, this is that of the non-optimised joints.
        speed_limits: (n,), rad/s; those of the non-optimised joints are what their profiles aim at.
        rounding: s; width of the rounded transition of non-optimised joints from triangle to trapezoid, 0 for
            the exact rule.
        rise_times: (n,), s, of the accelerations; default 0: trapezoidal profiles.
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
        self.corners = max(2 * K + 2 if layout.joints else 4, 4)
        moving = [joint for joint in range(n) if joint not in layout.joints and abs(self.way[joint]) > 0]
        self.passive_joints = moving
        self.columns = np.full((n, layout.per_joint), layout.end)
        self.counts, self.used = np.zeros((2, n), dtype=np.int64)
        self.counts[moving], self.used[moving] = 1, 4
        self._constant_d_times = np.zeros((n, self.corners, layout.per_joint))
        for j, joint in enumerate(layout.joints):
            self.columns[joint] = np.arange(j * layout.per_joint, (j + 1) * layout.per_joint)
            self.counts[joint], self.used[joint] = layout.per_joint, 2 * K + 2
            row = np.zeros(layout.per_joint)
            for k in range(2 * K + 2):
                self._constant_d_times[joint, k] = row
                if k < 2 * K + 1:
                    row[K + k // 2 if k % 2 == 0 else 2 * K + 1 + k // 2] = 1.0
        self._optimised, self._passive = (
            np.array(joints, dtype=np.int64) for joints in (layout.joints, moving)
        )
        self._cruises = np.abs(self.way[moving]) / speed_limits[moving]

    def start_at(self, x: np.ndarray) -> np.ndarray:
        """(n,) The start, rad, with the angles that are free as they are in x."""
        start = self.start.copy()
        if self.layout.free[0]:
            start[list(self.layout.joints)] = x[self.layout.start]
        return start

    def corner_time(self, joint: int, k: int) -> np.ndarray:
        """Time of a corner of an optimised joint as a row (nx,) times x."""
        row = np.zeros(self.layout.size)
        row[self.columns[joint]] = self._constant_d_times[joint, k]
        return row

    def edge(self, joint: int) -> float:
        """End time t_E, s, up to which the profile of a non-optimised joint is a trapezoid; then it is a
        triangle.
        """
        return 2 * abs(self.way[joint]) / self.speed_limits[joint]

    def regime(self, end: float) -> dict[int, bool]:
        """Whether the profile of each moving non-optimised joint is a trapezoid (else a triangle) at this
        t_E.
        """
        return {joint: bool(self.edge(joint) > end) for joint in self.passive_joints}

    def __call__(self, x: np.ndarray, regime: dict[int, bool] | None = None) -> Corners:
        """Corners at x ((nx,)); non-optimised joints in the given regime, by default in the one that fits
        t_E.
        """
        layout = self.layout
        n, K, C, P = layout.n, layout.commands, self.corners, layout.per_joint
        steps, times = np.zeros((n, C)), np.zeros((n, C))
        d_steps, d_times = np.zeros((n, C, P)), self._constant_d_times.copy()
        ramps = np.zeros((len(layout.joints), K + 1))
        put_corners(x, self._optimised, K, ramps, steps, times, d_steps)
        end, second = x[layout.end], np.zeros((n, 2))
        if self.passive_joints:
            regime = self.regime(end) if regime is None else regime
            forms = np.array([regime[joint] for joint in self.passive_joints])
            tables = self._passive, self.way[self._passive], self._cruises, float(self.rounding), forms
            put_passive_corners(end, *tables, steps, times, d_steps, d_times, second)
        return Corners(steps, times, d_steps, d_times, ramps, second)

    def add_second(
        self, hessian: np.ndarray, corners: Corners, x: np.ndarray, on_steps: np.ndarray, on_times: np.ndarray
    ) -> None:
        """Add sum of on_steps * (second derivative of steps) + on_times * (that of times), both (n, C)."""
        layout = self.layout
        optimised, passive = (self._optimised, layout.commands, corners.ramps), (self._passive, layout.end)
        add_corners_curvature(hessian, x, *optimised, *passive, corners.passive, on_steps, on_times)


@dataclass(frozen=True, eq=False)
class ActingCourse:
    """What acts on a robot at nodes.

    That is a process that varies over time, or over the share of the motion's duration, and a base that
    drives.

    Attributes:
        acts: of the robot.
        end: (nx,), the duration is end @ x, s.
    """

    acts: Acting
    end: np.ndarray

    @classmethod
    def of(cls, acts: Acting, end: np.ndarray) -> ActingCourse | None:
        """None if nothing acts; tasks with a process over the path of the TCP are refused."""
        assert acts.process is None or acts.process.over != PATH
        return cls(acts, end) if acts.size else None

    @property
    def of_duration(self) -> list[int]:
        """Variables on which the duration depends, of a process that varies with a share of it."""
        over_share = self.acts.process is not None and self.acts.process.over != TIME
        return np.flatnonzero(self.end).tolist() if over_share else []

    def put(self, x: np.ndarray, times: np.ndarray, states: NodeStates, derivatives: bool) -> None:
        """Put what acts at times @ x, times (N, nx), and its slopes, into the last states.

        The variables of the process are those of the duration; what varies over time has none.
        """
        share, length, first = times @ x, 1.0, len(states.values) - self.acts.size
        if (profile := self.acts.drive_profile) is not None:
            states.values[-BASE:], states.rates[-BASE:] = profile.rows(share).T, profile.rows(share, 1).T
        if (process := self.acts.process) is None:
            return
        if process.over != TIME:
            length = self.end @ x
            share = share / length
        slopes, block = process.slopes(share).T / length, slice(first, first + 6)
        states.values[block], states.rates[block] = np.hstack(process.at(share)).T, slopes
        for p, column in enumerate(self.of_duration if derivatives else []):
            change = -self.end[column] * share * slopes
            states.own[first // 3 : first // 3 + 2, p] = change.reshape(2, 3, -1)

    def add_second(self, hessian: np.ndarray, x: np.ndarray, times: np.ndarray, weights: np.ndarray) -> None:
        """Add the sum of weights (k, N) times the second derivatives."""
        process, profile = self.acts.process, self.acts.drive_profile
        if profile is not None:
            bends = np.sum(weights[-BASE:].T * profile.rows(times @ x, 2), axis=1)
            hessian += times.T @ (bends[:, None] * times)
        if process is None or process.over == TIME:
            return
        length = self.end @ x
        share = times @ x / length
        weight = np.sum(weights[:6] * process.slopes(share).T, axis=0)
        mixed = np.outer(weight @ times, self.end)
        hessian += (2 * (weight @ share) * np.outer(self.end, self.end) - mixed - mixed.T) / length**2


@dataclass(frozen=True, eq=False)
class NodeStates:
    """Joint states at N nodes and their derivatives over x, see `profile_kernels`.

    Attributes:
        values: (S, N): angles, speeds, accelerations, n each; what acts, see `standing.acting`.
        rates: (S, N), their derivatives over the nodes' times.
        own: (groups, variables, 3, N), over the variables of each group of three states.
        nodes: whose.
        steps, corners: what second derivatives need.
    """

    values: np.ndarray
    rates: np.ndarray
    own: np.ndarray
    nodes: Nodes
    steps: np.ndarray
    corners: Corners

    def over_all(self, nodes: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Slopes (R, nx) over x of functions at nodes (R,) with slopes (R, S) over the states."""
        assert slopes.shape[1] == len(self.values)
        of, contiguous = self.nodes, np.ascontiguousarray
        return over_all_variables(
            contiguous(nodes), contiguous(slopes), self.own, self.rates, *of.groups, of.times
        )

    def over_all_everywhere(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (nx, N) over x of one function at each node with slopes (S, N) over the states."""
        of = self.nodes
        return slopes_at_all_nodes(slopes, self.own, self.rates, *of.groups, of.times)

    def add_hessian(
        self, hessian: np.ndarray, x: np.ndarray, H: np.ndarray, weights: np.ndarray, other: np.ndarray
    ) -> None:
        """Add the second derivatives over x of a sum over nodes of functions of the states.

        Args:
            hessian: (nx, nx), added to.
            x: where.
            H: their second derivatives over the states, upper halves (S (S + 1) / 2, N).
            weights: their slopes (S, N) over the states.
            other: (nx, nx), added with its transpose.
        """
        of, profiles, corners = self.nodes, self.nodes.profiles, self.corners
        T, n = of.times, profiles.layout.n
        on_t, mixed = np.zeros(len(T)), np.zeros(T.shape[::-1])
        on_steps, on_times = np.zeros((2, n, profiles.corners))
        rows, columns, counts = of.groups
        add_curvature(hessian, H, self.own, self.rates, rows, columns, counts, on_t, mixed)
        tables = (
            corners.steps,
            corners.d_steps,
            corners.d_times,
            profiles.columns,
            profiles.counts,
            profiles.used,
        )
        add_second_derivatives(hessian, weights, self.steps, *tables, T, on_t, mixed, on_steps, on_times)
        profiles.add_second(hessian, corners, x, on_steps, on_times)
        mixed = mixed @ T + other
        hessian += mixed + mixed.T
        if of.course is not None:
            of.course.add_second(hessian, x, T, weights[3 * n :])


class Nodes:
    """Nodes at times linear in x.

    Args:
        profiles: the joints' motion.
        times: (N, nx): node times are times @ x.
        masks: (N, n, C) of 0 and 1, which corners have passed at each node; None with a smooth step.
        late: (N, n, C) the same a rise time later; needed for exact S-curves only.
        half_width: s, of the smooth step, see `profile_kernels`; 0 with masks.
        regime: of the non-optimised joints, see `Profiles`.
        behind: (N, n), s, delay of joints at nodes, with masks of then; default: none.
        kinds: (N,) of the nodes, see `standing.limit_kinds.limit`; at acceleration steps masks are 1 + kappa
            at the corners of the switching time; default all ordinary.
        course: of what acts.
        earlier: masks (N, n, C) of the delay of an uncertainty before; None: nobody asks.

    Attributes:
        groups: rows (G, 3) of the states that depend on the same variables, columns (G, most) of these in x,
            and how many they are (G,).
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
        course: ActingCourse | None = None,
        earlier: np.ndarray | None = None,
    ) -> None:
        self.course, self.regime, self._earlier = course, regime, earlier
        self.profiles, self.times = profiles, np.ascontiguousarray(times)
        self._behind = np.zeros((0, 0))
        if behind is not None and np.any(behind):
            self._behind = np.ascontiguousarray(np.transpose(behind))
        self._masks, self._late = (
            np.zeros((0, 0, 0))
            if events is None
            else np.ascontiguousarray(np.moveaxis(events, 0, -1), dtype=float)
            for events in (masks, late)
        )
        self.half_width = half_width
        self.kinds = np.zeros(len(times), dtype=int) if kinds is None else kinds
        self.groups = self._groups()

    def _groups(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        profiles, layout, n = self.profiles, self.profiles.layout, self.profiles.layout.n
        rows, counts = np.arange(3 * n).reshape(3, n).T, profiles.counts.copy()
        columns = np.pad(profiles.columns, ((0, 0), (0, layout.free[0])))
        if layout.free[0]:
            joints = list(layout.joints)
            columns[joints, -1] = np.arange(layout.start.start, layout.start.stop)
            counts[joints] += 1
        if self.course is not None:
            of_duration, size = self.course.of_duration, self.course.acts.size
            rows = np.vstack([rows, 3 * n + np.arange(size).reshape(-1, 3)])
            more = np.zeros((size // 3, columns.shape[1]), dtype=columns.dtype)
            more[:2, : len(of_duration)] = of_duration
            numbers = [len(of_duration)] * 2 if self.course.acts.process else []
            numbers += [0] * (size // 3 - len(numbers))
            columns, counts = np.vstack([columns, more]), np.append(counts, numbers)
        return np.ascontiguousarray(rows), columns, counts

    def values(self, x: np.ndarray) -> np.ndarray:
        """States (S, N) of all joints at all nodes."""
        return self._states(x, 0).values

    def before(self, x: np.ndarray) -> np.ndarray | None:
        """Accelerations (N, n) of the delay of an uncertainty before, where these are known."""
        if self._earlier is None:
            return None
        return np.einsum("Njc,jc->Nj", self._earlier, self.profiles(x, self.regime).steps)

    def states(self, x: np.ndarray) -> NodeStates:
        """States of all joints at all nodes, with derivatives."""
        return self._states(x, self.groups[1].shape[1])

    def _states(self, x: np.ndarray, own_size: int) -> NodeStates:
        profiles, layout = self.profiles, self.profiles.layout
        corners = profiles(x, self.regime)
        values, rates, profile_slopes, steps = joint_states(
            self.times @ x,
            self._behind,
            self._masks,
            self._late,
            self.half_width,
            profiles.rise_times,
            profiles.start_at(x),
            *(corners.steps, corners.times, corners.d_steps, corners.d_times),
            *(profiles.counts, profiles.used, 3 * len(self.groups[0]), own_size),
        )
        if layout.free[0] and own_size:
            profile_slopes[list(layout.joints), -1, 0] = 1.0
        states = NodeStates(values, rates, profile_slopes, self, steps, corners)
        if self.course is not None:
            self.course.put(x, self.times, states, bool(own_size))
        return states
