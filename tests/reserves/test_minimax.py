import clarabel
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.optimize import linprog, minimize

from ocptip.reserves import minimax
from ocptip.reserves.minimax import ConeBatch, minimise_usage
from ocptip.reserves.optimality import lengths, solve_each
from tests.quick import examples, some


def problem(rng, count, n, k, spread=1.0):
    """Random tangential forces, redistributions and limits of 10^spread different magnitudes."""
    rank = min(3, n * k)
    Q = np.array([null_space(rng.normal(size=(rank, n * k))).reshape(n, k, -1) for _ in range(count)])
    return rng.normal(size=(count, n, k)), Q, 10 ** rng.uniform(-spread, 0, (count, n))


def polygon_bound(q, Q, limits, sides=720):
    """Optimum with the circle replaced by the polygon around it: at most 1e-5 too small."""
    n, k, nz = Q.shape
    angles = 2 * np.pi * np.arange(sides) / sides
    directions = np.column_stack([np.cos(angles), np.sin(angles)]) if k == 2 else np.array([[1.0], [-1.0]])
    rows = [np.column_stack([directions @ Q[i], np.full(len(directions), -limits[i])]) for i in range(n)]
    bounds = np.concatenate([-directions @ q[i] for i in range(n)])
    result = linprog(np.r_[np.zeros(nz), 1.0], A_ub=np.vstack(rows), b_ub=bounds, bounds=(None, None))
    assert result.success
    return result.fun


@pytest.mark.parametrize(("n", "k"), some(2, [(3, 2), (4, 2), (6, 2), (4, 1)]))
def test_against_a_linear_program_on_fine_polygons(n, k):
    q, Q, limits = problem(np.random.default_rng(n), 12, n, k)
    optimum = minimise_usage(q, Q, limits)
    assert np.all(optimum.solved)
    lower = np.array([polygon_bound(*data) for data in zip(q, Q, limits, strict=True)])
    np.testing.assert_allclose(optimum.usage, lower, rtol=2e-5)


def test_against_slsqp():
    q, Q, limits = problem(np.random.default_rng(3), 10, 4, 2)
    optimum = minimise_usage(q, Q, limits)
    for s in range(len(q)):

        def slack(x, s=s):
            return (x[0] * limits[s]) ** 2 - np.sum((q[s] + Q[s] @ x[1:]) ** 2, axis=1)

        start = np.r_[np.max(lengths(q[s]) / limits[s]) + 1, np.zeros(Q.shape[3])]
        found = minimize(
            lambda x: x[0], start, constraints={"type": "ineq", "fun": slack}, method="SLSQP",
            bounds=[(0, None)] + [(None, None)] * Q.shape[3], options={"ftol": 1e-12, "maxiter": 500},
        )  # fmt: skip
        assert found.success
        assert optimum.usage[s] == pytest.approx(found.x[0], rel=1e-6)


@examples(40)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 8), spread=st.floats(0, 8))
def test_bounds_meet_and_the_forces_are_redistributions(seed, n, spread):
    q, Q, limits = problem(np.random.default_rng(seed), 5, n, 2, spread)
    optimum = minimise_usage(q, Q, limits)
    assert np.all(optimum.solved)
    np.testing.assert_allclose(np.max(lengths(optimum.forces) / limits, axis=1), optimum.usage, rtol=1e-9)
    change = (optimum.forces - q).reshape(5, -1)
    for s in range(5):
        basis = Q[s].reshape(change.shape[1], -1)
        np.testing.assert_allclose(basis @ (basis.T @ change[s]), change[s], atol=1e-7)


@pytest.mark.parametrize("n", [3, 5])
def test_multipliers_are_the_derivative(n):
    rng = np.random.default_rng(8)
    q, Q, limits = problem(rng, 30, n, 2)
    optimum = minimise_usage(q, Q, limits)
    dq, dl, h = rng.normal(size=q.shape), rng.normal(size=limits.shape) * limits, 1e-5
    ahead, behind = (minimise_usage(q + s * h * dq, Q, limits + s * h * dl).usage for s in (1, -1))
    predicted = np.einsum("sik,sik->s", optimum.pull, dq)
    predicted -= optimum.usage * np.einsum("si,si->s", lengths(optimum.pull), dl)
    errors = np.abs((ahead - behind) / (2 * h) - predicted) / np.abs(predicted)
    assert np.quantile(errors, 0.9) < 1e-7  # the others are near a change of the active contacts
    assert np.max(errors) < 1e-3


def test_usage_scales_with_the_forces_and_against_the_limits():
    q, Q, limits = problem(np.random.default_rng(5), 4, 4, 2)
    usage = minimise_usage(q, Q, limits).usage
    np.testing.assert_allclose(minimise_usage(q * 1e6, Q, limits).usage, usage * 1e6, rtol=1e-9)
    np.testing.assert_allclose(minimise_usage(q, Q, limits * 1e6).usage, usage / 1e6, rtol=1e-9)


def test_nothing_to_hold_needs_no_program(monkeypatch):
    monkeypatch.setattr(minimax, "ConeBatch", None)
    _, Q, limits = problem(np.random.default_rng(5), 4, 4, 2)
    z = np.ones((4, Q.shape[3]))
    internal = np.einsum("sikz,sz->sik", Q, z)
    optimum = minimise_usage(internal, Q, limits)
    np.testing.assert_array_less(optimum.usage, 1e-9)
    np.testing.assert_array_equal(optimum.pull, 0)
    assert list(optimum.status) == ["direct"] * 4


def test_nothing_to_redistribute_needs_no_program(monkeypatch):
    monkeypatch.setattr(minimax, "ConeBatch", None)
    q, limits = np.array([[[3.0, 4.0], [1.0, 0.0]]]), np.array([[10.0, 4.0]])
    optimum = minimise_usage(q, np.zeros((1, 2, 2, 0)), limits)
    assert optimum.usage[0] == 0.5
    np.testing.assert_allclose(optimum.pull, [[[0.06, 0.08], [0, 0]]])


def test_a_failing_solver_is_reported(monkeypatch):
    def hopeless(self, A, b):
        return (
            np.full((len(A), A.shape[2]), np.nan),
            np.full(b.shape, np.nan),
            np.full(len(A), "NumericalError"),
        )

    monkeypatch.setattr(ConeBatch, "solve", hopeless)
    q, Q, limits = problem(np.random.default_rng(5), 3, 4, 2)
    optimum = minimise_usage(q, Q, limits)
    assert not np.any(optimum.solved)
    assert np.all(np.isinf(optimum.gap))
    usage = np.max(lengths(optimum.forces) / limits, axis=1)
    np.testing.assert_allclose(optimum.usage, usage)  # still an upper bound


def test_cone_batch_gives_no_point_where_a_program_is_infeasible():
    structure = np.ones((2, 1), dtype=bool)
    batch = ConeBatch(structure, [clarabel.NonnegativeConeT(2)], 1e-9, equilibrate=True)
    A = np.array([[[1.0], [-1.0]], [[1.0], [-1.0]]])
    x, _, status = batch.solve(A, np.array([[1.0, 1.0], [-1.0, -1.0]]))
    assert x[0, 0] == pytest.approx(-1.0)
    assert np.isnan(x[1, 0])
    assert status[1] == "PrimalInfeasible"


def test_singular_systems_do_not_stop_the_others():
    matrices = np.array([np.eye(2), np.zeros((2, 2)), np.full((2, 2), np.nan)])
    solution = solve_each(matrices, np.ones((3, 2)))
    np.testing.assert_array_equal(solution, [[1, 1], [np.nan, np.nan], [np.nan, np.nan]])
