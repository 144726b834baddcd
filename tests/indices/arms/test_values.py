"""Indices of many poses are those of each of them; what is not defined is NaN in the shape of the others."""

import dataclasses

import numpy as np
import pytest

from ocptip.indices.arms.values import ARM_INDICES, index_values
from ocptip.published.arms import arm_by_name, irb_2000
from tests.robots.sample_arms import random_arm

POSES = np.random.default_rng(3).uniform(-1, 1, (4, 6))
RATES = np.random.default_rng(4).uniform(-1, 1, (4, 6))


@pytest.mark.parametrize("arm", [arm_by_name("FSFS"), irb_2000()], ids=["with masses", "without"])
def test_many_poses_are_as_single_ones(arm):
    many = index_values(arm, POSES, rates=RATES)
    assert list(many) == list(ARM_INDICES)
    for k, (q, rates) in enumerate(zip(POSES, RATES, strict=True)):
        for name, value in index_values(arm, q, rates=rates).items():
            assert np.ndim(value) == 0
            assert many[name].shape == (4,)
            assert many[name][k] == pytest.approx(value, rel=1e-9, nan_ok=True), name
    undefined = {name for name, values in many.items() if np.isnan(values).all()}
    motionless = {"pi_oe_weighted", "inv_cdn_oe_weighted"}  # nothing turns with the last axis of FSFS
    without = {name for name in ARM_INDICES if name.endswith("_weighted")}
    assert undefined == (motionless if arm.masses.any() else without)


def test_seven_axes_have_no_distance():
    arm = dataclasses.replace(random_arm(2, 7), inertias=np.tile(np.eye(3), (7, 1, 1)))
    many = index_values(arm, np.zeros((3, 7)) + 0.3, rates=np.ones(7))
    assert all(values.shape == (3,) for values in many.values())
    undefined = {name for name, values in many.items() if np.isnan(values).all()}
    assert undefined == {
        "pi_oe",
        "pi_oe_weighted",
        "dm_inf",
        "dm_2",
        "dm_inf_weighted",
        "dm_2_weighted",
        "sigma",
    }
