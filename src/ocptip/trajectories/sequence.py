"""Points of motions one after the other, and where a trajectory through points stands still between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ocptip.trajectories.points import Points, stamped
from ocptip.trajectories.trajectory import Trajectory

STILL = 1e-6
"""rad, m and rad/s, m/s: samples that differ by less, or move slower, stand still."""


def joined(sequence: Sequence[Points], pauses: Sequence[float]) -> Points:
    """The points of several motions of the same kind as one, with standstill between them and after the last.

    `standstills` finds the seams again, and `parted` the motions. Times are whole nanoseconds. A controller
    that draws straight lines needs one period for the corners at both sides of a seam, which is added; its
    last pause is at least one.

    Args:
        sequence: all with or all without speeds, accelerations, period.
        pauses: s, after each.
    """
    begin, times, rows = 0.0, [], {"angles": [], "speeds": [], "accelerations": []}
    for motion, pause in zip(sequence, pauses, strict=True):
        row = stamped(begin + motion.times)
        seamless = bool(times) and row[0] - times[-1][-1] < 1e-9  # its first sample is the last one before
        values = {name: getattr(motion, name) for name in rows}
        times.append(row[int(seamless) :])
        for name, value in values.items():
            if value is not None:
                rows[name].append(value[int(seamless) :])
        begin = float(stamped(row[-1] + pause + (motion.period or 0.0)))
    if pauses[-1] > 0:
        times.append(stamped(times[-1][-1:] + max(pauses[-1], sequence[-1].period or 0.0)))
        for name, row in rows.items():
            if row:
                row.append(row[-1][-1:] if name == "angles" else np.zeros_like(row[-1][-1:]))
    whole: dict[str, Any] = {name: np.concatenate(row) if row else None for name, row in rows.items()}
    angles = whole.pop("angles")
    return Points(np.concatenate(times), angles, **whole, period=sequence[0].period)


def standstills(points: Points) -> list[tuple[int, int]]:
    """First and last sample of each standstill of all joints after the first sample has been left.

    A single sample at which all joints rest counts where samples have speeds.
    """
    same = np.all(np.abs(np.diff(points.angles, axis=0)) <= STILL, axis=1)
    rests = np.ones(len(points.times), dtype=bool)
    if points.speeds is not None:
        rests = np.all(np.abs(points.speeds) <= STILL, axis=1)
        same &= rests[:-1] & rests[1:]
    alone = rests.copy() if points.speeds is not None else np.zeros(len(rests), dtype=bool)
    results, first = [], 0
    while first < len(rests):
        last = first
        while last < len(same) and same[last]:
            last += 1
        if first > 0 and (last > first or (alone[first] and first < len(rests) - 1)):
            results.append((first, last))
        first = last + 1
    return results


def parted(motion: Trajectory, seams: Sequence[tuple[int, int]]) -> Trajectory:
    """The motions between standstills.

    Args:
        motion: through points.
        seams: of :func:`standstills`, in their order; one that lasts to the last sample is the last pause.
    """
    points = motion.points
    assert points is not None
    period = points.period or 0.0
    last, first, motions, pauses = len(points.times) - 1, 0, [], []
    whole = np.array_equal(points.times, stamped(points.times))
    for begin, end in [*seams, *([] if seams and seams[-1][1] == last else [(last, last)])]:
        rows = slice(first, begin + 1)
        speeds, accelerations, before = (
            None if rate is None else rate[rows]
            for rate in (points.speeds, points.accelerations, points.before)
        )
        times = points.times[rows] - points.times[first]
        clock = stamped(times) if whole else times
        values = {"speeds": speeds, "accelerations": accelerations, "before": before}
        part = replace(points, times=clock, angles=points.angles[rows], **values)
        motions.append(replace(motion, points=part))
        corners = period if begin < end < last else 0.0
        pauses.append(max(float(points.times[end] - points.times[begin]) - corners, 0.0))
        first = end
    return Trajectory.from_segments(motions, pauses)
