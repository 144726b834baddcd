"""Motions near one whose proof falls short of limits: tighter or slower, until a proof is complete."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeVar

from ocptip.motion.check import MotionCheck
from ocptip.standing.limit_kinds.limit import AskedLimit
from ocptip.trajectories.trajectory import Trajectory

PROOFS, DEARER = 2, 1.02
"""How often a motion without a proof is made again, and what that may cost."""

AHEAD = 2
"""Times what a proof falls short are limits tightened, for proofs are a little different each time."""

Faults = Sequence[tuple[AskedLimit, float, list[float]]]
"""Limits that a proof leaves open, by how much, and when, s."""


class Checked(Protocol):
    """A motion with its check."""

    @property
    def check(self) -> MotionCheck:
        """Of the motion."""
        ...


C = TypeVar("C", bound=Checked)


class Timed(NamedTuple):
    """A motion and its check."""

    motion: Trajectory
    check: MotionCheck


def within_reach(faults: Faults) -> bool:
    """Whether motions near by may be proved."""
    return bool(faults) and all(short <= PROOFS * limit.largest_step for limit, short, _ in faults)


def proved_slower(run: C, again: Callable[[float], C], asked: Sequence[AskedLimit]) -> C | None:
    """A slower motion with a complete proof; None: there is none for a little more time.

    Args:
        run: a motion whose proof falls short.
        again: the same with all its times stretched by a factor, with its proof if it keeps its limits.
        asked: limits that proofs are compared with.
    """
    factor, slower, first = 1.0, run, 0.0
    gain = 2.0  # of the share that is missing, by a factor near 1: loads fall by its square
    for _ in range(PROOFS):
        faults = slower.check.not_proved(asked)
        if not within_reach(faults) or any(limit.of_place for limit, *_ in faults):
            break
        missing = max(short / limit.number for limit, short, _ in faults)
        if factor > 1:
            gain = (first - missing) / (factor - 1)  # parts of loads do not depend on speed
        first = first or missing
        if gain <= 0 or (factor := factor + AHEAD * missing / gain) > DEARER:
            break
        slower = again(factor)
        if slower.check.certified:
            return slower
    return None
