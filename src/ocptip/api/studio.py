"""`ocptip.studio`: a robot at rest on a page with sliders; poses become a task that is planned from there."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.api.plan import plan
from ocptip.api.results.plan import Plan
from ocptip.api.tasks import TaskLike, load_task
from ocptip.basics.errors import InputError
from ocptip.basics.toml import toml_text
from ocptip.basics.write import MARK, write_files
from ocptip.motion.files.source import TASK, source_of
from ocptip.motion.task import MotionTask
from ocptip.pictures.browser.studio import Actions, studio_page
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
from ocptip.task_files.plan_folder import read_plan_folder


def studio(task: TaskLike) -> Studio:
    """Return a robot at rest whose posture and conditions can be changed; `serve` opens it for a browser.

    Example::

        studio = ocptip.studio("examples/tasks/kit_arm.toml")
        print(studio.answer(payload=2.0))

    Args:
        task: a task of an arm, its file, or a published case; of a cycle the first segment.

    Raises:
        InputError: the task cannot be read, its robot is no arm, or it carries loose objects.
    """
    return Studio(load_task(task).segments[0].task)


class Studio:
    """The arm of a task on its base, at rest.

    Args:
        task: with the robot.

    Attributes:
        task: with the poses that were kept.
        study: of its robot, as it rests at the start.
        conditions: at the start of the task.
    """

    def __init__(self, task: MotionTask) -> None:
        robot = Robot.of(task.robot, "task: the studio is for arms; this robot is a parallel one").resting(0)
        self.task, self.study = task, PostureStudy(robot, task.limits)
        self.conditions = Conditions(task.start, robot.payload.mass if robot.payload else 0.0)

    def __repr__(self) -> str:
        """The task and its robot."""
        return f"<Studio {self.task.name}: {self.study.robot!r}>"

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

    def keep(self, which: str, q: np.ndarray) -> None:
        """Make a posture (n,), rad (sliding joints: m), the "start" or the "goal" of the task."""
        ends = ("start", "goal")
        if which not in ends:
            raise InputError(f"which: expected start or goal, got {which!r}")
        posture = np.array(q, dtype=float)
        targets = [
            None if name == which else target for name, target in zip(ends, self.task.targets, strict=True)
        ]
        source, arm = source_of(self.task), self.study.robot.arm
        self.task = replace(self.task, **{which: posture}, targets=tuple(targets), choices=(), reference=None)
        if source is not None and "motion" in source.data:
            motion = {k: v for k, v in source.data["motion"].items() if not k.startswith(which)}
            for unit, target, scale in (("deg", ~arm.prismatic, 180 / np.pi), ("m", arm.prismatic, 1.0)):
                if target.any():
                    motion[f"{which}_{unit}"] = (scale * posture[target]).tolist()
            self.task = replace(self.task, source=replace(source, data={**source.data, "motion": motion}))

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

    def serve(self, say: Callable[[str], None], folder: str | os.PathLike[str]) -> None:
        """Serve the page until Ctrl-C.

        Args:
            say: gets its address.
            folder: for the task with its poses, and for the plan.
        """

        def planned() -> tuple[str, tuple[Part, ...]]:
            result, there = self.plan(), Path(folder) / "plan"
            there.parent.mkdir(exist_ok=True)
            result.save(there)
            return f"{result.headline}; {there}", read_plan_folder(there).parts("the studio shows")

        def kept(which: str, q: np.ndarray) -> str:
            self.keep(which, q)
            return f"{which} saved: {self.save(folder)}"

        ends = {"start": self.task.start, "goal": self.task.goal}
        actions = Actions(kept, planned)
        with studio_page(self.task.name, self.study, self.conditions, ends, actions) as page:
            until_interrupted(page.server, say)
