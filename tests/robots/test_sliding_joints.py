"""Arms with sliding joints against Pinocchio and finite differences; what cannot take them refuses."""

import dataclasses

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.arms.symbolic import index_function
from ocptip.indices.arms.values import rate_arm
from ocptip.robots.dynamics import evaluate_dynamics, inverse_dynamics
from ocptip.robots.inverse.closed_form import closed_form_family
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.kinematics import gripper_pose, jacobian, link_frames
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.urdf.arm import arm_from_pinocchio
from tests.quick import examples
from tests.robots.pinocchio_twin import dynamics, twin
from tests.robots.sample_arms import random_arm

ALIGNED = {
    True: (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ),
    False: (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ),
}
UNALIGNED = {True: pin.JointModelPrismaticUnaligned, False: pin.JointModelRevoluteUnaligned}


def random_model(seed: int, slides: list[bool], root: pin.JointModelFreeFlyer | None = None) -> pin.Model:
    """A chain of joints about or along random axes; the same one with and without a floating root."""
    rng, robot, parent = np.random.default_rng(seed), pin.Model(), 0
    if root is not None:
        parent = robot.addJoint(0, root, pin.SE3.Identity(), "root")
    for index, kind in enumerate(slides):
        axis = rng.normal(size=3)
        aligned = rng.integers(4)
        joint = ALIGNED[kind][aligned]() if aligned < 3 else UNALIGNED[kind](axis / np.linalg.norm(axis))
        rotation = pin.exp3(rng.normal(size=3))
        parent = robot.addJoint(parent, joint, pin.SE3(rotation, rng.normal(size=3)), f"j{index}")
        robot.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
    tool = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    robot.addFrame(pin.Frame("tool", parent, tool, pin.FrameType.OP_FRAME))
    return robot


chains = st.lists(st.booleans(), min_size=1, max_size=8)


@examples(40)
@given(seed=st.integers(0, 2**31 - 1), slides=chains)
def test_any_chain_agrees_with_pinocchio_and_with_its_floating_base(seed, slides):
    pin.seed(seed)
    fixed = random_model(seed, slides)
    pin.seed(seed)
    floating = random_model(seed, slides, pin.JointModelFreeFlyer())
    model = arm_from_pinocchio(fixed, base_link="universe", tool_frame="tool", accept_inertia=True)
    assert model.prismatic.tolist() == slides
    n, rng = len(slides), np.random.default_rng(seed + 1)
    q, qd, qdd = rng.uniform(-2, 2, (3, n))
    gravity = rng.normal(size=3) * 5
    for robot in (fixed, floating):
        robot.gravity.linear = gravity
    data = fixed.createData()
    pin.framesForwardKinematics(fixed, data, q)
    position, rotation = gripper_pose(model, q)
    tool = data.oMf[fixed.getFrameId("tool")]
    scale = 1 + np.abs(tool.translation).max()
    np.testing.assert_allclose(position, tool.translation, atol=1e-13 * scale)
    np.testing.assert_allclose(rotation, tool.rotation, atol=1e-13)
    pin.computeJointJacobians(fixed, data, q)
    theirs = pin.getFrameJacobian(fixed, data, fixed.getFrameId("tool"), pin.LOCAL_WORLD_ALIGNED)
    np.testing.assert_allclose(jacobian(model, q), theirs.reshape(6, n), atol=1e-12 * scale)

    ours = evaluate_dynamics(model, q, qd, qdd, gravity=gravity)
    torque = pin.rnea(fixed, data, q, qd, qdd)
    still = np.zeros(6)
    whole = pin.rnea(
        floating,
        floating.createData(),
        np.concatenate([pin.neutral(floating)[:7], q]),
        np.concatenate([still, qd]),
        np.concatenate([still, qdd]),
    )
    size = np.abs(whole).max()
    np.testing.assert_allclose(ours.torque, torque, atol=1e-12 * size)
    np.testing.assert_allclose(ours.torque, whole[6:], atol=1e-12 * size)
    np.testing.assert_allclose(ours.wrench, -whole[:6], atol=1e-12 * size)  # what would hold the base


def slider(seed: int, slides: list[bool]) -> ArmModel:
    return dataclasses.replace(random_arm(seed, len(slides)), prismatic=np.array(slides))


@examples(20)
@given(seed=st.integers(0, 2**31 - 1), slides=chains)
def test_loads_at_the_gripper_and_armatures_agree_with_pinocchio(seed, slides):
    model, rng = slider(seed, slides), np.random.default_rng(seed)
    robot = twin(model)
    q, qd, qdd = rng.uniform(-2, 2, (3, model.n))
    gravity, force, moment, about = rng.normal(size=(4, 3)) * 5
    ours = evaluate_dynamics(model, q, qd, qdd, gravity=gravity, force=force, moment=moment, about=about)
    torque, wrench = dynamics(robot, q, qd, qdd, gravity, force, moment, about)
    theirs = np.concatenate([torque, wrench])
    difference = np.concatenate([ours.torque, ours.wrench]) - theirs
    assert np.abs(difference).max() < 1e-12 * np.abs(theirs).max()


@examples(10)
@given(seed=st.integers(0, 2**31 - 1), slides=chains)
def test_derivatives_agree_with_finite_differences(seed, slides):
    model, n = slider(seed, slides), len(slides)
    rng, h = np.random.default_rng(seed), 1e-6
    q = rng.uniform(-1, 1, n)
    moved = [gripper_pose(model, q + s * h * e)[0] for e in np.eye(n) for s in (1, -1)]
    slopes = np.array([(a - b) / (2 * h) for a, b in zip(moved[::2], moved[1::2], strict=True)]).T
    np.testing.assert_allclose(jacobian(model, q)[:3], slopes, atol=1e-7)
    x = cs.SX.sym("x", n)
    f = inverse_dynamics(model)
    columns = cs.vertcat(*f(x, 0.3, -0.2, cs.DM([1, 2, -9]), 0, 0, 0))
    value, slope = cs.Function("v", [x], [columns]), cs.Function("s", [x], [cs.jacobian(columns, x)])
    exact = np.array(slope(q))
    for j, e in enumerate(np.eye(n)):
        numeric = np.array(value(q + h * e) - value(q - h * e))[:, 0] / (2 * h)
        np.testing.assert_allclose(exact[:, j], numeric, atol=1e-6 * (1 + np.abs(exact).max()))


def gantry() -> ArmModel:
    """A lift, then three axes of an elbow arm in the plane, then a boom that slides out."""
    along_x = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # z of the frame along x of the one before
    about_y = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    limits = JointLimits.unlimited(4)
    limits = dataclasses.replace(
        limits, angle_min=np.array([0.0, -7, -7, 0.1]), angle_max=np.array([0.5, 7, 7, 0.4])
    )
    return ArmModel(
        name="gantry",
        joint_names=("lift", "turn", "lean", "boom"),
        rotations=np.array([np.eye(3), np.eye(3), about_y, along_x]),
        offsets=np.array([[0, 0, 0.4], [0, 0, 0], [0.5, 0, 0], [0, 0, 0.2]]),
        masses=np.full(4, 2.0),
        centres=np.full((4, 3), 0.05),
        inertias=np.tile(0.01 * np.eye(3), (4, 1, 1)),
        limits=limits,
        prismatic=np.array([True, False, False, True]),
    )


def test_sliding_moves_and_does_not_turn():
    model = gantry()
    frames = link_frames(model, np.array([[0.1, 0.3, 0.2, 0.2], [0.4, 0.3, 0.2, 0.3]]))
    np.testing.assert_allclose(frames.rotations[0], frames.rotations[1])
    np.testing.assert_allclose(frames.origins[1, 0] - frames.origins[0, 0], [0, 0, 0.3], atol=1e-15)
    boom = frames.origins[1, -1] - frames.origins[0, -1] - [0, 0, 0.3]
    np.testing.assert_allclose(boom, 0.1 * frames.rotations[0, 3, :, 2], atol=1e-15)
    assert model.units == ("m", "rad", "rad", "m")
    assert model.reach == pytest.approx(0.4 + 0.5 + 0.2 + 0.5 + 0.4)


def test_inverse_kinematics_finds_ways_within_their_limits_and_does_not_turn_them():
    model = gantry()
    wanted = np.array([0.2, 0.3, -0.4, 0.25])
    found = solve_inverse_kinematics(model, *gripper_pose(model, wanted))
    assert found.method == "search"
    assert closed_form_family(model) is None
    np.testing.assert_allclose(found.nearest(wanted), wanted, atol=1e-8)
    turned = within_limits(model, wanted + 2 * np.pi)
    assert np.isnan(turned[[0, 3]]).all()  # a way has no copy a turn away
    np.testing.assert_allclose(turned[1:3], wanted[1:3])


def test_poses_beyond_the_limit_of_a_slide_say_metres():
    model = gantry()
    position, rotation = gripper_pose(model, np.array([0.2, 0.3, -0.4, 0.6]))
    with pytest.raises(InputError, match=r"'(lift|boom)' at [-0-9.]+ m, limits 0\.\d{4} to 0\.\d{4}$"):
        solve_inverse_kinematics(model, position, rotation)


def test_indices_refuse_sliding_joints_by_name():
    model = slider(3, [True, False, False, True, False, False])
    with pytest.raises(InputError, match="but these slide: j0, j3; lock them"):
        rate_arm(model, np.zeros(6))
    with pytest.raises(InputError, match="but these slide: j0, j3; lock them"):
        index_function(model, "dm_2")


@pytest.mark.parametrize("wrong", [[True], np.zeros(4), "yes"])
def test_kinds_are_one_truth_value_per_joint(wrong):
    with pytest.raises(InputError, match="prismatic: expected 4 times true or false"):
        dataclasses.replace(gantry(), prismatic=wrong)
