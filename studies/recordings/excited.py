"""Recordings by MuJoCo of excitation motions and of plans: what does `identify arm` find from either?

    python -m studies.recordings.excited --out results [--runs 20]

The machines are those of `recordings.identify`, links up to 10 % heavier or lighter than described and dry
friction, simulated once for each motion; every run has noise and a clock of its own. Recorded are torques,
with or without a force-torque sensor under the arm. What was identified, and what is not told as it was
described, predicts torques at random states within the joints' limits: their error is that of the whole.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.measured.excitation import SeriesSearch, excite
from ocptip.measured.links import (
    Identified,
    all_parameters,
    friction_columns,
    identify_links,
    random_states,
    torque_columns,
)
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import WRENCH, Recording
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from studies.common import EXAMPLES, say, software, table
from studies.recordings.identify import covered, wrong
from studies.recordings.machine import sampled, simulated
from studies.recordings.run import machine

HEAD = [
    "arm", "recorded", "motion", "s", "condition", "told", "runs", "all inside", "one inside", "least",
    "worst / sigma", "standard error, times that of the excitation", "the same per root of time",
    "error of torques [% of limits]",
]  # fmt: skip
Run = tuple[np.ndarray, Identified, float]
"""Errors of the numbers (K,), what was found, error of torques as a share of their limits, rms."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--only", nargs="+", choices=("A", "UR5"), default=["A", "UR5"])
    options = parser.parse_args(arguments)
    rows, described = [], []
    for name in options.only:
        own, error = of_arm(name, options.runs)
        rows += own
        described.append(f"{name} {100 * error:.2g} %")
    lines = ["# What excitation motions are worth", "", f"MuJoCo, {software(versions())}"]
    lines += ["", *table(HEAD, rows, left=3), ""]
    lines += ["condition: of the regressor of base parameters and friction along the motion, scaled as for"]
    lines += ["`identify motion`;"]
    lines += ["told: of all numbers; standard errors: median over the numbers that both motions tell;"]
    lines += [
        f"error of torques without any recording, links as described without friction: {', '.join(described)}"
    ]
    say("\n".join(lines))
    write_text(options.out / "excitation.md", "\n".join(lines) + "\n")
    return 0


def of_arm(name: str, runs: int) -> tuple[list[list[str]], float]:
    """Rows of the table, and the error of torques as described."""
    robot, plan = machine(name)
    task = (
        experiment_task(name, "effective") if name == "A" else load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    )
    task = replace(task, robot=robot)
    found = excite(task)
    motions: dict[str, Trajectory] = {"plan": plan, "excitation": found.motion}
    all_runs = {what: _runs(robot, motion, runs) for what, motion in motions.items()}
    rows = []
    for sensor in (False, True):
        own = {what: each[sensor] for what, each in all_runs.items()}
        rows += [
            [
                name, "torques and sensor" if sensor else "torques", what, f"{motion.end:.1f}",
                f"{SeriesSearch(task, motion.end).condition(motion):.0f}",
                *_row(own[what]), *_against(own, what, motions),
                f"{100 * np.sqrt(np.mean([error**2 for _, _, error in own[what]])):.2g}",
            ]
            for what, motion in motions.items()
        ]  # fmt: skip
    one = all_runs["plan"][False][0][1]
    true = _true(robot, one)
    return rows, _error_of_torques(robot, one, one_described(one) - true)


def one_described(one: Identified) -> np.ndarray:
    """Numbers before anything is recorded."""
    return np.concatenate([one.described, np.zeros(len(one.estimate.values) - len(one.described))])


def _runs(robot: Robot, motion: Trajectory, runs: int) -> dict[bool, list[Run]]:
    """What is found without and with a sensor."""
    faults, predictor = wrong(robot)[2], Predictor(robot, motion)
    seen, found = simulated(robot, motion, faults), {False: [], True: []}
    for number in range(runs):
        recording = sampled(seen, faults, np.random.default_rng([4, number]))
        torques = [one for one in recording.signals if one.kind != WRENCH]
        for sensor, own in ((False, Recording(recording.times, tuple(torques))), (True, recording)):
            one = identify_links(own, predictor)
            away = one.estimate.values - _true(robot, one)
            found[sensor].append((away, one, _error_of_torques(robot, one, away)))
    return found


def _true(robot: Robot, one: Identified) -> np.ndarray:
    """Numbers of the machine: base parameters, dry friction, no viscous friction."""
    arm, friction, _ = wrong(robot)
    return np.concatenate([one.basis.combinations @ all_parameters(arm), friction, np.zeros(robot.n)])


def _error_of_torques(robot: Robot, one: Identified, away: np.ndarray) -> float:
    """Rms at random states, share of the joints' limits."""
    bare, own = robot.arm.with_payload(None), robot.limits
    q, qd, qdd = random_states(bare)
    qd, qdd = (x / np.abs(x).max() * most for x, most in ((qd, own.speed), (qdd, own.acceleration)))
    links = torque_columns(bare, robot.support.gravity, q, qd, qdd)[:, :, one.basis.independent]
    errors = np.concatenate([links, friction_columns(qd)], axis=2) @ away
    return float(np.sqrt(np.mean((errors / own.torque) ** 2)))


def _row(runs: Sequence[Run]) -> list[str]:
    """Numbers that are told, and whether their intervals hold."""
    found = []
    for away, one, _ in runs:
        own = one.estimate.seen
        found.append((away[own], one.estimate.covariance[np.ix_(own, own)], one.estimate.freedom))
    count, numbers, *others = covered(found)
    return [f"{numbers} of {len(runs[0][0])}", count, *others]


def _against(own: Mapping[str, Sequence[Run]], what: str, motions: Mapping[str, Trajectory]) -> list[str]:
    """Median of the standard errors over those of the excitation, and that in the same time."""
    this, best = (
        np.median([one.estimate.errors for _, one, _ in own[k]], axis=0) for k in (what, "excitation")
    )
    both = np.isfinite(this) & np.isfinite(best)
    ratio = float(np.median(this[both] / best[both]))
    return [f"{ratio:.3g}", f"{ratio * np.sqrt(motions[what].end / motions['excitation'].end):.3g}"]


if __name__ == "__main__":
    sys.exit(main())
