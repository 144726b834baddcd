"""Options of several commands, checked and put to use; and reports with requirements, for pipelines."""

from __future__ import annotations

import re
import tempfile
from abc import abstractmethod
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np

from ocptip.api.inputs.requirements import Outcome, junit, outcomes_to_dict, read_requirements
from ocptip.basics.errors import InputError, naming, positive_number, share_of_one
from ocptip.basics.outputs import require_replaceable
from ocptip.basics.write import write_text
from ocptip.cli.command import Report
from ocptip.task_files.tables.tolerance import load_tolerance

if TYPE_CHECKING:
    from ocptip.motion.cycles.task import Task
    from ocptip.motion.files.source import TaskSource
    from ocptip.motion.task import MotionTask
    from ocptip.standing.arm import Robot
    from ocptip.standing.tolerance import Uncertainty


_LIMITS = (
    *(("gn", "GN"), ("gt", "GT"), ("torque_ratio",) * 2),
    *(("clearance",) * 2, ("foot_lift",) * 2, ("tcp_speed",) * 2),
)


def given_limits(options: Namespace) -> dict[str, Any]:
    """The limits that are given, by their names; InputError names an option that cannot be."""
    given: dict[str, Any] = {}
    for name, limit in _LIMITS:
        value, option = getattr(options, name), f"--{name.replace('_', '-')}"
        if value is not None and limit in ("GN", "GT"):
            given[limit] = share_of_one(option, value)
        elif value is not None:
            given[limit] = positive_number(option, value, zero_allowed=limit in ("clearance", "foot_lift"))
    tolerance = given_tolerance(options) if hasattr(options, "tolerance") else None
    return given if tolerance is None else {**given, "uncertainty": tolerance}


def given_tolerance(options: Namespace) -> Uncertainty | None:
    """The uncertainty from option `--tolerance`; None without that option."""
    if options.tolerance is None:
        return None
    with naming("--tolerance"):
        return load_tolerance(options.tolerance)


def with_cancel(task: Task, options: Namespace) -> Task:
    """The task with the deceleration and the reaction time of a cancelled controller, as typed."""
    text, reaction, base = options.deceleration, options.reaction, getattr(options, "base_deceleration", None)
    if text is None and reaction is None and base is None:
        return task

    def changed(motion_task: MotionTask) -> MotionTask:
        given: dict[str, Any] = {}
        if reaction is not None:
            given["reaction"] = 1e-3 * positive_number("--reaction", reaction, zero_allowed=True)
        if base is not None:
            given["base_deceleration"] = positive_number("--base-deceleration", base, zero_allowed=True)
        if text is not None:
            law = re.fullmatch(r"(?P<share>[^,]+)%|stopj(?:\((?P<stopj>[^,]+)\))?|(?P<rates>.+)", text)
            kind = law.lastgroup if law else ""
            words = law[kind].split(",") if law and kind else [str(motion_task.stops.STOPJ)]
            try:
                numbers = [positive_number("--deceleration", float(word)) for word in words]
            except ValueError:
                reason = f"expected numbers, a share such as 46%, or stopj(4), got {text!r}"
                raise InputError(reason, "--deceleration") from None
            given |= {"share": 1.0, "deceleration": None, "stopj": None}
            if kind == "share":
                given["share"] = numbers[0] / 100
            elif text.startswith("stopj"):
                given["stopj"] = numbers[0]
            else:
                n, units = motion_task.robot.n, motion_task.robot.units
                if len(numbers) not in (1, n):
                    raise InputError(f"expected 1 or {n} numbers, got {len(numbers)}", "--deceleration")
                scales = np.array([np.pi / 180 if unit == "rad" else 1.0 for unit in units])
                given["deceleration"] = scales * np.array(numbers)
        stops, limits = replace(motion_task.stops, **given), motion_task.limits
        if limits.cancel is not None:  # as the file asks for, of an arm
            limits = replace(limits, cancel=stops.cancel(cast("Robot", motion_task.robot), limits))
        return replace(motion_task, stops=stops, limits=limits)

    return task.each(changed)


def taken(options: Namespace, names: str) -> dict[str, Any]:
    """Options by these names, with spaces between them, as arguments of a function of the same names."""
    return {name: getattr(options, name) for name in names.split()}


def typed(options: Namespace, *names: str) -> list[str]:
    """Those of these options that are given."""
    return [name for name in names if getattr(options, name) is not None]


@contextmanager
def naming_options(*arguments: str) -> Iterator[None]:
    """Call arguments as options are typed, in every InputError of the block that is about one of them."""
    try:
        yield
    except InputError as error:
        if error.path not in arguments:
            raise
        raise InputError(error.text, f"--{error.path.replace('_', '-')}", error.file) from None


def require_least(options: Namespace, **least: int) -> None:
    """Raise InputError if an option that is given is below its minimum; names it as it is typed."""
    for name, bound in least.items():
        value = getattr(options, name)
        if value is not None and value < bound:
            raise InputError(f"--{name}: must be >= {bound}, got {value}")


def output_directory(options: Namespace, name: str, source: TaskSource | None = None) -> Path:
    """Where files go; InputError before anything is computed if they cannot be written there.

    The same if they would replace files that an earlier run of the command did not write.

    Args:
        options: of the command.
        name: of the task.
        source: of the task, which is written with all that it names.
    """
    stem = re.sub(r"[^\w.-]+", "-", name)
    path = Path(options.out or f"ocptip-{options.command}-{stem}")
    if options.out and getattr(options, "many", False):
        path = path / stem
    if path.exists() and not path.is_dir():
        raise InputError(f"--out: {path} is not a directory")
    if not path.parent.is_dir():
        raise InputError(f"--out: no such directory: {path.parent}")
    place = path if path.is_dir() else path.parent
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix=".ocptip-"):
            pass
    except OSError as error:
        raise InputError(f"--out: cannot write into {place}: {error.strerror}") from None
    further = source.places if source else ()
    with naming("--out"):
        require_replaceable(path, options.command, further, overwrite=options.overwrite)
    return path


class _Requirable(Protocol):
    def require(self, text: str) -> tuple[Outcome, ...]: ...


def read_gate(options: Namespace) -> None:
    """Refuse requirements that cannot be understood, before anything is computed."""
    if options.require is not None:
        read_requirements(options.require)


def gate_of(options: Namespace, requirable: _Requirable) -> dict[str, Any]:
    """The fields of a `GatedReport` from the options and the answer."""
    outcomes = () if options.require is None else requirable.require(options.require)
    return {"outcomes": outcomes, "junit": options.junit}


@dataclass
class GatedReport(Report):
    """An answer with requirements.

    Attributes:
        outcomes: of the requirements.
        junit: file of the report for pipelines; None: not asked for.
    """

    outcomes: tuple[Outcome, ...] = field(default=(), kw_only=True)
    junit: str | None = field(default=None, kw_only=True)

    @property
    @abstractmethod
    def kept(self) -> bool:
        """Whether the answer is yes, apart from requirements."""

    @property
    @abstractmethod
    def headline(self) -> str:
        """The first line: a name, three spaces, and the verdict."""

    @property
    def broken(self) -> Sequence[str]:
        """The broken limits, one sentence each."""
        return ()

    @property
    def good(self) -> bool:
        """Whether the answer is yes, and all requirements are met."""
        return self.kept and all(one.met for one in self.outcomes)

    @property
    def unmet(self) -> list[str]:
        """Requirements that are not met, or that all are."""
        unmet = [f"{one}" for one in self.outcomes if not one.met]
        return unmet or ["all requirements met"] * bool(self.outcomes)

    def gate_to_dict(self) -> dict[str, Any]:
        """The entry of the requirements for JSON."""
        return outcomes_to_dict(self.outcomes)

    def write(self) -> Iterator[Path]:
        """Write the report for pipelines, if one is wanted."""
        if self.junit is not None:
            name, _, verdict = self.headline.partition("   ")
            text = "; ".join([verdict, *self.broken])
            write_text(self.junit, junit(name, text, self.kept, self.outcomes))
            yield Path(self.junit)
