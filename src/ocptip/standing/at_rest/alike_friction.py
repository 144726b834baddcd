"""Whether equally compliant feet slip where another sharing of the load would hold the base."""

from __future__ import annotations

import numpy as np

from ocptip.reserves.equal_compliance import (
    ENOUGH,
    equal_sharing,
    equally_compliant,
    slides_beyond,
)
from ocptip.standing.footing import Footing

_FIRST = 20  # wrenches that are solved before the others
_CHUNK = 10_000  # wrenches multiplied with functions at once
_NEIGHBOURS = 32  # wrenches that share a box


class AlikeFriction:
    """The friction of equally compliant feet under wrenches, where contacts differ in their coefficients.

    Where they do not, the best sharing slides at the same tangential force. It is left out there.

    Args:
        footing: a base on its contacts.

    Attributes:
        slides: (k, 6) functions of the wrench, positive where such feet slide; None: see `equal_sharing`.
    """

    def __init__(self, footing: Footing) -> None:
        self._footing, self.slides, support = footing, None, footing.support
        equal = equally_compliant(support) if support.dimension == 3 else None
        if equal and equal.elastic:
            normal_map = equal.elastic.normal_map
            self.slides = slides_beyond(support, normal_map, fine=True)
            enough = slides_beyond(support, normal_map, ENOUGH, fine=True)
            self._lifts, self._doubtful = -normal_map, np.vstack([enough, -normal_map])

    @classmethod
    def if_held(cls, footing: Footing, nominal: np.ndarray) -> AlikeFriction | None:
        """The friction, if it holds nominal wrenches (N, 6); else a headline says that it does not."""
        alike = cls(footing)
        return alike if alike.slips(nominal) is None else None

    def most(self, wrenches: np.ndarray) -> float:
        """The largest share of the friction that such feet use under some of wrenches (N, 6), infinite where
        they lose the base; NaN: see `slides`.

        The wrenches are those farthest beyond the functions, and those under which most of a foot lifts.
        """
        if self.slides is None:
            return np.nan
        parts = np.array_split(wrenches, 1 + len(wrenches) // _CHUNK)
        rows = [
            np.argsort(-np.concatenate([np.max(part @ functions.T, axis=1) for part in parts]))[:_FIRST]
            for functions in (self.slides, self._lifts)
        ]
        equal = equal_sharing(self._footing.contact_states(wrenches[np.unique(rows)]))
        assert equal is not None  # else there are no functions
        return float(np.max(np.nan_to_num(equal.GT, nan=np.inf)))

    def slips(self, wrenches: np.ndarray) -> int | None:
        """Row of one of the wrenches (N, 6) under which such feet slip or lose the base; None: under none."""
        if self.slides is None:
            return None
        for rows in np.split(beyond(self._doubtful, wrenches), [_FIRST]):  # most slip among the first
            equal = equal_sharing(self._footing.contact_states(wrenches[rows])) if len(rows) else None
            if equal is not None and not np.all(equal.stands):
                return int(rows[np.argmax(np.nan_to_num(equal.GT, nan=np.inf))])
        return None


def beyond(half_spaces: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
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
