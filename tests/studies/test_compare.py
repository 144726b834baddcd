"""The comparison with Nelder-Mead, tiny: every method runs, it goes on where it stopped, figures are true."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.trajectories.trajectory import Trajectory
from studies.compare import run as study
from studies.compare import runs as compare_runs
from studies.compare.methods import METHODS as ALL_METHODS
from studies.compare.methods import Settings
from studies.compare.runs import BASE, NO_MOTION, Runs, run_one, slowed
from studies.compare.summary import markdown, restarted, statistics

METHODS = ["nelder-mead", "nelder-mead-plain", "slsqp"]


def command(out, *more):
    """The arguments of a short run of case A."""
    options = ["--cases", "A", "--starts", "1", "--max-seconds", "0.4", "--jobs", "1"]
    return ["--out", str(out), *options, *more]


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Folder, records, rows of one start of case A; the seconds of ours are set, so that CMA-ES ends soon."""
    out = tmp_path_factory.mktemp("compare")
    assert study.main(command(out, "--methods", *METHODS)) == 0
    settings = Settings(max_seconds=0.4)
    runs = Runs(out / "runs.jsonl", settings)
    runs.add(run_one("A", 0, "ours", settings) | {"wall_s": 0.05, "cpu_s": 0.05})
    assert study.main(command(out, "--methods", "ours", "cma", *METHODS)) == 0
    runs = Runs(out / "runs.jsonl", Settings(max_seconds=0.4))
    rows = json.loads((out / "compare_nelder_mead.json").read_text())["rows"]
    return out, runs.records, rows


@pytest.mark.slow
def test_every_method_improves_and_says_what_it_did(short):
    pytest.importorskip("cma")
    _, records, _ = short
    assert {key[2] for key in records} == set(ALL_METHODS)
    for (_, _, method), r in records.items():
        if method == "ours":
            continue
        assert r["cost"] <= r["start_cost"]
        assert r["history"][-1][2] == pytest.approx(r["cost"], rel=1e-6)
        costs = [cost for _, _, cost in r["history"]]
        assert costs == sorted(costs, reverse=True)
        assert r["evaluations"] > 20
        assert r["cpu_s"] < 3
        assert r["status"]


@pytest.mark.slow
def test_energy_and_check_are_those_of_the_motion_written(short):
    _, records, _ = short
    r = records["A", 0, "nelder-mead"]
    task = experiment_task("A", BASE)
    motion = Trajectory.from_dict(r["motion"])
    checked = check_motion(task.robot, motion, task.limits)
    assert r["energy_J"] == pytest.approx(checked.energy, rel=1e-9)
    assert r["verified"] == checked.verified
    assert r["worst"]["GN"] == pytest.approx(checked.worst["GN"].value, rel=1e-6)
    assert r["inside_bounds"]


@pytest.mark.slow
def test_cma_gets_ten_times_the_time_of_ours(short):
    pytest.importorskip("cma")
    _, records, _ = short
    assert records["A", 0, "cma"]["limit_s"] == pytest.approx(10 * records["A", 0, "ours"]["cpu_s"])


@pytest.mark.slow
def test_rows_compare_with_ours_from_the_same_start(short):
    _, records, rows = short
    by_method = {row["method"]: row for row in rows}
    ours, other = (records["A", 0, method] for method in ("ours", "nelder-mead"))
    row = by_method["nelder-mead"]
    assert row["runs"] == 1
    assert row["ours_lower"] == float(ours["energy_J"] <= other["energy_J"]) == 1.0
    reached = next(t for t, _, cost in other["history"] if cost <= 1.01 * other["cost"])
    assert row["times_faster"] == pytest.approx(reached / 0.05)
    assert row["times_faster_total"] == pytest.approx(other["cpu_s"] / 0.05)
    assert by_method["ours"]["ours_lower"] is None
    within = [t for t, _, cost in other["history"] if cost <= 1.01 * ours["energy_J"]]
    assert row["reach_ours"] == float(bool(within))
    assert row["times_longer"] == (pytest.approx(within[0] / 0.05) if within else None)


@pytest.mark.slow
def test_files_are_there_and_nothing_is_printed_but_the_table(short, capsys):
    out, _, _ = short
    for name in ("compare_energies.png", "compare_convergence.png", "compare_motions.png"):
        assert (out / name).stat().st_size > 10_000
    capsys.readouterr()
    assert study.main(command(out, "--methods", "nelder-mead")) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out == (out / "compare_nelder_mead.md").read_text()
    assert len([line for line in printed.out.splitlines() if line.startswith("| A |")]) == 1


@pytest.mark.slow
def test_goes_on_after_a_kill_in_the_middle_of_a_line(short, tmp_path, monkeypatch):
    out, records, _ = short
    text = (out / "runs.jsonl").read_text()
    (tmp_path / "runs.jsonl").write_text(text[:-30])  # the last record is broken
    asked = []

    def stand_in(*key_and_more):
        asked.append(key_and_more[:3])
        return records[key_and_more[:3]]

    monkeypatch.setattr(compare_runs, "run_one", stand_in)
    methods = [key[2] for key in records]
    assert study.main(command(tmp_path, "--methods", *methods)) == 0
    assert len(asked) == 1
    assert asked[0] == list(records)[-1]
    assert (tmp_path / "runs.jsonl").read_text() == text


@pytest.mark.slow
def test_other_settings_need_another_folder(short, capsys):
    out, _, _ = short
    assert study.main(command(out, "--methods", "nelder-mead", "--seed", "3")) == 1
    assert "other settings" in capsys.readouterr().err


@pytest.mark.slow
def test_slowing_finds_the_least_factor_that_is_verified():
    task = experiment_task("B", BASE)
    motion = task.reference.time_scaled(0.9)
    found = slowed(task, motion, check_motion(task.robot, motion, task.limits))
    factor = found["factor"]
    assert 1.0 < factor < 1.5
    slow, less = (
        check_motion(task.robot, motion.time_scaled(f), task.limits) for f in (factor, factor - 0.003)
    )
    assert slow.verified
    assert not less.verified
    assert found["energy_J"] == pytest.approx(slow.energy)
    assert slowed(task, motion.time_scaled(2), slow)["factor"] == 1.0


def test_medians_count_missing_results_as_infinite():
    empty = {"case": "A", "method": "ours", "cpu_s": 1.0, "evaluations": 5} | NO_MOTION
    row = statistics([empty | {"start": 0}], {})
    assert row["energy_J"] == row["least_J"] == np.inf
    assert "none" in markdown([{"case": "A", "method": "ours", **row}], [])


@pytest.mark.parametrize(
    "wrong", [["--starts", "0"], ["--max-seconds", "0"], ["--cases", "Z"], ["--methods", "simplex"]]
)
def test_wrong_arguments_are_refused(tmp_path, wrong, capsys):
    with pytest.raises(SystemExit):
        study.main(["--out", str(tmp_path), *wrong])
    assert "error" in capsys.readouterr().err


def test_restarts_count_time_per_success():
    def record(case, start, method, energy, seconds):
        return {
            "case": case,
            "start": start,
            "method": method,
            "energy_J": energy,
            "verified": True,
            "slowed": {"factor": 1.0, "energy_J": energy},
            "cpu_s": seconds,
        }

    runs = [record("A", n, "ours", e, 2.0) for n, e in enumerate((100.0, 101.0, 102.0))]
    runs += [record("A", n, "cma", e, 10.0) for n, e in enumerate((102.0, 103.0, 101.5))]
    runs += [record("A", n, "slsqp", 200.0, 4.0) for n in range(3)]
    records = {(r["case"], r["start"], r["method"]): r for r in runs}
    assert restarted(records, "A", "cma") == (pytest.approx(30 / 2 / 2), 2)
    assert restarted(records, "A", "slsqp") == (pytest.approx(12 / 2), 0)
    assert restarted(records, "A", "ours") is None
