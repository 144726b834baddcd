"""Whitening and selection against statistics that are known."""

import numpy as np
import pytest
from scipy import signal

from ocptip.measured.regression import Block, autoregression, explain, whitened


def blocks(rng, truth, N=600, noise=(1.0,), columns=8):
    """Coloured noise, a smooth random design, and a stretch that is missing."""
    X = np.asarray(signal.lfilter([1.0], [1.0, -0.95], rng.normal(size=(N, columns)), axis=0))
    y = X @ truth + signal.lfilter([1.0], noise, rng.normal(size=N))
    kept = np.ones(N, dtype=bool)
    kept[100:110] = False
    y[~kept] = 1e6
    return [Block(y, X, kept)]


def test_autoregression_is_recovered():
    rng = np.random.default_rng(0)
    values = np.asarray(signal.lfilter([1.0], [1.0, -1.6, 0.9], rng.normal(size=4000)))
    found = autoregression(values)
    assert found == pytest.approx([1.0, -1.6, 0.9], abs=0.03)
    assert len(autoregression(rng.normal(size=4000))) == 1


@pytest.mark.slow
def test_chance_finds_nothing_as_often_as_it_should():
    """With a level of 20 %, in coloured noise: 150 draws."""
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(150):
        own = [whitened(b) for b in blocks(rng, np.zeros(8), 600, (1.0, -0.8))]
        found += bool(explain(own, 0.2).causes)
    assert 0.1 < found / 150 < 0.3


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_should():
    rng = np.random.default_rng(2)
    truth = np.array([0, 0.5, 0, 0, -0.5, 0, 0, 0])
    inside = total = 0
    for _ in range(150):
        found = explain([whitened(b) for b in blocks(rng, truth, 300, (1.0, -0.7))], 1e-3)
        assert {c.index for c in found.causes} == {1, 4}
        for cause in found.causes:
            inside += abs(cause.value - truth[cause.index]) < 1.96 * cause.error
            total += 1
    assert 0.90 < inside / total < 0.985


def test_what_cannot_be_told_apart_is_said():
    rng = np.random.default_rng(3)
    (block,) = blocks(rng, np.array([0, 1.0, 0, 0]), columns=4)
    twin = block.columns.copy()
    twin[:, 3] = -2 * twin[:, 1]
    found = explain([whitened(Block(block.values, twin, block.kept))], 1e-3)
    assert len(found.causes) == 1
    assert {found.causes[0].index, *found.causes[0].rivals} == {1, 3}


def test_nuisance_and_prior():
    """What is always in is no finding; a prior with no error keeps it out."""
    rng = np.random.default_rng(4)
    own = [whitened(b) for b in blocks(rng, np.array([0.7, 0, 0, 0]), columns=4)]
    free = explain(own, 1e-3, always=[0])
    assert not free.causes
    assert free.values[0] == pytest.approx(0.7, abs=4 * free.errors[0])
    held = explain(own, 1e-3, always=[0], prior=np.array([1e12, 0, 0, 0]))
    assert abs(held.values[0]) < 1e-3
    assert held.square > free.square
