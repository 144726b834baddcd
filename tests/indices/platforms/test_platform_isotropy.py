import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from ocptip.basics.errors import InputError
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import platform_conditioning
from tests.indices.sample_platforms import (
    LEGS,
    SEEDS,
    flat_pose,
    moved,
    random_ellipsoid,
    random_motion,
    random_pose,
)
from tests.quick import examples


@examples(40)
@given(SEEDS, LEGS)
def test_equals_the_generalised_eigenproblem(seed, n):
    rng = np.random.default_rng(seed)
    pose, W = random_pose(rng, n), random_ellipsoid(rng).W()
    result = platform_conditioning(pose, W)
    inverse = eigh(pose.N, W, eigvals_only=True)
    assert 0.0 <= result.value <= 1.0
    assert result.value == pytest.approx(math.sqrt(inverse[0] / inverse[-1]), rel=1e-5)
    assert result.lambdas[0] <= 18 / n * (1 + 1e-9)
    assert 18 / n <= result.lambdas[-1] * (1 + 1e-9)
    assert result.residual < 1e-9
    rates = np.linalg.norm(pose.jacobian @ result.fastest)
    assert rates**2 * result.lambdas[-1] == pytest.approx(1.0, rel=1e-6)


@examples(30)
@given(SEEDS, LEGS, st.floats(0.01, 100))
def test_does_not_depend_on_frame_and_unit(seed, n, factor):
    rng = np.random.default_rng(seed)
    pose, oe = random_pose(rng, n), random_ellipsoid(rng)
    R, t = random_motion(rng)
    scaled = OperationEllipsoid(factor * oe.center, oe.axes, factor * oe.half_axes)
    value = platform_conditioning(pose, oe.W()).value
    other = platform_conditioning(moved(pose, R, t, factor), scaled.W(R, t)).value
    assert other == pytest.approx(value, rel=1e-7)


def test_singular_pose_gives_zero_and_three_infinite_eigenvalues():
    rng = np.random.default_rng(0)
    for n in (6, 9):
        result = platform_conditioning(flat_pose(rng, n), random_ellipsoid(rng).W())
        assert result.value == 0.0
        assert np.isinf(result.lambdas).sum() == 3
        assert result.to_dict()["lambdas"][3:] == [None] * 3


def test_metric_is_checked():
    pose = random_pose(np.random.default_rng(0))
    with pytest.raises(InputError, match="positive definite"):
        platform_conditioning(pose, np.diag([0.0, 1, 1, 1, 1, 1]))
    with pytest.raises(InputError, match="positive definite"):
        platform_conditioning(pose, -np.eye(6))
    with pytest.raises(InputError, match="symmetric"):
        platform_conditioning(pose, np.eye(6) + np.triu(np.ones((6, 6)), 1))
    with pytest.raises(InputError, match="W: expected shape 6 x 6"):
        platform_conditioning(pose, np.eye(5))
