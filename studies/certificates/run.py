"""Certificates of plans: are they found, how near to the sampled worst values, in what time?

    python -m studies.certificates.run --out OUT [--plans results/plans] [--folders DIR ...] [--broken 200]

The best plans of the eight cases on both sets of base data (`--plans`, as `studies.plan_cases.run` writes
them), each as ramps, with accelerations that rise within 20 ms, and as points of a controller; the
committed plans of `studies.replay`, within their tolerances; and every plan below the folders, such as
those of `studies.foreign_arms.run`; cycles segment by segment; with the tolerances that their tasks give.
Each is checked at sampled instants and certified. The loss of a reserve is how far the certified bound is
above the sampled worst value, relative to it. Motions broken on purpose: `broken`. Writes
OUT/certificates.json and .md. Goes on: finished rows are kept.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_text
from ocptip.certificate.find import certify
from ocptip.motion.check import check_motion
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.task import MotionTask
from ocptip.numerics.threads import one_thread
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import BASES, experiment_task
from ocptip.task_files.plan_folder import is_plan_folder, read_plan_folder
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from studies.certificates.broken import BROKEN, broken_on_purpose
from studies.common import (
    RESULTS,
    RowFile,
    commit,
    ended,
    percent,
    progress,
    software,
    source_state,
    state_notes,
    table,
)
from studies.replay.tasks import plan_file, planned, tasks

_NAME = "certificates"
_STATE = (
    "basics",
    "certificate",
    "contact",
    "motion",
    "numerics",
    "reserves",
    "robots",
    "standing",
    "trajectories",
)
_RISE = 0.02  # s
_RESERVES = ("GN", "GT", "torque_ratio", "GN_worst_case", "GT_worst_case")
_LATE = "delayed joints"


def row_of(name: str, kind: str, task: MotionTask, motion: Trajectory) -> dict[str, Any]:
    """What became of one motion."""
    checked = check_motion(task.robot, motion, task.limits)
    began = time.process_time()
    found = certify(task.robot, motion, task.limits, checked.worst)
    seconds, bounds = time.process_time() - began, found.verdict.bounds
    known = [key for key in _RESERVES if key in bounds and checked.worst[key].value > 0]
    return {
        "name": name,
        "kind": kind,
        "verified": checked.verified,
        "certified": found.holds,
        "sampled_only": list(found.sampled),
        "contacts": task.robot.support.n_contacts,
        "pairs": len(task.robot.collision.labels),
        "duration_s": motion.end,
        "intervals": found.verdict.intervals,
        "cpu_s": seconds,
        "worst": {key: checked.worst[key].value for key in _RESERVES if key in checked.worst},
        "bounds": dict(bounds),
        "loss": {key: bounds[key] / checked.worst[key].value - 1 for key in known},
        "missing": found.reason or [str(one) for one in found.undecided[:3]],
    }


def motions(
    plans: Path, replayed: Path, folders: Sequence[Path]
) -> Iterator[tuple[str, str, MotionTask, Trajectory]]:
    """Name, kind, task and motion of everything that is looked at."""
    for base in BASES:
        for case in motion_cases():
            path = plans / f"{case}-{base}" / "plan.json"
            if not path.is_file():
                continue
            task, motion = experiment_task(case, base), load_motion(path)
            yield f"{case} {base}", "ramps", task, motion
            yield f"{case} {base}", "cubic points", task, controller_points(motion, "cubic")
            risen = motion.with_rise_times(_RISE)
            yield f"{case} {base}", "S-curves", task, risen
            yield f"{case} {base}", "quintic points", task, controller_points(risen, "quintic")
    for name in tasks():
        if plan_file(name, replayed).is_file() and not isinstance(answer := planned(name, replayed, 0), str):
            yield name, "replayed", *answer
    for folder in folders:
        found = sorted(path.parent for path in folder.rglob("plan.json") if is_plan_folder(path.parent))
        if not found:
            raise InputError(f"{folder}: no folder of a plan in it")
        for path in found:
            try:
                plan = read_plan_folder(path)
            except InputError as error:
                print(f"left out: {error}", file=sys.stderr)
                continue
            name = f"{folder.name}/{path.relative_to(folder).as_posix()}"
            if isinstance(plan.task, CycleTask):
                for segment, own in zip(plan.task.segments, plan.motion.segments, strict=True):
                    yield f"{name}/{segment.name}", "segment", segment.task, own
            else:
                yield name, "as planned", plan.task, plan.motion


def markdown(rows: Sequence[dict[str, Any]], notes: Sequence[str]) -> str:
    """The results in words and a table."""
    head = (
        *("motion", "kind", "feet", "pairs", "verified", "certified", "GN", "GT", "GN within", "GT within"),
        *("intervals", "CPU s", "missing"),
    )
    verified = [row for row in rows if row["verified"]]
    groups = {
        "the world as described": [row for row in verified if not _within(row)],
        "a tolerance": [row for row in verified if _within(row)],
    }
    said = [_summary(name, group) for name, group in groups.items() if group]
    lines = ["# Certificates of plans", "", *said, *notes, "", *table(head, map(_cells, rows), left=2)]
    return "\n".join(lines) + "\n"


def _within(row: dict[str, Any]) -> bool:
    return "GT_worst_case" in row["worst"]


def _summary(name: str, rows: Sequence[dict[str, Any]]) -> str:
    proved = [row for row in rows if row["certified"]]
    full = [row for row in proved if _LATE not in row["sampled_only"]]
    seconds = [row["cpu_s"] for row in rows]
    losses = {
        key: [row["loss"][key] for row in full if key in row["loss"]] for key in ("GN", "GT", *_RESERVES[3:])
    }
    worst = ", ".join(
        f"{key} {percent(max(own), 3)} (median {percent(statistics.median(own), 3)})"
        for key, own in losses.items()
        if own
    )
    return (
        f"- Within {name}: {len(full)} of {len(rows)} verified motions are certified"
        + (
            f", {len(proved) - len(full)} more but for joints that are late"
            if len(proved) > len(full)
            else ""
        )
        + f"; largest loss of {worst}; CPU time to find and to check one: median "
        f"{statistics.median(seconds):.2f} s, largest {max(seconds):.2f} s, one thread."
    )


def _cells(row: dict[str, Any]) -> list[str]:
    def both(key: str) -> str:
        bound = row["bounds"].get(key)
        if key not in row["worst"]:
            return "-"
        return f"{row['worst'][key]:.5f}" + ("" if bound is None else f" <= {bound:.5f}")

    missing = row["missing"] if isinstance(row["missing"], str) else "; ".join(row["missing"])
    yes = {True: "yes", False: "no"}
    return [
        row["name"],
        row["kind"],
        str(row["contacts"]),
        str(row["pairs"]),
        yes[row["verified"]],
        "on time" if _LATE in row["sampled_only"] else yes[row["certified"]],
        both("GN"),
        both("GT"),
        both("GN_worst_case"),
        both("GT_worst_case"),
        str(row["intervals"]),
        f"{row['cpu_s']:.2f}",
        missing or "-",
    ]


def study(options: argparse.Namespace) -> str:
    """Run it; returns the table."""
    every = list(motions(options.plans, options.replayed, options.folders))
    if not every:
        raise InputError(f"--plans: no plans in {options.plans}, and no --folders")
    options.out.mkdir(parents=True, exist_ok=True)
    file = RowFile(options.out / f"{_NAME}.json", {}, ("name", "kind"), source_state(*_STATE))
    with one_thread:
        for number, (name, kind, task, motion) in enumerate(every):
            progress(number, len(every), f"{name} {kind}")
            if file.find(name=name, kind=kind) is None:
                file.put(row_of(name, kind, task, motion))
        broken = file.find(name=BROKEN, kind=f"{options.broken}")
        if options.broken and broken is None:
            broken = {"name": BROKEN, "kind": f"{options.broken}", **broken_on_purpose(options.broken)}
            file.put(broken)
    progress(len(every), len(every), "done")
    rows = [row for row in file.own if row["name"] != BROKEN]
    notes = [] if broken is None else [f"- {broken['text']}"]
    notes.append(f"- Commit {commit()}, {software(versions())}.")
    notes += state_notes([row["state"] for row in rows], file.state)
    text = markdown(rows, notes)
    write_text(options.out / f"{_NAME}.md", text)
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--plans", type=Path, default=RESULTS / "plans", help="plans of the cases")
    parser.add_argument(
        "--replayed", type=Path, default=RESULTS / "replay_plans", help="plans of studies.replay"
    )
    parser.add_argument("--folders", type=Path, nargs="*", default=[], help="folders of plans of other arms")
    parser.add_argument("--broken", type=int, default=0, help="so many motions broken on purpose")
    options = parser.parse_args(arguments)
    return ended(_NAME, lambda: study(options))


if __name__ == "__main__":
    raise SystemExit(main())
