"""The documentation site: `python -m sphinx -W docs site`.

Pages are those of this folder, four notebooks (executed), tables of the studies and docstrings. Formulas are
MathML, which browsers draw themselves: the site needs no network and no TeX.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
from pathlib import Path
from typing import NoReturn

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

from ocptip.cli.commands import COMMANDS
from ocptip.cli.main import parser

ROOT = Path(__file__).resolve().parents[1]
os.environ["COLUMNS"] = "80"  # of the help texts
RESULTS = "studies/results"

project = "ocptip"
author = copyright = "The ocptip authors"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "ocptip"
exclude_patterns = ["_build"]

myst_enable_extensions = ["colon_fence", "dollarmath"]
html_math_renderer = "mathml"
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_use_ivar = True
napoleon_use_rtype = False
suppress_warnings = [
    "ref.python"
]  # the shapes with which properties are described, (n, 3), are taken for types


def _copy_tables(app: Sphinx) -> None:
    """The studies' tables and figures become pages of the site."""
    target = Path(app.srcdir) / "results"
    shutil.rmtree(target, ignore_errors=True)
    for path in (ROOT / RESULTS).rglob("*"):
        if path.suffix in (".md", ".png", ".gif"):
            copy = target / path.relative_to(ROOT / RESULTS)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, copy)


def _write_help(app: Sphinx) -> None:
    """The help of all commands becomes a page."""
    texts = [f"## {c.name}\n\n```text\n{_help_of(c.name)}```\n" for c in COMMANDS]
    page = Path(app.srcdir) / "results" / "command_line.md"
    page.write_text("\n".join(["# All commands and options\n", *texts]), encoding="utf-8")


def _help_of(command: str) -> str:
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        parser().parse_args([command, "--help"])
    return text.getvalue()


def _inside(app: Sphinx, name: str, content: list[str]) -> None:
    """Links to what was copied lead there, and each table has a title."""
    content[0] = content[0].replace(f"](../{RESULTS}/", "](results/")
    content[0] = content[0].replace(f"](../../{RESULTS}/", "](../results/")
    if name.startswith("results/") and not content[0].startswith("# "):
        title = name.split("/")[-1].replace("_", " ").capitalize()
        content[0] = f"# {title}\n\n{content[0]}"


def _plain(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text with `names`: nothing but these is markup."""
    for i, line in enumerate(lines):
        parts = re.split(r"(^ *\* |`+[^`]*`+|:class:`[^`]*`)", line)
        parts[::2] = [re.sub(r"([*|\\])|_(?=\W|$)", lambda m: "\\" + m[0], part) for part in parts[::2]]
        lines[i] = "".join(re.sub(r"^`([^`]+)`$", r"``\1``", part) for part in parts)


def _formula(translator: HTML5Translator, node: nodes.Element) -> NoReturn:
    """A formula of a line, or in the text."""
    display = "block" if isinstance(node, nodes.math_block) else "inline"
    translator.body.append(convert(node.astext(), display=display))
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (_formula, None), (_formula, None))
    app.connect("builder-inited", _copy_tables)
    app.connect("builder-inited", _write_help)
    app.connect("source-read", _inside)
    app.connect("autodoc-process-docstring", _plain, priority=400)  # before napoleon
