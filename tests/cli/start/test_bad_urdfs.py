"""Bad URDFs and bad words about them: every kind is refused in one line, with exit code 2, and says why."""

import pytest

from ocptip.cli.main import main
from tests.task_files.test_arm_files import LIFT, ON_A_LIFT, SHORT, TURN


def edited(old: str, new: str, count: int = -1) -> str:
    assert old in ON_A_LIFT
    return ON_A_LIFT.replace(old, new, count)


FILES = {
    "empty": ("", "is empty"),
    "blank": (" \n\n", "is empty"),
    "git-lfs": ("version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a pointer of git-lfs"),
    "not closed": (ON_A_LIFT[:-8], "broken XML: no element found"),
    "mismatched": (edited("</robot>", "</robt>"), "broken XML: mismatched tag"),
    "text": ("robot", "broken XML: syntax error"),
    "TOML": (SHORT, "broken XML"),
    "undefined entity": (edited("<robot", "&nbsp;<robot"), "broken XML"),
    "xacro elements": (
        edited(
            '"on a lift">', '"x" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="a" value="1"/>'
        ),
        "a xacro file, not a URDF yet; expand it: xacro lift.urdf > robot.urdf",
    ),
    "xacro expressions": (edited('"0 0 0.3"', '"0 0 ${height}"', 1), "a xacro file, not a URDF yet"),
    "xacro without namespace": (edited("</robot>", "<xacro:arm/>"), "a xacro file, not a URDF yet"),
    "SDF": ('<sdf version="1.9"><model name="m"/></sdf>', "not a URDF (<robot>): an SDF file"),
    "MuJoCo": ("<mujoco/>", "not a URDF (<robot>): a MuJoCo model"),
    "COLLADA": ("<COLLADA/>", "not a URDF (<robot>): a COLLADA file"),
    "HTML": ("<html><body/></html>", "not a URDF (<robot>): its outermost element is <html>"),
    "no links": ('<robot name="r"></robot>', "no <link> in it"),
    "two links of one name": (
        edited("</robot>", '<link name="tool0"/></robot>'),
        "2 links are called 'tool0'",
    ),
    "two joints of one name": (edited('name="turn_2"', 'name="turn_1"'), "2 joints are called 'turn_1'"),
    "link without name": (edited("</robot>", "<link/></robot>"), "a link has no name"),
    "joint without name": (edited('name="turn_1" ', ""), "a joint has no name"),
    "unknown kind of joint": (
        edited('type="continuous"', 'type="continous"'),
        "joint 'turn_2': type 'continous', expected one of revolute, continuous, prismatic, fixed, floating, "
        "planar; did you mean 'continuous'?",
    ),
    "dynamics without values": (
        edited('<limit velocity="2" effort="60"/>', '<limit velocity="2" effort="60"/><dynamics/>'),
        "joint 'turn_2': <dynamics> has neither damping nor friction",
    ),
    "safety controller without gain": (
        edited('<limit velocity="2" effort="60"/>', '<limit velocity="2" effort="60"/><safety_controller/>'),
        "joint 'turn_2': <safety_controller> has no k_velocity",
    ),
    "mimics nothing": (edited('<mimic joint="finger_1"/>', "<mimic/>"), "'finger_2': <mimic> names no joint"),
    "robot without name": (edited(' name="on a lift"', ""), "<robot> has no name"),
    "another version": (
        edited(' name="on a lift"', ' name="a" version="2.0"'),
        "expected 1.0 to 1.2, got '2.0'",
    ),
    "two materials": (
        edited('<link name="base"/>', '<link name="base"/>' + 2 * '<material name="red"/>'),
        "2 materials are called 'red'",
    ),
    "joint without kind": (edited(' type="continuous"', ""), "joint 'turn_2': type ''"),
    "unknown parent": (
        edited('parent link="upper"', 'parent link="uper"'),
        "parent 'uper' is no link of the",
    ),
    "unknown child": (
        edited('child link="upper"', 'child link="uper"'),
        "child 'uper' is no link of the file",
    ),
    "no parent": (edited('<parent link="upper"/>', ""), "joint 'turn_2': no <parent link=...>"),
    "no child": (edited('<child link="upper"/>', ""), "joint 'turn_1': no <child link=...>"),
    "two roots": (
        edited("</robot>", '<link name="lonely"/></robot>'),
        "expected one link without a parent, got 2: 'base', 'lonely'",
    ),
    "two parents": (
        edited('<child link="tool0"/>', '<child link="upper"/>'),
        "link 'upper' is the child of 2 joints; a URDF is a tree",
    ),
    "a circle": (
        edited('parent link="base"', 'parent link="lower"'),
        "link 'torso' is an ancestor of itself; a URDF is a tree",
    ),
    "no limits": (edited(TURN, ""), "joint 'turn_1': a revolute joint needs <limit"),
    "no limits of a slide": (edited(LIFT, ""), "joint 'lift': a prismatic joint needs <limit"),
    "limits swapped": (
        edited('lower="-3" upper="3"', 'lower="3" upper="-3"'),
        "lower limit 3 is above the upper",
    ),
    "axis of no length": (
        edited('axis xyz="0 1 0"', 'axis xyz="0 0 0"', 1),
        "joint 'turn_2': its axis is 0 0 0",
    ),
    "axis of two numbers": (
        edited('axis xyz="0 1 0"', 'axis xyz="0 1"', 1),
        "expected three numbers, got '0 1'",
    ),
    "words for numbers": (
        edited('xyz="0.25 0 0"', 'xyz="0,25 0 0"'),
        "<origin xyz>: expected three numbers, got",
    ),
    "mass in words": (
        edited('mass value="2"', 'mass value="2 kg"', 1),
        "link 'torso': <mass value>: expected a",
    ),
    "infinite mass": (
        edited('mass value="2"', 'mass value="inf"', 1),
        "<mass value>: expected a number, got 'inf'",
    ),
    "inertia in words": (
        edited('ixx="0.02"', 'ixx=""', 1),
        "link 'torso': <inertia ixx>: expected a number, got ''",
    ),
    "limit in degrees": (
        edited('lower="-3"', 'lower="-170deg"'),
        "joint 'turn_1': <limit lower>: expected a number",
    ),
    "an SRDF": (
        '<robot name="r"><disable_collisions link1="a" link2="b" reason="Never"/></robot>',
        "no <link> in it; it is an SRDF, whose key is srdf",
    ),
    "no joints": (
        '<robot name="r"><link name="base"/></robot>',
        "--base-link: no joint moves behind 'base'",
    ),
    "only fixed joints": (
        edited('type="prismatic"', 'type="fixed"')
        .replace("revolute", "fixed")
        .replace("continuous", "fixed"),
        "--base-link: no joint moves behind 'base'",
    ),
    "planar joint": (edited('type="continuous"', 'type="planar"'), "joint 'turn_2' is a JointModelPlanar"),
    "floating joint": (
        edited('type="continuous"', 'type="floating"'),
        "joint 'turn_2' is a JointModelFreeFlyer",
    ),
    "no way": (
        edited(LIFT, LIFT.replace("0.4", "0")).replace("revolute", "fixed").replace("continuous", "fixed"),
        "no free joint between 'base' and 'tool0'",
    ),
    "mimics what is not there": (
        edited('<limit velocity="2"', '<mimic joint="turn_7"/><limit velocity="2"'),
        "joint 'turn_2' mimics 'turn_7', which is missing or mimics it as well",
    ),
    "coupled, no way left": (
        edited('<limit velocity="2"', '<mimic joint="turn_1" offset="8"/><limit velocity="2"')
        .replace("continuous", "revolute")
        .replace('velocity="2" effort="60"', 'velocity="2" effort="60" lower="-1" upper="1"'),
        "limits leave no way to 'turn_1', for turn_2 follows turn_1 at 1 times its value + 8",
    ),
    "coupled beside the way": (
        edited('<mimic joint="finger_1"/>', '<mimic joint="turn_1"/>'),
        "joint 'finger_2', beside the chain to the tool, mimics 'turn_1', which moves; only couplings",
    ),
    "two tools": (
        edited(
            "</robot>",
            '<link name="left_tool0"/><joint name="f" type="fixed"><parent link="lower"/>'
            '<child link="left_tool0"/></joint></robot>',
        ),
        "--tool-frame: is missing, candidates: tool0, left_tool0",
    ),
}
WORDS = [
    (
        ["--base-link", "bse"],
        "--base-link: no 'bse'; candidates: base, torso, upper, lower; did you mean 'base'?",
    ),
    (
        ["--tool-frame", "tool"],
        "--tool-frame: no 'tool'; candidates: lower, tool0; did you mean 'tool0'?",
    ),
    (["--base-link", "tool0"], "--base-link: no joint moves behind 'tool0'"),
    (["--base-link", "left", "--tool-frame", "right"], "'right' is not behind base_link 'left'"),
    (["--base-link", "lower", "--tool-frame", "tool0"], "no free joint between 'lower' and 'tool0'"),
]
LOCKS = [
    ("finger", "expected JOINT=DEGREES or JOINT=LENGTHm"),
    ("finger_1=x", "expected JOINT=DEGREES or JOINT=LENGTHm"),
    ("fnger_1=0.1m", "no joint 'fnger_1'; there are lift, turn_1, turn_2, finger_1, finger_2; did you mean"),
    ("thumb*=0.1m", "no joint 'thumb*'"),
    ("finger_*=10", "joint 'finger_1' slides"),
    ("turn_1=0.1m", "joint 'turn_1' turns"),
    ("flange=1", "joint 'flange' is fixed"),
]


def refusal(capfd, *words: str) -> str:
    """The line on stderr; whatever Pinocchio's parser writes counts, too."""
    assert main(list(words)) == 2
    said, error = capfd.readouterr()
    assert not said
    assert error.startswith("ocptip: ")
    assert error.count("\n") == 1
    return error


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lift.urdf").write_text(ON_A_LIFT, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(("text", "message"), FILES.values(), ids=FILES)
def test_bad_files(here, capfd, text, message):
    (here / "lift.urdf").write_text(text, encoding="utf-8")
    assert message in refusal(capfd, "init", "lift.urdf")
    (here / "task.toml").write_text(SHORT, encoding="utf-8")
    line = refusal(capfd, "plan", "task.toml")
    assert message.replace("--tool-frame", "tool_frame").replace("--base-link", "base_link") in line
    assert line.startswith("ocptip: task.toml: arm.")
    assert not (here / "lift.toml").exists()


@pytest.mark.parametrize(("words", "message"), WORDS)
def test_bad_names(here, capfd, words, message):
    assert message in refusal(capfd, "init", "lift.urdf", *words)
    assert message in refusal(capfd, "rate", "lift.urdf", "0", "0", "0", *words)


@pytest.mark.parametrize(("lock", "message"), LOCKS)
def test_bad_locks(here, capfd, lock, message):
    assert message in refusal(capfd, "rate", "lift.urdf", "0", "0", "0", "--lock", lock)


def test_all_complaints_of_a_file_are_said_at_once(here, capfd):
    text = ON_A_LIFT.replace('type="continuous"', 'type="spinning"').replace('value="2"', 'value="two"')
    (here / "lift.urdf").write_text(text.replace('parent link="base"', 'parent link="bas"'), encoding="utf-8")
    line = refusal(capfd, "init", "lift.urdf")
    for part in ("'spinning'", "<mass value>", "parent 'bas' is no link", "got 'two'"):
        assert part in line
    assert "; " in line


def test_files_that_cannot_be_read_or_written(here, capfd):
    (here / "bytes.urdf").write_bytes(b"\xff\xfe<\x00r\x00")
    assert "broken XML" in refusal(capfd, "init", "bytes.urdf")
    assert "no such file" in refusal(capfd, "init", "none.urdf")
    assert "is a folder; expected a file" in refusal(capfd, "init", ".")
    (here / "lift.toml").write_text("mine", encoding="utf-8")
    assert "lift.toml: exists; give another place by --out, or --overwrite" in refusal(
        capfd, "init", "lift.urdf"
    )
    assert (here / "lift.toml").read_text(encoding="utf-8") == "mine"
    assert main(["init", "lift.urdf", "--overwrite"]) == 0
    assert "#>" in (here / "lift.toml").read_text(encoding="utf-8")
    capfd.readouterr()
    assert "none" in refusal(capfd, "init", "lift.urdf", "--out", "none/task.toml")
    assert "these slide: lift; lock them" in refusal(capfd, "rate", "lift.urdf", "0", "0", "0")


def test_what_is_given_is_not_guessed(here, capfd):
    """A joint is moved or locked, a pose or values are given."""
    task = here / "task.toml"
    for old, new, message in (
        (
            'urdf = "lift.urdf"',
            'urdf = "lift.urdf"\nlocked_m = { lift = 0.1 }',
            "motion.start_m: unknown key",
        ),
        ("start_m = [0.1]", "start_m = [0.9]", "lift at 0.9000 m is outside its limits 0.0000 to 0.4000"),
        ("mount_position", "mount_positon", "arm.mount_positon: unknown key; did you mean 'mount_position'"),
    ):
        task.write_text(SHORT.replace(old, new), encoding="utf-8")
        assert message in refusal(capfd, "plan", "task.toml")
