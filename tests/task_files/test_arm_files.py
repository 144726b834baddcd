"""Arms with a lift and a gripper in task files: few lines, names and patterns, metres beside degrees."""

import json

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.task_files.motion import load_task
from ocptip.trajectories.read import load_motion
from tests.places import EXAMPLES
from tests.quick import ONE_START

INERTIAL = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="2"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>'
)


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str, limit: str) -> str:
    return (
        f'<link name="{child}">{INERTIAL}</link><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


TURN = '<limit lower="-3" upper="3" velocity="2" effort="80"/>'
LIFT = '<limit lower="0" upper="0.4" velocity="0.3" effort="400"/>'
GRIP = '<limit lower="0.01" upper="0.05" velocity="0.1" effort="20"/>'
ON_A_LIFT = "".join(
    [
        '<robot name="on a lift"><link name="base"/>',
        _joint("lift", "prismatic", "base", "torso", "0 0 0.3", "0 0 1", LIFT),
        _joint("turn_1", "revolute", "torso", "upper", "0.1 0 0.1", "0 0 1", TURN),
        _joint(
            "turn_2", "continuous", "upper", "lower", "0.25 0 0", "0 1 0", '<limit velocity="2" effort="60"/>'
        ),
        _joint("finger_1", "prismatic", "lower", "left", "0 0.02 0.2", "0 1 0", GRIP),
        _joint(
            "finger_2",
            "prismatic",
            "lower",
            "right",
            "0 0.02 0.2",
            "0 -1 0",
            GRIP + '<mimic joint="finger_1"/>',
        ),
        '<link name="tool0"/><joint name="flange" type="fixed"><parent link="lower"/><child link="tool0"/>'
        '<origin xyz="0 0 0.3"/></joint></robot>',
    ]
)
SHORT = """\
[base]
mass = 60
center_of_mass = [0, 0, 0.2]
feet = [[0.4, 0.3, 0], [0.4, -0.3, 0], [-0.4, -0.3, 0], [-0.4, 0.3, 0]]
friction = 0.6
[arm]
urdf = "lift.urdf"
mount_position = [0, 0, 0.4]
[motion]
start_deg = [-40, 30]
start_m = [0.1]
goal_deg = { turn_1 = 40, "turn_*" = -20 }
goal_m = { lift = 0.3 }
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "lift.urdf").write_text(ON_A_LIFT, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(folder, text):
    (folder / "task.toml").write_text(text, encoding="utf-8")
    return load_task(folder / "task.toml")


def test_a_short_file_of_a_foreign_arm(folder):
    task = load(folder, SHORT)
    robot = task.robot
    assert robot.names == ("lift", "turn_1", "turn_2")
    assert robot.units == ("m", "rad", "rad")
    assert robot.motor_units == ("N", "N m", "N m")
    np.testing.assert_allclose(task.start, [0.1, *np.deg2rad([-40, 30])])
    np.testing.assert_allclose(task.goal, [0.3, *np.deg2rad([40, -20])])
    np.testing.assert_allclose(robot.limits.acceleration, [0.6, 4, 4])
    np.testing.assert_array_equal(robot.limits.angle_max, [0.4, 3, np.inf])
    assert [contact.friction for contact in robot.support.contacts] == [0.6] * 4
    words = [note.split(",")[0].split(":")[0] for note in robot.notes]
    assert words == [
        "base_link 'base' and tool_frame 'tool0'",
        "locked",
        "acceleration limits of joints lift",
        "energy",
    ]
    assert "finger_1, finger_2 at 0.01" in robot.notes[1]  # the second one mimics the first


LIMITS = """
[arm.limits]
acceleration_m_s2 = 0.5
position_max_m = [0.35]
force_N = { lift = 300 }
speed_deg_s = { "turn_*" = 90, turn_2 = 60 }
"""


def test_limits_by_name_pattern_and_kind(folder):
    limits = load(folder, SHORT + LIMITS).robot.limits
    np.testing.assert_allclose(limits.angle_max, [0.35, 3, np.inf])
    np.testing.assert_allclose(limits.torque, [300, 80, 60])
    np.testing.assert_allclose(limits.speed, [0.3, *np.deg2rad([90, 60])])
    np.testing.assert_allclose(limits.acceleration, [0.5, *np.deg2rad([180, 120])])


@pytest.mark.parametrize(
    ("line", "joints"),
    [('["turn_*"]', (1, 2)), ('["lift", 3]', (0, 2)), ('["*"]', (0, 1, 2)), ("[2]", (1,))],
)
def test_optimised_joints_by_pattern(folder, line, joints):
    assert load(folder, SHORT + f"optimised = {line}\n").optimised == joints


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("start_m = [0.1]\n", "", "motion.start_m: expected either start_m or start_pose, got none"),
        ("[0.1]", "[0.1, 0.2]", r"motion.start_m: expected 1 numbers \(lift\), got 2"),
        ("[-40, 30]", "[10, 20, 30]", r"motion.start_deg: expected 2 numbers \(turn_1, turn_2\), got 3"),
        ("start_m", "start_pose = {}\nstart_m", "motion.start_deg: expected either .*start_m or start_pose"),
        ("lift = 0.3", "turn_1 = 0.3", "motion.goal_m.turn_1: no such joint; there are lift"),
        ("friction = 0.6\n", "", r"base.friction: missing \(of the feet\)"),
        ("[[0.4, 0.3, 0], [0", "[[0.4, 0.3], [0", "base.feet: expected lists of the same length"),
        ("feet = ", "feet = 3 #", "base.feet: expected a list of positions, got 3"),
        (
            "[[0.4, 0.3, 0], [0.4, -0.3, 0], [-0.4, -0.3, 0], [-0.4, 0.3, 0]]",
            "[]",
            "base.feet: expected a list",
        ),
        ("friction = 0.6", "friction = -1", "base.friction: must be >= 0, got -1"),
        (
            "mass = 60\n",
            "mas = 60\nkg = 3\n",
            "base.mas: unknown key; did you mean 'mass'.*; base.kg: unknown key",
        ),
        ("mass = 60\ncenter_of_mass = [0, 0, 0.2]\n", "", "base.mass: missing; base.center_of_mass: missing"),
    ],
)
def test_mistakes(folder, old, new, message):
    assert old in SHORT
    with pytest.raises(InputError, match=message) as caught:
        load(folder, SHORT.replace(old, new))
    assert "\n" not in str(caught.value)


def test_missing_limits_are_asked_for_by_key(folder):
    (folder / "lift.urdf").write_text(
        ON_A_LIFT.replace('effort="400"', 'effort="0"').replace(
            'velocity="2" effort="60"', 'effort="60" velocity="0"'
        ),
        encoding="utf-8",
    )
    message = (
        "limits: the URDF has no torque limit of lift; give force_N; .*speed limit of turn_2; give speed_"
    )
    with pytest.raises(InputError, match=message):
        load(folder, SHORT)
    load(folder, SHORT + "[arm.limits]\nforce_N = 300\nspeed_deg_s = { turn_2 = 90 }\n")


@pytest.mark.slow
def test_plan_and_check_of_an_arm_on_a_lift_speak_of_metres(folder, capsys):
    load(folder, SHORT + 'optimised = ["lift", "turn_1"]\ncommands = 2\n')
    assert main(["plan", "task.toml", *ONE_START, "--out", "out"]) == 0
    text = capsys.readouterr().out
    assert "PROVED" in text
    assert "Assumed" in text
    plan = json.loads((folder / "out" / "plan.json").read_text(encoding="utf-8"))
    assert plan["units"] == ["m", "deg", "deg"]
    assert plan["start"] == pytest.approx([0.1, -40, 30])
    assert len(plan["assumed"]) == 4
    assert "position_margin_m" in plan["worst"]
    header = (folder / "out" / "motion.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.startswith("time_s,q1_m,q2_deg,q3_deg,qd1_m_s,qd2_deg_s")
    assert "tau1_N,tau2_Nm" in header
    for name in ("plan.json", "motion.csv"):
        main(["check", f"out/{name}", "-v", "--task", "task.toml"])
        assert "position margin" in capsys.readouterr().out
    wrong = load_motion(folder / "out" / "motion.csv", ("m", "rad", "rad"))
    assert wrong.start[0] == pytest.approx(0.1)
    (folder / "wrong.csv").write_text(
        (folder / "out" / "motion.csv").read_text(encoding="utf-8").replace("q1_m,", "q1_deg,"),
        encoding="utf-8",
    )
    assert main(["check", "wrong.csv", "--task", "task.toml"]) == 2
    assert "joint 1 moves in m, but the motion gives deg" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.07, 0.013])
def test_slow_lifts_keep_their_accelerations(folder, capsys, speed):
    """Rows of the programs are kept to 1e-8 rad/s, which is much of 0.03 m/s^2."""
    (folder / "lift.urdf").write_text(
        ON_A_LIFT.replace('velocity="0.3"', f'velocity="{speed}"'), encoding="utf-8"
    )
    load(folder, SHORT.replace("lift = 0.3", "lift = 0.11") + 'optimised = ["lift", "turn_1"]\n')
    assert main(["plan", "task.toml", *ONE_START, "--json"]) == 0
    worst = json.loads(capsys.readouterr().out)["worst"]
    assert worst["acceleration_ratio"]["value"] <= 1
    assert worst["speed_ratio"]["value"] <= 1


def test_rows_of_dh_take_their_links_from_parts():
    """The example: tube and drive of the shoulder, by hand."""
    arm = load_task(EXAMPLES / "tasks" / "arm_of_parts.toml").robot.arm.with_payload(None)
    assert arm.masses == pytest.approx([4.5, 3.1, 2.0, 0.7])
    centre = (1.1 * np.array([0.2, 0, 0]) + 2.0 * np.array([0.4, 0, 0.05])) / 3.1
    np.testing.assert_allclose(arm.centres[1], centre, atol=1e-14)
    along = 0.0011 + 0.0035 + 2.0 * 0.05**2 - 3.1 * centre[2] ** 2  # about x, through the centre
    assert arm.inertias[1][0, 0] == pytest.approx(along)


ENDS = """start_deg = [-40]
start_m = [0.1]
goal_deg = [40]
goal_m = [0.3]
"""


def _coupled(folder, urdf: str, table: str):
    (folder / "lift.urdf").write_text(urdf, encoding="utf-8")
    text = SHORT[: SHORT.index("start_deg")] + ENDS
    (folder / "t.toml").write_text(text.replace("[motion]", f"{table}\n[motion]"), encoding="utf-8")
    return load_task("t.toml").robot.arm


def test_joints_follow_others_as_those_that_mimic_in_the_urdf(folder):
    table = '[arm.follows]\nturn_2 = { joint = "turn_1", ratio = -0.5, offset_deg = 10 }'
    said = _coupled(folder, ON_A_LIFT, table)
    mimic = '<mimic joint="turn_1" multiplier="-0.5" offset="0.17453292519943295"/>'
    limit = '<limit velocity="2" effort="60"/>'
    meant = _coupled(folder, ON_A_LIFT.replace(limit, limit + mimic), "")
    assert said.joint_names == meant.joint_names == ("lift", "turn_1")
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 20, 2))
    one, other = (evaluate_dynamics(arm, q, qd, qdd) for arm in (said, meant))
    np.testing.assert_array_equal(one.torque, other.torque)
    np.testing.assert_array_equal(one.wrench, other.wrench)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('turn_3 = { joint = "turn_1" }', r"arm\.follows\.turn_3: no joint 'turn_3' that moves"),
        ('turn_2 = { joint = "flange" }', r"arm\.follows\.turn_2\.joint: no joint 'flange' that moves"),
        ('turn_2 = { joint = "turn_1", ratio = 0 }', r"turn_2\.ratio: must not be 0; lock the joint"),
        ('turn_2 = { joint = "turn_1", offset_m = 1 }', r"'turn_2' turns, its key is offset_deg"),
    ],
)
def test_couplings_are_refused_by_their_place(folder, line, message):
    with pytest.raises(InputError, match=message):
        _coupled(folder, ON_A_LIFT, f"[arm.follows]\n{line}")


def test_masses_are_added_to_base_and_links(folder):
    text = SHORT.replace("[arm]", "[[base.added]]\nmass = 20\ncenter_of_mass = [0.3, 0, 0.1]\n[arm]")
    text = text.replace("[base]", "[base]\ninertia = [2, 3, 4]")
    more = "[[arm.links.turn_2.added]]\nmass = 1\nposition = [0, 0.1, 0]\n"
    (folder / "t.toml").write_text(text.replace("[motion]", f"{more}[motion]"), encoding="utf-8")
    robot = load_task("t.toml").robot
    support = robot.support
    assert support.mass == 80
    np.testing.assert_allclose(support.center_of_mass, [0.075, 0, 0.175])
    # By hand: 60 * 20 / 80 = 15 kg of reduced mass at a distance of 0.3 m along x and 0.1 m along z.
    np.testing.assert_allclose(
        support.inertia, np.diag([2, 3, 4]) + 15 * np.array([[0.01, 0, 0.03], [0, 0.1, 0], [0.03, 0, 0.09]])
    )
    (folder / "t.toml").write_text(SHORT, encoding="utf-8")
    before = load_task("t.toml").robot.arm
    np.testing.assert_allclose(robot.arm.masses - before.masses, [0, 0, 1])
    mass = before.masses[2]
    np.testing.assert_allclose(
        (mass + 1) * robot.arm.centres[2], mass * before.centres[2] + [0, 0.1, 0], atol=1e-12
    )
