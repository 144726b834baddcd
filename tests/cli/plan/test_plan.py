"""`ocptip plan` around the planner: options, summary, files, exit codes. The planner itself is replaced."""

from __future__ import annotations

import io
import json
import os
import re
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from ocptip.api import plan as planning
from ocptip.api import tasks
from ocptip.api.plan import _limits
from ocptip.api.results.plan import Plan
from ocptip.basics import errors
from ocptip.basics.outputs import OUTPUTS
from ocptip.basics.write import MARK
from ocptip.certificate.checks import certified
from ocptip.cli import motion_summary, terminal
from ocptip.cli.main import main
from ocptip.cli.plan.plan_report import PlanReport
from ocptip.cli.terminal import Progress
from ocptip.motion.files.output import plan_to_dict
from ocptip.motion.objective import ENERGY, TIME, priced
from ocptip.motion.stops.check import cancels_by_segment
from ocptip.motion.tolerated import robustness
from ocptip.numerics.time_limit import TimeBudget
from ocptip.pictures import plan as motion_plots
from ocptip.published import tasks as task
from ocptip.robots.payload import Payload
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE, WORKSHOP, Uncertainty
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of, stand_in_plan
from tests.places import EXAMPLES

FILES = ["plan.json", "motion.csv", "trajectory.json", "certificate.json", "task/task.toml", "SHA256SUMS"]


def files_in(folder):
    """Names of all files in a folder and below it."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@cache
def robustness_of_c():
    """Computed once: most tests here are about everything else."""
    plan = stand_in_plan()
    return robustness(plan.task, plan.motion)


@cache
def proved_plan():
    """Proved once, likewise."""
    plan = stand_in_plan()
    robot, limits = plan.task.robot, plan.task.limits
    return replace(plan, check=certified(robot, plan.motion, plan.check, limits))


@cache
def cancels_of_c():
    plan = stand_in_plan()
    return cancels_by_segment(plan.task, plan.motion)


@pytest.fixture
def planner(monkeypatch, tmp_path):
    """Replaces the planner; `result` is what it returns or raises, `calls` are what it was given."""
    state = SimpleNamespace(result=proved_plan(), calls=[])

    def plan_motion(task, **options):
        state.calls.append((task, options))
        if progress := options.get("progress"):
            progress(0, 2, None)
            progress(1, 2, 231.04)
        if isinstance(state.result, BaseException):
            raise state.result
        if task.rise_times:
            return plan_of(state.result.task, state.result.motion.with_rise_times(task.rise_times))
        own = state.result.task
        data = None if task.source is None else replace(own.source, data=task.source.data)
        return replace(state.result, task=replace(own, source=data))

    monkeypatch.setattr("ocptip.api.plan.plan_motion", plan_motion)
    monkeypatch.setattr(planning, "plan_motion", plan_motion)
    monkeypatch.setattr("ocptip.api.results.plan.calls_begun", lambda *_: nullcontext(partial))
    monkeypatch.setattr("ocptip.api.results.plan.robustness", lambda task, motion: robustness_of_c())
    monkeypatch.setattr("ocptip.api.results.plan.cancels_by_segment", lambda task, motion: cancels_of_c())
    monkeypatch.chdir(tmp_path)
    return state


def run(capsys, *arguments):
    """Exit code, stdout, stderr."""
    code = main(["plan", *map(str, arguments)])
    return code, *capsys.readouterr()


def test_files_figures_and_summary(planner, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(motion_plots, "FIGURES", {"motion": motion_plots.FIGURES["motion"]})
    code, out, err = run(capsys, "C")
    assert (code, err) == (0, "")  # piped: no progress bar
    lines = out.splitlines()
    assert lines[0] == "C   PROVED for the nominal model only (no uncertainty)"
    assert lines[1] == "Motion  2.126 s   221.9 J (+0 % vs reference)   trapezoidal profiles"
    moment = planner.result.check.contacts.moment
    tip = next(line for line in lines if line.startswith("Tipping margin"))
    assert f" {moment.value:.3g} N m @{moment.time:.3f}s  >= " in tip
    assert [line for line in lines if line.endswith("<- critical")] == [tip]
    assert any(line.startswith("Robust to (one at a time): tilt ") for line in lines)
    directory = tmp_path / "ocptip-plan-C"
    names = [*FILES, "motion.png"]
    assert (
        lines[-2]
        == f"Files   ocptip-plan-C/: plan.json, motion.csv, trajectory.json and {len(names) - 3} more"
    )
    assert lines[-1] == "Next    ocptip view ocptip-plan-C, ocptip check ocptip-plan-C --stops path"
    assert files_in(directory) == sorted(names)
    assert all(len(line) <= 80 for line in lines)
    assert out.isascii()
    assert (directory / "motion.png").read_bytes().startswith(b"\x89PNG")


def test_a_missing_package_has_its_install_command(monkeypatch):
    monkeypatch.setattr(motion_summary, "find_spec", lambda name: None)
    assert "pip install 'ocptip[view]' for ocptip view {0}" in motion_summary._following()


def test_requirements_decide_the_exit_code_and_quiet_shows_what_is_not_met(planner, capsys, tmp_path):
    report = tmp_path / "report.xml"
    asked = "C", "--no-figures", "--junit", report, "--require", "duration <= 9 s, tipping margin >= 900 N m"
    code, out, _ = run(capsys, *asked, "-q")
    head, unmet = out.splitlines()
    assert (code, head) == (1, "C   PROVED for the nominal model only (no uncertainty)")
    assert unmet.startswith("tipping margin >= 900 N m: ")
    assert unmet.endswith("NOT MET")
    code, out, _ = run(capsys, "C", "--no-figures", "--require", "duration <= 9 s", "-q")
    assert (code, out.splitlines()) == (0, [head, "all requirements met"])
    suite = ElementTree.parse(report).getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("3", "1")
    code, out, _ = run(capsys, *asked)
    assert code == 1
    assert "Require duration <= 9 s: 2.13 s   met" in out
    code, _, err = run(capsys, "A", "B", "--require", "duration <= 9 s")
    assert (code, err) == (2, "ocptip: --require: is for one task, got 2\n")


def test_a_junit_report_names_the_broken_limits(planner, capsys, tmp_path):
    planner.result = stand_in_plan("B")
    report = tmp_path / "report.xml"
    assert run(capsys, "B", "--no-figures", "--junit", report)[0] == 1
    (failure,) = ElementTree.parse(report).getroot().iter("failure")
    assert failure.get("message").startswith("LIMITS BROKEN; tipping margin is ")
    terminal.latest.quiet = False


def test_stages_after_the_search_are_shown(planner):
    shown = []
    Plan.of(planner.result, stage=shown.append)
    assert shown[0] == "checking what is run ..."
    assert shown[1:3] == ["checking stops and cancels ...", "finding which deviations lose no contact ..."]
    assert shown[3:] == ["proving what is run ..."]


def test_figures_that_are_drawn_while_others_check_show_the_whole_result(planner, monkeypatch, tmp_path):
    monkeypatch.setattr(motion_plots, "FIGURES", {"drives": motion_plots.FIGURES["drives"]})
    Plan.of(planner.result).save(tmp_path / "after")
    monkeypatch.setattr(
        "ocptip.api.results.plan.calls_begun", lambda *_: nullcontext(lambda *call: partial(*call))
    )
    shown = []
    plan = Plan.of(stand_in_plan(), figures=True, stage=shown.append)
    assert shown[-3:] == ["proving what is run ...", "drawing figures ...", shown[-1]]
    assert [one.quantity for one in plan.robustness] == [one.quantity for one in robustness_of_c()]
    plan.save(tmp_path / "meanwhile")
    names = [tmp_path / when / "drives.png" for when in ("after", "meanwhile")]
    assert names[0].read_bytes() == names[1].read_bytes() == plan.pngs["drives.png"]


def test_without_time_checks_are_left_out_and_named(planner):
    plan = Plan.of(stand_in_plan("C"), budget=TimeBudget(0.0), time_scale=[0.99])
    points = "check of the points in trajectory.json"
    assert plan.left_out == (points, "robustness", "time scales", "safe decelerations of cancels")
    assert plan.executions[0].points.times[-1] == pytest.approx(plan.motion.end)
    assert "trajectory" not in plan.to_dict()
    assert plan.verified
    text = " ".join(PlanReport(plan).to_text().split())
    assert "the time was up or it was interrupted: check of the points in trajectory.json," in text
    assert plan.to_dict()["left_out"] == list(plan.left_out)
    unknown = replace(plan, left_out=("stops",))
    assert not unknown.verified
    assert unknown.headline.endswith("; stops NOT CHECKED, the time was up")


def test_an_interrupt_ends_one_check_and_those_after_it():
    def interrupted():
        raise KeyboardInterrupt

    budget = TimeBudget(None)
    assert budget.within(interrupted, "without", "first") == "without"
    assert budget.within(lambda: "made", "without", "second") == "without"
    assert budget.left_out == ["first", "second"]
    assert TimeBudget(None).within(lambda: "made", "without", "first") == "made"


def test_options_reach_the_planner(planner, capsys, tmp_path):
    numbers = ["--starts", 5, "--seed", 7, "--jobs", 2]
    limits = ["--gn", 0.8, "--gt", 0.7, "--torque-ratio", 0.5, "--clearance", 0.02]
    code, *_ = run(capsys, "C", "--no-figures", "--out", tmp_path / "x", *numbers, *limits)
    assert code == 0
    (given, options), *_ = planner.calls
    assert (options["starts"], options["seed"], options["jobs"]) == (5, 7, 2)
    assert given.limits == Limits(GN=0.8, GT=0.7, torque_ratio=0.5, clearance=0.02, tolerance=WORKSHOP)
    assert files_in(tmp_path / "x") == sorted(FILES)


def test_a_plan_has_workshop_tolerance_unless_file_or_option_says_otherwise(
    planner, without_robustness, capsys, tmp_path
):
    (tmp_path / "free.toml").write_text('case = "C"\n')
    (tmp_path / "own.toml").write_text('case = "C"\n[tolerance]\nfriction = 0.1\n')
    (tmp_path / "none.toml").write_text('case = "C"\n[tolerance]\npreset = "none"\n')
    delta = EXAMPLES / "tasks" / "delta_cart.toml"
    for arguments in (
        ["C"],
        ["free.toml"],
        ["own.toml"],
        ["none.toml"],
        ["C", "--tolerance", "none"],
        [delta],
    ):
        run(capsys, *arguments, "--no-figures", "--overwrite")
    given = [task.limits.tolerance for task, _ in planner.calls]
    assert given == [WORKSHOP, WORKSHOP, Uncertainty(friction=0.1), NONE, NONE, NONE]


@pytest.mark.parametrize(
    ("arguments", "objective", "durations"),
    [
        ([], ENERGY, (0.0, np.inf)),
        (["--objective", "time", "--max-duration", 2], TIME, (0.0, 2.0)),
        (["--price-per-second", 30, "--duration", 1.5], priced(30.0), (1.5, 1.5)),
    ],
)
def test_what_is_least_and_how_long_it_may_take(planner, capsys, arguments, objective, durations):
    run(capsys, "C", "--no-figures", *arguments)
    (given, _), *_ = planner.calls
    assert given.objective == objective
    assert (given.limits.min_duration, given.limits.max_duration) == durations


def test_a_controller_gets_points_and_the_verdict_is_of_its_motion(planner, capsys, tmp_path):
    code, out, _ = run(capsys, "C", "--no-figures", "--out", tmp_path / "x", "--controller", "quintic")
    assert code == 0
    assert "executed by quintics between points; all numbers" in " ".join(out.split())
    data = json.loads((tmp_path / "x" / "plan.json").read_text())
    run_by = data["controller"]
    assert f"Motion  {run_by['duration_s']:.3f} s   {run_by['energy_J']:.4g} J" in out
    points = json.loads((tmp_path / "x" / "trajectory.json").read_text())["points"]
    assert all(point["accelerations"] and not point["effort"] for point in points)


@pytest.mark.parametrize(("arguments", "mass"), [([], 3.45), (["--base", "printed"], 6.582)])
def test_contacts_bind_with_the_default_base(planner, capsys, tmp_path, arguments, mass):
    assert run(capsys, "C", *arguments, "--no-figures")[0] == 0
    assert planner.calls[0][0].robot.support.mass == mass
    data = json.loads((tmp_path / "ocptip-plan-C" / "plan.json").read_text(encoding="utf-8"))
    assert data["base"] == (arguments or ["effective"])[-1]
    motion = Trajectory.from_dict(data)
    np.testing.assert_allclose(motion.states(0.7)[0], planner.result.motion.states(0.7)[0], atol=1e-12)


def test_a_task_file_and_limits_over_those_of_the_file(planner, capsys, tmp_path, monkeypatch):
    read = task.experiment_task("C", "effective", Limits(GN=0.5, GT=0.6))
    read = replace(read, source=replace(read.source, data={"case": "C"}))
    monkeypatch.setattr(tasks, "read_task", lambda path, otherwise: read)
    assert run(capsys, "my.toml", "--no-figures", "--gt", 0.8)[0] == 0
    assert planner.calls[0][0].limits == Limits(GN=0.5, GT=0.8)
    assert "base" not in json.loads((tmp_path / "ocptip-plan-C" / "plan.json").read_text(encoding="utf-8"))
    assert run(capsys, "my.toml", "--no-figures")[0] == 0
    assert planner.calls[1][0] is read


def test_json_is_that_of_the_file_and_the_paths(planner, capsys, tmp_path):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    code, out, err = run(capsys, "C", "--json", "--no-figures", "--time-scale", 1.2)
    assert (code, err) == (0, "")
    printed = json.loads(out, parse_constant=refuse)
    assert printed.pop("written") == [f"ocptip-plan-C/{name}" for name in FILES]
    assert printed == json.loads((tmp_path / "ocptip-plan-C" / "plan.json").read_text(encoding="utf-8"))
    assert set(printed) == set(plan_to_dict(planner.result)) | {
        *("base", "cancel", "margins", "time_scale", "warnings", "tolerated", "trajectory", "digest")
    }
    assert printed["time_scale"][0]["factor"] == 1.2


def test_time_scale_says_what_still_stands(planner, capsys):
    planner.result = stand_in_plan("B", limits=Limits(GN=0.999))
    code, out, _ = run(capsys, "B", "--no-figures", "--tolerance", "none", "--time-scale", 1.1, 0.999, 0.5)
    assert code == 0  # the plan itself is verified
    slower, quicker, quick = (line for line in out.splitlines() if line.startswith("Times x"))
    assert re.fullmatch(r"Times x 1.1: all limits kept, [\d.]+ J in [\d.]+ s", slower)
    assert quicker.startswith("Times x 0.999: ")
    assert quick.startswith("Times x 0.5: NOT STABLE, ")
    assert "a contact slips or lifts off" in " ".join(out.split())


@pytest.mark.slow
def test_time_scale_beyond_a_limit_but_standing():
    plan = Plan.of(stand_in_plan("C", limits=Limits(GN=0.89)), time_scale=[0.99])
    assert "Times x 0.99: LIMITS BROKEN, " in PlanReport(plan).to_text()
    assert plan.to_dict()["time_scale"][0]["stands"] is True


def test_without_a_reference_there_is_no_ratio(planner, capsys):
    planner.result = stand_in_plan(reference=False)
    _, out, _ = run(capsys, "C", "--no-figures")
    assert "reference" not in out


def test_an_interrupted_search_keeps_the_best(planner, capsys):
    planner.result = stand_in_plan(interrupted=True)
    code, out, _ = run(capsys, "C", "--no-figures")
    assert code == 0
    assert "Note    interrupted: this is the best of the starts that had finished\n" in out


def test_interrupted_before_anything_was_found(planner, capsys, tmp_path):
    planner.result = KeyboardInterrupt()
    code, out, err = run(capsys, "C")
    assert (code, out) == (130, "")
    assert err == "ocptip: interrupted before there was a verified plan\n"
    assert list(tmp_path.iterdir()) == []


def test_no_verified_plan_is_exit_code_1(planner, capsys, tmp_path):
    planner.result = errors.PlanningError("none of 8 starts: GN is 0.912 at 1.2 s, must be <= 0.9")
    code, out, err = run(capsys, "C")
    assert (code, err) == (1, "")
    head, within, held = out.splitlines()
    assert head == "C: NO VERIFIED PLAN. none of 8 starts: GN is 0.912 at 1.2 s, must be <= 0.9"
    assert within.startswith(
        "within   base mass +-5 %, friction -20 %, floor tilt 0.5 deg, arm masses +-5 %, "
    )
    assert "payload" not in within  # nothing is held
    assert within.endswith("; --tolerance none plans for the nominal model")
    assert held == "masses   base 3.45 kg, arm 15.71 kg; together 19.16 kg"
    code, out, _ = run(capsys, "C", "--json")
    assert code == 1
    data = json.loads(out)
    assert (data["case"], data["verified"], data["status"]) == ("C", False, str(planner.result))
    assert list(tmp_path.iterdir()) == []


def test_a_plan_that_is_not_verified_says_what_it_breaks(planner, capsys):
    planner.result = stand_in_plan("B")
    code, out, _ = run(capsys, "B", "--no-figures")
    assert code == 1
    lines = out.splitlines()
    assert lines[0] == "B   LIMITS BROKEN"
    assert lines[2].startswith("Broken  tipping margin is ")
    assert [line.split()[:2] for line in lines if line.endswith("BROKEN")] == [
        ["B", "LIMITS"],
        ["Tipping", "margin"],
    ]


def test_refused_tasks_are_exit_code_2(planner, capsys, tmp_path):
    planner.result = errors.InputError("start: collision of link 3 with the floor, 12 mm deep")
    code, out, err = run(capsys, "C")
    assert (code, out) == (2, "")
    assert err == "ocptip: start: collision of link 3 with the floor, 12 mm deep\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["K"], "K: neither a case (A to H) nor a task file (.toml)"),
        (["nowhere.toml"], "nowhere.toml: no such file"),
        (["nowhere.toml", "--base", "printed"], "--base: belongs to the cases A to H"),
        (["C", "--starts", "0"], "--starts: must be >= 1, got 0"),
        (["C", "--jobs", "0"], "--jobs: must be >= 1, got 0"),
        (["C", "--seed", "-1"], "--seed: must be >= 0, got -1"),
        (["C", "--gn", "0"], "--gn: must be above 0 and at most 1"),
        (["C", "--gt", "5"], "--gt: must be above 0 and at most 1"),
        (["C", "--torque-ratio", "nan"], "--torque-ratio: must be finite"),
        (["C", "--clearance", "-0.1"], "--clearance: must be >= 0"),
        (["C", "--time-scale", "0.9", "0"], "--time-scale: must be > 0"),
        (["C", "--duration", "1", "--max-duration", "2"], "--duration: give either"),
        (["C", "--max-duration", "0"], "--max-duration: must be > 0"),
        (["C", "--duration", "inf"], "--duration: must be finite"),
        (["C", "--objective", "time", "--price-per-second", "2"], "price_per_second: belongs to"),
        (["C", "--controller", "quintic", "--rise-time", "0"], "--rise-time: must be > 0"),
        (["C", "--controller", "linear", "--rate", "nan"], "--rate: must be finite"),
        (["C", "--objective", "both"], "objective: both needs price_per_second"),
        (["C", "--price-per-second", "-1"], "price_per_second: must be > 0"),
        (["C", "--out", "{dir}/a/b"], "--out: no such directory: {dir}/a"),
        (["C", "--out", "{dir}/file"], "--out: {dir}/file is not a directory"),
    ],
)
def test_bad_input_is_one_line_before_anything_is_computed(planner, capsys, tmp_path, arguments, expected):
    (tmp_path / "file").write_text("")
    code, out, err = run(capsys, *(a.format(dir=tmp_path) for a in arguments))
    assert (code, out) == (2, "")
    assert err.startswith(f"ocptip: {expected.format(dir=tmp_path)}")
    assert err.count("\n") == 1
    assert planner.calls == []
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    "arguments", [["plan"], ["plan", "C", "--base", "x"], ["plan", "C", "--starts", "1.5"]]
)
def test_wrong_command_line_is_one_line(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_disk_that_is_full_costs_files_but_not_the_result(planner, capsys, monkeypatch):
    def full_disk(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full_disk)
    code, out, err = run(capsys, "C", "--json")
    assert code == 2
    assert json.loads(out)["written"] == []
    assert json.loads(out)["commands"] == planner.result.motion.to_dict()["commands"]
    assert err == "ocptip: ocptip-plan-C/plan.json: No space left on device\n"


def test_figures_are_only_drawn_when_wanted(planner, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "ocptip.pictures.plan", None)  # its import would fail
    assert run(capsys, "C", "--no-figures")[0] == 0


def test_progress_bar_on_a_terminal_is_erased_at_the_end(planner, capsys, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert main(["plan", "C", "--no-figures"]) == 0
    shown = terminal.getvalue().split("\r")
    assert "building" in shown[1]
    assert re.fullmatch(r"\[\.{24}\] 0/2 search steps, no verified plan yet, \d+ s\x1b\[K", shown[2])
    assert re.fullmatch(r"\[#{12}\.{12}\] 1/2 search steps, best 231\.0 J, \d+ s\x1b\[K", shown[3])
    assert shown[-1] == "\x1b[K"
    assert [text for text in shown if len(text) >= 80] == []


def test_progress_says_nothing_into_a_pipe():
    pipe = io.StringIO()
    with Progress(pipe, "building ...", "none yet", "best {:.1f} J") as progress:
        progress(1, 2, 3.0)
    assert pipe.getvalue() == ""


def test_files_of_others_are_not_replaced(planner, capsys, tmp_path):
    other = tmp_path / "ocptip-plan-C"
    other.mkdir()
    for name in ("motion.png", "notes.txt"):
        (other / name).write_text("mine")
    code, out, err = run(capsys, "C", "--no-figures")
    assert (code, out) == (2, "")
    assert err == (
        "ocptip: --out: ocptip-plan-C holds files that ocptip plan did not write and would replace: "
        "motion.png; choose another directory, or --overwrite\n"
    )
    assert not planner.calls
    (other / "plan.json").write_text('{"energy_J": 3}')  # not from ocptip
    assert run(capsys, "C", "--no-figures")[0] == 2
    assert run(capsys, "C", "--no-figures", "--overwrite")[0] == 0
    assert files_in(other) == sorted([*FILES, "notes.txt", "motion.png"])


def test_figures_of_an_earlier_plan_are_removed(planner, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(motion_plots, "FIGURES", {"motion": motion_plots.FIGURES["motion"]})
    assert run(capsys, "C", "--no-figures")[0] == 0
    directory = tmp_path / "ocptip-plan-C"
    for name in ("motion.png", "drives.png", "mine.png"):
        (directory / name).write_text(f"old, {MARK}")
    assert run(capsys, "C", "--no-figures")[0] == 0
    assert files_in(directory) == sorted([*FILES, "mine.png"])
    (directory / "motion.png").write_text("mine")
    assert run(capsys, "C", "--no-figures")[0] == 2
    assert run(capsys, "C", "--no-figures", "--overwrite")[0] == 0  # replaces, but does not delete
    assert (directory / "motion.png").read_text() == "mine"
    assert run(capsys, "C", "--overwrite")[0] == 0
    assert MARK.encode() in (directory / "motion.png").read_bytes()
    assert run(capsys, "C", "--no-figures")[0] == 0
    assert files_in(directory) == sorted([*FILES, "mine.png"])


def test_the_names_of_all_files_are_known():
    figures = [f"{name}.png" for name in (*motion_plots.FIGURES, "feet", "gears", "stops")]
    assert OUTPUTS["plan"] == (*FILES, *figures)


def test_a_plan_says_what_the_arm_holds(planner, capsys, tmp_path):
    read = task.experiment_task("C", "effective")
    held = read.robot.varied(arm=read.robot.arm.with_payload(Payload(2.0, [0, 0, 0.1])))
    task_of_held = replace(planner.result.task, robot=held)
    planner.result = replace(planner.result, task=task_of_held)
    _, out, _ = run(capsys, "C", "--no-figures", "-v")
    payload = "payload 2 kg (point mass at (0, 0, 0.1) m)"
    assert f"base 3.45 kg, arm 15.71 kg, {payload}; together 21.16 kg" in " ".join(out.split())
    data = json.loads((tmp_path / "ocptip-plan-C" / "plan.json").read_text(encoding="utf-8"))
    assert data["payload"] == {"mass": 2.0, "center_of_mass": [0.0, 0.0, 0.1]}
    assert data["masses_kg"] == pytest.approx({"base": 3.45, "arm": 15.711, "payload": 2.0, "total": 21.161})


@pytest.fixture
def computed(monkeypatch):
    """What a plan for stops computes, in its order; nothing of it takes time."""
    order = []

    def stands_for(name, result):
        def compute(*_, **how):
            order.append((name, how.get("decelerations", True)))
            return result

        return compute

    monkeypatch.setattr("ocptip.api.results.plan.stops_by_segment", stands_for("stops", {}))
    monkeypatch.setattr("ocptip.api.results.plan.robustness", stands_for("robustness", robustness_of_c()))
    monkeypatch.setattr("ocptip.api.results.plan.cancels_by_segment", stands_for("cancels", {}))
    return order


def stoppable_stand_in():
    """A plan that has to be stoppable along its path."""
    planned = stand_in_plan("C")
    limits = replace(planned.task.limits, stops=planned.task.stops.asked(planned.task.limits).stops)
    return replace(planned, task=replace(planned.task, limits=limits))


@pytest.mark.parametrize(("seconds", "optional"), [(60.0, "last"), (None, "first")])
def test_in_limited_time_stops_and_proof_come_before_what_is_optional(
    monkeypatch, computed, seconds, optional
):
    """Without a limit the proof is last, for an interrupt ends it; ranges of decelerations are optional."""

    def prove(part, _):
        computed.append(("proof", True))
        return part

    monkeypatch.setattr("ocptip.api.methods.certified", lambda robot, motion, check, limits: check)
    monkeypatch.setattr("ocptip.api.results.plan.proved_part", prove)
    plan = Plan.of(stoppable_stand_in(), budget=TimeBudget(seconds))
    names = [name for name, _ in computed]
    others, proof = ["robustness", "cancels"], ["proof"]
    assert names == ["stops", *(proof + others if optional == "last" else others + proof)]
    assert computed[0] == ("stops", seconds is None)
    assert plan.left_out == ()


def test_a_proof_that_runs_out_of_time_leaves_some_for_robustness_and_is_not_begun_again(
    monkeypatch, computed
):
    def prove(*_):
        time.sleep(60.0)

    def again(*_):
        raise AssertionError("another proof")

    monkeypatch.setattr("ocptip.api.methods.certified", again)
    monkeypatch.setattr("ocptip.api.results.plan.proved_part", prove)
    monkeypatch.setattr("ocptip.motion.files.execution.execute", lambda *_, **__: None)
    plan = Plan.of(stoppable_stand_in(), budget=TimeBudget(1.0))
    assert plan.robustness
    assert "robustness" not in plan.left_out
    assert "a proof: the time was up before it was complete" in plan.unproved


def test_plans_for_stops_keep_more_time_for_checks_and_proofs():
    task = stand_in_plan("C").task
    stoppable = stoppable_stand_in().task
    assert _limits(200.0, task) == (195.0, pytest.approx(140.0))
    assert _limits(200.0, stoppable) == (195.0, pytest.approx(100.0))
    assert _limits(None, stoppable) == (None, None)
