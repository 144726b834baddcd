"""Whether and how the base moved: by its pose, or by tangential shifts of its contacts, (6.16), (6.17)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from ocptip.measured.recording import BASE, SHIFT, Recording
from ocptip.measured.regression import autoregression
from ocptip.measured.signals import Finding

_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_FEWEST = 20  # samples before and after


@dataclass(frozen=True, eq=False)
class BaseShift:
    """How far the base moved, in base axes at the start.

    Attributes:
        names: of the coordinates that are known, of x, y, z, roll, pitch, yaw.
        values: (N, k), m and rad, since the start.
        changes: (k,) from before to after the motion.
        intervals: (k,) half widths of their 95 % intervals.
        peaks: (k,) maximum size at any time.
        contacts: (c,), m: maximum tangential shift of each contact at any time; empty where it is not known.
        findings: coordinates that changed.
    """

    names: tuple[str, ...]
    values: np.ndarray
    changes: np.ndarray
    intervals: np.ndarray
    peaks: np.ndarray
    contacts: np.ndarray
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data, m and rad."""
        rows = zip(self.names, self.changes, self.intervals, self.peaks, strict=True)
        return {
            "coordinates": [{"name": n, "change": c, "interval": i, "peak": p} for n, c, i, p in rows],
            "contact_shifts_m": self.contacts.tolist(),
        }


def planar_motion(places: np.ndarray, directions: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Shift and turn of a body in the plane from shifts of its points along directions.

    Args:
        places: (s, 2), m, of the points, from the point whose shift is wanted.
        directions: (s, 2) along which each shift is measured.
        shifts: (N, s), m; at least three, not all about one centre.

    Returns:
        (N, 3): x, y, m, and angle, rad: of the two angles that three shifts allow the smaller one (6.16).
    """
    values = np.zeros((len(shifts), 3))
    for _ in range(6):
        c, s = np.cos(values[:, 2:]), np.sin(values[:, 2:])
        turned = np.stack([c * places[:, 0] - s * places[:, 1], s * places[:, 0] + c * places[:, 1]], axis=-1)
        slopes = np.stack([-turned[..., 1], turned[..., 0]], axis=-1)
        left = shifts - np.sum((values[:, None, :2] + turned - places) * directions, axis=-1)
        J = np.concatenate(
            [np.broadcast_to(directions, turned.shape), np.sum(slopes * directions, axis=-1)[..., None]],
            axis=-1,
        )
        values += np.einsum("nij,nj->ni", np.linalg.pinv(J), left)
    return values


def base_motion(
    recording: Recording, contacts: np.ndarray, begin: float, end: float, level: float
) -> BaseShift | None:
    """The motion of the base; None where it is not recorded.

    A coordinate changed if its means before and after the motion differ by more than their errors, in noise
    with memory, explain at this level.

    Args:
        recording: with signals of the base.
        contacts: (c, 3), m, positions in base axes.
        begin, end: of the motion, s.
        level: probability of finding a change where there is none.
    """
    result = _coordinates(recording, contacts)
    if result is None:
        return None
    names, values = result
    good = np.isfinite(values).all(axis=1)
    first = (recording.times < begin) & good
    last = (recording.times > end) & good
    k = len(names)
    changes, intervals = np.full(k, np.nan), np.full(k, np.nan)
    findings = []
    if min(first.sum(), last.sum()) >= _FEWEST:
        for j in range(k):
            parts = [values[which, j] for which in (first, last)]
            changes[j] = parts[1].mean() - parts[0].mean()
            error = float(np.sqrt(sum(_variance_of_mean(part) for part in parts)))
            freedom = sum(len(part) for part in parts) - 2
            intervals[j] = float(stats.t.isf(0.025, freedom)) * error
            if abs(changes[j]) > float(stats.t.isf(0.5 * level / k, freedom)) * error and changes[j]:
                turns = _AXES.index(names[j]) >= 3
                scale, unit = (180 / np.pi, "deg") if turns else (1e3, "mm")
                name = f"base {'turned' if turns else 'shifted'} ({names[j]})"
                findings.append(Finding("base", name, scale * changes[j], scale * intervals[j], unit))
    still = values[first].mean(axis=0) if first.any() else np.zeros(k)
    moved = np.where(np.isfinite(values), values - still, 0.0)
    return BaseShift(
        names, moved, changes, intervals, np.abs(moved).max(axis=0), _slides(names, moved, contacts),
        tuple(findings),
    )  # fmt: skip


def _coordinates(recording: Recording, contacts: np.ndarray) -> tuple[tuple[str, ...], np.ndarray] | None:
    pose, shifts = recording.of(BASE), recording.of(SHIFT)
    if pose:
        return tuple(_AXES[one.index] for one in pose), np.stack([one.values for one in pose], axis=1)
    shifts = [one for one in shifts if one.index // 2 < len(contacts)]
    if len(shifts) < 3:
        return None
    places = contacts[[one.index // 2 for one in shifts], :2] - contacts[:, :2].mean(axis=0)
    directions = np.eye(2)[[one.index % 2 for one in shifts]]
    values = np.stack([one.values for one in shifts], axis=1)
    good = np.isfinite(values).all(axis=1)
    scalars = np.full((len(values), 3), np.nan)
    scalars[good] = planar_motion(places, directions, values[good])
    return ("x", "y", "yaw"), scalars


def _slides(names: tuple[str, ...], moved: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """Maximum tangential shift of each contact, m."""
    if not {"x", "y", "yaw"} <= set(names):
        return np.empty(0)
    x, y, yaw = (moved[:, names.index(name), None] for name in ("x", "y", "yaw"))
    middle = contacts[:, :2].mean(axis=0) if len(names) == 3 else np.zeros(2)
    px, py = (contacts[:, :2] - middle).T
    dx = x + (np.cos(yaw) - 1) * px - np.sin(yaw) * py
    dy = y + np.sin(yaw) * px + (np.cos(yaw) - 1) * py
    return np.hypot(dx, dy).max(axis=0)


def _variance_of_mean(values: np.ndarray) -> float:
    """Variance of the mean of correlated noise."""
    a = autoregression(values)
    order = len(a) - 1
    away = values - values.mean()
    innovations = np.convolve(away, a, "valid")
    return float(np.mean(innovations**2)) / max(float(a.sum()) ** 2, 1e-12) / max(len(values) - order, 1)
