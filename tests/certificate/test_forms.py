"""Enclosures hold what they claim: against ball arithmetic, on purpose at the edge of what rounds."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.certificate.trusted.forms import ORDER, Form, K, cos_sin, length, linear, numbers_of
from ocptip.certificate.trusted.within import _sides

flint = pytest.importorskip("flint")
from tests.oracles import arm_in_balls as balls  # noqa: E402

numbers = st.floats(-1e3, 1e3).map(lambda x: x if abs(x) > 1e-60 else 0.0)
coefficients = st.lists(numbers, min_size=1, max_size=ORDER + 1)
places = st.sampled_from([-1.0, -0.7, 0.0, 0.3, 1.0])
WIDTH = flint.arb("1e-70")  # of the balls themselves
radii = st.sampled_from([0.0, 1e-12, 0.1])


def _form(c, radius):
    return Form.of(*(np.array([x]) for x in c), radius=np.array([radius]))


def _inside(form, value, s):
    """Whether a ball is within the form at s; both ends of the ball."""
    middle = balls.polynomial(form.c[:, 0], flint.arb(s))
    return abs(value - middle) <= flint.arb(float(form.r[0])) + WIDTH


@given(coefficients, coefficients, radii, radii, places, st.sampled_from([-1.0, 0.0, 1.0]))
def test_operations_enclose(a, b, ra, rb, s, side):
    f, g = _form(a, ra), _form(b, rb)
    u = flint.arb(s)
    x = balls.polynomial(a, u) + flint.arb(side * ra)
    y = balls.polynomial(b, u) - flint.arb(side * rb)
    assert _inside(f + g, x + y, s)
    assert _inside(f - g, x - y, s)
    assert _inside(f * g, x * y, s)
    assert _inside(f * 0.1, x * flint.arb(0.1), s)
    both = Form(np.concatenate([f.c, g.c], axis=1)[:, :, None], np.concatenate([f.r, g.r])[:, None])
    matrix = np.array([[0.1, -0.7], [1e6, 1e-6]])
    for row, found in zip(matrix, (linear(matrix, both)[k] for k in range(2)), strict=True):
        assert _inside(found, flint.arb(row[0]) * x + flint.arb(row[1]) * y, s)
    low, high = f.range
    assert flint.arb(float(low[0])) - WIDTH <= x <= flint.arb(float(high[0])) + WIDTH


@given(st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=4), st.floats(-7, 7), places)
def test_cosine_and_sine_enclose(bends, middle, s):
    q = _form([middle, *bends], 1e-9)
    for side in (-1, 0, 1):
        value = balls.polynomial([middle, *bends], flint.arb(s)) + side * flint.arb(1e-9)
        cosine, sine = cos_sin(q)
        assert _inside(cosine, value.cos(), s)
        assert _inside(sine, value.sin(), s)


def test_range_is_that_of_the_polynomial_at_its_ends():
    f = _form([0.2, -0.5, 0.1], 0.0)
    low, high = f.range
    assert high[0] == pytest.approx(0.8, abs=1e-12)  # at s = -1, where Bernstein coefficients are exact
    assert low[0] == pytest.approx(-0.2, abs=1e-12)


@pytest.mark.parametrize("m", [1, 3])
def test_halves_of_a_number_are_the_form_there(m):
    rng, (_, i, j) = np.random.default_rng(m), numbers_of(length(m))

    def at(form, s, e):
        c = form.c[:, 0]
        slopes = c[K : K + m] + s * c[K + m : K + 2 * m]
        return c[:K] @ s ** np.arange(K) + slopes @ e + c[K + 2 * m :] @ (e[i] * e[j])

    form = Form(rng.normal(size=(length(m), 1)), np.zeros(1))
    for k in range(m):
        for side in (-1.0, 1.0):
            s, e = rng.uniform(-1, 1), rng.uniform(-1, 1, m)
            whole = np.where(np.arange(m) == k, 0.5 * (side + e), e)
            assert at(form.half(k, side), s, e) == pytest.approx(at(form, s, whole), abs=1e-13)


def test_no_numbers_give_less_than_the_ends_and_what_goes_beyond_them():
    """Sums of numbers in [-1, 1] and of their products, at corners and inside."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        m = int(rng.integers(1, 6))
        i, j = np.triu_indices(m)
        slopes = rng.normal(size=m) * 10 ** rng.uniform(-2, 1, m)
        bends = rng.normal(size=len(i)) * (rng.random(len(i)) < 0.6)
        ends, beyond = _sides(list(slopes[:, None, None, None]), bends[:, None, None], i, j)
        bound = np.ravel(ends) @ slopes + bends @ (np.ravel(ends)[i] * np.ravel(ends)[j])
        bound -= 2 * np.sum(np.maximum(beyond, 0.0))
        e = np.vstack([list(product([-1.0, 1.0], repeat=m)), rng.uniform(-1, 1, (200, m))])
        assert np.min(e @ slopes + (e[:, i] * e[:, j]) @ bends) >= bound - 1e-12
