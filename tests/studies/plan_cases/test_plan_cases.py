"""The study of the eight cases goes on where it stopped, and its tables say what its starts were."""

from __future__ import annotations

import json
import pickle
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

from ocptip.basics.errors import SolverError
from ocptip.motion.check import check_motion
from ocptip.motion.planner.attempt import Attempt, StartResult
from ocptip.published.tasks import experiment_task
from studies.plan_cases import journal as plan_cases_journal
from studies.plan_cases import run as plan_cases
from studies.plan_cases import times as plan_cases_times
from studies.ramp_gap import run as ramp_gap

CALL = ["--cases", "A", "--sets", "printed", "--jobs", "1", "--out"]
STAGES = {"start": 0.01, "coarse": 1.0, "fine": 0.5, "exact": 0.4, "check": 0.1}
ENERGIES = {1: 1.01, 2: 1.5, 3: 1.0}  # of stand-ins, as shares of the first start's


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Folder of a run of one start."""
    out = tmp_path_factory.mktemp("plan_cases")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan_cases_times, "ProcessPoolExecutor", lambda *_, **__: ThreadPoolExecutor(1))
        patch.setattr(plan_cases_times, "CALLS", 2)
        patch.setattr(plan_cases_times, "BUILDINGS", 1)
        assert plan_cases.main([*CALL, str(out), "--starts", "1"]) == 0
    return out


@pytest.fixture
def copy(study, tmp_path):
    """A copy of that folder to go on with."""
    return shutil.copytree(study, tmp_path / "out")


def results(out):
    return json.loads((out / "plan_cases.json").read_text())


class StandIn:
    """Instead of a search: the printed motion with a made-up energy; the last start is not verified.

    Args:
        first: energy of start 0, J.
    """

    def __init__(self, first):
        self.first = first

    def __call__(self, payload, number, seed):
        task = pickle.loads(payload)
        verified = number < 3
        status = "verified" if verified else "not verified: too fast"
        energy, seconds = ENERGIES[number] * self.first, 10.0 * number
        result = StartResult(number, status, energy, verified, 100 * number, seconds, seconds, 6, STAGES)
        return Attempt(result, task.reference, check_motion(task.robot, task.reference, task.limits))


def without_motion(payload, number, seed):
    """Instead of a search: no motion."""
    return Attempt(StartResult(number, "no motion", float("nan"), False, 9, 1.0, 1.0, 1, STAGES), None, None)


@pytest.mark.slow
def test_one_start(study, capsys):
    data = results(study)
    (row,) = data["rows"]
    task = experiment_task("A", "printed")
    assert row["reference"]["energy_J"] == pytest.approx(task.robot.energy(task.reference))
    assert row["ratio"] == row["plan"]["energy_J"] / row["reference"]["energy_J"] < 1
    assert (row["starts"], row["verified"], row["near"], row["failures"]) == (1, 1, 1, {})
    assert sum(row["stages_s"].values()) == pytest.approx(row["median_s"], rel=0.05)
    text = (study / "plan_cases.md").read_text()
    line = next(x for x in text.splitlines() if x.startswith("| A | 210.8 |"))
    for value in (f"{row['plan']['energy_J']:.1f}", f"{row['ratio']:.3f}", f"/ {row['plan']['GT']:.3f}"):
        assert value in line
    assert f"| {row['ratio']:.3f} (missed) |" in text
    times = data["times"]["A"]
    assert times["evaluation_s"] == pytest.approx(sum(times["parts_s"].values()))
    assert f"| A | {times['nodes']} | {times['variables']} | {times['rows']} |" in text
    for name in ("printed", "ratios"):
        assert (study / f"plan_cases_{name}.png").read_bytes().startswith(b"\x89PNG")
    plan = ramp_gap.read_plan(study / "plans", "A", "printed")
    assert check_motion(task.robot, plan).verified
    assert data["versions"]["casadi"]


@pytest.mark.slow
def test_nothing_is_run_twice(copy, monkeypatch, capsys):
    monkeypatch.setattr(plan_cases_journal, "run_start", None)
    monkeypatch.setattr(plan_cases_times, "ProcessPoolExecutor", None)
    before = {name: (copy / name).read_bytes() for name in ("plan_cases.jsonl", "plan_cases.json")}
    assert plan_cases.main([*CALL, str(copy), "--starts", "1"]) == 0
    assert {name: (copy / name).read_bytes() for name in before} == before
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out == (copy / "plan_cases.md").read_text()
    # another seed is another study
    assert plan_cases.main([*CALL, str(copy), "--seed", "1", "--summary-only"]) == 1
    assert "no finished starts" in capsys.readouterr().err


@pytest.mark.slow
def test_goes_on_after_a_line_that_was_being_written(copy, monkeypatch):
    journal = copy / "plan_cases.jsonl"
    whole = journal.read_bytes()
    broken = whole + whole[:100]
    journal.write_bytes(broken)
    assert plan_cases.main([*CALL, str(copy), "--summary-only"]) == 0
    assert journal.read_bytes() == broken
    assert "1 of 50 starts have ended" in (copy / "plan_cases.md").read_text()

    monkeypatch.setattr(plan_cases_journal, "run_start", StandIn(json.loads(whole)["energy_J"]))
    assert plan_cases.main([*CALL, str(copy), "--starts", "4", "--no-times"]) == 0
    lines = [json.loads(line) for line in journal.read_text().splitlines()]
    assert [line["number"] for line in lines] == [0, 1, 2, 3]
    (row,) = results(copy)["rows"]
    assert (row["starts"], row["verified"], row["near"], row["best"]) == (4, 3, 2, 0)
    assert row["failures"] == {"3": "not verified: too fast"}
    assert row["median_s"] == pytest.approx(15.0)
    assert row["ninety_percent_s"] == pytest.approx(27.0)
    text = (copy / "plan_cases.md").read_text()
    assert "| A | 4 | 75 % | 50 % | 15.00 | 27.00 | " in text
    assert "have ended" not in text
    assert len(json.loads((copy / "plans" / "A-printed" / "plan.json").read_text())["starts"]) == 4

    assert plan_cases.main([*CALL, str(copy), "--starts", "2", "--summary-only"]) == 0
    assert results(copy)["rows"][0]["starts"] == 2


def test_broken_line_is_named(copy, capsys):
    journal = copy / "plan_cases.jsonl"
    journal.write_text("{\n" + journal.read_text())
    assert plan_cases.main([*CALL, str(copy), "--summary-only"]) == 1
    assert "line 1 is broken" in capsys.readouterr().err


def test_two_writers_keep_each_others_starts(copy):
    path = copy / "plan_cases.jsonl"
    one, other = (plan_cases_journal.Journal(path, 0) for _ in range(2))
    (line,) = one.lines.values()
    one.add({**line, "number": 1})
    other.add({**line, "number": 2})
    with path.open("ab") as stream:
        stream.write(b'{"set": "printed", "case"')  # a third one was killed
    one.add({**line, "number": 3})
    assert [key[2] for key in plan_cases_journal.Journal(path, 0).lines] == [0, 1, 2, 3]


@pytest.mark.slow
def test_interrupt_keeps_what_is_done(copy, monkeypatch, capsys):
    def run(payload, number, seed):
        if number == 2:
            raise KeyboardInterrupt
        raise SolverError("came to grief")

    monkeypatch.setattr(plan_cases_journal, "run_start", run)
    assert plan_cases.main([*CALL, str(copy), "--starts", "4"]) == 130
    assert "start again" in capsys.readouterr().err
    (row,) = results(copy)["rows"]
    assert (row["starts"], row["verified"]) == (2, 1)
    assert "came to grief" in row["failures"]["1"]

    # what ended in an error is tried again
    monkeypatch.setattr(plan_cases_journal, "run_start", StandIn(row["plan"]["energy_J"]))
    assert plan_cases.main([*CALL, str(copy), "--starts", "4", "--no-times"]) == 0
    (row,) = results(copy)["rows"]
    assert (row["starts"], row["verified"]) == (4, 3)


def test_tables_without_any_plan(copy, monkeypatch):
    monkeypatch.setattr(plan_cases_journal, "run_start", without_motion)
    (copy / "plan_cases.jsonl").unlink()
    assert plan_cases.main([*CALL, str(copy), "--starts", "2", "--no-times"]) == 0
    (row,) = results(copy)["rows"]
    assert (row["plan"], row["ratio"], row["verified"], row["near"]) == (None, None, 0, 0)
    text = (copy / "plan_cases.md").read_text()
    assert "| A | 210.8 | - | - | 1.808 / - |" in text
    assert "| cases with a plan | all | 0 of 1 |" in text


def test_limits_of_the_sets():
    reference = plan_cases_journal.reference_check("reference", "B").worst
    limits = plan_cases_journal.task_of("reference", "B").limits
    assert reference["GN"].value == limits.GN
    assert reference["GT"].value == limits.GT
    for name in ("printed", "effective"):
        assert plan_cases_journal.task_of(name, "B").limits.GN == 0.9
    masses = [plan_cases_journal.task_of(name, "B").robot.mass for name in plan_cases_journal.SETS]
    assert masses[0] == masses[2] != masses[1]


@pytest.mark.parametrize("options", [["--starts", "0"], ["--jobs", "0"], ["--cases", "Z"], ["--seed", "-1"]])
def test_bad_options_are_refused(options, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        plan_cases.main(["--out", str(tmp_path), *options])
    assert stopped.value.code == 2
    assert options[0] in capsys.readouterr().err
