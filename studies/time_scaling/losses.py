"""One motion at many time scalings: where is a contact lost, which one, for how long?"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ocptip.motion.check import check_motion
from ocptip.standing.arm import Robot
from ocptip.standing.samples import MotionSamples
from ocptip.trajectories.trajectory import INSIDE, Trajectory

SEARCHED = (0.05, 20.0)  # tau* is sought between these
CELL = 5e-4  # s
TOLERANCE = 1e-4  # of tau*


@dataclass(frozen=True)
class Scaled:
    """A motion at one time scaling.

    Attributes:
        tau: all times are multiplied by it.
        stands: every contact persists at every instant looked at, and every state is solved.
        GN, GT: worst, by `check_motion`; above 1 they contain the acceleration of a contact, m/s^2.
        GN_time, GT_time: when, s.
        lost_s, longest_s: total and longest time in which the base does not stand, s; 0 if that is so only at
            the ends of intervals between events.
        lifted_s, slid_s: longest time in which each contact lifts off, or slides, s.
        unsolved: instants without a verified state (counted as lost).
        torque_ratio, speed_ratio, acceleration_ratio: largest, relative to the drives' limits.
    """

    tau: float
    stands: bool
    GN: float
    GT: float
    GN_time: float
    GT_time: float
    lost_s: float
    longest_s: float
    lifted_s: tuple[float, ...]
    slid_s: tuple[float, ...]
    unsolved: int
    torque_ratio: float
    speed_ratio: float
    acceleration_ratio: float


def cells(motion: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N,), s, of cells that fill the motion, with their widths (N,), s.

    Both ends of every interval between events are among them, with width 0.
    """
    times, widths = [], []
    for left, right in motion.intervals:
        n = max(1, math.ceil((right - left) / CELL))
        width = (right - left) / n
        middles = left + width * (np.arange(n) + 0.5)
        side = min(INSIDE, 0.25 * width)
        times += [[left + side], middles, [right - side]]
        widths += [[0.0], np.full(n, width), [0.0]]
    return np.concatenate(times), np.concatenate(widths)


def longest_run(marked: np.ndarray, widths: np.ndarray) -> float:
    """The largest sum of widths (N,) over a run of successive marked ones ((N,), bool)."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
    return float(max((widths[begin:end].sum() for begin, end in ends.reshape(-1, 2)), default=0.0))


def lost(samples: MotionSamples) -> np.ndarray:
    """(N,) True where a contact is lost, or where that is not known."""
    return ~(samples.states.persistent & samples.slip.solved & (samples.tip.GN < 1) & (samples.slip.GT < 1))


def moving(samples: MotionSamples) -> tuple[np.ndarray, np.ndarray]:
    """(N, contacts) True where a contact lifts off (or yields along its normal); where it slides."""
    accelerations, rest = samples.states.contact_accelerations, samples.states.rest_limit[:, None]
    lifts = np.abs(accelerations[:, :, 0]) > rest
    return lifts, ~lifts & (np.max(np.abs(accelerations[:, :, 1:]), axis=2) > rest)


def scaled(robot: Robot, motion: Trajectory, tau: float) -> Scaled:
    """Worst values and lost contacts of a motion with all times multiplied by tau."""
    motion = motion.time_scaled(tau)
    worst = check_motion(robot, motion).worst
    times, widths = cells(motion)
    samples = robot.samples(motion, times)
    gone, (lifts, slides) = lost(samples), moving(samples)
    GN, GT = worst["GN"], worst["GT"]
    return Scaled(
        tau=tau,
        stands=bool(not gone.any() and GN.value < 1 and GT.value < 1),
        GN=GN.value,
        GT=GT.value,
        GN_time=GN.time,
        GT_time=GT.time,
        lost_s=float(widths @ gone),
        longest_s=longest_run(gone, widths),
        lifted_s=tuple(longest_run(column, widths) for column in lifts.T),
        slid_s=tuple(longest_run(column, widths) for column in slides.T),
        unsolved=int(np.sum(~(samples.states.solved & samples.slip.solved))),
        **{name: worst[name].value for name in ("torque_ratio", "speed_ratio", "acceleration_ratio")},
    )


def first_loss(robot: Robot, motion: Trajectory, found: Scaled) -> dict:
    """Which contacts are the first to be lost, at a scaling that just does not stand."""
    motion = motion.time_scaled(found.tau)
    if found.GN >= 1 or found.GT >= 1:
        time = found.GN_time if found.GN >= 1 else found.GT_time
    else:
        times, _ = cells(motion)
        time = float(times[np.argmax(lost(robot.samples(motion, times)))])
    samples = robot.samples(motion, np.array([time]))
    lifts, slides = (mask[0] for mask in moving(samples))
    usage = samples.slip.usage[0]
    if not (lifts.any() or slides.any()) and np.isfinite(usage).any():  # beyond the cone only
        slides = usage > np.nanmax(usage) - 1e-3
    which = lifts if lifts.any() else slides
    kind = "lift-off" if lifts.any() else "slip" if slides.any() else "unknown"
    return {"kind": kind, "contacts": [int(k) + 1 for k in np.flatnonzero(which)], "time_s": time}


def critical(values: dict[float, Scaled], at: Callable[[float], Scaled]) -> tuple[float, float] | None:
    """The tau at which a contact is first lost when the motion becomes faster: (lost, stands), or None.

    Args:
        values: results so far, not empty; those of the search are added.
        at: computes one.

    Returns:
        The two are `TOLERANCE` apart or less; None if there is no change of state between the `SEARCHED`.
    """

    def computed(tau: float) -> Scaled:
        if tau not in values:
            values[tau] = at(tau)
        return values[tau]

    low, high = min(values), max(values)
    while values[low].stands and low > SEARCHED[0]:
        low = max(0.85 * low, SEARCHED[0])
        computed(low)
    while not values[high].stands and high < SEARCHED[1]:
        high = min(high / 0.85, SEARCHED[1])
        computed(high)
    falling = [tau for tau, one in values.items() if not one.stands]
    if not falling or max(falling) == max(values):
        return None
    low = max(falling)
    high = min(tau for tau in values if tau > low)
    while high - low > TOLERANCE:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if computed(middle).stands else (middle, high)
    return low, high


def rests_anywhere(robot: Robot, motion: Trajectory) -> bool:
    """Whether the base stands if the arm rests anywhere on the path of the motion."""
    q = motion.states(cells(motion)[0])[0]
    return bool(np.all(robot.contact_states(robot.loads(q, 0 * q, 0 * q)[1]).persistent))
