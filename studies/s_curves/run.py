"""Jumps or none: what motions cost that carry the overshoot of their jumps, or have none, and what feet feel.

The eight cases (effective base) and an arm on a cart are planned

- as ramps, whose jumps nobody looks at (`ramps`);
- as ramps that carry the overshoot of every single jump at 5 % damping (`carried`);
- as S-curves with some rise times (`S 50 ms`).

Each plan is then run on feet of 1e5, 1e6 and 1e7 N/m with 5 % damping (`ocptip.standing.elastic.feet`): least
normal force of any foot, and by how much feet lift. Bases with clamps have no such feet.

    python -m studies.s_curves.run --out results [--cases A B cart] [--starts 4] [--seed 0] [--limit SECONDS]

Goes on: what is finished is kept in OUT/s_curves.json. With --limit no further plan is begun after so long.
Writes OUT/s_curves.json and .md; plans that have not been made are dashes there.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.write import versions, write_text
from ocptip.certificate.checks import certified
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.feet import on_its_feet
from ocptip.standing.mechanism import StandingMechanism
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from studies.common import (
    EXAMPLES,
    PLANNING,
    RESULTS,
    RowFile,
    ended,
    number,
    progress,
    software,
    source_state,
    state_notes,
    table,
)

CART = "cart"
DAMPING = 0.05
STIFFNESSES = (1e5, 1e6, 1e7)  # N/m
RISES = (0.02, 0.05, 0.1)  # s
VARIANTS = ("ramps", "carried", *(f"S {1e3 * rise:.0f} ms" for rise in RISES))


def task_of(case: str, variant: str) -> MotionTask:
    """The task of a case, or of the arm on a cart, in a variant."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml") if case == CART else experiment_task(case)
    if variant == "carried":
        task = replace(task, limits=replace(task.limits, damping=DAMPING))
    rises = dict(zip(VARIANTS[2:], RISES, strict=True))
    return replace(task, rise_times=rises.get(variant, 0.0))


def on_feet(robot: StandingMechanism, stiffness: float) -> StandingMechanism | None:
    """The same robot on compliant feet; None if it stands on other contacts, too."""
    own = robot.support
    if not all(isinstance(contact, UnilateralContact) for contact in own.contacts):
        return None
    feet = [replace(c, stiffness=stiffness, damping_ratio=DAMPING) for c in own.contacts]
    parts = {"mass": own.mass, "center_of_mass": own.center_of_mass, "gravity": own.gravity}
    return robot.varied(support=Support(feet, inertia=own.inertia, **parts))


def feet_of(robot: StandingMechanism, motion: Trajectory) -> list[dict]:
    """Minimum normal force and lift on all stiffnesses, as far as they are known."""
    found = []
    for stiffness in STIFFNESSES:
        soft = on_feet(robot, stiffness)
        felt = on_its_feet(soft, motion) if soft else None
        if felt:
            least = min(margin.value for margin in felt.least)
            lift = None if felt.falls else 1e3 * felt.lift
            found.append({"stiffness": stiffness, "force_N": least, "lift_mm": lift, "falls": felt.falls})
    return found


def row_of(case: str, variant: str, starts: int, seed: int) -> dict:
    """A plan and what its feet feel."""
    task, began = task_of(case, variant), time.process_time()
    if not isinstance(task.robot, Robot):
        raise InputError(f"{case}: is no arm")
    row = {"case": case, "variant": variant}
    try:
        plan = plan_motion(task, starts=starts, seed=seed, jobs=1, prove=certified)
    except PlanningError as error:
        return {**row, "energy_J": None, "status": f"{error}"}
    jumps = replace(task.limits, damping=DAMPING)
    worst = check_motion(task.robot, plan.motion, jumps).worst
    return {
        **row,
        "energy_J": plan.energy,
        "duration_s": plan.duration,
        "verified": sum(start.verified for start in plan.starts),
        "iterations": sum(start.iterations for start in plan.starts),
        "cpu_s": time.process_time() - began,
        **{name: worst[name].value for name in ("GN", "GT", "jump_GN", "jump_GT")},
        "feet": feet_of(plan.task.robot, plan.motion),
        **plan.motion.to_dict(plan.task.robot.units),
    }


def markdown(rows: Sequence[dict], options: dict, state: str) -> str:
    """Tables of price and of feet."""
    by = {(row["case"], row["variant"]): row for row in rows}
    cases = [case for case in (*motion_cases(), CART) if any(key[0] == case for key in by)]
    lines = ["# Jumps, their overshoot, and S-curves", ""]
    lines += [
        f"Energy in J, duration in s and, in brackets, energy relative to ramps; best of {options['starts']} "
        f"starts, seed {options['seed']}, effective base; `python -m studies.s_curves.run`. "
        "`ramps`: jumps do not count; "
        f"`carried`: every jump with its overshoot at {100 * DAMPING:g} % damping is carried "
        "(GN, GT at most 1); "
        "`S`: S-curves with this rise time, jumps do not count as there are none. A dash: not run.",
        "",
    ]

    def price(case: str, variant: str) -> str:
        row, plain = by.get((case, variant)), by.get((case, "ramps"))
        if row is None:
            return "-"
        if row["energy_J"] is None:
            return "no plan"
        ratio = f" ({row['energy_J'] / plain['energy_J']:.3f})" if plain and plain["energy_J"] else ""
        return f"{row['energy_J']:.1f}, {row['duration_s']:.3f}{ratio}"

    lines += table(["case", *VARIANTS], [[case, *(price(case, v) for v in VARIANTS)] for case in cases])
    lines += ["", "Median of energy and duration relative to ramps, over the cases that have both:", ""]
    medians = []
    for variant in VARIANTS[1:]:
        pairs = [(by[c, variant], by[c, "ramps"]) for c in cases if (c, variant) in by and (c, "ramps") in by]
        pairs = [pair for pair in pairs if None not in (pair[0]["energy_J"], pair[1]["energy_J"])]
        keys = ("energy_J", "duration_s", "cpu_s")
        ratios = [np.median([a[key] / b[key] for a, b in pairs]) if pairs else None for key in keys]
        medians.append([variant, f"{len(pairs)}", *(number(ratio) for ratio in ratios)])
    lines += table(["variant", "cases", "energy", "duration", "CPU time of planning"], medians)
    lines += [
        "",
        "GN of the loads at jumps with their overshoot (1: a contact is lost; S-curves have none):",
        "",
    ]
    lines += table(
        ["case", "ramps", "carried"],
        [
            [case, *(number((by.get((case, v)) or {}).get("jump_GN"), 2) for v in VARIANTS[:2])]
            for case in cases
        ],
    )
    lines += [
        "",
        f"Minimum normal force of any foot, N, on compliant feet, {100 * DAMPING:g} % damping; lift in mm:",
        "",
    ]
    for stiffness in STIFFNESSES:
        cells = [[case, *(_feet(by.get((case, v)), stiffness) for v in VARIANTS)] for case in cases]
        lines += [f"{stiffness:.0e} N/m", "", *table(["case", *VARIANTS], cells), ""]
    lines += [f"- {software(versions())}", *state_notes([row.get("state") for row in rows], state)]
    return "\n".join(lines) + "\n"


def _feet(row: dict | None, stiffness: float) -> str:
    felt = next((one for one in (row or {}).get("feet", []) if one["stiffness"] == stiffness), None)
    if felt is None:
        return "-"
    if felt["falls"]:
        return "falls"
    return f"{felt['force_N']:.1f}" + (f", lifts {felt['lift_mm']:.2g}" if felt["lift_mm"] else "")


def run(out: Path, cases: Sequence[str], starts: int, seed: int, limit: float | None) -> str:
    """Plan what is missing, write and return the tables."""
    out.mkdir(parents=True, exist_ok=True)
    state, options = source_state(*PLANNING), {"starts": starts, "seed": seed}
    kept = RowFile(out / "s_curves.json", options, ("case", "variant"), state)
    todo = [(case, variant) for case in cases for variant in VARIANTS]
    began = time.monotonic()
    for done, (case, variant) in enumerate(todo):
        progress(done, len(todo), f"{case}, {variant}")
        late = limit is not None and time.monotonic() - began > limit
        if not late and kept.find(case=case, variant=variant) is None:
            kept.put(row_of(case, variant, starts, seed))
    progress(len(todo), len(todo), "plans")
    text = markdown(kept.own, options, state)
    write_text(out / "s_curves.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; exit code 0, or 1 with a line on stderr."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    everything = (*motion_cases(), CART)
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--cases", nargs="+", choices=everything, default=list(everything))
    parser.add_argument("--starts", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=float, default=None, help="s: no plan is begun later")
    options = parser.parse_args(argv)
    values = options.cases, options.starts, options.seed, options.limit
    return ended("s_curves", lambda: run(options.out, *values), "finished plans are kept.")


if __name__ == "__main__":
    sys.exit(main())
