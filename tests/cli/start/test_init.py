"""`ocptip init`: what a URDF knows stands in the file, what it does not know is marked, and then it plans."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from ocptip.basics.errors import InputError, InputWarning
from ocptip.cli.layout import brief_notes
from ocptip.cli.main import main
from ocptip.task_files.motion import load_task
from ocptip.task_files.reference import json_schema
from ocptip.task_files.template import MARK, task_template
from tests.places import UR5
from tests.robots.collision.collision_urdf import with_collision
from tests.task_files.test_arm_files import ON_A_LIFT

VALUES = {
    "mass": "60",
    "center_of_mass": "[0, 0, 0.2]",
    "feet": "[[0.4, 0.3, 0], [0.4, -0.3, 0], [-0.4, -0.3, 0], [-0.4, 0.3, 0]]",
    "friction": "0.6",
    "mount_position": "[0, 0, 0.4]",
}


def filled(text: str, values: dict[str, str]) -> str:
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if line.startswith(MARK):
            key = line.removeprefix(MARK).split("=")[0].strip()
            lines[k] = f"{key} = {values[key]}"
    return "\n".join(lines) + "\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "lift.urdf").write_text(ON_A_LIFT, encoding="utf-8")
    return tmp_path


def test_file_is_complete_but_for_its_marks(here, capsys):
    assert main(["init", "robots/lift.urdf"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("lift.toml: written.\n")
    assert "base to tool0: lift, turn_1, turn_2" in said
    assert "acceleration limits of joints lift, turn_1, turn_2: full speed in 0.5 s, for the URDF" in said
    text = (here / "lift.toml").read_text(encoding="utf-8")
    data = tomllib.loads(text)  # as it is: TOML, but no task yet
    assert data["arm"]["urdf"] == "robots/lift.urdf"
    assert main(["plan", "lift.toml"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "base.mass: missing; base.center_of_mass: missing; base.feet: missing (where it" in error
    (here / "lift.toml").write_text(filled(text, VALUES), encoding="utf-8")
    task = load_task("lift.toml")
    assert task.robot.names == ("lift", "turn_1", "turn_2")
    np.testing.assert_allclose(task.goal - task.start, [0.1, *np.deg2rad([30, 30])], atol=1e-4)  # an example
    np.testing.assert_allclose(task.robot.limits.acceleration, 2 * task.robot.limits.speed, rtol=1e-5)
    # What init chose stands in the file; what else was chosen is said.
    assert [note.split(",")[0] for note in task.robot.notes] == [
        "locked",
        "acceleration limits of joints lift",
        "energy: motors are estimated from limits of torque and speed",
    ]
    code = [line for line in filled(text, VALUES).splitlines() if line.strip() and line[0] != "#"]
    assert len(code) <= 25


def test_the_schema_that_the_file_names_lies_beside_it(here):
    assert main(["init", "robots/lift.urdf"]) == 0
    first, *lines = (here / "lift.toml").read_text(encoding="utf-8").splitlines()
    assert first == "#:schema ./task.schema.json"
    assert json.loads((here / "task.schema.json").read_text(encoding="utf-8")) == json_schema()
    assert any(line.startswith("# Replace them by yours: joint values") for line in lines)


def test_long_lists_of_names_are_cut_to_a_number():
    names = [f"finger_{k}_joint" for k in range(38)]
    note = f"locked, not in the chain to the tool: {', '.join(names)} at 0 (rad, sliding joints m)"
    (brief,) = brief_notes([note], verbose=False)
    first = f"locked, not in the chain to the tool: {', '.join(names[:3])} and 35 more"
    assert brief == f"{first} at 0 (rad, sliding joints m) (-v lists all)"
    assert brief_notes([note], verbose=True) == [note]
    assert brief_notes(["short"], verbose=False) == ["short"]


def test_limits_and_other_ends_stand_in_comments(here):
    text = task_template("robots/lift.urdf", here).text
    assert "#   lift    0 to 0.4 m, 0.3 m/s, 400 N\n" in text
    assert "#   turn_1  -171.9 to 171.9 deg, 114.6 deg/s, 80 N m\n" in text
    assert "#   turn_2  none to none deg, 114.6 deg/s, 60 N m\n" in text
    assert "others: left, right" in text
    assert "# locked, not in the chain to the tool: finger_1, finger_2 at 0.01" in text


def test_limits_that_the_urdf_lacks_are_marked(here, capsys):
    (here / "bare.urdf").write_text(
        ON_A_LIFT.replace('effort="400"', 'effort="0"').replace('<limit velocity="2" effort="60"/>', ""),
        encoding="utf-8",
    )
    assert main(["init", "bare.urdf", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert {"force_N", "speed_deg_s", "torque_Nm"} < set(answer["to_fill"])
    assert answer["units"] == ["m", "deg", "deg"]
    more = {"force_N": "300", "speed_deg_s": "{ turn_2 = 90 }", "torque_Nm": "{ turn_2 = 50 }"}
    text = (here / "bare.toml").read_text(encoding="utf-8")
    (here / "bare.toml").write_text(filled(text, VALUES | more), encoding="utf-8")
    task = load_task("bare.toml")
    np.testing.assert_allclose(task.robot.limits.torque, [300, 80, 50])
    assert any(note.startswith("acceleration limits") for note in task.robot.notes)


def test_names_with_quotes_and_a_file_elsewhere(here):
    (here / "robots" / "odd.urdf").write_text(
        ON_A_LIFT.replace("on a lift", "a &quot;lift&quot; für Ä").replace('"tool0"', '"tool &quot;0&quot;"'),
        encoding="utf-8",
    )
    (here / "tasks").mkdir()
    assert main(["init", "robots/odd.urdf", "--tool-frame", 'tool "0"', "--out", "tasks/odd.toml"]) == 0
    data = tomllib.loads((here / "tasks" / "odd.toml").read_text(encoding="utf-8"))
    assert data["name"] == 'a "lift" für Ä'
    assert data["arm"]["tool_frame"] == 'tool "0"'
    assert data["arm"]["urdf"] == "../robots/odd.urdf"


def test_filled_in_as_they_are_the_examples_make_a_task(tmp_path):
    """The numbers behind the marks are TOML of the right kind."""
    template = task_template(UR5, tmp_path)
    (tmp_path / "ur5.toml").write_text(template.text.replace(MARK, ""), encoding="utf-8")
    task = load_task(tmp_path / "ur5.toml")
    assert task.robot.n == 6
    assert template.to_fill[:4] == ["mass", "center_of_mass", "feet", "friction"]


@pytest.mark.parametrize(
    ("meshes", "mark", "key"),
    [
        ("package://elsewhere", "package_dirs", "Folders with packages"),
        ("elsewhere", "collision", "or add the missing"),
    ],
)
def test_missing_meshes_are_said(tmp_path, monkeypatch, capsys, meshes, mark, key):
    monkeypatch.chdir(tmp_path)
    urdf = with_collision(tmp_path, meshes=meshes)
    assert main(["init", urdf.name]) == 0
    said = capsys.readouterr().out
    names = f"{meshes}/upper_arm_link.stl, {meshes}/forearm_link.stl"
    assert f"2 mesh files missing: {names}" in said
    text = Path("ur5_with_collision.toml").read_text()
    (line,) = [line for line in text.splitlines() if line.startswith(f"{MARK} {mark}")]
    assert key in line
    assert names in line
    Path("ur5_with_collision.toml").write_text(text.replace(MARK, ""))
    if mark == "collision":
        assert load_task("ur5_with_collision.toml").robot.arm.geometry is None
        spheres = text.replace(MARK, "").replace("# sphere_radius", "sphere_radius")
        Path("ur5_with_collision.toml").write_text(spheres)
        assert load_task("ur5_with_collision.toml").robot.arm.sphere_sets
    else:
        with pytest.raises(InputError, match=r"arm\.urdf: .*no mesh file 'package://elsewhere/upper"):
            load_task("ur5_with_collision.toml")


@pytest.mark.slow
def test_meshes_are_found_by_the_end_of_their_path(tmp_path, monkeypatch, capsys):
    """The package has another name here; its folder is beside the URDF, or given."""
    monkeypatch.chdir(tmp_path)
    urdf = with_collision(tmp_path, meshes="package://elsewhere/arm_meshes/links")
    (tmp_path / "given").mkdir()
    (tmp_path / "arm_meshes").rename(tmp_path / "given/arm_meshes")
    assert main(["init", urdf.name, "--out", "a.toml"]) == 0
    said = capsys.readouterr().out
    assert "2 mesh files missing" in said
    assert "names a folder that contains elsewhere/" in said
    assert main(["init", urdf.name, "--out", "b.toml", "--package-dirs", "given"]) == 0
    assert "missing" not in capsys.readouterr().out
    assert 'package_dirs = ["given"]' in Path("b.toml").read_text()
    (tmp_path / "given/arm_meshes").rename(tmp_path / "arm_meshes")
    assert main(["init", urdf.name, "--out", "c.toml"]) == 0
    assert "missing" not in capsys.readouterr().out
    assert "package_dirs" not in Path("c.toml").read_text()


def test_without_geometry_it_says_that_nothing_is_checked(here, capsys):
    assert main(["init", "robots/lift.urdf"]) == 0
    assert "collision  not checked, for the URDF has no collision geometry" in capsys.readouterr().out
    assert "# sphere_radius = " in Path("lift.toml").read_text()


@pytest.mark.slow
def test_filled_in_it_plans(here, capsys):
    assert main(["init", "robots/lift.urdf", "--out", "t.toml"]) == 0
    text = (here / "t.toml").read_text(encoding="utf-8")
    (here / "t.toml").write_text(filled(text, VALUES), encoding="utf-8")
    assert (
        main(["plan", "t.toml", "--starts", "2", "--jobs", "1", "--tolerance", "none", "--no-figures"]) == 0
    )
    assert "PROVED" in capsys.readouterr().out


def test_limits_and_states_of_moveit_go_into_the_task(here, capsys):
    """URDF 1.2 has accelerations and jerks, joint_limits.yaml replaces them, SRDF states are ends."""
    urdf = ON_A_LIFT.replace('name="on a lift"', 'name="on a lift" version="1.2"')
    urdf = urdf.replace('effort="400"', 'effort="400" acceleration="0.9" deceleration="0.8" jerk="6"')
    (here / "lift.urdf").write_text(urdf, encoding="utf-8")
    (here / "joint_limits.yaml").write_text(
        "default_velocity_scaling_factor: 0.1\n"
        "joint_limits:\n"
        "  turn_1: {has_velocity_limits: true, max_velocity: 1.5, has_acceleration_limits: true,"
        " max_acceleration: 3.0}\n"
        "  turn_2: {has_velocity_limits: false, max_velocity: 9.0, has_acceleration_limits: false}\n"
    )
    joints = "".join(
        f'<joint name="{name}" value="{value}"/>'
        for name, value in {"lift": 0.2, "turn_1": -0.5, "turn_2": 0.25, "finger_1": 0.02}.items()
    )
    states = f'<group_state name="stow" group="arm">{joints}</group_state>'
    (here / "robot.srdf").write_text(f'<robot name="on a lift">{states}</robot>')
    call = ["init", "lift.urdf", "--joint-limits", "joint_limits.yaml", "--srdf", "robot.srdf"]
    assert main(call) == 0
    text = Path("lift.toml").read_text(encoding="utf-8")
    assert 'joint_limits = "joint_limits.yaml"' in text
    assert "#   lift    0 to 0.4 m, 0.3 m/s, 400 N, 0.8 m/s^2, 6 m/s^3" in text
    assert '# acceleration_deg_s2 = { "turn_2" = 229.183 }  # assumed without this line' in text
    assert '# or start = "stow"; states of the SRDF: stow' in text
    start = next(line for line in text.splitlines() if line.startswith("start_deg"))
    text = text.replace(start, 'start = "stow"').replace("\nstart_m", "\n# start_m")
    Path("lift.toml").write_text(filled(text, VALUES), encoding="utf-8")
    with pytest.warns(InputWarning, match=r"state 'stow' has finger_1 at 0\.02, locked at 0\.01"):
        task = load_task("lift.toml")
    np.testing.assert_allclose(task.start, [0.2, -0.5, 0.25])
    limits = task.robot.limits
    np.testing.assert_allclose(limits.speed, [0.3, 1.5, 2.0])
    np.testing.assert_allclose(limits.acceleration, [0.8, 3.0, 4.0])  # the last one is assumed
    np.testing.assert_allclose(task.rise_times, [2 * 0.8 / 6, 0.0, 0.0])  # from one limit to the opposite one
    notes = " | ".join(task.robot.notes)
    assert "acceleration limits of joints turn_2: full speed in 0.5 s, for the file gives none" in notes
    assert "default_velocity_scaling_factor 0.1 of joint_limits.yaml does not count" in notes
    assert "joint_limits.yaml does not name lift" in notes


@pytest.mark.parametrize(
    ("yaml", "line", "reason"),
    [
        ("[]", "", r"arm\.joint_limits: .*expected a table joint_limits"),
        (
            "joint_limits: {lift: {has_jerk_limits: true}}",
            "",
            r"lift: has_jerk_limits is true",
        ),
        (
            "joint_limits: {lift: {has_jerk_limits: 1}}",
            "",
            r"has_jerk_limits: expected true or false",
        ),
        (
            "joint_limits: {lift: {has_velocity_limits: true, max_velocity: -1}}",
            "",
            r"lift: velocity must be > 0, got -1",
        ),
        ("joint_limits: {}", 'start = "home"', r"motion\.start: no state 'home'; there are stow"),
        (
            "joint_limits: {}",
            'start = "stow"',
            r"motion\.start: state 'stow' has no value for turn_1",
        ),
    ],
)
def test_files_of_moveit_are_refused_by_their_place(here, yaml, line, reason):
    (here / "l.yaml").write_text(yaml)
    state = '<group_state name="stow" group="arm"><joint name="lift" value="0.1"/></group_state>'
    (here / "r.srdf").write_text(f'<robot name="on a lift">{state}</robot>')
    text = filled(task_template("robots/lift.urdf", here, srdf="r.srdf").text, VALUES)
    text = text.replace("\nmount_position", '\njoint_limits = "l.yaml"\nmount_position')
    if line:
        text = text.replace("\nstart_m", "\n# start_m").replace("\nstart_deg", f"\n{line}\n# start_deg")
    Path("t.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=reason):
        load_task("t.toml")
