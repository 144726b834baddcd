"""Springs of joints swing from rest: with jumps of accelerations as steps of what bends them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.measured.causes import Swinging
from ocptip.measured.prediction import Elasticity, _integrated
from ocptip.measured.recording import ANGLE
from tests.measured.machines import predictor, recorded


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


@pytest.mark.slow
def test_springs_are_found_from_far_away():
    """Two springs whose frequencies are off by a fifth, beside a joint that is shifted: least squares finds
    both, where steps along slopes end in another minimum."""
    bends, damping = np.array([0.0, 1 / 8e3, 1 / 1.5e4, 0.0, 0.0, 0.0]), np.full(6, 0.05)
    true = Elasticity(bends, damping, bends > 0)
    recording = recorded(5, elastic=true)
    signals = [one for one in recording.signals if one.kind == ANGLE]
    shifted = replace(signals[3], values=signals[3].values + 1e-3)
    signals[3] = shifted
    free = [np.full((len(recording.times), 1), float(one is shifted)) for one in signals]
    kept = [np.ones(len(one.values), dtype=bool) for one in signals]
    swinging = Swinging(
        predictor(), signals, kept, recording.times - 0.1234567, np.zeros(6), np.zeros(25), free
    )
    wrong = bends * np.array([1, 1.5, 0.65, 1, 1, 1])
    found = swinging.fitted(replace(true, bends=wrong, damping=2 * damping))
    np.testing.assert_allclose(found.bends, bends, rtol=0.02)
    np.testing.assert_allclose(found.damping[1], 0.05, rtol=0.3)  # the third joint hardly rings
    assert (found.bends[[0, 3, 4, 5]] == 0).all()
