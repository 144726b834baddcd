"""The document of a task, and its file."""

import json
import re

import pytest

from ocptip.cli.main import main
from tests.places import EXAMPLES

TASK = str(EXAMPLES / "tasks" / "ur5_cart.toml")


@pytest.fixture
def cases(tmp_path):
    file = tmp_path / "cases.toml"
    file.write_text("tilt_deg = [0, 40]\npush_N = [0]\npayload_kg = [0]\n")
    return str(file)


def test_page_of_a_task_stands_alone_and_lists_its_cases(tmp_path, capsys, cases):
    out = tmp_path / "report.html"
    assert main(["report", TASK, "--cases", cases, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "2 of 4 load cases stand" in said
    assert "does not stand: start +0 kg 40 deg 0 N" in said
    page = out.read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=['\"](?!data:)", page)
    for words in ("claims no conformity", "Tilt by direction", "40&nbsp;deg", "ocptip report ur5_cart.toml"):
        assert words in page
    assert "Motion</h2>" not in page  # there is none


def test_the_same_as_json_and_as_pdf(tmp_path, capsys, cases):
    out = tmp_path / "report.pdf"
    assert main(["report", TASK, "--cases", cases, "--out", str(out), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [case["stands"] for case in data["load_cases"]] == [True, False, True, False]
    assert set(data["least_tilt_deg"]) == {"start", "goal"}
    assert out.read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([TASK, "--out", "report.txt"], "--out: path: expected a file NAME.html or NAME.pdf"),
        ([str(EXAMPLES / "tasks" / "delta_cart.toml")], "is of a parallel robot; report is about arms"),
        ([str(EXAMPLES / "tasks" / "ur5_pick_and_place.toml")], "cycle"),
    ],
)
def test_what_it_cannot_be_about_is_refused(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(["report", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
