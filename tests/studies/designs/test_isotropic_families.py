import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import platform_conditioning
from studies.indices.designs.isotropic_families import IsotropicFamily, LineGroup, isotropic_u1, isotropic_u2
from tests.indices.sample_axes import klein_form
from tests.quick import examples

SIGNS = st.tuples(*[st.sampled_from([1, -1])] * 3)
RADII = st.floats(0.02, 0.66).flatmap(lambda r: st.sampled_from([r, -r]))


def conditioning(family, low=-1.3, high=0.8):
    return platform_conditioning(family.pose(low, high), family.ellipsoid.W())


@examples(60)
@given(st.floats(0.1, 5), RADII, st.floats(-3, 3), st.integers(3, 6), SIGNS, st.integers(0, 1000))
def test_u1_is_isotropic_wherever_the_anchors_sit(p, r2, mu, g, signs, seed):
    rng = np.random.default_rng(seed)
    family = isotropic_u1(p, r2, mu=mu, g=g, signs=signs)
    result = conditioning(family, rng.uniform(-3, -0.5, 2 * g), rng.uniform(0.5, 3, 2 * g))
    assert result.value == pytest.approx(1.0, abs=1e-10)
    np.testing.assert_allclose(result.lambdas, 18 / (2 * g), rtol=1e-9)


@examples(40)
@given(st.floats(0.1, 5), st.floats(-3, 3), st.integers(3, 6), SIGNS)
def test_u2_is_isotropic(p, mu, g, signs):
    result = conditioning(isotropic_u2(p, mu=mu, g=g, signs=signs))
    assert result.value == pytest.approx(1.0, abs=1e-11)
    np.testing.assert_allclose(result.lambdas, 18 / (2 * g), rtol=1e-10)


@examples(30)
@given(st.integers(0, 2**32 - 1), st.integers(3, 6))
def test_form_of_two_rotated_groups(seed, g):
    """Entries of N and the factors of the characteristic polynomial for any two groups ([Naw07] 5.3)."""
    rng = np.random.default_rng(seed)
    (r1, h1, z1), (r2, h2, z2), mu, p = *rng.normal(size=(2, 3)), rng.normal(), rng.uniform(0.3, 2)
    family = IsotropicFamily(LineGroup(r1, h1, z1), LineGroup(r2, h2, z2, mu), p, g)
    N = family.pose().N
    D = g / (2 * (1 + z1**2) * (1 + z2**2))
    A, B = 1 + z2**2, 1 + z1**2
    n11 = (A * (r1**2 * z1**2 + h1**2) + B * (r2**2 * z2**2 + h2**2)) * D
    n33 = 2 * (r1**2 * A + r2**2 * B) * D
    n44, n66 = (A + B) * D, (2 * z1**2 + 2 * z2**2 + 4 * z1**2 * z2**2) * D
    n36 = 2 * (r1 * z1 * A + r2 * z2 * B) * D
    n24 = (h1 * A + h2 * B) * D
    expected = np.diag([n11, n11, n33, n44, n44, n66])
    expected[2, 5] = n36
    expected[0, 3] = expected[1, 4] = -n36 / 2
    expected[1, 3], expected[0, 4] = n24, -n24
    np.testing.assert_allclose(N, expected + np.triu(expected, 1).T, atol=1e-9 * np.abs(N).max())
    W, x = family.ellipsoid.W(), rng.normal()
    F1 = x**2 * (n36**2 - n33 * n66) + x * (6 * n33 + 4 * n66) - 24
    F2 = x**2 * (n36**2 / 4 + n24**2 - n44 * n11) + x * (6 * n11 + 2 * n44 * (1 + p * p)) - 12 * (1 + p * p)
    values = np.linalg.eigvalsh(W - x * N)
    assert np.prod(values) == pytest.approx(-F1 * F2**2, rel=1e-6, abs=1e-9 * np.abs(values).max() ** 6)


def test_perturbed_lines_are_not_isotropic():
    family = isotropic_u1(1.0, 0.3)
    pose = family.pose()
    moved = type(pose)(pose.base, pose.platform + np.array([0.0, 0.0, 0.05]))
    assert platform_conditioning(moved, family.ellipsoid.W()).value < 0.99


@pytest.mark.parametrize(
    ("p", "r2", "r1", "h1", "z1", "h2", "z2"),
    [
        (1.0, 0.3, -0.657456707695, -0.497274281078, 0.234260642833, 1.223294731453, 1.262933094032),
        (0.5, 0.6, -0.549169647365, -0.549685541934, 0.801783725737, 0.461735855225, 0.616441400297),
    ],
)
def test_fixed_members(p, r2, r1, h1, z1, h2, z2):
    family = isotropic_u1(p, r2)
    one, two = family.first, family.second
    got = [one.radius, one.height, one.slope, two.height, two.slope]
    np.testing.assert_allclose(got, [r1, h1, z1, h2, z2], atol=1e-12)


@examples(30)
@given(RADII, st.floats(0.1, 5))
def test_cone_angles_of_u1(r2, p):
    family = isotropic_u1(p, r2)
    q = r2 * r2
    assert math.cos(family.first.cone_angle) == pytest.approx(abs(r2) / math.sqrt(2 - 3 * q), rel=1e-9)
    expected = math.sqrt((9 * q - 4) / (9 * q - 6))
    assert math.cos(family.second.cone_angle) == pytest.approx(expected, rel=1e-9)
    for group in (family.first, family.second):
        assert math.acos(math.sqrt(6) / 3) < group.cone_angle < math.pi / 2


def test_cones_of_u1_are_equal_at_one_radius_and_u2_is_a_plane_and_a_cone():
    family = isotropic_u1(0.7, math.sqrt(3) / 3)
    assert family.first.cone_angle == pytest.approx(family.second.cone_angle)
    assert family.first.cone_angle == pytest.approx(math.acos(math.sqrt(3) / 3))
    flat = isotropic_u2(0.7)
    assert flat.first.slope == 0.0
    assert flat.second.cone_angle == pytest.approx(math.acos(math.sqrt(6) / 3))


def test_lines_carry_the_legs():
    family = isotropic_u1(1.2, 0.4, mu=0.5, g=4)
    pose = family.pose(-0.5, 2.0)
    np.testing.assert_allclose(pose.spears, family.spears, atol=1e-14)
    assert klein_form(family.spears, family.spears) == pytest.approx(0.0, abs=1e-14)
    np.testing.assert_allclose(pose.lengths, 2.5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: isotropic_u1(1.0, 0.7), "r2: expected 0 < "),
        (lambda: isotropic_u1(1.0, 0.0), "r2: expected 0 < "),
        (lambda: isotropic_u1(0.0, 0.3), "p: must be > 0"),
        (lambda: isotropic_u1(1.0, 0.3, g=2), "g: must be a whole number >= 3, got 2"),
        (lambda: isotropic_u1(1.0, 0.3, signs=(1, 2, 1)), "signs: expected three numbers"),
        (lambda: isotropic_u2(1.0, signs=3), "signs: expected three numbers"),
        (lambda: isotropic_u2(math.inf), "p: must be finite"),
        (lambda: isotropic_u2(1.0).pose(0.5, 0.5), "leg 1: base and platform anchor coincide"),
        (lambda: isotropic_u2(1.0).pose([1.0] * 5), "base_offset: expected shape 6"),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_sign_branches_are_eight_different_members():
    members = {
        tuple(np.round(isotropic_u1(0.8, 0.5, signs=s).spears.ravel(), 9))
        for s in itertools.product((1, -1), repeat=3)
    }
    assert len(members) == 8
