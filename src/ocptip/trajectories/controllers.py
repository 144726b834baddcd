"""Trajectory controllers: the points that they get of a motion, and the motion between them.

A controller that interpolates runs trapezoidal velocity profiles exactly only on two conditions: their
switching times are among its points, and the points have angles and speeds only ("cubic"). With accelerations
as well ("quintic") it makes these continuous, and overshoots at acceleration steps. So it gets the points of
S-curves (`s_curves`). Their pieces are cubics, which quintic polynomials between points at the switching
times reproduce.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.trajectories.points import stamped
from ocptip.trajectories.trajectory import Trajectory

Controller = Literal["linear", "cubic", "quintic"]
CONTROLLERS = ("linear", "cubic", "quintic")
STEP = 0.01
"""Distance of points, s, where there are no switching times."""

UPDATE_RATE = 500.0
"""Updates of a controller per second where nobody says how many.

Drivers of present arms run at 500 Hz (UR e-series) to 1 kHz (Franka). Corners of straight lines last one
update, so this default is on the strict side for controllers at 100 to 250 Hz.
"""

NEAREST = 1e-6  # s: points are not nearer to each other than this
_APART = 0.01  # of a step, where accelerations have none
SHORTEST = 1e-3  # s: of a motion
ROUNDING = 1e-9  # s: of times


def controller_points(motion: Trajectory, controller: Controller, *, step: float | None = None) -> Trajectory:
    """Return the points for a controller, and with them the motion that it makes of them.

    Times are whole nanoseconds, as messages hold them.

    Args:
        motion: of trapezoidal velocity profiles or S-curves, or along a path.
        controller: "linear": angles every `step`; "cubic": angles and speeds at all switching times and every
            `step`, exact for trapezoidal velocity profiles; "quintic": with accelerations, exact for
            S-curves.
        step: s; of a linear controller its period, default 2 ms; of the others 10 ms.

    Raises:
        InputError: no such controller, a step that is not positive, a motion shorter than 1 ms, or for
            quintics a joint without rise time, or a timing of a path without a limit of the jerk.
    """
    if controller not in CONTROLLERS:
        raise InputError(f"controller: expected {', '.join(CONTROLLERS)}, got {controller!r}")
    step = usual_step(controller) if step is None else positive_number("step", step)
    if motion.end < SHORTEST:
        raise InputError(f"motion: lasts {motion.end:.4g} s, which is too short for a controller's points")
    if controller == "linear":
        times = step * np.arange(np.ceil(motion.end / step) + 1)
        return Trajectory.from_points(stamped(times), motion.states(times)[0], period=step)
    if controller == "cubic":
        steady = motion.timing is not None and motion.timing.times is not None
        times = _spread(motion.event_times, step, _APART * step if steady else NEAREST)
        angles, speeds, _ = motion.states(times)
        if motion.profiles is not None:
            _rest(motion, times, angles, speeds)
        else:  # it rests at both ends, wherever rounding puts these
            angles[-1], speeds[[0, -1]] = motion.goal, 0.0
        return Trajectory.from_points(times, angles, speeds)
    if motion.timing is not None:
        if motion.timing.times is None:
            raise InputError("quintic: timings without a limit of the jerk (--jerk) have acceleration steps")
        times = _spread(motion.event_times, step)
        angles, speeds, accelerations = motion.states(times)
        angles[-1], speeds[[0, -1]], accelerations[[0, -1]] = motion.goal, 0.0, 0.0
        return Trajectory.from_points(times, angles, speeds, accelerations)
    if not all(motion.rise_times or [0.0]):
        raise InputError("rise_time: must be > 0 for quintic, which cannot run acceleration steps")
    times = _spread(np.unique(np.concatenate(motion.breaks)), step)
    angles, speeds, accelerations = motion.states(times)
    _rest(motion, times, angles, speeds, accelerations)
    return Trajectory.from_points(times, angles, speeds, accelerations)


def usual_step(controller: Controller) -> float:
    """Distance of points for a controller where nobody says it, s."""
    return 1 / UPDATE_RATE if controller == "linear" else STEP


def _spread(events: np.ndarray, step: float, apart: float = NEAREST) -> np.ndarray:
    """Switching times and multiples of `step` between them, none too near to another one; both ends stay.

    Multiples keep a tenth of a step from switching times: rounded times weigh more the shorter an interval
    is. Where accelerations do not step at switching times, these need not be kept exactly: in an interval of
    some microseconds, the jerk would be that of the rounding.
    """
    end, kept = events[-1], [events[0]]
    for time in events[1:]:
        if time - kept[-1] >= apart and (time == end or end - time >= apart):
            kept.append(time)
    events = np.array(kept)
    grid = step * np.arange(1, np.ceil(end / step))
    after = np.clip(np.searchsorted(events, grid), 1, len(events) - 1)
    near = np.minimum(np.abs(grid - events[after]), np.abs(grid - events[after - 1]))
    return stamped(np.sort(np.concatenate([events, grid[near >= max(NEAREST, 0.1 * step)]])))


def _rest(motion: Trajectory, times: np.ndarray, angles: np.ndarray, *rates: np.ndarray) -> None:
    """Where a joint rests, make it rest exactly: rounded times would leave it a speed, and power a direction.

    Args:
        motion: of trapezoidal velocity profiles or S-curves.
        times: (N,), s.
        angles, rates: (N, n), changed in place.
    """
    for j, (joint, rise) in enumerate(
        zip(motion.joints, motion.rise_times or (0.0,) * motion.n, strict=True)
    ):
        still = (joint.speeds[:-1] == 0) & (joint.speeds[1:] == 0)
        begins = np.concatenate([[-np.inf], joint.times[:-1][still], joint.times[-1:]]) + rise
        ends = np.concatenate([joint.times[:1], joint.times[1:][still], [np.inf]])
        places = np.concatenate([joint.angles[:1], joint.angles[:-1][still], joint.angles[-1:]])
        for begin, end, place in zip(begins, ends, places, strict=True):
            resting = (times >= begin - ROUNDING) & (times <= end + ROUNDING)
            angles[resting, j] = place
            for rate in rates:
                rate[resting, j] = 0.0
