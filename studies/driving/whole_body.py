"""Paths of base and arm together in MuJoCo, on a cart with steered wheels that roll on hinges.

    python -m studies.driving.whole_body --out results [--paths 20] [--seconds S]

The paths and their two timings, with and without regard to the contacts of the base, are those of
`studies.retiming.whole_body`. The model is the exported one. Its feet become wheels that steer so that none
slides sideways; joints of arm, steering and wheels do what is commanded. Tyres grip so well that the cart
tips before it slides. Finished paths are kept.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_text
from ocptip.retiming.retime import retime
from ocptip.standing.arm import Robot
from ocptip.standing.simulation.mjcf import BASE as BODY
from ocptip.standing.simulation.mjcf import to_mjcf
from ocptip.standing.simulation.replay import prescribed
from ocptip.standing.tolerance import NONE
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from studies.common import (
    PLANNING,
    RowFile,
    ended,
    number,
    say,
    software,
    source_state,
    state_notes,
    table,
)
from studies.driving.wheels import RADIUS, ROUGH, SETTLE, SPINS, STEP, WHEEL
from studies.retiming.whole_body import BASE, NODES, TASK, random_path, whole

INERTIA = 1e8  # kg m^2 of steering, that nothing but its command turns it
EDGE, AFTER = 2e-3, 0.3  # s: of the ends of a motion, where the direction is not known; s of rest behind it
LIFTED, TIPPED = 0.05e-3, np.radians(20.0)  # m of a wheel above the ground; of the base
FEET = "foot", "ground"
HEAD = "seed", "duration [s]", "lift [mm]", "without contacts [s]", "lift [mm]", "tilt [deg]"


def steered(robot: Robot, motion: Trajectory) -> mujoco.MjModel:
    """The exported model of a motion of the arm, on steered wheels in place of the feet."""
    spec = prescribed(to_mjcf(robot, motion), STEP)
    for what in [*spec.sensors, *spec.pairs, *spec.geoms, *spec.sites]:
        if getattr(what, "geomname1", what.name).startswith(FEET):
            spec.delete(what)
    ground = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], conaffinity=1)
    ground.friction, ground.solref = [ROUGH, 0, 0], [0.004, 1]
    base, support = spec.body(BODY), robot.support
    for k, contact in enumerate(support.contacts):
        place = contact.position - support.center_of_mass + [0, 0, RADIUS]
        yoke = base.add_body(
            name=f"yoke{k}", pos=place, mass=WHEEL, inertia=[SPINS] * 3, explicitinertial=True
        )
        yoke.add_joint(name=f"yoke{k}", axis=[0, 0, 1], armature=INERTIA)
        wheel = yoke.add_body(name=f"wheel{k}", mass=WHEEL, inertia=[SPINS] * 3, explicitinertial=True)
        wheel.add_joint(name=f"wheel{k}", axis=[0, 1, 0], armature=INERTIA)
        wheel.add_geom(
            name=f"wheel{k}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], contype=1, condim=3,
            friction=[ROUGH, 0, 0], solref=[0.004, 1], priority=1,
        )  # fmt: skip
    for what in ("yoke", "wheel"):
        for k in range(len(support.contacts)):
            motor = spec.add_actuator(name=f"{what}{k}", target=f"{what}{k}")
            motor.trntype, motor.gear[0] = mujoco.mjtTrn.mjTRN_JOINT, INERTIA
    return spec.compile()


def steering(robot: Robot, motion: Trajectory, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (T, c), rad, and speeds, m/s, of the wheels of a base that moves in this way."""
    states, rates, _ = motion.states(np.clip(times, EDGE, motion.end - EDGE))
    moving = (times > 0) & (times < motion.end)
    yaw = states[:, 2]
    forward = np.cos(yaw) * rates[:, 0] + np.sin(yaw) * rates[:, 1]
    across = -np.sin(yaw) * rates[:, 0] + np.cos(yaw) * rates[:, 1]
    x, y = np.array([contact.position[:2] for contact in robot.support.contacts]).T
    along = forward[:, None] - rates[:, 2:3] * y
    aside = across[:, None] + rates[:, 2:3] * x
    return np.unwrap(np.arctan2(aside, along), axis=0), moving[:, None] * np.hypot(along, aside)


def driven(robot: Robot, arm: Trajectory, motion: Trajectory) -> tuple[float, float]:
    """Maximum height of a wheel above the ground, m, and maximum tilt of the base, rad.

    Args:
        robot: on contacts that become wheels.
        arm: motion of the arm.
        motion: x, y and yaw of the base, and the arm's joints.
    """
    model = steered(robot, arm)
    data = mujoco.MjData(model)
    times = np.arange(-SETTLE, motion.end + AFTER, STEP)
    inside = np.clip(times, 0.0, motion.end)
    states, rates, _ = motion.states(inside)
    rates[(times <= 0) | (times >= motion.end)] = 0.0
    angles, speeds = steering(robot, motion, times)
    commanded = np.hstack([rates[:, 3:], np.gradient(angles, STEP, axis=0), speeds / RADIUS])
    controls = np.diff(commanded, axis=0) / STEP
    wheels = [model.geom(f"wheel{k}").id for k in range(len(robot.support.contacts))]
    data.qpos[:3], data.qpos[3:7] = robot.support.center_of_mass, [1, 0, 0, 0]
    data.qpos[7 : 7 + robot.n] = states[0, 3:]
    for k, angle in enumerate(angles[0]):
        data.qpos[model.joint(f"yoke{k}").qposadr[0]] = angle
    lift = tilt = 0.0
    for when, control in zip(times, controls, strict=False):
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        if when > 0:
            lift = max(lift, float(data.geom_xpos[wheels, 2].max()) - RADIUS)
            tilt = max(tilt, float(np.arccos(np.clip(data.body(BODY).xmat[8], -1, 1))))
        if tilt > TIPPED:
            break
    return lift, tilt


def timed(robot: Robot, blind: Robot, seed: int, task: Any) -> dict[str, Any]:
    """Both timings of a path in the simulator."""
    path, row = random_path(task.start, task.goal, seed), dict[str, Any]()
    for name, own in (("kept", robot), ("blind", blind)):
        found = retime(own, path, task.limits, nodes=NODES, base=BASE)
        lift, tilt = driven(robot, found.motion, whole(found, path))
        row[name] = {"duration_s": found.motion.end, "lift_m": lift, "tilt_rad": tilt}
    return row


def text_of(rows: Sequence[dict[str, Any]], notes: Sequence[str]) -> str:
    """A line per path, and the counts."""
    lines, lost = [], dict.fromkeys(("kept", "blind"), 0)
    found = [row for row in rows if "refused" not in row]
    for row in found:
        kept, blind = row["kept"], row["blind"]
        for name in lost:
            lost[name] += row[name]["lift_m"] > LIFTED
        numbers = [number(kept["duration_s"]), number(1e3 * kept["lift_m"]), number(blind["duration_s"])]
        tilt = number(np.degrees(blind["tilt_rad"]), 1)
        lines.append([f"{row['seed']}", *numbers, number(1e3 * blind["lift_m"]), tilt])
    summary = (
        f"Of {len(found)} paths timed with the contacts of the base, {lost['kept']} lift a wheel more than "
        f"{1e3 * LIFTED:g} mm; timed without, {lost['blind']} do."
    )
    refused = [f"- seed {row['seed']}: no timing ({row['refused']})" for row in rows if "refused" in row]
    head = ["# Paths of base and arm together on hinged wheels", "", *notes, ""]
    return "\n".join([*head, *table(HEAD, lines), "", summary, *refused]) + "\n"


def run(out: Path, paths: int, seconds: float) -> str:
    """Compute what is missing, path by path, and write the table."""
    out.mkdir(parents=True, exist_ok=True)
    state, began = source_state(*PLANNING), time.monotonic()
    file = RowFile(out / "driving_whole_body.json", {"step_s": STEP, "nodes": NODES}, ("seed",), state)
    task = load_task(TASK, NONE)
    robot = cast(Robot, task.robot)
    wide = [dataclasses.replace(c, position=5 * c.position, friction=10.0) for c in robot.support.contacts]
    blind = robot.varied(support=robot.support.varied(wide))
    for seed in range(paths):
        if file.find(seed=seed) is not None or time.monotonic() - began > seconds:
            continue
        say(f"seed {seed}")
        try:
            row = timed(robot, blind, seed, task)
        except InputError as error:
            row = {"refused": f"{error}"}
        file.put({"seed": seed, **row})
    note = f"{software(versions(('numpy', 'mujoco')))}; steps of {1e3 * STEP:g} ms; wheels of {RADIUS:g} m."
    told = state_notes([row.get("state") for row in file.own], state)
    text = text_of(file.own, [note]) + "\n".join(told) + "\n"
    write_text(out / "driving_whole_body.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--paths", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no path after so long")
    given = parser.parse_args(argv)
    return ended("whole_body", lambda: run(given.out, given.paths, given.seconds), "finished paths are kept.")


if __name__ == "__main__":
    sys.exit(main())
