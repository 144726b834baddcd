"""The solver: the contact laws hold, no matter how degenerate; symmetries, derivatives, honest failure."""

import json

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact import solver
from ocptip.contact.bindings import laws, pyramid
from ocptip.contact.bindings.clamps import ForceConstantTwoSidedClamp, RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve, solve_many, solve_randomly
from ocptip.contact.states import ARRAYS
from ocptip.contact.support import Support
from studies.contact.peers import PinocchioADMM
from studies.contact.random_supports import random_support, random_wrenches
from tests.contact.contact_cases import (
    CLAMPS,
    GRAVITY,
    KINDS,
    assert_valid,
    binding,
    disturbed_weight,
    feet,
    kind_name,
    mixed,
    parameters,
    platform_loads,
    polygon,
)
from tests.oracles.exact_lemke import exact_stewart_trinkle
from tests.quick import some

WEIGHT = 60 * GRAVITY
every_kind = pytest.mark.parametrize("kind", KINDS, ids=kind_name)
every_space = pytest.mark.parametrize("planar", [True, False], ids=["planar", "spatial"])


# ----------------------------------------------------------------------------------- random problems


@pytest.mark.parametrize("seed", some(1, range(10)))
def test_random_problems_are_all_solved(seed):
    """20,000 problems in ten parts: all bindings, planar and spatial, exactly degenerate, 1e-9 to 1e6 N."""
    rng = np.random.default_rng([77, seed])
    for i in range(50):
        support = random_support(rng, clamps=i % 3 > 0, planar=i % 4 == 3)
        states = solve_many(support, random_wrenches(rng, support, 40), warm_start=bool(i % 2))
        assert_valid(states)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_many_more_random_problems_are_all_solved(seed):
    rng = np.random.default_rng([78, seed])
    for i in range(1000):
        support = random_support(rng, planar=i % 4 == 3)
        assert_valid(solve_many(support, random_wrenches(rng, support, 50), warm_start=bool(i % 2)))


# ------------------------------------------------------------------------------ exact rational oracle


def exact(support, wrench):
    friction = np.array([c.friction for c in support.contacts])
    facets = support.contacts[0].facets
    return exact_stewart_trinkle(
        support.wrench_matrix, support.inverse_mass, friction, facets, np.asarray(wrench)
    )


@pytest.mark.slow
@pytest.mark.parametrize("facets", some(1, [4, 5, 6, 8]))
def test_three_coplanar_feet_move_as_in_exact_arithmetic(facets):
    """Three feet on a plane with moderate friction have one solution: 200 loads in four parts."""
    rng = np.random.default_rng(facets)
    for _ in range(10):
        support = feet(
            rng.uniform(-0.5, 0.5, (3, 3)) * [1, 1, 0], facets=facets, friction=rng.uniform(0.1, 0.5)
        )
        loads = platform_loads(rng, 5)
        states = solve_many(support, loads)
        assert_valid(states)
        for i, load in enumerate(loads):
            oracle = exact(support, load)
            assert oracle.residual == 0
            np.testing.assert_allclose(states.acceleration[i], oracle.acceleration, atol=1e-9)
            assert states.persistent[i] == (np.max(np.abs(oracle.acceleration)) < 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("n", some(1, [2, 4, 5]))
def test_exact_solutions_and_ours_obey_the_same_laws(n):
    """Where the solution need not be unique: 120 problems, both are put into the independent check."""
    rng = np.random.default_rng(n)
    for _ in range(20):
        contacts = [
            UnilateralContact(position=p, normal=[*q, 1.0], friction=rng.uniform(0.1, 1.5), facets=4)
            for p, q in zip(rng.uniform(-0.5, 0.5, (n, 3)), rng.normal(size=(n, 2)), strict=True)
        ]
        support = Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6], inertia=[3, 4, 5])
        loads = random_wrenches(rng, support, 2)
        states = solve_many(support, loads, warm_start=False)
        assert_valid(states)
        for i, load in enumerate(loads):
            oracle = exact(support, load)
            accelerations = (oracle.acceleration @ support.wrench_matrix).reshape(n, 3)
            unit = max(states.scale[i] * support.mass, np.finfo(float).tiny)
            for k, contact in enumerate(contacts):
                force, acceleration = oracle.forces[k][None], accelerations[k][None]
                breach = laws.law_violation(contact, force, acceleration, unit, support.mass)[0]
                assert breach < 1e-9


# -------------------------------------------------------------------- platform benchmark, degenerate loads


@pytest.mark.parametrize("n", [3, 4, 6, 8])
@pytest.mark.parametrize("facets", [4, 12])
def test_standing_platform_benchmark_is_solved_completely(n, facets):
    support = feet(polygon(n), facets=facets)
    states = solve_many(support, platform_loads(np.random.default_rng(0), 200), warm_start=False)
    assert_valid(states)
    assert 20 < np.sum(states.persistent) < 180
    assert np.max(states.pivots) < 150


DEGENERATE = {
    "pure gravity": ([0, 0, -WEIGHT, 0, 0, 0], True),
    "200 N lateral": ([200, 0, -WEIGHT, 0, 0, 0], None),
    "400 N lateral": ([400, 0, -WEIGHT, 0, 0, 0], False),
    "300 N m tip": ([0, 0, -WEIGHT, 0, 300, 0], False),
    "100 N lift": ([0, 0, 100, 0, 0, 0], False),
    "zero load": ([0, 0, 0, 0, 0, 0], True),
    "1e-12 N load": ([0, 0, -1e-12, 0, 0, 0], True),
    "1e-12 N lift": ([0, 0, 1e-12, 0, 0, 0], False),
}


@pytest.mark.parametrize("n", [4, 8])
@pytest.mark.parametrize("facets", [4, 8, 12])
@pytest.mark.parametrize(("load", "stands"), list(DEGENERATE.values()), ids=list(DEGENERATE))
def test_degenerate_loads_are_solved(n, facets, load, stands):
    support = feet(polygon(n), facets=facets)
    state = solve(support, load)
    assert_valid(state.states)
    assert stands is None or state.persistent == stands
    if state.persistent:
        np.testing.assert_allclose(np.sum(state.forces, axis=0), -np.array(load[:3], dtype=float), atol=1e-9)
    else:
        assert state.acceleration @ np.array(load, dtype=float) > 0


def test_four_hundred_newtons_overcome_the_friction_by_the_difference():
    support = feet(polygon(4) * [1, 1, 0] + [0, 0, 0.6], facets=4)  # feet level with the centre of mass
    state = solve(support, [400.0, 0, -WEIGHT, 0, 0, 0])
    limit = pyramid.corrected_friction(0.5, 4) * WEIGHT
    np.testing.assert_allclose(state.acceleration, [(400 - limit) / 60, 0, 0, 0, 0, 0], atol=1e-9)
    assert state.modes == ["slide"] * 4


# --------------------------------------------------------------------------------- Pinocchio's problems

CUBE = [[x, y, -0.5] for x in (-0.5, 0.5) for y in (-0.5, 0.5)]


@pytest.mark.parametrize("share", [0.0, 0.9, 1.1])
def test_cube_of_pinocchio_s_unit_test(share):
    """10 kg, 1 m, mu 0.4: at 0.9 of the slip force it stands, at 1.1 it accelerates by 0.1 f_slip / m."""
    contacts = [UnilateralContact(position=p, friction=0.4, facets=8) for p in CUBE]
    cube = Support(contacts, mass=10.0, inertia=10.0 / 6)
    slip = pyramid.corrected_friction(0.4, 8) * 10.0 * GRAVITY  # along a face
    # as in the original, the force acts so that the cube does not tip: at the height of the ground
    load = cube.weight + np.r_[share * slip, 0, 0, np.cross([0, 0, -0.5], [share * slip, 0, 0])]
    state = solve(cube, load)
    assert state.persistent == (share < 1)
    expected = [max(share - 1, 0) * slip / 10.0, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(state.acceleration, expected, atol=1e-9)
    np.testing.assert_allclose(
        np.sum(state.forces, axis=0), [-min(share, 1) * slip, 0, 10 * GRAVITY], atol=1e-8
    )


@pytest.mark.parametrize("n", [3, 4, 6])
def test_resultants_agree_with_pinocchio_where_pyramid_and_cone_do(n):
    admm = PinocchioADMM()
    assert admm.available(), "Pinocchio is a dependency of the package"
    support = feet(polygon(n), facets=32, friction=0.5)
    loads = platform_loads(np.random.default_rng(1), 30)
    states = solve_many(support, loads)
    stood, moved = 0, 0
    for i, load in enumerate(loads):
        peer = admm.solve(support.wrench_matrix, support.inverse_mass, np.full(n, 0.5), 32, load)
        if not peer.converged:
            continue
        rests = np.max(np.abs(peer.acceleration)) < 1e-6
        if rests != states.persistent[i]:
            continue  # between pyramid and cone
        resultant = states.forces[i].sum(axis=0)
        theirs = np.einsum("kij,kj->i", support.frames, peer.forces)
        if rests:
            stood += 1
            np.testing.assert_allclose(resultant, theirs, atol=1e-5)
        elif n == 3 and "separate" not in states.modes(i):
            moved += 1
            free = np.linalg.norm(load[:3]) / support.mass
            assert np.linalg.norm(states.acceleration[i][:3] - peer.acceleration[:3]) < 0.02 * free
    assert stood > 5
    assert n > 3 or moved > 1


# ------------------------------------------------------------------------------- planar against spatial


@every_kind
def test_planar_support_moves_as_the_spatial_one_of_the_same_geometry(kind):
    """Two feet in the plane against four in space, each with half the clamp force, loads in the plane.

    In space the first face of the pyramid looks along x, so that its slope, mu_S, is the plane's mu.
    """
    facets = 4
    values = parameters(kind)
    if kind is ForceConstantTwoSidedClamp:
        values["clamp_force"] = 500.0  # enough for the weight
    small = {name: v * 0.5 if name.startswith("friction") else v for name, v in values.items()}
    flat = {
        name: pyramid.corrected_friction(v, facets) if name.startswith("friction") else v
        for name, v in small.items()
    }
    half = {name: v / 2 if name == "clamp_force" else v for name, v in small.items()}
    planar = Support(
        [kind(position=[x, 0.0], normal=[0, 1], **flat) for x in (-0.4, 0.3)],
        mass=60.0,
        center_of_mass=[0.0, 0.6],
        inertia=4.0,
    )
    spatial = Support(
        [kind(position=[x, y, 0.0], facets=facets, **half) for x in (-0.4, 0.3) for y in (-0.2, 0.2)],
        mass=60.0,
        center_of_mass=[0.0, 0.0, 0.6],
        inertia=[3.0, 4.0, 5.0],
    )
    rng = np.random.default_rng(11)
    loads = disturbed_weight(rng, planar, 60, force=400.0, moment=150.0)
    lifted = np.zeros((60, 6))
    lifted[:, [0, 2, 4]] = loads * [1, 1, -1]  # from x to z is the negative turn about y
    two, four = solve_many(planar, loads), solve_many(spatial, lifted)
    assert_valid(two)
    assert_valid(four)
    assert 5 < np.sum(two.persistent) < 55
    np.testing.assert_array_equal(two.persistent, four.persistent)
    np.testing.assert_allclose(four.acceleration[:, [0, 2, 4]] * [1, 1, -1], two.acceleration, atol=1e-8)


# ---------------------------------------------------------------------------------- warm starts, batches


def smooth_path(support, count=400):
    """Loads along a closed curve: standing, sliding, tipping and back."""
    t = np.linspace(0, 2 * np.pi, count)
    load = np.outer(np.ones(count), support.weight)
    load[:, 0] += 300 * np.sin(t)
    load[:, 1] += 150 * np.sin(2 * t)
    load[:, 4] += 150 * np.sin(3 * t)
    return load


def test_warm_and_cold_starts_agree_where_the_solution_is_unique():
    support = feet(polygon(3), facets=12)
    path = smooth_path(support)
    warm, cold = solve_many(support, path), solve_many(support, path, warm_start=False)
    assert_valid(warm)
    assert_valid(cold)
    assert set(warm.persistent) == {True, False}
    np.testing.assert_allclose(warm.acceleration, cold.acceleration, atol=1e-9)
    np.testing.assert_allclose(warm.forces.sum(axis=1), cold.forces.sum(axis=1), atol=1e-7)
    assert warm.pivots.sum() < 0.7 * cold.pivots.sum()


def test_a_cold_state_does_not_depend_on_its_neighbours():
    support = mixed(UnilateralContact)
    loads = disturbed_weight(np.random.default_rng(0), support, 20)
    batch = solve_many(support, loads, warm_start=False)
    for i in (0, 7, 19):
        alone = solve(support, loads[i])
        np.testing.assert_allclose(alone.forces, batch[i].forces, atol=1e-10)
        np.testing.assert_array_equal(alone.states.subsets[0], batch.subsets[i])


@every_kind
@every_space
def test_continuation_from_a_solved_state_starts_in_its_basis(kind, planar):
    support = mixed(kind, planar=planar)
    first = solve(support, support.weight)
    again = solve_many(support, support.weight[None] * 1.0001, initial=first)
    assert_valid(again)
    assert again.attempts[0] == 0
    assert again.pivots[0] == 0
    np.testing.assert_array_equal(again.subsets[0], first.states.subsets[0])


def test_continuation_in_parts_equals_one_run():
    support = feet(polygon(3), facets=8)
    path = smooth_path(support, 100)
    whole = solve_many(support, path)
    first = solve_many(support, path[:60])
    second = solve_many(support, path[60:], initial=first[59])
    assert second.attempts[0] == 0
    parts = np.vstack([first.acceleration, second.acceleration])
    np.testing.assert_allclose(parts, whole.acceleration, atol=1e-9)


def test_continuation_from_another_support_is_refused():
    one, other = feet(polygon(3)), feet(polygon(3))
    with pytest.raises(InputError, match=r"^initial: "):
        solve_many(one, one.weight[None], initial=solve(other, other.weight))


@every_kind
@every_space
def test_states_in_no_order_start_from_any_known_basis(kind, planar):
    support = mixed(kind, planar=planar)
    loads = disturbed_weight(np.random.default_rng(1), support, 200)
    states, neighbours = solve_many(support, loads, warm_start="any"), solve_many(support, loads)
    assert_valid(states)
    np.testing.assert_array_equal(states.persistent, neighbours.persistent)
    assert np.sum(states.pivots == 0) > np.sum(neighbours.pivots == 0)


@pytest.mark.parametrize("n", [3, 5, 8])
def test_states_in_no_order_have_the_motion_and_resultant_of_those_from_scratch(n):
    """With 8 feet some loads have two solutions: the platform stands, or it tips."""
    support = feet(polygon(n), facets=12)
    path = np.random.default_rng(n).permutation(smooth_path(support))
    states, cold = (solve_many(support, path, warm_start=how) for how in ("any", False))
    assert_valid(states)
    assert set(states.persistent) == {True, False}
    differ = states.persistent != cold.persistent
    assert np.sum(differ) <= (len(path) // 50 if n == 8 else 0)
    stands = states.persistent
    np.testing.assert_allclose(states.forces[stands].sum(axis=1), -path[stands, :3], atol=1e-7)
    if n == 3:
        np.testing.assert_allclose(states.acceleration, cold.acceleration, atol=1e-9)
    assert states.pivots.sum() < 0.5 * cold.pivots.sum()


@pytest.mark.parametrize("warm_start", [True, False, "any"])
def test_results_do_not_depend_on_the_number_of_threads(warm_start, monkeypatch):
    monkeypatch.setattr(solver, "_CHUNK", 64)
    support = feet(polygon(4), facets=8)
    path = np.random.default_rng(5).permutation(smooth_path(support))
    one, *others = (solve_many(support, path, warm_start=warm_start, threads=t) for t in (1, 2, 3, None))
    assert_valid(one)
    for name in ARRAYS:
        for other in others:
            np.testing.assert_array_equal(getattr(other, name), getattr(one, name))


def test_chunks_do_not_depend_on_each_other(monkeypatch):
    monkeypatch.setattr(solver, "_CHUNK", 64)
    support = feet(polygon(4), facets=8)
    path = smooth_path(support)
    whole = solve_many(support, path, warm_start="any")
    part = solve_many(support, path[64:128], warm_start="any")
    np.testing.assert_array_equal(part.contact_forces, whole.contact_forces[64:128])
    scratch = solve_many(support, path, warm_start=False)
    monkeypatch.setattr(solver, "_CHUNK", 4096)
    np.testing.assert_array_equal(
        solve_many(support, path, warm_start=False).contact_forces, scratch.contact_forces
    )


def test_known_bases_beyond_the_memory_replace_the_least_used(monkeypatch):
    support = feet(polygon(5), facets=12)
    loads = platform_loads(np.random.default_rng(2), 400)
    for memory in (1, 3):
        monkeypatch.setattr(solver, "_MEMORY", memory)
        assert_valid(solve_many(support, loads, warm_start="any"))


@every_kind
def test_a_single_state_is_that_of_a_batch_of_one(kind):
    support = mixed(kind)
    for load in disturbed_weight(np.random.default_rng(9), support, 20):
        batch, state = solve_many(support, load[None]), solve(support, load)
        for name in ARRAYS:
            np.testing.assert_allclose(
                getattr(state.states, name), getattr(batch, name), rtol=1e-9, atol=1e-9, err_msg=name
            )


def test_a_single_state_does_not_depend_on_the_form_of_its_wrench():
    support = feet(polygon(3))
    (load,) = disturbed_weight(np.random.default_rng(9), support, 1)
    fixed = load.copy()
    fixed.setflags(write=False)
    forms = (load, load.tolist(), np.repeat(load, 2)[::2], fixed)
    states = [solve(support, wrench) for wrench in forms]
    for state in states:
        np.testing.assert_allclose(state.forces, states[0].forces, atol=1e-9)
    whole = np.array([3, -2, -600, 1, 2, 3])
    np.testing.assert_allclose(solve(support, whole).forces, solve(support, whole.astype(float)).forces)


def test_a_single_state_keeps_its_own_wrench():
    support = feet(polygon(3))
    load = support.weight.copy()
    state = solve(support, load)
    load[:] = 0.0
    np.testing.assert_array_equal(state.wrench, support.weight)


def test_bad_options_of_batches_are_refused():
    support = feet(polygon(3))
    with pytest.raises(InputError, match=r"^threads: "):
        solve_many(support, support.weight[None], threads=0)
    with pytest.raises(InputError, match=r"^warm_start: .* 'any'"):
        solve_many(support, support.weight[None], warm_start="some")


def test_no_states_are_a_valid_batch():
    support = feet(polygon(3))
    states = solve_many(support, np.zeros((0, 6)))
    assert len(states) == 0
    assert states.forces.shape == (0, 3, 3)
    assert states.acceleration.shape == (0, 6)
    assert states.force_maps.shape == (0, 3, 3, 6)
    assert states.acceleration_maps.shape == (0, 3, 3, 6)
    assert states.law_violation().shape == states.persistent.shape == (0,)


# ------------------------------------------------------------------- dependent rows, few contacts, limits


@pytest.mark.parametrize("kind", CLAMPS, ids=kind_name)
@pytest.mark.parametrize("n", [4, 6, 8])
def test_many_coplanar_clamps_carry_what_they_must(kind, n):
    """Rigid and force-variable clamps then have dependent rows: the distribution of forces is open."""
    clamps = [kind(position=p, facets=6, **parameters(kind)) for p in polygon(n)]
    support = Support(clamps, mass=60.0, center_of_mass=[0, 0, 0.6], inertia=[3, 4, 5])
    loads = disturbed_weight(np.random.default_rng(n), support, 60, force=500.0, moment=200.0)
    states = solve_many(support, np.vstack([support.weight, np.zeros(6), loads]))
    assert_valid(states)
    assert states.persistent[:2].all()
    stands = states.persistent
    resultant = states.contact_forces.reshape(len(states), -1) @ support.wrench_matrix.T
    np.testing.assert_allclose(resultant[stands], -states.wrenches[stands], atol=1e-6)


@every_kind
def test_base_that_turns_about_the_line_of_its_two_contacts_does_not_stand(kind):
    """No contact point accelerates, and still the base falls over."""
    contacts = [kind(position=[x, 0.0, 0.0], **parameters(kind)) for x in (-0.4, 0.4)]
    support = Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6])
    load = 0.5 * support.weight  # what the yielding clamps can carry
    assert solve(support, load).persistent
    falling = solve(support, load + np.array([0, 0, 0, 6.0, 0, 0]))
    assert_valid(falling.states)
    assert falling.acceleration[3] > 0.1
    assert not falling.persistent


@every_kind
@every_space
def test_base_on_one_contact_balances_only_forces_through_it(kind, planar):
    contact = binding(kind, planar=planar)
    up = np.eye(2 if planar else 3)[-1]
    support = Support([contact], mass=10.0, center_of_mass=0.5 * up)
    assert solve(support, support.weight).persistent
    tipped = support.weight.copy()
    tipped[support.dimension :] += 1.0
    state = solve(support, tipped)
    assert_valid(state.states)
    assert not state.persistent


@every_kind
def test_pulling_a_contact_off(kind):
    """Only contacts that can give way upwards do so, at the force of their preload."""
    support = Support([binding(kind)], mass=1.0)
    low, _ = laws.normal_range(support.contacts[0])
    beyond = solve(support, [0, 0, -1.01 * low + 1, 0, 0, 0] if np.isfinite(low) else [0, 0, 1e5, 0, 0, 0])
    assert beyond.persistent == np.isinf(low)
    if np.isfinite(low):
        assert beyond.acceleration[2] == pytest.approx(1 - 0.01 * low)
        assert beyond.modes[0] in ("separate", "yield")
        assert solve(support, [0, 0, -0.99 * low - 1e-6, 0, 0, 0]).persistent


def test_free_fall_has_no_contact_forces():
    support = feet(polygon(4))
    state = solve(support, [0, 0, 10.0, 0, 0, 0])
    assert state.modes == ["separate"] * 4
    np.testing.assert_array_equal(state.forces, 0.0)
    np.testing.assert_allclose(state.acceleration, [0, 0, 1 / 6, 0, 0, 0])


def test_crushed_jam_between_two_walls_is_solved():
    """Contacts that face each other, pressed by nothing, by little, and by a lot."""
    walls = [
        UnilateralContact(position=[x, 0, 0], normal=[-np.sign(x), 0, 0], friction=1.2, facets=8)
        for x in (-0.3, 0.3)
    ]
    support = Support(walls, mass=10.0)
    loads = np.array([0, 1e-9, 1.0, 1e6])[:, None] * disturbed_weight(np.random.default_rng(0), support, 1)
    assert_valid(solve_many(support, loads, warm_start=False))


# ----------------------------------------------------------------------------------- honesty and evidence


def random_problem(seed, number, count):
    """Random support `number` of a seed and its `count` wrenches."""
    rng = np.random.default_rng(seed)
    for i in range(number + 1):
        support = random_support(rng, planar=i % 4 == 3)
        wrenches = random_wrenches(rng, support, count)
    return support, wrenches


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number", "state"), [(0, 448, 13), (7, 314, 22)])
def test_what_random_starts_solve_is_not_given_up(seed, number, state):
    """Clamps in space: most random starts end in a solution, so one must be found."""
    support, wrenches = random_problem([78, seed], number, 50)
    assert solve_randomly(support, wrenches[state], 100).solved.sum() > 50
    assert_valid(solve_many(support, wrenches[state][None]))


@pytest.mark.slow
def test_where_pivoting_finds_nothing_it_says_so_and_the_search_decides(monkeypatch):
    monkeypatch.setattr(solver, "_ATTEMPTS", 3)  # without random starts
    support, wrenches = random_problem(1, 395, 40)  # in the plane, three clamps, these paths end in a ray
    pivoted = solve_many(support, wrenches, search=False)
    lost = ~pivoted.solved
    assert lost.any()
    assert np.isnan(pivoted.forces[lost]).all()
    assert np.isnan(pivoted.force_maps[lost]).all()
    assert np.isnan(pivoted.law_violation()[lost]).all()
    assert not pivoted.persistent[lost].any()
    state = pivoted[int(np.flatnonzero(lost)[0])]
    assert "no solution: " in state.status
    assert "clamp that yields" in state.status
    assert state.modes == ["unknown"] * support.n_contacts
    decided = solve_many(support, wrenches)
    assert_valid(decided)
    assert np.all(decided.attempts[lost] == -1)


def test_basic_values_and_residual_reproduce_the_state():
    support = mixed(CLAMPS[1])
    states = solve_many(support, disturbed_weight(np.random.default_rng(2), support, 20))
    system = support.system
    for i in range(20):
        columns = np.concatenate(
            [
                system.first_column[k] + contact.automaton.subsets[states.subsets[i, k]]
                for k, contact in enumerate(support.contacts)
            ]
        )
        x = np.zeros(system.plain_matrix.shape[1])
        x[columns] = states.basic[i]
        assert np.all(states.basic[i] >= 0)
        right = system.rhs_matrix @ states.wrenches[i] + system.plain_rhs_offset
        assert np.max(np.abs(system.plain_matrix @ x - right)) < 1e-9 * np.max(np.abs(right))
        forces = system.force_matrix @ x + system.force_offset
        np.testing.assert_allclose(forces, states.contact_forces[i].ravel(), atol=1e-9)


def test_a_wrong_state_is_seen_by_the_law_check():
    """The check must not be blind: forces of another load violate the laws."""
    support = feet(polygon(3))
    states = solve_many(support, disturbed_weight(np.random.default_rng(3), support, 10))
    swapped = type(states)(
        **{**{f: getattr(states, f) for f in states.__dataclass_fields__}, "wrenches": states.wrenches[::-1]}
    )
    assert np.min(swapped.law_violation()) > 1e-3


def test_states_can_be_selected_and_indexed():
    support = feet(polygon(3))
    states = solve_many(support, disturbed_weight(np.random.default_rng(4), support, 6))
    part = states.select([4, 1])
    assert len(part) == 2
    np.testing.assert_array_equal(part.forces[0], states.forces[4])
    np.testing.assert_array_equal(states[-1].forces, states[5].forces)
    with pytest.raises(IndexError):
        states[6]


def test_a_state_is_plain_data_for_json():
    support = feet(polygon(3))
    data = json.loads(json.dumps(solve(support, support.weight).to_dict()))
    assert data["persistent"] is True
    assert data["modes"] == ["stick"] * 3
    assert np.shape(data["forces"]) == (3, 3)


BAD_WRENCHES = [
    [0.0] * 5,
    [0.0] * 7,
    [[0.0] * 6],
    3.0,
    None,
    "down",
    [0, 0, float("nan"), 0, 0, 0],
    [0, 0, float("inf"), 0, 0, 0],
    [0, 0, 1j, 0, 0, 0],
    np.array([0, 0, 1j, 0, 0, 0]),
    ["0", "0", "-1", "0", "0", "0"],
]


@pytest.mark.parametrize("wrench", BAD_WRENCHES, ids=str)
def test_bad_wrenches_are_refused(wrench):
    with pytest.raises(InputError, match=r"^wrench: "):
        solve(feet(polygon(3)), wrench)


@pytest.mark.parametrize("wrenches", [np.zeros(6), np.zeros((2, 3)), np.full((1, 6), np.nan)], ids=str)
def test_bad_batches_are_refused(wrenches):
    with pytest.raises(InputError, match=r"^wrenches: "):
        solve_many(feet(polygon(3)), wrenches)


def test_planar_supports_take_three_numbers():
    support = feet([[-0.4, 0.0], [0.4, 0.0]])
    assert solve(support, support.weight).persistent
    with pytest.raises(InputError, match=r"^wrench: expected shape 3, got 6"):
        solve(support, np.zeros(6))


def test_input_arrays_are_not_changed():
    support = feet(polygon(3))
    loads = disturbed_weight(np.random.default_rng(6), support, 5)
    before = loads.copy()
    solve_many(support, loads)
    np.testing.assert_array_equal(loads, before)


@pytest.mark.parametrize("tilt", [0.0, 15.0, 24.0, 27.0, 40.0])
def test_block_on_a_slope_slides_beyond_its_friction_angle(tilt):
    """mu = 0.5: 26.57 degrees. In the plane the cone is exact."""
    angle = np.radians(tilt)
    support = feet(
        [[-0.4, 0.0], [0.4, 0.0]],
        center_of_mass=[0.0, 0.1],
        gravity=GRAVITY * np.array([np.sin(angle), -np.cos(angle)]),
    )
    state = solve(support, support.weight)
    assert state.persistent == (np.tan(angle) < 0.5)
    expected = max(GRAVITY * (np.sin(angle) - 0.5 * np.cos(angle)), 0.0)
    np.testing.assert_allclose(state.acceleration, [expected, 0, 0], atol=1e-9)


def test_rigid_clamp_brakes_in_proportion_to_its_normal_force_in_both_directions():
    clamp = RigidClamp(position=[0.0, 0.0], normal=[0, 1], friction_upper=0.7, friction_lower=0.4)
    support = Support([clamp], mass=1.0)
    for vertical, limit in ((-100.0, 70.0), (100.0, 40.0)):
        state = solve(support, [limit + 5.0, vertical, 0.0])
        np.testing.assert_allclose(state.acceleration, [5.0, 0, 0], atol=1e-9)
        assert solve(support, [limit - 5.0, vertical, 0.0]).persistent
