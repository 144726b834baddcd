"""Pages of a document as HTML and PDF: title block, headings, tables, figures. No page needs other files."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK
from ocptip.pictures.frame import png

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }
h1, h2 { line-height: 1.2 } h2 { margin-top: 2em; border-bottom: 1px solid #d0d0d0 }
.verdict { font-weight: 600; padding: 8px 12px; border-left: 6px solid }
.good { color: #1a7f37 } .bad { color: #c0281e } .near { color: #b35c00 }
td.bad, td.near { font-weight: 600; white-space: nowrap }
.beside { float: right; width: 27%; margin: 0 0 1em 1em }
figure { margin: 1em 0 } figcaption { color: #555; font-size: 13px } h2 { clear: both }
table { border-collapse: collapse; font-size: 13px; margin: 1em 0 }
td, th { padding: 2px 10px; text-align: left; vertical-align: top } td:first-child { white-space: nowrap }
th { border-bottom: 1px solid #808080 } tr:nth-child(even) td { background: #f5f5f5 }
img { max-width: 100% } code { background: #f0f0f0; padding: 0 3px }
@media print {
  body { font-size: 11px; margin: 0 } table { font-size: 10px }
  h2 { break-after: avoid } tr, img { break-inside: avoid } h2:first-of-type { break-before: page }
}
"""


_SHARE = "data-width"
_LINE, _SHORT = 116, 12  # characters: of a line of a table in a PDF; texts up to this are not broken


def page(title: str, parts: Iterable[str]) -> bytes:
    """A whole page of parts made by the functions below."""
    about = f"<meta charset='utf-8'><meta name='generator' content='{MARK}'><title>{escape(title)}</title>"
    head = f"<!doctype html><html lang='en'><head>{about}"
    return f"{head}<style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n".encode()


def heading(text: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{escape(text)}</h{level}>"


def verdict(text: str, good: bool) -> str:
    """The answer, coloured."""
    return f"<p class='verdict {'good' if good else 'bad'}'>{escape(text)}</p>"


def paragraph(text: str) -> str:
    """A paragraph; `words` in backquotes are code."""
    pieces = escape(text).split("`")
    pieces[1::2] = [f"<code>{piece}</code>" for piece in pieces[1::2]]
    return f"<p>{''.join(pieces)}</p>"


def items(texts: Iterable[object]) -> str:
    """A list."""
    return f"<ul>{''.join(f'<li>{escape(str(text))}</li>' for text in texts)}</ul>"


def grid(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table with a line of titles, unless these are empty."""
    texts = [[str(cell) for cell in row] for row in rows]
    widths = _widths([titles, *texts])
    names = "".join(f"<th{wide}>{escape(title)}</th>" for wide, title in zip(widths, titles, strict=True))
    head = f"<thead><tr>{names}</tr></thead>" if any(titles) else ""
    lines = []
    for number, row in enumerate(texts):
        first = widths if not head and not number else ("",) * len(row)
        cells = "".join(
            f"<td{wide}{_mark(cell)}>{_cell(cell)}</td>" for wide, cell in zip(first, row, strict=True)
        )
        lines.append(f"<tr>{cells}</tr>")
    return f"<table>{head}<tbody>{''.join(lines)}</tbody></table>"


def _widths(rows: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """The attribute of each column for a PDF: its share of the width; short texts are not broken."""
    titles, *texts = rows
    words = [[*title.split(), *cells] for title, *cells in zip(titles, *texts, strict=True)]
    longest = [max(map(len, column), default=0) + 2 for column in words]
    wide = max(longest, default=0)
    while wide > _SHORT and sum(min(length, wide) for length in longest) > _LINE:
        wide -= 1
    shares = [min(length, wide) for length in longest]
    return tuple(f" {_SHARE}='{100 * share / sum(shares):.1f}%'" for share in shares)


_MARKS = {"NO": "bad", "BROKEN": "bad", "tips": "bad", "slips": "bad", "<- critical": "near"}


def _mark(value: str) -> str:
    """The attribute of a cell that should be seen first."""
    return f" class='{_MARKS[value]}'" if value in _MARKS else ""


def _cell(value: str) -> str:
    """Numbers stay on a line with their units."""
    text = escape(value)
    return text.replace(" ", "&nbsp;") if len(text) < 24 else text


def picture(figure: Any, caption: str, *, beside: bool = False) -> str:
    """A matplotlib figure inside the page; beside the text that follows it, or alone."""
    return image(png(figure, small=True), caption, beside=beside)


def image(content: bytes, caption: str, *, beside: bool = False) -> str:
    """A PNG inside the page."""
    data, text = b64encode(content).decode("ascii"), escape(caption)
    where = " class='beside'" if beside else ""
    return (
        f"<figure{where}><img src='data:image/png;base64,{data}' alt='{text}'>"
        f"<figcaption>{text}</figcaption></figure>"
    )


def pdf(title: str, parts: Iterable[str]) -> bytes:
    """A document with this title and these parts, as PDF.

    Raises:
        InputError: fpdf2, which makes it, is not there.
    """
    try:
        from fpdf import FPDF, TextStyle
    except ImportError:
        raise InputError("--out: a .pdf needs fpdf2 (pip install 'ocptip[report]'); .html does not") from None
    document = FPDF(format="A4")
    document.set_title(title)
    document.set_keywords(MARK)
    document.add_page()
    document.set_font("helvetica", size=9)
    text = "".join(parts).replace("&nbsp;", " ")
    known = (
        ("<figure class='beside'><img ", "<p><img width='200' "),
        ("<figure><img ", "<p><img width='380' "),
        ("</figure>", "</p>"),
        ("<figcaption>", "</p><p>"),
        ("</figcaption>", ""),
    )
    for tag, wanted in (
        *known,
        ("<td", "<td align='left'"),
        (_SHARE, "width"),
    ):
        text = text.replace(tag, wanted)
    styles = {f"h{k}": TextStyle(font_size_pt=size, t_margin=6, b_margin=2) for k, size in ((1, 18), (2, 13))}
    document.write_html(
        text.encode("latin-1", "replace").decode("latin-1"), table_line_separators=True, tag_styles=styles
    )
    return bytes(document.output())


def blank(text: str) -> str:
    """A text of the title block, or a line to write on."""
    return text or "_" * 24
