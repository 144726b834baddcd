"""Samples of motions as CSV: numbers out of lines, and the motion between them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from ocptip.basics.errors import LARGEST, InputError, doubt_degrees, refuse_huge
from ocptip.basics.text import some
from ocptip.trajectories.csv_text import TextTable, one_row_per_time, plain_names, text_table, times_of
from ocptip.trajectories.fit import fitted
from ocptip.trajectories.points import REST, Points
from ocptip.trajectories.trajectory import Trajectory

POSITION, SPEED, ACCELERATION = "position", "velocity", "acceleration"
KINDS = (POSITION, SPEED, ACCELERATION)

_WORDS = {
    **dict.fromkeys(("position", "positions", "pos", "angle", "q"), POSITION),
    **dict.fromkeys(("velocity", "velocities", "vel", "speed", "qd"), SPEED),
    **dict.fromkeys(("acceleration", "accelerations", "acc", "accel", "qdd"), ACCELERATION),
}
_PER = {"": POSITION, "s": SPEED, "s2": ACCELERATION}
_NUMBERED = re.compile(r"(?P<word>q|qd|qdd)(?P<joint>[1-9][0-9]*)")
_UNIT = re.compile(r"[\s_]*[\[(]?(?<![A-Za-z])(?P<unit>deg|rad|m)(?:[_/](?P<per>s|s\^?2))?[\])]?")
_AT_END = re.compile(rf"(?P<body>.*?[\w\]])(?:{_UNIT.pattern})")
_APART = re.compile(r"[./\s_]+")


@dataclass(frozen=True)
class _Column:
    """A column of a joint, counted from 0; the unit is "" where the header says none."""

    number: int
    kind: str
    joint: int
    unit: str


@dataclass(frozen=True)
class CsvColumns:
    """Columns of a header, counted from 0.

    Attributes:
        joints: by quantity (`KINDS`) the column of every joint in the robot's order, or none.
        units: by quantity "deg", "rad" or "m" per joint.
    """

    joints: dict[str, list[int]]
    units: dict[str, list[str]]

    def scales(self, kind: str) -> np.ndarray:
        """(n,): SI unit per unit of the file."""
        return np.array([np.pi / 180 if unit == "deg" else 1.0 for unit in self.units[kind]])


def columns_of(
    header: Sequence[str], names: Sequence[str] | None, units: Sequence[str], unit: str | None
) -> CsvColumns:
    """Understand a header.

    Args:
        header: names of the columns.
        names: of the robot's joints; None: only numbered columns are known.
        units: "rad" or "m" per joint of the robot; empty: unknown.
        unit: "deg" or "rad", of columns of turning joints that say none; None: such columns are refused.

    Raises:
        InputError: a joint without position, a quantity twice, or a missing unit.
    """
    numbered = [c for k, text in enumerate(header) if (c := _numbered(k, text))]
    named = [c for k, text in enumerate(header) if (c := _named(k, text, names))]
    if any(column.kind == POSITION for column in named) or not numbered:
        result, n, titles = named, len(names or ()), list(names or ())
    else:
        result, n = numbered, max(column.joint for column in numbered) + 1
        titles = [f"q{joint + 1}" for joint in range(n)]
    joints: dict[str, list[int]] = {}
    own_units: dict[str, list[str]] = {}
    for kind in KINDS:
        of_joint: dict[int, _Column] = {}
        for column in result:
            if column.kind == kind and (other := of_joint.setdefault(column.joint, column)) is not column:
                texts = header[other.number], header[column.number]
                raise InputError(f"header: {texts[0]} and {texts[1]} are the same quantity")
        missing = [titles[joint] for joint in range(n) if joint not in of_joint]
        if not n or (missing and (kind == POSITION or of_joint)):
            raise InputError(_missing(kind, missing, numbered, names))
        ordered = [of_joint[joint] for joint in sorted(of_joint)]
        joints[kind] = [column.number for column in ordered]
        own_units[kind] = [_unit(header, column, units, unit) for column in ordered]
    return CsvColumns(joints, own_units)


def _numbered(number: int, text: str) -> _Column | None:
    """Column of q1_deg, qd1_deg_s, qdd1_deg_s2, with unit or without."""
    match = _NUMBERED.match(text)
    if match is None:
        return None
    rest, kind = text[match.end() :], _WORDS[match["word"]]
    unit = _UNIT.fullmatch(rest) if rest else None
    if rest and (unit is None or _PER[(unit["per"] or "").replace("^", "")] != kind):
        return None
    return _Column(number, kind, int(match["joint"]) - 1, unit["unit"] if unit else "")


def _named(number: int, text: str, names: Sequence[str] | None) -> _Column | None:
    """Column of a joint's name with a word for the quantity, or alone."""
    for joint, name in enumerate(names or ()):
        for body, unit in _bodies(text):
            match = re.fullmatch(rf"(?:(.*)[./\s_])?{re.escape(name)}(?:[./\s_](.*))?", body)
            if match is None:
                continue
            before, after = (_APART.split(part.strip("./ _")) if part else [] for part in match.groups())
            words = [w.lower() for w in (*before[-1:], *after) if w.lower() in _WORDS]
            topic = text.startswith("/") and not after
            if len(words) == 1 and len(after) <= 1 and (not after or after[0].lower() in _WORDS):
                return _Column(number, _WORDS[words[0]], joint, unit)
            if not words and not after and (not before or topic):
                return _Column(number, POSITION, joint, unit)
    return None


def _bodies(text: str) -> list[tuple[str, str]]:
    """The text as it is, and without the unit at its end."""
    match = _AT_END.fullmatch(text)
    return [(text, "")] + ([(match["body"].rstrip(" _"), match["unit"])] if match else [])


def _missing(
    kind: str, missing: Sequence[str], numbered: Sequence[_Column], names: Sequence[str] | None
) -> str:
    if numbered or not names:
        word, per = {POSITION: ("q", ""), SPEED: ("qd", "_s"), ACCELERATION: ("qdd", "_s2")}[kind]
        joint = missing[0].removeprefix("q") if missing else "1"
        hint = "" if names else ", and no joints are known by name"
        return f"header: {word}{joint}_deg{per} is missing{'' if numbered else hint}"
    return f"header: no {kind} of {some(list(missing))}; joints are known by name, or as q1_deg, q2_deg, ..."


def _unit(header: Sequence[str], column: _Column, units: Sequence[str], unit: str | None) -> str:
    """Unit of a column: that of its title, else m for joints that slide, else that of the user."""
    if column.unit:
        return column.unit
    if column.joint < len(units) and units[column.joint] == "m":
        return "m"
    if unit is None:
        raise InputError(
            f"header: {header[column.number]} says neither degrees nor radians; give --unit deg or "
            f"--unit rad, or call it {header[column.number]}_deg"
        )
    return unit


ENOUGH, JUMP = 8, 4.0  # rows and ratio of accelerations from which a file counts as cut off
NEAREST = 1e-4  # s: least distance of rows of a fit
SAME = 1e-8  # rad, m and rad/s, m/s: rows at one time may differ by this (rounding)
EXACT = 1e-4  # share of accelerations: rounding may change them by this if they are to be taken as given


def motion_of_table(
    table: TextTable, names: Sequence[str] | None, units: Sequence[str], unit: str | None
) -> Trajectory:
    """The motion of a table, see `ocptip.trajectories.read.load_motion`.

    Raises:
        InputError: it holds no motion; names line and column.
    """
    if not table.header:
        raise InputError(
            "is empty; expected profile commands, a joint trajectory, or columns time_s, q1_deg, q2_deg, ..."
        )
    times, clock = times_of(table)
    title = table.header[clock.columns[0]]
    long = one_row_per_time(table, times, clock.columns, names or ())
    if long is not table:
        times = times_of(long)[0]
    table = plain_names(long, names)
    columns = columns_of(table.header, names, units, unit)
    for kind in (POSITION, SPEED, ACCELERATION):
        require_units(columns.units[kind], units)
    wanted = list(chain(*columns.joints.values()))
    kept = [k for k, row in enumerate(table.rows) if any(row[c] for c in wanted)]  # not of other signals
    table = replace(table, rows=[table.rows[k] for k in kept], lines=[table.lines[k] for k in kept])
    if len(kept) < 2:
        raise InputError(f"times: at least two samples are needed, got {len(kept)}")
    cells = numbers_of(table, wanted)
    times = times[kept] - times[kept[0]]
    values = {
        kind: np.stack([cells[c] for c in places], axis=1) * columns.scales(kind)
        for kind, places in columns.joints.items()
        if places
    }
    _require_order(times, table.lines, title, values)
    motion = _as_given(times, values) or _fit(times, values, _rounding(table, columns))
    in_degrees = np.array(columns.units[POSITION]) == "deg"
    doubt_degrees("columns q_deg", np.rad2deg(values[POSITION][:, in_degrees]))
    return motion


def csv_table(text: str) -> tuple[list[str], np.ndarray]:
    """Header and numbers (N, columns) of a file.

    Raises:
        InputError: it is empty, or something is no number; names line and column.
    """
    table = text_table(text)
    if not table.rows:
        raise InputError("is empty; expected a line of names and lines of numbers")
    cells = numbers_of(table, range(len(table.header)))
    return table.header, np.column_stack(list(cells.values()))


def require_units(given: Sequence[str], units: Sequence[str]) -> None:
    """Refuse angles of joints that slide, and lengths of joints that turn.

    Args:
        given: "deg", "rad" or "m" per joint.
        units: "rad" or "m" per joint of the robot.
    """
    if len(given) == len(units):  # other numbers of joints are refused by the robot
        for joint, (unit_given, unit) in enumerate(zip(given, units, strict=True), 1):
            if (unit_given == "m") != (unit == "m"):
                slides = "moves in m" if unit == "m" else "turns"
                raise InputError(f"units: joint {joint} {slides}, but the motion gives {unit_given}")


def numbers_of(table: TextTable, wanted: Iterable[int]) -> dict[int, np.ndarray]:
    """Values (N,) by column; InputError names the cell that holds none."""
    return {
        column: _numbers_in(table.lines, table.header[column], [row[column] for row in table.rows])
        for column in wanted
    }


def _numbers_in(lines: Sequence[int], name: str, cells: Sequence[str]) -> np.ndarray:
    """(N,) values; cell by cell, which takes long, only where one of them is none."""
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError:
        values = np.array([np.nan])
    if np.all(np.abs(values) <= LARGEST):
        return values
    return np.array([_cell(line, name, cell) for line, cell in zip(lines, cells, strict=True)])


def _cell(line: int, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"line {line}, {name}: expected a number, got {text!r}") from None
    if not np.isfinite(value):
        raise InputError(f"line {line}, {name}: must be finite, got {text.strip()}")
    refuse_huge(f"line {line}, {name}", value)
    return value


def _require_order(
    times: np.ndarray, numbers: Sequence[int], name: str, values: dict[str, np.ndarray]
) -> None:
    """Refuse times that go back, and other states at the same time; acceleration steps are allowed."""
    later = np.diff(times)
    if (late := np.flatnonzero(later < 0)).size:
        row = int(late[0]) + 1
        raise InputError(f"line {numbers[row]}: {name} {times[row]:.9g} comes after {times[row - 1]:.9g}")
    for row in (np.flatnonzero(later == 0) + 1).tolist():
        states = [values[kind] for kind in (POSITION, SPEED) if kind in values]
        if max(np.abs(state[row] - state[row - 1]).max() for state in states) > SAME:
            text = f"{name} {times[row]:.9g} again, with other angles or speeds"
            raise InputError(f"line {numbers[row]}: {text}")


def _as_given(times: np.ndarray, values: dict[str, np.ndarray]) -> Trajectory | None:
    """The motion whose accelerations are those of the file; None if it has none, or they do not fit."""
    if len(values) < 3 or len(times) < 2:
        return None
    begins = np.flatnonzero(np.diff(times, prepend=-1.0) > 0)
    ends = np.append(begins[1:] - 1, len(times) - 1)
    angles, speeds, given = (values[kind] for kind in (POSITION, SPEED, ACCELERATION))
    if len(begins) < 2:
        return None
    motion = Trajectory.from_points(
        times[begins], angles[begins], speeds[begins], given[ends], before=given[begins]
    )
    most = np.max(np.abs(given), axis=0)
    return motion if np.all(motion.acceleration_peaks <= most * (1 + EXACT) + REST) else None


def _fit(times: np.ndarray, values: dict[str, np.ndarray], rounding: np.ndarray) -> Trajectory:
    kept = _spaced(times)
    angles, speeds = values[POSITION][kept], values.get(SPEED)
    if speeds is None:
        _refuse_cut(times[kept], angles)
    else:
        speeds = speeds[kept]
    points = Points(times[kept], angles, speeds)  # complains about what cannot be a motion
    return fitted(points.times, points.angles, rounding=rounding, speeds=points.speeds)


def _rounding(table: TextTable, columns: CsvColumns) -> np.ndarray:
    """(n,): half a unit of the last digit that positions usually have, rad or m; equal ones count once."""
    cells = (list(set(table.texts(column))) for column in columns.joints[POSITION])
    digits = [np.median(_decimals(np.array(row))) for row in cells]
    return 0.5 * 10.0 ** -np.array(digits) * columns.scales(POSITION)


def _decimals(cells: np.ndarray) -> np.ndarray:
    """(N,): decimal places that numbers are written with."""
    mantissas, _, exponents = np.strings.partition(np.strings.lower(np.strings.strip(cells)), "e")
    places = np.strings.str_len(np.strings.partition(mantissas, ".")[2])
    return places - np.where(exponents == "", "0", exponents).astype(int)


def _spaced(times: np.ndarray) -> list[int]:
    """Rows whose times are not too near to the one kept before; the last row always."""
    kept: list[int] = []
    for row, time in enumerate(times):
        if not kept or time - times[kept[-1]] >= NEAREST:
            kept.append(row)
    if kept and kept[-1] != len(times) - 1:
        if len(kept) > 1:
            kept.pop()
        kept.append(len(times) - 1)
    return kept


def _refuse_cut(times: np.ndarray, angles: np.ndarray) -> None:
    """Refuse angles (N, n) that begin or end in full motion, as those of a file that is cut off.

    A motion comes to rest in about the way in which it moves otherwise: the acceleration that would take the
    speed between the last two samples to zero is of the size of the others.
    """
    if len(times) < ENOUGH:
        return
    widths = np.diff(times)[:, None]
    speeds = np.diff(angles, axis=0) / widths
    inside = np.max(np.abs(np.diff(speeds, axis=0)) / (0.5 * (widths[1:] + widths[:-1])), axis=0)
    ends = 2 * np.abs(speeds[[0, -1]]) / widths[[0, -1]]
    for end, (where, verb) in zip((0, -1), (("first", "begins"), ("last", "ends")), strict=True):
        usual = np.maximum(inside, ends[-1 - end])
        moving = (np.abs(speeds[end]) > REST) & (ends[end] > JUMP * usual)
        if moving.any():
            joint = int(np.argmax(moving))
            raise InputError(
                f"the motion {verb} before it rests: between the {where} two rows joint {joint + 1} moves "
                f"with {abs(speeds[end, joint]):.4g} rad/s (or m/s); is the file cut off? Else add a row "
                f"{'before' if end == 0 else 'after'} it with the same positions"
            )
