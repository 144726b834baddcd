import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from studies.indices.designs.optimal_domains import (
    TOUCHING_POINT,
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
    for function in (outer_border, inner_borders, special_limit, lambda x: main_roots(x, 1.0)):
        with pytest.raises(InputError, match="t: "):
            function(t)
    with pytest.raises(InputError, match="r1: must not be 0"):
        main_roots(0.3, 0.0)
