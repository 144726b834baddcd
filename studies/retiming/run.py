"""Timing of the same random paths by ocptip and by toppra: durations, what is broken, how many tip.

Each path is a spline from start to goal of a task through three random postures. It is timed

- by toppra with limits of speed and acceleration only, interpolated collocation (`toppra`);
- by ocptip with the same limits only: on a base of 1e6 kg, torques not limited (`same`);
- by toppra with the half planes of torque, tip-over and slip that ocptip takes at the same nodes (`rows`);
- by ocptip with all limits (`retime`).

All four have the same nodes. The motions are then looked at on a dense grid: toppra's as piecewise constant
accelerations along the path, exactly as they were computed, between its nodes, too.

    python -m studies.retiming.run --out results [--paths 20] [--seed 0] [--nodes 100]

Adds to OUT/retiming.jsonl, writes OUT/retiming.md. It goes on: paths that the file has are not timed again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ocptip.basics.errors import InputError, OcptipError
from ocptip.basics.write import plain, versions, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.published.tasks import experiment_task
from ocptip.retiming.fastest import spaced
from ocptip.retiming.retime import retime
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.path_fit import spline_through
from ocptip.trajectories.trajectory import Trajectory
from studies.common import (
    EXAMPLES,
    PLANNING,
    RESULTS,
    JsonLines,
    ended,
    number,
    progress,
    software,
    source_state,
    state_notes,
    table,
)

NAMES = ("toppra", "same", "rows", "retime")
HEAVY = 1e6  # kg
SPREAD = (0.02, 0.25)  # of the postures around the straight line, per largest travel of a joint
APART = 0.03  # of the ends from those of the task, likewise
MOST_TRIES = 50
PACKAGES = (*PLANNING, "retiming")


class Ends(NamedTuple):
    """A robot, start and goal (n,) around which its paths begin and end, and its limits."""

    robot: StandingMechanism
    start: np.ndarray
    goal: np.ndarray
    limits: Limits


def robots() -> dict[str, Ends]:
    """By name; durations are not limited."""
    cart, delta = (load_task(EXAMPLES / "tasks" / f"{name}_cart.toml") for name in ("ur5", "delta"))
    tasks = {"UR5 on a cart": cart, "delta robot": delta}
    tasks |= {f"case {name}": experiment_task(name, "effective") for name in "ADG"}
    found = {
        name: Ends(t.robot, t.start, t.goal, replace(t.limits, max_duration=np.inf))
        for name, t in tasks.items()
    }
    feet = [
        UnilateralContact(position=p, friction=0.4, facets=12)
        for p in ([0.3, 0.0, 0.0], [-0.2, 0.3, 0.0], [-0.2, -0.3, 0.0])
    ]
    three = Support(feet, mass=60.0, center_of_mass=[0.0, 0.0, 0.3])
    found["UR5 on three feet"] = found["UR5 on a cart"]._replace(robot=cart.robot.varied(support=three))
    return found


def heavy(robot: StandingMechanism) -> StandingMechanism:
    """The same on a base that never tips."""
    own = robot.support
    base = Support(list(own.contacts), mass=HEAVY, center_of_mass=own.center_of_mass)
    return robot.varied(support=base)


def random_path(rng: np.random.Generator, ends: Ends) -> JointPath:
    """A spline through five postures, along which nothing collides and the base stands at rest."""
    robot, travel = ends.robot, np.abs(ends.goal - ends.start).max()
    for _ in range(MOST_TRIES):
        points = ends.start + np.linspace(0, 1, 5)[:, None] * (ends.goal - ends.start)
        points[1:-1] += travel * rng.uniform(*SPREAD) * rng.normal(size=(3, robot.n))
        points[[0, -1]] += travel * APART * rng.normal(size=(2, robot.n))
        path = spline_through(np.clip(points, robot.limits.angle_min, robot.limits.angle_max)).path
        slow = Trajectory.from_path(path, path.breakpoints, np.r_[0, np.full(path.pieces - 1, 1e-4), 0])
        try:
            if check_motion(robot, slow, ends.limits, step=0.5).verified:
                return path
        except InputError:  # out of a parallel robot's workspace
            continue
    raise OcptipError("no path that stands at rest was found")


def row_of(ends: Ends, path: JointPath, nodes: int, rows: bool) -> dict[str, Any]:
    """Durations, seconds and outcome of the timings of a path; `rows` only if asked for."""
    from studies.retiming.toppra_timing import by_toppra  # an extra that only this study needs

    robot, limits, row = ends.robot, ends.limits, {}
    none = replace(limits, torque_ratio=1e6)
    places = spaced(path, nodes)
    ways: dict[str, Callable[[], tuple[Trajectory, float]]] = {
        "toppra": lambda: by_toppra(robot, path, places),
        "same": lambda: _ours(heavy(robot), path, none, nodes),
        "rows": lambda: by_toppra(robot, path, places, limits),
        "retime": lambda: _ours(robot, path, limits, nodes),
    }
    if not rows:
        del ways["rows"]
    for way, timed in ways.items():
        try:
            motion, seconds = timed()
        except OcptipError as error:
            row[way] = {"status": f"{error}"}
            continue
        checked = check_motion(robot, motion, limits)
        row[way] = {"duration_s": motion.end, "seconds": seconds, **_outcome(checked)}
    return row


def _ours(robot: StandingMechanism, path: JointPath, limits: Limits, nodes: int) -> tuple[Trajectory, float]:
    found = retime(robot, path, limits, nodes=nodes)
    return found.motion, found.seconds


def _outcome(checked: MotionCheck) -> dict[str, Any]:
    worst = {name: w.value for name, w in checked.worst.items()}
    names = ("GN", "GT", "torque_ratio", "speed_ratio", "acceleration_ratio")
    return {"verified": checked.verified, "stands": checked.stands, **{name: worst[name] for name in names}}


def markdown(rows: Sequence[dict[str, Any]], options: dict[str, Any]) -> str:
    """The table of the study."""
    lines = []
    for name in dict.fromkeys(row["robot"] for row in rows):
        own = [row for row in rows if row["robot"] == name]
        lines += [(name, way, *_cells(own, way)) for way in NAMES]
    head = ("robot", "by", "timed", "duration / toppra (median)", "least", "most",
            "most / toppra within its limits", "lose a contact",
            "keep all limits", "largest GN", "largest acceleration / limit", "ms (median)")  # fmt: skip
    refused = [f"- {row['robot']}, path {row['path']}, {way}: {row[way]['status']}"
               for row in rows for way in NAMES if "status" in row.get(way, {})]  # fmt: skip
    text = [
        f"{len(rows)} paths of {len({row['robot'] for row in rows})} robots, seed {options['seed']}, "
        f"{options['nodes']} nodes; {software({**versions(), 'toppra': version('toppra')})}.",
        "",
        *table(head, lines, left=2),
        "",
        "Durations are divided by toppra's of the same path with speeds and accelerations only (of the delta "
        "robot with speeds of motors, too); `within its limits`: after slowing toppra's down by what it "
        "exceeds these between nodes. ms: `toppra` "
        "and `rows` with set-up, without a check; `same` and `retime` with the check on a dense grid; on a "
        "machine that others used, too.",
        "",
        *(["Not timed:", "", *refused] if refused else ["No path was refused."]),
        *state_notes([row["state"] for row in rows], source_state(*PACKAGES)),
    ]
    return "\n".join(text) + "\n"


def _cells(rows: Sequence[dict[str, Any]], way: str) -> tuple[str, ...]:
    rows = [row for row in rows if way in row]
    good = [row[way] for row in rows if "duration_s" in row[way]]
    both = [row for row in rows if "duration_s" in row[way] and "duration_s" in row["toppra"]]
    if not both:
        return f"0 of {len(rows)}", *"-" * 9
    ratio = [row[way]["duration_s"] / row["toppra"]["duration_s"] for row in both]
    kept = [own / _slower(row["toppra"]) for own, row in zip(ratio, both, strict=True)]
    return (
        f"{len(good)} of {len(rows)}",
        *(number(float(value), 4) for value in (np.median(ratio), min(ratio), max(ratio), max(kept))),
        f"{sum(not one['stands'] for one in good)}",
        f"{sum(one['verified'] for one in good)}",
        number(max(one["GN"] for one in good)),
        number(max(one["acceleration_ratio"] for one in good), 4),
        number(1e3 * float(np.median([one["seconds"] for one in good])), 1),
    )


def _slower(own: dict[str, Any]) -> float:
    """Factor of times with which a motion keeps its limits of speed and acceleration between nodes, too."""
    return max(1.0, own["speed_ratio"], float(np.sqrt(own["acceleration_ratio"])))


def study(options: argparse.Namespace) -> str:
    """Run what is missing, write, and say where."""
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    file, machines = JsonLines(out / "retiming.jsonl"), robots()
    own = {"seed": options.seed, "nodes": options.nodes}
    done = {(row["robot"], row["path"]) for row in file.read() if own.items() <= row.items()}
    for k in range(options.paths):
        progress(k, options.paths, "paths of each robot")
        for name, ends in machines.items():
            if (name, k) not in done:
                path = random_path(np.random.default_rng([options.seed, k, *name.encode()]), ends)
                row = {"robot": name, "path": k, **own, **row_of(ends, path, options.nodes, k < options.rows)}
                file.append(plain({**row, "state": source_state(*PACKAGES)}))
    rows = [row for row in file.read() if own.items() <= row.items()]
    write_text(out / "retiming.md", markdown(rows, own))
    return f"{out / 'retiming.md'}\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", default=str(RESULTS))
    parser.add_argument("--paths", type=int, default=20, help="of each robot")
    parser.add_argument(
        "--rows", type=int, default=4, help="paths of each robot timed by toppra with rows, too"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--nodes", type=int, default=100)
    options = parser.parse_args(arguments)
    return ended("retiming", lambda: study(options), "finished rows are kept.")


if __name__ == "__main__":
    sys.exit(main())
