"""Lower bounds of the slip reserve, by powers of friction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.support import Support
from ocptip.placement.estimates import LeastSlip
from ocptip.reserves.slip import Slip
from tests.quick import examples, some
from tests.reserves.test_mixed_friction import least_use, random_case


def base(rng, count, turned):
    """Feet on a circle that is a little off, on one plane, each with its own friction."""
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    places = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)]) @ turned.T
    friction = rng.uniform(0.2, 0.9, count)
    contacts = [
        UnilateralContact(position=p, normal=turned[:, 2], friction=mu)
        for p, mu in zip(0.4 * places, friction, strict=True)
    ]
    return Support(contacts, mass=40.0, center_of_mass=turned @ [0.02, 0.01, 0.3])


def loads(rng, turned, count=12):
    """Weights, pushes and moments (N, 6)."""
    forces = np.column_stack([rng.uniform(-90, 90, (count, 2)), np.full(count, -400.0)])
    moments = np.column_stack([rng.uniform(-25, 25, (count, 2)), rng.uniform(-40, 40, count)])
    return np.hstack([forces @ turned.T, moments @ turned.T])


@examples(15)
@given(count=st.integers(3, 6), seed=st.integers(0, 10**6))
def test_bound_is_no_larger_than_the_reserve_and_near_to_it(count, seed):
    """Duality: the largest share over all ways to slide is the smallest use over all forces that hold."""
    rng = np.random.default_rng(seed)
    turned = Rotation.from_rotvec(rng.uniform(-1, 1, 3)).as_matrix()
    support, wrenches = base(rng, count, turned), loads(rng, turned)
    states = solve_resting(support, wrenches)
    exact = Slip(support, "full").evaluate(states, derivatives=False).GT
    least = LeastSlip(support)(wrenches)
    held = states.persistent
    assert np.all(least[held] <= exact[held] + 1e-6)
    away = exact[held] - least[held]
    assert held.sum() > 2
    assert np.median(away) < 0.02


@pytest.mark.parametrize("seed", some(4, range(0, 40, 2)))
def test_bound_of_wheels_amid_casters_is_no_larger_than_that_of_a_cone_program(seed):
    support, wrenches = random_case(seed)
    least = LeastSlip(support)(wrenches)
    exact = [least_use(support, wrench) for wrench in wrenches]
    assert np.all(least <= np.array(exact) + 1e-6)
    assert np.all(np.isfinite(least))


@pytest.mark.parametrize("uneven", [0.0, 0.05])
def test_feet_on_steps_and_straight_pushes(uneven):
    """All feet slide one way: then the bound is the reserve itself, whatever their heights."""
    corners = ([0.4, 0.3, 0], [0.4, -0.3, 0], [-0.4, -0.3, 0], [-0.4, 0.3, uneven])
    support = Support([UnilateralContact(position=p, friction=0.5) for p in corners], mass=40.0)
    wrench = np.array([[60.0, 0, -400, 0, 0, 0]])
    assert LeastSlip(support)(wrench) == pytest.approx(60 / 200)


def test_nothing_is_known_of_clamps():
    clamp = RigidClamp(position=[0, 0, 0], friction_upper=0.5, friction_lower=0.5)
    assert LeastSlip(Support([clamp], mass=1.0))(np.ones((2, 6))).tolist() == [0.0, 0.0]
