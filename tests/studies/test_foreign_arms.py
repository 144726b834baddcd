"""The study of foreign arms: packages are found, files filled in, results told; it plans nothing here."""

import tomllib
from pathlib import Path

import pytest

from ocptip.basics.errors import InputError
from ocptip.task_files.motion import load_task
from studies.foreign_arms.run import code_lines, main, package_folder, report, task_text
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
    text = task_text(ARM, tmp_path / "lift.urdf", tmp_path, 0)
    (tmp_path / "task.toml").write_text(text, encoding="utf-8")
    task = load_task(tmp_path / "task.toml")
    assert task.optimised == (0, 1)
    assert code_lines(text) <= 25
    assert tomllib.loads(task_text(ARM, tmp_path / "lift.urdf", tmp_path, 2))["payload"]["mass"] == 2


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
        },
        {**base, "verdict": "verified", "energy_J": 12.34, "distance_m": None},
        {**base, "arm": "B", "accepted": False, "verdict": "refused", "reason": "because"},
    ]
    text = report({"starts": 2, "source": "s", "machine": {"cores": 2}, "rows": rows})
    assert "3 tasks, 2 accepted, 2 verified" in text
    assert "0.012 (hand and deck)" in text
    assert text.count("not checked") == 2
    assert "- B, 0 kg: because" in text


def test_missing_packages_are_named(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--only", "Stretch", "--packages", str(tmp_path)]) == 1
    assert "package stretch_urdf not found" in capsys.readouterr().err
