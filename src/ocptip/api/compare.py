"""`ocptip.compare`: a recording of a machine beside the plan that it ran, and what would explain the rest."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, naming
from ocptip.basics.write import versions, write_json
from ocptip.measured.compare import LEVEL
from ocptip.measured.compare import compare as compared
from ocptip.measured.comparison import Comparison
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import Recording, doubt_turns, read_recording
from ocptip.pictures.compared import save_comparison
from ocptip.task_files.plan_folder import PlanFolder, read_plan_folder


def compare(
    plan: PlanFolder | str | os.PathLike[str],
    recording: str | os.PathLike[str],
    *,
    unit: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    topics: Sequence[str] = (),
    level: float = LEVEL,
    same_clock: bool = False,
) -> PlanComparison:
    """Compare what a machine did with the plan that it ran.

    Example::

        ocptip.compare("ocptip-plan-A", "recording.csv", unit="deg").agrees

    Args:
        plan: the folder of a plan, or what was read from it.
        recording: file of the recording (docs/compare.md).
        unit: of angles in it, where its columns do not say it: "deg" or "rad".
        columns: title or number of each signal's column, by signal; numbers from 1.
        topics: of a bag: joint states, and the wrench of the sensor in the base, which is read only if named.
        level: probability of any finding by chance.
        same_clock: the recording's times are those of the plan.

    Raises:
        InputError: a file cannot be used; one line that names it.
    """
    folder = read_plan_folder(plan)
    name = str(folder.path)
    if folder.task.is_cycle:
        raise InputError("is a cycle; compare recordings of its segments with plans of these", "", name)
    folder.task.robot.require_no_objects("compare")
    with naming(name):
        predictor = Predictor(folder.task.robot, folder.motion)
    measured = read_recording(recording, folder.task.robot, unit=unit, columns=columns, topics=topics)
    doubt_turns(measured, folder.task.robot, folder.motion)
    with naming(Path(recording).name):
        result = compared(measured, predictor, level=level, same_clock=same_clock)
    return PlanComparison(folder.task.name, predictor, result, measured)


@dataclass(frozen=True, eq=False, repr=False)
class PlanComparison:
    """A recording compared with the plan that was run.

    Attributes:
        name: of the task.
        predictor: of its robot and motion.
        found: the comparison.
        recording: that was compared.
    """

    name: str
    predictor: Predictor
    comparison: Comparison
    recording: Recording

    @property
    def agrees(self) -> bool:
        """Whether nothing differs from what was described."""
        return self.comparison.agrees

    def __repr__(self) -> str:
        """The number of findings, and their names."""
        names = ", ".join(finding.name for finding in self.comparison.findings)
        return f"<PlanComparison {self.name}: {'agrees' if self.agrees else f'differs: {names}'}>"

    def to_dict(self) -> dict[str, Any]:
        """All numbers but the curves."""
        return {
            "task": self.name,
            **self.comparison.to_dict(),
            "period_s": self.recording.period,
            "time_bases": list(self.recording.rates),
            "versions": versions(),
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the data as JSON (.json), or a figure (.png, .pdf, .svg), into a file; returns its path."""
        if Path(path).suffix == ".json":
            write_json(Path(path), self.to_dict())
            return Path(path)
        return save_comparison(path, self.comparison, self.predictor, self.name)
