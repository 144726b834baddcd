"""Cancels as limits of programs: wrenches of the states of stops, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.published.tasks import experiment_task
from ocptip.standing.stops.by_cancel import cancel_slopes, stop_states


@pytest.fixture(scope="module")
def robot():
    return experiment_task("A", "effective").robot


def test_slopes_and_curvature_against_differences(robot):
    rng, n, step = np.random.default_rng(0), robot.n, 1e-5
    q, qd = rng.normal(size=(2, 4, n))
    qd[0, 1] = 0.0
    rates = tuple(rng.uniform(2, 6, n))
    at = stop_states(q, qd, np.array(rates))
    rows = np.flatnonzero(rng.random(len(at.owner)) < 0.2)
    chosen = np.sign(qd)[at.owner[rows]], at.moves[rows].astype(float), at.weights[rows]
    s = np.hstack([q, qd, 0 * q])[at.owner[rows]]
    slopes, weights = cancel_slopes(robot, rates), rng.normal(size=(len(rows), 6))
    expected = robot.loads(at.q[rows], at.qd[rows], at.qdd[rows])[1]
    np.testing.assert_allclose(slopes.wrenches(s, *chosen), expected, atol=1e-9)
    gradient, bends = (f(s, *chosen, weights) for f in (slopes.gradient, slopes.hessian))
    assert not gradient[:, 2 * n :].any()
    for j in range(2 * n):
        d = step * np.eye(3 * n)[j]
        ahead, back = (np.sum(weights * slopes.wrenches(s + own, *chosen), axis=1) for own in (d, -d))
        numeric = (ahead - back) / (2 * step)
        np.testing.assert_allclose(gradient[:, j], numeric, atol=3e-5 * np.abs(gradient).max())
        numeric = (slopes.gradient(s + d, *chosen, weights) - slopes.gradient(s - d, *chosen, weights)) / (
            2 * step
        )
        np.testing.assert_allclose(bends[:, j], numeric, atol=1e-4 * np.abs(bends).max())
