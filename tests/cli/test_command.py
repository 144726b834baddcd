"""What every command does alike: exit codes, Ctrl-C, files that cannot be written, quick help."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import casadi
import pytest

from ocptip.basics import errors
from ocptip.basics.errors import doubt
from ocptip.cli import main as command_line
from ocptip.cli.command import Report
from ocptip.cli.commands import COMMANDS
from ocptip.cli.layout import summary
from ocptip.cli.main import main

ARGUMENTS = {
    "stand": ["a.toml"],
    "plan": ["A"],
    "place": ["a.toml"],
    "cell": ["a.toml"],
    "chart": ["a.toml"],
    "drive": ["a.toml"],
    "studio": ["a.toml"],
    "retime": ["a.toml"],
    "check": ["a.json"],
    "certify": ["a.json"],
    "rate": ["FSFS"],
    "parallel": ["6UPS"],
    "examples": ["ex"],
    "init": ["robot.urdf"],
    "view": ["a.toml"],
    "export": ["plan"],
    "simulate": ["plan"],
    "compare": ["recording.csv", "plan"],
    "identify": ["payload", "recording.csv", "plan"],
    "report": ["plan"],
    "completion": ["bash"],
    "schema": [],
}
MODULES = {command.name: command.module for command in COMMANDS}
NAMES = list(MODULES)


@dataclass
class Answer(Report):
    good: bool = True
    failure: Exception | None = None

    def to_text(self):
        return "text"

    def to_dict(self):
        return {"number": float("inf")}

    def write(self):
        yield "first"
        if self.failure:
            raise self.failure


def answered(monkeypatch, name, answer, *more):
    """Exit code of a command whose `run` returns or raises this."""

    def run(options):
        if isinstance(answer, BaseException):
            raise answer
        return answer

    monkeypatch.setitem(sys.modules, MODULES[name], SimpleNamespace(run=run))
    return main([name, *ARGUMENTS[name], *more])


@pytest.mark.parametrize("name", NAMES)
def test_answers(monkeypatch, capsys, name):
    assert answered(monkeypatch, name, Answer()) == 0
    assert answered(monkeypatch, name, Answer(good=False)) == 1
    assert capsys.readouterr() == ("text\ntext\n", "")
    assert answered(monkeypatch, name, Answer(), "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"number": None, "warnings": []}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (errors.InputError("x: is bad"), 2, "x: is bad"),
        (errors.SolverError("stuck"), 2, "computation failed: stuck"),
        (PermissionError(13, "Permission denied", "secret.toml"), 2, "secret.toml: Permission denied"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (KeyboardInterrupt("before the end"), 130, "interrupted before the end"),
        (ZeroDivisionError("a\nb"), 3, "internal error: ZeroDivisionError: a b; please report it"),
        (OSError(12, "Cannot allocate memory"), 2, "out of memory"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
def test_errors_are_one_line(monkeypatch, capsys, name, error, code, line):
    monkeypatch.delenv("OCPTIP_DEBUG", raising=False)
    assert answered(monkeypatch, name, error) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"ocptip: {line}")
    assert err.count("\n") == 1


def test_a_file_that_cannot_be_written_does_not_cost_the_answer(monkeypatch, capsys):
    answer = Answer(failure=OSError(28, "No space left on device", "map.png"))
    assert answered(monkeypatch, "stand", answer) == 2
    assert capsys.readouterr() == ("text\n", "ocptip: map.png: No space left on device\n")
    assert answer.written == ["first"]


class Early(Answer):
    early = True

    def to_text(self):
        return "\n".join(["text", *self.written])


@pytest.mark.parametrize("failure", [None, OSError(28, "No space left on device", "map.png")])
def test_an_early_answer_is_said_before_its_files_are_written(monkeypatch, capsys, failure):
    answer, before = Early(failure=failure), []
    own = answer.write

    def write():
        before.append(capsys.readouterr().out)
        yield from own()

    monkeypatch.setattr(answer, "write", write)
    assert answered(monkeypatch, "stand", answer) == (2 if failure else 0)
    assert (before, capsys.readouterr().out) == (["text\n"], "first\n")
    assert answered(monkeypatch, "stand", Early(), "--json") == 0
    json.loads(capsys.readouterr().out)


def test_an_early_answer_is_the_beginning_of_the_whole_one():
    """Else it would be said twice, however short its names are."""
    lines = [("look", "at this"), ("", "and that")]
    early, whole = (summary("FOUND.", lines, files) for files in ([], [Path("out/a.png")]))
    assert whole.startswith(early)
    assert whole.removeprefix(early) == "\n\nFiles   out/: a.png"


@pytest.mark.parametrize("name", NAMES)
def test_suspicions_are_a_line_on_stderr_and_in_the_data(monkeypatch, capsys, name):
    def run(options):
        doubt("a.toml: start_deg: are they radians?")
        doubt("a.toml: start_deg: are they radians?")
        return Answer()

    monkeypatch.setitem(sys.modules, MODULES[name], SimpleNamespace(run=run))
    assert main([name, *ARGUMENTS[name], "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["warnings"] == ["a.toml: start_deg: are they radians?"] * 2
    assert err == "warning: a.toml: start_deg: are they radians?\n" * 2


def test_other_warnings_go_their_way(monkeypatch):
    def run(options):
        warnings.warn("old", DeprecationWarning, stacklevel=1)
        return Answer()

    monkeypatch.setitem(sys.modules, "ocptip.cli.verify.stand", SimpleNamespace(run=run))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        assert main(["stand", "a.toml"]) == 0
    assert [str(w.message) for w in found] == ["old"]


@pytest.fixture
def stopping(monkeypatch):
    """This process stops on signals, as that of a command does; gives the signals that came."""
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(command_line, "stops", [])
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    command_line._stop_on_signals()
    yield command_line.stops
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_python_cannot_raise_comes_again(stopping, number):
    class Dying:
        def __del__(self):
            signal.raise_signal(number)

    def wait():
        Dying()
        for _ in range(1000):
            time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        wait()
    assert [one for one, _ in stopping] == [number]


def test_a_second_signal_ends_the_command_at_once(stopping, monkeypatch):
    ended = []
    monkeypatch.setattr(os, "_exit", ended.append)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGTERM)  # of `timeout`, which sends two
    assert not ended
    stopping[0] = signal.SIGTERM, float("-inf")
    signal.raise_signal(signal.SIGINT)
    assert ended == [130]


def test_an_interrupt_that_casadi_would_drop_comes_again(stopping):
    class Row:
        def __DM__(self):  # CasADi tries another conversion where it fails
            signal.raise_signal(signal.SIGTERM)
            return casadi.DM(1)

    def wait():
        casadi.DM(Row())
        for _ in range(1000):
            time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        wait()
