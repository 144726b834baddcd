"""Ipopt on programs written in NumPy: known optima, signs of multipliers, exceptions, limits."""

import signal
import time

import numpy as np
import pytest

from ocptip.numerics.ipopt import _Function, solve


class HockSchittkowski71:
    """min x1 x4 (x1 + x2 + x3) + x3 with x1 x2 x3 x4 >= 25, |x|^2 = 40, 1 <= x <= 5."""

    start = np.array([1.0, 5.0, 5.0, 1.0])
    x_bounds = np.ones(4), np.full(4, 5.0)
    bounds = np.array([25.0, 40.0]), np.array([np.inf, 40.0])
    optimum = np.array([1.0, 4.74299963, 3.82114998, 1.37940829])
    objective = 17.0140173

    def values(self, x):
        return x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2], np.array([np.prod(x), x @ x])

    def gradient(self, x):
        total = x[0] + x[1] + x[2]
        return np.array([x[3] * (total + x[0]), x[0] * x[3], x[0] * x[3] + 1, x[0] * total])

    def jacobian(self, x):
        return np.array([np.prod(x) / x, 2 * x])

    def hessian(self, x, sigma, multipliers):
        a, b, c, d = x
        objective = np.array(
            [[2 * d, d, d, 2 * a + b + c], [d, 0, 0, a], [d, 0, 0, a], [2 * a + b + c, a, a, 0]]
        )
        product = np.prod(x) / np.outer(x, x)
        np.fill_diagonal(product, 0)
        return sigma * objective + multipliers[0] * product + multipliers[1] * 2 * np.eye(4)


class Parabola:
    """min (x - target)^2 / 2 with one row, x itself; keeps count of its evaluations."""

    def __init__(self, target):
        self.target = target

    def values(self, x):
        return 0.5 * float(np.sum((x - self.target) ** 2)), x.copy()

    def gradient(self, x):
        return x - self.target

    def jacobian(self, x):
        return np.eye(len(x))

    def hessian(self, x, sigma, multipliers):
        return sigma * np.eye(len(x))


FREE = np.full(1, -10.0), np.full(1, 10.0)


def hs071(program=None, **options):
    program = program or HockSchittkowski71()
    return solve(program, program.start, program.x_bounds, program.bounds, **options)


def test_published_optimum():
    solution = hs071(tolerance=1e-9)
    assert solution.converged
    assert solution.status == "Solve_Succeeded"
    np.testing.assert_allclose(solution.x, HockSchittkowski71.optimum, atol=1e-6)
    assert solution.objective == pytest.approx(HockSchittkowski71.objective, abs=1e-6)
    assert solution.violation < 1e-8
    assert 0 < solution.iterations < 30
    assert solution.seconds > 0


def test_multipliers_make_the_gradient_of_the_lagrangian_vanish():
    solution, program = hs071(tolerance=1e-9), HockSchittkowski71()
    np.testing.assert_allclose(solution.multipliers, [-0.55229366, 0.16146857], atol=1e-6)  # published
    gradient = program.gradient(solution.x) + solution.multipliers @ program.jacobian(solution.x)
    assert gradient[0] == pytest.approx(1.0878712, abs=1e-5)  # held at its lower bound
    np.testing.assert_allclose(gradient[1:], 0, atol=1e-6)


@pytest.mark.parametrize(
    ("target", "low", "high", "expected"), [(3, -1, 1, 2), (-3, -1, 1, -2), (0.5, -1, 1, 0)]
)
def test_multipliers_are_positive_at_upper_and_negative_at_lower_bounds(target, low, high, expected):
    bounds = np.full(1, float(low)), np.full(1, float(high))
    solution = solve(Parabola(target), np.zeros(1), FREE, bounds, tolerance=1e-9)
    assert solution.converged
    assert solution.x[0] == pytest.approx(np.clip(target, low, high), abs=1e-6)
    assert solution.multipliers[0] == pytest.approx(expected, abs=1e-5)


def test_start_outside_the_bounds_is_moved_inside():
    solution = solve(Parabola(0.5), np.full(1, 99.0), FREE, (np.full(1, -5.0), np.full(1, 5.0)))
    assert solution.converged
    assert solution.x[0] == pytest.approx(0.5, abs=1e-4)


def test_an_infeasible_program_does_not_converge_and_says_by_how_much():
    solution = solve(Parabola(0.0), np.zeros(1), FREE, (np.full(1, 12.0), np.full(1, np.inf)))
    assert not solution.converged
    assert solution.violation >= 2.0 - 1e-6


def test_iteration_limit_is_not_convergence():
    solution = hs071(max_iterations=2)
    assert not solution.converged
    assert solution.iterations == 2
    assert solution.status == "Maximum_Iterations_Exceeded"
    assert solution.violation > 1e-6


def test_time_limit_is_not_convergence():
    class Slow(HockSchittkowski71):
        def gradient(self, x):
            time.sleep(0.02)
            return super().gradient(x)

    solution = hs071(Slow(), seconds=0.05)
    assert not solution.converged
    assert solution.iterations < 8


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, SystemExit])
@pytest.mark.parametrize("where", ["values", "gradient", "jacobian", "hessian"])
def test_what_a_function_raises_comes_out(where, error):
    class Failing(HockSchittkowski71):
        pass

    calls = []

    def fail(self, *arguments):
        calls.append(arguments)
        if len(calls) > 2:
            raise error("in the middle")
        return getattr(HockSchittkowski71, where)(self, *arguments)

    setattr(Failing, where, fail)
    with pytest.raises(error, match="in the middle"):
        hs071(Failing())
    assert len(calls) == 3  # and at once


@pytest.mark.parametrize("where", ["get_n_in", "has_eval_buffer", "eval_buffer"])
def test_an_interrupt_in_code_of_the_solver_comes_out(where, monkeypatch):
    """CasADi ends with a status, or with an error of its own, where a handler raises in its code."""
    inner, before = getattr(_Function, where), signal.getsignal(signal.SIGINT)

    def interrupted(self, *arguments):
        result = inner(self, *arguments)
        signal.raise_signal(signal.SIGINT)
        return result

    monkeypatch.setattr(_Function, where, interrupted)
    with pytest.raises(KeyboardInterrupt):
        hs071()
    assert signal.getsignal(signal.SIGINT) is before
