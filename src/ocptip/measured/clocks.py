"""Where in a recording a motion is, and by how much each signal is later than the others."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import signal

from ocptip.basics.errors import InputError
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import ANGLE, GRIPPER, POWER, SPEED, TORQUE, WRENCH, Recording

_FINER = 4  # instants per sample
_ROUNDS = 8
_FOLLOWS = 0.25  # squared correlation below which no signal follows a motion
AROUND = 1.5
"""Samples around a switching time in which loads are not checked: they have steps there."""

FOLLOWING = (ANGLE, SPEED, TORQUE, WRENCH, POWER, GRIPPER)
"""Kinds of signals that move with the motion."""


def find_clock(recording: Recording, predictor: Predictor) -> tuple[float, Mapping[str, float]]:
    """When a motion begins.

    The sum of the squared cross-correlations of all signals with their predictions has its maximum there; the
    begin of each signal is refined to fractions of a sample by least squares in begin, size and offset.

    Returns:
        The time of the recording, s, at which the motion begins by all signals; and by each of them.

    Raises:
        InputError: no signal follows the motion.
    """
    dt, T = recording.period, recording.times[-1] - recording.times[0]
    grid = recording.times[0] + dt * np.arange(int(np.floor(T / dt)) + 1)
    N, M = len(grid), int(np.ceil(predictor.motion.end / dt))
    local = dt / _FINER * (np.arange(-N * _FINER, (N + M) * _FINER + 1) + 0.5)  # no event is just there
    state = predictor.state(local, np.zeros(predictor.robot.n), np.zeros(4 * predictor.robot.arm.links + 1))
    scores, seen = np.zeros(N + M + 2), {}
    for kind in FOLLOWING:
        for one in recording.of(kind):
            fine, good = predictor.signal(kind, one.index, state), np.isfinite(one.values)
            if good.sum() < 3 or not np.ptp(one.values[good]) or np.ptp(fine) <= 1e-9 * np.abs(fine).max():
                continue
            measured = np.interp(grid, recording.times[good], one.values[good])
            scores += correlations(measured, fine[::_FINER])
            seen[one.name] = (one.values, fine)
    if not seen or scores.max() < _FOLLOWS:
        raise InputError("recording: no signal follows the motion of the plan, or none that moves is there")
    # the sequence begins N samples before the motion: at place m its begin is at sample N - m
    begin = recording.times[0] + dt * (N - 0.5 / _FINER - _top(scores))
    single = {
        name: _refined(recording, local, fine, y, begin, predictor.jumps) for name, (y, fine) in seen.items()
    }
    return float(begin), single


def correlations(values: np.ndarray, long: np.ndarray) -> np.ndarray:
    """(len(long) - N + 1,) squared correlation of values (N,) with each part of a longer sequence."""
    N = len(values)
    values, long = values - values.mean(), long - long.mean()
    products = signal.correlate(long, values, "valid", method="fft")
    sums = np.cumsum(np.concatenate([[0.0], long]))
    squares = np.cumsum(np.concatenate([[0.0], long**2]))
    spread = (squares[N:] - squares[:-N]) - (sums[N:] - sums[:-N]) ** 2 / N
    flat = spread <= 1e-9 * max(float(spread.max()), 1e-300)
    return np.where(flat, 0.0, products**2 / np.where(flat, 1.0, spread) / float(values @ values))


def _top(scores: np.ndarray) -> float:
    """Place of the maximum, between the samples by a parabola."""
    index = int(np.argmax(scores))
    if not 0 < index < len(scores) - 1:
        return float(index)
    low, mid, high = scores[index - 1 : index + 2]
    curved = low - 2 * mid + high
    return index + (0.5 * (low - high) / curved if curved < 0 else 0.0)


def distance(times: np.ndarray, events: np.ndarray) -> np.ndarray:
    """(N,), s, of each time from the nearest switching time; infinite without one."""
    events = np.concatenate([[-np.inf], events, [np.inf]])
    after = np.searchsorted(events, times)
    return np.minimum(events[after] - times, times - events[after - 1])


def _refined(
    recording: Recording,
    fine_times: np.ndarray,
    fine: np.ndarray,
    y: np.ndarray,
    begin: float,
    events: np.ndarray,
) -> float:
    """Begin of the motion by one signal, s: least squares in begin, size and offset, from a first begin.

    Without samples next to switching times, where loads have steps; nan if the others do not fix it within a
    sample.
    """
    slope, first, step, error = np.gradient(fine, fine_times), begin, recording.period, np.inf
    for _ in range(_ROUNDS):
        good = np.isfinite(y) & (distance(recording.times - begin, events) > AROUND * step)
        times, values = recording.times[good], y[good]
        if len(times) < 10:
            return float("nan")
        p, dp = (np.interp(times - begin, fine_times, curve) for curve in (fine, slope))
        X = np.column_stack([np.ones_like(p), p, dp])
        size = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        X = X / size
        result, _, rank, _ = np.linalg.lstsq(X, values, rcond=1e-10)
        noise = np.sqrt(np.sum((values - X @ result) ** 2) / (len(times) - 3))
        result = result / size
        if rank < 3 or not result[1]:
            return float("nan")
        error = noise * np.sqrt(np.linalg.inv(X.T @ X)[2, 2]) / size[2] / abs(result[1])
        change = float(np.clip(-result[2] / result[1], -4 * step, 4 * step))
        begin += change
        if abs(change) < 1e-3 * step:
            break
    return (
        begin
        if error < step and abs(begin - first) < 0.5 * (fine_times[-1] - fine_times[0])
        else float("nan")
    )
