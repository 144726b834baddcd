"""The search over all modes against brute force, and against pivoting."""

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.mode_search import EXHAUSTED, FOUND, LIMIT, find_motion, find_solution
from ocptip.contact.solver import solution_from_search, solve, solve_many
from ocptip.contact.states import NO_SOLUTION
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium
from studies.contact.random_supports import CLAMPS as RANDOM_CLAMPS
from studies.contact.random_supports import random_binding, random_support, random_wrenches
from tests.contact.contact_cases import (
    CLAMPS,
    KINDS,
    binding,
    disturbed_weight,
    feet,
    kind_name,
    mixed,
    parameters,
    polygon,
)
from tests.quick import THOROUGH, some


def mode_columns(system):
    """Columns of every combination of the contacts' usable modes."""
    lists = []
    for first, contact in zip(system.first_column, system.support.contacts, strict=True):
        automaton = contact.automaton
        lists.append([first + s for s in automaton.subsets[~automaton.redundant]])
    return [np.concatenate(choice) for choice in itertools.product(*lists)]


def right_hand_side(system, wrench):
    return system.rhs_matrix @ wrench + system.plain_rhs_offset


def brute_force_residual(system, wrench):
    """Smallest relative residual over all combinations of modes: zero if there is a solution."""
    rhs = right_hand_side(system, wrench)
    scale = np.max(np.abs(rhs)) or 1.0
    return min(nnls(system.plain_matrix[:, c], rhs / scale)[1] for c in mode_columns(system))


def brute_force_power(system, wrench):
    """Largest power of the wrench on the base's acceleration over all solutions (relative); 0: all stand."""
    support = system.support
    rhs = right_hand_side(system, wrench)
    scale = np.max(np.abs(rhs)) or 1.0
    # h' qdd = h' inv(M) (h + W K)
    per_force = support.wrench_matrix.T @ support.inverse_mass @ wrench
    constant = wrench @ support.inverse_mass @ wrench + per_force @ system.force_offset
    best = 0.0
    for c in mode_columns(system):
        program = linprog(
            -per_force @ system.force_matrix[:, c], A_eq=system.plain_matrix[:, c], b_eq=rhs / scale
        )
        if program.status == 0:
            best = max(best, constant - program.fun * scale)
    return best / max(wrench @ support.inverse_mass @ wrench, np.finfo(float).tiny)


def planar_pair(rng, kinds):
    contacts = [
        random_binding(rng, kinds[rng.integers(len(kinds))], p, q, 4)
        for p, q in zip(
            rng.uniform(-0.5, 0.5, (2, 2)),
            [0.0, 1.0] + rng.normal(size=(2, 2)) * rng.uniform(0.05, 1.5),
            strict=True,
        )
    ]
    return Support(contacts, mass=60.0, center_of_mass=[0.0, 0.6], inertia=rng.uniform(0.5, 6.0))


@pytest.mark.parametrize("seed", some(1, range(4)))
def test_a_solution_is_found_exactly_where_brute_force_finds_one(seed):
    rng = np.random.default_rng([5, seed])
    for _ in range(12 if seed else 2):
        support = planar_pair(rng, (UnilateralContact, *RANDOM_CLAMPS))
        for wrench in random_wrenches(rng, support, 2):
            result = find_solution(support.system, wrench)
            assert result.status in (FOUND, EXHAUSTED)
            assert (result.status == FOUND) == (brute_force_residual(support.system, wrench) < 1e-9)
            if result.status == FOUND:
                state = solution_from_search(support, wrench, result)
                assert state.residual < 1e-9
                assert state.states.law_violation()[0] < 1e-8


@pytest.mark.parametrize("seed", some(1, range(4)))
def test_a_motion_is_found_exactly_where_brute_force_finds_one(seed):
    rng = np.random.default_rng([6, seed])
    seen = set()
    for _ in range(12 if seed else 4):
        support = planar_pair(rng, (UnilateralContact, RigidClamp))
        wrench = disturbed_weight(rng, support, 1)[0]
        power = brute_force_power(support.system, wrench)
        if 1e-9 < power < 1e-4:
            continue
        result = find_motion(support.system, wrench)
        assert result.status == (FOUND if power > 1e-4 else EXHAUSTED)
        seen.add(result.status)
        if result.status == FOUND:
            state = solution_from_search(support, wrench, result)
            assert state.states.law_violation()[0] < 1e-8
            assert not state.persistent
    assert seen == {FOUND, EXHAUSTED}


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
@pytest.mark.parametrize("planar", [True, False], ids=["planar", "spatial"])
def test_what_pivoting_solves_the_search_solves_too(kind, planar):
    support = mixed(kind, planar=planar, facets=4)
    for load in disturbed_weight(np.random.default_rng(8), support, 10 if THOROUGH else 4):
        pivoted = solve(support, load)
        result = find_solution(support.system, load)
        assert result.status == FOUND
        found = solution_from_search(support, load, result)
        assert found.states.law_violation()[0] < 1e-8
        assert result.nodes < 300
        if not planar and kind is UnilateralContact:  # three feet: one solution
            np.testing.assert_allclose(found.acceleration, pivoted.acceleration, atol=1e-8)


@pytest.mark.slow
def test_random_solved_problems_are_never_declared_unsolvable():
    rng = np.random.default_rng(9)
    for i in range(12):
        support = random_support(rng, planar=i % 2 == 1, n=int(rng.integers(2, 5)))
        wrench = random_wrenches(rng, support, 1)[0]
        if solve_many(support, wrench[None], search=False).solved[0]:
            assert find_solution(support.system, wrench, max_nodes=300).status != EXHAUSTED


def narrow_support():
    """A rigid clamp and two feet within 5 cm, 0.65 m beside the centre of mass: ill-conditioned bases."""
    clamp = RigidClamp(
        position=[-0.47991253684111634, 0.0],
        normal=[-0.5199854913110462, -0.8541750926045607],
        friction_upper=0.15656334290138404,
        friction_lower=5.55728740044366,
    )
    upper = UnilateralContact(
        position=[-0.43606523969239286, 0.0],
        normal=[-0.8930408634938524, 0.4499755728149636],
        friction=4.855074743817799,
    )
    lower = UnilateralContact(
        position=[-0.4792925564544458, 0.0],
        normal=[-0.8124020276905374, -0.5830977151424136],
        friction=0.15233410283305926,
    )
    center = [0.3255681903156318, -0.958479402260775]
    return Support([clamp, upper, lower], mass=60.0, center_of_mass=center, inertia=0.11802380456192792)


NARROW_LOAD = np.array([154.86556416912762, 126.01690916411226, 0.5901418458674851])


def test_an_ill_conditioned_problem_with_a_solution_is_not_declared_unsolvable():
    """The word exhausted means proved; but balancing forces exist, and modes that fit to 1e-10."""
    support = narrow_support()
    assert equilibrium(support, NARROW_LOAD, cone=False).margin > 100.0
    assert brute_force_residual(support.system, NARROW_LOAD) < 1e-10
    assert find_solution(support.system, NARROW_LOAD).status != EXHAUSTED
    assert solve_many(support, NARROW_LOAD[None]).status_codes[0] != NO_SOLUTION


@pytest.mark.slow
def test_what_pivoting_solves_is_not_declared_unsolvable_near_the_ill_conditioned_problem():
    support = narrow_support()
    loads = NARROW_LOAD * (1 + 1e-3 * np.random.default_rng(0).normal(size=(200, 3)))
    solved = solve_many(support, loads, warm_start=False, search=False).solved
    assert solved.sum() > 3
    assert all(find_solution(support.system, load).status != EXHAUSTED for load in loads[solved])


@pytest.mark.parametrize("lateral", some(2, [100.0, 1.0, 0.3, 0.1]))
def test_a_slow_motion_is_a_motion_too(lateral):
    """A base on ice, jammed between two walls: it can slide along them, slowly compared with free fall."""
    floor = [UnilateralContact(position=p, friction=1e-5) for p in polygon(3)]
    walls = [
        UnilateralContact(position=[x, 0, 0.6], normal=[-np.sign(x), 0, 0], friction=1.0) for x in (-0.5, 0.5)
    ]
    support = Support([*floor, *walls], mass=60.0, center_of_mass=[0, 0, 0.6], inertia=[3, 4, 5])
    load = support.weight + np.array([0, lateral, 0, 0, 0, 0])
    sliding = solve(support, load)
    assert sliding.states.law_violation()[0] < 1e-8
    assert not sliding.persistent
    assert sliding.acceleration[1] > 1e-3
    assert find_motion(support.system, load).status == FOUND


def test_a_standing_base_without_load_has_no_motion():
    support = feet(polygon(4))
    assert find_motion(support.system, np.zeros(6)).status == EXHAUSTED


def test_free_fall_is_a_motion():
    support = feet(polygon(4))
    result = find_motion(support.system, np.array([0, 0, 50.0, 0, 0, 0]))
    assert result.status == FOUND
    state = solution_from_search(support, np.array([0, 0, 50.0, 0, 0, 0]), result)
    assert state.modes == ["separate"] * 4


@pytest.mark.parametrize("search", [find_solution, find_motion])
def test_a_search_that_is_cut_short_is_undecided(search):
    support = feet(polygon(4), facets=12)
    load = support.weight + np.array([50.0, 30.0, 0, 10.0, 5.0, 20.0])
    result = search(support.system, load, max_nodes=0)
    assert result.status == LIMIT
    assert result.subsets is None


@pytest.mark.parametrize("kind", CLAMPS, ids=kind_name)
def test_a_clamp_that_holds_has_no_motion(kind):
    support = Support([binding(kind, facets=6)], mass=5.0)
    assert find_motion(support.system, np.array([3.0, -2.0, -20.0, 0, 0, 0])).status == EXHAUSTED


@pytest.mark.parametrize("scale", some(1, [1e-6, 1.0, 1e6]))
def test_the_search_does_not_depend_on_the_unit_of_force(scale):
    contacts = [UnilateralContact(position=p, facets=6, **parameters(UnilateralContact)) for p in polygon(3)]
    support = Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6])
    stands, slides = support.weight, support.weight + np.array([500.0, 0, 0, 0, 0, 0])
    assert find_motion(support.system, scale * stands).status == EXHAUSTED
    assert find_motion(support.system, scale * slides).status == FOUND
    assert find_solution(support.system, scale * slides).status == FOUND
