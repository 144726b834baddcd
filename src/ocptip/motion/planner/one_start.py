"""One start of the planner: random motion, smooth programs of growing sharpness, exact program, check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ocptip.basics.errors import InputError, SolverError
from ocptip.motion.check import MotionCheck, Prove, check_motion
from ocptip.motion.planner.attempt import Attempt, Clock, Rough
from ocptip.motion.planner.exact import Exact, Refiner
from ocptip.motion.planner.formulation import Formulation, Smoothing
from ocptip.motion.planner.free_ends import FreeEnds
from ocptip.motion.planner.program import MotionProgram, Pull
from ocptip.motion.planner.random_start import random_change, random_start
from ocptip.motion.provable import AHEAD, DEARER, PROOFS, Timed, sampled_near, slower_to_prove, within_reach
from ocptip.motion.task import MotionTask
from ocptip.motion.violations import broken_words
from ocptip.numerics.ipopt import ending
from ocptip.standing.further_limits import POINT_SPEED, TCP_SPEED
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import AskedLimit, tightened
from ocptip.standing.limit_kinds.worst_case import as_described
from ocptip.standing.limits import Limits
from ocptip.trajectories.trajectory import Trajectory

WIDTHS = (0.010, 0.004)  # s: half widths of the steps in the fine programs
PULL = 1e-3  # keeps a program regular where phases do nothing, see `Pull`
COARSE_ROWS, FINE_ROWS = 0.7, 0.75  # use of a limit from which node rows take part
COARSE_ROUNDS = 3
EXCHANGES, ITERATIONS = 5, 60  # at most so many solves of a smooth program, each with more rows; of each
KEPT, HOT = 1.005, 1e-3  # use of limits up to which they count as kept; barrier parameter of later solves
CYCLES = 3  # at most, of fine and exact programs, until a motion is verified
MERGES = (0.004, 0.0, 0.012)  # s: events nearer than this become simultaneous; tried in this order
SLOWER = (1.0, 1.4, 2.0)  # durations from which an exact program within a tolerance begins,
SLOWER_JUMPS = (1.2, 1.5, 2.0)  # and where jumps count, of which the smooth programs know little
SOLVED = 1e-4  # largest violation of an exact program that is good enough to be tightened
HOPELESS = 0.05  # largest violation from which a motion is worth its check
LOST = 1.0  # largest violation from which, with rows of stops, no other pace leads anywhere
TIGHTENINGS = 5
WORSE_EXACT = (
    1.0005  # times what a motion costs: what an exact program may have, to replace it once it is checked
)
ROUGHLY = 1.01  # times what a motion costs: what smooth programs may promise with another rise time,
HOPEFUL = 1.03, 1.005  # and after a random change: the coarse one, the fine one
PROMISING = 1.02  # times the cost of an S-curve motion, what its path may cost as ramps
MISS = 1e-7  # m and rad, by which start and goal may miss their poses
SLOWED = 1.001  # a motion that exceeds speeds or accelerations by less is slowed down by as much
NUMERICAL = (InputError, SolverError, ArithmeticError, np.linalg.LinAlgError)


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
        kinds = limits_of(task.robot, task.limits)
        tolerance, rest = task.limits.tolerance, np.array([task.start, task.goal])
        self.jumps = bool(tolerance.delay or tolerance.overshoot) and not self.formulation.rise
        self.smooth = as_described(task.robot, task.limits, rest, jumps=not self.formulation.rise)
        self._asked = [limit for limit in kinds if isinstance(limit, AskedLimit)]
        self.inner = task.limits
        for limit in self._asked:
            self.inner = limit.inner(self.inner)

    def rough(self, number: int, seed: int) -> Rough:
        """The start of that number, as far as the coarse program; if acceleration steps count, as far as the
        fine ones.
        """
        clock, task = Clock(), self.task
        rng = np.random.default_rng([seed, number])
        try:
            start = random_start(
                *(task.robot, task.start, task.goal, task.optimised, task.commands),
                *(self._at_first(task.limits, number), rng),
                task.objective,
                straight=number == 0,
            )
            most = task.limits.max_duration - self.formulation.rise
            if start.end > most:  # breaks limits, but is of the right length
                start = start.time_scaled(most / start.end)
            clock.stage("start")
            x = self.formulation.variables(start)
            coarse, cost = self._coarse(x, self._at_first(self.smooth, number), clock)
            x = coarse
            clock.stage("coarse")
            if self.jumps:
                x, _ = self._fine(coarse, clock)
                cost = Refiner(self.formulation, self.inner).slowed_cost(x)
                clock.stage("fine")
        except NUMERICAL as error:
            clock.pause()
            return Rough.failed(number, f"no motion: {error}", clock)
        clock.pause()
        return Rough(number, coarse, x, cost, "", clock)

    def run(self, number: int, seed: int, rough: Rough | None = None) -> Attempt:
        """The start of that number, from where it was left."""
        rough = rough or self.rough(number, seed)
        clock, status, x = rough.clock, rough.status, rough.x
        clock.go_on()
        best: tuple[Trajectory, MotionCheck] | None = None
        cycles = CYCLES - bool(self.task.limits.tolerance.given)
        try:
            for cycle in range(cycles):
                if x is None or rough.coarse is None:
                    break  # there is no rough motion
                if cycle > 0 and best is None and self.task.limits.stoppable:  # x has lost its way
                    x = self.formulation.slowed(rough.coarse, SLOWER[cycle])
                if cycle > 0 or not self.jumps:
                    x, _ = self._fine(x, clock)
                    clock.stage("fine")
                result, x, status = self._refined(x, clock)
                if result is None:
                    continue
                if best is not None and not self._better(result[1], best[1]):
                    break
                best = result
                if result[1].verified:
                    break
        except NUMERICAL as error:  # one start of many: what was found before counts
            status = f"no motion: {error}"
        motion, checked = best or (None, None)
        if checked is not None:
            broken = "; ".join(broken_words(self.task.robot, checked.violations))
            status = "verified" if checked.verified else f"not verified: {broken}"
        clock.pause()
        return Attempt(clock.result(number, status, checked), motion, checked)

    def hopped(self, before: Attempt, draw: tuple[int, ...]) -> Attempt:
        """A verified start solved again from its motion changed at random, if that is better; by itself.

        Basin hopping: near a good motion cheaper ones are more frequent than elsewhere.

        Args:
            before: the start.
            draw: seed of the change.
        """
        assert before.motion is not None
        assert before.check is not None
        x, cost = self.formulation.variables(before.motion), self._cost(before.check)
        limits = self._at_first(self.smooth, before.result.number)

        def coarse(x: np.ndarray, clock: Clock) -> tuple[np.ndarray, float]:
            return self._coarse(x, limits, clock)

        def begun(clock: Clock) -> np.ndarray | None:
            result = random_change(self.formulation.layout, x, np.random.default_rng(draw))
            for step, most in zip((coarse, self._fine), HOPEFUL, strict=True):
                result, promised = step(result, clock)
                if promised * self.task.objective.size > most * cost:
                    return None
            return result

        attempt = self._gone_on(before, begun)
        return replace(attempt, result=replace(attempt.result, hops=1))

    def changed(self, before: Attempt) -> Attempt:
        """A verified start of a task with other rise times, solved again with those of this one.

        It stays as it is if that does not cost less, or promises to cost more: from the beginning where
        acceleration steps count, else after the smooth programs. These begin from the motion, and from a
        coarse optimum near it, which may have another order of switching times.
        """
        assert before.motion is not None
        assert before.check is not None
        x, cost = self.formulation.variables(before.motion), self._cost(before.check)
        size = self.task.objective.size

        def begun(clock: Clock) -> np.ndarray | None:
            if self.jumps and Refiner(self.formulation, self.inner).slowed_cost(x) * size > PROMISING * cost:
                return None
            limits = self._at_first(self.smooth, before.result.number)
            results = [self._fine(x, clock)]
            results.append(self._fine(self._coarse(x, limits, clock)[0], clock))
            x_best, promised = min(results, key=lambda one: one[1])
            return x_best if promised * size <= ROUGHLY * cost else None

        return self._gone_on(before, begun)

    def _gone_on(self, before: Attempt, begun: Callable[[Clock], np.ndarray | None]) -> Attempt:
        """A verified start after exact programs from what smooth ones give, if better, and what that took."""
        assert before.check is not None
        clock, motion, checked = Clock(), before.motion, before.check
        try:
            start = begun(clock)
            clock.stage("fine")
            if start is not None:
                outcome, _, _ = self._refined(start, clock, WORSE_EXACT * self._cost(checked))
                if outcome is not None and self._better(outcome[1], checked):
                    motion, checked = outcome
        except NUMERICAL:
            pass  # what was found before counts
        clock.pause()
        result = clock.result(before.result.number, "verified", checked)
        return Attempt(result, motion, checked)

    def proved(self, before: Attempt, prove: Prove) -> Attempt:
        """A verified start with its certificate; solved again, tighter, where something is not proved.

        A proved motion replaces one that is not, if its cost is nearly the same.
        """
        assert before.motion is not None
        assert before.check is not None
        clock = Clock()
        checked = prove(self.task.robot, before.motion, before.check, self.task.limits)
        clock.stage("proof")
        result = self._made_provable(before.motion, checked, prove, clock)
        motion, checked, slower = result or Timed(before.motion, checked)
        clock.pause()
        status = before.result.status
        return Attempt(clock.result(before.result.number, status, checked), motion, checked, slower)

    def _made_provable(
        self, motion: Trajectory, checked: MotionCheck, prove: Prove, clock: Clock
    ) -> Timed | None:
        """A proved motion near one that is not: slower, which needs no program, or else a tighter one."""
        cost, refiner, exact = self._cost(checked), Refiner(self.formulation, self.inner), None
        slower = slower_to_prove(self.task.robot, motion, checked, self.task.limits, prove)
        clock.stage("proof")
        if slower and (checked.lacks_cancels or self._cost(slower.check) <= DEARER * cost):
            return slower
        try:
            for _ in range(PROOFS):
                faults = checked.not_proved(self._asked)
                if not within_reach(faults) or not sampled_near(checked, faults):
                    break
                ahead = [(limit, AHEAD * short) for limit, short, _ in faults]
                refiner.limits = tightened(refiner.limits, ahead)
                exact = exact or self._ordered(refiner, self.formulation.variables(motion), clock)
                exact = refiner.again(exact, [time for *_, times in faults for time in times])
                clock.stage("exact")
                motion, checked = self._checked(refiner, exact, clock)
                if not checked.verified or self._cost(checked) > DEARER * cost:
                    break
                checked = prove(self.task.robot, motion, checked, self.task.limits)
                clock.stage("proof")
                if checked.certified:
                    return Timed(motion, checked)
        except NUMERICAL:
            pass  # it stays as it was
        finally:
            clock.count(refiner)
        return None

    def _refined(
        self, x: np.ndarray, clock: Clock, most: float = np.inf
    ) -> tuple[tuple[Trajectory, MotionCheck] | None, np.ndarray, str]:
        """As `_exact`, with what it took."""
        refiner = Refiner(self.formulation, self.inner)
        try:
            return self._exact(refiner, x, clock, most)
        finally:
            clock.count(refiner)

    @staticmethod
    def _at_first(limits: Limits, number: int) -> Limits:
        """Without stops, which narrow a motion that is good without, but for brakes in every other start.

        Where these break much without, other joints have to turn together from the beginning.
        """
        return replace(limits.without_stops, brakes=limits.brakes if number % 2 else None)

    def _coarse(self, x: np.ndarray, limits: Limits, clock: Clock) -> tuple[np.ndarray, float]:
        """As `_fine`, of the coarse programs: repeated while the motion becomes much shorter than the
        grid.
        """
        formulation, x, cost = self.formulation, x.copy(), np.inf
        at_end = formulation.layout.end
        for round_ in range(COARSE_ROUNDS):
            end = x[at_end] = np.clip(x[at_end], formulation.earliest, formulation.latest)
            program = formulation.coarse_program(limits, end)
            x, cost = self._solved(program, x, COARSE_ROWS, 1e-3 if round_ else 1e-2, clock)
            if x[at_end] > 0.8 * end:
                break
        return x, cost

    def _fine(self, x: np.ndarray, clock: Clock) -> tuple[np.ndarray, float]:
        """Variables after the fine programs, and about the cost, in units of the objective."""
        cost = np.inf
        for width in WIDTHS:
            smoothing = Smoothing(width, 3 * width, 1.5 * width, 2.0)
            program = self.formulation.fine_program(self.smooth, smoothing, x)
            x, cost = self._solved(program, x, FINE_ROWS, 1e-4, clock)
        return x, cost

    def _exact(
        self, refiner: Refiner, x: np.ndarray, clock: Clock, most: float
    ) -> tuple[tuple[Trajectory, MotionCheck] | None, np.ndarray, str]:
        """A checked exact motion near x, its variables, and what is missing if there is none.

        One that costs more than `most` is not checked: where limits are tightened it costs still more.
        """
        best = self._ordered(refiner, x, clock)
        x = best.solution.x[: self.formulation.layout.size]
        if best.solution.violation > HOPELESS:
            missing = (
                f"limits stay broken, most of all {best.program.most_broken(best.solution.x)} by "
                f"{best.solution.violation:.2g} in its units ({ending(best.solution.status)})"
            )
            if self.task.limits.stoppable and best.solution.violation > LOST:
                raise SolverError(missing)
            return None, x, f"no motion: {missing}"
        if (cost := best.cost * self.task.objective.size) > most:
            return None, x, f"no motion: costs {cost:.4g}, others less"
        try:
            return self._checked(refiner, best, clock), x, ""
        except (InputError, SolverError) as error:  # the program was left so early that no motion is near x
            return None, x, f"no motion: {error}"

    def _ordered(self, refiner: Refiner, x: np.ndarray, clock: Clock) -> Exact:
        """The exact solution near x.

        Where the order of switching times at x leads nowhere, others that x suggests are tried, and within an
        uncertainty slower motions.
        """
        best, within = None, bool(self.task.limits.tolerance.given)
        paces = SLOWER_JUMPS if self.jumps else SLOWER if within else (1.0,)
        for merge in MERGES:
            for pace in paces:
                exact = refiner.first(self.formulation.slowed(x, pace), merge)
                if best is None or exact.solution.violation < best.solution.violation:
                    best = exact
                if best.solution.violation <= SOLVED:
                    break
            assert best is not None  # there is a pace
            if best.solution.violation <= (HOPELESS if within else SOLVED):
                break
        assert best is not None  # there is a merge
        clock.stage("exact")
        return best

    @staticmethod
    def _solved(
        program: MotionProgram, x: np.ndarray, share: float, mu: float, clock: Clock
    ) -> tuple[np.ndarray, float]:
        """Variables and about the cost: rows that are near at x take part, and then those that are broken."""
        solution, rows = None, program.no_rows()
        for _ in range(EXCHANGES):
            near, multipliers = program.near_rows(x, share).including(rows), None
            if solution is not None and (near - rows == 0 or np.max(program.use(x)) <= KEPT):
                break
            chosen = program.with_rows(near, Pull(x.copy(), PULL), near=x)
            if solution is not None:
                multipliers = chosen.carried(solution.multipliers, rows), solution.bound_multipliers
            how = {"tolerance": 1e-3, "max_iterations": ITERATIONS, "multipliers": multipliers}
            solution = chosen.solve(x, start_mu=mu, push=mu, **how)
            clock.iterations, clock.solves = clock.iterations + solution.iterations, clock.solves + 1
            x, rows, mu = solution.x, near, min(mu, HOT)
        assert solution is not None  # there is a first one
        return x, program.values(x)[0] * (1 + solution.violation)

    def _checked(self, refiner: Refiner, exact: Exact, clock: Clock) -> tuple[Trajectory, MotionCheck]:
        """The exact motion and its check; solved again, a little tighter, where the check finds a fault."""
        best = self._motion_and_check(refiner, exact, clock)
        checked = best[1]
        for attempt in range(TIGHTENINGS):
            worst = [(limit, checked.worst[limit.result]) for limit in self._asked]
            faults = [(limit, w) for limit, w in worst if w.excess > 0]
            if checked.verified or not faults:
                break
            refiner.limits = tightened(
                refiner.limits,
                [
                    (limit, w.excess)
                    for limit, w in faults
                    if attempt or not limit.rows_first or w.excess <= limit.largest_step
                ],
            )
            try:
                exact = refiner.again(exact, [w.time for _, w in faults])
                clock.stage("exact")
                result = self._motion_and_check(refiner, exact, clock)
            except NUMERICAL:
                break  # what was found before counts
            checked = result[1]
            if self._better(checked, best[1]) or not best[1].verified:
                best = result
        return best

    def _motion_and_check(
        self, refiner: Refiner, exact: Exact, clock: Clock
    ) -> tuple[Trajectory, MotionCheck]:
        motion = refiner.motion(exact)
        if (miss := self.ends.miss(motion.start, motion.goal)) > MISS:
            raise SolverError(f"start or goal misses its pose by {miss:.2g} (m, rad)")
        checked = check_motion(self.task.robot, motion, self.task.limits)
        ratios = [checked.worst["speed_ratio"].value, np.sqrt(checked.worst["acceleration_ratio"].value)]
        ratios += [w.value / w.limit for name, w in checked.worst.items() if name in (TCP_SPEED, POINT_SPEED)]
        if (
            not checked.verified and 1 < max(ratios) < SLOWED
        ):  # a program that was solved to its tolerance only
            slower = motion.slowed(max(ratios) * (1 + 1e-9))
            again = check_motion(self.task.robot, slower, self.task.limits)
            motion, checked = (slower, again) if again.verified else (motion, checked)
        clock.stage("check")
        return motion, checked

    def _cost(self, checked: MotionCheck) -> float:
        return self.task.objective.cost(checked.energy, checked.duration)

    def _better(self, checked: MotionCheck, than: MotionCheck) -> bool:
        (good, cost), (than_good, than_cost) = ((c.verified, self._cost(c)) for c in (checked, than))
        return (good, -cost) > (than_good, -than_cost)


def free_ends(task: MotionTask) -> FreeEnds:
    """The ends of the task's motion that the planner may choose."""
    margin = task.limits.angle_margin
    return FreeEnds(task.robot.arm, (task.start, task.goal), task.targets, task.optimised, margin)
