"""Check after the plan: does a motion keep all limits at every instant, not only at quadrature nodes?

The exact motion is sampled in every interval between events, up to 1.5 ns from each event on either side
(torques and reserves jump there; joints that switch together do so within 1 ns), and refined around the worst
instants until they stay put. The rest before and after the motion is looked at, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import MotionSamples, StandingMechanism
from ocptip.trajectories.sampled import Motion

INSIDE = 1.5e-9
"""Distance from events at which the two sides are sampled, s."""

MOST_INSTANTS = 1_000_000
"""Largest number of instants of the first grid: some 3 GB of memory."""

_MIN_POINTS = 5
_ROUNDS = 8
_NEAREST = 6
_FRESH = 9
_ANGLE_TOLERANCE = 1e-9
_RELATIVE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Worst:
    """The worst instant of one quantity.

    Attributes:
        value: in the quantity's unit.
        time: s.
        limit: what it is compared with.
        detail: where or what, e.g. "joint 2".
    """

    value: float
    time: float
    limit: float
    detail: str = ""


@dataclass(frozen=True)
class MotionCheck:
    """Outcome of the check of a motion.

    Attributes:
        verified: True only if every limit holds at every sampled instant and all contact states are solved.
        energy: J, electric.
        duration: s.
        worst: by name: GN, GT, torque_ratio, clearance_m, and the exact speed_ratio, acceleration_ratio,
            angle_margin_deg of the motion (angle_margin where a coordinate is a length: in its unit); the
            mechanism's further limits by their names.
        violations: one sentence per broken limit, empty if verified.
        samples: number of instants evaluated.
        stands: no contact is lost at any sampled instant, whatever other limits are broken.
    """

    verified: bool
    energy: float
    duration: float
    worst: dict[str, Worst]
    violations: tuple[str, ...]
    samples: int
    stands: bool

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "verified": self.verified,
            "energy_J": self.energy,
            "duration_s": self.duration,
            "worst": {name: vars(worst).copy() for name, worst in self.worst.items()},
            "violations": list(self.violations),
            "samples": self.samples,
            "stands": self.stands,
        }


def check_motion(
    robot: StandingMechanism, motion: Motion, limits: MotionLimits | None = None, *, step: float = 0.01
) -> MotionCheck:
    """Check a motion against all limits on a dense grid that is refined around the worst instants.

    Args:
        robot: the arm on its support.
        motion: the exact ramp motion, or samples: then the check is of the curve through them.
        limits: default 0.9 for both reserves, the arm's torques, no collision.
        step: first spacing of the grid inside the intervals between events, s.

    Raises:
        InputError: the motion does not fit the arm, step is not positive, or so small that the grid would
            have more than `MOST_INSTANTS`.
    """
    limits = limits or MotionLimits()
    step = positive_number("step", step)
    worst: dict[str, Worst] = _exact_limits(robot, motion)
    instants = motion.end / step + _MIN_POINTS * len(motion.intervals)
    if not instants <= MOST_INSTANTS:
        raise InputError(
            f"step: the motion lasts {motion.end:.4g} s, which would be {instants:.2g} instants at steps of "
            f"{step:.4g} s, more than {MOST_INSTANTS:.0e}; take larger steps, or look for a speed or an "
            "acceleration that is far too small"
        )
    grids = [_Grid(left + INSIDE, right - INSIDE, step) for left, right in motion.intervals]
    grids += [_Grid(t, t, step) for t in (-INSIDE, motion.end + INSIDE)]
    samples, unsolved, standing = 0, [], True
    todo = [grid.times for grid in grids]
    for _ in range(_ROUNDS):
        count = sum(map(len, todo))
        if count == 0:
            break
        samples += count
        found = _evaluate(robot, motion, todo)
        unsolved += found.unsolved
        standing &= found.standing
        for grid, times, columns in zip(grids, todo, found.split(todo), strict=True):
            grid.add(times, columns)
        todo = _refinements(grids)
    values = np.concatenate([grid.values for grid in grids])
    times = np.concatenate([grid.times for grid in grids])
    joints = np.concatenate([grid.joints for grid in grids])
    for column, (name, limit) in enumerate(
        [("GN", limits.GN), ("GT", limits.GT), ("torque_ratio", limits.torque_ratio)]
    ):
        at = int(np.argmax(values[:, column]))
        detail = f"joint {joints[at] + 1}" if name == "torque_ratio" else ""
        worst[name] = Worst(float(values[at, column]), float(times[at]), limit, detail)
    at = int(np.argmax(values[:, 3]))
    worst["clearance_m"] = Worst(float(-values[at, 3]), float(times[at]), limits.clearance)
    violations = _violations(worst)
    for name, (found_worst, sentence) in _further_worst(robot, values[:, 4:], times).items():
        worst[name] = found_worst
        violations += [sentence] if sentence else []
    if unsolved:
        violations.append(
            f"no verified contact state at {len(unsolved)} instants, first at {unsolved[0]:.4f} s"
        )
    elif not standing:
        violations.append("a contact slips or lifts off")
    return MotionCheck(
        verified=not violations,
        energy=robot.energy(motion),
        duration=motion.end,
        worst=worst,
        violations=tuple(violations),
        samples=samples,
        stands=standing and not unsolved and all(worst[name].value < 1 for name in ("GN", "GT")),
    )


class _Grid:
    """Sampled values of one interval: columns GN, GT, torque ratio, -clearance, excess of further limits."""

    def __init__(self, left: float, right: float, step: float) -> None:
        if right <= left:
            self.times = np.array([0.5 * (left + right)])
        else:
            points = max(_MIN_POINTS, int(np.ceil((right - left) / step)) + 1)
            self.times = np.linspace(left, right, points)
        self.values = np.empty((0, 0))
        self.joints = np.empty(0, dtype=int)

    def add(self, times: np.ndarray, columns: tuple[np.ndarray, np.ndarray]) -> None:
        """Put new values among the old ones, sorted by time."""
        values, joints = columns
        if len(self.values):
            times = np.concatenate([self.times, times])
            values, joints = np.vstack([self.values, values]), np.concatenate([self.joints, joints])
        order = np.argsort(times, kind="stable")
        self.times, self.values, self.joints = times[order], values[order], joints[order]


@dataclass
class _Found:
    values: np.ndarray
    joints: np.ndarray
    unsolved: list[float]
    standing: bool

    def split(self, todo: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
        ends = np.cumsum([len(times) for times in todo])[:-1]
        return list(zip(np.split(self.values, ends), np.split(self.joints, ends), strict=True))


def _evaluate(robot: StandingMechanism, motion: Motion, todo: list[np.ndarray]) -> _Found:
    """Values at the listed instants of all grids."""
    times = np.concatenate(todo)
    samples = robot.samples(motion, times)
    values, joints = _quantities(robot, samples)
    values[np.isnan(values)] = np.inf
    certain = samples.states.solved & samples.slip.solved
    return _Found(values, joints, times[~certain].tolist(), bool(np.all(samples.states.persistent)))


def _quantities(robot: StandingMechanism, samples: MotionSamples) -> tuple[np.ndarray, np.ndarray]:
    ratios = np.abs(samples.torques) / robot.limits.torque
    columns = [samples.tip.GN, samples.slip.GT, np.max(ratios, axis=1), -samples.clearances]
    excess = robot.further_limits.excess(samples.further) if robot.further_limits.count else samples.further
    return np.column_stack([*columns, excess]), np.argmax(ratios, axis=1)


def _refinements(grids: list[_Grid]) -> list[np.ndarray]:
    """New instants around the largest local maxima of each quantity, where neighbours still differ."""
    new: list[list[np.ndarray]] = [[] for _ in grids]
    for column in range(grids[0].values.shape[1]):
        peaks = []
        for g, grid in enumerate(grids):
            v = grid.values[:, column]
            padded = np.concatenate([[-np.inf], v, [-np.inf]])
            for i in np.flatnonzero((v >= padded[:-2]) & (v >= padded[2:])):
                if np.isfinite(v[i]):
                    peaks.append((v[i], g, i))
        peaks.sort(key=lambda peak: -peak[0])
        for value, g, i in peaks[:_NEAREST]:
            grid = grids[g]
            lo, hi = max(i - 1, 0), min(i + 1, len(grid.times) - 1)
            spread = value - min(grid.values[lo, column], grid.values[hi, column])
            wide = grid.times[hi] - grid.times[lo] > 1e-7
            if wide and spread > _RELATIVE_TOLERANCE * max(1.0, abs(value)):
                new[g].append(np.linspace(grid.times[lo], grid.times[hi], _FRESH + 2)[1:-1])
    return [
        np.setdiff1d(np.concatenate(parts), grid.times) if parts else np.empty(0)
        for grid, parts in zip(grids, new, strict=True)
    ]


def _exact_limits(robot: StandingMechanism, motion: Motion) -> dict[str, Worst]:
    """Speed, acceleration and angle limits of the motion, exactly."""
    limits = robot.limits
    robot.require_fit(motion.n)
    speed = motion.speed_peaks / limits.speed
    acceleration = motion.acceleration_peaks / limits.acceleration
    low, high = motion.angle_ranges.T
    margin = np.minimum(low - limits.angle_min, limits.angle_max - high)
    worst = {}
    for name, ratio in (("speed_ratio", speed), ("acceleration_ratio", acceleration)):
        j = int(np.argmax(ratio))
        worst[name] = Worst(float(ratio[j]), float("nan"), 1.0, f"joint {j + 1}")
    angles = set(robot.units) == {"rad"}
    margin = np.rad2deg(margin) if angles else margin
    j = int(np.argmin(margin))
    name = "angle_margin_deg" if angles else "coordinate_margin"
    worst[name] = Worst(float(margin[j]), float("nan"), 0.0, f"joint {j + 1}")
    return worst


def _further_worst(
    robot: StandingMechanism, excess: np.ndarray, times: np.ndarray
) -> dict[str, tuple[Worst, str]]:
    """Worst of each further quantity, from its excess (N, k) over the limits, and its violation if any."""
    limits, found = robot.further_limits, {}
    for name in dict.fromkeys(limits.names):
        columns = [k for k in range(limits.count) if limits.names[k] == name and limits.limited[k]]
        if not columns:
            continue
        at, column = np.unravel_index(np.argmax(excess[:, columns]), (len(times), len(columns)))
        k = columns[column]
        value, limit, least = limits.described(k, float(excess[at, k]))
        sentence = ""
        if not excess[at, k] <= _ANGLE_TOLERANCE:
            sentence = f"{name} is {value:.4g} at {times[at]:.4f} s ({limits.details[k]}), must be "
            sentence += f"{'>=' if least else '<='} {limit:.4g}"
        found[name] = Worst(value, float(times[at]), limit, limits.details[k]), sentence
    return found


def _violations(worst: dict[str, Worst]) -> list[str]:
    found = []
    for name, w in worst.items():
        smallest = name in ("clearance_m", "angle_margin_deg", "coordinate_margin")
        excess = (w.limit - w.value) if smallest else (w.value - w.limit)
        if not excess <= _ANGLE_TOLERANCE:
            where = f" at {w.time:.4f} s" if np.isfinite(w.time) else ""
            what = f" ({w.detail})" if w.detail else ""
            found.append(
                f"{name} is {w.value:.4g}{where}{what}, must be {'>=' if smallest else '<='} {w.limit:.4g}"
            )
    return found
