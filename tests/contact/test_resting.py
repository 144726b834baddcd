"""Standing states wherever there are any: a function of the wrench alone."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import resting, solve_resting
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, stability
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from studies.contact.random_supports import random_support
from tests.quick import examples, some


def four_feet(rng: np.random.Generator) -> tuple[Support, np.ndarray]:
    """Four feet of different friction, and 60 wrenches of a base that is pushed about."""
    places = [(0.3, 0.25, 0), (-0.3, 0.25, 0), (-0.3, -0.25, 0), (0.3, -0.25, 0)]
    feet = [UnilateralContact(friction=rng.uniform(0.1, 1.2), position=at, normal=(0, 0, 1)) for at in places]
    wrenches = rng.normal(size=(60, 6)) * [60, 60, 0, 12, 12, 15] + [0, 0, -300, 0, 0, 0]
    return Support(feet, mass=30.0, center_of_mass=(0, 0, 0.2)), wrenches


def stands(support: Support, wrenches: np.ndarray, **how) -> np.ndarray:
    """(N,) as checks judge it."""
    states = solve_resting(support, wrenches, **how)
    return (TipOver(support).evaluate(states).GN < 1) & (Slip(support).evaluate(states).GT < 1)


@examples(12)
@given(st.integers(0, 10_000))
def test_the_verdict_depends_on_the_wrench_alone(seed):
    rng = np.random.default_rng(seed)
    support, wrenches = four_feet(rng)
    order = rng.permutation(len(wrenches))
    found = stands(support, wrenches)
    np.testing.assert_array_equal(stands(support, wrenches[order]), found[order])
    for how in (False, "any"):
        np.testing.assert_array_equal(stands(support, wrenches, warm_start=how), found)
    some = order[:6]
    np.testing.assert_array_equal([stands(support, wrenches[k : k + 1])[0] for k in some], found[some])
    np.testing.assert_array_equal([equilibrium(support, wrenches[k]).stands for k in some], found[some])


def test_what_pivoting_lets_slide_though_forces_hold_stands():
    support, wrenches = four_feet(np.random.default_rng(0))
    before, after = solve_many(support, wrenches), solve_resting(support, wrenches)
    changed = np.flatnonzero(after.persistent & ~before.persistent)
    assert len(changed) >= 10
    np.testing.assert_array_equal(resting(before).persistent, after.persistent)
    reserve = Slip(support).evaluate(after)
    assert np.max(reserve.GT[changed]) <= 1
    assert np.max(reserve.residual[changed]) < 1e-6
    for k in changed[:3]:
        assert stability(support, wrenches[k]).verdict == "weak"
        assert np.max(np.abs(after.contact_forces[k].ravel() @ support.wrench_matrix.T + wrenches[k])) < 1e-6


def test_derivatives_where_no_basis_belongs_to_a_state():
    support, wrenches = four_feet(np.random.default_rng(0))
    slip, step = Slip(support), 1e-4
    states = solve_resting(support, wrenches)
    k = int(np.flatnonzero(states.persistent & (states.subsets[:, 0] < 0))[0])
    moved = wrenches[k] + step * np.vstack([np.eye(6), -np.eye(6)])
    GT = slip.evaluate(solve_resting(support, moved)).GT
    numeric = (GT[:6] - GT[6:]) / (2 * step)
    assert slip.evaluate(states).gradient[k] == pytest.approx(numeric, abs=1e-5)
    assert not states.acceleration_maps[k].any()


@pytest.mark.parametrize("clamps", some(1, [False, True]))
def test_one_proof_for_many_wrenches_never_hides_a_standing_one(clamps):
    rng = np.random.default_rng(3)
    hidden = []
    for _ in range(25):
        support = random_support(rng, clamps=clamps)
        weight = np.r_[support.mass * support.gravity, np.zeros(3)]
        wrenches = weight + rng.normal(size=(12, 6)) * np.linalg.norm(weight) * 0.3
        states = solve_resting(support, wrenches)
        moving = np.flatnonzero(~states.persistent)
        hidden += [equilibrium(support, wrenches[k]).margin / np.linalg.norm(weight) for k in moving]
    assert len(hidden) > 50
    assert max(hidden) < 1e-6


def with_a_clamp(seed: int) -> tuple[Support, np.ndarray]:
    """Two feet and a clamp, and 200 wrenches, many of which the contacts do not hold."""
    feet = [UnilateralContact(friction=0.5, position=at) for at in [(-0.2, 0.3, 0), (-0.2, -0.3, 0)]]
    jaws = {"friction_upper": 0.3, "friction_lower": 0.5, "clamp_force": 80.0}
    clamp = ForceConstantHalfRigidClamp(position=(0.35, 0, 0), **jaws)
    support = Support([*feet, clamp], mass=30.0, center_of_mass=(0, 0, 0.3))
    pushes = np.random.default_rng(seed).normal(size=(200, 6)) * [150, 150, 100, 30, 30, 40]
    return support, support.weight + pushes


def programs_asked(support: Support, wrenches: np.ndarray) -> tuple[int, np.ndarray]:
    """How many programs tell which wrenches move the base, and the indices of these; that is so."""
    with mock.patch("ocptip.contact.resting.equilibrium", side_effect=equilibrium) as program:
        states = solve_resting(support, wrenches)
    moving = np.flatnonzero(~states.persistent)
    assert 50 < len(moving) < 190
    assert not any(equilibrium(support, wrenches[k]).stands for k in moving)
    return program.call_count, moving


def test_few_programs_tell_that_a_base_with_a_clamp_moves_and_fewer_still_later():
    support, wrenches = with_a_clamp(4)
    asked, moving = programs_asked(support, wrenches)
    assert asked < len(moving) / 3
    later, _ = programs_asked(support, with_a_clamp(5)[1])
    assert later < asked / 2


def test_forces_that_hold_one_wrench_hold_others_near_to_it():
    """Two wheels amid four casters: pivoting puts all weight on the casters, in every state."""
    places = [(0, 0.19), (0, -0.19), (0.17, 0.15), (0.17, -0.15), (-0.17, -0.15), (-0.17, 0.15)]
    contacts = [UnilateralContact(position=[*p, 0], friction=0.8 * (k < 2)) for k, p in enumerate(places)]
    support, rng = Support(contacts, mass=100, center_of_mass=[0.05, 0, 0.4]), np.random.default_rng(1)
    wrenches = support.wrench([]) + rng.normal(size=(300, 6)) * [60, 60, 0, 60, 60, 10]
    with mock.patch("ocptip.contact.resting.equilibrium", side_effect=equilibrium) as programs:
        states = solve_resting(support, wrenches)
    assert programs.call_count < 60
    expected = np.array([equilibrium(support, wrench).stands for wrench in wrenches])
    assert 0.2 < expected.mean() < 0.98
    np.testing.assert_array_equal(states.persistent, expected)
    found = states.without_basis & expected  # what pivoting finds lies on pyramids
    assert found.sum() > 100
    held = states.contact_forces[found]
    balance = wrenches[found] + held.reshape(len(held), -1) @ support.wrench_matrix.T
    assert np.max(np.abs(balance)) < 1e-6
    assert np.all(held[:, :, 0] > -1e-4)
    friction = np.array([contact.friction for contact in contacts])
    assert np.all(np.linalg.norm(held[:, :, 1:], axis=2) <= friction * held[:, :, 0] + 1e-4)
    assert not held[:, 2:, 1:].any()
