"""Numbers and names as people read them, for tables, pictures and messages."""

from __future__ import annotations

import difflib
import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # `ocptip --help` loads no numerics
    import numpy as np

WIDTH = 80
"""Characters of a line of output."""

_FIXED = "\xa0"  # a space at which no line ends
_UNIT = re.compile(r"(?<=\d) (?=%|[a-zA-Z])")  # between a number and its unit

NOISE = 1e-9
"""Values below this, relative to the largest one beside them, are shown as zero."""


def without_noise(values: np.ndarray) -> np.ndarray:
    """Zero where a value is nothing but rounding; NaN and infinity stay."""
    sizes, shown = abs(values), values.copy()
    shown[sizes <= NOISE * sizes[sizes < math.inf].max(initial=0.0)] = 0.0
    return shown


def ratio(value: float) -> str:
    """A dimensionless number of the size of one: "0.166", "infinite", "-"."""
    if not math.isfinite(value):
        return "infinite" if value > 0 else "-"
    return f"{value if abs(value) > NOISE else 0.0:.3g}"


def percent(share: float) -> str:
    """A share: "16 %", "-"."""
    return f"{100 * share:.0f} %" if math.isfinite(share) else "-"


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A quantity: "116.5 N", "unlimited", "-"."""
    if not math.isfinite(value):
        return "unlimited" if value > 0 else "-"
    return f"{value + 0.0:.{digits}g} {unit}"


def wrapped(name: str, texts: Iterable[str], wide: int = 8) -> list[str]:
    """Texts with a name before the first, in so wide a column, broken at 80 columns."""
    lines, below = [], " " * wide
    for text in (_UNIT.sub(_FIXED, text) for text in texts):
        first = below if lines else f"{name:<{wide}}"
        lines += textwrap.wrap(
            text, WIDTH, initial_indent=first, subsequent_indent=below, break_on_hyphens=False,
            break_long_words=False,
        )  # fmt: skip
    return [line.replace(_FIXED, " ") for line in lines]


def joint_words(names: Iterable[str], units: Iterable[str], q: np.ndarray) -> str:
    """Values (n,) of joints with their names: "lift 0.2 m, elbow 30 deg"."""
    known = {"rad": ("deg", 180 / math.pi)}
    joints = [
        (name, *known.get(unit, (unit, 1.0)), value)
        for name, unit, value in zip(names, units, q, strict=True)
    ]
    return ", ".join(f"{name} {quantity(scale * value, unit)}" for name, unit, scale, value in joints)


def margin_text(value: float, unit: str, digits: int = 3) -> str:
    """A margin, and below zero what is missing: "27.1 N m", "-12.3 N m: 12.3 N m are missing"."""
    text = quantity(value, unit, digits)
    return f"{text}: {text[1:]} are missing" if value < 0 else text


def towards(side: np.ndarray) -> str:
    """A direction in words: "towards -y", "towards (0.71, -0.71, 0)"."""
    unit = side / max(math.hypot(*side), 1e-300)
    k = int(abs(unit).argmax())
    if abs(unit[k]) > 0.999:
        return f"towards {'-' if unit[k] < 0 else '+'}{'xyz'[k]}"
    return "towards ({})".format(", ".join(f"{x:.2g}" for x in unit.round(2) + 0.0))


def with_error(value: float, half: float, unit: str = "") -> str:
    """A value and half the width of its interval, to two digits of that: "0.208 +- 0.0045 kg"."""
    unit = f" {unit}" if unit else ""
    if not (math.isfinite(half) and half > 0):
        return f"{value:.4g}{unit}"
    digits = 1 - math.floor(math.log10(half))
    texts = (f"{round(number, digits) + 0.0:.{max(digits, 0)}f}" for number in (value, half))
    return " +- ".join(texts) + unit


def enumerated(names: Sequence[str]) -> str:
    """Some names, all of them: "a, b and c"."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def numbered(word: str, numbers: Iterable[int]) -> str:
    """Things by their rising numbers: "link 3", "links 1 to 3, 5"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    parts = [f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs]
    return f"{word}{'s' * (len(runs) > 1 or len(runs[0]) > 1)} {', '.join(parts)}"


def some(names: Sequence[str], most: int = 5) -> str:
    """The first of some names, and how many more there are: "a, b and 3 more"."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """The known name nearest to a wrong word: "; did you mean 'mass'?", "" if none is near."""
    near = difflib.get_close_matches(str(word), list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def of_known(word: object, known: Iterable[str], instead: Iterable[str] = ()) -> str:
    """A suggestion for a wrong word, and the known words: "; did you mean 'mass'? known: mass, center".

    Args:
        word: the wrong one.
        known: words that are right.
        instead: further words that would be right in place of some of these.
    """
    known = list(known)
    return f"{did_you_mean(word, [*known, *instead]) or ';'} known: {', '.join(known) or 'none'}"


def table(rows: Sequence[Sequence[str]], left: Sequence[int]) -> list[str]:
    """Lines of a table; the columns in `left` are flush left, the others right."""
    widths = [max(len(row[c]) for row in rows) for c in range(len(rows[0]))]
    return [
        "  ".join(
            f"{cell:<{w}}" if c in left else f"{cell:>{w}}"
            for c, (cell, w) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def silent(text: str) -> None:
    """Show nothing, where nobody wants to know what is done next."""
