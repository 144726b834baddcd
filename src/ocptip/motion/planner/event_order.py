"""The order of the events of a motion: ends of ramps and cruises, zero crossings, passive joints' corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ocptip.motion.planner.profiles import Layout, Profiles
from ocptip.standing.mechanism import StandingMechanism

SLOWEST = 5e-3
"""Least peak speed of a command in an ordered program, rad/s."""


class Ramped(Protocol):
    """What is planned; `Formulation` is one: a mechanism's joints, those of `layout` by ramps."""

    robot: StandingMechanism
    layout: Layout
    start: np.ndarray
    goal: np.ndarray


@dataclass(frozen=True, eq=False)
class EventOrder:
    """Signs of speeds and order of events of a motion.

    Attributes:
        layout: with the crossings counted.
        speed_signs: (joints, K) +1 or -1.
        change_signs: (joints, K) sign of w_k - w_{k-1}.
        regime: passive joints, see `Profiles`.
        groups: names of the events in order, simultaneous ones in one group; "2.3" is corner 3 of joint 2
            (1-based), "2.x1" its crossing in ramp 1, "5.p" and "5.pp" are t' and t'' of a passive joint.
        times: by name, (nx,): event times are times[name] @ x.
        rows: (groups, nx), the times of the groups.
        corner_positions: (n, C) group of each corner.
        directions: (intervals, n) directions of motion, +1 at rest.
    """

    layout: Layout
    speed_signs: np.ndarray
    change_signs: np.ndarray
    regime: dict[int, bool]
    groups: tuple[tuple[str, ...], ...]
    times: dict[str, np.ndarray]
    rows: np.ndarray
    corner_positions: np.ndarray
    directions: np.ndarray

    @property
    def equalities(self) -> list[tuple[str, str]]:
        """Events tied together: (first of the group, other member)."""
        return [(group[0], member) for group in self.groups for member in group[1:]]

    def jump_masks(self, overshoot: float) -> np.ndarray:
        """Masks (groups, n, C) of the accelerations after the jump at each group with its overshoot.

        Those after the jump are the steps until then, each once; the step that is being taken counts once
        more by the share `overshoot`. Angles and speeds are those of the event.
        """
        at = np.arange(len(self.groups))[:, None, None]
        return (self.corner_positions <= at) + overshoot * (self.corner_positions == at)


def order_of(formulation: Ramped, x: np.ndarray, merge: float = 0.0) -> tuple[EventOrder, np.ndarray]:
    """Signs and order of events at x (variables of the smooth program, or of an ordered one).

    Args:
        formulation: of the task.
        x: variables; crossings at its end are ignored.
        merge: s; events nearer to each other than this are made simultaneous, if they can be.

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
    arm = formulation.robot.limits
    profiles = Profiles(layout, formulation.start, formulation.goal, arm.speed)
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
    return _ordered(layout, profiles, speed_signs, change_signs, regime, groups, times), x


def _may_join(group: list[str], name: str, commands: int) -> bool:
    """Whether an event may happen together with a group.

    Not with another of its own joint, except the two ends of its first or last cruise, and not at t = 0.
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
        own = (f"{joint + 1}.p", f"{joint + 1}.pp") if regime[joint] else ("half", "half")
        corners[joint, :4] = [0, position[own[0]], position[own[1]], intervals]
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
        directions,
    )


def unit_row(layout: Layout, at: int) -> np.ndarray:
    """The row that picks variable `at` out of x."""
    row = np.zeros(layout.size)
    row[at] = 1.0
    return row
