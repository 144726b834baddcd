"""The order of the switching times of a motion: ends of acceleration phases and cruises, zero crossings,
corners of non-optimised joints.

In S-curves every corner is two switching times: its acceleration begins to change, and a rise time later it
has changed. What is simultaneous at the first is so at the second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import casadi as cs
import numpy as np

from ocptip.motion.planner.profiles import Layout, Profiles
from ocptip.trajectories.ramps import JointRamps
from ocptip.trajectories.velocity_profiles import s_curve

SLOWEST = 5e-3
"""Minimum peak speed of a command in an ordered program, rad/s."""


class Ramped(Protocol):
    """A motion with optimised velocity profiles of the joints of `layout`, such as `Formulation`."""

    layout: Layout
    start: np.ndarray
    goal: np.ndarray

    def profiles(self, layout: Layout) -> Profiles:
        """Corners of the joints' motions as functions of variables."""
        ...


@dataclass(frozen=True, eq=False)
class EventOrder:
    """Signs of speeds and order of switching times of a motion.

    Attributes:
        layout: with the crossings counted.
        speed_signs: (joints, K) +1 or -1.
        change_signs: (joints, K) sign of w_k - w_{k-1}.
        regime: of non-optimised joints, see `Profiles`.
        groups: names of the switching times in order, simultaneous ones in one group; "2.3" is corner 3 of
            joint 2 (1-based), "2.x1" its crossing in acceleration phase 1, "5.p" and "5.pp" are t' and t'' of
            a non-optimised joint. In S-curves "2.x1" is the joint's first crossing, and groups that end rises
            are named "2.3+", "5.p+", after the first of their corners.
        times: by name, (nx,): switching times are times[name] @ x.
        rows: (groups, nx), the times of the groups.
        corner_positions: (n, C) group of each corner.
        late_positions: (n, C) group of each corner's end of rise; the same without rise times.
        directions: (intervals, n) directions of motion, +1 at rest.
        apart: (., nx) rows more that are at least 0, see `kept_apart`.
    """

    layout: Layout
    speed_signs: np.ndarray
    change_signs: np.ndarray
    regime: dict[int, bool]
    groups: tuple[tuple[str, ...], ...]
    times: dict[str, np.ndarray]
    rows: np.ndarray
    corner_positions: np.ndarray
    late_positions: np.ndarray
    directions: np.ndarray
    apart: np.ndarray | None = None

    @property
    def equalities(self) -> list[tuple[str, str]]:
        """Simultaneous switching times: (first of the group, other member)."""
        return [(group[0], member) for group in self.groups for member in group[1:]]

    @cached_property
    def steps(self) -> np.ndarray:
        """Rows (., nx), at least 0 where the order holds: from each group to the next, each row once."""
        steps = self.rows[1:] - self.rows[:-1]
        if not self.rises:
            return steps if self.apart is None else np.vstack([steps, self.apart])
        steps = np.unique(steps, axis=0)  # two events and the ends of their rises: the same row
        return steps[np.any(np.delete(steps, self.layout.one, axis=1) != 0, axis=1)]

    def kept_apart(self, x: np.ndarray, delay: float) -> EventOrder:
        """This order, where groups of switching times that are more than a delay (s) apart at x remain so."""
        times = self.rows @ x
        before = np.searchsorted(times, times - delay) - 1  # the last group that is so far before each
        late, early = np.arange(len(times))[before >= 0], before[before >= 0]
        apart = self.rows[late] - self.rows[early]
        apart[:, self.layout.one] -= delay
        return replace(self, apart=apart)

    @property
    def rises(self) -> bool:
        """Whether accelerations take time to change."""
        return self.late_positions is not self.corner_positions

    @property
    def crossings(self) -> list[tuple[int, int]]:
        """Joint (0-based) and group of each crossing, in the order of the variables."""
        results = [
            (int(group[0].partition(".")[0]) - 1, k, np.argmax(self.rows[k]))
            for k, group in enumerate(self.groups)
            if ".x" in group[0]
        ]
        return [(joint, k) for joint, k, _ in sorted(results, key=lambda one: one[2])]

    def speed(self, x: cs.SX, rise: float, joint: int, time: cs.SX, group: int) -> cs.SX:
        """Speed of an optimised joint, whose rise time is given, in the interval after a group of switching
        times.
        """
        layout = self.layout
        j = layout.joints.index(joint)
        w, d, c = x[layout.w(j)], x[layout.d(j)], x[layout.c(j)]
        ramps = (cs.vertcat(w, 0) - cs.vertcat(0, w)) / d
        speed, since = cs.SX(0), time
        for k in range(2 * layout.commands + 2):
            step = ramps[k // 2] * (1 - 2 * (k % 2))
            begun, done = (
                positions[joint, k] <= group for positions in (self.corner_positions, self.late_positions)
            )
            if rise > 0:
                speed += step * (begun * since**2 - done * (since - rise) ** 2) / (2 * rise)
            elif begun:
                speed += step * since
            if k < 2 * layout.commands + 1:
                since = since - (c if k % 2 else d)[k // 2]
        return speed

    def jump_masks(self, overshoot: float) -> np.ndarray:
        """Masks (groups, n, C) of the accelerations after the step at each group with its overshoot.

        The steps until then count once each; the present step counts once more by the share `overshoot`.
        Angles and speeds are those of the switching time.
        """
        numbers = np.arange(len(self.groups))[:, None, None]
        return (self.corner_positions <= numbers) + overshoot * (self.corner_positions == numbers)


def order_of(formulation: Ramped, x: np.ndarray, merge: float = 0.0) -> tuple[EventOrder, np.ndarray]:
    """Signs and order of switching times at x (variables of the smooth program, or of an ordered one).

    Args:
        formulation: of the task.
        x: variables; crossings at its end are ignored.
        merge: s; switching times nearer to each other than this are made simultaneous, if they can be.

    Returns:
        The order, and x with speeds moved to the right side of zero and with the crossings.
    """
    base = formulation.layout
    K, x = base.commands, x[: base.size].copy()
    speed_signs, change_signs = np.ones((len(base.joints), K)), np.ones((len(base.joints), K))
    crossings: list[tuple[int, int]] = []
    for j, joint in enumerate(base.joints):
        w = x[base.w(j)]  # a view
        before, sign_before = 0.0, np.sign(formulation.goal[joint] - formulation.start[joint]) or 1.0
        for k in range(K):
            sign = np.sign(w[k]) or sign_before
            w[k] = sign * max(abs(w[k]), 2 * SLOWEST)
            speed_signs[j, k], change_signs[j, k] = sign, np.sign(w[k] - before) or sign
            if k > 0 and sign != sign_before:
                crossings.append((j, k))
            before, sign_before = w[k], sign
    layout = base.extended(len(crossings))
    x = np.concatenate([x, np.zeros(len(crossings))])
    profiles = formulation.profiles(layout)
    regime = profiles.regime(x[layout.end])
    times = {"start": np.zeros(layout.size), "end": unit_row(layout, layout.end)}
    rank = {"start": -1, "end": 10**6}
    for joint in layout.joints:
        for k in range(1, 2 * K + 2):
            name = f"{joint + 1}.{k}"
            times[name], rank[name] = profiles.corner_time(joint, k), 2 * k
    for index, (j, k) in enumerate(crossings):
        name = f"{layout.joints[j] + 1}.x{k}"
        times[name], rank[name] = unit_row(layout, layout.crossing + index), 4 * k + 1
        w = x[layout.w(j)]
        begin = times[f"{layout.joints[j] + 1}.{2 * k}"] @ x
        x[layout.crossing + index] = begin + x[layout.d(j)][k] * w[k - 1] / (w[k - 1] - w[k])
    for joint in profiles.passive_joints:
        if regime[joint]:
            cruise = abs(profiles.way[joint]) / profiles.speed_limits[joint] * unit_row(layout, layout.one)
            times[f"{joint + 1}.p"], rank[f"{joint + 1}.p"] = times["end"] - cruise, 0
            times[f"{joint + 1}.pp"], rank[f"{joint + 1}.pp"] = cruise, 1
        else:
            times["half"], rank["half"] = times["end"] / 2, 0
    names = sorted(times, key=lambda name: (times[name] @ x if rank[name] >= 0 else -1.0, rank[name]))
    names.remove("end")
    names.append("end")
    groups: list[list[str]] = []
    for name in names:
        if groups and times[name] @ x - times[groups[-1][0]] @ x < merge and _may_join(groups[-1], name, K):
            groups[-1].append(name)
        else:
            groups.append([name])
    if groups[-1][-1] == "end":
        groups[-1] = ["end", *groups[-1][:-1]]
    order = _ordered(layout, profiles, speed_signs, change_signs, regime, groups, times)
    return _risen(order, profiles, x) if profiles.rise_times.any() else (order, x)


def _may_join(group: list[str], name: str, commands: int) -> bool:
    """Whether a switching time may coincide with a group.

    Not with another of the same joint, except the two ends of its first or last cruise, and not at t = 0.
    """
    if group[0] == "start":
        return False
    joint, corner = name.partition(".")[::2]
    for other in group:
        if other.partition(".")[0] == joint:
            pair = {corner, other.partition(".")[2]}
            if pair not in ({"1", "2"}, {str(2 * commands - 1), str(2 * commands)}) or commands == 1:
                return False
    return True


def _ordered(
    layout: Layout,
    profiles: Profiles,
    speed_signs: np.ndarray,
    change_signs: np.ndarray,
    regime: dict[int, bool],
    groups: list[list[str]],
    times: dict[str, np.ndarray],
) -> EventOrder:
    position = {name: i for i, group in enumerate(groups) for name in group}
    K, intervals = layout.commands, len(groups) - 1
    corners = np.zeros((layout.n, profiles.corners), dtype=int)
    directions = np.ones((intervals, layout.n))
    for j, joint in enumerate(layout.joints):
        corners[joint, 1 : 2 * K + 2] = [position[f"{joint + 1}.{k}"] for k in range(1, 2 * K + 2)]
        corners[joint, 2 * K + 2 :] = intervals
        for p in range(2 * K + 1):
            begin, stop, k = corners[joint, p], corners[joint, p + 1], p // 2
            directions[begin:stop, joint] = speed_signs[j, min(k, K - 1)]
            if p % 2 == 0 and f"{joint + 1}.x{k}" in position:
                directions[begin : position[f"{joint + 1}.x{k}"], joint] = speed_signs[j, k - 1]
    for joint in profiles.passive_joints:
        names = (f"{joint + 1}.p", f"{joint + 1}.pp") if regime[joint] else ("half", "half")
        corners[joint, :4] = [0, position[names[0]], position[names[1]], intervals]
        directions[:, joint] = np.sign(profiles.way[joint])
    return EventOrder(
        layout,
        speed_signs,
        change_signs,
        regime,
        tuple(map(tuple, groups)),
        times,
        np.array([times[group[0]] for group in groups]),
        corners,
        corners,
        directions,
    )


def _risen(ramps: EventOrder, profiles: Profiles, x: np.ndarray) -> tuple[EventOrder, np.ndarray]:
    """The order of an S-curve motion from that of its trapezoidal profiles, and x with the crossings of the
    S-curve.

    The switching times of the trapezoidal profiles keep their order and groups, the ends of their rises have
    the same. These two sequences, and the crossings, are interleaved in time as at x.
    """
    base = ramps.layout.extended(0)
    x = x[: base.size]
    joints, signs, result = list(base.joints), ramps.speed_signs, _crossings(profiles, x)
    layout = base.extended(len(result))
    padding = np.zeros(len(result))
    kept = [k for k, group in enumerate(ramps.groups) if any(".x" not in name for name in group)]
    groups = [tuple(name for name in ramps.groups[k] if ".x" not in name) for k in kept]
    renamed = {
        name: np.append(row[: base.size], padding) for name, row in ramps.times.items() if ".x" not in name
    }
    chain = np.full(ramps.corner_positions.shape, len(kept) - 1)
    moving = dict.fromkeys(joints, 2 * base.commands + 2) | dict.fromkeys(profiles.passive_joints, 4)
    for joint, count in moving.items():
        chain[joint, :count] = np.searchsorted(kept, ramps.corner_positions[joint, :count])

    events = [(renamed[group[0]], group) for group in groups]
    one, late = unit_row(layout, layout.one), dict[tuple[int, float], int]()
    longest = max(profiles.rise_times[joint] for joint in moving)
    for rise in sorted({profiles.rise_times[joint] for joint in moving} - {0.0}):
        of_rise = {
            k for j, count in moving.items() if profiles.rise_times[j] == rise for k in chain[j, :count]
        }
        for k in sorted(of_rise | ({len(groups) - 1} if rise == longest else set())):
            late[k, rise] = len(events)
            events.append((events[k][0] + rise * one, (f"{groups[k][0]}+{rise:g}",)))
    for index, (j, _) in enumerate(result):
        events.append((unit_row(layout, layout.crossing + index), (f"{joints[j] + 1}.x{index + 1}",)))
    x = np.concatenate([x, [time for _, time in result]])
    instants = np.array([row @ x for row, _ in events])
    for part in _chains(len(groups), late):
        instants[part] = np.maximum.accumulate(instants[part])
    instants[late[len(groups) - 1, longest]] = np.inf
    sequence = np.argsort(instants, kind="stable")
    place = np.argsort(sequence)

    corners, ends = np.full((2, *chain.shape), len(events) - 1)
    for joint, count in moving.items():
        rise = profiles.rise_times[joint]
        chain_here = chain[joint, :count]
        corners[joint, :count] = place[chain_here]
        ends[joint, :count] = place[[late.get((k, rise), int(k)) for k in chain_here]]
    directions = np.ones((len(events) - 1, layout.n))
    directions[:, joints] = signs[:, 0]
    for index, (j, _) in enumerate(result):
        directions[place[len(events) - len(result) + index] :, joints[j]] *= -1
    for joint in profiles.passive_joints:
        directions[:, joint] = np.sign(profiles.way[joint])
    for joint, count in moving.items():
        directions[ends[joint, count - 1] :, joint] = 1.0
    ordered = [events[k] for k in sequence]
    return EventOrder(
        layout,
        signs,
        ramps.change_signs,
        ramps.regime,
        tuple(names for _, names in ordered),
        renamed | {names[0]: row for row, names in events},
        np.array([row for row, _ in ordered]),
        corners,
        ends,
        directions,
    ), x


def _chains(count: int, late: dict[tuple[int, float], int]) -> list[list[int]]:
    """Switching times with a fixed order: those of the trapezoidal profiles, and their ends for each rise
    time.
    """
    rises = sorted({rise for _, rise in late})
    return [
        list(range(count)),
        *([position for (_, late_rise), position in late.items() if late_rise == rise] for rise in rises),
    ]


def _crossings(profiles: Profiles, x: np.ndarray) -> list[tuple[int, float]]:
    """Optimised joint (its number among those) and time of all changes of sign of its speed."""
    layout, crossings = profiles.layout, []
    for j, joint in enumerate(layout.joints):
        w, d, c = x[layout.w(j)], x[layout.d(j)], x[layout.c(j)]
        lengths = np.append(np.column_stack([d[:-1], c]), d[-1])
        times = np.concatenate([[0.0], np.cumsum(lengths)])
        speeds = np.concatenate([[0.0], np.repeat(w, 2), [0.0]])
        angles = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * lengths)])
        steps = np.diff(speeds)
        accelerations = np.divide(steps, lengths, out=np.zeros_like(steps), where=steps != 0)
        ramps = JointRamps((), times, angles, speeds, accelerations)
        rise = float(profiles.rise_times[joint])
        if rise > 0:
            crossings += [(j, float(t)) for t in s_curve(ramps, rise).crossings]
            continue
        for k in np.flatnonzero(speeds[:-1] * speeds[1:] < 0):
            crossings.append((j, float(times[k] - speeds[k] / accelerations[k])))
    return crossings


def unit_row(layout: Layout, position: int) -> np.ndarray:
    """The row that picks variable `at` out of x."""
    row = np.zeros(layout.size)
    row[position] = 1.0
    return row
