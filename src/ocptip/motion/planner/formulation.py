"""Programs of a motion task: one that leaves the order of switching times open, and one with the order fixed.

The smooth program replaces the steps of accelerations (and of power at zero speed) by short smooth
transitions at nodes spread evenly over the motion. It is as smooth as Ipopt wants it, for any order of
switching times, and finds order and signs. The ordered program is exact: Gauss-Legendre nodes inside the
intervals between switching times (5.25), with their order and the signs of all speeds as constraints.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.motion.objective import ENERGY, Objective
from ocptip.motion.planner.deviating import MEET, Deviating, Place, masks_of, time_of
from ocptip.motion.planner.event_order import SLOWEST, EventOrder, order_of, unit_row
from ocptip.motion.planner.free_ends import FreeEnds
from ocptip.motion.planner.node_physics import NodePhysics
from ocptip.motion.planner.profiles import ActingCourse, Layout, Nodes, Profiles
from ocptip.motion.planner.program import MotionProgram, Structure
from ocptip.motion.task import LONGEST
from ocptip.numerics.quadrature import unit_gauss_legendre
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import DEVIATING, JUMP, ORDINARY
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.ramps import RampCommand, phases_to_commands, without_idle_ramps
from ocptip.trajectories.trajectory import Trajectory
from ocptip.trajectories.velocity_profiles import earliest_end, passive_command

SPACING, SMOOTH_NODES = 0.05, (24, 48)  # s, and least and greatest number, of evenly spread nodes
SHORTEST = 1e-3  # least duration of a ramp in an ordered program, s
GENTLEST = 0.05  # least acceleration of a ramp, rad/s^2 (slow joints: half of their limit)
MIDDLE_CRUISE = 1e-3  # s, where a middle command slows the joint down
ORDER, SHORT = 4, (0.08, 0.01)  # Gauss nodes per interval; one less below each of these lengths, s
POLISHING = 20  # Newton steps at most


@dataclass(frozen=True)
class Smoothing:
    """How sharp a smooth program is.

    Attributes:
        width: s; half width of a step of an acceleration; None for the node spacing.
        power: rad/s; the step of a drive's power is spread over twice this speed.
        brake: rad/s; rounding of |speed| in the brake law.
        shortest: minimum duration of an acceleration phase, in half widths.
    """

    width: float | None
    power: float
    brake: float
    shortest: float


COARSE = Smoothing(None, 0.1, 0.05, 2.0)


class Formulation:
    """Programs of one task.

    Args:
        robot: the arm on its support.
        start, goal: (n,), rad.
        joints: optimised joints, 0-based.
        commands: K, profile commands of each.
        objective: what is minimised.
        durations: minimum and maximum duration, s.
        ends: which of start and goal are free; default none.
        rise_times: (n,), s, of the accelerations; default 0: trapezoidal profiles.
    """

    def __init__(
        self,
        robot: StandingMechanism,
        start: np.ndarray,
        goal: np.ndarray,
        joints: tuple[int, ...],
        commands: int,
        objective: Objective = ENERGY,
        durations: tuple[float, float] = (0.0, LONGEST),
        ends: FreeEnds | None = None,
        rise_times: np.ndarray | None = None,
    ) -> None:
        self.robot, self.start, self.goal = robot, start, goal
        self.objective = objective.with_power(robot.support.power)
        self.ends = ends or FreeEnds(None, (start, goal), (None, None), joints)
        self.layout = Layout(robot.n, joints, commands, free=self.ends.free)
        self.smooth_physics, self.physics = NodePhysics(robot, smooth=True), NodePhysics(robot)
        arm = robot.limits
        passive = [j for j in range(robot.n) if j not in joints]
        self._latest: tuple[EventOrder, Structure] | None = None
        earliest = earliest_end((goal - start)[passive], arm.speed[passive], arm.acceleration[passive])
        self.rise_times = np.zeros(robot.n) if rise_times is None else np.asarray(rise_times, dtype=float)
        moving = [j for j in range(robot.n) if j in joints or goal[j] != start[j]]
        self.rise = float(np.max(self.rise_times[moving], initial=0.0))
        self.earliest = max(float(np.max(earliest, initial=0.0)), durations[0] - self.rise)
        self.latest = min(durations[1], LONGEST) - self.rise

    def profiles(self, layout: Layout, rounding: float = 0.0) -> Profiles:
        """Corners of the joints' motions as functions of the variables, see `Profiles`."""
        ends = self.start, self.goal, self.robot.limits.speed
        return Profiles(layout, *ends, rounding, self.rise_times)

    # --- variables and motions ----------------------------------------------------------------------------

    def variables(self, motion: Trajectory) -> np.ndarray:
        """Variables of the smooth program for a motion whose optimised joints have up to K commands each."""
        layout = self.layout
        x = np.zeros(layout.size)
        for j, joint in enumerate(layout.joints):
            ramps = motion.joints[joint]
            idle = np.zeros(layout.commands - len(ramps.peaks))
            x[layout.w(j)], x[layout.c(j)] = np.append(ramps.peaks, idle), np.append(ramps.cruises, idle)
            x[layout.d(j)] = np.maximum(np.append(ramps.ramps, idle), 1e-3)
        x[layout.end], x[layout.one] = motion.with_rise_times(0.0).end, 1.0
        joints = list(layout.joints)
        for index, posture in ((layout.start, motion.start), (layout.goal, motion.goal)):
            x[index] = posture[joints][: index.stop - index.start]
        return x

    def motion(self, x: np.ndarray) -> Trajectory:
        """The exact motion of a solution, rebuilt from its commands.

        Raises:
            InputError: no commands produce these phases.
        """
        layout, arm, (start, goal) = self.layout, self.robot.limits, self.ends.values(self.layout, x)
        commands: list[tuple[RampCommand, ...]] = [
            () if j in layout.joints
            else (passive_command(start[j], goal[j], x[layout.end], arm.speed[j], arm.acceleration[j]),)
            for j in range(layout.n)
        ]  # fmt: skip
        for j, joint in enumerate(layout.joints):
            if goal[joint] == start[joint] and np.all(np.abs(x[layout.w(j)]) <= SLOWEST):
                commands[joint] = (RampCommand(goal[joint], 1.0, 1.0),)
                continue
            commands[joint] = phases_to_commands(
                start[joint],
                *without_idle_ramps(x[layout.w(j)], x[layout.d(j)], x[layout.c(j)]),
                phi_goal=goal[joint],
                tolerance=1e-5,
            )
        return Trajectory.from_profiles(start, commands, self.rise_times)

    def slowed(self, x: np.ndarray, factor: float) -> np.ndarray:
        """Variables of the same path in so much more time, as far as there is time."""
        layout, x = self.layout, x[: self.layout.size].copy()
        factor = min(factor, self.latest / x[layout.end])
        for j in range(len(layout.joints)):
            x[layout.w(j)] /= factor
            x[layout.d(j)] *= factor
            x[layout.c(j)] *= factor
        x[layout.end] *= factor
        return x

    def polished(
        self, order: EventOrder, structure: Structure, x: np.ndarray, meet: float = MEET
    ) -> np.ndarray:
        """x moved a little (least squares): equalities, and order rows below `meet`, s, hold to rounding.

        Ipopt leaves errors of about 1e-8 s: simultaneous switching times would follow one another.
        """
        equal, first = structure.lower == structure.upper, len(structure.lower) - len(order.steps)
        for within in (meet, MEET, 0.0):  # what cannot all be met is left as it is
            moved = np.clip(x, structure.x_lower, structure.x_upper)
            for edge in (structure.x_lower, structure.x_upper):
                moved = np.where(np.abs(moved - edge) <= max(within, MEET), edge, moved)
            binding = equal.copy()
            binding[first:] |= structure.rows(moved)[0][first:] < within
            if (solved := self._newton(binding, structure, moved)) is not None:
                return solved
        return moved

    @staticmethod
    def _newton(chosen: np.ndarray, structure: Structure, x: np.ndarray) -> np.ndarray | None:
        """x at which the chosen rows vanish, or None; variables that meet a bound stay there."""
        free = (x > structure.x_lower) & (x < structure.x_upper)
        for _ in range(POLISHING):
            values, jacobian = structure.rows(x)
            error = values[chosen]
            if np.max(np.abs(error), initial=0.0) < 1e-13:
                return x
            step = np.linalg.lstsq(jacobian[chosen][:, free], -error, rcond=1e-10)[0]
            x = x.copy()
            x[free] += step
            outside = (x < structure.x_lower) | (x > structure.x_upper)
            x = np.clip(x, structure.x_lower, structure.x_upper)
            free &= ~outside
        return x if np.max(np.abs(structure.rows(x)[0][chosen])) < 1e-10 else None

    # --- programs ------------------------------------------------------------------------------------------

    def coarse_program(self, limits: Limits, end: float, nodes: int | None = None) -> MotionProgram:
        """The smooth program with nodes spread evenly, for profiles that end after about `end` seconds."""
        layout, nodes = self.layout, nodes or int(np.clip(end / SPACING, *SMOOTH_NODES))
        spacing = (end + self.rise) / nodes
        last = self._last(layout)
        times = ((np.arange(nodes) + 0.5) / nodes)[:, None] * last
        weights = np.tile(1.0 / nodes * last, (nodes, 1))
        return self._smooth_program(limits, COARSE, spacing, times, weights)

    def fine_program(self, limits: Limits, smoothing: Smoothing, x: np.ndarray) -> MotionProgram:
        """The smooth program with nodes that follow the switching times of a motion near x.

        The integrand is one smooth function of time, so that the sum over pieces between switching times is
        the integral even when these pass each other.
        """
        layout, width = self.layout, smoothing.width
        assert width is not None  # fine programs have one
        order, _ = order_of(self, x)
        shift = width * unit_row(layout, layout.one)
        rows = [
            row[: layout.size]
            for row, group in zip(order.rows, order.groups, strict=True)
            if ".x" not in group[0]
        ]
        zones = [[rows[0], rows[0] + shift, 1]]
        for row in rows[1:]:
            if row @ x - zones[-1][1] @ x < width:
                zones[-1][1:] = row + shift, zones[-1][2] + 1
            else:
                zones.append([row - shift, row + shift, 1])
        zones[-1][1] = rows[-1]
        pieces = []
        for i, (left, right, count) in enumerate(zones):
            pieces.append((left, right, 1 + count))
            if i + 1 < len(zones):
                length = (zones[i + 1][0] - right) @ x
                pieces.append((right, zones[i + 1][0], 3 if length > SHORT[0] else 2))
        times, weights = [], []
        for left, right, order_ in pieces:
            for a, g in zip(*unit_gauss_legendre(min(order_, 8)), strict=True):
                times.append(left + a * (right - left))
                weights.append(g * (right - left))
        return self._smooth_program(limits, smoothing, width, np.array(times), np.array(weights))

    def _smooth_program(
        self, limits: Limits, smoothing: Smoothing, width: float, times: np.ndarray, weights: np.ndarray
    ) -> MotionProgram:
        layout = self.layout
        if self.ends:  # what is free must stand, too, at rest: nodes before and after the motion
            outside = 2 * width * unit_row(layout, layout.one)
            times = np.vstack([times, -outside, self._last(layout) + outside])
            weights = np.vstack([weights, np.zeros((2, layout.size))])
        nodes = Nodes(
            self.profiles(layout, 0.5 * width), times, half_width=width, course=self._course(layout)
        )
        speeds = np.full((len(times), layout.n), smoothing.power)
        kept = limits_of(self.robot, limits, layout.joints)
        structure = self._smooth_structure(smoothing, width)
        physics, objective = self.smooth_physics, self.objective
        return MotionProgram(physics, kept, layout, nodes, weights, speeds, structure, objective)

    def ordered_program(
        self, limits: Limits, order: EventOrder, x: np.ndarray, extra: list[Place]
    ) -> MotionProgram:
        """The exact program with the switching times in the given order.

        Args:
            limits: to keep at the nodes; where acceleration steps count, every switching time is also a node.
            order: of the switching times.
            x: near the solution; short intervals there get fewer nodes.
            extra: further nodes, for rows only.
        """
        layout, events = order.layout, order.rows
        where = []
        for i, length in enumerate(np.diff(events @ x)):
            nodes = ORDER - sum(length < short for short in SHORT)
            where += [(i, s, g) for s, g in zip(*unit_gauss_legendre(nodes), strict=True)]
        jumps = len(where), len(where) + len(events) * (limits.overshoot > 0 and not order.rises)
        last = len(events) - 2
        where += [(min(i, last), float(i > last), 0.0) for i in range(jumps[1] - jumps[0])]
        rest = [(-1, 0.0, 0.0), (len(events) - 1, 0.0, 0.0)] if self.ends else []  # before and after it
        ends = [0.0 if isinstance(place, Deviating) else place[1] for place in extra]
        where += rest + [(place[0], share, 0.0) for place, share in zip(extra, ends, strict=True)]
        index = np.array([i for i, _, _ in where])
        shares, quadrature = np.array([s for _, s, _ in where]), np.array([g for _, _, g in where])
        left, right = (events[np.clip(index + k, 0, len(events) - 1)] for k in (0, 1))
        times = left + shares[:, None] * (right - left)
        weights = quadrature[:, None] * (right - left)
        masks, late = (
            (positions[None] <= index[:, None, None]).astype(float)
            for positions in (order.corner_positions, order.late_positions)
        )
        masks[slice(*jumps)] = order.jump_masks(limits.overshoot)[: jumps[1] - jumps[0]]
        kinds = np.full(len(where), ORDINARY)
        kinds[slice(*jumps)] = JUMP
        behind = np.zeros((len(where), layout.n))
        for node, place in enumerate(extra, len(where) - len(extra)):
            if isinstance(place, Deviating):
                times[node] = time_of(order, place)
                masks[node], late[node], behind[node] = masks_of(order, place)
                kinds[node] = DEVIATING
        how = {"regime": order.regime, "behind": behind, "kinds": kinds, "course": self._course(layout)}
        if limits.cancel is not None and limits.tolerance.given and not order.rises:
            group = np.searchsorted(events @ x, times @ x - limits.tolerance.late - MEET, side="right") - 1
            how["earlier"] = (order.corner_positions <= group[:, None, None]).astype(float)
        placed = Nodes(self.profiles(layout), times, masks=masks, late=late, **how)
        directions = order.directions[np.clip(index, 0, last)]
        if self.physics.smooth:  # the order says nothing about the motors' directions
            directions = np.full(directions.shape, COARSE.power)
        kept, structure = limits_of(self.robot, limits, layout.joints), self._structure_of(order)
        with_objective = directions, structure, self.objective
        return MotionProgram(self.physics, kept, layout, placed, weights, *with_objective)

    # --- structure rows ---------------------------------------------------------------------------------

    def _smooth_structure(self, smoothing: Smoothing, width: float) -> Structure:
        layout, arm = self.layout, self.robot.limits
        x = cs.SX.sym("x", layout.size)
        rows = _Rows()
        lower, upper = np.full(layout.size, smoothing.shortest * width), np.full(layout.size, LONGEST)
        start, goal = self._ends(rows, layout, x, lower, upper)
        for j, joint in enumerate(layout.joints):
            w, d, c = x[layout.w(j)], x[layout.d(j)], x[layout.c(j)]
            before = _delayed(w)
            change = w - before
            _arrive(rows, goal[joint] - start[joint], before, w, d, c)
            rows.equal(
                (_rounded(w[-1], smoothing.brake) * d[-2] - _rounded(change[-1], smoothing.brake) * d[-1])
                * 10
            )
            rows.at_least(arm.acceleration[joint] * d[:-1] - change)
            rows.at_least(arm.acceleration[joint] * d[:-1] + change)
            rows.at_least(arm.acceleration[joint] * d[-1] - w[-1])
            rows.at_least(arm.acceleration[joint] * d[-1] + w[-1])
            rows.at_least(x[layout.end] - cs.sum1(d) - cs.sum1(c))
            lower[layout.w(j)], upper[layout.w(j)] = -arm.speed[joint], arm.speed[joint]
            lower[layout.c(j)] = 0.0
        lower[layout.end], upper[layout.end] = max(self.earliest, 0.05), self.latest
        lower[layout.one] = upper[layout.one] = 1.0
        return rows.structure(x, lower, upper)

    def _structure_of(self, order: EventOrder) -> Structure:
        """Structure rows of an order; programs of one order follow each other."""
        latest = self._latest  # of one thread: another one may plan for another order
        if latest is None or latest[0] is not order:
            self._latest = latest = order, self._ordered_structure(order)
        return latest[1]

    def _ordered_structure(self, order: EventOrder) -> Structure:
        layout, arm = order.layout, self.robot.limits
        x = cs.SX.sym("x", layout.size)
        rows = _Rows()
        lower, upper = np.full(layout.size, SHORTEST), np.full(layout.size, LONGEST)
        start, goal = self._ends(rows, layout, x, lower, upper)
        crossing = layout.crossing
        for j, joint in enumerate(layout.joints):
            w, d, c = x[layout.w(j)], x[layout.d(j)], x[layout.c(j)]
            before = _delayed(w)
            signs, changes = order.speed_signs[j], order.change_signs[j]
            _arrive(rows, goal[joint] - start[joint], before, w, d, c)
            size = [changes[k] * (w[k] - before[k]) for k in range(layout.commands)]
            rows.equal((signs[-1] * w[-1] * d[-2] - size[-1] * d[-1]) * 10)
            angle = start[joint]
            # Ipopt and polishing keep rows to some 1e-8 rad/s, which is more of a slow joint's acceleration.
            inside = 1 - 1e-7 / min(1.0, arm.acceleration[joint]) ** 2
            lower[layout.c(j)] = 0.0
            for k in range(layout.commands):
                rows.at_least(inside * arm.acceleration[joint] * d[k] - size[k])
                rows.at_least(size[k] - min(GENTLEST, 0.5 * arm.acceleration[joint]) * d[k])
                angle += 0.5 * (before[k] + w[k]) * d[k] + w[k] * c[k]
                if k < layout.commands - 1:  # the target stays within the joint's limits
                    limit = arm.angle_max[joint] if signs[k] > 0 else arm.angle_min[joint]
                    if np.isfinite(limit):
                        rows.at_least(2 * signs[k] * (limit - angle) * size[k] - w[k] ** 2 * d[k])
                slows = k > 0 and signs[k] == signs[k - 1] and changes[k] != signs[k]
                if slows and k < layout.commands - 1:
                    lower[layout.c(j).start + k] = MIDDLE_CRUISE
                if k > 0 and signs[k] != signs[k - 1] and not order.rises:
                    since = x[crossing] - cs.sum1(d[:k]) - cs.sum1(c[:k])
                    rows.equal((since * size[k] - d[k] * signs[k - 1] * w[k - 1]) * 10)
                    lower[crossing] = 0.0
                    crossing += 1
                i = layout.w(j).start + k
                slowest = min(SLOWEST, 0.1 * arm.speed[joint])
                bounds = sorted((signs[k] * slowest, signs[k] * arm.speed[joint]))
                lower[i], upper[i] = bounds
        lower[layout.end], upper[layout.end] = max(self.earliest, 0.05), self.latest
        lower[layout.one] = upper[layout.one] = 1.0
        for joint, trapezoid in order.regime.items():
            edge = self.profiles(layout).edge(joint)
            if trapezoid:
                upper[layout.end] = min(upper[layout.end], edge)
            else:
                lower[layout.end] = max(lower[layout.end], edge)
        for first, other in order.equalities:
            rows.equal(cs.dot(cs.DM(order.times[other] - order.times[first]), x))
        if order.rises:
            lower[layout.crossing :] = 0.0
            for index, (joint, group) in enumerate(order.crossings):
                rows.equal(order.speed(x, self.rise_times[joint], joint, x[layout.crossing + index], group))
        rows.at_least(cs.mtimes(cs.DM(order.steps), x))
        return rows.structure(x, lower, upper)

    def _course(self, layout: Layout) -> ActingCourse | None:
        return ActingCourse.of(self.robot.acts, self._last(layout))

    def _last(self, layout: Layout) -> np.ndarray:
        """The row of the end of the motion, that of its trapezoidal profiles and the rise."""
        return unit_row(layout, layout.end) + self.rise * unit_row(layout, layout.one)

    def _ends(
        self, rows: _Rows, layout: Layout, x: cs.SX, lower: np.ndarray, upper: np.ndarray
    ) -> tuple[cs.SX, cs.SX]:
        """Start and goal as expressions; rows and bounds of those that are free."""
        for equation in self.ends.equations(layout, x):
            rows.equal(equation * 10)
        self.ends.bound(layout, lower, upper)
        return self.ends.expressions(layout, x)


def _arrive(rows: _Rows, asked: cs.SX, before: cs.SX, w: cs.SX, d: cs.SX, c: cs.SX) -> None:
    way = cs.dot(0.5 * (before + w), d[:-1]) + cs.dot(w, c) + 0.5 * w[-1] * d[-1]
    rows.equal((way - asked) * 10)


def _delayed(w: cs.SX) -> cs.SX:
    """Speeds before each acceleration phase: 0, w_1 .. w_{K-1}."""
    return cs.vertcat(0, *cs.vertsplit(w)[:-1])


class _Rows:
    """Collects rows and their bounds."""

    def __init__(self) -> None:
        self.rows: list[cs.SX] = []
        self.upper: list[float] = []

    def equal(self, row: cs.SX) -> None:
        self._add(row, 0.0)

    def at_least(self, row: cs.SX) -> None:
        self._add(row, np.inf)

    def _add(self, row: cs.SX, upper: float) -> None:
        self.rows.append(row)
        self.upper += [upper] * row.numel()

    def structure(self, x: cs.SX, lower: np.ndarray, upper: np.ndarray) -> Structure:
        function = cs.Function("structure", [x], [cs.vertcat(*self.rows)])
        return Structure(function, np.zeros(len(self.upper)), np.array(self.upper), lower, upper)


def _rounded(value: cs.SX, radius: float) -> cs.SX:
    """|value| with its kink rounded."""
    return cs.sqrt(value**2 + radius**2)
