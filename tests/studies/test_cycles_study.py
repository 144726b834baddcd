"""The study of cycles of foreign arms: its files, its report; it plans nothing here."""

import tomllib

import numpy as np
import pytest

from ocptip.task_files.cycle import load_cycle
from studies.cycles.run import DWELL, cycle_text, report
from studies.foreign_arms.run import task_text, template_of
from tests.studies.robots.test_foreign_arms import ARM
from tests.task_files.test_arm_files import ON_A_LIFT


@pytest.fixture
def text(tmp_path):
    (tmp_path / "lift.urdf").write_text(ON_A_LIFT, encoding="utf-8")
    return task_text(ARM, template_of(ARM, tmp_path / "lift.urdf", tmp_path), 0, {}, spheres=0.03)


def test_a_cycle_begins_half_way_and_carries(text, tmp_path):
    (tmp_path / "task.toml").write_text(cycle_text(text, ARM, 2.0, "time"), encoding="utf-8")
    task = load_cycle(tmp_path / "task.toml")
    loads = [segment.task.robot.payload for segment in task.segments]
    assert [load and load.mass for load in loads] == [None, 2.0, None]
    assert [segment.dwell for segment in task.segments] == [DWELL, DWELL, 0.0]
    assert {segment.task.objective.name for segment in task.segments} == {"time"}
    ends = [segment.task.goal for segment in task.segments]
    np.testing.assert_allclose(task.starts[0], 0.5 * (ends[0] + ends[1]), atol=1e-12)
    np.testing.assert_allclose(ends[2], task.starts[0])
    empty = tomllib.loads(cycle_text(text, ARM, 0, "energy"))
    assert "payload" not in empty["segment"][1]


def test_the_report_says_what_was_not_run_or_not_verified():
    back = {"verified": True, "reason": "", "energy_off": 3e-6, "worst_off": {"GN": 2e-9}}
    good = {"verdict": "verified", "reason": "", "cpu_s": 9.0, "energy_J": 80.0, "duration_s": 3.0, "GN": 0.5}
    good |= {"GT": 0.4, "torque_ratio": 0.3, "clearance_m": 0.02, "read_back": back}
    rows = [
        {"arm": "Lift", "payload_kg": 0, "objective": "energy", **good},
        {
            "arm": "Lift",
            "payload_kg": 2,
            "objective": "energy",
            "verdict": "no plan",
            "reason": "tips",
            "cpu_s": 1,
        },
        {
            "arm": "Lift",
            "payload_kg": 2,
            "objective": "time",
            **good,
            "read_back": {**back, "verified": False},
        },
    ]
    data = {"rows": rows, "starts": 1, "source": "x", "machine": {"cores": 4}, "not_run": ["Crane (4 of 4)"]}
    said = report(data)
    assert "3 cycles of three segments (Lift), 2 planned and verified; of these 1 verified again" in said
    assert "| Lift | 0 | energy | verified | 80.0 | 3.00 | 0.500 |" in said
    assert "| NOT verified |" in said
    assert "- Lift, 2 kg, energy: tips" in said
    assert "Not run: Crane (4 of 4)." in said
    assert "- GN: read back and planned differ by at most 2.0e-09" in said
