"""Feet with friction amid casters without: the best sharing of the load against a cone program."""

from __future__ import annotations

import clarabel
import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import brentq

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium
from ocptip.reserves import fractional
from ocptip.reserves.minimax import ConeBatch
from ocptip.reserves.slip import Slip
from tests.quick import some

_AGREE = 1e-6


def margin(support, wrench, usage):
    """Largest s with |T_i| + s <= usage mu_i N_i and s <= N_i of forces that balance the wrench, relative."""
    n, unit = support.n_contacts, np.abs(wrench).max()
    size = 3 * n + 1
    balance = np.hstack([support.wrench_matrix, np.zeros((6, 1))])
    rows, rhs, cones = [balance], [-wrench / unit], [clarabel.ZeroConeT(6)]
    for i, contact in enumerate(support.contacts):
        block = np.zeros((1 if contact.friction == 0 else 3, size))
        if contact.friction == 0:
            block[0, [3 * i, -1]] = -1.0, 1.0
            fixed = np.zeros((2, size))
            fixed[[0, 1], [3 * i + 1, 3 * i + 2]] = 1.0
            rows.append(fixed)
            rhs.append(np.zeros(2))
            cones += [clarabel.ZeroConeT(2), clarabel.NonnegativeConeT(1)]
        else:
            block[0, [3 * i, -1]] = -usage * contact.friction, 1.0
            block[[1, 2], [3 * i + 1, 3 * i + 2]] = -1.0
            cones.append(clarabel.SecondOrderConeT(3))
        rows.append(block)
        rhs.append(np.zeros(len(block)))
    last = np.zeros((1, size))
    last[0, -1] = 1.0
    rows.append(last)
    rhs.append(np.ones(1))
    cones.append(clarabel.NonnegativeConeT(1))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    cost = -np.eye(size)[-1]
    nothing = sparse.csc_matrix((size, size))
    matrix = sparse.csc_matrix(np.vstack(rows))
    solution = clarabel.DefaultSolver(nothing, cost, matrix, np.concatenate(rhs), cones, settings).solve()
    return solution.x[-1] if "Infeasible" not in str(solution.status) else -1.0


def least_use(support, wrench):
    """Smallest share of the friction with which any forces hold the base; infinite without any below 4."""
    if margin(support, wrench, 4.0) <= 1e-9:
        return np.inf
    if margin(support, wrench, 1e-7) > 0:
        return 0.0
    return brentq(lambda usage: margin(support, wrench, usage), 1e-7, 4.0, xtol=1e-10)


def random_case(seed):
    """A base on 3 to 8 contacts, one or more without friction, and wrenches near its weight."""
    rng = np.random.default_rng(seed)
    n, flat = int(rng.integers(3, 9)), seed % 2 == 0
    angles = np.sort(2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n)
    radii = rng.uniform(0.2, 0.5, n)
    friction = rng.choice([0.0, 0.0, 0.05, 0.3, 0.8], n)
    friction[rng.permutation(n)[:2]] = 0.7, 0.4  # two of them hold a moment about the vertical
    contacts = []
    for i in range(n):
        tilt = np.zeros(2) if flat else rng.uniform(-0.2, 0.2, 2)
        height = 0.0 if flat else rng.uniform(-0.05, 0.05)
        contacts.append(
            UnilateralContact(
                position=[radii[i] * np.cos(angles[i]), radii[i] * np.sin(angles[i]), height],
                normal=[*tilt, 1.0],
                friction=float(friction[i]),
            )
        )
    support = Support(contacts, mass=float(rng.uniform(20, 200)), center_of_mass=[0.01, -0.02, 0.4])
    weight = 9.81 * support.mass
    wrenches = support.wrench([]) + weight * rng.uniform(-1, 1, (3, 6)) * [0.2, 0.2, 0.2, 0.06, 0.06, 0.03]
    return support, wrenches


@pytest.mark.parametrize("seed", some(8, [49, *range(49), *range(50, 120)]))
def test_best_sharing_and_verdict_are_those_of_a_cone_program(seed):
    support, wrenches = random_case(seed)
    states = solve_resting(support, wrenches)
    slip = Slip(support, "full").evaluate(states)
    for i, wrench in enumerate(wrenches):
        least = least_use(support, wrench)
        if abs(least - 1) > _AGREE:
            assert equilibrium(support, wrench).stands == (least < 1)
            assert (states.persistent[i] and slip.GT[i] < 1) == (least < 1)
        if least < 1 - _AGREE:
            assert slip.solved[i], slip.status[i]
            assert slip.slip_ratio[i] == pytest.approx(least, abs=_AGREE)


@pytest.mark.parametrize("seed", some(1, [1, 4, 6, 9, 13, 104, 106, 119]))
def test_gradient_is_that_of_the_cone_program(seed):
    support, wrenches = random_case(seed)
    wrench = wrenches[np.argmin([least_use(support, own) for own in wrenches])]
    gradient = Slip(support, "full").evaluate(solve_resting(support, wrench[None])).gradient[0]
    step = 1e-4 * np.abs(wrench).max()
    for k, along in enumerate(np.eye(6) * step):
        before, after = (least_use(support, wrench + sign * along) for sign in (-1, 1))
        assert gradient[k] * step == pytest.approx((after - before) / 2, abs=2e-7, rel=1e-3)


def test_many_states_amid_casters_are_all_certified():
    """Two drive wheels amid four casters; before, the optimum stayed open in a quarter of the states."""
    wheels, casters = [(0, 0.19), (0, -0.19)], [(0.17, 0.15), (0.17, -0.15), (-0.17, -0.15), (-0.17, 0.15)]
    contacts = [UnilateralContact(position=[*p, 0], friction=0.8 * (p in wheels)) for p in wheels + casters]
    support, rng = Support(contacts, mass=100, center_of_mass=[0.05, 0, 0.4]), np.random.default_rng(0)
    wrenches = support.wrench([]) + rng.normal(size=(400, 6)) * [5, 5, 0, 10, 10, 1]
    slip = Slip(support).evaluate(solve_resting(support, wrenches))
    assert slip.solved.all()
    chosen = range(0, 400, 40)
    expected = [least_use(support, wrenches[i]) for i in chosen]
    np.testing.assert_allclose(slip.GT[chosen], expected, atol=_AGREE)


@pytest.mark.slow
def test_a_state_on_a_plane_takes_no_general_program_and_has_the_value_of_the_iteration(monkeypatch):
    """Where balances are apart a solver of its own does; the iteration for any normals took up to eleven."""
    programs, solve = [], ConeBatch.solve

    def counted(batch, A, b):
        programs.append(len(A))
        return solve(batch, A, b)

    monkeypatch.setattr(ConeBatch, "solve", counted)
    needed, iterated, compared = [], [], 0
    for seed in range(0, 40, 2):
        support, wrenches = random_case(seed)
        slip, states = Slip(support, "full"), solve_resting(support, wrenches)
        for i in range(len(states)):
            state = states.select(np.array([i]))
            programs.clear()
            direct = slip.evaluate(state)
            needed.append(sum(programs))
            with monkeypatch.context() as plain:
                plain.setattr(fractional, "_by_growth", lambda best, q, *_: np.zeros(len(q), bool))
                programs.clear()
                slow = slip.evaluate(state)
                iterated.append(sum(programs))
            assert direct.solved.all()
            assert slow.solved.all()
            np.testing.assert_allclose(direct.GT, slow.GT, rtol=0, atol=1e-9)
            compared += bool(state.persistent[0])
    assert compared > 50
    assert max(needed) == 0
    assert max(iterated) > 6
