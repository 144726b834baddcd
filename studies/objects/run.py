"""Margins of objects on a tray against cone programs of their own, in random states of a UR5.

    python -m studies.objects.run --out DIR

The objects are a glass, and a cup on a plate, on a tray that is level in the start posture of the example
`ur5_cart`. Tipping margins are compared with moments about the edges of the footprint, friction used with
cone programs of all contact forces: they exist with a little more friction, and with a little less there
is a proof that they do not. Programs without an answer confirm nothing.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import clarabel
import numpy as np

from ocptip.basics.write import write_text
from ocptip.contact.support import Support
from ocptip.numerics.cone_program import INFEASIBLE, USABLE, quiet_settings, solve_cones
from ocptip.standing.arm import Robot
from ocptip.standing.objects import Object
from ocptip.task_files.motion import load_task
from studies.common import EXAMPLES, table

STATES, SEED = 1000, 0
NEAR = 1e-6  # relative: contacts hold with so much more friction, and do not with so much less
TURN, SPEED, ACCELERATION = 0.15, 0.5, 3.0  # rad, rad/s, rad/s^2
HEAD = "object", "states", "stable", "tipping margin differs by", "friction confirmed", "contradicted"
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


def holds(support: Support, wrench: np.ndarray, share: float) -> str:
    """Whether contact forces within a share of the friction balance a wrench: yes, no (proved), or ?."""
    n, W, mu = support.n_contacts, support.wrench_matrix, support.contacts[0].friction  # pyright: ignore[reportAttributeAccessIssue]
    scaling = np.r_[np.ones(3), np.full(3, 1 / support.length)]
    cones = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(3)] * n]
    b = np.r_[-scaling * wrench / np.linalg.norm(wrench[:3]), np.zeros(3 * n)]
    A = np.vstack([scaling[:, None] * W, np.kron(np.eye(n), -np.diag([share * mu, 1.0, 1.0]))])
    status = str(solve_cones(np.zeros(3 * n), A, b, cones, quiet_settings(1e-12)).status)
    return "yes" if status in USABLE else "no" if status in INFEASIBLE else "?"


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
        answers = [
            (holds(own.support, wrench, most * (1 + NEAR)), holds(own.support, wrench, most * (1 - NEAR)))
            for wrench, most in zip(wrenches[stable], GT[stable], strict=True)
        ]
        less = [holds(own.support, wrench, 1 - NEAR) for wrench in wrenches[~stable]]
        wrong = sum(above == "no" or below == "yes" for above, below in answers) + less.count("yes")
        sure = sum(pair == ("yes", "no") for pair in answers) + less.count("no")
        found.append([own.name, str(len(q)), str(len(answers)), f"{tips:.1g} of M0", str(sure), str(wrong)])
    return found


def main(arguments: list[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--out", type=Path, default=Path("studies/results"))
    parser.add_argument("--states", type=int, default=STATES)
    options = parser.parse_args(arguments)
    lines = [
        "# Objects against cone programs", "",
        "Random states of a tray against independent programs: `studies.objects.run`; friction to 1e-6.", "",
        *table(HEAD, rows(options.states)),
    ]  # fmt: skip
    write_text(options.out / "objects.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
