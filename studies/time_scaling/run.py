"""Planned and printed motions, faster and slower: when is a contact lost, and for how long?

The experiment of the source scales all times of a motion by tau (below 1: faster) and watches the contacts
(7.4). Here the same is computed for the best plans and the printed motions of the eight cases, on both sets
of base data. Then come the source's observations about its own plans (5.9), each computed from motions: how
long they take with large and small triangle, with and without clamp, and whether they raise or lower the arm.

At every tau the exact motion is checked, and once more looked at cell by cell (0.5 ms) for the time in which
a contact is lost. That is the time in which the contacts cannot hold the base at rest; what the base does
once it has left them is not computed. Drives are not limited here; a column tells what they can do.

There is one tau* between standing and losing a contact: at the same point of the path, the load on the base
is that of the arm at rest plus that of its motion over tau^2, and the loads that the contacts can bear form
a convex set. If the base stands with the arm at rest anywhere on the path, it stands at every tau above one
at which it stands. The study checks both.

    python -m studies.time_scaling.run --out results [--plans results/plans] [--cases A B] [--step 0.01]

`--plans DIR`: plans as DIR/A-effective/plan.json, as `studies.plan_cases.run` writes them; missing ones are
left out.
Writes OUT/time_scaling.json, .md and .png.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import atomic_file, plain, versions
from ocptip.published.cases import MotionCase, motion_case, motion_cases
from ocptip.published.tasks import BASES, experiment_robot
from ocptip.trajectories.read import load_motion, motion_origin
from ocptip.trajectories.trajectory import Trajectory
from studies.common import RESULTS, ended, json_text, machine, progress
from studies.time_scaling.losses import CELL, critical, first_loss, rests_anywhere, scaled
from studies.time_scaling.report import FACETS, FASTEST, KINDS, SLOWEST, draw, markdown
from studies.time_scaling.trends import heights, trends

PLANS = RESULTS / "plans"
LIFTING_JOINT = {"W1P1P2W2": 3}  # that raises the arm according to the source; otherwise 2


def row_of(case: MotionCase, base: str, kind: str, motion: Trajectory, taus: Sequence[float]) -> dict:
    """All about one motion: reserves against tau, tau*, first loss, heights."""
    robot = experiment_robot(case, base, facets=FACETS)
    values = {tau: scaled(robot, motion, tau) for tau in taus}
    bracket = critical(values, lambda tau: scaled(robot, motion, tau))
    order = [values[tau].stands for tau in sorted(values)]
    unscaled = values[1.0]
    return {
        "case": case.name,
        "base": base,
        "motion": kind,
        "arm": case.arm,
        "triangle_m": case.triangle_side,
        "clamp": case.clamped,
        "duration_s": motion.end,
        "energy_J": robot.energy(motion),
        "tau_star": bracket[1] if bracket else None,
        "tau_lost": bracket[0] if bracket else None,
        "first_loss": first_loss(robot, motion, values[bracket[0]]) if bracket else None,
        "monotone": order == sorted(order),
        "rests_anywhere": rests_anywhere(robot, motion),
        "tau_drives": max(unscaled.speed_ratio, math.sqrt(unscaled.acceleration_ratio)),
        **heights(robot.arm, motion, LIFTING_JOINT.get(case.arm, 2)),
        "taus": [asdict(values[tau]) for tau in taus],
    }


def read_plan(folder: Path, case: MotionCase, base: str) -> Trajectory | None:
    """The plan of a case on a base, or None if there is none.

    Raises:
        InputError: it cannot be read, or belongs to another case or base.
    """
    path = folder / f"{case.name}-{base}" / "plan.json"
    if not path.exists():
        return None
    try:
        motion, origin = load_motion(path), motion_origin(path)
    except InputError as error:
        raise InputError(f"{path.parent.name}: {error}") from None
    for key, own in (("case", case.name), ("base", base)):
        if origin.get(key, own) != own:
            raise InputError(f"{path}: {key} is {origin[key]}, must be {own}")
    for name in ("start", "goal"):
        angles, own = getattr(motion, name), getattr(case, name)
        if angles.shape != own.shape or not np.allclose(angles, own, atol=1e-4):
            raise InputError(f"{path}: the motion's {name} is not that of case {case.name}")
    return motion


def run(plans: Path, cases: Sequence[str], bases: Sequence[str], step: float) -> dict:
    """All results as plain data.

    Raises:
        InputError: a plan cannot be used.
    """
    steps = round((SLOWEST - FASTEST) / step)
    taus = [round(FASTEST + k * (SLOWEST - FASTEST) / steps, 9) for k in range(steps + 1)]
    todo = []
    for base in bases:
        for case in map(motion_case, cases):
            limits = experiment_robot(case, base, facets=FACETS).arm.limits
            printed = case.reference_motion(limits.speed, limits.acceleration)
            motions = {"ours": read_plan(plans, case, base), "printed": printed}
            todo += [(case, base, kind, motion) for kind, motion in motions.items() if motion]
    rows = []
    for done, (case, base, kind, motion) in enumerate(todo):
        progress(done, len(todo), f"{case.name}, {base} base, {KINDS[kind]}")
        rows.append(row_of(case, base, kind, motion, taus))
    progress(len(todo), len(todo), "motions")
    return plain({
        "versions": versions(),
        "machine": machine(),
        "options": {"cases": list(cases), "bases": list(bases), "step": step, "cell_s": CELL},
        "rows": rows,
        "trends": trends(rows),
    })  # fmt: skip


def write_all(out: Path, data: dict) -> str:
    """Write results, tables and figure; return the tables."""
    text = markdown(data)
    files = {"json": json_text(data).encode(), "md": text.encode(), "png": draw(data)}
    out.mkdir(parents=True, exist_ok=True)
    for suffix, content in files.items():
        with atomic_file(out / f"time_scaling.{suffix}") as stream:
            stream.write(content)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    names = list(motion_cases())
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results, tables and figure")
    parser.add_argument(
        "--plans", type=Path, default=PLANS, help="folder with A-effective/plan.json and so on"
    )
    parser.add_argument("--cases", nargs="+", choices=names, default=names)
    parser.add_argument("--bases", nargs="+", choices=list(BASES), default=list(BASES))
    parser.add_argument("--step", type=float, default=0.01, help="of tau; 0.05 must be a multiple of it")
    given = parser.parse_args(argv)
    if not (0.001 <= given.step <= 0.05 and abs(0.05 / given.step - round(0.05 / given.step)) < 1e-6):
        parser.error(f"--step must be 0.05 divided by a whole number, 0.001 or more, got {given.step:g}")
    if not given.plans.is_dir():
        parser.error(f"--plans: there is no folder {given.plans}")
    cases, bases = ([x for x in known if x in asked] for known, asked in
                    ((names, given.cases), (BASES, given.bases)))  # fmt: skip
    return ended("time_scaling", lambda: write_all(given.out, run(given.plans, cases, bases, given.step)))


if __name__ == "__main__":
    sys.exit(main())
