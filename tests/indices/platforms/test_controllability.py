import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import control_number, platform_conditioning
from ocptip.indices.platforms.platform import PlatformPose, StewartPlatform
from ocptip.indices.platforms.reviewed import best_complex, manipulability
from studies.indices.designs.flight_simulator import FlightSimulator
from tests.indices.sample_platforms import (
    LEGS,
    SEEDS,
    example_main_anchors,
    flat_pose,
    moved,
    random_motion,
    random_pose,
)
from tests.quick import examples


@examples(40)
@given(SEEDS, LEGS)
def test_equals_the_generalised_eigenproblem(seed, n):
    pose = random_pose(np.random.default_rng(seed), n)
    control = control_number(pose)
    inverse = eigh(pose.N, pose.Z, eigvals_only=True)
    assert 0.0 <= control.value <= 1.0
    assert control.value == pytest.approx(math.sqrt(inverse[0] / inverse[-1]), rel=1e-6)
    np.testing.assert_allclose(1 / control.lambdas[::-1], inverse, atol=1e-10 * inverse[-1])
    assert control.residual < 1e-10
    for k in range(6):
        screw = control.screws[:, k]
        assert screw @ pose.Z @ screw == pytest.approx(1.0, rel=1e-9)
        assert np.linalg.norm(pose.jacobian @ screw) ** 2 * control.lambdas[k] == pytest.approx(1.0, rel=1e-6)


@examples(40)
@given(SEEDS, LEGS, st.floats(1e-4, 1e4))
def test_does_not_depend_on_frame_and_unit(seed, n, factor):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, n)
    other = moved(pose, *random_motion(rng), factor)
    a, b = control_number(pose), control_number(other)
    assert b.value == pytest.approx(a.value, rel=1e-9)
    np.testing.assert_allclose(b.lambdas * factor**2, a.lambdas, rtol=1e-8)


@pytest.mark.parametrize(("distance", "tolerance"), [(1e3, 1e-11), (1e6, 1e-8)])
def test_a_far_origin_costs_only_the_digits_of_the_anchors(distance, tolerance):
    pose = random_pose(np.random.default_rng(8))
    far = moved(pose, np.eye(3), np.array([distance, -distance, distance]))
    assert control_number(far).value == pytest.approx(control_number(pose).value, rel=tolerance)
    flat = flat_pose(np.random.default_rng(8))
    far = moved(flat, np.eye(3), np.array([1e2, 0.0, 0.0]))
    assert control_number(far).value <= 1e-12


@examples(40)
@given(SEEDS, LEGS, st.data())
def test_does_not_depend_on_order_handedness_and_exchange(seed, n, data):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, n)
    value = control_number(pose).value
    order, mirror = rng.permutation(n), np.diag([1.0, 1.0, -1.0])
    subset = data.draw(st.sets(st.integers(0, n - 1)))
    for other in (
        PlatformPose(pose.base[order], pose.platform[order]),
        PlatformPose(pose.base @ mirror, pose.platform @ mirror),
        pose.exchanged(sorted(subset)),
    ):
        assert control_number(other).value == pytest.approx(value, rel=1e-9)


@examples(30)
@given(SEEDS, LEGS)
def test_sees_anchors_that_slide_along_their_leg_when_others_do_not(seed, n):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, n)
    slid = PlatformPose(
        pose.base - rng.uniform(0.1, 1.0, (n, 1)) * pose.legs,
        pose.platform + rng.uniform(0.1, 1.0, (n, 1)) * pose.legs,
    )
    np.testing.assert_allclose(slid.jacobian, pose.jacobian, atol=1e-12)
    assert manipulability(slid) == pytest.approx(manipulability(pose), rel=1e-7)
    a, b = best_complex(pose), best_complex(slid)
    assert (b.sigma_r, b.sigma_s) == pytest.approx((a.sigma_r, a.sigma_s), rel=1e-7)
    W = np.diag([0.4, 0.5, 0.6, 6.0, 6.0, 6.0])
    assert platform_conditioning(slid, W).value == pytest.approx(
        platform_conditioning(pose, W).value, rel=1e-8
    )
    assert abs(control_number(slid).value - control_number(pose).value) > 1e-7


@examples(30)
@given(SEEDS, LEGS)
def test_eigenvalues_enclose_the_mean_of_the_legs(seed, n):
    pose = random_pose(np.random.default_rng(seed), n)
    lambdas = control_number(pose).lambdas
    mean = np.mean(4 / pose.lengths**2)
    assert lambdas[0] <= mean * (1 + 1e-12)
    assert mean <= lambdas[-1] * (1 + 1e-12)


@examples(20)
@given(SEEDS, LEGS)
def test_flat_platform_has_three_infinite_eigenvalues(seed, n):
    control = control_number(flat_pose(np.random.default_rng(seed), n))
    assert control.value == 0.0
    assert control.singular
    assert np.isinf(control.lambdas).tolist() == [False] * 3 + [True] * 3


def test_legs_that_no_joint_feels():
    rng = np.random.default_rng(0)
    base = rng.normal(size=(6, 3))
    control = control_number(PlatformPose(base, base + np.array([0.0, 0.1, 1.0])))
    assert control.indeterminate
    assert control.value == 0.0
    assert control.screws is None
    assert control.to_dict()["least_controllable"] is None
    line = np.outer(np.arange(6.0), [1.0, 2.0, 3.0])
    assert control_number(PlatformPose(line, line + np.array([0.5, 1.0, 1.5]))).value == 0.0


@examples(30)
@given(SEEDS, st.floats(-8, -5))
def test_vanishes_with_the_distance_to_a_singularity(seed, exponent):
    """Legs leave one common line by epsilon: CTN goes to zero like epsilon, without loss of digits."""
    rng = np.random.default_rng(seed)
    base, through = rng.normal(size=(6, 3)), np.outer(rng.uniform(-1, 1, 6), [0.0, 0.0, 1.0])
    off, epsilon = rng.normal(size=(6, 3)), 10.0**exponent
    platform = base + 0.6 * (through - base)
    near = control_number(PlatformPose(base, platform + epsilon * off)).value
    nearer = control_number(PlatformPose(base, platform + 0.1 * epsilon * off)).value
    assert control_number(PlatformPose(base, platform)).value <= 1e-12
    if 1e-10 < near < 1e-4:
        assert nearer / near == pytest.approx(0.1, rel=0.01)


# --- published and computed numbers of [Naw07] 6.4


@pytest.mark.parametrize(
    ("alpha", "height", "value"),
    [
        (0.0, 0.2, 0.240644),
        (0.0, 0.4, 0.581448),
        (0.0, 0.8, 0.252641),
        (0.2, 0.2, 0.413069),
        (0.2, 0.4, 0.389532),
        (0.2, 0.8, 0.107547),
        (0.4, 0.2, 0.246303),
        (0.4, 0.4, 0.065630),
        (0.4, 0.8, 0.016694),
    ],
)
def test_flight_simulator_samples(alpha, height, value):
    design = FlightSimulator(alpha, height)
    assert control_number(design.platform.at(design.position)).value == pytest.approx(value, abs=6e-7)


@pytest.fixture(scope="module")
def best():
    design = FlightSimulator.optimal()
    return design.platform, design.position


@pytest.mark.parametrize(
    ("half", "value"),
    [
        (0.05, 0.051491),
        (0.1, 0.111166),
        (0.2, 0.271619),
        (0.3, 0.479940),
        (0.5, 0.459506),
        (0.75, 0.221977),
        (1.0, 0.129025),
        (2.0, 0.033365),
    ],
)
def test_best_flight_simulator_at_other_heights(half, value):
    alpha = FlightSimulator.optimal().alpha
    design = FlightSimulator(alpha, half)
    assert control_number(design.platform.at(design.position)).value == pytest.approx(value, abs=6e-7)


@pytest.mark.parametrize(
    ("shift", "value"),
    [
        ((0.25, 0), 0.558647),
        ((-0.25, 0), 0.569319),
        ((0, 0.25), 0.563724),
        ((0, -0.25), 0.563724),
        ((0.5, 0), 0.402246),
        ((-0.5, 0), 0.422593),
        ((0, 0.5), 0.410016),
        ((0.5, 0.5), 0.299834),
    ],
)
def test_best_flight_simulator_shifted(best, shift, value):
    platform, position = best
    pose = platform.at(position + np.array([*shift, 0.0]))
    assert control_number(pose).value == pytest.approx(value, abs=6e-7)


@pytest.mark.parametrize(
    ("axis", "angle", "value"),
    [("x", s * a, v) for a, v in ((0.2, 0.601443), (0.4, 0.450671), (0.8, 0.157918)) for s in (1, -1)]
    + [("x", 1.2, 0.022521), ("x", -1.2, 0.022521)]
    + [("y", -0.8, 0.085600), ("y", -0.4, 0.426701), ("y", -0.2, 0.601929)]
    + [("y", 0.2, 0.602454), ("y", 0.4, 0.477864), ("y", 0.8, 0.267227)]
    + [("z", 0.2, 0.535217), ("z", -0.4, 0.411124), ("z", 0.8, 0.218580), ("z", -1.2, 0.073649)],
)
def test_best_flight_simulator_turned(best, axis, angle, value):
    platform, position = best
    pose = platform.at(position, Rotation.from_euler(axis, angle).as_matrix())
    assert control_number(pose).value == pytest.approx(value, abs=6e-7)


def test_best_flight_simulator_turned_by_a_right_angle_is_singular(best):
    platform, position = best
    for sign in (1, -1):
        pose = platform.at(position, Rotation.from_euler("z", sign * math.pi / 2).as_matrix())
        assert control_number(pose).value == 0.0


# --- [Naw07] 7.3.3: neighbourhood of K_M


@pytest.fixture(scope="module")
def example():
    pose = example_main_anchors()
    return StewartPlatform(pose.base, pose.platform)


@pytest.mark.parametrize(
    ("axis", "angle", "value"),
    [
        ("x", -0.8, 0.268426),
        ("x", -0.4, 0.551067),
        ("x", -0.2, 0.739023),
        ("x", 0.2, 0.720028),
        ("x", 0.4, 0.478441),
        ("x", 0.8, 0.136805),
        ("y", -0.4, 0.507069),
        ("y", -0.2, 0.723017),
        ("y", 0.2, 0.728484),
        ("y", 0.4, 0.516290),
        ("z", -0.8, 0.555694),
        ("z", -0.4, 0.703619),
        ("z", -0.2, 0.824501),
        ("z", 0.2, 0.766541),
        ("z", 0.4, 0.518318),
        ("z", 0.8, 0.115965),
    ],
)
def test_example_main_turned(example, axis, angle, value):
    turned = example.at([0, 0, 0], Rotation.from_euler(axis, angle).as_matrix())
    assert control_number(turned).value == pytest.approx(value, abs=6e-7)


@pytest.mark.parametrize("angle", [-2.186276, 0.955317])
def test_example_main_singular_turns_about_z(example, angle):
    """Printed to six decimals: CTN is nearly zero there and grows on both sides."""

    def value(a):
        return control_number(example.at([0, 0, 0], Rotation.from_euler("z", a).as_matrix())).value

    assert value(angle) < 2e-6
    assert value(angle - 0.01) > 1e-3 < value(angle + 0.01)


@pytest.mark.parametrize(
    ("shift", "value"),
    [
        ((0.25, 0, 0), 0.650347),
        ((-0.25, 0, 0), 0.650347),
        ((0, 0.25, 0), 0.648556),
        ((0.5, 0, 0), 0.415202),
        ((0, 0.5, 0), 0.408416),
        ((0.5, 0.5, 0), 0.261559),
        ((1, 0, 0), 0.123933),
        ((0, 0, 0.25), 0.938810),
        ((0, 0, -0.25), 0.938810),
        ((0, 0, 0.5), 0.816305),
        ((0, 0, 1), 0.499277),
        ((0, 0, -2), 0.133848),
    ],
)
def test_example_main_shifted(example, shift, value):
    assert control_number(example.at(shift)).value == pytest.approx(value, abs=6e-7)


def test_pose_is_checked():
    with pytest.raises(InputError, match="expected a PlatformPose"):
        control_number(np.eye(6))


def test_plain_data():
    control = control_number(random_pose(np.random.default_rng(1)))
    data = control.to_dict()
    assert data["value"] == control.value
    assert data["least_controllable"] == control.least_controllable.tolist()
    assert len(data["lambdas"]) == 6
