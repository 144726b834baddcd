"""GT as a smooth function of the wrench: against the redistribution and its own finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.contact import ForceConstantHalfRigidClamp, Support, UnilateralContact, solve_many
from ocptip.reserves.slip import Slip, SlipMap

TRIANGLE = ([0.35, 0, 0.02], [-0.2, 0.3, 0.02], [-0.2, -0.3, 0.02])


def slip_of(positions=TRIANGLE, friction=(0.5, 0.3, 0.8), **options) -> Slip:
    feet = [
        UnilateralContact(position=p, friction=mu, **options)
        for p, mu in zip(positions, np.resize(friction, len(positions)), strict=True)
    ]
    return Slip(Support(feet, mass=60.0, center_of_mass=[0, 0, 0.6]))


def clamped() -> Slip:
    """Two feet and a clamp that lets go when it is pulled with more than 300 N."""
    *places, at = TRIANGLE
    feet = [UnilateralContact(position=p, friction=0.5) for p in places]
    clamp = ForceConstantHalfRigidClamp(
        position=at, friction_upper=0.4, friction_lower=0.2, clamp_force=300.0
    )
    return Slip(Support([*feet, clamp], mass=60.0, center_of_mass=[0, 0, 0.6]))


def wrenches_of(count: int, pull: float = 50.0) -> np.ndarray:
    rng = np.random.default_rng(3)
    spread = np.array([pull, pull, 40.0, 10.0, 10.0, 10.0])
    return np.array([0, 0, -588.6, 0, 0, 0]) + rng.uniform(-spread, spread, (count, 6))


def rotated_about_a_foot(slip: Slip) -> np.ndarray:
    """Wrenches held best by forces of a rotation about one foot: mostly a moment about the vertical."""
    wrenches = wrenches_of(40, pull=4.0)
    wrenches[:, 5] = np.linspace(20.0, 60.0, 40)
    return wrenches


@pytest.mark.parametrize("slip", [slip_of(), clamped(), slip_of(friction=(0.5, 0.0, 0.8))])
@pytest.mark.parametrize("wrenches", [wrenches_of(200), wrenches_of(40, 4.0)])
def test_where_the_base_stands_it_is_gt_with_its_gradient(slip, wrenches):
    reserve = slip.evaluate(solve_many(slip.support, wrenches))
    values, slopes, _ = SlipMap(slip, 0.9)(wrenches)
    stands = reserve.GT < 0.95
    assert np.sum(stands) > 30
    np.testing.assert_allclose(values[stands], reserve.GT[stands], rtol=1e-6)
    np.testing.assert_allclose(slopes[stands], reserve.gradient[stands], rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("slip", [slip_of(), clamped(), slip_of(friction=(0.5, 0.0, 0.8))])
@pytest.mark.parametrize("turned", [False, True])
def test_derivatives_are_those_of_finite_differences(slip, turned):
    own = SlipMap(slip, 0.9)
    wrenches = rotated_about_a_foot(slip) if turned else wrenches_of(60, pull=250.0)
    values, slopes, bends = own(wrenches)
    step, moved = 1e-3, np.zeros((6, 2, len(wrenches), 7))
    for k in range(6):
        for side, sign in enumerate((1, -1)):
            there = own(wrenches + sign * step * np.eye(6)[k])
            moved[k, side] = np.column_stack(there[:2])
    differences = (moved[:, 0] - moved[:, 1]) / (2 * step)
    smooth = np.isfinite(values) & (np.abs(bends).max(axis=(1, 2)) > 0)
    assert np.sum(smooth) > 30
    np.testing.assert_allclose(slopes, differences[:, :, 0].T, atol=1e-6)
    error = np.abs(bends - differences[:, :, 1:].transpose(1, 2, 0)).max(axis=(1, 2))
    assert np.quantile(error[smooth], 0.9) < 1e-7  # a few lie where it changes from a rotation to none
    np.testing.assert_allclose(bends, bends.transpose(0, 2, 1), atol=1e-12)


def test_beyond_what_holds_it_goes_on_smoothly():
    slip = slip_of()
    pulls = np.linspace(100.0, 900.0, 60)
    wrenches = np.zeros((60, 6))
    wrenches[:, 2], wrenches[:, 0], wrenches[:, 4] = -588.6, pulls, -0.58 * pulls  # as if at the ground
    values, _, _ = SlipMap(slip, 0.9)(wrenches)
    assert values[0] < 0.9
    assert values[-1] > 1.2
    assert np.abs(np.diff(values, 2)).max() < 0.01
    GT = slip.evaluate(solve_many(slip.support, wrenches)).GT
    assert np.abs(np.diff(GT, 2)).max() > 0.02  # the reserve itself jumps in slope where the base slips


@pytest.mark.parametrize(
    "slip",
    [
        slip_of(([0.3, 0.3, 0], [0.3, -0.3, 0], [-0.3, -0.3, 0], [-0.3, 0.3, 0])),
        slip_of(facets=4),  # whose pyramid holds less than 0.9 of the cone
        slip_of(friction=(0.5, 0.0, 0.0)),
        slip_of(([0.35, 0, 0], [0.1, 0, 0], [-0.3, 0, 0])),
    ],
)
def test_of_all_others_it_is_gt(slip):
    wrenches = wrenches_of(20)
    reserve = slip.evaluate(solve_many(slip.support, wrenches))
    values, slopes, bends = SlipMap(slip, 0.9)(wrenches)
    np.testing.assert_array_equal(values, reserve.GT)
    np.testing.assert_array_equal(slopes, np.nan_to_num(reserve.gradient))
    assert not bends.any()


@pytest.mark.parametrize("friction", [(0.5, 0.3, 0.8), (0.0, 0.3, 0.8)])
def test_a_lifted_foot_is_left_to_the_reserve(friction):
    slip = slip_of(friction=friction)
    wrenches = np.tile([0.0, 0.0, -588.6, 0.0, 0.0, 0.0], (3, 1))
    wrenches[:, 4] = [0.0, 400.0, -400.0]
    values, _, _ = SlipMap(slip, 0.9)(wrenches)
    np.testing.assert_allclose(values, slip.evaluate(solve_many(slip.support, wrenches)).GT, atol=1e-9)


def test_where_a_clamp_lets_go_it_goes_on_smoothly_in_programs_only():
    slip, wrenches = clamped(), np.zeros((60, 6))
    wrenches[:, 2], wrenches[:, 3] = -588.6, -np.linspace(0.0, 400.0, 60)  # tips away from the clamp
    states = solve_many(slip.support, wrenches)
    values, _, _ = slip.map(0.9)(wrenches)
    GT = slip.evaluate(states).GT
    held = states.persistent
    assert held[0]
    assert not held[-1]
    np.testing.assert_allclose(values[held], GT[held], atol=1e-9)
    assert np.any(values[~held] < GT[~held] - 0.1)
    within, _ = slip.within(0.9)
    np.testing.assert_array_equal(within(wrenches)[0], np.nan_to_num(GT, nan=10.0))
