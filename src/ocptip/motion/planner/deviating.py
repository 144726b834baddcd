"""Nodes of an ordered program at which joints deviate: delayed, or overshooting acceleration steps.

With trapezoidal velocity profiles such a node lies at a switching time, or the longest delay after it. Its
states are those of the check (`within.late_joints`), up to small differences of angles and speeds. This
concerns every joint with an acceleration step there, or within that delay before. Its steps count up to one
of them. That one is not done yet, or counts the share of the overshoot more, or does so with all steps
before. With S-curves every joint whose acceleration changes within the delay is on time, or has the whole
delay. All combinations are evaluated; the worst of each row takes part.
"""

from __future__ import annotations

from itertools import chain, product
from typing import NamedTuple

import numpy as np

from ocptip.motion.planner.event_order import EventOrder, unit_row
from ocptip.motion.planner.program import MotionProgram
from ocptip.standing.limit_kinds.limit import DEVIATING
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.late_joints import combinations, delay_cases

Steps = tuple[tuple[int, int, float], ...]
"""Deviating joints: which, a group of its steps, and how many times more than once this and all later ones
count; several of a joint add up."""


class DelayedJoints(NamedTuple):
    """Delayed joints, the interval in which they are (-1: at rest before), and their delay, s."""

    joints: tuple[int, ...]
    interval: int
    delay: float


class Deviating(NamedTuple):
    """A node with deviating joints: `after` seconds after a switching time, in an interval, with their steps.

    Or after a share of the time to the next switching time.
    """

    interval: int
    event: int
    after: float
    steps: Steps = ()
    late: DelayedJoints = DelayedJoints((), -1, 0.0)
    share: float = 0.0


Place = tuple[int, float] | Deviating
"""A node: interval, share of it; or one with deviating joints."""

BETWEEN = (0.25, 0.5, 0.75)  # shares of the way from one event to the next
MEET = 1e-6  # s: events nearer to each other than this have met
KEPT = 1e-3  # by how much the use of a limit may exceed 1 after a solve


def deviating_places(order: EventOrder, x: np.ndarray, tolerance: Uncertainty) -> list[Deviating]:
    """All nodes at which joints may deviate from a motion with variables x.

    Args:
        order: of the switching times.
        x: variables; switching times within the delay of each other there count as one.
        tolerance: its delay and its overshoot.
    """
    delay, more = tolerance.delay * (1 + tolerance.speed), tolerance.overshoot
    if not (delay or more) or (order.rises and not delay):
        return []
    times, results = order.rows @ x, []
    moving = [
        joint for joint in range(order.layout.n) if joint in order.layout.joints or joint in order.regime
    ]
    if order.rises:
        return _late_places(order, times, moving, delay)
    for event, after in product(range(len(times)), sorted({0.0, delay})):
        time = times[event] + after
        last = int(np.searchsorted(times, time + MEET, side="right")) - 1
        if after == 0.0 and last > event:
            continue  # the last of those that meet stands for all
        options = []
        for joint in moving:
            groups = order.corner_positions[joint]
            near = groups[(groups <= last) & (times[groups] >= time - max(delay, MEET) - MEET)]
            if len(near):
                combination = _apart(np.unique(near), times)
                options.append(_options(joint, combination, times[combination].tolist(), time, delay, more))
        if options:
            results += [
                Deviating(last, event, after, tuple(chain(*combination)))
                for combination in combinations(options)
            ]
    return results


def _late_places(order: EventOrder, times: np.ndarray, moving: list[int], delay: float) -> list[Deviating]:
    """Delayed joints of S-curves: at switching times, between them and the delay after them."""
    late_places, gaps = [], np.diff(times)
    places = [(event, after, 0.0) for event in range(len(times)) for after in (0.0, delay)]
    places += [(event, 0.0, share) for event in np.flatnonzero(gaps > delay).tolist() for share in BETWEEN]
    for event, after, share in places:
        time = times[event] + after + (share * gaps[event] if share else 0.0)
        last, before = (int(np.searchsorted(times, t + MEET, side="right")) - 1 for t in (time, time - delay))
        if after == share == 0.0 and last > event:
            continue  # the last of those that meet stands for all
        rising = np.any((order.corner_positions <= last) & (order.late_positions > before), axis=1)
        options: list[list[tuple[int, ...]]] = [[(), (joint,)] for joint in moving if rising[joint]]
        late = [joints for combination in combinations(options) if (joints := tuple(chain(*combination)))]
        late_places += [
            Deviating(last, event, after, late=DelayedJoints(joints, before, delay), share=share)
            for joints in late
        ]
    return late_places


def _apart(groups: np.ndarray, times: np.ndarray) -> list[int]:
    """The first of each group of steps that coincide; together they are one step."""
    return groups[np.diff(times[groups], prepend=-np.inf) > MEET].tolist()


def _options(
    joint: int, groups: list[int], instants: list[float], time: float, delay: float, more: float
) -> list[Steps]:
    """The possible delayed states of a joint at a time; the delay before it covers steps of these groups.

    Being on time is between what it was before and overshooting, as far as nodes go.
    """
    stepses: list[Steps] = []
    every = delay_cases(instants, time, delay, more > 0)
    event_steps = [(case.event, case.steps) for case in every if case.event is not None]
    for event, steps in sorted(event_steps, key=lambda one: (one[0], one[1] > 0, -one[1])):
        if steps:
            later = tuple((joint, group, -1.0 - more) for group in groups[event + 1 : event + 2])
            stepses.append(((joint, groups[event + 1 - steps], more), *later))
        else:
            stepses.append(((joint, groups[event], -1.0),))
    return stepses if more else [*stepses, ((joint, groups[-1], 0.0),)]


def time_of(order: EventOrder, place: Deviating) -> np.ndarray:
    """The time (nx,) of a node, as a row times x."""
    row = order.rows[place.event] + place.after * unit_row(order.layout, order.layout.one)
    return row + place.share * (order.rows[place.event + 1] - row) if place.share else row


def masks_of(order: EventOrder, place: Deviating) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masks (n, C), those of the ends of rises, and delays of joints (n,), of a node: see `Nodes`."""
    groups, late = order.corner_positions, list(place.late.joints)
    scalars, behind = np.full((len(groups), 1), place.interval), np.zeros(len(groups))
    scalars[late], behind[late] = place.late.interval, place.late.delay
    masks, ends = (groups <= scalars).astype(float), (order.late_positions <= scalars).astype(float)
    for joint, group, factor in place.steps:
        masks[joint] += factor * ((groups[joint] >= group) & (groups[joint] <= place.interval))
    return masks, ends, behind


def worst_places(
    program: MotionProgram, x: np.ndarray, places: list[Deviating], first: int, share: float
) -> list[Deviating]:
    """The worst deviating nodes, from node `first` on, of each switching time and row, if their use is at
    least `share`.
    """
    if not places:
        return []
    kinds = [(place.event, place.after > 0, place.share) for place in places]
    events = np.unique(kinds, axis=0, return_inverse=True)[1]
    chosen: set[int] = set()
    instants = program.instants(x, np.arange(first, first + len(places)))
    for limit in program.limits:
        if DEVIATING not in limit.node_kinds:
            continue
        uses = limit.uses(instants)
        for event in np.unique(events):
            indices = np.flatnonzero(events == event)
            worst = indices[np.argmax(uses[indices], axis=0)]
            chosen.update(int(k) for column, k in enumerate(worst) if uses[k, column] >= share)
    return [places[k] for k in sorted(chosen)]


def kept_at_worst(program: MotionProgram, x: np.ndarray) -> bool:
    """Whether rows within an uncertainty are kept with deviations chosen at x, not those of the solve."""
    instants = program.instants(x, np.arange(program.n_nodes))
    limits_kept = [limit for limit in program.limits if DEVIATING in limit.node_kinds]
    return all(float(np.max(limit.use(instants), initial=0.0)) <= 1 + KEPT for limit in limits_kept)
