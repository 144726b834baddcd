"""The study of postures: its tasks, what it leaves out, what it calls found."""

import numpy as np
import pytest

from ocptip.motion.choices import plainest_cost
from studies.postures.redundancy import report as redundancy_report
from studies.postures.run import Runs, report, study
from studies.postures.tasks import HOPELESS, branch_task, hopeless, plannable_pairs


@pytest.mark.slow
def test_tasks_are_those_of_their_number():
    first, again, other = branch_task(1), branch_task(1), branch_task(4)
    np.testing.assert_array_equal(first.goal, again.goal)
    assert np.abs(first.goal - other.goal).max() > 0.1
    assert len(first.choices) >= 3
    assert first.targets[0] is None
    assert branch_task(7).targets[0] is not None


@pytest.mark.slow
def test_what_is_left_out_is_dear():
    pairs = plannable_pairs(branch_task(1))
    costs, without = [plainest_cost(pair) for pair in pairs], hopeless(pairs)
    assert 0 < len(without) < len(pairs)
    for k, cost in enumerate(costs):
        assert (k in without) == (cost > HOPELESS * min(costs))


@pytest.mark.slow
def test_a_task_of_the_study(tmp_path):
    """Started again it runs nothing."""
    runs = Runs(tmp_path / "runs.jsonl", 0)
    row = study(runs, 1, False, 0)
    assert row["best"] <= row["second"]
    assert row["chosen"] == pytest.approx(row["best"])
    assert row["rank"] == 1
    text = (tmp_path / "runs.jsonl").read_text()
    assert study(Runs(tmp_path / "runs.jsonl", 0), 1, False, 0) == row
    assert (tmp_path / "runs.jsonl").read_text() == text
    missed = {**row, "chosen": 1.01 * row["best"], "rank": 0}
    assert "found in 1 of 2 tasks" in report([row, missed])
    assert "not planned" in report([row, missed])


def test_the_table_of_seven_axes():
    rows = [{"task": 0, "name": "arm 0", "kind": "plan", "k": 0, "energy": 50.5}]
    rows += [{**rows[0], "kind": "random", "k": k, "energy": e} for k, e in enumerate((50.0, 60.0, None))]
    assert "| arm 0 | 50.50 | 50.00 | 55.0 | +1.0 % | 2 |" in redundancy_report([rows])
