"""The solver's symmetries (units, axes, mirror) and its exact derivatives, for every binding."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Support
from tests.contact.contact_cases import (
    GRAVITY,
    KINDS,
    assert_valid,
    disturbed_weight,
    feet,
    kind_name,
    mixed,
    parameters,
    polygon,
)
from tests.quick import examples, some

every_kind = pytest.mark.parametrize("kind", KINDS, ids=kind_name)
every_space = pytest.mark.parametrize("planar", [True, False], ids=["planar", "spatial"])


# ------------------------------------------------------------------------------------------- symmetries

finite = st.floats(-1.0, 1.0, allow_subnormal=False)
vectors = st.lists(finite, min_size=3, max_size=3).map(np.array)
loads_of_all_kinds = st.tuples(vectors, vectors).map(lambda v: np.r_[300 * v[0], 120 * v[1]])


def changed(kind, transform, *, force=1.0, length=1.0, mass=1.0):
    """A three-foot support (one foot of the given kind) in other units or turned by `transform`."""
    contacts = []
    for k, p in enumerate(polygon(3)):
        own = kind if k == 0 else UnilateralContact
        values = parameters(own)
        if "clamp_force" in values:
            values["clamp_force"] *= force
        normal, tangent = np.array([0.05 * k, 0.1, 1.0]), np.array([1.0, 0.3, 0.0])
        contacts.append(
            own(
                position=length * transform @ p,
                normal=transform @ normal,
                tangent=transform @ tangent,
                facets=5,
                **values,
            )
        )
    inertia = mass * length**2 * transform @ np.diag([3.0, 4.0, 5.0]) @ transform.T
    return Support(
        contacts,
        mass=60.0 * mass,
        center_of_mass=length * transform @ [0, 0, 0.6],
        inertia=(inertia + inertia.T) / 2,
        gravity=transform @ [0, 0, -GRAVITY],
    )


PLAIN = {kind: changed(kind, np.eye(3)) for kind in KINDS}


@examples(60)
@given(st.sampled_from(KINDS), loads_of_all_kinds, st.integers(-6, 6), st.integers(-3, 3))
def test_units_of_force_and_length_do_not_matter(kind, disturbance, force_exponent, length_exponent):
    force, length = 10.0**force_exponent, 10.0**length_exponent
    other = changed(kind, np.eye(3), force=force, length=length, mass=force)
    load = PLAIN[kind].weight + disturbance
    units = force * np.r_[1, 1, 1, length, length, length]
    state, scaled = solve(PLAIN[kind], load), solve(other, load * units)
    assert_valid(scaled.states)
    assert scaled.persistent == state.persistent
    factor = np.r_[1, 1, 1, 1 / length, 1 / length, 1 / length]
    size = np.max(np.abs(load)) / 60
    np.testing.assert_allclose(scaled.acceleration / factor, state.acceleration, atol=1e-7 * size)


@examples(60)
@given(st.sampled_from(KINDS), loads_of_all_kinds, vectors.filter(lambda v: np.linalg.norm(v) > 0.1))
def test_the_choice_of_base_axes_does_not_matter(kind, disturbance, axis):
    turn = Rotation.from_rotvec(3 * axis).as_matrix()
    other = changed(kind, turn)
    load = PLAIN[kind].weight + disturbance
    both = np.kron(np.eye(2), turn)
    state, turned = solve(PLAIN[kind], load), solve(other, both @ load)
    assert_valid(turned.states)
    assert turned.persistent == state.persistent
    size = np.max(np.abs(load)) / 60
    np.testing.assert_allclose(turned.acceleration, both @ state.acceleration, atol=1e-7 * size)


def test_a_mirrored_load_gives_the_mirrored_motion():
    support = feet(polygon(4), facets=4)
    load = support.weight + np.array([300.0, 40.0, 50.0, 20.0, -60.0, 30.0])
    mirror = np.array([1.0, -1, 1, -1, 1, -1])  # at the plane y = 0; moments are axial vectors
    one, other = solve(support, load), solve(support, mirror * load)
    np.testing.assert_allclose(other.acceleration, mirror * one.acceleration, atol=1e-9)


# ------------------------------------------------------------------------------------------ derivatives


@every_kind
@every_space
@pytest.mark.parametrize("n_clamps", some(1, [1, 2]))
def test_maps_are_the_derivatives_where_no_mode_changes(kind, planar, n_clamps):
    support = mixed(kind, planar=planar, n_clamps=n_clamps)
    loads = disturbed_weight(np.random.default_rng(21), support, 40, force=400.0)
    states = solve_many(support, loads)
    assert_valid(states)
    step = 1e-2
    checked, smallest = 0, np.full((len(loads), support.wrench_size), np.nan)
    for j in range(support.wrench_size):
        sides = []
        for sign in (1.0, -1.0):
            moved = loads + sign * step * np.eye(support.wrench_size)[j]
            sides.append(
                [solve_many(support, w[None], initial=s) for w, s in zip(moved, states, strict=True)]
            )
        for i, (up, down) in enumerate(zip(*sides, strict=True)):
            if np.any(up.subsets != states.subsets[i]) or np.any(down.subsets != states.subsets[i]):
                continue
            checked += 1
            force = (up.contact_forces[0] - down.contact_forces[0]) / (2 * step)
            acceleration = (up.contact_accelerations[0] - down.contact_accelerations[0]) / (2 * step)
            np.testing.assert_allclose(states.force_maps[i, :, :, j], force, atol=1e-6)
            np.testing.assert_allclose(states.acceleration_maps[i, :, :, j], acceleration, atol=1e-6)
            smallest[i, j] = 0
    assert checked > 0.5 * smallest.size


@every_kind
@every_space
def test_states_are_affine_in_the_wrench_within_a_basis(kind, planar):
    support = mixed(kind, planar=planar)
    loads = disturbed_weight(np.random.default_rng(5), support, 200)
    states = solve_many(support, loads, warm_start=False)
    pairs = 0
    for i in range(0, 200, 2):
        for j in range(i + 1, 200):
            if np.array_equal(states.subsets[i], states.subsets[j]):
                pairs += 1
                change = loads[j] - loads[i]
                force = states.contact_forces[i] + states.force_maps[i] @ change
                acceleration = states.contact_accelerations[i] + states.acceleration_maps[i] @ change
                np.testing.assert_allclose(force, states.contact_forces[j], atol=1e-8)
                np.testing.assert_allclose(acceleration, states.contact_accelerations[j], atol=1e-9)
                break
    assert pairs > 20


def test_one_state_s_map_is_its_batch_s_map():
    support = feet(polygon(4))
    states = solve_many(support, disturbed_weight(np.random.default_rng(0), support, 5))
    np.testing.assert_array_equal(states[3].force_map, states.force_maps[3])


@pytest.mark.parametrize("factor", [1e-9, 1e-6, 1e6, 1e9])
@pytest.mark.parametrize("clamped", [False, True])
def test_a_resting_base_of_unusual_inertia_has_the_same_normal_forces_and_derivatives(factor, clamped):
    def states(value):
        kind = ForceConstantHalfRigidClamp if clamped else UnilateralContact
        feet = [UnilateralContact(position=p, **parameters(UnilateralContact)) for p in polygon(3)[:2]]
        feet.append(kind(position=polygon(3)[2], **parameters(kind)))
        support = Support(feet, mass=60.0, center_of_mass=[0, 0, 0.6], inertia=value)
        return solve_many(support, support.weight + np.diag([20.0, -30.0, 10.0, 5.0, -8.0, 3.0]))

    inertia = np.array([3.0, 4.0, 5.0])
    usual, other = states(inertia), states(factor * inertia)
    assert usual.persistent.all()
    assert other.persistent.all()
    # three feet: normal forces are unique, how tangential forces pull against each other is not
    np.testing.assert_allclose(other.contact_forces[..., 0], usual.contact_forces[..., 0], atol=1e-9 * 600)
    np.testing.assert_allclose(other.force_maps[:, :, 0], usual.force_maps[:, :, 0], atol=1e-9)
    balanced = other.forces.sum(axis=1) + other.wrenches[:, :3]
    np.testing.assert_allclose(balanced, 0, atol=1e-9 * 600)
    sums = np.einsum("kij,skjw->siw", other.support.frames, other.force_maps)
    np.testing.assert_allclose(sums, np.broadcast_to(-np.eye(3, 6), sums.shape), atol=1e-9)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_a_moving_base_moves_with_its_own_inertia(factor):
    """A wheel on no contact that holds it: the free base's acceleration."""
    foot = UnilateralContact(position=[0.0, 0.0, -0.5], **parameters(UnilateralContact))
    support = Support([foot], mass=2.0, inertia=0.5 * factor)
    state = solve_many(support, [[0.0, 0.0, 30.0, 0.0, 0.0, 7.0]])[0]
    assert state.modes == ["separate"]
    np.testing.assert_allclose(state.acceleration, [0, 0, 15.0, 0, 0, 14.0 / factor], rtol=1e-9)
