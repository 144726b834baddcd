"""Three glasses on a tray on a UR5: a path timed with and without regard to them, replayed by MuJoCo.

    python -m studies.objects.waiter

Both timings carry the masses of the glasses, and keep all limits of the robot and its base. One also keeps
the limits of the glasses. Prints a table, and the CPU time of rows and polygons with seven glasses.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace

from ocptip.retiming.fastest import ExtraRows, Grid, spaced
from ocptip.retiming.retime import retime
from ocptip.retiming.rows import TimingLimits
from ocptip.standing.arm import Robot
from ocptip.standing.parts import Part
from ocptip.standing.simulation.objects import predicted_objects
from ocptip.standing.simulation.replay import Simulator
from ocptip.standing.tolerance import NONE
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from studies.common import EXAMPLES, table

HEAD = "timing", "duration", "glasses that keep their contacts", "largest lift", "largest slide", "cart"


def rows() -> Iterator[list[str]]:
    """Of both timings: duration, glasses kept by the library, and what becomes of them in MuJoCo."""
    task = load_task(EXAMPLES / "tasks" / "ur5_waiter.toml")
    robot = task.robot
    assert isinstance(robot, Robot)
    path = load_path(EXAMPLES / "paths" / "ur5_waiter.toml", task).paths[0].path
    for name, timed in (("with the glasses", robot), ("without", robot.varied(objects=()))):
        found = retime(timed, path, task.limits)
        assert found.check.verified, found.check.violations
        parts = (Part(robot, found.motion),)
        replay, kept = Simulator(parts).run(), predicted_objects(parts)
        moved = replay.objects.values()
        yield [
            name,
            f"{found.motion.end:.3f} s",
            f"{sum(kept.values())} of {len(kept)}",
            f"{1e3 * max(own.lift for own in moved):.3f} mm",
            f"{1e3 * max(own.slide for own in moved):.2f} mm",
            "falls"
            if replay.falls
            else f"lifts {1e3 * replay.lift:.3f} mm, slides {1e3 * replay.slide:.2f} mm",
        ]


def milliseconds(nodes: int = 100, times: int = 7) -> float:
    """The least CPU time, ms, of rows and polygons of a timing with seven glasses."""
    task = load_task(EXAMPLES / "tasks" / "ur5_waiter.toml", NONE)
    path = load_path(EXAMPLES / "paths" / "ur5_waiter.toml", task).paths[0].path
    robot = task.robot
    assert isinstance(robot, Robot)
    glass = robot.objects[0]
    places = [(-0.01, y, z) for y, z in ((-0.08, 0.2), (0.08, 0.2), (0.0, 0.16), (0.0, 0.2))]
    more = [replace(glass, name=f"glass_{k}", position=place) for k, place in enumerate(places)]
    robot = robot.without_objects().carrying([*robot.objects, *more])
    limits, found = TimingLimits(robot, task.limits), []
    grid = Grid(robot, path, limits, spaced(path, nodes))
    for _ in range(times):
        began = time.process_time()
        limits.half_planes(grid.places)
        grid.polygons(ExtraRows.none())
        found.append(1e3 * (time.process_time() - began))
    return min(found)


def main(arguments: list[str] | None = None) -> None:
    """Print the table and the time."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args(arguments)
    print("\n".join(table(HEAD, rows())))
    print(f"rows and polygons with seven glasses: {milliseconds():.0f} ms")


if __name__ == "__main__":
    main()
