"""Files of a plan: their content, that they are read back, and that none is ever half written."""

from __future__ import annotations

import csv
import json
import os
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions
from ocptip.motion.files.output import joint_trajectory, plan_to_dict, sample_motion, write_motion_csv
from ocptip.motion.files.plan_files import write_plan
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import stand_in_plan

PER_JOINT = ("q{}_deg", "qd{}_deg_s", "qdd{}_deg_s2", "tau{}_Nm", "power{}_W")


def strict(text):
    """JSON without NaN and Infinity."""

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    return json.loads(text, parse_constant=refuse)


def table(path):
    """Columns of a CSV file by name."""
    with open(path, newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


@pytest.fixture
def plan():
    return stand_in_plan()


def test_plan_has_the_promised_keys(plan):
    data = strict(json.dumps(plan_to_dict(plan), allow_nan=False))
    checked = plan.check
    assert data["case"] == "C"
    assert (data["energy_J"], data["duration_s"]) == (checked.energy, checked.duration)
    assert data["verified"] is True
    assert data["violations"] == []
    for name in ("GN", "GT", "torque_ratio", "clearance_m"):
        worst = checked.worst[name]
        expected = {"value": worst.value, "time": worst.time, "limit": worst.limit, "detail": worst.detail}
        assert data["worst"][name] == expected
    assert data["worst"]["speed_ratio"]["time"] is None  # NaN: holds for no single instant
    np.testing.assert_allclose(np.deg2rad(data["goal"]), plan.task.goal, atol=1e-12)
    assert [len(commands) for commands in data["commands"]] == [3, 3, 3, 1, 1, 1]
    assert set(data["commands"][0][0]) == {"phi_e", "speed", "acceleration"}
    first, second = data["starts"]
    assert (first["energy_J"], first["verified"], first["solves"]) == (checked.energy, True, 2)
    assert (second["energy_J"], second["status"]) == (None, "infeasible")
    assert (data["iterations"], data["seconds"], data["seed"]) == (43, 2.5, 3)
    assert data["interrupted"] is False
    assert data["options"]["limits"]["GN"] == 0.9
    assert "base" not in data
    assert set(data["versions"]) == set(versions())
    assert set(versions()) >= {"ocptip", "python", "casadi", "numpy", "scipy", "clarabel", "pin"}


def test_base_is_taken_from_the_options(plan):
    plan = SimpleNamespace(**{**vars(plan), "options": {"base": "effective"}})
    assert plan_to_dict(plan)["base"] == "effective"


def test_reference_is_compared():
    slower = stand_in_plan(factor=1.1)
    reference = plan_to_dict(slower)["reference"]
    assert reference["duration_s"] == pytest.approx(slower.duration / 1.1)
    assert reference["energy_J"] == pytest.approx(stand_in_plan().energy, rel=1e-12)
    assert reference["ratio"] == slower.energy / reference["energy_J"]
    assert plan_to_dict(stand_in_plan(reference=False))["reference"] is None


def test_plan_json_is_read_back_as_the_same_motion(plan, tmp_path):
    write_plan(tmp_path / "out", plan)
    motion = Trajectory.from_dict(strict((tmp_path / "out" / "plan.json").read_text(encoding="utf-8")))
    times = np.linspace(0, plan.motion.end, 200)
    for mine, original in zip(motion.states(times)[:2], plan.motion.states(times)[:2], strict=True):
        np.testing.assert_allclose(mine, original, atol=1e-12)
    np.testing.assert_allclose(motion.event_times, plan.motion.event_times, atol=1e-12)


def test_csv_header_names_units_and_rows_are_the_samples(plan, tmp_path):
    samples = sample_motion(plan.task.robot, plan.motion)
    write_motion_csv(tmp_path / "motion.csv", samples)
    columns = table(tmp_path / "motion.csv")
    names = [
        "time_s",
        *(name.format(j) for name in PER_JOINT for j in range(1, 7)),
        "GN",
        "GT",
        "clearance_m",
    ]
    names += [name.format(k) for name in ("normal{}_N", "friction_use{}") for k in (1, 2, 3)]
    names += ["total_power_W", *(f"gripper_{name}" for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"))]
    names += [f"sensor_{name}" for name in ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")]
    assert list(columns) == names
    for name, values in {
        "time_s": samples.times,
        "q2_deg": np.rad2deg(samples.angles[:, 1]),
        "qd6_deg_s": np.rad2deg(samples.speeds[:, 5]),
        "qdd1_deg_s2": np.rad2deg(samples.accelerations[:, 0]),
        "tau3_Nm": samples.torques[:, 2],
        "power1_W": samples.powers[:, 0],
        "GN": samples.tip.GN,
        "GT": samples.slip.GT,
        "clearance_m": samples.clearances,
        "normal3_N": samples.states.contact_forces[:, 2, 0],
        "friction_use1": samples.slip.usage[:, 0],
        "total_power_W": samples.powers.sum(axis=1),
        "sensor_my_Nm": samples.sensor[:, 4],
    }.items():
        np.testing.assert_allclose(columns[name], values, rtol=1e-11, atol=1e-12, err_msg=name)
    weight = -plan.task.robot.mass * plan.task.robot.support.gravity[2]
    assert sum(columns[f"normal{k}_N"][0] for k in (1, 2, 3)) == pytest.approx(weight, rel=0.05)


def test_samples_hold_both_sides_of_every_event_and_a_step_of_5_ms(plan):
    samples, events = sample_motion(plan.task.robot, plan.motion), plan.motion.event_times
    times = samples.times
    assert np.all(np.diff(times) >= 0)
    assert np.max(np.diff(times)) <= 0.0055 + 1e-12
    assert [int(np.sum(times == t)) for t in events] == [1, *[2] * (len(events) - 2), 1]
    for t in events[1:-1]:
        left, right = np.flatnonzero(times == t)
        np.testing.assert_array_equal(samples.angles[left], samples.angles[right])
        for row, moment in ((left, t - 1e-6), (right, t + 1e-6)):
            np.testing.assert_allclose(samples.accelerations[row], plan.motion.states(moment)[2])
    for t in (0.005, 0.5):
        assert t in np.round(times, 12)


def test_joints_that_end_together_up_to_rounding_brake_until_the_end():
    """Case A: their ends differ by 2e-16 s; at the last of them the others rest already."""
    plan = stand_in_plan("A")
    assert len({joint.end for joint in plan.motion.joints[3:]} | {plan.motion.end}) > 1
    samples = sample_motion(plan.task.robot, plan.motion)
    np.testing.assert_array_equal(samples.accelerations[-1], samples.accelerations[-2])
    assert samples.slip.GT[-1] == pytest.approx(samples.slip.GT[-2], rel=1e-3)


def test_power_of_the_samples_integrates_to_the_energy():
    for name in "AC":
        plan = stand_in_plan(name)
        samples = sample_motion(plan.task.robot, plan.motion)
        power = samples.powers.sum(axis=1)
        energy = np.sum(0.5 * np.diff(samples.times) * (power[1:] + power[:-1]))
        assert energy == pytest.approx(plan.energy, rel=1e-5)


def test_worst_values_of_the_check_are_seen_in_the_samples(plan):
    samples = sample_motion(plan.task.robot, plan.motion)
    assert np.max(samples.tip.GN) == pytest.approx(plan.check.worst["GN"].value, rel=1e-3)
    assert np.max(samples.slip.GT) == pytest.approx(plan.check.worst["GT"].value, rel=1e-3)


def test_a_motion_that_rests_is_one_sample(plan):
    rest = Trajectory.from_profiles(
        plan.task.start, [[RampCommand(phi, 1.0, 1.0)] for phi in plan.task.start]
    )
    samples = sample_motion(plan.task.robot, rest)
    assert samples.times.tolist() == [0.0]


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan")])
def test_step_must_be_positive(plan, step):
    with pytest.raises(InputError, match="step: must be"):
        sample_motion(plan.task.robot, plan.motion, step)


def test_trajectory_has_the_shape_of_the_ros_message(plan):
    points = controller_points(plan.motion, "cubic").points
    trajectory = strict(json.dumps(joint_trajectory(plan.task.robot, points), allow_nan=False))
    assert trajectory["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert trajectory["joint_names"] == list(plan.task.robot.arm.joint_names)
    points = trajectory["points"]
    stamps = [point["time_from_start"] for point in points]
    assert all(0 <= stamp["nanosec"] < 10**9 for stamp in stamps)
    nanoseconds = np.array([10**9 * stamp["sec"] + stamp["nanosec"] for stamp in stamps])
    assert np.all(np.diff(nanoseconds) > 0)
    assert nanoseconds[0] == 0
    assert nanoseconds[-1] == round(plan.motion.end * 1e9)
    events = np.round(plan.motion.event_times * 1e9).astype(int)
    assert set(events) <= set(nanoseconds)
    angles, speeds = (np.array([point[key] for point in points]) for key in ("positions", "velocities"))
    expected = plan.motion.states(nanoseconds * 1e-9)
    np.testing.assert_allclose(angles, expected[0], atol=1e-8)
    np.testing.assert_allclose(speeds, expected[1], atol=1e-7)
    assert all(point["accelerations"] == point["effort"] == [] for point in points)
    np.testing.assert_array_equal(speeds[[0, -1]], 0)


def test_write_plan_writes_files_with_extra_entries(plan, tmp_path):
    paths = write_plan(tmp_path / "out", plan, extra={"base": "effective", "worth": np.float64("nan")})
    names = ["plan.json", "motion.csv", "trajectory.json", "task/task.toml", "SHA256SUMS"]
    assert paths == [tmp_path / "out" / name for name in names]
    assert sorted(p for p in (tmp_path / "out").rglob("*") if p.is_file()) == sorted(paths)
    data = strict(paths[0].read_text(encoding="utf-8"))
    assert (data["base"], data["worth"]) == ("effective", None)
    points = controller_points(plan.motion, "cubic").points
    assert strict(paths[2].read_text(encoding="utf-8")) == joint_trajectory(plan.task.robot, points)
    assert paths[0].stat().st_mode & 0o044  # readable by others like any new file
    write_plan(tmp_path / "out", plan)  # replaces
    assert "worth" not in strict(paths[0].read_text(encoding="utf-8"))


def test_no_file_is_left_half_written(plan, tmp_path, monkeypatch):
    target = tmp_path / "plan.json"
    target.write_text("old")

    def full_disk(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full_disk)
        with pytest.raises(OSError, match="No space left on device") as caught:
            write_plan(tmp_path, plan)
    assert caught.value.filename == str(target)
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["plan.json"]


def test_errors_name_the_path(plan, tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        write_plan(tmp_path / "missing" / "out", plan)
    assert caught.value.filename == str(tmp_path / "missing" / "out")
    samples = sample_motion(plan.task.robot, plan.motion)
    target = tmp_path / "missing" / "motion.csv"
    with pytest.raises(FileNotFoundError) as caught:
        write_motion_csv(target, samples)
    assert caught.value.filename == str(target)
    (tmp_path / "file").write_text("")
    with pytest.raises(FileExistsError) as caught:
        write_plan(tmp_path / "file", plan)
    assert caught.value.filename == str(tmp_path / "file")
