"""MDH rows from joint axes: special positions of axes, any frame by one row, moved inertias."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.parallel.description.frames import (
    compose,
    fixed_row,
    inverse,
    modified_rows,
    moved_inertia,
    rotation_angles,
    row_frame,
    standard_frame,
)
from ocptip.parallel.description.platform import product_of
from ocptip.parallel.description.robot_description import FIXED, PRISMATIC, REVOLUTE, MDHRow
from ocptip.robots.dh import DHRow, arm_from_dh
from ocptip.robots.kinematics import gripper_pose
from tests.oracles.parallel_urdf.chain import JointAxis, joints_to_coupling, mdh_chain
from tests.parallel.parallel_cases import random_body
from tests.quick import examples

X, Y, Z = np.eye(3)
ANGLES = [0.0, math.pi / 2, -math.pi / 2, math.pi, 0.3, -2.0]


def axis(point, direction, sigma=REVOLUTE):
    direction = np.array(direction, dtype=float)
    return JointAxis(sigma, np.array(point, dtype=float), direction / np.linalg.norm(direction))


def random_frame(seed):
    rng = np.random.default_rng(seed)
    turns = [(letter, float(rng.choice(ANGLES))) for letter in "zxz"]
    return product_of(turns), rng.uniform(-1, 1, 3) * (rng.random(3) > 0.4)


@given(seed=st.integers(0, 10**6))
@examples(100)
def test_any_frame_is_one_row(seed):
    R, p = random_frame(seed)
    row = fixed_row((R, p))
    assert row.sigma == FIXED
    turned, moved = row_frame(row)
    np.testing.assert_allclose(turned, R, atol=1e-14)
    np.testing.assert_allclose(moved, p, atol=1e-13)
    np.testing.assert_allclose(product_of(rotation_angles(R)), R, atol=1e-14)


@given(seed=st.integers(0, 10**6))
@examples(30)
def test_standard_rows_are_the_same_chain(seed):
    """Against the arms of `robots.dh`, which knows both conventions by itself."""
    rng = np.random.default_rng(seed)
    numbers, slides, q = rng.uniform(-1, 1, (5, 4)), rng.random(5) < 0.3, rng.uniform(-1, 1, 5)
    arm = arm_from_dh(
        "arm",
        [
            DHRow(a=a, alpha=alpha, d=d, theta=theta, slides=bool(kind))
            for (theta, d, a, alpha), kind in zip(numbers, slides, strict=True)
        ],
    )
    joints = [
        MDHRow(PRISMATIC if kind else REVOLUTE, theta=theta, r=d)
        for (theta, d, _, _), kind in zip(numbers, slides, strict=True)
    ]
    links = [(a, alpha) for _, _, a, alpha in numbers]
    frame = np.eye(3), np.zeros(3)
    for row, value in zip(modified_rows(joints, links), q, strict=True):
        frame = compose(frame, row_frame(row, value))
    turned, moved = compose(frame, standard_frame(*links[-1]))
    position, rotation = gripper_pose(arm, q)
    np.testing.assert_allclose(turned, rotation, atol=1e-12)
    np.testing.assert_allclose(moved, position, atol=1e-12)


CHAINS = {
    "parallel": [axis((0, 0, 0), Z), axis((0.6, 0, 0.1), Z), axis((1, 0.2, 0), Z)],
    "against each other": [axis((0, 0, 0), Z), axis((0.6, 0, 0), -Z), axis((1, 0, 0), Z)],
    "coincident": [
        axis((0, 0, 0.4), Z, PRISMATIC),
        axis((0, 0, 1), Z),
        axis((0, 0, 0), -Z),
        axis((1, 0, 0), X),
    ],
    "all coincident": [axis((0, 0, 0), Y), axis((0, 1, 0), Y)],
    "intersecting": [axis((0, 0, 0), Z), axis((0, 0, 0.5), X), axis((1, 0, 0.5), Y)],
    "skew": [axis((0, 0, 0), Z), axis((0.3, 0.1, 0.5), (1, 2, 3)), axis((1, 0, 0), (0, -1, 1), PRISMATIC)],
    "one": [axis((0.1, 0.2, 0.3), (1, 1, 0))],
}


@pytest.mark.parametrize("name", list(CHAINS))
def test_frames_are_on_the_axes(name):
    axes = CHAINS[name]
    chain = mdh_chain(axes)
    assert [row.sigma for row in chain.rows] == [one.sigma for one in axes]
    assert all(row.gamma == row.b == 0 for row in chain.rows)
    assert all(row.d >= 0 for row in chain.rows)
    for one, (R, p) in zip(axes, chain.frames, strict=True):
        np.testing.assert_allclose(R[:, 2], one.direction, atol=1e-14)
        np.testing.assert_allclose(np.cross(p - one.point, one.direction), 0, atol=1e-14)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_planar_chain_has_link_lengths_only():
    rows = mdh_chain([*CHAINS["parallel"][:1], axis((0.5, 0, 0), Z), axis((1.25, 0, 0), Z)]).rows
    assert [(row.alpha, row.d, row.theta, row.r) for row in rows[1:]] == [(0, 0.5, 0, 0), (0, 0.75, 0, 0)]


def test_snap_makes_right_angles():
    tilted = [axis((0, 0, 0), Z), axis((0.5, 0, 2e-6), (0, -1, 3e-6)), axis((0.5, 0, 0.4), (2e-6, -1, 0))]
    exact = mdh_chain(tilted, snap=1e-5).rows
    assert [row.alpha for row in exact] == [0, math.pi / 2, 0]
    assert exact[2].d == pytest.approx(0.4, abs=1e-5)
    assert mdh_chain(tilted, snap=1e-9).rows[1].alpha != math.pi / 2


@pytest.mark.parametrize(
    ("axes", "wanted", "n"),
    [
        (CHAINS["parallel"], None, 2),
        ([axis((0, 0, 0), Z), axis((1, 0, 0), Z), axis((1, 0, 0), X)], None, 1),
        ([axis((0, 0, 0), Z), axis((1, 0, 0), Z), axis((1, 0, 0), X)], 2, 2),
        (
            [axis((0, 0, 0), Z, PRISMATIC), axis((0, 1, 1), X), axis((1, 0, 1), Y), axis((1, 1, 0), Z)],
            None,
            1,
        ),
        (
            [axis((0, 0, 0), Z, PRISMATIC), axis((0, 1, 2), X), axis((1, 0, 1), Y), axis((1, 1, 0), Z)],
            None,
            2,
        ),
        ([axis((0, 0, 0), Z), axis((0, 0, 0), X), axis((0, 0, 0), Y)], None, 1),
        ([axis((0, 0, 0), Z), axis((1, 0, 0), X, PRISMATIC)], None, 2),
        ([axis((0, 0, 0), Z)], None, 1),
    ],
)
def test_joints_that_turn_about_the_end(axes, wanted, n):
    assert joints_to_coupling(axes, wanted, 1e-9) == n


def test_moved_inertia_keeps_energy():
    rng = np.random.default_rng(4)
    body, frame = random_body(rng), random_frame(3)
    moved = moved_inertia(body, frame)
    v, w = rng.uniform(-1, 1, (2, 3))  # of the other frame's origin, in its axes
    own_v, own_w = frame[0].T @ (v + np.cross(w, frame[1])), frame[0].T @ w

    def energy(one, v, w):
        return 0.5 * one.mass * v @ v + v @ np.cross(w, one.first_moment) + 0.5 * w @ one.inertia @ w

    assert energy(moved, v, w) == pytest.approx(energy(body, own_v, own_w), rel=1e-13)
    np.testing.assert_allclose(moved_inertia(moved, inverse(frame)).vector, body.vector, atol=1e-13)
    np.testing.assert_allclose(compose(frame, inverse(frame))[1], 0, atol=1e-15)
