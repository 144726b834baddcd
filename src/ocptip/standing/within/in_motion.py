"""A whole motion at the worst of its uncertainty: every instant, and every joint by itself at acceleration
steps.

For the contacts these are instants, with the maximum delay of every joint without an acceleration step, and
the states of delayed joints around these steps, in all combinations, see `late_joints`. Torques are evaluated
with all joints on time, see `maximum_torques`; distances with joints that are delayed independently.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ocptip.basics.text import margin_text, quantity
from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.reserves.slip import known
from ocptip.standing.arm import Robot
from ocptip.standing.contact_margins import Margin
from ocptip.standing.limit_kinds.limit import Sampled
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.alike import friction_if_alike, least_if_alike
from ocptip.standing.within.late_joints import DelayedStates, jump_states, on_time
from ocptip.standing.within.torques import maximum_torques
from ocptip.standing.within.worst_case import WorstCase, WorstDeviations, worst_cases_of
from ocptip.trajectories.trajectory import Trajectory

ALIKE = "friction_if_feet_give_alike"
"""The entry of files with the friction that equally compliant feet use."""

EXACT = 48  # instants that are looked at exactly, those that look worst up to products of deviations
STARTS, FROM_MORE = 5, 12  # of the search for the worst slip, and instants at which there is more than one
NEARER, FRESH = 2, 9  # rounds of instants around the worst
SOME, AT_EVENT = 150, 1e-5  # instants at which torques are looked at first; s: so near to an event
PEAKS = 6  # instants around which the greatest torques and the smallest distances are looked for
LATER = 5  # instants of the delay at which it is looked where a joint may be
FURTHER = 0.1  # m beyond the smallest distance: what is further apart does not come nearer by being late
ON_TIME = 1e-6  # rad or m: what is nearer to where it should be is on time
NEAREST, LIKELY = 2000, 200  # pairs at instants whose slopes, and whose nearest places, are looked at


@dataclass(frozen=True)
class WorstInstant:
    """The worst instant of one index.

    Attributes:
        value: GN or GT.
        time: s.
        how: the deviations, in words.
        left: what is left there, in words.
        bound: of GN: what it can be at most at this instant, with products of deviations that were not tried;
            None for GT, which is the worst result of a search.
        factor: of GT: on the friction with which the contacts hold the base; NaN where it is not known.
    """

    value: float
    time: float
    how: str
    left: str
    bound: float | None
    factor: float = np.nan

    @property
    def most(self) -> float:
        """The bound, or the value where there is none."""
        return self.value if self.bound is None else self.bound

    def __str__(self) -> str:
        return f"{self.how}, at {self.time:.3f} s: {self.left}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        data = dict(vars(self))
        if not np.isfinite(data["factor"]):
            del data["factor"]
        return data


@dataclass(frozen=True)
class WorstTorque:
    """The maximum share of its limit that a drive may need.

    Attributes:
        value: of its limit.
        time: s.
        joint: number, from 1.
    """

    value: float
    time: float
    joint: int


@dataclass(frozen=True)
class WorstGap:
    """The smallest distance of what may collide with delayed joints.

    Attributes:
        value: m.
        time: s.
        between: what it is between, in words.
        joints: numbers of joints that are delayed there, from 1.
    """

    value: float
    time: float
    between: str
    joints: tuple[int, ...]

    def __str__(self) -> str:
        late = f", joints {', '.join(map(str, self.joints))} delayed" if self.joints else ""
        return f"{quantity(1e3 * self.value, 'mm', 3)} between {self.between}{late}, at {self.time:.3f} s"


@dataclass(frozen=True)
class WithinTolerance:
    """A motion in the worst case of an uncertainty.

    Attributes:
        tolerance: of the arm, its base, the floor and the drives.
        tip, slip: the worst instants; tip is None where the base cannot tip.
        torque: the worst of the drives.
        gap: the smallest distance; None without delays, or where nothing may collide.
        states: number of evaluated states.
        alike: see `ContactMargins.alike`, up to products of deviations.
        alike_friction: share of the friction that equally compliant feet use, at least, see
            `friction_if_alike`; 1 and more: they slip.
        exact_springs: the arm has counterbalance springs, and nothing about them is uncertain.
        foot_force: minimum distance of a normal force from where its contact lets go, N, where equilibrium
            alone decides it: on three contacts.
        objects: `tip` and `slip` of each object, by name.
        course: instants (K,), s, and the minimum moment about a tipping axis there, N m, up to products of
            deviations: for figures.
    """

    tolerance: Uncertainty
    tip: WorstInstant | None
    slip: WorstInstant
    torque: WorstTorque
    gap: WorstGap | None
    states: int
    alike: Margin | None = None
    foot_force: Margin | None = None
    alike_friction: Margin | None = None
    exact_springs: bool = False
    objects: Mapping[str, dict[str, WorstInstant | None]] = field(default_factory=dict)
    course: tuple[np.ndarray, np.ndarray] = field(default=(np.empty(0), np.empty(0)), compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        tip = self.tip and self.tip.to_dict()
        given = self.tolerance.to_dict()
        slip, torque, gap = self.slip.to_dict(), dict(vars(self.torque)), self.gap and dict(vars(self.gap))
        parts = {"tip": tip, "slip": slip, "torque": torque, "clearance": gap}
        forces = {"least_force_if_feet_give_alike_N": self.alike, "least_normal_force_N": self.foot_force}
        forces |= {ALIKE: self.alike_friction}
        named = {name: force and force.to_dict() for name, force in forces.items()}
        exact = {"exact_springs": True} if self.exact_springs else {}
        objects = {
            name: {key: worst and worst.to_dict() for key, worst in part.items()}
            for name, part in self.objects.items()
        }
        carried = {"objects": objects} if objects else {}
        return {"tolerance": given, **parts, "states": self.states, **named, **exact, **carried}


def worst_within(
    robot: StandingMechanism, motion: Trajectory, tolerance: Uncertainty, times: np.ndarray
) -> WithinTolerance:
    """The worst of contacts and drives in a motion, everything off at once as far as the tolerance goes.

    Args:
        robot: an arm on its base.
        motion: of it.
        tolerance: of both.
        times: (N,), s, to evaluate; more are taken around the worst.

    Raises:
        InputError: the robot is no arm.
    """
    return worst_of_cases(worst_cases_of(robot, tolerance), motion, times)


def worst_of_sampled(sampled: Sampled, tolerance: Uncertainty) -> WithinTolerance:
    """The worst values of a sampled motion within an uncertainty, computed once for all limits."""
    if tolerance not in sampled.memo:
        sampled.memo[tolerance] = worst_within(sampled.robot, sampled.motion, tolerance, sampled.times)
    return sampled.memo[tolerance]


def worst_of_cases(interfaces: Sequence[WorstCase], motion: Trajectory, times: np.ndarray) -> WithinTolerance:
    """The worst values of a motion of an arm within the uncertainty of the cases of all its interfaces."""
    cases, *of_objects = interfaces
    tolerance = cases.deviations.tolerance
    acting = cases.deviations.robot.during(motion)
    torque = _worst_torque(acting, motion, tolerance, times)
    gap = _smallest_gap(acting, motion, tolerance, times)
    exact, result = acting.arm.has_springs and not tolerance.springs, worst_contacts(cases, motion, times)
    objects = {}
    for of_object in of_objects:
        contacts = worst_contacts(of_object, motion, times)
        objects[of_object.footing.name] = {name: contacts[name] for name in ("tip", "slip")}
    return WithinTolerance(
        tolerance=tolerance, torque=torque, gap=gap, exact_springs=exact, objects=objects, **result
    )


def worst_contacts(cases: WorstCase, motion: Trajectory, times: np.ndarray) -> dict[str, Any]:
    """The fields of `WithinTolerance` that are about contacts."""
    tolerance = cases.deviations.tolerance
    acting = cases.deviations.robot.during(motion)
    delayed = on_time(motion, tolerance, times, acting)
    delayed = delayed.joined(jump_states(motion, tolerance, cases, acting))
    tip, course = None, (np.empty(0), np.empty(0))
    if cases.axes:
        worst, bad = _refined(cases, motion, acting, delayed, _least_moments)
        tip, course = _worst_tip(cases, worst), (delayed.times, -bad[: len(delayed.times)])
    slip = _worst_slip(cases, _refined(cases, motion, acting, delayed, _greatest_slips)[0])
    return {
        "tip": tip,
        "slip": slip,
        "states": len(delayed.times),
        "alike": least_if_alike(cases, delayed),
        "foot_force": _least_foot_force(cases, motion, acting, delayed),
        "alike_friction": friction_if_alike(cases, delayed),
        "course": course,
    }


def worst_tip_of(cases: WorstCase, states: DelayedStates) -> WorstInstant:
    """The worst of some states for tip-over."""
    return _worst_tip(cases, states.some(np.argsort(-_least_moments(cases, states), kind="stable")[:EXACT]))


def worst_slip_of(cases: WorstCase, states: DelayedStates) -> WorstInstant | None:
    """The maximum GT of delayed states within the uncertainty; the most critical ones exactly.

    None where it is at most `WorstCase.enough`.
    """
    bad = _greatest_slips(cases, states)
    if np.max(known(bad)) <= cases.enough:
        return None
    return _worst_slip(cases, states.some(np.argsort(-bad, kind="stable")[:EXACT]))


def _least_foot_force(
    cases: WorstCase, motion: Trajectory, acting: Robot, delayed: DelayedStates
) -> Margin | None:
    """Minimum distance of a normal force from where its contact lets go; None where other forces also decide
    it.

    Every axis of three contacts on a plane passes through two of them. So the moment about it is the force on
    the third times its distance, and the worst deviations of that moment are those of the force.
    """
    tip_over = cases.footing.tip_over
    lifted = tip_over.lifts != 0
    if (
        tip_over.affine_moments is None
        or len(tip_over.support.contacts) != 3
        or np.any(lifted.sum(axis=1) > 1)
    ):
        return None
    distances = np.abs(tip_over.lifts).sum(axis=1)

    def pressed_least(cases: WorstCase, states: DelayedStates) -> np.ndarray:
        return -np.min(cases.estimated_moments(states.s, states.max_delay) / distances, axis=1)

    instants = _refined(cases, motion, acting, delayed, pressed_least)[0]
    rows, axes = _every_axis(cases, instants)
    forces = (
        cases.moments(instants.s[rows], axes, max_delay=instants.max_delay[rows]).values / distances[axes]
    )
    k = int(np.argmin(forces))
    return Margin(float(forces[k]), float(instants.times[rows[k]]), (int(np.argmax(lifted[axes[k]])) + 1,))


def _every_axis(cases: WorstCase, states: DelayedStates) -> tuple[np.ndarray, np.ndarray]:
    """Row and axis of every pair of a state and a tipping axis."""
    count = len(states.times)
    return np.repeat(np.arange(count), cases.axes), np.tile(np.arange(cases.axes), count)


def _smallest_gap(
    robot: Robot, motion: Trajectory, tolerance: Uncertainty, times: np.ndarray
) -> WorstGap | None:
    """With every joint where it is to be at some time in the delay before, by slopes: the result is
    attained.
    """
    if not tolerance.late or not robot.collision.labels:
        return None
    every, gap = np.unique(times), None
    for _ in range(1 + NEARER):
        where, pairs, gaps, late = _late_gaps(robot, motion, tolerance.late, times)
        k = int(np.argmin(gaps))
        if gap is None or gaps[k] < gap.value:
            joints = tuple(int(j) + 1 for j in np.flatnonzero(late[k]))
            gap = WorstGap(float(gaps[k]), float(where[k]), str(robot.collision.labels[pairs[k]]), joints)
        times = _around(every, where[np.argsort(gaps)[:PEAKS]])
        every = np.unique(np.concatenate([every, times]))
    return gap


def _late_gaps(
    robot: Robot, motion: Trajectory, delay: float, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pairs that come near: when, s, which, the distance, m, (r,), and which joints are delayed, (r, n)."""
    earlier = times[:, None] - np.linspace(0.0, delay, LATER)
    places = motion.states(earlier.ravel())[0].reshape(len(times), LATER, robot.n)
    ends = np.stack([places.min(axis=1), places.max(axis=1)])
    middle, half = 0.5 * ends.sum(axis=0), 0.5 * (ends[1] - ends[0])
    gaps = robot.collision.gaps(middle, float(np.min(robot.collision.least(middle))) + FURTHER)
    nearest = np.argsort(gaps, axis=None, kind="stable")[:NEAREST]
    rows, pairs = np.unravel_index(nearest, gaps.shape)
    near, slopes = robot.collision.slopes(middle, rows, pairs, once=True)
    likely = np.argsort(near - np.einsum("rj,rj->r", np.abs(slopes), half[rows]), kind="stable")[:LIKELY]
    rows, pairs, slopes = rows[likely], pairs[likely], slopes[likely]
    number, least, late = np.arange(len(rows)), near[likely], middle[rows]
    for _ in range(NEARER):
        q = middle[rows] - np.sign(slopes) * half[rows]
        result, slopes = robot.collision.slopes(q, number, pairs, once=True)
        late = np.where((result < least)[:, None], q, late)
        least = np.minimum(result, least)
    return times[rows], pairs, least, np.abs(late - places[rows, 0]) > ON_TIME


def _around(every: np.ndarray, peaks: np.ndarray) -> np.ndarray:
    """New instants around some of `every`, s, increasing, up to the next on either side."""
    near = np.searchsorted(every, peaks)
    left, right = every[np.maximum(near - 1, 0)], every[np.minimum(near + 1, len(every) - 1)]
    return np.linspace(left, right, FRESH + 2)[1:-1].ravel()


def _some(times: np.ndarray, events: np.ndarray) -> np.ndarray:
    """A few of the instants, increasing, with those at switching times: torques are smooth in between."""
    event = np.concatenate([events, [np.inf]])
    nearest = np.minimum(event[np.searchsorted(events, times - AT_EVENT)] - times, AT_EVENT)
    chosen = nearest < AT_EVENT
    chosen[:: max(len(times) // SOME, 1)] = True
    chosen[-1] = True
    return times[chosen]


def _worst_torque(robot: Robot, motion: Trajectory, tolerance: Uncertainty, times: np.ndarray) -> WorstTorque:
    worst = WorstTorque(0.0, 0.0, 1)
    every = times = _some(np.unique(times), motion.event_times)
    for _ in range(1 + NEARER):
        most = maximum_torques(robot, tolerance, *motion.states(times), robot.acting(times))
        shares = (most / robot.limits.torque).T
        joint, k = np.unravel_index(np.argmax(shares), shares.shape)
        if shares[joint, k] > worst.value:
            worst = WorstTorque(float(shares[joint, k]), float(times[k]), int(joint) + 1)
        times = _around(every, times[np.argsort(-np.max(shares, axis=0))[:PEAKS]])
        every = np.unique(np.concatenate([every, times]))
    return worst


def _least_moments(cases: WorstCase, states: DelayedStates) -> np.ndarray:
    return -np.min(cases.estimated_moments(states.s, states.max_delay), axis=1)


def _greatest_slips(cases: WorstCase, states: DelayedStates) -> np.ndarray:
    return cases.greatest_slips(states.s, states.max_delay)


def _refined(
    cases: WorstCase,
    motion: Trajectory,
    acting: Robot,
    delayed: DelayedStates,
    badness: Callable[[WorstCase, DelayedStates], np.ndarray],
) -> tuple[DelayedStates, np.ndarray]:
    """The states that look worst, with instants around the worst one, and how bad all are in their order."""
    bad = badness(cases, delayed)
    for _ in range(NEARER):
        row = int(np.argmax(bad))
        if delayed.words[row]:
            break
        plain = np.array([not word for word in delayed.words])
        near = _around(np.sort(delayed.times[plain]), delayed.times[row])
        new = on_time(motion, cases.deviations.tolerance, near, acting)
        delayed, bad = delayed.joined(new), np.concatenate([bad, badness(cases, new)])
    return delayed.some(np.argsort(-bad, kind="stable")[:EXACT]), bad


def _worst_tip(cases: WorstCase, states: DelayedStates) -> WorstInstant:
    rows, axes = _every_axis(cases, states)
    result = cases.moments(states.s[rows], axes, max_delay=states.max_delay[rows])
    k = int(np.argmin(result.values))
    row, state, max_delay = int(rows[k]), states.s[rows[k : k + 1]], states.max_delay[rows[k : k + 1]]
    theta, slopes = result.theta[k : k + 1], result.slopes[k : k + 1]
    missed = float(cases.deviations.missed(state, theta, slopes, max_delay)[0])
    moment = float(result.values[k])
    first, second = sorted(c + 1 for c in cases.footing.tip_over.axes[axes[k]].contacts)
    left = f"tipping margin {margin_text(moment, 'N m')} about contacts {first} and {second}"
    left += _kept(cases, state, theta)
    value, bound = (float(cases.tip_ratio(np.array(m))) for m in (moment, moment - missed))
    return WorstInstant(
        value, float(states.times[row]), _how(cases, result, k, states.words[row]), left, bound
    )


def _worst_slip(cases: WorstCase, states: DelayedStates) -> WorstInstant:
    result = cases.slip(states.s, max_delay=states.max_delay)
    states = states.some(np.argsort(-result.values, kind="stable")[:FROM_MORE])
    result = cases.slip(states.s, STARTS, max_delay=states.max_delay)
    k = int(np.argmax(result.values))
    value, state, theta = float(result.values[k]), states.s[k : k + 1], result.theta[k : k + 1]
    used, factor = f"{100 * value:.3g} %", value
    if value > 1:
        demand = FrictionDemand.of(cases.footing.support, cases.deviations.wrench(state, theta)[0][0])
        used, factor = demand.used, demand.factor
    left = f"friction used {used}{_kept(cases, state, theta)}"
    return WorstInstant(
        value, float(states.times[k]), _how(cases, result, k, states.words[k]), left, None, factor
    )


def _how(cases: WorstCase, worst_deviations: WorstDeviations, k: int, words: str) -> str:
    return ", ".join(part for part in (cases.deviations.words(worst_deviations.theta[k]), words) if part)


def _kept(cases: WorstCase, s: np.ndarray, theta: np.ndarray) -> str:
    """Which contact keeps how much of its normal force; nothing where the sharing is not determined."""
    if cases.footing.slip.redistribution != "tangential":
        return ""
    states = cases.footing.contact_states(cases.deviations.wrench(s, theta)[0])
    reserves = cases.footing.tip_over.evaluate(states).normal_reserves[0]
    if not states.solved[0] or not np.isfinite(reserves).any():
        return ""
    k = int(np.nanargmin(reserves))
    return f", contact {k + 1} keeps {quantity(max(float(reserves[k]), 0.0), 'N', 3)}"
