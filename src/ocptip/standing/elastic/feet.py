"""A motion on compliant feet: which feet lift and when, how the base rocks, how long it takes to settle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from ocptip.basics.text import percent, quantity
from ocptip.contact.bindings.binding import DAMPING_RATIO, TANGENTIAL_SHARE, Spring
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.elastic import ElasticFeet
from ocptip.numerics.bisection import bisected
from ocptip.standing.contact_margins import Margin
from ocptip.standing.elastic.drives import SETTLED, course_shifts, ridden, settling
from ocptip.standing.elastic.springs import FALLEN, Course, Ride, Simulation
from ocptip.standing.elastic.steps import Modes
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory

STIFFEST, SOFTEST = 1e7, 1e4  # N/m
_CLOSE = 0.02  # decades of stiffness
_A_MOMENT = 1e-3  # s


@dataclass(frozen=True)
class Lift:
    """A foot in the air.

    Attributes:
        contact: counted from 1.
        begin, end: s.
        height: m, largest gap below it.
        time: s, of the largest gap.
    """

    contact: int
    begin: float
    end: float
    height: float
    time: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "contact": self.contact,
            "begin_s": self.begin,
            "end_s": self.end,
            "height_m": self.height,
            "time_s": self.time,
        }


@dataclass(frozen=True, eq=False)
class FeetMotion:
    """The vibration of a base on compliant feet during a motion and after it.

    Attributes:
        course: of base and feet.
        end: of the motion, s.
        frequency: lowest natural frequency at the start, Hz, all feet pressing, gears that do not give.
        damping: ratio of that mode.
        least: minimum normal force of each foot, n margins, N.
        lowest: (n,), N, normal forces at which they let go.
        lifts: feet in the air, the highest first.
        shift: of the gripper by the feet, farthest from that at rest at the start, m.
        settling: s after the end of the motion until the gripper stays within `SETTLED` of its last place;
            infinite if that was not seen.
    """

    course: Course
    end: float
    frequency: float
    damping: float
    least: tuple[Margin, ...]
    lowest: np.ndarray
    lifts: tuple[Lift, ...]
    shift: Margin
    settling: float

    @property
    def lift(self) -> float:
        """Largest height of a foot above the ground, m; at least `FALLEN` if the base falls."""
        return max(self.lifts[0].height if self.lifts else 0.0, FALLEN if self.falls else 0.0)

    @property
    def falls(self) -> bool:
        """A foot moved so far that it was not followed any longer."""
        return self.course.falls

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "frequency_Hz": self.frequency,
            "damping_ratio": self.damping,
            "least_normal_forces_N": [margin.to_dict() for margin in self.least],
            "lift_m": self.lift,
            "lifts": [lift.to_dict() for lift in self.lifts],
            "falls": self.falls,
            "gripper_shift_m": self.shift.value,
            "gripper_shift_time_s": self.shift.time,
            "settling_s": self.settling,
        }

    def lines(self) -> list[str]:
        """In words."""
        mode = f"lowest natural frequency {self.frequency:.3g} Hz, damping {percent(self.damping)}"
        if self.falls:
            return [f"a foot moves by more than {1e3 * FALLEN:.0f} mm at {self.course.times[-1]:.3f} s", mode]
        result = self._lift_lines() if self.lifts else self._force_lines()
        shift = f"gripper shifted by up to {quantity(1e3 * self.shift.value, 'mm', 3)} {self.shift}"
        within = f"within {1e3 * SETTLED:.1f} mm of rest"
        if np.isfinite(self.settling):
            rest = f"{within} {self.settling:.2f} s after the end"
        else:
            rest = f"not {within} {self.course.times[-1] - self.end:.2g} s after the end"
        return [*result, mode, shift, rest]

    def _force_lines(self) -> list[str]:
        """The contact that is nearest to letting go; none where only rigid clamps hold the base."""
        spare = [margin.value for margin in self.least] - self.lowest
        k = int(np.argmin(spare))
        if not np.isfinite(spare[k]):
            return []
        what = "minimum force at the jaw that does not yield" if self.lowest[k] else "minimum normal force"
        return [f"{what} {quantity(float(spare[k]), 'N', 3)} {self.least[k]}"]

    def _lift_lines(self) -> list[str]:
        highest = self.lifts[0]
        line = f"contact {highest.contact} lifts by {1e3 * highest.height:.2g} mm ({highest.time:.3f} s)"
        if highest.height == 0:
            line = f"contact {highest.contact} bears nothing for an instant ({highest.time:.3f} s)"
        more = len(self.lifts) - 1
        return [line + (f"; {more} other lift{'s' if more > 1 else ''}" if more else "")]


@lru_cache(maxsize=8)
def on_its_feet(robot: StandingMechanism, motion: Trajectory) -> FeetMotion | None:
    """A motion on the springs of the robot's feet; None where it does not swing on them."""
    elastic, begin = robot.support.elastic, motion.start[None]
    if elastic is None or not robot.swings:
        return None
    modes = Modes.of(elastic, robot.inertia(begin, 0 * begin)[0][0])
    _, course = ridden(robot, motion)
    moved = course_shifts(robot, motion, course)
    return FeetMotion(
        course=course,
        end=motion.end,
        frequency=modes.lowest,
        damping=modes.damping,
        least=tuple(_least(course, k) for k in range(len(modes.delays))),
        lowest=elastic.lowest,
        lifts=tuple(sorted(_lifts(course), key=lambda lift: -lift.height)),
        shift=_largest(course.times, np.linalg.norm(moved - moved[0], axis=1)),
        settling=settling(course, motion.end, moved),
    )


def first_lift(robot: StandingMechanism, motion: Trajectory) -> Margin | None:
    """The foot that lifts on the robot's declared springs, when, and by how many N; None: none does.

    Until one lifts, feet that may pull move alike, which is quicker to compute. The base swings on for a
    period after the motion.
    """
    elastic = robot.support.elastic
    if elastic is None or not robot.swings:
        return None
    begin = motion.start[None]
    modes = Modes.of(elastic, robot.inertia(begin, 0 * begin)[0][0])
    ride = Ride(robot, motion, rest=1 / modes.lowest)
    forces, times, _ = Simulation(ride, elastic, modes, one_sided=False).least()
    k = int(np.argmin(spare := forces - elastic.lowest))
    return Margin(float(spare[k]), float(times[k]), (k + 1,)) if spare[k] < 0 else None


@dataclass(frozen=True)
class SoftestFeet:
    """The minimum stiffness of equal feet so that none lifts, with `DAMPING_RATIO` of the lowest mode.

    Attributes:
        least: the stiffness from which on none lifts, N/m: infinite if one lifts on the stiffest.
        lost: minimum normal force, N, when and which foot, on softer ones; not below zero where feet yield by
            more than `FALLEN` before one lifts. None if all stay also on `SOFTEST`.
        between: N/m: where one lifts on the stiffest, the stiffest range on which none does.
    """

    least: float
    lost: Margin | None = None
    between: tuple[float, float] | None = None


def softest_feet(robot: StandingMechanism, motion: Trajectory) -> SoftestFeet | None:
    """Evaluate feet from `STIFFEST` down to `SOFTEST`, two per decade, and bisect where one begins to lift.

    Acceleration steps may lift feet of any stiffness, as forces overshoot by a share of the steps. Soft feet
    answer slowly, so that the next step may come before they lift: what holds on soft feet need not hold on
    stiff ones.

    Returns:
        None where contacts are not ordinary ones, or the robot's inertia is not known, or nothing holds it.
    """
    support = robot.support
    ordinary = [contact for contact in support.contacts if isinstance(contact, UnilateralContact)]
    if not robot.knows_inertia or len(ordinary) < support.n_contacts:
        return None
    unit = np.array([[1.0, *2 * [TANGENTIAL_SHARE if foot.friction else 0.0]] for foot in ordinary])

    def feet(exponent: float) -> ElasticFeet:
        springs = [Spring(10**exponent * each, 0.0, DAMPING_RATIO) for each in unit]
        return ElasticFeet(support.wrench_matrix, springs, support.length)

    if not feet(0.0).holds:
        return None
    ride = Ride(robot, motion, rest=_A_MOMENT)

    def lifted(exponent: float, whether: bool = False) -> Margin | None:
        elastic = feet(exponent)
        modes = Modes.of(elastic, ride.start_inertia[:6, :6])
        forces, times, falls = Simulation(ride, elastic, modes, one_sided=False).least(whether)
        k = int(np.argmin(forces))
        least = Margin(float(forces[k]), float(times[k]), (k + 1,))
        return least if least.value < 0 or falls else None

    return _range(lifted, np.arange(np.log10(STIFFEST), np.log10(SOFTEST) - 0.1, -0.5).tolist())


def _range(lifted: Callable[..., Margin | None], exponents: list[float]) -> SoftestFeet:
    """Stiffness range from what lifts at powers of ten of the stiffness, the stiffest first.

    Args:
        lifted: called as lifted(exponent, whether): some margin below zero is enough if `whether` is true.
        exponents: of ten.
    """
    whether = partial(lifted, whether=True)
    results = [lifted(exponents[0])]
    while results[-1] is not None and len(results) < len(exponents):
        results.append(whether(exponents[len(results)]))
    if results[-1] is not None:
        return SoftestFeet(np.inf, results[0])
    top, least, lost = len(results) - 1, SOFTEST, None
    for above, exponent in pairwise(exponents[top:]):
        if lost := lifted(exponent):
            above, lost = bisected(lifted, above, exponent, lost, _near)
            least = float(10**above)
            break
    if top == 0:
        return SoftestFeet(least, lost)
    beyond = results[top - 1]
    assert beyond is not None  # all before the last one
    most, _ = bisected(whether, exponents[top], exponents[top - 1], beyond, _near)
    return SoftestFeet(np.inf, results[0], (least, float(10**most)))


def _near(low: float, high: float) -> bool:
    return high - low <= _CLOSE


def _least(course: Course, k: int) -> Margin:
    i = int(np.argmin(course.forces[:, k, 0]))
    return Margin(float(course.forces[i, k, 0]), float(course.times[i]), (k + 1,))


def _largest(times: np.ndarray, values: np.ndarray) -> Margin:
    i = int(np.argmax(values))
    return Margin(float(values[i]), float(times[i]))


def _lifts(course: Course) -> list[Lift]:
    """Runs of instants at which a foot has a gap below it, and instants at which one lets go without."""
    lifts = []
    for k, gaps in enumerate(course.gaps.T):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], gaps > 0, [False]])))
        for first, last in edges.reshape(-1, 2):
            top = first + int(np.argmax(gaps[first:last]))
            begin, end = course.times[max(first - 1, 0)], course.times[min(last, len(gaps) - 1)]
            lifts.append(Lift(k + 1, float(begin), float(end), float(gaps[top]), float(course.times[top])))
    for k, time in course.lost:
        if not any(lift.contact == k + 1 and lift.begin - 1e-9 <= time <= lift.end for lift in lifts):
            lifts.append(Lift(k + 1, time, time, 0.0, time))
    return lifts
