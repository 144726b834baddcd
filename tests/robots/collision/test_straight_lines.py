"""Straight lines in joint space: against fine samples, bounds of slopes, and screened distances."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ocptip.published.arms import load_arm
from ocptip.robots.collision.bounds import LAST, StraightLines
from ocptip.robots.collision.model import collisions_of
from ocptip.robots.collision.shapes import Ball, Box, Cylinder, Hull
from ocptip.robots.geometry import Pillar, Solid, Wall, floor
from tests.motion.paths.among_boxes import task_among

PLATE = 'kind = "box"\nsize = [0.2, 0.0005, 0.4]\nposition = [0.75, 0.0, 0.5]\n'
CLEARANCE = 0.002


@pytest.fixture(scope="module")
def among(tmp_path_factory: pytest.TempPathFactory):
    """Distances of the arm from a plate of half a millimetre and itself."""
    return task_among(Path(tmp_path_factory.mktemp("plate")), PLATE).robot


@pytest.fixture(scope="module")
def modular():
    """An arm of spheres among a pillar, a wall and a floor."""
    around = (floor(-0.3), Wall(np.array([1.0, 0, 0]), 0.5), Pillar([0.35, 0.35, 0], 0.1))
    return collisions_of(load_arm("FSFS"), around, ())


@pytest.mark.parametrize(
    ("model", "widest"), [pytest.param("among", 1.2, marks=pytest.mark.slow), ("modular", 2.5)]
)
def test_nothing_tunnels_through_a_thin_plate(model, widest, request):
    """Every line is judged as by samples, but for those that pass within what a proof leaves open."""
    given = request.getfixturevalue(model)
    collision = getattr(given, "collision", given)
    lines, rng, seen = StraightLines(collision, CLEARANCE), np.random.default_rng(3), {True: 0, False: 0}
    for begin, end in rng.uniform(-widest, widest, (40, 2, collision.n)):
        states = begin + np.linspace(0, 1, 1000)[:, None] * (end - begin)
        least = collision.gaps(states, 0.01).min()
        clear = lines.clear(begin, end)
        seen[clear] += 1
        if clear:
            assert least >= CLEARANCE
        else:
            assert least < CLEARANCE + 2 * LAST
    assert min(seen.values()) > 5


def test_a_plate_between_two_free_ends_is_seen(among):
    begin, end = np.array([-0.4, 0.0, 0.0]), np.array([0.4, 0.0, 0.0])
    lines = StraightLines(among.collision, CLEARANCE)
    assert lines.free(begin)
    assert lines.free(end)
    assert not lines.clear(begin, end)
    assert not lines.clear(end, begin)


def test_machine_code_judges_lines_as_batches_of_distances_do(modular, monkeypatch):
    lines = np.random.default_rng(4).uniform(-2.5, 2.5, (60, 2, modular.n))
    judged = [StraightLines(modular, CLEARANCE).clear(*line) for line in lines]
    monkeypatch.setattr(modular, "on_line", lambda *_: None)
    assert judged == [StraightLines(modular, CLEARANCE).clear(*line) for line in lines]
    assert 10 < sum(judged) < 50


def test_slopes_of_distances_keep_their_bounds(among, modular):
    for collision, limits in ((among.collision, among.limits), (modular, load_arm("FSFS").limits)):
        rng = np.random.default_rng(1)
        low, high = np.maximum(limits.angle_min, -2), np.minimum(limits.angle_max, 2)
        q = rng.uniform(low, high, (40, collision.n))
        count = len(collision.labels)
        rows, pairs = np.divmod(np.arange(40 * count), count)
        gaps, slopes = collision.slopes(q, rows, pairs)
        apart, bounds = gaps > 0, collision.steepest[pairs]
        assert np.all(np.abs(slopes[apart]) <= bounds[apart] + 1e-9)
        assert np.max(np.abs(slopes[apart]) / np.maximum(bounds[apart], 1e-3)) > 0.7


def test_screened_distances_judge_as_all_distances(tmp_path):
    kinds = (
        Box([0.3, 0.02, 0.3], position=[0.7, 0.1, 0.5]),
        Cylinder(0.1, 0.2, position=[-0.5, 0.4, 0.5]),
        Ball(0.1, position=[0.2, -0.6, 0.5]),
        Hull(np.random.default_rng(0).normal(size=(20, 3)) * 0.1 + [-0.5, -0.5, 0.5]),
    )
    arm = task_among(tmp_path).robot.arm
    around = tuple(Solid(shape, f"{k}") for k, shape in enumerate(kinds))
    collision = collisions_of(arm, (floor(0.3), *around), ())
    q = np.random.default_rng(2).uniform(-2.5, 2.5, (400, 3))
    gaps = collision.gaps(q)
    needed = np.linspace(0.01, 0.1, gaps.shape[1])
    free = np.all(gaps >= 0.005, axis=1)
    for one, state, own in zip(free, q, gaps, strict=True):
        kept = collision.proved(state[None], 0.005, needed)
        assert (kept is not None) == one
        if kept is not None:
            assert kept[0] == np.all(own >= needed)
    assert 50 < np.sum(free) < 350
    assert np.array_equal(collision.proved(q[free], 0.005, needed), np.all(gaps[free] >= needed, axis=1))
