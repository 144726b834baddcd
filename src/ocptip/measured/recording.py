"""Recordings of machines: columns of a CSV file, by the names and units of their header.

Known quantities, with a unit at the end of the name, which may be in brackets (`tau1_Nm`, `tau1 [Nm]`):

- time, as for motions: `time_s`, `t`, `timestamp_ms`, ...; s, ms, us, ns
- joint values: `q1`, `q2`, ..., or `NAME`, `NAME_position`; deg, rad, m
- joint speeds: `qd1`, ..., `NAME_velocity`; deg_s, rad_s, m_s
- joint torques, forces: `tau1`, ..., `NAME_effort`, `NAME_torque`; Nm, N
- force-torque sensor: `fx`, `fy`, `fz`, `mx`, `my`, `mz`, alone or after `SENSOR_`; N, Nm
- total electric power: `total_power`, `power` in W, or `voltage` and `current` in V and A
- power of a drive: `power1`, ...; W
- TCP: `gripper_x`, `gripper_y`, `gripper_z`; m, mm
- pose of the base since the start: `base_x`, `base_y`, `base_z`; m, mm; and `base_roll`, `base_pitch`,
  `base_yaw`; deg, rad
- tangential shifts of contacts 1, 2, ...: `dx1`, `dy1`, ...; m, mm
- switches at contacts 1, 2, ...: `contact1`, ...; numbers or V, closed above half of their maximum
- normal forces of contacts 1, 2, ...: `normal1`, ...; N

NAME is that of a joint, SENSOR that of the task's `[sensor]`. The columns of `motion.csv` are among these.
Without a unit numbers are SI, but for angles, which must say theirs. All other
columns are left out, and named. Cells that are empty or `nan` are samples that are missing.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ocptip.basics.errors import InputError, doubt, refuse_huge
from ocptip.basics.read import read_text
from ocptip.measured.contact_losses import ContactLoss, contact_loss
from ocptip.measured.time_bases import on_one_clock
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.bags import is_bag, recording_in_bag, refuse_of_other_files
from ocptip.trajectories.csv_text import TextTable, one_row_per_time, plain_names, text_table, times_of
from ocptip.trajectories.trajectory import Trajectory

ANGLE, SPEED, TORQUE, WRENCH, POWER, GRIPPER, BASE, SHIFT, FOOT, SWITCH = (
    "angles", "speeds", "torques", "sensor", "power", "gripper", "base", "shifts", "feet", "switches",
)  # fmt: skip
KINDS = (ANGLE, SPEED, TORQUE, WRENCH, POWER, GRIPPER, BASE, SHIFT)
FEWEST = 50  # samples: statistics of less say nothing
_USUAL, _GAP = 0.9, 1.75  # quantile of distances of samples, and so many times that is a gap
MOST = 6000  # samples that are looked at: of longer recordings every second, third, ... one

_LENGTH, _TURN = {"m": 1.0, "mm": 1e-3}, {"deg": np.pi / 180, "rad": 1.0}
_UNITS = {
    ANGLE: {**_TURN, **_LENGTH},
    SPEED: {f"{unit}{per}": value for unit, value in {**_TURN, **_LENGTH}.items() for per in ("_s", "/s")},
    TORQUE: {"Nm": 1.0, "N m": 1.0, "N": 1.0},
    WRENCH: {"Nm": 1.0, "N m": 1.0, "N": 1.0},
    POWER: {"W": 1.0, "kW": 1e3, "V": 1.0, "A": 1.0, "mA": 1e-3},
    GRIPPER: _LENGTH,
    BASE: {**_LENGTH, **_TURN},
    SHIFT: _LENGTH,
    FOOT: {"N": 1.0},
    SWITCH: {"V": 1.0},
}
_ALL = sorted({unit for units in _UNITS.values() for unit in units}, key=len, reverse=True)
_WITH_UNIT = re.compile(rf"(?P<body>.+?)[\s_]*[\[(]?(?<![A-Za-z])(?P<unit>{'|'.join(_ALL)})[\])]?")
_WORDS = {
    **dict.fromkeys(("position", "pos", "angle", "q"), ANGLE),
    **dict.fromkeys(("velocity", "vel", "speed", "qd"), SPEED),
    **dict.fromkeys(("effort", "torque", "force", "tau"), TORQUE),
}
_NUMBERED = re.compile(r"(?P<word>q|qd|tau|power|normal|contact)(?P<number>[1-9][0-9]*)")
_WRENCH = re.compile(r"(?:.*[./_])?(?P<part>force|torque)[./](?P<axis>[xyz])")  # of a WrenchStamped
_AXES = {name: k for k, name in enumerate(("fx", "fy", "fz", "mx", "my", "mz"))}
_PLACES = {name: k for k, name in enumerate(("x", "y", "z", "roll", "pitch", "yaw"))}
_TOTAL, _DRIVE, _VOLTAGE, _CURRENT = "power", "power{}", "voltage", "current"


@dataclass(frozen=True, eq=False)
class Signal:
    """A column of a recording.

    Attributes:
        name: without unit: `q1`, `tau2`, `fz`, `power`, `gripper_x`, `base_yaw`, `dx3`.
        kind: one of `KINDS`, or `FOOT`, of which no cause is searched.
        index: within its kind, from 0: joint, axis or contact (twice its number, + 1 for dy); of power 0 for
            the total and the number of the drive else.
        values: (N,), SI; nan where the sample is missing.
    """

    name: str
    kind: str
    index: int
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording of a motion: sampled signals over time.

    Attributes:
        times: (N,), s, increasing.
        signals: what is known of it.
        unknown: names of columns that are left out.
        thinned: every so manieth sample of the file is here.
        gaps: from, to (s) and number of samples where whole lines of the file are missing, see `gaps_of`.
        rates: what was done with signals that were not sampled with the joints, in words.
        slower: names of those that were sampled less often: where they have no sample, none is missing.
        contact_losses: of contacts with a switch, from all samples of the file, times as in it.
    """

    times: np.ndarray
    signals: tuple[Signal, ...]
    unknown: tuple[str, ...] = ()
    thinned: int = 1
    gaps: tuple[tuple[float, float, int], ...] = ()
    rates: tuple[str, ...] = ()
    slower: frozenset[str] = frozenset()
    contact_losses: tuple[ContactLoss, ...] = ()

    @property
    def period(self) -> float:
        """Usual distance of samples, s."""
        return float(np.median(np.diff(self.times)))

    def of(self, kind: str) -> list[Signal]:
        """Signals of a kind, in their order."""
        return sorted((s for s in self.signals if s.kind == kind), key=lambda s: s.index)


def read_recording(
    path: str | os.PathLike[str],
    robot: StandingMechanism,
    *,
    unit: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    topics: Sequence[str] = (),
) -> Recording:
    """Read a recording of a robot: a CSV file, or a bag with joint states in rad, m, N m, N.

    Args:
        path: of the file.
        robot: gives the names of joints and sensor, and units.
        unit: "deg" or "rad", of angles that say none.
        columns: what columns are: names of the module, each with the title or the number, from 1, of one.
        topics: of a bag, see `ocptip.trajectories.bags.recording_in_bag`.

    Raises:
        InputError: it cannot be read, or holds no time, nothing known, something twice, a text or too few
            samples; names file, line and column.
    """
    path = Path(path)
    bag = is_bag(path)
    refuse_of_other_files(bag, topics, columns)
    table = recording_in_bag(path, topics) if bag else None
    text = "" if bag else read_text(path)
    try:
        if table is None:
            return _of_table(text_table(text, columns), robot, unit)
        return _of_table(table, robot, "rad")
    except InputError as error:
        raise InputError(error.text, error.path, path.name) from None


def gaps_of(times: np.ndarray) -> tuple[tuple[float, float, int], ...]:
    """From, to (s) and number of missing samples between times (N,), s, that are farther apart than usual.

    Usual is up to what nine of ten distances are: clocks of recorders jitter.
    """
    apart = np.diff(times)
    usual = max(float(np.quantile(apart, _USUAL)), float(np.median(apart)))
    wide = np.flatnonzero(apart > _GAP * usual)
    period = float(np.median(apart))
    return tuple((float(times[k]), float(times[k + 1]), max(round(apart[k] / period) - 1, 1)) for k in wide)


def doubt_turns(recording: Recording, robot: StandingMechanism, motion: Trajectory) -> None:
    """Warn if the recorded angles are to those of the motion that was run as radians are to degrees."""
    turns = [one for one in recording.signals if one.kind == ANGLE and robot.units[one.index] == "rad"]
    planned = np.abs(motion.states(np.linspace(0.0, motion.end, 50))[0])
    recorded = max((np.abs(np.nan_to_num(one.values)).max() for one in turns), default=0.0)
    expected = max((planned[:, one.index].max() for one in turns), default=0.0)
    for factor, word in ((np.pi / 180, "radians"), (180 / np.pi, "degrees")):
        if abs(recorded - factor * expected) < 0.2 * factor * expected:
            doubt(f"recorded angles are {factor:.2g} times those of the plan; are they {word}?")


def _of_table(table: TextTable, robot: StandingMechanism, unit: str | None) -> Recording:
    if len(table.rows) < FEWEST:
        raise InputError(f"at least {FEWEST} samples are needed, got {len(table.rows)}")
    times, clock = times_of(table)
    title = table.header[clock.columns[0]]
    long = one_row_per_time(table, times, clock.columns, robot.names)
    if long is not table:
        times, clock = times_of(long)
    table = plain_names(long, robot.names, measured=True)
    if (late := np.flatnonzero(~(np.diff(times) >= 0))).size:
        raise InputError(f"line {table.lines[int(late[0]) + 1]}: {title} does not increase")
    rows = _cells(table)
    known = {k: _signal(text, robot, unit) for k, text in enumerate(table.header) if k not in clock.columns}
    unknown = [table.header[k] for k, column in known.items() if column is None and table.header[k]]
    signals: dict[str, tuple[str, int, np.ndarray]] = {}
    for k, column in known.items():
        if column is None:
            continue
        name, kind, index, scale = column
        if name in signals:
            raise InputError(f"header: {table.header[k]} is {name}, which is there already")
        signals[name] = kind, index, scale * rows[:, k]
        largest = float(np.nanmax(np.abs(signals[name][2]), initial=0.0))
        refuse_huge(f"column {table.header[k]}", largest)
    switches = {name: signals.pop(name) for name in list(signals) if signals[name][0] == SWITCH}
    if not signals:
        raise InputError(f"header: no known quantity among {', '.join(table.header)} (see docs/compare.md)")
    others = [k for k, column in known.items() if column is None]
    one = on_one_clock(times, signals, np.asarray(np.isfinite(rows[:, others]).any(axis=1)))
    step = -(-len(one.times) // MOST)
    results = {
        name: Signal(name, kind, index, values[::step]) for name, (kind, index, values) in one.signals.items()
    }
    return Recording(
        one.times[::step],
        tuple(_with_power(results)),
        tuple(unknown),
        step,
        gaps_of(one.times),
        one.moved,
        one.slower,
        tuple(contact_loss(k + 1, times, values) for _, k, values in switches.values()),
    )


def _cells(table: TextTable) -> np.ndarray:
    """All numbers; nan for what is empty, and for columns that hold texts from the first line on."""
    values = np.full((len(table.rows), len(table.header)), np.nan)
    for k, title in enumerate(table.header):
        numeric = False
        for index, cell in enumerate(table.texts(k)):
            try:
                values[index, k] = float(cell) if cell else np.nan
                numeric = numeric or bool(cell)
            except ValueError:
                if numeric:
                    raise InputError(
                        f"line {table.lines[index]}, {title}: expected a number, got {cell!r}"
                    ) from None
    values[~np.isfinite(values)] = np.nan
    return values


def _signal(title: str, robot: StandingMechanism, unit: str | None) -> tuple[str, str, int, float] | None:
    """Name, kind, index and SI unit per unit of a column; None if it is not known."""
    match = _WITH_UNIT.fullmatch(title)
    for body, unit_text in (((match["body"], match["unit"]),) if match else ()) + ((title, ""),):
        known = _known(body.strip(" _"), robot.names, robot.sensor.name)
        if known is None:
            continue
        name, kind, index = known
        if kind == SWITCH and index >= len(robot.support.contacts):
            continue
        if unit_text and unit_text not in _UNITS[kind]:
            continue
        return name, kind, index, _scale(title, kind, index, unit_text, robot.units, unit)
    return None


def _scale(
    title: str, kind: str, index: int, unit_given: str, units: Sequence[str], unit: str | None
) -> float:
    """SI unit per unit of a column."""
    turns = kind == BASE and index >= 3
    slides = (kind in (ANGLE, SPEED) and units[index] == "m") or (kind == BASE and not turns)
    turns = turns or (kind in (ANGLE, SPEED) and not slides)
    if not unit_given and turns:
        if unit is None:
            raise InputError(
                f"header: {title} says neither degrees nor radians; give --unit deg or --unit rad, or call "
                f"it {title}_deg"
            )
        return _TURN[unit]
    base = unit_given.split("_")[0].split("/")[0]
    if unit_given and ((turns and base not in _TURN) or (slides and base not in _LENGTH)):
        raise InputError(f"header: {title}: expected {'degrees or radians' if turns else 'a length'}")
    return _UNITS[kind][unit_given] if unit_given else 1.0


def _known(body: str, names: Sequence[str], sensor: str) -> tuple[str, str, int] | None:
    """Name, kind and index of a column without its unit."""
    if (match := _NUMBERED.fullmatch(body)) is not None:
        number = int(match["number"])
        if match["word"] in ("normal", "contact"):
            return body, FOOT if match["word"] == "normal" else SWITCH, number - 1
        kind = {"q": ANGLE, "qd": SPEED, "tau": TORQUE, "power": POWER}[match["word"]]
        if number > len(names):
            return None
        return body, kind, number if kind == POWER else number - 1
    low = body.lower()
    axis = low.removeprefix(f"{sensor.lower()}_")
    if axis in _AXES:
        return axis, WRENCH, _AXES[axis]
    if (match := _WRENCH.fullmatch(low)) is not None:
        axis = f"{'f' if match['part'] == 'force' else 'm'}{match['axis']}"
        return axis, WRENCH, _AXES[axis]
    if low in (_TOTAL, "total_power"):
        return _TOTAL, POWER, 0
    if low in (_VOLTAGE, _CURRENT):
        return low, POWER, -1
    for kind, word in ((GRIPPER, "gripper_"), (BASE, "base_")):
        place = low.removeprefix(word)
        if place != low and place in _PLACES and not (kind == GRIPPER and _PLACES[place] > 2):
            return low, kind, _PLACES[place]
    if (match := re.fullmatch(r"d([xy])([1-9][0-9]*)", low)) is not None:
        return low, SHIFT, 2 * (int(match[2]) - 1) + (match[1] == "y")
    return _of_joint(body, names)


def _of_joint(body: str, names: Sequence[str]) -> tuple[str, str, int] | None:
    """Quantity and joint of a column with a joint's name, alone or with a word for the quantity beside it."""
    short = {ANGLE: "q", SPEED: "qd", TORQUE: "tau"}
    for joint, name in enumerate(names):
        match = re.fullmatch(rf"(?:(?P<a>.*)[./\s_])?{re.escape(name)}(?:[./\s_](?P<b>\w+))?", body)
        if match is None:
            continue
        before = re.split(r"[./\s_]+", (match["a"] or "").strip("./_ "))[-1].lower()
        after = (match["b"] or "").lower()
        word = after or before
        if word in _WORDS or not word or (not after and body.startswith("/")):
            kind = _WORDS.get(word, ANGLE)
            return f"{short[kind]}{joint + 1}", kind, joint
    return None


def _with_power(result: dict[str, Signal]) -> Iterator[Signal]:
    """The signals; voltage times current as the total power, if that is not there."""
    voltage, current = result.pop(_VOLTAGE, None), result.pop(_CURRENT, None)
    yield from result.values()
    if _TOTAL not in result and voltage is not None and current is not None:
        yield Signal(_TOTAL, POWER, 0, voltage.values * current.values)
