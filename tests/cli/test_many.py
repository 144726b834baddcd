"""Many tasks in one call: order, lines, table, codes, what is kept; workers that die."""

from __future__ import annotations

import json
from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from ocptip.basics.errors import InputError
from ocptip.cli import many
from ocptip.cli.many import Asked, answer_many, digest_of
from ocptip.cli.options import output_directory
from ocptip.published.tasks import experiment_task
from tests.cli.many_work import work


def options_for(tmp_path, *tasks, **more):
    given = {"command": "plan", "task": list(tasks), "out": f"{tmp_path / 'all'}", "overwrite": False}
    given |= {"no_figures": True, "json": False, "jobs": 2, "scheduler": None, "tolerance": None, "starts": 3}
    return Namespace(**{**given, **more})


def read(options):
    if options.task == "unreadable":
        raise InputError("mass: must be > 0, got -3", file="unreadable")
    name = options.task.split(":")[0]
    answer = options.task.split(":")[-1]
    return Asked(answer, name, output_directory(options, name), f"{answer} {options.starts}")


@pytest.fixture
def here(monkeypatch):
    """Calls run in this process."""

    @contextmanager
    def pool(*_):
        with ThreadPoolExecutor(1) as threads:
            yield threads

    monkeypatch.setattr(many, "worker_pool", pool)


def test_lines_as_they_come_then_a_table_and_the_worst_code(here, tmp_path, capsys):
    report = answer_many(options_for(tmp_path, "b:yes", "unreadable", "a:no"), read, work)
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["[1/3] unreadable: mass: must be > 0, got -3", "[2/3] b: YES.", "[3/3] a: NO."]
    assert [line.split() for line in report.to_text().splitlines() if line] == [
        ["task", "answer", "energy", "time"],
        ["b", "yes", "1.5", "J", "2.000", "s"],
        ["unreadable", "BAD", "INPUT", "-", "-"],
        ["a", "NO", "1.5", "J", "2.000", "s"],
    ]
    assert (report.exit_code, report.good) == (2, False)
    rows = json.loads(report.to_json())
    assert [(row["task"], row["exit_code"], row["kept"]) for row in rows] == [
        ("b", 0, False),
        ("unreadable", 2, False),
        ("a", 1, False),
    ]
    assert json.loads((tmp_path / "all" / "b" / "plan.json").read_text())["starts"] == 3


def test_what_is_finished_is_kept_if_it_is_of_the_same_task(here, tmp_path, capsys):
    answer_many(options_for(tmp_path, "a:yes", "b:yes", "c:yes"), read, work)
    (tmp_path / "all" / "c" / "SHA256SUMS").unlink()
    capsys.readouterr()
    report = answer_many(options_for(tmp_path, "a:yes", "b:other", "c:yes"), read, work)
    assert [row["kept"] for row in json.loads(report.to_json())] == [True, False, False]
    out = capsys.readouterr().out.splitlines()
    assert out[0] == f"[1/3] a: kept, {tmp_path / 'all' / 'a'} holds its answer"
    assert "[2/3] b: OTHER." in out
    assert report.exit_code == 0
    report = answer_many(options_for(tmp_path, "a:yes", starts=4), read, work)
    assert not json.loads(report.to_json())[0]["kept"]
    drawn = answer_many(options_for(tmp_path, "a:yes", starts=4, no_figures=False), read, work)
    assert not json.loads(drawn.to_json())[0]["kept"]  # its figures are not there


def test_two_of_one_name_are_refused(here, tmp_path):
    with pytest.raises(InputError, match=r"two tasks would write into .*both are called 'a'"):
        answer_many(options_for(tmp_path, "a:yes", "a:no"), read, work)


@pytest.mark.slow
def test_errors_and_dead_workers_are_lines(tmp_path, capsys):
    tasks = ["a:yes", "b:fails", "c:dies", "d:once", "e:yes"]
    report = answer_many(options_for(tmp_path, *tasks, json=True), read, work)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 5
    found = {row["task"]: row for row in json.loads(report.to_json())}
    assert [found[name]["exit_code"] for name in "abcde"] == [0, 3, 2, 0, 0]
    assert found["b"]["status"].startswith("internal error: ValueError: cannot be")
    assert found["c"]["status"].startswith("computation failed: its worker process died 2 times")
    assert report.exit_code == 3


def test_a_digest_is_of_the_task_and_of_what_is_typed(tmp_path):
    source = experiment_task("A", "effective").source
    first = digest_of(source, options_for(tmp_path, "A"))
    assert first == digest_of(source, options_for(tmp_path, "A", "B", out="x", json=True, jobs=7))
    assert first != digest_of(source, options_for(tmp_path, "A", starts=4))
    assert first != digest_of(experiment_task("B", "effective").source, options_for(tmp_path, "A"))
    assert digest_of(None, options_for(tmp_path, "A")) == ""
    (tmp_path / "t.toml").write_text("friction = 0.1\n")
    one = digest_of(source, options_for(tmp_path, "A", tolerance=f"{tmp_path / 't.toml'}"))
    (tmp_path / "t.toml").write_text("friction = 0.2\n")
    assert one != digest_of(source, options_for(tmp_path, "A", tolerance=f"{tmp_path / 't.toml'}"))
