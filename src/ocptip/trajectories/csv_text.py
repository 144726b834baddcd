"""Tables of numbers as programs write them: separators, headers, arrays, and one line per joint.

Every dialect becomes the same: a header, and lines of as many cells, with decimal points. What may mean two
things is refused, with what would make it clear.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from decimal import Decimal, InvalidOperation

import numpy as np

from ocptip.basics.errors import InputError, refuse_huge
from ocptip.basics.text import did_you_mean

_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas"}
_SAMPLE = 20  # lines by which a separator is judged
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_DECIMAL_POINT = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?")
_JOINT_TITLES = ("joint", "joint_name", "name")
_INDEX = r"(?:\[(?P<index>\d+)\]|_?(?P<number>\d+))"
_NAME_OF = re.compile(rf"(?P<before>(?:.*[./_])?)name{_INDEX}")
_VALUE_OF = re.compile(rf"(?P<before>(?:.*[./_])?)(?P<word>position|velocity|acceleration|effort){_INDEX}")
_SHORT = {
    **dict.fromkeys(("q", "position", "positions", "joint_position", "pos"), "q"),
    **dict.fromkeys(("qd", "dq", "velocity", "velocities", "joint_velocity", "vel"), "qd"),
    **dict.fromkeys(("qdd", "ddq", "acceleration", "accelerations", "acc"), "qdd"),
    **dict.fromkeys(("tau", "tau_J", "effort", "efforts", "torque"), "tau"),
}
_WORDS = "|".join(sorted(_SHORT, key=len, reverse=True))
_ARRAY = re.compile(
    rf"(?P<before>(?:.*[./_\s])?)(?P<word>{_WORDS})(?:\[(?P<index>\d+)\]|_(?P<low>\d+)|(?P<glued>\d+))(?P<rest>(?:[\s_\[(].*)?)"
)
_PLAIN = re.compile(r"(?:q|qd|qdd|tau)[1-9]\d*(?:\D.*)?")  # names that are known as they are
_FROM_ZERO = re.compile(r"(?:q|qd|qdd|tau)0(?:\D.*)?")
_BRACKETS = re.compile(rf"(?P<before>(?:.*[./\s_])?(?:{_WORDS}))\[(?P<name>[^\]]*\D[^\]]*)\](?P<rest>.*)")
_MEANT = ("target", "desired", "command", "commanded", "reference", "error")


@dataclass(frozen=True, eq=False)
class TextTable:
    """A table whose cells are texts.

    Attributes:
        header: names of the columns.
        rows: of every line as many cells.
        lines: number of each row's line in its file.
    """

    header: list[str]
    rows: list[list[str]]
    lines: list[int]

    def texts(self, column: int) -> list[str]:
        """The cells of a column."""
        return [row[column] for row in self.rows]


def text_table(text: str, columns: Mapping[str, str | int] | None = None) -> TextTable:
    """Split a text.

    Args:
        text: of a file.
        columns: names that this library knows, with the title, or the number from 1, of their column; with
            numbers a file without a header can be read.

    Raises:
        InputError: its separator, header or decimal sign is unclear, or a line has another number of cells.
    """
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        return TextTable([], [], [])
    comments = []
    while lines and lines[0][1].lstrip().startswith("#"):
        comments.append(lines.pop(0)[1].lstrip().lstrip("#").strip())
    if not lines:
        raise InputError("holds comments only")
    separator = _separator([line for _, line in lines[:_SAMPLE]])
    rows = [[cell.strip() for cell in row] for row in _split([line for _, line in lines], separator)]
    if len(rows) != len(lines):
        raise InputError("a cell in quotes goes over several lines; expected one line per sample")
    numbers = [number for number, _ in lines]
    if separator != ",":
        rows = _with_points(rows, numbers)
    if any(map(_is_number, rows[0])) and all(not cell or _is_number(cell) for cell in rows[0]):
        named = _split(comments[-1:], separator)
        named = [[cell.strip() for cell in row] for row in named]
        if named and len(named[0]) == len(rows[0]):
            header = named[0]
        elif columns and all(isinstance(place, int) for place in columns.values()):
            header = [f"column {k + 1}" for k in range(len(rows[0]))]
        else:
            raise InputError(
                f"line {numbers[0]}: expected names of columns, got numbers; add a line of names, or give "
                "their numbers in a file for --columns"
            )
    else:
        header, rows, numbers = rows[0], rows[1:], numbers[1:]
    if len(header) > 1 and not header[-1] and all(row[-1:] == [""] or len(row) < len(header) for row in rows):
        rows = [row[: len(header) - 1] for row in rows]  # every line ends with a separator
        header = header[:-1]
    for number, row in zip(numbers, rows, strict=True):
        if len(row) != len(header):
            raise InputError(f"line {number}: expected {len(header)} values as in the header, got {len(row)}")
    return TextTable(_renamed(header, columns or {}), rows, numbers)


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    if separator == " ":
        return [line.split() for line in lines]
    try:
        return list(csv.reader(lines, delimiter=separator))
    except csv.Error as error:  # a cell without end
        raise InputError(f"broken CSV: {error}", "") from None


def _separator(lines: Sequence[str]) -> str:
    """The separator of the cells; InputError where several are possible."""
    there = [sign for sign in _SEPARATORS if sign in lines[0]]
    if not there:
        counts = {len(line.split()) for line in lines}
        return " " if len(counts) == 1 and counts != {1} else ","
    if len(there) > 1:
        even = [sign for sign in there if len({len(row) for row in _split(lines, sign)}) == 1]
        if len(even) != 1:
            signs = " or ".join(_SEPARATORS[sign] for sign in there)
            raise InputError(f"header: {signs} may part its columns; use one of them")
        there = even
    return there[0]


def _with_points(rows: list[list[str]], numbers: Sequence[int]) -> list[list[str]]:
    """The rows with decimal points for decimal commas."""
    comma = next((k for k, row in enumerate(rows) if any(map(_DECIMAL_COMMA.fullmatch, row))), None)
    if comma is None:
        return rows
    for number, row in zip(numbers, rows, strict=True):
        if point := next(filter(_DECIMAL_POINT.fullmatch, row), None):
            raise InputError(
                f"line {number}: {point} has a decimal point, line {numbers[comma]} has decimal commas"
            )
    return [
        [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in rows
    ]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _renamed(header: list[str], columns: Mapping[str, str | int]) -> list[str]:
    """The header with the names that a user gives its columns."""
    renamed = list(header)
    for name, place in columns.items():
        if isinstance(place, int):
            if not 1 <= place <= len(header):
                raise InputError(f"columns.{name}: must be 1 to {len(header)}, got {place}")
            renamed[place - 1] = name
            continue
        if header.count(place) != 1:
            known = f"no column {place!r}{did_you_mean(place, header)}" if place not in header else ""
            raise InputError(f"columns.{name}: {known or f'{place!r} stands {header.count(place)} times'}")
        renamed[header.index(place)] = name
    return renamed


def one_row_per_time(
    table: TextTable, times: np.ndarray, clock: Sequence[int], names: Sequence[str]
) -> TextTable:
    """A table with one line per joint and time as one with a line per time; others stay as they are.

    Args:
        table: whose times, one per line, are known.
        times: equal ones make a line.
        clock: columns of the time, from 0; they come first.
        names: of the robot's joints.

    Raises:
        InputError: a joint has two lines at a time.
    """
    places = [k for k, title in enumerate(table.header) if title.lower() in _JOINT_TITLES]
    if len(places) != 1 or not set(table.texts(places[0])) & set(names):
        return table
    (place,) = places
    joints = list(dict.fromkeys(table.texts(place)))
    columns = [k for k in range(len(table.header)) if k != place and k not in clock]
    header = [table.header[k] for k in clock]
    header += [f"{joint}.{table.header[k]}" for joint in joints for k in columns]
    rows, lines, seen = [], [], set[str]()
    for k, row in enumerate(table.rows):
        if k == 0 or times[k] != times[k - 1]:
            rows.append([*(row[c] for c in clock), *[""] * (len(joints) * len(columns))])
            lines.append(table.lines[k])
            seen = set()
        if row[place] in seen:
            raise InputError(f"line {table.lines[k]}: {row[place]} again, at the same time")
        seen.add(row[place])
        begin = len(clock) + joints.index(row[place]) * len(columns)
        rows[-1][begin : begin + len(columns)] = [row[c] for c in columns]
    return TextTable(header, rows, lines)


def plain_names(table: TextTable, names: Sequence[str] | None, *, measured: bool = False) -> TextTable:
    """The table with arrays of joints under names that are known: `q1`, `qd1`, `tau1`, or the joint's.

    Args:
        table: with `actual_q_0`, `q[0]`, `field.position0` and the like, counted from 0 or from 1; where
            columns such as `field.name0` say the joints' names, these count.
        names: of the robot's joints; None: unknown.
        measured: set points (`target_q_0`) are no measurements, and keep their names.

    Raises:
        InputError: it is unclear whether arrays are counted from 0 or from 1, or names change.
    """
    header = _by_name_columns(table)
    for k, title in enumerate(header):
        match = _BRACKETS.fullmatch(title)
        if match and match["name"] in (names or ()):
            header[k] = f"{match['before']}.{match['name']}{match['rest']}"
    from_zero = any(map(_FROM_ZERO.fullmatch, header))
    kinds = {}
    for k, title in enumerate(header):
        match = _ARRAY.fullmatch(title)
        if match is None or (_PLAIN.fullmatch(title) and not from_zero):
            continue
        parts = re.split(r"[./_\s]+", match["before"].lower())
        named = title.removesuffix(match["rest"]) in (names or ())
        if not named and not (measured and set(parts) & set(_MEANT)):
            kinds[k] = match
    if not kinds:
        return replace(table, header=header)
    numbers = {int(m["index"] or m["low"] or m["glued"]) for m in kinds.values()}
    first = min(numbers)
    count = len(names) if names else max(numbers) + (first == 0)
    if first > 0 and max(numbers) != count:
        raise InputError(
            f"header: {header[min(kinds)]}: are joints counted from 0 or from 1? The robot has {count}; say "
            "it in a file for --columns"
        )
    titles = dict[str, str]()
    for k, match in kinds.items():
        number = int(match["index"] or match["low"] or match["glued"]) + (first == 0)
        name = f"{_SHORT[match['word']]}{number}"
        if (other := titles.setdefault(name, header[k])) != header[k]:
            raise InputError(
                f"header: {other} and {header[k]} are the same quantity; say which counts in a file for "
                "--columns"
            )
        header[k] = name + match["rest"]
    return replace(table, header=header)


def _by_name_columns(table: TextTable) -> list[str]:
    """The header with the names that columns such as `field.name0` give to `field.position0`."""
    named: dict[tuple[str, str], str] = {}
    for k, title in enumerate(table.header):
        match = _NAME_OF.fullmatch(title)
        texts = list(dict.fromkeys(filter(None, table.texts(k)))) if match else []
        if match is None or not texts or any(map(_is_number, texts)):
            continue
        if len(texts) > 1:
            raise InputError(f"header: {title} is {texts[0]} and {texts[1]}; expected one order of joints")
        named[match["before"], match["index"] or match["number"]] = texts[0]
    header = list(table.header)
    for k, title in enumerate(header):
        if match := _VALUE_OF.fullmatch(title):
            name = named.get((match["before"], match["index"] or match["number"]))
            header[k] = f"{match['before']}{match['word']}.{name}" if name else title
    return header


_TIME = re.compile(
    r"(?P<nano>%time|rosbagTimestamp)"
    r"|(?:__)?(?:time|t|timestamp|time_from_start)(?:[\s_]*[\[(]?(?P<unit>s|sec|ms|us|ns)[\])]?)?",
    re.IGNORECASE,
)
_SECONDS = re.compile(r"(?P<before>(?:.*[./_\s])?)secs?")
_NANOSECONDS = re.compile(r"(?P<before>(?:.*[./_\s])?)(?:nanosecs?|nsecs?)")
_STAMP = re.compile(r"(?:.*[./_\s])?stamp")
_UNITS = {"s": 0, "sec": 0, "ms": -3, "us": -6, "ns": -9}  # powers of ten
_EPOCHS = ((9, 0), (12, -3), (15, -6), (18, -9))
"""Dates from 2001 to 2286 are this power of ten of a unit, which is that power of ten of a second."""


@dataclass(frozen=True)
class TimeColumns:
    """Where the times of a table are.

    Attributes:
        columns: of seconds, or of whole seconds and nanoseconds, from 0.
        power: the unit of a single column is this power of ten of a second; None: the title says none.
    """

    columns: tuple[int, ...]
    power: int | None


def time_columns(header: Sequence[str]) -> TimeColumns:
    """Columns of the time in a header.

    Raises:
        InputError: there is none, or several.
    """
    results, stamps = [(k, match) for k, text in enumerate(header) if (match := _TIME.fullmatch(text))], []
    exact = [pair for pair in results if header[pair[0]] == "time_s"]
    if len(exact or results) == 1:
        number, match = (exact or results)[0]
        return TimeColumns((number,), -9 if match["nano"] else _UNITS.get((match["unit"] or "").lower()))
    if not results:
        seconds, nanoseconds = (
            {match["before"]: k for k, text in enumerate(header) if (match := form.fullmatch(text))}
            for form in (_SECONDS, _NANOSECONDS)
        )
        pairs = [(seconds[before], nanoseconds[before]) for before in seconds if before in nanoseconds]
        stamps = [k for k, text in enumerate(header) if _STAMP.fullmatch(text)]
        if len(pairs) == 1:
            return TimeColumns(pairs[0], None)
        if not pairs and len(stamps) == 1:
            return TimeColumns((stamps[0],), None)
    none = "" if results or stamps else "; points without times are [[waypoint]] of a TOML file"
    raise InputError(f"header: expected one column time_s, got {', '.join(header)}{none}")


def times_of(table: TextTable) -> tuple[np.ndarray, TimeColumns]:
    """Times of all lines, (N,), s, dates from the first one on; and where they are.

    Raises:
        InputError: there are none, or a cell holds none; names line and column.
    """
    where = time_columns(table.header)
    title = table.header[where.columns[0]]
    if len(where.columns) == 2:
        pairs = [[_whole(table, line, k) for k in where.columns] for line in range(len(table.rows))]
        first = pairs[0] if pairs and abs(pairs[0][0]) >= 10**9 else (0, 0)
        return np.array([(s - first[0]) + 1e-9 * (ns - first[1]) for s, ns in pairs]), where
    cells = table.texts(where.columns[0])
    if cells and not _is_decimal(cells[0]) and (dates := _dates(table, cells, title)) is not None:
        return dates, where
    values = [_decimal(table.lines[k], title, cell) for k, cell in enumerate(cells)]
    power, first = where.power, values[0] if values else Decimal(0)
    size = abs(first)
    epoch = next((unit for digits, unit in _EPOCHS if 10**digits <= size < 10 ** (digits + 1)), None)
    if power is None:
        power = 0 if epoch is None else epoch
    origin = first if epoch == power else Decimal(0)
    times = [float((value - origin).scaleb(power)) for value in values]
    for line, time in zip(table.lines, times, strict=True):
        refuse_huge(f"line {line}, {title}", time)
    return np.array(times), where


def _whole(table: TextTable, row: int, column: int) -> int:
    cell = table.rows[row][column]
    try:
        return int(cell)
    except ValueError:
        where = f"line {table.lines[row]}, {table.header[column]}"
        raise InputError(f"{where}: expected a whole number, got {cell!r}") from None


def _is_decimal(cell: str) -> bool:
    try:
        Decimal(cell)
    except InvalidOperation:
        return False
    return True


def _decimal(line: int, title: str, cell: str) -> Decimal:
    try:
        value = Decimal(cell)
    except InvalidOperation:
        raise InputError(f"line {line}, {title}: expected a number, got {cell!r}") from None
    if not value.is_finite():
        raise InputError(f"line {line}, {title}: must be finite, got {cell}")
    return value


def _dates(table: TextTable, cells: Sequence[str], title: str) -> np.ndarray | None:
    """Times since the first one, s; None if that is no date of ISO 8601."""
    try:
        first = datetime.fromisoformat(cells[0])
    except ValueError:
        return None
    times = []
    for line, cell in zip(table.lines, cells, strict=True):
        try:
            times.append((datetime.fromisoformat(cell) - first).total_seconds())
        except (ValueError, TypeError):
            raise InputError(f"line {line}, {title}: expected a date like {cells[0]}, got {cell!r}") from None
    return np.array(times)
