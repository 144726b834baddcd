import dataclasses

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import (
    arm_from_spears,
    arm_pose,
    moving_inertias,
    symbolic_inertias,
    symbolic_pose,
)
from ocptip.indices.lines import adjoint
from ocptip.published.arms import arm_by_name, irb_2000, known_arms
from ocptip.robots.kinematics import jacobian
from tests.indices.sample_axes import random_axes, random_pose, turned
from tests.quick import examples
from tests.robots.pinocchio_twin import twin
from tests.robots.sample_arms import random_arm

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@examples(25)
@given(seeds, st.integers(1, 8))
def test_axes_are_those_of_a_product_of_rotations(rng, count):
    axes, (rotation, position) = random_axes(rng, count), random_pose(rng)
    arm = arm_from_spears("random", axes.T, tool_position=position, tool_rotation=rotation)
    reference = arm_pose(arm, np.zeros(count))
    assert reference.jacobian == pytest.approx(axes, abs=1e-12)
    assert reference.rotation == pytest.approx(rotation, abs=1e-12)
    assert reference.position == pytest.approx(position, abs=1e-12)
    angles = rng.uniform(-3, 3, count)
    assert arm_pose(arm, angles).jacobian == pytest.approx(turned(axes, angles), abs=1e-10)


@pytest.mark.parametrize("name", known_arms())
def test_axes_and_geometric_jacobian_describe_one_motion(name):
    arm = arm_by_name(name)
    q = np.random.default_rng(1).uniform(-2, 2, (5, 6))
    pose, geometric = arm_pose(arm, q), jacobian(arm, q)
    for k in range(5):
        at_tool = np.linalg.inv(adjoint(np.eye(3), pose.position[k])) @ pose.jacobian[k]
        assert np.vstack([at_tool[3:], at_tool[:3]]) == pytest.approx(geometric[k], abs=1e-12)
        single = arm_pose(arm, q[k])
        assert single.jacobian == pytest.approx(pose.jacobian[k], abs=1e-15)


@pytest.mark.parametrize("joints", [1, 6, 7])
def test_symbolic_pose_and_inertias(joints):
    arm = random_arm(4, joints)
    symbols = cs.SX.sym("q", joints)
    function = cs.Function("f", [symbols], [*symbolic_pose(arm, symbols), symbolic_inertias(arm, symbols)])
    q = np.random.default_rng(2).uniform(-2, 2, joints)
    pose = arm_pose(arm, q)
    expected = (pose.jacobian, pose.rotation, pose.position, pose.inertias)
    for value, want in zip(function(q), expected, strict=True):
        assert np.array(value).reshape(want.shape) == pytest.approx(want, abs=1e-12)


def test_moving_inertias_are_the_diagonal_of_the_mass_matrix():
    arm = arm_by_name("FP1W2F")
    robot = twin(arm)
    q = np.random.default_rng(3).uniform(-2, 2, 6)
    assert arm_pose(arm, q).inertias == pytest.approx(
        np.diag(pin.crba(robot, robot.createData(), q)), abs=1e-12
    )


def test_moving_inertias_that_cannot_be_used():
    q = np.zeros(6)
    with pytest.raises(InputError, match="no masses"):
        moving_inertias(arm_pose(irb_2000(), q))
    with pytest.raises(InputError, match="axis 6 moves 0"):
        moving_inertias(arm_pose(arm_by_name("FP1W2F"), q))
    heavy = random_arm(0, 6)
    solid = np.tile(np.eye(3), (6, 1, 1))
    assert (moving_inertias(arm_pose(dataclasses.replace(heavy, inertias=solid), q)) > 0).all()


def test_irb_2000_is_the_printed_robot():
    arm = irb_2000()
    q = np.random.default_rng(0).uniform(arm.limits.angle_min, arm.limits.angle_max, (50, 6))
    s2, c3, s3, s5 = np.sin(q[:, 1]), np.cos(q[:, 2]), np.sin(q[:, 2]), np.sin(q[:, 4])
    both = q[:, 1] + q[:, 2]
    elbow, shoulder = 850 * c3 + 125 * s3, 710 * s2 + 850 * np.cos(both) + 125 * np.sin(both)
    printed = 710 * np.abs(elbow * shoulder * s5)  # mm^3, [Naw07] 3.5
    assert np.abs(np.linalg.det(arm_pose(arm, q).jacobian)) * 1e9 == pytest.approx(printed)
    assert np.degrees(arm.limits.angle_max) == pytest.approx([179, 100, 60, 200, 120, 200])
    assert arm_pose(arm, np.zeros(6)).position == pytest.approx([1.15, 0, 0.835])


def test_names_and_bad_spears():
    assert arm_by_name("irb 2000") is irb_2000()
    assert arm_by_name("fsfs").name == "FSFS"
    with pytest.raises(InputError, match=r"no arm 'KUKA'; there are FP1W2F"):
        arm_by_name("KUKA")
    with pytest.raises(InputError, match=r"spears\[0\]: no spear: direction of length 2"):
        arm_from_spears("x", [[0, 0, 2, 0, 0, 0]], tool_position=[0, 0, 0])
    with pytest.raises(InputError, match="not perpendicular"):
        arm_from_spears("x", [[0, 0, 1, 0, 0, 1]], tool_position=[0, 0, 0])
    with pytest.raises(InputError, match="tool_position"):
        arm_from_spears("x", [[0, 0, 1, 0, 0, 0]], tool_position=[0, np.inf, 0])
