"""Signals of one file that were sampled at different rates: joints at 100 Hz, a sensor at 500 Hz.

Recorders write such signals into one table, whose lines then hold the cells of one rate, the others being
empty. All that compares signals needs them at the same instants: those of the joints. Faster signals are
interpolated there, between two of their samples; slower ones keep their samples, at the nearest instants.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

Columns = Mapping[str, tuple[str, int, np.ndarray]]
"""Kind, index and values (N,) of signals by name."""

_TOGETHER = 0.9  # share of a signal's samples that are on lines of a base: then it belongs to it
_HALF = 0.5  # of a base's lines: signals with fewer samples, evenly spaced, have a base of their own
_EVEN = 1.5  # times the usual distance of samples, within which nine of ten are
_LEADS = "angles"


@dataclass(frozen=True, eq=False)
class OneClock:
    """Signals at the same instants.

    Attributes:
        times: (M,), s, increasing.
        signals: at these, nan where a sample is missing.
        moved: what was done with signals of other time bases, in words.
        slower: names of those with fewer samples than the others.
    """

    times: np.ndarray
    signals: Columns
    moved: tuple[str, ...] = ()
    slower: frozenset[str] = frozenset()


def on_one_clock(times: np.ndarray, signals: Columns, others: np.ndarray) -> OneClock:
    """Put all signals at the instants of the joints.

    Args:
        times: (N,), s, never decreasing.
        signals: nan where a cell is empty.
        others: (N,) whether a line has numbers of columns that are not known.
    """
    filled = {name: np.isfinite(values) for name, (_, _, values) in signals.items()}
    bases = _bases(times, filled)
    if len(bases) == 1:
        anything = np.any(list(filled.values()), axis=0)
        kept = anything | ~others  # lines of other signals only are no samples of these
        return OneClock(
            *_without_repeats(times[kept], {n: _at(signal, kept) for n, signal in signals.items()})
        )
    joints = [sum(signals[name][0] == _LEADS for name in base) for base in bases]
    main = bases[int(np.argmax(joints))] if max(joints) else max(bases, key=len)
    signal = np.any([filled[name] for name in main], axis=0)
    clock, placed = _without_repeats(times[signal], {name: _at(signals[name], signal) for name in main})
    period, words, slower = float(np.median(np.diff(clock))), [], set[str]()
    for base in bases:
        if base is main:
            continue
        there = np.any([filled[name] for name in base], axis=0)
        given, values = _without_repeats(times[there], {name: _at(signals[name], there) for name in base})
        rate = float(np.median(np.diff(given))) if len(given) > 1 else np.inf
        faster = rate <= _EVEN * period
        for name, (kind, index, samples) in values.items():
            moved = _between(clock, given, samples, rate) if faster else _nearest(clock, given, samples)
            placed[name] = kind, index, moved
        slower |= set() if faster else set(base)
        titles = ", ".join(base)
        how = "interpolated at" if faster else "kept at the nearest of"
        words.append(f"{titles}: {1 / rate:.4g} Hz, {how} the instants of {main[0]} ({1 / period:.4g} Hz)")
    return OneClock(clock, {name: placed[name] for name in signals}, tuple(words), frozenset(slower))


def _at(signal: tuple[str, int, np.ndarray], rows: np.ndarray) -> tuple[str, int, np.ndarray]:
    kind, index, values = signal
    return kind, index, values[rows]


def _bases(times: np.ndarray, filled: Mapping[str, np.ndarray]) -> list[list[str]]:
    """Names of the signals that were sampled together."""
    bases: list[tuple[list[str], np.ndarray]] = []
    for name in sorted(filled, key=lambda name: -int(filled[name].sum())):
        values = filled[name]
        for names, lines in bases:
            shared = np.sum(values & lines) >= _TOGETHER * np.sum(values)
            if shared and (np.sum(values) >= _HALF * np.sum(lines) or not _even(times[values])):
                names.append(name)
                lines |= values
                break
        else:
            bases.append(([name], values.copy()))
    order = list(filled)
    return [sorted(names, key=order.index) for names, _ in bases]


def _even(times: np.ndarray) -> bool:
    """Whether samples are evenly spaced, as those of a slower clock are and those that are left are not."""
    apart = np.diff(times)
    return len(apart) > 1 and float(np.quantile(apart, 0.9)) <= _EVEN * float(np.median(apart))


def _without_repeats(times: np.ndarray, signals: Columns) -> tuple[np.ndarray, dict]:
    """The last one of lines with the same time, as in motion.csv."""
    last = np.append(np.diff(times) > 0, True)
    return times[last], {name: (kind, index, values[last]) for name, (kind, index, values) in signals.items()}


def _between(clock: np.ndarray, times: np.ndarray, values: np.ndarray, rate: float) -> np.ndarray:
    """Values at the clock's times, linear between neighbours; nan where these are missing or far apart."""
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(len(clock), np.nan)
    times, values = times[good], values[good]
    after = np.clip(np.searchsorted(times, clock), 1, len(times) - 1)
    moved = np.interp(clock, times, values)
    near = times[after] - times[after - 1] <= 2 * _EVEN * rate
    inside = (clock >= times[0] - rate) & (clock <= times[-1] + rate)
    return np.where(near & inside, moved, np.nan)


def _nearest(clock: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Each value at the nearest of the clock's times, nan at all others."""
    moved = np.full(len(clock), np.nan)
    after = np.clip(np.searchsorted(clock, times), 1, len(clock) - 1)
    nearest = np.where(times - clock[after - 1] < clock[after] - times, after - 1, after)
    moved[nearest] = values
    return moved
