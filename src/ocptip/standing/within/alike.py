"""Equally compliant feet in the worst case of an uncertainty: which lifts, and how much friction they use."""

from __future__ import annotations

import numpy as np

from ocptip.reserves.equal_compliance import equal_normal_map, equal_sharing, slides_beyond
from ocptip.standing.contact_margins import Margin
from ocptip.standing.within.late_joints import DelayedStates
from ocptip.standing.within.worst_case import WorstCase

_EXACT = 8  # wrenches whose forces are solved


def least_if_alike(cases: WorstCase, states: DelayedStates) -> Margin | None:
    """Minimum normal force of a foot if all gave alike, by slopes over the deviations."""
    if (shares := equal_normal_map(cases.footing.support)) is None:
        return None
    wrenches, over = cases.deviations.wrench_and_slopes(
        states.s, np.zeros((len(states.s), cases.deviations.size))
    )
    forces = wrenches @ shares.T
    for k, share in enumerate(shares):
        change = np.einsum("w,nwt->nt", share, over)
        forces[:, k] += np.einsum("nt,nt->n", change, cases.deviations.least(change, states.max_delay))
    row, foot = np.unravel_index(np.argmin(forces), forces.shape)
    return Margin(float(forces[row, foot]), float(states.times[row]), (int(foot) + 1,))


def friction_if_alike(cases: WorstCase, states: DelayedStates) -> Margin | None:
    """Share of the friction that equally compliant feet use at the worst deviations of this search.

    Slopes give these for sliding along and about some axes while all feet press. Under the worst wrenches the
    forces are those of feet that only push; infinite where these lose the base.
    """
    support = cases.footing.support
    if (shares := equal_normal_map(support)) is None:
        return None
    pulls, beyond = (slides_beyond(support, shares, share) for share in (0.0, 1.0))
    wrenches, over = cases.deviations.wrench_and_slopes(
        states.s, np.zeros((len(states.s), cases.deviations.size))
    )
    found = []
    for pull, more in zip(pulls, beyond, strict=True):
        change = np.einsum("w,nwt->nt", more, over)
        theta = cases.deviations.least(-change, states.max_delay)
        worst = wrenches + np.einsum("nwt,nt->nw", over, theta)
        friction = worst @ (pull - more)
        used = np.where(friction > 0, worst @ pull / np.where(friction > 0, friction, 1.0), 0.0)
        row = int(np.argmax(used))
        found.append((used[row], row, worst[row]))
    found = sorted(found, key=lambda one: -one[0])[:_EXACT]
    equal = equal_sharing(cases.footing.contact_states(np.array([wrench for *_, wrench in found])))
    assert equal is not None  # there are such feet
    exact = np.nan_to_num(equal.GT, nan=np.inf)
    k = int(np.argmax(exact))
    return Margin(float(exact[k]), float(states.times[found[k][1]]))
