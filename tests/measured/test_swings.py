"""Springs of joints swing from rest: with jumps of accelerations as steps of what bends them."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.measured.prediction import _integrated


@pytest.mark.parametrize("inside", [0.0, 0.3, 0.77])
def test_a_step_anywhere_between_instants_rings_in_time(inside):
    """One mass on a spring, a step of its load: the exact solution, wherever in a step it comes."""
    m, k, zeta, h = 2.0, 2.0 * (2 * np.pi * 25) ** 2, 0.05, 5e-4
    omega, at = np.sqrt(k / m), 0.02 + inside * h
    times = np.union1d(np.arange(0.0, 0.2, h), [at - 1e-7, at + 1e-7])
    forces = np.where(times > at, 10.0, 0.0)[:, None]
    every = np.ones((len(times), 1, 1))
    c = 2 * zeta * np.sqrt(k * m)
    way = _integrated(np.diff(times), m * every, c * every, k * every, forces)[0, :, 0]
    since, damped = np.maximum(times - at, 0.0), omega * np.sqrt(1 - zeta**2)
    ring = np.exp(-zeta * omega * since) * (
        np.cos(damped * since) + zeta / np.sqrt(1 - zeta**2) * np.sin(damped * since)
    )
    np.testing.assert_allclose(way, 10 / k * (1 - ring), atol=6e-3 * 10 / k)
