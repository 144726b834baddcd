import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, SolverError
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_number, platform_conditioning
from ocptip.indices.platforms.platform import StewartPlatform
from studies.indices.designs.optimal_domains import main_roots, special_limit
from studies.indices.designs.optimal_planar import optimal_planar_angle
from studies.indices.designs.optimal_platforms import (
    ctn_optimal_main,
    ctn_optimal_special,
    example_main,
    example_special,
)
from tests.indices.sample_platforms import SEEDS, example_main_anchors
from tests.quick import examples

SIGN = st.sampled_from([1, -1])
SHAPES = st.floats(0.02, 0.98).flatmap(lambda t: st.sampled_from([t, -t]))
REACH = st.floats(0.05, 2.5).flatmap(lambda r: st.sampled_from([r, -r]))


def draw_main(data, t, r1, **more):
    roots = main_roots(t, r1)
    assume(roots and min(abs(abs(t) - 0.5), 1.0) > 1e-3)
    return ctn_optimal_main(
        t,
        r1,
        root=data.draw(st.sampled_from(sorted(roots))),
        branch=data.draw(st.integers(1, 4)),
        phi1_sign=data.draw(SIGN),
        **more,
    )


@examples(80)
@given(SHAPES, REACH, st.floats(-3, 3), st.integers(3, 6), st.data())
def test_every_main_member(t, r1, mu, g, data):
    """CTN = 1, regular, equal legs, cone angles: [Naw07] 7.3.1."""
    member = draw_main(data, t, r1, mu=mu, g=g)
    pose = member.pose
    square = r1 * r1 * (2 * t * t + 1)
    assert member.control.value == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(member.control.lambdas, 4 / square, rtol=1e-8)
    np.testing.assert_allclose(pose.lengths**2, square, rtol=1e-8)
    assert not pose.singular
    size = max(map(abs, (member.platform.first.forms() | member.platform.second.forms()).values()))
    assert np.abs(member.platform.proportionality_defects()).max() < 1e-8 * (1 + size) ** 2
    steep = np.abs(pose.legs[:, 2]) / pose.lengths
    np.testing.assert_allclose(steep[:g], math.sqrt(2) * abs(t) / math.sqrt(2 * t * t + 1), rtol=1e-8)
    second = math.sqrt(6 - 6 * t * t) / (3 * math.sqrt(2 * t * t + 1))
    np.testing.assert_allclose(steep[g:], second, rtol=1e-7)
    assert steep.max() < math.sqrt(6) / 3
    assert control_number(member.platform.pose(exchanged=[0, g])).value == pytest.approx(1.0, abs=1e-9)


@examples(25)
@given(SHAPES, REACH, st.data())
def test_angles_between_legs_of_three(t, r1, data):
    member = draw_main(data, t, r1, g=3)
    units = member.pose.legs / member.pose.lengths[:, None]
    cos1, cos2 = units[0] @ units[1], units[3] @ units[4]
    assert cos1 == pytest.approx((4 * t * t - 1) / (4 * t * t + 2), abs=1e-7)
    assert cos1 == pytest.approx(-cos2, abs=1e-7)


@examples(25)
@given(SHAPES, REACH, st.data())
def test_main_members_are_isotropic_for_a_spheroid(t, r1, data):
    """Remark of [Naw07] 7.3.1, with its half-axes; the anchors lie on it on average."""
    member = draw_main(data, t, r1)
    pose = member.pose
    R2 = 1.5 * pose.N[2, 2] / pose.N[5, 5]
    c2 = 3 * pose.N[0, 0] / pose.N[3, 3] - R2
    assume(c2 < 1e4 * R2 < 1e8 * c2)
    spheroid = OperationEllipsoid(np.zeros(3), np.eye(3), np.sqrt([R2, R2, c2]))
    assert platform_conditioning(pose, spheroid.W()).value == pytest.approx(1.0, abs=1e-7)
    points = np.vstack([pose.base, pose.platform])
    assert np.mean(points**2 @ [1 / R2, 1 / R2, 1 / c2]) == pytest.approx(1.0, rel=1e-6)


@examples(30)
@given(st.floats(0.05, 4 / 3 * math.sqrt(2) - 1e-3), SIGN, SIGN, st.data())
def test_at_one_half_the_top_view_is_the_planar_optimum(r, sign_r, sign_t, data):
    r1, t = sign_r * r, sign_t * 0.5
    root = data.draw(st.sampled_from([1, 2]))
    assume(root in main_roots(t, r1) and abs(r - 2 / 3 * math.sqrt(6)) > 1e-3)
    member = ctn_optimal_main(t, r1, root=root)
    planar = optimal_planar_angle(abs(r1), "-" if root == 1 else "+")
    # a negative reach turns the leg by pi
    angle = member.platform.first.angle + (math.pi if r1 < 0 else 0.0)
    assert math.cos(angle) == pytest.approx(math.cos(planar), abs=1e-9)


@examples(80)
@given(SHAPES, st.floats(0.02, 1), SIGN, st.tuples(SIGN, SIGN, SIGN), SIGN, st.integers(3, 6))
def test_every_special_member(t, share, sign, signs, phi1_sign, g):
    """CTN = 1, regular, first group flat, leg lengths and cone: [Naw07] 7.3.2."""
    r1 = sign * share * special_limit(t)
    member = ctn_optimal_special(t, r1, signs=signs, phi1_sign=phi1_sign, g=g)
    pose = member.pose
    assert member.control.value == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(pose.lengths[:g] ** 2, r1 * r1, rtol=1e-9)
    np.testing.assert_allclose(pose.lengths[g:] ** 2, 2 * t * t * r1 * r1 / (1 - t * t), rtol=1e-8)
    np.testing.assert_allclose(member.control.lambdas, np.mean(4 / pose.lengths**2), rtol=1e-7)
    np.testing.assert_allclose(pose.legs[:g, 2], 0, atol=1e-9 * abs(r1))
    steep = np.abs(pose.legs[g:, 2]) / pose.lengths[g:]
    np.testing.assert_allclose(steep, math.sqrt(2 * t * t + 2) / 2, rtol=1e-7)
    assert not pose.singular


def test_fixed_members():
    main = ctn_optimal_main(0.3, 1.0, root=1, branch=1).platform.parameters()
    expected = {
        "a1": -1.915285198687,
        "b1": -2.339549267399,
        "phi1": 1.177181767307,
        "F": -1.262330016528,
        "a2": 1.737973184858,
        "b2": 2.516861281228,
        "r2": 0.757187779440,
        "phi2": -0.554245769501,
    }
    assert {k: main[k] for k in expected} == pytest.approx(expected, abs=1e-11)
    special = ctn_optimal_special(0.5, 1.0)
    expected = {
        "a1": 0.627269847774,
        "b1": 0.627269847774,
        "phi1": 1.086471538574,
        "F": 0.554933559977,
        "a2": -0.845473485329,
        "b2": -0.199976260961,
        "r2": 0.5,
    }
    parameters = special.platform.parameters()
    assert {k: parameters[k] for k in expected} == pytest.approx(expected, abs=1e-11)
    np.testing.assert_allclose(special.control.lambdas, 5.0, rtol=1e-11)
    np.testing.assert_allclose(ctn_optimal_main(0.3, 1.0).control.lambdas, 3.389830508, rtol=1e-9)


@pytest.mark.parametrize("mu", [0.0, math.pi / 3, 1.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_example_main(mu, sign):
    """K_M in the families' scale: CTN = 1; printed numbers hold after rescaling by sqrt(3)/2."""
    member = example_main(mu, sign)
    pose = member.pose
    scaled = type(pose)(pose.base * math.sqrt(3) / 2, pose.platform * math.sqrt(3) / 2)
    control = control_number(scaled)
    assert control.value == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(control.lambdas, 4 / 3, rtol=1e-12)
    np.testing.assert_allclose(scaled.lengths**2, 3.0, rtol=1e-13)
    np.testing.assert_allclose(scaled.N, np.diag([3, 3, 4, 2, 2, 2]), atol=1e-13)
    np.testing.assert_allclose(scaled.Z, 4 / 3 * scaled.N, atol=1e-13)


def test_example_main_printed_anchors():
    pose = example_main_anchors()
    control = control_number(pose)
    assert control.value == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(control.lambdas, 4 / 3, rtol=1e-12)
    np.testing.assert_allclose(pose.lengths**2, 3.0)
    half_axes = np.sqrt([3.0, 3.0, 1.5])
    result = platform_conditioning(pose, OperationEllipsoid(np.zeros(3), np.eye(3), half_axes).W())
    assert result.value == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(result.lambdas, 3.0, rtol=1e-12)
    points = np.vstack([pose.base, pose.platform])
    np.testing.assert_allclose(((points / half_axes) ** 2).sum(axis=1), 1.0, rtol=1e-13)


@examples(40)
@given(SEEDS)
def test_example_main_turned_by_a_right_angle_about_a_horizontal_axis_is_singular(seed):
    """[Naw07] 7.3.3, mu = 0: for every horizontal axis and every translation."""
    rng = np.random.default_rng(seed)
    pose = example_main(0.0).pose
    angle, side = rng.uniform(-np.pi, np.pi), rng.choice([-1, 1])
    R = Rotation.from_rotvec(side * np.pi / 2 * np.array([math.cos(angle), math.sin(angle), 0])).as_matrix()
    t = rng.normal(size=3)
    for base, platform in ((pose.base, pose.platform), (pose.platform, pose.base)):
        turned = StewartPlatform(base, platform).at(t, R)
        assert turned.singular_values[-1] < 1e-14 * turned.singular_values[0]
        assert control_number(turned).value <= 1e-12
    other = StewartPlatform(*_anchors(example_main(math.pi / 3))).at(t, R)
    assert other.singular_values[-1] > 1e-9


def _anchors(member):
    return member.pose.base, member.pose.platform


def test_singular_positions_of_example_main_are_a_quadric_cylinder():
    """[Naw07] 7.3.3: for constant orientation det J of B = y, P = x, times the leg lengths, is free of z and
    quadratic in x and y."""
    pose = example_main(0.0).pose
    platform = StewartPlatform(pose.platform, pose.base)
    R = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()

    def determinant(x, y, z):
        turned = platform.at([x, y, z], R)
        return np.linalg.det(turned.jacobian) * np.prod(turned.lengths)

    points = np.random.default_rng(0).normal(size=(9, 2))
    values = np.array([determinant(x, y, 0.4) for x, y in points])
    for z in (-1.0, 2.0):
        np.testing.assert_allclose([determinant(x, y, z) for x, y in points], values, rtol=1e-9)
    x, y = points.T
    terms = np.column_stack([np.ones(9), x, y, x * x, x * y, y * y])
    fit = np.linalg.lstsq(terms[:6], values[:6])[0]
    np.testing.assert_allclose(terms[6:] @ fit, values[6:], rtol=1e-8)


def test_example_special():
    member = example_special()
    assert member.family == "L_S"
    assert member.control.value == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(member.control.lambdas, 1.6, rtol=1e-12)
    np.testing.assert_allclose(member.pose.lengths**2, 2.5, rtol=1e-13)


@pytest.mark.parametrize("epsilon", [1e-4, -1e-4, 1e-8])
def test_members_next_to_one_half_are_right(epsilon):
    """Two of the four roots stay finite there; the others run off to infinity."""
    roots = main_roots(0.5 + epsilon, 0.7)
    finite = [root for root, b1 in roots.items() if abs(b1) < 10]
    assert len(finite) == 2
    for root in finite:
        assert ctn_optimal_main(0.5 + epsilon, 0.7, root=root).control.value > 1 - 1e-8


def test_members_whose_closed_form_has_lost_its_digits_are_refused():
    roots = main_roots(0.5 + 1e-8, 0.7)
    far = max(roots, key=lambda root: abs(roots[root]))
    with pytest.raises(SolverError, match="the closed form gives CTN = 0"):
        ctn_optimal_main(0.5 + 1e-8, 0.7, root=far)


def test_other_points_of_the_parameters_are_not_optimal():
    """The families are thin: half a per cent in one parameter is seen."""
    member = ctn_optimal_main(0.3, 1.0)
    for name in ("a1", "b1", "r1", "phi1", "F", "a2", "b2", "r2", "phi2"):
        parameters = member.platform.parameters()
        parameters[name] *= 1.005
        changed = type(member.platform).from_parameters(**parameters)
        assert control_number(changed.pose()).value < 1 - 1e-5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ctn_optimal_main(0.0, 1.0), "t: expected -1 < t < 1 and not 0"),
        (lambda: ctn_optimal_main(0.3, 0.0), "r1: must not be 0"),
        (lambda: ctn_optimal_main(0.3, 1.0, root=5), "root: must be a whole number >= 1 and <= 4, got 5"),
        (lambda: ctn_optimal_main(0.3, 1.0, branch=0), "branch: must be a whole number >= 1 and <= 4"),
        (lambda: ctn_optimal_main(0.3, 3.0), "real roots: none"),
        (lambda: ctn_optimal_main(0.5, 1.0, root=3), "root 3 is not real"),
        (lambda: ctn_optimal_main(0.3, 1.0, g=2), "g: must be a whole number >= 3"),
        (lambda: ctn_optimal_main(0.3, 1.0, phi1_sign=0), "phi1_sign: expected \\+1 or -1"),
        (lambda: ctn_optimal_special(0.5, 1e3), "r1: expected 0 < "),
        (lambda: ctn_optimal_special(0.5, 0.0), "r1: expected 0 < "),
        (lambda: ctn_optimal_special(0.5, 1.0, signs=(1, 1)), "signs: expected three"),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_plain_data():
    data = example_special().to_dict()
    assert data["family"] == "L_S"
    assert len(data["base"]) == len(data["platform"]) == 6
    assert data["parameters"]["g"] == 3
