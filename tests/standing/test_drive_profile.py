"""A base that drives while its arm moves: loads by Pinocchio, tipping by hand, deviations one by one."""

import dataclasses
import json

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest

import ocptip
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.contact.support import Support
from ocptip.pictures.plan_curves import PlanCurves, seen_plan
from ocptip.robots.motors import DCMotors
from ocptip.standing.objects import Object
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.in_motion import worst_within
from ocptip.standing.within.torques import maximum_torques
from ocptip.trajectories.drive_profile import DriveProfile, load_drive_profile
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES
from tests.standing.test_base_motion import FEET, G, carried, feet, on_free_flyer

TASK = EXAMPLES / "tasks" / "ur5_cart.toml"
END = 1.5  # s


@pytest.fixture(scope="module")
def task():
    return ocptip.load_task(TASK, uncertainty="none")


def arc(t):
    """A course along an arc, 0.8 m in radius: x, y, yaw with two derivatives, each (N, 3)."""
    s, v, a = (1 - np.cos(np.pi * t / END)), np.pi / END * np.sin(np.pi * t / END), None
    a = (np.pi / END) ** 2 * np.cos(np.pi * t / END)
    c, n = np.cos(s), np.sin(s)
    place = np.column_stack([0.8 * n, 0.8 * (1 - c), s])
    speed = np.column_stack([0.8 * c * v, 0.8 * n * v, v])
    bend = np.column_stack([0.8 * (c * a - n * v**2), 0.8 * (n * a + c * v**2), a])
    return place, speed, bend


@pytest.fixture(scope="module")
def profile():
    times = np.linspace(0, END, 151)
    return DriveProfile.of_course(Trajectory.from_points(times, *arc(times)))


def test_rows_are_those_of_the_course_in_base_axes(profile):
    t = np.linspace(0.0131, END - 0.0172, 40)
    place, speed, bend = arc(t)
    c, s = np.cos(place[:, 2]), np.sin(place[:, 2])
    rows = profile.rows(t)
    expected = c * bend[:, 0] + s * bend[:, 1], c * bend[:, 1] - s * bend[:, 0], speed[:, 2], bend[:, 2]
    np.testing.assert_allclose(rows[:, [0, 1, 5, 8]].T, expected, atol=2e-5)
    slower = profile.at_pace(2.0).rows(2 * t)
    np.testing.assert_allclose(slower * [4, 4, 4, 2, 2, 2, 4, 4, 4], rows, atol=1e-12)
    h = 1e-6
    differences = (profile.rows(t + h) - profile.rows(t - h)) / (2 * h)
    np.testing.assert_allclose(profile.rows(t, 1), differences, atol=1e-6)
    differences = (profile.rows(t + h, 1) - profile.rows(t - h, 1)) / (2 * h)
    np.testing.assert_allclose(profile.rows(t, 2), differences, atol=1e-6)


def test_velocities_go_straight_between_samples_and_stay_at_the_ends():
    own = DriveProfile.of_velocities(
        np.array([2.0, 3.0, 5.0]), np.array([[1, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    )
    rows = own.rows(np.array([-1.0, 0.5, 2.0, 9.0]))[:, [0, 1, 5, 8]]
    np.testing.assert_allclose(rows, [[0, 0.5, 0.5, 0], [-1, 0.25, 0.5, 0], [0, 0, 0.25, -0.25], [0] * 4])
    assert own.end == 3.0


def test_loads_of_arm_and_base_together_are_those_of_a_root_that_moves(task, profile):
    rng, robot = np.random.default_rng(4), task.robot.driving(profile)
    t, states = np.array([0.2, 0.7, 1.3]), rng.normal(size=(3, 3, 6))
    torques, wrenches = robot.loads(*states, robot.acting(t))
    place, speed, bend = arc(t)
    model = on_free_flyer(robot)
    data = model.createData()
    for k in range(3):
        turn = pin.SE3(pin.Quaternion(pin.rpy.rpyToMatrix(0, 0, place[k, 2])), np.r_[place[k, :2], 0])
        back = turn.rotation.T
        v, w = back @ np.r_[speed[k, :2], 0], np.array([0, 0, speed[k, 2]])
        a = back @ np.r_[bend[k, :2], 0] - np.cross(w, v)
        root, (q, qd, qdd) = pin.SE3ToXYZQUAT(turn), states[:, k]
        needed = pin.rnea(model, data, np.r_[root, q], np.r_[v, w, qd], np.r_[a, 0, 0, bend[k, 2], qdd])
        about = robot.support.center_of_mass
        moment = needed[3:6] - np.cross(about, needed[:3])
        np.testing.assert_allclose(-wrenches[k], np.r_[needed[:3], moment], atol=2e-3)
        np.testing.assert_allclose(torques[k], needed[6:], atol=2e-3)
    q, qd, qdd, acting = (cs.SX.sym(name, n) for name, n in (("q", 6), ("v", 6), ("a", 6), ("b", 9)))
    function = cs.Function("f", [q, qd, qdd, acting], list(robot.load_expressions(q, qd, qdd, acting)))
    found = function(*(values[0] for values in states), robot.acting(t)[0])
    np.testing.assert_allclose(found[0].full().ravel(), torques[0], atol=1e-9)
    np.testing.assert_allclose(found[1].full().ravel(), wrenches[0], atol=1e-9)


@pytest.mark.parametrize(("share", "stands"), [(0.999, True), (1.001, False)])
def test_a_block_tips_where_statics_say_while_it_brakes(share, stands):
    # A block whose centre is 0.5 m high, 0.3 m behind the front axle, tips at g 0.3 / 0.5.
    support = Support(feet(FEET), mass=20.0, center_of_mass=[0, 0, 0.5])
    robot = carried(support)
    limits = dataclasses.replace(robot.arm.limits, torque=np.array([50.0]), speed=np.array([2.0]))
    arm = dataclasses.replace(robot.arm, limits=limits)
    robot = robot.varied(arm=arm, motors=DCMotors.estimated(arm))
    brakes = share * G * 0.3 / 0.5
    motion = Trajectory.from_points(np.array([0.0, 0.3]), np.zeros((2, 1)))
    profile = DriveProfile.of_velocities(
        np.array([0, 0.2, 0.4]), np.array([[brakes * 0.2, 0, 0], [0] * 3, [0] * 3])
    )
    found = ocptip.motion.check.check_motion(robot.driving(profile), motion, ocptip.Limits(GN=1, GT=1))
    assert found.stands == stands
    assert found.contacts.moment.value == pytest.approx(21 * (G * 0.3 - brakes * 0.5), rel=1e-6)


@pytest.mark.parametrize(("share", "verdict"), [(0.24, True), (0.26, False)])
def test_a_box_on_the_deck_tips_where_statics_say(task, share, verdict):
    # 0.1 m wide and 0.4 m high, it tips at g 0.05 / 0.2.
    box = Object.box("crate", 1.0, (0.1, 0.2, 0.4), friction=2.0, on="base", position=(0, 0.5, 0.6))
    robot, brakes = task.robot.carrying([box]), share * G
    own = task.each(lambda one: dataclasses.replace(one, robot=robot))
    speeds = np.array([[0.3 * brakes, 0, 0], [0, 0, 0], [0, 0, 0]])
    profile = DriveProfile.of_velocities(np.array([0, 0.3, 0.4]), speeds)
    found = ocptip.check(own, "start", drive_profile=profile).check
    assert found.stands == verdict
    assert found.objects["crate"].moment.value == pytest.approx(G * 0.05 - brakes * 0.2, rel=1e-9)


@pytest.mark.slow
def test_what_comes_after_the_motion_of_the_arm_counts(task):
    still = Trajectory.from_points(np.array([0.0, 0.1]), np.tile(task.start, (2, 1)))
    late = DriveProfile.of_velocities(np.array([0, 1, 2.0]), np.array([[1, 0, 0], [1, 0, 0], [0, 0, 0]]))
    early = DriveProfile.of_velocities(np.array([0, 1.0]), np.array([[1, 0, 0], [0, 0, 0]]))
    found = [ocptip.check(task, still, drive_profile=own).check for own in (late, early)]
    assert found[0].worst["GT"].value == pytest.approx(found[1].worst["GT"].value, rel=1e-6)
    assert found[0].worst["GT"].time >= 1.0


def test_figures_show_the_base_that_drives_on(task):
    still = Trajectory.from_points(np.array([0.0, 0.1]), np.tile(task.start, (2, 1)))
    profile = DriveProfile.of_velocities(np.array([0, 0.3, 0.4]), np.array([[1, 0, 0], [1, 0, 0], [0, 0, 0]]))
    found = ocptip.check(task, still, drive_profile=profile)
    curves = PlanCurves.of(seen_plan(found.task, found.motion, found.checked))
    assert curves.times[-1] == pytest.approx(0.4, abs=1e-4)
    k = int(np.nanargmax(curves.samples.slip.GT))
    assert 0.3 <= curves.times[k] <= 0.4
    assert curves.samples.slip.GT[k] == pytest.approx(found.check.worst["GT"].value, rel=1e-3)


@pytest.mark.slow
def test_the_worst_pace_of_the_base_is_one_of_its_ends(task):
    robot, tolerance = task.robot, Uncertainty(drive_speed=0.1, damping=0.2)
    profile = DriveProfile.of_velocities(
        np.array([0, 0.5, 1]), np.array([[0, 0, 0], [0.9, 0, 0.6], [0.9, 0, 0.6]])
    )
    motion, times = (
        Trajectory.from_points(np.array([0.0, 1.0]), np.tile(task.start, (2, 1))),
        np.linspace(0, 1, 21),
    )
    driven = robot.driving(profile)
    found = worst_within(driven, motion, tolerance, times)
    still, more, moments = np.zeros((1, 6)), tolerance.overshoot, []
    for pace in (0.9, 1.0, 1.1):
        scales = np.array([pace**2] * 3 + [pace] * 3 + [pace**2] * 3)
        rows = profile.rows(np.linspace(0, 1, 201))
        before, after = (profile.rows(np.array([0, 0.5, 1]) + side) for side in (-1e-7, 1e-7))
        rows = np.vstack([rows, after + more * (after - before)])
        for row in rows * scales:
            motion_then = ocptip.BaseMotion(row[:3], row[3:6], row[6:])
            wrench = robot.loads(task.start[None], still, still, base_motion=motion_then)[1]
            slopes, offsets = robot.tip_over.affine_moments
            moments.append(np.min(wrench @ slopes.T + offsets))
    assert found.tip.value == pytest.approx(float(robot.tip_over.ratio(np.array(min(moments)))), rel=1e-9)
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 4, 6))
    rows = driven.acting(np.linspace(0.1, 0.9, 4))
    own = dataclasses.replace(tolerance, speed=0.05, arm_mass=0.0)
    most = maximum_torques(driven, own, q, qd, qdd, rows)
    for pace, rush in ((0.95, 1.1), (1.05, 0.9), (1.0, 1.0), (1.05, 1.1)):
        scaled = rows * np.array([rush**2] * 3 + [rush] * 3 + [rush**2] * 3)
        assert np.all(np.abs(driven.loads(q, pace * qd, pace**2 * qdd, scaled)[0]) <= most + 1e-9)


@pytest.mark.slow
def test_steps_of_base_and_joints_that_meet_overshoot_together(task):
    robot, tolerance, rate = task.robot, Uncertainty(damping=0.2), 0.8
    goal = task.start + 0.2
    motion = Trajectory.ending_together(task.start, goal, [None] * 6, np.full(6, 0.4), np.full(6, rate))
    still, more = np.zeros((1, 6)), tolerance.overshoot
    for sign in (1, -1):
        speeds = np.array([[0, 0, 0], [sign * 0.2, 0, 0]])
        driven = robot.driving(DriveProfile.of_velocities(np.array([0, 0.2]), speeds))
        found = worst_within(driven, motion, tolerance, np.linspace(0, motion.end, 11))

        def ratio(joints, base):
            drives = ocptip.BaseMotion([base, 0, 0])
            states = task.start[None], still, still + joints
            slopes, offsets = robot.tip_over.affine_moments
            wrench = robot.loads(*states, base_motion=drives)[1]
            return float(robot.tip_over.ratio(np.min(wrench @ slopes.T + offsets)))

        both = ratio((1 + more) * rate, sign * (1 + more))
        assert found.tip.value >= both - 1e-6
        if both > max(ratio((1 + more) * rate, sign), ratio(rate, sign * (1 + more))) + 1e-3:
            assert found.tip.value == pytest.approx(both, rel=1e-4)
            assert "overshooting, base overshooting" in found.tip.how
            return
    pytest.fail("no direction in which both are the worst")


def test_files_and_words_give_the_same_profile(tmp_path):
    words = load_drive_profile("0.5 m, 0.5 m/s, 1 m/s^2")
    (tmp_path / "v.csv").write_text("t,cmd.linear.x,w_deg_s\n1,0,0\n1.5,0.5,0\n2,0.5,0\n2.5,0,0\n")
    (tmp_path / "c.json").write_text(
        json.dumps(
            {
                "units": ["m", "m", "deg"],
                "start": [0, 0, 0],
                "commands": [
                    [{"phi_e": 0.5, "speed": 0.5, "acceleration": 1}],
                    *[[{"phi_e": 0, "speed": 1, "acceleration": 1}]] * 2,
                ],
            }
        )
    )
    t = np.array([0.1, 0.7, 1.2])
    for other in (load_drive_profile(tmp_path / name) for name in ("v.csv", "c.json")):
        np.testing.assert_allclose(other.rows(t), words.rows(t), atol=1e-9)
    times = np.linspace(0, END, 301)
    table = np.column_stack([times, arc(times)[0]])
    np.savetxt(tmp_path / "p.csv", table, fmt="%.7f", delimiter=",", header="t,x,y,yaw_rad", comments="")
    np.testing.assert_allclose(
        load_drive_profile(tmp_path / "p.csv").rows(t)[:, 5], arc(t)[1][:, 2], atol=5e-3
    )


def test_words_without_a_unit_are_no_file():
    with pytest.raises(InputError, match=r"with units, such as .*, got .2 m, 0\.5 m/s, 0\.5.$"):
        load_drive_profile("2 m, 0.5 m/s, 0.5")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,v\n0,0\n", "at least two samples"),
        ("t,v\n0,0\n0,1\n", "line 3: the time does not increase"),
        ("t,v,vx\n0,0,0\n1,1,1\n", "vx is the same velocity as another column"),
        ("t,v\n0,0\n1,a\n", "line 3, v: expected a number"),
        ("t,q\n0,0\n1,1\n", "joints are known by name"),
    ],
)
def test_files_that_are_no_profile_are_refused(tmp_path, text, words):
    path = tmp_path / "drive.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as error:
        load_drive_profile(path)
    assert "drive.csv" in str(error.value)
    assert "\n" not in str(error.value)


def test_velocities_in_bags_of_commands_and_odometry_are_read(tmp_path):
    rosbags = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"]
    with rosbags.Writer(tmp_path / "bag", version=9) as bag:
        kind = "geometry_msgs/msg/Twist"
        connection = bag.add_connection("/cmd_vel", kind, typestore=store)
        for time, v in ((1.0, 0.0), (1.5, 0.6), (2.0, 0.6)):
            message = types[kind](linear=vector(v, 0.0, 0.0), angular=vector(0.0, 0.0, v))
            bag.write(connection, int(1e9 * time), store.serialize_cdr(message, kind))
    found = load_drive_profile(tmp_path / "bag")
    np.testing.assert_allclose(found.rows(np.array([0.25]))[0, [0, 1, 5, 8]], [1.2, 0.09, 0.3, 1.2])


@pytest.mark.slow
def test_check_takes_a_posture_and_the_key_of_the_task(tmp_path, capsys):
    options = ["check", "start", "--task", str(TASK), "--tolerance", "none", "--json", "--drive-profile"]
    assert main([*options, "2 m, 0.8 m/s, 1 m/s^2", "--plot", str(tmp_path / "wheels.svg")]) == 0
    assert "friction used" in (tmp_path / "wheels.svg").read_text(encoding="utf-8")
    data = json.loads(capsys.readouterr().out)
    assert data["certified"]
    assert data["duration_s"] == pytest.approx(3.3)
    assert any("while the base drives" in text for text in data["assumed"])
    assert main([*options, "9 m, 9 m/s, 9 m/s^2"]) == 1
    assert json.loads(capsys.readouterr().out)["stands"] is False
    assert main([*options, str(tmp_path / "none.csv")]) == 2
    assert main(["plan", str(TASK), "--drive-profile", str(tmp_path / "none.csv")]) == 2
    text = TASK.read_text().replace("[motion]", '[motion]\ndrive_profile = "drive.csv"', 1)
    for name in ("meshes", "ur5.urdf"):
        text = text.replace(f'"{name}', f'"{TASK.parent / name}')
    own = tmp_path / "task.toml"
    own.write_text(text)
    (tmp_path / "drive.csv").write_text("t,v\n0,0\n1,0.5\n")
    assert ocptip.load_task(own).robot.acts.end == 1.0


@pytest.mark.slow
def test_a_motion_planned_while_the_base_brakes_stands_where_others_tip(task):
    speeds = np.array([[0.6, 0, 0.3], [0.6, 0, 0.3], [0, 0, 0], [0, 0, 0]])
    profile = DriveProfile.of_velocities(np.array([0, 0.2, 0.45, 0.7]), speeds)
    fast = ocptip.load_task(task, objective="time")
    found = ocptip.plan(fast, drive_profile=profile, starts=1, jobs=1)
    assert found.check.verified
    assert found.check.certified
    # The same path in the same time, from rest to rest without a look at the base.
    plain = Trajectory.ending_together(
        task.start, task.goal, [None] * 6, task.robot.limits.speed, task.robot.limits.acceleration
    )
    quick = plain.time_scaled(found.motion.end / plain.end)
    assert not ocptip.check(task, quick, drive_profile=profile).check.stands


@pytest.mark.parametrize(("yaw", "speed"), [(0.0, 0.28), (np.pi / 2, 0.0), (np.pi / 6, 0.2425)])
def test_a_note_says_how_fast_the_base_moves_sideways_in_its_own_frame(task, yaw, speed):
    """The course goes along y of the world; of a base that is turned by 90 degrees that is forward."""
    times = np.array([0.0, 1.0, 2.0, 3.0])
    course = np.column_stack([np.zeros(4), [0, 0.14, 0.42, 0.56], np.full(4, yaw)])
    speeds = np.outer([0, 0.28, 0.28, 0], [0, 1, 0])
    profile = DriveProfile.of_course(Trajectory.from_points(times, course, speeds))
    notes = [text for text in task.robot.driving(profile).notes if "sideways" in text]
    expected = f"the base moves sideways (up to {speed:.3g} m/s): only for holonomic bases; not checked that"
    assert [text.startswith(expected) for text in notes] == [True] * bool(speed)


@pytest.mark.parametrize(
    ("words", "end", "said"),
    [
        (
            "2 m, 0.5 m/s, 0.5 m/s^2",
            1.09,
            "accelerates until 1 s, then cruises; it brakes only while the arm",
        ),
        (
            "2 m, 0.5 m/s, 0.5 m/s^2",
            6.0,
            "until 1 s, then cruises until 4 s, then brakes until 5 s, then rests",
        ),
        ("90 deg, 60 deg/s, 60 deg/s^2", 0.5, "accelerates; it cruises and brakes only while the arm rests"),
    ],
)
def test_phases_that_overlap_the_motion_of_the_arm_are_told(words, end, said):
    (text,) = load_drive_profile(words).while_moving(end)
    assert text.startswith(f"the arm moves from 0 to {end:g} s: meanwhile the base ")
    assert said in text


def test_of_many_phases_none_is_told():
    times = np.arange(10.0)
    assert not DriveProfile.of_velocities(times, np.outer(times % 2, [1.0, 0.0, 0.0])).while_moving(5.0)
