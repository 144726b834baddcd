"""`ocptip.studio`: a robot at rest on a page with sliders; poses become a task that is planned from there."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.api.plan import plan
from ocptip.api.rate import kind_of
from ocptip.api.results.plan import Plan
from ocptip.api.tasks import TaskLike, load_task
from ocptip.basics.errors import InputError
from ocptip.basics.toml import toml_text
from ocptip.basics.write import MARK, write_files
from ocptip.motion.files.source import TASK, source_of
from ocptip.motion.task import MotionTask
from ocptip.parallel.analysis.workspace import ChainPosture
from ocptip.parallel.robot import ParallelRobot
from ocptip.pictures.browser.chain_studio import chain_page
from ocptip.pictures.browser.sliders import Actions
from ocptip.pictures.browser.studio import studio_page
from ocptip.pictures.browser.view import until_interrupted
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.posture_study import (
    Conditions,
    PostureAnswer,
    PostureStudy,
    Robustness,
    WorstPosture,
)
from ocptip.standing.parts import Part
from ocptip.standing.platform import StandingParallelRobot
from ocptip.task_files.parallel import read_robot
from ocptip.task_files.plan_folder import read_plan_folder


def studio(task: TaskLike | ParallelRobot) -> Studio | ChainStudio:
    """Return a robot at rest whose posture and conditions can be changed; `serve` opens it for a browser.

    Example::

        studio = ocptip.studio("examples/tasks/kit_arm.toml")
        print(studio.answer(payload=2.0))
        print(ocptip.studio("Delta").answer([0.1, 0.0, -0.5]))

    Args:
        task: a task, its file, or a published case; of a cycle the first segment. Or a parallel robot
            without a base: its file, the name of a ready-made one, or the object.

    Raises:
        InputError: the task cannot be read, or it carries loose objects.
    """
    if isinstance(task, ParallelRobot):
        return ChainStudio(task)
    if isinstance(task, str | os.PathLike) and kind_of(task, several=True) == "parallel":
        return ChainStudio(ParallelRobot(read_robot(os.fspath(task))))
    first = load_task(task).segments[0].task
    if isinstance(first.robot, StandingParallelRobot):
        return ChainStudio(first.robot.robot, first.robot, PosesOfTask(first))
    return Studio(first)


class PosesOfTask:
    """A task whose start and goal can be changed.

    Args:
        task: to begin with.

    Attributes:
        task: with the poses that were kept.
    """

    def __init__(self, task: MotionTask) -> None:
        self.task = task

    def keep(self, which: str, q: np.ndarray) -> None:
        """Make a posture (n,), rad (sliding joints: m), the "start" or the "goal" of the task."""
        ends = ("start", "goal")
        if which not in ends:
            raise InputError(f"which: expected start or goal, got {which!r}")
        posture = np.array(q, dtype=float)
        targets = [
            None if name == which else target for name, target in zip(ends, self.task.targets, strict=True)
        ]
        source = source_of(self.task)
        self.task = replace(self.task, **{which: posture}, targets=tuple(targets), choices=(), reference=None)
        if source is not None and "motion" in source.data:
            motion = {k: v for k, v in source.data["motion"].items() if not k.startswith(which)}
            data = {**source.data, "motion": motion | self.keys(which, posture)}
            self.task = replace(self.task, source=replace(source, data=data))

    def keys(self, which: str, posture: np.ndarray) -> dict[str, Any]:
        """A posture (n,), m and rad, as the task file says it."""
        return {which: posture.tolist()}

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the task with its poses, and the files that it names, into a folder; returns the task file.

        Raises:
            InputError: the task has no file with poses that can change: a published case, a cycle.
        """
        source = source_of(self.task)
        if source is None or "case" in source.data or "segment" in source.data:
            raise InputError("save: needs a task file of a single motion, no published case and no cycle")
        contents = {source.place(name): data for name, data in source.files.items()}
        text = toml_text({"name": self.task.name, **source.data})
        contents[TASK] = f"# {MARK}: poses of the studio\n{text}".encode()
        Path(folder).mkdir(exist_ok=True)
        write_files(Path(folder), contents)
        return Path(folder) / TASK

    def plan(self, *, starts: int = 1) -> Plan:
        """Plan the motion between the poses.

        Raises:
            NoPlanError: there is none; says why.
        """
        return plan(self.task, starts=starts)

    def actions(self, folder: str | os.PathLike[str]) -> Actions:
        """What the buttons of a page do; poses and plans are written into a folder."""

        def planned() -> tuple[str, tuple[Part, ...]]:
            result, there = self.plan(), Path(folder) / "plan"
            there.parent.mkdir(exist_ok=True)
            result.save(there)
            return f"{result.headline}; {there}", read_plan_folder(there).parts("the studio shows")

        def kept(which: str, q: np.ndarray) -> str:
            self.keep(which, q)
            return f"{which} saved: {self.save(folder)}"

        return Actions(kept, planned)

    @property
    def name(self) -> str:
        """Of the task."""
        return self.task.name

    @property
    def ends(self) -> dict[str, np.ndarray]:
        """The poses (n,)."""
        return {"start": self.task.start, "goal": self.task.goal}


class Studio(PosesOfTask):
    """The arm of a task on its base, at rest.

    Args:
        task: with the robot.

    Attributes:
        study: of its robot, as it rests at the start.
        conditions: at the start of the task.
    """

    def __init__(self, task: MotionTask) -> None:
        super().__init__(task)
        robot = Robot.of(task.robot).resting(0)
        self.study = PostureStudy(robot, task.limits)
        self.conditions = Conditions(task.start, robot.payload.mass if robot.payload else 0.0)

    def __repr__(self) -> str:
        """The task and its robot."""
        return f"<Studio {self.task.name}: {self.study.robot!r}>"

    def keys(self, which: str, posture: np.ndarray) -> dict[str, Any]:
        """A posture (n,), rad and m, as the task file says it."""
        slides = self.study.robot.arm.prismatic
        parts = ("deg", ~slides, 180 / np.pi), ("m", slides, 1.0)
        return {f"{which}_{unit}": (scale * posture[k]).tolist() for unit, k, scale in parts if k.any()}

    def answer(self, **changes: object) -> PostureAnswer:
        """Margins, contact forces and torques under changed conditions, in the nominal model.

        Args:
            changes: fields of `Conditions`; the others are those of the task at its start.

        Raises:
            InputError: there is no such condition, or its value cannot be used.
        """
        return self.study.answer(self._changed(changes))

    def worst(self, **changes: object) -> WorstPosture | None:
        """The worst within the uncertainty of the task; None without one."""
        return self.study.worst(self._changed(changes))

    def robustness(self, **changes: object) -> Robustness:
        """The robustness beyond such conditions, each deviation alone."""
        return self.study.robustness(self._changed(changes))

    def _changed(self, changes: dict[str, object]) -> Conditions:
        known = list(vars(self.conditions))
        if unknown := [name for name in changes if name not in known]:
            raise InputError(f"{unknown[0]}: no such condition; there are {', '.join(known)}")
        return replace(self.conditions, **changes)

    def serve(self, say: Callable[[str], None], folder: str | os.PathLike[str]) -> None:
        """Serve the page until Ctrl-C.

        Args:
            say: gets its address.
            folder: for the task with its poses, and for the plan.
        """
        actions = self.actions(folder)
        with studio_page(self.name, self.study, self.conditions, self.ends, actions) as page:
            until_interrupted(page.server, say)


class ChainStudio:
    """A parallel robot at rest.

    Args:
        robot: the robot.
        standing: the same on its base, for margins.
        poses: of its task, for plans.

    Attributes:
        robot, standing: as given.
    """

    def __init__(
        self,
        robot: ParallelRobot,
        standing: StandingParallelRobot | None = None,
        poses: PosesOfTask | None = None,
    ) -> None:
        self.robot, self.standing, self._poses = robot, standing, poses

    @property
    def name(self) -> str:
        """Of the task, else of the robot."""
        return self.robot.description.name if self._poses is None else self._poses.name

    def __repr__(self) -> str:
        """The task or the robot."""
        return f"<ChainStudio {self.name}>"

    def answer(self, z: ArrayLike | None = None) -> ChainPosture:
        """Joints with their ranges, motors and the distance from singular poses.

        Args:
            z: (m,) coordinates of the platform, m and rad; default: the start, or home.

        Raises:
            InputError: the pose is out of reach.
        """
        return ChainPosture(self.robot, self._start if z is None else z)

    @property
    def _start(self) -> np.ndarray:
        return self.robot.description.home if self._poses is None else self._poses.task.start

    def serve(self, say: Callable[[str], None], folder: str | os.PathLike[str]) -> None:
        """Serve the page until Ctrl-C; arguments as of `Studio.serve`."""
        poses = self._poses
        ends = {"start": self._start} if poses is None else poses.ends
        actions = None if poses is None else poses.actions(folder)
        with chain_page(self.robot, self.standing, ends, actions) as page:
            until_interrupted(page.server, say)
