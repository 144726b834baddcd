"""Which contact is lost under wrenches, and the largest level of a deviation up to which none is."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ocptip.numerics.bisection import bisected
from ocptip.reserves.slip import Slip
from ocptip.standing.at_rest.alike_friction import AlikeFriction, beyond
from ocptip.standing.at_rest.directions import NO_DIRECTION, Directions
from ocptip.standing.footing import Footing

CLOSE = 2e-3  # of a level: how near the bisection gets
SLIPS_ALIKE = "slips if equally compliant"
ON_SPRINGS = "lifts on its springs"
_FIRST = 20  # wrenches beyond half spaces that are solved before the others

Loads = Callable[[float], np.ndarray]
"""Wrenches (N, 6) on the base at a level of a deviation."""


@dataclass(frozen=True, eq=False)
class Deviation:
    """One way to deviate, or one for each of some directions.

    Attributes:
        loads: wrenches by level, those of one direction after those of another.
        sides: (P, 3) the directions, if any.
        how: in words.
    """

    loads: Loads
    sides: np.ndarray | None = None
    how: str = ""


def pushed(
    nominal: np.ndarray, at_tool: Callable[[np.ndarray], np.ndarray], words: Callable[[np.ndarray], str]
) -> Callable[[np.ndarray], list[Deviation]]:
    """Pushes at the TCP beside nominal wrenches (N, 6), by directions (P, 3); the level is the force, N.

    Args:
        nominal: the wrenches.
        at_tool: wrenches (N, 6) of a force (3,), N.
        words: of a direction (3,).
    """

    def towards(side: np.ndarray) -> Deviation:
        per_newton = at_tool(side)
        return Deviation(lambda force: nominal + force * per_newton, side[None], words(side))

    return lambda sides: [towards(side) for side in sides]


@dataclass(frozen=True)
class LargestLevel:
    """The largest level of a deviation that loses no contact.

    Attributes:
        level: the largest one.
        row: of the wrenches of one direction, which are instants, where a contact is lost beyond; -1: none is
            up to the largest level that was searched.
        how: direction, and what happens.
    """

    level: float
    row: int = -1
    how: str = ""


class LossSearch:
    """Says whether contacts of a base hold; finds the largest level at which all do.


    Args:
        footing: the base on its contacts.
        alike: the friction of equally compliant feet, if it has to be enough as well.
        lifts: a foot that lifts on declared springs is a lost contact, also where the others hold the base.
            It lifts where the force that it has if all feet press, which is linear in the wrench, is below
            its lowest one. Vibration does not count.
    """

    def __init__(self, footing: Footing, alike: AlikeFriction | None = None, lifts: bool = False) -> None:
        support, tip_over, slip = footing.support, footing.tip_over, footing.slip
        self._footing = footing
        self._quick = Slip(support, "tangential")
        affine = not tip_over.free_rotation and len(tip_over.axes) > 0 and support.elastic is None
        self._moments = tip_over.affine_moments if affine else None
        self._held = slip.half_spaces(1.0) if affine else None
        elastic = support.elastic if lifts else None
        self._springs = elastic and (elastic.normal_map, elastic.lowest)
        self._alike, self._predicting = alike, self._held
        if alike and alike.slides is not None and self._held is not None:
            self._predicting = np.vstack([self._held, alike.slides])

    def lost(self, wrenches: np.ndarray) -> tuple[int, str] | None:
        """Row of the worst wrench under which a contact is lost, and how; None if none is."""
        if self._springs is not None:
            spare = wrenches @ self._springs[0].T - self._springs[1]
            row, foot = np.unravel_index(np.argmin(spare), spare.shape)
            if spare[row, foot] < 0:
                return int(row), f"contact {foot + 1} {ON_SPRINGS}"
        if (result := self._lost(wrenches)) is not None or self._alike is None:
            return result
        row = self._alike.slips(wrenches)
        return None if row is None else (row, SLIPS_ALIKE)

    def _lost(self, wrenches: np.ndarray) -> tuple[int, str] | None:
        """The same for the sharing of the load that loses no contact, if there is one."""
        if self._moments is None or self._held is None:
            return self._solved(wrenches)
        slope, offset = self._moments
        least = np.min(wrenches @ slope.T + offset, axis=1)
        worst = int(np.argmin(least))
        if least[worst] <= 0:
            return worst, self._tips(int(np.argmin(wrenches[worst] @ slope.T + offset)))
        for rows in np.split(beyond(self._held, wrenches), [_FIRST]):  # most are lost among the first
            if len(rows) and (result := self._solved(wrenches[rows])) is not None:
                return int(rows[result[0]]), result[1]
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
        if (held := self._predicting) is None:
            return None
        rows = np.sort(beyond(held, loads(level)))

        def likely(level: float) -> bool:
            nonlocal rows
            wrenches = loads(level)[rows]
            far = beyond(held, wrenches)
            if not len(far) or self.lost(wrenches[far[:1]]) is None:
                return False
            rows = np.sort(rows[far])
            return True

        return likely

    def largest(
        self,
        most: float,
        deviations: Callable[[np.ndarray], Iterable[Deviation]],
        directions: Directions = NO_DIRECTION,
    ) -> LargestLevel:
        """The largest level, at most `most`, in the worst direction; to a relative precision of `CLOSE`.

        Args:
            most: the largest level that is searched.
            deviations: of directions (P, 3), all together.
            directions: to begin with, and those near them.
        """
        best, row, how = most, -1, ""
        worst: np.ndarray | None = None

        def near(low: float, high: float) -> bool:
            return high - low <= CLOSE * high or high <= 1e-6 * most

        def narrow(sides: np.ndarray) -> np.ndarray | None:
            nonlocal best, row, how, worst
            for one in deviations(sides):
                loads = one.loads(best)
                fails = self.lost(loads)
                if fails is None:
                    continue

                def lost(level: float, loads: Loads = one.loads) -> tuple[int, str] | None:
                    return self.lost(loads(level))

                best, fails = bisected(lost, 0.0, best, fails, near, self._prediction(one.loads, best))
                row, how, each = fails[0], ", ".join(part for part in (one.how, fails[1]) if part), len(loads)
                if one.sides is not None:
                    each //= len(one.sides)
                    worst = one.sides[row // each]
                row %= each
            return worst

        directions.search(narrow, narrow(directions.sides))
        return LargestLevel(float(best), row, how)
