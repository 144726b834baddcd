"""The study of foreign arms: packages are found, files filled in, results told; it plans nothing here."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.task_files.motion import load_task
from studies.foreign_arms.mesh_check import MeshCheck
from studies.foreign_arms.report import report
from studies.foreign_arms.run import (
    code_lines,
    deck_of,
    main,
    package_folder,
    places_of,
    task_text,
    template_of,
)
from tests.task_files.test_arm_files import ON_A_LIFT

ARM = {
    "name": "Lift",
    "package": "lifts",
    "urdf": "lift.urdf",
    "base": {"mass": 60, "height": 0.4, "half": [0.4, 0.3]},
    "start_deg": [-40, 30],
    "start_m": [0.1],
    "goal_deg": [40, -20],
    "goal_m": [0.3],
    "optimised": ["lift", "turn_1"],
}


def test_packages_are_found_in_folders(tmp_path):
    (tmp_path / "lifts").mkdir()
    shared = tmp_path / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
    shared.mkdir(parents=True)
    assert package_folder("lifts", [tmp_path / "none", tmp_path]) == tmp_path / "lifts"
    assert package_folder("example-robot-data", [tmp_path]) == shared
    assert package_folder("ocptip", []).name == "ocptip"
    with pytest.raises(InputError, match="package lifts not found; pip install --target DIR lifts"):
        package_folder("lifts", [])


def test_files_of_init_filled_in_are_tasks_of_few_lines(tmp_path):
    (tmp_path / "lift.urdf").write_text(ON_A_LIFT, encoding="utf-8")
    template = template_of(ARM, tmp_path / "lift.urdf", tmp_path)
    text = task_text(ARM, template, 2, {}, spheres=0.03)
    (tmp_path / "task.toml").write_text(text, encoding="utf-8")
    task = load_task(tmp_path / "task.toml")
    assert task.optimised == (0, 1)
    assert task.robot.payload.mass == 2
    assert task.robot.arm.sphere_sets
    assert "deck" in {label.second for label in task.robot.collision.labels}
    assert code_lines(text) <= 25
    plain = tomllib.loads(task_text(ARM, template, 0, {"package_dirs": "."}))
    assert "payload" not in plain
    assert plain["arm"]["package_dirs"] == "."
    assert "sphere_radius" not in plain["arm"]


def test_decks_end_where_the_arm_stands():
    size, position = deck_of(ARM["base"])
    assert size == [0.8, 0.6, 0.1]
    assert position[2] + size[2] / 2 == pytest.approx(0.4)
    assert deck_of({**ARM["base"], "deck": False}) is None


def test_packages_under_other_names_are_linked(tmp_path):
    (tmp_path / "lifts" / "deep").mkdir(parents=True)
    task = tmp_path / "task"
    task.mkdir()
    arm = {**ARM, "links": {"as_in_urdf": "deep"}, "srdf": "lift.srdf"}
    for _ in range(2):
        places = places_of(arm, tmp_path / "lifts", task)
        assert places == {"package_dirs": ".", "srdf": "../lifts/lift.srdf"}
    assert (task / "as_in_urdf").samefile(tmp_path / "lifts" / "deep")


FINGER = """<robot name="finger">
{links}
<link name="l3"/>
<link name="l4"><collision><geometry><mesh filename="bar.obj"/></geometry></collision></link>
{joints}
</robot>"""
LINK = (
    '<link name="l{0}"><collision><origin xyz="0 0 0.2"/><geometry><box size="0.05 0.05 0.3"/></geometry>'
    "</collision></link>"
)
JOINT = (
    '<joint name="j{1}" type="{2}"><parent link="l{0}"/><child link="l{1}"/><origin xyz="0 0 0.4"/>'
    '<axis xyz="0 1 0"/>{3}</joint>'
)
BAR = """v -0.02 -0.02 -0.3
v 0.02 -0.02 -0.3
v 0 0.02 -0.3
v 0 0 0
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""


@pytest.fixture
def finger(tmp_path):
    """Three joints about y, links 0.4 m apart; the last link, a tetrahedron from 0.1 to 0.4, is a mesh."""
    limit = '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
    kinds = {1: "revolute", 2: "continuous", 3: "revolute", 4: "fixed"}
    joints = [JOINT.format(k - 1, k, kind, "" if kind == "fixed" else limit) for k, kind in kinds.items()]
    text = FINGER.format(links="".join(map(LINK.format, range(3))), joints="".join(joints))
    (tmp_path / "finger.urdf").write_text(text, encoding="utf-8")
    (tmp_path / "bar.obj").write_text(BAR, encoding="utf-8")
    return tmp_path / "finger.urdf"


NAMES = ("j1", "j2", "j3")


def test_penetrations_are_found_on_the_meshes(finger):
    check = MeshCheck(finger, "l0", NAMES, {}, deck=([2, 2, 0.02], [0, 0, -0.01]))
    angles = np.deg2rad([[0, 0, 0], [30, 30, 30], [60, 140, 140], [95, 45, -20]])
    found = check.motion(angles)
    assert found["instants"] == 4
    assert found["colliding"] == 2
    assert found["pairs"] == [("l1", "l4"), ("l4", "deck")]  # 60, 200, 340 deg; 95, 140, 120 deg
    assert check.always == []
    assert 0 < check.colliding < 100
    assert MeshCheck(finger, "l0", NAMES, {}).motion(angles[3:])["colliding"] == 0


def test_pairs_named_by_the_user_and_neighbours_do_not_count(finger):
    folded = np.deg2rad([[60, 140, 140]])
    found = MeshCheck(finger, "l0", NAMES, {}).motion(folded)
    assert found["colliding"] == 1
    assert ("l1", "l2") not in found["pairs"]
    assert MeshCheck(finger, "l0", NAMES, {}, excluded=found["pairs"]).motion(folded)["colliding"] == 0


def test_joints_that_rest_stand_where_they_are_told(finger):
    folded = np.deg2rad([[0, 60]])
    check = MeshCheck(finger, "l0", ("j1", "j3"), {"j2": np.deg2rad(170)})
    assert check.motion(folded)["colliding"] == 1
    assert MeshCheck(finger, "l0", ("j1", "j3"), {}).motion(folded)["colliding"] == 0


def test_arms_of_the_study_are_twelve_and_more():
    arms = tomllib.loads(Path("studies/foreign_arms/arms.toml").read_text(encoding="utf-8"))["arm"]
    assert len({arm["name"] for arm in arms}) == len(arms) >= 12
    assert len({arm["package"] for arm in arms}) >= 4


def test_report_tells_distances_only_where_they_were_checked():
    base = {"arm": "A", "package": "p", "payload_kg": 0, "joints": 6, "lines": 20, "accepted": True}
    rows = [
        {
            **base,
            "verdict": "verified",
            "energy_J": 12.34,
            "distance_m": 0.0123,
            "distance_between": "hand and deck",
            "cpu_s": 8.0,
            "meshes": {"instants": 900, "colliding": 3, "random_colliding": 40},
            "spheres": {"verdict": "verified", "cpu_s": 4.0, "read_s": 1.0, "read_meshes_s": 2.0},
        },
        {**base, "verdict": "verified", "energy_J": 12.34, "distance_m": None},
        {**base, "arm": "B", "accepted": False, "verdict": "refused", "reason": "because"},
    ]
    rows[0]["left_out"] = [{"pair": ["a", "b"], "reason": "telescope: all (touching in 3 of 200 postures)"}]
    text = report({"starts": 2, "machine": {"cores": 2}, "rows": rows})
    assert "  A: 1 telescope." in text
    assert "3 tasks, 2 accepted, 2 verified" in text
    assert "0.012 (hand and deck)" in text
    assert text.count("not checked") == 2
    assert "| 3 of 900 | 8 | 4 | 2.00 |" in text
    assert "1 plans, 900 instants, 3 collide" in text
    assert "- B, 0 kg: because" in text


def test_missing_packages_are_named(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--only", "Stretch", "--packages", str(tmp_path)]) == 1
    assert "package stretch_urdf not found" in capsys.readouterr().err
