"""The folder that `ocptip plan` wrote, read back: task, motion, and the results on them."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from ocptip.basics.errors import InputError, naming, positive_number
from ocptip.basics.outputs import SUMS, require_unchanged
from ocptip.basics.read import only_inside, read_json
from ocptip.motion.cycles.check import segments_of
from ocptip.motion.cycles.task import CycleTask, Task
from ocptip.motion.files.output import PLAN
from ocptip.motion.files.source import TASK
from ocptip.standing.arm import Robot
from ocptip.standing.parts import Part
from ocptip.task_files.cycle import read_task
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class PlanFolder:
    """A plan on disk; everything that is needed to go on with it.

    Attributes:
        path: of the folder.
        task: as it was planned, with its limits and objective.
        motion: that was checked: of the named controller, or trapezoidal velocity profiles.
        data: content of plan.json: seed, options, versions, worst values and more.
    """

    path: Path
    task: Task
    motion: Trajectory
    data: dict[str, Any]

    @property
    def task_of_motion(self) -> Task:
        """The task between the postures of the motion, where poses leave several."""
        if not isinstance(self.task, CycleTask):
            return replace(
                self.task, start=self.motion.start, goal=self.motion.goal, choices=(), targets=(None, None)
            )
        motions = [part.motion for part in self.every_part]  # refuses one that lacks segments
        segments = tuple(
            replace(segment, task=segment.between(motion.start, motion.goal), goals=motion.goal[None])
            for segment, motion in zip(self.task.segments, motions, strict=True)
        )
        return replace(self.task, segments=segments, starts=self.motion.start[None])

    def parts(self, does: str, *, objects: bool = False) -> tuple[Part, ...]:
        """The motions of an arm: one, or those of a cycle.

        Args:
            does: what is done with it, such as "view shows".
            objects: it takes those that only contacts hold.

        Raises:
            InputError: it is of another mechanism.
        """
        arms_of(self.task, does, self.path, objects=objects)
        return self.every_part

    @property
    def every_part(self) -> tuple[Part, ...]:
        """The motions, of any mechanism.

        Raises:
            InputError: segments are missing.
        """
        robots = [cast(Robot, segment.task.robot) for segment in self.task.segments]
        if len(self.motion.segments) < len(robots):
            raise InputError(
                f"holds {len(self.motion.segments)} of {len(robots)} segments", "", str(self.path)
            )
        rows = zip(
            robots, self.motion.segments, [segment.name for segment in self.task.segments],
            self.motion.begins.tolist(), self.motion.pauses, strict=True,
        )  # fmt: skip
        return tuple(Part(*row) for row in rows)

    def of_arm(self, does: str) -> tuple[Robot, Trajectory]:
        """Robot and motion of a single motion of an arm.

        Args:
            does: what is done with it, such as "simulate replays".

        Raises:
            InputError: a cycle, or another mechanism.
        """
        return arm_of(self.task, does, self.path), self.motion


def arm_of(task: Task, does: str, path: Path) -> Robot:
    """The arm of a single motion; InputError names the file or folder of a cycle, or another mechanism."""
    if task.is_cycle:
        raise InputError(f"is a cycle; {does} single motions", "", str(path))
    return arms_of(task, does, path)[0]


def arms_of(task: Task, does: str, path: Path, *, objects: bool = False) -> list[Robot]:
    """The arm of a motion, or those of a cycle's segments; InputError names the file of another mechanism."""
    if any(segment.task.robot.arm is None for segment in task.segments):
        raise InputError(f"is of a parallel robot; {does} arms", "", str(path))
    arms = [Robot.of(segment.task.robot) for segment in task.segments]
    for arm in [] if objects else arms:
        arm.require_no_objects(does.partition(" ")[0])
    return arms


def planned_rate(folder: Path) -> float | None:
    """Updates per second of the controller that a plan names; None if it draws no straight lines."""
    with only_inside(folder):
        data = read_json(folder / PLAN)
    controller = data.get("controller") if isinstance(data, dict) else None
    if not isinstance(controller, dict) or controller.get("name") != "linear":
        return None
    with naming(str(folder / PLAN)):
        return 1 / positive_number("controller.step_s", controller.get("step_s"))


def is_plan_folder(path: str | os.PathLike[str]) -> bool:
    """Whether a folder holds a plan with its task."""
    folder = Path(path)
    return all((folder / name).is_file() for name in (PLAN, SUMS, TASK))


def read_plan_folder(path: PlanFolder | str | os.PathLike[str]) -> PlanFolder:
    """Read a folder of a plan, wherever it is by now; nothing outside it is needed.

    Args:
        path: of the folder; or what was read from it, which is returned.

    Raises:
        InputError: it is no such folder, a file is missing or not what was written, or cannot be read; one
            line that names it.
    """
    if isinstance(path, PlanFolder):
        return path
    folder = Path(path)
    if not folder.is_dir():
        is_file = "is a file; expected the folder of a plan"
        raise InputError(is_file if folder.exists() else "no such folder", "", str(folder))
    if lacking := [name for name in (PLAN, SUMS) if not (folder / name).is_file()]:
        raise InputError(f"is no folder of a plan: no {' and no '.join(lacking)} in it", "", str(folder))
    require_unchanged(folder)
    if not (folder / TASK).is_file():
        raise InputError(f"holds no {TASK}: its task was made in Python", "", str(folder))
    with only_inside(folder):
        task = read_task(folder / TASK)
        motion = load_motion(folder / PLAN, task.robot.names, task.robot.units, several=True)
        motion = motion if task.is_cycle else segments_of(task, motion)
        return PlanFolder(folder, task, motion, read_json(folder / PLAN))
