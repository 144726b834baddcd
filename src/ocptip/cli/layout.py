"""Layout that several commands share: tables, names and texts below each other, entries of JSON."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.basics.text import WIDTH, quantity, table, wrapped

if TYPE_CHECKING:  # most of them take long to load, and `ocptip stand` needs none
    from ocptip.motion.check import MotionCheck
    from ocptip.motion.cycles.check import CycleCheck
    from ocptip.motion.stops.check import Stops
    from ocptip.motion.tolerated import Tolerated
    from ocptip.standing.at_rest.sensitivity import Sensitivity
    from ocptip.standing.mechanism import StandingMechanism


_NARROWEST = 20  # characters of a column that is broken
_PRICES = {
    "energy": ("energy_more", "energy"),
    "time": ("duration_more", "duration"),
    "both": ("cost_more", "cost (energy and time)"),
}
_NAMED = 3  # names of files in the last lines
_WIDEST = 7  # characters of the names of lines, at least
_LONG_NOTE = 140  # characters
_NAMES = re.compile(r"[^\s,;:()]+(?:, [^\s,;:()]+){4,}(?=$|[;:]| )")  # five and more single words


def named(lines: Sequence[tuple[str, str]], least: int = 0) -> list[str]:
    """Lines of names and texts, the texts below each other, names at least so wide."""
    width = max((least, *(len(name) for name, _ in lines)))
    return [f"{name:<{width}}  {text}" for name, text in lines]


def headlines(head: str) -> list[str]:
    """The first line of an answer, broken at 80 columns."""
    return textwrap.wrap(head, WIDTH, subsequent_indent=" " * 8, break_on_hyphens=False)


def headline_of(text: str) -> str:
    """The headline of an answer as one line, see `headlines`."""
    first, *rest = text.split("\n")
    return " ".join([first, *(line.strip() for line in takewhile(_goes_on, rest))])


def _goes_on(line: str) -> bool:
    return line[:8].isspace() and not line[8:9].isspace()


def fitted(lines: Sequence[tuple[str, str]]) -> list[str]:
    """The same as `named`, texts broken at 80 columns."""
    width = 2 + max((len(name) for name, _ in lines), default=0)
    return [line for name, text in lines for line in wrapped(name, [text], width)]


def masses(robot: StandingMechanism) -> str:
    """What moves and what it stands on: "base 35 kg, arm 14.4 kg, payload 5 kg (point mass at ...)"."""
    parts = [f"{name} {quantity(mass, 'kg')}" for name, mass in robot.masses.items()]
    held = f" ({robot.payload})" if robot.payload else ""
    return f"{', '.join(parts)}{held}; together {quantity(robot.mass, 'kg')}"


def joint_numbers(robot: StandingMechanism) -> str:
    """By which numbers worst cases name joints and links."""
    names = ", ".join(f"{number} {name}" for number, name in enumerate(robot.names, 1))
    return f"{names}; link k is behind joint k"


def under(name: str, texts: Iterable[object]) -> list[tuple[str, str]]:
    """Named lines of several texts; the first has the name."""
    return [("" if k else name, f"{text}") for k, text in enumerate(texts)]


def brief_notes(notes: Iterable[str], verbose: bool) -> list[str]:
    """Notes with long lists of names cut to the first ones and a number, unless all is asked for."""
    results = []
    for note in notes:
        brief = _NAMES.sub(_first_names, note) if len(note) > _LONG_NOTE and not verbose else note
        results.append(brief if brief == note else f"{brief} (-v lists all)")
    return results


def _first_names(names: re.Match[str]) -> str:
    every = names[0].split(", ")
    return f"{', '.join(every[:3])} and {len(every) - 3} more"


def changes_table(sensitivities: Sequence[Sensitivity], title: str = "") -> list[str]:
    """The worst values as they are and after each change; empty without changes."""
    if not sensitivities:
        return []
    case = "worst case" if sensitivities[0].worst_case else "nominal"
    rows = [[f"{title}, {case}" if title else case, *sensitivities[0].before.TITLES]]
    rows += [
        ["as it is", *sensitivities[0].before.cells()],
        *([one.change, *one.after.cells()] for one in sensitivities),
    ]
    known = [k for k in range(len(rows[0])) if any(row[k] != "-" for row in rows[1:])]
    return table([[row[k] for k in known] for row in rows], left=(0,))


def check_rows(
    robot: StandingMechanism, checked: MotionCheck, robustness: Sequence[Tolerated]
) -> list[tuple[str, str]]:
    """Detailed rows about a motion, or a cycle."""
    return [
        *([("joints", joint_numbers(robot))] if robot.arm is not None else []),
        *under("contacts", checked.contacts.lines()),
        *under("compliant feet", checked.feet_lines),
        *under("elastic joints", checked.drive_lines),
        ("collision", checked.collision_text),
        *within_rows(checked),
        *under("robust to", tolerated_lines(robustness)),
    ]


def tolerated_lines(tolerateds: Sequence[Tolerated]) -> list[str]:
    """Robustness, a line for each deviation; one line for a nominal motion that loses a contact."""
    for one in tolerateds:
        if one.quantity == "tilt" and one.value == 0 and not one.at_most:
            return [f"nothing: the nominal model loses a contact ({one.how}, {one.time:.3f} s)"]
    return [f"{one}" for one in tolerateds]


def gear_rows(segments: CycleCheck) -> list[tuple[str, str]]:
    """The vibration of a cycle's segments with elastic joints, each from rest."""
    pairs = zip(segments.names, segments.segments, strict=True)
    return under(
        "elastic joints", [f"{name}: {line}" for name, driven in pairs for line in driven.drive_lines]
    )


def within_rows(checked: MotionCheck) -> list[tuple[str, str]]:
    """Result of a check within an uncertainty; nothing without one."""
    if (within := checked.within) is None:
        return []
    texts = [f"{within.tolerance}"]
    texts += [
        f"worst {name}: {instant}"
        for name, instant in (("tipping", within.tip), ("slip", within.slip))
        if instant
    ]
    if within.gap:
        texts.append(f"minimum clearance: {within.gap}")
    return under("uncertainty", texts)


def price_line(price: Mapping[str, Any]) -> list[str]:
    """The cost of plans with stops, in words: that of the objective against the plan without them."""
    if not price:
        return []
    name, word = _PRICES[price["objective"]]
    costs, more = price["without_stops"], 100 * price[name]
    than = f"the plan without, {costs['energy_J']:.1f} J in {costs['duration_s']:.3f} s"
    luck = "; that plan is a worse local optimum" if more < -0.05 else ""
    return [f"cost of stops: {round(more, 1) + 0.0:+.1f} % {word} against {than}{luck}"]


def stop_table(stops: Stops) -> list[str]:
    """Largest safe share of the planned speed over time, and how long stops take."""
    titles = {"path": "on its path", "brakes": "by brakes", "cancel": "on cancel"}
    known = []
    for kind, speeds in stops.speeds.items():
        known += [(titles[kind], speeds, "{:.2f}"), ("takes", stops.durations[kind], "{:.3f} s")]
    rows = [["stopped at", *(title for title, _, _ in known)]]
    for i, time in enumerate(stops.times):
        cells = [
            form.format(values[i]) if np.isfinite(values[i]) else "never rests" for _, values, form in known
        ]
        rows.append([f"{time:.3f} s", *cells])
    about = "(contacts in the nominal model; clearance and joint range do not count)"
    return ["largest safe share of the planned speed", about, *table(rows, left=())]


def summary(head: str, lines: Sequence[tuple[str, str]], written: Sequence[Path]) -> str:
    """A headline and named lines, the written files last: an early answer has none and is the beginning."""
    return "\n".join([head, *named(lines, _WIDEST), *files_lines(written)])


def files_lines(written: Sequence[Path], following: str = "") -> list[str]:
    """The last lines of an answer: what was written, and which commands come next, "{}" being its folder."""
    if not written:
        return []
    folder = written[0].parent
    inside = [path for path in written if path.is_relative_to(folder)]
    names = [*dict.fromkeys(path.relative_to(folder).parts[0] for path in inside)]
    others = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    lines = ["", f"Files   {folder}{os.sep}: {', '.join(names[:_NAMED])}{others}"]
    lines += [f"        {path}" for path in written if path not in inside]
    return lines + ([f"Next    {following.format(folder)}"] if following else [])


def narrowed(rows: Sequence[Sequence[str]], column: int) -> list[list[str]]:
    """Rows of a table that fits on 80 columns: texts of one column go on in rows below."""
    others = (max(len(row[k]) for row in rows) + 2 for k in range(len(rows[0])) if k != column)
    width, result = max(WIDTH - sum(others), _NARROWEST), list[list[str]]()
    for row in rows:
        for number, text in enumerate(textwrap.wrap(row[column], width) or [""]):
            result.append([text if k == column else cell * (not number) for k, cell in enumerate(row)])
    return result
