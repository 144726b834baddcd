"""Robustness of a motion until a contact is lost: each deviation from the model alone, by bisection.

The loads are linear in what deviates: gravity (a tilted floor), mass at the TCP, a push, the square of a
speed factor. So those of all instants are computed once and combined. At every level the contact forces, GN
and GT are computed again: lost means GN or GT at 1, or that a foot lifts on declared springs, whatever
smaller limits the motion keeps. Sampled instants and directions are checked; other limits (torques,
clearance) are not. Of objects that only contacts hold, the same contacts count; what is pushed or added at
the gripper does not load them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, product
from typing import Any

import numpy as np

from ocptip.contact.bindings.binding import DAMPING_RATIO
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.motion.cycles.task import Task
from ocptip.numerics.bisection import bisected
from ocptip.numerics.threads import one_thread
from ocptip.reserves.slip import known
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.alike_friction import AlikeFriction
from ocptip.standing.at_rest.directions import pushes, slopes, tilted
from ocptip.standing.at_rest.load_cases import LinearLoads, MotionLoads, ObjectLoads
from ocptip.standing.at_rest.loss_search import CLOSE, ON_SPRINGS, Deviation, Loads, LossSearch, pushed
from ocptip.standing.contact_margins import Margin
from ocptip.standing.elastic.feet import STIFFEST, first_lift, softest_feet
from ocptip.standing.elastic.springs import FALLEN
from ocptip.standing.footing import Footing
from ocptip.trajectories.trajectory import INSIDE, Trajectory

SPACING = 0.01  # s: between instants, at most
MOST_LATE = 6  # joints of which every subset may be late
_LEVELS = 5  # of a deviation at which vibration is computed, before bisection
_NO_DELAY = 3e3 * INSIDE  # ms: states at steps are so close to these that less is none
TILT, SPEED, DELAY = np.radians(30.0), 1.0, 0.1  # rad, share, s: what is looked at, at most

_WORDS = {
    "tilt": ("floor tilted by ", ""),
    "extra_mass": ("", " more at the TCP"),
    "push": ("push of ", " at the TCP"),
    "friction": ("friction x ", ""),
    "faster": ("", " faster"),
    "delay": ("joints delayed by ", ""),
}
_SHORT = {
    "tilt": "tilt",
    "extra_mass": "payload +",
    "push": "push",
    "friction": "friction",
    "faster": "speed +",
    "delay": "delay",
    "foot_stiffness": "foot stiffness",
}


@dataclass(frozen=True)
class Tolerated:
    """The largest deviation of one quantity that loses no contact.

    Attributes:
        quantity: "tilt", "extra_mass", "push", "friction", "faster" or "delay".
        value: in `unit`; of friction the minimum factor.
        unit: "deg", "kg", "N", "", "%" or "ms".
        at_most: nothing was lost up to this value (friction: down to it), beyond which was not searched.
        time: s, where the contact is lost; NaN if none is.
        how: direction, and what happens.
        between: of feet one of which lifts on the stiffest: on those between these, in `unit`, none does.
        drives: of masses, what the drives can move of them, in `unit`; None: not limited, or not of a mass.
    """

    quantity: str
    value: float
    unit: str
    at_most: bool
    time: float
    how: str
    between: tuple[float, float] | None = None
    drives: float | None = None

    def __str__(self) -> str:
        if self.quantity == "foot_stiffness":
            return self._of_feet()
        name, unit = _WORDS[self.quantity], f" {self.unit}" if self.unit else ""
        value = f"{name[0]}{self.value:.3g}{unit}{name[1]}"
        drives = "" if self.drives is None else f"; the drives move {self.drives:.3g}{unit} more"
        if self.at_most:
            return f"{value} and {'less' if self.quantity == 'friction' else 'more'}{drives}"
        return f"{value} ({self.how}, {self.time:.3f} s){drives}"

    @property
    def short(self) -> str:
        """In a few words: "tilt 3.84 deg", "delay >= 100 ms", "delay 0 ms (slips at once, 0.500 s)"."""
        name, sign, value = _SHORT[self.quantity], ">= " if self.at_most else "", self.value
        if self.quantity == "friction":
            return "any friction" if self.at_most else f"friction {100 * (value - 1):.3g} %"
        if self.quantity != "foot_stiffness":
            text = f"{name} {sign}{value:.3g} {self.unit}".replace("+ ", "+").replace("+>= ", ">= +")
            if value == 0 and not self.at_most:
                return f"{text} ({self.how.rpartition(', ')[2]} at once, {self.time:.3f} s)"
            return text if self.drives is None else f"{text} (drives +{self.drives:.3g} {self.unit})"
        if np.isfinite(value):
            return f"{name} from {_stiffness_text(min(value, STIFFEST))}"
        if self.between is None:
            return f"no {name} is enough"
        least, most = map(_stiffness_text, self.between)
        return f"{name} {least.removesuffix(' N/m')} to {most}"

    def _of_feet(self) -> str:
        damping = f"{100 * DAMPING_RATIO:.0f} % damping"
        value = _stiffness_text(min(self.value, STIFFEST))
        if np.isinf(self.value):
            fails = f"{self.how} on those of {value}, {damping}, {self.time:.3f} s"
            if self.between is None:
                return f"no compliant feet ({fails}, and on softer ones)"
            least, most = map(_stiffness_text, self.between)
            return f"compliant feet, of {least} to {most} only ({fails})"
        if self.at_most:
            return f"compliant feet, of {value} and more ({damping})"
        how = f"{self.how} on softer ones, {damping}, {self.time:.3f} s"
        return f"compliant feet, of {value} and more ({how})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        data = dict(vars(self))
        between, drives = data.pop("between"), data.pop("drives")
        data |= {"drives": drives} if drives is not None else {}
        return data | ({"between": list(between)} if between else {})


def _stiffness_text(value: float) -> str:
    return f"{value:.2g} N/m".replace("e+0", "e")


@one_thread
def tolerated(robot: Robot, motion: Trajectory, may_lift: bool = False) -> tuple[Tolerated, ...]:
    """Robustness of the motion of an arm, each quantity alone.

    - tilt: of floor and base, in any direction, degrees;
    - extra_mass: a point mass at the TCP, kg, and the one that the drives can move;
    - push: a force at the TCP in any direction, N;
    - friction: factor of the friction coefficients of all ordinary contacts (left out if all are clamps);
    - faster: all times shorter, per cent of speed;
    - foot_stiffness: the minimum, N/m, of compliant feet, see `ocptip.standing.elastic.feet.softest_feet`;
      infinite if a foot lifts on the stiffest, then `between` says on which none does, if on any;
    - delay: delay of any of the joints, ms (up to six joints that move).

    Tilt, friction, speed and delay are the minimum over base and objects; with objects there is no
    `foot_stiffness`. A foot that lifts on declared springs is a lost contact unless it `may_lift`; payload
    and speed then also count the vibration of the base on them.
    All values are zero for a nominal motion that loses a contact.

    Raises:
        InputError: the motion does not fit the arm.
    """
    robot.require_fit(motion.n)
    given, robot = robot, robot.during(motion)
    times = np.union1d(motion.both_sides(SPACING), _knots(robot, motion))
    parts = MotionLoads(robot, motion, times)
    base = _Tolerating(robot, parts, times, may_lift)
    least = base.in_motion(_late(robot, motion, lambda *states: robot.loads(*states)[1]))
    free, nominal = robot.support.gravity, parts.total()
    forces = pushed(nominal, parts.at_tool, _direction)
    most_push = float(np.linalg.norm(free)) * robot.mass
    mass = base.largest("extra_mass", "kg", 1.0, robot.mass, _alone(lambda m: nominal + m * parts.extra))
    least["extra_mass"] = replace(mass, drives=parts.held_by_drives(robot, motion))
    least["push"] = base.largest("push", "N", 1.0, most_push, forces, pushes(free))
    for number, footing in enumerate(robot.interfaces[1:]):

        def wrenches(q: Any, qd: Any, qdd: Any, acting: Any, number: int = number) -> np.ndarray:
            return robot.object_wrenches(q, qd, qdd, robot.acts.split(acting)[1])[number]

        loads = ObjectLoads(robot, motion, times, number)
        of_object = _Tolerating(footing, loads, times, may_lift)
        for name, result in of_object.in_motion(_late(robot, motion, wrenches)).items():
            if name not in least or _worse(result, least[name]):
                least[name] = result
    least |= {} if may_lift else _vibrating(given, motion, least)
    feet = None if robot.objects else _stiffness(robot, motion)
    results = (least.get(name) for name in _WORDS)
    return tuple(one for one in (*results, feet) if one is not None)


class _Tolerating:
    """What the contacts of the base, or of an object, tolerate under the loads of a motion.

    Args:
        footing: with these contacts.
        parts: the loads.
        times: of them, s.
        may_lift: feet may lift on declared springs.
    """

    def __init__(self, footing: Footing, parts: LinearLoads, times: np.ndarray, may_lift: bool) -> None:
        self._footing, self._parts, self._times, self._may_lift = footing, parts, times, may_lift
        # Where equally compliant feet slip nominally, a headline says so, and the best sharing counts.
        self._alike = AlikeFriction.if_held(footing, parts.total()) is not None
        self._contacts = self._search(footing)
        self._what = "" if footing is parts.robot else f"{footing.name} "

    def _search(self, footing: Footing) -> LossSearch:
        return LossSearch(footing, AlikeFriction(footing) if self._alike else None, not self._may_lift)

    def largest(
        self,
        quantity: str,
        unit: str,
        scale: float,
        most: float,
        *searched: Any,
        times: np.ndarray | None = None,
    ) -> Tolerated:
        """The largest level of a deviation, see `LossSearch.largest`."""
        result, times = self._contacts.largest(most, *searched), self._times if times is None else times
        lost = result.row >= 0
        time, how = (float(times[result.row]), self._what + result.how) if lost else (np.nan, "")
        return Tolerated(quantity, float(scale * result.level), unit, not lost, time, how)

    def in_motion(self, late: tuple[np.ndarray, list[Deviation]]) -> dict[str, Tolerated]:
        """By quantity: tilt, friction, speed, and delay with its times and wrenches."""
        parts, nominal, free = self._parts, self._parts.total(), self._parts.robot.support.gravity

        def tilts(sides: np.ndarray) -> list[Deviation]:
            def under(side: np.ndarray) -> Loads:
                return lambda angle: nominal + parts.per_gravity @ (tilted(free, side, angle) - free)

            return [_towards(side, "downhill ", under(side)) for side in sides]

        delays, subsets = late
        delay = self.largest("delay", "ms", 1e3, DELAY, lambda _: subsets, times=delays)
        if delay.value <= _NO_DELAY:  # joints that are apart at an acceleration step are what fails
            delay = replace(delay, value=0.0)
        results = [
            self.largest("tilt", "deg", np.degrees(1.0), TILT, tilts, slopes(free)),
            self._least_friction(nominal),
            self.largest("faster", "%", 100.0, SPEED, _alone(lambda e: parts.total(speed=1 + e))),
            delay,
        ]
        return {one.quantity: one for one in results if one is not None}

    def _least_friction(self, wrenches: np.ndarray) -> Tolerated | None:
        """The minimum factor of friction coefficients of ordinary contacts; None without such contacts."""
        footing = self._footing
        if not any(isinstance(c, UnilateralContact) for c in footing.support.contacts):
            return None

        def lost(factor: float) -> tuple[int, str] | None:
            changed = [
                replace(c, friction=factor * c.friction) if isinstance(c, UnilateralContact) else c
                for c in footing.support.contacts
            ]
            return self._search(footing.on(footing.support.varied(changed))).lost(wrenches)

        def near(low: float, high: float) -> bool:
            return high - low <= 0.5 * CLOSE or high <= 1e-3

        factor, result = 1.0, self._contacts.lost(wrenches)
        if result is None:
            # The friction used is the factor that contacts need; each factor evaluated takes another solver.
            used = float(np.max(known(footing.slip.greatest(wrenches))))
            factor, (row, how) = bisected(lost, 1.0, 0.0, (-1, "slips"), near, lambda factor: factor <= used)
        else:
            row, how = result
        if row < 0:  # it needs next to no friction
            return Tolerated("friction", factor, "", True, np.nan, "")
        return Tolerated("friction", factor, "", False, float(self._times[row]), self._what + how)


def _alone(loads: Loads) -> Callable[[np.ndarray], list[Deviation]]:
    return lambda _: [Deviation(loads)]


def robustness(task: Task, motion: Trajectory) -> tuple[Tolerated, ...]:
    """For every deviation the minimum over the segments; empty for parallel robots.

    Times are from the begin of the first segment.
    """
    least: dict[str, Tolerated] = {}
    for segment, segment_motion, begin in zip(task.segments, motion.segments, motion.begins, strict=False):
        robot, may_lift = segment.task.robot, segment.task.limits.foot_lift > 0
        for result in tolerated(Robot.of(robot), segment_motion, may_lift) if robot.arm else ():
            placed = replace(result, time=float(begin) + result.time)
            if segment.name and not result.at_most:
                placed = replace(placed, how=f"segment {segment.name}: {result.how}")
            before = least.get(result.quantity)
            if before is None:
                least[result.quantity] = placed
            elif result.quantity == "foot_stiffness":
                least[result.quantity] = _of_both(before, placed)
            elif _worse(placed, before):
                least[result.quantity] = placed
    return tuple(least.values())


def _of_both(one: Tolerated, other: Tolerated) -> Tolerated:
    """The range of stiffness on which no foot lifts in either of two motions.

    The instant is when a foot lifts on softer feet, or on the stiffest ones where one lifts there.
    """
    worse = max(one, other, key=lambda feet: (feet.value, not feet.at_most))
    if np.isfinite(worse.value):
        return worse
    ranges = [(feet.value, np.inf) if np.isfinite(feet.value) else feet.between for feet in (one, other)]
    known = [part for part in ranges if part is not None]
    least, most = max((low for low, _ in known), default=0.0), min((high for _, high in known), default=0.0)
    if len(known) == len(ranges) and least <= most:
        return replace(worse, between=(least, most))
    apart = (
        {"how": f"no stiffness is enough in both: {one.how}; {other.how}"}
        if len(known) == len(ranges)
        else {}
    )
    return replace(worse, between=None, **apart)


def _worse(one: Tolerated, other: Tolerated) -> bool:
    """Whether one value of a quantity is worse than another; a factor of friction is worse if it is
    larger.
    """
    if one.quantity == "friction":
        return one.value > other.value
    return (one.value, one.at_most) < (other.value, other.at_most)


def _stiffness(robot: Robot, motion: Trajectory) -> Tolerated | None:
    """The minimum stiffness of feet; None where it is not known."""
    result = softest_feet(robot, motion)
    if result is None:
        return None
    lost, between = result.lost, result.between
    if lost is None or lost.time is None:
        return Tolerated("foot_stiffness", result.least, "N/m", True, np.nan, "", between)
    what = "lifts" if lost.value < 0 else f"moves by more than {1e3 * FALLEN:.0f} mm"
    how = f"contact {lost.contacts[0]} {what}"
    return Tolerated("foot_stiffness", result.least, "N/m", False, lost.time, how, between)


def _towards(side: np.ndarray, word: str, loads: Loads) -> Deviation:
    return Deviation(loads, side[None], f"{word}{_direction(side)}")


def _direction(side: np.ndarray) -> str:
    """In words: (0.71, -0.71, 0)."""
    return "towards ({})".format(", ".join(f"{x:.2g}" for x in np.round(side, 2) + 0.0))


def _knots(robot: Robot, motion: Trajectory) -> np.ndarray:
    """(K,) s, within the motion, of what acts."""
    knots = robot.acts.knots
    return knots[(knots > 0) & (knots < motion.end)]


def _near(low: float, high: float) -> bool:
    return high - low <= CLOSE * high or high <= 1e-6


def _vibrating(robot: Robot, motion: Trajectory, least: dict[str, Tolerated]) -> dict[str, Tolerated]:
    """Payload and speed at which no foot lifts while the base vibrates on its declared springs.

    Several levels are computed below those without vibration, for a slower motion may
    excite a mode more than a faster one. All are zero where a foot lifts nominally.
    """
    whole = replace(robot.arm, payload=None, bare_link=None)  # what is held is a part of the last link

    def heavier(mass: float) -> Margin | None:
        return first_lift(robot.varied(arm=whole.with_payload(Payload(mass))).during(motion), motion)

    def faster(more: float) -> Margin | None:
        quicker = motion.time_scaled(1 / (1 + more))
        lift = first_lift(robot.during(quicker), quicker)
        return lift and replace(lift, time=min((1 + more) * (lift.time or 0.0), motion.end))

    def lost(one: Tolerated, value: float, lift: Margin) -> Tolerated:
        how = f"contact {lift.contacts[0]} {ON_SPRINGS}"
        return replace(one, value=value, at_most=False, time=lift.time, how=how)

    if not robot.swings:
        return {}
    if lift := first_lift(robot.during(motion), motion):
        return {name: lost(one, float(name == "friction"), lift) for name, one in least.items()}
    results = {}
    for name, scale, lifted in (("extra_mass", 1.0, heavier), ("faster", 100.0, faster)):
        levels = np.linspace(0.0, least[name].value / scale, _LEVELS + 1)
        for below, level in pairwise(levels.tolist()):
            if level > below and (lift := lifted(level)):
                level, lift = bisected(lifted, below, level, lift, _near)
                results[name] = lost(least[name], scale * level, lift)
                break
    return results


def _late(
    robot: Robot, motion: Trajectory, wrenches: Callable[..., np.ndarray]
) -> tuple[np.ndarray, list[Deviation]]:
    """Times of wrenches, which are functions of states and what acts; every subset of the joints that move,
    delayed by the level. Above `MOST_LATE` joints each is delayed alone.
    """
    moving = np.flatnonzero(motion.speed_peaks > 0)
    if len(moving) > MOST_LATE:
        subsets = np.eye(len(moving), dtype=bool)
    else:
        subsets = np.array(list(product((False, True), repeat=len(moving)))[1:-1], dtype=bool)
    events = np.union1d(motion.event_times, _knots(robot, motion))

    @lru_cache(maxsize=1)  # all subsets begin with the largest delay that was not yet too much
    def both(delay: float) -> tuple:
        sides = events[:, None] + np.array([-INSIDE, INSIDE])
        times = np.hstack([sides, sides + delay]).ravel()  # by event, as the case's times
        return motion.states(times), motion.states(times - delay), robot.acting(times)

    def case(subset: np.ndarray) -> Deviation:
        late = np.isin(np.arange(motion.n), moving[subset])

        def loads(delay: float) -> np.ndarray:
            now, then, acting = both(delay)
            q, qd, qdd = (np.where(late, b, a) for a, b in zip(now, then, strict=True))
            return wrenches(q, qd, qdd, acting)

        names = (robot.names[j] for j in moving[subset])
        return Deviation(loads, how=f"delayed: {', '.join(names)}")

    return np.repeat(events, 4), [case(subset) for subset in subsets]
