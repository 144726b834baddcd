"""Reserves of contacts in general position against the convex test of equilibrium with true cones."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load, Support
from ocptip.contact.verdict import equilibrium
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipMap, TipOver
from tests.quick import examples
from tests.reserves.reserve_scenes import corners, feet

seeds = st.integers(0, 10**6)


def uneven(rng, n, slope=0.25, height=0.05, clamp=False):
    """A base on n feet around it, at different heights and with different normals."""
    turn = np.sort(rng.uniform(0, 2 * np.pi, n))
    radius = rng.uniform(0.3, 0.5, n)
    places = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(-height, height, n)])
    normals = np.column_stack([rng.uniform(-slope, slope, (n, 2)), np.ones(n)])
    contacts = [
        UnilateralContact(position=p, normal=normal, friction=0.6, facets=16)
        for p, normal in zip(places, normals, strict=True)
    ]
    if clamp:
        options = {"friction_upper": 0.6, "friction_lower": 0.5, "clamp_force": 80.0}
        contacts[0] = ForceConstantHalfRigidClamp(position=places[0], normal=normals[0], facets=16, **options)
    return Support(contacts, mass=50.0, center_of_mass=[*rng.uniform(-0.05, 0.05, 2), 0.3])


def loaded(rng, support, force=60.0):
    """A wrench of weight and one load under which the base stands, with its state."""
    wrench = support.wrench([Load(force=rng.normal(size=3) * force, point=rng.normal(size=3) * 0.3)])
    states = solve_many(support, wrench[None])
    tip_over = TipOver(support)
    assume(states.persistent[0] and tip_over.axes and not tip_over.free_rotation)
    assume(Slip(support).evaluate(states).GT[0] < 0.98)
    return wrench, states, tip_over


@examples(25)
@given(seed=seeds, n=st.integers(3, 6))
def test_the_least_moment_is_what_can_be_added_about_any_axis(seed, n):
    rng = np.random.default_rng(seed)
    support = uneven(rng, n)
    wrench, states, tip_over = loaded(rng, support)
    moments = tip_over.evaluate(states).moments[0]
    least = np.min(moments)
    nearest = tip_over.axes[int(np.argmin(moments))].direction

    def stands(direction, moment):
        return equilibrium(support, wrench + np.r_[np.zeros(3), moment * direction]).stands

    assert all(stands(axis.direction, 0.999 * least) for axis in tip_over.axes)
    assert not stands(nearest, least + 1e-3 * max(1.0, least))


@examples(25)
@given(seed=seeds, n=st.integers(3, 5), clamp=st.booleans())
def test_derivatives(seed, n, clamp):
    rng = np.random.default_rng(seed)
    support = uneven(rng, n, clamp=clamp)
    wrench, states, tip_over = loaded(rng, support)
    reserve, direction, step = tip_over.evaluate(states), rng.normal(size=6) * [1, 1, 1, 0.3, 0.3, 0.3], 1e-2
    tip_map, at = TipMap(tip_over), int(reserve.nearest_axis[0])

    def moments(wrench):
        return tip_map(wrench[None])[0][0, at]

    ahead, behind = (moments(wrench + sign * step * direction) for sign in (1, -1))
    curvature = ahead + behind - 2 * moments(wrench)
    assume(abs(curvature) < 1e-4)  # no change of what is active in between
    expected = (ahead - behind) / (2 * step)
    slopes = tip_map(wrench[None])[1][0, at], reserve.moment_gradients[0, at]
    assert [slope @ direction for slope in slopes] == pytest.approx(
        [expected] * 2, abs=1e-3 * (1 + abs(expected))
    )
    assert reserve.moments[0, at] == pytest.approx(moments(wrench), rel=1e-6, abs=1e-6)


@examples(20)
@given(seed=seeds)
def test_almost_on_a_plane_the_reserve_is_that_of_the_plane(seed):
    rng = np.random.default_rng(seed)
    places = corners(int(rng.integers(3, 6)))
    plain = feet(places)
    contacts = [
        UnilateralContact(
            position=c.position, normal=[*rng.normal(size=2) * 1e-7, 1.0], friction=0.5, facets=12
        )
        for c in plain.contacts
    ]
    tilted = Support(contacts, mass=60.0, center_of_mass=plain.center_of_mass, inertia=[3.0, 4.0, 5.0])
    wrench = plain.weight + np.r_[rng.normal(size=3) * 20, rng.normal(size=3) * 8]
    on_plane, off_plane = TipOver(plain), TipOver(tilted)
    assert (on_plane.on_plane, off_plane.on_plane) == (True, False)
    states = [solve_many(support, wrench[None]) for support in (plain, tilted)]
    assume(states[0].persistent[0] and Slip(plain).evaluate(states[0]).GT[0] < 0.5)
    values = [tip.evaluate(s).GN[0] for tip, s in zip((on_plane, off_plane), states, strict=True)]
    assert values[1] == pytest.approx(values[0], rel=1e-5)


def test_normals_that_differ_share_normal_forces_in_the_best_way():
    """A tripod under its weight: the vertex solution has one foot at the edge of its friction."""
    normals = [-0.15, 0.0, 1.0], [0.1, -0.1, 1.0], [0.1, 0.1, 1.0]
    places = [0.4, 0.0, 0.0], [-0.2, 0.35, 0.0], [-0.2, -0.35, 0.0]
    contacts = [
        UnilateralContact(position=p, normal=normal, friction=0.6, facets=12)
        for p, normal in zip(places, normals, strict=True)
    ]
    support = Support(contacts, mass=50.0, center_of_mass=[0.0, 0.0, 0.3])
    states = solve_many(support, support.weight[None])
    assert Slip(support, "tangential").evaluate(states).GT[0] > 0.9
    slip = Slip(support)
    assert slip.redistribution == "full"
    assert slip.evaluate(states).GT[0] == pytest.approx(0.0273075, abs=1e-6)


def test_the_default_keeps_normal_forces_where_they_are_unique():
    choices = {n: Slip(feet(corners(n))).redistribution for n in (3, 4, 6)}
    assert choices == {3: "tangential", 4: "full", 6: "full"}


def test_a_base_that_falls_between_walls_has_used_up_its_reserve():
    walls = [
        UnilateralContact(position=[-0.5, 0.0], normal=[1.0, 0.0], friction=0.5),
        UnilateralContact(position=[0.5, 0.0], normal=[-1.0, 0.0], friction=0.5),
    ]
    support = Support(walls, mass=2.0, center_of_mass=[0.0, 0.0], gravity=[0.0, -9.81])
    states = solve_many(support, support.weight[None])
    assert not states.persistent[0]
    reserve = Slip(support).evaluate(states)
    assert reserve.GT[0] == pytest.approx(1 + 9.81)
    assert reserve.gradient[0, :2] == pytest.approx([0.0, -0.5])


def test_no_states_are_a_valid_batch():
    support = uneven(np.random.default_rng(0), 4)
    states = solve_many(support, np.zeros((0, 6)))
    reserve = TipOver(support).evaluate(states)
    assert reserve.GN.shape == (0,)
    assert reserve.gradient.shape == (0, 6)
