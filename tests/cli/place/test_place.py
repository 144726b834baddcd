"""`ocptip place`: summary, files, exit codes; once for real, else with the search replaced."""

from __future__ import annotations

import io
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.cli.main import main
from ocptip.cli.place.place import near_base, progress_bar
from ocptip.placement.result import PlacementMargin
from tests.pictures.placed_example import TASK, found, refused


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@pytest.fixture
def task(tmp_path, monkeypatch):
    """A task file, in the directory where the command runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "press.toml").write_text(TASK, encoding="utf-8")
    return "press.toml"


@pytest.fixture
def search(monkeypatch):
    """Replaces the search; `result` is what it returns or raises, `calls` what it was given."""
    state = SimpleNamespace(result=found(), calls=[])

    def place(problem, **options):
        state.calls.append((problem, options))
        options["progress"](1, 2, None)
        options["progress"](2, 2, 0.123)
        if isinstance(state.result, BaseException):
            raise state.result
        return state.result

    monkeypatch.setattr("ocptip.api.place.search", place)
    return state


def run(capsys, *arguments):
    """Exit code, stdout, stderr."""
    code = main(["place", *map(str, arguments)])
    return code, *capsys.readouterr()


def test_for_real(task, capsys, tmp_path):
    code, out, err = run(capsys, task, "--json", "--starts", 1, "--no-figures", "--out", "new")
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert data["written"] == ["new/placement.json"]
    stored = json.loads((tmp_path / "new" / "placement.json").read_text(encoding="utf-8"))
    assert {**stored, "written": data["written"]} == data
    assert data["found"]
    best = data["best"]
    assert all(m["relative"] >= -1e-6 for m in best["margins"])
    assert 0 < best["criteria"]["GN"]["value"] <= 0.9
    assert best["total"] == pytest.approx(sum(c["share"] for c in best["criteria"].values()))


def test_summary(task, search, capsys):
    code, out, err = run(capsys, task, "--no-figures", "--starts", 5, "--seed", 3)
    assert (code, err) == (0, "")  # piped: no progress bar
    ((problem, options),) = search.calls
    assert (options["starts"], options["seed"]) == (5, 3)
    assert problem.tasks[0].name == "press"
    lines = {line.split("  ")[0].strip(): line for line in out.splitlines()}
    best = search.result.best
    scope = "(contacts and drives; collision not checked)"
    head = f"press   PLACED for 'workshop' uncertainty (default), all constraints verified {scope} "
    assert " ".join(out.split()).startswith(" ".join(head.split()))
    assert max(map(len, out.splitlines())) <= 80
    assert f"p1 {best.parameters[0]:.3f} m, p2 {best.parameters[1]:.3f} m" in out.splitlines()[2]
    joints = out.split("joints")[1].split("\n\n")[0]
    angles = [float(angle) for angle in re.findall(r"([-\d.]+) deg", joints)]
    assert all(f"{name} " in joints for name in best.problem.robot.arm.joint_names)
    np.testing.assert_allclose(angles, np.rad2deg(best.angles[0]), atol=0.006)
    left = best.problem.robot.tip_over.reference_moment * (1 / best.criteria["GN"] - 1)
    assert f" {left:.3g} N m " in lines["tipping margin (GN)"]
    assert lines["tipping margin (GN)"].split()[-2] == "0.25"
    assert f" {100 * best.criteria['GT']:.3g} % " in lines["friction used (GT)"]
    assert lines["friction used (GT)"].split()[-2:] == ["-", "-"]
    assert lines["sum"].split()[1] == f"{best.total:.4f}"
    assert re.search(r"^torque +[\d.e-]+ N m +(<= [\d.]+|at limit)  ", out, flags=re.MULTILINE)
    assert all(margin.full_name in " ".join(out.split("at limit")[-1].split()) for margin in best.active)
    assert re.search(r"masses +base [\d.]+ kg, arm [\d.]+ kg; together [\d.]+ kg", out)
    assert lines["Files"].endswith("ocptip-place-press/: placement.json")
    assert out.count("\n") < 45
    assert out.isascii()


def test_figures_are_written(task, search, capsys, tmp_path, monkeypatch):
    drawn = []

    def draw(directory, name, placements):
        drawn.append((name, placements))
        (directory / "map.png").write_bytes(b"")
        return [directory / "map.png"]

    monkeypatch.setattr("ocptip.pictures.placement.draw_placement", draw)
    code, out, _ = run(capsys, task)
    assert code == 0
    assert drawn == [("press", search.result.placements)]
    assert out.splitlines()[-1].endswith("placement.json, map.png")


def test_no_placement(task, search, capsys, tmp_path):
    search.result = refused()
    code, out, err = run(capsys, task, "--no-figures")
    assert (code, err) == (1, "")
    assert out.startswith("press   NO PLACEMENT. No placement keeps all constraints")
    worst = search.result.nearest.violations[0]
    assert f"broken {worst}" in " ".join(out.split())
    assert "off by" in out
    assert json.loads((tmp_path / "ocptip-place-press" / "placement.json").read_text())["found"] is False
    code, out, _ = run(capsys, task, "--no-figures", "--json")
    assert code == 1
    assert json.loads(out)["reason"] == str(search.result)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["absent.toml"], "absent.toml: no such file"),
        (["press.toml", "--starts", "0"], "--starts: must be >= 1, got 0"),
        (["press.toml", "--seed", "-1"], "--seed: must be >= 0, got -1"),
        (["press.toml", "--out", "a/b"], "--out: no such directory: a"),
        (["press.toml", "--out", "press.toml"], "--out: press.toml is not a directory"),
    ],
)
def test_bad_input(task, search, capsys, arguments, message):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err == f"ocptip: {message}\n"
    assert not search.calls


def test_a_wrong_key_is_named(task, capsys, tmp_path):
    (tmp_path / task).write_text(TASK + "\n[limit]\n", encoding="utf-8")
    code, _, err = run(capsys, task)
    assert code == 2
    assert err.startswith("ocptip: press.toml: limit: unknown key; did you mean 'limits'?")


def test_files_that_cannot_be_written_do_not_cost_the_result(task, search, capsys, monkeypatch):
    def refuse(*_):
        raise OSError(28, "No space left on device", "out/placement.json")

    monkeypatch.setattr("ocptip.api.place.write_placement", refuse)
    code, out, err = run(capsys, task, "--no-figures")
    assert code == 2
    assert out.startswith("press   PLACED")
    assert err == "ocptip: out/placement.json: No space left on device\n"


def test_interruption(task, search, capsys):
    search.result = KeyboardInterrupt()
    code, out, err = run(capsys, task)
    assert (code, out) == (130, "")
    assert "interrupted" in err


def test_progress_on_a_terminal_only():
    terminal, pipe = Terminal(), io.StringIO()
    for stream in (terminal, pipe):
        with progress_bar(stream) as progress:
            progress(0, 4, None)
            progress(1, 4, 0.25)
    assert pipe.getvalue() == ""
    shown = terminal.getvalue().split("\r")
    assert "[######..................] 1/4 starts, minimum total 0.2500" in shown[3]
    assert "no placement yet" in shown[2]
    assert shown[-1] == "\x1b[K"


@pytest.mark.parametrize(
    ("gap", "base_clearance", "warned"), [(5.58e-5, 0.0, True), (0.02, 0.0, False), (0.006, 0.005, False)]
)
def test_a_base_that_almost_touches_something_is_named(gap, base_clearance, warned):
    """Where no clearance of the base is given, that of the arm is the measure."""
    rows = [
        PlacementMargin("clearance", "base and table", gap, base_clearance, False, "m", 0.1, 0),
        PlacementMargin("clearance", "link 4 and link 6", 0.008, 0.01, False, "m", 0.1, 0),
        PlacementMargin("base clearance", "contact 2 and table", 0.025, base_clearance, False, "m", 0.1, -1),
    ]
    limits = SimpleNamespace(base_clearance=base_clearance, clearance=0.01)
    lines = near_base(SimpleNamespace(margins=rows, problem=SimpleNamespace(limits=limits)))
    text = "base and table are only 0.056 mm apart: base_clearance in [limits] is 0, that of the arm 10 mm"
    assert lines == ([("clearance", text)] if warned else [])
