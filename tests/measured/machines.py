"""Recordings of a published plan by the library's own formulas, with noise: for what needs no simulator."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from ocptip.measured.prediction import Elasticity, Predictor
from ocptip.measured.recording import Recording, Signal
from ocptip.standing.arm import Robot
from tests.standing.simulation.test_replay import plan_of

NOISE = {"angles": 2e-4, "torques": 0.1, "sensor": 0.1, "power": 2.0, "gripper": 1e-4}
NAMES = {
    "angles": [f"q{k}" for k in range(1, 7)],
    "torques": [f"tau{k}" for k in range(1, 7)],
    "sensor": ["fx", "fy", "fz", "mx", "my", "mz"],
    "power": ["power"],
}


@cache
def predictor() -> Predictor:
    """Of plan A."""
    return Predictor(*plan_of("A-effective"))


def heavier(link: int, factor: float) -> Robot:
    """The robot with another mass of a link, counted from 1."""
    robot = predictor().robot
    factors = np.where(np.arange(robot.arm.links) == link - 1, factor, 1.0)
    arm = robot.arm
    return robot.varied(
        arm=replace(arm, masses=factors * arm.masses, inertias=factors[:, None, None] * arm.inertias)
    )


def recorded(
    seed: int,
    *,
    robot: Robot | None = None,
    delays: dict[int, float] | None = None,
    late: dict[str, float] | None = None,
    elastic: Elasticity | None = None,
    clock: float = 0.1234567,
    nominal: Predictor | None = None,
) -> Recording:
    """At 500 Hz; joints late by their delays, s, kinds of signals by others."""
    nominal = nominal or predictor()
    own = nominal if robot is None else Predictor(robot, nominal.motion)
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, clock + nominal.motion.end + 0.2, 2e-3)
    joints = np.array([(delays or {}).get(j, 0.0) for j in range(6)])
    signals = []
    for kind, names in NAMES.items():
        lag = (late or {}).get(kind, 0.0)
        state = own.state(times - clock - lag, joints, np.zeros(25), elastic)
        for k, name in enumerate(names):
            values = own.signal(kind, k, state) + NOISE[kind] * rng.normal(size=len(times))
            signals.append(Signal(name, kind, k, values))
    return Recording(times, tuple(signals))


def changed(recording: Recording, name: str, values: np.ndarray) -> Recording:
    """With other values of a signal."""
    signals = (replace(s, values=values) if s.name == name else s for s in recording.signals)
    return replace(recording, signals=tuple(signals))


def values_of(recording: Recording, name: str) -> np.ndarray:
    """Of a signal, a copy."""
    return next(s.values for s in recording.signals if s.name == name).copy()
