"""How long contacts were open, by switches at the contacts (thesis M, 7.4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class ContactLoss:
    """The interruptions of one contact.

    Attributes:
        contact: its number, from 1.
        count: number of interruptions.
        longest: s, duration of the longest one; 0 without any.
        at: s, when that begins; nan without any.
        total: s, of all.
        ever_closed: whether the switch was closed at any time.
    """

    contact: int
    count: int
    longest: float
    at: float
    total: float
    ever_closed: bool

    def to_dict(self) -> dict[str, Any]:
        """Plain data; times in s."""
        return dict(vars(self))

    def after(self, clock: float) -> ContactLoss:
        """The same with `at` counted from the time `clock`, s."""
        return replace(self, at=self.at - clock)


def contact_loss(contact: int, times: np.ndarray, values: np.ndarray) -> ContactLoss:
    """Interruptions of a contact.

    An interruption lasts from its first open sample to the next closed one. Missing samples count as neither.

    Args:
        contact: its number, from 1.
        times: (N,), s, increasing.
        values: (N,) of its switch, as a number or a voltage: closed above half of the maximum; nan: missing.
    """
    good = np.isfinite(values)
    times, values = times[good], values[good]
    top = float(values.max(initial=0.0))
    if top <= 0:
        total = float(times[-1] - times[0]) if len(times) else 0.0
        return ContactLoss(contact, 1, total, float(times[0]) if len(times) else float("nan"), total, False)
    is_open = np.concatenate([[False], values <= 0.5 * top, [False]])
    edges = np.diff(is_open.astype(int))
    first, closed = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    ends = np.append(times, times[-1] + period)
    durations = ends[closed] - times[first]
    if not len(durations):
        return ContactLoss(contact, 0, 0.0, float("nan"), 0.0, True)
    k = int(np.argmax(durations))
    return ContactLoss(
        contact, len(durations), float(durations[k]), float(times[first[k]]), float(durations.sum()), True
    )


def losses_text(losses: Sequence[ContactLoss]) -> str:
    """All contacts in one line."""
    parts = []
    for one in losses:
        if not one.ever_closed:
            parts.append(f"{one.contact} never closed")
        elif not one.count:
            parts.append(f"{one.contact} always closed")
        else:
            times = "once" if one.count == 1 else f"{one.count} times"
            parts.append(f"{one.contact} open {times}, at most {1e3 * one.longest:.3g} ms at {one.at:.3f} s")
    return "; ".join(parts)
