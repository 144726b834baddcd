"""The eight cases planned with the measured power maps read literally, as maps of the drive torque.

The planner reads the torque of the maps as load torque; read as drive torque, a drive feeds back more than it
draws (see `PowerMaps`). How much less energy than the printed motions the plans need depends on the
reading: ratios found by others may belong to the literal one. Here reference and plan have the same one.

    python -m studies.plan_cases.power_reading --out results [--cases A B] [--starts 8] [--jobs 2]

Every finished case is kept in power_reading.json with the state of the source that made it; start again to go
on. Rows of other --starts and --seed stay there, too.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.basics.write import write_text
from ocptip.certificate.checks import certified
from ocptip.motion.check import check_motion
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask
from ocptip.published.arms import modular_motors
from ocptip.published.cases import case_names
from ocptip.published.tasks import BASES, experiment_task
from studies.common import PLANNING, RowFile, say, source_state, state_notes, table


def task_of(case: str, base: str, reading: str) -> MotionTask:
    """The task of a case with a reading of the power maps."""
    task = experiment_task(case, base)
    return replace(task, robot=task.robot.varied(motors=modular_motors(torque_reading=reading)))


def planned(case: str, base: str, starts: int, seed: int, jobs: int) -> dict:
    """One row: plan with the literal reading, both energies of both motions."""
    literal, usual = (task_of(case, base, reading) for reading in ("drive", "load"))
    row: dict = {"case": case, "base": base}
    for reading, task in (("drive", literal), ("load", usual)):
        row[f"reference_{reading}_J"] = task.robot.energy(task.reference)
    try:
        plan = plan_motion(literal, starts=starts, seed=seed, jobs=jobs, prove=certified)
    except OcptipError as error:
        return row | {"verified": False, "reason": str(error)}
    checked = check_motion(literal.robot, plan.motion, literal.limits)
    row |= {"verified": checked.verified, "duration_s": checked.duration, "plan_drive_J": checked.energy}
    row |= {name: checked.worst[name].value for name in ("GN", "GT", "speed_ratio")}
    row["plan_load_J"] = usual.robot.energy(plan.motion)
    return row | {"ratio": checked.energy / row["reference_drive_J"]}


def markdown(rows: list[dict], notes: list[str]) -> str:
    """Tables by base, and averages."""
    rows = sorted(rows, key=lambda r: r["case"])
    text = "# Plans with the power maps read literally (drive torque)\n"
    for base in BASES:
        own = [r for r in rows if r["base"] == base]
        if not own:
            continue
        names = ("ratio", "duration_s", "GN", "GT")
        cells = []
        for r in own:
            found = ["no plan", *[""] * len(names)]
            if r["verified"]:
                found = [f"{r['plan_drive_J']:.1f}", *(f"{r[name]:.3f}" for name in names)]
            cells.append([r["case"], f"{r['reference_drive_J']:.1f}", *found])
        head = ["case", "reference [J]", "ours [J]", "ratio", "duration [s]", "GN", "GT"]
        text += "\n".join([f"\n## {base} base\n", *table(head, cells)]) + "\n"
        ratios = [r["ratio"] for r in own if r["verified"]]
        if ratios:
            text += (
                f"\nAverage ratio of {len(ratios)} cases {np.mean(ratios):.3f}, largest {max(ratios):.3f}.\n"
            )
    return text + ("\n" + "\n".join(notes) + "\n" if notes else "")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cases", nargs="+", choices=case_names(), default=case_names())
    parser.add_argument("--bases", nargs="+", choices=list(BASES), default=list(BASES))
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args(arguments)
    if options.starts < 1 or options.jobs < 1:
        parser.error("--starts and --jobs must be at least 1")
    options.out.mkdir(parents=True, exist_ok=True)
    state = source_state(*PLANNING)
    asked = {"starts": options.starts, "seed": options.seed}
    kept = RowFile(options.out / "power_reading.json", asked, ("base", "case"), state)
    for base, case in [(base, case) for base in options.bases for case in options.cases]:
        if kept.find(base=base, case=case) is None:
            say(f"{base} {case} ...")
            kept.put(planned(case, base, options.starts, options.seed, options.jobs))
    rows = kept.own
    text = markdown(rows, state_notes([row.get("state") for row in rows], state))
    write_text(options.out / "power_reading.md", text)
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
