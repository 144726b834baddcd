"""Robustness of a motion until a contact is lost: each deviation from the model alone, by bisection.

The loads are linear in what deviates: gravity (a tilted floor), mass at the gripper, a push, the square of a
speed factor. So those of all instants are computed once and combined. At every level the contact forces, GN
and GT are computed again: lost means GN or GT at 1, whatever smaller limits the motion keeps. Sampled
instants and directions are checked; other limits (torques, clearance) are not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from ocptip.contact.bindings.binding import DAMPING_RATIO
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.motion.cycles.task import Task
from ocptip.numerics.bisection import bisected
from ocptip.numerics.threads import one_thread
from ocptip.reserves.slip import Slip, known
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.load_cases import CLOSER, MotionLoads, about, everywhere
from ocptip.standing.at_rest.slope import around, beside, tilted
from ocptip.standing.elastic.feet import STIFFEST, softest_feet
from ocptip.standing.elastic.springs import FALLEN
from ocptip.standing.footing import Footing
from ocptip.trajectories.trajectory import INSIDE, Trajectory

SPACING = 0.01  # s: between instants, at most
FIRST = 20  # wrenches beyond half spaces that are looked at before the others
_NEIGHBOURS = 32  # wrenches that share a box
CLOSE = 2e-3  # of a value: how near the bisection gets
MOST_LATE = 6  # joints of which every subset may be late
TILT, SPEED, DELAY = np.radians(30.0), 1.0, 0.1  # rad, share, s: what is looked at, at most

_WORDS = {
    "tilt": ("floor tilted by ", ""),
    "extra_mass": ("", " more at the gripper"),
    "push": ("push of ", " at the gripper"),
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
    "foot_stiffness": "feet",
}
Loads = Callable[[float], np.ndarray]
"""Wrenches (N, 6) on the base at a level of a deviation."""


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
        """In a few words: "tilt 3.84 deg", "delay >= 100 ms"."""
        name, sign, value = _SHORT[self.quantity], ">= " if self.at_most else "", self.value
        if self.quantity == "friction":
            return "any friction" if self.at_most else f"friction {100 * (value - 1):.3g} %"
        if self.quantity != "foot_stiffness":
            text = f"{name} {sign}{value:.3g} {self.unit}".replace("+ ", "+").replace("+>= ", ">= +")
            return text if self.drives is None else f"{text} (drives +{self.drives:.3g} {self.unit})"
        if np.isfinite(value):
            return f"{name} of {_stiffness_text(min(value, STIFFEST))} and stiffer"
        if self.between is None:
            return "compliant feet lift or slip"
        return f"{name} of {' to '.join(map(_stiffness_text, self.between))}"

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
        own = dict(vars(self))
        between, drives = own.pop("between"), own.pop("drives")
        own |= {"drives": drives} if drives is not None else {}
        return own | ({"between": list(between)} if between else {})


def _stiffness_text(value: float) -> str:
    return f"{value:.2g} N/m".replace("e+0", "e")


@dataclass(frozen=True, eq=False)
class _Case:
    """One way to deviate: wrenches by level, at these times, what to call it, and its direction, if any."""

    loads: Loads
    times: np.ndarray
    how: str
    side: np.ndarray | None = None


@one_thread
def tolerated(robot: Robot, motion: Trajectory) -> tuple[Tolerated, ...]:
    """Robustness of the motion of an arm, each quantity alone.

    - tilt: of floor and base, in any direction, degrees;
    - extra_mass: a point mass at the gripper, kg, and the one that the drives can move;
    - push: a force at the gripper in any direction, N;
    - friction: factor of the friction coefficients of all ordinary contacts (left out if all are clamps);
    - faster: all times shorter, per cent of speed;
    - foot_stiffness: the minimum, N/m, of compliant feet, see `ocptip.standing.elastic.feet.softest_feet`;
      infinite if a foot lifts on the stiffest, then `between` says on which none does, if on any;
    - delay: delay of any of the joints, ms (up to six joints that move).

    All values are zero for a nominal motion that loses a contact.

    Raises:
        InputError: the motion does not fit the arm.
    """
    robot.require_fit(motion.n)
    robot = robot.during(motion)
    parts = MotionLoads(robot, motion, np.union1d(motion.both_sides(SPACING), _knots(robot, motion)))
    solver = _Solver(robot)
    free = robot.support.gravity
    size = float(np.linalg.norm(free))

    nominal = parts.total()

    def downhill(side: np.ndarray) -> Loads:
        return lambda a: nominal + parts.per_gravity @ (tilted(free, side, a) - free)

    def pushed(side: np.ndarray) -> Loads:
        per_newton = parts.at_tool(side)
        return lambda force: nominal + force * per_newton

    def slopes(sides: np.ndarray) -> list[_Case]:
        return _named(parts, downhill, sides, "downhill")

    def pushes(sides: np.ndarray) -> list[_Case]:
        return _named(parts, pushed, sides, "")

    tilts = slopes(around(free)), lambda side, angle: slopes(beside(free, side, angle))
    forces = pushes(everywhere(free)), lambda side, angle: pushes(about(side, angle))
    found = [
        solver.largest("tilt", "deg", np.degrees(1.0), TILT, *tilts),
        replace(
            solver.largest(
                "extra_mass",
                "kg",
                1.0,
                robot.mass,
                [_Case(lambda m: nominal + m * parts.extra, parts.times, "")],
            ),
            drives=parts.held_by_drives(robot, motion),
        ),
        solver.largest("push", "N", 1.0, size * robot.mass, *forces),
        _least_friction(robot, solver, parts.times, nominal),
        solver.largest(
            "faster", "%", 100.0, SPEED, [_Case(lambda e: parts.total(speed=1 + e), parts.times, "")]
        ),
        solver.largest("delay", "ms", 1e3, DELAY, _late(robot, motion)),
        _stiffness(robot, motion),
    ]
    return tuple(one for one in found if one is not None)


def robustness(task: Task, motion: Trajectory) -> tuple[Tolerated, ...]:
    """For every deviation the minimum over the segments; empty for parallel robots, and with objects.

    Times are from the begin of the first segment.
    """
    least: dict[str, Tolerated] = {}
    for segment, own, begin in zip(task.segments, motion.segments, motion.begins, strict=False):
        robot = segment.task.robot
        for found in tolerated(robot, own) if isinstance(robot, Robot) and not robot.objects else ():
            placed = replace(found, time=float(begin) + found.time)
            if segment.name and not found.at_most:
                placed = replace(placed, how=f"segment {segment.name}: {found.how}")
            before = least.get(found.quantity)
            if before is None or _worse(placed, before):
                least[found.quantity] = placed
    return tuple(least.values())


def _worse(one: Tolerated, other: Tolerated) -> bool:
    """Whether one value of a quantity is worse than another; a factor of friction is worse if it is
    larger.
    """
    if one.quantity == "friction":
        return one.value > other.value
    return (one.value, one.at_most) < (other.value, other.at_most)


class _Solver:
    """Says whether contacts hold; finds the largest level at which all do."""

    def __init__(self, footing: Footing) -> None:
        support, tip_over, slip = footing.support, footing.tip_over, footing.slip
        self._footing = footing
        self._quick = Slip(support, "tangential")
        affine = not tip_over.free_rotation and len(tip_over.axes) > 0 and support.elastic is None
        self._moments = tip_over.affine_moments if affine else None
        self._held = slip.half_spaces(1.0) if affine else None

    def lost(self, wrenches: np.ndarray) -> tuple[int, str] | None:
        """Row of the worst wrench under which a contact is lost, and how; None if none is."""
        if self._moments is None or self._held is None:
            return self._solved(wrenches)
        slope, offset = self._moments
        least = np.min(wrenches @ slope.T + offset, axis=1)
        worst = int(np.argmin(least))
        if least[worst] <= 0:
            return worst, self._tips(int(np.argmin(wrenches[worst] @ slope.T + offset)))
        for rows in np.split(_beyond(self._held, wrenches), [FIRST]):  # most are lost among the first
            if len(rows) and (found := self._solved(wrenches[rows])) is not None:
                return int(rows[found[0]]), found[1]
        return None

    def _tips(self, axis: int) -> str:
        axes = self._footing.tip_over.axes
        if not 0 <= axis < len(axes):
            return "tips"
        return "tips about contacts {} and {}".format(*sorted(c + 1 for c in axes[axis].contacts))

    def _solved(self, wrenches: np.ndarray) -> tuple[int, str] | None:
        """A state that fails, and its failure in words, from solved contact forces."""
        states = self._footing.contact_states(wrenches)
        tip = self._footing.tip_over.evaluate(states)
        falls = ~(tip.GN < 1)
        if falls.any():
            row = int(np.argmax(np.where(np.isnan(tip.GN), np.inf, tip.GN)))
            return row, self._tips(int(tip.nearest_axis[row]))
        rows = np.flatnonzero(~(self._quick.evaluate(states, derivatives=False).GT < 1))
        if not len(rows):
            return None
        ratio = self._footing.slip.evaluate(states.select(rows), derivatives=False).GT
        slides = np.flatnonzero(~(ratio < 1))
        return (int(rows[slides[np.argmax(ratio[slides])]]), "slips") if len(slides) else None

    def _prediction(self, loads: Loads, level: float) -> Callable[[float], bool] | None:
        """Whether contacts are likely lost at levels below one at which they are; None: not known cheaply.

        Half spaces are convex: wrenches within them at the levels zero and `level` are so between. The others
        decide; forces are solved for the farthest only.
        """
        if (held := self._held) is None:
            return None
        rows = np.sort(_beyond(held, loads(level)))

        def likely(level: float) -> bool:
            nonlocal rows
            wrenches = loads(level)[rows]
            beyond = _beyond(held, wrenches)
            if not len(beyond) or self.lost(wrenches[beyond[:1]]) is None:
                return False
            rows = np.sort(rows[beyond])
            return True

        return likely

    def largest(
        self,
        quantity: str,
        unit: str,
        scale: float,
        most: float,
        cases: Iterable[_Case],
        near_by: Callable[[np.ndarray, float], Iterable[_Case]] | None = None,
    ) -> Tolerated:
        """The largest level, the minimum over all cases; to a relative precision of `CLOSE`.

        `near_by` has the cases at an angle from a direction, for those next to the worst of the given ones.
        """
        best, time, how = most, np.nan, ""
        worst: np.ndarray | None = None

        def near(low: float, high: float) -> bool:
            return high - low <= CLOSE * high or high <= 1e-6 * most

        def narrow(cases: Iterable[_Case]) -> None:
            nonlocal best, time, how, worst
            for case in cases:
                fails = self.lost(case.loads(best))
                if fails is None:
                    continue

                def lost(level: float, loads: Loads = case.loads) -> tuple[int, str] | None:
                    return self.lost(loads(level))

                best, fails = bisected(lost, 0.0, best, fails, near, self._prediction(case.loads, best))
                time, worst = float(case.times[fails[0]]), case.side
                how = ", ".join(part for part in (case.how, fails[1]) if part)

        narrow(cases)
        for angle in () if near_by is None else CLOSER:
            if worst is not None:
                narrow(near_by(worst, angle))
        return Tolerated(quantity, float(scale * best), unit, not how, time, how)


def _beyond(half_spaces: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
    """Rows of wrenches (N, 6) that are beyond half spaces a . w <= 0, the farthest first.

    Boxes around neighbours, which are alike, are looked at first: most are inside with all their corners.
    """
    starts = np.arange(0, len(wrenches), _NEIGHBOURS)
    low, high = np.minimum.reduceat(wrenches, starts), np.maximum.reduceat(wrenches, starts)
    most = 0.5 * ((low + high) @ half_spaces.T + (high - low) @ np.abs(half_spaces).T)
    near = np.repeat(np.max(most, axis=1) > 0, _NEIGHBOURS)[: len(wrenches)]
    rows = np.flatnonzero(near)
    outside = np.max(wrenches[rows] @ half_spaces.T, axis=1, initial=-np.inf)
    return rows[np.argsort(-outside, kind="stable")[: np.count_nonzero(outside > 0)]]


def _least_friction(
    robot: Robot, solver: _Solver, times: np.ndarray, wrenches: np.ndarray
) -> Tolerated | None:
    """The minimum factor of the friction coefficients of ordinary contacts; None without such contacts."""
    if not any(isinstance(c, UnilateralContact) for c in robot.support.contacts):
        return None

    def lost(factor: float) -> tuple[int, str] | None:
        contacts = [
            replace(c, friction=factor * c.friction) if isinstance(c, UnilateralContact) else c
            for c in robot.support.contacts
        ]
        return _Solver(robot.on(robot.support.varied(contacts))).lost(wrenches)

    def near(low: float, high: float) -> bool:
        return high - low <= 0.5 * CLOSE or high <= 1e-3

    factor, found = 1.0, solver.lost(wrenches)
    if found is None:
        # The friction used is the factor that contacts need; each factor evaluated takes another solver.
        used = float(np.max(known(robot.slip.greatest(wrenches))))
        factor, (row, how) = bisected(lost, 1.0, 0.0, (-1, "slips"), near, lambda factor: factor <= used)
    else:
        row, how = found
    if row < 0:  # it needs next to no friction
        return Tolerated("friction", factor, "", True, np.nan, "")
    return Tolerated("friction", factor, "", False, float(times[row]), how)


def _stiffness(robot: Robot, motion: Trajectory) -> Tolerated | None:
    """The minimum stiffness of feet; None where it is not known."""
    found = softest_feet(robot, motion)
    if found is None:
        return None
    lost, between = found.lost, found.between
    if lost is None:
        return Tolerated("foot_stiffness", found.least, "N/m", True, np.nan, "", between)
    what = "lifts" if lost.value < 0 else f"moves by more than {1e3 * FALLEN:.0f} mm"
    how = f"contact {lost.contacts[0]} {what}"
    return Tolerated("foot_stiffness", found.least, "N/m", False, lost.time, how, between)


def _named(
    parts: MotionLoads, loads: Callable[[np.ndarray], Loads], sides: Iterable[np.ndarray], word: str
) -> list[_Case]:
    return [_Case(loads(side), parts.times, f"{word} {_direction(side)}".lstrip(), side) for side in sides]


def _direction(side: np.ndarray) -> str:
    """In words: (0.71, -0.71, 0)."""
    return "towards ({})".format(", ".join(f"{x:.2g}" for x in np.round(side, 2) + 0.0))


def _knots(robot: Robot, motion: Trajectory) -> np.ndarray:
    """(K,) s, within the motion, of what acts."""
    own = robot.acts.knots
    return own[(own > 0) & (own < motion.end)]


def _late(robot: Robot, motion: Trajectory) -> list[_Case]:
    """Every subset of the joints that move, delayed by the level; above `MOST_LATE` joints, each alone."""
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

    def case(subset: np.ndarray) -> _Case:
        late = np.isin(np.arange(motion.n), moving[subset])

        def loads(delay: float) -> np.ndarray:
            now, then, acting = both(delay)
            q, qd, qdd = (np.where(late, b, a) for a, b in zip(now, then, strict=True))
            return robot.loads(q, qd, qdd, acting)[1]

        names = (robot.names[j] for j in moving[subset])
        return _Case(loads, np.repeat(events, 4), f"delayed: {', '.join(names)}")

    return [case(subset) for subset in subsets]
