import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import arm_from_spears, arm_pose
from ocptip.indices.arms.distance import stationary_curvatures
from ocptip.indices.arms.values import ARM_INDICES, index_values, rate_arm
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.reviewed import inv_cdn, inv_cdn_cl, inv_cdn_points
from ocptip.published.arms import arm_by_name, irb_2000, known_arms
from tests.indices.sample_axes import random_axes, random_ellipsoid, random_pose, stationary_pose
from tests.quick import examples
from tests.robots.sample_arms import random_arm

POSE = np.array([0.3, 0.4, -0.5, 0.6, 0.7, 0.2])
seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def heavy_arm(joints):
    return dataclasses.replace(random_arm(2, joints), inertias=np.tile(np.eye(3), (joints, 1, 1)))


@pytest.mark.parametrize("name", known_arms())
def test_every_index_is_rated_within_its_bounds(name):
    rating = rate_arm(arm_by_name(name), POSE, rates=np.ones(6))
    assert tuple(entry.name for entry in rating.entries) == ARM_INDICES
    for entry in rating.entries:
        if np.isnan(entry.value):
            assert entry.name.endswith("_weighted")
            assert "masses" in entry.status or "inertia" in entry.status
        else:
            assert entry.lower <= entry.value <= entry.upper
            assert entry.status == "ok"
        assert len(entry.meaning) > 20
    assert not rating.singular
    assert json.loads(json.dumps(rating.to_dict(), allow_nan=False))["robot"] == name


def test_values_are_those_of_the_functions():
    arm, ellipsoid = heavy_arm(6), random_ellipsoid(np.random.default_rng(0))
    rates = np.arange(6.0)
    rating, pose = rate_arm(arm, POSE, ellipsoid=ellipsoid, rates=rates), arm_pose(arm, POSE)
    center = pose.rotation @ ellipsoid.center + pose.position
    tips = ellipsoid.vertices(pose.rotation, pose.position)[:3]
    assert rating["inv_cdn"].value == pytest.approx(inv_cdn(pose.jacobian))
    expected = inv_cdn_cl(pose.jacobian, center, ellipsoid.characteristic_length)
    assert rating["inv_cdn_cl"].value == pytest.approx(expected)
    assert rating["inv_cdn_points"].value == pytest.approx(inv_cdn_points(pose.jacobian, tips))
    assert rating["manipulability"].value == pytest.approx(abs(np.linalg.det(pose.jacobian)))
    assert rating["sigma"].value == pytest.approx(rating.distance.motion_angle(rates))
    assert rating["dm_2_weighted"].value == pytest.approx(rating.distance.energy_2)
    with pytest.raises(InputError, match="no 'ctn' here"):
        rating["ctn"]


@examples(30)
@given(seeds)
def test_many_poses_are_rated_as_single_ones(rng):
    arm = heavy_arm(6)
    q, rates = rng.uniform(-3, 3, (3, 6)), rng.normal(size=(3, 6))
    many = index_values(arm, q, rates=rates)
    for k in range(3):
        one = index_values(arm, q[k], rates=rates[k])
        for name in ARM_INDICES:
            assert many[name][k] == pytest.approx(one[name], rel=1e-7, abs=1e-12), name


@examples(30)
@given(seeds)
def test_base_frame_and_unit_of_length_do_not_matter(rng):
    axes, tool = random_axes(rng), rng.normal(size=3)
    arm = arm_from_spears("random", axes.T, tool_position=tool)
    q, ellipsoid, rates = rng.uniform(-3, 3, 6), random_ellipsoid(rng), rng.normal(size=6)
    rotation, position = random_pose(rng)
    here = index_values(arm, q, ellipsoid=ellipsoid, rates=rates)
    moved = index_values(arm.mounted(position, rotation), q, ellipsoid=ellipsoid, rates=rates)
    factor = rng.uniform(0.1, 10)
    stretched = axes * np.repeat([1, factor], 3)[:, None]
    larger = OperationEllipsoid(factor * ellipsoid.center, ellipsoid.axes, factor * ellipsoid.half_axes)
    scaled_arm = arm_from_spears("larger", stretched.T, tool_position=factor * tool)
    scaled = index_values(scaled_arm, q, ellipsoid=larger, rates=rates)
    for name in ARM_INDICES:
        if name == "inv_cdn" or name.endswith("_weighted"):
            continue
        size = factor**3 if name == "manipulability" else 1.0
        assert scaled[name] / size == pytest.approx(here[name], rel=1e-5, abs=1e-9), name
        assert moved[name] == pytest.approx(here[name], rel=1e-5, abs=1e-9), name


def test_singular_pose():
    rating = rate_arm(irb_2000(), np.zeros(6), rates=np.ones(6))
    assert rating.singular
    values = {entry.name: entry.value for entry in rating.entries}
    zero = (
        "pi_oe",
        "inv_cdn_oe",
        "dm_inf",
        "dm_2",
        "manipulability",
        "inv_cdn",
        "inv_cdn_cl",
        "inv_cdn_points",
    )
    assert all(values[name] == 0.0 for name in zero)
    assert rating["dm_2"].status == "singular"
    assert np.isnan(values["sigma"])
    assert rating["sigma"].status == "not defined in a singular pose"


def test_stationary_pose():
    q = stationary_pose()
    rating = rate_arm(irb_2000(), q, rates=[0, 0, 0, 0, 1, 0])
    assert rating["dm_2"].value == rating["dm_inf"].value == np.inf
    assert rating["dm_2"].status == "stationary"
    assert rating["sigma"].value == pytest.approx(0, abs=1e-9)
    assert rating["sigma"].status == "stationary: along the most negative curvature"
    assert rating.to_dict()["distance"]["dm_2"] is None
    worst = stationary_curvatures(arm_pose(irb_2000(), q).jacobian).worst
    rates = np.array([np.zeros(6), [0, *worst, 0], [0, *-worst, 0]])
    sigma = index_values(irb_2000(), np.tile(q, (3, 1)), rates=rates, names=["sigma"])["sigma"]
    assert sigma == pytest.approx([np.nan, -np.pi / 2, -np.pi / 2], nan_ok=True)


def test_resting_joints_and_arms_of_seven_axes():
    rating = rate_arm(irb_2000(), POSE, rates=[1, 0, 0, 0, 0, 1])
    assert rating["sigma"].status == "not defined: joints 2 to 5 rest"
    seven = rate_arm(heavy_arm(7), np.zeros(7))
    assert seven["inv_cdn_oe"].value > 0
    assert seven["inv_cdn_oe_weighted"].value > 0
    for name in ("pi_oe", "dm_inf", "dm_2", "dm_2_weighted"):
        assert np.isnan(seven[name].value)
        assert seven[name].status == "defined for six axes only"
    assert seven.distance is None
    assert json.dumps(seven.to_dict(), allow_nan=False)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="has 5 axes"):
        rate_arm(random_arm(0, 5), np.zeros(5))
    with pytest.raises(InputError, match="q: expected shape 6"):
        rate_arm(irb_2000(), np.zeros(5))
    with pytest.raises(InputError, match="NaN"):
        rate_arm(irb_2000(), np.full(6, np.nan))
    with pytest.raises(InputError, match="rates"):
        rate_arm(irb_2000(), POSE, rates=[1, 2])
    with pytest.raises(InputError, match="no index 'dm'"):
        index_values(irb_2000(), POSE, names=["dm"])
    with pytest.raises(InputError, match="sigma needs rates"):
        index_values(irb_2000(), POSE, names=["sigma"])


def test_rating_takes_less_than_a_millisecond(benchmark):
    benchmark(rate_arm, arm_by_name("FP1W2F"), POSE, rates=np.ones(6))
    assert benchmark.disabled or benchmark.stats.stats.min < 1e-3
