"""Feet on a plane without cone programs: the same friction utilisation and forces as with them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.support import Support
from ocptip.reserves.equal_compliance import equal_sharing
from ocptip.reserves.feet_on_plane import feet_on_plane
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.standing.margins import Margins
from tests.quick import examples

RECTANGLE = [0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]


def stand_on(places, friction, **base):
    contacts = [UnilateralContact(position=p, friction=f) for p, f in zip(places, friction, strict=True)]
    return Support(contacts, **{"mass": 30.0, "center_of_mass": [0.0, 0.0, 0.4], **base})


def random_support(rng, n=4, casters=0):
    """A convex polygon with different coefficients, on a plane that leans in its base axes."""
    angles = 2 * np.pi / n * (np.arange(n) + rng.uniform(-0.38, 0.38, n))
    places = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)]) * rng.uniform(0.2, 0.5)
    turn = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)).as_matrix()
    friction = rng.permutation(np.append(rng.uniform(0.2, 1.2, n - casters), np.zeros(casters)))
    support = stand_on(places @ turn.T, friction, gravity=-9.81 * turn[:, 2])
    contacts = [replace(contact, normal=turn[:, 2]) for contact in support.contacts]
    return support.varied(contacts, center_of_mass=turn @ [0.02, -0.01, 0.3]), turn


def random_wrenches(rng, support, turn, count):
    force = rng.uniform(-1, 1, (count, 3)) * [80, 80, 60] - [0, 0, 300]
    moment = rng.uniform(-1, 1, (count, 3)) * [30, 30, 20]
    return np.hstack([force @ turn.T, moment @ turn.T])


KINDS = (
    (3, 0),
    (3, 1),
    (4, 0),
    (4, 1),
    (4, 2),
    (5, 0),
    (6, 0),
    (6, 2),
    (6, 4),
    (9, 0),
    (12, 3),
)  # feet, casters among them


@examples(25)
@given(st.integers(0, 10**6), st.sampled_from(KINDS))
def test_the_usage_is_the_optimum_of_the_cone_program(seed, kind):
    rng = np.random.default_rng(seed)
    support, turn = random_support(rng, *kind)
    wrenches = random_wrenches(rng, support, turn, 10)
    states, shared = solve_resting(support, wrenches), feet_on_plane(support).share(wrenches)
    optimum = Slip(support).evaluate(states, derivatives=False)
    sure = np.isfinite(shared.usage) & states.persistent & optimum.solved
    np.testing.assert_allclose(shared.usage[sure], optimum.GT[sure], atol=2e-9)
    # what needs more than the friction there is does not hold
    moves = np.isfinite(shared.usage) & ~states.persistent & states.solved
    assert np.all(shared.usage[moves] > 1 - 1e-6)
    equal = equal_sharing(states)  # None for three: then forces are unique
    forces, used = (equal.normal_forces, equal.usage) if equal else (optimum.normal_forces, optimum.usage)
    np.testing.assert_allclose(shared.normal_forces[sure], forces[sure], atol=1e-6)
    np.testing.assert_allclose(shared.friction_used[sure], used[sure], atol=1e-6)


@pytest.mark.parametrize("kind", [(6, 0), (12, 0), (4, 2), (6, 4)])
def test_nearly_all_states_on_many_feet_are_certain(kind):
    """The others are left to the cone program."""
    rng = np.random.default_rng(5)
    support, turn = random_support(rng, *kind)
    shared = feet_on_plane(support).share(random_wrenches(rng, support, turn, 300))
    pressed = np.isfinite(shared.normal_forces).all(axis=1)
    assert np.count_nonzero(pressed) > 50
    assert np.mean(np.isnan(shared.usage[pressed])) < 0.02


def test_nearly_all_states_are_certain_and_all_kinds_of_optima_occur():
    rng = np.random.default_rng(1)
    support, turn = random_support(rng)
    wrenches = random_wrenches(rng, support, turn, 400)
    equal = equal_sharing(solve_resting(support, wrenches))
    pressed = np.all(equal.if_all_pressed > 1.0, axis=1)
    shared = feet_on_plane(support).share(wrenches)
    assert np.count_nonzero(pressed) > 100
    assert np.mean(np.isfinite(shared.usage[pressed])) > 0.99
    assert not np.isfinite(shared.usage[np.any(equal.if_all_pressed < 0, axis=1)]).any()
    square = stand_on([[0.3, 0.3, 0], [0.3, -0.3, 0], [-0.3, -0.3, 0], [-0.3, 0.3, 0]], [0.5] * 4)
    twist = feet_on_plane(square).share(square.wrench()[None] + [[0, 0, 0, 0, 0, 10.0]])
    radius, weight = 0.3 * np.sqrt(2), square.mass * 9.81
    assert twist.usage[0] == pytest.approx(10.0 / (0.5 * weight * radius))
    push = feet_on_plane(square).share(square.wrench()[None] + [[30.0, 0, 0, 0, -30.0 * 0.4, 0]])
    assert push.usage[0] == pytest.approx(30.0 / (0.5 * weight))
    assert feet_on_plane(square).share(square.wrench()[None]).usage[0] == 0.0


@examples(15)
@given(st.integers(0, 10**6), st.sampled_from(KINDS))
def test_margins_are_the_same_with_and_without_a_contact_solver(seed, kind):
    rng = np.random.default_rng(seed)
    support, turn = random_support(rng, *kind)
    wrenches = random_wrenches(rng, support, turn, 20) * [1, 1, 1, 2, 2, 1]
    tip_over, slip = TipOver(support), Slip(support)
    quick = Margins.under(wrenches, tip_over, slip)
    slow = Margins.of(solve_resting(support, wrenches), tip_over, slip)
    # near the limit the contact solver's pyramids decide otherwise than cones, by the state before
    clear = np.abs(slow.GT - 1) > 0.1
    np.testing.assert_array_equal(quick.stable[clear], slow.stable[clear])
    assert quick.note == slow.note
    holds = quick.stable & slow.stable  # a base that moves may have several motions
    for name in ("GN", "GT", "tipping_moment", "edge_distance", "min_foot_force", "friction_used"):
        own, other = getattr(quick[holds], name), getattr(slow[holds], name)
        np.testing.assert_allclose(own, other, atol=1e-5, err_msg=name)


@pytest.mark.parametrize(
    "support",
    [
        stand_on(RECTANGLE[:3], [0.5, 0.0, 0.0]),
        stand_on(RECTANGLE, [0.5, 0.5, 0.5, 0.001]),
        stand_on([*RECTANGLE[:3], [-0.3, 0.2, 0.1]], [0.5] * 4),
        stand_on([[x, 0, 0] for x in (-0.3, -0.1, 0.1, 0.3)], [0.5] * 4),
        Support([UnilateralContact(position=p, friction=0.5, stiffness=1e5) for p in RECTANGLE], mass=30.0),
    ],
    ids=["one with friction", "slippery", "no plane", "a line", "springs"],
)
def test_other_supports_have_none(support):
    assert feet_on_plane(support) is None
