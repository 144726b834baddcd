"""How README and docs read: words, length of sentences, reading ease, banned words, cells, repository paths.

A page is measured as a reader sees it: code, headings and addresses of links do not count as prose.
Paragraphs and list items do. Table cells are measured by themselves. `tests/test_words.py` keeps the rules.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from studies.common import table
from studies.words.code import module, words_of

ROOT = Path(__file__).resolve().parents[2]
WORDS, MEAN, LONGEST, CELL, EASE = 1500, 18.0, 25, 15, 50.0
"""Maximum words of a page, mean and maximum words of a sentence, maximum words of a cell; minimum ease."""

GENERATED = "task-file-reference.md"
"""The reference of all keys, which nobody reads from its beginning to its end."""

BANNED = {
    r"reserves?": "margin",
    r"persist\w*": "contacts maintained, stable",
    r"as described|as it is described": "nominal",
    r"worlds": "scenarios",
    r"tolerates|tolerated": "robustness, withstands",
    r"(?<!_)price": "cost, energy penalty",
    r"late|lateness": "delayed, delay",
    r"jump(s|ed|ing)?": "acceleration step",
    r"events?": "switching time",
    r"pace": "speed override",
    r"gripper point": "TCP",
    r"(inverse )?branch(es)?(?!-and|:)": "IK solution",
    r"passive joints?": "non-optimised joint, unactuated joint",
    r"plainest": "synchronised default motion",
    r"bindings?": "contact model",
    r"(printed|effective) (base|ones|data)": "as-published, identified base",
    r"the source('s)?": "author, title, year, section",
    r"(feet|gears|contacts) (that|which) give": "compliant feet, elastic joints",
    r"ramps?": "trapezoidal velocity profile",
    r"house|judges?|judged|doings|said|own|found|told": "(name the actor and the thing)",
    r"look(s|ed|ing)? (at|for)": "check, search",
    r"ways?(?! to)": "path, method",
    r"hardly|anew|all but|ours|dear|dearer|frugal|in one sitting|somebody else('s)?": "(standard words)",
    r"greatest|least(?![- ]squares)(?<!at least)": "maximum, minimum",
    r"by so much|so many": "by X",
    r"certified": "proved",
    r"(?<=[a-z]), too(?! \w)": "also",
}
"""What docs do not use, and what to say instead; quoted output, code and names of keys do not count."""


VAGUE = {"house", "judge", "judges", "judged", "doing", "doings", "look", "looks", "looked", "room", "ways"}
VAGUE |= {"said", "told", "ours", "dear"}
"""Words that no name in the code has: they do not say what a thing is."""


@dataclass(frozen=True)
class Page:
    """One Markdown file or notebook."""

    path: Path

    @cached_property
    def text(self) -> str:
        """Of a notebook: its cells of text."""
        text = self.path.read_text(encoding="utf-8")
        if self.path.suffix != ".ipynb":
            return text
        cells = (c for c in json.loads(text)["cells"] if c["cell_type"] == "markdown")
        return "\n\n".join("".join(cell["source"]) for cell in cells)

    @cached_property
    def words(self) -> int:
        return len(self.text.split())

    @cached_property
    def _plain(self) -> str:
        """Without code blocks, comments, formulas, images and addresses; a code span is one word."""
        text = re.sub(r"^(```+|:::+).*?^\1\s*$", "", self.text, flags=re.DOTALL | re.MULTILINE)
        text = re.sub(r"^\$\$.*?^\$\$", "", text, flags=re.DOTALL | re.MULTILINE)
        text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
        text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
        text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
        text = re.sub(r"`+[^`]+`+|\$[^$\n]+\$", "X", text)
        return re.sub(r"[*_]{1,2}(?=\w)|(?<=[\w.])[*_]{1,2}", "", text)

    @cached_property
    def cells(self) -> list[str]:
        """Of all tables, heads included."""
        rows = [line for line in self._plain.splitlines() if line.startswith("|")]
        return [cell.strip() for row in rows for cell in row.strip("| ").split("|") if set(cell) - set("-: ")]

    @cached_property
    def sentences(self) -> list[str]:
        """Of paragraphs and list items."""
        parts: list[str] = [""]
        for line in self._plain.splitlines():
            item = re.match(r"\s*([-*]|\d+\.) ", line)
            if not line.strip() or item or re.match(r"[#|:>]|---|\(.*\)=$", line):
                parts.append("")
            if not re.match(r"[#|:]|---|\(.*\)=$", line):
                parts[-1] += f" {line[item.end() :] if item else line}"
        split = [re.split(r"(?<=[.!?])[\"')]?\s+(?=[A-Z0-9X])|:\s*$", part.strip()) for part in parts]
        return [s for part in split for s in part if s and len(s.split()) > 1]

    @property
    def mean(self) -> float:
        """Words of a sentence."""
        return sum(map(_length, self.sentences)) / max(len(self.sentences), 1)

    @property
    def longest(self) -> str:
        return max(self.sentences, key=_length, default="")

    @property
    def ease(self) -> float:
        """Flesch reading ease: above 50 plain, below 30 very difficult."""
        words = [w for s in self.sentences for w in re.findall(r"[A-Za-z]+", s)]
        return 206.835 - 1.015 * self.mean - 84.6 * sum(map(_syllables, words)) / max(len(words), 1)

    def banned(self) -> Iterator[str]:
        """Word, what is around it, and what to use instead."""
        return banned(re.sub(r"\s*\n\s*(?![\n#|])", " ", self._plain))

    def long_cells(self) -> list[str]:
        return [cell for cell in self.cells if _length(cell) > CELL]

    def repository_paths(self) -> list[str]:
        """Paths that are there in the repository but not where ocptip is installed."""
        return re.findall(r"\bsrc/ocptip[\w/.]*", self.text)

    def faults(self) -> list[str]:
        """What breaks the rules; empty: the page is finished."""
        faults = [f"banned {what}" for what in self.banned()]
        faults += [f"cell of {_length(cell)} words: {cell}" for cell in self.long_cells()]
        faults += [f"path of the repository: {path}" for path in self.repository_paths()]
        if self.words > WORDS and self.path.name != GENERATED:
            faults.append(f"{self.words} words, at most {WORDS}")
        if self.mean > MEAN:
            faults.append(f"{self.mean:.1f} words per sentence, at most {MEAN}")
        if _length(self.longest) > LONGEST:
            faults.append(f"sentence of {_length(self.longest)} words: {self.longest}")
        return faults


def banned(text: str) -> Iterator[str]:
    """Word, what is around it, and what to use instead."""
    for pattern, instead in BANNED.items():
        for match in re.finditer(rf"\b(?:{pattern})\b", text, flags=re.IGNORECASE):
            around = text[max(match.start() - 30, 0) : match.end() + 30].replace("\n", " ")
            yield f"{match[0]!r} in '...{around}...': {instead}"


def texts_of_code() -> Iterator[tuple[str, str, str]]:
    """Kind ("docstring" or "message"), place and text of all that people read in the modules of ocptip."""
    for path in sorted((ROOT / "src").rglob("*.py")):
        for is_docstring, line, text in module(path).texts:
            if is_docstring or " " in text.strip():
                plain = re.sub(r"`+[^`]+`+", "X", text)
                if is_docstring:  # names of arguments and attributes are code, as examples are
                    plain = re.sub(r"^( *).*::\n\n(?:\1 +.*\n|\n)+", "", plain, flags=re.MULTILINE)
                    plain = re.sub(r"^ +[\w, ]+:(?= )", "", plain, flags=re.MULTILINE)
                kind = "docstring" if is_docstring else "message"
                yield kind, f"{path.relative_to(ROOT)}:{line}", re.sub(r"\s+", " ", plain)


def vague_names() -> Iterator[str]:
    """Place and name of functions, classes, arguments and variables of ocptip with a word of `VAGUE`."""
    for path in sorted((ROOT / "src").rglob("*.py")):
        for name, line in module(path).names.items():
            if not VAGUE.isdisjoint(words_of(name)):
                yield f"{path.relative_to(ROOT)}:{line}: {name}"


def _length(text: str) -> int:
    return len(re.findall(r"[\w'.,-]*\w[\w'.,-]*", text))


def _syllables(word: str) -> int:
    word = re.sub(r"(?<![td])ed$|(?<!c)(?<!s)(?<!x)(?<!z)(?<!g)(?<!h)es$|(?<!l)e$", "", word.lower())
    return max(len(re.findall(r"[aeiouy]+", word)), 1)


def pages() -> list[Page]:
    """README, pages and notebooks of docs, not those that the site's builder makes."""
    docs = ROOT / "docs"
    made = {docs / "results", docs / "_build"}
    files = [
        p for p in sorted([*docs.rglob("*.md"), *docs.glob("notebooks/*.ipynb")]) if not made & set(p.parents)
    ]
    return [Page(path) for path in (ROOT / "README.md", *files)]


def main() -> None:
    """Print the table, or the faults of the pages that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", nargs="*", type=Path, help="list the faults of these pages")
    parser.add_argument("--code", action="store_true", help="list banned words of docstrings and messages")
    options = parser.parse_args()
    named = options.page
    for kind, place, text in texts_of_code() if options.code else ():
        for word in banned(text):
            print(f"{place}: {kind}: {word}")
    for name in vague_names() if options.code else ():
        print(f"{name}: a name says what the thing is")
    for page in map(Page, named):
        print(f"{page.path}: {page.words} words, {page.mean:.1f} per sentence, ease {page.ease:.0f}")
        print(*(f"  {fault}" for fault in page.faults()), sep="\n")
    if not named and not options.code:
        head = ("page", "words", "mean", "longest", "ease", "banned", "cells", "paths")
        rows = [
            (
                str(page.path.relative_to(ROOT)),
                str(page.words),
                f"{page.mean:.1f}",
                str(_length(page.longest)),
                f"{page.ease:.0f}",
                str(len(list(page.banned()))),
                str(len(page.long_cells())),
                str(len(page.repository_paths())),
            )
            for page in pages()
        ]
        print(*table(head, rows), sep="\n")


if __name__ == "__main__":
    main()
