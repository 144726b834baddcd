"""The study of the literal reading of the power maps: same motion, both readings, and the table."""

import json

import numpy as np
import pytest

from ocptip.published.tasks import experiment_task
from studies.plan_cases import power_reading


def test_readings_differ_in_power_only():
    load, drive = (power_reading.task_of("B", "effective", r) for r in ("load", "drive"))
    assert load.robot.tip_over.reference_moment == drive.robot.tip_over.reference_moment
    motion = load.reference
    a, b = (task.robot.samples(motion, np.linspace(0, motion.end, 50)) for task in (load, drive))
    np.testing.assert_array_equal(a.torques, b.torques)
    assert load.robot.energy(motion) == pytest.approx(237.6, abs=0.05)
    assert drive.robot.energy(motion) != pytest.approx(237.6, rel=0.01)


def test_drives_are_all_that_changes():
    usual, drive = experiment_task("B", "effective"), power_reading.task_of("B", "effective", "drive")
    assert [str(one) for one in drive.robot.obstacles] == [str(one) for one in usual.robot.obstacles] != []
    assert drive.robot.collision.labels == usual.robot.collision.labels
    assert drive.robot.slip.redistribution == usual.robot.slip.redistribution
    assert drive.limits == usual.limits


def test_rows_of_other_options_stay(tmp_path, monkeypatch, capsys):
    def planned(case, base, starts, seed, jobs):
        return {"case": case, "base": base, "reference_drive_J": 100.0 + seed, "verified": False}

    def run(*more):
        assert power_reading.main(["--out", str(tmp_path), "--bases", "printed", *more]) == 0
        return capsys.readouterr().out

    monkeypatch.setattr(power_reading, "planned", planned)
    first = run("--cases", "B")
    assert "| B | 100.0 | no plan" in first
    second = run("--cases", "A", "--seed", "1")
    assert "| A | 101.0 |" in second
    assert "| B |" not in second
    monkeypatch.setattr(power_reading, "planned", None)
    assert run("--cases", "B") == first
    monkeypatch.setattr(power_reading, "source_state", lambda *_: "new")
    assert "another state of the source code" in run("--cases", "B")
    rows = json.loads((tmp_path / "power_reading.json").read_text())["rows"]
    assert [(row["case"], row["seed"]) for row in rows] == [("B", 0), ("A", 1)]


@pytest.mark.slow
def test_a_case_is_planned_and_kept(tmp_path, monkeypatch, capsys):
    options = ["--out", str(tmp_path), "--cases", "A", "--bases", "printed", "--starts", "1", "--jobs", "1"]
    assert power_reading.main(options) == 0
    (row,) = json.loads((tmp_path / "power_reading.json").read_text())["rows"]
    assert row["verified"]
    assert row["ratio"] == pytest.approx(row["plan_drive_J"] / row["reference_drive_J"])
    first = capsys.readouterr().out
    assert f"| A | {row['reference_drive_J']:.1f} | {row['plan_drive_J']:.1f} |" in first
    monkeypatch.setattr(power_reading, "plan_motion", None)
    assert power_reading.main(options) == 0
    assert capsys.readouterr().out == first
