"""Margins of objects on a tray against cone programs of their own, in random states of a UR5.

    python -m studies.objects.run --out DIR

The objects are a glass, and a cup on a plate, on a tray that is level in the start posture of the example
`ur5_cart`. Tipping margins are compared with moments about the edges of the footprint, friction used with
cone programs of all contact forces, solved by Clarabel. A program grows what friction has to hold, and its
multipliers bound the growth. So friction used lies between two numbers. A state is confirmed where the
library's differs from both by at most 1e-9. Where contacts are lost, programs must say so as well.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import clarabel
import numpy as np

from ocptip.basics.write import write_text
from ocptip.contact.support import Support
from ocptip.numerics.cone_program import INFEASIBLE, quiet_settings, solve_cones
from ocptip.standing.arm import Robot
from ocptip.standing.objects import Object
from ocptip.task_files.motion import load_task
from studies.common import EXAMPLES, table

STATES, SEED = 1000, 0
NEAR = 1e-9  # of friction used: agreement
TURN, SPEED, ACCELERATION = 0.15, 0.5, 3.0  # rad, rad/s, rad/s^2
HEAD = "object", "states", "stable", "tipping margin differs by", "friction by", "confirmed", "contradicted"
UPRIGHT = np.diag([1.0, -1.0, -1.0])  # the gripper points down


def waiter() -> tuple[Robot, np.ndarray]:
    """The robot with its tray, and its start posture."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    on_tray = {"rotation": UPRIGHT}
    plate = Object.box("plate", 0.5, (0.16, 0.12, 0.03), friction=0.4, position=(0.1, 0, -0.02), **on_tray)
    cup = Object.box("cup", 0.2, (0.06, 0.05, 0.1), friction=0.3, on="plate")
    glass = Object.cylinder("glass", 0.4, (0.035, 0.14), friction=0.35, position=(-0.1, 0, -0.02), **on_tray)
    robot = task.robot
    assert isinstance(robot, Robot)
    return robot.carrying([plate, cup, glass]), task.start


def friction_bounds(support: Support, wrench: np.ndarray) -> tuple[float, float]:
    """Between which numbers the friction used is; both infinite where no forces hold the normal load."""
    n, mu = support.n_contacts, support.contacts[0].friction  # pyright: ignore[reportAttributeAccessIssue]
    normal = support.frames[0, :, 0]
    foot = np.mean([np.asarray(one.position) for one in support.contacts], axis=0) - support.center_of_mass
    unit = np.linalg.norm(wrench[:3])
    load = -np.r_[wrench[:3], (wrench[3:] - np.cross(foot, wrench[:3])) / support.length] / unit
    matrix = support.wrench_matrix.copy()
    matrix[3:] = (matrix[3:] - np.cross(foot, matrix[:3].T).T) / support.length
    matrix[:, ::3] /= mu
    along = np.r_[normal, 0, 0, 0][:, None] * np.r_[normal, 0, 0, 0]
    across = np.r_[0, 0, 0, normal][:, None] * np.r_[0, 0, 0, normal]
    fixed = along @ load + np.r_[np.zeros(3), load[3:]] - across @ load
    growing = load - fixed
    start = max(float(np.linalg.norm(growing)), 1e-6)
    A = np.vstack([np.column_stack([matrix, -growing / start]), np.eye(3 * n, 3 * n + 1) * -1.0])
    cones = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(3)] * n]
    settings = quiet_settings(1e-12)
    solution = solve_cones(-np.eye(3 * n + 1)[-1], A, np.r_[fixed, np.zeros(3 * n)], cones, settings)
    if str(solution.status) in INFEASIBLE:
        return np.inf, np.inf
    y = np.array(solution.z)[:6]
    prices = (matrix.T @ y).reshape(n, 3)
    # More of the normal direction makes the multipliers admissible to rounding.
    y[:3] += mu * normal * max(np.max(np.linalg.norm(prices[:, 1:], axis=1) - prices[:, 0]), 0.0)
    most = (y @ fixed) / -(y @ growing)
    return 1 / most, start / solution.x[-1]


def edge_moment(support: Support, wrench: np.ndarray) -> float:
    """Least moment, N m, about the edges of a convex footprint, whose contacts go around it."""
    points = np.array([contact.position for contact in support.contacts]) - support.center_of_mass
    found = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        e = (b - a) / np.linalg.norm(b - a)
        found.append(-e @ (wrench[3:] - np.cross(a, wrench[:3])))
    return min(found)


def rows(states: int) -> list[list[str]]:
    """One row per object."""
    (robot, start), rng = waiter(), np.random.default_rng(SEED)
    q = start + TURN * rng.uniform(-1, 1, (states, robot.n))
    qd, qdd = (most * rng.uniform(-1, 1, q.shape) for most in (SPEED, ACCELERATION))
    found = []
    for own, wrenches in zip(robot.interfaces[1:], robot.object_wrenches(q, qd, qdd), strict=True):
        contacts = own.contact_states(wrenches)
        stable = contacts.persistent
        margins = own.tip_over.evaluate(contacts).margins.min(axis=1)
        GT = own.slip.evaluate(contacts, derivatives=False).GT
        moments = np.array([edge_moment(own.support, wrench) for wrench in wrenches])
        tips = float(np.max(np.abs(margins - moments)[stable])) / float(own.tip_over.reference_moment or 1.0)
        bounds = np.array([friction_bounds(own.support, wrench) for wrench in wrenches])
        differences = np.max(np.abs(bounds - GT[:, None])[stable], axis=1)
        sure = int(np.sum(differences <= NEAR) + np.sum(bounds[~stable, 0] > 1))
        wrong = int(np.sum(bounds[stable, 0] - NEAR > GT[stable]) + np.sum(bounds[~stable, 1] < 1))
        errors = f"{tips:.1g} of M0", f"{differences.max():.1g}"
        found.append([own.name, str(len(q)), str(stable.sum()), *errors, str(sure), str(wrong)])
    return found


def main(arguments: list[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--out", type=Path, default=Path("studies/results"))
    parser.add_argument("--states", type=int, default=STATES)
    options = parser.parse_args(arguments)
    lines = [
        "# Objects against cone programs", "",
        "Random states of a tray against independent programs: `studies.objects.run`; friction to 1e-9.", "",
        *table(HEAD, rows(options.states)),
    ]  # fmt: skip
    write_text(options.out / "objects.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
