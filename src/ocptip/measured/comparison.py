"""The result of comparing a recording with its plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.measured.base_motion import BaseShift
from ocptip.measured.contact_losses import ContactLoss
from ocptip.measured.prediction import Predictor, State
from ocptip.measured.recording import ANGLE, FOOT, GRIPPER, POWER, Recording, Signal
from ocptip.measured.signals import Finding, noise_of
from ocptip.reserves.equal_compliance import reported_normal_forces


@dataclass(frozen=True, eq=False)
class ComparedSignal:
    """One signal beside its prediction, SI.

    Attributes:
        name, kind, index: of the signal.
        measured, predicted: (N,); the prediction is that of the plan, at the common clock.
        lag: s, by which the signal by itself is later than the common clock; nan where it does not move.
        largest: maximum size of measured minus predicted; of loads away from acceleration steps.
        at: s of the motion, when.
        rms: of the difference, there.
        span: of the prediction.
        noise: standard deviation of the white part of the difference.
        left: rms of what the accepted causes do not explain; nan where that was not checked.
    """

    name: str
    kind: str
    index: int
    measured: np.ndarray
    predicted: np.ndarray
    lag: float
    largest: float
    at: float
    rms: float
    span: float
    noise: float
    left: float

    @property
    def share(self) -> float:
        """Maximum difference over the span of the prediction; nan where that is 0."""
        return self.largest / self.span if self.span else float("nan")

    def to_dict(self) -> dict[str, Any]:
        """Plain data without the curves."""
        names = ("name", "kind", "lag", "largest", "at", "rms", "span", "share", "noise", "left")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, eq=False)
class Comparison:
    """A recording beside the plan that was run.

    Attributes:
        times: (N,), s, of the motion.
        clock: s of the recording, at which the motion begins.
        clock_error: half width of its 95 % interval; nan where it was not checked.
        signals: each beside its prediction.
        gripper: (N,), m, deviation of the TCP: of a measured one, or by the joint angles; None where neither
            is recorded.
        energy: measured and predicted, J, of the electric power; None where that is not recorded.
        base: how the base moved; None where that is not recorded.
        contact_losses: interruptions of contacts with a switch, times of the motion.
        findings: what differs from the description.
        unrecorded: kinds of signals that are not there.
        unknown: columns of the file that are left out.
        unexplained: probability that chance alone leaves as much unexplained, by motion and loads.
        level: probability of any finding where there is nothing to find.
        thinned: n: every n-th sample was evaluated.
    """

    times: np.ndarray
    clock: float
    clock_error: float
    signals: tuple[ComparedSignal, ...]
    gripper: np.ndarray | None
    energy: tuple[float, float] | None
    base: BaseShift | None
    contact_losses: tuple[ContactLoss, ...]
    findings: tuple[Finding, ...]
    unrecorded: tuple[str, ...]
    unknown: tuple[str, ...]
    unexplained: Mapping[str, float]
    level: float
    thinned: int

    @property
    def agrees(self) -> bool:
        """Whether there are no findings."""
        return not self.findings

    def to_dict(self) -> dict[str, Any]:
        """Plain data without the curves."""
        deviation = None if self.gripper is None else float(np.nanmax(self.gripper))
        energy = None
        if self.energy is not None:
            energy = {"measured_J": self.energy[0], "predicted_J": self.energy[1]}
        return {
            "agrees": self.agrees,
            "clock_s": self.clock,
            "clock_interval_s": self.clock_error,
            "signals": [one.to_dict() for one in self.signals],
            "gripper_deviation_m": deviation,
            "energy": energy,
            "base": self.base.to_dict() if self.base else None,
            "contact_losses": [one.to_dict() for one in self.contact_losses],
            "findings": [one.to_dict() for one in self.findings],
            "unrecorded": list(self.unrecorded),
            "unknown_columns": list(self.unknown),
            "chance_of_rest": dict(self.unexplained),
            "level": self.level,
            "samples": len(self.times),
            "every_nth": self.thinned,
        }


def beside(
    one: Signal,
    predicted: np.ndarray,
    times: np.ndarray,
    lag: float,
    still: np.ndarray,
    left: np.ndarray | None,
) -> ComparedSignal:
    """A signal beside its prediction.

    Args:
        one: the signal.
        predicted: (N,), of the plan.
        times: (N,), s, of the motion.
        lag: see `ComparedSignal`.
        still: (N,) True where samples count, unless none does.
        left: (N,), what findings do not explain; None where that was not checked.
    """
    away = one.values - predicted
    good = np.isfinite(away)
    steady = good & still
    good = steady if steady.any() else good
    size = np.where(good, np.abs(away), -1.0)
    value = away if left is None else left
    return ComparedSignal(
        one.name, one.kind, one.index, one.values, predicted, lag,
        float(size.max()) if good.any() else float("nan"), float(times[np.argmax(size)]),
        float(np.sqrt(np.mean(away[good] ** 2))) if good.any() else float("nan"),
        float(np.ptp(predicted)), noise_of(np.nan_to_num(value), steady & np.isfinite(value)),
        float("nan") if left is None else float(np.sqrt(np.nanmean(left**2))),
    )  # fmt: skip


def foot_forces(
    recording: Recording, predictor: Predictor, state: State, times: np.ndarray, still: np.ndarray
) -> list[ComparedSignal]:
    """Recorded normal forces beside those of `motion.csv`: of equally compliant feet where it is open.

    Causes of their differences are not searched: `identify` does so.

    Args:
        recording: with or without such signals.
        predictor: of the plan.
        state: of it, at the samples.
        times, still: see `beside`.

    Raises:
        InputError: a signal of a contact that the robot does not have.
    """
    signals, robot = recording.of(FOOT), predictor.robot
    if not signals:
        return []
    for one in signals:
        if one.index >= robot.support.n_contacts:
            raise InputError(f"recording: {one.name}: the robot has {robot.support.n_contacts} contacts")
    wrenches = robot.loads(state.q, state.qd, state.qdd, robot.acting(times))[1]
    forces = reported_normal_forces(robot.contact_states(wrenches))
    return [beside(one, forces[:, one.index], times, float("nan"), still, None) for one in signals]


def gripper_deviation(recording: Recording, predictor: Predictor, q: np.ndarray) -> np.ndarray | None:
    """(N,), m, of the gripper from where it is at joint values q (N, n); see `Comparison`."""
    measured, angles = recording.of(GRIPPER), recording.of(ANGLE)
    planned = predictor.gripper(q)[0]
    if len(measured) == 3 and np.all([np.isfinite(one.values).any() for one in measured]):
        return np.linalg.norm(np.stack([one.values for one in measured], axis=1) - planned, axis=1)
    if len(angles) < predictor.robot.n:
        return None
    shown = np.stack([one.values for one in angles], axis=1)
    good = np.isfinite(shown).all(axis=1)
    if not good.any():
        return None
    scalars = np.full(len(q), np.nan)
    scalars[good] = np.linalg.norm(predictor.gripper(shown[good])[0] - planned[good], axis=1)
    return scalars


def energies(compared: Sequence[ComparedSignal], times: np.ndarray, end: float) -> tuple[float, float] | None:
    """Measured and predicted, J, of a motion until its end, as far as it was recorded: trapezoidal rule."""
    energy = next((one for one in compared if one.kind == POWER and one.index == 0), None)
    if energy is None:
        return None
    good = np.isfinite(energy.measured) & (times >= 0) & (times <= end)
    both = (energy.measured[good], energy.predicted[good])
    return float(np.trapezoid(both[0], times[good])), float(np.trapezoid(both[1], times[good]))
