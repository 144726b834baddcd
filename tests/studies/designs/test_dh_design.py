import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.metric import OperationEllipsoid
from studies.indices.designs.arm_design import best_arm_pose
from studies.indices.designs.dh_design import design_arm, designed_arm

# a, alpha, d: links up to 0.6 m, any twist; the first d changes nothing.
LOWER = np.tile([0.0, -np.pi, -0.4], (6, 1))
UPPER = np.tile([0.6, np.pi, 0.4], (6, 1))
LOWER[0, 2] = UPPER[0, 2] = 0.0
RANGE = np.deg2rad(np.tile([-120.0, 120.0], (6, 1)))
SPHERE = OperationEllipsoid.sphere(0.3)
WELDER = OperationEllipsoid((0.05, 0.0, 0.1), np.eye(3), np.array([0.1, 0.15, 0.3]))


@pytest.mark.parametrize(("tool", "seed"), [(SPHERE, 2), (WELDER, 3)], ids=["sphere", "ellipsoid"])
def test_a_designed_arm_has_an_isotropic_pose_in_its_range(tool, seed):
    found = design_arm(tool, LOWER, UPPER, RANGE, seed=seed)  # these seeds succeed within a few starts
    assert found.inv_cdn_oe == pytest.approx(1, abs=1e-9)
    assert ((found.rows >= LOWER) & (found.rows <= UPPER)).all()
    assert (np.abs(found.q) <= RANGE[:, 1]).all()
    pose = arm_pose(designed_arm(found.rows, RANGE), found.q)
    center = pose.rotation @ tool.center + pose.position
    if tool is SPHERE:  # the operation point is CL = R sqrt(2/3) away from all axes
        moments = pose.jacobian[3:] - np.cross(center, pose.jacobian[:3].T).T
        assert np.linalg.norm(moments, axis=0) == pytest.approx(np.full(6, 0.3 * np.sqrt(2 / 3)), abs=1e-7)
    assert operation_indices(pose.jacobian, tool, pose.rotation, pose.position).pi_oe == pytest.approx(1)


@pytest.mark.slow
def test_an_operation_point_on_the_last_axis_admits_no_isotropic_pose():
    """[Naw07] 3.4.1: all axes are equally far from the operation point of an isotropic pose."""
    upper = UPPER.copy()
    upper[5, 0] = 0.0
    found = design_arm(SPHERE, LOWER, upper, RANGE, starts=4)
    assert found.inv_cdn_oe < 0.9
    assert (
        best_arm_pose(designed_arm(found.rows, RANGE), "inv_cdn_oe", ellipsoid=SPHERE, starts=2).value < 0.9
    )


def test_bounds_are_kept_and_checked():
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[:, 1] = upper[:, 1] = np.pi / 2 * np.array([1, 0, 1, -1, 1, 0])  # twists of industrial arms
    found = design_arm(SPHERE, lower, upper, RANGE, starts=2)
    np.testing.assert_array_equal(found.rows[:, 1], lower[:, 1])
    assert 0 < found.inv_cdn_oe <= 1
    with pytest.raises(InputError, match="above its upper bound"):
        design_arm(SPHERE, UPPER, LOWER, RANGE)
    with pytest.raises(InputError, match="joint_range"):
        design_arm(SPHERE, LOWER, UPPER, RANGE[:5])
