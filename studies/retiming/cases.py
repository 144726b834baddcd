"""What the form of ramps costs: the plans of the cases A to H, timed anew on their own path.

The paths are those of the ramps as they are; free is the law of time along them. Energies are those of the
measured drives, for which a timing is a local optimum.

    python -m studies.retiming.cases --out results

Reads results/plans, writes OUT/retiming_cases.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.motion.check import check_motion
from ocptip.motion.objective import ENERGY
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import experiment_task
from ocptip.retiming.retime import retime
from ocptip.trajectories.path_fit import path_of_motion
from ocptip.trajectories.read import load_motion
from studies.common import RESULTS, ended, number, progress, software, table

HEAD = ("case", "ramps: J", "s", "cheapest: J", "s", "less energy, %", "fastest: s", "keeps all limits")


def row_of(case: str) -> tuple[str, ...]:
    """One line of the table."""
    task = experiment_task(case, "effective")
    robot, limits = task.robot, replace(task.limits, max_duration=np.inf)
    plan = load_motion(RESULTS / "plans" / f"{case}-effective" / "plan.json", robot.names, robot.units)
    ramps, path = check_motion(robot, plan, limits), path_of_motion(plan).path
    cheap, fast = retime(robot, path, limits, ENERGY), retime(robot, path, limits)
    values = (
        number(ramps.energy, 2), number(ramps.duration, 4), number(cheap.check.energy, 2),
        number(cheap.motion.end, 4), number(100 * (1 - cheap.check.energy / ramps.energy), 2),
        number(fast.motion.end, 4),
    )  # fmt: skip
    return case, *values, "yes" if cheap.verified and fast.verified else "NO"


def study(options: argparse.Namespace) -> str:
    """Time all, write, and say where."""
    rows = []
    for k, case in enumerate(motion_cases()):
        progress(k, len(motion_cases()), "cases")
        rows.append(row_of(case))
    text = ["# Plans of the cases on their own path with a free law of time", ""]
    text += [f"Effective base, world as described; {software(versions())}.", "", *table(HEAD, rows)]
    Path(options.out).mkdir(parents=True, exist_ok=True)
    write_text(Path(options.out) / "retiming_cases.md", "\n".join(text) + "\n")
    return f"{Path(options.out) / 'retiming_cases.md'}\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", default=str(RESULTS))
    return ended("retiming_cases", lambda: study(parser.parse_args(arguments)))


if __name__ == "__main__":
    sys.exit(main())
