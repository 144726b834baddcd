"""A plan as it is run: the points that are written, and the check of the motion between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, cast

from ocptip.motion.check import OF_PATH, MotionCheck, Prove, check_motion
from ocptip.motion.provable import C, proved_slower
from ocptip.motion.violations import stated
from ocptip.numerics.bisection import bisected
from ocptip.numerics.time_limit import TimeBudget
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import NONE
from ocptip.trajectories.controllers import STEP, Controller, controller_points, usual_step
from ocptip.trajectories.points import Points
from ocptip.trajectories.trajectory import Trajectory

SLOWEST = 1.25  # a motion that has to be slowed down by more is another motion
STEPS = (1.0, 1.0005, 1.002, 1.005, 1.01, 1.02, 1.05, 1.1, SLOWEST)
CLOSE = 1e-4  # of the factor
_FORETOLD = 4  # checks at factors near the one that values foretell; halves follow


@dataclass(frozen=True, eq=False)
class Execution:
    """The execution of a planned motion: by a controller or by drives, with the motion that results.

    Attributes:
        controller: how it interpolates; `"ramps"`: drives that take the commands of velocity profiles.
        motion: that is run.
        points: of trajectory.json; a controller makes `motion` of them, or what `written` says.
        check: of `motion`.
        slower: factor of all times of the profiles, with which all limits are kept.
        step: between points, s.
        rise_times: of the commands' accelerations, (n,), s; empty: trapezoidal profiles.
        written: of drives: what a controller makes of the points, with its check; else None, as without time
            for that check.
    """

    controller: Controller | Literal["ramps"]
    motion: Trajectory
    points: Points
    check: MotionCheck
    slower: float
    step: float
    rise_times: tuple[float, ...] = ()
    written: Execution | None = None

    @classmethod
    def of_drives(
        cls,
        robot: StandingMechanism,
        motion: Trajectory,
        limits: Limits,
        check: MotionCheck,
        budget: TimeBudget | None = None,
        begin: Callable[..., Callable[[], Any]] = partial,
    ) -> Execution:
        """Execution by drives that take commands, whose check is known; the points are for controllers that
        run them exactly.

        These draw cubics for trapezoidal velocity profiles, and quintics for S-curves. Times in whole
        nanoseconds raise accelerations between neighbouring switching times of two joints. So the points are
        also checked, and slowed down by the minimum factor needed if they break a limit.

        Args:
            robot, motion, limits: as for `check_motion`.
            check: of the motion.
            budget: of time; without enough the points are written unchecked.
            begin: begins a call, and gives what waits for its result.
        """
        controller: Controller = "quintic" if motion.rise_times and all(motion.rise_times) else "cubic"
        slowest = SLOWEST if check.verified else 1.0
        compute = begin(partial(execute, slowest=slowest), robot, motion, limits, controller)
        share = 0.25 if limits.stoppable else 1.0  # checks and proofs of stops follow
        unchecked = "check of the points in trajectory.json"
        written = (budget or TimeBudget(None)).within(compute, None, unchecked, share)
        points = (
            controller_points(motion, controller, step=usual_step(controller)).points
            if written is None
            else written.points
        )
        assert points is not None
        return cls("ramps", motion, points, check, 1.0, STEP, motion.rise_times, written)

    @property
    def verified(self) -> bool:
        """All limits hold in what is run, and in what a controller makes of the written points."""
        return self.check.verified and (self.written is None or self.written.check.verified)

    def trajectory_to_dict(self) -> dict[str, Any]:
        """The motion that a controller makes of the written points, as plain data for JSON."""
        run = self.written or self
        return {
            "controller": run.controller,
            "slower": run.slower,
            "duration_s": run.motion.end,
            "verified": run.check.verified,
            "violations": stated(run.check.violations),
        }

    @property
    def trajectory_text(self) -> str:
        """The difference between the written points and the executed motion, in words; empty if there is
        none.
        """
        run = self.written
        if run is None or (run.check.verified and run.slower == 1):
            return ""
        if not run.check.verified:
            return "the points of trajectory.json, with times in whole ns, do not keep all limits"
        more = 1e3 * (run.motion.end - self.motion.end)
        return f"trajectory.json takes {more:.2g} ms more than the plan, so that its points keep all limits"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "name": self.controller,
            "step_s": self.step,
            "rise_time_s": list(self.rise_times),
            "slower": self.slower,
            "points": len(self.points.times),
            **self.check.to_dict(),
        }


def execute(
    robot: StandingMechanism,
    motion: Trajectory,
    limits: Limits,
    controller: Controller,
    *,
    step: float | None = None,
    slowest: float = SLOWEST,
    first: float = 1.0,
) -> Execution:
    """Points for a controller whose motion keeps all limits, slower than the plan if need be.

    Cubics run trapezoidal velocity profiles exactly, quintics S-curves. The interpolation of other motions
    differs from them a little and may break limits that they just keep. Then all times of the profiles are
    stretched by the minimum factor that helps, up to `slowest`. Beyond, the unchanged motion is returned,
    with its violations. Limits of the path itself, such as clearance, hold or break at any factor.

    Args:
        robot, motion, limits: as for `check_motion`.
        controller, step: see `ocptip.trajectories.controllers.controller_points`.
        slowest: factor, up to 1.25.
        first: factor that is tried first; above 1 it spares the search for a smaller one.
    """

    step = usual_step(controller) if step is None else step

    def tried(factor: float, limits: Limits = limits) -> Execution:
        run = controller_points(motion.slowed(factor), controller, step=step)
        checked = check_motion(robot, run, limits)
        assert run.points is not None
        return Execution(controller, run, run.points, checked, factor, step, motion.rise_times)

    factor, plain = first, replace(limits, tolerance=NONE)
    result: Execution | None = None
    for kept in (plain, limits) if limits.tolerance.given else (limits,):  # the quick check goes before
        result = slowed_as_needed(partial(tried, limits=kept), factor, slowest)
        if result is None:
            return tried(1.0)
        factor = result.slower
    assert result is not None  # there are limits
    return result


def slower_to_prove(
    robot: StandingMechanism, motion: Trajectory, limits: Limits, run: Execution, prove: Prove
) -> Execution:
    """The execution of a timing, with its proof; slower where that completes one which falls short of limits.

    Args:
        robot, motion, limits: as for `execute`.
        run: what it gave, with a certificate.
        prove: gives certificates.
    """
    if run.check.certified:
        return run

    def again(factor: float) -> Execution:
        first, controller = factor * run.slower, cast(Controller, run.controller)
        slower = execute(robot, motion, limits, controller, step=run.step, first=first)
        return replace(slower, check=prove(robot, slower.motion, slower.check, limits))

    return proved_slower(run, again, limits_of(robot, limits)) or run


def slowed_as_needed(tried: Callable[[float], C], first: float = 1.0, slowest: float = SLOWEST) -> C | None:
    """The result at the minimum factor that cures what timing can cure, as near as is worth a check.

    Args:
        tried: the motion with all its times stretched by a factor.
        first: factor that is tried first.
        slowest: the maximum factor.

    Returns:
        None: up to the maximum there is none.
    """
    checks: dict[float, MotionCheck] = {}

    def kept(factor: float) -> C | None:
        outcome = tried(factor)
        checks[factor] = outcome.check
        return outcome if outcome.check.timed_well else None

    low = first
    if result := kept(first):
        return result
    while steps := [step for step in (*STEPS, slowest) if low < step <= slowest]:
        # A broken limit says how far to go at least; the last step is tried in any case.
        asked = low * checks[low].slowing
        last = max(min(slowest, asked), steps[0])
        high = next((step for step in steps if asked <= step <= SLOWEST), last)
        if result := kept(high):
            return _narrowed(kept, checks, low, high, result)
        low = high
    return None


def _narrowed(
    kept: Callable[[float], C | None], checks: Mapping[float, MotionCheck], low: float, high: float, result: C
) -> C:
    """The result near the minimum factor between one without and one with it; `checks` has those of all."""
    turn = 0
    while not _near(low, high):
        middle, turn = 0.5 * (low + high), turn + 1
        likely = _foretold(low, high, checks[low].worst, checks[high].worst)
        if likely and turn <= _FORETOLD:
            without, having = bisected(
                lambda f, holds=likely: f if holds(f) else None, low, high, high, _near
            )
            middle = without if without > low else having
        if (new := kept(middle)) is None:
            low = middle
        else:
            high, result = middle, new
    return result


def _foretold(
    low: float, high: float, before: Mapping[str, Worst], after: Mapping[str, Worst]
) -> Callable[[float], bool] | None:
    """Whether values that are broken at the first of two factors keep their limits at one between them.

    Accelerations fall by the square of the factor. Where the force that presses rises meanwhile, the
    reciprocal of a utilisation is nearly linear in that square. None: nothing broken has a maximum.
    """
    pairs = [
        (1 / one.value, 1 / max(after[name].value, 1e-9), 1 / one.limit)
        for name, one in before.items()
        if one.broken and not one.least and one.limit > 0 and name in after and name not in OF_PATH
    ]

    def likely(factor: float) -> bool:
        share = (factor**2 - low**2) / (high**2 - low**2)
        return all((1 - share) * first + share * last >= asked for first, last, asked in pairs)

    return likely if pairs else None


def _near(low: float, high: float) -> bool:
    """Factors that differ by too little to be worth a check, measured by what they slow down."""
    return high - low <= max(CLOSE, 0.1 * (high - 1))
