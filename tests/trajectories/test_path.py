"""Paths: polynomials in s against finite differences and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.trajectories.path import JointPath


def _random(seed: int, pieces: int = 4, joints: int = 3, degree: int = 5) -> JointPath:
    """Continuous positions, corners everywhere."""
    rng = np.random.default_rng(seed)
    ends = np.concatenate([[0.0], np.sort(rng.uniform(0.05, 0.95, pieces - 1)), [1.0]])
    rows = rng.normal(size=(degree + 1, pieces, joints))
    powers = np.diff(ends)[:, None] ** np.arange(degree, -1, -1)
    for k in range(1, pieces):
        rows[-1, k] = powers[k - 1] @ rows[:, k - 1]
    return JointPath(ends, rows)


@given(seed=st.integers(0, 10_000))
def test_derivatives_are_those_of_the_positions(seed: int) -> None:
    path, step = _random(seed), 1e-5
    places = path.breakpoints[:-1] + np.diff(path.breakpoints) * 0.37
    _, first, second = path.at(places)
    before, at, after = (path.at(places + by)[0] for by in (-step, 0.0, step))
    scale = np.abs(path.coefficients).max() + 1
    assert np.abs((after - before) / (2 * step) - first).max() < 1e-6 * scale * 10
    assert np.abs((after - 2 * at + before) / step**2 - second).max() < 1e-3 * scale * 10


def test_sides_corners_and_ends_by_hand() -> None:
    """One joint runs on, the other turns back at s = 0.5; then only curvature jumps at 0.75."""
    rows = np.zeros((3, 3, 2))
    rows[1] = [[2.0, 1.0], [2.0, -1.0], [2.0, -1.0]]
    rows[2] = [[0.0, 0.0], [1.0, 0.5], [1.5, 0.25]]
    rows[0, 2] = [3.0, 0.0]
    path = JointPath(np.array([0.0, 0.5, 0.75, 1.0]), rows)
    assert path.corners.tolist() == [1]
    assert path.joints == 2
    assert path.start.tolist() == [0.0, 0.0]
    assert path.goal.tolist() == [2.1875, 0.0]
    assert path.at(0.5, side="left")[1].tolist() == [2.0, 1.0]
    assert path.at(0.5)[1].tolist() == [2.0, -1.0]
    assert path.at([0.75], side="left")[2].tolist() == [[0.0, 0.0]]
    assert path.at([0.75])[2].tolist() == [[6.0, 0.0]]
    assert path.ranges.tolist() == [[0.0, 2.1875], [0.0, 0.5]]


@given(seed=st.integers(0, 10_000))
def test_ranges_hold_every_position(seed: int) -> None:
    path = _random(seed)
    positions = path.at(np.linspace(0, 1, 2000))[0]
    assert np.all(positions >= path.ranges[:, 0] - 1e-12)
    assert np.all(positions <= path.ranges[:, 1] + 1e-12)
    assert np.all(np.ptp(positions, axis=0) >= 0.99 * np.ptp(path.ranges, axis=1))


@pytest.mark.parametrize(
    ("ends", "rows", "text"),
    [
        ([0.0, 0.5], np.ones((2, 1, 1)), "from 0 to 1"),
        ([0.0, 0.6, 0.5, 1.0], np.ones((2, 3, 1)), "increasing"),
        ([0.0, 1.0], np.full((2, 1, 1), np.nan), "coefficients"),
        ([0.0, 1.0], np.ones((1, 1, 1)), "D and n"),
        ([0.0, 0.5, 1.0], np.ones((2, 2, 1)), "has a gap of 0.5 at s = 0.5"),
    ],
)
def test_what_is_no_path_is_refused(ends: list[float], rows: np.ndarray, text: str) -> None:
    with pytest.raises(InputError, match=text):
        JointPath(np.array(ends), rows)


def test_a_piece_that_rests_has_no_timing() -> None:
    path = JointPath(
        np.array([0.0, 0.5, 1.0]), np.array([[[1.0, 1.0], [0.0, 1.0]], [[0.0, 0.0], [0.5, 0.5]]])
    )
    path.require_motion()
    with pytest.raises(InputError, match=r"does not move between s = 0\.5 and 1"):
        path.some(slice(1)).require_motion()


@pytest.mark.parametrize("place", [-1e-9, 1.001, np.nan])
def test_places_outside_are_refused(place: float) -> None:
    with pytest.raises(InputError, match=r"s: must be in \[0, 1\]"):
        _random(0).at(place)
