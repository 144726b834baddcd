"""Cycles that may be stopped: their files have `[stops]`, their plans keep it, folders ask for it again."""

import json

import pytest

import ocptip
from ocptip.basics.errors import InputError, PlanningError
from ocptip.cli.main import main
from ocptip.cli.plan.plan_report import PlanReport
from ocptip.retiming.among import SLOW
from ocptip.task_files.cycle import load_cycle
from tests.motion.cycles.cycle_files import CYCLE, written

BRAKES = '[stops]\nsafe = "both"\nbrake_torque_min_Nm = [2, 20, 10, 2, 2, 2]\nbrake_torque_max_Nm = {}\n'
STRONGER = "[2.5, 25, 12, 2.5, 2.5, 2.5]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Of the plan of a cycle that may be stopped, and what the command said."""
    made = tmp_path_factory.mktemp("stops")
    path, out = written(made, CYCLE + '[stops]\nsafe = "path"\nGN = 0.85\n'), made / "plan"
    quick = ["--starts", "1", "--jobs", "1", "--tolerance", "none", "--no-figures", "--json"]
    code = main(["plan", str(path), *quick, "--out", str(out)])
    return out, code


@pytest.mark.slow
def test_the_plan_keeps_every_segments_reserves_in_stops(folder):
    out, code = folder
    assert code == 0
    data = json.loads((out / "plan.json").read_text())
    assert [row["segment"] for row in data["stops"]] == ["out", "back"]
    assert all(row["verified"] and row["kinds"] == "path" for row in data["stops"])
    assert all(row["worst"]["path"]["GN"] <= 0.85 + 1e-9 for row in data["stops"])
    assert data["price_of_stops"]["energy_more"] > -0.02
    task = load_cycle(out / "task" / "task.toml")
    assert [segment.task.limits.stops.GN for segment in task.segments] == [0.85, 0.85]
    assert [segment.task.limits.stops.GT for segment in task.segments] == [0.9, 0.9]


@pytest.mark.slow
def test_the_folder_is_checked_with_its_stops(folder, capsys):
    out, _ = folder
    capsys.readouterr()
    assert main(["check", str(out)]) == 0
    said = capsys.readouterr().out
    assert "Stops of segment out\n  along the path (category 1 and 2), in the nominal" in said
    assert "largest safe share of the planned speed" in said


def test_every_segment_has_the_brakes_of_the_file(tmp_path):
    task = load_cycle(written(tmp_path, CYCLE + BRAKES.format(STRONGER)))
    for segment in task.segments:
        limits = segment.task.limits
        assert limits.brakes.greatest == (2.5, 25.0, 12.0, 2.5, 2.5, 2.5)
        assert limits.stops is not None
    with pytest.raises(InputError, match=r"stops.brake_torque_max_Nm: "):
        load_cycle(written(tmp_path, CYCLE + BRAKES.format("[1, 1, 1, 1, 1, 1]")))


GENTLE = '[stops]\nsafe = "cancel"\ncancel_deceleration_deg_s2 = {}\n'


@pytest.mark.slow
def test_a_segment_without_a_motion_for_cancels_is_slowed_until_it_has_one(tmp_path, monkeypatch):
    """Each of both, and the plan and its cancels are proved."""

    def nothing(*_):
        raise PlanningError("none of 1 starts gave a verified motion")

    monkeypatch.setattr("ocptip.api.methods._first_of", nothing)
    task = load_cycle(written(tmp_path, CYCLE + GENTLE.format(100.0)))
    plan = ocptip.plan(task, starts=3)
    assert plan.verified
    assert [part.options[SLOW] for part in plan.planned.parts] == [True, True]
    assert plan.check.certified
    assert "cancels PROVED to lose no contact" in plan.headline
    text = " ".join(PlanReport(plan).to_text().split())
    assert "a slow motion of all joints in step: the search gave no better one that keeps all limits" in text
    assert "(segment out)" in text
    assert "(segment back)" in text


def test_where_no_slow_motion_is_safe_when_cancelled_the_search_does_not_begin(tmp_path, monkeypatch):
    begun = []
    monkeypatch.setattr("ocptip.api.methods._first_of", lambda *_: begun.append(1))
    task = load_cycle(written(tmp_path, CYCLE + GENTLE.format(20000.0)))
    with pytest.raises(
        ocptip.NoPlanError, match=r"even slowly, joints in step from start to goal in .* cancel"
    ) as error:
        ocptip.plan(task, starts=3)
    assert not begun
    assert "--method direct" in str(error.value)
    assert "safe at " in error.value.cancels
