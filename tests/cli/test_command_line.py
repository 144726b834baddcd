"""What can be typed: groups, options beside positional arguments, commands that do not exist, completion."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest

from ocptip.cli import terminal
from ocptip.cli.commands import COMMANDS, GROUPS
from ocptip.cli.main import main, parser


def parsed(line):
    return vars(parser().parse_args(line.split()))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("check --stops PLAN", {"motion": "PLAN", "stops": "both"}),
        ("check --stops path PLAN", {"motion": "PLAN", "stops": "path"}),
        ("check PLAN --stops", {"motion": "PLAN", "stops": "both"}),
        ("plan --time-scale 0.95 A", {"task": ["A"], "time_scale": [0.95]}),
        (
            "plan A --time-scale 0.95 0.9 --jobs 2 B",
            {"task": ["A", "B"], "time_scale": [0.95, 0.9], "jobs": 2},
        ),
        ("plan --stop-safe A", {"task": ["A"], "stop_safe": "given"}),
        ("simulate --tilt 1 PLAN", {"plan": "PLAN", "tilt": [1.0]}),
        ("simulate --tilt -1 30 PLAN", {"plan": "PLAN", "tilt": [-1.0, 30.0]}),
        ("rate --workspace x=-1:1 y=0:1 6UPS", {"robot": "6UPS", "workspace": ["x=-1:1", "y=0:1"]}),
        ("rate --index dm_2 ctn 6UPS", {"robot": "6UPS", "index": ["dm_2", "ctn"]}),
        ("parallel --modes 1 2 3RRR", {"robot": "3RRR", "modes": [1.0, 2.0]}),
        ("stand TASK --posture -80,20,0", {"scene": "TASK", "posture": "-80,20,0"}),
        ("check --stops -- -PLAN", {"motion": "-PLAN", "stops": "both"}),
    ],
)
def test_options_leave_positional_arguments_alone(line, expected):
    assert expected.items() <= parsed(line).items()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("plam A", "no such command: 'plam'; did you mean 'plan'?"),
        ("xyz", "no such command: 'xyz'"),
        ("plan --time-scale A", "argument --time-scale: invalid float value: 'A'"),
        (
            "plan --stop-safe=never A",
            "argument --stop-safe: must be path, brakes, both, cancel or all, got 'never'",
        ),
        (
            "plan --start 3 A",
            "unrecognized arguments: --start; did you mean '--starts'? (see ocptip plan --help)",
        ),
        (
            "plan A --uncertainty none",
            "unrecognized arguments: --uncertainty; did you mean '--tolerance'? (see ocptip plan --help)",
        ),
        (
            "view --gif x.gif A",
            "unrecognized arguments: --gif; did you mean '--movie'? (see ocptip view --help)",
        ),
        ("plan A -v -q", "not allowed with argument"),
    ],
)
def test_a_wrong_line_is_refused_in_one_line(capsys, line, message):
    with pytest.raises(SystemExit) as caught:
        main(line.split())
    said = capsys.readouterr().err
    assert caught.value.code == 2
    assert message in said
    assert said.count("\n") == 1


def test_without_a_command_the_help_is_shown(capsys):
    assert main([]) == 0
    shown = capsys.readouterr().out
    assert all(f"\n{group}:\n" in shown for group in GROUPS)
    assert all(f"\n  {command.name} " in shown for command in COMMANDS)
    assert {command.group for command in COMMANDS} == set(GROUPS)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_help_of_a_command_has_all_exit_codes(capsys, command):
    with pytest.raises(SystemExit):
        main([command.name, "--help"])
    shown = " ".join(capsys.readouterr().out.split())
    assert f"exit codes: {command.codes}, 2 bad input, 3 internal error, 130 interrupted" in shown


def test_quiet_prints_the_verdict_only(capsys, scenes):
    scene = str(scenes / "tripod_with_arm.toml")
    assert main(["stand", scene, "-q"]) == 0
    quiet = capsys.readouterr().out
    assert main(["stand", scene]) == 0
    assert quiet == capsys.readouterr().out.split("\n", 1)[0] + "\n"
    terminal.latest.quiet = False


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_the_verdict_is_coloured_on_terminals_that_want_it(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert terminal.coloured("a: STANDS. Yes\nNOT A", Terminal()) == "a: \x1b[32mSTANDS\x1b[0m. Yes\nNOT A"
    assert terminal.coloured("A: NOT VERIFIED. x", Terminal()) == "A: \x1b[31mNOT VERIFIED\x1b[0m. x"
    assert terminal.coloured("A: NOT VERIFIED. x", io.StringIO()) == "A: NOT VERIFIED. x"
    monkeypatch.setenv("NO_COLOR", "1")
    assert terminal.coloured("A: NOT VERIFIED. x", Terminal()) == "A: NOT VERIFIED. x"


def test_completion_completes_commands_and_options(capsys, tmp_path):
    pytest.importorskip("shtab")
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "complete.sh"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    tries = "COMP_WORDS=(ocptip pla); COMP_CWORD=1; _shtab_ocptip; echo ${COMPREPLY[@]};"
    tries += "COMP_WORDS=(ocptip plan --time); COMP_CWORD=2; _shtab_ocptip; echo ${COMPREPLY[@]}"
    done = subprocess.run(
        ["bash", "-c", f"source {script}; {tries}"], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["plan", "place", "--time-scale"]


def test_completion_without_its_package_says_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "zsh"]) == 2
    assert "pip install 'ocptip[completion]'" in capsys.readouterr().err
