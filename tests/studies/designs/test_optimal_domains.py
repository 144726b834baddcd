import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from studies.indices.designs.optimal_domains import (
    TOUCHING_POINT,
    W_CROSSES_S12,
    W_MEETS_S,
    W_MEETS_S12,
    angle_borders,
    discriminants,
    inner_borders,
    main_roots,
    outer_border,
    real_root_counts,
    special_limit,
)
from studies.indices.designs.optimal_planar import LARGEST_R
from tests.quick import examples

SHAPES = st.floats(0.02, 0.98).flatmap(lambda t: st.sampled_from([t, -t]))
T_N = TOUCHING_POINT[0]


@examples(60)
@given(SHAPES, st.floats(0.01, 4))
def test_roots_follow_the_borders(t, r1):
    """The pattern of [Naw07] 7.3.1: which roots are real between the curves."""
    S, (lower, upper) = outer_border(t), inner_borders(t)
    assume(min(abs(r1 - c) for c in (S, lower, upper) if not math.isnan(c)) > 1e-6)
    assume(abs(abs(t) - 0.5) > 1e-6 and abs(abs(t) - T_N) > 1e-6)
    roots = set(main_roots(t, r1))
    if abs(t) < 0.5:
        expected = {1, 2, 3, 4} if r1 <= S else set()
    elif abs(t) < T_N:
        expected = {1, 2} if r1 <= S else set()
        expected |= {3, 4} if r1 < lower or upper < r1 < S else set()
    else:
        expected = ({1, 2} if r1 <= upper else set()) | ({3, 4} if r1 <= lower else set())
    assert roots == expected
    mirrored = main_roots(-t, r1)
    assert sorted(-b for b in mirrored.values()) == pytest.approx(sorted(main_roots(t, r1).values()))


@examples(30)
@given(SHAPES)
def test_borders_are_zeros_of_the_discriminants(t):
    S = outer_border(t)
    assert abs(discriminants(t, S)[0]) < 1e-9 * (1 + S * S)
    for r1 in inner_borders(t):
        if not math.isnan(r1) and discriminants(t, r1)[0] > 1e-9:
            scale = max(np.abs(discriminants(t, r1)[1]))
            assert min(np.abs(discriminants(t, r1)[1])) < 1e-7 * scale


def test_special_points():
    t, r1 = TOUCHING_POINT
    u = t * t
    polynomial = 205 - 12 * u + 72 * u**2 - 5888 * u**3 - 5568 * u**4 - 2304 * u**5 + 2560 * u**6
    assert abs(polynomial) < 1e-6
    assert outer_border(t) == pytest.approx(r1, abs=1e-10)
    assert inner_borders(t)[1] == pytest.approx(r1, abs=1e-9)
    assert main_roots(0.5, LARGEST_R)
    assert not main_roots(0.5, LARGEST_R + 1e-6)
    assert set(main_roots(0.5, 2 / 3 * math.sqrt(6))) == {1}
    assert main_roots(0.5, 2 / 3 * math.sqrt(6))[1] == pytest.approx(0, abs=1e-12)


def discriminant_of_the_angle(t, r1, b1):
    """W of [Naw07] (7.47) as printed: zero where both solutions of Phi1 are the same."""
    a1, q = b1 + math.sqrt(2) * t * r1, r1 * r1
    d = a1 - b1
    return (
        -6 * q**4
        - 8 * q**3 * (6 * b1**2 - 12 * b1 * a1 + 9 * a1**2 - 4)
        + 24 * q * (2 * a1**2 + 5 * b1 * a1 - b1**2 + 12) * d**4
        - 3 * q * q * (33 * a1**2 - 78 * b1 * a1 + 33 * b1**2 - 64) * d * d
        - 16 * (12 * b1 * a1 + 3 * b1**2 - 8) * d**6
    )


@examples(30)
@given(st.floats(0.02, 0.61), st.sampled_from([1, -1]))
def test_angle_borders_are_zeros_of_the_angle_discriminant(t, sign):
    """(7.63) to (7.65): on both curves W = 0 for exactly one root, elsewhere W > 0 (theorem 7.5)."""
    assume(abs(t - 0.5) > 1e-3 and abs(t - W_CROSSES_S12[0]) > 1e-4 and abs(t - W_MEETS_S12[0]) > 1e-3)
    assume(abs(t - W_MEETS_S[0]) > 1e-3)
    for r1 in angle_borders(sign * t):
        values = [discriminant_of_the_angle(sign * t, r1, b1) for b1 in main_roots(sign * t, r1).values()]
        assert sorted(np.abs(values))[0] < 1e-7
        assert sorted(values)[1] > 1e-3


def test_curve_w_has_the_printed_points():
    """[Naw07] 7.3.1, remark on theorem 7.5: T~, M~, K and where the curve ends and meets T."""
    t, r1 = W_MEETS_S
    assert (angle_borders(t)[1], outer_border(t)) == pytest.approx((r1, r1), abs=1e-10)
    t, r1 = W_CROSSES_S12
    assert (angle_borders(t)[1], inner_borders(t)[1]) == pytest.approx((r1, r1), abs=1e-9)
    t, r1 = W_MEETS_S12
    assert (angle_borders(t)[1], inner_borders(t)[1]) == pytest.approx((r1, r1), abs=1e-10)
    assert angle_borders(0.5)[1] == pytest.approx(LARGEST_R, abs=1e-12)  # (7.62), of the limit t -> 1/2
    assert not any(map(math.isnan, angle_borders(0.6111)))
    assert all(map(math.isnan, angle_borders(0.6112)))


@pytest.mark.parametrize(
    ("t", "other", "crosses"),
    [
        (W_MEETS_S[0], outer_border, 0),
        (W_MEETS_S12[0], lambda t: inner_borders(t)[1], 0),
        (W_CROSSES_S12[0], lambda t: inner_borders(t)[1], 1),
    ],
)
def test_curve_w_touches_or_crosses_as_printed(t, other, crosses):
    before, after = (other(t + step) - angle_borders(t + step)[1] for step in (-1e-3, 1e-3))
    assert (before * after < 0) == bool(crosses)
    assert min(abs(before), abs(after)) > 1e-9


@pytest.mark.parametrize("t", [0.3, -0.4, 0.7, 0.9])
@pytest.mark.parametrize("sign", [1, -1])
def test_flat_angles_of_the_special_family_are_complex(t, sign):
    """(7.84): sin Phi1 = 0 there, by (7.79) and (7.77) in complex numbers; none of the four r1 is real."""
    r1 = (
        4 / math.sqrt(3) * np.sqrt((t * t - 1 + sign * 2 * np.emath.sqrt(t * t - 2)) / (t**4 - 6 * t * t + 9))
    )
    assert abs(r1.imag) > 0.1
    p, q = r1 * r1, (t * r1) ** 2
    V = 12 * (p * p + 2 * p * q + 5 * q * q) * (p + 3 * q) ** 2
    V -= 9 * q * (p + q) * (-9 * q**3 + 17 * q * q * p + 13 * q * p * p + 3 * p**3)
    H = 21 * p**3 + 32 * p * p + 81 * q * p * p + 192 * p * q + 159 * q * q * p + 27 * q**3 + 288 * q * q
    H += 8 * r1 * np.sqrt(V)  # the other sign belongs to -r1
    square = p * p - q * q
    b1 = q * square * H / (3 * (p + 3 * q) ** 3 * (3 * p - q) ** 2)  # squared
    top = q * square * (3 * q + 32 + 21 * p) - 3 * b1 * (p + 3 * q) * (3 * p - q) ** 2
    cosine = top / (-16 * math.sqrt(3) * r1 * q * square)
    assert cosine**2 == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("t", [0.5, -0.5])
@pytest.mark.parametrize("r1", [0.4, -1.1, 1.7])
def test_roots_at_one_half_are_limits(t, r1):
    exact, near = main_roots(t, r1), main_roots(t * (1 + 1e-8), r1)
    for value in exact.values():
        assert min(abs(value - other) for other in near.values()) < 1e-5 * (1 + abs(value))


def test_counts_on_a_grid():
    counts = real_root_counts(np.array([0.3, 0.52, 0.8]), np.array([0.2, 5.0]))
    assert counts.tolist() == [[4, 0], [4, 0], [4, 0]]


def test_special_limit_falls_from_infinity_at_zero():
    values = [special_limit(t) for t in (0.01, 0.1, 0.3, 0.6, 0.9)]
    assert values[0] > 50
    assert special_limit(-0.3) == values[2]


@pytest.mark.parametrize("t", [0.0, 1.0, -1.0, 1.5, math.nan])
def test_shape_outside_of_its_range_is_refused(t):
    for function in (outer_border, inner_borders, angle_borders, special_limit, lambda x: main_roots(x, 1.0)):
        with pytest.raises(InputError, match="t: "):
            function(t)
    with pytest.raises(InputError, match="r1: must not be 0"):
        main_roots(0.3, 0.0)
