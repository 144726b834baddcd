"""Columns of motion.csv of a robot from a URDF: Pinocchio's reading of the file, the motors' law by hand."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from ocptip.motion.check import check_motion
from ocptip.motion.files.output import csv_blocks, sample_motion
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.common import EXAMPLES

STANDBY, REGENERATION = 5.0, 0.0


@pytest.fixture(scope="module")
def swing():
    """The task, a motion of all joints, its samples, and their columns."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    ways = np.array([-1.2, 0.3, -0.4, 0.5, 0.6, -0.7])
    ramps = zip(task.start + ways, np.abs(ways), 5 * np.abs(ways), strict=True)
    motion = Trajectory.from_profiles(task.start, [[RampCommand(*ramp)] for ramp in ramps])
    samples = sample_motion(task.robot, motion, 0.002)
    return task, motion, samples, dict(csv_blocks(samples))


@pytest.fixture(scope="module")
def ur5():
    return pin.buildModelFromUrdf(str(EXAMPLES / "tasks" / "ur5.urdf"))


def test_the_gripper_is_where_pinocchio_has_the_urdfs_tool(swing, ur5):
    task, _, samples, columns = swing
    data, tool = ur5.createData(), ur5.getFrameId("tool0")
    mount = pin.SE3(task.robot.arm.mount_rotation, np.array([0.0, 0.0, 0.75]))
    assert list(ur5.names)[1:] == list(task.robot.arm.joint_names)
    base = ur5.getFrameId("base_link")
    for k in range(0, len(samples.times), 40):
        pin.framesForwardKinematics(ur5, data, samples.angles[k])
        found = mount * data.oMf[base].actInv(data.oMf[tool])
        own = [columns[f"gripper_{name}"][k] for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")]
        np.testing.assert_allclose(own[:3], found.translation, atol=1e-12)
        np.testing.assert_allclose(Rotation.from_quat(own[3:]).as_matrix(), found.rotation, atol=1e-12)


def test_total_power_is_that_of_pinocchios_torques_and_its_integral_the_energy(swing, ur5):
    task, motion, samples, columns = swing
    data, motors = ur5.createData(), task.robot.motors
    ur5.armature = task.robot.arm.armature.copy()
    states = samples.angles, samples.speeds, samples.accelerations
    torques = np.array([pin.rnea(ur5, data, *state) for state in zip(*states, strict=True)])
    drive = torques + motors.coulomb * np.sign(samples.speeds) + motors.viscous * samples.speeds
    drawn = (drive / motors.motor_constant) ** 2 + drive * samples.speeds
    power = (STANDBY + np.where(drawn > 0, drawn, REGENERATION * drawn)).sum(axis=1)
    inside = np.all(np.abs(samples.speeds) > 1e-6, axis=1)  # at rest friction has the sign of what follows
    assert np.mean(inside) > 0.9
    np.testing.assert_allclose(columns["total_power_W"][inside], power[inside], rtol=1e-9)
    energy = np.trapezoid(columns["total_power_W"], columns["time_s"])
    assert energy == pytest.approx(check_motion(task.robot, motion, task.limits).energy, rel=1e-4)
