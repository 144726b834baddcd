import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import control_number
from studies.indices.designs.symmetric_platforms import SymmetricPlatform
from tests.indices.sample_platforms import SEEDS
from tests.quick import examples


def random_platform(rng, g):
    names = ("a1", "b1", "r1", "phi1", "F", "a2", "b2", "r2", "phi2", "mu")
    return SymmetricPlatform.from_parameters(**dict(zip(names, rng.normal(size=10), strict=True)), g=g)


@examples(40)
@given(SEEDS, st.integers(3, 6))
def test_averages_are_the_entries_of_both_forms(seed, g):
    platform = random_platform(np.random.default_rng(seed), g)
    pose = platform.pose()
    one, two = platform.first.forms(), platform.second.forms()
    m = {key: g * (one[key] + two[key]) for key in one}

    def form(e, f, g_):
        matrix = np.diag([m[e + "11"], m[e + "11"], m[e + "33"], m[g_ + "11"], m[g_ + "11"], m[g_ + "33"]])
        matrix[0, 3] = matrix[1, 4] = m[f + "11"]
        matrix[2, 5] = -2 * m[f + "11"]
        matrix[0, 4], matrix[1, 3] = m[f + "12"], -m[f + "12"]
        return matrix + np.triu(matrix, 1).T

    np.testing.assert_allclose(pose.N, form("e", "f", "g"), atol=1e-9 * np.abs(pose.N).max())
    np.testing.assert_allclose(pose.Z, form("r", "s", "t"), atol=1e-9 * np.abs(pose.Z).max())


@examples(20)
@given(SEEDS, st.floats(-3, 3))
def test_characteristic_polynomial_factors(seed, x):
    """det(Z - lambda N) = H1 H2^2 with the corrected factors of [Naw07] 7.3."""
    platform = random_platform(np.random.default_rng(seed), 3)
    pose = platform.pose()
    one, two = platform.first.forms(), platform.second.forms()
    m = {key: 3 * (one[key] + two[key]) for key in one}
    d = {z + k: m[z + k] - x * m[n + k] for z, n in ("re", "sf", "tg") for k in ("11", "33") if z + k in m}
    d["s12"] = m["s12"] - x * m["f12"]
    H1 = d["r33"] * d["t33"] - 4 * d["s11"] ** 2
    H2 = d["r11"] * d["t11"] - d["s11"] ** 2 - d["s12"] ** 2
    values = np.linalg.eigvalsh(pose.Z - x * pose.N)
    assert np.prod(values) == pytest.approx(H1 * H2**2, rel=1e-6, abs=1e-9 * np.abs(values).max() ** 6)


@examples(20)
@given(SEEDS, st.floats(-3, 3))
def test_rotation_between_the_groups_does_not_matter(seed, mu):
    platform = random_platform(np.random.default_rng(seed), 4)
    other = SymmetricPlatform.from_parameters(**platform.parameters() | {"mu": mu})
    value = control_number(platform.pose()).value
    assert control_number(other.pose()).value == pytest.approx(value, rel=1e-7, abs=1e-12)


def test_parameters_come_back_and_legs_can_be_exchanged():
    platform = random_platform(np.random.default_rng(1), 3)
    again = SymmetricPlatform.from_parameters(**platform.parameters())
    np.testing.assert_allclose(again.pose().base, platform.pose().base, atol=1e-14)
    assert platform.to_dict()["g"] == 3
    pose, other = platform.pose(), platform.pose(exchanged=[0, 5])
    np.testing.assert_array_equal(other.base[[0, 5]], pose.platform[[0, 5]])
    np.testing.assert_array_equal(other.base[1:5], pose.base[1:5])
    with pytest.raises(InputError, match="legs are counted 0 to 5, got 6"):
        platform.pose(exchanged=[6])
    assert np.abs(platform.proportionality_defects()).max() > 1e-3
