"""Folders of plans: moved, without the files that the task was read from, changed, and read back."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.outputs import SUMS
from ocptip.cli.main import main
from ocptip.motion.check import check_motion
from ocptip.motion.files.execution import execute
from ocptip.motion.files.plan_files import write_plan
from ocptip.motion.objective import TIME, priced
from ocptip.published.tasks import PRINTED_LIMITS, experiment_task
from ocptip.standing.limits import Limits
from ocptip.task_files.motion import load_task
from ocptip.task_files.plan_folder import is_plan_folder, read_plan_folder
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES
from tests.quick import THOROUGH, some

CART = (EXAMPLES / "tasks/ur5_cart.toml").read_text(encoding="utf-8")
SRDF = '<robot name="ur5"><disable_collisions link1="base_link" link2="wrist_1_link" reason="Far"/></robot>'


@pytest.fixture(scope="module")
def case():
    worst = {"GN_worst_case": 0.98, "GT_worst_case": 0.97, "clearance_worst_case": 1e-3}
    limits = Limits(GN=0.85, GT=0.8, max_duration=4.0, **worst)
    return replace(experiment_task("C", "effective", limits), objective=priced(20.0))


@pytest.fixture(scope="module")
def written(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plans") / "C"
    write_plan(folder, plan_of(case, case.reference))
    return folder


@pytest.fixture
def plan(written, tmp_path):
    return shutil.copytree(written, tmp_path / "elsewhere")


def files_in(folder):
    """Names of all files in a folder and below it."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def plain_motion(task):
    """One ramp per joint."""
    limits = task.robot.limits
    none = [None] * task.robot.n
    return Trajectory.ending_together(
        task.start, task.goal, none, 0.8 * limits.speed, 0.4 * limits.acceleration
    )


def same_check(found, task, motion):
    """Worst values of two checks, to rounding."""
    pairs = (found.task, found.motion), (task, motion)
    again, before = (check_motion(one.robot, moves, one.limits) for one, moves in pairs)
    assert again.verified == before.verified
    assert again.energy == pytest.approx(before.energy, rel=1e-9)
    for name, worst in before.worst.items():
        assert again.worst[name].value == pytest.approx(worst.value, rel=1e-9, abs=1e-9), name


def test_a_published_case_with_its_limits(plan, case):
    found = read_plan_folder(plan)
    assert (found.task.name, found.task.limits, found.task.objective) == ("C", case.limits, case.objective)
    assert found.task.robot.support.mass == 3.45
    assert found.data["task_file"] == "task/task.toml"
    assert (found.data["seed"], found.data["options"]["starts"]) == (3, 2)
    same_check(found, case, case.reference)


def test_the_hashes_are_those_of_sha256sum(plan):
    names = [line.split("  ")[1] for line in (plan / SUMS).read_text().splitlines()]
    assert names == ["plan.json", "motion.csv", "trajectory.json", "task/task.toml"]
    if shutil.which("sha256sum"):
        subprocess.run(["sha256sum", "-c", "--quiet", SUMS], cwd=plan, check=True)


@pytest.mark.parametrize("controller", some(1, ["cubic", "linear", "quintic"]))
def test_the_motion_is_that_of_the_controller(case, tmp_path, controller):
    motion = case.reference.with_rise_times(0.02) if controller == "quintic" else case.reference
    execution = execute(case.robot, motion, case.limits, controller)
    write_plan(tmp_path, plan_of(case, motion), executions=[execution])
    same_check(read_plan_folder(tmp_path), case, execution.motion)


@pytest.fixture
def cart(tmp_path):
    """A task with a URDF, meshes in a package, an SRDF, a mesh of a payload, in folders of their own."""
    pytest.importorskip("pinocchio")
    from tests.robots.collision.collision_urdf import box, with_collision, write_stl

    home = tmp_path / "home"
    (home / "robots").mkdir(parents=True)
    (home / "tasks").mkdir()
    urdf = with_collision(home / "robots")
    (home / "ws").mkdir()
    (home / "robots" / "arm_meshes").rename(home / "ws" / "arm_meshes")
    (home / "arm.srdf").write_text(SRDF)
    small = box((-0.01, -0.01, 0.0), (0.01, 0.01, 0.02))
    (home / "ws" / "held").mkdir()
    write_stl(home / "ws" / "held" / "forearm_link.stl", *small)  # a name that a mesh of the arm has, too
    text = re.sub(r"sphere_radius.*\n", 'srdf = "../arm.srdf"\npackage_dirs = "../ws"\n', CART)
    text = re.sub(r'urdf = ".*"', f'urdf = "../robots/{urdf.name}"', text)
    held = '[payload]\nmass = 0.5\n[payload.shape]\nkind = "mesh"\nfile = "../ws/held/forearm_link.stl"\n'
    (home / "tasks" / "job.toml").write_text(f"{text}\n{held}", encoding="utf-8")
    return home


@pytest.mark.slow
def test_nothing_outside_the_folder_is_needed(cart, tmp_path, capsys):
    task = load_task(cart / "tasks" / "job.toml")
    task = replace(task, limits=replace(task.limits, angle_margin=0.02))  # in Python
    motion = plain_motion(task)
    plan = plan_of(task, motion)
    write_plan(tmp_path / "plan", plan)
    files = files_in(tmp_path / "plan" / "task")
    robot = {"ur5_with_collision.urdf", "arm.srdf", "meshes/upper_arm_link.stl", "meshes/forearm_link.stl"}
    assert files == {"task.toml", "forearm_link.stl", *robot}
    shutil.rmtree(cart)
    (tmp_path / "plan").rename(tmp_path / "moved")
    found = read_plan_folder(tmp_path / "moved")
    same_check(found, task, motion)
    assert found.task.limits.angle_margin == pytest.approx(0.02, rel=1e-12)
    geometry = found.task.robot.arm.geometry
    assert len(geometry.shapes) == len(task.robot.arm.geometry.shapes)
    assert geometry.apart == task.robot.arm.geometry.apart
    assert found.task.name == task.name
    for name in ("", "plan.json", "trajectory.json", "motion.csv")[:: 1 if THOROUGH else 4]:
        code = main(["check", str(tmp_path / "moved" / name), "--json"])
        data = json.loads(capsys.readouterr().out)
        assert (code, data["verified"]) == (0 if plan.verified else 1, plan.verified), name
        assert data["task"] == task.name
        for key, worst in plan.check.worst.items():
            assert data["worst"][key]["value"] == pytest.approx(worst.value, abs=1e-6), (name, key)
    write_plan(tmp_path / "moved", plan_of(found.task, found.motion))  # and a copy of a copy is the same
    assert files_in(tmp_path / "moved" / "task") == files
    same_check(read_plan_folder(tmp_path / "moved"), task, motion)


@pytest.mark.slow
def test_files_of_another_robot_do_not_stay(cart, case, tmp_path):
    task = load_task(cart / "tasks" / "job.toml")
    write_plan(tmp_path / "plan", plan_of(task, plain_motion(task)))
    (tmp_path / "plan" / "task" / "mine.txt").write_text("mine")
    write_plan(tmp_path / "plan", plan_of(case, case.reference))
    assert files_in(tmp_path / "plan" / "task") == {"task.toml", "mine.txt"}
    assert read_plan_folder(tmp_path / "plan").task.name == "C"


@pytest.mark.slow
def test_files_may_change_while_a_plan_is_made(cart, tmp_path):
    task = load_task(cart / "tasks" / "job.toml")
    (cart / "tasks" / "job.toml").write_text("other")
    next((cart / "robots").glob("*.urdf")).unlink()
    write_plan(tmp_path / "plan", plan_of(task, plain_motion(task)))
    assert read_plan_folder(tmp_path / "plan").task.robot.arm.joint_names == task.robot.arm.joint_names


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("plan.json", "{", "plan.json is not what was written (hashes in SHA256SUMS)"),
        ("task/task.toml", "", "task/task.toml is not what was written"),
        ("motion.csv", None, "motion.csv is missing"),
        (SUMS, None, "is no folder of a plan: no SHA256SUMS in it"),
        (SUMS, "12  plan.json", "SHA256SUMS: line 1: expected a hash and a name, got '12  plan.json'"),
        (SUMS, f"{'0' * 64}  ../x", "SHA256SUMS: line 1: expected a hash and a name"),
    ],
)
def test_changed_folders_are_refused_in_one_line(plan, capsys, name, change, message):
    if change is None:
        (plan / name).unlink()
    else:
        (plan / name).write_text(change)
    with pytest.raises(InputError) as caught:
        read_plan_folder(plan)
    assert message in str(caught.value)
    assert str(plan) in str(caught.value)
    assert main(["check", str(plan)]) == 2
    assert capsys.readouterr().err == f"ocptip: {caught.value}\n"


@pytest.mark.slow
def test_a_task_made_in_python_is_not_in_the_folder(case, tmp_path, capsys):
    bare = replace(case, source=None)
    write_plan(tmp_path / "p", plan_of(bare, case.reference))
    assert not is_plan_folder(tmp_path / "p")
    with pytest.raises(InputError, match=r"holds no task/task.toml: its task was made in Python"):
        read_plan_folder(tmp_path / "p")
    changed = replace(case, robot=case.robot.varied(support=case.robot.support))
    write_plan(tmp_path / "q", plan_of(changed, case.reference))
    assert json.loads((tmp_path / "q" / "plan.json").read_text())["task_file"] is None
    assert main(["check", str(tmp_path / "p" / "plan.json"), "--tolerance", "none"]) in (0, 1)  # of its case
    assert "plan.json on C   " in capsys.readouterr().out


@pytest.mark.slow
def test_what_the_command_line_says_goes_before_the_folder(plan, tmp_path, capsys):
    assert main(["check", str(plan), "--base", "printed", "--json", "--tolerance", "none"]) == 0
    assert json.loads(capsys.readouterr().out)["masses_kg"]["base"] == 6.582
    (tmp_path / "mine.toml").write_text('case = "C"\nbase = "printed"\n[limits]\nGN = 0.3\n')
    assert main(["check", str(plan), "--task", str(tmp_path / "mine.toml"), "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert (data["limits"]["GN"], data["masses_kg"]["base"]) == (0.3, 6.582)
    shutil.copy(plan / "motion.csv", plan / "recorded.csv")  # no file of the plan, but of its robot
    main(["check", str(plan / "recorded.csv"), "--json"])
    assert json.loads(capsys.readouterr().out)["limits"]["max_duration"] == 4.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('case = "Q"', "case: expected one of A, B"),
        ('case = "C"\nbase = "x"', "base: expected one of printed, effective"),
        ('case = "C"\n[arm]\nname = "FP1W2F"', "arm: unknown key"),
        ('case = "C"\n[limits]\nGN = 2', "limits.GN: must be"),
        ('case = "C"\n[motion]\nobjective = "both"', "motion.objective: both needs price_per_second"),
    ],
)
def test_mistakes_in_files_that_name_a_case(tmp_path, text, message):
    (tmp_path / "t.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        load_task(tmp_path / "t.toml")


def test_a_file_that_names_a_case(tmp_path):
    text = 'case = "B"\n[motion]\nobjective = "time"\nduration = 2.0\n[limits]\nGT = 0.5'
    (tmp_path / "t.toml").write_text(text)
    task, nominal = load_task(tmp_path / "t.toml"), experiment_task("B", "effective")
    assert (task.name, task.objective) == ("B", TIME)
    assert task.limits == replace(PRINTED_LIMITS, GT=0.5, min_duration=2.0, max_duration=2.0)
    np.testing.assert_array_equal(task.start, nominal.start)
    assert task.reference is not None
