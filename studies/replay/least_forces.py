"""Minimum foot forces of plans, replayed in MuJoCo from their exported models, beside the library's.

Stored nominal plans of six cases with the effective and two with the printed base, which are ramps, and
plans of the same tasks within `workshop`, made here, which may be S-curves. Rigid feet, three of them, so
that normal forces are unique; rests and steps with an event are left out. One newton rms is the aim.

    python -m studies.replay.least_forces [--out results] [--only A-effective ...] [--starts 2]

Goes on: finished rows are kept.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.write import versions, write_text
from ocptip.certificate.checks import certified
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask
from ocptip.published.tasks import experiment_task
from ocptip.standing.parts import Part
from ocptip.standing.simulation.replay import Simulator, compared
from ocptip.standing.tolerance import WORKSHOP
from ocptip.trajectories.trajectory import Trajectory
from studies.common import (
    PLANNING,
    RESULTS,
    RowFile,
    ended,
    number,
    say,
    software,
    source_state,
    state_notes,
    table,
)

PLANS = (*(f"{case}-effective" for case in "ABDEGH"), "A-printed", "D-printed")
KINDS = ("nominal", "workshop")


def motion_of(name: str, kind: str, starts: int) -> tuple[MotionTask, Trajectory]:
    """Task and motion; InputError or PlanningError where there is no plan within the tolerance."""
    task = experiment_task(*name.split("-"))
    if kind == "nominal":
        data = json.loads((RESULTS / "plans" / name / "plan.json").read_text())
        return task, Trajectory.from_dict(data)
    task = replace(task, limits=replace(task.limits, tolerance=WORKSHOP))
    return task, plan_motion(task, starts=starts, jobs=1, prove=certified).motion


def row_of(name: str, kind: str, starts: int) -> dict[str, Any]:
    """What a replay says beside the library; `refused` where there is no plan."""
    row: dict[str, Any] = {"plan": name, "kind": kind}
    try:
        task, motion = motion_of(name, kind, starts)
    except (InputError, PlanningError) as error:
        return row | {"refused": f"{error}"}
    parts = (Part(task.robot, motion),)
    replay = Simulator(parts).run()
    beside = compared(parts, replay)
    assert beside is not None  # three feet
    inside = (replay.times > 0) & (replay.times < replay.end) & replay.quiet
    return row | {
        "rise_time_s": max(motion.rise_times, default=0.0),
        "duration_s": motion.end,
        "least_N": float(beside.least.min()),
        "simulated_N": float(replay.forces[inside].min()),
        "rms_least_N": beside.rms_least,
        "rms_N": beside.rms,
        "lift_m": replay.lift,
        "slide_m": replay.slide,
        "stands": bool(replay.stands and beside.stands),
    }


def markdown(rows: Sequence[dict[str, Any]], notes: Sequence[str]) -> str:
    """A row per plan, and the largest difference."""
    lines = [
        [
            row["plan"],
            row["kind"],
            f"S-curves, {1e3 * row['rise_time_s']:.0f} ms" if row["rise_time_s"] else "ramps",
            *(number(row[key], 3) for key in ("least_N", "simulated_N", "rms_least_N", "rms_N")),
            number(1e3 * row["lift_m"], 2),
            number(1e3 * row["slide_m"], 2),
            "yes" if row["stands"] else "no",
        ]
        for row in rows
        if "refused" not in row
    ]
    head = ("plan", "within", "form", "least force [N]", "in MuJoCo [N]", "rms of the least [N]")
    head += ("rms of all [N]", "lift [mm]", "slide [mm]", "stands")
    text = ["# Minimum foot forces in MuJoCo", "", *notes, "", *table(head, lines, left=3), ""]
    seen = [row for row in rows if "refused" not in row]
    if seen:
        most = max(row["rms_least_N"] for row in seen)
        text.append(f"- At most {most:.2f} N rms between the minimum foot forces of {len(seen)} plans.")
    text += [
        f"- {row['plan']}, {row['kind']}: no plan ({row['refused']})" for row in rows if "refused" in row
    ]
    return "\n".join(text) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Run the study; prints its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULTS, help="where results go")
    parser.add_argument("--only", nargs="+", choices=PLANS, default=PLANS, help="some of the plans")
    parser.add_argument("--starts", type=int, default=2, help="of plans within the tolerance")
    options = parser.parse_args(arguments)

    def study() -> str:
        state = source_state(*PLANNING)
        kept = RowFile(options.out / "least_forces.json", {"starts": options.starts}, ("plan", "kind"), state)
        for kind in KINDS:
            for name in options.only:
                if kept.find(plan=name, kind=kind) is None:
                    say(f"{name}, {kind} ...")
                    kept.put(row_of(name, kind, options.starts))
        notes = [f"{software(versions())}; seed 0; workshop: plans of {options.starts} starts."]
        notes += state_notes([row["state"] for row in kept.own], state)
        text = markdown(kept.own, notes)
        write_text(options.out / "least_forces.md", text)
        return text

    return ended("least forces", study, "finished rows are kept.")


if __name__ == "__main__":
    sys.exit(main())
