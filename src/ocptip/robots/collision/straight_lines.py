"""Straight lines in joint space that keep a clearance, proved between samples by what joints sweep at most.

A joint that turns by a small angle moves a point of a link by at most that angle times the point's distance
from the axis. So a distance changes along a line of joint angles by at most a known rate. A sample that is
farther away than the clearance proves an interval around it; intervals that it does not prove are halved.
Nothing thin can lie between two samples.
"""

from __future__ import annotations

import numpy as np

from ocptip.robots.collision.gaps import Collisions

FIRST = 0.1
"""m: what solids move at most between the first sample and the ends of its interval."""

LAST = 5e-4
"""m: of the smallest intervals. A line that is nearer to the clearance than this counts as not clear."""


class StraightLines:
    """Decides which states of a mechanism, and straight lines between them, keep a clearance.

    Args:
        collision: its distances.
        clearance: m, that every distance keeps.

    Attributes:
        tested: number of states whose distances were computed.
    """

    def __init__(self, collision: Collisions, clearance: float) -> None:
        self._collision, self._clearance = collision, clearance
        self.tested = 0

    def free(self, q: np.ndarray) -> bool:
        """Whether the state q (n,) keeps the clearance."""
        self.tested += 1
        needed = np.full(len(self._collision.labels), self._clearance)
        return self._collision.proved(q[None], self._clearance, needed) is not None

    def clear(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether every state from begin to end, (n,) each, keeps the clearance; False: not proved."""
        swept = self._collision.approach((end - begin)[None])[0]
        most = float(np.max(swept, initial=0.0))
        count = max(1, int(np.ceil(most / (2 * FIRST))))
        half, middles = 0.5 / count, (np.arange(count) + 0.5) / count
        while middles.size:
            needed = self._clearance + half * swept
            self.tested += len(middles)
            states = begin + middles[:, None] * (end - begin)
            kept = self._collision.proved(states, self._clearance, needed)
            if kept is None:
                return False
            open_ones = middles[~kept]
            half *= 0.5
            if open_ones.size and half * most < LAST:
                return False
            middles = np.concatenate([open_ones - half, open_ones + half])
        return True
