"""Motions near one whose proof falls short of limits: tighter or slower, until a proof is complete."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeVar

from ocptip.motion.check import MotionCheck, Prove, check_motion
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import AskedLimit, Limit
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory

PROOFS, DEARER = 2, 1.02
"""How often a motion without a proof is made again, and what that may cost."""

UNTIL_CANCELS = 1.02, 1.05
"""Factors of all times that are tried until no cancel loses a contact, one after the other: proofs of cancels
take long, and do not say by how much they fall short.
"""

AHEAD = 2
"""Times what a proof falls short are limits tightened, for proofs are a little different each time."""

LOADS, BOUNDS = 2.0, 0.5
"""What a factor of all times gains, by its difference from 1: loads fall by its square. Where samples are far
from the limit, and only the bounds of a proof are beyond, these fall more slowly.
"""

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
    """A motion and its check.

    Attributes:
        motion: it.
        check: of the motion.
        slower: factor of all its times that makes its proof complete.
    """

    motion: Trajectory
    check: MotionCheck
    slower: float = 1.0


def within_reach(faults: Faults) -> bool:
    """Whether motions near by may be proved."""
    return bool(faults) and all(short <= PROOFS * limit.largest_step for limit, short, _ in faults)


def sampled_near(checked: MotionCheck, faults: Faults) -> bool:
    """Whether a sampled value is so near to a limit that is open that a tighter number changes the motion."""
    near = [(checked.worst.get(limit.result), PROOFS * AHEAD * short) for limit, short, _ in faults]
    return any(worst is None or worst.excess > -step for worst, step in near)


def slower_to_prove(
    robot: StandingMechanism, motion: Trajectory, checked: MotionCheck, limits: Limits, prove: Prove
) -> Timed | None:
    """A slower motion with a complete proof, see `proved_slower`; arguments are those of `prove`."""

    def again(factor: float) -> Timed:
        slower = motion.slowed(factor)
        checked = check_motion(robot, slower, limits)
        return Timed(slower, prove(robot, slower, checked, limits), factor)

    return proved_slower(Timed(motion, checked), again, limits_of(robot, limits))


def proved_slower(run: C, again: Callable[[float], C], limits: Sequence[Limit]) -> C | None:
    """A slower motion with a complete proof; None: there is none for a little more time.

    Stops along the path and by brakes are beyond proofs.

    Args:
        run: a motion whose proof falls short.
        again: the same with all its times stretched by a factor, with its proof if it keeps its limits.
        limits: of the motion; proofs are compared with those that have a number.
    """
    asked = [limit for limit in limits if isinstance(limit, AskedLimit)]
    factor, slower, first = 1.0, run, 0.0
    gain = LOADS  # of the share that is missing, by a factor near 1
    for _ in range(PROOFS):
        if slower.check.lacks_cancels:
            factor = next((step for step in UNTIL_CANCELS if step > factor), math.inf)
        else:
            faults = slower.check.not_proved(asked)
            if not within_reach(faults) or any(limit.of_place for limit, *_ in faults):
                break
            missing = max(short / limit.number for limit, short, _ in faults)
            if factor > 1:
                gain = (first - missing) / (factor - 1)  # parts of loads do not depend on speed
            enough = gain * (DEARER - factor) > missing
            if factor == 1 and not sampled_near(slower.check, faults):
                gain = BOUNDS
            first = first or missing
            factor = min(factor + AHEAD * missing / gain, DEARER) if enough else math.inf
        if factor > (UNTIL_CANCELS[-1] if slower.check.lacks_cancels else DEARER):
            break
        slower = again(factor)
        if slower.check.proved_while_moving and not slower.check.lacks_cancels:
            return slower
    return None
