import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import minimize

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import (
    INNER,
    singularity_distance,
    stationary_curvatures,
    stationary_motion_angle,
)
from ocptip.indices.lines import adjoint, spear
from ocptip.published.arms import arm_by_name, irb_2000
from tests.indices.sample_axes import (
    published_motion,
    published_rates,
    random_axes,
    random_pose,
    stationary_pose,
    turned,
)

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)
STATIONARY = (0.88638233, -0.19062529, np.pi / 2)

# (theta_2, theta_3, MPB in mm^3, DM_inf, DM_2) with theta_5 = 60 degrees, [Naw07] 4.6
MAP = [
    (0, 0, 4.442494e8, 0.539426, 0.849763),
    (np.pi / 4, 0, 6.227200e8, 1.150138, 1.554889),
    (0.88638233, -0.19062529, 6.395526e8, 1.732051, 1.732051),
    (-1, 0.5, 4.388894e7, 0.061661, 0.086487),
    (1, 0.8, 2.205569e8, 0.258418, 0.381475),
    (0.5, -0.9, 2.844251e8, 0.269193, 0.411222),
]
# (t, MPB in mm^3, DM_inf, DM_2, sigma) along the motion of [Naw07] 3.5
MOTION = [
    (0.05, 3.335623e8, 0.366020, 0.419153, 0.111298),
    (0.10, 3.521316e8, 0.401875, 0.463211, 0.033041),
    (0.20, 3.172248e8, 0.391707, 0.590531, -0.261877),
    (0.30, 1.787765e8, 0.319225, 0.487454, -0.820357),
    (0.40, 1.480905e7, 0.038058, 0.055305, -0.752806),
    (0.45, 2.236807e7, 0.068986, 0.118080, 0.161671),
    (0.49, 9.886082e6, 0.034992, 0.041502, -0.560499),
    (0.55, 8.990179e7, 0.140951, 0.199946, 0.917818),
    (0.60, 2.344078e8, 0.275339, 0.407505, 0.958908),
    (0.70, 5.318561e8, 0.827506, 1.079345, 0.626096),
    (0.80, 5.426448e8, 0.574418, 0.891859, -0.450140),
    (0.90, 2.305546e8, 0.243087, 0.344666, -0.796259),
    (0.98, 8.715657e6, 0.020108, 0.028681, -0.815959),
]


def at(*angles):
    """The IRB 2000 at theta_2, theta_3, theta_5 (others arbitrary, they do not matter)."""
    second, third, fifth = angles
    return arm_pose(irb_2000(), np.array([0.4, second, third, -0.7, fifth, 1.1])).jacobian


@pytest.mark.parametrize(("second", "third", "mpb", "dm_inf", "dm_2"), MAP)
def test_published_map(second, third, mpb, dm_inf, dm_2):
    result = singularity_distance(at(second, third, np.pi / 3))
    assert abs(result.determinant) * 1e9 == pytest.approx(mpb, rel=4e-7)
    assert result.dm_inf == pytest.approx(dm_inf, abs=6e-7)
    assert result.dm_2 == pytest.approx(dm_2, abs=6e-7)


@pytest.mark.parametrize(("t", "mpb", "dm_inf", "dm_2", "sigma"), MOTION)
def test_published_motion(t, mpb, dm_inf, dm_2, sigma):
    result = singularity_distance(arm_pose(irb_2000(), published_motion(t)).jacobian)
    assert abs(result.determinant) * 1e9 == pytest.approx(mpb, rel=4e-7)
    assert result.dm_inf == pytest.approx(dm_inf, abs=6e-7)
    assert result.dm_2 == pytest.approx(dm_2, abs=6e-7)
    assert result.motion_angle(published_rates(t)) == pytest.approx(sigma, abs=6e-7)


def test_published_details():
    result = singularity_distance(arm_pose(irb_2000(), published_motion(0.6)).jacobian)
    assert result.determinant * 1e9 == pytest.approx(-2.34407775e8, rel=1e-8)
    expected = [-1.83989909e8, -1.40865201e8, 0, -5.26488482e8]
    assert result.gradient * 1e9 == pytest.approx(expected, rel=1e-8)
    assert result.gradient[2] == 0.0
    assert result.step_2 == pytest.approx([-0.130343205, -0.0997925476, 0, -0.372978042], abs=1e-9)
    assert result.step_inf == pytest.approx([-0.27533863, -0.27533863, 0, -0.27533863], abs=1e-8)
    assert result.status == "regular"


@pytest.mark.parametrize("t", [0.413466849, 0.5, 0.985464775])
def test_published_singularities_of_the_motion(t):
    before, after = (
        singularity_distance(arm_pose(irb_2000(), published_motion(t + step)).jacobian)
        for step in (-1e-8, 1e-8)
    )
    assert before.determinant * after.determinant < 0
    assert max(before.dm_2, after.dm_2) < 1e-7


def test_stationary_point_and_its_curvatures():
    J = at(*STATIONARY)
    result = singularity_distance(J)
    assert abs(result.determinant) * 1e9 == pytest.approx(7.38491693e8, rel=1e-8)
    assert result.dm_2 > 1e6  # the printed angles have eight digits
    curvatures = stationary_curvatures(J)
    mpb = abs(result.determinant)
    assert curvatures.values[1] == pytest.approx(-mpb, rel=1e-7)
    assert curvatures.values * 1e9 == pytest.approx([-1.55817e9, -7.38492e8, -5.21468e8], rel=4e-6)
    printed = [[0.45754, 0.88919, 0, 0], [0, 0, 0, 1], [0.88919, -0.45754, 0, 0]]
    for direction, expected in zip(curvatures.directions, printed, strict=True):
        assert direction * np.sign(direction @ expected) == pytest.approx(expected, abs=5.1e-6)
    rates = np.zeros(6)
    rates[INNER] = -curvatures.worst
    assert stationary_motion_angle(curvatures, rates) == pytest.approx(-np.pi / 2)
    rates[INNER] = curvatures.directions[1] * 3
    assert stationary_motion_angle(curvatures, rates) == pytest.approx(0)
    with pytest.raises(InputError, match="rest"):
        stationary_motion_angle(curvatures, np.zeros(6))


def test_exactly_stationary_points_are_infinitely_far():
    result = singularity_distance(arm_pose(irb_2000(), stationary_pose()).jacobian)
    assert (result.dm_inf, result.dm_2, result.status) == (np.inf, np.inf, "stationary")
    assert not result.step_inf.any()
    assert not result.step_2.any()
    assert np.isnan(result.motion_angle(np.ones(6)))
    assert result.to_dict()["dm_2"] is None


def nearest_along(direction):
    """Distance to det J = 0 from the stationary point, forward and backward."""
    found = []
    for sign in (1, -1):
        steps = np.linspace(0, 3, 3001)
        q = np.zeros((len(steps), 6))
        q[:, [1, 2, 4]] = np.array(STATIONARY) + sign * np.outer(steps, direction)
        signs = np.sign(np.linalg.det(arm_pose(irb_2000(), q).jacobian))
        found.append(steps[np.flatnonzero(np.diff(signs))[0] + 1])
    return sorted(found)


def test_most_negative_curvature_is_the_worst_direction():
    directions = stationary_curvatures(at(*STATIONARY)).directions[:, [0, 1, 3]]
    distances = [nearest_along(d) for d in directions]
    assert distances[0] == pytest.approx([1.388, 1.480], abs=2e-3)  # [Naw07] 4.4.2
    assert distances[1] == pytest.approx([1.571, 1.571], abs=2e-3)
    assert distances[2] == pytest.approx([2.47, 2.67], abs=7e-3)
    assert min(distances[0]) == min(min(pair) for pair in distances)


@given(seeds)
def test_determinant_and_gradient_against_finite_differences_of_turned_axes(rng):
    J = random_axes(rng)
    result = singularity_distance(J)
    assert result.determinant == pytest.approx(np.linalg.det(J), abs=1e-12)
    step = 1e-5
    for i, slope in enumerate(result.gradient, start=1):
        angles = np.zeros(6)
        angles[i] = step
        numeric = (np.linalg.det(turned(J, angles)) - np.linalg.det(turned(J, -angles))) / (2 * step)
        assert slope == pytest.approx(numeric, abs=1e-7 * (1 + abs(slope)) * (1 + np.abs(J).max() ** 3))


@given(seeds)
def test_hessian_against_finite_differences(rng):
    J = random_axes(rng)
    assume(abs(np.linalg.det(J)) > 1e-2)
    result = stationary_curvatures(J)
    step, sign = 1e-4, np.sign(np.linalg.det(J))
    for value, direction in zip(result.values, result.directions, strict=True):
        angles = np.zeros(6)
        angles[INNER] = step * direction
        plus, middle, minus = (sign * np.linalg.det(turned(J, k * angles)) for k in (1, 0, -1))
        assert value == pytest.approx(
            (plus - 2 * middle + minus) / step**2, abs=1e-4 * (1 + np.abs(J).max() ** 3)
        )
    assert (np.diff(result.values) >= 0).all()


@given(seeds)
def test_relations_between_the_distances(rng):
    result = singularity_distance(random_axes(rng))
    assert 0 < result.dm_inf <= result.dm_2 * (1 + 1e-12)
    assert result.dm_2 <= 2 * result.dm_inf * (1 + 1e-12)
    assert np.abs(result.step_2).max() <= 1.5 * result.dm_inf * (1 + 1e-12)
    scale = abs(result.determinant)
    assert result.determinant + result.gradient @ result.step_2 == pytest.approx(0, abs=1e-12 * scale)
    assert result.determinant + result.gradient @ result.step_inf == pytest.approx(0, abs=1e-12 * scale)
    assert np.linalg.norm(result.step_2) == pytest.approx(result.dm_2)
    assert np.abs(result.step_inf) == pytest.approx(np.full(4, result.dm_inf))


@given(seeds)
def test_invariance(rng):
    J = random_axes(rng)
    result = singularity_distance(J)
    expected = pytest.approx([result.dm_inf, result.dm_2], rel=1e-6)

    def values(jacobian):
        other = singularity_distance(jacobian)
        return [other.dm_inf, other.dm_2]

    assert values(adjoint(*random_pose(rng)) @ J) == expected
    assert values(J * np.repeat([1, rng.uniform(0.01, 100)], 3)[:, None]) == expected
    assert values(J * rng.choice([-1, 1], 6)) == expected
    assert values(J[:, ::-1]) == expected  # the arm seen from its end-effector
    first, last = np.zeros(6), np.zeros(6)
    first[0], last[5] = rng.uniform(-3, 3, 2)
    assert values(turned(J, first)) == expected
    assert values(turned(J, last)) == expected


def test_distance_depends_on_the_order_of_the_axes():
    rng = np.random.default_rng(8)
    J = random_axes(rng)
    result = singularity_distance(J)
    changed = 0
    for i, j in itertools.pairwise(range(6)):
        order = list(range(6))
        order[i], order[j] = j, i
        other = singularity_distance(J[:, order])
        assert abs(other.determinant) == pytest.approx(abs(result.determinant))
        changed += abs(other.dm_2 / result.dm_2 - 1) > 1e-3
    assert changed == 5


@given(seeds)
def test_angle_of_a_motion(rng):
    result = singularity_distance(random_axes(rng))
    rates = rng.normal(size=6)
    sigma = result.motion_angle(rates)
    assert abs(sigma) <= np.pi / 2
    assert result.motion_angle(-rates) == pytest.approx(-sigma)
    assert result.motion_angle(7 * rates) == pytest.approx(sigma)
    towards = np.concatenate([[5], result.step_2, [-3]])
    cosine = result.step_2 @ rates[INNER] / np.linalg.norm(result.step_2) / np.linalg.norm(rates[INNER])
    assert sigma == pytest.approx(np.arccos(cosine) - np.pi / 2)  # (4.8)
    assert result.motion_angle(towards) == pytest.approx(-np.pi / 2, abs=1e-7)
    assert result.motion_angle(-towards) == pytest.approx(np.pi / 2, abs=1e-7)
    assert np.isnan(result.motion_angle([1, 0, 0, 0, 0, 1]))


@given(seeds)
def test_weighted_distances_are_constrained_minima(rng):
    J, inertias = random_axes(rng), rng.uniform(0.2, 3, 6)
    result = singularity_distance(J, inertias=inertias)
    det, g, inner = result.determinant, result.gradient, inertias[INNER]
    equal = -np.sign(det) * np.sign(g) * np.sqrt(2 / inner * result.energy_inf)  # (4.18)
    assert det + g @ equal == pytest.approx(0, abs=1e-11 * abs(det))
    total = np.sum(g**2 / inner)
    assert result.energy_2 == pytest.approx(det**2 / (2 * total))  # (4.15)
    other = rng.normal(size=4)
    other *= -det / (g @ other)
    assert inner @ other**2 / 2 >= result.energy_2 * (1 - 1e-9)
    assert np.max(inner * other**2 / 2) >= result.energy_inf * (1 - 1e-9)


def test_weighted_minimum_by_an_optimiser():
    rng = np.random.default_rng(3)
    inertias = rng.uniform(0.2, 3, 6)
    result = singularity_distance(random_axes(rng), inertias=inertias)
    found = minimize(
        lambda x: inertias[INNER] @ x**2 / 2,
        np.ones(4),
        jac=lambda x: inertias[INNER] * x,
        constraints={"type": "eq", "fun": lambda x: result.determinant + result.gradient @ x},
        method="SLSQP",
        options={"ftol": 1e-14},
    )
    assert found.success
    assert found.fun == pytest.approx(result.energy_2, rel=1e-6)


@given(seeds)
def test_zero_exactly_in_singular_configurations(rng):
    J = random_axes(rng)
    i, j = rng.choice(6, 2, replace=False)
    J[:, i] = J[:, j]
    result = singularity_distance(J)
    assert (result.dm_inf, result.dm_2, result.determinant) == (0, 0, 0)
    assert result.status.startswith("singular")
    assert not result.step_2.any()
    assert np.isnan(result.motion_angle(rng.normal(size=6)))


def test_singularities_of_higher_order_are_flagged():
    rng = np.random.default_rng(2)
    point = rng.normal(size=3)
    J = np.array(
        [
            spear(point + s * np.eye(3)[2], d)
            for s, d in zip(rng.normal(size=6), rng.normal(size=(6, 3)), strict=True)
        ]
    ).T
    ordinary = singularity_distance(J)
    assert (ordinary.dm_2, ordinary.status) == (0, "singular")
    flat = spear(np.hstack([rng.normal(size=(6, 2)), np.zeros((6, 1))]), np.tile([0.0, 0, 1], (6, 1))).T
    higher = singularity_distance(flat)
    assert (higher.dm_inf, higher.dm_2, higher.status) == (0, 0, "singular of higher order")


@pytest.mark.parametrize("name", ["FP1W2F", "IRB2000"])
def test_spherical_wrist_does_not_know_joint_four(name):
    q = np.random.default_rng(1).uniform(-2, 2, (20, 6))
    result = singularity_distance(arm_pose(arm_by_name(name), q).jacobian)
    assert (np.abs(result.gradient[:, 2]) < 1e-12).all()
    assert (result.dm_2 > 0).all()


def test_distance_is_exact_to_first_order_near_a_singularity():
    ratios = []
    for epsilon in (0.5, 0.2, 0.1, 0.05):
        ratios.append(singularity_distance(at(0.5, 0.2, epsilon)).dm_2 / epsilon)
    # Printed without the point of the wrist singularity it was measured at.
    assert ratios == pytest.approx([1.052, 1.008, 1.002, 1.0005], abs=2e-3)
    errors = np.abs(np.array(ratios) - 1)
    assert errors[:-1] / errors[1:] == pytest.approx([6.25, 4, 4], rel=0.05)


def test_many_poses_at_once():
    rng = np.random.default_rng(5)
    J, inertias = np.array([random_axes(rng) for _ in range(4)]), rng.uniform(1, 2, (4, 6))
    J[2, :, 0] = J[2, :, 3]
    many = singularity_distance(J, inertias=inertias)
    rates = rng.normal(size=(4, 6))
    for k in range(4):
        one = singularity_distance(J[k], inertias=inertias[k])
        assert many.dm_inf[k] == pytest.approx(one.dm_inf)
        assert many.step_2[k] == pytest.approx(one.step_2)
        assert many.energy_inf[k] == pytest.approx(one.energy_inf)
        assert many.motion_angle(rates)[k] == pytest.approx(one.motion_angle(rates[k]), nan_ok=True)
        assert many.status[k] == one.status
    assert many.to_dict()["status"] == ["regular", "regular", "singular", "regular"]


def test_bad_input_is_refused():
    rng = np.random.default_rng(6)
    J = random_axes(rng)
    with pytest.raises(InputError, match="six axes, got 7"):
        singularity_distance(random_axes(rng, 7))
    with pytest.raises(InputError, match="inertias"):
        singularity_distance(J, inertias=[1, 0, 1, 1, 1, 1])
    assert singularity_distance(J, inertias=[0, 1, 1, 1, 1, 0]).energy_2 > 0
    with pytest.raises(InputError, match="rates"):
        singularity_distance(J).motion_angle([1, 2, 3])
    with pytest.raises(InputError, match="rates"):
        singularity_distance(J).motion_angle(np.full(6, np.nan))
    J[:, 0] = J[:, 1]
    with pytest.raises(InputError, match="singular"):
        stationary_curvatures(J)
