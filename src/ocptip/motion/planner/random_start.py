"""Random motions to start from: paths on which the robot stands at rest, run slowly enough to stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ocptip.motion.objective import ENERGY, Objective
from ocptip.motion.planner.profiles import Layout
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import Limit
from ocptip.standing.limit_kinds.stops import BrakeLimit
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory

DETOUR = 1.2  # rad; random targets lie this far beyond start and goal at most
LEISURE, HASTE = 0.1, 0.5  # least share of a joint's speed and acceleration that is drawn
DRAWS = 300
SHORTEST_WAY = 1e-6  # of the longest way of a joint: so far moves along the line what need not move
NEARER = 0.8, 25  # with objects each draw is that much nearer to the straight line; so many draws
CANDIDATES = 10  # of these the one with the least energy is taken: it ends in a better optimum more often
WITH_BRAKES = 40  # where brakes count: what they do depends on which joints turn which way, not on speeds
INSTANTS = 40
ONE_CHANGES, ALL_CHANGE = (0.1, 0.6), (0.1, 0.4)  # relative sizes of random changes: of a joint, of all
SLOWER = (1.0, 1.15, 1.3, 1.5, 1.8, 2.2, 2.7, 3.3, 4.0, 5.0, 6.0)


def random_start(
    robot: StandingMechanism,
    start: np.ndarray,
    goal: np.ndarray,
    joints: tuple[int, ...],
    commands: int,
    limits: Limits,
    rng: np.random.Generator,
    objective: Objective = ENERGY,
    straight: bool = False,
) -> Trajectory:
    """A random motion from start to goal ((n,), rad) with `commands` profile commands of each of `joints`.

    Targets, speeds and accelerations are drawn until the path neither collides nor tips at rest; after DRAWS
    draws the best path so far is taken. Then the motion is slowed down until it stands. Of CANDIDATES such
    motions it is the one with the minimum cost; with stops by brakes, of more of them the one whose stops
    violate limits by the minimum amount. Where time counts, speeds and accelerations are drawn high.

    Most random paths tilt a tray so far that objects on it slide at rest. With objects, draws therefore come
    nearer and nearer to the straight line in joint space.

    Args:
        straight: with objects, the motion along the straight line is the only candidate.
    """
    kinds = limits_of(robot, limits, joints)
    kept = tuple(limit for limit in kinds if not isinstance(limit, BrakeLimit))
    braked = [limit for limit in kinds if isinstance(limit, BrakeLimit)]
    paces = {"energy": (LEISURE,), "time": (HASTE,), "both": (LEISURE, HASTE)}[objective.name]
    straight &= bool(robot.carried)
    candidates = [
        _candidate(robot, start, goal, joints, commands, kept, rng, paces[i % len(paces)], straight)
        for i in range(1 if straight else WITH_BRAKES if braked else CANDIDATES)
    ]

    def badness(motion: Trajectory) -> tuple[float, float]:
        times = motion.quadrature(2)[0]
        instants = Instants.of_states(robot.during(motion), *motion.states(times), times)
        use = max((float(np.max(limit.use(instants))) for limit in braked), default=0.0)
        return max(use, 1.0), objective.cost(robot.energy(motion), motion.end)

    return min(candidates, key=badness)


def random_change(layout: Layout, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Variables (nx,) of a motion that takes as long, with other speeds and acceleration durations of one
    joint, or of all.
    """
    x, one = x.copy(), rng.random() < 0.5
    size = rng.uniform(*(ONE_CHANGES if one else ALL_CHANGE))
    joints = [int(rng.integers(len(layout.joints)))] if one else range(len(layout.joints))
    for j in joints:
        w, d, c = x[layout.w(j)], x[layout.d(j)], x[layout.c(j)]  # views
        w += size * np.abs(w).max() * rng.standard_normal(len(w))
        d *= np.exp(size * rng.standard_normal(len(d)))
        c += size * x[layout.end] / (2 * len(c)) * rng.standard_normal(len(c))
        np.maximum(c, 0.0, out=c)
        longer = (d.sum() + c.sum()) / x[layout.end]
        if longer > 1:
            d /= longer
            c /= longer
    return x


def _candidate(
    robot: StandingMechanism,
    start: np.ndarray,
    goal: np.ndarray,
    joints: tuple[int, ...],
    commands: int,
    limits: tuple[Limit, ...],
    rng: np.random.Generator,
    slowest: float,
    straight: bool,
) -> Trajectory:
    limit, way = robot.limits, np.abs(goal - start)
    speed, acceleration = (np.where(np.isfinite(v), v, 10.0) for v in (limit.speed, limit.acceleration))
    together = np.maximum(way, SHORTEST_WAY * np.max(way))  # along the straight line, in these proportions
    even = [together * np.min(most / together) if np.any(way) else most for most in (speed, acceleration)]
    nearer, draws = NEARER if robot.carried else (1.0, DRAWS)
    best, least, apart = None, np.inf, float(not straight)
    for _ in range(1 if straight else draws):
        table: list[list[RampCommand] | None] = [None] * robot.n
        for joint in joints:
            ends = start[joint], goal[joint]
            low = max(limit.angle_min[joint], min(ends) - DETOUR)
            high = min(limit.angle_max[joint], max(ends) + DETOUR)
            between = np.linspace(*ends, commands + 1)[1:-1]
            drawn = rng.uniform(low, high, commands - 1)
            targets = [*(apart * drawn + (1 - apart) * between), goal[joint]]
            table[joint] = [
                RampCommand(
                    t,
                    *(
                        apart * most[joint] * rng.uniform(slowest, 1) + (1 - apart) * even_limit[joint]
                        for most, even_limit in zip((speed, acceleration), even, strict=True)
                    ),
                )
                for t in targets
            ]
        motion = Trajectory.ending_together(start, goal, table, speed, acceleration)
        short = _path_violation(robot, motion, limits)
        if short < least:
            best, least = motion, short
        if short <= 0:
            break
        apart *= nearer
    assert best is not None  # the first draw is one
    return best.time_scaled(pace_that_stands(robot, best, limits, SLOWER) or SLOWER[-1])


def _path_violation(robot: StandingMechanism, motion: Trajectory, limits: tuple[Limit, ...]) -> float:
    """The largest violation of limits along the path, at rest at each point: 0 or less if there is none."""
    times = np.linspace(0, motion.end, INSTANTS)
    resting = Instants.at_rest(robot.during(motion), motion.states(times)[0], times)
    return float(np.max([limit.path_excess(resting) for limit in limits]))


def pace_that_stands(
    robot: StandingMechanism, motion: Trajectory, limits: tuple[Limit, ...], paces: Sequence[float] = (1.0,)
) -> float | None:
    """Time-scaling factor with which a motion keeps the limits of the contacts, checked on a coarse grid.

    Returns:
        The first such of the paces; None if it does at none.
    """
    times = motion.quadrature(4)[0]
    q, qd, qdd = motion.states(times)
    for pace in paces:
        acting = robot if not robot.acts.size else robot.during(motion.time_scaled(pace))
        instants = Instants.of_states(acting, q, qd / pace, qdd / pace**2, pace * times)
        if all(limit.kept(instants) for limit in limits if limit.of_contacts):
            return pace
    return None
