"""The study of stock robots: which files it takes, what it makes of answers, that it goes on."""

import json
from xml.etree import ElementTree as ET

import pytest

from studies.stock_robots import run
from studies.stock_robots.report import general, markdown, short
from studies.stock_robots.robots import longest_chain, stock_robots
from tests.task_files.test_arm_files import ON_A_LIFT


def chain(*names, offset="0 0 0.2"):
    parts = [f'<link name="{name}"/>' for name in ("root", *names)]
    for k, name in enumerate(names):
        parts.append(
            f'<joint name="{name}_joint" type="revolute"><parent link="{("root", *names)[k]}"/>'
            f'<child link="{name}"/><origin xyz="{offset}"/><limit lower="-1" upper="1"/></joint>'
        )
    return f'<robot name="r">{"".join(parts)}</robot>'


def test_legs_are_no_arms():
    assert len(longest_chain(ET.fromstring(chain("one", "two", "three", "four")))) == 4
    assert longest_chain(ET.fromstring(chain("hip", "thigh", "knee", "foot"))) == []


def test_one_robot_per_chain_and_packages_in_turn(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    four = ("one", "two", "three", "four")
    files = {
        "a/arm.urdf": chain(*four),
        "a/arm_again.urdf": chain(*four),
        "a/longer.urdf": chain(*four, offset="0 0 0.3"),
        "a/short.urdf": chain(*four[:3]),
        "a/hand.urdf": chain(*four, offset="0 0 0.02"),
        "b/five.urdf": chain(*four, "five"),
        "b/broken.urdf": "<robot",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    found = stock_robots(tmp_path, ["a", "b"])
    assert [(robot.package, robot.urdf.name) for robot in found] == [
        ("a", "arm.urdf"),
        ("b", "five.urdf"),
        ("a", "longer.urdf"),
    ]


@pytest.mark.parametrize(
    ("name", "code", "said", "complained", "outcome"),
    [
        ("plan", 0, "arm   PROVED for 'workshop'", "", "proved"),
        ("plan", 0, "arm   CHECKED", "", "checked"),
        ("report", 0, "written", "", "yes"),
        ("check", 1, "BROKEN", "", "no"),
        ("init", 2, "", "ocptip: no mesh", "refused"),
        ("plan", 3, "", "internal error: oh", "internal error"),
        ("plan", 1, "", "Traceback (most recent call last)", "internal error"),
        ("plan", -11, "", "", "internal error"),
        ("plan", 3, "", "MemoryError", "memory"),
        ("plan", -24, "", "", "time-out"),
    ],
)
def test_outcomes(name, code, said, complained, outcome):
    assert run.classified(name, code, said, complained) == outcome


@pytest.mark.slow
def test_a_robot_is_run_once_and_its_row_is_printed(tmp_path, monkeypatch, capsys):
    """A robot without an inertia: `init` says why, and nothing else is run."""
    packages, out = tmp_path / "packages", tmp_path / "out"
    (packages / "one").mkdir(parents=True)
    text = ON_A_LIFT.replace('type="prismatic"><parent link="base"', 'type="revolute"><parent link="base"')
    (packages / "one" / "lift.urdf").write_text(text)
    monkeypatch.setattr(run, "PACKAGES", {"one": "1.0"})
    monkeypatch.setattr("studies.stock_robots.robots.JOINTS", 3)
    monkeypatch.setattr(run, "_LATER", {"plan": ("plan", "no such task.toml")})
    for _ in range(2):
        assert run.main(["--packages", str(packages), "--out", str(out)]) == 0
    rows = [json.loads(line) for line in (out / "stock_robots.jsonl").read_text().splitlines()]
    assert [(row["command"], row["outcome"]) for row in rows] == [("init", "yes"), ("plan", "refused")]
    assert all(row["cpu"] > 0.1 and row["memory"] > 50 and row["version"] == "1.0" for row in rows)
    printed = capsys.readouterr().out
    assert "| one: lift | yes " in printed
    assert printed.splitlines()[-1].startswith("- `plan`, refused: ")
    assert markdown(rows) in printed


def test_files_with_common_names_are_called_by_their_folders():
    assert short("compas-fab/data/panda/urdf/robot_description.urdf") == "compas-fab: panda"
    assert short("a/b/c.urdf") == "a: c"


def test_the_reason_is_the_error_behind_the_progress():
    text = "warning: odd\nocptip plan: [##......] 7/16 steps, 154 s\nocptip: start: tips\n"
    assert run.shortened(text) == "start: tips"
    assert run.shortened("\nA   PROVED\nstarts 3\n") == "A   PROVED"
    assert run.shortened("") == ""


def test_robots_with_the_same_reason_stand_in_one_line():
    files = "'package://{0}/1.stl', 'package://{0}/2.stl' and 5 more"
    missing = f"task.toml: arm.urdf: {{0}}.urdf: no mesh file {files}; give"
    rows = [
        {"urdf": f"p/{name}.urdf", "command": "plan", "outcome": "refused", "reason": missing.format(name)}
        | {"cpu": 1.0, "memory": 100.0}
        for name in ("a", "b")
    ]
    assert markdown(rows).splitlines()[-1] == "- `plan`, refused: no mesh file '...'; give: p: a, p: b"
    broken = "/some/folder/robot.urdf: joint 'a': axis is '1, 2'; joint 'b': axis is '3'"
    assert general(broken) == "joint '...': axis is '...'"
