"""Random ramp motions to start from: paths on which the robot stands at rest, run slowly enough to stand."""

from __future__ import annotations

import numpy as np

from ocptip.reserves.tipping import TipMap
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.ramps import RampCommand

DETOUR = 1.2  # rad; random targets lie this far beyond start and goal at most
DRAWS = 300
CANDIDATES = 10  # of these the one with the least energy is taken: it ends in a better optimum more often
INSTANTS = 40
SLOWER = (1.0, 1.15, 1.3, 1.5, 1.8, 2.2, 2.7, 3.3, 4.0, 5.0, 6.0)
PATH_MARGIN = 0.5  # share of M0 / GN - M0 that a path at rest keeps beyond the limit


def random_start(
    robot: StandingMechanism,
    start: np.ndarray,
    goal: np.ndarray,
    joints: tuple[int, ...],
    commands: int,
    limits: MotionLimits,
    rng: np.random.Generator,
) -> ArmMotion:
    """A random motion from start to goal ((n,), rad) with `commands` ramps of each of `joints`.

    Targets, speeds and accelerations are drawn until the path neither collides nor tips at rest (after DRAWS
    draws the best path so far is taken), then the motion is slowed down until it stands. Of CANDIDATES such
    motions it is the one with the least electric energy.
    """
    candidates = [_candidate(robot, start, goal, joints, commands, limits, rng) for _ in range(CANDIDATES)]
    return min(candidates, key=robot.energy)


def _candidate(
    robot: StandingMechanism,
    start: np.ndarray,
    goal: np.ndarray,
    joints: tuple[int, ...],
    commands: int,
    limits: MotionLimits,
    rng: np.random.Generator,
) -> ArmMotion:
    limit = robot.limits
    speed, acceleration = (np.where(np.isfinite(v), v, 10.0) for v in (limit.speed, limit.acceleration))
    best, least = None, np.inf
    for _ in range(DRAWS):
        table: list[list[RampCommand] | None] = [None] * robot.n
        for joint in joints:
            ends = start[joint], goal[joint]
            low = max(limit.angle_min[joint], min(ends) - DETOUR)
            high = min(limit.angle_max[joint], max(ends) + DETOUR)
            targets = [*rng.uniform(low, high, commands - 1), goal[joint]]
            table[joint] = [
                RampCommand(t, speed[joint] * rng.uniform(0.1, 1), acceleration[joint] * rng.uniform(0.1, 1))
                for t in targets
            ]
        motion = ArmMotion.with_passive(start, goal, table, speed, acceleration)
        short = _path_violation(robot, motion, limits)
        if short < least:
            best, least = motion, short
        if short <= 0:
            break
    for factor in SLOWER:
        slower = best.time_scaled(factor)
        if _stands(robot, slower, limits):
            break
    return slower


def _path_violation(robot: StandingMechanism, motion: ArmMotion, limits: MotionLimits) -> float:
    """How far the path, taken at rest, misses its limits: 0 or less if it keeps them."""
    q = motion.states(np.linspace(0, motion.end, INSTANTS))[0]
    still = np.zeros_like(q)
    torque, wrenches = robot.loads(q, still, still)
    worst = [np.max(np.abs(torque) / robot.limits.torque) / limits.torque_ratio - 1]
    if robot.collision.labels:
        worst.append(10 * (limits.clearance - np.min(robot.collision.gaps(q))))
    if robot.further_limits.count:
        worst.append(np.max(robot.further_limits.excess(robot.further(q, still))))
    tip = robot.tip_over
    if tip.axes and not tip.free_rotation:
        needed = tip.reference_moment * (1 / limits.GN - 1) * (1 + PATH_MARGIN)
        moments, _ = TipMap(tip)(wrenches)
        worst.append((needed - np.min(moments)) / tip.reference_moment)
    return float(np.max(worst))


def _stands(robot: StandingMechanism, motion: ArmMotion, limits: MotionLimits) -> bool:
    times, _ = motion.quadrature(4)
    _, wrenches = robot.loads(*motion.states(times))
    states = robot.contact_states(wrenches)
    GN = robot.tip_over.evaluate(states).GN
    return bool(np.all(GN <= limits.GN)) and bool(
        np.all(robot.slip.evaluate(states, derivatives=False).GT <= limits.GT)
    )
