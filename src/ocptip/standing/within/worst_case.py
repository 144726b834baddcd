"""The worst that a tolerance allows for the contacts of an arm on its base, state by state.

For every moment about a tipping axis and for friction utilisation the worst deviations are chosen by the
slopes over them. They are evaluated exactly, chosen again there, and evaluated again: the result is attained.
A moment about an axis on a plane is affine in the wrench, so that nothing but products of deviations can be
missed, see `Deviations.missed`. The wrenches that contacts carry within a share of their friction are a
convex set; for friction utilisation the ascent finds one worst end of the tolerance from each start. It
starts from those that are the worst for half spaces of that set, see `half_spaces`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ocptip.reserves.slip import SlipMap, known
from ocptip.reserves.tipping import TipMap
from ocptip.reserves.wrench_cone import ConeMap
from ocptip.standing.arm import Robot
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.deviations import Deviations, deviations_of
from ocptip.standing.within.half_spaces import Beyond, farthest

ROUNDS = 2  # how often the worst deviations are chosen
_FIRST = 16  # states with which the search for the largest slip reserve begins


@dataclass(frozen=True, eq=False)
class WorstDeviations:
    """The worst of N states.

    Attributes:
        values: (N,) moment, N m, or GT.
        theta: (N, size) deviations there.
        slopes: (N, 6) of the value over the wrench there.
        bends: (N, 6, 6) second derivatives; None where there are none, or nobody asked.
    """

    values: np.ndarray
    theta: np.ndarray
    slopes: np.ndarray
    bends: np.ndarray | None = None

    def worse(self, other: WorstDeviations, sign: float) -> WorstDeviations:
        """State by state the one with the larger sign * value; without second derivatives."""
        better = sign * other.values > sign * self.values
        return WorstDeviations(
            np.where(better, other.values, self.values),
            np.where(better[:, None], other.theta, self.theta),
            np.where(better[:, None], other.slopes, self.slopes),
        )


class WorstCase:
    """Worst moments and friction utilisation of an arm on its base within an uncertainty.

    Args:
        robot: on its base.
        tolerance: of it.
        interface: of the robot's `interfaces`; 0: the base.

    Attributes:
        footing: the base on contacts with the minimum friction.
        deviations: of it.
        reference: M0 of the tip-over index, N m; of the nominal robot.
        axes: number of tipping axes.
        enough: friction utilisation up to which nobody asks for more than a bound, see `up_to`.

    Raises:
        InputError: the tolerance does not fit the robot, or the robot is no arm.
    """

    def __init__(self, robot: StandingMechanism, tolerance: Uncertainty, interface: int = 0) -> None:
        robot = Robot.of(
            robot, "tolerance: parallel robots have only damping in [tolerance] (--tolerance none)"
        )
        self.deviations: Deviations = deviations_of(robot, tolerance, interface)
        self._nominal = robot.interfaces[interface]
        self.footing = self._nominal.weakest(tolerance)
        self.reference = self.footing.tip_over.reference_moment or 0.0
        self._map = TipMap(self.footing.tip_over)
        self._slip_map: ConeMap | SlipMap | None = None
        self.enough = 0.0
        self.axes = self._map.count

    def within(self, tolerance: Uncertainty) -> WorstCase:
        """The worst case within another uncertainty, of at most these quantities; most of it is shared."""
        other = copy(self)
        other.deviations = self.deviations.within(tolerance)
        if tolerance.friction != self.deviations.tolerance.friction:
            other.footing = self._nominal.weakest(tolerance)
            other._map = TipMap(other.footing.tip_over)
        return other

    def loaded(self, factors: np.ndarray) -> WorstCase:
        """The worst case of N states whose payload has its mass times factors (N,).

        For `moments`, `least` and `slip` of exactly these states; estimates are of the nominal payload.
        """
        other = copy(self)
        other.deviations = self.deviations.loaded(factors)
        return other

    def on_slopes(self, gravity: np.ndarray) -> WorstCase:
        """The worst case of N states of a base that drives, with gravity (N, 3), m/s^2, base axes.

        For `moments`, `least` and `slip` of exactly these states.
        """
        other = copy(self)
        other.deviations = self.deviations.on_slopes(gravity)
        return other

    def tilted(self, more: np.ndarray) -> WorstCase:
        """The worst case of N states whose floor may have a further tilt (N,), rad.

        For `moments` and `least` of exactly these states.
        """
        other = copy(self)
        other.deviations = self.deviations.tilted(more)
        return other

    def up_to(self, GT: float) -> WorstCase:
        """The worst case where no friction utilisation is searched that half spaces show to be below GT."""
        other = copy(self)
        other.enough = self.footing.slip.level_below(GT)
        return other

    def smooth(self, GT: float) -> tuple[WorstCase, float]:
        """The worst case with a smooth slip function for programs, and the bound on it that keeps GT."""
        other = copy(self)
        other._slip_map, most = self.footing.slip.within(GT)
        return other, most

    def moments(
        self,
        s: np.ndarray,
        axis: np.ndarray,
        theta: np.ndarray | None = None,
        max_delay: np.ndarray | None = None,
    ) -> WorstDeviations:
        """Minimum moments about tipping axes.

        Args:
            s: (N, 3 n) states.
            axis: (N,) which axis of each.
            theta: (N, size) deviations; default: the worst.
            max_delay: (N, n), s: maximum delay of joints there; default: the whole delay.
        """
        rows = np.arange(len(s))
        if theta is not None:
            values, slopes = self._map(self.deviations.wrench(s, theta)[0])
            return WorstDeviations(values[rows, axis], theta, slopes[rows, axis])

        def about_axis(wrenches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slopes = self._map(wrenches)
            return values[rows, axis], slopes[rows, axis]

        return self.least(s, about_axis, max_delay)

    def least(
        self,
        s: np.ndarray,
        quantity: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
        max_delay: np.ndarray | None = None,
    ) -> WorstDeviations:
        """Minimum of a quantity of the wrench: values (N,) and slopes (N, 6) of wrenches (N, 6)."""

        def at(theta: np.ndarray) -> tuple[WorstDeviations, np.ndarray]:
            wrenches, over = self.deviations.wrench_and_slopes(s, theta)
            values, slopes = quantity(wrenches)
            return WorstDeviations(values, theta, slopes), np.einsum("nw,nwt->nt", slopes, over)

        result, slopes = at(self.deviations.nominal(len(s)))
        for k in range(ROUNDS):
            theta = self.deviations.least(slopes, max_delay)
            if k < ROUNDS - 1:
                new, slopes = at(theta)
            else:  # nobody asks for slopes over the last deviations, which take most of the time
                values, over = quantity(self.deviations.wrench(s, theta)[0])
                new = WorstDeviations(values, theta, over)
            result = result.worse(new, -1.0)
        return result

    def all_moments(self, s: np.ndarray) -> np.ndarray:
        """(N, axes) minimum moments."""
        count, axes = len(s), self.axes
        rows = np.repeat(np.arange(count), axes), np.tile(np.arange(axes), count)
        return self.moments(s[rows[0]], rows[1]).values.reshape(count, axes)

    def estimated_moments(self, s: np.ndarray, max_delay: np.ndarray | None = None) -> np.ndarray:
        """(N, axes) the same up to products of deviations, several times faster."""
        return np.stack([result.values for result in self._estimated(s, range(self.axes), max_delay)], axis=1)

    def _estimated(
        self, s: np.ndarray, axes: Iterable[int], max_delay: np.ndarray | None
    ) -> Iterator[WorstDeviations]:
        """Minimum moments about one axis after the other, up to products of deviations."""
        wrenches, over = self.deviations.wrench_and_slopes(s, np.zeros((len(s), self.deviations.size)))
        values, slopes = self._map(wrenches)
        for k in axes:
            change = np.einsum("nw,nwt->nt", slopes[:, k], over)
            theta = self.deviations.least(change, max_delay)
            yield WorstDeviations(values[:, k] + np.einsum("nt,nt->n", change, theta), theta, slopes[:, k])

    def slip(
        self,
        s: np.ndarray,
        starts: int = 1,
        theta: np.ndarray | None = None,
        max_delay: np.ndarray | None = None,
    ) -> WorstDeviations:
        """Maximum friction utilisation of the search.

        Args:
            s: (N, 3 n) states.
            starts: from how many deviations the worst is searched: those that are worst for the half spaces
                which they go farthest beyond, and as many others: by slopes at the nominal ones, then those
                with gravity tilted and so on, along the axes of the force and the moment.
            theta: (N, size) deviations; default: the worst.
            max_delay: (N, n), s: maximum delay of joints there; default: the whole delay.
        """
        if theta is not None:
            return self._slip_under(self.deviations.wrench(s, theta)[0], theta)
        result, slopes = self._slip_at(s, self.deviations.nominal(len(s)))
        for theta in self._starts(s, starts, result.values, slopes, max_delay):
            for _ in range(ROUNDS + (starts > 1)):
                new, slopes = self._slip_at(s, theta)
                result, theta = result.worse(new, 1.0), self.deviations.least(-slopes, max_delay)
        return result

    def keeps_slip(self, s: np.ndarray, GT: float) -> bool:
        """Whether half spaces prove that friction utilisation at states (N, 3 n) is at most GT, at the worst.

        Also False where there are none, or where only the round cones are wide enough.
        """
        rows = self.footing.slip.half_spaces(GT)
        if rows is None:
            return False
        states, a = np.repeat(s, len(rows), axis=0), np.tile(rows, (len(s), 1))
        theta = np.zeros((len(states), self.deviations.size))
        for k in range(ROUNDS + 1):
            wrenches, over = self.deviations.wrench_and_slopes(states, theta)
            if np.any(np.einsum("nw,nw->n", a, wrenches) > 0):
                return False
            if k < ROUNDS:
                theta = self.deviations.least(-np.einsum("nw,nwt->nt", a, over))
        return True

    def estimated_slip(self, s: np.ndarray, max_delay: np.ndarray | None = None) -> np.ndarray:
        """(N,) worst friction utilisation by its slopes at the nominal state."""
        result, slopes = self._slip_at(s, np.zeros((len(s), self.deviations.size)))
        return result.values + np.einsum("nt,nt->n", slopes, self.deviations.least(-slopes, max_delay))

    def greatest_slips(self, s: np.ndarray, max_delay: np.ndarray | None = None) -> np.ndarray:
        """(N,) worst friction utilisation where it is large, at the deviations that are worst for the nearest
        half space; elsewhere a bound of at most 95 % of the maximum, and of 1.

        The half spaces are those of a level just below the maximum: at a higher one the nearest may be that
        of tip-over. Where there are none it is the estimate by slopes.
        """
        slip, values, left = self.footing.slip, np.empty(len(s)), np.arange(len(s))
        wrenches = self.deviations.wrench(s, self.deviations.nominal(len(s)))[0]
        maximum = self.enough or float(np.max(known(slip.greatest(wrenches)), initial=0.0))
        for most in (_FIRST, len(s)):
            level = max(slip.level_below(maximum), self.enough)
            if (rows := slip.half_spaces(level)) is None:
                return self.estimated_slip(s, max_delay)
            late = None if max_delay is None else max_delay[left]
            beyond = self.farthest(s[left], rows, late, 0.0, 1)
            worst = np.argsort(-beyond.values, kind="stable")[:most]
            todo, values[left] = left[beyond.instants[worst]], level
            values[todo] = self.slip(s[todo], theta=beyond.theta[worst]).values
            maximum, left = max(maximum, np.max(known(values[todo]), initial=0.0)), np.setdiff1d(left, todo)
        return values

    def function(
        self, s: np.ndarray, which: np.ndarray, max_delay: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The worst values, (N,), and their slopes (N, 3 n) over the states.

        Args:
            s: (N, 3 n) states.
            which: (N,) of each: minus the moment about a tipping axis, or, = `axes`, friction utilisation.
            max_delay: (N, n), s: maximum delay of joints there.
        """
        values, slopes = np.empty(len(s)), np.empty(s.shape)
        for chosen, sign in ((which < self.axes, -1.0), (which == self.axes, 1.0)):
            if chosen.any():
                tips = sign < 0
                result = (
                    self.moments(s[chosen], which[chosen], max_delay=max_delay[chosen])
                    if tips
                    else self.slip(s[chosen], max_delay=max_delay[chosen])
                )
                values[chosen] = sign * result.values
                slopes[chosen] = self.deviations.state_slopes(s[chosen], result.theta, sign * result.slopes)[
                    0
                ]
        return values, slopes

    def estimated(
        self, s: np.ndarray, functions: Sequence[int], max_delay: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values (N, F) and slopes (N, F, 3 n) of F functions of all states.

        As `function` gives them, but those of moments up to products of deviations, several times faster.
        """
        tips = self._estimated(s, [k for k in functions if k < self.axes], max_delay)
        values, slopes = np.empty((len(s), len(functions))), np.empty((len(s), len(functions), s.shape[1]))
        for number, which in enumerate(functions):
            sign = -1.0 if which < self.axes else 1.0
            result = next(tips) if which < self.axes else self.slip(s, max_delay=max_delay)
            values[:, number] = sign * result.values
            slopes[:, number] = self.deviations.state_slopes(s, result.theta, sign * result.slopes)[0]
        return values, slopes

    def _starts(
        self,
        s: np.ndarray,
        count: int,
        nominal: np.ndarray,
        slopes: np.ndarray,
        max_delay: np.ndarray | None,
    ) -> Iterator[np.ndarray]:
        level = self.footing.slip.level_below(float(np.max(known(nominal), initial=0.0)))
        planes = None if self._slip_map is not None else self.footing.slip.half_spaces(level)
        if planes is not None:
            beyond = self.farthest(s, planes, max_delay, None, count)
            first = np.searchsorted(beyond.instants, np.arange(len(s)))
            last = np.searchsorted(beyond.instants, np.arange(len(s)), side="right") - 1
            for k in range(count):
                yield beyond.theta[np.minimum(first + k, last)]
        yield self.deviations.least(-slopes, max_delay)
        if count > 1:
            over = self.deviations.wrench_and_slopes(s, self.deviations.nominal(len(s)))[1]
            for k in range(count - 1):
                sign = 1.0 if k % 2 else -1.0
                yield self.deviations.least(sign * over[:, (0, 1, 5, 3, 4, 2)[k // 2 % 6]], max_delay)

    def farthest(
        self,
        s: np.ndarray,
        planes: np.ndarray,
        max_delay: np.ndarray | None,
        above: float | None,
        most: int,
    ) -> Beyond:
        """The half spaces that states go farthest beyond, with the deviations that are worst for each."""
        n = self.deviations.robot.n
        late = np.full((len(s), n), self.deviations.tolerance.late) if max_delay is None else max_delay
        options = np.stack([*np.split(s[:, : 3 * n], 3, axis=1), late], axis=2)[:, :, None]
        return farthest(self.deviations, options, s[:, 3 * n :], planes, above, most)

    def _slip_at(self, s: np.ndarray, theta: np.ndarray) -> tuple[WorstDeviations, np.ndarray]:
        """GT at deviations, large where it is not known, and its slopes over the deviations."""
        wrenches, over = self.deviations.wrench_and_slopes(s, theta)
        worst_deviations = self._slip_under(wrenches, theta)
        return worst_deviations, np.einsum("nw,nwt->nt", worst_deviations.slopes, over)

    def _slip_under(self, wrenches: np.ndarray, theta: np.ndarray) -> WorstDeviations:
        if self._slip_map is not None:
            values, slopes, bends = self._slip_map(wrenches)
            return WorstDeviations(values, theta, slopes, bends)
        reserve = self.footing.slip.evaluate(self.footing.contact_states(wrenches))
        values, slopes = reserve.for_program()
        return WorstDeviations(values, theta, slopes)

    def tip_ratio(self, moments: np.ndarray) -> np.ndarray:
        """GN of minimum moments, N m, see `TipOver.ratio`."""
        return self.footing.tip_over.ratio(moments)


@lru_cache(maxsize=16)
def worst_case_of(robot: StandingMechanism, tolerance: Uncertainty, interface: int = 0) -> WorstCase:
    """That of a robot, made once."""
    return WorstCase(robot, tolerance, interface)


def worst_cases_of(robot: StandingMechanism, tolerance: Uncertainty) -> list[WorstCase]:
    """Those of all `interfaces` of a robot."""
    return [worst_case_of(robot, tolerance, k) for k in range(len(robot.interfaces))]
