"""One start of the planner: random motion, smooth programs of growing sharpness, exact program, check."""

from __future__ import annotations

import time
from copy import copy
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, SolverError
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.planner.exact import Exact, Refiner
from ocptip.motion.planner.formulation import Formulation, Smoothing
from ocptip.motion.planner.free_ends import FreeEnds
from ocptip.motion.planner.program import MotionProgram, Pull
from ocptip.motion.planner.random_start import random_start
from ocptip.motion.task import MotionTask
from ocptip.numerics.ipopt import Solution
from ocptip.standing.arm import StandingRobot
from ocptip.standing.limit import AskedLimit
from ocptip.standing.limit_kinds import limits_of
from ocptip.standing.worst_case_limits import as_described
from ocptip.trajectories.arm_motion import ArmMotion

WIDTHS = (0.010, 0.004)  # s: half widths of the steps in the fine programs
PULL = 1e-3  # keeps a program regular where phases do nothing, see `Pull`
COARSE_ROWS, FINE_ROWS = 0.7, 0.75  # use of a limit from which node rows take part
COARSE_ROUNDS = 3
CYCLES = 3  # at most, of fine and exact programs, until a motion is verified
FURTHER = 2  # cycles more from a verified motion, which often find a better order
BINDING = 0.97  # share of a reserve's limit from which the contacts decide; only then a second cycle pays
MERGES = (0.004, 0.0, 0.012)  # s: events nearer than this become simultaneous; tried in this order
SLOWER = (1.0, 1.4, 2.0)  # durations from which an exact program within a tolerance begins
SOLVED = 1e-4  # largest violation of an exact program that is good enough to be tightened
HOPELESS = 0.05  # largest violation from which a motion is worth its check
TIGHTENINGS = 5
MISS = 1e-7  # m and rad, by which start and goal may miss their poses
SLOWED = 1.001  # a motion that exceeds speeds or accelerations by less is slowed down by as much
LEFT_OUT = "left out: other starts promise a lower cost"
NUMERICAL = (InputError, SolverError, ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class StartResult:
    """What became of one start.

    Attributes:
        number: of the start; with the seed it decides the random motion.
        status: "verified", or what is missing.
        energy: J, NaN if no motion came out.
        verified: the motion keeps all limits on the dense grid.
        iterations: of Ipopt, all solves together.
        seconds: wall time.
        cpu_seconds: CPU time of its thread, which other work on the machine disturbs less.
        solves: number of programs solved.
        stages: CPU seconds by stage: start, coarse, fine, exact, check.
    """

    number: int
    status: str
    energy: float
    verified: bool
    iterations: int
    seconds: float
    cpu_seconds: float
    solves: int
    stages: dict[str, float]


@dataclass(frozen=True, eq=False)
class Rough:
    """A start after its first smooth programs.

    Attributes:
        number: of the start.
        coarse, x: variables after the coarse and the fine programs; None if there are none.
        cost: of the motion, about; infinite if there is none.
        status: what is missing; empty if nothing is.
        clock: what it took.
    """

    number: int
    coarse: np.ndarray | None
    x: np.ndarray | None
    cost: float
    status: str
    clock: Clock

    @property
    def left_out(self) -> Attempt:
        """The start, given up here."""
        return Attempt(self.clock.result(self.number, self.status or LEFT_OUT, None), None, None)


@dataclass(frozen=True, eq=False)
class Attempt:
    """What a start has come to.

    Attributes:
        result: in numbers.
        motion, check: both None if no motion came out.
        x: variables to go on from, where another cycle may find a better order of events; else None.
        clock: what it took.
    """

    result: StartResult
    motion: ArmMotion | None
    check: MotionCheck | None
    x: np.ndarray | None = None
    clock: Clock | None = None


class Search:
    """Runs starts of one task; the programs' functions are built once.

    Args:
        task: a plannable task.
    """

    def __init__(self, task: MotionTask) -> None:
        self.task = task
        durations = task.limits.min_duration, task.limits.max_duration
        self.ends = free_ends(task)
        self.formulation = Formulation(
            *(task.robot, task.start, task.goal, task.optimised, task.commands, task.objective, durations),
            self.ends,
            np.array(task.rise_times or (0.0,) * task.robot.n),
        )
        self.smooth = as_described(task.robot, task.limits, np.array([task.start, task.goal]))
        self.first = task.limits.without_stops  # they narrow a motion that is good without them
        kinds = limits_of(task.robot, task.limits)
        self._asked = [limit for limit in kinds if isinstance(limit, AskedLimit)]
        self.inner = task.limits
        for limit in self._asked:
            self.inner = limit.inner(self.inner)

    def rough(self, number: int, seed: int) -> Rough:
        """The start of that number, as far as the first fine program."""
        clock, task = Clock(), self.task
        rng = np.random.default_rng([seed, number])
        try:
            start = random_start(
                *(task.robot, task.start, task.goal, task.optimised, task.commands, self.first, rng),
                task.objective,
            )
            most = task.limits.max_duration - self.formulation.rise
            if start.end > most:  # breaks limits, but is of the right length
                start = start.time_scaled(most / start.end)
            clock.stage("start")
            x = self._coarse(start, clock)
            clock.stage("coarse")
            coarse = x
            x, cost = self._fine(x, clock)
            clock.stage("fine")
        except NUMERICAL as error:
            clock.pause()
            return Rough(number, None, None, np.inf, f"no motion: {error}", clock)
        clock.pause()
        return Rough(number, coarse, x, cost, "", clock)

    def run(self, number: int, seed: int, rough: Rough | None = None) -> Attempt:
        """The start of that number, from where it was left."""
        rough = rough or self.rough(number, seed)
        clock, status, x = rough.clock, rough.status, rough.x
        clock.go_on()
        best: tuple[ArmMotion, MotionCheck] | None = None
        cycles = CYCLES - bool(self.task.limits.tolerance.given) if x is not None else 0
        try:
            for cycle in range(cycles):
                if cycle > 0:
                    begin = x if best is not None or not self.task.limits.stoppable else rough.coarse
                    x, _ = self._fine(begin, clock)
                    clock.stage("fine")
                found, x, status = self._refined(x, clock)
                if found is None:
                    continue
                if best is not None and not self._better(found[1], best[1]):
                    break
                best = found
                if found[1].verified:
                    break
        except NUMERICAL as error:  # one start of many: what was found before counts
            status = f"no motion: {error}"
        motion, checked = best or (None, None)
        if checked is not None:
            status = "verified" if checked.verified else f"not verified: {'; '.join(checked.violations)}"
        clock.pause()
        return Attempt(
            clock.result(number, status, checked), motion, checked, self._open_at(x, checked), clock
        )

    def further(self, before: Attempt) -> Attempt:
        """A verified start after another cycle of fine and exact programs from its motion."""
        assert before.x is not None
        assert before.clock is not None
        assert before.check is not None
        clock, x, motion, checked = before.clock.again(), None, before.motion, before.check
        try:
            start, _ = self._fine(before.x, clock)
            clock.stage("fine")
            found, end, _ = self._refined(start, clock)
            if found is not None and self._better(found[1], checked):
                motion, checked = found
                x = self._open_at(end, checked)
        except NUMERICAL:
            pass  # what was found before counts
        clock.pause()
        return Attempt(clock.result(before.result.number, "verified", checked), motion, checked, x, clock)

    def _refined(
        self, x: np.ndarray, clock: Clock
    ) -> tuple[tuple[ArmMotion, MotionCheck] | None, np.ndarray, str]:
        """As `_exact`, with what it took."""
        refiner = Refiner(self.formulation, self.inner)
        try:
            return self._exact(refiner, x, clock)
        finally:
            clock.iterations += refiner.iterations
            clock.solves += refiner.solves

    def _open_at(self, x: np.ndarray | None, checked: MotionCheck | None) -> np.ndarray | None:
        """Variables from which another cycle may pay; within a tolerance it rarely does."""
        pays = checked and checked.verified and self._at_the_limit(checked)
        return x if pays and not self.task.limits.tolerance.given else None

    def _coarse(self, start: ArmMotion, clock: Clock) -> np.ndarray:
        """Variables after the coarse programs; anew while the motion becomes much shorter than the grid."""
        formulation, limits = self.formulation, self.smooth.without_stops
        x = formulation.variables(start)
        at_end = formulation.layout.end
        for round_ in range(COARSE_ROUNDS):
            end = x[at_end] = np.clip(x[at_end], formulation.earliest, formulation.latest)
            program = formulation.coarse_program(limits, end)
            mu, push = (1e-2, 1e-2) if round_ == 0 else (1e-3, 1e-3)
            x = self._solve(program, x, COARSE_ROWS, mu, push, clock).x
            if x[at_end] > 0.8 * end:
                break
        return x

    def _fine(self, x: np.ndarray, clock: Clock) -> tuple[np.ndarray, float]:
        """Variables after the fine programs, and about the cost."""
        cost = np.inf
        for width in WIDTHS:
            program = self.formulation.fine_program(
                self.smooth, Smoothing(width, 3 * width, 1.5 * width, 2.0), x
            )
            solution = self._solve(program, x, FINE_ROWS, 1e-4, 1e-4, clock)
            x, cost = solution.x, program.values(solution.x)[0] * (1 + solution.violation)
        return x, cost

    def _exact(
        self, refiner: Refiner, x: np.ndarray, clock: Clock
    ) -> tuple[tuple[ArmMotion, MotionCheck] | None, np.ndarray, str]:
        """A checked exact motion near x, its variables, and what is missing if there is none.

        Where the order of events found at x leads nowhere, others that x suggests are tried; within a
        tolerance, of which the smooth programs know little, then those of slower motions.
        """
        best = None
        for pace in SLOWER if self.task.limits.tolerance.given else (1.0,):
            begin = self.formulation.slowed(x, pace)
            for merge in MERGES:
                exact = refiner.first(begin, merge)
                if best is None or exact.solution.violation < best.solution.violation:
                    best = exact
                if best.solution.violation <= SOLVED:
                    break
            if best.solution.violation <= HOPELESS:
                break
        assert best is not None  # there is a pace
        clock.stage("exact")
        x = best.solution.x[: self.formulation.layout.size]
        if best.solution.violation > HOPELESS:
            missing = (
                f"no motion: exact program not solved (Ipopt: {best.solution.status}, largest violation of a "
                f"limit {best.solution.violation:.2g} in its units)"
            )
            return None, x, missing
        return self._checked(refiner, best, clock), x, ""

    @staticmethod
    def _solve(
        program: MotionProgram, x: np.ndarray, share: float, mu: float, push: float, clock: Clock
    ) -> Solution:
        program = program.with_rows(program.near_rows(x, share), Pull(x.copy(), PULL), near=x)
        solution = program.solve(x, start_mu=mu, push=push, tolerance=1e-3)
        clock.iterations += solution.iterations
        clock.solves += 1
        return solution

    def _checked(self, refiner: Refiner, exact: Exact, clock: Clock) -> tuple[ArmMotion, MotionCheck]:
        """The exact motion and its check; solved again, a little tighter, where the check finds a fault."""
        best = self._motion_and_check(refiner, exact, clock)
        checked = best[1]
        for attempt in range(TIGHTENINGS):
            worst = [(limit, checked.worst[limit.quantity]) for limit in self._asked]
            faults = [(limit, w) for limit, w in worst if w.excess > 0]
            if checked.verified or not faults:
                break
            for limit, w in faults:
                if attempt or not limit.rows_first or w.excess <= limit.largest_step:
                    refiner.limits = limit.tightened(refiner.limits, w.excess)
            try:
                exact = refiner.again(exact, [w.time for _, w in faults])
                clock.stage("exact")
                found = self._motion_and_check(refiner, exact, clock)
            except NUMERICAL:
                break  # what was found before counts
            checked = found[1]
            if self._better(checked, best[1]) or not best[1].verified:
                best = found
        return best

    def _motion_and_check(
        self, refiner: Refiner, exact: Exact, clock: Clock
    ) -> tuple[ArmMotion, MotionCheck]:
        motion = refiner.motion(exact)
        if (miss := self.ends.miss(motion.start, motion.goal)) > MISS:
            raise SolverError(f"start or goal misses its pose by {miss:.2g} (m, rad)")
        checked = check_motion(self.task.robot, motion, self.task.limits)
        ratios = checked.worst["speed_ratio"].value, np.sqrt(checked.worst["acceleration_ratio"].value)
        if (
            not checked.verified and 1 < max(ratios) < SLOWED
        ):  # a program that was solved to its tolerance only
            slower = motion.slowed(max(ratios) * (1 + 1e-9))
            again = check_motion(self.task.robot, slower, self.task.limits)
            motion, checked = (slower, again) if again.verified else (motion, checked)
        clock.stage("check")
        return motion, checked

    def _at_the_limit(self, checked: MotionCheck) -> bool:
        """Whether the contacts decide the motion; if not, there is little that another order could give."""
        worst = [checked.worst[limit.quantity] for limit in self._asked if limit.of_contacts]
        return any(w.value > BINDING * w.limit for w in worst)

    def _better(self, checked: MotionCheck, than: MotionCheck) -> bool:
        (good, cost), (than_good, than_cost) = (
            (c.verified, self.task.objective.cost(c.energy, c.duration)) for c in (checked, than)
        )
        return (good, -cost) > (than_good, -than_cost)


def free_ends(task: MotionTask) -> FreeEnds:
    """The ends of the task's motion that the planner may choose."""
    arm = task.robot.arm if isinstance(task.robot, StandingRobot) else None
    margin = task.limits.angle_margin
    return FreeEnds(arm, (task.start, task.goal), task.targets, task.optimised, margin)


class Clock:
    """Adds up CPU time of the thread by stage, wall time, iterations and solves."""

    def __init__(self) -> None:
        self.stages: dict[str, float] = {}
        self.iterations = self.solves = 0
        self.seconds = self.cpu_seconds = 0.0
        self.go_on()

    def again(self) -> Clock:
        """Another clock that goes on from here."""
        other = copy(self)
        other.stages = dict(self.stages)
        other.go_on()
        return other

    def go_on(self) -> None:
        """From here on, perhaps in another thread."""
        self.began = time.perf_counter(), time.thread_time()
        self.last = self.began[1]

    def pause(self) -> None:
        """Count no further."""
        self.seconds += time.perf_counter() - self.began[0]
        self.cpu_seconds += time.thread_time() - self.began[1]

    def stage(self, name: str) -> None:
        """A stage of that name has ended."""
        now = time.thread_time()
        self.stages[name] = self.stages.get(name, 0.0) + now - self.last
        self.last = now

    def result(self, number: int, status: str, checked: MotionCheck | None) -> StartResult:
        """Of a start that took so long."""
        return StartResult(
            number=number,
            status=status,
            energy=checked.energy if checked else float("nan"),
            verified=bool(checked and checked.verified),
            iterations=self.iterations,
            seconds=self.seconds,
            cpu_seconds=self.cpu_seconds,
            solves=self.solves,
            stages=self.stages,
        )
