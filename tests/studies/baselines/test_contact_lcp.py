"""The two conventional contact formulations: mechanics, agreement with each other, exact arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.pyramid import corrected_friction, edge_directions, face_directions
from studies.baselines.contact_lcp import PairwiseContactProblem, StewartTrinkleContactProblem
from studies.baselines.lemke import solve_lcp, solve_lcp_many
from tests.oracles.exact_lemke import exact_stewart_trinkle
from tests.quick import some

FORMULATIONS = (PairwiseContactProblem, StewartTrinkleContactProblem)
MASS = 60.0
WEIGHT = MASS * 9.81


def standing_platform(feet, friction=0.5, height=0.6, facets=4, mass=MASS):
    """Arguments (W, inverse mass, friction, facets) of a platform on feet on a circle of radius 0.35 m.

    Base axes: z up; contact axes n = z, t1 = x, t2 = y; centre of mass `height` above the feet.
    """
    angles = 2.0 * np.pi * np.arange(feet) / feet + np.pi / feet
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    W = np.zeros((6, 3 * feet))
    for k, angle in enumerate(angles):
        position = np.array([0.35 * np.cos(angle), 0.35 * np.sin(angle), -height])
        W[:3, 3 * k : 3 * k + 3] = axes.T
        W[3:, 3 * k : 3 * k + 3] = np.cross(position, axes).T
    inertia = np.array([mass, mass, mass, 3.0, 4.0, 5.0])
    return W, np.diag(1.0 / inertia), np.full(feet, friction), facets


def standing_loads(count, seed=0):
    """Wrenches (count, 6) from rest to sliding and tipping [N, N m]."""
    rng = np.random.default_rng(seed)
    loads = np.empty((count, 6))
    for load in loads:
        level = rng.uniform(0.0, 1.0)
        load[:2] = rng.normal(size=2) * 250.0 * level
        load[2] = -WEIGHT + rng.normal() * 150.0 * level
        load[3:] = rng.normal(size=3) * [90.0, 90.0, 60.0] * level
    return loads


def solve(problem, wrench, rule="lexicographic"):
    answer = solve_lcp(problem.lcp_matrix(), problem.q(wrench), rule)
    assert answer.status == "solved"
    return problem.recover(answer.z, wrench)


def law_violation(arguments, forces, acceleration):
    """Largest violation of the contact laws on the pyramid, all quantities in newtons."""
    W, _, friction, facets = arguments
    worst = 0.0
    motions = MASS * (W.T @ acceleration).reshape(-1, 3)
    for mu, force, motion in zip(friction, forces, motions, strict=True):
        radius = corrected_friction(mu, facets) * force[0]
        reserves = radius - face_directions(facets) @ force[1:]
        worst = max(worst, -motion[0], -force[0], min(force[0], motion[0]), -reserves.min())
        # No force of the polygon opposes the slip more than the actual one does.
        vertices = radius / np.cos(np.pi / facets) * edge_directions(facets)
        deficit = force[1:] @ motion[1:] - (vertices @ motion[1:]).min()
        worst = max(worst, deficit / max(1.0, np.linalg.norm(motion), np.linalg.norm(force)))
    return worst


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("facets", some(2, [4, 5, 3, 12]))
@pytest.mark.parametrize("feet", some(2, [3, 8, 1, 4]))
def test_rest_under_gravity(formulation, feet, facets):
    arguments = standing_platform(feet, facets=facets)
    # A single foot carries only what passes through it.
    column = arguments[0][:, 0] if feet == 1 else np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    wrench = -WEIGHT * column
    forces, acceleration = solve(formulation(*arguments), wrench)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-10)
    np.testing.assert_allclose(arguments[0] @ forces.ravel(), -wrench, atol=1e-8)
    assert law_violation(arguments, forces, acceleration) < 1e-8


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("feet", [3, 4, 6])
def test_sliding_starts_at_the_friction_limit(formulation, feet):
    facets = 6
    arguments = standing_platform(feet, height=0.05, facets=facets)
    limit = corrected_friction(0.5, facets) * WEIGHT
    problem = formulation(*arguments)
    for part in (0.9, 1.1):
        wrench = np.array([part * limit, 0.0, -WEIGHT, 0.0, 0.0, 0.0])
        forces, acceleration = solve(problem, wrench)
        assert acceleration[0] == pytest.approx(max(part - 1.0, 0.0) * limit / MASS, abs=1e-9)
        np.testing.assert_allclose(acceleration[1:3], 0.0, atol=1e-9)
        assert forces[:, 0].sum() == pytest.approx(WEIGHT)
        assert law_violation(arguments, forces, acceleration) < 1e-8


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_tipping_starts_at_the_edge_of_support(formulation):
    arguments = standing_platform(4, friction=1.0)
    limit = WEIGHT * 0.35 * np.cos(np.pi / 4)
    problem = formulation(*arguments)
    for part, tips in ((0.95, False), (1.05, True)):
        forces, acceleration = solve(problem, np.array([0.0, 0.0, -WEIGHT, 0.0, part * limit, 0.0]))
        assert (acceleration[4] > 1e-3) == tips
        lifted = (arguments[0].T @ acceleration).reshape(-1, 3)[:, 0] > 1e-6
        assert lifted.sum() == (2 if tips else 0)
        np.testing.assert_allclose(forces[lifted], 0.0, atol=1e-9)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_lifted_platform_is_free(formulation):
    arguments = standing_platform(4, facets=6)
    wrench = np.array([20.0, -5.0, 40.0, 0.0, 0.0, 3.0])
    forces, acceleration = solve(formulation(*arguments), wrench)
    np.testing.assert_allclose(forces, 0.0, atol=1e-9)
    np.testing.assert_allclose(acceleration, arguments[1] @ wrench, atol=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("facets", some(1, [6, 4, 12]))
@pytest.mark.parametrize("feet", some(2, [3, 6, 4, 8]))
def test_answers_obey_the_contact_laws(formulation, feet, facets):
    arguments = standing_platform(feet, facets=facets)
    problem = formulation(*arguments)
    loads = standing_loads(40, seed=feet)
    batch = solve_lcp_many(problem.lcp_matrix(), problem.q(loads))
    assert batch.solved.all()
    for z, load in zip(batch.z, loads, strict=True):
        forces, acceleration = problem.recover(z, load)
        assert law_violation(arguments, forces, acceleration) < 1e-7


@pytest.mark.parametrize("facets", some(2, [4, 5, 3, 6, 12]))
def test_formulations_agree_on_three_feet(facets):
    arguments = standing_platform(3, facets=facets)
    loads = standing_loads(100, seed=1)
    accelerations = []
    for formulation in FORMULATIONS:
        problem = formulation(*arguments)
        batch = solve_lcp_many(problem.lcp_matrix(), problem.q(loads))
        assert batch.solved.all()
        accelerations.append([problem.recover(z, h)[1] for z, h in zip(batch.z, loads, strict=True)])
    np.testing.assert_allclose(accelerations[0], accelerations[1], atol=1e-8)
    moves = np.abs(accelerations[0]).max(axis=1) > 1e-6
    assert 10 < moves.sum() < 90


@pytest.mark.slow
@pytest.mark.parametrize("facets", [4, 5])
def test_formulations_agree_with_exact_arithmetic(facets):
    arguments = standing_platform(3, facets=facets)
    problems = [formulation(*arguments) for formulation in FORMULATIONS]
    for load in standing_loads(8, seed=2):
        exact = exact_stewart_trinkle(*arguments, load)
        assert exact.residual == 0
        assert law_violation(arguments, exact.forces, exact.acceleration) < 1e-8
        for problem in problems:
            forces, acceleration = solve(problem, load)
            np.testing.assert_allclose(acceleration, exact.acceleration, atol=1e-9)
            np.testing.assert_allclose(
                arguments[0] @ forces.ravel(), arguments[0] @ exact.forces.ravel(), atol=1e-7
            )


@pytest.mark.parametrize("feet", some(1, [4, 6]))
def test_exact_arithmetic_solves_indeterminate_feet(feet):
    arguments = standing_platform(feet)
    gravity = np.array([0.0, 0.0, -WEIGHT, 0.0, 0.0, 0.0])
    push, tilt = 200.0 * np.eye(6)[0], 300.0 * np.eye(6)[3]
    for load in (gravity, gravity + push, gravity + tilt):
        exact = exact_stewart_trinkle(*arguments, load)
        assert exact.residual == 0
        assert law_violation(arguments, exact.forces, exact.acceleration) < 1e-8
    rest = exact_stewart_trinkle(*arguments, gravity)
    np.testing.assert_array_equal(rest.acceleration, 0.0)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_ties_decide_between_failure_and_success(formulation):
    """The textbook ratio test fails on four feet; tolerant ones do not (200 loads)."""
    problem = formulation(*standing_platform(4))
    M, Q = problem.lcp_matrix(), problem.q(standing_loads(200))
    assert solve_lcp_many(M, Q, "textbook").solved.sum() < 150
    assert solve_lcp_many(M, Q, "lexicographic").solved.all()
    assert solve_lcp_many(M, Q, "largest-pivot").solved.all()


SYMMETRIC_LOADS = {
    "gravity": [0, 0, -WEIGHT, 0, 0, 0],
    "push": [200, 0, -WEIGHT, 0, 0, 0],
    "slide": [400, 0, -WEIGHT, 0, 0, 0],
    "tip": [0, 0, -WEIGHT, 300, 0, 0],
    "lift": [0, 0, 100, 0, 0, 0],
    "nothing": [0, 0, 0, 0, 0, 0],
    "tiny": [0, 0, -1e-12, 0, 0, 0],
}

# The largest pivot is no protection against cycling: here every tie is exact.
MAY_CYCLE = {(StewartTrinkleContactProblem, "largest-pivot", 8, "slide")}


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("rule", ["lexicographic", "largest-pivot"])
@pytest.mark.parametrize("feet", [4, 8])
@pytest.mark.parametrize("load", SYMMETRIC_LOADS)
def test_symmetric_loads(formulation, rule, feet, load):
    arguments = standing_platform(feet)
    wrench = np.array(SYMMETRIC_LOADS[load], dtype=float)
    problem = formulation(*arguments)
    answer = solve_lcp(problem.lcp_matrix(), problem.q(wrench), rule)
    if (formulation, rule, feet, load) in MAY_CYCLE:
        assert answer.status in ("solved", "pivot limit")
        return
    assert answer.solved
    forces, acceleration = problem.recover(answer.z, wrench)
    assert law_violation(arguments, forces, acceleration) <= 1e-10 * np.abs(wrench).max()


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("factor", [1e-4, 1e4])
def test_mass_of_the_base_does_not_matter(formulation, factor):
    W, inverse_mass, friction, facets = standing_platform(6)
    problem = formulation(W, inverse_mass, friction, facets)
    scaled = formulation(W, inverse_mass / factor, friction, facets)
    loads = standing_loads(50, seed=4)
    batch = solve_lcp_many(scaled.lcp_matrix(), scaled.q(factor * loads))
    assert batch.solved.all()
    np.testing.assert_allclose(scaled.lcp_matrix(), problem.lcp_matrix(), atol=1e-12)


@pytest.mark.parametrize("facets", some(2, range(3, 17)))
def test_pairwise_map_holds_for_any_forces_and_accelerations(facets):
    """y = A x + b is an identity: for any x the y are the accelerations and reserves of x's forces."""
    rng = np.random.default_rng(facets)
    arguments = standing_platform(2, facets=facets)
    problem = PairwiseContactProblem(*arguments)
    wrench = rng.normal(size=6)
    x = rng.normal(size=2 * (facets + 1))
    y = (problem.lcp_matrix() @ x + problem.q(wrench)).reshape(2, -1)
    forces, acceleration = problem.recover(x, wrench)
    motion = problem.reference_mass * (arguments[0].T @ acceleration).reshape(2, 3)
    faces = face_directions(facets)
    for k, (own, given) in enumerate(zip(y, x.reshape(2, -1), strict=True)):
        assert forces[k, 0] == pytest.approx(given[0])
        assert motion[k, 0] == pytest.approx(own[0])
        reserves = np.r_[given[1:3], own[3:]]
        np.testing.assert_allclose(
            corrected_friction(0.5, facets) * forces[k, 0] - faces @ forces[k, 1:], reserves, atol=1e-10
        )
        radial = np.r_[own[1:3], given[3:]]
        np.testing.assert_allclose(-faces.T @ radial, motion[k, 1:], atol=1e-10)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_shapes(formulation):
    problem = formulation(*standing_platform(3, facets=5))
    size = {PairwiseContactProblem: 18, StewartTrinkleContactProblem: 21}[formulation]
    assert problem.lcp_matrix().shape == (size, size)
    assert problem.q(np.zeros(6)).shape == (size,)
    assert problem.q(np.zeros((4, 6))).shape == (4, size)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"W": np.zeros((6, 8))}, "W"),
        ({"inverse_mass": np.eye(3)}, "inverse_mass"),
        ({"inverse_mass": -np.eye(6)}, "inverse_mass"),
        ({"friction": [0.5, 0.5, 0.0]}, "friction"),
        ({"friction": []}, "friction"),
        ({"facets": 2}, "facets"),
    ],
)
def test_unusable_input_is_refused(formulation, change, word):
    names = ("W", "inverse_mass", "friction", "facets")
    with pytest.raises(InputError, match=word):
        formulation(**(dict(zip(names, standing_platform(3), strict=True)) | change))


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_unusable_wrenches_are_refused(formulation):
    problem = formulation(*standing_platform(3))
    with pytest.raises(InputError, match="wrenches"):
        problem.q(np.zeros(5))
    with pytest.raises(InputError, match="z"):
        problem.recover(np.zeros(3), np.zeros(6))
