"""The timing of a path: solved on a grid, refined where something got through, checked as any motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, positive_number, whole_number
from ocptip.motion.check import OF_PATH, MotionCheck, check_motion
from ocptip.motion.files.execution import SLOWEST, slowed_as_needed
from ocptip.motion.objective import TIME, Objective
from ocptip.numerics.threads import one_thread
from ocptip.retiming.cheapest import CheapestTiming, PoweredTiming, Price, cheapest
from ocptip.retiming.drives import QuadraticDrives
from ocptip.retiming.fastest import Between, ExtraRows, FastestTiming, Grid, enough, fastest, spaced
from ocptip.retiming.jerk import steady
from ocptip.retiming.late import Couplings, LateJoints
from ocptip.retiming.rows import PathClock, TimingLimits
from ocptip.retiming.while_driving import clocks_to_try
from ocptip.retiming.whole_body import BaseLimits, Run, able_to_drive
from ocptip.standing.arm import Robot
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import AskedLimit, tightened
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.drive_profile import POSE
from ocptip.trajectories.path import JointPath, PathTiming
from ocptip.trajectories.trajectory import Trajectory

FASTEST_NODES, CHEAPEST_NODES = 300, 100
"""Intervals between nodes if nothing else is asked for: 0.1 % of the duration; costs are flatter. Delayed
joints also need cone programs.
"""

JERK_NODES = 150
"""The same with a limit of the jerk, whose program is the slowest."""

_ROUNDS, _MOST_ROUNDS = 4, 25  # of rows between nodes; of tangents
_LATE = 1e-5  # excess of rows of late joints, in units of M0 and GT, that is none
_TIGHTENINGS = 4
_MORE = 1.5  # times what is exceeded: by so much a limit is tightened
_ROUNDING = 1e-12
_STEPS = 1e-5  # of the greatest acceleration: so much the solver of the jerk leaves at nodes
_KEPT = 2e-4  # of the longest duration: for what gets through between nodes


@dataclass(frozen=True, eq=False)
class Retimed:
    """A path with its timing, and the evidence.

    Attributes:
        robot: that moves so: on a path of base and arm its base drives by the timing.
        motion: the result.
        check: of the motion, against all limits.
        objective: what is minimised.
        active: (N,) which limit decides in the intervals between nodes of the fastest timing, whether it is
            speeding up, braking or at its maximum speed.
        curve: (N,), 1/s: maximum ds/dt that the limits at the begin of each interval allow by themselves.
        curve_limits: (N,) by which limit.
        fastest: s, duration of the fastest timing, without delays of joints.
        cheapest: cost and its lower bound, on the grid; None for the fastest timing without delayed joints.
        slower: factor of all times with which what got through between nodes keeps the limits.
        later: kinds of limits that no timing knows of, only the check.
        jerk: (n,), rad/s^3 or m/s^3, that was asked for; None: acceleration steps are allowed.
        seconds: that it took, with the check.
    """

    robot: StandingMechanism
    motion: Trajectory
    check: MotionCheck
    objective: Objective
    active: tuple[str, ...]
    curve: np.ndarray
    curve_limits: tuple[str, ...]
    fastest: float
    cheapest: CheapestTiming | None
    slower: float
    later: tuple[str, ...]
    jerk: np.ndarray | None
    seconds: float

    @property
    def verified(self) -> bool:
        """All limits hold in the check; with a jerk limit that one also holds, and accelerations are
        continuous.
        """
        if self.jerk is None:
            return self.check.verified
        steps = np.max(self.motion.acceleration_steps / np.max(self.motion.acceleration_peaks))
        return self.check.verified and self.jerk_ratio <= 1 + 1e3 * _ROUNDING and bool(steps < _STEPS)

    @property
    def jerk_ratio(self) -> float:
        """Maximum jerk of the motion as a share of what was asked for; 0 where that was nothing."""
        return 0.0 if self.jerk is None else float(np.max(self.motion.jerk_peaks / self.jerk))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        bound = self.cheapest
        return {
            "objective": self.objective.to_dict(),
            "duration_s": self.motion.end,
            "fastest_s": self.fastest,
            "slower": self.slower,
            "nodes": len(self.motion.breaks[0]),
            "cost": None if bound is None else bound.cost,
            "lower_bound": None if bound is None else bound.lower_bound,
            "gap": None if bound is None else bound.gap,
            "active": {name: self.active.count(name) for name in dict.fromkeys(self.active)},
            "only_checked": list(self.later),
            "jerk_ratio": None if self.jerk is None else self.jerk_ratio,
            "seconds": self.seconds,
            **self.check.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class _Solved:
    grid: Grid
    fast: FastestTiming
    cheap: CheapestTiming | None
    couplings: Couplings

    @property
    def x(self) -> np.ndarray:
        return self.fast.x if self.cheap is None else self.cheap.x


@one_thread
def retime(
    robot: StandingMechanism,
    path: JointPath,
    limits: Limits | None = None,
    objective: Objective = TIME,
    *,
    nodes: int | None = None,
    ends: tuple[float, float] = (0.0, 0.0),
    jerk: ArrayLike | None = None,
    base: BaseLimits | None = None,
    slowest: float = SLOWEST,
) -> Retimed:
    """Time a path so that the robot stands and keeps its limits: as fast, or as cheaply, as possible.

    The cheapest timing is the global optimum for the grid of nodes, up to the gap of `Retimed.cheapest`; the
    fastest one is within 0.05 % of it with 300 nodes, 0.2 % with 100 (measured on ten paths). With drives
    other than DC motors, such as measured maps, the solution is a local one, and the bound is of quadratic
    drives below.
    The result is checked on a dense grid; `Retimed.verified` says with what outcome.

    Args:
        robot: on its support.
        path: of its joints; with `base` x, y and yaw of the base come before them.
        limits: default 0.9 for GN and GT, the arm's torques, no collision. With an uncertainty by which
            joints are delayed or overshoot, the fastest timing is also that of a cone program.
        objective: `TIME`, `ENERGY` or `priced`.
        nodes: intervals between nodes; default 300 (cheapest or with delayed joints 100), and more for paths
            on which a joint turns back more than five times.
        ends: ds/dt at start and end, 1/s, for stretches of longer motions.
        jerk: maximum of each joint, (n,) or one for all, rad/s^3 or m/s^3, beside the limits of jerk that
            joints and `limits` have. Where there is one, accelerations are continuous: a second stage,
            nowhere faster than the first, a local solution.
        base: limits of a base that drives on the path.
        slowest: maximum factor of all times by which a timing that breaks limits in the check is slowed down.

    Raises:
        InputError: the path does not fit the robot, or cannot be timed: says where, and by which limit; or
            its curvature has a step, which no limit of the jerk allows.
        SolverError: the program of the cheapest timing, or that of the jerk, is not solved.
    """
    begun, limits = perf_counter(), limits or Limits()
    _require_fit(robot, path, base)
    speeds = [positive_number("ends", speed, zero_allowed=True) for speed in ends]
    own_jerk = _limits_of_jerk(robot, limits, jerk)
    if base is not None:
        if own_jerk is not None:
            raise InputError("jerk: limits of jerk are not for paths of base and arm together")
        robot = able_to_drive(Robot.of(robot))
    coupled = LateJoints.wanted(limits.tolerance)
    usual = FASTEST_NODES if objective.name == "time" and not coupled else CHEAPEST_NODES
    usual = usual if own_jerk is None else min(usual, JERK_NODES)
    count = whole_number("nodes", enough(path, usual) if nodes is None else nodes, 8)
    squares, s = (speeds[0] ** 2, speeds[1] ** 2), spaced(path, count)
    best: Retimed | None = None
    for clocks in [()] if base else _clocks(robot, path, limits, objective, s, squares):
        result, run, checked, slower = _tight(robot, path, limits, objective, s, squares, clocks, base)
        if own_jerk is not None:
            run = _long_enough(run._replace(motion=steady(result.grid, run.motion, own_jerk)), limits)
            run, slower = _within_peaks(run, own_jerk)
            checked = check_motion(run.robot, run.motion, limits)
        if not checked.verified:
            run, checked, more = _slowed(run, limits, checked, slowest)
            slower *= more
        if best is None or checked.timed_well:
            curve, names = _curve(result)
            best = Retimed(
                run.robot, run.motion, checked, objective, result.fast.active, curve, names,
                _duration(result), result.cheap, slower, tuple(result.grid.limits.later), own_jerk,
                perf_counter() - begun,
            )  # fmt: skip
        if checked.timed_well:
            break
    assert best is not None
    return best


def _require_fit(robot: StandingMechanism, path: JointPath, base: BaseLimits | None) -> None:
    """Raise InputError if the path is not one of the robot, or rests."""
    joints = robot.n + (len(POSE) if base else 0)
    if path.joints != joints:
        columns, more = ("columns", " joints and x, y, yaw of its base") if base else ("joints", "")
        raise InputError(f"path: has {path.joints} {columns}, the {robot.kind} has {robot.n}{more}")
    path.require_motion()
    if base and (robot.acts.size or robot.arm is None):
        raise InputError("path of base and arm: for arms, without a drive profile and a process that varies")


def _tight(
    robot: StandingMechanism,
    path: JointPath,
    limits: Limits,
    objective: Objective,
    s: np.ndarray,
    ends: tuple[float, float],
    clocks: Sequence[PathClock],
    base: BaseLimits | None,
) -> tuple[_Solved, Run, MotionCheck, float]:
    """A timing, with limits that are tightened where its motion breaks them; the factor of its slow-down."""
    asked, known, timed_robot = limits, None, robot if base else _along(robot, path, clocks)
    for turn in range(_TIGHTENINGS):
        result = _solve(
            timed_robot, path, TimingLimits(timed_robot, asked, base), objective, s, ends, known, clocks
        )
        run, slower = _within_peaks(_long_enough(Run.of(robot, PathTiming(path, s, result.x)), limits))
        checked = check_motion(run.robot, run.motion, limits)
        tighter = _tightened(robot, asked, limits, checked)
        if checked.timed_well or tighter == asked or turn == _TIGHTENINGS - 1:
            return result, run, checked, slower
        asked, known = tighter, result.couplings
    raise AssertionError("the last turn returns")


@one_thread
def least_cost(
    robot: StandingMechanism, path: JointPath, limits: Limits, objective: Objective, nodes: int
) -> float:
    """Duration, s, of the fastest timing on a grid, or cost of the cheapest one in the objective's unit.

    Nothing is checked; angles and clearance are not checked.

    Args:
        robot: on its support.
        path: of its joints.
        limits: those with tolerances take long.
        objective: see `retime`.
        nodes: intervals between nodes.

    Raises:
        InputError: the path cannot be timed: says where, and by which limit.
        SolverError: the program of the cheapest timing is not solved.
    """
    grid = spaced(path, nodes)
    clocks = next(_clocks(robot, path, limits, objective, grid, (0.0, 0.0)))
    robot = _along(robot, path, clocks)
    timing = TimingLimits(robot, limits)
    result = _solve(robot, path, timing, objective, grid, (0.0, 0.0), clocks=clocks)
    if result.cheap is not None and objective.name != "time":
        return result.cheap.cost
    return max(Trajectory.from_path(path, grid, result.x).end, limits.min_duration)


def _along(robot: StandingMechanism, path: JointPath, clocks: Sequence[PathClock]) -> StandingMechanism:
    return robot.along(path, clocks[0].timing) if clocks else robot.along(path)


def _clocks(
    robot: StandingMechanism,
    path: JointPath,
    limits: Limits,
    objective: Objective,
    s: np.ndarray,
    ends: tuple[float, float],
) -> Iterator[tuple[PathClock, ...]]:
    """Clocks with which to time the path, see `clocks_to_try`; without a drive profile there are none."""

    def timed(limits: Limits, clocks: Sequence[PathClock]) -> PathTiming:
        timed_robot = _along(robot if clocks else Robot.of(robot).driving(None), path, clocks)
        result = _solve(
            timed_robot, path, TimingLimits(timed_robot, limits), objective, s, ends, clocks=clocks
        )
        return PathTiming(path, s, result.x)

    profile = robot.acts.drive_profile
    return iter([()]) if profile is None else clocks_to_try(profile, timed, limits)


def _solve(
    robot: StandingMechanism,
    path: JointPath,
    timing: TimingLimits,
    objective: Objective,
    s: np.ndarray,
    ends: tuple[float, float],
    known: Couplings | None = None,
    clocks: Sequence[PathClock] = (),
) -> _Solved:
    """On a grid, with rows between the nodes where they are broken, and with tangents.

    `known` are rows of delayed joints of the same grid, of limits that are not tighter.
    """
    grid, extra = Grid(robot, path, timing, s, ends, clocks), ExtraRows.none()
    late = LateJoints(grid) if LateJoints.wanted(timing.asked.tolerance) else None
    drives, couplings = _drives(robot, objective, late is not None), known or Couplings.none(len(s))
    longest = timing.asked.max_duration * (1 - _KEPT)
    spent = objective.with_power(robot.support.power)
    price = Price(spent.energy_weight, spent.time_weight, longest)
    between, measured = Between(grid), drives is not None and not drives.exact
    settled, turn = not measured, 0
    while True:
        fast = fastest(grid, extra)
        cheap = cheapest(grid, fast.polygons, drives, price, fast.x, couplings) if drives else None
        if cheap and measured and settled:
            cheap = _improved(grid, fast, price, cheap, couplings)
        solved = _Solved(grid, fast, cheap, couplings)
        more = between.broken(solved.x, rows=turn < _ROUNDS + 2 * measured)
        if len(more[0]):
            extra = extra.with_more(more[0], more[1], grid.widths, more[2], more[3])
        excess, rows = late.broken(solved.x) if late else (0.0, couplings)
        if excess > _LATE:
            couplings = couplings.joined(rows)
        elif not len(more[0]):
            if settled:
                return solved
            settled = True
        turn += 1
        if turn == _MOST_ROUNDS:
            return solved


def _drives(robot: StandingMechanism, objective: Objective, coupled: bool) -> QuadraticDrives | None:
    """Drives of the cone program; None: none is solved."""
    if objective.name == "time":
        return QuadraticDrives.free(robot.n) if coupled else None
    if not robot.direct_drives:
        raise InputError("objective: the cheapest timing is for drives at the joints (time works with all)")
    return QuadraticDrives.of(robot.motors, robot.limits)


def _improved(
    grid: Grid, fast: FastestTiming, price: Price, bound: CheapestTiming, couplings: Couplings
) -> CheapestTiming:
    """The best of the cone program's timing, the fastest, and what Ipopt makes of the first."""
    powered = PoweredTiming(grid, grid.robot.motors, price)
    tried = [bound.x] if len(couplings) else [bound.x, fast.x]
    if (result := powered.local(fast.polygons, bound.x, couplings)) is not None:
        tried.append(result)
    costs = [powered.cost(x) for x in tried]
    k = int(np.argmin(costs))
    return CheapestTiming(tried[k], costs[k], bound.lower_bound)


def _duration(solved: _Solved) -> float:
    return Trajectory.from_path(solved.grid.path, solved.grid.s, solved.fast.x).end


def _curve(solved: _Solved) -> tuple[np.ndarray, tuple[str, ...]]:
    """Maximum ds/dt at the begin of each interval by the rows there alone, and which limit it is."""
    polygons, speeds, names = solved.fast.polygons, [], []
    extra = ExtraRows.none()
    plain = solved.grid.polygons(extra)
    for i, count in enumerate(plain.counts):
        k = int(np.argmax(plain.corners[i, :count, 0]))
        speeds.append(np.sqrt(max(plain.corners[i, k, 0], 0.0)))
        edges = int(plain.numbers[i, k]), int(plain.numbers[i, k - 1 if k else count - 1])
        row_names = [solved.grid.name(edge, extra, i) for edge in edges]
        names.append(next(filter(None, row_names), ""))
    assert len(speeds) == len(polygons.counts)
    return np.array(speeds), tuple(names)


def _long_enough(run: Run, limits: Limits) -> Run:
    """Slower where the motion has to take longer; all limits are kept on the way to rest."""
    return run.slowed(max(1.0, limits.min_duration / run.motion.end))


def _limits_of_jerk(robot: StandingMechanism, limits: Limits, jerk: ArrayLike | None) -> np.ndarray | None:
    """(n,), rad/s^3 or m/s^3, of all; infinite: not limited. None: none is."""
    values = np.asarray(np.inf if jerk is None else jerk, dtype=float)
    if values.shape not in ((), (robot.n,)):
        raise InputError(f"jerk: expected 1 or {robot.n} numbers, got {values.size}")
    if not np.all(values > 0):
        raise InputError(f"jerk: must be > 0, got {values.min():.6g}")
    most = np.minimum(values, limits.jerks(robot.limits))
    return most if jerk is not None or np.isfinite(most).any() else None


def _within_peaks(run: Run, jerk: np.ndarray | None = None) -> tuple[Run, float]:
    """Slower by what speeds, accelerations and jerks, which a motion knows, are too great between nodes."""
    limits, motion = run.robot.limits, run.motion
    speed = float(np.max(motion.speed_peaks / limits.speed))
    acceleration = float(np.max(motion.acceleration_peaks / limits.acceleration))
    sharp = 0.0 if jerk is None else float(np.max(motion.jerk_peaks / jerk))
    factor = max(speed, np.sqrt(acceleration), np.cbrt(sharp), 1.0) * (1 + _ROUNDING)
    return run.slowed(factor), factor


def _tightened(robot: StandingMechanism, asked: Limits, limits: Limits, checked: MotionCheck) -> Limits:
    """The numbers asked for, tighter where a motion broke them; the same where that does not help."""
    names = [name for name, worst in checked.worst.items() if worst.broken and name not in OF_PATH]
    broken = [
        (limit, _MORE * checked.worst[limit.result].excess)
        for limit in limits_of(robot, limits)
        if isinstance(limit, AskedLimit) and limit.result in names and not limit.of_place
    ]
    asked = tightened(asked, broken)
    if not checked.stands and not names:  # of several states of the contacts the solver's is one that slides
        asked = replace(asked, GT=0.97 * asked.GT)
    return asked


class _Slowed(NamedTuple):
    """A motion with all its times stretched by a factor, and its check."""

    run: Run
    check: MotionCheck
    factor: float


def _slowed(run: Run, limits: Limits, checked: MotionCheck, slowest: float) -> _Slowed:
    """The motion slowed down by the minimum factor that cures what timing can, not beyond `max_duration`."""

    def tried(factor: float) -> _Slowed:
        if factor == 1:
            return unchanged
        slower = run.slowed(factor)
        return _Slowed(slower, check_motion(slower.robot, slower.motion, limits), factor)

    unchanged = _Slowed(run, checked, 1.0)
    longest = max(limits.max_duration / run.motion.end, SLOWEST)
    return slowed_as_needed(tried, slowest=min(slowest, longest)) or unchanged
