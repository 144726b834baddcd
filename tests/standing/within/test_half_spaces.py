"""The worst of all combinations for half spaces of friction."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.standing.tolerance import WORKSHOP
from ocptip.standing.within.half_spaces import farthest
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.standing.within.worst_options import worst_beyond
from tests.retiming.paths import cart


@pytest.fixture
def cases():
    return worst_case_of(cart().robot, WORKSHOP)


def options_of(robot, rng, count: int, kinds: int) -> np.ndarray:
    """(count, n, kinds, 4): accelerations of joints differ much, their angles and speeds little."""
    options = np.zeros((count, robot.n, kinds, 4))
    options[..., 0] = rng.uniform(-1, 1, (count, robot.n, 1)) + 0.01 * rng.normal(size=options.shape[:3])
    options[..., 1] = rng.uniform(-0.5, 0.5, (count, robot.n, 1)) + 0.05 * rng.normal(size=options.shape[:3])
    options[..., 2] = rng.uniform(-3, 3, options.shape[:3])
    options[..., 3] = rng.uniform(0, WORKSHOP.delay, options.shape[:3])
    options[:, 0, 1:] = np.nan
    return options


@pytest.mark.slow
def test_no_drawn_combination_goes_farther(cases):
    """Than the worst one by its exact value, beyond any half space; to first order it is known to 2 %."""
    robot, rng = cart().robot, np.random.default_rng(0)
    deviations, n = cases.deviations, robot.n
    options, acting = options_of(robot, rng, 3, 4), np.empty((3, 0))
    planes = cases.footing.slip.half_spaces(0.9)
    found = farthest(deviations, options, acting, planes, -np.inf, len(planes))
    assert len(found.values) == 3 * len(planes)
    weight = np.linalg.norm(robot.support.weight)
    number, values = worst_beyond(options, cases, acting, planes, -np.inf, len(planes))[1::2]
    np.testing.assert_allclose(values, found.values, atol=0.02 * weight)
    worst = np.full((3, len(planes)), -np.inf)
    for _ in range(50):
        drawn = rng.integers(0, 4, (3, n))
        drawn[:, 0] = 0
        at = options[np.arange(3)[:, None], np.arange(n), drawn]
        theta = deviations.least(rng.normal(size=(3, deviations.size)), at[..., 3])
        s = at[..., :3].transpose(0, 2, 1).reshape(3, -1)
        worst = np.maximum(worst, deviations.wrench(s, theta)[0] @ planes.T)
    assert np.all(worst[found.instants, found.planes] <= values + 1e-4 * weight)
    assert np.any(number > 0)


def test_of_an_instant_the_farthest_half_spaces_are_given(cases):
    rng, planes = np.random.default_rng(1), cases.footing.slip.half_spaces(0.5)
    options, acting = options_of(cart().robot, rng, 4, 3), np.empty((4, 0))
    every = farthest(cases.deviations, options, acting, planes, -np.inf, len(planes))
    few = farthest(cases.deviations, options, acting, planes, -np.inf, 2)
    assert few.instants.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    best = every.values.reshape(4, -1)[:, :2].ravel()
    np.testing.assert_allclose(few.values, best)
    above = float(np.median(best))
    some = farthest(cases.deviations, options, acting, planes, above, len(planes))
    assert len(some.values) == np.sum(every.values > above)
