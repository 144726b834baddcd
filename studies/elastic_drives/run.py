"""Elastic joints: vibration of the gripper and the wrench on the base, computed and simulated.

Motions of the modular arm and of a UR5, with gears of two stiffnesses (5 % damping of each joint alone),
bolted down and on compliant feet, by `ocptip.standing.elastic.drives` and by MuJoCo's rigid bodies with a
spring at every joint, integrated by Runge-Kutta steps: nothing is linearised there. Vibration is where the
gripper is less where it sags to at rest in the same posture, which MuJoCo finds for itself. And what rise
times of one period of a mode do.

    python -m studies.elastic_drives.run --out studies/results
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.published.tasks import experiment_task
from ocptip.robots.gears import Gears
from ocptip.robots.kinematics import gripper_batch
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.drives import DriveMotion, on_its_drives, with_rise
from ocptip.standing.elastic.springs import Ride
from ocptip.standing.elastic.steps import Modes
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.common import EXAMPLES, RESULTS, number, percent, software, table
from studies.elastic_feet.rigid_bodies import FeetSimulation

SHARES = np.array([1.0, 1.0, 0.5, 0.1, 0.1, np.inf])  # of the stiffness, by joint; the last one does not give
STIFFNESSES = 5e3, 2e4  # N m/rad
FEET, FEET_DAMPING = 1e6, 0.1
STEP, AFTER = 2e-4, 0.3  # s
POSTURES = 60  # at which the simulation is asked where the gripper sags to


@dataclass(frozen=True, eq=False)
class Simulated:
    """What MuJoCo found: vibration (T, 3), m, at times (T,), s, and the wrench on a bolted base (T, 6).

    Attributes:
        peak, after: m, greatest vibration during the motion and after it.
    """

    times: np.ndarray
    vibration: np.ndarray
    wrenches: np.ndarray
    peak: float
    after: float


def simulated(robot: Robot, motion: Trajectory, step: float, after: float) -> Simulated:
    """MuJoCo's motion of a robot with elastic joints, on its feet if these give, else bolted down."""
    gears, elastic = robot.arm.gears, robot.support.elastic
    assert gears is not None
    ride, feet = Ride(robot, motion), {}
    own = ride.start_inertia[:6, :6]
    if elastic is not None:
        stiffness = elastic.stiffness[0]
        feet = {"stiffness": stiffness[0], "tangential": stiffness[1]}
        feet["delay"] = Modes.of(elastic, own).delays[0]
    springs = {int(k): pair for k, *pair in zip(gears.elastic, ride.springs, ride.dampers, strict=True)}
    bodies = FeetSimulation(robot, motion, gears=springs, **feet)
    seen = bodies.run(step, after)
    postures = np.linspace(0, motion.end, POSTURES)
    still = FeetSimulation(robot, motion, gears=springs, **feet)  # whose feet have not slid
    sags = np.array([still.sag(q) for q in motion.states(postures)[0]])
    tip = gripper_batch(robot.arm)
    sags = CubicSpline(postures, sags - tip(motion.states(postures)[0])[0])  # it changes less than the place
    q = motion.states(np.minimum(seen.times, motion.end))[0]
    vibration = seen.gripper - tip(q)[0] - sags(np.minimum(seen.times, motion.end))
    sizes, moving = np.linalg.norm(vibration, axis=1), seen.times <= motion.end
    return Simulated(seen.times, vibration, seen.wrenches, sizes[moving].max(), sizes[~moving].max())


def planned(case: str) -> tuple[Robot, Trajectory]:
    """The committed plan of a case."""
    path = RESULTS / f"plans/{case}-effective/plan.json"
    return experiment_task(case).robot, Trajectory.from_dict(json.loads(path.read_text()))


def lifted() -> tuple[Robot, Trajectory]:
    """A UR5 on its cart, one ramp per joint."""
    task = load_task(EXAMPLES / "tasks/ur5_cart.toml")
    turns = zip(task.start, task.goal, strict=True)
    motion = Trajectory.from_profiles(task.start, [[RampCommand(b, 1.0, 3.0)] for _, b in turns])
    assert isinstance(task.robot, Robot)
    return task.robot, motion


def motions() -> list[tuple[str, Robot, Trajectory, bool]]:
    """Name, robot, motion, and whether feet give."""
    (a, of_a), (d, of_d), (g, of_g), (h, of_h) = map(planned, "ADGH")
    return [
        ("A", a, of_a, False),
        ("A", a, of_a.time_scaled(1.2), True),
        ("D", d, of_d, False),
        ("G, rise time 40 ms", g, of_g.with_rise_times(0.04), True),
        ("H", h, of_h, False),
        ("UR5, a ramp per joint", *lifted(), False),
    ]


def geared(robot: Robot, stiffness: float, feet: bool) -> Robot:
    """The same robot with gears, and perhaps feet, that give."""
    if feet:
        own = robot.support
        contacts = [
            replace(c, stiffness=FEET, damping_ratio=FEET_DAMPING)
            for c in own.contacts
            if isinstance(c, UnilateralContact)
        ]
        robot = robot.varied(support=own.varied(contacts))
    return robot.varied(arm=robot.arm.with_gears(Gears(stiffness * SHARES)))


def compared(name: str, robot: Robot, motion: Trajectory, feet: bool, stiffness: float) -> dict[str, Any]:
    """One row."""
    robot = geared(robot, stiffness, feet)
    began = time.process_time()
    found = on_its_drives(robot, motion)
    seconds = time.process_time() - began
    assert found is not None
    theirs = simulated(robot, motion, STEP, AFTER)
    course = found.course
    row = {
        "motion": name,
        "feet_N_m": FEET if feet else None,
        "stiffness_Nm_rad": stiffness,
        "modes_Hz": [mode.last for mode in found.modes],
        "peak_m": found.peak.value,
        "simulated_peak_m": theirs.peak,
        "after_m": found.after,
        "simulated_after_m": theirs.after,
        "cpu_s": seconds,
        "rms_N": None,
    }
    if not feet:
        own = np.stack([np.interp(theirs.times, course.times, w) for w in course.wrenches.T], axis=1)
        row["rms_N"] = float(np.sqrt(np.mean((own - theirs.wrenches)[:, 2] ** 2)))
    return row | {"rise": rises(robot, motion, found)}


def rises(robot: Robot, motion: Trajectory, found: DriveMotion) -> dict[str, float] | None:
    """What the suggested rise time does, by this and by MuJoCo."""
    best = with_rise(robot, motion)
    if best is None or best.rise is None:
        return None
    theirs = simulated(robot, motion.with_rise_times(best.rise.rise_time), STEP, AFTER)
    return {
        "rise_time_s": best.rise.rise_time,
        "frequency_Hz": best.rise.frequency,
        "peak_m": best.rise.peak,
        "after_m": best.rise.after,
        "simulated_peak_m": theirs.peak,
        "simulated_after_m": theirs.after,
    }


def markdown(result: dict[str, Any]) -> str:
    """The page."""

    def mm(value: float) -> str:
        return number(1e3 * value, 3)

    rows, rises = [], []
    for row in result["rows"]:
        feet = "bolted" if row["feet_N_m"] is None else f"{row['feet_N_m']:.0e} N/m"
        head = [row["motion"], feet, f"{row['stiffness_Nm_rad']:.0f}"]
        off = row["peak_m"] / row["simulated_peak_m"] - 1
        modes = ", ".join(number(f, 1) for f in row["modes_Hz"])
        peaks = [mm(row["peak_m"]), mm(row["simulated_peak_m"]), percent(off, 2)]
        ends = [mm(row["after_m"]), mm(row["simulated_after_m"])]
        rows.append([*head, modes, *peaks, *ends, number(row["rms_N"], 2), number(row["cpu_s"], 2)])
        if rise := row["rise"]:
            before = [mm(row["peak_m"]), mm(row["after_m"])]
            now = [mm(rise[key]) for key in ("peak_m", "simulated_peak_m", "after_m", "simulated_after_m")]
            times = [f"{1e3 * rise['rise_time_s']:.1f}", number(rise["frequency_Hz"], 1)]
            rises.append([*head, *times, before[0], *now[:2], before[1], *now[2:]])
    worst = max(abs(row["peak_m"] / row["simulated_peak_m"] - 1) for row in result["rows"])
    lines = [
        "# Elastic joints",
        "",
        f"{software(result['versions'])}. Effective bases; stiffness of the gears of joints 1 and 2, half of "
        "it in joint 3, a tenth in joints 4 and 5, joint 6 does not give; 5 % damping of each joint alone. "
        f"Compliant feet have {100 * FEET_DAMPING:.0f} % damping of their lowest mode. Simulation: MuJoCo's "
        f"rigid bodies, nothing linearised, Runge-Kutta steps of {1e3 * STEP:g} ms.",
        "",
        f"Vibration of the gripper; the greatest difference of a peak is {percent(worst, 1)}. Last but one: "
        "root mean square of the difference of the vertical force on a bolted base; then CPU seconds of one "
        "motion here.",
        "",
        *table(
            ["motion", "feet", "N m/rad", "modes at the end [Hz]", "peak [mm]", "MuJoCo", "off",
             "after the end [mm]", "MuJoCo", "rms [N]", "CPU [s]"],
            rows,
            left=2,
        ),
        "",
        "With the rise time of the accelerations that `ocptip check` suggests: one period of a mode.",
        "",
        *table(
            ["motion", "feet", "N m/rad", "rise time [ms]", "mode [Hz]", "peak before [mm]", "peak", "MuJoCo",
             "after the end, before [mm]", "after the end", "MuJoCo"],
            rises,
            left=2,
        ),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = [compared(*motion, stiffness) for motion in motions() for stiffness in STIFFNESSES]
    software_used = versions(("numpy", "scipy", "casadi", "mujoco"))
    result = {"versions": software_used, "rows": rows}
    write_json(options.out / "elastic_drives.json", result, indent=1)
    write_text(options.out / "elastic_drives.md", markdown(result))
    print(markdown(result), end="")


if __name__ == "__main__":
    main()
