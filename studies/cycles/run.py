"""Pick, carry, return with arms of other people's packages: fastest and most frugal, without and with load.

    python -m studies.cycles.run --out FOLDER [--packages DIR ...] [--only NAME ...] [--starts 1]

The arms and bases are those of `studies/foreign_arms/arms.toml`. A cycle begins half-way between the start
and goal given there (joint by joint), reaches for the start, carries a payload (none, or the nominal one)
to the goal and returns. Every plan is written as `ocptip plan --controller cubic` does; its trajectory.json
is read back, parted at its standstills and checked with the task of the folder, interpolated as written.
Rows that are there already are kept: an interrupted study goes on. Writes cycles.json and .md, and per plan
a folder with the task and the plan.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, OcptipError
from ocptip.basics.toml import toml_text
from ocptip.basics.write import versions, write_text
from ocptip.certificate.checks import certified
from ocptip.motion.cycles.check import check_cycle, cycle_check, parts_of
from ocptip.motion.files.execution import execute
from ocptip.motion.files.plan_files import run_by, write_plan
from ocptip.motion.files.source import TASK
from ocptip.motion.plan import plan_motion
from ocptip.motion.violations import sentence
from ocptip.task_files.cycle import load_cycle
from ocptip.trajectories.read import load_motion
from studies.common import PLANNING, ended, json_text, machine, number, source_state, table
from studies.foreign_arms import run as foreign

_NAME = "cycles"
_ARMS = Path(foreign.__file__).parent / "arms.toml"
OBJECTIVES = ("energy", "time")
DWELL = 0.3  # s
_HEAD = (
    "arm",
    "payload kg",
    "least",
    "verdict",
    "J",
    "s",
    "GN",
    "GT",
    "torque",
    "clearance m",
    "read back",
    "CPU s",
)


def cycle_text(text: str, arm: Mapping[str, Any], payload: float, objective: str) -> str:
    """The file of a cycle, out of that of a motion from start to goal.

    Args:
        text: of `studies.foreign_arms.run.task_text`, without payload.
        arm: an entry of arms.toml.
        payload: kg that is carried, 0: none.
        objective: "energy" or "time".
    """
    data = tomllib.loads(text)
    keys = [key for key in ("deg", "m") if f"start_{key}" in arm]
    ends = {end: {f"goal_{key}": arm[f"{end}_{key}"] for key in keys} for end in ("start", "goal")}
    motion = {key: value for key, value in data["motion"].items() if not key.startswith(("start", "goal"))}
    for key in keys:
        pair = np.array([arm[f"start_{key}"], arm[f"goal_{key}"]], dtype=float)
        motion[f"start_{key}"] = pair.mean(axis=0).tolist()
    held = {"payload": {"mass": payload, "center_of_mass": [0, 0, 0.05]}} if payload else {}
    segments = [
        {"name": "reach", **ends["start"], "dwell": DWELL},
        {"name": "carry", **held, **ends["goal"], "dwell": DWELL},
        {"name": "return", "goal": "start"},
    ]
    return toml_text({**data, "motion": {**motion, "objective": objective}, "segment": segments})


def row_of(folder: Path, text: str, starts: int) -> dict[str, Any]:
    """Plan the cycle of a file, write it, read its trajectory back and check that."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "task.toml", text)
    began = time.process_time()
    try:
        task = load_cycle(folder / "task.toml")
        plan = plan_motion(task, starts=starts, jobs=1, prove=certified)
    except OcptipError as error:
        verdict = "refused" if isinstance(error, InputError) else "no plan"
        return {"verdict": verdict, "reason": str(error), "cpu_s": time.process_time() - began}
    cpu = time.process_time() - began
    executions = [execute(p.task.robot, p.motion, p.task.limits, "cubic") for p in plan.parts]
    write_plan(folder / "plan", plan, executions=executions)
    again = load_cycle(folder / "plan" / TASK)
    points = load_motion(folder / "plan" / "trajectory.json", again.robot.names, again.robot.units)
    found = check_cycle(again, parts_of(again, points)).whole
    run = cycle_check(task, run_by(plan, executions), [own.check for own in executions])
    worst = run.whole.worst
    off = {name: abs(found.worst[name].value - own.value) for name, own in worst.items()}
    return {
        "verdict": "verified" if run.whole.verified else "no plan",
        "reason": "; ".join(map(sentence, run.whole.violations)),
        "cpu_s": cpu,
        "joints": task.robot.n,
        "energy_J": run.whole.energy,
        "duration_s": run.whole.duration,
        "rest_energy_J": sum(run.rest_energies),
        **{name: worst[name].value for name in ("GN", "GT", "torque_ratio", "clearance_m")},
        "slower": max(own.slower for own in executions),
        "segments_J": [own.energy for own in run.segments],
        "segments_s": [own.duration for own in run.segments],
        "read_back": {
            "verified": found.verified,
            "reason": "; ".join(map(sentence, found.violations)),
            "energy_off": abs(found.energy / run.whole.energy - 1),
            "worst_off": {name: value for name, value in off.items() if np.isfinite(value)},
        },
        "iterations": sum(start.iterations for part in plan.parts for start in part.starts),
    }


def report(data: Mapping[str, Any]) -> str:
    """Results as Markdown."""
    rows = data["rows"]
    good = [row for row in rows if row["verdict"] == "verified"]
    back = [row for row in good if row["read_back"]["verified"]]
    lines = [
        "# Pick, carry, return with arms of other people's packages",
        "",
        f"{len(rows)} cycles of three segments ({', '.join(dict.fromkeys(r['arm'] for r in rows))}), "
        f"{len(good)} planned and verified; of these {len(back)} verified again as written for "
        "controllers that draw cubics: trajectory.json read back and parted at its standstills. "
        f"{data['starts']} starts per segment, one "
        f"process, rests of {DWELL:g} s after reaching and carrying.",
        "",
        *table(_HEAD, map(_cells, rows), left=3),
        "",
    ]
    if back:
        for name in sorted({name for row in back for name in row["read_back"]["worst_off"]}):
            most = max(row["read_back"]["worst_off"].get(name, 0.0) for row in back)
            lines.append(f"- {name}: read back and planned differ by at most {most:.1e}")
        most = max(row["read_back"]["energy_off"] for row in back)
        lines += [f"- energy: by at most {most:.1e} of itself", ""]
    why = [f"- {_title(row)}: {row['reason']}" for row in rows if row.get("reason")]
    why += [
        f"- {_title(row)}, read back: {row['read_back']['reason']}"
        for row in good
        if row["read_back"]["reason"]
    ]
    lines += ["Not verified:", "", *why, ""] if why else []
    if data["not_run"]:
        lines += [f"Not run: {', '.join(data['not_run'])}.", ""]
    lines.append(f"Source {data['source']}, {data['machine']['cores']} cores, shared with other work.")
    return "\n".join(lines) + "\n"


def _title(row: Mapping[str, Any]) -> str:
    return f"{row['arm']}, {row['payload_kg']:g} kg, {row['objective']}"


def _cells(row: Mapping[str, Any]) -> list[str]:
    back = row.get("read_back")
    return [
        row["arm"],
        f"{row['payload_kg']:g}",
        row["objective"],
        row["verdict"],
        number(row.get("energy_J"), 1),
        number(row.get("duration_s"), 2),
        *(number(row.get(name)) for name in ("GN", "GT", "torque_ratio", "clearance_m")),
        "-" if back is None else "verified" if back["verified"] else "NOT verified",
        number(row["cpu_s"], 0),
    ]


def tasks_of(arms: Sequence[Mapping[str, Any]]) -> list[tuple[Mapping[str, Any], float, str]]:
    """Arm, payload and objective of every row."""
    return [(arm, load, own) for arm in arms for load in (0, arm["payload"]) for own in OBJECTIVES]


def study(out: Path, packages: Sequence[Path], only: Sequence[str], starts: int) -> str:
    """All rows that are not there yet; returns the report."""
    arms = tomllib.loads(_ARMS.read_text(encoding="utf-8"))["arm"]
    wanted = tasks_of([a for a in arms if not only or a["name"].startswith(tuple(only))])
    path = out / f"{_NAME}.json"
    kept = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.exists() else []
    rows = {(row["arm"], row["payload_kg"], row["objective"]): row for row in kept}
    data: dict[str, Any] = {"starts": starts, "source": source_state(*PLANNING, "task_files")}
    data |= {"machine": machine(), "versions": versions(), "rows": kept, "not_run": []}
    out.mkdir(parents=True, exist_ok=True)
    for arm, payload, objective in wanted:
        key = (arm["name"], payload, objective)
        if key not in rows:
            name = arm["name"].split(",")[0].replace(" ", "_")
            folder = out / _NAME / f"{name}_{payload:g}_{objective}"
            folder.mkdir(parents=True, exist_ok=True)
            package = foreign.package_folder(arm["package"], packages)
            template = foreign.template_of(arm, package / arm["urdf"], folder)
            places = foreign.places_of(arm, package, folder)
            text = cycle_text(foreign.task_text(arm, template, 0, places), arm, payload, objective)
            found = row_of(folder, text, starts)
            rows[key] = {"arm": arm["name"], "payload_kg": payload, "objective": objective, **found}
            print(f"{_title(rows[key])}: {found['verdict']}", file=sys.stderr, flush=True)
        data["rows"] = [rows[k] for a, p, o in tasks_of(arms) if (k := (a["name"], p, o)) in rows]
        left = [a["name"] for a, p, o in tasks_of(arms) if (a["name"], p, o) not in rows]
        data["not_run"] = [f"{arm} ({left.count(arm)} of 4)" for arm in dict.fromkeys(left)]
        write_text(path, json_text(data) + "\n")
        write_text(out / f"{_NAME}.md", report(data))
    return report(data)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--packages", type=Path, nargs="+", default=[])
    parser.add_argument("--only", nargs="+", default=[], help="arms whose names begin so")
    parser.add_argument("--starts", type=int, default=1)
    options = parser.parse_args(arguments)
    run = (options.out, options.packages, options.only, options.starts)
    return ended(_NAME, lambda: study(*run), "the cycles so far are written.")


if __name__ == "__main__":
    sys.exit(main())
