"""How a base drives over time: its velocities in base axes, as piecewise polynomials, and their files."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import comb
from pathlib import Path

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.read import read_text
from ocptip.trajectories.bags import is_bag, refuse_of_other_files, twists_in_bag
from ocptip.trajectories.csv_text import TextTable, text_table, times_of
from ocptip.trajectories.pieces import MERGE, Pieces, Side
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.read_csv import numbers_of
from ocptip.trajectories.trajectory import Trajectory

POSE, UNITS = ("x", "y", "yaw"), ("m", "m", "rad")
_LONGEST = 0.02  # s: of pieces of a base that turns on a path: their velocities are off by less than 1e-8
_SAMPLED = 0.005  # s: of curved velocities in files, so that their accelerations are nearly the same
_MOST_PHASES = 6  # that are told one by one
_SIDEWAYS = 1e-3  # m/s: less is rounding
_NAMES = {
    **dict.fromkeys(("v", "vx", "v_x", "linear.x", "linear_x"), 0),
    **dict.fromkeys(("vy", "v_y", "linear.y", "linear_y"), 1),
    **dict.fromkeys(("w", "wz", "w_z", "omega", "yaw_rate", "angular.z", "angular_z"), 2),
}
_UNIT = re.compile(r"[\s_]*[\[(]?(?P<unit>m|rad|deg)[_/]s[\])]?")
_NUMBER = r"\s*([0-9.eE+-]+)\s*"
_TRAPEZOID = re.compile(rf"{_NUMBER}(m|deg|rad),{_NUMBER}\2/s,{_NUMBER}\2/s\^2\s*")


_WORDS = re.compile(rf"{_NUMBER}(m|deg|rad)\s*,")  # begins like a profile, and like no file


@dataclass(frozen=True, eq=False)
class DriveProfile:
    """Velocities of a base that drives: forward and sideways, m/s, and turning, rad/s, in base axes.

    Before and after they stay what they are at both ends.

    Attributes:
        velocities: three polynomials over time, s; their derivatives are accelerations in base axes.
    """

    velocities: Pieces

    @classmethod
    def of_velocities(cls, times: np.ndarray, velocities: np.ndarray) -> DriveProfile:
        """Velocities (N, 3) at times (N,), s, increasing, with straight lines between them."""
        slopes = np.diff(velocities, axis=0) / np.diff(times)[:, None]
        return cls(Pieces(times - times[0], np.stack([velocities[:-1], slopes]), velocities[-1]))

    @classmethod
    def of_course(cls, course: Trajectory) -> DriveProfile:
        """Of a course x, y, m, and yaw, rad, of the base frame in the world, x forward at yaw 0."""
        every = np.unique(np.concatenate([course.event_times, *course.breaks]))
        apart = np.diff(every) > MERGE
        breaks, last = every[np.append(True, apart)], every[np.append(apart, True)]
        if course.speed_peaks[2] > 0:
            counts = np.maximum(np.ceil(np.diff(breaks) / _LONGEST), 1).astype(int)
            rows = zip(breaks[:-1], breaks[1:], counts, strict=True)
            breaks = np.append(
                np.concatenate([np.linspace(*row, endpoint=False) for row in rows]), breaks[-1]
            )
        # Accelerations step at the first or the last of breaks that are merged, by rounding.
        near = last[np.searchsorted(last, breaks)]
        after = np.where(near - breaks <= MERGE, near, breaks)
        (v0, d0), (v1, d1) = _in_base(course, after[:-1], "right"), _in_base(course, breaks[1:], "left")
        h = np.diff(breaks)[:, None]
        rate = (v1 - v0) / h  # cubic polynomials through velocities and accelerations at both ends
        bends = (6 * rate - 4 * d0 - 2 * d1) / h, (6 * (d0 + d1) - 12 * rate) / h**2
        near = np.abs(breaks[:, None] - course.event_times).min(axis=1) <= MERGE
        return cls(Pieces(breaks, np.stack([v0, d0, *bends]), v1[-1], near))

    @property
    def end(self) -> float:
        """After that the velocities do not change, s."""
        return float(self.velocities.breaks[-1])

    @property
    def knots(self) -> np.ndarray:
        """(K,) s, at which accelerations may step."""
        return self.velocities.switching_times

    def rows(self, times: np.ndarray, order: int = 0, *, side: Side = "right") -> np.ndarray:
        """(N, 9) rows of `BaseMotion` at times (N,), s, or their derivative of an order inside the pieces."""
        v = self.velocities.at(times, range(order + 2), side)
        rows = np.zeros((len(times), 9))
        rows[:, :2] = v[order + 1][:, :2]
        for k in range(order + 1):
            rows[:, :2] += comb(order, k) * _crossed(v[k], v[order - k])
        rows[:, 5], rows[:, 8] = v[order][:, 2], v[order + 1][:, 2]
        return rows

    def at_pace(self, factor: float) -> DriveProfile:
        """The same course with all times multiplied by a factor > 0."""
        velocities = self.velocities
        powers = factor ** -np.arange(1.0, len(velocities.derivatives) + 1)[:, None, None]
        changed = {"derivatives": powers * velocities.derivatives, "goal": velocities.goal / factor}
        return DriveProfile(replace(velocities, breaks=factor * velocities.breaks, **changed))

    def to_csv(self) -> str:
        """Time, v, vy and w: what `load_drive_profile` reads; exact where velocities are straight lines."""
        velocities = self.velocities
        times, values = velocities.breaks, np.vstack([velocities.derivatives[0], velocities.goal])
        if np.any(velocities.derivatives[2:]):
            times = np.unique(np.append(np.arange(0.0, self.end, _SAMPLED), times))
            values = velocities.at(times, range(1))[0]
        rows = np.column_stack([times, values]).tolist()
        return "\n".join(["time,v,vy,w", *(",".join(map(repr, row)) for row in rows), ""])

    @property
    def notes(self) -> tuple[str, ...]:
        """What is assumed about the base, one sentence each, for reports."""
        drives = f"the base drives: {self}; the arm has its clock, obstacles go along with it"
        sideways = float(self.velocities.peaks(0)[1])
        if sideways <= _SIDEWAYS:
            return (drives,)
        return (
            drives,
            f"the base moves sideways (up to {sideways:.3g} m/s): only for holonomic bases; not checked that "
            "the wheels can",
        )

    def while_moving(self, end: float) -> tuple[str, ...]:
        """A sentence on its phases while an arm moves from 0 to `end`, s; none if there are many."""
        sides = zip((self.velocities.breaks[:-1], self.velocities.breaks[1:]), ("right", "left"), strict=True)
        before, after = (np.linalg.norm(self.velocities.at(t, range(1), s)[0], axis=1) for t, s in sides)
        last = float(np.linalg.norm(self.velocities.goal))
        before, after = np.append(before, last), np.append(after, last)
        close = 1e-6 * max(before.max(), after.max())
        phases: list[tuple[str, float]] = []  # and when they begin
        for begin, first, final in zip(self.velocities.breaks, before, after, strict=True):
            kind = (
                "accelerates" if final > first + close else "brakes" if final < first - close else "cruises"
            )
            kind = "rests" if max(first, final) <= close else kind
            if not phases or phases[-1][0] != kind:
                phases.append((kind, float(begin)))
        if len(phases) > _MOST_PHASES:
            return ()
        meanwhile = [one for one in phases if one[1] < end - MERGE]
        ends = [f" until {begin:.4g} s" for _, begin in meanwhile[1:]] + [""]
        text = ", then ".join(kind + until for (kind, _), until in zip(meanwhile, ends, strict=True))
        text = f"the arm moves from 0 to {end:.4g} s: meanwhile the base {text}"
        other = dict.fromkeys(kind for kind, _ in phases if kind not in [*dict(meanwhile), "rests"])
        return (f"{text}; it {' and '.join(other)} only while the arm rests" if other else text,)

    def __str__(self) -> str:
        speeds, breaks = self.velocities.peaks(0), self.velocities.breaks
        ends = np.vstack([self.rows(breaks, side=side) for side in ("left", "right")])
        most = float(np.max(np.linalg.norm(ends[:, :2], axis=1)))
        return (
            f"{self.end:.4g} s, up to {np.max(speeds[:2]):.3g} m/s, {speeds[2]:.3g} rad/s "
            f"and {most:.3g} m/s^2"
        )


def in_words(source: str) -> bool:
    """Whether a text is a profile in words, not the name of a file."""
    return _WORDS.match(source) is not None


def load_drive_profile(
    source: str | os.PathLike[str],
    *,
    unit: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
) -> DriveProfile:
    """Read how a base drives.

    Its time counts from its first sample, which is when the motion of the arm begins.

    Example::

        ocptip.load_drive_profile("drive.csv")
        ocptip.load_drive_profile("2 m, 0.8 m/s, 1 m/s^2")

    Args:
        source: CSV with the time and velocities in base axes (v, vy, w: m/s, rad/s), with straight lines
            between samples; or with a course (x, y, yaw), which is fitted like samples of a motion; profile
            commands of x, y, yaw (JSON); a bag of ROS with commands of velocities, or odometry; or a
            trapezoidal velocity profile in words, straight on or, in deg, on the spot.
        unit: "deg" or "rad", of columns of angles that do not say it.
        columns: of CSV files, see :func:`ocptip.check`.
        topic: of bags.

    Raises:
        InputError: the file cannot be read or holds no such profile; names file, and line or column.
    """
    if isinstance(source, str) and (words := _TRAPEZOID.fullmatch(source)):
        return DriveProfile.of_course(_trapezoid(words))
    if isinstance(source, str) and in_words(source):
        raise InputError(
            "drive profile: expected distance, speed and acceleration with units, such as "
            f"'2 m, 0.8 m/s, 1 m/s^2', got {source!r}"
        )
    path = Path(source)
    bag = is_bag(path)
    refuse_of_other_files(bag, [topic] if topic else [], columns)
    try:
        if bag:
            return _of_table(twists_in_bag(path, topic), unit)
        if path.suffix.lower() == ".csv":
            table = text_table(read_text(path), columns)
            if any(_velocity(title) for title in table.header):
                return _of_table(table, unit)
    except InputError as error:
        raise InputError(error.text, error.path, path.name) from None
    return DriveProfile.of_course(load_motion(path, POSE, UNITS, unit=unit, columns=columns))


def _trapezoid(words: re.Match[str]) -> Trajectory:
    """From rest to rest, straight on or on the spot; InputError names a number that cannot be used."""
    way, unit, speed, acceleration = words.groups()
    scale = np.pi / 180 if unit == "deg" else 1.0
    try:
        numbers = [scale * float(number) for number in (way, speed, acceleration)]
    except ValueError:
        raise InputError(f"drive profile: expected three numbers, got {words[0]!r}") from None
    coordinate = 0 if unit == "m" else 2
    still = RampCommand(0.0, 1.0, 1.0)
    commands = [[RampCommand(*numbers) if k == coordinate else still] for k in range(3)]
    return Trajectory.from_profiles(np.zeros(3), commands)


def _velocity(title: str) -> tuple[int, str] | None:
    """Which velocity a column is of, and "deg" or "rad" or nothing; None: of none."""
    match = _UNIT.search(title)
    unit = match["unit"] if match and match.end() == len(title) else ""
    name = (title[: match.start()] if match and unit else title).strip().lower().replace("/", ".")
    result = next((k for word, k in _NAMES.items() if name == word or name.endswith(f".{word}")), None)
    if result is None or (unit and (unit == "m") == (result == 2)):
        return None
    return result, "" if unit == "m" else unit


def _of_table(table: TextTable, unit: str | None) -> DriveProfile:
    """Of columns of velocities; those that are missing are zero."""
    times = times_of(table)[0]
    if len(times) < 2:
        raise InputError(f"times: at least two samples are needed, got {len(times)}")
    if (wrong := np.flatnonzero(np.diff(times) <= 0)).size:
        raise InputError(f"line {table.lines[int(wrong[0]) + 1]}: the time does not increase")
    columns = {k: result for k, title in enumerate(table.header) if (result := _velocity(title))}
    values = numbers_of(table, columns)
    velocities, seen = np.zeros((len(times), 3)), set[int]()
    for column, (which, given) in columns.items():
        if which in seen:
            raise InputError(f"header: {table.header[column]} is the same velocity as another column")
        seen.add(which)
        in_degrees = which == 2 and (given or unit) == "deg"
        velocities[:, which] = values[column] * (np.pi / 180 if in_degrees else 1.0)
    return DriveProfile.of_velocities(times, velocities)


def _crossed(turning: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(N, 2) acceleration in base axes of velocities (N, 3) that turn with those of others."""
    return turning[:, 2:] * np.column_stack([-v[:, 1], v[:, 0]])


def _in_base(course: Trajectory, times: np.ndarray, side: Side) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and their derivatives (N, 3) in base axes of a course in the world."""
    places, speeds, accelerations = course.states(times, side=side)
    c, s = np.cos(places[:, 2]), np.sin(places[:, 2])

    def turned(vectors: np.ndarray) -> np.ndarray:
        x, y, z = vectors.T
        return np.column_stack([c * x + s * y, c * y - s * x, z])

    v, a = turned(speeds), turned(accelerations)
    a[:, :2] -= _crossed(v, v)
    return v, a
