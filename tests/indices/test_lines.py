import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.lines import (
    BUNDLE_TYPES,
    PENCIL_TYPES,
    adjoint,
    bundle_type,
    dual_cross,
    foot_point,
    pencil_type,
    point_velocity,
    screw_decompose,
    spear,
)
from ocptip.numerics.vectors import cross, skew
from tests.indices.sample_axes import distance_to_point, klein_form, random_pose

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(seeds)
def test_spear_is_a_line_through_its_point(rng):
    points, directions = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    lines = spear(points, directions)
    assert np.linalg.norm(lines[:, :3], axis=1) == pytest.approx(1.0)
    assert np.abs(np.sum(lines[:, :3] * lines[:, 3:], axis=1)).max() < 1e-14 * 10
    for point, line in zip(points, lines, strict=True):
        assert distance_to_point(line, point) < 1e-14 * 20
        assert distance_to_point(line, foot_point(line)) < 1e-14 * 20
        assert np.linalg.norm(foot_point(line)) == pytest.approx(np.linalg.norm(line[3:]))
        other = point + rng.normal(size=3)
        along = np.linalg.norm(np.cross(other - point, line[:3]))
        assert distance_to_point(line, other) == pytest.approx(along)


@given(seeds)
def test_adjoint_moves_lines_as_their_points(rng):
    (first, a), (second, b) = random_pose(rng), random_pose(rng)
    point, direction = rng.normal(size=(2, 3))
    moved = adjoint(first, a) @ spear(point, direction)
    assert moved == pytest.approx(spear(first @ point + a, first @ direction), abs=1e-12)
    both = adjoint(second, b) @ adjoint(first, a)
    assert both == pytest.approx(adjoint(second @ first, second @ a + b), abs=1e-12)
    assert np.linalg.det(adjoint(first, a)) == pytest.approx(1.0)


@given(seeds)
def test_dual_product_is_the_rate_of_a_carried_spear(rng):
    axis, line = spear(rng.normal(size=(2, 3)), rng.normal(size=(2, 3)))
    foot, step = foot_point(axis), 1e-6

    def carried(angle):
        k = skew(axis[:3])
        rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
        return adjoint(rotation, foot - rotation @ foot) @ line

    rate = (carried(step) - carried(-step)) / (2 * step)
    assert dual_cross(axis, line) == pytest.approx(rate, abs=1e-8)
    assert dual_cross(line, axis) == pytest.approx(-dual_cross(axis, line))


@given(seeds)
def test_lines_that_meet_are_zeros_of_the_klein_form(rng):
    point = rng.normal(size=3)
    first, second = spear(np.array([point, point]), rng.normal(size=(2, 3)))
    assert abs(klein_form(first, second)) < 1e-13
    parallel = spear(rng.normal(size=3), first[:3])
    assert abs(klein_form(first, parallel)) < 1e-13
    skewed = spear(point + np.cross(first[:3], second[:3]), second[:3])
    assert abs(klein_form(first, skewed)) > 0.1 * np.sum(np.cross(first[:3], second[:3]) ** 2)


@given(seeds)
def test_screw_decomposition(rng):
    screw = rng.normal(size=6)
    motion = screw_decompose(screw)
    again = motion.angular * motion.axis
    again[3:] += motion.linear * motion.direction
    assert again == pytest.approx(screw, abs=1e-12)
    assert motion.pitch == pytest.approx(screw[:3] @ screw[3:] / (screw[:3] @ screw[:3]))
    assert not motion.is_translation
    x, y = rng.normal(size=(2, 3))
    speed = np.sum(point_velocity(screw, x) ** 2)
    assert speed == pytest.approx(
        (motion.angular * distance_to_point(motion.axis, x)) ** 2 + motion.linear**2
    )
    along = point_velocity(screw, x) - point_velocity(screw, y)
    assert abs(along @ (x - y)) < 1e-12 * (1 + np.sum((x - y) ** 2) * motion.angular)
    assert motion.to_dict()["pitch"] == motion.pitch


def test_translation_has_no_axis():
    motion = screw_decompose([0, 0, 0, 0, -2.0, 0])
    assert (motion.angular, motion.linear, motion.pitch, motion.axis) == (0.0, 2.0, np.inf, None)
    assert motion.direction == pytest.approx([0, -1, 0])
    assert motion.is_translation
    assert motion.to_dict()["pitch"] is None
    with pytest.raises(InputError, match="zero screw"):
        screw_decompose(np.zeros(6))


def test_pencils_of_linear_complexes():
    x_axis = spear([0, 0, 0], [1, 0, 0])
    assert pencil_type(x_axis, spear([0, 0, 1], [0, 1, 0])) == "hyperbolic"
    assert pencil_type(x_axis, spear([0, 0, 0], [0, 1, 0])) == "degenerate"
    regular = np.array([0, 0, 1.0, 0, 0, 0.7])
    assert pencil_type(regular, np.array([1.0, 0, 0, 0.7, 0, 0])) == "elliptic"
    assert pencil_type(regular, spear([0, 0, 0], [1, 0, 0])) == "parabolic"
    assert pencil_type(x_axis, np.array([0, 0, 0, 0, 0, 1.0])) == "degenerate"
    assert set(PENCIL_TYPES) == {"hyperbolic", "elliptic", "parabolic", "degenerate"}


def lines_of_a_regulus(angles, slope):
    """Rulings of x^2 + y^2 - slope^2 z^2 = 1."""
    directions = [[-np.sin(a) * slope, np.cos(a) * slope, 1.0] for a in angles]
    return spear([[np.cos(a), np.sin(a), 0.0] for a in angles], directions)


def test_bundles_of_linear_complexes():
    rulings = lines_of_a_regulus([0.3, 1.4, 4.0, 5.5], 0.8)
    assert bundle_type(*rulings[:3]) == "regulus"
    span = np.linalg.svd(rulings)[1]
    assert span[3] < 1e-12  # four rulings of one family span no more than three do
    origin = np.zeros((3, 3))
    assert bundle_type(*spear(origin, np.eye(3))) == "degenerate"
    assert (
        bundle_type(*spear([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0], [1, 1, 0]]))
        == "degenerate"
    )
    # Two pencils: in the plane z = 0 about the origin, in x = 0 about (0, 1, 0); common line: y-axis.
    y_axis = spear([0, 0, 0], [0, 1, 0])
    assert bundle_type(y_axis, spear([0, 0, 0], [1, 0, 0]), spear([0, 1, 0], [0, 0, 1])) == "two pencils"
    pitch = np.array([1.0, 1.0, 1.0])
    definite = np.hstack([np.eye(3), np.diag(pitch)])
    assert bundle_type(*definite) == "imaginary"
    assert bundle_type(definite[0], definite[1], spear([0, 0, 0], [0, 0, 1])) == "single line"
    flat = spear([0, 0, 0], [0, 1, 0])
    assert bundle_type(definite[0], flat, spear([0, 0, 0], [0, 0, 1])) == "double pencil"
    assert "regulus" in BUNDLE_TYPES


@given(seeds)
def test_types_of_pencils_do_not_depend_on_frame_and_basis(rng):
    a, b = rng.normal(size=(2, 6))
    gram = np.array([[klein_form(a, a), klein_form(a, b)], [klein_form(a, b), klein_form(b, b)]])
    determinant = np.linalg.det(gram)
    if abs(determinant) < 1e-3:
        return
    expected = "hyperbolic" if determinant < 0 else "elliptic"
    motion = adjoint(*random_pose(rng))
    mix = rng.normal(size=(2, 2)) + 3 * np.eye(2)
    c, d = mix @ np.array([motion @ a, motion @ b])
    assert pencil_type(a, b) == pencil_type(c, d) == expected


def test_cross_and_skew_agree_with_numpy():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 5, 3))
    assert cross(a, b) == pytest.approx(np.cross(a, b))
    assert np.einsum("kij,kj->ki", skew(a), b) == pytest.approx(np.cross(a, b))


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="direction"):
        spear([0, 0, 0], [0, 0, 0])
    with pytest.raises(InputError, match="NaN"):
        spear([0, np.nan, 0], [0, 0, 1])
    with pytest.raises(InputError, match="point"):
        spear([[0, 0, 0]], [[0, 0, 1], [1, 0, 0]])
    with pytest.raises(InputError, match="independent"):
        pencil_type([1, 0, 0, 0, 0, 0], [2, 0, 0, 0, 0, 0])
    with pytest.raises(InputError, match="zero vector"):
        bundle_type(np.zeros(6), [1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0])
