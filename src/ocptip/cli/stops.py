"""What commands say about stops, and about what would help."""

from __future__ import annotations

import numpy as np

from ocptip.cli.layout import table
from ocptip.motion.check import MotionCheck
from ocptip.motion.stops import Kinds, Stops, check_stops
from ocptip.motion.task import MotionTask
from ocptip.standing.sensitivity import Sensitivity, motion_sensitivities
from ocptip.trajectories.sampled import Motion

SPACING = 0.01  # s, between instants of sensitivities


def stops_of(
    task: MotionTask, motion: Motion, checked: MotionCheck, kinds: Kinds | None = None
) -> Stops | None:
    """Stops of the kinds asked for; those along the path where the task's limits ask for them; else None."""
    if kinds is None and task.limits.stops is None:
        return None
    limits = task.limits if task.limits.stops is not None else task.stops.asked(task.limits)
    return check_stops(task.robot, motion, limits, task.stops, checked, kinds or "path")


def sensitivities_of(task: MotionTask, motion: Motion) -> tuple[Sensitivity, ...]:
    """What changes of the robot and its base would do to the worst reserves of a motion."""
    return motion_sensitivities(task.robot, *motion.states(motion.both_sides(SPACING)))


def stop_table(stops: Stops) -> list[str]:
    """Largest safe share of the planned speed over time, and how long stops take."""
    columns = [
        ("along the path", stops.path_speeds, "{:.2f}"),
        ("stop takes", stops.path_times, "{:.3f} s"),
        ("by brakes", stops.brake_speeds, "{:.2f}"),
        ("stop takes", stops.brake_times, "{:.3f} s"),
    ]
    known = [(title, values, form) for title, values, form in columns if values is not None]
    rows = [["stopped at", *(title for title, _, _ in known)]]
    for i, time in enumerate(stops.times):
        cells = [
            form.format(values[i]) if np.isfinite(values[i]) else "never rests" for _, values, form in known
        ]
        rows.append([f"{time:.3f} s", *cells])
    return ["largest safe share of the planned speed, at most 1", *table(rows, left=())]
