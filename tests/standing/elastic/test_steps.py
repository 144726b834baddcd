"""States of linear systems over many steps at once: as step by step."""

import numpy as np

from ocptip.standing.elastic.steps import ends_of_steps, powers, states_within


def test_all_steps_at_once_are_the_steps_one_after_the_other():
    rng = np.random.default_rng(0)
    steps = np.tile(np.eye(6), (9, 1, 1))
    steps[:, :2] += 0.1 * rng.normal(size=(9, 2, 6))
    steps[:, 3, 2] = 0.25  # time
    counts = np.array([3, 1, 4, 4, 1, 2, 3, 1, 5])
    z = np.array([0.3, -0.2, 1.0, 0.0, 0.0, 0.0])
    ends = ends_of_steps(steps, counts, z, 2)
    states, owner = states_within(steps, counts, ends)
    for i, count in enumerate(counts):
        z[2:] = 1.0, 0.0, 0.0, 0.0
        expected = powers(steps[i], z, count)
        np.testing.assert_allclose(states[owner == i], expected[1:], rtol=1e-12, atol=1e-14)
        z = expected[-1].copy()
    np.testing.assert_allclose(ends[-1], z, rtol=1e-12, atol=1e-14)


def test_what_grows_without_end_has_no_numbers_and_no_warnings():
    steps = np.full((3, 3, 3), 1e200)
    assert not np.isfinite(ends_of_steps(steps, np.array([2, 2, 2]), np.ones(3), 1)[-1]).any()
