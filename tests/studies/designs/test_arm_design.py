import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import arm_from_spears, arm_pose
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.reviewed import inv_cdn_cl
from ocptip.published.arms import arm_by_name, irb_2000
from studies.indices.designs.arm_design import (
    best_arm_pose,
    characteristic_length,
    isotropic_axes,
    joint_range,
    random_poses,
    workspace_index,
)
from tests.indices.sample_axes import random_ellipsoid, turned
from tests.quick import some
from tests.robots.sample_arms import random_arm


@pytest.mark.parametrize("seed", some(2, range(4)))
def test_isotropic_axes(seed):
    ellipsoid = random_ellipsoid(np.random.default_rng(seed))
    axes = isotropic_axes(ellipsoid, seed=seed)
    result = operation_indices(axes.T, ellipsoid)
    assert (result.pi_oe, result.inv_cdn_oe) == pytest.approx((1, 1), abs=1e-9)
    order = np.random.default_rng(seed).permutation(6)
    assert operation_indices(axes[order].T, ellipsoid).inv_cdn_oe == pytest.approx(1, abs=1e-9)
    assert np.linalg.norm(axes[:, :3], axis=1) == pytest.approx(np.ones(6))


def test_isotropic_axes_of_a_sphere_have_the_characteristic_distance():
    axes = isotropic_axes(OperationEllipsoid.sphere(0.3), seed=5)
    assert np.linalg.norm(axes[:, 3:], axis=1) == pytest.approx(np.full(6, 0.3 * np.sqrt(2 / 3)), abs=1e-9)
    assert axes[:, :3].T @ axes[:, :3] == pytest.approx(2 * np.eye(3), abs=1e-9)
    assert axes[:, 3:].T @ axes[:, 3:] == pytest.approx(4 / 3 * 0.09 * np.eye(3), abs=1e-9)
    assert axes[:, :3].T @ axes[:, 3:] == pytest.approx(np.zeros((3, 3)), abs=1e-9)


def isotropic_arm(radius):
    """An arm with an isotropic pose that is not its reference pose."""
    axes = isotropic_axes(OperationEllipsoid.sphere(radius), seed=1)
    away = np.array([0.0, 0.8, -0.5, 1.0, 0.6, 0.0])
    arm = arm_from_spears("isotropic", axes, tool_position=np.zeros(3))
    pose = arm_pose(arm, away)
    assert pose.jacobian == pytest.approx(turned(axes.T, away), abs=1e-12)
    return arm_from_spears(
        "isotropic", pose.jacobian.T, tool_position=pose.position, tool_rotation=pose.rotation
    )


@pytest.mark.slow
def test_best_pose_finds_the_isotropic_pose():
    arm = isotropic_arm(0.3)
    found = best_arm_pose(arm, "inv_cdn_oe", ellipsoid=OperationEllipsoid.sphere(0.3), starts=4)
    assert found.value == pytest.approx(1, abs=1e-6)  # six equal eigenvalues: no derivative there
    assert found.sampled < 0.95
    assert found.agreeing >= 1
    value = index_values(arm, found.q, ellipsoid=OperationEllipsoid.sphere(0.3), names=["inv_cdn_oe"])
    assert found.value == value["inv_cdn_oe"]


@pytest.mark.slow
def test_characteristic_length_of_an_isotropic_arm():
    arm = isotropic_arm(0.3)
    found = characteristic_length(arm, starts=8)
    assert found.inv_cdn_cl == pytest.approx(1, abs=1e-6)
    assert found.length == pytest.approx(0.3 * np.sqrt(2 / 3), rel=1e-5)


@pytest.mark.slow
def test_characteristic_length_is_a_local_optimum():
    arm = arm_by_name("FP1W2F")
    found = characteristic_length(arm, starts=4)
    pose = arm_pose(arm, found.q)
    assert inv_cdn_cl(pose.jacobian, pose.position, found.length) == pytest.approx(found.inv_cdn_cl)
    for factor in (0.98, 1.02):
        assert inv_cdn_cl(pose.jacobian, pose.position, factor * found.length) < found.inv_cdn_cl
    rng = np.random.default_rng(0)
    near = np.clip(found.q + 0.02 * rng.normal(size=(500, 6)), *joint_range(arm))
    poses = arm_pose(arm, near)
    lengths = found.length * np.exp(0.02 * rng.normal(size=500))
    others = [inv_cdn_cl(poses.jacobian[k], poses.position[k], lengths[k]) for k in range(500)]
    assert max(others) <= found.inv_cdn_cl * (1 + 1e-6)


def test_published_maximum_of_the_manipulability():
    found = best_arm_pose(irb_2000(), "manipulability", starts=4)
    assert found.value * 1e9 == pytest.approx(7.38491693e8, rel=1e-8)
    assert found.agreeing == 4
    lower, upper = joint_range(irb_2000())
    assert (lower <= found.q).all()
    assert (found.q <= upper).all()
    assert found.to_dict()["q"] == found.q.tolist()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "index"), some(1, [("FP1W2F", "inv_cdn_oe"), ("FSFS", "pi_oe")]))
def test_best_pose_beats_many_samples(name, index):
    arm = arm_by_name(name)
    found = best_arm_pose(arm, index, starts=4)
    assert found.value > found.sampled
    samples = random_poses(arm, 5000, seed=9)
    assert found.value >= index_values(arm, samples, names=[index])[index].max()


def test_workspace_statistics():
    arm = irb_2000()
    found = workspace_index(arm, "pi_oe", samples=2000, percentiles=(10, 50))
    values = index_values(arm, random_poses(arm, 2000, 0), names=["pi_oe"])["pi_oe"]
    assert (found.minimum, found.maximum) == (values.min(), values.max())
    assert found.mean == pytest.approx(values.mean())
    assert found.percentiles[50.0] == found.median == pytest.approx(np.median(values))
    assert index_values(arm, found.best, names=["pi_oe"])["pi_oe"] == pytest.approx(found.maximum)
    assert index_values(arm, found.worst, names=["pi_oe"])["pi_oe"] == pytest.approx(found.minimum)
    assert workspace_index(arm, "pi_oe", samples=2000).mean == found.mean
    assert found.to_dict()["percentiles"]["10"] == found.percentiles[10.0]


@pytest.mark.slow
def test_seven_axes_have_a_best_condition_number():
    arm = dataclasses.replace(random_arm(2, 7), inertias=np.tile(np.eye(3), (7, 1, 1)))
    found = best_arm_pose(arm, "inv_cdn_oe", ellipsoid=OperationEllipsoid.sphere(1.0), starts=2)
    assert found.value > found.sampled
    with pytest.raises(InputError, match="six axes"):
        best_arm_pose(arm, "pi_oe")


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="can maximise"):
        best_arm_pose(irb_2000(), "dm_2")
    with pytest.raises(InputError, match="starts"):
        best_arm_pose(irb_2000(), "pi_oe", starts=0)
    with pytest.raises(InputError, match="not defined for IRB2000"):
        workspace_index(irb_2000(), "pi_oe_weighted", samples=10)
    with pytest.raises(InputError, match="samples"):
        workspace_index(irb_2000(), "pi_oe", samples=-1)
