"""Distances of solids against coal called by hand, exact formulas and finite differences."""

from __future__ import annotations

import tracemalloc

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ocptip.robots.collision.bounds import between_lines
from ocptip.robots.collision.distances import RESTING, Distances
from ocptip.robots.collision.shapes import (
    Ball,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Hull,
    Shape,
    enclosing_capsule,
)
from tests.quick import examples, some

coal = pytest.importorskip("coal")
SEEDS = st.integers(0, 10**6)
KINDS = ("ball", "capsule", "cylinder", "box", "hull")


def random_shape(rng: np.random.Generator, kind: str) -> Shape:
    turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    pose = {"rotation": turn, "position": 0.1 * rng.normal(size=3)}
    if kind == "ball":
        return Ball(rng.uniform(0.05, 0.2), **pose)
    if kind == "capsule":
        return Capsule(rng.uniform(0.05, 0.1), rng.uniform(0.1, 0.5), **pose)
    if kind == "cylinder":
        return Cylinder(rng.uniform(0.05, 0.1), rng.uniform(0.1, 0.5), **pose)
    if kind == "box":
        return Box(rng.uniform(0.05, 0.4, 3), **pose)
    return Hull(0.1 * rng.normal(size=(12, 3)), **pose)


def two_free_bodies() -> cs.Function:
    """Frames of two bodies out of roll, pitch, yaw and position of each, (12,)."""
    y = cs.SX.sym("y", 12)

    def frame(e: cs.SX) -> cs.SX:
        turn = cs.SX.eye(3)
        for axis in range(3):
            c, s = cs.cos(e[axis]), cs.sin(e[axis])
            one = cs.SX.eye(3)
            i, j = (axis + 1) % 3, (axis + 2) % 3
            one[i, i], one[i, j], one[j, i], one[j, j] = c, -s, s, c
            turn = one @ turn
        return cs.vertcat(cs.vec(turn.T), e[3:])

    return cs.Function("frames", [y], [cs.vertcat(frame(y[:6]), frame(y[6:]))])


FRAMES = two_free_bodies()
ROW = np.array([0])


def apart(rng: np.random.Generator) -> np.ndarray:
    y = rng.uniform(-1, 1, (1, 12))
    way = rng.normal(size=3)
    y[0, 3:6], y[0, 9:] = 0, rng.uniform(0.5, 0.9) * way / np.linalg.norm(way)
    return y


@pytest.mark.parametrize("first", KINDS)
@pytest.mark.parametrize("second", some(2, KINDS))
@examples(2)
@given(seed=SEEDS)
def test_distance_is_that_of_the_cores(first, second, seed):
    """The distance of the hulls of corners, by quadratic programming, minus both thicknesses."""
    rng = np.random.default_rng(seed)
    shapes, y = (random_shape(rng, first), random_shape(rng, second)), apart(rng)
    found = Distances(FRAMES, list(enumerate(shapes)), [(0, 1)])
    axes, origins = found._poses(y)
    corners = [origins[0, i] + s.outline() @ axes[0, i].T for i, s in enumerate(shapes)]
    at = [c.mean(axis=0) for c in corners]
    for _ in range(20_000):  # Frank-Wolfe with exact line search from both sides
        gap = at[1] - at[0]
        ends = corners[0][np.argmax(corners[0] @ gap)], corners[1][np.argmin(corners[1] @ gap)]
        lower = float(gap @ (ends[1] - ends[0])) / np.linalg.norm(gap)
        if np.linalg.norm(gap) - lower < 1e-5:
            break
        for i in (0, 1):
            step = ends[i] - at[i]
            if step @ step > 0:
                share = np.clip(((at[1 - i] - at[i]) @ step) / (step @ step), 0, 1)
                at[i] = at[i] + share * step
    upper, thick = np.linalg.norm(at[1] - at[0]), sum(s.thickness for s in shapes)
    gap = found.gaps(y)[0, 0]
    assert lower - thick - 1e-6 <= gap <= upper - thick + 1e-6
    contact, _ = found.at(y, ROW, ROW)
    assert contact.distances[0] == gap
    between = contact.points[0, 1] - contact.points[0, 0]
    np.testing.assert_allclose(between, gap * contact.normals[0], atol=2e-6)


@pytest.mark.parametrize("first", KINDS)
@pytest.mark.parametrize("second", some(1, ["half space", *KINDS]))
@examples(2)
@given(seed=SEEDS)
def test_derivatives_by_differences(first, second, seed):
    rng = np.random.default_rng(seed)
    y = apart(rng)
    if second == "half space":
        other: Shape = HalfSpace(np.array([0.0, 0.6, -0.8]), 1.2)
        y[0, 9:] *= 0.1
    else:
        other = random_shape(rng, second)
    found = Distances(FRAMES, [(0, random_shape(rng, first)), (1, other)], [(0, 1)])
    contact, slope = found.at(y, ROW, ROW)
    if contact.distances[0] < 0.02:
        return
    bend, h = found.curvature(y, contact, np.ones(1))[0], 1e-5
    steps = [found.at(y + sign * h * np.eye(12)[j], ROW, ROW) for j in range(12) for sign in (1, -1)]
    gaps, slopes = (
        np.array(v).reshape(12, 2, -1) for v in zip(*[(c.distances, s) for c, s in steps], strict=True)
    )
    np.testing.assert_allclose((gaps[:, 0] - gaps[:, 1])[:, 0] / (2 * h), slope[0], atol=1e-6)
    if max(np.abs(c.points - contact.points).max() for c, _ in steps) < 1e-3:  # the corners are the same
        scale = 1 + np.abs(bend).max()
        np.testing.assert_allclose((slopes[:, 0] - slopes[:, 1]) / (2 * h), bend, atol=2e-4 * scale)


@examples(40)
@given(seed=SEEDS)
def test_segments(seed):
    rng = np.random.default_rng(seed)
    one, two = rng.normal(size=(2, 2, 3))
    if seed % 5 == 0:
        two = one + rng.normal(size=3)  # parallel
    if seed % 7 == 0:
        two[1] = two[0]  # a point

    def squared(s):
        return np.sum((one[0] + s[0] * (one[1] - one[0]) - two[0] - s[1] * (two[1] - two[0])) ** 2)

    starts = [(a, b) for a in (0, 0.5, 1) for b in (0, 0.5, 1)]
    expected = min(minimize(squared, s, bounds=[(0, 1)] * 2, tol=1e-14).fun for s in starts)
    assert between_lines(one, two) == pytest.approx(np.sqrt(expected), abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
@examples(10)
@given(seed=SEEDS)
def test_capsules_enclose(kind, seed):
    shape = random_shape(np.random.default_rng(seed), kind)
    ends, radius = enclosing_capsule(shape)
    points = shape.outline()
    beyond = max(between_lines(np.array([point, point]), ends) for point in points)
    assert beyond + shape.thickness <= radius


@examples(15)
@given(seed=SEEDS, below=st.floats(-0.1, 0.6))
def test_far_pairs_are_bounded_and_the_nearest_is_found(seed, below):
    rng = np.random.default_rng(seed)
    shapes = [random_shape(rng, kind) for kind in KINDS]
    space = HalfSpace(np.array([0.0, 0.0, -1.0]), 0.2)
    solids = [
        (0, shapes[0]),
        (0, shapes[1]),
        (1, shapes[2]),
        (1, shapes[3]),
        (RESTING, shapes[4]),
        (RESTING, space),
    ]
    pairs = [(a, b) for a in (0, 1) for b in (2, 3, 4, 5)]
    found, y = Distances(FRAMES, solids, pairs), rng.uniform(-1, 1, (5, 12))
    exact, bounded = found.gaps(y), found.gaps(y, below)
    near = (bounded < below) | (exact < below)
    np.testing.assert_array_equal(bounded[near], exact[near])
    assert (bounded <= exact + 1e-9).all()
    groups = rng.permutation(np.arange(len(pairs)) % 3)
    smallest = found.smallest(y, groups, below)
    of_groups = np.stack([exact[:, groups == g].min(axis=1) for g in range(3)], axis=1)
    near = (smallest < below) | (of_groups < below)
    np.testing.assert_array_equal(smallest[near], of_groups[near])
    assert (smallest <= of_groups + 1e-9).all()
    least = found.least(y)
    np.testing.assert_array_equal(least.distances, exact.min(axis=1))
    np.testing.assert_array_equal(least.states, np.arange(5))
    many = found.least(np.tile(y, (20, 1)))  # more than are computed at once
    np.testing.assert_array_equal(many.states, np.arange(100))
    for field in ("pairs", "distances", "normals", "points"):
        np.testing.assert_array_equal(getattr(many, field).reshape(20, -1)[7], getattr(least, field).ravel())


def test_depth_of_overlap():
    solids = [
        (0, Box([1.0, 1.0, 1.0])),
        (1, Box([1.0, 1.0, 1.0])),
        (RESTING, HalfSpace(np.array([1.0, 0, 0]), 0.3)),
    ]
    y = np.zeros((1, 12))
    y[0, 9:] = [0.9, 0.1, 0.2]
    gaps = Distances(FRAMES, solids, [(0, 1), (0, 2)]).gaps(y)
    np.testing.assert_allclose(gaps, [[-0.1, -0.2]], atol=1e-6)


def test_a_flat_mesh_gets_a_thickness():
    plate = Hull(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    np.testing.assert_allclose(np.ptp(plate.points[:, 2]), 1e-3)


def test_fine_meshes_take_memory_in_proportion_to_their_corners():
    points = np.random.default_rng(0).normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]  # a ball: all are corners
    flat = points * [1.0, 1.0, 0.0]
    tracemalloc.start()
    enclosing_capsule(Hull(points))
    thin = Hull(flat)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6  # B; a matrix of corners by corners has 128e6
    assert np.ptp(thin.points[:, 2]) == pytest.approx(1e-3)


def test_slopes_where_all_pairs_begin_or_end_at_rest():
    rng = np.random.default_rng(0)
    solids = [(0, random_shape(rng, "box")), (RESTING, Box(np.ones(3), position=np.array([2.0, 0, 0])))]
    y, one = rng.uniform(-1, 1, (1, 12)), np.zeros(1, dtype=int)
    ahead, behind = (Distances(FRAMES, solids, [pair]).at(y, one, one)[1] for pair in ((0, 1), (1, 0)))
    np.testing.assert_allclose(ahead, behind, atol=1e-9)
    assert np.abs(ahead).max() > 0.1


def test_no_rows_have_slopes_and_curvatures_too():
    """Programs ask for the rows of pairs that are near, and there may be none."""
    rng = np.random.default_rng(1)
    solids = [(0, random_shape(rng, "box")), (1, random_shape(rng, "ball"))]
    found, none = Distances(FRAMES, solids, [(0, 1)]), np.empty(0, dtype=int)
    y = rng.uniform(-1, 1, (3, 12))
    contact, slopes = found.at(y, none, none)
    assert contact.distances.shape == (0,)
    assert slopes.shape == (0, 12)
    np.testing.assert_array_equal(found.curvature(y, contact, np.empty(0)), np.zeros((3, 12, 12)))
    assert found.gaps(y[:0]).shape == (0, 1)
