"""Tidied functions: the same values in fewer operations."""

from __future__ import annotations

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.parallel.code.leg_plans import count_operations
from ocptip.parallel.code.tidy import tidy

X = [cs.SX.sym(name) for name in "abcd"]


def made(*expressions: cs.SX) -> cs.Function:
    return cs.Function("f", X, list(expressions))


EXPRESSIONS = st.recursive(
    st.sampled_from(X) | st.integers(-2, 2).map(cs.SX),
    lambda inner: st.one_of(
        st.tuples(inner, inner).map(lambda p: p[0] + p[1]),
        st.tuples(inner, inner).map(lambda p: p[0] - p[1]),
        st.tuples(inner, inner).map(lambda p: p[0] * p[1]),
        st.tuples(inner, inner).map(lambda p: p[0] / (2 + cs.sin(p[1]))),
        inner.map(lambda x: -x),
        inner.map(cs.sin),
        inner.map(cs.cos),
        inner.map(lambda x: x * x),
    ),
    max_leaves=25,
)


@given(first=EXPRESSIONS, second=EXPRESSIONS)
def test_value_is_kept_and_work_does_not_grow(first, second):
    plain = made(first, second, first * second - first)
    found = tidy(plain)
    at = [0.7, -1.3, 0.4, 2.1]
    values, expected = np.array(found(*at)).ravel(), np.array(plain(*at)).ravel()
    scale = max(1.0, np.abs(expected).max())
    assert values == pytest.approx(expected, abs=1e-9 * scale)
    merged = cs.Function("f", X, cs.cse([first, second, first * second - first]))
    # A sign that was pulled out may come back as a negation of an output.
    assert count_operations(found).arithmetic <= count_operations(merged).arithmetic + 3


@pytest.mark.parametrize(
    ("expression", "operations"),
    [
        (lambda a, b, c, d: [(a + b) * c, (b + a) * d], (1, 2, 0)),
        (lambda a, b, c, d: [(a - b) * c, (b - a) * d], (2, 2, 0)),
        (lambda a, b, c, d: [a / d + b, b / d, c / d], (1, 3, 1)),
        (lambda a, b, c, d: [a * b + a * c - a * d], (2, 1, 0)),
        (lambda a, b, c, d: [-(a - b)], (1, 0, 0)),
        (lambda a, b, c, d: [-(c * (a - b))], (1, 1, 0)),
        (lambda a, b, c, d: [cs.sin(a - b) + cs.sin(b - a)], (0, 0, 0)),
    ],
)
def test_what_it_finds(expression, operations):
    count = count_operations(tidy(made(*expression(*X))))
    assert (count.additions, count.multiplications, count.divisions) == operations


def test_names_sparsity_and_matrix_inputs_stay():
    x = cs.SX.sym("x", 2, 3)
    sparse = cs.SX(3, 2)
    sparse[1, 0] = x[0, 1] / x[1, 2]
    function = cs.Function(
        "g", [x, cs.SX(0, 1)], [sparse, cs.SX.zeros(2, 2)], ["x", "empty"], ["y", "nought"]
    )
    found = tidy(function)
    assert (found.name(), found.name_in(), found.name_out()) == ("g", ["x", "empty"], ["y", "nought"])
    assert found.sparsity_out(0) == function.sparsity_out(0)
    value = np.arange(1.0, 7.0).reshape(2, 3)
    assert np.array(cs.DM(found(value, [])[0]))[1, 0] == 2 / 6


def test_casadi_simplifies_again_afterwards():
    tidy(made(X[0] * X[1]))
    assert (X[0] * 0).is_zero()


def test_unknown_operation_is_refused():
    with pytest.raises(InputError, match="not known here"):
        tidy(made(cs.atan2(X[0], X[1])))
