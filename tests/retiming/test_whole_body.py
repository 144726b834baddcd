"""Timing of paths of base and arm together: loads by Pinocchio, friction by hand, contacts that are kept."""

import dataclasses
import json

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline

import ocptip
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.retiming.fastest import Grid, spaced
from ocptip.retiming.late import LateJoints
from ocptip.retiming.retime import retime
from ocptip.retiming.rows import Places, TimingLimits
from ocptip.retiming.whole_body import BaseLimits, able_to_drive
from ocptip.robots.motors import DCMotors
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from ocptip.trajectories.path import JointPath
from tests.places import EXAMPLES
from tests.retiming.paths import arm_of, random_path
from tests.standing.test_base_motion import FEET, G, carried, feet, on_free_flyer

BASE = BaseLimits(speed=1.2, turning=1.5, acceleration=2.5, turning_acceleration=4.0)
NODES = 60
TASK = EXAMPLES / "tasks" / "ur5_cart.toml"


@pytest.fixture(scope="module")
def task():
    return load_task(TASK, NONE)


def with_base(arm: JointPath, seed: int) -> JointPath:
    """A path with a base that drives a random curve of about 2 m and turns by about 1 rad."""
    rng, ends = np.random.default_rng(seed), np.linspace(0, 1, 5)
    poses = ends[:, None] * [2.0, 0.5, 1.0] + np.vstack([np.zeros(3), 0.15 * rng.normal(size=(4, 3))])
    return JointPath(ends, np.concatenate([CubicSpline(ends, poses).c, arm.coefficients], axis=2))


def course_states(path: JointPath, s: np.ndarray, u: np.ndarray, x: np.ndarray):
    """Positions, speeds and accelerations (P, 3 + n)."""
    q, dq, ddq = path.at(s)
    return q, dq * np.sqrt(x)[:, None], dq * u[:, None] + ddq * x[:, None]


def test_loads_along_the_path_are_those_of_a_root_that_moves(task):
    rng, robot = np.random.default_rng(3), able_to_drive(arm_of(task.robot))
    path, s = with_base(random_path(task, 3), 3), np.array([0.13, 0.4, 0.77])
    u, x = rng.normal(size=3), rng.uniform(0.2, 2.0, 3)
    at = Places.of(robot, path, s, np.zeros(3, dtype=bool)).instants(u, x)
    model = on_free_flyer(robot)
    data = model.createData()
    for k, (q, v, a) in enumerate(zip(*course_states(path, s, u, x), strict=True)):
        turn = pin.rpy.rpyToMatrix(0, 0, q[2])
        root = np.r_[q[:2], 0, pin.Quaternion(turn).coeffs()]
        linear, w = turn.T @ np.r_[v[:2], 0], np.array([0, 0, v[2]])
        spatial = turn.T @ np.r_[a[:2], 0] - np.cross(w, linear)
        moving, needed = np.r_[linear, w, v[3:]], np.r_[spatial, 0, 0, a[2:]]
        found = pin.rnea(model, data, np.r_[root, q[3:]], moving, needed)
        moment = found[3:6] - np.cross(robot.support.center_of_mass, found[:3])
        np.testing.assert_allclose(-at.wrenches[k], np.r_[found[:3], moment], atol=1e-8)
        np.testing.assert_allclose(at.torques[k], found[6:], atol=1e-8)


def test_slopes_along_the_path_are_differences(task):
    robot, path = able_to_drive(arm_of(task.robot)), with_base(random_path(task, 3), 3)
    places = Places.of(robot, path, np.array([0.2, 0.6]), np.zeros(2, dtype=bool))
    u, x, h = np.array([0.4, -0.3]), np.array([0.8, 1.3]), 1e-6
    slopes = places.slopes(places.instants(u, x), u, x)
    for k, (du, dx) in enumerate(((h, 0), (0, h))):
        ahead, behind = (places.instants(u + sign * du, x + sign * dx) for sign in (1, -1))
        np.testing.assert_allclose(slopes.s_x[..., k], (ahead.s - behind.s) / (2 * h), atol=1e-7)


def test_a_block_drives_as_fast_as_friction_allows():
    """It accelerates and brakes with 0.9 mu g: 2 sqrt(way / (0.9 mu g)) from rest to rest."""
    robot = carried(Support(feet(FEET, 0.4), mass=20.0, center_of_mass=[0, 0, 0.05]))
    strong = dataclasses.replace(robot.arm.limits, torque=np.array([50.0]), speed=np.array([2.0]))
    arm = dataclasses.replace(robot.arm, limits=strong)
    robot = robot.varied(arm=arm, motors=DCMotors.estimated(arm))
    path = JointPath(np.array([0.0, 1.0]), np.array([[[1.5, 0, 0, 0]], [[0, 0, 0, 0.3]]]))
    found = retime(robot, path, Limits(GN=0.95, GT=0.9), nodes=NODES, base=BaseLimits())
    assert found.check.verified
    shortest = 2 * np.sqrt(1.5 / (0.9 * 0.4 * G))
    assert shortest <= found.motion.end < 1.015 * shortest  # half spaces of friction are inside the cone
    force = 0.5 * 0.9 * 0.4 * G * robot.mass  # half of it: drives that are weaker than the friction
    weak = retime(robot, path, Limits(GN=0.95), nodes=NODES, base=BaseLimits(force=force))
    assert weak.motion.end == pytest.approx(np.sqrt(2) * shortest, rel=1e-3)
    assert set(weak.active) == {"base force"}


@pytest.mark.slow
def test_contacts_are_kept_that_a_timing_without_them_loses(task):
    path = with_base(random_path(task, 1, 0.1), 1)
    found = retime(task.robot, path, task.limits, nodes=NODES, base=BASE)
    assert found.check.verified
    robot = arm_of(found.robot)
    assert robot.drive_profile is not None
    speeds = robot.drive_profile.velocities.peaks(0)
    assert np.hypot(*speeds[:2]) <= 1.001 * np.sqrt(2) * BASE.speed
    assert speeds[2] <= 1.001 * BASE.turning
    assert robot.drive_profile.end == pytest.approx(found.motion.end)
    support = task.robot.support
    wide = [dataclasses.replace(own, position=5 * own.position, friction=10) for own in support.contacts]
    blind = retime(
        arm_of(task.robot).varied(support=support.varied(wide)), path, task.limits, nodes=NODES, base=BASE
    )
    assert blind.motion.end < found.motion.end
    profile = arm_of(blind.robot).drive_profile
    assert not check_motion(arm_of(task.robot).driving(profile), blind.motion, task.limits).stands


WAYPOINTS = """
[[waypoint]]
at_deg = [-60, -90, 90, -90, -90, 0]
base = [0, 0, 0]
[[waypoint]]
at_deg = [0, -80, 80, -90, -90, 0]
base = [0.6, 0.1, 20]
[[waypoint]]
at_deg = [40, -90, 90, -90, -90, 0]
base = [1.2, 0.4, 40]
"""


@pytest.mark.slow
def test_waypoints_of_base_and_arm_from_the_command_line(tmp_path, capsys):
    path, out = tmp_path / "path.toml", str(tmp_path / "plan")
    path.write_text(WAYPOINTS, encoding="utf-8")
    limits = ["--base-limits", "1 m/s, 2 m/s^2, 90 deg/s"]
    options = ["retime", str(path), "--task", str(TASK), "--tolerance", "none", "--no-figures", "--out", out]
    assert main([*options, *limits]) == 0
    assert "the base drives" in capsys.readouterr().out
    drive = np.loadtxt(tmp_path / "plan" / "task" / "drive.csv", delimiter=",", skiprows=1)
    turn = np.append(0, np.cumsum(np.diff(drive[:, 0]) * 0.5 * (drive[1:, 3] + drive[:-1, 3])))
    ahead = drive[:, 1:3] * np.cos(turn)[:, None] + drive[:, 2:0:-1] * [-1, 1] * np.sin(turn)[:, None]
    steps = 0.5 * np.diff(drive[:, 0])[:, None] * (ahead[1:] + ahead[:-1])
    np.testing.assert_allclose([*steps.sum(axis=0), turn[-1]], [1.2, 0.4, np.deg2rad(40)], atol=1e-3)
    assert main(["check", out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stands"]


def test_waypoints_have_the_base_in_front(task, tmp_path):
    (tmp_path / "path.toml").write_text(WAYPOINTS, encoding="utf-8")
    path = load_path(tmp_path / "path.toml", task).paths[0].path
    np.testing.assert_allclose(path.start[:4], [0, 0, 0, np.deg2rad(-60)], atol=1e-9)
    np.testing.assert_allclose(path.goal[:4], [1.2, 0.4, *np.deg2rad([40, 40])], atol=1e-9)
    with pytest.raises(InputError, match="give limits of the base"):
        ocptip.retime(task, tmp_path / "path.toml")
    (tmp_path / "some.toml").write_text(WAYPOINTS.replace("base = [0.6, 0.1, 20]\n", ""), encoding="utf-8")
    with pytest.raises(InputError, match="of all waypoints or of none"):
        load_path(tmp_path / "some.toml", task)


@pytest.mark.slow
def test_samples_of_base_and_arm_have_columns_of_both(task, tmp_path):
    t = np.linspace(0, 2, 81)
    share = (1 - np.cos(np.pi * t / 2)) / 2
    joints = task.start + share[:, None] * (task.goal - task.start)
    rows = np.column_stack([t, 0.8 * share, 0.1 * share, 0.3 * share, joints])
    header = ",".join(["time", "x", "y", "yaw", *task.robot.names])
    np.savetxt(tmp_path / "both.csv", rows, delimiter=",", header=header, comments="")
    fit = load_path(tmp_path / "both.csv", task, unit="rad", with_base=True).paths[0]
    np.testing.assert_allclose(fit.path.start, [0, 0, 0, *task.start], atol=1e-4)
    np.testing.assert_allclose(fit.path.goal, [0.8, 0.1, 0.3, *task.goal], atol=1e-4)
    assert fit.some(slice(3, None)).path.joints == task.robot.n


def test_limits_of_bases_are_read_with_their_units():
    assert BaseLimits.of("0.8 m/s, 1 m/s^2, 90 deg/s, 300 N") == BaseLimits(
        speed=0.8, acceleration=1.0, turning=np.pi / 2, force=300.0
    )
    for words in ("1 m/s, 2 m/s", "1 km/h", "", "1.2.3 m/s"):
        with pytest.raises(InputError, match="base_limits"):
            BaseLimits.of(words)


def test_what_is_no_path_of_base_and_arm_is_refused(task):
    arm = random_path(task, 1, 0.1)
    with pytest.raises(InputError, match=r"6 columns, the .* has 6 joints and x, y, yaw"):
        retime(task.robot, arm, base=BASE)
    with pytest.raises(InputError, match="jerk"):
        retime(task.robot, with_base(arm, 1), base=BASE, jerk=100.0)
    still = JointPath(np.array([0.0, 1.0]), np.array([[[0.0] * 9], [[0.0] * 9]]))
    with pytest.raises(InputError, match="does not move"):
        retime(task.robot, still, base=BASE)
    assert isinstance(task.robot, Robot)


@pytest.mark.slow
def test_rows_within_an_uncertainty_know_the_base(task):
    own, path = load_task(TASK, Uncertainty(tilt=0.005, damping=0.3)), with_base(random_path(task, 1, 0.1), 1)
    robot = able_to_drive(arm_of(own.robot))
    limits = TimingLimits(robot, own.limits, BaseLimits())
    grid = Grid(robot, path, limits, spaced(path, 12))
    late, rng = LateJoints(grid), np.random.default_rng(0)
    x = np.minimum(1.0, 12 * np.minimum(grid.s, 1 - grid.s)) * rng.uniform(0.8, 1.2, len(grid.s))
    excess, rows = late.broken(x)
    assert excess > 0
    change = 1e-6 * x * rng.normal(size=len(x))
    worst = int(np.argmax(rows.A @ x - rows.b))
    found = late.broken(x + change)[0] - excess
    assert found == pytest.approx((rows.A @ change)[worst], rel=1e-3)
