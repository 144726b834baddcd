"""Moments about tipping axes straight from the wrench equal those of the contact states."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.reserves.tipping import TipOver
from tests.quick import examples
from tests.reserves.reserve_scenes import (
    CLAMPS,
    FRICTION,
    GRAVITY,
    HEIGHT,
    MASS,
    RADIUS,
    clamp,
    corners,
    feet,
    wrenches,
)


def turned_support(rng, n, kinds=()):
    """A base on n feet of a plane that is tilted, turned and moved; the first feet are clamps of `kinds`."""
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R = R * np.sign(np.linalg.det(R))
    shift = rng.uniform(-1, 1, 3)
    places = corners(n) + np.column_stack([rng.uniform(-0.1, 0.1, (n, 2)), np.zeros(n)])
    contacts = []
    for i, place in enumerate(places):
        frame = {"normal": R[:, 2], "tangent": R[:, 0]}
        position = shift + R @ place
        if i < len(kinds):
            contacts.append(clamp(kinds[i], position, **frame))
        else:
            contacts.append(UnilateralContact(position=position, friction=FRICTION, facets=8, **frame))
    return Support(
        contacts,
        mass=MASS,
        center_of_mass=shift + R @ [0.0, 0.0, HEIGHT],
        inertia=R @ np.diag([3.0, 4.0, 5.0]) @ R.T,
        gravity=R @ [0.0, 0.0, -GRAVITY],
    )


def assert_moments_follow_from_the_wrench(support, rng, count=30, least=5):
    tip_over = TipOver(support)
    at = wrenches(rng, support, count, force=60.0, moment=30.0)
    states = solve_many(support, at)
    slope, offset = tip_over.affine_moments
    assert slope.shape == (len(tip_over.axes), 6)
    moments = tip_over.evaluate(states).moments
    standing = states.solved & states.persistent
    assert np.count_nonzero(standing) >= least
    scale = np.max(np.abs(states.contact_forces)) * RADIUS
    error = np.abs(at @ slope.T + offset - moments)[standing]
    assert np.max(error) < 1e-9 * scale


@examples(40)
@given(seed=st.integers(0, 10**6), n=st.integers(3, 5))
def test_feet_on_a_plane_anywhere_in_space(seed, n):
    rng = np.random.default_rng(seed)
    assert_moments_follow_from_the_wrench(turned_support(rng, n), rng)


@pytest.mark.parametrize("kind", CLAMPS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("n", [3, 4, 5])
def test_clamped_feet_on_a_plane(kind, n):
    for seed in range(3):
        rng = np.random.default_rng([seed, n])
        assert_moments_follow_from_the_wrench(turned_support(rng, n, [kind]), rng)


def test_two_different_clamps_at_once():
    kinds = [ForceConstantHalfRigidClamp, CLAMPS[-1]]
    for seed in range(5):
        rng = np.random.default_rng(seed)
        assert_moments_follow_from_the_wrench(turned_support(rng, 4, kinds), rng)


def test_slope_is_the_gradient_of_the_moments_in_the_contact_states():
    rng = np.random.default_rng(1)
    support = turned_support(rng, 4, [ForceConstantHalfRigidClamp])
    tip_over = TipOver(support)
    states = solve_many(support, wrenches(rng, support, 30, force=60.0, moment=30.0))
    gradients = tip_over.evaluate(states).moment_gradients[states.persistent]
    assert len(gradients) > 5
    assert np.max(np.abs(gradients - tip_over.affine_moments[0])) < 1e-9


def test_clamp_force_raises_only_moments_that_it_resists():
    """A force-constant clamp adds its force times its lever to the axes it does not lie on."""
    places = corners(3)
    free = TipOver(feet(places, facets=8))
    contacts = [clamp(ForceConstantHalfRigidClamp, places[0])]
    contacts += [UnilateralContact(position=p, friction=FRICTION, facets=8) for p in places[1:]]
    held = TipOver(Support(contacts, mass=MASS, center_of_mass=[0.0, 0.0, HEIGHT], inertia=[3.0, 4.0, 5.0]))
    assert [axis.contacts for axis in held.axes] == [axis.contacts for axis in free.axes]
    np.testing.assert_allclose(held.affine_moments[0], free.affine_moments[0], atol=1e-15)
    added = held.affine_moments[1] - free.affine_moments[1]
    force = -held._sets.lower[0]
    assert force > 0
    expected = [0.0 if 0 in axis.contacts else force * 1.5 * RADIUS for axis in held.axes]
    np.testing.assert_allclose(added, expected, rtol=1e-12, atol=1e-9)


def test_the_formula_goes_on_where_the_base_tips():
    support = feet(corners(4))
    tip_over = TipOver(support)
    slope, offset = tip_over.affine_moments
    push = np.array([0, 0, 0, 0, 2 * MASS * GRAVITY * RADIUS, 0])
    assert not solve_many(support, (support.weight + push)[None]).persistent[0]
    moments = slope @ (support.weight + push) + offset
    inradius = RADIUS / np.sqrt(2)
    assert np.min(moments) == pytest.approx(MASS * GRAVITY * (inradius - 2 * RADIUS / np.sqrt(2)), rel=1e-9)


def test_feet_in_different_planes_have_none():
    places = corners(4)
    places[2, 2] += 0.05
    assert TipOver(feet(places)).affine_moments is None


def test_normals_in_different_directions_have_none():
    places = corners(3)
    contacts = [
        UnilateralContact(position=p, normal=[0.1 * i, 0, 1], friction=FRICTION, facets=8)
        for i, p in enumerate(places)
    ]
    support = Support(contacts, mass=MASS, center_of_mass=[0.0, 0.0, HEIGHT], inertia=[3.0, 4.0, 5.0])
    assert TipOver(support).affine_moments is None


def test_planes_across_the_normals_have_none():
    """A staircase: all normals point up, but the feet's plane is inclined, so that friction acts, too."""
    places = corners(3)
    places[:, 2] = 0.3 * places[:, 0]
    assert TipOver(feet(places)).affine_moments is None


def test_supports_in_the_plane_and_on_a_line_have_none():
    planar = Support(
        [UnilateralContact(position=[x, 0.0], normal=[0.0, 1.0], friction=0.5) for x in (-0.3, 0.3)],
        mass=MASS,
        center_of_mass=[0.0, HEIGHT],
        inertia=4.0,
    )
    assert TipOver(planar).affine_moments is None
    line = feet([[-0.3, 0, 0], [0.0, 0, 0], [0.3, 0, 0]])
    assert TipOver(line).free_rotation
    assert TipOver(line).affine_moments is None


def test_clamps_that_cannot_tip_have_none():
    rng = np.random.default_rng(0)
    assert TipOver(turned_support(rng, 3, [CLAMPS[0]] * 3)).affine_moments is None
