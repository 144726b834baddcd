"""`ocptip.certify`: a proof that a motion keeps all limits at every instant, or the check of one."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.api.inputs.given import MotionLike, given_motion
from ocptip.api.tasks import Base, TaskLike
from ocptip.basics.errors import InputError, naming
from ocptip.basics.read import parse_json, read_text
from ocptip.basics.text import silent
from ocptip.basics.write import versions, write_text
from ocptip.certificate.checks import certified_cycle
from ocptip.motion.cycles.check import check_cycle, segments_of
from ocptip.motion.cycles.task import refuse_objects
from ocptip.motion.summary import CheckedMotion
from ocptip.trajectories.read import CERTIFICATE


@dataclass(frozen=True, eq=False, repr=False)
class Certified(CheckedMotion):
    """The bounds that were proved for a motion, or for the motions of a cycle, with its sampled check.

    Attributes:
        name: of the motion's file.
        assumed: what the file does not say.
    """

    name: str
    assumed: tuple[str, ...]

    @property
    def certified(self) -> bool:
        """All limits are proved to hold at every instant."""
        return self.check.certified

    def __repr__(self) -> str:
        """Verdict, what is proved, what is broken."""
        rows = [f"{self.name} on {self.task.name}: {self.check.headline}"]
        rows += [f"  proof: {self.certificate}"] if self.certificate else []
        return "\n".join([*rows, *(f"  broken: {text}" for text in self.broken)])

    def to_dict(self) -> dict[str, Any]:
        """The check with the certificate's bounds, plain data for JSON."""
        return {
            "motion": self.name,
            "task": self.task.name,
            **self.checked.to_dict(),
            "assumed": [*self.task.robot.notes, *self.assumed],
            "versions": versions(),
        }

    def save(self, path: str | os.PathLike[str]) -> Path | None:
        """Write the certificate of a motion as JSON; returns the path, None where there is no certificate."""
        if self.certificate is None or self.certificate.data is None:
            return None
        write_text(path, json.dumps(self.certificate.data, allow_nan=False) + "\n")
        return Path(path)


def certify(
    task: TaskLike | None,
    motion: MotionLike | None = None,
    *,
    base: Base | None = None,
    rise_time: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
    stage: Callable[[str], None] | None = None,
) -> Certified:
    """Prove that a motion loses no contact and keeps all limits at every instant.

    Example::

        found = ocptip.certify("task.toml", "trajectory.json")
        found.save("certificate.json")

    Args:
        task, motion: as for :func:`ocptip.check`.
        base: of a case, if it is not that of the file.
        rise_time: s, of profile commands; default: that of the file, or of the task.
        unit, rate, columns, topic: of files, see `ocptip.trajectories.read.load_motion`.
        stage: called with what is proved, and how much of it.

    Raises:
        InputError: the motion cannot be read or does not fit the robot, or is a fit to samples.
    """
    if motion is None:
        if not isinstance(task, str | os.PathLike):
            raise InputError("motion: missing; the task alone is no motion")
        task, motion = None, task
    reading = {"rise_time": rise_time, "unit": unit, "rate": rate, "columns": columns, "topic": topic}
    name, task, given = given_motion(motion, task, base=base, **reading)
    if given.fit is not None:
        raise InputError(
            f"{motion}: its samples do not say the accelerations exactly, and a proof about a fit to "
            "them says nothing about the motion; certify the commanded motion, or use ocptip check"
        )
    refuse_objects(task)
    with naming(name):
        sequence = segments_of(task, given)
        checked = certified_cycle(task, sequence, check_cycle(task, sequence), say=stage or silent)
    return Certified(name, given.assumed, task=task, checked=checked)


def read_certificate(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """The data if a file is a certificate; of what is none, the reader of motions says what is wrong."""
    path = Path(path)
    if path.suffix.lower() != ".json" or not path.is_file() or CERTIFICATE not in (text := read_text(path)):
        return None
    try:
        data = parse_json(text)
    except InputError:
        return None
    known = isinstance(data, dict) and str(data.get("format", "")).startswith(CERTIFICATE)
    return data if known else None
