"""Studies of operation ellipsoids: size and time, and where that of an optimal platform lies."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from ocptip.indices.arms.values import rate_arm
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_number, platform_conditioning
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.published.arms import irb_2000
from studies.indices import anchor_ellipsoids, ellipsoid_size
from studies.indices.designs.optimal_domains import special_limit
from studies.indices.designs.optimal_platforms import ctn_optimal_main, ctn_optimal_special, example_main
from tests.quick import some


@pytest.mark.slow
def test_size_and_time_reach_the_level_lines_of_the_source(tmp_path, capsys):
    assert ellipsoid_size.main(["--out", str(tmp_path), "--grid", "21"]) == 0
    assert "| prolate | PI_OE |" in capsys.readouterr().out
    for row in json.loads((tmp_path / "ellipsoid_size.json").read_text())["highest"]:
        step = {"pi_oe": 0.1, "inv_cdn_oe": 0.02}[row["index"]]
        line = row["highest_level_line_of_the_source"]
        assert line - 0.02 * step <= row["largest"] < line + step
    assert (tmp_path / "ellipsoid_size.png").stat().st_size > 50_000


def test_maps_of_size_and_time_are_those_of_single_poses():
    found = ellipsoid_size.maps(5)
    for shape, half in (
        ("sphere", (0.175,) * 3),
        ("prolate", (0.05, 0.05, 0.175)),
        ("oblate", (0.175, 0.175, 0.05)),
    ):
        q = ellipsoid_size.motion(found["t"][3:4])[0]
        rating = rate_arm(irb_2000(), q, ellipsoid=OperationEllipsoid(np.zeros(3), half_axes=half))
        for name in ("pi_oe", "inv_cdn_oe"):
            assert found["maps"][shape][name][3, 2] == pytest.approx(rating[name].value, rel=1e-9)
    line = ellipsoid_size.along(11)
    # [Naw07] 4.6: t = 0.6, and the difference quotient of the motion
    assert line["dm_2"][6] == pytest.approx(0.407505, abs=1e-6)
    assert line["sigma"][6] == pytest.approx(0.958908, abs=1e-6)
    h, t = 1e-6, np.array([0.3])
    quotient = (ellipsoid_size.motion(t + h) - ellipsoid_size.motion(t - h)) / (2 * h)
    assert ellipsoid_size.rates(t) == pytest.approx(quotient, rel=1e-8)


@given(st.integers(0, 2**31), st.integers(6, 9), st.floats(0.2, 4.0))
def test_equal_legs_have_the_ctn_of_their_anchors(seed, n, length):
    """Against the definition: rates of the passive joints of the single legs."""
    rng = np.random.default_rng(seed)
    base, along = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    pose = PlatformPose(base, base + length * along)
    own = platform_conditioning(pose, anchor_ellipsoids.own_ellipsoid(pose).W())
    kappa = own.lambdas * n / 3.0  # of all 2 n anchors; six vertices stand for them
    predicted = np.sqrt((kappa[0] - 2) / (kappa[-1] - 2))
    assert control_number(pose).value == pytest.approx(predicted, abs=1e-9)
    assert own.value >= control_number(pose).value - 1e-12


@pytest.mark.parametrize(("t", "r1", "root"), [(0.3, 1.0, 3), (-0.7, 0.8, 1), (0.2, 1.2, 2), (0.5, 0.7, 2)])
def test_main_members_are_isotropic_for_the_ellipsoid_of_their_anchors(t, r1, root):
    pose = ctn_optimal_main(t, r1, root=root).pose
    own = anchor_ellipsoids.own_ellipsoid(pose)
    assert platform_conditioning(pose, own.W()).value == pytest.approx(1.0, abs=1e-10)
    defect, center, squares = anchor_ellipsoids.isotropic_ellipsoid(pose)
    assert defect < 1e-10
    assert center == pytest.approx(own.center, abs=1e-9)
    assert squares == pytest.approx((own.axes * own.half_axes**2) @ own.axes.T, abs=1e-9)
    levels = anchor_ellipsoids.levels(pose, own)
    assert levels.mean() == pytest.approx(1.0)
    assert (np.abs(levels - 1).max() < 1e-9) == (t == 0.5)


def test_where_all_anchors_lie_on_it():
    pose = example_main(0.3).pose
    assert anchor_ellipsoids.levels(pose, anchor_ellipsoids.own_ellipsoid(pose)) == pytest.approx(np.ones(12))
    (r1,) = anchor_ellipsoids.spheres(0.6, 2)
    pose = ctn_optimal_main(0.6, r1, root=2).pose
    own = anchor_ellipsoids.own_ellipsoid(pose)
    assert np.ptp(own.half_axes) < 1e-9
    assert pose.lengths == pytest.approx(np.full(6, 2 / np.sqrt(3) * own.half_axes[0]))
    assert np.linalg.norm(pose.base - own.center, axis=1) == pytest.approx(np.full(6, own.half_axes[0]))


@pytest.mark.slow
@pytest.mark.parametrize("t", some(1, [0.2, 0.8]))
def test_no_ellipsoid_is_better_for_special_members(t):
    """Against a search over ellipsoids of any centre, axes and size."""
    pose = ctn_optimal_special(t, 0.6 * special_limit(t)).pose
    bound = anchor_ellipsoids.special_bound(t)
    assert anchor_ellipsoids.best_of_special(pose) == pytest.approx(bound, rel=1e-9)

    def loss(x):
        axes = np.linalg.qr(
            np.eye(3) + 0.3 * np.array([[0, x[3], x[4]], [-x[3], 0, x[5]], [-x[4], -x[5], 0]])
        )[0]
        axes = axes * np.sign(np.linalg.det(axes))
        return -platform_conditioning(pose, OperationEllipsoid(x[6:], axes, np.exp(x[:3])).W()).value

    start = np.zeros(9)
    start[:3] = np.log(anchor_ellipsoids.own_ellipsoid(pose).half_axes[[1, 2, 0]])
    found = -minimize(loss, start, method="Nelder-Mead", options={"maxfev": 900, "adaptive": True}).fun
    assert 0.8 * bound < found <= bound + 1e-9


@pytest.mark.slow
def test_six_legs_without_symmetry_that_are_optimal_and_isotropic_are_equal(tmp_path):
    found = anchor_ellipsoids.search(6, 1, True, np.random.default_rng(8))
    optimal = anchor_ellipsoids.search(6, 1, False, np.random.default_rng(5))
    assert (found["found"], found["equal_legs"], found["freedom"]) == (1, 1, [5.0, 5.0])
    assert found["own"] == pytest.approx([1.0, 1.0], abs=1e-9)
    assert (optimal["found"], optimal["equal_legs"], optimal["freedom"]) == (1, 0, [10.0, 10.0])
    anchor_ellipsoids.draw(tmp_path / "figure.png", 8)
    assert (tmp_path / "figure.png").stat().st_size > 50_000
