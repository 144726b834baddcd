"""Starts of the search: combinations of branches against all of them, bounds, where samples go."""

from itertools import product

import numpy as np
import pytest

from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.limit import smallest_margin
from ocptip.placement.problem import GripperTask, ProcessLoad
from ocptip.placement.search.starts import best_branches, exact_scores, rough_scores, sample, solutions
from ocptip.robots.geometry import Pillar
from tests.placement.placement_scenes import INTO_WALL, drilling


@pytest.fixture(scope="module")
def evaluator():
    """Two gripper poses near a pillar; the second one has two loads, so that it counts more in the mean."""
    tasks = [
        GripperTask([0.0, 0.0, 0.55], INTO_WALL, [ProcessLoad([-6.0, 0.0, 1.0])], name="first"),
        GripperTask(
            [0.0, 0.15, 0.5],
            INTO_WALL,
            [ProcessLoad([-4.0, 1.0, 0.0], name="a"), ProcessLoad([0.0, 2.0, 1.0], name="b")],
            name="second",
        ),
    ]
    return Evaluator(drilling(tasks=tasks, obstacles=[Pillar([-0.1, 0.3, 0.0], 0.05)]))


@pytest.fixture(scope="module")
def places():
    rng = np.random.default_rng(2)
    return np.column_stack([rng.uniform(-0.6, -0.2, 60), rng.uniform(-0.3, 0.4, 60), rng.uniform(-3, 3, 60)])


@pytest.mark.slow
def test_best_combination_of_branches_against_all_of_them(evaluator, places):
    ground = smallest_margin(evaluator.ground(0, places), len(places))
    found = best_branches(evaluator, 0, places, ground, np.random.default_rng(0))
    branches = [solutions(evaluator, t, 0, places, np.random.default_rng(0)) for t in range(2)]
    compared = 0
    for k, place in enumerate(places):
        own = [q[k][np.isfinite(q[k]).all(axis=1)] for q in branches]
        at = [i for i, p in enumerate(found.parameters) if np.array_equal(p, place)]
        both = np.array(list(product(*own))).reshape(-1, 2, 6)
        assert bool(at) == bool(len(both))
        if not at:
            continue
        totals, margins = rough_scores(evaluator, 0, np.tile(place, (len(both), 1)), both)
        margins = np.minimum(margins, ground[k])
        score = totals + 0.3 * np.maximum(-margins, 0)
        assert found.totals[at[0]] + 0.3 * max(-found.margins[at[0]], 0) == pytest.approx(score.min())
        for i in at:
            same = np.abs(both - found.angles[i]).max(axis=(1, 2)) == 0
            assert same.sum() == 1
            assert found.totals[i] == pytest.approx(totals[same][0])
            assert found.margins[i] == pytest.approx(margins[same][0])
        compared += len(at) > 1
    assert compared > 10


def test_rough_scores_are_bounds_of_exact_ones(evaluator, places):
    q = [solutions(evaluator, t, 0, places, np.random.default_rng(0)) for t in range(2)]
    who, which = np.nonzero(np.isfinite(np.concatenate(q, axis=2)).all(axis=2))
    angles = np.stack([branch[who, which] for branch in q], axis=1)
    rough, room = rough_scores(evaluator, 0, places[who], angles)
    exact, margin = exact_scores(evaluator, 0, places[who], angles, fast=True)
    stands = margin > -0.5
    assert stands.sum() > 20
    assert (rough[stands] <= exact[stands] + 1e-9).all()
    base = smallest_margin(evaluator.ground(0, places[who]), len(who))
    assert (np.minimum(room, base) >= margin - 1e-9).all()


def test_samples_gather_around_the_best_places(evaluator):
    found = sample(evaluator, np.random.default_rng(1), 300)
    assert found.reached <= found.clear <= found.sampled
    scores = found.totals + 0.3 * np.maximum(-found.margins, 0)
    assert (np.diff(scores) >= -1e-12).all()
    p = np.array(found.parameters)
    best, rest = p[:20, :2], p[-100:, :2]
    assert np.ptp(best, axis=0).max() < np.ptp(rest, axis=0).max()
