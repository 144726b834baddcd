"""What a process does to the gripper: the same in every place that computes with an arm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.published.tasks import experiment_task
from ocptip.robots.braking import terms
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.kinematics import gripper_pose, jacobian
from ocptip.robots.process import AXES, ProcessWrench
from tests.quick import examples
from tests.robots.pinocchio_twin import dynamics, twin
from tests.robots.sample_arms import random_arm

GRAVITY, ABOUT = np.array([0.4, -0.3, -9.7]), np.array([0.1, 0.2, -0.3])


def states(model, seed, count=4):
    return np.random.default_rng(seed).uniform(-3, 3, (3, count, model.n))


def random_process(seed, axes):
    return ProcessWrench(*np.random.default_rng(seed).normal(size=(2, 3)) * 20, axes)


def in_base_axes(model, process, q):
    """Force and moment (N, 3) in base axes."""
    turn = gripper_pose(model, q)[1] if process.axes == "tool" else np.broadcast_to(np.eye(3), (len(q), 3, 3))
    return turn @ process.force, turn @ process.moment


@examples(15)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(1, 7), axes=st.sampled_from(AXES))
def test_torques_and_base_wrench_are_pinocchios(seed, joints, axes):
    model, process = random_arm(seed, joints), random_process(seed, axes)
    q, qd, qdd = states(model, seed)
    ours = evaluate_dynamics(model.with_process(process), q, qd, qdd, gravity=GRAVITY, about=ABOUT)
    other = twin(model)
    for k, (force, moment) in enumerate(zip(*in_base_axes(model, process, q), strict=True)):
        torque, wrench = dynamics(other, q[k], qd[k], qdd[k], GRAVITY, force, moment, ABOUT)
        theirs, mine = np.concatenate([torque, wrench]), np.concatenate([ours.torque[k], ours.wrench[k]])
        assert np.abs(mine - theirs).max() < 1e-10 * np.abs(theirs).max()


@pytest.mark.parametrize("axes", AXES)
def test_it_adds_the_transposed_jacobian_times_it_at_any_speed(axes):
    robot = experiment_task("B").robot
    process = random_process(3, axes)
    q, qd, qdd = states(robot.arm, 4)
    with_it = robot.varied(arm=robot.arm.with_process(process))
    (torque, wrench), (bare, own) = with_it.loads(q, qd, qdd), robot.loads(q, qd, qdd)
    force, moment = in_base_axes(robot.arm, process, q)
    J = jacobian(robot.arm, q)
    added = np.einsum("kij,ki->kj", J, np.hstack([force, moment]))
    np.testing.assert_allclose(torque - bare, -added, atol=1e-11)
    np.testing.assert_allclose((wrench - own)[:, :3], force, atol=1e-11)
    lever = robot.tool(q) - robot.support.center_of_mass
    np.testing.assert_allclose((wrench - own)[:, 3:], moment + np.cross(lever, force), atol=1e-11)


def test_brakes_feel_it():
    model = random_arm(5, 4)
    process = random_process(6, "tool")
    q, qd, _ = states(model, 7)
    parts = [terms(one, q, qd, GRAVITY, ABOUT) for one in (model.with_process(process), model)]
    force, moment = in_base_axes(model, process, q)
    added = np.einsum("kij,ki->kj", jacobian(model, q), np.hstack([force, moment]))
    np.testing.assert_allclose(parts[0].bias - parts[1].bias, -added, atol=1e-11)
    np.testing.assert_array_equal(parts[0].inertia, parts[1].inertia)
    np.testing.assert_allclose((parts[0].rest - parts[1].rest)[:, :3], force, atol=1e-11)


def test_another_base_frame_sees_the_same_forces():
    model, turn = random_arm(8, 5), Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix()
    q, qd, qdd = states(model, 9)
    for axes in AXES:
        own = model.with_process(random_process(10, axes))
        moved = evaluate_dynamics(own.mounted([0.1, 0.2, 0.3], turn), q, qd, qdd, gravity=turn @ GRAVITY)
        np.testing.assert_allclose(
            moved.torque, evaluate_dynamics(own, q, qd, qdd, gravity=GRAVITY).torque, atol=1e-10
        )


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"force": [1.0, 2.0]}, "force: expected"),
        ({"moment": [np.nan, 0, 0]}, "moment"),
        ({"axes": "world axes"}, "axes: expected one of tool, base, world, got 'world axes'"),
    ],
)
def test_what_cannot_be_is_refused(arguments, complaint):
    with pytest.raises(InputError, match=complaint):
        ProcessWrench(**arguments)
