"""Forward kinematics against Pinocchio, the Jacobian against finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.published.arms import arm_names, load_arm
from ocptip.robots.kinematics import (
    forward_kinematics,
    gripper_kinematics,
    gripper_pose,
    jacobian,
    link_frames,
)
from tests.robots.pinocchio_twin import twin
from tests.robots.sample_arms import random_arm

ARMS = [*(load_arm(name).mounted([0.1, 0.2, 0.3]) for name in arm_names()), random_arm(1, 7)]


@pytest.mark.parametrize("model", ARMS, ids=lambda m: m.name)
def test_frames_and_jacobian_agree_with_pinocchio(model):
    robot = twin(model)
    data = robot.createData()
    states = np.random.default_rng(0).uniform(-3, 3, (40, model.n))
    frames, slopes = link_frames(model, states), jacobian(model, states)
    for q, R, o, J in zip(states, frames.rotations, frames.origins, slopes, strict=True):
        pin.framesForwardKinematics(robot, data, q)
        tool = data.oMf[robot.getFrameId("G")]
        for i, placement in enumerate([*list(data.oMi)[1:], tool]):
            np.testing.assert_allclose(R[i], placement.rotation, atol=1e-13)
            np.testing.assert_allclose(o[i], placement.translation, atol=1e-12)
        frame = robot.getFrameId("G")
        theirs = pin.computeFrameJacobian(robot, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(J, theirs, atol=1e-12)


def test_jacobian_against_finite_differences():
    model = load_arm("FSFS")
    q = np.linspace(-1, 1.2, 6)
    step = 1e-6
    for joint in range(6):
        e = step * np.eye(6)[joint]
        (p1, R1), (p0, R0) = gripper_pose(model, q + e), gripper_pose(model, q - e)
        column = np.concatenate([p1 - p0, Rotation.from_matrix(R1 @ R0.T).as_rotvec()]) / (2 * step)
        np.testing.assert_allclose(jacobian(model, q)[:, joint], column, atol=1e-8)


def test_single_state_has_no_leading_axis():
    model = load_arm("FSFS")
    frames = link_frames(model, np.zeros(6))
    assert frames.rotations.shape == (7, 3, 3)
    assert frames.origins.shape == (7, 3)
    assert gripper_pose(model, np.zeros((4, 6)))[1].shape == (4, 3, 3)
    np.testing.assert_array_equal(frames.origins[-1], gripper_pose(model, np.zeros(6))[0])


def test_functions_are_cached_per_model():
    model = load_arm("FSFS")
    assert forward_kinematics(model) is forward_kinematics(model)
    assert gripper_kinematics(model) is not gripper_kinematics(model.mounted([0, 0, 1]))


def test_mounting_twice_composes():
    model = load_arm("FP1W2F")
    turn = Rotation.from_rotvec([0.2, -0.4, 0.9]).as_matrix()
    once = model.mounted([0, 0, 1])
    twice = once.mounted([1, 2, 3], turn)
    q = np.linspace(-1, 1, 6)
    p, R = gripper_pose(once, q)
    p2, R2 = gripper_pose(twice, q)
    np.testing.assert_allclose(p2, [1, 2, 3] + turn @ p, atol=1e-14)
    np.testing.assert_allclose(R2, turn @ R, atol=1e-14)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="q: expected shape n x 6, got 2 x 5"):
        link_frames(load_arm("FSFS"), np.zeros((2, 5)))
