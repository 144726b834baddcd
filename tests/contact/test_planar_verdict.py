"""Moving solutions on true cones: feet in one plane and others, against searches of their own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.cone_motion import ConeProblem, clearly_moving
from ocptip.contact.cone_search import find_cone_motion
from ocptip.contact.mode_search import EXHAUSTED, FOUND, LIMIT
from ocptip.contact.planar_verdict import feet_share_a_plane, find_planar_motion
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, stability
from studies.contact.random_supports import random_support, random_wrenches
from studies.contact.verdicts import (
    moves_by_projection,
    moves_with_fine_pyramids,
    random_load,
    random_stand,
    standing_case,
)
from tests.contact.contact_cases import feet, polygon
from tests.quick import some


def may_move(support, wrench, sectors):
    """False only if no solution on the true cones moves: modes by enumeration, a linear program for each.

    Friction of a foot that slides lies in its sector, at most mu N / cos(half a sector).
    The base's power must exceed 1e-4 of that of the free base.
    """
    n, inverse = support.n_contacts, support.inverse_mass
    size = np.max(np.abs(wrench))
    W = support.wrench_matrix.reshape(6, n, 3).swapaxes(0, 1)
    corners = 2 * np.pi * np.arange(sectors + 1) / sectors
    reach = 1 / np.cos(np.pi / sectors)

    def columns(k, mode):
        mu = support.contacts[k].friction
        if mode in ("free", "stick"):
            angles, radius = np.pi * np.arange(24) / 12, 1 / np.cos(np.pi / 24)
            return np.array([[1.0, mu * radius * np.cos(t), mu * radius * np.sin(t)] for t in angles])
        if mode == "separate":
            return np.zeros((0, 3))
        a, b = corners[mode], corners[mode + 1]
        pairs = ((a, 1.0), ((a + b) / 2, reach), (b, 1.0))
        return np.array([[1.0, -mu * r * np.cos(t), -mu * r * np.sin(t)] for t, r in pairs])

    def feasible(modes):
        forces = [columns(k, mode) for k, mode in enumerate(modes)]
        pushes = np.hstack([W[k] @ f.T for k, f in enumerate(forces)])
        # a = inverse (wrench + pushes x), in the unit of the load
        response, start = inverse @ pushes, inverse @ wrench / size
        upper, limit, equal, value = [-(wrench @ response)], [wrench @ start * (1 - 1e-4)], [], []
        for k, mode in enumerate(modes):
            u, u0 = W[k].T @ response, W[k].T @ start
            if mode in ("free", "separate"):
                upper, limit = [*upper, -u[0]], [*limit, u0[0]]
                continue
            equal, value = [*equal, u[0]], [*value, -u0[0]]
            if mode == "stick":
                equal, value = [*equal, u[1], u[2]], [*value, -u0[1], -u0[2]]
            else:
                for angle, sign in ((corners[mode], -1.0), (corners[mode + 1], 1.0)):
                    across = sign * np.array([-np.sin(angle), np.cos(angle)])  # inside where <= 0
                    upper, limit = [*upper, across @ u[1:]], [*limit, -across @ u0[1:]]
        if not pushes.shape[1]:
            return bool(np.all(np.array(limit) >= 0) and np.all(np.array(value) == 0))
        matrices = np.array(upper), limit, np.array(equal) if equal else None, value or None
        program = linprog(
            np.zeros(pushes.shape[1]), *matrices, options={"primal_feasibility_tolerance": 1e-10}
        )
        return program.status != 2

    def search(modes):
        if not feasible(modes):
            return False
        if "free" not in modes:
            return True
        k = modes.index("free")
        return any(search([*modes[:k], m, *modes[k + 1 :]]) for m in ("stick", "separate", *range(sectors)))

    return search(["free"] * n)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "sectors", "count"),
    [(3, 12, 3), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((4, 8, 2), (5, 8, 1)))],
)
def test_what_enumeration_of_modes_proves_is_strong(n, sectors, count):
    rng = np.random.default_rng([1, n])
    proved = 0
    for i in range(count):
        support, wrench = standing_case(rng, n, ("circle", "scattered")[i % 2])
        wrench = support.weight + 0.1 * (wrench - support.weight)
        result = stability(support, wrench)
        assert result.decided
        if not may_move(support, wrench, sectors):
            proved += 1
            assert result.strong
    assert proved


@pytest.mark.slow
@pytest.mark.parametrize("layout", some(1, ["scattered", "circle"]))
def test_no_stand_is_strong_that_another_search_sees_move(layout):
    rng = np.random.default_rng(2)
    words = []
    for i in range(10):
        support, wrench = standing_case(rng, int(rng.integers(3, 9)), layout)
        result = stability(support, wrench)
        words.append(result.verdict)
        assert result.decided
        if moves_by_projection(support, wrench, 16, 800, i) or moves_with_fine_pyramids(support, wrench):
            assert result.verdict == "weak"
    assert "strong" in words
    assert layout == "circle" or "weak" in words


def true_cone_violation(support, state):
    """Largest violation of the laws with true cones by a state's forces, relative to the load."""
    forces = np.einsum("kji,kj->ki", support.frames, state.forces)
    acceleration = support.inverse_mass @ (state.wrench + support.wrench_matrix @ forces.ravel())
    u = (acceleration @ support.wrench_matrix).reshape(-1, 3) * support.mass
    worst = 0.0
    for contact, K, v in zip(support.contacts, forces, u, strict=True):
        slip, limit = np.linalg.norm(v[1:]), contact.friction * K[0]
        worst = max(worst, -K[0], -v[0], min(K[0], v[0]), np.linalg.norm(K[1:]) - limit)
        if slip > 1e-9 * np.max(np.abs(state.wrench)):
            worst = max(worst, np.linalg.norm(K[1:] + limit * v[1:] / slip) * min(1.0, slip))
    return worst / np.max(np.abs(state.wrench))


@pytest.mark.slow
@pytest.mark.parametrize("n", some(1, [4, 12, 6, 8, 16]))
def test_counterexamples_obey_the_laws_with_true_cones(n):
    rng = np.random.default_rng([3, n])
    seen = 0
    while seen < 3:
        support, wrench = standing_case(rng, n, "scattered")
        result = stability(support, wrench)
        assert result.decided
        if result.counterexample is not None:
            seen += 1
            assert true_cone_violation(support, result.counterexample) < 1e-8
            assert result.counterexample.states.law_violation()[0] < 1e-8
            assert not result.counterexample.persistent


@pytest.mark.slow
@pytest.mark.parametrize("layout", some(1, ["scattered", "circle"]))
def test_both_searches_on_cones_say_the_same(layout):
    """Triangles of the motion in the plane against arcs of sliding of each foot."""
    rng = np.random.default_rng(4)
    seen = set()
    for _ in range(4):
        support, wrench = standing_case(rng, 3, layout)
        problem = ConeProblem.of(support, wrench)
        plane, arcs = find_planar_motion(problem, 20000), find_cone_motion(problem, 5000)
        assert plane.status == arcs.status
        seen.add(plane.status)
    assert EXHAUSTED in seen


def uneven():
    """Five feet on uneven ground and a load under which the facets used to decide the verdict."""
    places = [
        [0.2105, 0.0600, 0.0699], [-0.2877, 0.2691, 0.0544], [-0.3247, -0.3176, -0.0230],
        [0.1566, -0.2042, -0.0086], [0.3930, -0.1523, 0.0447],
    ]  # fmt: skip
    normals = [
        [-0.11988, 0.03470, 0.99218], [0.21416, -0.23505, 0.94810], [-0.06601, -0.11685, 0.99095],
        [0.21253, 0.12386, 0.96927], [-0.03882, 0.09714, 0.99451],
    ]  # fmt: skip
    friction = [0.5750, 0.7448, 0.4558, 0.6520, 0.5703]
    return places, normals, friction


@pytest.mark.parametrize("facets", some(3, [4, 16, 64, 6, 8, 12, 24]))
def test_facets_do_not_decide_on_uneven_ground(facets):
    contacts = [
        UnilateralContact(position=p, normal=q, friction=mu, facets=facets)
        for p, q, mu in zip(*uneven(), strict=True)
    ]
    support = Support(
        contacts, mass=63.346, center_of_mass=[-0.000144, 0.08886, 0.20608], inertia=[1.9103, 1.1970, 1.3439]
    )
    load = np.zeros(6)
    for force, point in (
        ([-28.134, 34.228, -27.554], [-0.30636, 0.14050, 0.68192]),
        ([-1.7329, -37.373, 6.7727], [0.39466, 0.44393, 0.58938]),
        ([-32.110, -177.528, -17.207], [-0.45738, 0.25377, 0.13729]),
    ):
        load += np.r_[force, np.cross(np.array(point) - support.center_of_mass, force)]
    result = stability(support, support.weight + load)
    assert (result.verdict, result.decided) == ("weak", True)
    assert true_cone_violation(support, result.counterexample) < 1e-8


@pytest.mark.parametrize("facets", [4, 8, 16, 64])
def test_a_motion_of_the_pyramids_alone_is_none(facets):
    """Under this load pivoting finds motions with 8 and with 16 facets, none with 12, 32, 64 or 128."""
    support = feet(polygon(4), facets=facets, friction=0.8)
    assert stability(support, [141.0, 76.0, -483.0, 38.0, -3.0, -60.0]).verdict == "strong"


def test_eight_feet_under_a_push_stand_for_sure():
    support = feet(polygon(8, 0.4), center_of_mass=[0, 0, 0.4], mass=50.0)
    result = stability(support, support.weight + np.array([20.0, 0, 0, 0, 0, 0]))
    assert result.strong
    assert result.nodes < 1000


@pytest.mark.parametrize("friction", some(1, [0.3, 2.0]))
@pytest.mark.parametrize("n", some(2, [3, 6, 4, 9]))
def test_where_nothing_can_stand_the_search_finds_how_it_moves(n, friction):
    """Ordinary contacts always have a solution: sliding, tipping about edges and corners, lifting off."""
    rng = np.random.default_rng([9, n])
    modes, seen = set(), 0
    while seen < 12:
        support = feet(polygon(n), friction=friction)
        load = support.weight + np.r_[rng.normal(size=3) * 300, rng.normal(size=3) * 150]
        if equilibrium(support, load).stands:
            continue
        seen += 1
        found = find_planar_motion(ConeProblem.of(support, load), 20000)
        assert found.status == FOUND
        assert true_cone_violation(support, found.state) < 1e-8
        modes.add(found.state.modes.count("separate"))
    assert modes & {n - 1, n - 2}  # about a corner, about an edge


def test_a_motion_in_which_one_foot_sticks_and_one_slides_is_found():
    """Five feet with much friction may hold this load, or tip about two of them."""
    places = [
        [0.281, 0.321, 0],
        [0.131, -0.452, 0],
        [-0.066, -0.253, 0],
        [-0.394, 0.145, 0],
        [-0.34, 0.427, 0],
    ]
    support = feet(
        places, friction=1.8265726, center_of_mass=[0, 0, 0.305962], inertia=[6.3787, 9.304, 7.338]
    )
    result = stability(support, [338.88, -341.27, -758.68, 99.75, -135.79, -77.34])
    assert result.verdict == "weak"
    assert {"stick", "slide"} <= set(result.counterexample.modes)
    assert true_cone_violation(support, result.counterexample) < 1e-8


@pytest.mark.parametrize("count", [1, 2, 3])
def test_feet_on_a_line_or_at_a_point_share_a_plane_too(count):
    positions = np.array([[-0.3, 0, 0], [0.3, 0, 0], [0.1, 0, 0]])[:count]
    support = feet(positions, center_of_mass=[positions[:, 0].mean(), 0, 0.5])
    assert feet_share_a_plane(support)
    assert stability(support, support.weight).strong  # in balance: no load drives a motion
    pushed = support.weight + np.array([0, 0, 0, 1.0, 0, 0])
    assert stability(support, pushed).verdict == "none"


def test_feet_of_one_stand_may_be_at_the_same_place():
    support = feet([*polygon(3), polygon(3)[0]])
    assert stability(support, support.weight + np.array([50.0, 0, 0, 0, 0, 0])).decided


def test_feet_that_share_no_plane():
    assert not feet_share_a_plane(feet([*polygon(3), [0, 0, 0.01]]))
    tilted = [replace(c, normal=[0.01 * k, 0, 1]) for k, c in enumerate(feet(polygon(3)).contacts)]
    assert not feet_share_a_plane(Support(tilted, mass=60.0))


def test_a_tilted_plane_is_a_plane():
    """The verdict does not depend on how the stand is turned."""
    rng = np.random.default_rng(6)
    axis, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    axis *= np.sign(np.linalg.det(axis))
    for layout in ("circle", "scattered"):
        support, wrench = standing_case(rng, 5, layout)
        turned = support.varied(
            [replace(c, position=axis @ c.position, normal=axis @ c.normal) for c in support.contacts],
            center_of_mass=axis @ support.center_of_mass,
            inertia=axis @ support.inertia @ axis.T,
        )
        assert feet_share_a_plane(turned)
        same = stability(turned, np.r_[axis @ wrench[:3], axis @ wrench[3:]])
        assert same.verdict == stability(support, wrench).verdict


def test_a_search_that_is_cut_short_says_how_far_it_came():
    support, wrench = standing_case(np.random.default_rng(7), 6, "scattered")
    result = find_planar_motion(ConeProblem.of(support, wrench), 0)
    assert (result.status, result.state) == (LIMIT, None)
    assert result.resolution > 0.5
    assert "degrees" in stability(support, wrench, max_nodes=0).explanation


@pytest.mark.parametrize("search", [find_planar_motion, find_cone_motion])
def test_nothing_drives_a_base_without_load(search):
    support = feet(polygon(4))
    assert search(ConeProblem.of(support, np.zeros(6)), 100).status == EXHAUSTED


@pytest.mark.parametrize("search", [find_planar_motion, find_cone_motion])
def test_free_fall_is_found(search):
    support = feet(polygon(4))
    found = search(ConeProblem.of(support, np.array([0, 0, 50.0, 0, 0, 0])), 1000)
    assert found.status == FOUND
    assert found.state.modes == ["separate"] * 4


# ------------------------------------------------------------------------------- little friction, and none


def cart(friction):
    positions = [[0.3, 0.25, 0], [0.3, -0.25, 0], [-0.3, -0.25, 0], [-0.3, 0.25, 0]]
    contacts = [UnilateralContact(position=p, friction=mu) for p, mu in zip(positions, friction, strict=True)]
    return Support(contacts, mass=40.0, center_of_mass=[0, 0, 0.5])


@pytest.mark.parametrize("mu", [0.0, 1e-6, 1e-5, 1e-4, 1e-3])
def test_little_friction_is_enough_for_little_force(mu):
    support = cart([mu] * 4)
    assert stability(support, support.weight).strong
    limit = mu * 40 * 9.81
    for share, word in ((0.5, "strong"), (1.5, "none")):
        push = share * limit if mu else 1e-3
        if mu == 0 and share < 1:
            continue
        result = stability(support, support.weight + np.array([push, 0, 0, 0, 0, 0]))
        assert result.verdict == word
        assert result.decided


def test_castors_hold_nothing_and_wheels_hold_the_cart():
    support = cart([0.5, 0.5, 0.0, 0.0])
    assert stability(support, support.weight).strong
    result = stability(support, support.weight + np.array([20.0, 0, 0, 0, 0, 0]))
    assert result.weak
    if result.counterexample is not None:
        assert true_cone_violation(support, result.counterexample) < 1e-8
    assert stability(cart([0.0] * 4), support.weight + np.array([20.0, 0, 0, 0, 0, 0])).verdict == "none"


@pytest.mark.parametrize("seed", some(1, range(3)))
def test_random_stands_with_castors(seed):
    rng = np.random.default_rng([8, seed])
    for _ in range(6):
        stand = random_stand(rng, 5, "scattered")
        contacts = [replace(c, friction=0.0) if k < 2 else c for k, c in enumerate(stand.contacts)]
        support = Support(contacts, mass=50.0, center_of_mass=stand.center_of_mass, inertia=[3.0, 4.0, 5.0])
        wrench = random_load(rng, support)
        result = stability(support, wrench)
        assert result.state.solved
        assert result.state.states.law_violation()[0] < 1e-8
        assert result.weak == equilibrium(support, wrench).stands
        assert not (result.strong and moves_by_projection(support, wrench, 16, 500, seed))


@pytest.mark.parametrize(("normal", "moves"), [(20.0, True), (3e7, False)])
def test_rounding_of_large_forces_is_no_motion(normal, moves):
    """A plank jammed at 3e7 N: forces that balance to 2e-4 N, 7e-12 of themselves, prove no motion."""
    contacts = [
        UnilateralContact(position=[x, 0.0], normal=[-np.sign(x), 0.0], friction=0.5) for x in (-0.5, 0.5)
    ]
    support = Support(contacts, mass=2.0)
    falling = solve_many(support, support.weight[None])
    upward = 9.81 + 1e-4
    forces = np.array([[[normal, -upward], [normal, upward]]])  # the tangents point down and up
    accelerations = np.array([[[0.0, -1e-4], [0.0, 1e-4]]])
    states = replace(falling, contact_forces=forces, contact_accelerations=accelerations)
    assert not states.persistent[0]
    assert clearly_moving(states)[0] == moves


@pytest.mark.parametrize("friction", [1.0, 1e-3, 1e-4, 1e-5, 1e-6])
def test_a_plank_jammed_by_little_friction_is_judged(friction):
    """Balance needs normal forces of 10 N / friction."""
    contacts = [
        UnilateralContact(position=[x, 0.0], normal=[-np.sign(x), 0.0], friction=friction)
        for x in (-0.5, 0.5)
    ]
    support = Support(contacts, mass=2.0)
    result = stability(support, support.weight)
    assert result.verdict == "weak"
    assert clearly_moving(result.counterexample.states)[0]


@pytest.mark.parametrize("cone", some(1, [True, False]), ids=["cone", "pyramid"])
def test_clamps_with_hardly_any_friction_are_judged(cone):
    """Forces of 1e6 times the load balance it to rounding of these forces, not of the load."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        support = random_support(rng)
        contacts = []
        for contact in support.contacts:
            names = [name for name in contact.parameter_names() if name.startswith("friction")]
            contacts.append(replace(contact, **dict.fromkeys(names, 1e-6)))
        support = Support(contacts, mass=60.0, center_of_mass=support.center_of_mass)
        wrench = random_wrenches(rng, support, 1)[0]
        assert equilibrium(support, wrench, cone=cone).programs >= 0
