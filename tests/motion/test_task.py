"""Motion tasks: printed cases, task files, what is refused before planning, the UR5 on its cart."""

import dataclasses
import re

import numpy as np
import pytest

from ocptip.api.inputs.postures import resting_posture
from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.objective import TIME, priced
from ocptip.motion.task import MotionTask, refusals, require_plannable
from ocptip.published.tasks import experiment_task
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.motors import DCMotors, PowerMaps
from ocptip.robots.payload import Payload
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE
from ocptip.task_files.motion import load_task
from ocptip.task_files.task_scene import NO_BASE_SHAPE
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES

FEET = """\
[base]
mass = 30.0
center_of_mass = [0, 0, -0.05]
[[contact]]
kind = "unilateral"
position = [0.3, 0, -0.15]
friction = 0.6
[[contact]]
kind = "unilateral"
position = [-0.15, 0.26, -0.15]
friction = 0.6
[[contact]]
kind = "unilateral"
position = [-0.15, -0.26, -0.15]
friction = 0.6
"""
MODULAR = (
    FEET
    + """\
[arm]
name = "FP1W2F"
mount_position = [0, 0, 0]
[[obstacle]]
kind = "floor"
height = -0.14
[motion]
start_deg = [-90, 35, -18, 45, -37, 180]
goal_deg = [90, 30, -8, 45, 18, 0]
"""
)
TWO_JOINTS = """<robot name="two"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<link name="finger"/><link name="tip"/>
<joint name="hip" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/>
  <limit lower="-2" upper="2" velocity="2" effort="40"/></joint>
<joint name="knee" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/>
  <axis xyz="0 -1 0"/><limit lower="-2" upper="2" velocity="2" effort="20"/></joint>
<joint name="grip" type="prismatic"><parent link="lower"/><child link="finger"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><parent link="lower"/><child link="tip"/>
  <origin xyz="0.25 0 0"/></joint></robot>
"""
URDF = (
    FEET
    + """\
[arm]
urdf = "two.urdf"
base_link = "base"
tool_frame = "tip"
locked_m = { grip = 0.02 }
armature = 0.1
mount_position = [0.05, 0, 0.2]
mount_rpy_deg = [0, 0, 90]
sphere_radius = 0.04
[arm.limits]
acceleration_deg_s2 = 200
torque_Nm = [60, 30]
[motors]
kind = "estimated"
standby = 3
[motion]
start_deg = [20, 40]
goal_deg = [60, -30]
[limits]
GN = 0.8
clearance = 0.005
reference_moment = 12
"""
)

ENERGY = "energy: motors are estimated from limits of torque and speed"


def load(tmp_path, text, name="task.toml"):
    (tmp_path / "two.urdf").write_text(TWO_JOINTS)
    path = tmp_path / name
    path.write_text(text)
    return load_task(path)


def changed(text, **replacements):
    """The text with whole lines (their keys) replaced; None leaves them out."""
    for key, line in replacements.items():
        text, count = re.subn(rf"(?m)^{key} = .*\n", "" if line is None else f"{line}\n", text)
        assert count, key
    return text


@pytest.fixture(scope="module")
def ur5(root):
    return load_task(root / "src/ocptip/examples/tasks" / "ur5_cart.toml")


def test_printed_cases_are_tasks_that_can_be_planned():
    for name in "ABCDEFGH":
        for base in ("printed", "effective"):
            task = experiment_task(name, base)
            assert refusals(task) == (), (name, base)
            require_plannable(task)
            np.testing.assert_allclose(task.reference.start, task.start)
            np.testing.assert_allclose(task.reference.goal, task.goal, atol=1e-9)
    limits = Limits(GN=0.5)
    assert experiment_task("A", limits=limits).limits is limits
    with pytest.raises(InputError, match="case: there is no 'Z'"):
        experiment_task("Z")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": np.zeros(5)}, "start: expected shape 6, got 5"),
        ({"goal": np.full(6, np.nan)}, "goal: contains NaN"),
        ({"limits": 0.9}, "limits: expected Limits"),
        ({"optimised": ()}, "optimised: expected joints of 0 to 5, at least one"),
        ({"optimised": (0, 6)}, "optimised: expected joints of 0 to 5"),
        ({"optimised": (0, 1.5)}, "optimised: expected joints of 0 to 5"),
        ({"optimised": (1, 0)}, "optimised: joints must increase"),
        ({"commands": 0}, "commands: must be a whole number >= 1 and <= 12, got 0"),
        ({"commands": 10**6}, "commands: must be a whole number >= 1 and <= 12, got 1000000"),
        ({"commands": True}, "commands: must be"),
        ({"reference": Trajectory.from_profiles([0.0], [[RampCommand(1, 1, 1)]])}, "reference: has 1 joints"),
    ],
)
def test_tasks_are_checked(change, message):
    with pytest.raises(InputError, match=message):
        dataclasses.replace(experiment_task("A"), **change)


def test_a_modular_arm_from_a_file(tmp_path):
    task = load(tmp_path, MODULAR)
    assert (task.name, task.optimised, task.commands, task.reference) == ("task", tuple(range(6)), 3, None)
    np.testing.assert_allclose(np.rad2deg(task.start), [-90, 35, -18, 45, -37, 180])
    assert isinstance(task.robot.motors, PowerMaps)
    assert task.limits == Limits()
    assert any("floor" in str(label) for label in task.robot.collision.labels)
    assert refusals(task) == ()


def test_a_urdf_from_a_file(tmp_path):
    task = load(tmp_path, 'name = "leg"\n' + URDF.replace("[motion]", '[motion]\noptimised = ["knee"]'))
    arm = task.robot.arm
    assert (task.name, task.optimised, arm.joint_names) == ("leg", (1,), ("hip", "knee"))
    np.testing.assert_allclose(arm.limits.acceleration, np.deg2rad([200, 200]))
    np.testing.assert_allclose(arm.limits.torque, [60, 30])
    np.testing.assert_allclose(arm.armature, 0.1)
    # rpy of 90 degrees about z: the stretched arm lies along y of the base
    np.testing.assert_allclose(gripper_pose(arm, [0, 0])[0], [0.05, 0.55, 0.2], atol=1e-12)
    assert task.limits == Limits(GN=0.8, clearance=0.005)
    assert task.robot.tip_over.reference_moment == 12
    assert isinstance(task.robot.motors, DCMotors)
    np.testing.assert_allclose(task.robot.motors.standby, 3)
    assert refusals(task) == ()


@pytest.mark.parametrize(
    "motors",
    [
        'kind = "dc"\nmotor_constant = 3\ncoulomb = 1\nviscous = [0.1, 0.2]\nstandby = 2\nregeneration = 0.5',
        'kind = "dc"\nresistance = 4\ntorque_constant = 0.06\ngear_ratio = 100\ncoulomb = 1\n'
        "viscous = [0.1, 0.2]\nstandby = 2\nregeneration = 0.5",
    ],
)
def test_motor_data(tmp_path, motors):
    task = load(tmp_path, URDF.replace('kind = "estimated"\nstandby = 3', motors))
    np.testing.assert_allclose(task.robot.motors.motor_constant, 3)
    np.testing.assert_allclose(task.robot.motors.viscous, [0.1, 0.2])
    assert task.robot.motors.regeneration == 0.5


def test_obstacles(tmp_path):
    walls = """
    [[obstacle]]
    kind = "wall"
    normal = [0, 2, 0]
    distance = 0.9
    name = "left wall"
    [[obstacle]]
    kind = "pillar"
    point = [1, 0, 0]
    radius = 0.1
    """
    task = load(tmp_path, MODULAR + walls)
    names = {label.second for label in task.robot.collision.labels}
    assert {"floor", "left wall", "pillar"} <= names


def test_poses_take_the_shortest_usable_pair_of_branches(tmp_path):
    given = load(tmp_path, MODULAR)
    arm = given.robot.arm
    lines = {}
    for key, q in (("start", given.start), ("goal", given.goal)):
        position, rotation = gripper_pose(arm, q)
        pose = f"{{ position = {position.tolist()}, rotation = {rotation.tolist()} }}"
        lines[f"{key}_deg"] = f"{key}_pose = {pose}"
    task = load(tmp_path, changed(MODULAR, **lines))
    assert refusals(task) == ()
    for q, wanted in ((task.start, given.start), (task.goal, given.goal)):
        np.testing.assert_allclose(gripper_pose(arm, q)[0], gripper_pose(arm, wanted)[0], atol=1e-9)
    way = np.sum(np.abs(task.goal - task.start) / arm.limits.speed)
    assert way <= np.sum(np.abs(given.goal - given.start) / arm.limits.speed) + 1e-9
    # the given start is kept, only the goal's branch is free
    mixed = load(tmp_path, changed(MODULAR, goal_deg=lines["goal_deg"]))
    np.testing.assert_array_equal(mixed.start, given.start)
    branches = solve_inverse_kinematics(arm, *gripper_pose(arm, given.goal)).branches
    usable = [
        np.sum(np.abs(branch - mixed.start) / arm.limits.speed)
        for branch in branches
        if not refusals(dataclasses.replace(mixed, goal=branch))
    ]
    assert len(usable) > 1
    mixed_way = np.sum(np.abs(mixed.goal - mixed.start) / arm.limits.speed)
    assert mixed_way <= min(usable) + 1e-9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": [0, 3.0, 0, 0, 0, 0]}, r"start: joint 2 at 171\.89 degrees is outside its limits -"),
        ({"goal": [0, 2.5, 0, 0, 0, 0]}, r"goal: collision: .* and floor overlap by \d+\.\d mm"),
        (
            {"limits": Limits(clearance=1.0)},
            r"start: .* are \d+\.\d mm apart.*, must be >= 1000",
        ),
        (
            {"limits": Limits(torque_ratio=0.01)},
            r"goal: joint 2 needs .* N m to hold the arm, must be <=",
        ),
        (
            {"limits": Limits(GN=0.05)},
            r"start: at rest the tipping margin is \d+\.?\d* N m, must be >= \d+\.?\d* N m "
            r"\(about contacts \d and \d\)",
        ),
    ],
)
def test_every_refusal_has_its_number(tmp_path, change, message):
    task = dataclasses.replace(load(tmp_path, MODULAR), **change)
    reasons = refusals(task)
    assert any(re.match(message, reason) for reason in reasons), reasons
    with pytest.raises(InputError, match=r"task: cannot be planned: (start|goal): "):
        require_plannable(task)


def test_a_base_that_falls_or_slips_is_refused(tmp_path):
    light = MODULAR.replace("mass = 30.0", "mass = 4.0").replace("0.3, 0, -0.15]", "0.05, 0, -0.15]")
    reasons = refusals(load(tmp_path, light))
    assert any("the base does not stand at rest: contact" in r and "lifts off" in r for r in reasons), reasons
    # on a slope of 24 degrees friction 0.6 is used to 74 %
    slope = "gravity = [4.0, 0, -8.96]\n" + MODULAR + "[limits]\nGT = 0.5\n"
    reasons = refusals(load(tmp_path, slope))
    assert any(
        re.search(r"friction used is 7\d.* %, must be <= 50 % \(contact \d uses", r) for r in reasons
    ), reasons


def test_joints_without_limits_are_refused(tmp_path):
    task = load(tmp_path, URDF)
    robot = task.robot.varied(arm=task.robot.arm.with_limits(acceleration=np.full(2, np.inf)))
    task = dataclasses.replace(task, robot=robot)
    assert refusals(task) == ("joints without acceleration limit: 1, 2; every joint needs one",)


def test_what_a_file_leaves_open_is_assumed_and_said(tmp_path):
    text = URDF.replace("acceleration_deg_s2 = 200\n", "")
    assert load(tmp_path, URDF).robot.notes == (ENERGY, NO_BASE_SHAPE)
    task = load(tmp_path, text)
    np.testing.assert_allclose(task.robot.limits.acceleration, 2 * task.robot.limits.speed)
    note, *others = task.robot.notes
    assert others == [ENERGY, NO_BASE_SHAPE]
    assert note.startswith("acceleration limits of joints ")
    assert note.endswith(": full speed in 0.5 s, for the file gives none")
    task = load(tmp_path, text.replace('[motors]\nkind = "estimated"\nstandby = 3\n', ""))
    assert isinstance(task.robot.motors, DCMotors)
    assert [note.split()[0] for note in task.robot.notes] == ["acceleration", "energy:", "the"]
    task = load(tmp_path, changed(URDF, locked_m=None, base_link=None))
    assert task.robot.notes == (
        "base_link 'base', not given in the file",
        "locked, not in the chain to the tool: grip at 0 (rad, sliding joints m)",
        ENERGY,
        NO_BASE_SHAPE,
    )


POSE = "goal_pose = { position = [0.2, 0, 0.5], rpy_deg = [0, 90, 0] }"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MODULAR.replace("[motion]", "[motoin]"), "motoin: unknown key; did you mean 'motion'"),
        (MODULAR.replace("[arm]", "[[arm]]"), r"arm: expected a table \[arm\]"),
        (FEET, r"is a scene \(ocptip stand\), not a motion task"),
        (MODULAR.replace("friction = 0.6", "friction = -1", 1), r"contact\[1\]\.friction: must be >= 0"),
        (changed(MODULAR, name='name = "FP1"'), "arm.name: no arm 'FP1'"),
        (changed(MODULAR, name="name = 3"), "arm.name: expected a text, got 3"),
        (changed(MODULAR, name=None), "arm.name: expected either name, urdf or dh, got none"),
        (
            changed(MODULAR, name='name = "FSFS"\nurdf = "a"'),
            "arm.name: expected either name, urdf or dh, got name and urdf",
        ),
        (changed(MODULAR, name='name = "FSFS"\nbase_link = "a"'), "arm.base_link: unknown key"),
        (changed(MODULAR, goal_deg="goal_deg = [1, 2, 3]"), "motion.goal_deg: expected 6 numbers, got 3"),
        (changed(MODULAR, goal_deg=None), "motion.goal_deg: expected either goal_deg or goal_pose, got none"),
        (
            MODULAR + POSE,
            "motion.goal_deg: expected either goal_deg or goal_pose, got goal_deg and goal_pose",
        ),
        (
            changed(MODULAR, goal_deg="goal_pose = 1"),
            r"motion.goal_pose: expected a table \[motion.goal_pose\], got 1",
        ),
        (
            changed(MODULAR, goal_deg=POSE.replace("rpy_deg", "rpy")),
            r"motion\.goal_pose\.rpy: unknown key; did you mean 'rpy_deg'",
        ),
        (
            changed(MODULAR, goal_deg="goal_pose = { position = [0, 0, 1] }"),
            "motion.goal_pose.rpy_deg: expected either rpy_deg, .* or rotation, got none",
        ),
        (
            changed(MODULAR, goal_deg=POSE.replace("rpy_deg = [0, 90, 0]", "rotation = [[1, 0], [0, 1]]")),
            "motion.goal_pose.rotation: expected shape 3 x 3, got 2 x 2",
        ),
        (
            changed(MODULAR, goal_deg=POSE.replace("0.2, 0, 0.5", "3, 0, 0.5")),
            r"motion\.goal_pose: arm 'FP1W2F' cannot reach position .* misses by \d+\.\d+ mm",
        ),
        (MODULAR + "optimised = [1, 7]", "motion.optimised: no joint 7; there are 1 to 6: joint 1"),
        (MODULAR + "optimised = [1, 1]", "motion.optimised: expected different joints"),
        (MODULAR + "optimised = 3", "motion.optimised: expected a list of joints"),
        (MODULAR + "[limits]\nGN = 0", "limits.GN: must be above 0 and at most 1"),
        (MODULAR.replace('"floor"', '"lava"'), r"obstacle\[1\]\.kind: expected one of floor, wall, pillar"),
        (
            MODULAR + '[[obstacle]]\nkind = "wall"\nnormal = [0, 0, 0]',
            r"obstacle\[2\]\.normal: must not be zero",
        ),
        (
            MODULAR + '[[obstacle]]\nkind = "pillar"\npoint = [1, 0, 0]\nradius = 0',
            r"obstacle\[2\]\.radius: must be > 0",
        ),
        (changed(URDF, urdf='urdf = "no.urdf"'), r"arm\.urdf: .*no\.urdf: no such file"),
        (
            changed(URDF, base_link='base_link = "bse"'),
            "arm.base_link: no 'bse'; candidates: base, upper, .*did you mean 'base'",
        ),
        (changed(URDF, tool_frame=None), "arm.tool_frame: is missing, candidates: lower, tip"),
        (changed(URDF, locked_m='locked_m = { "gr?p*" = 1, "x*" = 1 }'), r"no joint 'x\*'; there are hip, "),
        (changed(URDF, locked_m="locked_m = { knee = 1 }"), "joint 'knee' turns, its key is locked_deg"),
        (changed(URDF, locked_m="locked_deg = { grip = 10 }"), "joint 'grip' slides, its key is locked_m"),
        (changed(URDF, locked_m="locked_m = { end = 1 }"), "joint 'end' is fixed"),
        (changed(URDF, locked_m='locked_m = { grip = "x" }'), "arm.locked_m.grip: expected a number"),
        (changed(URDF, torque_Nm="angle_min_deg = 170"), "arm.limits: joint 1: angle_min"),
        (
            URDF.replace('"estimated"\nstandby = 3', '"modular"'),
            "the power maps 'modular' are for the modular arms",
        ),
        (changed(URDF, torque_Nm="force_N = 3"), "arm.limits.force_N: no joint of the arm slides"),
        (
            changed(URDF, torque_Nm='torque_Nm = { "k*" = 3, hipp = 2 }'),
            "arm.limits.torque_Nm.hipp: no such joint; there are hip, knee; did you mean 'hip'",
        ),
        (changed(URDF, start_deg="start_deg = 3"), "motion.start_deg: expected a list of 2 numbers, got 3"),
        (changed(URDF, start_deg="start_deg = { hip = 3 }"), "motion.start_deg: no value for knee"),
        (changed(URDF, start_deg="start_m = [1]"), "motion.start_deg: expected either start_deg or start_p"),
        (changed(URDF, start_deg="start_deg = [1, 2]\nstart_m = [1]"), "motion.start_m: unknown key"),
        (
            URDF.replace("sphere_radius = 0.04", "excluded_links = [[1, 2]]"),
            "arm.excluded_links: there is nothing to exclude",
        ),
        (
            URDF.replace("= 0.04", "= 0.04\nexcluded_links = [[1, 3]]"),
            "arm.excluded_links: expected two of the",
        ),
        (
            changed(URDF, sphere_radius=None) + '[[obstacle]]\nkind = "floor"\nheight = 0',
            "no collision geometry",
        ),
        ("name = 3\n" + MODULAR, "name: expected a text, got 3"),
        ("[arm", "broken TOML"),
    ],
)
def test_mistakes_are_named_in_one_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path, text)
    assert str(caught.value).startswith("task.toml: ")
    assert str(caught.value).count("task.toml: ") == 1
    assert "\n" not in str(caught.value)


def test_a_missing_task_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: no such file"):
        load_task(tmp_path / "none.toml")


def test_a_planar_support_carries_no_arm(tmp_path):
    planar = re.sub(r"\[(-?[0-9.]+), (-?[0-9.]+), (-?[0-9.]+)\]", r"[\1, \3]", FEET)
    with pytest.raises(InputError, match=r"task\.toml: support: a mechanism needs a spatial support"):
        load(tmp_path, MODULAR.replace(FEET, planar))


def fast_motion(task):
    """One ramp per joint at its full speed and acceleration."""
    limits = task.robot.arm.limits
    ramps = zip(task.goal, limits.speed, limits.acceleration, strict=True)
    return Trajectory.from_profiles(task.start, [[RampCommand(*ramp)] for ramp in ramps])


def test_ur5_on_a_cart_stands_but_would_tip_at_full_speed(ur5):
    assert isinstance(ur5, MotionTask)
    assert (ur5.name, ur5.robot.arm.n, ur5.robot.support.n_contacts) == ("UR5 on a cart", 6, 4)
    require_plannable(ur5)
    at_rest = dataclasses.replace(ur5, limits=Limits(GN=0.2, GT=0.2, torque_ratio=0.5, clearance=0.01))
    assert refusals(at_rest) == ()
    position, rotation = gripper_pose(ur5.robot.arm, ur5.goal)
    np.testing.assert_allclose(position, [0.3, -0.5, 1.05], atol=1e-9)
    np.testing.assert_allclose(rotation[:, 2], [0, 0, -1], atol=1e-9)
    motion = fast_motion(ur5)
    checked = check_motion(ur5.robot, motion, ur5.limits)
    assert checked.worst["GN"].value > 1
    assert any("slips or lifts off" in violation.detail for violation in checked.violations)
    assert check_motion(ur5.robot, motion.time_scaled(1.5), ur5.limits).verified


def test_ur5_agrees_with_the_published_lengths_and_masses(ur5):
    arm = ur5.robot.arm
    # stretched out along -x: both arm lengths, then the wrist's offsets, on a foot at 0.75 m
    position, _ = gripper_pose(arm, np.zeros(6))
    expected = [-0.425 - 0.39225, -0.10915 - 0.0823, 0.75 + 0.089159 - 0.09465]
    np.testing.assert_allclose(position, expected, atol=1e-12)
    np.testing.assert_allclose(arm.masses, [3.7, 8.393, 2.275, 1.219, 1.219, 0.1879])
    np.testing.assert_allclose(arm.limits.torque, [150, 150, 150, 28, 28, 28])
    np.testing.assert_allclose(np.rad2deg(arm.limits.speed), 180)


def test_ur5_refuses_what_cannot_be(root, tmp_path):
    folder = root / "src/ocptip/examples/tasks"
    text = (folder / "ur5_cart.toml").read_text()
    (tmp_path / "ur5.urdf").write_text((folder / "ur5.urdf").read_text())
    far = text.replace("0.30, -0.50, 1.05", "0.30, -1.50, 1.05")
    with pytest.raises(InputError, match=r"motion\.goal_pose: arm 'ur5' cannot reach .* misses by"):
        load(tmp_path, far)
    narrow = text.replace("0.20, 0.0]", "0.03, 0.0]").replace("mass = 35.0", "mass = 12.0")
    reasons = refusals(load(tmp_path, narrow))
    assert any(reason.startswith("start: the base does not stand at rest") for reason in reasons), reasons
    low = text.replace("0.30, 0.50, 0.90", "0.30, 0.50, 0.60")
    reasons = refusals(load(tmp_path, low))
    assert any(re.match("start: collision: .*_link and floor overlap by", r) for r in reasons), reasons


@pytest.mark.parametrize(
    ("lines", "objective", "durations"),
    [
        ('objective = "time"\nmax_duration = 3.5', TIME, (0.0, 3.5)),
        ("price_per_second = 25\nduration = 2", priced(25.0), (2.0, 2.0)),
    ],
)
def test_what_is_least_and_how_long_it_may_take(tmp_path, lines, objective, durations):
    task = load(tmp_path, URDF.replace("[motion]", f"[motion]\n{lines}"))
    assert task.objective == objective
    assert (task.limits.min_duration, task.limits.max_duration) == durations


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('objective = "speed"', "motion.objective: expected energy, time or both, got 'speed'"),
        ('objective = "both"', "motion.objective: both needs price_per_second"),
        ("price_per_second = 0", "motion.price_per_second: must be > 0"),
        ("duration = 1\nmax_duration = 2", "motion.duration: expected either duration or max_duration"),
        ("max_duration = 0", "motion.max_duration: must be > 0"),
    ],
)
def test_objectives_that_cannot_be_are_named(tmp_path, lines, message):
    with pytest.raises(InputError, match=re.escape(message)):
        load(tmp_path, URDF.replace("[motion]", f"[motion]\n{lines}"))


def test_motions_that_have_to_take_longer_than_any_that_is_planned_are_refused():
    task = experiment_task("A")
    (reason,) = refusals(dataclasses.replace(task, rise_times=40.0))
    assert reason.startswith("max_duration: joint 1 needs 41.")
    assert reason.endswith("s at its limits, 30 s is the longest motion that is planned")
    limits = dataclasses.replace(task.limits, min_duration=31.0, max_duration=31.0)
    reasons = refusals(dataclasses.replace(task, limits=limits))
    assert reasons == ("duration: is 31 s, 30 s is the longest motion that is planned",)


def test_a_payload_that_is_too_heavy_has_the_possible_one_beside_it():
    """It is the smaller one of those that `stand` has at start and goal."""
    task = load_task(EXAMPLES / "tasks/ur5_cart.toml", NONE)
    heavy = task.robot.varied(arm=task.robot.arm.with_payload(Payload(60.0)))
    task = dataclasses.replace(task, robot=heavy)
    with pytest.raises(InputError, match="cannot be planned") as error:
        require_plannable(task)
    ends = (resting_posture(task, name).largest_payload(NONE) for name in ("start", "goal"))
    least = min(one.mass_kg for one in ends if one is not None)
    assert f"possible is a payload of {least:.3g} kg instead of 60 kg (" in str(error.value)


def test_links_with_spheres_are_excluded_by_name_or_number(tmp_path):
    """Messages name them, so that their words can be copied."""
    (tmp_path / "two.urdf").write_text(TWO_JOINTS)
    labels = []
    for pair in ("[1, 2]", '["upper", "lower"]'):
        text = URDF.replace("= 0.04", f"= 0.04\nexcluded_links = [{pair}]")
        (tmp_path / "task.toml").write_text(text, encoding="utf-8")
        labels.append([f"{label}" for label in load_task(tmp_path / "task.toml").robot.collision.labels])
    assert labels[0] == labels[1]
    wrong = URDF.replace("= 0.04", '= 0.04\nexcluded_links = [["upper", "payload"]]')
    (tmp_path / "task.toml").write_text(wrong, encoding="utf-8")
    with pytest.raises(InputError, match="expected two of the links upper, lower, or their numbers, got"):
        load_task(tmp_path / "task.toml")
