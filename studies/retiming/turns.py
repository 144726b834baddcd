"""How much a grid of nodes costs on splines whose joints turn back at every waypoint.

Usage: python -m studies.retiming.turns

A UR5 with its speeds and accelerations (3 rad/s, 4 rad/s^2) on a base that cannot tip; splines through N
waypoints, to and fro between two regions (all joints turn back) or anywhere. Durations of the fastest timing
with the default number of nodes and with 300, above those with 6,000.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ocptip.motion.objective import TIME
from ocptip.retiming.fastest import enough
from ocptip.retiming.retime import FASTEST_NODES, least_cost
from ocptip.standing.limits import Limits
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path_fit import spline_through
from studies.common import EXAMPLES, RESULTS

MANY = 6000


def main() -> None:
    """Write the table."""
    text = (EXAMPLES / "tasks" / "ur5_cart.toml").read_text(encoding="utf-8")
    text = text.replace("mass = 35.0", "mass = 400.0").replace('urdf = "', f'urdf = "{EXAMPLES}/tasks/')
    text = text.replace("acceleration_deg_s2 = 800.0", "acceleration_deg_s2 = 229.18\nspeed_deg_s = 171.89")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "heavy.toml"
        path.write_text(text, encoding="utf-8")
        robot = load_task(path).robot
    start = np.radians([0.0, -26.6, -33.0, 0.0, -97.4, 0.0])
    way, rng = np.radians([30, 20, -25, 10, 15, -20]), np.random.default_rng(0)
    lines = ["| waypoints | kind | nodes | above 6,000 nodes | 300 nodes |", "|---|---|---|---|---|"]
    for count in (3, 6, 12, 24, 48):
        for kind in ("to and fro", "anywhere"):
            points = [
                start + (way * rng.uniform(0.8, 1.2) if k % 2 else 0.02 * rng.normal(size=6))
                if kind == "to and fro"
                else start + 0.3 * rng.normal(size=6)
                for k in range(count)
            ]
            path = spline_through(np.array(points)).path
            nodes = enough(path, FASTEST_NODES)
            best, own, few = (
                least_cost(robot, path, Limits(), TIME, n) for n in (MANY, nodes, FASTEST_NODES)
            )
            more = [f"{100 * (value / best - 1):.2f} %" for value in (own, few)]
            lines.append(f"| {count} | {kind} | {nodes} | {more[0]} | {more[1]} |")
            print(lines[-1], flush=True)
    (RESULTS / "retiming_turns.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
