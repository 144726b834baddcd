"""The table of capabilities (studies/results/sources.md): all that it names exists, all numbers are there."""

import re

import pytest

from ocptip.cli.commands import COMMANDS
from tests.places import ROOT

TEXT = (ROOT / "studies/results/sources.md").read_text(encoding="utf-8")


def rows(title):
    """Cells of the table under a heading, without its head."""
    section = TEXT.split(f"\n## {title}", 1)[1].split("\n## ", 1)[0]
    lines = [line.strip("|").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line] for line in lines[2:]]


CAPABILITIES = [row for title in ("Thesis M", "Thesis P", "[Naw07]") for row in rows(title)]


def names(cell):
    return re.findall(r"`([^`]+)`", cell)


def exists(name):
    """Whether a module, command, script or test file of this name is there."""
    if name.startswith("ocptip "):
        return name.split()[1] in {command.name for command in COMMANDS}
    path = ROOT / ("src" if name.startswith("ocptip.") else "") / name
    return path.is_file() or (path.parent / name.replace(".", "/")).with_suffix(".py").is_file()


def test_no_row_is_lost():
    assert [len(rows(title)) for title in ("Thesis M", "Thesis P", "[Naw07]")] == [44, 20, 24]
    assert len(rows("Printed numbers")) > 20


@pytest.mark.parametrize("row", CAPABILITIES, ids=lambda row: row[1][:40])
def test_every_capability_is_somewhere_and_tested(row):
    _section, _what, here, tests = row
    assert names(here)
    assert names(tests)
    assert [name for name in names(here) + names(tests) if not exists(name)] == []
    assert all(name.startswith("tests/") for name in names(tests))


@pytest.mark.parametrize("row", rows("Printed numbers"), ids=lambda row: row[1][:40])
def test_every_number_stands_in_its_file(row):
    _source, _what, _printed, here, file = row
    text = (ROOT / names(file)[0]).read_text(encoding="utf-8")
    known = {float(number) for number in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?", text)}
    for number in here.split(", "):
        assert float(number) in known or -float(number) in known, number


@pytest.mark.parametrize("row", rows("Missing"), ids=lambda row: row[1][:40])
def test_what_is_missing_has_a_reason(row):
    assert len(row) == 3
    assert len(row[2].split()) >= 5
    assert row[2].endswith(".")


def test_names_that_do_not_exist_are_seen():
    assert not exists("ocptip.contact.nothing")
    assert not exists("ocptip nothing")
    assert not exists("tests/nothing.py")
    assert exists("ocptip.contact.solver")
    assert exists("studies.compare.run")
