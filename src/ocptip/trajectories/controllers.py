"""What a trajectory controller makes of a ramp motion: the points that it gets, and the motion between them.

A controller that interpolates cannot run ramps as they are unless their events are among its points and the
points have angles and speeds only ("cubic"). One that is given accelerations, too ("quintic"), makes them
continuous, and overshoots wherever those of the ramps jump. So its points are those of a motion whose
accelerations change within a rise time: every joint's angle is the mean of the ramp motion's over the last
such time. Speeds, accelerations and angles stay within those of the ramps, the motion takes one rise time
longer, and its pieces are cubics, which quintic polynomials between points at its events reproduce.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.sampled import SampledMotion

Controller = Literal["linear", "cubic", "quintic"]
CONTROLLERS = ("linear", "cubic", "quintic")
NEAREST = 1e-6  # s: points are not nearer to each other than this
SHORTEST = 1e-3  # s: of a motion
ROUNDING = 1e-9  # s: of times


def controller_points(
    motion: ArmMotion, controller: Controller, *, step: float = 0.01, rise_time: float = 0.02
) -> SampledMotion:
    """Return the points for a controller, and with them the motion that it makes of them.

    Times are whole nanoseconds, as messages hold them.

    Args:
        motion: of ramps.
        controller: "linear": angles every `step`; "cubic": angles and speeds at all events and every `step`;
            "quintic": with accelerations, of the motion whose accelerations need `rise_time` to change.
        step: s; of a linear controller its period.
        rise_time: s.

    Raises:
        InputError: no such controller, a time that is not positive, or a motion shorter than 1 ms.
    """
    step, rise = positive_number("step", step), positive_number("rise_time", rise_time)
    if controller not in CONTROLLERS:
        raise InputError(f"controller: expected {', '.join(CONTROLLERS)}, got {controller!r}")
    if motion.end < SHORTEST:
        raise InputError(f"motion: lasts {motion.end:.4g} s, too short for a controller's points")
    if controller == "linear":
        times = step * np.arange(np.ceil(motion.end / step) + 1)
        return SampledMotion(np.round(times, 9), motion.states(times)[0], period=step)
    if controller == "cubic":
        times = _spread(motion.event_times, step)
        angles, speeds, _ = motion.states(times)
        _rest(motion, 0.0, times, angles, speeds)
        return SampledMotion(times, angles, speeds)
    edges = np.concatenate([joint.times for joint in motion.joints])
    times = _spread(np.unique(np.concatenate([edges, edges + rise])), step)
    angles, speeds, accelerations = _averaged(motion, rise, times)
    _rest(motion, rise, times, angles, speeds, accelerations)
    return SampledMotion(times, angles, speeds, accelerations)


def _spread(events: np.ndarray, step: float) -> np.ndarray:
    """Events and multiples of `step` between them, none too near to another one; both ends stay.

    Multiples keep a tenth of a step from events: rounded times weigh more the shorter an interval is.
    """
    end, kept = events[-1], [events[0]]
    for time in events[1:]:
        if time - kept[-1] >= NEAREST and (time == end or end - time >= NEAREST):
            kept.append(time)
    events = np.array(kept)
    grid = step * np.arange(1, np.ceil(end / step))
    after = np.clip(np.searchsorted(events, grid), 1, len(events) - 1)
    near = np.minimum(np.abs(grid - events[after]), np.abs(grid - events[after - 1]))
    return np.round(np.sort(np.concatenate([events, grid[near >= max(NEAREST, 0.1 * step)]])), 9)


def _rest(motion: ArmMotion, rise: float, times: np.ndarray, angles: np.ndarray, *rates: np.ndarray) -> None:
    """Where a joint rests, make it rest exactly: rounded times would leave it a speed, and power a direction.

    Args:
        motion: of ramps.
        rise: s; the joint rests that much later.
        times: (N,), s.
        angles, rates: (N, n), changed in place.
    """
    for j, joint in enumerate(motion.joints):
        still = (joint.speeds[:-1] == 0) & (joint.speeds[1:] == 0)
        begins = np.concatenate([[-np.inf], joint.times[:-1][still], joint.times[-1:]]) + rise
        ends = np.concatenate([joint.times[:1], joint.times[1:][still], [np.inf]])
        places = np.concatenate([joint.angles[:1], joint.angles[:-1][still], joint.angles[-1:]])
        for begin, end, place in zip(begins, ends, places, strict=True):
            resting = (times >= begin - ROUNDING) & (times <= end + ROUNDING)
            angles[resting, j] = place
            for rate in rates:
                rate[resting, j] = 0.0


def _averaged(motion: ArmMotion, rise: float, times: np.ndarray) -> tuple[np.ndarray, ...]:
    """Angles, speeds and accelerations (N, n) of the mean over the last `rise` seconds before each time."""
    now, before = motion.states(times), motion.states(times - rise)
    means = (_integral(motion, times) - _integral(motion, times - rise)) / rise
    return means, (now[0] - before[0]) / rise, (now[1] - before[1]) / rise


def _integral(motion: ArmMotion, times: np.ndarray) -> np.ndarray:
    """Of the angles from the start on, (N, n), rad s; the joints rest before and after."""
    columns = []
    for joint in motion.joints:
        lengths, angles, speeds = joint.durations, joint.angles[:-1], joint.speeds[:-1]
        pieces = lengths * (angles + lengths * (speeds / 2 + lengths * joint.accelerations / 6))
        at_edges = np.concatenate([[0.0], np.cumsum(pieces)])
        piece = np.clip(np.searchsorted(joint.times, times, side="right") - 1, 0, len(lengths) - 1)
        t = np.clip(times, 0, joint.end) - joint.times[piece]
        inside = angles[piece] + t * (speeds[piece] / 2 + t * joint.accelerations[piece] / 6)
        rest = np.minimum(times, 0) * joint.phi_start + np.maximum(times - joint.end, 0) * joint.phi_end
        columns.append(at_edges[piece] + t * inside + rest)
    return np.stack(columns, axis=-1)
