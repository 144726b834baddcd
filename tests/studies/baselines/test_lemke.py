"""Lemke's method: textbook problems, degenerate ones against exact arithmetic, honest failure."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from studies.baselines.lemke import solve_lcp, solve_lcp_many
from tests.oracles.exact_lemke import exact_lemke, natural_residual, rational
from tests.quick import examples

RULES = ("textbook", "lexicographic", "largest-pivot")
CAREFUL = ("lexicographic", "largest-pivot")

# name: matrix, vector, solution (None: Lemke's method ends on a ray)
PROBLEMS = {
    "Murty 2.8": (
        [[1, -1, -1, -1], [-1, 1, -1, -1], [1, 1, 2, 0], [1, 1, 0, 2]],
        [3, 5, -9, -5],
        [2, 1, 3, 1],
    ),
    "Murty 2.9": ([[-1, 0, -3], [1, -2, -5], [-2, -1, -2]], [-3, -2, -1], None),
    "Kostreva 1": ([[1, 2, 0], [0, 1, 2], [2, 0, 1]], [-1, -1, -1], [1 / 3, 1 / 3, 1 / 3]),
    "Kostreva 2": ([[1, -1, 3], [2, -1, 3], [-1, -2, 0]], [-1, -1, -1], None),
    "no solution": ([[-1]], [-1], None),
    "one unknown": ([[4]], [-2], [0.5]),
    "equal entries": ([[2, 1], [1, 2]], [-1, -1], [1 / 3, 1 / 3]),
    "nothing to do": ([[-1, 3], [2, -5]], [0, 2], [0, 0]),
}

# Kostreva's examples are the classic ones on which the method cycles without care for ties.
CYCLES = {("Kostreva 1", "textbook"), ("Kostreva 2", "textbook"), ("Kostreva 2", "largest-pivot")}


def exponential_problem(n):
    """Murty's lower triangular family, on which the number of pivots doubles with every row."""
    M = np.eye(n) + 2.0 * np.tri(n, k=-1)
    q = -np.cumsum(2.0 ** np.arange(n, 0, -1))
    return M, q


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("rule", RULES)
def test_textbook_problems(name, rule):
    M, q, expected = PROBLEMS[name]
    answer = solve_lcp(M, q, rule)
    if (name, rule) in CYCLES:
        assert answer.status == "pivot limit"
    elif expected is None:
        assert answer.status == "ray"
    else:
        assert answer.status == "solved"
        np.testing.assert_allclose(answer.z, expected, atol=1e-14)
        np.testing.assert_allclose(answer.w, np.array(M) @ answer.z + q)


@pytest.mark.parametrize("name", PROBLEMS)
def test_textbook_problems_exactly(name):
    M, q, expected = PROBLEMS[name]
    M, q = rational(M), rational(q)
    z, solved, _ = exact_lemke(M, q)
    assert solved == (expected is not None)
    if solved:
        assert natural_residual(M, q, z) == 0
        np.testing.assert_allclose([float(x) for x in z], expected, rtol=1e-15)


def test_exact_oracle_has_no_rounding():
    M, q, _ = PROBLEMS["Kostreva 1"]
    assert exact_lemke(rational(M), rational(q)).z == [Fraction(1, 3)] * 3


def test_nothing_to_do_takes_no_pivots():
    M, q, _ = PROBLEMS["nothing to do"]
    assert solve_lcp(M, q).pivots == 0


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("n", [4, 6])
def test_exponential_family_takes_two_to_the_n_pivots(n, rule):
    M, q = exponential_problem(n)
    answer = solve_lcp(M, q, rule)
    assert answer.solved
    assert answer.pivots == 2**n
    assert exact_lemke(rational(M), rational(q)).pivots == 2**n


def test_pivot_limit_is_reported():
    M, q = exponential_problem(6)
    answer = solve_lcp(M, q, max_pivots=63)
    assert answer.status == "pivot limit"
    assert answer.pivots == 63
    assert not answer.solved


@pytest.mark.parametrize("rule", CAREFUL)
@pytest.mark.parametrize("factor", [1e-15, 1e-6, 1.0, 1e9])
def test_size_of_the_vector_does_not_matter(factor, rule):
    M, q, expected = PROBLEMS["Murty 2.8"]
    answer = solve_lcp(M, factor * np.array(q), rule)
    assert answer.solved
    np.testing.assert_allclose(answer.z, factor * np.array(expected), rtol=1e-12)


def test_success_is_verified_on_the_original_data():
    rng = np.random.default_rng(3)
    A = rng.normal(size=(12, 12))
    M, q = A @ A.T, rng.normal(size=12)
    answer = solve_lcp(M, q)
    assert answer.solved
    assert answer.residual == pytest.approx(np.max(np.abs(np.minimum(answer.z, M @ answer.z + q))), rel=1e-3)
    assert 0.0 < answer.residual < 1e-12
    assert solve_lcp(M, q, accuracy=1e-20).status == "inaccurate"


def test_a_residual_lost_in_rounding_is_no_success():
    """The textbook rule pivots on 1e-16 and finds z = 4.5e15, where M z swallows q: there is no solution."""
    M = [[4, 0, 4, -2, 0], [0] * 5, [4, 0, 4, -4, 0], [-6, 0, -4, 4, 0], [0] * 5]
    q = [-1, 0, -1, -1, 0]
    assert not exact_lemke(rational(M), rational(q)).solved
    for rule in RULES:
        assert not solve_lcp(M, q, rule).solved


def test_residual_of_a_failure_is_reported():
    answer = solve_lcp([[-1.0]], [-1.0])
    assert answer.residual == 1.0
    assert answer.z.tolist() == [0.0]


@pytest.mark.parametrize("rule", RULES)
def test_batch_equals_single_solves(rule):
    rng = np.random.default_rng(8)
    A = rng.normal(size=(7, 7))
    M, Q = A @ A.T + 0.1 * (A - A.T), rng.normal(size=(20, 7))
    batch = solve_lcp_many(M, Q, rule)
    assert batch.solved.all()
    for k, q in enumerate(Q):
        single = solve_lcp(M, q, rule)
        np.testing.assert_array_equal(batch.z[k], single.z)
        assert (batch.status[k], batch.pivots[k], batch.residual[k]) == (
            single.status,
            single.pivots,
            single.residual,
        )


def test_batch_of_none():
    batch = solve_lcp_many(np.eye(3), np.empty((0, 3)))
    assert batch.z.shape == (0, 3)
    assert batch.solved.shape == (0,)


def test_results_go_to_json():
    M, q, _ = PROBLEMS["Murty 2.8"]
    assert json.loads(json.dumps(solve_lcp(M, q).to_dict()))["status"] == "solved"
    assert json.loads(json.dumps(solve_lcp_many(M, [q]).to_dict()))["status"] == ["solved"]


def test_data_are_not_changed():
    M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-1.0, -3.0])
    before = M.copy(), q.copy()
    solve_lcp(M, q)
    np.testing.assert_array_equal(M, before[0])
    np.testing.assert_array_equal(q, before[1])


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (([[1.0]], [1.0, 2.0]), "M"),
        (([[np.nan]], [1.0]), "M"),
        (([[1.0]], [np.inf]), "q"),
        (([[1.0]], [[1.0]]), "q"),
        ((np.empty((0, 0)), []), "q"),
        (([[1.0]], [-1.0], "bland"), "rule"),
        (([[1.0]], [-1.0], "textbook", -1), "max_pivots"),
        (([[1.0]], [-1.0], "textbook", 2.5), "max_pivots"),
    ],
)
def test_unusable_input_is_refused(arguments, word):
    with pytest.raises(InputError, match=word):
        solve_lcp(*arguments)


@st.composite
def degenerate_problems(draw):
    """Small integer problems with a positive semidefinite matrix of low rank: full of ties.

    On such a matrix a ray proves that no solution exists, so that two correct methods must agree on it.
    """
    n = draw(st.integers(1, 6))
    rank = draw(st.integers(0, 3))
    entries = st.integers(-2, 2)
    B = np.array(draw(st.lists(st.lists(entries, min_size=n, max_size=n), min_size=rank, max_size=rank)))
    B = B.reshape(rank, n)
    K = np.array(draw(st.lists(st.lists(entries, min_size=n, max_size=n), min_size=n, max_size=n)))
    q = np.array(draw(st.lists(entries, min_size=n, max_size=n)))
    return B.T @ B + K - K.T, q


@examples(300)
@given(degenerate_problems())
def test_degenerate_problems_agree_with_exact_arithmetic(problem):
    M, q = problem
    exact = exact_lemke(rational(M), rational(q))
    answer = solve_lcp(M, q, "lexicographic")
    assert answer.status == ("solved" if exact.solved else "ray")
    if exact.solved:
        assert natural_residual(rational(M), rational(q), exact.z) == 0
        assert solve_lcp(M, q, "largest-pivot").status in ("solved", "pivot limit")
    assert not (solve_lcp(M, q, "textbook").solved and not exact.solved)


@examples(100)
@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_positive_definite_problems_have_one_solution(n, seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    M, q = A @ A.T + np.eye(n), rng.normal(size=n)
    answers = [solve_lcp(M, q, rule) for rule in RULES]
    assert all(answer.solved for answer in answers)
    for answer in answers[1:]:
        np.testing.assert_allclose(answer.z, answers[0].z, atol=1e-9)
