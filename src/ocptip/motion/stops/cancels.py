"""Which decelerations of a cancelled motion are safe: verdicts by share, the maximum and the minimum.

With too much deceleration the base tips, slips, or a drive lacks torque. With too little the arm leaves its
joint range or the clear space, or the stop takes too long.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ocptip.motion.stops.broken import (
    CANCEL,
    CLEARANCE,
    broken_contacts,
    broken_drives,
    broken_duration,
    broken_postures,
    broken_within,
)
from ocptip.motion.violations import broken_words, quantity_title
from ocptip.numerics.bisection import bisected
from ocptip.standing.arm import Robot
from ocptip.standing.contact_margins import of_friction
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import SLIP_WITHIN, WITHIN_OF, Limits
from ocptip.standing.stops.by_cancel import Cancel, CancelCheck, cancel_times
from ocptip.standing.within.cancelled import alike_of_cancels, worst_of_cancels
from ocptip.standing.within.in_motion import ALIKE
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.trajectory import Trajectory

SHARES = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05)
CLOSE = 0.005  # of the share, to which its ends are determined
_KEPT = 1e-9
_DIGITS = 3


@dataclass(frozen=True)
class CancelLevel:
    """The worst values at the base when a motion is cancelled at any instant, at one deceleration.

    Attributes:
        share: of the decelerations that are 100 %.
        GN: the largest; above 1 a contact lifts.
        lost: share of the instants from which a limit of the contacts is broken (nominal model).
        torque_ratio: the largest share of a torque limit that a drive needs.
        longest_stop_s: from the cancel until everything rests.
        clearance_m: the smallest distance; None where it is not known.
        stops: in time, in the joint range and in clear space, whatever becomes of contacts and drives.
        broken: limits; first those that cancels break from the largest share of the instants, then by the
            largest share of the limit. Empty where the stops are safe.
        friction_if_feet_give_alike: share of the friction that equally compliant feet use, at least (nominal
            model); None where only the best sharing of the load counts.
    """

    share: float
    GN: float
    lost: float
    torque_ratio: float
    longest_stop_s: float
    clearance_m: float | None
    stops: bool
    broken: tuple[Worst, ...]
    friction_if_feet_give_alike: float | None = None

    @property
    def safe(self) -> bool:
        """All limits are kept."""
        return not self.broken


@dataclass(frozen=True)
class SafeDecelerations:
    """Which decelerations of a cancelled motion are safe.

    Attributes:
        robot: whose motion it is.
        full: n, rad/s^2 (sliding joints: m/s^2), at 100 %.
        of_limits: these are the acceleration limits, which a controller would use by default.
        together: joints come to rest together, see `Cancel`.
        planned: planning does not help: the motion was planned to be safe when cancelled, or the base drives.
        levels: by falling share.
        minimum, maximum: of the safe shares; None where no checked share is safe.
        within: the uncertainty in words; empty: nominal model only.
        instants: number of those at which the motion is cancelled, for each level.
        alike: share of the friction that equally compliant feet use in cancels at the maximum, at least;
            None where only the best sharing of the load counts.
    """

    robot: Robot
    full: tuple[float, ...]
    of_limits: bool
    together: bool
    planned: bool
    levels: tuple[CancelLevel, ...]
    minimum: float | None
    maximum: float | None
    within: str
    instants: int
    alike: float | None = None

    @property
    def slips_alike(self) -> bool:
        """Whether equally compliant feet slip at the maximum."""
        return self.alike is not None and self.alike >= 1

    @property
    def hardest(self) -> CancelLevel:
        """The largest that was checked: 100 %, or more where more is asked for."""
        return self.levels[0]

    def deceleration(self, share: float) -> str:
        """In words: "352 deg/s^2", or the range over the joints."""
        values = [
            np.degrees(a) if unit == "rad" else a for a, unit in zip(self.full, self.robot.units, strict=True)
        ]
        texts = []
        for unit, word in (("rad", "deg/s^2"), ("m", "m/s^2")):
            scaled = [share * value for value, of in zip(values, self.robot.units, strict=True) if of == unit]
            if scaled:
                ends = dict.fromkeys(f"{rounded_down(end):g}" for end in (min(scaled), max(scaled)))
                texts.append(f"{' to '.join(ends)} {word}")
        return " and ".join(texts)

    @property
    def yaml(self) -> str:
        """The line of ros2_control, or of URScript, for the maximum safe deceleration; empty if none is."""
        if self.maximum is None:
            return ""
        if self.together:
            return f"stopj({rounded_down(self.maximum * self.full[0]):g})"
        values = [rounded_down(self.maximum * value) for value in self.full]
        joints = ", ".join(
            f"{name}: {{max_deceleration_on_cancel: {value:g}}}"
            for name, value in zip(self.robot.names, values, strict=True)
        )
        return f"constraints: {{decelerate_on_cancel: true, {joints}}}"

    @property
    def text(self) -> str:
        """What is safe, why not more, and what helps."""
        return f"{self.verdict}{self._helps}"

    @property
    def verdict(self) -> str:
        """What is safe, and why not more."""
        of = "the acceleration limits" if self.of_limits else "the given decelerations"
        of = f"stopj({self.full[0]:g})" if self.together else of
        hardest, model = self.hardest, self.within or "nominal model"
        if self.minimum is None or self.maximum is None:
            kept = f"no deceleration from {100 * SHARES[-1]:g} to {100 * hardest.share:.3g} % of {of} is safe"
        else:
            least, greatest = -rounded_down(-100 * self.minimum), rounded_down(100 * self.maximum)
            safe = f"{least:g} to {greatest:g} %" if least < greatest else f"about {greatest:g} %"
            each = " by joint" if len(set(self.full)) > 1 and not self.together else ""
            most = self.deceleration(self.maximum) + each
            end = ", harder ones were not tried" if hardest.safe else ""
            kept = f"safe at {safe} of {of}, at {greatest:g} % {most}{end}"
            if self.alike is not None:
                but = ", BUT" if self.slips_alike else "; there"
                kept += f"{but} equally compliant feet use at least {of_friction(self.alike)}"
        gentlest = self.levels[-1]
        if self.minimum is not None:  # why no gentler one is safe
            gentlest = next((level for level in self.levels if level.share < self.minimum), hardest)
        worst = dict.fromkeys([hardest, gentlest])
        why = [f"; at {100 * level.share:.3g} % {self._why(level)}" for level in worst if not level.safe]
        rigid = "; forces of compliant feet not checked" if self.robot.support.elastic else ""
        return f"{kept} ({model}, checked at {self.instants} instants{rigid}){''.join(why)}"

    def _why(self, level: CancelLevel) -> str:
        """The first of the broken limits with its share of the instants, and the names of the others."""
        first, *others = level.broken
        share = "" if np.isnan(first.share) else f"{100 * first.share:.3g} % of the instants"
        names = ", ".join(dict.fromkeys(quantity_title(one.name).removesuffix(" / limit") for one in others))
        more = "; ".join(filter(None, [share, names and f"also broken: {names}"]))
        return f"{broken_words(self.robot, [first])[0]}{more and f' ({more})'}"

    @property
    def _helps(self) -> str:
        """What helps where not all decelerations are safe."""
        if self.minimum is not None:
            # plans know the contacts, no torques
            unhelpful = self.together or self.planned or self.hardest.torque_ratio > 1
            remedy = "" if unhelpful else ", or plan with --stop-safe cancel"
            return "" if self.hardest.safe else f". Set that in the controller{remedy}"
        if any(broken.name == CLEARANCE for broken in self.hardest.broken):
            return ". Plans keep no clearance in cancels: plan with a larger --clearance, then check"
        gentle = f" --deceleration {100 * self.gentlest:g}%" if self.gentlest else ""
        to_plan = f". To plan for it, try ocptip plan with --stop-safe cancel{gentle}"
        return "" if self.together or self.planned else to_plan

    @property
    def gentlest(self) -> float | None:
        """The minimum share that stops in time and in joint range; None if none does."""
        return min((level.share for level in self.levels if level.stops), default=None)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        rows = [
            {**vars(level), "broken": broken_words(self.robot, level.broken), "safe": level.safe}
            for level in self.levels
        ]
        greatest = None if self.maximum is None else [self.maximum * a for a in self.full]
        return {
            "full_deceleration": list(self.full),
            "units": [f"{unit}/s^2" for unit in self.robot.units],
            "of_acceleration_limits": self.of_limits,
            **({"together": True} if self.together else {}),
            "minimum_safe_share": self.minimum,
            "maximum_safe_share": self.maximum,
            "maximum_safe_deceleration": greatest,
            **({} if self.alike is None else {ALIKE: self.alike}),
            "levels": rows,
            "within": self.within or None,
            "instants": self.instants,
            "urscript" if self.together else "ros2_control": self.yaml or None,
        }


def in_all(collection: Collection[SafeDecelerations]) -> str:
    """One proposal for all segments of a cycle, for a controller has one deceleration."""
    highest = [levels.maximum for levels in collection if levels.maximum is not None]
    lowest = [levels.minimum for levels in collection if levels.minimum is not None]
    if len(highest) == len(collection) and max(lowest) <= min(highest):
        least, greatest = -rounded_down(-100 * max(lowest)), rounded_down(100 * min(highest))
        text = f"all segments: safe at {least:g} to {greatest:g} %"
        if all(levels.hardest.safe for levels in collection):
            return text
        plan = f"plan with --stop-safe cancel --deceleration {greatest:g}%"
        return f"{text}; set at most that in the controller, or {plan}"
    text = "all segments: no deceleration is safe in all of them"
    if any(levels.together or levels.planned for levels in collection):
        return text
    shares = [levels.gentlest for levels in collection]
    gentle = f" --deceleration {100 * max(filter(None, shares)):g}%" if all(shares) else ""
    return f"{text}. To plan for it, try ocptip plan with --stop-safe cancel{gentle}"


def safe_decelerations(
    robot: Robot,
    motion: Trajectory,
    limits: Limits,
    cancel: Cancel,
    *,
    of_limits: bool = True,
    close: float = CLOSE,
    most: float = 1.0,
) -> SafeDecelerations:
    """Which shares of the decelerations of `cancel` are safe, at all instants of a motion.

    Args:
        robot, motion: what is cancelled.
        limits: of the motion; stops keep its clearance, and its uncertainty.
        cancel: decelerations that are 100 %, reaction, limits of the contacts.
        of_limits: the decelerations are the acceleration limits.
        close: of the share, to which the ends are determined; 1: no closer than `SHARES`.
        most: the largest share that is checked, if it is above 1.
    """
    table: dict[float, CancelLevel] = {}
    level_of = _levels(robot, motion, limits, cancel)

    def level(share: float) -> CancelLevel:
        if share not in table:
            table[share] = level_of(share)
        return table[share]

    def safe(share: float) -> float | None:
        return share if level(share).safe else None

    def near(one: float, other: float) -> bool:
        return abs(one - other) <= close

    runs: list[list[float]] = [[]]
    shares = (most, *SHARES) if most > 1 else SHARES
    for share in shares:
        if level(share).safe:
            runs[-1].append(share)
        elif runs[-1]:
            runs.append([])
    widest = max(runs, key=lambda run: run[0] - run[-1] if run else -1.0)
    minimum = maximum = None
    if widest:
        maximum, minimum = widest[0], widest[-1]
        above, below = (shares.index(maximum) - 1, shares.index(minimum) + 1)
        if above >= 0:
            maximum = bisected(safe, shares[above], maximum, maximum, near)[1]
        if below < len(shares):
            minimum = bisected(safe, shares[below], minimum, minimum, near)[1]
    alike = None
    if maximum is not None:
        scaled = replace(cancel, decelerations=tuple(maximum * a for a in cancel.decelerations))
        cases = worst_case_of(robot, limits.tolerance)
        if worst := alike_of_cancels(cases, motion, scaled, cancel_times(motion)):
            alike = max(worst.value, level(maximum).friction_if_feet_give_alike or 0.0)
    return SafeDecelerations(
        robot=robot,
        full=cancel.decelerations,
        of_limits=of_limits,
        together=cancel.together,
        planned=limits.cancel is not None or bool(robot.acts.end),
        levels=tuple(table[share] for share in sorted(table, reverse=True)),
        minimum=minimum,
        maximum=maximum,
        within=limits.tolerance.title if limits.tolerance.given else "",
        instants=len(cancel_times(motion)),
        alike=alike,
    )


def _levels(
    robot: Robot, motion: Trajectory, limits: Limits, cancel: Cancel
) -> Callable[[float], CancelLevel]:
    """A function from a share of the decelerations to the worst values of a motion cancelled with it."""
    times = cancel_times(motion)
    q, qd, _ = motion.states(times)
    process = robot.during(motion).acting(times)
    tolerance = limits.tolerance
    every = range(len(robot.interfaces) if tolerance.given else 0)
    cases = [worst_case_of(robot, tolerance, k).up_to(getattr(limits, SLIP_WITHIN)) for k in every]

    def level(share: float) -> CancelLevel:
        scaled = replace(cancel, decelerations=tuple(share * a for a in cancel.decelerations))
        checks = (CancelCheck(robot, scaled, exact=False, interface=k) for k in range(len(robot.interfaces)))
        result = stops = next(checks).stops(q, qd, process, times)
        broken, lost = list[Worst](), np.zeros(len(q), dtype=bool)
        for footing in robot.interfaces:
            lost = (result.GN > scaled.GN) | (result.GT > scaled.GT)
            if broken := broken_contacts(footing, times, result, scaled, CANCEL):
                break  # further interfaces need not be evaluated
            if check := next(checks, None):
                result = check.stops(q, qd, process, times)
        way = broken_duration(times, stops, scaled)
        way += broken_postures(robot, times, stops, limits, CANCEL)
        for footing, of_contacts in zip(robot.interfaces, cases, strict=False):
            worst = worst_of_cancels(of_contacts, motion, scaled, times)
            for name, instant in () if broken or way else zip(WITHIN_OF, worst, strict=True):
                known = {} if instant is None else {footing.result(name): instant}
                every = broken_within(known, limits)
                if broken := [replace(one, detail=" within the uncertainty") for one in every]:
                    break  # slip need not be evaluated
        broken += [*way, *broken_drives(times, stops)]
        # Of limits that are broken equally often, contacts are named first: their loss is the worse one.
        broken.sort(key=lambda one: (-np.nan_to_num(one.share), -one.excess / (abs(one.limit) or 1e-9)))
        return CancelLevel(
            share=share,
            GN=float(np.max(stops.GN)),
            lost=float(np.mean(lost)),
            torque_ratio=float(np.max(stops.drives)),
            longest_stop_s=float(np.max(stops.rests)) + scaled.reaction,
            clearance_m=float(stops.clearance) if np.isfinite(stops.clearance) else None,
            stops=not way,
            broken=tuple(broken),
            friction_if_feet_give_alike=None if np.isnan(stops.alike) else stops.alike,
        )

    return level


def rounded_down(value: float) -> float:
    """To three digits, never above the value: a rounded limit must not break what it is a limit of."""
    scale = 10.0 ** (_DIGITS - 1 - int(np.floor(np.log10(abs(value)))))
    return float(np.floor(value * scale + _KEPT) / scale)
