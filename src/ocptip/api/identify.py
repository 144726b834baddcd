"""`ocptip.identify`: parameters of a machine out of recordings, as tables of a task file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from ocptip.basics.errors import InputError, doubt, naming, positive_number
from ocptip.basics.read import read_text
from ocptip.basics.text import some
from ocptip.basics.toml import toml_text
from ocptip.basics.write import MARK, versions, write_text
from ocptip.measured.bodies import BASE, PAYLOAD, identify_bodies, tables
from ocptip.measured.excitation import Excitation, excite
from ocptip.measured.links import Identified, identify_links, mass_tolerance
from ocptip.measured.power_maps import PowerMap, fit_power_map, motors_table, samples_by_joint
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import Recording, doubt_turns, read_recording
from ocptip.measured.signals import gaps
from ocptip.motion.task import MotionTask
from ocptip.standing.tolerance import DEFAULT
from ocptip.task_files.cycle import read_task
from ocptip.task_files.plan_folder import PlanFolder, arm_of, read_plan_folder
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.read_csv import csv_table

What = Literal["payload", "base", "bodies", "arm", "power"]

SIGMAS = 3.0
"""Standard errors that tolerances cover by default."""
_BODIES = {"payload": (PAYLOAD,), "base": (BASE,), "bodies": (PAYLOAD, BASE)}
_INSTANTS = 1000
_FAR, _WORSE = 5.0, 1.2  # standard errors, and rms over that of plain least squares, that are a contradiction


def identify(
    recording: str | os.PathLike[str],
    plan: PlanFolder | str | os.PathLike[str] | None = None,
    *,
    what: What = "payload",
    task: str | os.PathLike[str] | None = None,
    unit: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    topics: Sequence[str] = (),
    tared: bool = False,
    sigmas: float | None = None,
    bandwidth: float | None = None,
) -> Identification:
    """Identify parameters of a machine from a recording of a plan that it ran.

    Example::

        ocptip.identify("recording.csv", "ocptip-plan-A", what="payload").tables["payload"]

    Args:
        recording: file of the recording (docs/identify.md); for "power" samples of power, torque and speed.
        plan: the folder of the plan that was run, or what was read from it; with `task` the file of a motion.
            For "power" it may be left out.
        what: "payload" or "base" by a force-torque sensor or the contacts' normal forces, "bodies" for both,
            "arm" by joint torques, "power" for power maps of the drives.
        task: task file of the robot, where `plan` is a motion.
        unit, columns, topics: see `ocptip.compare`.
        tared: the sensor was set to zero at the start.
        sigmas: standard errors that tolerances cover; default 3.
        bandwidth: Hz, of a filter of the torques ("arm"), or of the sensor or the feet; infinite for none;
            default: identified.

    Raises:
        InputError: a file or an argument cannot be used; one line.

    Warns:
        InputWarning: samples are missing, or the model does not fit.
    """
    if what == "power":
        return _power(Path(recording), None if plan is None else _predictor(plan, task))
    if what != "arm" and what not in _BODIES:
        raise InputError(f"what: expected payload, base, bodies, arm or power, got {what!r}")
    if plan is None:
        raise InputError(f"identify {what}: needs PLAN_DIR, the folder of the plan that was run")
    if bandwidth is not None and bandwidth != math.inf:
        positive_number("bandwidth", bandwidth)
    predictor = _predictor(plan, task)
    measured = read_recording(recording, predictor.robot, unit=unit, columns=columns, topics=topics)
    doubt_turns(measured, predictor.robot, predictor.motion)
    for gap in gaps(measured):
        doubt(f"{gap.name}: {gap.text}")
    sigmas = SIGMAS if sigmas is None else sigmas
    with naming(Path(recording).name):
        if what != "arm":
            names = _BODIES[what]
            bodies = identify_bodies(measured, predictor, names, tared=tared, bandwidth=bandwidth)
            return Identification(what, tables(bodies, sigmas), bodies.to_dict(), bodies, sigmas)
        links = identify_links(measured, predictor, bandwidth=bandwidth)
        _doubt_plain(links, measured)
        share = mass_tolerance(links, predictor, sigmas)
        tolerance = {} if share is None else {"tolerance": {"arm_mass": share}}
        named = {**links.to_tables(predictor.robot.motors), **tolerance}
        return Identification(what, named, links.to_dict(), links, sigmas, measured, predictor)


def _predictor(plan: PlanFolder | str | os.PathLike[str], task: str | os.PathLike[str] | None) -> Predictor:
    """The predictor of the folder of a plan, or of a motion file and a task."""
    name = str(plan.path) if isinstance(plan, PlanFolder) else str(plan)
    if task is None:
        folder = read_plan_folder(plan)
        robot, motion = folder.of_arm("identify takes")
    else:
        given = read_task(task)
        robot = arm_of(given, "identify takes", Path(task))
        motion = load_motion(name, robot.names, robot.units, start=given.start, several=True)
        if motion.parts:
            raise InputError("is a cycle; identify takes single motions", "", name)
    with naming(name):
        return Predictor(robot, motion)


def _power(path: Path, predictor: Predictor | None) -> Identification:
    """Maps of all drives."""
    with naming(path.name):
        samples = samples_by_joint(*csv_table(read_text(path)))
        if list(samples) != list(range(1, len(samples) + 1)):
            raise InputError(
                f"column joint: expected 1 to {max(samples)}, got {', '.join(map(str, samples))}"
            )
        maps = []
        for joint, joint_map in samples.items():
            with naming(f"joint {joint}"):
                maps.append(fit_power_map(*joint_map))
        if predictor is not None and predictor.robot.n != len(maps):
            raise InputError(f"maps of {len(maps)} joints, the plan's robot has {predictor.robot.n}")
    data = {"maps": [joint_map.to_dict() for joint_map in maps]}
    return Identification("power", {"motors": motors_table(maps)}, data, maps, SIGMAS, predictor=predictor)


def _doubt_plain(identified: Identified, recording: Recording) -> None:
    """Warn where plain least squares says something else: then the model of the recording does not hold."""
    fit = identified.estimate
    names = [*identified.names]
    names += [
        f"{word} friction {j + 1}" for word in ("dry", "viscous") for j in range(len(identified.coulomb))
    ]
    far = int(np.argmax(fit.away))
    worse = [
        f"{recording.of(kind)[number].name} {rms:.3g} instead of {plain:.3g}"
        for kind, number, rms, plain in fit.signals
        if rms > _WORSE * plain
    ]
    if fit.away[far] > _FAR or worse:
        left = f"; it leaves more over: {', '.join(worse)}" if worse else ""
        doubt(
            f"arm: plain least squares contradicts the estimate, most in {names[far]} ({fit.away[far]:.1f} "
            f"standard errors){left}; something is not in the model, such as a filter of the torques "
            "(--bandwidth), elastic joints, or friction that depends on load"
        )


def beyond_samples(maps: Sequence[PowerMap], predictor: Predictor) -> list[float]:
    """Per joint, the share of the plan's motion that is beyond the samples of its power map."""
    times = np.linspace(0.0, predictor.motion.end, _INSTANTS)
    state = predictor.state(times, np.zeros(len(maps)), np.zeros(4 * predictor.robot.arm.links + 1))
    return [
        float(index_map.outside(state.torques[:, j], state.qd[:, j]).mean())
        for j, index_map in enumerate(maps)
    ]


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """The parameters that were identified.

    Attributes:
        what: was asked for.
        tables: of a task file, with tolerances.
        data: all numbers, with covariances.
        source: bodies, links or power maps, see `ocptip.measured`.
        sigmas: standard errors that tolerances cover.
        recording: of links; else None.
        predictor: of the plan, where it is needed to read the result; else None.
    """

    what: What
    tables: Mapping[str, Any]
    data: Mapping[str, Any]
    source: Any
    sigmas: float
    recording: Recording | None = None
    predictor: Predictor | None = None

    def __repr__(self) -> str:
        """The subject of the identification, and the names of the tables."""
        return f"<Identification {self.what}: tables {some(list(self.tables))}>"

    def to_dict(self) -> dict[str, Any]:
        """Values, covariances, and the tables."""
        return {"identified": self.what, **self.data, "tables": self.tables, "versions": versions()}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the tables, to be put into a task file; returns the path."""
        write_text(Path(path), f"# {MARK}: tables of a task file\n{toml_text(self.tables)}")
        return Path(path)


def motion_for_identification(task: MotionTask | str | os.PathLike[str], *, seed: int = 0) -> ExcitingMotion:
    """Return a motion of a task's robot, within its limits, that tells the parameters of its links.

    Args:
        task: a task or its file.
        seed: of the search.

    Raises:
        InputError: the task cannot be used; one line.
    """
    is_file = isinstance(task, str | os.PathLike)
    given = read_task(task, DEFAULT) if is_file else task
    name = Path(task).name if is_file else given.name
    if given.is_cycle:
        raise InputError("is a cycle; motions for identification start at one pose", "", str(task))
    given.robot.require_no_objects("identify")
    with naming(name):
        return ExcitingMotion(given.name, excite(cast(MotionTask, given), seed=seed))


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion:
    """A motion for identification.

    Attributes:
        name: of the task.
        found: the motion, its check, and how well it tells parameters.
    """

    name: str
    excitation: Excitation

    def __repr__(self) -> str:
        """Duration and condition."""
        result = self.excitation
        return f"<ExcitingMotion {self.name}: {result.motion.end:.3g} s, condition {result.condition:.0f}>"

    def to_dict(self) -> dict[str, Any]:
        """The motion and its condition number, as plain data for JSON."""
        result = self.excitation
        return {
            "task": self.name,
            "duration_s": result.motion.end,
            "condition": result.condition,
            "random_condition": result.random,
            "slower": result.slower,
            "smaller": result.smaller,
            "check": result.check.to_dict(),
            "versions": versions(),
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write its samples as CSV; returns the path."""
        points = self.excitation.motion.points
        assert points is not None
        assert points.speeds is not None
        assert points.accelerations is not None  # they were sampled from a formula
        numbers = range(1, self.excitation.motion.n + 1)
        kinds = (
            ("q{}_rad", points.angles),
            ("qd{}_rad_s", points.speeds),
            ("qdd{}_rad_s2", points.accelerations),
        )
        head = ["time_s", *(name.format(k) for name, _ in kinds for k in numbers)]
        rows = np.column_stack([points.times, *(values for _, values in kinds)])
        lines = [",".join(head), *(",".join(map(repr, row)) for row in rows.tolist())]
        write_text(Path(path), "\n".join(lines) + "\n")
        return Path(path)
