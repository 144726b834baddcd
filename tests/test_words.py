"""README and docs are in plain words: `python -m studies.words.run PAGE` lists what a page breaks."""

from __future__ import annotations

import re
from functools import cache

import pytest

from studies.words.run import EASE, ROOT, Page, banned, pages, texts_of_code, vague_names

said_by_the_code = cache(lambda: list(texts_of_code()))  # it parses all modules

PAGES = {str(page.path.relative_to(ROOT)): page for page in pages()}


@pytest.mark.parametrize("name", sorted(PAGES))
def test_page_is_in_plain_words(name):
    assert PAGES[name].faults() == []


def test_pages_are_easy_to_read():
    """All but the two of titles and captions, which have few sentences."""
    of_prose = set(PAGES) - {"docs/bibliography.md", "docs/gallery.md"}
    hard = {name: PAGES[name].ease for name in of_prose if PAGES[name].sentences and PAGES[name].ease <= EASE}
    assert hard == {}


@pytest.mark.parametrize("kind", ["docstring", "message"])
def test_code_has_no_banned_words(kind):
    """`python -m studies.words.run --code` lists them."""
    texts = [(place, text) for one, place, text in said_by_the_code() if one == kind]
    assert len(texts) > 1000
    assert [f"{place}: {word}" for place, text in texts for word in banned(text)] == []


def test_names_say_what_a_thing_is():
    assert list(vague_names()) == []


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


def test_messages_of_troubleshooting_are_those_of_the_code():
    source = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    one_line = re.sub(r'"\s*\n\s*f?"', "", source)  # a message over several lines
    messages = re.findall(r"^\| `([^`]+)` \|", PAGES["docs/troubleshooting.md"].text, flags=re.MULTILINE)
    assert len(messages) > 20
    assert [message for message in messages if message not in one_line] == []


def test_all_fields_of_a_plan_are_on_their_page():
    code = (ROOT / "src" / "ocptip" / "motion" / "files" / "output.py").read_text(encoding="utf-8")
    code = code[code.index('"case": plan.task.name') - 9 : code.index("return plain(data)")]
    fields = re.findall(r'^        (?:\*\*\(\{)?"(\w+)": ', code, flags=re.MULTILINE)
    assert {"energy_J", "verified", "contacts", "units"} <= set(fields)
    assert [name for name in fields if f"`{name}`" not in PAGES["docs/plan-json.md"].text] == []


def test_code_and_quoted_output_are_no_prose(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        "# T\n\nThe key `late` is a word. See [margins](late.md).\n\n```text\nreserve, late\n```\n"
    )
    assert Page(path).faults() == []


def test_pages_that_the_code_names_exist():
    """With their folder: docs/how-to/cycles.md."""
    names = {name for _, _, text in said_by_the_code() for name in re.findall(r"\bdocs/[\w/-]+\.md\b", text)}
    assert len(names) > 10
    assert [name for name in names if not (ROOT / name).exists()] == []
