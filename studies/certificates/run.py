"""Certificates of plans: are they found, how near to the sampled worst values, in what time?

    python -m studies.certificates.run --out OUT [--plans results/plans] [--folders DIR ...]

The best plans of the eight cases on both sets of base data (`--plans`, as `studies.plan_cases.run` writes
them), each as ramps, with accelerations that rise within 20 ms, and as points of a controller; and every plan
below the folders, such as those of `studies.foreign_arms.run`. Each is checked at sampled instants and
certified, twice; the second time is measured. The loss of a reserve is how far the certified bound is above
the sampled worst value, relative to it. Writes OUT/certificates.json and .md.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_text
from ocptip.certificate.find import certify
from ocptip.motion.check import check_motion
from ocptip.motion.task import MotionTask
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import BASES, experiment_task
from ocptip.task_files.plan_folder import is_plan_folder, read_plan_folder
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.sampled import Motion
from studies.common import (
    RESULTS,
    ended,
    json_text,
    machine,
    percent,
    progress,
    software,
    source_state,
    table,
)

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
_RESERVES = ("GN", "GT", "torque_ratio")


def row_of(name: str, kind: str, task: MotionTask, motion: Motion) -> dict[str, Any]:
    """What became of one motion."""
    checked = check_motion(task.robot, motion, task.limits)
    found = [certify(task.robot, motion, task.limits, checked.worst) for _ in range(2)][1]
    bounds = found.verdict.bounds
    losses = {
        key: bounds[key] / checked.worst[key].value - 1
        for key in _RESERVES
        if key in bounds and checked.worst[key].value > 0
    }
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
        "seconds": found.seconds,
        "worst": {key: checked.worst[key].value for key in _RESERVES},
        "bounds": dict(bounds),
        "loss": losses,
        "missing": found.reason or [str(one) for one in found.undecided[:3]],
    }


def motions(plans: Path, folders: Sequence[Path]) -> Iterator[tuple[str, str, MotionTask, Motion]]:
    """Name, kind, task and motion of everything that is looked at."""
    for base in BASES:
        for case in motion_cases():
            path = plans / f"{case}-{base}" / "plan.json"
            if not path.is_file():
                continue
            task, motion = experiment_task(case, base), load_motion(path)
            assert isinstance(motion, ArmMotion)
            yield f"{case} {base}", "ramps", task, motion
            yield f"{case} {base}", "cubic points", task, controller_points(motion, "cubic")
            risen = motion.with_rise_times(_RISE)
            yield f"{case} {base}", "S-curves", task, risen
            yield f"{case} {base}", "quintic points", task, controller_points(risen, "quintic")
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
            yield path.relative_to(folder).as_posix(), "as planned", plan.task, plan.motion


def markdown(rows: Sequence[dict[str, Any]], state: str) -> str:
    """The results in words and a table."""
    verified = [row for row in rows if row["verified"]]
    certified = [row for row in verified if row["certified"]]
    seconds = [row["seconds"] for row in verified] or [0.0]
    worst = max((loss for row in certified for loss in row["loss"].values()), default=0.0)
    head = (
        "motion",
        "kind",
        "feet",
        "pairs",
        "verified",
        "certified",
        "GN",
        "GT",
        "intervals",
        "s",
        "missing",
    )
    lines = [
        "# Certificates of plans",
        "",
        f"{len(certified)} of {len(verified)} verified motions are certified; "
        f"largest loss of GN, GT or torque ratio {percent(worst, 3)}; time to find and to check one: median "
        f"{statistics.median(seconds):.2f} s, largest {max(seconds):.2f} s, one thread. {state}",
        "",
        *table(head, [_cells(row) for row in rows], left=2),
    ]
    return "\n".join(lines) + "\n"


def _cells(row: dict[str, Any]) -> list[str]:
    def both(key: str) -> str:
        bound = row["bounds"].get(key)
        return f"{row['worst'][key]:.5f}" + ("" if bound is None else f" <= {bound:.5f}")

    missing = row["missing"] if isinstance(row["missing"], str) else "; ".join(row["missing"])
    yes = {True: "yes", False: "no"}
    return [
        row["name"],
        row["kind"],
        str(row["contacts"]),
        str(row["pairs"]),
        yes[row["verified"]],
        yes[row["certified"]],
        both("GN"),
        both("GT"),
        str(row["intervals"]),
        f"{row['seconds']:.2f}",
        missing or "-",
    ]


def study(options: argparse.Namespace) -> str:
    """Run it; returns the table."""
    every = list(motions(options.plans, options.folders))
    if not every:
        raise InputError(f"--plans: no plans in {options.plans}, and no --folders")
    rows = []
    with threadpool_limits(1):
        for number, entry in enumerate(every):
            progress(number, len(every), f"{entry[0]} {entry[1]}")
            rows.append(row_of(*entry))
    progress(len(every), len(every), "done")
    state = source_state(*_STATE)
    text = markdown(rows, f"Source {state}; {software(versions())}.")
    options.out.mkdir(parents=True, exist_ok=True)
    data = {"versions": versions(), "machine": machine(), "source": state, "rows": rows}
    write_text(options.out / f"{_NAME}.json", json_text(data))
    write_text(options.out / f"{_NAME}.md", text)
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--plans", type=Path, default=RESULTS / "plans", help="plans of the cases")
    parser.add_argument("--folders", type=Path, nargs="*", default=[], help="folders of plans of other arms")
    options = parser.parse_args(arguments)
    return ended(_NAME, lambda: study(options))


if __name__ == "__main__":
    raise SystemExit(main())
