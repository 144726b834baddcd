"""The largest uncertainty that a motion can have: bisection, by planning, of what was too much.

Where no plan was verified, the best motion withstands less than it was planned for: that also narrows the
bracket, from below.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ocptip.basics.errors import InputError, PlanningError
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.multi_start import ToleranceError
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask, refusals
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.standing.within.tolerable import AT_REST, culprit

PLANS = 5  # at most
BOLD = 0.75  # share of the way to what is too much that is tried after a plan was found
CLOSE = 0.03  # of the least with which there is none: narrower is not looked
SECONDS = 300.0  # after which no further plan is begun


@dataclass(frozen=True, eq=False)
class LargestTolerance:
    """The result of bisection by planning.

    Attributes:
        had: the largest tolerance with which there is a motion, and no more than what was asked for.
        factor: of what was asked for.
        not_had: the smallest without one; None: there was one with all of it.
        plan: with `had`; None: `had` is what the best earlier motion withstands.
        plans, starts: how many were planned, with how many starts each.
        at_rest: with more than this not even start and goal stand; None: they do with what was asked for.
        interrupted: by Ctrl-C, which keeps earlier results.
    """

    had: Uncertainty
    factor: float
    not_had: Uncertainty | None
    plan: MotionPlan | None
    plans: int
    starts: int
    at_rest: Uncertainty | None = None
    interrupted: bool = False

    def __str__(self) -> str:
        """The result in words; no result proves nothing."""
        cost = f", {self.plan.energy:.1f} J" if self.plan else ""
        nothing = self.plan is None and self.factor == 0
        result = "no motion with any of it" if nothing else f"a motion with {self.had}{cost}"
        if self.not_had is not None:
            result += f"; none with {self.not_had}"
        if self.at_rest is not None:
            result += f"; start and goal stand at rest with up to {self.at_rest}"
        ended = ", then interrupted" if self.interrupted else ""
        return f"{result} ({self.plans} plans of {self.starts} starts{ended})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "found": self.had.to_dict(),
            "not_found": self.not_had and self.not_had.to_dict(),
            "at_rest": self.at_rest and self.at_rest.to_dict(),
            "energy_J": self.plan and self.plan.energy,
            "plans": self.plans,
            "starts": self.starts,
            "interrupted": self.interrupted,
        }


def largest_tolerance(
    task: MotionTask,
    error: ToleranceError,
    *,
    starts: int = 2,
    seconds: float = SECONDS,
    stage: Callable[[str], None] | None = None,
    **how: Any,
) -> LargestTolerance:
    """Bisect what was too much, alone if it was so alone, by a few plans that are checked and not proved.

    An interrupt (Ctrl-C) ends it with the result so far.

    Args:
        task: without a motion within its uncertainty.
        error: that reports it.
        starts: of each plan.
        seconds: wall time after which no further plan is begun.
        stage: called with what is planned next.
        how: further arguments of `plan_motion`.
    """
    began, low, high, best, plans = time.monotonic(), error.factor, error.at_rest, None, 0
    rest = error.too_much.scaled(high) if high < 1 else None
    new = error.alone and rest is None  # all of it alone has not been planned yet
    share = 0.5 if rest is None else BOLD  # of the way to what is too much
    tried = high if new else low + share * (high - low)
    not_had = None if new or rest is not None else error.too_much
    interrupted = False
    while plans < PLANS and high - low > CLOSE * high and time.monotonic() - began < seconds:
        tolerance = error.too_much.scaled(tried)
        limits = replace(task.limits, tolerance=tolerance)
        plans += 1
        if stage:
            stage(f"searching the largest uncertainty: plan {plans} of at most {PLANS}, {tolerance} ...")
        try:
            best = plan_motion(replace(task, limits=limits), starts=starts, **how)
            low, share, interrupted = tried, BOLD, best.interrupted
        except KeyboardInterrupt:
            interrupted = True
        except (PlanningError, InputError) as none:
            high, share, not_had = tried, 0.5, tolerance
            if isinstance(none, ToleranceError) and none.too_much.given == tolerance.given:
                most = tried * none.factor  # of the best of the motions that were found
                low, best = (most, None) if most > low else (low, best)
        if interrupted:
            break
        tried = low + share * (high - low)
    low = min(low, high)
    had = error.too_much.scaled(low)
    return LargestTolerance(had, low, not_had, best, plans, starts, rest, interrupted)


def too_much_at_rest(task: MotionTask) -> ToleranceError | None:
    """Says which quantity start or goal cannot have at rest, and how much they can; None if not that."""
    asked = task.limits.tolerance

    def kept(tolerance: Uncertainty) -> bool:
        return not refusals(replace(task, limits=replace(task.limits, tolerance=tolerance)))

    if not asked.given or not (reasons := refusals(task)) or not kept(NONE):
        return None
    error = ToleranceError(f"cannot be planned: {'; '.join(reasons)}")
    error.too_much, error.at_rest = culprit(asked, AT_REST, kept)
    return error
