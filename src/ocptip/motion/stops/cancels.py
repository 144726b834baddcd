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
_NOT_PLANNED = {
    CLEARANCE: ("clearance", "a larger --clearance"),
    "torque_ratio": ("torques", "slower motions (--duration) or a lighter payload"),
}
"""Limits of cancels that plans leave out: what they are called, and what helps."""
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
        broken: limits; a contact that is lost within the uncertainty first, then those that cancels break
            from the largest share of the instants, then by the largest share of the limit. Empty where the
            stops are safe.
        friction_if_feet_give_alike: share of the friction that equally compliant feet use, at least, within
            the uncertainty where no other limit is broken; None: another sharing of the load uses no more.
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
        """All limits are kept, also by equally compliant feet."""
        return not self.broken and (self.friction_if_feet_give_alike or 0.0) < 1

    @property
    def not_planned(self) -> set[str]:
        """The broken limits that plans for cancels leave out."""
        return {one.name for one in self.broken} & set(_NOT_PLANNED)


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
        best_sharing: the same of those at which only the best sharing of the load holds, where none is safe;
            None: none does.
        within: the uncertainty in words; empty: nominal model only.
        instants: number of those at which the motion is cancelled, for each level.
        alike: share of the friction that equally compliant feet use in cancels at the maximum, at least;
            without one the smallest at those of `best_sharing`. None: another sharing uses no more.
    """

    robot: Robot
    full: tuple[float, ...]
    of_limits: bool
    together: bool
    planned: bool
    levels: tuple[CancelLevel, ...]
    minimum: float | None
    maximum: float | None
    best_sharing: tuple[float, float] | None
    within: str
    instants: int
    alike: float | None = None

    @property
    def slips_alike(self) -> bool:
        """Whether equally compliant feet slip at all decelerations that other limits allow."""
        return self.best_sharing is not None

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
            if self.best_sharing and self.alike:
                kept += f", at {_percents(*self.best_sharing)[0]} only the best sharing of the load holds: "
                kept += f"equally compliant feet use at least {of_friction(self.alike)}"
        else:
            safe, greatest = _percents(self.minimum, self.maximum)
            each = " by joint" if len(set(self.full)) > 1 and not self.together else ""
            most = self.deceleration(self.maximum) + each
            end = ", harder ones were not tried" if hardest.safe else ""
            kept = f"safe at {safe} of {of}, at {greatest:g} % {most}{end}"
            if self.alike is not None:
                kept += f"; there equally compliant feet use at least {of_friction(self.alike)}"
        # Why no gentler one is safe; where none is, why the gentlest that stops in time and range is not.
        least = self.minimum or (self.best_sharing or [0.0])[0]
        stopping = [level for level in self.levels if level.stops] or self.levels
        gentlest = next(
            (level for level in self.levels if level.share < least), hardest if least else stopping[-1]
        )
        worst = dict.fromkeys([hardest, gentlest])
        why = [f"; at {100 * level.share:.3g} % {self._why(level)}" for level in worst if not level.safe]
        rigid = "; forces of compliant feet not checked" if self.robot.support.elastic else ""
        return f"{kept} ({model}, checked at {self.instants} instants{rigid}){''.join(why)}"

    def _why(self, level: CancelLevel) -> str:
        """The first of the broken limits with its share of the instants, and the names of the others."""
        if not level.broken:
            return f"equally compliant feet use {of_friction(level.friction_if_feet_give_alike or 0.0)}"
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
        if self.best_sharing:
            return ". What helps: more friction, or `stiffness` of the contacts where known"
        if self.together or self.planned:
            return ""
        if self.not_planned:
            return f". {_not_planned_words(self.not_planned)}"
        return _to_plan_words([self.to_plan_for])

    @property
    def not_planned(self) -> set[str]:
        """Limits that plans for cancels leave out, of which each deceleration breaks one; else none."""
        return set() if self._to_plan_for else {name for level in self.levels for name in level.not_planned}

    @property
    def to_plan_for(self) -> float | None:
        """The smallest share that stops in time and range and breaks what is planned for alone.

        Where all of these take too long or leave the range the largest; None where there is none.
        """
        stopping = [level.share for level in self._to_plan_for if level.stops]
        return min(stopping) if stopping else max((level.share for level in self._to_plan_for), default=None)

    @property
    def _to_plan_for(self) -> list[CancelLevel]:
        return [level for level in self.levels if not level.not_planned]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        rows = [
            {name: value for name, value in vars(level).items() if name != ALIKE or value is not None}
            | {"broken": broken_words(self.robot, level.broken), "safe": level.safe}
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
            **({"best_sharing_shares": self.best_sharing} if self.best_sharing else {}),
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
    if any(levels.together or levels.planned or levels.best_sharing for levels in collection):
        return text
    if missing := set().union(*(levels.not_planned for levels in collection)):
        return f"{text}. {_not_planned_words(missing)}"
    return f"{text}{_to_plan_words([levels.to_plan_for for levels in collection])}"


def _to_plan_words(shares: Collection[float | None]) -> str:
    """How to plan for one deceleration in several motions."""
    share = max(share or 1.0 for share in shares)
    gentle = f" --deceleration {100 * share:g}%" if share < 1 else ""
    return f". To plan for it, try ocptip plan with --stop-safe cancel{gentle}"


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

    def unbroken(share: float) -> float | None:
        return None if level(share).broken else share

    def near(one: float, other: float) -> bool:
        return abs(one - other) <= close

    shares = (most, *SHARES) if most > 1 else SHARES

    def widest(kept: Callable[[float], float | None]) -> tuple[float, float] | None:
        """The ends of the widest range of shares that are kept."""
        runs: list[list[float]] = [[]]
        for share in shares:
            if kept(share) is not None:
                runs[-1].append(share)
            elif runs[-1]:
                runs.append([])
        run = max(runs, key=lambda run: run[0] - run[-1] if run else -1.0)
        if not run:
            return None
        maximum, minimum = run[0], run[-1]
        above, below = (shares.index(maximum) - 1, shares.index(minimum) + 1)
        if above >= 0:
            maximum = bisected(kept, shares[above], maximum, maximum, near)[1]
        if below < len(shares):
            minimum = bisected(kept, shares[below], minimum, minimum, near)[1]
        return minimum, maximum

    minimum, maximum = widest(safe) or (None, None)
    best_sharing = widest(unbroken) if maximum is None else None
    alike = None if maximum is None else level(maximum).friction_if_feet_give_alike
    if best_sharing:
        slipping = (one.friction_if_feet_give_alike for one in table.values() if not one.broken)
        alike = min(share for share in slipping if share is not None)
    return SafeDecelerations(
        robot=robot,
        full=cancel.decelerations,
        of_limits=of_limits,
        together=cancel.together,
        planned=limits.cancel is not None or bool(robot.acts.end),
        levels=tuple(table[share] for share in sorted(table, reverse=True)),
        minimum=minimum,
        maximum=maximum,
        best_sharing=best_sharing,
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
        alike = [] if np.isnan(stops.alike) else [stops.alike]
        if alike and not broken:
            result = alike_of_cancels(worst_case_of(robot, tolerance), motion, scaled, times)
            alike += [result.value] if result else []
        # A contact that is lost within the uncertainty has no share, and comes first: its loss is the worst.
        broken.sort(
            key=lambda one: (-np.nan_to_num(one.share, nan=np.inf), -one.excess / (abs(one.limit) or 1.0))
        )
        return CancelLevel(
            share=share,
            GN=float(np.max(stops.GN)),
            lost=float(np.mean(lost)),
            torque_ratio=float(np.max(stops.drives)),
            longest_stop_s=float(np.max(stops.rests)) + scaled.reaction,
            clearance_m=float(stops.clearance) if np.isfinite(stops.clearance) else None,
            stops=not way,
            broken=tuple(broken),
            friction_if_feet_give_alike=max(alike, default=None),
        )

    return level


def _not_planned_words(names: set[str]) -> str:
    """That plans leave limits out, and what helps."""
    words, remedies = zip(*(_NOT_PLANNED[name] for name in sorted(names)), strict=True)
    return f"Plans keep no {' and no '.join(words)} in cancels: plan with {', '.join(remedies)}, then check"


def _percents(minimum: float, maximum: float) -> tuple[str, float]:
    """A range of shares in words, rounded inwards, and its end in per cent."""
    least, greatest = -rounded_down(-100 * minimum), rounded_down(100 * maximum)
    return (f"{least:g} to {greatest:g} %" if least < greatest else f"about {greatest:g} %"), greatest


def rounded_down(value: float) -> float:
    """To three digits, never above the value: a rounded limit must not break what it is a limit of."""
    scale = 10.0 ** (_DIGITS - 1 - int(np.floor(np.log10(abs(value)))))
    return float(np.floor(value * scale + _KEPT) / scale)
