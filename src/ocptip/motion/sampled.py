"""A motion given by samples, a cubic between each two of them; reading motions of either form from files.

A proof is about every instant, samples are at some. Which curve is meant between them decides the verdict:

- Angles and speeds: the cubic Hermite polynomial of each interval, as trajectory controllers do with points
  that have positions and speeds. Speeds are continuous, accelerations jump at samples. A ramp motion comes
  back exactly if all its events are among the samples. Where its acceleration jumps between two samples, the
  curve overshoots by up to a third of the jump, however dense the samples are.
- Angles only: the cubic spline with rest at both ends. Accelerations are continuous. Where the true motion's
  jump, the spline oscillates around the jump.

So samples of a ramp motion without its events get a verdict of their own, as a rule a stricter one than the
commands. Of a robot that interpolates otherwise, or of a measurement's gaps, it says nothing.

Rounded numbers are differentiated twice: an error e of the angles becomes up to 6 e / h^2 in the
accelerations between samples h apart. Files should hold 12 digits; rows closer than 0.1 ms to another are
left out, and with them phases shorter than that.
"""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

from ocptip.errors import InputError, finite_array, positive_number, refuse_huge
from ocptip.motion.passive import MERGE, ArmMotion, gauss_legendre
from ocptip.motion.ramps import checked_times
from ocptip.tables import read_text

_REST = 1e-3  # rad/s: a motion that begins or ends faster than this is only a piece of one
_STILL = 1e-9  # rad/s: a joint that never gets faster rests; changes of sign are rounding
_NEAREST = 1e-4  # s: least distance of rows read from a file
_SAME = 1e-8  # rad and rad/s: rows at one time may differ by this (rounding)
_COLUMN = re.compile(r"(?P<kind>q|qd)(?P<joint>[1-9][0-9]*)_(?P<unit>deg|rad)(?P<per_second>_s)?")


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """The motion of n joints through N samples, see the module for what lies between them.

    It rests before the first and after the last sample. Serves wherever an :class:`ArmMotion` is checked.

    Attributes:
        times: (N,), s, increasing, N >= 2; counted from the first sample, which is at 0.
        angles: (N, n), rad.
        speeds: (N, n), rad/s, below 0.001 at both ends; None: rest at both ends, else from the spline.
    """

    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Raise InputError if shapes do not fit, times do not increase, or an end is not at rest."""
        times = finite_array("times", self.times, (None,))
        if len(times) < 2:
            raise InputError(f"times: at least two samples are needed, got {len(times)}")
        if (late := np.flatnonzero(np.diff(times) <= 0)).size:
            k = int(late[0])
            raise InputError(
                f"times: must increase, sample {k + 2} at {times[k + 1]:.9g} s follows {times[k]:.9g} s"
            )
        values = {
            "times": times - times[0],
            "angles": finite_array("angles", self.angles, (len(times), None)),
        }
        if not values["angles"].shape[1]:
            raise InputError("angles: at least one joint is needed, got none")
        if self.speeds is not None:
            values["speeds"] = finite_array("speeds", self.speeds, values["angles"].shape)
            for where, ends in (("first", values["speeds"][0]), ("last", values["speeds"][-1])):
                joint = int(np.argmax(np.abs(ends)))
                if abs(ends[joint]) > _REST:
                    raise InputError(
                        f"speeds: joint {joint + 1} moves with {np.rad2deg(ends[joint]):.4g} deg/s at the "
                        f"{where} sample; a motion goes from rest to rest"
                    )
        for name, array in values.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.angles.shape[1]

    @property
    def interpolation(self) -> str:
        """What lies between the samples, for messages."""
        return "cubic spline" if self.speeds is None else "cubic Hermite polynomials"

    @property
    def start(self) -> np.ndarray:
        """Angles before the motion, (n,), rad."""
        return self.angles[0]

    @property
    def goal(self) -> np.ndarray:
        """Angles after the motion, (n,), rad."""
        return self.angles[-1]

    @property
    def end(self) -> float:
        """Time of the last sample, s."""
        return float(self.times[-1])

    @cached_property
    def angle_ranges(self) -> np.ndarray:
        """Least and greatest angle of each joint during the motion, exact, (n, 2), rad."""
        ranges = []
        for joint, turns in enumerate(self._turns):
            angles = np.concatenate([self.angles[:, joint], self.states(turns)[0][:, joint]])
            ranges.append((angles.min(), angles.max()))
        return np.array(ranges)

    @cached_property
    def speed_peaks(self) -> np.ndarray:
        """Greatest |speed| of each joint, exact, (n,), rad/s."""
        cubic, square, linear, _ = self._curve.c
        width = self._widths
        with np.errstate(divide="ignore", invalid="ignore"):
            inner = -square / (3 * cubic)  # where the acceleration vanishes
        inner = np.where((inner > 0) & (inner < width), inner, 0.0)
        peaks = [np.abs(linear + t * (2 * square + t * 3 * cubic)) for t in (0.0, inner, width)]
        return np.max(peaks, axis=(0, 1))

    @cached_property
    def acceleration_peaks(self) -> np.ndarray:
        """Greatest |acceleration| of each joint, exact, (n,), rad/s^2."""
        cubic, square = self._curve.c[:2]
        return np.max([np.abs(2 * square + t * 6 * cubic) for t in (0.0, self._widths)], axis=(0, 1))

    def states(
        self, times: ArrayLike, *, side: Literal["left", "right"] = "right"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles (rad), speeds (rad/s), accelerations (rad/s^2) at N times (s): three arrays (N, n).

        Args:
            times: when; a single time gives (n,).
            side: "right": at a sample the acceleration after it, "left": the one before it.

        Raises:
            InputError: a time is not finite, or side is another word.
        """
        t = checked_times(times, side)
        starts, coefficients = self._padded
        piece = np.searchsorted(self.times, t, side=side)  # 0: rest before, 1 .. N - 1: moving, N: rest
        elapsed = (t - starts[piece])[..., None]
        cubic, square, linear, constant = coefficients[:, piece]
        angles = constant + elapsed * (linear + elapsed * (square + elapsed * cubic))
        speeds = linear + elapsed * (2 * square + elapsed * 3 * cubic)
        return angles, speeds, 2 * square + elapsed * 6 * cubic

    @cached_property
    def event_times(self) -> np.ndarray:
        """Samples, and all instants at which a joint's speed changes sign, sorted, (S,), s.

        Instants within 1 ns of a sample or of each other are one.
        """
        kept = [0.0]
        for t in np.unique(np.concatenate(self._turns)):
            index = min(int(np.searchsorted(self.times, t)), len(self.times) - 1)
            nearest = np.min(np.abs(self.times[max(index - 1, 0) : index + 1] - t))
            if nearest > MERGE and t - kept[-1] > MERGE:
                kept.append(float(t))
        return np.unique(np.concatenate([kept, self.times]))

    @property
    def intervals(self) -> np.ndarray:
        """Intervals between events, (S - 1, 2), s: within each, torque and power are smooth."""
        return np.column_stack([self.event_times[:-1], self.event_times[1:]])

    def quadrature(self, order: int = 4) -> tuple[np.ndarray, np.ndarray]:
        """Return Gauss-Legendre nodes (s) inside all intervals and their weights (s), both (N,).

        Raises:
            InputError: order is not a whole number >= 1.
        """
        return gauss_legendre(self.intervals, order)

    def time_scaled(self, factor: float) -> SampledMotion:
        """Return the same path with all times multiplied by `factor` > 0 (below 1: faster)."""
        factor = positive_number("factor", factor)
        speeds = None if self.speeds is None else self.speeds / factor
        return SampledMotion(self.times * factor, self.angles, speeds)

    @cached_property
    def _curve(self) -> PPoly:
        if self.speeds is None:
            return CubicSpline(self.times, self.angles, bc_type="clamped")
        return CubicHermiteSpline(self.times, self.angles, self.speeds)

    @cached_property
    def _widths(self) -> np.ndarray:
        return np.diff(self.times)[:, None]

    @cached_property
    def _padded(self) -> tuple[np.ndarray, np.ndarray]:
        """Start times (N + 1,) and coefficients (4, N + 1, n), cubic first, with rest before and after."""
        rest = np.zeros((2, 4, 1, self.n))
        rest[:, 3, 0] = self.start, self.goal
        coefficients = np.concatenate([rest[0], self._curve.c, rest[1]], axis=1)
        return np.concatenate([self.times[:1], self.times]), coefficients

    @cached_property
    def _turns(self) -> list[np.ndarray]:
        """Per joint the instants at which its speed vanishes, s; none for a joint that rests."""
        roots = self._curve.derivative().roots(discontinuity=False, extrapolate=False)
        moving = self.speed_peaks > _STILL
        return [r[np.isfinite(r)] if moves else np.empty(0) for r, moves in zip(roots, moving, strict=True)]


Motion = ArmMotion | SampledMotion


def load_motion(path: str | os.PathLike[str]) -> Motion:
    """Read a motion from a file: JSON with `start` and `commands`, or CSV with samples.

    JSON: as :meth:`ArmMotion.from_dict`; `plan.json` is one such file. CSV: a header with the columns
    `time_s`, `q1_deg` .. `qn_deg` and, if at hand, `qd1_deg_s` .. `qdn_deg_s` (or `_rad`, `_rad_s`), in any
    order; other columns are ignored. A time may be repeated (left and right of a jump of the acceleration) if
    angles and speeds are the same.

    Raises:
        InputError: the file cannot be read or holds no motion; names file, and key or line and column.
    """
    path = Path(path)
    text = read_text(path)
    try:
        if text.lstrip().startswith(("{", "[")):
            motion = ArmMotion.from_dict(_json(text))
            _refuse_huge_commands(motion)
            return motion
        return _from_csv(text)
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None


def motion_origin(path: str | os.PathLike[str]) -> dict[str, str]:
    """Return what a motion file says about its robot: the texts `case` and `base`, those that it has."""
    path = Path(path)
    text = read_text(path)
    try:
        data = _json(text) if text.lstrip().startswith("{") else {}
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None
    return {key: data[key] for key in ("case", "base") if isinstance(data.get(key), str)}


def _refuse_huge_commands(motion: ArmMotion) -> None:
    for number, joint in enumerate(motion.joints, start=1):
        refuse_huge(f"start[{number}]", joint.phi_start)
        for which, command in enumerate(joint.commands, start=1):
            for key, value in vars(command).items():
                refuse_huge(f"commands[{number}][{which}].{key}", value)


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"broken JSON: {error}") from None
    except RecursionError:
        raise InputError("broken JSON: nested too deeply") from None


def _from_csv(text: str) -> SampledMotion:
    lines = [(k, row) for k, row in enumerate(csv.reader(text.splitlines()), 1) if any(map(str.strip, row))]
    if not lines:
        raise InputError("is empty; expected a header with time_s, q1_deg, q2_deg, ...")
    header = [name.strip() for name in lines[0][1]]
    time, angles, speeds = _columns(header)
    wanted = [time, *angles, *speeds]
    table = np.empty((len(lines) - 1, len(wanted)))
    for row, (number, cells) in enumerate(lines[1:]):
        if len(cells) != len(header):
            raise InputError(
                f"line {number}: expected {len(header)} values as in the header, got {len(cells)}"
            )
        table[row] = [_cell(number, header[c], cells[c]) for c in wanted]
    table[:, 1:] *= [np.deg2rad(1.0) if "_deg" in header[c] else 1.0 for c in wanted[1:]]
    for row in range(1, len(table)):
        later = table[row, 0] - table[row - 1, 0]
        if later < 0:
            raise InputError(
                f"line {lines[row + 1][0]}: time_s {table[row, 0]:.9g} comes after {table[row - 1, 0]:.9g}"
            )
        if later == 0 and np.abs(table[row, 1:] - table[row - 1, 1:]).max() > _SAME:
            raise InputError(
                f"line {lines[row + 1][0]}: time_s {table[row, 0]:.9g} again, with other angles or speeds"
            )
    table, n = _spaced(table), len(angles)
    return SampledMotion(table[:, 0], table[:, 1 : n + 1], table[:, n + 1 :] if speeds else None)


def _spaced(table: np.ndarray) -> np.ndarray:
    """The rows whose times (first column) are not too near to the one kept before; the last row always."""
    kept: list[int] = []
    for row, time in enumerate(table[:, 0]):
        if not kept or time - table[kept[-1], 0] >= _NEAREST:
            kept.append(row)
    if kept and kept[-1] != len(table) - 1:
        if len(kept) > 1:
            kept.pop()
        kept.append(len(table) - 1)
    return table[kept]


def _columns(header: Sequence[str]) -> tuple[int, list[int], list[int]]:
    """Column of the time, columns of the joints' angles, and of their speeds if there are any."""
    if header.count("time_s") != 1:
        raise InputError(f"header: expected one column time_s, got {', '.join(header)}")
    found: dict[str, dict[int, int]] = {"q": {}, "qd": {}}
    for column, name in enumerate(header):
        match = _COLUMN.fullmatch(name)
        if match is None or (match["kind"] == "qd") != bool(match["per_second"]):
            continue
        joints, joint = found[match["kind"]], int(match["joint"])
        if joint in joints:
            raise InputError(f"header: {header[joints[joint]]} and {name} are the same quantity")
        joints[joint] = column
    n = max([0, *found["q"], *found["qd"]])
    for kind, example in (("q", "deg"), ("qd", "deg_s")):
        missing = [joint for joint in range(1, n + 1) if joint not in found[kind]]
        if (kind == "q" or found[kind]) and (missing or not n):
            raise InputError(f"header: {kind}{(missing or [1])[0]}_{example} is missing")
    angles, speeds = ([found[kind][joint] for joint in sorted(found[kind])] for kind in ("q", "qd"))
    return header.index("time_s"), angles, speeds


def _cell(line: int, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"line {line}, {name}: expected a number, got {text!r}") from None
    if not np.isfinite(value):
        raise InputError(f"line {line}, {name}: must be finite, got {text.strip()}")
    refuse_huge(f"line {line}, {name}", value)
    return value
