"""Timing of paths while the base drives: loads on a base that turns, and timings that keep all limits."""

import dataclasses
import json

import numpy as np
import pytest

import ocptip
from ocptip.api.inputs.given import driving
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.motion.check import check_motion
from ocptip.motion.files.source import source_of
from ocptip.motion.objective import TIME
from ocptip.retiming import while_driving
from ocptip.retiming.fastest import Grid, spaced
from ocptip.retiming.late import LateJoints
from ocptip.retiming.retime import least_cost, retime
from ocptip.retiming.rows import PathClock, TimingLimits
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.instants import Instants
from ocptip.standing.stops.along_path import affine_loads
from ocptip.standing.tolerance import Uncertainty
from ocptip.trajectories.drive_profile import DriveProfile, load_drive_profile
from ocptip.trajectories.path import PathTiming
from tests.places import EXAMPLES
from tests.retiming.paths import arm_of, random_path

TASK = EXAMPLES / "tasks" / "ur5_cart.toml"
BRAKES = DriveProfile.of_velocities(  # in a curve
    np.array([0, 0.4, 0.9, 1.2]), np.array([[0.9, 0, 0.9], [0.9, 0, 0.9], [0, 0, 0], [0, 0, 0]])
)
NODES = 60


@pytest.fixture(scope="module")
def task():
    return ocptip.load_task(TASK, uncertainty="none", objective="time")


@pytest.mark.slow
def test_a_timing_says_when_it_passes_places(task):
    path = random_path(task, 1)
    s = np.array([0.0, 0.1, 0.25, 0.4, 0.5, 0.75, 1.0])
    timing = PathTiming(path, s, np.array([0.0, 0.5, 0.9, 0.2, 0.6, 0.7, 0.0]))
    times, rates = timing.passes(s)
    np.testing.assert_allclose(times, timing.node_times, atol=1e-12)
    np.testing.assert_allclose(rates, np.sqrt(timing.x), atol=1e-12)
    places = np.linspace(0, 1, 60)[1:-1]
    motion = ocptip.Trajectory(timing=timing)
    np.testing.assert_allclose(motion.states(timing.passes(places)[0])[0], path.at(places)[0], atol=1e-10)


def test_loads_on_a_turning_base_are_those_of_its_motion_at_the_pace_of_the_tangent(task):
    rng, robot = np.random.default_rng(2), task.robot.driving(BRAKES)
    q, dq, ddq = rng.normal(size=(3, 5, 6))
    acting, pace = rng.normal(size=(5, 9)), rng.uniform(0.2, 2.0, 5)
    u, x = rng.normal(size=5), pace**2
    exact = robot.loads(q, dq * pace[:, None], dq * u[:, None] + ddq * x[:, None], acting)
    found = affine_loads(robot, q, dq, ddq, acting, pace)
    for own, (of_u, of_x, rest) in zip(exact, found, strict=True):
        np.testing.assert_allclose(of_u * u[:, None] + of_x * x[:, None] + rest, own, atol=1e-9)
    slower = robot.loads(q, 0.9 * dq * pace[:, None], dq * u[:, None] + 0.81 * ddq * x[:, None], acting)[1]
    of_u, of_x, rest = found[1]
    off = np.abs(of_u * u[:, None] + 0.81 * of_x * x[:, None] + rest - slower).max()
    assert 0 < off < 0.01 * np.abs(of_x * x[:, None]).max()  # a tangent: wrong only by the square of the step


def test_a_path_timed_while_the_base_brakes_stands_where_the_timing_at_rest_tips(task):
    path, robot = random_path(task, 1, 0.1), task.robot.driving(BRAKES)
    resting = retime(task.robot, path, task.limits, nodes=NODES)
    assert resting.check.verified
    assert not check_motion(robot, resting.motion, task.limits).stands
    found = retime(robot, path, task.limits, nodes=NODES)
    assert found.check.verified
    assert found.motion.end < 1.5 * resting.motion.end
    assert max(found.check.worst["GN"].value, found.check.worst["GT"].value) > 0.87  # as fast as it may
    assert least_cost(robot, path, task.limits, TIME, NODES) == pytest.approx(found.motion.end, rel=0.02)


@pytest.mark.slow
def test_where_no_clock_settles_limits_hold_whenever_a_place_is_passed(task, monkeypatch):
    monkeypatch.setattr(while_driving, "_ROUNDS", 0)
    knots, speeds = BRAKES.velocities.breaks, 0.3 * np.array([[1, 0, 1], [1, 0, 1], [0, 0, 0], [0, 0, 0]])
    path = random_path(task, 1, 0.1)
    found = retime(
        task.robot.driving(DriveProfile.of_velocities(knots, speeds)), path, task.limits, nodes=NODES
    )
    assert found.check.verified
    later = DriveProfile.of_velocities(np.append(0, 0.3 + knots), np.vstack([speeds[:1], speeds]))
    assert check_motion(task.robot.driving(later), found.motion, task.limits).verified


def test_a_base_that_tips_by_itself_is_told_with_place_and_time(task):
    hard = DriveProfile.of_velocities(
        np.array([0, 0.1, 0.4]), np.array([[3.0, 0, 0], [3.0, 0, 0], [0, 0, 0]])
    )
    with pytest.raises(InputError, match=r"at s = 0\.\d+, passed at 0\.\d+ s, .*: .*, or drive more gently"):
        retime(task.robot.driving(hard), random_path(task, 1, 0.1), task.limits, nodes=NODES)


def test_some_instants_keep_the_motion_of_the_base(task):
    q = np.tile(task.start, (3, 1))
    motion = BaseMotion(np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]]), (0.0, 0.0, 0.5))
    found = Instants.of_states(task.robot, q, 0 * q, 0 * q, base_motion=motion).some(np.array([2, 0]))
    assert found.base_motion is not None
    np.testing.assert_array_equal(found.base_motion.rows(2)[:, [0, 5]], [[3.0, 0.5], [1.0, 0.5]])


def test_sensitivities_of_a_driving_base_are_refused(task):
    driven = task.each(lambda own: dataclasses.replace(own, robot=own.robot.driving(BRAKES)))
    with pytest.raises(InputError, match="sensitivities: not for a base that drives"):
        ocptip.plan(driven, sensitivities=True)


def test_the_source_of_a_driven_task_holds_the_profile(task, tmp_path):
    driven = driving(task, "40 deg, 60 deg/s, 90 deg/s^2").segments[0].task
    source = source_of(driven)
    assert source is not None
    for name, content in source.files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (tmp_path / "task.toml").write_text(source.text("driven", driven.limits, TIME), encoding="utf-8")
    again = ocptip.load_task(tmp_path / "task.toml").robot
    t = np.linspace(0.01, 1.3, 40)
    np.testing.assert_allclose(again.acting(t), driven.robot.acting(t), atol=1e-9)


@pytest.mark.slow
def test_the_folder_of_a_timed_path_holds_the_profile(task, tmp_path, capsys):
    sweep = EXAMPLES / "paths" / "ur5_sweep.json"
    options = ["retime", str(sweep), "--task", str(TASK), "--tolerance", "none", "--no-figures"]
    out = str(tmp_path / "plan")
    assert main([*options, "--drive-profile", "0.3 m, 0.5 m/s, 0.8 m/s^2", "--out", out]) == 0
    assert "PROVED" in capsys.readouterr().out
    assert main(["check", out, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert any("while the base drives" in text for text in again["assumed"])
    assert main(["retime", str(sweep), "--case", "A", "--drive-profile", "0.3 m, x m/s, 1 m/s^2"]) == 2


@pytest.mark.parametrize("profile", [load_drive_profile("40 deg, 60 deg/s, 90 deg/s^2"), BRAKES])
def test_profiles_are_read_as_they_are_written(profile, tmp_path):
    (tmp_path / "drive.csv").write_text(profile.to_csv())
    t = np.linspace(0.013, profile.end - 0.013, 50)
    np.testing.assert_allclose(load_drive_profile(tmp_path / "drive.csv").rows(t), profile.rows(t), atol=1e-9)


def test_accelerations_of_a_turn_step_at_its_knots_alone():
    profile = load_drive_profile("40 deg, 60 deg/s, 90 deg/s^2")
    t = np.linspace(1e-6, profile.end - 1e-6, 400)
    rate = np.where(t < 0.5 * profile.end, 1, -1) * np.pi / 2
    np.testing.assert_allclose(profile.rows(t)[:, 8], rate, atol=1e-9)


@pytest.mark.slow
def test_rows_within_an_uncertainty_know_steps_of_the_profile(task):
    own = ocptip.load_task(TASK, uncertainty=Uncertainty(damping=0.3))
    profile = DriveProfile.of_velocities(np.array([0, 0.4, 0.6]), np.array([[0.6, 0, 0]] * 2 + [[0, 0, 0]]))
    robot, path = arm_of(own.robot).driving(profile), random_path(task, 1, 0.01)
    s = spaced(path, 12)
    slow = np.where((s == 0) | (s == 1), 0, 0.05)
    clock = PathClock(PathTiming(path, s, slow))
    late = LateJoints(Grid(robot, path, TimingLimits(robot, own.limits), s, clocks=[clock]))
    calm = dataclasses.replace(own.limits, tolerance=Uncertainty(delay=1e-3))
    without = LateJoints(Grid(robot, path, TimingLimits(robot, calm), s, clocks=[clock]))
    assert late.broken(slow)[0] > without.broken(slow)[0] + 1e-3


@pytest.mark.slow
def test_within_an_uncertainty(task):
    own, path = ocptip.load_task(TASK, uncertainty="workshop", objective="time"), random_path(task, 1, 0.1)
    knots, speeds = BRAKES.velocities.breaks, 0.6 * np.array([[1, 0, 1], [1, 0, 1], [0, 0, 0], [0, 0, 0]])
    profile = DriveProfile.of_velocities(knots, speeds)
    robot = arm_of(own.robot).driving(profile)
    found = retime(robot, path, own.limits, nodes=30)
    assert found.check.verified
    plain = retime(arm_of(task.robot).driving(profile), path, task.limits, nodes=30)
    assert found.motion.end > plain.motion.end
    assert not check_motion(robot, plain.motion, own.limits).verified
