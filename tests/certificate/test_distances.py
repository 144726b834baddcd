"""Bounds of distances in certificates: of hulls with many points only those in front are bounded closely."""

import coal
import numpy as np
import pytest

from ocptip.certificate.trusted.distances import _above, _foremost, distances
from ocptip.certificate.trusted.forms import Form, K, linear
from ocptip.robots.collision.shapes import Hull

INTERVALS, POINTS = 6, 3000
TIMES = np.linspace(-1, 1, 21)


def forms(rng, size, wide):
    """Random forms (3, N) of this size, which change by about `wide` of it over an interval."""
    c = size * wide * rng.normal(size=(K, 3, INTERVALS)) / np.arange(1, K + 1)[:, None, None] ** 2
    c[0] = size * rng.normal(size=(3, INTERVALS))
    return Form(c, size * wide * 1e-3 * rng.random((3, INTERVALS)))


def values(form):
    """(T, 3, N): of the polynomials at some times."""
    return np.einsum("tk,kan->tan", TIMES[:, None] ** np.arange(K), form.c)


@pytest.mark.parametrize("wide", [0.0, 1e-3, 0.1, 2.0])
@pytest.mark.parametrize("seed", range(3))
def test_no_point_left_out_comes_before_those_kept(seed, wide):
    rng = np.random.default_rng(seed)
    points, along = rng.normal(size=(POINTS, 3)), forms(rng, 1.0, wide)
    kept = _foremost(points, along)
    assert len(kept) < POINTS or wide > 1  # of wide intervals nothing is known
    every = np.einsum("pa,tan->tpn", points, values(along)).max(axis=1)
    best = np.einsum("pa,tan->tpn", kept, values(along)).max(axis=1)
    np.testing.assert_allclose(best, every, rtol=0, atol=1e-12)
    bound = linear(kept, along).range[1].max(axis=0)
    assert np.all(every <= bound)
    assert np.all(bound <= linear(points, along).range[1].max(axis=0) + 1e-12)


def test_narrow_forms_leave_few_points_and_no_numbers_leave_all():
    rng = np.random.default_rng(0)
    points, along = rng.normal(size=(POINTS, 3)), forms(rng, 1.0, 1e-6)
    assert len(_foremost(points, along)) <= INTERVALS
    along.c[0, 0, 2] = np.nan
    assert len(_foremost(points, along)) == POINTS


@pytest.mark.parametrize("seed", range(5))
def test_bodies_beside_a_box_at_rest_are_no_nearer_than_proved(seed):
    """Bounds without any direction, against coal, whichever of the pair rests; where balls prove less."""
    rng, radius = np.random.default_rng(seed), 0.02
    board = rng.uniform(0.05, 1, 3) * [1, 1, 0.02] * (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5)
    board = (board @ np.linalg.qr(rng.normal(size=(3, 3)))[0] if seed % 2 else board) + rng.normal(size=3)
    part = 0.1 * rng.normal(size=(10, 3))
    bodies = [
        {"link": k, "points": own.tolist(), "radius": r}
        for k, own, r in ((-1, board, 0.0), (0, part, radius))
    ]
    origins = board.mean(axis=0)[:, None] + 0.8 * rng.normal(size=(3, 200))
    frame = Form.of(np.tile(np.eye(3)[:, :, None], 200)), Form.of(origins)

    def unknown(intervals, pairs):
        return np.full((len(pairs), 4), np.nan)

    solids, request = [Hull(own).solid() for own in (board, part)], coal.DistanceRequest()
    places = [coal.Transform3s(np.eye(3), at) for at in (np.zeros(3), *origins.T)]
    exact = [
        coal.distance(solids[0], places[0], solids[1], at, request, coal.DistanceResult())
        for at in places[1:]
    ]
    for pair in ((0, 1), (1, 0)):
        (bound,) = distances([frame], bodies, np.array([pair]), 0.05, unknown)
        known = ~np.isnan(bound)
        assert np.all(bound[known] <= np.array(exact)[known] - radius + 1e-6)
        balls = np.linalg.norm(board.mean(axis=0)[:, None] - part.mean(axis=0)[:, None] - origins, axis=0)
        reach = [np.linalg.norm(own - own.mean(axis=0), axis=1).max() for own in (board, part)]
        assert np.sum(known) > np.sum(balls - sum(reach) - radius >= 0.05)


def test_two_hulls_and_a_floor_are_as_far_apart_as_their_points():
    """Against NumPy: bodies at rest, a direction that separates them."""
    rng = np.random.default_rng(3)
    still = Form.of(np.tile(np.eye(3)[:, :, None], 1)), Form.of(np.zeros((3, 1)))
    moved = still[0], Form.of(np.array([[3.0], [0.5], [0.2]]))
    balls = rng.normal(size=(2, POINTS, 3))
    balls /= np.linalg.norm(balls, axis=2, keepdims=True)
    bodies = [{"link": k, "points": own.tolist(), "radius": 0.01} for k, own in enumerate(balls)]
    d = np.array([3.0, 0.5, 0.2])
    (gap,) = distances([still, moved], bodies, np.array([[0, 1]]), 10.0, lambda i, k: np.array([[0, *d]]))
    d /= np.linalg.norm(d)
    expected = np.min((balls[1] + moved[1].c[0, :, 0]) @ d) - np.max(balls[0] @ d) - 0.02
    assert expected - 1e-9 <= gap[0] <= expected
    floor = {"link": -1, "normal": [0.0, 0.0, 1.0], "level": 4.0}
    expected = 4.0 - (balls[1][:, 2].max() + 0.2) - 0.01
    assert expected - 1e-9 <= _above([still, moved], bodies[1], floor)[0] <= expected
