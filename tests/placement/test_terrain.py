"""Terrain patches: the inclined plane of the source, user-defined terrain, refusals."""

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.placement.terrain import custom_terrain, plane
from tests.placement.placement_scenes import hills
from tests.quick import examples

SLOPE = st.floats(-2, 2)


@examples(30)
@given(SLOPE, SLOPE, st.floats(-3, 3), st.floats(-3, 3), st.floats(-7, 7))
def test_plane_has_the_axes_of_the_source(a, b, x, y, angle):
    position, rotation = plane((a, b), 0.3).poses([[x, y, angle]])
    assert position[0] == pytest.approx([x, y, 0.3 + a * x + b * y])
    e_x = np.array([1, 0, a]) / np.sqrt(1 + a**2)  # (4.3)
    e_y = np.array([-a * b, 1 + a**2, b]) / np.sqrt((1 + a**2) * (1 + a**2 + b**2))
    e_z = np.array([-a, -b, 1]) / np.sqrt(1 + a**2 + b**2)
    turned = np.column_stack(
        [np.cos(angle) * e_x + np.sin(angle) * e_y, np.cos(angle) * e_y - np.sin(angle) * e_x]
    )
    assert np.allclose(rotation[0], np.column_stack([turned, e_z]), atol=1e-12)


def test_angles_are_wrapped_only_where_bounds_allow():
    assert plane().wrapped([0.0, 7.0, 4.0])[2] == pytest.approx(4.0 - 2 * np.pi)
    assert plane().wrapped([0.0, 7.0, 4.0])[1] == 7.0
    assert plane(angle=(3.0, 5.0)).wrapped([0.0, 0.0, 4.0])[2] == 4.0


def test_box_keeps_bounds_and_reach():
    low, high = plane(x=(-0.5, 9.0)).box(np.array([0.0, 1.0, 2.0]), 2.0)
    assert low.tolist() == [-0.5, -1.0, -np.pi]
    assert high.tolist() == [2.0, 3.0, np.pi]
    low, high = plane(x=(5.0, 9.0)).box(np.zeros(3), 2.0)
    assert low[0] == high[0] == 5.0


@pytest.mark.parametrize(
    ("bounds", "sampled"),
    [
        ((190, 350), (190, 350)),
        ((100, 260), (100, 260)),
        ((-350, -190), (-350, -190)),
        ((-10, 10), (-10, 10)),
        ((-400, 400), (-180, 180)),
        ((100, 800), (100, 460)),
        ((-800, -300), (-660, -300)),
        ((200, np.inf), (200, 560)),
        ((-np.inf, -200), (-560, -200)),
        ((-np.inf, np.inf), (-180, 180)),
    ],
)
def test_angles_are_sampled_over_their_bounds_or_one_turn_of_them(bounds, sampled):
    low, high = plane(angle=np.deg2rad(bounds)).box(np.zeros(3), 2.0)
    assert np.rad2deg([low[2], high[2]]) == pytest.approx(sampled)


def test_constraints_of_a_custom_terrain():
    values = hills().constraint_values([[0.0, 0.0, 0.0], [-0.1, 0.05, 1.0]])
    assert values[:, 0] == pytest.approx([0.0, -0.0075])


def test_custom_terrain_refuses_what_is_no_pose():
    p = cs.SX.sym("p", 2)
    position = cs.vertcat(p, 0)
    stretched = cs.Function("f", [p], [position, 2 * cs.SX.eye(3)])
    with pytest.raises(InputError, match="'bad': function: its second result is no rotation"):
        custom_terrain(stretched, [0, 0], [1, 1], name="bad")
    good = cs.Function("f", [p], [position, cs.SX.eye(3)])
    with pytest.raises(InputError, match="p2: needs finite bounds"):
        custom_terrain(good, [0, -np.inf], [1, 1])
    with pytest.raises(InputError, match=r"expected a function of \(2,\)"):
        custom_terrain(cs.Function("f", [p], [position]), [0, 0], [1, 1])
    with pytest.raises(InputError, match=r"lower bound 2.0 is above upper bound 1.0"):
        custom_terrain(good, [2, 0], [1, 1])
    with pytest.raises(InputError, match="constraint_names: expected 0"):
        custom_terrain(good, [0, 0], [1, 1], constraint_names=["a"])


def test_plane_refuses_broken_input():
    with pytest.raises(InputError, match="slope"):
        plane((np.nan, 0.0))
    with pytest.raises(InputError, match="x: expected two bounds"):
        plane(x=(0.0, np.nan))
    with pytest.raises(InputError, match="above upper"):
        plane(y=(1.0, 0.0))
