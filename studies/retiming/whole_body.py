"""Random paths of a base and its arm together, timed with and without regard to the contacts of the base.

    python -m studies.retiming.whole_body [--paths N] [--seed N]

A UR5 on its cart drives a random curve of some 2 m while the arm goes through random postures. Both timings
keep the same limits of joints and base; that without contacts is of the cart on feet five times as far apart.
The judge knows nothing of wrenches: it differentiates the linear and angular momentum of all bodies in the
world every 4 ms. What the floor then exerts has to press beside all edges of the support polygon.
"""

from __future__ import annotations

import argparse
import dataclasses
from typing import cast

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.retiming.retime import Retimed, retime
from ocptip.retiming.whole_body import BaseLimits
from ocptip.robots.kinematics import link_frames
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import NONE
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.trajectory import Trajectory
from studies.common import table

TASK = "src/ocptip/examples/tasks/ur5_cart.toml"
BASE = BaseLimits(speed=1.0, turning=1.5, acceleration=2.0, turning_acceleration=3.0)
NODES, STEP, H = 60, 4e-3, 1e-4


def random_path(start: np.ndarray, goal: np.ndarray, seed: int) -> JointPath:
    """A curve of the base of about 2 m, and a spline of the arm beside the line from start to goal."""
    rng, ends = np.random.default_rng(seed), np.linspace(0, 1, 5)
    poses = ends[:, None] * [2.0, 0.5 * rng.normal(), rng.normal()]
    poses[1:] += 0.15 * rng.normal(size=(4, 3))
    joints = start + ends[:, None] * (goal - start)
    joints[1:-1] += 0.1 * rng.normal(size=(3, len(start))) * np.abs(goal - start).max()
    return JointPath(ends, CubicSpline(ends, np.hstack([poses, joints])).c)


def momenta(robot: Robot, states: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular momentum about the world's origin, (N, 3) each; states are x, y, yaw and joints."""
    linear, angular = np.zeros((len(states), 3)), np.zeros((len(states), 3))
    ahead, behind, here = (bodies(robot, states + sign * H * rates) for sign in (1, -1, 0))
    for (_, p1, r1), (_, p0, r0), ((mass, inertia), p, r) in zip(ahead, behind, here, strict=True):
        speed = (p1 - p0) / (2 * H)
        turning = Rotation.from_matrix(r1 @ r0.transpose(0, 2, 1)).as_rotvec() / (2 * H)
        spin = np.einsum("kij,jl,kml,km->ki", r, inertia, r, turning)
        linear += mass * speed
        angular += np.cross(p, mass * speed) + spin
    return linear, angular


def bodies(robot: Robot, states: np.ndarray) -> list[tuple[tuple[float, np.ndarray], np.ndarray, np.ndarray]]:
    """Mass and inertia, centre of mass (N, 3) and rotation (N, 3, 3) in the world, of base and links."""
    support, arm = robot.support, robot.arm
    turn = Rotation.from_euler("z", states[:, 2:3]).as_matrix()
    place = np.column_stack([states[:, :2], np.zeros(len(states))])

    def moved(points: np.ndarray) -> np.ndarray:
        return place + np.einsum("kij,kj->ki", turn, points)

    found = [
        ((support.mass, support.inertia), moved(np.tile(support.center_of_mass, (len(states), 1))), turn)
    ]
    frames = [link_frames(arm, q) for q in states[:, 3:]]
    for k in range(arm.links):
        rotations = np.array([own.rotations[k] for own in frames])
        centres = np.array([own.origins[k] for own in frames]) + rotations @ arm.centres[k]
        found.append(((float(arm.masses[k]), arm.inertias[k]), moved(centres), turn @ rotations))
    return found


def least_moment(robot: Robot, motion: Trajectory) -> float:
    """Smallest moment, N m, with which the floor presses beside an edge of the support polygon."""
    times = np.arange(STEP, motion.end - STEP, STEP)
    inside = times[np.min(np.abs(times[:, None] - motion.breaks[0]), axis=1) > 1.5 * H]
    states = motion.states(inside)[0]
    (l1, a1), (l0, a0) = (momenta(robot, *motion.states(inside + sign * H)[:2]) for sign in (1, -1))
    masses, centres = zip(*((own[0], p) for own, p, _ in bodies(robot, states)), strict=True)
    gravity = robot.support.gravity
    force = (l1 - l0) / (2 * H) - sum(masses) * gravity
    moment = (a1 - a0) / (2 * H) - sum(m * np.cross(c, gravity) for m, c in zip(masses, centres, strict=True))
    back = Rotation.from_euler("z", -states[:, 2:3]).as_matrix()
    place = np.column_stack([states[:, :2], np.zeros(len(states))])
    moment = np.einsum("kij,kj->ki", back, moment - np.cross(place, force))
    force = np.einsum("kij,kj->ki", back, force)
    feet = np.array([own.position for own in robot.support.contacts])
    feet = feet[np.argsort(np.arctan2(*(feet - feet.mean(axis=0))[:, 1::-1].T))]
    edges = np.roll(feet, -1, axis=0) - feet
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    about = [(moment - np.cross(p, force)) @ e for p, e in zip(feet, edges, strict=True)]
    return float(np.min(about))


def whole(found: Retimed, path: JointPath) -> Trajectory:
    """The motion of base and arm."""
    timing = found.motion.timing
    assert timing is not None
    return Trajectory.from_path(path, timing.s, timing.x)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    task = load_task(TASK, NONE)
    robot = cast(Robot, task.robot)
    wide = [dataclasses.replace(c, position=5 * c.position, friction=10.0) for c in robot.support.contacts]
    blind = robot.varied(support=robot.support.varied(wide))
    rows, seed = [], options.seed
    while len(rows) < options.paths:
        path, seed = random_path(task.start, task.goal, seed), seed + 1
        try:
            kept, other = (retime(own, path, task.limits, nodes=NODES, base=BASE) for own in (robot, blind))
        except InputError as error:
            print(f"seed {seed - 1}: {error}")
            continue
        moments = [least_moment(robot, whole(own, path)) for own in (kept, other)]
        rows.append((seed - 1, kept.motion.end, other.motion.end, *moments))
        print(*(f"{value:.3f}" for value in rows[-1]), kept.check.stands, flush=True)
    head = ["seed", "s", "s without contacts", "N m", "N m without contacts"]
    print("\n".join(table(head, [[f"{row[0]}", *(f"{value:.2f}" for value in row[1:])] for row in rows])))
    lost = [sum(row[k] < 0 for row in rows) for k in (3, 4)]
    slower = np.median([row[1] / row[2] for row in rows])
    print(f"lose a contact: {lost[0]} of {len(rows)}, without contacts {lost[1]}; {slower:.2f} times slower")


if __name__ == "__main__":
    main()
