"""Recordings by MuJoCo with noise: do the intervals of `identify` contain what the simulated machine has?

    python -m studies.recordings.identify --out results [--runs 100]

The machine is the UR5 of the replay study or an arm of the printed cases, bolted down, with links up to 10 %
heavier or lighter than described and dry friction, or with 2 kg in the gripper. It is simulated once; every
run has noise and a clock of its own. Power maps: those of table 6.1, 2,000 samples each, with noise of 1 % of
the range.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats

from ocptip.basics.write import versions, write_text
from ocptip.measured.bodies import identify_bodies
from ocptip.measured.links import all_parameters, identify_links
from ocptip.measured.power_maps import fit_power_map, motors_of
from ocptip.measured.prediction import Predictor
from ocptip.published.arms import load_arm, modular_motors
from ocptip.robots.model import ArmModel
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from studies.common import say, software, table
from studies.recordings.machine import Faults, sampled, simulated
from studies.recordings.run import machine

HELD = Payload(2.0, [0.02, -0.01, 0.05], [0.01, 0.012, 0.008])
SAMPLES, NOISE = 2000, 0.01  # of a map; share of its range
HEAD = ["what", "runs", "numbers", "all inside", "one inside", "least", "worst / sigma", "largest error"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; write the table where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--runs", type=int, default=100)
    options = parser.parse_args(arguments)
    rows = [links("UR5", options.runs), payload("UR5", options.runs), payload("A", options.runs)]
    rows.append(maps(options.runs))
    lines = ["# What identify finds in simulated recordings", "", f"MuJoCo, {software(versions())}"]
    lines += ["", *table(HEAD, rows)]
    lines += ["", "all inside: runs whose 95 % region of all numbers together contains the truth;"]
    lines += ["one inside: share of single 95 % intervals that do, and of the worst number"]
    say("\n".join(lines))
    write_text(options.out / "identification.md", "\n".join(lines) + "\n")
    return 0


def links(name: str, runs: int) -> list[str]:
    """Base parameters and friction of an arm."""
    robot, motion = machine(name)
    arm, friction, faults = wrong(robot)
    seen, predictor, found = simulated(robot, motion, faults), Predictor(robot, motion), []
    for number in range(runs):
        one = identify_links(sampled(seen, faults, np.random.default_rng([1, number])), predictor)
        true = np.concatenate([one.basis.combinations @ all_parameters(arm), friction, np.zeros(robot.n)])
        own = one.estimate.seen
        found.append(
            (
                (one.estimate.values - true)[own],
                one.estimate.covariance[np.ix_(own, own)],
                one.estimate.freedom,
            )
        )
    return [f"arm {name}, torques and sensor", *covered(found), "-"]


def wrong(robot: Robot) -> tuple[ArmModel, np.ndarray, Faults]:
    """The arm as it is, its dry friction (n,), and how it differs from what is described."""
    rng = np.random.default_rng(0)
    factors = 1 + 0.1 * rng.uniform(-1, 1, robot.arm.links)
    friction = 0.05 * robot.limits.torque * rng.uniform(0.2, 1, robot.n)
    masses, inertias = factors * robot.arm.masses, factors[:, None, None] * robot.arm.inertias
    faults = Faults(masses=dict(enumerate(factors)), coulomb=dict(enumerate(friction)))
    return replace(robot.arm, masses=masses, inertias=inertias), friction, faults


def payload(name: str, runs: int) -> list[str]:
    """Mass and centre of mass of what is held."""
    robot, motion = machine(name)
    real = robot.varied(arm=robot.arm.with_payload(HELD))
    seen, predictor, found = simulated(real, motion, Faults()), Predictor(robot, motion), []
    for number in range(runs):
        recording = sampled(seen, Faults(), np.random.default_rng([2, number]))
        bodies = identify_bodies(recording, predictor)
        body = bodies.bodies[0]
        away = np.append(body.mass - HELD.mass, body.center - HELD.center_of_mass)
        found.append((away, body.covariance, bodies.estimate.freedom))
    mass = max(abs(away[0]) for away, _, _ in found) / HELD.mass
    centre = max(np.abs(away[1:]).max() for away, _, _ in found)
    return [f"payload of {name}, sensor", *covered(found), f"{100 * mass:.2g} %, {1e3 * centre:.2g} mm"]


def maps(runs: int) -> list[str]:
    """Largest error of a map of table 6.1 over its range, beyond no sample."""
    limits, worst = load_arm("FP1W2F").limits, []
    for number in range(runs):
        rng, joint = np.random.default_rng([3, number]), number % 6
        ends = limits.torque[joint], limits.speed[joint]
        t, w = (end * rng.uniform(-1, 1, SAMPLES) for end in ends)
        grid = [g.ravel() for g in np.meshgrid(*(0.95 * end * np.linspace(-1, 1, 16) for end in ends))]
        power, true = (_power(joint, *own) for own in ((t, w), grid))
        size = float(np.ptp(true))
        found = motors_of([fit_power_map(t, w, power + NOISE * size * rng.normal(size=SAMPLES))])
        worst.append(np.abs(found.power(grid[0][:, None], grid[1][:, None])[:, 0] - true).max() / size)
    inside = int(np.sum(np.array(worst) < 0.01))
    return ["power maps of table 6.1", str(runs), "12", f"{inside} below 1 %", "-", "-", "-",
            f"{100 * max(worst):.2g} % of the range"]  # fmt: skip


def _power(joint: int, torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
    full = np.zeros((2, len(torque), 6))
    full[0, :, joint], full[1, :, joint] = torque, speed
    return modular_motors().power(full[0], full[1])[:, joint]


def covered(found: Sequence[tuple[np.ndarray, np.ndarray, int]]) -> list[str]:
    """Cells of the table: runs, numbers, how often together and alone, worst number, worst error."""
    together, alone, sizes = 0, [], []
    for away, covariance, freedom in found:
        k, errors = len(away), np.sqrt(np.diag(covariance))
        square = float(away @ np.linalg.solve(covariance, away))
        together += square < k * stats.f.isf(0.05, k, freedom)
        alone.append(np.abs(away) < stats.t.isf(0.025, freedom) * errors)
        sizes.append(np.abs(away / errors).max())
    per = np.mean(alone, axis=0)
    return [
        str(len(found)), str(len(found[0][0])), f"{together} of {len(found)}",
        f"{100 * np.mean(alone):.1f} %", f"{100 * per.min():.0f} %", f"{max(sizes):.1f}",
    ]  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
