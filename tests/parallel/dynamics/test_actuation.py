"""Redundant motors: least norm, weights, limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.dynamics.terms import limited_motor_forces, motor_forces
from tests.parallel.parallel_cases import error, random_state
from tests.quick import examples, some


def problem(seed: int, motors: int = 5, m: int = 3):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (motors, m)), rng.uniform(-10, 10, m), rng.uniform(0.5, 2, motors)


def test_extra_motor_on_a_3rrr():
    """A motor on a passive joint: the row of J_a is there, the forces get smaller."""
    state = random_state("3RRR", 3)
    robot = dataclasses.replace(state.robot, actuated=(*state.robot.actuated, (1, 1)))
    found = lean_function(robot, ("tau", "J_a"), form="S")(state.z, state.s, state.sd, state.q)
    plain = lean_function(state.robot, form="A")(state.z, state.s, state.sd, state.q)["tau"]
    shared = motor_forces(found["J_a"], found["tau"])
    assert shared.residual < 1e-12
    assert np.linalg.norm(shared.forces) <= np.linalg.norm(plain)
    assert shared.null_space.shape == (4, 1)
    assert np.abs(found["J_a"].T @ shared.null_space).max() < 1e-12


@examples(40)
@given(seed=st.integers(0, 10**6))
def test_weighted_minimum_is_the_closed_formula(seed):
    J, tau, w = problem(seed)
    inverse = np.diag(1 / w)
    expected = inverse @ J @ np.linalg.solve(J.T @ inverse @ J, tau)
    found = motor_forces(J, tau, weights=w)
    assert error(found.forces, expected) < 1e-8
    assert found.residual < 1e-9
    # Orthogonal to the null space in the weighted inner product: no smaller solution exists.
    assert np.abs(found.null_space.T @ (w * found.forces)).max() < 1e-8 * np.abs(found.forces).max()
    assert found.status == "closed form"


@examples(30)
@given(seed=st.integers(0, 10**6))
def test_wide_limits_change_nothing(seed):
    J, tau, w = problem(seed)
    free = motor_forces(J, tau, weights=w)
    infinite = np.full(5, np.inf)
    found = limited_motor_forces(J, tau, -infinite, infinite, weights=w)
    assert error(found.forces, free.forces) < 1e-6
    assert not found.at_limit.any()


@pytest.mark.parametrize("seed", some(2, range(5)))
def test_limits_are_kept_and_the_best_is_found(seed):
    J, tau, w = problem(seed)
    free = motor_forces(J, tau, weights=w).forces
    # Below the largest free force, above the least possible maximum, which a linear program gives.
    from scipy.optimize import linprog

    A = np.hstack([np.vstack([np.eye(5), -np.eye(5)]), -np.ones((10, 1))])
    smallest = linprog(
        [*[0] * 5, 1], A, np.zeros(10), np.hstack([J.T, np.zeros((3, 1))]), tau, bounds=[(None, None)] * 6
    ).fun
    cap = 0.5 * (smallest + np.abs(free).max())
    found = limited_motor_forces(J, tau, np.full(5, -cap), np.full(5, cap), weights=w)
    assert np.abs(found.forces).max() <= cap * (1 + 1e-6)
    assert found.residual < 1e-7
    assert found.at_limit.any()
    rng = np.random.default_rng(seed)
    for _ in range(200):
        other = found.forces + found.null_space @ rng.normal(0, 0.2 * cap, 2)
        if np.abs(other).max() <= cap:
            assert w @ found.forces**2 <= w @ other**2 * (1 + 1e-6)


def test_preferred_pretension():
    J, tau, _ = problem(1)
    null = motor_forces(J, tau).null_space
    wish = motor_forces(J, tau).forces + null @ [3.0, -2.0]
    found = limited_motor_forces(J, tau, np.full(5, -np.inf), np.full(5, np.inf), preferred=wish)
    assert error(found.forces, wish) < 1e-6
    assert set(found.to_dict()) >= {"forces", "residual", "at_limit", "status"}


def test_impossible_limits():
    J, tau, _ = problem(2)
    with pytest.raises(SolverError, match="no motor forces within the limits"):
        limited_motor_forces(J, 100 * tau, np.full(5, -1e-3), np.full(5, 1e-3))


def test_singular_pose_is_named():
    J = np.array([[1.0, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]])
    with pytest.raises(SolverError, match="type II"):
        motor_forces(J, np.ones(3))


def test_too_few_motors():
    J, tau, _ = problem(4, motors=2)
    with pytest.raises(InputError, match="under-actuated"):
        motor_forces(J, tau)
    closest = motor_forces(J, tau, least_squares=True)
    assert closest.residual > 1e-3
    assert J @ (J.T @ closest.forces - tau) == pytest.approx(0, abs=1e-9)
    with pytest.raises(InputError, match="under-actuated"):
        limited_motor_forces(J, tau, -np.ones(2), np.ones(2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": [1, 1, 0, 1, 1]}, "weights: must be > 0"),
        ({"weights": [1, 1]}, "weights: expected shape"),
        ({"generalized_force": [1, np.nan, 0]}, "generalized_force: contains NaN"),
    ],
)
def test_bad_input(change, message):
    J, tau, _ = problem(0)
    with pytest.raises(InputError, match=message):
        motor_forces(**{"jacobian": J, "generalized_force": tau, **change})
    with pytest.raises(InputError, match="motor 2 has lower"):
        limited_motor_forces(J, tau, [0, 1, 0, 0, 0], [0.0] * 5)
