"""Files of a plan, of a motion or a cycle: plan.json, motion.csv, trajectory.json, proofs, the task."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from ocptip.basics.toml import toml_text
from ocptip.basics.write import plain, versions
from ocptip.motion.cycles.check import CycleCheck, cycle_check, segments_of
from ocptip.motion.cycles.task import CycleTask, Task, freed_offset
from ocptip.motion.files.execution import Execution
from ocptip.motion.files.output import (
    CERTIFICATE,
    MOTION,
    PLAN,
    TRAJECTORY,
    csv_blocks,
    csv_text,
    joint_trajectory,
    plan_to_dict,
    sample_motion,
    write_folder,
)
from ocptip.motion.files.source import TASK, TaskSource, source_of, stop_keys, tolerance_table
from ocptip.motion.motion_plan import MotionPlan
from ocptip.standing.samples import MotionSamples
from ocptip.trajectories.bags import write_bag
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.points import Points
from ocptip.trajectories.sequence import joined
from ocptip.trajectories.trajectory import Trajectory

_ONCE = ("case", "task_file", "versions", "options", "seed", "assumed")


def write_plan(
    directory: str | os.PathLike[str],
    plan: MotionPlan,
    *,
    executions: Sequence[Execution] | None = None,
    samples: Sequence[MotionSamples] | None = None,
    effort: bool = False,
    extra: Mapping[str, Any] | None = None,
) -> list[Path]:
    """Write plan.json, motion.csv, trajectory.json, the task and the hashes of all; old ones are replaced.

    If there is a certificate, certificate.json is among them; those of the segments of a cycle are
    certificate-1.json and so on. A cycle whose planning was interrupted before all segments had a plan gets
    no trajectory.json. The task and the files that it names are left out in two cases: it was made in Python,
    or its robot was changed since it was read.

    Args:
        directory: made if it does not exist; the one above it must.
        plan: the plan.
        executions: what runs the segments; motion.csv and trajectory.json are of their motions. Default:
            drives with velocity profiles or S-curves, and trajectory.json is for a controller that runs them
            exactly.
        samples: of :func:`task_samples`; computed if None.
        effort: see `ocptip.motion.files.output.joint_trajectory`.
        extra: more entries of plan.json; they win.

    Returns:
        The paths.

    Raises:
        OSError: a file or the directory cannot be written; names it.
    """
    task = plan.task
    executions = executions or drives_of(plan)
    motion = run_by(plan, executions)
    samples = samples or task_samples(task, motion)
    check = cycle_check(plan.finished, motion, [run.check for run in executions])
    blocks = csv_blocks(samples_joined(samples))
    if task.is_cycle:
        number = np.repeat(np.arange(1, len(samples) + 1), [len(sample.times) for sample in samples])
        blocks.append(("segment", number))
    data = {**planned_to_dict(plan, executions, check), **plain(dict(extra or {}))}
    texts = {PLAN: json.dumps(data, indent=2, allow_nan=False) + "\n", MOTION: csv_text(blocks)}
    if plan.complete:
        points = _trajectory(task, motion.pauses, executions, effort=effort)
        texts[TRAJECTORY] = json.dumps(points, allow_nan=False) + "\n"
    for number, run in enumerate(executions, 1):
        if (certificate := run.check.certificate) and certificate.data:
            name = CERTIFICATE.replace(".", f"-{number}.") if task.is_cycle else CERTIFICATE
            texts[name] = json.dumps(certificate.data, allow_nan=False) + "\n"
    source = source_of(task)
    return write_folder(Path(directory), texts, source, _task_text(task, source) if source else "")


def drives_of(plan: MotionPlan) -> list[Execution]:
    """The execution of each segment if drives follow the commands as they are."""
    return [Execution.of_drives(p.task.robot, p.motion, p.task.limits, p.check) for p in plan.parts]


def run_by(plan: MotionPlan, executions: Sequence[Execution]) -> Trajectory:
    """The motion that is run, of a cycle with the rests between its segments."""
    motions = [run.motion for run in executions]
    return Trajectory.from_segments(motions, plan.motion.pauses) if plan.segments else motions[0]


def planned_to_dict(plan: MotionPlan, executions: Sequence[Execution], check: CycleCheck) -> dict[str, Any]:
    """Return a plan, and by what it is run, as plain data for strict JSON.

    That of a motion is `plan_to_dict`. Of a cycle, `segments` holds that of each segment, in times from its
    begin. Further keys there are `name`, `begin_s`, `rest_s`, `rest_energy_J`, and `goal_offset_m` where the
    goal's pose is free. All else is of the whole, in times from the first begin.
    """
    if not plan.task.is_cycle:
        return plan_to_dict(plan, executions[0])
    data, task = check.to_dict(), cast(CycleTask, plan.task)
    rows = [
        {
            **{key: row[key] for key in ("name", "begin_s", "rest_s", "rest_energy_J")},
            **_freed(task, end, part),
            **{key: value for key, value in plan_to_dict(part, execution).items() if key not in _ONCE},
        }
        for end, (row, part, execution) in enumerate(
            zip(data.pop("segments"), plan.parts, executions, strict=True), 1
        )
    ]
    return plain(
        {
            "case": plan.task.name,
            **data,
            "verified": plan.complete and check.whole.verified,
            "certified": plan.complete and check.whole.certified,
            "task_file": TASK if source_of(plan.task) else None,
            "closed": task.closed,
            "missing": [segment.name for segment in plan.task.segments[len(plan.parts) :]],
            "segments": rows,
            "iterations": sum(start.iterations for start in plan.starts),
            "seconds": plan.seconds,
            "interrupted": plan.interrupted,
            "seed": plan.seed,
            "options": plan.options,
            "assumed": plan.task.robot.notes,
            "versions": versions(),
        }
    )


def _freed(task: CycleTask, end: int, part: MotionPlan) -> dict[str, Any]:
    """Where in its ranges the pose of an end is."""
    result = freed_offset(task.ends[end][2], task.robot, part.motion.goal)
    return {"goal_offset_m": result} if result else {}


def task_samples(task: Task, motion: Trajectory) -> list[MotionSamples]:
    """Samples of every segment as `sample_motion` takes them, and of both ends of the rest after it.

    Times are those of the cycle. Each segment is sampled with the robot of this segment.
    """
    results = []
    for segment, segment_motion, begin, pause in zip(
        task.segments, motion.segments, motion.begins, motion.pauses, strict=False
    ):
        robot = segment.task.robot
        parts = [sample_motion(robot, segment_motion)]
        if pause:
            still = np.zeros((2, robot.n))
            ends = segment_motion.end + np.array([0.0, pause])
            parts.append(robot.samples_of(ends, np.tile(segment_motion.goal, (2, 1)), still, still))
        whole = samples_joined(parts)
        results.append(dataclasses.replace(whole, times=begin + whole.times))
    return results


def save_bag(task: Task, motion: Trajectory, path: str | os.PathLike[str]) -> None:
    """Write trajectory, joint states and the columns of `motion.csv` over time as a bag of ROS 2 (MCAP).

    Args:
        task, motion: see `task_samples`.
        path: of the folder, which must not exist; see `ocptip.trajectories.bags.write_bag` for the topics.

    Raises:
        InputError: it exists, cannot be written, or `rosbags` is missing.
    """
    whole = segments_of(task, motion)
    points = [one.points or cast(Points, controller_points(one, "cubic").points) for one in whole.segments]
    samples = samples_joined(task_samples(task, whole))
    joints = {"position": samples.angles, "velocity": samples.speeds, "effort": samples.torques}
    of_joints = re.compile(r"time_s|(q|qd|qdd|tau)\d+_.*")
    columns = {name: values for name, values in csv_blocks(samples) if not of_joints.fullmatch(name)}
    message = joint_trajectory(task.segments[0].task.robot, joined(points, whole.pauses))
    write_bag(path, message, samples.times, joints, columns)


def samples_joined(parts: Sequence[Any]) -> Any:
    """Samples, or states or margins in them, one after the other: arrays by rows, all else of the first."""
    first = parts[0]
    values = {}
    for field in dataclasses.fields(first):
        arrays = [getattr(part, field.name) for part in parts]
        if isinstance(arrays[0], np.ndarray):
            values[field.name] = np.concatenate(arrays)
        elif field.name in ("states", "tip", "slip"):
            values[field.name] = samples_joined(arrays)
        elif field.name == "status":
            values[field.name] = tuple(text for status in arrays for text in status)
    return dataclasses.replace(first, **values)


def _trajectory(
    task: Task, pauses: Sequence[float], executions: Sequence[Execution], *, effort: bool = False
) -> dict[str, Any]:
    """One `trajectory_msgs/JointTrajectory` of a cycle; see `joint_trajectory`.

    Args:
        task: gives names, and efforts by segment.
        pauses: s, after each segment.
        executions: of the segments.
        effort: fill in the joint torques, N m; at seams those with what was held before.
    """
    if not task.is_cycle:
        return joint_trajectory(task.robot, executions[0].points, effort=effort)
    points = [execution.points for execution in executions]
    whole, parts = joined(points, pauses), [Trajectory(points=execution) for execution in points]
    data = joint_trajectory(task.robot, whole)
    if effort:
        run, begins = Trajectory(points=whole), Trajectory.from_segments(parts, pauses).begins
        owner = np.clip(np.searchsorted(begins, whole.times - 1e-9) - 1, 0, len(parts) - 1)
        for number, segment in enumerate(task.segments):
            rows = np.flatnonzero(owner == number)
            torques = segment.task.robot.samples(run, whole.passing_times[rows]).torques
            for row, values in zip(rows, torques.tolist(), strict=True):
                data["points"][row]["effort"] = values
    return data


def _task_text(task: Task, source: TaskSource) -> str:
    """The task's file with the limits and objectives of the task, which replace those of the file."""
    if not task.is_cycle:
        rises = cast(tuple[float, ...] | None, task.segments[0].task.rise_times)
        return source.text(task.name, task.limits, task.objective, rises)
    rows = []
    for row, segment in zip(source.data["segment"], task.segments, strict=True):
        limits, objective = segment.task.limits, segment.task.objective
        row_data = {key: value for key, value in row.items() if key != "price_per_second"}
        row_data |= {"limits": limits.in_files, "objective": objective.name}
        price = {"price_per_second": objective.time_weight} if objective.name == "both" else {}
        rows.append({**row_data, **price})
    data = {key: value for key, value in source.data.items() if key != "tolerance"}
    tolerance = tolerance_table(task.limits, task.robot)
    if any(segment.task.limits.stoppable for segment in task.segments):  # GN and GT are those of the file
        asked = {
            key: value for key, value in stop_keys(task.limits, task.robot).items() if key not in ("GN", "GT")
        }
        data["stops"] = {**data.get("stops", {}), **asked}
    return toml_text({"name": task.name, **data, "tolerance": tolerance, "segment": rows})
