"""`ocptip parallel`."""

from __future__ import annotations

import contextlib
import io
import json
import re
from functools import cache

import numpy as np
import pytest

from ocptip.cli.main import main
from ocptip.cli.poses_and_closed_chains import parallel as command
from ocptip.parallel.description.ready_made import READY_MADE, delta, ups6
from tests.quick import some


@cache
def said(*arguments):
    """What the command prints about a robot that moves as described."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(["parallel", *arguments]) == 0
    return printed.getvalue()


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, ["3rpr", "Delta", "3RRR", "4prrr", "6ups"]))
def test_ready_made_robots(name):
    report = json.loads(said(name, "--json"))
    assert report["mobility"]["dof"] == len(report["coordinates"]) == len(report["actuated"])
    assert report["home_pose"]["singular"] == []
    assert set(report["operations"]) == {"tau_a", "jacobian"}
    assert report["dynpar"] == 3
    assert report["written"] == []
    assert "ocptip" in report["versions"]


@pytest.mark.slow
def test_table_says_the_same_as_json():
    text, report = said("3RRR"), json.loads(said("3RRR", "--json"))
    assert "3RRR: 3 legs, mobility as in its file." in text
    assert "actuated joints" in text
    assert "1.1, 2.1, 3.1" in text
    assert str(report["operations"]["tau_a"]["weighted"]) in text
    assert text.isascii()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count", "rank"), [("6ups", 24, 21), ("3RRR", 10, 9), ("Delta", 14, 13)])
def test_rank_of_the_base_parameters_is_said(name, count, rank):
    text, report = said(name), json.loads(said(name, "--json"))
    assert (len(report["inertia_parameters"]), report["rank"]) == (count, rank)
    assert len(report["base_parameters"]) == rank
    assert f"{rank} of {count}: dependent in the whole robot" in text
    assert ", ".join(report["base_parameters"]) in text
    assert json.loads(said(name, "--dynpar", "2", "--json"))["rank"] is None


def test_c_code(capsys, tmp_path):
    target = tmp_path / "hexapod.c"
    assert main(["parallel", "6UPS", "--c", str(target), "--dynpar", "2", "--form", "Z"]) == 0
    text = capsys.readouterr().out
    assert "tau_z (form Z, DynPar 2)" in text
    assert f"wrote {target}" in text
    source = target.read_text()
    assert "int tau_z(" in source
    assert "int jacobian(" in source


def test_a_robot_that_is_singular_everywhere_is_not_accepted(capsys, monkeypatch):
    monkeypatch.setitem(READY_MADE, "6UPS", lambda: ups6(gap=np.pi / 3))
    assert main(["parallel", "6UPS"]) == 1
    text = capsys.readouterr().out
    assert "MOBILITY NOT AS IN ITS FILE" in text
    assert "singular in every checked pose" in text


def test_a_vertical_delta_is_not_accepted(capsys, monkeypatch):
    """All first axes vertical: the position closures do not see it, the mobility does."""
    tilted = delta()

    def upright():
        import dataclasses

        legs = tuple(
            dataclasses.replace(
                leg, base_rotation=(("z", 2 * np.pi * k / 3 + 0.3),), end_rotation=None, guess=()
            )
            for k, leg in enumerate(tilted.legs)
        )
        return dataclasses.replace(tilted, legs=legs, name="upright", home=[0.0, 0.0, -0.4])

    monkeypatch.setitem(READY_MADE, "Delta", upright)
    code = main(["parallel", "Delta"])
    text = capsys.readouterr()
    assert code == 1
    assert "MOBILITY NOT AS IN ITS FILE" in text.out
    assert "the mechanism has mobility 4, but 3 coordinates are described" in text.out
    assert "no code: the mobility is not as in the robot's file" in text.out


def test_targets_are_checked_before_anything_is_computed(capsys, monkeypatch):
    def not_called(*_, **__):
        raise AssertionError("computed")

    monkeypatch.setattr(command, "examine", not_called)
    assert main(["parallel", "3RRR", "--c", "3rrr.c"]) == 2
    assert "--c: expected a file NAME.c with NAME an identifier, got '3rrr.c'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("pattern", "new", "expected"),
    [
        ("home = .*", "home = [50.0, 0.0, 0.0]", "home: leg 1 does not reach its coupling point"),
        ("actuated = .*", "actuated = [7]", "leg[1].actuated: must be a whole number >= 1 and <= 3, got 7"),
    ],
)
def test_errors_of_a_robot_file_name_file_and_key(capsys, root, tmp_path, pattern, new, expected):
    text = (root / "src/ocptip/examples/robots" / "planar_3rrr.toml").read_text()
    path = tmp_path / "robot.toml"
    path.write_text(re.sub(pattern, new, text, count=1))
    assert main(["parallel", str(path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"ocptip: robot.toml: {expected}")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["hexapod"], "hexapod: expected one of 3RRR"),
        (["3RRR", "--c", "robot.txt"], "ocptip: --c: expected a file NAME.c"),
        (["3RRR", "--c", "nowhere/robot.c"], "ocptip: --c: the folder 'nowhere' does not exist"),
        (["missing.toml"], "missing.toml"),
    ],
)
def test_bad_input_is_one_line(capsys, arguments, expected):
    assert main(["parallel", *arguments]) == 2
    err = capsys.readouterr().err
    assert expected in err
    assert err.count("\n") == 1
    assert err.startswith("ocptip: ")


@pytest.mark.slow
def test_robot_without_generated_code(capsys, root, tmp_path):
    example = str(root / "src/ocptip/examples/robots/delta_parallelograms.toml")
    assert main(["parallel", example]) == 0
    assert "no code: leg 1 is branched or has closed loops" in capsys.readouterr().out
    for options in (["--c", str(tmp_path / "x.c")], ["--form", "S"], ["--dynpar", "2"]):
        assert main(["parallel", example, *options]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert f"{options[0]}: " in err
        assert "leg 1 is branched" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_robot_with_dependent_coordinates(capsys, root, tmp_path):
    """Motor forces in base parameters of the whole robot, and what finds the joints they want."""
    example = str(root / "src/ocptip/examples/robots/rps3.toml")
    assert main(["parallel", example, "--c", str(tmp_path / "x.c")]) == 0
    out = capsys.readouterr().out
    assert "15: independent in the whole robot" in out
    assert "joints q for these functions: by Newton's method" in out
    header = (tmp_path / "x.h").read_text()
    assert all(f"int {name}(const" in header for name in ("tau_a", "jacobian", "joints", "home_joints"))
    assert main(["parallel", example, "--form", "Z"]) == 2
    assert "--form: joints behind the coupling points take part; only form A" in capsys.readouterr().err


def test_robot_with_code_of_complete_legs(capsys, monkeypatch, tmp_path):
    import dataclasses

    def passive_motor():
        robot = READY_MADE["3RPR"]()
        return dataclasses.replace(robot, actuated=((0, 1), (1, 1), (2, 2)))

    monkeypatch.setattr(command, "read_robot", lambda name: passive_motor())
    assert main(["parallel", "3RPR", "--c", str(tmp_path / "x.c")]) == 0
    out = capsys.readouterr().out
    assert "tau_a (form A, DynPar 3)" in out
    assert "joints q for these functions: by Newton's method" in out
    assert "int tau_a(const" in (tmp_path / "x.h").read_text()


@pytest.mark.slow
def test_friction_behind_coupling_points_is_in_the_code(capsys, monkeypatch):
    import dataclasses

    robot = READY_MADE["3RPR"]()
    legs = tuple(dataclasses.replace(leg, viscous=(0.0, 0.0, 0.3)) for leg in robot.legs)
    monkeypatch.setattr(command, "read_robot", lambda name: dataclasses.replace(robot, legs=legs))
    assert main(["parallel", "3RPR", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["dynpar"] == 3
    assert report["joints_from_z"]


def test_robot_file(capsys, root, tmp_path):
    """The example file is a 3RRR: about the operations of the ready-made one."""
    target = tmp_path / "planar.c"
    example = root / "src/ocptip/examples/robots" / "planar_3rrr.toml"
    assert main(["parallel", str(example), "--json", "--c", str(target)]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["mobility"]["dof"] == 3
    assert report["operations"]["tau_a"]["weighted"] <= 700
    assert report["written"] == [str(target), str(target.with_suffix(".h"))]
    assert report["joints_from_z"]
    assert "int joints(const" in target.with_suffix(".h").read_text()


@pytest.mark.slow
def test_assembly_modes_are_listed_in_degrees_with_the_home_pose_among_them():
    text, report = said("3RRR", "--modes"), json.loads(said("3RRR", "--modes", "--json"))
    modes = report["assembly_modes"]
    assert modes["complete"]
    assert f"assembly modes: {len(modes['modes'])} (6 paths" in text
    assert min(np.abs(mode["z"]).max() for mode in modes["modes"]) < 1e-9
    degrees = [str(value) for value in np.degrees(modes["qa"])]
    again = json.loads(said("3RRR", "--modes", *degrees, "--json"))["assembly_modes"]
    assert [mode["z"] for mode in again["modes"]] == [mode["z"] for mode in modes["modes"]]


@pytest.mark.slow
def test_assembly_modes_need_one_number_per_motor(capsys):
    assert main(["parallel", "3RRR", "--modes", "1", "2"]) == 2
    assert "--modes: expected 3 motor positions" in capsys.readouterr().err


@pytest.mark.slow
def test_workspace_with_ranges_and_its_figure(tmp_path):
    target = tmp_path / "workspace.png"
    grid = ["--workspace", "x=-0.5:0.5", "phi3=-60:60", "--cells", "8"]
    arguments = ["3RRR", *grid, "--range", "2", "50", "100"]
    text = said(*arguments, "--plot", str(target))
    report = json.loads(said(*arguments, "--json"))["workspace"]
    assert "workspace over x, phi3: size" in text
    assert "leg 1 joint 2" in text
    assert 0 < report["shares"]["inside"] < 1
    assert report["ranges"][1][1] < np.radians(60)
    assert target.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "why"),
    some(
        2,
        [
            (["--workspace", "x"], "--workspace: expected NAME=LOW:HIGH"),
            (["--workspace", "x=0:1", "--at", "0"], "--at: expected x, y, phi3"),
            (["--workspace", "x=0:1", "--range", "9", "0", "1"], "--range: no leg has a joint 9"),
            (["--range", "1", "2", "1"], "--range: range: expected the smallest"),
        ],
    ),
)
def test_workspace_refusals(capsys, arguments, why):
    assert main(["parallel", "3RRR", *arguments]) == 2
    assert why in capsys.readouterr().err


def test_code_of_serial_arms(capsys, root, tmp_path):
    examples = root / "src/ocptip/examples/tasks"
    counts = []
    for name in ("w1p1p2w2", str(examples / "ur5.urdf"), str(examples / "ur5_cart.toml")):
        target = tmp_path / "arm.c"
        assert main(["parallel", name, "--c", str(target), "--json"]) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["joints"] == 6
        counts.append(report["operations"]["arm"]["weighted"])
        assert "int arm(const" in target.with_suffix(".h").read_text()
    assert all(400 < count < 1500 for count in counts)
    assert main(["parallel", "fsfs"]) == 0
    assert "serial arm of 6 joints" in capsys.readouterr().out
    assert main(["parallel", "IRB2000"]) == 2
    assert "IRB2000: code: its links have no masses" in capsys.readouterr().err
    assert main(["parallel", "FSFS", "--form", "S"]) == 2
    assert capsys.readouterr().err == "ocptip: --form: not for serial arms, which have one form of code\n"
