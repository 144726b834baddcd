"""Where classical measures of tip-over stability err: against the contact solver, and against pushes.

    python -m studies.classical.run --out DIR

States of the example `ur5_cart` are random within the joint limits. The carts of the comparison with
pushes are random boxes on four wheels, with a random load at their centre of mass.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy import stats

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.reserves.classical import ClassicalMeasures
from ocptip.reserves.tipping import TipOver
from ocptip.standing.arm import Robot
from ocptip.task_files.motion import load_task
from studies.common import EXAMPLES, source_state, table

STATES, CARTS, SEED = 4000, 4000, 0
FRICTIONS = (3.0, 0.6, 0.3)
SPEED, ACCELERATION = 0.5, 1.0  # shares of the limits
MASS = 30.0  # kg: so light that the base tips in some states


def random_states(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, speeds and accelerations (N, n)."""
    limits, shape = robot.limits, (STATES, robot.n)
    q = rng.uniform(np.maximum(limits.angle_min, -np.pi), np.minimum(limits.angle_max, np.pi), shape)
    qd = rng.uniform(-SPEED, SPEED, shape) * limits.speed
    return q, qd, rng.uniform(-ACCELERATION, ACCELERATION, shape) * limits.acceleration


def verdicts() -> list[list[str]]:
    """Wrong answers of each measure by friction: says stable though a contact is lost, and conversely."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    states = random_states(task.robot, np.random.default_rng(SEED))
    rows = []
    for friction in FRICTIONS:
        own = task.robot.support
        contacts = [UnilateralContact(position=c.position, friction=friction) for c in own.contacts]
        robot = task.robot.varied(support=own.varied(contacts, mass=MASS))
        margins, moving = robot.margins(*states), robot.classical(*states)
        rest = robot.classical(states[0])
        measures = {
            "centre of mass over the polygon (at rest)": rest.zero_moment_point > 0,
            "zero-moment point": moving.zero_moment_point > 0,
            "force-angle": moving.force_angle > 0,
            "moment-height": moving.moment_height > 0,
            "load transfer below 1": np.max(np.abs(moving.load_transfer), axis=1) < 1 - 1e-9,
            "tipping margin of ocptip": margins.tipping_moment > 0,
            "tipping margin and friction used of ocptip": (margins.tipping_moment > 0) & (margins.GT < 1),
        }
        for name, says in measures.items():
            wrong = np.count_nonzero(says & ~margins.stable), np.count_nonzero(~says & margins.stable)
            share = 100 * np.mean(margins.stable)
            rows.append([f"{friction:g}", f"{share:.1f} %", name, *(f"{count}" for count in wrong)])
    return rows


def pushes() -> list[list[str]]:
    """Rank correlation of measures with the horizontal push at the centre of mass that tips the cart."""
    rng, values = np.random.default_rng(SEED), []
    while len(values) < CARTS:
        half, height = rng.uniform(0.15, 0.5, 2), rng.uniform(0.2, 1.0)
        mass, center = rng.uniform(20, 200), np.append(rng.uniform(-0.5, 0.5, 2) * half, height)
        feet = [
            UnilateralContact(position=[x * half[0], y * half[1], 0], friction=3.0)
            for x in (1, -1)
            for y in (1, -1)
        ]
        inertia = mass / 3 * np.array([half[1] ** 2 + height**2, half[0] ** 2 + height**2, half @ half])
        support = Support(feet, mass=mass, center_of_mass=center, inertia=inertia)
        wrench = support.weight + np.append(rng.normal(size=3) * 0.1, rng.normal(size=3) * 0.05) * 9.81 * mass
        tip_over = TipOver(support)
        measures = ClassicalMeasures.under(wrench[None], tip_over, np.ones((1, 4)))[0]
        assert tip_over.affine_moments is not None
        slope, offset = tip_over.affine_moments
        moment = float(np.min(slope @ wrench + offset))
        if moment > 0:
            push = moment / height  # in the direction of the nearest edge
            named = (moment, measures.zero_moment_point, measures.static_angle, measures.force_angle)
            values.append([push, *named, measures.moment_height])
    names = ("tipping margin (N m)", "zero-moment point", "static angle", "force-angle", "moment-height")
    ranks = [stats.spearmanr(*pair).statistic for pair in _pairs(np.array(values))]
    return [[name, f"{rank:.2f}"] for name, rank in zip(names, ranks, strict=True)]


def _pairs(values: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(values[:, 0], column) for column in values[:, 1:].T]


def main() -> None:
    """Write `classical.md` and `classical.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True, help="folder of the results")
    folder = Path(parser.parse_args().out)
    folder.mkdir(parents=True, exist_ok=True)
    first, second = verdicts(), pushes()
    head = ["friction", "stable", "measure", "says stable, is not", "says not, is stable"]
    lines = [*table(head, first, left=3), "", *table(["measure", "rank correlation with the push"], second)]
    write_text(folder / "classical.md", "\n".join(lines) + "\n")
    data = {"verdicts": first, "pushes": second, "seed": SEED, "states": STATES, "carts": CARTS}
    write_json(folder / "classical.json", {**data, "versions": versions(), "source": source_state()})
    print("\n".join(lines))


if __name__ == "__main__":
    main()
