"""Check of a task: every segment with its robot and limits, the rests between, and the worst of all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.task import SAME, CycleTask, Task
from ocptip.motion.violations import statement
from ocptip.standing.contact_margins import ContactMargins
from ocptip.standing.elastic.drives import with_rise
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.within.in_motion import WithinTolerance
from ocptip.trajectories.points import Points
from ocptip.trajectories.sequence import parted, standstills
from ocptip.trajectories.trajectory import Trajectory

NEAR = 1e-3  # rad, m: a standstill so near to a segment's goal is that of the segment
_MOST_ASSIGNMENTS = 10_000


@dataclass(frozen=True)
class CycleCheck:
    """Outcome of the check of a cycle, or of a motion, which has one segment.

    Attributes:
        names: of the segments; that of a motion is empty.
        segments: check of each motion, rest before and after it with what it holds included; times count from
            its begin.
        begins: s, when each begins.
        pauses: s, standstill after each.
        rest_energies: J, electric, of these.
        whole: of all: energy and duration with all rests, the worst value of each quantity, times from the
            begin of the first.
    """

    names: tuple[str, ...]
    segments: tuple[MotionCheck, ...]
    begins: tuple[float, ...]
    pauses: tuple[float, ...]
    rest_energies: tuple[float, ...]
    whole: MotionCheck

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: those of the whole, and of a cycle `segments` with those of each."""
        if self.names == ("",):
            return self.whole.to_dict()
        rows = zip(self.names, self.segments, self.begins, self.pauses, self.rest_energies, strict=True)
        return {
            **self.whole.to_dict(),
            "segments": [
                {"name": name, "begin_s": begin, "rest_s": pause, "rest_energy_J": energy, **check.to_dict()}
                for name, check, begin, pause, energy in rows
            ],
        }


def check_cycle(
    task: Task,
    motion: Trajectory,
    *,
    step: float = 0.01,
    progress: Callable[[int, int, None], None] | None = None,
) -> CycleCheck:
    """Check the motions of a task, each against the limits and with the robot of its segment.

    At each seam the base has to stand at rest with what is held before and after it.

    Args:
        task, motion: of as many segments.
        step, progress: see `check_motion`.

    Raises:
        InputError: another number of motions than of segments, or one that does not fit the robot.
    """
    if len(motion.segments) != len(task.segments):
        raise InputError(f"motion: has {len(motion.segments)} segments, {task.name} has {len(task.segments)}")
    pairs = list(zip(task.segments, motion.segments, strict=True))
    how = {"step": step, "progress": progress}
    checks = [check_motion(s.task.robot, segment_motion, s.task.limits, **how) for s, segment_motion in pairs]
    return cycle_check(task, motion, checks)


def with_rises(task: Task, motion: Trajectory, checked: CycleCheck) -> CycleCheck:
    """The check of a motion with the rise time that leaves minimum vibration of elastic joints; that of a
    cycle is unchanged.
    """
    if task.is_cycle:
        return checked
    drives = with_rise(task.robot, motion.segments[0])
    return cycle_check(task, motion, [replace(checked.whole, drives=drives)])


def cycle_check(task: Task, motion: Trajectory, checks: Sequence[MotionCheck]) -> CycleCheck:
    """The check of a motion or a cycle from the checks of its motions."""
    if not task.is_cycle:
        return CycleCheck(("",), tuple(checks), (0.0,), (0.0,), (0.0,), checks[0])
    task = cast(CycleTask, task)
    pauses, segments = motion.pauses, task.segments
    energies = [
        pause * segment.standby(segment_motion.goal) if pause else 0.0
        for segment, segment_motion, pause in zip(segments, motion.segments, pauses, strict=True)
    ]
    jumps = [
        f"{title} starts {jump:.3g} rad or m off the end of the one before"
        for title, jump in zip(task.titles()[1:], motion.jumps, strict=True)
        if jump > SAME
    ]
    jumps += [
        f"{title} rests for {1e3 * pause:.3g} ms, joints are delayed by up to {1e3 * late:.4g} ms"
        for number, (title, pause, segment) in enumerate(zip(task.titles(), pauses, segments, strict=True), 1)
        if (task.closed or number < len(segments))  # a closed cycle begins anew
        and pause < (late := segment.task.limits.tolerance.late)
    ]
    names = tuple(segment.name for segment in segments)
    whole = _whole(names, checks, motion.begins, jumps, sum(energies), motion.end)
    begins = tuple(motion.begins.tolist())
    return CycleCheck(names, tuple(checks), begins, motion.pauses, tuple(energies), whole)


def parts_of(task: CycleTask, motion: Trajectory) -> Trajectory:
    """The motions of one trajectory: its standstills part the segments.

    If there are more than that, those at the goals of the segments count.

    Raises:
        InputError: too few standstills, or it is not clear which of them are meant.
    """
    points, wanted = motion.points, len(task.segments)
    assert points is not None
    result, last = standstills(points), len(points.times) - 1
    tail = [seam for seam in result if seam[1] == last]
    inner = _longest(points, [seam for seam in result if seam[1] < last])
    if len(inner) < wanted - 1:
        raise InputError(
            f"rests {len(inner)} times between its ends; {wanted} segments of {task.name} need {wanted - 1}"
        )
    if len(inner) > wanted - 1:
        assignments = _assignments(task, [points.angles[begin] for begin, _ in inner])
        if len(assignments) != 1:
            which = "none fits their goals" if not assignments else "several fit their goals"
            raise InputError(
                f"rests {len(inner)} times between its ends; which {wanted - 1} of them part the segments "
                f"of {task.name} is not clear ({which}); check the plan.json, which says it"
            )
        inner = [inner[k] for k in assignments[0]]
    return parted(motion, [*inner, *tail])


def segments_of(task: Task, motion: Trajectory) -> Trajectory:
    """The segments of what a file holds.

    Raises:
        InputError: it is not clear where they begin, or there are more or fewer than in the task.
    """
    if task.is_cycle and motion.points is not None:
        motion = parts_of(cast(CycleTask, task), motion)
    if len(motion.segments) != len(task.segments):
        number_of_parts = f"has {len(task.segments)}" if task.is_cycle else "is a single motion"
        raise InputError(f"has {len(motion.segments)} segments, {task.name} {number_of_parts}")
    return motion


def _longest(points: Points, seams: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The standstills; of neighbours between which no joint goes far, as at the end of a profile, the
    longest.
    """
    groups: list[list[tuple[int, int]]] = []
    for seam in seams:
        if groups:
            way = points.angles[groups[-1][-1][1] : seam[0] + 1]
            if np.ptp(way, axis=0).max() <= NEAR:
                groups[-1].append(seam)
                continue
        groups.append([seam])
    return [max(group, key=lambda seam: points.times[seam[1]] - points.times[seam[0]]) for group in groups]


def _assignments(task: CycleTask, postures: list[np.ndarray]) -> list[list[int]]:
    """Standstills at the goals of all segments but the last, in their order: the first two assignments, if
    any.
    """
    assignments: list[list[int]] = [[]]
    for end in range(1, len(task.segments)):
        fitting = [k for k, q in enumerate(postures) if task.offset(end, q, NEAR).max() <= NEAR]
        assignments = [[*way, k] for way in assignments for k in fitting if not way or k > way[-1]][
            :_MOST_ASSIGNMENTS
        ]
    return assignments[:2]


def _whole(
    names: Sequence[str],
    checks: Sequence[MotionCheck],
    begins: np.ndarray,
    jumps: list[str],
    rest_energy: float,
    duration: float,
) -> MotionCheck:
    """The worst of all, times shifted to those of the cycle."""
    worst: dict[str, Worst] = {}
    violations = [*map(statement, jumps)]
    contacts: ContactMargins | None = None
    for name, check, begin in zip(names, checks, begins, strict=True):
        worst_here = {w.name: _placed(w, name, float(begin)) for w in check.worst.values()}
        others = [w for w in check.violations if not w.name]
        violations += [w for w in worst_here.values() if w.broken]
        violations += [replace(w, detail=f"{w.detail} (segment {name})") for w in others]
        for key, result in worst_here.items():
            if key not in worst or result.excess > worst[key].excess:
                worst[key] = result
        shifted = check.contacts.later(float(begin))
        contacts = shifted if contacts is None else contacts.worse(shifted)
    assert contacts is not None  # there is a segment
    proofs = [check.certificate for check in checks if check.certificate is not None]
    proof = proofs[0].followed_by(proofs[1:], begins.tolist()) if len(proofs) == len(checks) else None
    return MotionCheck(
        verified=not violations,
        energy=sum(check.energy for check in checks) + rest_energy,
        duration=duration,
        worst=worst,
        violations=tuple(violations),
        samples=sum(check.samples for check in checks),
        stands=all(check.stands for check in checks),
        contacts=contacts,
        collision=_collision([check.collision for check in checks]),
        within=_within(names, checks, begins),
        certificate=proof,
        proof_out_of_time=proof is None and any(check.proof_out_of_time for check in checks),
    )


def _placed(worst: Worst, name: str, begin: float) -> Worst:
    """With the time of the cycle and the segment's name."""
    detail = ", ".join(part for part in (worst.detail, f"segment {name}") if part)
    return replace(worst, time=begin + worst.time, detail=detail)


def _within(
    names: Sequence[str], checks: Sequence[MotionCheck], begins: np.ndarray
) -> WithinTolerance | None:
    """The worst of all segments; None without a tolerance."""
    results = [check.within for check in checks if check.within is not None]
    tips, slips, torques, gaps = [], [], [], []
    if len(results) < len(checks):
        return None
    for name, part, begin in zip(names, results, begins.tolist(), strict=True):
        for index, every in ((part.tip, tips), (part.slip, slips)):
            if index is not None:
                every.append(replace(index, time=begin + index.time, how=f"segment {name}: {index.how}"))
        torques.append(replace(part.torque, time=begin + part.torque.time))
        if part.gap is not None:
            gaps.append(replace(part.gap, time=begin + part.gap.time))
    pairs = list(zip(results, begins.tolist(), strict=True))
    forces = [
        min(
            (force.later(begin) for part, begin in pairs if (force := getattr(part, name)) is not None),
            key=lambda index: index.value,
            default=None,
        )
        for name in ("alike", "foot_force")
    ]
    courses = [(begin + part.course[0], part.course[1]) for part, begin in pairs]
    given = max((part.tolerance for part in results), key=lambda part: len(part.given))
    return WithinTolerance(
        given,
        max(tips, key=lambda index: index.bound, default=None),
        max(slips, key=lambda index: index.value),
        max(torques, key=lambda index: index.value),
        min(gaps, key=lambda index: index.value, default=None),
        sum(part.states for part in results),
        *forces,
        exact_springs=any(part.exact_springs for part in results),
        course=(np.concatenate([t for t, _ in courses]), np.concatenate([m for _, m in courses])),
    )


def _collision(sequence: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The collision check of all segments: that of an unchecked one, else that of the smallest distance."""
    checked_ones = [part for part in sequence if part["checked"]]
    if len(checked_ones) < len(sequence):
        return next(part for part in sequence if not part["checked"])
    return min(checked_ones, key=lambda part: part["least"]["distance_m"])
