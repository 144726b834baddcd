"""Attacks on what certificates claim: are there worlds inside a tolerance that are worse than proved?

    python -m studies.certificates.attack --out OUT [--worlds 100000] [--seed 0]

Swings of the eight cases within `workshop` are certified. Then worlds are drawn at random: every
joint by itself late, or overshooting the sum of its last steps where it jumps; all masses, centres, tilt,
pushes and pace at ends of their intervals or where a moment or the slip grows fastest, by the exact contact
solver. From the worst ones instants and delays are moved on, as long as that makes it worse. The certificate
must claim no less. Besides: functionals of the wrench of random arms against ball arithmetic, and changed
certificates (`tests/certificate/test_within_in_balls.py`, `test_mutations.py`). Writes
OUT/certificates_attacked.md.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.certificate.find import certify
from ocptip.motion.check import check_motion
from ocptip.published.tasks import BASES, experiment_task
from ocptip.standing.limits import MotionLimits
from ocptip.standing.tolerance import WORKSHOP, Tolerance
from ocptip.standing.worst_case import worst_case_of
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.ramps import RampCommand
from studies.common import RESULTS, machine, progress, software, source_state, table
from tests.certificate.test_mutations import broken
from tests.certificate.test_within_in_balls import check_random_arms
from tests.oracles.world_in_balls import LateJoints

_NAME = "certificates_attacked"
_STATE = ("certificate", "contact", "motion", "reserves", "robots", "standing", "trajectories")
_ROUNDS, _KEPT = 30, 200
_NO_DELAY = {"delay": 0.0, "damping": None}
_HEAD = ("case", "base", "claim", "GN found", "GN proved", "GT found", "GT proved")

Badness = Callable[[np.ndarray], np.ndarray]


def swing(case: str, base: str) -> tuple[Any, ArmMotion]:
    """A robot, and a swing of its joints by two fifths of the way of its task."""
    task = experiment_task(case, base)
    commands = [
        [RampCommand(a + 0.4 * w, 0.25 * v, 0.8)]
        for a, w, v in zip(task.start, task.goal - task.start, task.robot.limits.speed, strict=True)
    ]
    return task, ArmMotion.from_commands(task.start, commands)


def attack(
    task: Any, motion: ArmMotion, tolerance: Tolerance, data: Mapping[str, Any], worlds: int, seed: int
) -> tuple[float, float]:
    """Greatest GN and GT that are found in worlds with late joints."""
    rng, late = np.random.default_rng(seed), LateJoints(data["motion"], data["tolerance"])
    cases = worst_case_of(task.robot, replace(tolerance, **_NO_DELAY))
    drawn = [late.draw(float(rng.uniform(0, late.end)), rng) for _ in range(worlds)]

    def tipping(states: np.ndarray) -> np.ndarray:
        if not cases.axes:
            return np.zeros(len(states))
        return np.max(cases.tip_ratio(cases.all_moments(states)), axis=1)

    def slipping(states: np.ndarray) -> np.ndarray:
        return cases.slip(states, 2).values

    return _climbed(late, drawn, tipping, tipping, rng), _climbed(
        late, drawn, cases.estimated_slip, slipping, rng
    )


def _climbed(
    late: LateJoints, drawn: Sequence[Any], first: Any, exact: Any, rng: np.random.Generator
) -> float:
    states = np.array([late.state(choice).ravel() for choice in drawn])
    values = np.concatenate([first(part) for part in np.array_split(states, max(1, len(states) // 5000))])
    best = [drawn[k] for k in np.argsort(-values)[:_KEPT]]
    found = exact(np.array([late.state(choice).ravel() for choice in best]))
    for k in range(_ROUNDS):
        others = [late.moved(choice, 0.8**k, rng) for choice in best]
        new = exact(np.array([late.state(choice).ravel() for choice in others]))
        best = [b if y > x else a for a, b, x, y in zip(best, others, found, new, strict=True)]
        found = np.maximum(found, new)
    return float(np.max(found))


def _rows(worlds: int, seed: int) -> list[list[str]]:
    rows = []
    asked = [(case, base) for case in "ABCDEFGH" for base in BASES]
    for k, (case, base) in enumerate(asked):
        progress(k, len(asked), f"{case} {base}")
        task, motion = swing(case, base)
        limits = MotionLimits(tolerance=WORKSHOP)
        found = certify(task.robot, motion, limits, check_motion(task.robot, motion, limits).worst)
        if found.data is None or not found.holds or found.sampled:
            rows.append([case, base, "none made", *[""] * 4])
            continue
        bounds = found.verdict.bounds
        values = attack(task, motion, WORKSHOP, found.data, worlds, seed)
        proved = bounds["GN_worst_case"], bounds["GT_worst_case"]
        holds = all(value <= bound + 1e-9 for value, bound in zip(values, proved, strict=True))
        numbers = (values[0], proved[0], values[1], proved[1])
        rows.append([case, base, "holds" if holds else "BROKEN", *(f"{x:.5f}" for x in numbers)])
    progress(len(asked), len(asked), "")
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Attack, and write what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--worlds", type=int, default=100_000)
    parser.add_argument("--arms", type=int, default=100)
    parser.add_argument("--changes", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    began = time.process_time()
    nearest = check_random_arms(options.arms, 10, 5, options.seed)
    wrong, accepted = broken(options.changes, options.seed, samples=20)
    rows = _rows(options.worlds, options.seed)
    lines = f"""\
# Certificates attacked

{options.arms} random arms within random tolerances, 10 random intervals and 3 functionals of the wrench each,
5 worlds each in ball arithmetic: none is below what is proved. The nearest is {min(nearest):.2g} of the
functional's size above it, in the median of the arms {np.median(nearest):.2g}.

{options.changes} certificates with one thing changed: {accepted} are accepted, {len(wrong)} of these claim
what is not so.

Swings of the eight cases within `workshop`, {options.worlds} worlds each, of which the {_KEPT} worst were
moved on {_ROUNDS} times:
""".splitlines()
    lines += [*wrong, "", *table(_HEAD, rows, left=3), ""]
    lines.append(f"Seed {options.seed}, {time.process_time() - began:.0f} s of CPU, {machine()}.")
    lines.append(f"{software(versions())}; source {source_state(*_STATE)}.")
    write_text(options.out / f"{_NAME}.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
