"""Folders and files of strangers: each command ends in one line, reads nothing elsewhere, and never hangs."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ocptip.basics.outputs import SUMS
from ocptip.basics.write import MARK
from ocptip.cli.main import main
from ocptip.motion.files.plan_files import write_plan
from ocptip.robots.urdf.parser import printed
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes and links of POSIX")
pytest.importorskip("pinocchio")

SECRET = "the content of a file elsewhere"
COMMANDS = {
    "check": ["check"],
    "certify": ["certify"],
    "retime": ["retime"],
    "view": ["view", "--html", "page.html"],
    "export": ["export", "--urdf", "robot.urdf"],
    "simulate": ["simulate"],
    "report": ["report"],
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A plan of an arm of a URDF."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    limits, none = task.robot.limits, [None] * task.robot.n
    motion = Trajectory.ending_together(
        task.start, task.goal, none, 0.5 * limits.speed, 0.2 * limits.acceleration
    )
    folder = tmp_path_factory.mktemp("plans") / "cart"
    write_plan(folder, plan_of(task, motion))
    return folder


@pytest.fixture
def plan(written, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret").write_text(SECRET)
    return shutil.copytree(written, tmp_path / "plan")


def summed(plan: Path) -> None:
    """Hashes of what is there now, as a stranger would write them."""
    names = [line[66:] for line in (plan / SUMS).read_text().splitlines()]
    digests = {n: hashlib.sha256((plan / n).read_bytes()).hexdigest() for n in names if (plan / n).is_file()}
    (plan / SUMS).write_text("".join(f"{digest}  {name}\n" for name, digest in digests.items()))


def refused(capfd, *arguments):
    """The one line on stderr."""
    code = main([str(one) for one in arguments])
    out, err = capfd.readouterr()
    assert code == 2, (out, err)
    assert err.count("\n") == 1, err
    assert err.startswith("ocptip: ")
    assert SECRET not in out + err
    return err


def put(path: Path, how: str) -> None:
    """Something else in the place of a file or folder."""
    if path.is_dir():
        path.rename(path.with_name("moved"))
        target = path.with_name("moved")
    else:
        target = path.parents[path.parts[::-1].index("plan")].parent / "secret"
        path.unlink()
    {
        "pipe": lambda: os.mkfifo(path),
        "device": lambda: path.symlink_to("/dev/zero"),
        "link": lambda: path.symlink_to(target),
        "circle": lambda: path.symlink_to(path.name),
        "folder": path.mkdir,
        "nothing": lambda: None,
    }[how]()


NAMES = ["plan.json", "SHA256SUMS", "task/task.toml", "task", "task/ur5.urdf", "motion.csv"]


@pytest.mark.parametrize("how", ["pipe", "device", "link", "circle", "folder", "nothing"])
@pytest.mark.parametrize("name", NAMES)
def test_no_file_in_the_place_of_a_file(plan, capfd, name, how):
    put(plan / name, how)
    refused(capfd, "check", plan)


@pytest.mark.parametrize("command", list(COMMANDS))
@pytest.mark.parametrize(
    ("name", "how"), [("plan.json", "pipe"), ("task/task.toml", "device"), ("task", "link")]
)
def test_every_command_that_reads_a_plan(plan, capfd, command, name, how):
    put(plan / name, how)
    verb, *options = COMMANDS[command]
    refused(capfd, verb, plan, *options)


def test_files_are_there_and_may_be_read(plan, capfd):
    """What is refused below is refused for what was changed, and nothing else."""
    (plan.parent / "link").symlink_to(plan)
    for folder in (plan, plan.parent / "link"):
        assert main(["export", str(folder), "--urdf", str(folder.with_suffix(".urdf"))]) == 0, (
            capfd.readouterr()
        )


WITH_GEOMETRY = re.compile(r"^sphere_radius = .*\n", re.M)  # without it geometry is read


@pytest.mark.parametrize("name", ["../secret", "/etc/hostname", "../../secret", "link", "up/secret", "deep"])
@pytest.mark.parametrize("key", ["urdf", "srdf"])
def test_a_task_that_names_files_elsewhere(plan, capfd, name, key):
    (plan / "task" / "link").symlink_to("../../secret")
    (plan / "task" / "up").symlink_to("../..")
    (plan / "task" / "deep").symlink_to("deep")
    text = (plan / "task" / "task.toml").read_text()
    text = text.replace('"ur5.urdf"', f'"{name}"') if key == "urdf" else f"{WITH_GEOMETRY.sub('', text)}"
    if key == "srdf":
        text = text.replace('"ur5.urdf"', f'"ur5.urdf"\nsrdf = "{name}"')
    (plan / "task" / "task.toml").write_text(text)
    summed(plan)
    assert f'"{name}"' in text
    refused(capfd, "check", plan)


@pytest.mark.parametrize(
    "name", ["../../secret", "file:///etc/hostname", "package://x/../../secret", "pipe", "zero"]
)
def test_a_robot_that_names_meshes_elsewhere(plan, capfd, name):
    os.mkfifo(plan / "task" / "pipe")
    (plan / "task" / "zero").symlink_to("/dev/zero")
    urdf = plan / "task" / "ur5.urdf"
    mesh = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
    urdf.write_text(urdf.read_text().replace("</inertial>", f"</inertial>{mesh}", 1))
    assert_refused_geometry(plan, capfd, "mesh")


def assert_refused_geometry(plan, capfd, said):
    """What is said of the geometry of a plan's robot."""
    task = plan / "task" / "task.toml"
    task.write_text(WITH_GEOMETRY.sub("", task.read_text()))
    summed(plan)
    err = refused(capfd, "check", plan)
    assert said in err
    return err


def test_a_robot_of_another_folder_is_fine_where_the_user_names_it(plan, capfd, tmp_path):
    (plan / "task" / "ur5.urdf").rename(tmp_path / "ur5.urdf")
    text = (plan / "task" / "task.toml").read_text()
    (tmp_path / "task.toml").write_text(text.replace('"ur5.urdf"', f'"{tmp_path / "ur5.urdf"}"'))
    assert main(["rate", str(tmp_path / "ur5.urdf"), *["0", "-90", "90", "-90", "-90", "10"]]) in (0, 1)
    load_task(tmp_path / "task.toml")


HEADER = ",".join(["time_s", *(f"q{k}_deg" for k in range(1, 7))]) + "\n"
DEEP = 100_000
BOMB = "a0: &a0 [1]\n" + "".join(f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 10)}]\n" for k in range(15))


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("deep.json", "[" * DEEP, "nested too deeply"),
        ("deep.yaml", "[" * 150 + "]" * 150, "nested too deeply"),
        ("deep.toml", "a = " + "[" * DEEP, "nested too deeply"),
        ("dots.toml", ".".join("a" * 3000) + " = 1", "nested too deeply"),
        ("bomb.yaml", BOMB + "joint_names: *a15\npoints: [{positions: *a15}]", "aliases stand for more than"),
        ("huge.json", '{"points": [], "joint_names": ' + "9" * 5000 + "}", "broken JSON"),
        ("nan.json", '{"start": [NaN], "commands": [[]]}', "start"),
        ("many.json", json.dumps({"start": [10**400] * 6, "commands": [[]] * 6}), "start"),
        ("long.csv", "time_s,q1_deg\n" + '"' + "1" * 200_000, "broken CSV"),
        ("zero.csv", HEADER + "0,\0,1,1,1,1,1\n1,2,3,4,5,6,7\n", "expected a number"),
        ("huge.csv", HEADER + "0,1e300,1,1,1,1,1\n1,2,3,4,5,6,7\n", "1e+300"),
        ("empty.yaml", "", "joint trajectory"),
        ("surrogate.json", '{"points": [], "joint_names": ["\\ud800"]}', "joint_names"),
    ],
)
def test_motions_of_strangers(plan, capfd, name, text, said):
    (plan.parent / name).write_text(text, encoding="utf-8", errors="surrogatepass")
    command, arm = "check", ["--case", "A"]
    if name.endswith(".toml"):
        command, arm = "retime", ["--task", EXAMPLES / "tasks" / "ur5_cart.toml"]
    assert said in refused(capfd, command, plan.parent / name, *arm)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<robot", "<!DOCTYPE robot [<!ENTITY a 'b'>]><robot", "defines entities"),
        ("</robot>", "<a>" * 200 + "</a>" * 200 + "</robot>", "nested too deeply"),
        (
            "</robot>",
            "".join(
                f'<link name="l{k + 1}"/><joint name="j{k}" type="fixed"><child link="l{k + 1}"/>'
                f'<parent link="{f"l{k}" if k else "tool0"}"/></joint>'
                for k in range(4000)
            )
            + "</robot>",
            "joints in a row; expected at most 500",
        ),
    ],
)
def test_robots_of_strangers(plan, capfd, old, new, said):
    text = (plan / "task" / "ur5.urdf").read_text()
    (plan.parent / "arm.urdf").write_text(text.replace(old, new, 1))
    assert said in refused(capfd, "init", plan.parent / "arm.urdf")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{good}  ../secret", "line 1: expected a hash and a name"),
        ("{good}  /etc/hostname", "line 1: expected a hash and a name"),
        ("{good}  task/../plan.json", "line 1: expected a hash and a name"),
        ("{good}  Plan.json", "Plan.json is missing"),
        ("{good}  plan.json\n{good}  plan.json", "line 2: expected a hash and a name"),
        ("x" * 10_000_000, "line 1: expected a hash and a name"),
        ("\x1b[2J", "line 1: expected a hash and a name"),
        ("{good}  a\r", "a"),
    ],
)
def test_lists_of_hashes_of_strangers(plan, capfd, line, said):
    good = hashlib.sha256((plan / "plan.json").read_bytes()).hexdigest()
    (plan / SUMS).write_text(line.format(good=good) + "\n")
    err = refused(capfd, "check", plan)
    assert said in err
    assert len(err) < 5000
    assert "\x1b" not in err


@pytest.mark.slow
def test_a_file_of_a_line_end_in_its_name(plan, capfd, tmp_path):
    """The copy in the plan's folder has a name that a list of hashes can hold."""
    (plan / "task" / "ur5.urdf").rename(tmp_path / "a\nb.urdf")
    text = (plan / "task" / "task.toml").read_text()
    (tmp_path / "task.toml").write_text(text.replace('"ur5.urdf"', '"a\\nb.urdf"'))
    task = load_task(tmp_path / "task.toml")
    write_plan(
        tmp_path / "again", plan_of(task, Trajectory.from_dict(json.loads((plan / "plan.json").read_text())))
    )
    assert (tmp_path / "again" / "task" / "a_b.urdf").exists()
    assert main(["export", str(tmp_path / "again"), "--urdf", str(tmp_path / "out.urdf")]) == 0


def test_lines_of_the_parser_of_robots(plan, capfd):
    """Geometry that it leaves out is refused, in one line."""
    text = (plan / "task" / "ur5.urdf").read_text()
    bad = "</inertial><collision><geometry><mesh/></geometry></collision>"
    (plan / "task" / "ur5.urdf").write_text(text.replace("</inertial>", bad, 1))
    assert_refused_geometry(plan, capfd, "mesh")
    bad = "</inertial><collision><geometry><bx size='1 1 1'/></geometry></collision>"
    (plan / "task" / "ur5.urdf").write_text(text.replace("</inertial>", bad, 1))
    assert_refused_geometry(plan, capfd, "(bx) cannot be read: box needs size")


def test_lines_that_the_parser_of_robots_prints(capfd):
    with printed() as lines:
        os.write(2, b"Error:   a joint\n         at line 3 in /build/joint.cpp\n")
        os.write(1, b"Error:   a joint\n         at line 7 in /build/joint.cpp\nWarning: a link\n")
    assert lines == ["a joint", "a link"]
    print("afterwards")
    assert capfd.readouterr().out == "afterwards\n"


def test_a_folder_that_others_write_to_while_it_is_replaced(plan, capfd):
    """`plan --out` refuses before anything is computed."""
    (plan / "task" / "mine.txt").write_text("mine")
    with (plan / SUMS).open("a") as stream:
        stream.write(f"{hashlib.sha256(b'mine').hexdigest()}  task/mine.txt\n")
    before = {path: path.read_bytes() for path in plan.rglob("*") if path.is_file()}
    for more in ([], ["--overwrite"]):
        assert "does not write: task/mine.txt" in refused(capfd, "plan", "A", "--out", plan, *more)
    assert {path: path.read_bytes() for path in plan.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    "arguments",
    [
        ["stand", "SCENE", "--plot", "target.png"],
        ["export", "plan", "--urdf", "target.urdf"],
        ["export", "plan", "--mjcf", "target.xml"],
        ["report", "plan", "--out", "target.html"],
        ["view", "plan", "--html", "target.html"],
        ["certify", "plan", "--out", "target.json"],
        ["parallel", "3RRR", "--c", "target.c"],
        ["parallel", "3RRR", "--urdf", "target.urdf"],
        ["compare", "plan/motion.csv", "plan", "--plot", "target.png"],
        ["identify", "base", "plan/motion.csv", "plan", "--out", "target.toml"],
        ["rate", "3RRR", "--workspace", "x=0:1", "--plot", "target.png"],
    ],
)
def test_files_of_the_user_are_not_replaced(plan, capfd, arguments):
    scene = EXAMPLES / "scenes" / "rover_on_slope.toml"
    arguments = [scene if one == "SCENE" else one for one in arguments]
    target = Path(arguments[-1])
    target.write_text("mine")
    assert f"{target} exists and was not written by ocptip" in refused(capfd, *arguments)
    target.unlink()
    target.symlink_to("secret")
    assert f"{target} is a symbolic link" in refused(capfd, *arguments, "--overwrite")
    assert Path("secret").read_text() == SECRET


@pytest.mark.slow
def test_what_ocptip_wrote_is_replaced(plan):
    """By the mark in it, which every format has; those of figures are in `test_cli`."""
    scene = str(EXAMPLES / "scenes" / "rover_on_slope.toml")
    for *arguments, name in (
        ["stand", scene, "--plot", "a.png"],
        ["export", "plan", "--urdf", "a.urdf"],
        ["export", "plan", "--mjcf", "a.xml"],
        ["export", "plan", "--mjcf", "a.xml"],
        ["parallel", "3RRR", "--urdf", "b.urdf"],
        ["parallel", "3RRR", "--mjcf", "b.xml"],
    ):
        assert main([*arguments, name]) in (0, 1)
        assert MARK.encode() in Path(name).read_bytes(), name


@pytest.mark.slow
def test_code_that_ocptip_wrote_is_replaced(plan):
    for _ in range(2):
        assert main(["parallel", "3RRR", "--c", "a.c"]) == 0


def test_a_pipe_does_not_hang_the_program(plan):
    """In a process of its own, which would be ended."""
    put(plan / "plan.json", "pipe")
    found = subprocess.run(
        [sys.executable, "-m", "ocptip", "check", str(plan)], capture_output=True, text=True, timeout=300
    )
    assert found.returncode == 2
    assert found.stderr.count("\n") == 1
