"""Contacts in one plane: duality in three dimensions against the cone program."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.reserves.minimax import _minimise_general, minimise_usage
from tests.quick import examples


def problem(seed, count=6):
    """Random contacts in a plane: forces, cancelling forces Q, their complement J, limits."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    places = rng.uniform(-1, 1, (n, 2))
    A = np.zeros((3, n, 2))
    A[0, :, 0] = A[1, :, 1] = 1.0
    A[2, :, 0], A[2, :, 1] = -places[:, 1], places[:, 0]
    _, _, vt = np.linalg.svd(A.reshape(3, -1))
    J, Q = vt[:3].T.reshape(n, 2, 3), vt[3:].T.reshape(n, 2, -1)
    limits = 10.0 ** rng.uniform(-1, 2, (count, n))
    q = rng.normal(size=(count, n, 2)) * 10.0 ** rng.uniform(-2, 2)
    return q, *(np.broadcast_to(a, (count, *a.shape)).copy() for a in (Q, J)), limits


@examples(60)
@given(seed=st.integers(0, 10**6))
def test_both_ways_find_the_same_optimum_and_the_same_derivative(seed):
    q, Q, J, limits = problem(seed)
    fast, general = minimise_usage(q, Q, limits, J), _minimise_general(q, Q, limits)
    assert fast.solved.all()
    ok = general.solved
    np.testing.assert_allclose(fast.usage[ok], general.usage[ok], rtol=1e-6)
    scale = np.max(np.abs(q))
    np.testing.assert_allclose(
        np.einsum("sikr,sik->sr", J, fast.forces), np.einsum("sikr,sik->sr", J, q), atol=1e-9 * scale
    )
    assert np.all(np.linalg.norm(fast.forces, axis=2) <= fast.usage[:, None] * limits * (1 + 1e-9))
    np.testing.assert_allclose(
        np.einsum("sikz,sik->sz", Q, fast.pull), 0, atol=1e-9 * np.max(np.abs(fast.pull))
    )
    np.testing.assert_allclose(np.sum(np.linalg.norm(fast.pull, axis=2) * limits, axis=1), 1, rtol=1e-9)


@examples(30)
@given(seed=st.integers(0, 10**6))
def test_the_pull_is_the_derivative_of_the_usage(seed):
    q, Q, J, limits = problem(seed, count=1)
    best = minimise_usage(q, Q, limits, J)
    direction = np.random.default_rng(seed).normal(size=q.shape)
    step = 1e-6 * np.linalg.norm(q)
    ahead, behind = (minimise_usage(q + e * step * direction, Q, limits, J).usage[0] for e in (1, -1))
    slope = np.sum(best.pull * direction)
    steep = np.sum(np.linalg.norm(best.pull, axis=2)) * np.max(np.abs(direction))
    assert (ahead - behind) / (2 * step) == pytest.approx(slope, abs=1e-3 * steep)


def test_no_load_uses_nothing():
    q, Q, J, limits = problem(1)
    best = minimise_usage(np.zeros_like(q), Q, limits, J)
    assert best.solved.all()
    assert not best.usage.any()
    assert not best.pull.any()


def test_a_load_that_turns_about_a_contact():
    """Three equal contacts, a moment and the force that puts the centre of rotation on the first."""
    q, Q, J, limits = problem(3, count=1)
    pivot = np.cross(J[0, 0, 0], J[0, 0, 1])
    speeds = np.linalg.norm(J[0] @ pivot, axis=1)
    moving = speeds > 1e-12
    forces = np.zeros_like(q)
    forces[0, moving] = limits[0, moving, None] * (J[0] @ pivot)[moving] / speeds[moving, None]
    best = minimise_usage(forces, Q, limits, J)
    assert best.solved[0]
    assert best.usage[0] == pytest.approx(1.0, rel=1e-9)
