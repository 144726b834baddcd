"""Motions through the flat API: one call gives what the command says and writes."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ocptip
from ocptip.basics.errors import PlanningError
from ocptip.basics.outputs import SUMS
from ocptip.basics.read import read_json
from ocptip.basics.write import plain
from ocptip.cli.main import main
from ocptip.motion.files.output import PLAN
from ocptip.motion.files.source import TASK
from ocptip.standing.tolerance import NONE, WORKSHOP
from ocptip.trajectories.read import load_motion
from tests.places import EXAMPLES

CART = EXAMPLES / "tasks/ur5_cart.toml"

TIMES = ("seconds", "cpu_seconds")
OF_THE_COMMAND = ("digest", "warnings", "written")


@pytest.fixture(scope="module")
def task():
    return ocptip.load_task("C", uncertainty="none")


@pytest.fixture(scope="module")
def plan(task):
    return ocptip.plan(task, starts=1, time_scale=[1.2])


@pytest.fixture(scope="module")
def folder(plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "C"
    plan.save(path, figures=False)
    return path


def comparable(data):
    """Plain data without what differs between two runs, or what the command alone knows."""
    if isinstance(data, dict):
        return {key: comparable(value) for key, value in data.items() if key not in TIMES + OF_THE_COMMAND}
    return [comparable(value) for value in data] if isinstance(data, list) else data


def said(capsys, *arguments):
    """Exit code and JSON of a command."""
    capsys.readouterr()
    code = main([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_a_plan_is_what_the_command_says(plan, folder, tmp_path, capsys):
    options = ["--starts", 1, "--jobs", 1, "--tolerance", "none", "--time-scale", 1.2, "--no-figures"]
    code, data = said(capsys, "plan", "C", *options, "--out", tmp_path / "out")
    assert (code == 0) == plan.verified
    assert comparable(data) == comparable(json.loads(json.dumps(plain(plan.to_dict()))))
    assert comparable(read_json(folder / "plan.json")) == comparable(data)
    names = sorted(path.name for path in folder.rglob("*") if path.is_file())
    assert names == sorted(path.name for path in (tmp_path / "out").rglob("*") if path.is_file())


def test_a_plan_knows_everything_about_itself(plan, task):
    assert plan.verified
    assert plan.certificate.certified
    assert (plan.energy, plan.duration) == (plan.check.energy, plan.check.duration)
    np.testing.assert_allclose(plan.motion.goal, task.goal)
    assert {one.quantity for one in plan.robustness} > {"tilt", "push", "friction"}
    assert [factor for factor, _ in plan.time_scale] == [1.2]
    rows = repr(plan).splitlines()
    assert rows[0].startswith("C   PROVED")
    assert rows[1].startswith(f"Motion  {plan.duration:.3f} s   {plan.energy:.4g} J")
    assert [row.split("  ")[0] for row in rows[4:7]] == [
        *("Tipping margin", "Friction used", "Min foot force"),
    ]
    assert any(row.startswith("Robust to (one at a time): ") for row in rows)


@pytest.mark.slow
def test_a_plan_is_checked_again_by_its_folder_or_its_objects(plan, folder, task, capsys):
    code, data = said(capsys, "check", folder)
    again = ocptip.check(folder)
    assert (code, again.verified) == (0, True)
    assert comparable(json.loads(json.dumps(plain(again.to_dict())))) == comparable(data)
    same = ocptip.check(task, plan.motion)
    assert same.check.worst["GN"].value == pytest.approx(again.check.worst["GN"].value, abs=1e-9)
    assert repr(same).startswith("motion on C   PROVED")
    broken = ocptip.check(ocptip.load_task(task, GN=0.1), plan.motion)
    assert not broken.verified
    assert "Broken  tipping margin is " in repr(broken)


def test_a_proof_is_what_the_command_says(folder, tmp_path, capsys):
    code, data = said(capsys, "certify", folder)
    found = ocptip.certify(folder)
    assert (code, found.certified) == (0, True)
    assert comparable(json.loads(json.dumps(plain(found.to_dict())))) == comparable(data)
    assert main(["certify", str(found.save(tmp_path / "proof.json"))]) == 0


@pytest.mark.slow
def test_a_report_is_what_the_command_says(folder, tmp_path, capsys, few_tilts):
    code, data = said(capsys, "report", folder, "--out", tmp_path / "report.html")
    found = ocptip.report(folder)
    assert (code, found.stands) == (0, True)
    assert comparable(data) == comparable(json.loads(json.dumps(plain(found.to_dict()))))
    assert repr(found).startswith(f"C: {found.checked.headline}")
    assert [one.raised.name for one in found.charts] == ["payload", "tilt"]
    [why] = found.not_charted
    assert "friction of these contacts is not known by half spaces" in why
    assert why in (tmp_path / "report.html").read_text()


@pytest.mark.slow
def test_a_path_is_timed_as_the_command_does(tmp_path, capsys):
    path, file = EXAMPLES / "paths" / "ur5_sweep.json", EXAMPLES / "tasks" / "ur5_cart.toml"
    task = ocptip.load_task(file, uncertainty="none")
    plan = ocptip.retime(task, path)
    motion = load_motion(path, task.robot.names, task.robot.units, start=task.start)
    assert ocptip.retime(task, motion).duration == plan.duration
    with pytest.raises(ocptip.InputError, match="task: missing"):
        ocptip.retime(None, motion)
    options = ["--task", file, "--tolerance", "none", "--no-figures", "--out", tmp_path / "out"]
    code, data = said(capsys, "retime", path, *options)
    assert (code, plan.verified) == (0, True)
    assert comparable(json.loads(json.dumps(plain(plan.to_dict())))) == comparable(data)
    assert plan.duration < 1.03 * plan.timings[0].before.duration


def test_tasks_of_cases_and_files_with_what_is_to_be_different():
    assert ocptip.load_task("A").limits.tolerance == WORKSHOP
    task = ocptip.load_task("A", base="printed", uncertainty=NONE, objective="time", GN=0.5, max_duration=2)
    assert (task.limits.tolerance, task.limits.GN, task.limits.max_duration) == (NONE, 0.5, 2.0)
    assert task.objective.name == "time"
    again = ocptip.load_task(task, duration=1.5)
    assert (again.limits.min_duration, again.limits.max_duration, again.limits.GN) == (1.5, 1.5, 0.5)
    assert ocptip.load_task(again) is again


def test_a_cycle_is_a_task_as_well():
    task = ocptip.load_task(EXAMPLES / "tasks" / "ur5_pick_and_place.toml", GT=0.7)
    assert task.is_cycle
    assert {segment.task.limits.GT for segment in task.segments} == {0.7}
    with pytest.raises(ocptip.InputError, match=r"duration: of a cycle belongs to its \[\[segment\]\]s"):
        ocptip.load_task(task, duration=1.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ocptip.load_task("K"), "K: neither a case"),
        (
            lambda: ocptip.check(CART),
            f"{CART}: is a task or a path, no motion; 'ocptip stand {CART} --posture start' checks a task",
        ),
        (lambda: ocptip.load_task("x.toml", base="printed"), "base: belongs to the cases A to H, got x.toml"),
        (lambda: ocptip.load_task("A", duration=1, max_duration=2), "duration: give either"),
        (lambda: ocptip.plan("A", rate=0), "rate: must be > 0"),
        (lambda: ocptip.plan("A", controller="quintic", rise_time=0), "rise_time: must be > 0"),
        (lambda: ocptip.plan("A", time_scale=[-1]), "time_scale: must be > 0"),
        (lambda: ocptip.check(ocptip.load_task("A")), "motion: missing"),
        (lambda: ocptip.check("A", time_scale=[1e9]), "time_scale: must be between"),
    ],
)
def test_bad_arguments_are_named(call, message):
    with pytest.raises(ocptip.InputError) as caught:
        call()
    assert str(caught.value).startswith(message)


def test_the_folder_of_a_plan_is_no_task(tmp_path):
    for name in (PLAN, SUMS, TASK):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with pytest.raises(ocptip.InputError, match=r"is the folder of a plan; 'ocptip check .*' checks"):
        ocptip.load_task(tmp_path)


def test_where_there_is_no_plan_the_error_says_why(task, monkeypatch, tmp_path, capsys):
    def refuse(*_, **__):
        raise PlanningError("none of 1 starts gave a verified motion")

    monkeypatch.setattr("ocptip.api.plan.plan_motion", refuse)
    with pytest.raises(ocptip.NoPlanError, match="none of 1 starts gave a verified motion") as caught:
        ocptip.plan(task, starts=1)
    code, data = said(capsys, "plan", "C", "--tolerance", "none", "--starts", 1, "--out", tmp_path / "out")
    assert code == 1
    assert comparable(data) == json.loads(json.dumps(plain(caught.value.to_dict())))
