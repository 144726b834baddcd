"""Times of the lines of a table: seconds, milliseconds and so on, dates, seconds with nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from decimal import Decimal, InvalidOperation

import numpy as np

from ocptip.basics.errors import InputError, refuse_huge
from ocptip.trajectories.csv_text import TextTable

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
    found = [(k, match) for k, text in enumerate(header) if (match := _TIME.fullmatch(text))]
    exact = [pair for pair in found if header[pair[0]] == "time_s"]
    if len(exact or found) == 1:
        number, match = (exact or found)[0]
        return TimeColumns((number,), -9 if match["nano"] else _UNITS.get((match["unit"] or "").lower()))
    if not found:
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
    raise InputError(f"header: expected one column time_s, got {', '.join(header)}")


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
    times = [(value - origin).scaleb(power) for value in values]
    for line, own in zip(table.lines, times, strict=True):
        refuse_huge(f"line {line}, {title}", float(own))
    return np.array([float(own) for own in times]), where


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
    if not _is_decimal(cell):
        raise InputError(f"line {line}, {title}: expected a number, got {cell!r}")
    value = Decimal(cell)
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
