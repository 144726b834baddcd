"""Motions with random deviations, each joint late by itself, jumps overshooting: does a contact let go?"""

from __future__ import annotations

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.deviations import Deviations
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.trajectory import Trajectory

EDGE = 0.5  # share of the deviations that are at an end of their interval
NEAR = 0.7  # share of the instants that are near an event
ON_TIME, SOMEWHERE = 0.5, 0.4  # shares of joints that are not late; of the others, late by less than the most
JUMPING = 0.6  # share of the joints with a jump within the delay that just do it, or are just before it
JUST = 1e-6  # s: so near to a jump


def random_deviations(own: Deviations, rng: np.random.Generator, count: int) -> np.ndarray:
    """Deviations (count, size) within the tolerance, many of them at its edge; tilts and pushes all are."""
    theta = np.zeros((count, own.size))
    ends = np.where(rng.random(theta.shape) < 0.5, own.low, own.high)
    theta = np.where(rng.random(theta.shape) < EDGE, ends, rng.uniform(own.low, own.high, theta.shape))
    sizes = {"push": own.tolerance.push, "base_push": own.tolerance.base_push}
    gravity = own.robot.support.gravity
    for name, at in own.places.items():
        side = rng.normal(size=(count, 3))
        side /= np.linalg.norm(side, axis=1)[:, None]
        if name in sizes:
            theta[:, at] = sizes[name] * side
        elif name == "gravity":
            across = np.cross(gravity, side)
            across /= np.linalg.norm(across, axis=1)[:, None]
            size, tilt = np.linalg.norm(gravity), own.tolerance.tilt
            theta[:, at] = (np.cos(tilt) - 1) * gravity + np.sin(tilt) * size * across
    return theta


def sampled_wrenches(
    robot: Robot, motion: Trajectory, tolerance: Uncertainty, rng: np.random.Generator, count: int
) -> np.ndarray:
    """Wrenches (count, 6) on the base at random instants of the motion run so."""
    own, n = worst_case_of(robot, tolerance).deviations, robot.n
    theta = random_deviations(own, rng, count)
    if "delay" in own.places:
        theta[:, own.places["delay"]] = 0.0  # done here, by the motion itself
    delay = tolerance.delay * np.sqrt(1 + theta[:, own.places["speed"]][:, 0] if "speed" in own.places else 1)
    delay = np.broadcast_to(delay, count)  # in the motion's own time
    times = rng.uniform(-0.05, motion.end + 0.05, count)
    near = rng.random(count) < NEAR
    times[near] = rng.choice(motion.event_times, near.sum()) + rng.uniform(0, delay[near])
    late = np.where(rng.random((count, n)) < ON_TIME, 0.0, delay[:, None])
    late = np.where(rng.random(late.shape) < SOMEWHERE, rng.uniform(0, 1, late.shape) * delay[:, None], late)
    s = np.empty((count, 3 * n))
    for j in range(n):
        s[:, j::n] = _states_of_joint(motion, j, times, late[:, j], delay, tolerance.overshoot, rng)
    return own.wrench(s, theta)[0]


def _states_of_joint(
    motion: Trajectory,
    j: int,
    times: np.ndarray,
    late: np.ndarray,
    delay: np.ndarray,
    overshoot: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Angle, speed, acceleration (count, 3) of a joint that is late, some of them at a jump within the delay.

    Those overshoot by a share of that step, or of the sum of all since the delay began, or have not jumped.
    """
    found = np.stack([part[:, j] for part in motion.states(times - late)], axis=1)
    events = motion.event_times
    q, qd, before = (part[:, j] for part in motion.states(events - JUST))
    after = motion.states(events + JUST)[2][:, j]
    step = np.where(np.abs(after - before) > 1e-6 * motion.acceleration_peaks[j], after - before, 0.0)
    for k in np.flatnonzero(rng.random(len(times)) < JUMPING):
        inside = np.flatnonzero((events >= times[k] - delay[k]) & (events <= times[k]) & (step != 0))
        if len(inside):
            e = rng.choice(inside)
            sizes = (step[e], np.sum(step[inside[inside <= e]]))
            way = rng.integers(3)
            found[k] = q[e], qd[e], before[e] if way == 2 else after[e] + overshoot * sizes[way]
    return found


def lost(
    robot: Robot, motion: Trajectory, tolerance: Uncertainty, rng: np.random.Generator, count: int
) -> int:
    """How many of so many random instants lose a contact, by the exact contact solver with least friction."""
    weakest = worst_case_of(robot, tolerance).footing
    states = weakest.contact_states(sampled_wrenches(robot, motion, tolerance, rng, count))
    return int(np.sum(~(states.solved & states.persistent)))
