"""Timing of the same random paths by ocptip and by toppra: durations, what is broken, how many tip.

Each path is a spline through random postures around the start of a task. It is timed

- by toppra with limits of speed and acceleration only, interpolated collocation (`toppra`);
- by ocptip with the same limits only: on a base of 1e6 kg, torques not limited (`same`);
- by toppra with the half planes of torque, tip-over and slip that ocptip takes at the same nodes (`rows`);
- by ocptip with all limits (`retime`).

All four have the same nodes. The motions are then looked at on a dense grid: toppra's as piecewise constant
accelerations along the path, exactly as they were computed, between its nodes, too.

    python -m studies.retiming.run --out results [--paths 10] [--seed 0] [--nodes 300]

Writes OUT/retiming.json and .md.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import toppra
from toppra.constraint import DiscretizationType, JointAccelerationConstraint, JointVelocityConstraint
from toppra.constraint.linear_constraint import LinearConstraint, canlinear_colloc_to_interpolate

from ocptip.basics.errors import OcptipError
from ocptip.basics.write import versions, write_text
from ocptip.contact.support import Support
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.published.tasks import experiment_task
from ocptip.retiming.retime import retime
from ocptip.retiming.rows import Places, TimingLimits
from ocptip.standing.arm import StandingRobot
from ocptip.standing.limits import MotionLimits
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.path_fit import spline_through
from ocptip.trajectories.timed_path import TimedPath
from studies.common import EXAMPLES, RESULTS, ended, json_text, machine, number, progress, table

NAMES = ("toppra", "same", "rows", "retime")
HEAVY = 1e6  # kg
SPREAD = 0.6  # rad, of the postures around the start
MOST_TRIES = 50


class _Geometry(toppra.interpolator.AbstractGeometricPath):
    """A path as toppra takes it."""

    def __init__(self, path: JointPath) -> None:
        self._path = path

    def __call__(self, s: Any, order: int = 0) -> np.ndarray:
        return self._path.at(np.clip(s, 0.0, 1.0))[order]

    @property
    def dof(self) -> int:
        return self._path.joints

    @property
    def path_interval(self) -> np.ndarray:
        return np.array([0.0, 1.0])

    @property
    def waypoints(self) -> None:
        return None


class _Rows(LinearConstraint):
    """Half planes alpha u + beta x <= gamma at the nodes."""

    def __init__(self, robot: StandingRobot, path: JointPath, limits: MotionLimits) -> None:
        super().__init__()
        self._own, self._timing = (robot, path), TimingLimits(robot, limits)
        self.set_discretization_type(DiscretizationType.Interpolation)
        self.identical = False
        self.dof = path.joints

    def compute_constraint_params(self, path: _Geometry, gridpoints: np.ndarray) -> Any:
        places = Places.of(*self._own, gridpoints, np.zeros(len(gridpoints), dtype=bool))
        planes = self._timing.half_planes(places)
        rows = planes.alpha.shape[1]
        one = np.tile(np.eye(rows), (len(gridpoints), 1, 1))
        params = planes.alpha, planes.beta, -planes.gamma, one, np.zeros((len(gridpoints), rows)), None, None
        return canlinear_colloc_to_interpolate(*params, gridpoints=gridpoints)


def by_toppra(
    robot: StandingRobot, path: JointPath, nodes: np.ndarray, *more: Any
) -> tuple[TimedPath, float]:
    """The timing and the seconds it took, set-up included."""
    limits, begun = robot.limits, time.perf_counter()
    speed = JointVelocityConstraint(np.column_stack([-limits.speed, limits.speed]))
    acceleration = JointAccelerationConstraint(
        np.column_stack([-limits.acceleration, limits.acceleration]),
        discretization_scheme=DiscretizationType.Interpolation,
    )
    solver = toppra.algorithm.TOPPRA(
        [speed, acceleration, *more], _Geometry(path), gridpoints=nodes, solver_wrapper="seidel"
    )
    rates = solver.compute_parameterization(0.0, 0.0)[1]
    seconds = time.perf_counter() - begun
    if rates is None or not np.all(np.isfinite(rates)):
        raise OcptipError("toppra: no timing")
    return TimedPath(path, nodes, np.maximum(rates, 0.0) ** 2), seconds


def robots() -> dict[str, tuple[StandingRobot, np.ndarray]]:
    """By name: the robot and a posture to begin with."""
    found = {"UR5 on a cart": load_task(EXAMPLES / "tasks" / "ur5_cart.toml")}
    found |= {f"case {name}": experiment_task(name, "effective") for name in "ADG"}
    return {k: (t.robot, t.start) for k, t in found.items() if isinstance(t.robot, StandingRobot)}


def heavy(robot: StandingRobot) -> StandingRobot:
    """The same on a base that never tips."""
    own = robot.support
    base = Support(list(own.contacts), mass=HEAVY, center_of_mass=own.center_of_mass)
    return StandingRobot(robot.arm, base, robot.motors)


def random_path(rng: np.random.Generator, robot: StandingRobot, start: np.ndarray) -> JointPath:
    """A spline through four postures, along which nothing collides and the base stands at rest."""
    low, high = robot.limits.angle_min, robot.limits.angle_max
    for _ in range(MOST_TRIES):
        points = np.clip(start + SPREAD * np.cumsum(rng.normal(size=(4, robot.n)), axis=0), low, high)
        path = spline_through(points).path
        slow = TimedPath(path, path.breakpoints, np.r_[0, np.full(path.pieces - 1, 1e-4), 0])
        if check_motion(robot, slow, MotionLimits(), step=0.5).verified:
            return path
    raise OcptipError("no path that stands at rest was found")


def row_of(name: str, robot: StandingRobot, path: JointPath, nodes: int) -> dict[str, Any]:
    """Durations, seconds and outcome of the four timings of a path."""
    limits = MotionLimits()
    row: dict[str, Any] = {"robot": name}
    none = replace(limits, torque_ratio=1e6)
    places: np.ndarray = retime(robot, path, limits, nodes=nodes).motion.s
    ways: dict[str, Callable[[], tuple[TimedPath, float]]] = {
        "toppra": lambda: by_toppra(robot, path, places),
        "same": lambda: _ours(heavy(robot), path, none, nodes),
        "rows": lambda: by_toppra(robot, path, places, _Rows(robot, path, limits)),
        "retime": lambda: _ours(robot, path, limits, nodes),
    }
    for way, timed in ways.items():
        try:
            motion, seconds = timed()
        except OcptipError as error:
            row[way] = {"status": f"{error}"}
            continue
        checked = check_motion(robot, motion, limits)
        row[way] = {"duration_s": motion.end, "seconds": seconds, **_outcome(checked)}
    return row


def _ours(robot: StandingRobot, path: JointPath, limits: MotionLimits, nodes: int) -> tuple[TimedPath, float]:
    found = retime(robot, path, limits, nodes=nodes)
    return found.motion, found.seconds


def _outcome(checked: MotionCheck) -> dict[str, Any]:
    worst = {name: w.value for name, w in checked.worst.items()}
    names = ("GN", "GT", "torque_ratio", "speed_ratio", "acceleration_ratio")
    return {"verified": checked.verified, "stands": checked.stands, **{name: worst[name] for name in names}}


def markdown(rows: Sequence[dict[str, Any]], data: dict[str, Any]) -> str:
    """The table of the study."""
    lines = []
    for name in dict.fromkeys(row["robot"] for row in rows):
        own = [row for row in rows if row["robot"] == name]
        for way in NAMES:
            good = [row[way] for row in own if "duration_s" in row[way]]
            if not good:
                continue
            over = [one["acceleration_ratio"] for one in good]
            ratio = [
                row[way]["duration_s"] / row["toppra"]["duration_s"]
                for row in own
                if "duration_s" in row[way]
            ]
            cells = f"{len(good)} of {len(own)}", number(float(np.median(ratio)), 4), number(max(ratio), 4)
            lost = sum(not one["stands"] for one in good)
            cells += f"{lost}", f"{sum(one['verified'] for one in good)}", number(max(o["GN"] for o in good))
            cells += number(max(over), 4), number(1e3 * float(np.median([o["seconds"] for o in good])))
            lines.append((name, way, *cells))
    head = ("robot", "by", "timed", "duration / toppra (median)", "most", "lose a contact", "keep all limits",
            "largest GN", "largest acceleration / limit", "ms (median)")  # fmt: skip
    text = [
        *table(head, lines, left=2),
        "",
        f"Seed {data['seed']}, {data['nodes']} nodes. ms: `toppra` and `rows` ",
    ]
    text[-1] += "with set-up, without a check; `same` and `retime` with the check on a dense grid."
    return "\n".join(text) + "\n"


def study(options: argparse.Namespace) -> str:
    """Run, write, and say where."""
    rows, machines = [], robots()
    for name, (robot, start) in machines.items():
        rng = np.random.default_rng([options.seed, *name.encode()])
        for k in range(options.paths):
            progress(k, options.paths, name)
            rows.append(row_of(name, robot, random_path(rng, robot, start), options.nodes))
    data = {"seed": options.seed, "nodes": options.nodes, "machine": machine(), "versions": versions()}
    data["versions"]["toppra"] = version("toppra")
    out = Path(options.out)
    write_text(out / "retiming.json", json_text({**data, "rows": rows}))
    write_text(out / "retiming.md", markdown(rows, data))
    return f"{out / 'retiming.md'}"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", default=str(RESULTS))
    parser.add_argument("--paths", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--nodes", type=int, default=300)
    options = parser.parse_args(arguments)
    toppra.setup_logging("ERROR")
    return ended("retiming", lambda: study(options))


if __name__ == "__main__":
    sys.exit(main())
