"""The fastest timing against a dynamic program over (place, speed) that knows no reachability.

Ten random paths of `studies.retiming.run`. The program takes every pair of speeds at both ends of every
interval that keeps all rows there, backward from rest; then again with as many levels in a band around
its own best speeds, ever narrower, until it settles. It is compared with the passes on the same nodes, and
with what `retime` has before its check with 100, 300 and 1,200 nodes: what the nodes cost.

    python -m studies.retiming.dynamic_program --out results [--paths 10]

Writes OUT/retiming_dynamic_program.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.motion.objective import TIME
from ocptip.retiming.fastest import ExtraRows, Grid, fastest, spaced
from ocptip.retiming.retime import least_cost
from ocptip.retiming.rows import TimingLimits
from ocptip.trajectories.trajectory import Trajectory
from studies.common import RESULTS, ended, number, progress, software, table
from studies.retiming.run import random_path, robots

LEVELS, BAND, NARROWER, ROUNDS = 301, 0.5, 0.5, 8
COARSE, NODES, FINEST = 100, 300, 1200
HEAD = (
    "robot", "path", "program, 300 nodes: s", "passes, same nodes: s", "with rows between: s",
    "1,200 nodes: s", "passes / program - 1, %", "300 / 1,200 - 1, %", "100 / 1,200 - 1, %",
)  # fmt: skip


def program(grid: Grid) -> float:
    """Least duration, s, over pairs of speeds of a list of levels at every node."""
    rows, count = grid.polygons(ExtraRows.none()), len(grid.widths)
    caps = np.full(count + 1, np.inf)
    for i in range(count):
        corners = rows.corners[i, : rows.counts[i]]
        caps[i] = min(caps[i], corners[:, 0].max())
        caps[i + 1] = min(caps[i + 1], corners[:, 1].max())
    low, high, best = np.zeros(count + 1), np.sqrt(np.minimum(caps, grid.bounds[:, 1])), np.inf
    most, width = high, BAND
    for _ in range(ROUNDS):
        speeds = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, LEVELS)
        later, choice = np.zeros(LEVELS), []
        for i in range(count - 1, -1, -1):
            p, q = speeds[i][:, None], speeds[i + 1][None]
            kept = np.ones((LEVELS, LEVELS), dtype=bool)
            for a, b, c in rows.rows[i, : rows.counts[i]]:
                kept &= a * p**2 + b * q**2 <= c + 1e-10 * (abs(c) + abs(a) * p**2 + abs(b) * q**2)
            with np.errstate(divide="ignore"):
                total = np.where(kept, 2 * grid.widths[i] / (p + q) + later[None], np.inf)
            choice.append(np.argmin(total, axis=1))
            later = np.min(total, axis=1)
        at = [int(np.argmin(later))]
        best = min(best, float(later[at[0]]))
        for chosen in reversed(choice):
            at.append(int(chosen[at[-1]]))
        own = speeds[np.arange(count + 1), at]
        room = np.maximum(width * own, 2 * (high - low) / (LEVELS - 1))
        low, high = np.maximum(own - room, 0.0), np.minimum(own + room, most)
        width *= NARROWER
    return best


def study(options: argparse.Namespace) -> str:
    """Time all, write, and say where."""
    rows, known = [], robots()
    for k in range(options.paths):
        progress(k, options.paths, "paths")
        name = list(known)[k % len(known)]
        ends = known[name]
        path = random_path(np.random.default_rng([0, k // len(known), *name.encode()]), ends)
        timing = TimingLimits(ends.robot, ends.limits)
        grid = Grid(ends.robot, path, timing, spaced(path, NODES))
        passes = Trajectory.from_path(path, grid.s, fastest(grid, ExtraRows.none()).x).end
        levels = program(grid)
        fine, finest = (least_cost(ends.robot, path, ends.limits, TIME, nodes) for nodes in (NODES, FINEST))
        coarse = least_cost(ends.robot, path, ends.limits, TIME, COARSE)
        ratios = passes / levels, fine / finest, coarse / finest
        numbers = (levels, passes, fine, finest, *(100 * (value - 1) for value in ratios))
        rows.append((name, f"{k // len(known)}", *(number(value, 5) for value in numbers)))
    text = ["# The fastest timing against a dynamic program", ""]
    text += [f"{options.paths} random paths, all limits, {LEVELS} levels of speed, {ROUNDS} times in "
             f"narrower bands; {software(versions())}.", "", *table(HEAD, rows, left=2)]  # fmt: skip
    Path(options.out).mkdir(parents=True, exist_ok=True)
    write_text(Path(options.out) / "retiming_dynamic_program.md", "\n".join(text) + "\n")
    return f"{Path(options.out) / 'retiming_dynamic_program.md'}\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", default=str(RESULTS))
    parser.add_argument("--paths", type=int, default=10)
    return ended("retiming_dynamic_program", lambda: study(parser.parse_args(arguments)))


if __name__ == "__main__":
    sys.exit(main())
