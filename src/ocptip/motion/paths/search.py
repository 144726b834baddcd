"""A path among obstacles: straight lines in joint space from a start to a goal, searched by OMPL.

RRT-Connect grows one tree from every start and every goal; each new line is proved to be clear before it
joins a tree. Of the path that results, shortcuts replace detours. The clearance comes from this library's
collision model, as in all checks. The same seed gives the same path: the search ends after a number of
tested states, not after some time, unless a deadline is given.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import count, pairwise
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, PlanningError
from ocptip.motion.task import MotionTask, end_refusals
from ocptip.robots.collision.bounds import StraightLines
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.clearance import ClearanceLimit
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.trajectories.path_fit import FittedPath, blend_rows, rounded_lines
from ocptip.trajectories.path_legs import polygon_lengths

MOST_STATES = 400_000
"""States of a search whose distances are computed, at most."""

EXTRA = 0.004
"""m beyond the clearance, where ends allow it: motions within an uncertainty need some."""

AT_REST = 0.2
"""rad (sliding joints: m): spacing of the postures on a line in which the robot has to stand at rest."""

_SAG = 5e-4  # rad or m: distance of chords, which are tested, from the blend between them
_HALVINGS = 6  # of a blend at most; a corner that none rounds stays, and the motion stops there
_WITH_EXTRA = 0.25  # of the states are for paths that are farther away; then the clearance is enough
_FIRST = 20_000  # states of the first search
_FURTHER = 8_000  # states after which a path is taken as it is; before, others are searched
_RANGES = (1.0, 0.4)  # rad or m: longest line that a tree grows by at once, at first and after a failure
_SHORTCUTS = 60  # tried in a row without success, and rounds of them


def library_ompl() -> tuple[Any, Any, Any]:
    """The modules base, geometric and util of OMPL; InputError says how to get it."""
    try:
        base, geometric, util = (import_module(f"ompl.{name}") for name in ("base", "geometric", "util"))
    except ImportError:
        raise InputError("paths among obstacles need OMPL (pip install 'ocptip[paths]')") from None
    return base, geometric, util


class AllowedLines:
    """Straight lines between postures that a task allows: clear, and at rest within all limits.

    Args:
        task: of the motion.
        extra: m, beyond the clearance of the task.

    Attributes:
        at_rest: whether the limits at rest count, which take longer than the clearance.
        clearance: m, that the lines keep.
    """

    at_rest = False

    def __init__(self, task: MotionTask, extra: float) -> None:
        self.clearance = task.limits.clearance + extra
        self._lines = StraightLines(task.robot.collision, self.clearance)
        self._robot = task.robot.resting(0)
        kinds = limits_of(self._robot, task.limits)
        self._limits = [limit for limit in kinds if not isinstance(limit, ClearanceLimit)]

    @property
    def tested(self) -> int:
        """Number of states whose distances were computed."""
        return self._lines.tested

    def free(self, q: np.ndarray) -> bool:
        """Whether the posture q (n,) is allowed."""
        return self._lines.free(q) and not (self.at_rest and self._broken(q[None]))

    def clear(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether the straight line between two postures, (n,) each, is allowed."""
        return self._lines.clear(begin, end) and not (self.at_rest and self.broken(np.array([begin, end])))

    def all_clear(self, points: np.ndarray) -> bool:
        """Whether all lines between points (N, n) are allowed."""
        return all(self.clear(begin, end) for begin, end in pairwise(points))

    def broken(self, corners: np.ndarray) -> bool:
        """Whether a posture on the lines between corners (N, n) breaks a limit at rest."""
        parts = []
        for begin, end in pairwise(corners):
            number = int(np.ceil(np.max(np.abs(end - begin)) / AT_REST)) + 1
            parts.append(begin + np.linspace(0, 1, max(2, number))[:, None] * (end - begin))
        return self._broken(np.vstack(parts))

    def _broken(self, q: np.ndarray) -> bool:
        resting = Instants.at_rest(self._robot, q)
        return any(limit.path_excess(resting) > 0 for limit in self._limits)


def search_path(
    task: MotionTask, *, seed: int = 0, deadline: float = np.inf, most: int | None = None
) -> FittedPath:
    """A path from a start to a goal of a task that keeps the clearance: straight lines with rounded corners.

    Args:
        task: of which all pairs of start and goal postures count.
        seed: of the random search.
        deadline: of `time.perf_counter`, s, after which the search ends.
        most: number of tested states; default `MOST_STATES`.

    Raises:
        InputError: OMPL is not installed.
        PlanningError: start or goal is not allowed, or there is no path.
    """
    library_ompl()
    starts, goals = _ends(task)
    gaps = [task.robot.collision.least(np.array(postures)) for postures in (starts, goals)]
    extra = float(np.clip(0.5 * (min(map(np.max, gaps)) - task.limits.clearance), 0.0, EXTRA))
    tested, most = 0, most or MOST_STATES
    for more in sorted({extra, 0.0}, reverse=True):
        lines = AllowedLines(task, more)
        ends = [[q for q in postures if lines.free(q)] for postures in (starts, goals)]
        if not all(ends):
            continue
        how = {"seed": seed, "deadline": deadline, "most": int(most * (_WITH_EXTRA if more else 1))}
        result = _shortest(task, lines, *ends, **how)
        if result is not None and lines.broken(result):
            lines.at_rest = True
            result = _shortest(task, lines, *ends, **how)
        if result is not None:
            return rounded(result, lines)
        tested += lines.tested
    raise PlanningError(f"no path among the obstacles after {tested} tested states; {_HINT}")


def rounded(corners: np.ndarray, lines: AllowedLines) -> FittedPath:
    """The path through corners (N, n), each with the longest blend that is clear."""
    lengths, reaches = polygon_lengths(corners), []
    directions = np.diff(corners, axis=0) / np.diff(lengths)[:, None]
    for k, (before, after) in enumerate(pairwise(directions)):
        reach = 0.5 * float(min(np.diff(lengths)[k : k + 2]))
        for _ in range(_HALVINGS):
            if lines.all_clear(_blend(corners[k + 1] - reach * before, before, after - before, reach)):
                break
            reach *= 0.5
        else:
            reach = 0.0
        reaches.append(reach)
    return rounded_lines(corners, reaches)


def _blend(begin: np.ndarray, way: np.ndarray, bend: np.ndarray, reach: float) -> np.ndarray:
    """Points (N, n) on a blend, close enough that chords between them stand for it."""
    rows = blend_rows(begin, way, bend, reach)
    number = int(np.ceil(np.sqrt(3 * reach * float(np.max(np.abs(bend))) / (8 * _SAG)))) + 1
    places = np.linspace(0, 2 * reach, number + 1)
    return np.stack([np.polyval(rows[:, j], places) for j in range(len(begin))], axis=1)


_HINT = "another seed, more --seconds or a smaller clearance in [limits] may help"


def _ends(task: MotionTask) -> list[list[np.ndarray]]:
    """Starts and goals in which the robot may rest, those of the task first."""
    pairs = [(task.start, task.goal), *task.choices]
    ends = []
    for share, name in ((0, "start"), (1, "goal")):
        every = list({pair[share].tobytes(): pair[share] for pair in pairs}.values())
        reasons = [end_refusals(task, share, q) for q in every]
        allowed = [q for q, why in zip(every, reasons, strict=True) if not why]
        if not allowed:
            raise PlanningError(f"{name}: {'; '.join(reasons[0])}")
        ends.append(allowed)
    return ends


def _shortest(
    task: MotionTask,
    lines: AllowedLines,
    starts: Sequence[np.ndarray],
    goals: Sequence[np.ndarray],
    *,
    seed: int,
    deadline: float,
    most: int,
) -> np.ndarray | None:
    """Corners (N, n) of the quickest of several paths, of at most that many states; None: there is none.

    The time that a random search takes varies by a factor of a hundred: one that takes long is begun again
    with twice the number of states, and after a quick one there is time for others.
    """
    speed = np.where(np.isfinite(task.robot.limits.speed), task.robot.limits.speed, 1.0)
    states, paths, begin, failures = _FIRST, list[np.ndarray](), lines.tested, 0
    end = begin + most
    for turn in count():
        until = min(lines.tested + states, end)
        draw = np.random.SeedSequence([seed, turn]).generate_state(1)[0]
        range_ = _RANGES[min(failures, 1)]
        how = {"seed": int(draw) + 1, "range_": range_, "until": until, "deadline": deadline}
        result = _connected(task, lines, starts, goals, **how)
        if result is None:
            states, failures = 2 * states, failures + 1
        else:
            paths.append(result)
        enough = bool(paths) and (lines.tested > begin + _FURTHER or len(paths[-1]) == 2)
        if enough or lines.tested >= end or time.perf_counter() > deadline:
            break

    def duration(corners: np.ndarray) -> float:
        return float(np.sum(np.max(np.abs(np.diff(corners, axis=0)) / speed, axis=1)))

    return min(paths, key=duration, default=None)


def _connected(
    task: MotionTask,
    lines: AllowedLines,
    starts: Sequence[np.ndarray],
    goals: Sequence[np.ndarray],
    *,
    seed: int,
    range_: float,
    until: int,
    deadline: float,
) -> np.ndarray | None:
    """Corners (N, n) of a path, of at most `until` states that are tested in all; None: there is none."""
    base, geometric, util = library_ompl()
    n = task.robot.n

    def over() -> bool:
        return lines.tested >= until or time.perf_counter() > deadline

    def values(state: Any) -> np.ndarray:
        return np.array([state[j] for j in range(n)])

    class Validity(base.StateValidityChecker):
        def isValid(self, state: Any) -> bool:
            return True  # ends are checked before, and all other states with the lines to them

    class Motions(base.MotionValidator):
        def checkMotion(self, begin: Any, end: Any, *_: Any) -> bool:
            return not over() and lines.clear(values(begin), values(end))

    with _silent(util):
        util.RNG.setSeed(seed)
        space = base.RealVectorStateSpace(n)
        bounds = base.RealVectorBounds(n)
        for j, (low, high) in enumerate(joint_bounds(task, [*starts, *goals])):
            bounds.setLow(j, low)
            bounds.setHigh(j, high)
        space.setBounds(bounds)

        def state(q: np.ndarray) -> Any:
            made = space.allocState()
            for j, value in enumerate(q.tolist()):
                made[j] = value
            return made

        information = base.SpaceInformation(space)
        validity, motions = Validity(information), Motions(information)
        information.setStateValidityChecker(validity)
        information.setMotionValidator(motions)
        information.setup()
        problem, ends = base.ProblemDefinition(information), base.GoalStates(information)
        for q in starts:
            problem.addStartState(state(q))
        for q in goals:
            ends.addState(state(q))
        problem.setGoal(ends)
        planner = geometric.RRTConnect(information)
        planner.setRange(range_)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(base.PlannerTerminationCondition(over))
        if not problem.hasExactSolution():
            return None
        path = problem.getSolutionPath()
        shorter = geometric.PathSimplifier(information)
        shorter.reduceVertices(path, _SHORTCUTS, _SHORTCUTS)
        shorter.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS)
        shorter.reduceVertices(path, _SHORTCUTS, _SHORTCUTS)
        corners = np.array([values(path.getState(k)) for k in range(path.getStateCount())])
    return corners


def joint_bounds(task: MotionTask, ends: Sequence[np.ndarray] | np.ndarray) -> Iterator[tuple[float, float]]:
    """Limits of each joint within the margin that is asked for; joints without limits have one turn.

    The turn is around the ends, so that each posture is in it once: more turns only dilute random samples.
    """
    limits, turns = task.robot.limits, np.array(task.robot.units) == "rad"
    margin = np.where(turns, task.limits.angle_margin, 0.0)
    first, last = np.min(ends, axis=0), np.max(ends, axis=0)
    spare = np.maximum(np.pi - 0.5 * (last - first), 0.0)
    low = np.where(np.isfinite(limits.angle_min), limits.angle_min + margin, first - spare)
    high = np.where(np.isfinite(limits.angle_max), limits.angle_max - margin, last + spare)
    return zip(low.tolist(), high.tolist(), strict=True)


@contextmanager
def _silent(util: Any) -> Iterator[None]:
    """OMPL prints nothing meanwhile."""
    util.noOutputHandler()
    try:
        yield
    finally:
        util.restorePreviousOutputHandler()
