"""Samples of motions as CSV: numbers out of lines, and the motion between them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from itertools import chain

import numpy as np

from ocptip.basics.doubts import doubt_degrees
from ocptip.basics.errors import InputError, refuse_huge
from ocptip.trajectories.csv_columns import ACCELERATION, POSITION, SPEED, Columns, columns_of
from ocptip.trajectories.sampled import REST, SampledMotion

ENOUGH, JUMP = 8, 4.0  # rows and ratio of accelerations from which a file counts as cut off
NEAREST = 1e-4  # s: least distance of rows of a fit
SAME = 1e-8  # rad, m and rad/s, m/s: rows at one time may differ by this (rounding)
EXACT = 1e-4  # share of accelerations: rounding may change them by this if they are to be taken as given


def motion_from_csv(
    text: str, names: Sequence[str] | None, units: Sequence[str], unit: str | None
) -> SampledMotion:
    """The motion of a file, see `ocptip.trajectories.read.load_motion`.

    Raises:
        InputError: it holds no motion; names line and column.
    """
    lines = csv_lines(text)
    if not lines:
        raise InputError(
            "is empty; expected ramp commands, a joint trajectory, or columns time_s, q1_deg, q2_deg, ..."
        )
    header = [name.strip() for name in lines[0][1]]
    columns = columns_of(header, names, units, unit)
    for kind in (POSITION, SPEED, ACCELERATION):
        require_units(columns.units[kind], units)
    cells = _numbers(header, lines, [columns.time, *chain(*columns.joints.values())])
    if len(lines) < 3:
        raise InputError(f"times: at least two samples are needed, got {len(lines) - 1}")
    times = columns.second * (cells[columns.time] - cells[columns.time][0])
    values = {
        kind: np.stack([cells[c] for c in own], axis=1) * columns.scales(kind)
        for kind, own in columns.joints.items()
        if own
    }
    _require_order(times, [number for number, _ in lines[1:]], header[columns.time], values)
    motion = _as_given(times, values) or _fit(times, values, _rounding(lines, columns))
    in_degrees = np.array(columns.units[POSITION]) == "deg"
    doubt_degrees("columns q_deg", np.rad2deg(values[POSITION][:, in_degrees]))
    return motion


def csv_lines(text: str) -> list[tuple[int, list[str]]]:
    """Lines that are not empty, with their numbers from 1."""
    return [(k, row) for k, row in enumerate(csv.reader(text.splitlines()), 1) if any(map(str.strip, row))]


def csv_table(text: str) -> tuple[list[str], np.ndarray]:
    """Header and numbers (N, columns) of a file.

    Raises:
        InputError: it is empty, or something is no number; names line and column.
    """
    lines = csv_lines(text)
    if len(lines) < 2:
        raise InputError("is empty; expected a line of names and lines of numbers")
    header = [name.strip() for name in lines[0][1]]
    cells = _numbers(header, lines, range(len(header)))
    return header, np.column_stack(list(cells.values()))


def require_units(given: Sequence[str], units: Sequence[str]) -> None:
    """Refuse angles of joints that slide, and ways of joints that turn.

    Args:
        given: "deg", "rad" or "m" per joint.
        units: "rad" or "m" per joint of the robot.
    """
    if len(given) == len(units):  # other numbers of joints are refused by the robot
        for joint, (own, unit) in enumerate(zip(given, units, strict=True), 1):
            if (own == "m") != (unit == "m"):
                slides = "moves in m" if unit == "m" else "turns"
                raise InputError(f"units: joint {joint} {slides}, but the motion gives {own}")


def _numbers(
    header: Sequence[str], lines: Sequence[tuple[int, list[str]]], wanted: Sequence[int]
) -> dict[int, np.ndarray]:
    """Values (N,) by column."""
    for number, row in lines[1:]:
        if len(row) != len(header):
            raise InputError(f"line {number}: expected {len(header)} values as in the header, got {len(row)}")
    return {
        column: np.array([_cell(number, header[column], row[column]) for number, row in lines[1:]])
        for column in wanted
    }


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
    """Refuse times that go back, and other states at the same time; accelerations may jump."""
    later = np.diff(times)
    if (late := np.flatnonzero(later < 0)).size:
        row = int(late[0]) + 1
        raise InputError(f"line {numbers[row]}: {name} {times[row]:.9g} comes after {times[row - 1]:.9g}")
    for row in (np.flatnonzero(later == 0) + 1).tolist():
        states = [values[kind] for kind in (POSITION, SPEED) if kind in values]
        if max(np.abs(state[row] - state[row - 1]).max() for state in states) > SAME:
            text = f"{name} {times[row]:.9g} again, with other angles or speeds"
            raise InputError(f"line {numbers[row]}: {text}")


def _as_given(times: np.ndarray, values: dict[str, np.ndarray]) -> SampledMotion | None:
    """The motion whose accelerations are those of the file; None if it has none, or they do not fit."""
    if len(values) < 3 or len(times) < 2:
        return None
    begins = np.flatnonzero(np.diff(times, prepend=-1.0) > 0)
    ends = np.append(begins[1:] - 1, len(times) - 1)
    angles, speeds, given = (values[kind] for kind in (POSITION, SPEED, ACCELERATION))
    if len(begins) < 2:
        return None
    motion = SampledMotion(times[begins], angles[begins], speeds[begins], given[ends], before=given[begins])
    most = np.max(np.abs(given), axis=0)
    return motion if np.all(motion.acceleration_peaks <= most * (1 + EXACT) + REST) else None


def _fit(times: np.ndarray, values: dict[str, np.ndarray], rounding: np.ndarray) -> SampledMotion:
    from ocptip.trajectories.fit import fitted  # loads scipy.sparse for 0.1 s

    kept = _spaced(times)
    angles, speeds = values[POSITION][kept], values.get(SPEED)
    if speeds is None:
        _refuse_cut(times[kept], angles)
    else:
        speeds = speeds[kept]
    motion = SampledMotion(times[kept], angles, speeds)  # complains about what cannot be a motion
    return fitted(motion.times, motion.angles, rounding=rounding, speeds=motion.speeds)


def _rounding(lines: Sequence[tuple[int, list[str]]], columns: Columns) -> np.ndarray:
    """(n,): half a unit of the last digit that positions usually have, rad or m; equal ones count once."""
    cells = ({row[column] for _, row in lines[1:]} for column in columns.joints[POSITION])
    digits = [np.median([_decimals(cell) for cell in own]) for own in cells]
    return 0.5 * 10.0 ** -np.array(digits) * columns.scales(POSITION)


def _decimals(cell: str) -> int:
    """Decimal places that a number is written with."""
    mantissa, _, exponent = cell.strip().lower().partition("e")
    return len(mantissa.partition(".")[2]) - int(exponent or 0)


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
                f"with {abs(speeds[end, joint]):.4g} rad/s (or m/s); is the file cut off?"
            )
