"""Bounded Nelder-Mead on standard functions, its three cases of bounds one by one, limits and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import Bounds, LinearConstraint, minimize, rosen

from ocptip.basics.errors import InputError
from studies.baselines.nelder_mead import nelder_mead
from tests.quick import examples


def traced(function):
    """The function, and the list of points it was asked for."""
    points = []

    def wrapped(x):
        points.append(x)
        return function(x)

    return wrapped, points


@pytest.mark.parametrize("adapted", [True, False])
@pytest.mark.parametrize("bounds", [None, [(-2, 2), (-2, 2)]])
def test_rosenbrock(adapted, bounds):
    result = nelder_mead(rosen, [-1.2, 1.0], bounds=bounds, adapted=adapted, tolerance=1e-8)
    assert result.success
    np.testing.assert_allclose(result.x, 1.0, atol=1e-6)
    assert result.fun == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("shift", [0.0, -1e-9, 1e-9, 2e-9])
@pytest.mark.parametrize("adapted", [True, False])
def test_optimum_on_a_bound(adapted, shift):
    """Rosenbrock's function below x = 0.5: the optimum is (0.5, 0.25).

    Points on the bound are tried. The plain simplex ends on it; the adapted one may flatten just beside it:
    of 500 starts that differ by rounding 70 do, by up to 8e-7, with an error of up to 2.3e-5.
    """
    function, points = traced(rosen)
    bounds = Bounds([-2, -1], [0.5, 2])
    result = nelder_mead(function, [-1.2 + shift, 0.5], bounds=bounds, adapted=adapted, tolerance=1e-8)
    assert result.success
    np.testing.assert_allclose(result.x, [0.5, 0.25], atol=1e-4 if adapted else 1e-5)
    assert 0.5 - result.x[0] <= (1e-5 if adapted else 0.0)
    assert np.any(np.array(points)[:, 0] == 0.5)
    assert np.all(points >= bounds.lb)
    assert np.all(points <= bounds.ub)


@pytest.mark.parametrize("adapted", [True, False])
def test_kinks(adapted):
    def kinked(x):
        return max(3 * abs(x[0] - 0.3), abs(x[1] - 0.4)) + abs(x[0] + x[1] - 0.7)

    result = nelder_mead(kinked, [0.45, 0.6], bounds=[(0, 1)] * 2, adapted=adapted, tolerance=1e-9)
    assert result.fun == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_sphere_in_24_dimensions_plain():
    result = nelder_mead(
        lambda x: np.sum((x - 0.3) ** 2),
        np.full(24, 0.6),
        bounds=[(0, 1)] * 24,
        adapted=False,
        tolerance=1e-4,
        maxfev=50_000,
    )
    assert result.success
    assert result.fun < 1e-5


def test_adapted_simplex_flattens_in_24_dimensions():
    """The weights of (D.6) lean so much to few points that the simplex loses dimensions: the volume stops it.

    A finding, not a wish: whoever changes the method should know.
    """
    start = np.random.default_rng(0).uniform(0.1, 0.9, 24)
    result = nelder_mead(
        lambda x: np.sum((x - 0.3) ** 2), start, bounds=[(0, 1)] * 24, tolerance=1e-6, maxfev=50_000
    )
    points = result.final_simplex[0]
    stretches = np.linalg.svd(points[1:] - points[0], compute_uv=False)
    assert result.success
    assert 1e-3 < result.fun < 0.5 * np.sum((start - 0.3) ** 2)
    assert stretches[0] > 1e3 * stretches[-1]


def test_volume_criterion_in_24_dimensions_neither_underflows_nor_ends_at_once():
    """|det V| / n! is below the smallest number from the start; the criterion must not be."""
    edge = 1e-14
    assert edge**24 / math.factorial(24) == 0.0
    result = nelder_mead(
        lambda x: np.sum(x), np.zeros(24), initial_step=edge, tolerance=1e-15, maxfev=400, adapted=False
    )
    assert result.nfev == 400
    assert not result.success


def test_weighted_centroid_is_that_of_d6():
    """First reflection of a known triangle: through the mean weighted with f(worst) - f."""
    simplex = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    values = {(0.0, 0.0): 1.0, (1.0, 0.0): 3.0, (0.0, 1.0): 4.0}
    function, points = traced(lambda x: values.get(tuple(x), 3.5))
    nelder_mead(function, [0, 0], initial_simplex=simplex, maxfev=4)
    centroid = np.array([3 * 0.0 + 1 * 1.0, 0.0]) / 4
    np.testing.assert_allclose(points[3], 2 * centroid - simplex[2])
    function, points = traced(lambda x: values.get(tuple(x), 3.5))
    nelder_mead(function, [0, 0], initial_simplex=simplex, maxfev=4, adapted=False)
    np.testing.assert_allclose(points[3], [1.0, -1.0])


def test_case_1_centroid_on_a_bound_contracts_inside():
    simplex = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
    function, points = traced(lambda x: x[0] + 0.1 * x[1])
    nelder_mead(function, [0, 0], initial_simplex=simplex, bounds=[(0, 2), (-5, 5)], adapted=False, maxfev=4)
    np.testing.assert_allclose(points[3], [0.5, 0.25])  # between centroid (0, 0.5) and (1, 0)


def test_case_2_reflection_is_cut_at_the_bound_and_not_expanded():
    simplex = np.array([[0.2, 0.0], [0.2, 1.0], [1.0, 0.5]])
    function, points = traced(lambda x: x[0] + 1e-3 * x[1])
    nelder_mead(function, [0, 0], initial_simplex=simplex, bounds=[(0, 2), (-5, 5)], adapted=False, maxfev=5)
    np.testing.assert_allclose(points[3], [0.0, 0.5])
    assert points[3][0] == 0.0
    np.testing.assert_allclose(points[4], [0.0, -0.5])  # the next reflection: nothing was expanded


def test_case_3_expansion_is_cut_at_the_bound():
    simplex = np.array([[1.0, 0.0], [1.0, 1.0], [1.6, 0.5]])
    function, points = traced(lambda x: x[0] + 1e-3 * x[1])
    nelder_mead(function, [0, 0], initial_simplex=simplex, bounds=[(0, 2), (-5, 5)], adapted=False, maxfev=5)
    np.testing.assert_allclose(points[3], [0.4, 0.5])
    np.testing.assert_allclose(points[4], [0.0, 0.5])


def test_shrinks_where_contraction_fails():
    """A function that is low at the three corners only."""
    simplex = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    function, points = traced(lambda x: 0.1 * x[1] if tuple(x) in set(map(tuple, simplex)) else 9.0)
    result = nelder_mead(function, [0, 0], initial_simplex=simplex, maxfev=7, adapted=False)
    assert result.shrinks == 1
    np.testing.assert_allclose(points[5:7], [[0.5, 0.0], [0.0, 0.5]])


def test_infinite_and_undefined_values_are_avoided():
    def half_defined(x):
        return np.inf if x[0] > 0.5 else np.nan if x[1] > 0.9 else float(np.sum((x - 0.4) ** 2))

    result = nelder_mead(half_defined, [0.45, 0.85], initial_step=0.2, tolerance=1e-8)
    np.testing.assert_allclose(result.x, 0.4, atol=1e-5)
    assert nelder_mead(lambda x: np.nan, [0.0, 0.0], maxfev=50).fun == np.inf


def test_as_a_method_of_scipy():
    seen = []
    result = minimize(
        lambda x, a: np.sum((x - a) ** 2),
        [0.5, 0.5],
        args=(0.2,),
        method=nelder_mead,
        bounds=Bounds(0, 1),
        callback=seen.append,
        options={"tolerance": 1e-7, "history": True},
    )
    np.testing.assert_allclose(result.x, 0.2, atol=1e-5)
    assert len(seen) == result.nit
    counts, seconds, values = zip(*result.history, strict=True)
    assert list(values) == sorted(values, reverse=True)
    assert values[-1] == result.fun
    assert list(counts) == sorted(counts)
    assert counts[-1] <= result.nfev
    assert list(seconds) == sorted(seconds)


def test_callback_may_stop_and_sees_the_result_so_far():
    def stop(intermediate_result):
        if intermediate_result.fun < 0.01:
            raise StopIteration

    result = nelder_mead(rosen, [-1.2, 1.0], callback=stop)
    assert not result.success
    assert result.fun < 0.01
    assert "callback" in result.message


def test_limits_of_evaluations_and_time():
    function, points = traced(rosen)
    result = nelder_mead(function, [-1.2, 1.0], maxfev=2)  # not even the simplex
    assert result.nfev == len(points) == 2
    assert "maxfev" in result.message
    assert result.fun == pytest.approx(rosen([-1.1, 1.0]))
    result = nelder_mead(function, [-1.2, 1.0], max_seconds=1e-9)
    assert result.nfev == 1
    assert "max_seconds" in result.message


def test_same_input_same_path():
    first, second = (nelder_mead(rosen, [-1.2, 1.0, 0.3], maxfev=300) for _ in range(2))
    np.testing.assert_array_equal(first.final_simplex[0], second.final_simplex[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"x0": []}, "x0: at least one"),
        ({"x0": [np.nan, 0]}, "x0: contains NaN"),
        ({"bounds": [(0, 1)]}, "bounds: expected 2 pairs"),
        ({"bounds": [(0, 1), (1, 1)]}, "bounds: parameter 1 has no room"),
        ({"bounds": [(0, 1), (1, None)]}, "x0: parameter 1 is outside"),
        ({"tolerance": -1}, "tolerance: must be >= 0"),
        ({"maxfev": 0}, "maxfev: must be a whole number"),
        ({"max_seconds": 0}, "max_seconds: must be > 0"),
        ({"initial_step": 0.0}, "initial_step: must be > 0"),
        ({"initial_step": [0.1]}, "initial_step: expected shape 2"),
        ({"initial_simplex": [[0, 0], [1, 1], [2, 2]]}, "initial_simplex: its points lie in a plane"),
        ({"initial_simplex": [[0, 0], [1, 1]]}, "initial_simplex: expected shape 3 x 2"),
        ({"constraints": [1]}, "constraints: only linear ones can be used"),
        ({"jac": rosen}, "jac: this method cannot use it"),
        ({"xatol": 1}, "xatol: there is no such option"),
    ],
)
def test_refusals(arguments, message):
    with pytest.raises(InputError, match=message):
        nelder_mead(rosen, **{"x0": [0.5, 0.5], **arguments})


@pytest.mark.parametrize("adapted", [True, False])
def test_optimum_on_a_linear_limit(adapted):
    """Rosenbrock's function below x + y = 1: SLSQP knows where."""
    function, points = traced(rosen)
    below = LinearConstraint([[1.0, 1.0]], -np.inf, 1.0)
    options = {"tolerance": 1e-9, "adapted": adapted}
    result = minimize(function, [-1.2, 0.5], method=nelder_mead, constraints=below, options=options)
    other = minimize(rosen, [0.0, 0.0], method="SLSQP", constraints=below, tol=1e-14)
    np.testing.assert_allclose(result.x, other.x, atol=1e-4)
    assert result.x.sum() == pytest.approx(1.0, abs=1e-9)
    assert np.all(np.sum(points, axis=1) <= 1 + 1e-11)


@examples(30)
@given(st.integers(0, 2**32 - 1))
def test_no_point_breaks_a_limit_and_what_is_found_is_no_worse_than_near_it(seed):
    """Bounds and two-sided linear limits at once, in three dimensions."""
    rng = np.random.default_rng(seed)
    A, target, x0 = rng.normal(size=(4, 3)), rng.normal(size=3), rng.uniform(-0.2, 0.2, 3)
    limits = LinearConstraint(A, A @ x0 - rng.uniform(0.05, 1, 4), A @ x0 + rng.uniform(0.05, 1, 4))
    function, points = traced(lambda x: float(np.sum((x - target) ** 2)))
    result = nelder_mead(function, x0, bounds=[(-1, 1)] * 3, constraints=limits, tolerance=1e-7)
    rows = np.array(points) @ A.T
    assert np.all(np.abs(points) <= 1)
    assert np.all((rows >= limits.lb - 1e-10) & (rows <= limits.ub + 1e-10))
    assert result.fun <= function(x0)
    best = minimize(function, x0, method="SLSQP", bounds=[(-1, 1)] * 3, constraints=limits)
    assert best.fun <= result.fun + 1e-6


def test_the_simplex_begins_within_linear_limits():
    """A step to the other side, or a shorter one; x0 outside is refused."""
    limit = LinearConstraint([[1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], -np.inf, [0.05, 0.02, 0.02])
    function, points = traced(lambda x: float(np.sum((x - 1) ** 2)))
    nelder_mead(function, [0.0, 0.0], constraints=[limit], maxfev=3)
    np.testing.assert_allclose(points, [[0, 0], [-0.1, 0], [0, 0.0125]])
    with pytest.raises(InputError, match="x0: breaks a linear constraint"):
        nelder_mead(rosen, [0.1, 0.0], constraints=limit)
    with pytest.raises(InputError, match="row 0 leaves no room"):
        nelder_mead(rosen, [0.0, 0.0], constraints=LinearConstraint([[1.0, 1.0]], 0.0, 0.0))
    flat = LinearConstraint([[1.0, 0.0]], 0.0, 1e-14)
    with pytest.raises(InputError, match="leave no room beside it"):
        nelder_mead(rosen, [0.0, 0.0], constraints=flat)
