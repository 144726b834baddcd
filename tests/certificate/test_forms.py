"""Enclosures hold what they claim: against ball arithmetic, on purpose at the edge of what rounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.certificate.trusted.forms import ORDER, Form, cos_sin, linear

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
