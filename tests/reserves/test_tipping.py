import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import linprog

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load, Support
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver, largest_least
from studies.contact.random_supports import random_support, random_wrenches
from tests.quick import examples, some
from tests.reserves.reserve_scenes import (
    CLAMPS,
    GRAVITY,
    HEIGHT,
    MASS,
    RADIUS,
    clamp,
    clamped,
    corners,
    differences,
    feet,
    relative_errors,
    wrenches,
)


def one(support, *loads):
    return solve_many(support, [support.wrench(loads)])


@pytest.mark.parametrize("n", [3, 4, 5, 6, 8])
def test_reference_moment_of_a_regular_polygon(n):
    tip_over = TipOver(feet(corners(n, turn=0.3)))
    inradius = RADIUS * np.cos(np.pi / n)
    assert tip_over.reference_moment == pytest.approx(0.1 * MASS * GRAVITY * inradius, rel=1e-9)
    assert len(tip_over.axes) == n


def test_reference_moment_is_the_inscribed_circle_of_a_triangle():
    tip_over = TipOver(feet(np.array([[0.0, 0, 0], [0.4, 0, 0], [0, 0.3, 0]])))
    assert tip_over.reference_moment == pytest.approx(0.1 * MASS * GRAVITY * 0.1)  # 3-4-5: inradius 1


def test_weight_over_the_middle_of_a_square():
    support = feet(corners(4))
    tip_over = TipOver(support)
    reserve = tip_over.evaluate(one(support))
    moment = MASS * GRAVITY * RADIUS / np.sqrt(2)
    np.testing.assert_allclose(reserve.moments, [[moment] * 4], rtol=1e-9)
    assert reserve.GN[0] == pytest.approx(1 / 11)
    np.testing.assert_allclose(reserve.normal_reserves.sum(), MASS * GRAVITY)


def test_contacts_inside_the_polygon_and_on_its_edges_give_no_axes():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0, 0], [0.3, 0.4, 0], [1, 1, 0]])
    tip_over = TipOver(feet(square, center=(0.5, 0.5, 0.5)))
    assert sorted(axis.contacts for axis in tip_over.axes) == [(0, 1), (1, 2), (2, 3), (3, 0)]
    np.testing.assert_allclose(tip_over.axes[0].lift, [0, 0, 1, 1, 0, 0.4, 1], atol=1e-15)


@pytest.mark.parametrize("corner", range(3))
def test_load_exactly_above_a_foot_tips(corner):
    places = corners(3)
    support = feet(places, center=(*places[corner][:2], HEIGHT))
    assert TipOver(support).evaluate(one(support)).GN[0] == pytest.approx(1.0, abs=1e-9)


def test_tipping_adds_the_largest_normal_acceleration():
    support = feet(corners(4))
    states = one(support, Load(force=(0, 0, -500.0), point=(1.0, 1.0, 0)))
    reserve = TipOver(support).evaluate(states)
    assert reserve.tip_ratio[0] == pytest.approx(1.0)
    assert reserve.lift_acceleration[0] == pytest.approx(states.contact_accelerations[0, :, 0].max())
    assert reserve.GN[0] > 1.1
    axis = TipOver(support).axes[reserve.nearest_axis[0]]
    assert axis.lift[reserve.lifting_contact[0]] > 0


def test_lift_off_without_a_tipping_axis():
    """Two walls that face each other and a floor: no rotation about two contacts lifts the base."""
    contacts = [
        UnilateralContact(position=(x, y, 0.3), normal=(-np.sign(x), 0, 0), friction=0.3)
        for x in (-0.3, 0.3)
        for y in (-0.2, 0.2)
    ]
    contacts += [UnilateralContact(position=(x, 0, 0), friction=0.3) for x in (-0.2, 0.2)]
    support = Support(contacts, mass=10.0, center_of_mass=(0, 0, 0.3))
    reserve = TipOver(support).evaluate(solve_many(support, [-2 * support.weight]))
    assert reserve.tip_ratio[0] == 1
    assert reserve.GN[0] == pytest.approx(1 + 2 * GRAVITY)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_contacts_on_one_line_always_tip(n):
    support = feet(np.array([[0.0, 0, 0], [0.5, 0, 0], [0.2, 0, 0]])[:n], center=(0.2, 0, 0.5))
    tip_over = TipOver(support)
    assert tip_over.free_rotation
    assert [axis.contacts for axis in tip_over.axes] == [[], [(0, 1), (1, 0)], [(0, 1), (1, 0)]][n - 1]
    reserve = tip_over.evaluate(one(support))
    assert reserve.tip_ratio[0] == 1
    assert np.all(np.isfinite(reserve.gradient))
    two_clamps = Support([clamp(RigidClamp, p) for p in corners(2)])
    assert TipOver(two_clamps).free_rotation


def test_three_rigid_clamps_cannot_tip():
    support = Support([clamp(RigidClamp, p) for p in corners(3)], center_of_mass=(0, 0, 1))
    tip_over = TipOver(support)
    assert tip_over.axes == ()
    assert tip_over.reference_moment is None
    reserve = tip_over.evaluate(one(support))
    assert reserve.GN[0] == 0
    assert reserve.nearest_axis[0] == -1
    assert np.all(np.isinf(reserve.normal_reserves))
    np.testing.assert_array_equal(reserve.gradient, np.zeros((1, 6)))


def test_axes_pass_through_clamps_that_cannot_separate():
    places = corners(5)
    contacts = [UnilateralContact(position=p, friction=0.5) for p in places]
    contacts[2] = clamp(ForceVariableHalfRigidClamp, places[2])
    tip_over = TipOver(Support(contacts))
    assert tip_over.axes
    assert all(2 in axis.contacts and axis.lift[2] == 0 for axis in tip_over.axes)


def test_reserve_of_constant_clamps_includes_the_clamp_force():
    support = clamped(ForceConstantHalfRigidClamp)
    reserve = TipOver(support).evaluate(one(support))
    normals = one(support).contact_forces[:, :, 0]
    np.testing.assert_allclose(reserve.normal_reserves, normals + np.array([150, 150, 0, 0]))


def test_two_sided_clamps_yield_in_both_directions():
    support = Support([clamp(ForceConstantTwoSidedClamp, p) for p in corners(3)], mass=MASS)
    tip_over = TipOver(support)
    assert len(tip_over.axes) == 6
    states = one(support)
    reserve = tip_over.evaluate(states)
    normals = states.contact_forces[0, :, 0]
    nearest = np.minimum(normals + 345.0, 150 * (1 + 1 / 1.3) - normals)
    np.testing.assert_allclose(reserve.normal_reserves[0], nearest)
    smallest = np.min(nearest) * RADIUS * 1.5
    np.testing.assert_allclose(reserve.moments.min(), smallest)


def test_planar_support():
    contacts = [
        UnilateralContact(position=(x, 0.0), normal=(0, 1), friction=0.5) for x in (0.0, 0.4, 0.6, 0.6)
    ]
    support = Support(contacts, mass=10.0, center_of_mass=(0.2, 0.3))
    tip_over = TipOver(support)
    assert sorted((axis.contacts, float(axis.direction[0])) for axis in tip_over.axes) == [
        ((0, 0), 1.0),
        ((2, 2), -1.0),
    ]
    assert tip_over.reference_moment == pytest.approx(0.1 * 10 * GRAVITY * 0.3)
    reserve = tip_over.evaluate(one(support))
    assert np.min(reserve.moments) == pytest.approx(10 * GRAVITY * 0.2)
    assert TipOver(Support(contacts[:1])).free_rotation


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, "x"])
def test_reference_moment_must_be_positive(value):
    with pytest.raises(InputError, match="reference_moment"):
        TipOver(feet(corners(3)), reference_moment=value)


def test_reference_moment_is_needed_without_gravity():
    support = feet(corners(3), gravity=(0, 0, 0))
    with pytest.raises(InputError, match="gravity is zero"):
        TipOver(support)
    assert TipOver(support, 7.0).reference_moment == 7.0


def test_states_of_another_support_are_refused():
    with pytest.raises(InputError, match="another support"):
        TipOver(feet(corners(3))).evaluate(one(feet(corners(3))))


SUPPORTS = {
    **{f"{n} feet": lambda n=n: feet(corners(n)) for n in (3, 4, 6)},
    **{kind.kind: lambda kind=kind: clamped(kind) for kind in CLAMPS},
    "planar": lambda: random_support(np.random.default_rng(5), clamps=False, planar=True, n=3),
}


@pytest.mark.parametrize("name", SUPPORTS)
def test_gradients_against_central_differences(name):
    support = SUPPORTS[name]()
    at = wrenches(np.random.default_rng(1), support, 60)
    states = solve_many(support, at, warm_start=False)
    tip_over = TipOver(support)
    reserve = tip_over.evaluate(states)
    reference, same = differences(support, at, lambda s: tip_over.evaluate(s).GN)
    assert same.sum() > 20
    assert np.max(relative_errors(reserve.gradient, reference)[same]) < 1e-6
    for i in range(len(tip_over.axes)):
        reference, _ = differences(support, at, lambda s, i=i: tip_over.evaluate(s).moments[:, i])
        assert np.max(np.abs(reserve.moment_gradients[:, i] - reference)[same]) < 1e-5


@examples(40)
@given(seed=st.integers(0, 10**6))
@example(seed=5392)  # no load beside large preloads
@example(seed=293092)  # hardly any
def test_ratio_is_between_0_and_1_and_moments_are_affine(seed):
    rng = np.random.default_rng(seed)
    support = random_support(rng, planar=rng.random() < 0.2)
    states = solve_many(support, random_wrenches(rng, support, 6))
    reserve = TipOver(support).evaluate(states)
    ok = states.solved
    assert np.all((reserve.tip_ratio[ok] >= 0) & (reserve.tip_ratio[ok] <= 1))
    assert np.all(np.isnan(reserve.GN[~ok]))
    scale = np.maximum(np.max(np.abs(states.contact_forces), axis=(1, 2)), 1e-2)
    stands = ok
    if not TipOver(support).on_plane:
        stands = ok & states.persistent & (Slip(support).evaluate(states).GT < 1)
    if not TipOver(support).on_plane:  # cone programs, whose forces reach the preloads of clamps
        preload = max(getattr(contact, "clamp_force", 0.0) for contact in support.contacts)
        scale = 10 * np.maximum(scale, np.max(np.abs(reserve.moments), axis=1, initial=preload))
    assert np.all(reserve.moments[stands] >= -1e-8 * scale[stands, None])
    assert np.all(np.isfinite(reserve.gradient[ok]))


@examples(25)
@given(seed=st.integers(0, 10**6))
def test_rotating_the_base_axes_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R = R * np.sign(np.linalg.det(R))
    places = np.vstack([corners(3), rng.uniform(-0.3, 0.3, (2, 3)) * [1, 1, 0]])
    plain = feet(places)
    turned = Support(
        [
            UnilateralContact(position=R @ p, normal=R[:, 2], tangent=R[:, 0], friction=0.5, facets=12)
            for p in places
        ],
        mass=MASS,
        center_of_mass=R @ [0, 0, HEIGHT],
        inertia=R @ np.diag([3.0, 4.0, 5.0]) @ R.T,
        gravity=R @ [0, 0, -GRAVITY],
    )
    assert TipOver(turned).reference_moment == pytest.approx(TipOver(plain).reference_moment, rel=1e-9)
    at = wrenches(rng, plain, 5)
    rotated = np.hstack([at[:, :3] @ R.T, at[:, 3:] @ R.T])
    a, b = (
        TipOver(plain).evaluate(solve_many(plain, at)),
        TipOver(turned).evaluate(solve_many(turned, rotated)),
    )
    # Five feet that slide can do so under several normal forces; which of them is found depends on the axes.
    ok = a.states.persistent & b.states.persistent
    np.testing.assert_allclose(np.sort(a.moments[ok]), np.sort(b.moments[ok]), rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(a.GN[ok], b.GN[ok], rtol=1e-7)


def test_a_rotation_that_a_rigid_clamp_blocks_is_no_axis():
    places = corners(4)
    contacts = [UnilateralContact(position=p, friction=0.5) for p in places]
    contacts[0] = clamp(RigidClamp, places[0])
    contacts[2] = clamp(RigidClamp, places[2])
    tip_over = TipOver(Support(contacts))
    assert tip_over.axes == ()


@pytest.mark.parametrize("seed", some(8, range(40)))
def test_largest_least_is_that_of_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    m, n = rng.integers(1, 12, size=2)
    A = rng.uniform(size=(m, n)) * (rng.uniform(size=(m, n)) < rng.choice([0.4, 1.0]))
    if seed % 3 == 0:  # many rows and columns that are alike
        A = np.tile(np.round(A, 1), (2, 2))
    m, n = A.shape
    ahead = np.hstack([-A, np.ones((m, 1))])
    sums = np.r_[np.ones(n), 0.0][None]
    found = linprog(np.r_[np.zeros(n), -1.0], ahead, np.zeros(m), sums, [1.0], [(0, None)] * (n + 1))
    assert largest_least(A) == pytest.approx(found.x[-1], abs=1e-12)
