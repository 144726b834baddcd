"""Files of a plan: motion, task, hashes of all. Every file appears complete or not at all.

Inside the library: SI units and rad; in plan.json and motion.csv: degrees, as their keys say; in
trajectory.json: rad, as ROS wants. Lengths, such as the platform's coordinates of a parallel robot, are in
metres everywhere.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ocptip.basics.errors import positive_number
from ocptip.basics.outputs import replace_folder
from ocptip.basics.write import plain, versions, write_text
from ocptip.motion.files.execution import Execution
from ocptip.motion.files.source import TASK, TaskSource, source_of
from ocptip.motion.violations import stated
from ocptip.reserves.equal_compliance import reported_normal_forces
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.samples import MotionSamples
from ocptip.trajectories.pieces import MERGE
from ocptip.trajectories.points import Points
from ocptip.trajectories.trajectory import INSIDE, Trajectory

if TYPE_CHECKING:
    from ocptip.motion.motion_plan import MotionPlan

CLOSE = 0.1  # of a step: nearer to events there are no further samples
STEP = 0.005
"""Spacing of the samples in motion.csv and in the figures, s."""

PLAN, MOTION, TRAJECTORY = "plan.json", "motion.csv", "trajectory.json"
CERTIFICATE = "certificate.json"

_START_KEYS = {
    "number": "number",
    "status": "status",
    "energy": "energy_J",
    "verified": "verified",
    "iterations": "iterations",
    "solves": "solves",
    "hops": "hops",
    "seconds": "seconds",
}


def plan_to_dict(plan: MotionPlan, execution: Execution | None = None) -> dict[str, Any]:
    """Return a plan, and by what it is run, as plain data for strict JSON; what is not finite is None.

    `start` (degrees), `commands` (degrees and seconds) and `rise_time_s` are read back by
    `Trajectory.from_dict`; if some coordinates are lengths, `units` says which. `worst` holds per quantity
    `value`, `time` (s), `limit` and `detail`; the exact limits of the velocity profiles have no time.
    `reference` holds energy and duration of the task's reference motion and the ratio of the plan's energy to
    it, or is None.
    """
    checked, units = plan.check, plan.task.robot.units
    if execution is not None and execution.controller == "ramps":
        checked = execution.check  # with its certificate
    motion = plan.motion.to_dict(units)
    goal = plan.motion.goal
    data = {
        "case": plan.task.name,
        **({"base": plan.options["base"]} if "base" in plan.options else {}),
        "task_file": TASK if source_of(plan.task) else None,
        "objective": plan.task.objective.to_dict(),
        "energy_J": checked.energy,
        "duration_s": checked.duration,
        "verified": checked.verified,
        **{key: checked.to_dict()[key] for key in ("certified", "certificate")},
        "violations": stated(checked.violations),
        "worst": checked.to_dict()["worst"],
        **plan.task.robot.masses_to_dict(),
        "contacts": checked.contacts.to_dict(),
        **checked.objects_to_dict(),
        **({"feet": checked.feet.to_dict()} if checked.feet else {}),
        **({"drives": checked.drives.to_dict()} if checked.drives else {}),
        "collision": checked.collision,
        **({"within_tolerance": checked.within.to_dict()} if checked.within else {}),
        **({"units": motion["units"]} if "units" in motion else {}),
        "start": motion["start"],
        "goal": np.where(np.array(units) == "rad", np.rad2deg(goal), goal),
        **({"path": motion["path"]} if "path" in motion else {"commands": motion["commands"]}),
        "rise_time_s": motion.get("rise_time_s", 0.0),
        "starts": [{key: getattr(s, name) for name, key in _START_KEYS.items()} for s in plan.starts],
        "best": plan.best,
        "iterations": sum(s.iterations for s in plan.starts),
        "seconds": plan.seconds,
        "interrupted": plan.interrupted,
        "seed": plan.seed,
        "options": plan.options,
        "assumed": plan.task.robot.notes,
        **({"slower_to_prove": plan.slower} if plan.slower > 1 else {}),
        "reference": _reference(plan),
        "versions": versions(),
        **({"controller": execution.to_dict()} if execution and execution.controller != "ramps" else {}),
        **({"trajectory": execution.trajectory_to_dict()} if execution and execution.written else {}),
    }
    return plain(data)


def sample_motion(robot: StandingMechanism, motion: Trajectory, step: float = STEP) -> MotionSamples:
    """Sample a motion every `step` seconds and on both sides of every switching time.

    At switching times inside the motion accelerations, torques, power and margins have steps: these times
    appear twice, first with the limit from the left, then with that from the right.

    Args:
        robot: the arm on its support.
        motion: of its joints.
        step: s.

    Raises:
        InputError: step is not positive, or the motion does not fit the arm.
    """
    times, left = _instants(motion, step)
    intervals = _intervals(motion, times, left)
    samples = robot.during(motion).samples(cast(Trajectory, _OneSided(motion, intervals)), times)
    if not robot.direct_drives:
        return samples
    # Power jumps where a speed changes sign. At the crossing itself the speed is 0 up to rounding, so that
    # its sign has to come from inside the interval.
    _, speeds, _ = motion.states(intervals.mean(axis=1))
    powers = robot.motors.power(samples.torques, samples.speeds, np.where(speeds < 0, -1.0, 1.0))
    return dataclasses.replace(samples, powers=powers)


def write_motion_csv(path: str | os.PathLike[str], samples: MotionSamples) -> None:
    """Write samples as a table, one line per instant; the header names quantities and units.

    Columns, joints and contacts counted from 1: `time_s`; per joint `q1_deg`, `qd1_deg_s`, `qdd1_deg_s2`,
    `tau1_Nm`, `power1_W` (all joints of one quantity, then the next); `GN`, `GT`, `clearance_m`; per contact
    `normal1_N` (of equally compliant feet where rigid ones leave it open), `friction_use1` (in the best
    sharing; nan for a contact without load); `total_power_W`, the sum of all drives; the gripper's pose in
    the base frame, `gripper_x_m` and so on and its axes as a quaternion `gripper_qx`, `gripper_qy`,
    `gripper_qz`, `gripper_qw`; what a force-torque sensor in the base measures, `sensor_fx_N` and so on,
    `sensor_mx_Nm` and so on, under the name that `sensor` has, see `standing.sensor.WrenchSensor`. See
    :func:`sample_motion` for times that appear twice. Coordinates that are lengths have m for deg, linear
    motors N for Nm; further quantities of the mechanism follow at the end under their names.

    Raises:
        OSError: the file cannot be written; names it.
    """
    write_text(path, csv_text(csv_blocks(samples)))


def joint_trajectory(robot: StandingMechanism, points: Points, *, effort: bool = False) -> dict[str, Any]:
    """Return points shaped like a ROS `trajectory_msgs/JointTrajectory`, angles in rad.

    Args:
        robot: gives names and efforts.
        points: velocities and accelerations are empty where they have none, which tells a controller how to
            interpolate.
        effort: fill in the joint torques, N m, the last ones at rest. Controllers without an effort interface
            refuse such points.
    """
    empty = np.empty((len(points.times), 0))
    columns = {
        "positions": points.angles,
        "velocities": empty if points.speeds is None else points.speeds,
        "accelerations": empty if points.accelerations is None else points.accelerations,
        "effort": robot.samples(Trajectory(points=points), points.passing_times).torques if effort else empty,
    }
    rows = zip(*(values.tolist() for values in columns.values()), points.times, strict=True)
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(robot.names),
        "points": [
            {**dict(zip(columns, values, strict=True)), "time_from_start": _ros_time(time)}
            for *values, time in rows
        ],
    }


def write_folder(
    directory: Path, texts: Mapping[str, str], source: TaskSource | None, task: str
) -> list[Path]:
    """Write the files of a plan, its task and what that names, and their hashes; returns the paths.

    Args:
        directory: made if it does not exist; files of an earlier plan that are not written again go.
        texts: by name.
        source: of the task, if there is one.
        task: content of the task's file.

    Raises:
        InputError: see `ocptip.basics.outputs.replace_folder`.
        OSError: a file or the directory cannot be written; names it.
    """
    contents = {name: text.encode("utf-8") for name, text in texts.items()}
    if source:
        contents[TASK] = task.encode("utf-8")
        contents |= {source.place(name): content for name, content in source.files.items()}
    return replace_folder(directory, contents)


class _OneSided:
    """A motion whose accelerations at N given instants are limits from inside their intervals, (N, 2), s.

    Not simply those from one side of the instant: switching times within 0.1 us, as of joints that end
    together up to rounding, are one, but between them some joints have switched and others not.
    """

    def __init__(self, motion: Trajectory, intervals: np.ndarray) -> None:
        self._motion, self._intervals = motion, intervals

    def __getattr__(self, name: str) -> Any:
        return getattr(self._motion, name)

    def states(self, times: np.ndarray, **_: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        begin, end = self._intervals.T
        margin = np.minimum(INSIDE, 0.5 * (end - begin))
        angles, speeds = self._motion.states(times)[:2]
        return angles, speeds, self._motion.states(np.clip(times, begin + margin, end - margin))[2]


def _instants(motion: Trajectory, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,), s, sorted; and (N,) True where the limit from the left is meant."""
    step, events = positive_number("step", step), motion.event_times
    if len(events) < 2:
        return events, np.array([False])
    grid = step * np.arange(1, math.ceil(motion.end / step))
    after = np.clip(np.searchsorted(events, grid), 1, len(events) - 1)
    near = np.minimum(np.abs(grid - events[after]), np.abs(grid - events[after - 1]))
    grid = grid[near > max(MERGE, CLOSE * step)]
    times = np.concatenate([events[:-1], grid, events[1:]])
    left = np.repeat([False, True], [len(times) - len(events) + 1, len(events) - 1])
    order = np.lexsort((~left, times))
    return times[order], left[order]


def _intervals(motion: Trajectory, times: np.ndarray, left: np.ndarray) -> np.ndarray:
    """The interval between switching times of each instant, (N, 2), s; at one of these the interval before it
    if `left`.
    """
    intervals = motion.intervals if len(motion.event_times) > 1 else np.array([[0.0, 0.0]])
    before, upto = (np.searchsorted(intervals[:, 0], times, side=side) for side in ("left", "right"))
    return intervals[np.where(left, before, upto) - 1]


def csv_blocks(samples: MotionSamples) -> list[tuple[str, np.ndarray]]:
    """Columns of motion.csv, see :func:`write_motion_csv`: name and values (N,) each."""
    n, contacts = samples.angles.shape[1], samples.slip.usage.shape[1]
    blocks: list[tuple[str, np.ndarray]] = [("time_s", samples.times)]
    units = ["m" if unit == "m" else "deg" for unit in samples.units or ("rad",) * n]
    motors = [unit.replace(" ", "") for unit in samples.motor_units or ("N m",) * n]
    for name, values in (
        ("q{}_{}", samples.angles),
        ("qd{}_{}_s", samples.speeds),
        ("qdd{}_{}_s2", samples.accelerations),
    ):
        for j, unit in enumerate(units):
            column = values[:, j] if unit == "m" else np.rad2deg(values[:, j])
            blocks.append((name.format(j + 1, unit), column))
    blocks += [(f"tau{j + 1}_{unit}", samples.torques[:, j]) for j, unit in enumerate(motors)]
    blocks += [(f"power{j + 1}_W", samples.powers[:, j]) for j in range(n)]
    blocks += [("GN", samples.tip.GN), ("GT", samples.slip.GT), ("clearance_m", samples.clearances)]
    for name, values in (
        ("normal{}_N", reported_normal_forces(samples.states)),
        ("friction_use{}", samples.slip.usage),
    ):
        blocks += [(name.format(k + 1), values[:, k]) for k in range(contacts)]
    blocks.append(("total_power_W", samples.total_power))
    if samples.gripper.size:
        names = [f"gripper_{name}" for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")]
        blocks += zip(names, _steady(samples.gripper).T, strict=True)
    names = [f"{samples.sensor_name}_{name}" for name in ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")]
    blocks += zip(names, samples.sensor.T, strict=True)
    return [*blocks, *zip(samples.further_names, samples.further.T, strict=True)]


def _steady(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 7) whose quaternions, the same up to sign, are continuous from one to the next."""
    axes = poses[:, 3:]
    flips = np.sum(axes[1:] * axes[:-1], axis=1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2, -1.0, 1.0)])
    return np.hstack([poses[:, :3], signs[:, None] * axes])


def csv_text(blocks: Sequence[tuple[str, np.ndarray]]) -> str:
    """A table of columns."""
    rows = np.column_stack([values for _, values in blocks]) + 0.0  # no -0
    lines = [",".join(name for name, _ in blocks)]
    lines += [",".join(f"{x:.15g}" for x in row) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def _ros_time(seconds: float) -> dict[str, int]:
    sec, nanosec = divmod(round(seconds * 1e9), 10**9)
    return {"sec": sec, "nanosec": nanosec}


def _reference(plan: MotionPlan) -> dict[str, float] | None:
    reference = plan.task.segments[0].task.reference
    if reference is None:
        return None
    energy = plan.task.robot.energy(reference)
    return {"energy_J": energy, "duration_s": reference.end, "ratio": plan.check.energy / energy}
