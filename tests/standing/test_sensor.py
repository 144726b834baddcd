"""What a force-torque sensor in the base measures, against statics by hand and Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.motion.files.output import sample_motion, write_motion_csv
from ocptip.published.tasks import experiment_task
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.sensor import WrenchSensor
from ocptip.task_files.motion import load_task
from tests.robots.pinocchio_twin import dynamics, twin


def test_between_arm_and_base_it_measures_the_arm_and_the_adapter():
    """At the mount, in base axes, without an adapter: what Pinocchio says of the first joint."""
    task = experiment_task("B")
    robot, motion = task.robot, task.reference
    samples = robot.samples(motion, np.linspace(0.01, motion.end - 0.01, 7))
    other, none, about = twin(robot.arm), np.zeros(3), robot.arm.mount_position
    states = zip(samples.angles, samples.speeds, samples.accelerations, strict=True)
    for read, state in zip(samples.sensor, states, strict=True):
        _, wrench = dynamics(other, *state, robot.support.gravity, none, none, about)
        np.testing.assert_allclose(read, wrench, rtol=1e-9, atol=1e-9)


def test_axes_place_and_adapter():
    robot = experiment_task("A").robot
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 1.0]).as_matrix()
    place, centre = np.array([0.05, -0.1, 0.2]), np.array([0.1, 0.0, 0.3])
    plain = robot.sensor.reads(robot.support, wrenches := np.random.default_rng(1).normal(size=(5, 6)))
    sensor = WrenchSensor(place, "kms", turn, 0.164, centre)
    read = sensor.reads(robot.support, wrenches)
    weight = 0.164 * robot.support.gravity
    force = plain[:, :3] + weight
    moment = plain[:, 3:] + np.cross(robot.sensor.position - place, plain[:, :3])
    moment += np.cross(centre - place, weight)
    np.testing.assert_allclose(read[:, :3] @ turn.T, force, atol=1e-12)
    np.testing.assert_allclose(read[:, 3:] @ turn.T, moment, atol=1e-12)


def test_a_force_plate_under_the_feet_carries_all():
    robot = experiment_task("A").robot
    base = robot.support
    plate = robot.varied(
        sensor=WrenchSensor(np.zeros(3), "plate", mass=base.mass, center_of_mass=base.center_of_mass)
    )
    samples = plate.samples(experiment_task("A").reference, np.array([0.1, 0.3]))
    forces = np.einsum("kij,nkj->nki", base.frames, samples.states.contact_forces)
    places = np.array([contact.position for contact in base.contacts])
    np.testing.assert_allclose(samples.sensor[:, :3], -forces.sum(axis=1), atol=1e-8)
    np.testing.assert_allclose(samples.sensor[:, 3:], -np.cross(places, forces).sum(axis=1), atol=1e-8)


def test_a_file_names_its_sensor(tmp_path):
    path = tmp_path / "task.toml"
    path.write_text('case = "A"\n[sensor]\nname = "kms"\nposition = [0, 0, -0.02]\nrpy_deg = [180, 0, 0]\n')
    task = load_task(path)
    samples = sample_motion(task.robot, task.reference, 0.05)
    write_motion_csv(tmp_path / "motion.csv", samples)
    header, first, *_ = (tmp_path / "motion.csv").read_text().splitlines()
    row = dict(zip(header.split(","), map(float, first.split(",")), strict=True))
    arm = task.robot.mass - task.robot.support.mass
    assert samples.sensor[0, 2] == pytest.approx(row["kms_fz_N"], rel=1e-14)
    at_rest = task.robot.samples_of([0.0], [task.start], np.zeros((1, 6)), np.zeros((1, 6)))
    assert at_rest.sensor[0, 2] == pytest.approx(9.81 * (arm + 0.164), rel=1e-9)  # adapter of (6.13)
    assert task.source is not None
    assert "kms" in task.source.text("A", task.limits, task.objective)


def test_the_adapter_of_a_case_may_be_another(tmp_path):
    path = tmp_path / "task.toml"
    for line, mass in (("", 0.164), ("mass = 0", 0.0), ("mass = 0.5", 0.5)):
        path.write_text(f'case = "A"\n[sensor]\n{line}\n')
        assert load_task(path).robot.sensor.mass == pytest.approx(mass)
    assert experiment_task("A").robot.sensor.mass == 0.0  # where the arm is mounted, above the adapter


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ('name = "my sensor"', "sensor.name: expected letters, digits and underscores, got 'my sensor'"),
        ("mass = -1", "sensor.mass: must be >= 0, got -1"),
        ("place = [0, 0, 0]", "sensor.place: unknown key"),
        ("position = [0, 0]", "sensor.position: expected 3 numbers, got 2"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, line, complaint):
    path = tmp_path / "task.toml"
    path.write_text(f'case = "A"\n[sensor]\n{line}\n')
    with pytest.raises(InputError) as error:
        load_task(path)
    assert str(error.value).startswith(f"task.toml: {complaint}")


def test_gripper_poses_do_not_jump(tmp_path):
    task = experiment_task("E")
    samples = sample_motion(task.robot, task.reference)
    write_motion_csv(tmp_path / "motion.csv", samples)
    lines = (tmp_path / "motion.csv").read_text().splitlines()
    names, rows = lines[0].split(","), np.array([line.split(",") for line in lines[1:]], dtype=float)
    poses = rows[:, [names.index(f"gripper_{n}") for n in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")]]
    position, rotation = gripper_pose(task.robot.arm, samples.angles)
    np.testing.assert_allclose(poses[:, :3], position, atol=1e-12)
    np.testing.assert_allclose(Rotation.from_quat(poses[:, 3:]).as_matrix(), rotation, atol=1e-12)
    assert np.abs(np.diff(poses[:, 3:], axis=0)).max() < 0.1
    total = rows[:, names.index("total_power_W")]
    np.testing.assert_allclose(total, rows[:, [names.index(f"power{j}_W") for j in range(1, 7)]].sum(axis=1))
