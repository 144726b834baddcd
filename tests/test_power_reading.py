"""The study of the literal reading of the power maps: same motion, both readings, and the table."""

import json

import numpy as np
import power_reading
import pytest


def test_readings_differ_in_power_only():
    load, drive = (power_reading.task_of("B", "effective", r) for r in ("load", "drive"))
    assert load.robot.tip_over.reference_moment == drive.robot.tip_over.reference_moment
    motion = load.reference
    a, b = (task.robot.samples(motion, np.linspace(0, motion.end, 50)) for task in (load, drive))
    np.testing.assert_array_equal(a.torques, b.torques)
    assert load.robot.energy(motion) == pytest.approx(237.6, abs=0.05)
    assert drive.robot.energy(motion) != pytest.approx(237.6, rel=0.01)


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
