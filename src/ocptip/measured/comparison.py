"""What a comparison of a recording with its plan says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.measured.base_motion import BaseMotion
from ocptip.measured.signals import Finding


@dataclass(frozen=True, eq=False)
class Compared:
    """One signal beside its prediction, SI.

    Attributes:
        name, kind, index: of the signal.
        measured, predicted: (N,); the prediction is that of the plan, at the common clock.
        lag: s, by which the signal by itself is later than the common clock; nan where it does not move.
        largest: greatest size of measured minus predicted; of loads away from instants at which they jump.
        at: s of the motion, when.
        rms: of the difference, there.
        span: of the prediction.
        noise: standard deviation of the white part of the difference.
        left: rms of what the causes that were found do not explain; nan where that was not looked at.
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
        """Greatest difference over the span of the prediction; nan where that is 0."""
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
        clock_error: half width of its 95 % interval; nan where it was not looked at.
        signals: each beside its prediction.
        gripper: (N,), m, deviation of the gripper point: of a measured one, or by the joint angles; None
            where neither is recorded.
        energy: measured and predicted, J, of the electric power; None where that is not recorded.
        base: how the base moved; None where that is not recorded.
        findings: what is not as described.
        unrecorded: kinds of signals that are not there.
        unknown: columns of the file that are left out.
        unexplained: probability that chance alone leaves so much unexplained, by motion and loads.
        level: probability of any finding where there is nothing to find.
        thinned: every so manieth sample was looked at.
    """

    times: np.ndarray
    clock: float
    clock_error: float
    signals: tuple[Compared, ...]
    gripper: np.ndarray | None
    energy: tuple[float, float] | None
    base: BaseMotion | None
    findings: tuple[Finding, ...]
    unrecorded: tuple[str, ...]
    unknown: tuple[str, ...]
    unexplained: Mapping[str, float]
    level: float
    thinned: int

    @property
    def agrees(self) -> bool:
        """Whether nothing was found."""
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
            "findings": [one.to_dict() for one in self.findings],
            "unrecorded": list(self.unrecorded),
            "unknown_columns": list(self.unknown),
            "chance_of_rest": dict(self.unexplained),
            "level": self.level,
            "samples": len(self.times),
            "every_nth": self.thinned,
        }
