"""README and docs are in plain words: `python -m studies.words.run PAGE` lists what a page breaks."""

from __future__ import annotations

import pytest

from studies.words.run import EASE, ROOT, Page, pages

UNFINISHED = {
    "README.md",
    "docs/api/contacts.md",
    "docs/api/motions.md",
    "docs/cell.md",
    "docs/certificate.md",
    "docs/collision.md",
    "docs/commands.md",
    "docs/compare.md",
    "docs/comparison.md",
    "docs/contact-solver.md",
    "docs/gallery.md",
    "docs/identify.md",
    "docs/index.md",
    "docs/indices.md",
    "docs/measured.md",
    "docs/motion-planner.md",
    "docs/parallel-robots.md",
    "docs/placement.md",
    "docs/python.md",
    "docs/report.md",
    "docs/retiming.md",
    "docs/scenes.md",
    "docs/sensitivities.md",
    "docs/simulation.md",
    "docs/start.md",
    "docs/stops.md",
    "docs/tolerance.md",
    "docs/view.md",
}
"""Pages that are not rewritten yet. This list only shrinks; a new page is not on it."""

PAGES = {str(page.path.relative_to(ROOT)): page for page in pages()}


@pytest.mark.parametrize("name", sorted(set(PAGES) - UNFINISHED))
def test_page_is_in_plain_words(name):
    assert PAGES[name].faults() == []


def test_pages_are_easy_to_read():
    """On average: a page of formulas and names of methods may be harder."""
    finished = [PAGES[name].ease for name in set(PAGES) - UNFINISHED if PAGES[name].sentences]
    assert all(ease > EASE for ease in finished)


def test_unfinished_pages_exist_and_are_unfinished():
    assert set(PAGES) >= UNFINISHED
    assert [name for name in UNFINISHED if not PAGES[name].faults()] == []


@pytest.mark.parametrize(
    "text",
    [
        "What is left of the reserve.",
        "It tips in all worlds of the tolerance.",
        "The motion is judged.",
        "The base moves, and the arm moves, too.",
        "| key | " + "word " * 16 + "|\n|---|---|",
        "Run `ocptip stand src/ocptip/examples/scenes/a.toml`.",
        "A sentence " + "of words " * 20 + "is too long.",
        "Word. " * 1501,
    ],
)
def test_rules_see_what_breaks_them(tmp_path, text):
    path = tmp_path / "page.md"
    path.write_text(f"# Title\n\n{text}\n")
    assert len(Page(path).faults()) >= 1


def test_code_and_quoted_output_are_no_prose(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        "# T\n\nThe key `late` is a word. See [margins](late.md).\n\n```text\nreserve, late\n```\n"
    )
    assert Page(path).faults() == []
