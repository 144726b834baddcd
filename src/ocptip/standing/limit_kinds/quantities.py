"""The two quantities of contacts that limits are about: tip-over and slip, see `quantity`."""

from __future__ import annotations

import numpy as np

from ocptip.basics.text import margin_text, quantity
from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.reserves.slip import known
from ocptip.reserves.tipping import TipMap, moment_at
from ocptip.standing.footing import Footing
from ocptip.standing.instants import Loaded
from ocptip.standing.limit_kinds.limit import FAR_FROM_SLIPPING
from ocptip.standing.limit_kinds.quantity import ContactQuantity
from ocptip.standing.stops.by_brakes import BrakeCheck, Closing
from ocptip.standing.within.half_spaces import farthest
from ocptip.standing.within.worst_case import WorstCase, WorstDeviations
from ocptip.standing.within.worst_options import worst_options

PATH_MARGIN = 0.5  # share of M0 / GN - M0 that a path at rest keeps beyond the limit
PATH_MARGIN_WITHIN = 0.05  # share of M0 that a path at rest keeps within an uncertainty
NEAR_SHARE = (
    0.5  # share of M0 within which, at a use of zero, rows of moments within an uncertainty take part
)
STARTS_AT_REST = 9  # wrenches from which the worst slip at rest is looked for
FAR = 0.5  # use of the slip limit in stops by brakes where half spaces tell that it is kept


class TipOverQuantity(ContactQuantity):
    """GN; in programs minus the moments about the tipping axes, N m, which are smooth.

    Attributes:
        moments: of a wrench, N m, about the tipping axes.
        least_moment: N m, at which GN is the number asked for.
    """

    name, symbol, at_steps, in_results = "tip-over", "GN", "jump_tip_over", "tip"
    least = True

    def __init__(self, footing: Footing, number: float, smooth: bool = False) -> None:
        super().__init__(footing, number, smooth)
        self.moments = TipMap(footing.tip_over)
        self.width, self.affine = self.moments.count, self.moments.affine
        reference = footing.tip_over.reference_moment
        self.unit, self.least_moment = 2 * (reference or 1.0), moment_at(number, reference)

    def measure(self, loaded: Loaded) -> np.ndarray:
        return loaded.tip.GN

    def measure_still(self, loaded: Loaded) -> np.ndarray:
        """On the scale of uncertainties: nothing moves yet when the load comes."""
        if not self.width:
            return self.measure(loaded)
        return self.footing.tip_over.ratio(np.min(self.moments(loaded.wrenches)[0], axis=1))

    def detail(self, loaded: Loaded) -> str:
        """GN above 1 counts the acceleration of what lifts: the moment that is missing is another number."""
        return "" if loaded.tip.GN[0] <= 1 else self._left(loaded)

    def _left(self, loaded: Loaded) -> str:
        """The moment left or missing in a single instant, and about which contacts; empty without an axis."""
        axes, margins = self.footing.tip_over.axes, loaded.tip.margins[0]
        if not len(axes) or not np.isfinite(least := float(np.min(margins))):
            return ""
        first, second = sorted(axes[int(np.argmin(margins))].contacts)
        return f"tipping margin {margin_text(least, 'N m')} about contacts {first + 1} and {second + 1}"

    def kept(self, loaded: Loaded) -> bool:
        if self.affine:  # contact states are not needed
            return not self.width or bool(np.min(self.moments(loaded.wrenches)[0]) >= self.least_moment)
        return bool(np.all(self.measure(loaded) <= self.number))

    def refusals(self, loaded: Loaded) -> list[str]:
        if loaded.tip.GN[0] <= self.number:
            return []
        value, left = float(loaded.tip.GN[0]), self._left(loaded)
        where = left if value >= 1 else left[left.index("about") :] if left else ""
        return [f"at rest {self.lost_words(value)}{where and f' ({where})'}"]

    def lost_words(self, value: float, of: str = "") -> str:
        if value >= 1:
            return f"{of or 'the base'} tips"
        left = moment_at(value, self.footing.tip_over.reference_moment)
        left, least = (quantity(moment, "N m") for moment in (left, self.least_moment))
        return f"the tipping margin{of and f' of {of}'} is {left}, must be >= {least}"

    def path_excess(self, loaded: Loaded) -> float:
        if not self.width:
            return -np.inf
        needed = self.least_moment * (1 + PATH_MARGIN)
        return (needed - np.min(self.moments(loaded.wrenches)[0])) / self.footing.tip_over.reference_moment

    def badness(self, loaded: Loaded) -> np.ndarray:
        return self.exact(loaded)

    def exact(self, loaded: Loaded) -> np.ndarray:
        return -self.moments(loaded.wrenches)[0]

    def exact_rows(self, loaded: Loaded) -> tuple[np.ndarray, np.ndarray]:
        moments, slopes = self.moments(loaded.wrenches)
        return -moments / self.unit, -slopes / self.unit

    def near(self, badness: np.ndarray, share: float) -> np.ndarray:
        return -badness * share <= self.least_moment

    def uses(self, badness: np.ndarray) -> np.ndarray:
        return 1 + (self.least_moment + badness) / self.unit

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(self.width, self.least_moment / self.unit), np.full(self.width, np.inf)

    def worst(self) -> np.ndarray:
        return np.full(self.width, -self.least_moment / self.unit)

    def rows(
        self, wrenches: np.ndarray, i: np.ndarray, k: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return *self.moments.some(wrenches, i, k), np.empty(0)

    def smooth_within(self, cases: WorstCase) -> tuple[WorstCase, float]:
        return cases, self.least_moment

    def within(
        self, cases: WorstCase, s: np.ndarray, k: np.ndarray, theta: np.ndarray | None = None
    ) -> WorstDeviations:
        return cases.moments(s, k, theta)

    def worst_of_options(
        self, cases: WorstCase, options: np.ndarray, acting: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        number, values, _ = worst_options(options, cases, acting, functions=range(self.width))
        return values, number

    def worst_within(self, cases: WorstCase, s: np.ndarray, k: np.ndarray, late: np.ndarray) -> np.ndarray:
        return cases.moments(s, k, max_delay=late).theta

    def uses_within(self, cases: WorstCase, s: np.ndarray, bound: float) -> np.ndarray:
        reach = NEAR_SHARE * (cases.reference or 1.0)
        return 1 + (bound - cases.estimated_moments(s)) / reach

    def kept_within(self, cases: WorstCase, s: np.ndarray, bound: float) -> bool:
        return bool(np.all(cases.estimated_moments(s) >= bound))

    def rests_within(self, cases: WorstCase, s: np.ndarray) -> bool:
        return bool(np.all(cases.all_moments(s) >= self.least_moment))

    def worst_at_rest(self, cases: WorstCase, s: np.ndarray) -> tuple[float, np.ndarray]:
        result = cases.moments(s, np.array([np.argmin(cases.all_moments(s)[0])]))
        return float(cases.tip_ratio(result.values)[0]), result.theta[0]

    def path_excess_within(self, cases: WorstCase, s: np.ndarray) -> float:
        if not self.width:
            return -np.inf
        missing = self.least_moment - float(np.min(cases.estimated_moments(s)))
        return missing / cases.reference + PATH_MARGIN_WITHIN

    def brake_torques(self, check: BrakeCheck, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        return check.worst_corners(q, qd)[1]

    def brake_badness(
        self, check: BrakeCheck, closing: Closing, q: np.ndarray, qd: np.ndarray, share: float
    ) -> np.ndarray:
        return -check.worst_corners(q, qd)[0]


class SlipQuantity(ContactQuantity):
    """GT; its curvature over the wrench is left out in stops."""

    name, symbol, at_steps, in_results = "slip", "GT", "jump_slip", "slip"

    def __init__(self, footing: Footing, number: float, smooth: bool = False) -> None:
        super().__init__(footing, number, smooth)
        slip = footing.slip
        self._map, self._bound = slip.within(number) if smooth else (slip.map(up_to=number), number)

    def measure(self, loaded: Loaded) -> np.ndarray:
        return loaded.largest_slip.GT

    def largest(self, loaded: Loaded) -> np.ndarray:
        return self.footing.slip.greatest(loaded.wrenches)

    def detail(self, loaded: Loaded) -> str:
        """GT above 1 counts the acceleration of what slides: the friction needed is another number."""
        if not loaded.slip.GT[0] > 1:
            return ""
        demand = FrictionDemand.of(self.footing.support, loaded.wrenches[0])
        return "" if np.isnan(demand.factor) else f"friction used {demand.used}"

    def kept(self, loaded: Loaded) -> bool:
        if self.smooth:
            return bool(np.all(self.badness(loaded) <= self._bound))
        return bool(np.all(self.footing.slip.above(loaded.wrenches, self.number) <= self.number))

    def refusals(self, loaded: Loaded) -> list[str]:
        slip = loaded.slip
        if slip.GT[0] <= self.number:  # also where it is an upper bound
            return []
        if not slip.solved[0]:
            most = quantity(100 * float(slip.GT[0]), "%")
            return [f"at rest the friction used is at most {most}, the optimum is open: {slip.status[0]}"]
        usage = np.nan_to_num(slip.usage[0])
        most = f"contact {int(np.argmax(usage)) + 1} uses {100 * usage.max():.0f} % of its friction"
        return [f"at rest {self.lost_words(float(slip.GT[0]))} ({most})"]

    def lost_words(self, value: float, of: str = "") -> str:
        if value >= 1:
            return f"{of or 'the base'} slips"
        limit = quantity(100 * self.number, "%")
        return f"the friction used{of and f' of {of}'} is {quantity(100 * value, '%')}, must be <= {limit}"

    def half_spaces(self) -> np.ndarray | None:
        return self.footing.slip.half_spaces(self.number)

    def badness(self, loaded: Loaded) -> np.ndarray:
        if self._map not in loaded.memo:
            if self.smooth:
                loaded.memo[self._map] = self._map(loaded.wrenches)[0][:, None]
            elif self.footing.slip.redistribution == "full":
                loaded.memo[self._map] = self.exact(loaded)
            else:
                loaded.memo[self._map] = self.footing.slip.map(self.number)(
                    loaded.wrenches, derivatives=False
                )[0][:, None]
        return loaded.memo[self._map]

    def exact(self, loaded: Loaded) -> np.ndarray:
        return known(self.footing.slip.above(loaded.wrenches, FAR_FROM_SLIPPING * self.number))[:, None]

    def exact_rows(self, loaded: Loaded) -> tuple[np.ndarray, np.ndarray]:
        GT, slopes = self.footing.slip.evaluate(loaded.states).for_program()
        return GT[:, None], slopes[:, None]

    def uses(self, badness: np.ndarray) -> np.ndarray:
        return badness / self._bound

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([-np.inf]), np.array([self._bound])

    def worst(self) -> np.ndarray:
        return np.array([self.number])

    def rows(
        self, wrenches: np.ndarray, i: np.ndarray, k: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self._map(wrenches[i])

    def smooth_within(self, cases: WorstCase) -> tuple[WorstCase, float]:
        return cases.smooth(self.number)

    def within(
        self, cases: WorstCase, s: np.ndarray, k: np.ndarray, theta: np.ndarray | None = None
    ) -> WorstDeviations:
        return cases.slip(s, theta=theta)

    def worst_of_options(
        self, cases: WorstCase, options: np.ndarray, acting: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        if (planes := self._planes_within(cases)) is not None:
            result = farthest(cases.deviations, options, acting, planes, None, 1)
            return result.values[:, None], result.number[:, None]
        number, values, _ = worst_options(options, cases, acting, functions=[cases.axes])
        return values, number

    def worst_within(self, cases: WorstCase, s: np.ndarray, k: np.ndarray, late: np.ndarray) -> np.ndarray:
        if (planes := self._planes_within(cases)) is not None:
            return cases.farthest(s, planes, late, None, 1).theta
        return cases.slip(s, max_delay=late).theta

    def _planes_within(self, cases: WorstCase) -> np.ndarray | None:
        return cases.footing.slip.half_spaces(min(self.number, cases.footing.slip.sure))

    def uses_within(self, cases: WorstCase, s: np.ndarray, bound: float) -> np.ndarray:
        return cases.estimated_slip(s)[:, None] / bound

    def kept_within(self, cases: WorstCase, s: np.ndarray, bound: float) -> bool:
        return bool(np.all(cases.slip(s).values <= bound))

    def rests_within(self, cases: WorstCase, s: np.ndarray) -> bool:
        return cases.keeps_slip(s, self.number) or self.worst_at_rest(cases, s)[0] <= self.number

    def worst_at_rest(self, cases: WorstCase, s: np.ndarray) -> tuple[float, np.ndarray]:
        result = cases.slip(s, starts=STARTS_AT_REST)
        return float(result.values[0]), result.theta[0]

    def brake_torques(self, check: BrakeCheck, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        wrenches, torques = check.combinations(q, qd)
        rows = self.half_spaces()
        if rows is None:
            return torques[:, :1]
        worst = np.argmax(np.max(wrenches @ rows.T, axis=2), axis=1)
        return torques[np.arange(len(q)), worst][:, None]

    def brake_badness(
        self, check: BrakeCheck, closing: Closing, q: np.ndarray, qd: np.ndarray, share: float
    ) -> np.ndarray:
        wrenches = closing.wrenches(np.hstack([q, qd]), self.brake_torques(check, q, qd)[:, 0])
        rows, GT = self.footing.slip.half_spaces(share * self.number), np.full(len(q), min(FAR, share / 2))
        GT *= self.number
        todo = np.arange(len(q)) if rows is None else np.flatnonzero(np.max(wrenches @ rows.T, axis=1) > 0)
        if len(todo):
            states = self.footing.contact_states(wrenches[todo])
            GT[todo] = known(self.footing.slip.evaluate(states, derivatives=False).GT)
        return GT[:, None]
