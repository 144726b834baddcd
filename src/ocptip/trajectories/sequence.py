"""Motions one after the other, each from rest to rest, and where a trajectory stands still between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.frozen import settle
from ocptip.trajectories.sampled import Motion, SampledMotion, stamped

STILL = 1e-6
"""rad, m and rad/s, m/s: samples that differ by less, or move slower, stand still."""


@dataclass(frozen=True, eq=False)
class MotionSequence:
    """Motions of the same joints, each begins where the one before has ended.

    Attributes:
        motions: in their order, each with its own time from 0.
        pauses: s, standstill after each.
    """

    motions: tuple[Motion, ...]
    pauses: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise InputError if there is no motion, or numbers of joints or pauses do not fit."""
        settle(self, motions=tuple(self.motions), pauses=tuple(map(float, self.pauses)))
        if not self.motions:
            raise InputError("motions: at least one is needed, got none")
        if len(self.pauses) != len(self.motions):
            raise InputError(f"pauses: expected {len(self.motions)}, got {len(self.pauses)}")
        for number, (motion, pause) in enumerate(zip(self.motions, self.pauses, strict=True), 1):
            positive_number(f"pauses[{number}]", pause, zero_allowed=True)
            if motion.n != self.n:
                raise InputError(f"motions[{number}]: has {motion.n} joints, the first one has {self.n}")

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.motions[0].n

    @cached_property
    def begins(self) -> np.ndarray:
        """When each motion begins, (m,), s."""
        lengths = [motion.end + pause for motion, pause in zip(self.motions, self.pauses, strict=True)]
        return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])

    @property
    def start(self) -> np.ndarray:
        """Angles before the first motion, (n,), rad."""
        return self.motions[0].start

    @property
    def goal(self) -> np.ndarray:
        """Angles after the last motion, (n,), rad."""
        return self.motions[-1].goal

    @property
    def end(self) -> float:
        """With all pauses, s."""
        return float(self.begins[-1]) + self.motions[-1].end + self.pauses[-1]

    @property
    def assumed(self) -> tuple[str, ...]:
        """What the reader of a file had to assume, in words."""
        return tuple(dict.fromkeys(text for motion in self.motions for text in motion.assumed))

    @cached_property
    def event_times(self) -> np.ndarray:
        """Events of all motions, sorted, s."""
        pairs = zip(self.begins, self.motions, strict=True)
        return np.unique(np.concatenate([begin + motion.event_times for begin, motion in pairs]))

    @property
    def jumps(self) -> np.ndarray:
        """How far each motion but the first starts from the end of the one before, (m - 1,), rad or m."""
        ends = zip(self.motions[:-1], self.motions[1:], strict=True)
        return np.array([np.max(np.abs(after.start - before.goal)) for before, after in ends])

    def time_scaled(self, factor: float) -> MotionSequence:
        """The same path with all times, pauses too, multiplied by `factor` > 0."""
        pauses = tuple(factor * pause for pause in self.pauses)
        return MotionSequence(tuple(motion.time_scaled(factor) for motion in self.motions), pauses)


def joined(sequence: Sequence[SampledMotion], pauses: Sequence[float]) -> SampledMotion:
    """One trajectory of sampled motions of the same kind, with standstill between them and after the last.

    `standstills` finds the seams again, and `parted` the motions. Times are whole nanoseconds. A controller
    that draws straight lines needs one period for the corners at both sides of a seam, which is added; its
    last pause is at least one.

    Args:
        sequence: all with or all without speeds, accelerations, period.
        pauses: s, after each.
    """
    begin, times, rows = 0.0, [], {"angles": [], "speeds": [], "accelerations": []}
    for motion, pause in zip(sequence, pauses, strict=True):
        own = stamped(begin + motion.times)
        seamless = bool(times) and own[0] - times[-1][-1] < 1e-9  # its first sample is the last one before
        values = {name: getattr(motion, name) for name in rows}
        times.append(own[int(seamless) :])
        for name, value in values.items():
            if value is not None:
                rows[name].append(value[int(seamless) :])
        begin = float(stamped(own[-1] + pause + (motion.period or 0.0)))
    if pauses[-1] > 0:
        times.append(stamped(times[-1][-1:] + max(pauses[-1], sequence[-1].period or 0.0)))
        for name, own in rows.items():
            if own:
                own.append(own[-1][-1:] if name == "angles" else np.zeros((1, sequence[0].n)))
    whole: dict[str, Any] = {name: np.concatenate(own) if own else None for name, own in rows.items()}
    angles = whole.pop("angles")
    return SampledMotion(np.concatenate(times), angles, **whole, period=sequence[0].period)


def standstills(motion: SampledMotion) -> list[tuple[int, int]]:
    """First and last sample of each standstill of all joints after the first sample has been left.

    A single sample at which all joints rest counts where samples have speeds.
    """
    same = np.all(np.abs(np.diff(motion.angles, axis=0)) <= STILL, axis=1)
    rests = np.ones(len(motion.times), dtype=bool)
    if motion.speeds is not None:
        rests = np.all(np.abs(motion.speeds) <= STILL, axis=1)
        same &= rests[:-1] & rests[1:]
    alone = rests.copy() if motion.speeds is not None else np.zeros(len(rests), dtype=bool)
    found, first = [], 0
    while first < len(rests):
        last = first
        while last < len(same) and same[last]:
            last += 1
        if first > 0 and (last > first or (alone[first] and first < len(rests) - 1)):
            found.append((first, last))
        first = last + 1
    return found


def parted(motion: SampledMotion, seams: Sequence[tuple[int, int]]) -> MotionSequence:
    """The motions between standstills.

    Args:
        motion: of one trajectory.
        seams: of :func:`standstills`, in their order; one that lasts to the last sample is the last pause.
    """
    period = motion.period or 0.0
    last, first, motions, pauses = len(motion.times) - 1, 0, [], []
    whole = np.array_equal(motion.times, stamped(motion.times))
    for begin, end in [*seams, *([] if seams and seams[-1][1] == last else [(last, last)])]:
        rows = slice(first, begin + 1)
        speeds, accelerations, before = (
            None if rate is None else rate[rows]
            for rate in (motion.speeds, motion.accelerations, motion.before)
        )
        times = motion.times[rows] - motion.times[first]
        own = stamped(times) if whole else times
        values = {"speeds": speeds, "accelerations": accelerations, "before": before}
        motions.append(replace(motion, times=own, angles=motion.angles[rows], **values))
        corners = period if begin < end < last else 0.0
        pauses.append(max(float(motion.times[end] - motion.times[begin]) - corners, 0.0))
        first = end
    return MotionSequence(tuple(motions), tuple(pauses))
