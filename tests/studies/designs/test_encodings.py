import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from ocptip.basics.errors import InputError
from ocptip.indices.arms.symbolic import isotropy_surrogate, soft_smallest_eigenvalue
from studies.indices.designs.encodings import PIVOT_MARGIN, psd_constraint, ratio_constraint
from tests.indices.sample_platforms import SEEDS
from tests.quick import examples

SX = cs.SX.sym("A", 4, 4)


def random_spd(rng, m, spread=1.0):
    Q = np.linalg.qr(rng.normal(size=(m, m)))[0]
    return (Q * np.exp(spread * rng.normal(size=m))) @ Q.T


def evaluated(expression, *pairs):
    function = cs.Function("f", [symbol for symbol, _ in pairs], [expression])
    return np.array(function(*[value for _, value in pairs]))


@examples(40)
@given(SEEDS, st.floats(0.2, 3), st.sampled_from([cs.SX, cs.MX]))
def test_pivots_have_the_signs_of_the_eigenvalues(seed, floor, kind):
    A = random_spd(np.random.default_rng(seed), 4)
    symbol = kind.sym("A", 4, 4)
    block = psd_constraint(symbol, floor=floor, method="ldl")
    pivots = evaluated(block.g, (symbol, A)).ravel()
    pivots[:-1] += PIVOT_MARGIN
    values = np.linalg.eigvalsh(A) - floor
    assert (pivots > 0).sum() == (values > 0).sum()
    assert np.prod(pivots) == pytest.approx(np.prod(values), rel=1e-6)
    assert block.variables.shape[0] == 0
    assert block.guess(A).shape == (0,)


@examples(40)
@given(SEEDS, st.floats(-1.0, 0.9))
def test_lifted_start_is_feasible_where_the_matrix_is(seed, share):
    A = random_spd(np.random.default_rng(seed), 4)
    floor = share * np.linalg.eigvalsh(A)[0]
    block = psd_constraint(SX, floor=floor, method="lifted")
    start = block.guess(A)
    g = evaluated(block.g, (SX, A), (block.variables, start)).ravel()
    assert block.variables.shape[0] == len(start) == 10
    if np.linalg.eigvalsh(A)[0] - floor > 1e-2 * np.linalg.eigvalsh(A)[-1]:
        assert (g >= block.lower - 1e-9 * np.abs(A).max()).all()
        assert (g <= block.upper + 1e-9 * np.abs(A).max()).all()


@examples(40)
@given(SEEDS, st.sampled_from([1, 2, 4, 8]))
def test_soft_eigenvalue_is_conservative(seed, p):
    A = random_spd(np.random.default_rng(seed), 4)
    soft = float(evaluated(soft_smallest_eigenvalue(SX, p), (SX, A))[0, 0])
    smallest = np.linalg.eigvalsh(A)[0]
    assert 4 ** (-1 / p) * smallest <= soft * (1 + 1e-9)
    assert soft <= smallest * (1 + 1e-9)
    block = psd_constraint(SX, floor=0.1, method="trace", p=p)
    g = evaluated(block.g, (SX, A)).ravel()
    assert g[0] == pytest.approx(soft - 0.1)
    assert (g[1:] > 0).all()
    assert evaluated(block.g, (SX, A - 1.01 * smallest * np.eye(4))).ravel()[1:].min() < 0


@examples(40)
@given(SEEDS, st.sampled_from([1, 2, 4, 8]), st.floats(1e-3, 1e3))
def test_surrogate_bounds_the_index(seed, p, scale):
    rng = np.random.default_rng(seed)
    A, B = random_spd(rng, 4), random_spd(rng, 4)
    second = cs.SX.sym("B", 4, 4)
    surrogate = float(evaluated(isotropy_surrogate(SX, second, p), (SX, A), (second, scale * B))[0, 0])
    values = eigh(B, A, eigvals_only=True)
    index = np.sqrt(values[0] / values[-1])
    assert index * (1 - 1e-9) <= surrogate <= 4 ** (1 / p) * index * (1 + 1e-9)
    same = float(evaluated(isotropy_surrogate(SX, second, p), (SX, A), (second, 3.0 * A))[0, 0])
    assert same == pytest.approx(1.0, abs=1e-9)


@examples(40)
@given(SEEDS, st.sampled_from(["ldl", "lifted"]), st.floats(0.5, 1.5))
def test_ratio_is_met_at_the_start_exactly_where_the_index_is(seed, method, share):
    rng = np.random.default_rng(seed)
    A, B = random_spd(rng, 4, 0.3), random_spd(rng, 4, 0.3)
    second = cs.SX.sym("B", 4, 4)
    values = eigh(B, A, eigvals_only=True)
    index = np.sqrt(values[0] / values[-1])
    bound = min(share * index, 1.0)
    block = ratio_constraint(SX, second, bound, method=method)
    start = block.guess(A, B)
    g = evaluated(block.g, (SX, A), (second, B), (block.variables, start)).ravel()
    violation = max(np.max(block.lower - g), np.max(g - block.upper))
    if bound < 0.9 * index:
        assert violation < 1e-9 * max(np.abs(A).max(), np.abs(B).max()) + 1e-9
    elif bound > 1.01 * index:
        assert violation > 1e-6


def test_trace_form_of_the_ratio_is_conservative():
    rng = np.random.default_rng(0)
    A, B = random_spd(rng, 4, 0.3), random_spd(rng, 4, 0.3)
    second = cs.SX.sym("B", 4, 4)
    values = eigh(B, A, eigvals_only=True)
    index = np.sqrt(values[0] / values[-1])
    block = ratio_constraint(SX, second, 0.2, method="trace", p=8)
    g = evaluated(block.g, (SX, A), (second, B))[0, 0]
    assert index * 4 ** (-1 / 8) - 0.2 <= g + 1e-9
    assert g <= index - 0.2 + 1e-9


@pytest.mark.parametrize("method", ["ldl", "lifted", "trace"])
def test_largest_smallest_eigenvalue_is_found(method):
    """max t such that D(x) >= t, D = diag(1 + x, 2 - x, 3) turned: t = 1.5, where two eigenvalues meet."""
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    x, t = cs.SX.sym("x"), cs.SX.sym("t")
    A = cs.DM(Q) @ cs.diag(cs.vertcat(1 + x, 2 - x, 3)) @ cs.DM(Q.T)
    block = psd_constraint(A, floor=t, method=method, p=8)
    variables = cs.vertcat(x, t, block.variables)
    numeric = Q @ np.diag([1.2, 1.8, 3.0]) @ Q.T
    start = np.concatenate([[0.2, 0.5], block.guess(numeric)])
    solver = cs.nlpsol(
        "s",
        "ipopt",
        {"x": variables, "f": -t, "g": block.g},
        {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}},
    )
    solution = solver(x0=start, lbg=block.lower, ubg=block.upper)
    assert solver.stats()["success"]
    found = float(solution["x"][1])
    least = min(1 + float(solution["x"][0]), 2 - float(solution["x"][0]))
    assert found <= least + 1e-7
    low = {"lifted": 1.5 - 1e-6, "ldl": 1.499, "trace": 3 ** (-1 / 8) * 1.5}[method]
    assert low <= found


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: psd_constraint(cs.SX.sym("A", 2, 3)), "A: expected a square SX or MX matrix"),
        (lambda: psd_constraint(np.eye(3)), "A: expected a square SX or MX matrix, got ndarray"),
        (lambda: psd_constraint(SX, method="minors"), "method: expected one of ldl, lifted, trace"),
        (lambda: psd_constraint(SX, method="trace", p=3), "p: expected a power of two, got 3"),
        (lambda: ratio_constraint(SX, SX, 1.2), "ratio: an index is at most 1"),
        (lambda: ratio_constraint(SX, SX, 0.0), "ratio: must be > 0"),
        (lambda: ratio_constraint(SX, SX, 0.5, method="x"), "method: expected one of"),
        (lambda: isotropy_surrogate(SX, cs.SX.sym("B", 3, 3)), "B: expected the same kind and shape"),
        (lambda: isotropy_surrogate(SX, cs.MX.sym("B", 4, 4)), "B: expected the same kind and shape"),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
