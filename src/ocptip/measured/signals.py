"""Faults of single signals: missing, dead, clipped, noisy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from ocptip.measured.contact_losses import ContactLoss
from ocptip.measured.recording import ANGLE, SPEED, TORQUE, WRENCH, Recording, Signal

HARMLESS = 0.03
"""s: vibration opened contacts of the rig of thesis M for up to 30 ms, and no base tipped (7.4.1)."""

_NORMAL = 1.4826  # standard deviation over median deviation
_ROUNDED = 1e-9  # of a signal's range: predictions so near are the same
_TIES = 3  # samples at the very end of a signal's range from which it may be clipped
_TOGETHER = {ANGLE: "q{}", SPEED: "qd{}", TORQUE: "tau{}"}
_SENSOR = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True)
class Finding:
    """Something that differs from the description.

    Attributes:
        kind: "mass", "centre of mass", "friction", "losses", "delay", "elasticity", "zero", "missing",
            "dead", "clipped", "noisy", "base" or "contact".
        name: what: `mass of link 3`, `Coulomb friction of elbow`, `fz clipped`, ...
        value: its size, nan where there is none.
        interval: half width of its 95 % interval, in the same unit; nan where there is none.
        unit: of both, as people read it.
        explained: share of what would be left over without it, in squares; nan where that means nothing.
        rivals: names of what would explain the same as well, as far as the noise separates them.
        text: further remarks.
    """

    kind: str
    name: str
    value: float = float("nan")
    interval: float = float("nan")
    unit: str = ""
    explained: float = float("nan")
    rivals: tuple[str, ...] = ()
    text: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "rivals": list(self.rivals)}


def quantum(values: np.ndarray) -> float:
    """Minimum step between values that occur; 0 if there is only one."""
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    return float(steps.min()) if len(steps) else 0.0


def resolution(values: np.ndarray) -> float:
    """Minimum noise of a signal: of its rounding, and a millionth of its maximum size."""
    return max(quantum(values) / np.sqrt(12), 1e-6 * float(np.nanmax(np.abs(values), initial=0.0)), 1e-12)


def noise_of(residuals: np.ndarray, kept: np.ndarray) -> float:
    """Standard deviation of white noise, by third differences: what is smooth over four samples is none.

    By their median, so that single steps count little; 0 where most samples are smooth to the last digit.
    """
    together = kept[:-3] & kept[1:-2] & kept[2:-1] & kept[3:]
    differences = np.diff(np.where(kept, residuals, 0.0), 3)[together] / np.sqrt(20)
    if not len(differences):
        return 0.0
    return float(stats.median_abs_deviation(differences)) * _NORMAL


def absent(recording: Recording, joints: int) -> list[Finding]:
    """Signals that are not there though others of their kind are, and samples that are missing."""
    result = gaps(recording)
    for kind, title in _TOGETHER.items():
        there = {s.index for s in recording.of(kind)}
        if there:
            names = [title.format(k + 1) for k in range(joints) if k not in there]
            result += [Finding("missing", f"{name} missing", text="is not recorded") for name in names]
    there = {s.index for s in recording.of(WRENCH)}
    if there:
        lacking = [name for k, name in enumerate(_SENSOR) if k not in there]
        result += [Finding("missing", f"{name} missing", text="is not recorded") for name in lacking]
    for one in recording.signals:
        count = int(np.isnan(one.values).sum())
        if count and one.name not in recording.slower:
            gone = recording.times[np.isnan(one.values)]
            text = f"{count} of {len(one.values)} samples, {gone[0]:.4g} to {gone[-1]:.4g} s"
            share = 100 * count / len(one.values)
            result.append(Finding("missing", f"{one.name} missing", share, unit="%", text=text))
    return result


def gaps(recording: Recording) -> list[Finding]:
    """Whole samples that are missing: how many, and between which times."""
    if not recording.gaps:
        return []
    lost, there = sum(count for *_, count in recording.gaps), len(recording.times) * recording.thinned
    longest = max(recording.gaps, key=lambda gap: gap[1] - gap[0])
    text = f"{lost} of {lost + there} samples, none between {longest[0]:.4g} and {longest[1]:.4g} s"
    if more := len(recording.gaps) - 1:
        text += f", and {more} shorter gap{'s' * (more > 1)}"
    return [Finding("missing", "samples missing", 100 * lost / (lost + there), unit="%", text=text)]


def lost_contacts(losses: Sequence[ContactLoss]) -> list[Finding]:
    """Interruptions of contacts that contradict a plan in which none is lost."""
    results = []
    for one in losses:
        name = f"contact {one.contact}"
        if not one.ever_closed:
            results.append(
                Finding("contact", f"{name} never closed", text="its switch is open in all samples")
            )
        elif one.longest > HARMLESS:
            times = "once" if one.count == 1 else f"longest of {one.count} interruptions"
            text = f"{times}, from {one.at:.3f} s; vibration explains up to {1e3 * HARMLESS:.0f} ms"
            results.append(Finding("contact", f"{name} lost", 1e3 * one.longest, unit="ms", text=text))
    return results


def uncovered(recording: Recording, begin: float, end: float) -> list[Finding]:
    """Parts of a motion from begin to end, s, before the first and after the last sample."""
    first, last = float(recording.times[0]), float(recording.times[-1])
    edge, share = 2 * recording.period, 100 / (end - begin)
    parts = [("begin", begin, min(first, end)), ("end", max(last, begin), end)]
    return [
        Finding(
            "missing",
            f"{where} of the motion missing",
            share * (high - low),
            unit="%",
            text=f"no sample between {low:.4g} and {high:.4g} s",
        )
        for where, low, high in parts
        if high - low > edge
    ]


def dead(one: Signal, predicted: np.ndarray) -> bool:
    """Whether a signal never changes though it should."""
    values = one.values[np.isfinite(one.values)]
    moves = np.ptp(predicted) > 1e-6 * max(float(np.abs(predicted).max()), 1e-300)
    return len(values) == 0 or (not np.ptp(values) and bool(moves))


def clipped(one: Signal, predicted: np.ndarray, level: float) -> np.ndarray:
    """(N,) True where a signal stays at an end of its range beyond which it should go.

    At least three samples are exactly there, and the prediction (a drive at standby) is not. Either chance
    does not put as many there with this noise and rounding. Or the value expected from the others and the
    prediction is beyond it on average, by more than the scatter of the others explains.
    """
    y = one.values
    values = np.zeros(len(y), dtype=bool)
    good = np.isfinite(y)
    same = quantum(y) + _ROUNDED * np.ptp(predicted)
    about = np.lib.stride_tricks.sliding_window_view(np.pad(predicted, 1, mode="edge"), 3)  # jumps between
    for sign in (1.0, -1.0):
        top = np.max(sign * y[good])
        as_expected = (sign * about >= top - same).any(axis=1) & (sign * about <= top + same).any(axis=1)
        at_top = good & (sign * y >= top) & ~as_expected
        rest = good & ~at_top
        if at_top.sum() < _TIES or rest.sum() < 10:
            continue
        by_chance = good.sum() * min(1.0, quantum(y) / (np.sqrt(2 * np.pi) * max(noise_of(y, good), 1e-300)))
        if stats.poisson.sf(at_top.sum() - 1, by_chance) < level:
            values |= at_top
            continue
        X = np.column_stack([np.ones_like(predicted), predicted])
        size = np.linalg.lstsq(X[rest], y[rest], rcond=None)[0]
        spread = float(np.std(y[rest] - X[rest] @ size))
        beyond = float(np.mean(sign * (X[at_top] @ size) - top))
        if beyond > float(stats.norm.isf(level)) * spread + quantum(y):
            values |= at_top
    return values


def noisy(noises: Mapping[str, float], groups: Sequence[Sequence[str]], level: float) -> list[Finding]:
    """Signals that are noisier than the others of their kind, by how much those differ.

    Logarithms of the noise, each studentised by the other signals of its group (forces and moments
    separately, each about the mean). Groups of less than four signals say nothing.
    """
    results = []
    for names in groups:
        noisy_names = [name for name in names if noises.get(name, 0.0) > 0]
        if len(noisy_names) < 4:
            continue
        logs = np.log([noises[name] for name in noisy_names])
        parts = np.array([name[0] == "m" for name in noisy_names])
        for k, name in enumerate(noisy_names):
            rest = np.arange(len(noisy_names)) != k
            same = rest & (parts == parts[k])
            freedom = rest.sum() - len(set(parts[rest]))
            if not same.any() or freedom < 1:
                continue
            means = {part: logs[rest & (parts == part)].mean() for part in set(parts[rest])}
            away = np.array([logs[j] - means[parts[j]] for j in np.flatnonzero(rest)])
            spread = max(float(np.sqrt(np.sum(away**2) / freedom)), 1e-6)
            excess = logs[k] - logs[same].mean()
            t = excess / (spread * np.sqrt(1 + 1 / same.sum()))
            if stats.t.sf(t, freedom) < level:
                factor = float(np.exp(excess))
                results.append(Finding("noisy", f"{name} noisy", factor, unit="times the others of its kind"))
    return results
