"""The symbolic engine on leg tables nobody chose: random joints, angles and mixed legs."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.description.frames import PlatformCoordinates
from ocptip.parallel.description.platform import Parameter, Platform, product_of
from ocptip.parallel.description.robot_description import (
    PRISMATIC,
    REVOLUTE,
    MDHRow,
    RobotDescription,
    SerialLeg,
)
from ocptip.parallel.dynamics.terms import quasi_terms
from ocptip.parallel.kinematics.platform import Kinematics
from tests.parallel.parallel_cases import chain_end, error, random_body
from tests.quick import THOROUGH

QUARTER = np.pi / 2


MOTORS_PER_LEG = (2, 2, 1, 1)


def random_table(rng: np.random.Generator, name: str) -> tuple[list[MDHRow], np.ndarray]:
    """Three random joints and a coupling frame, far from singular, with joint variables."""
    while True:
        names = iter(range(100))

        def entry(value: float, names=names):
            return Parameter(f"{name}_{next(names)}", value) if rng.random() < 0.5 else float(value)

        rows = []
        for joint in range(4):
            sigma = PRISMATIC if joint < 3 and rng.random() < 0.35 else REVOLUTE
            angle = float(rng.choice([0.0, QUARTER, -QUARTER, np.pi]))
            alpha = angle if rng.random() < 0.7 else entry(rng.uniform(-1, 1))
            d, b, r = (entry(v) if rng.random() < 0.6 else 0.0 for v in rng.uniform(-0.6, 0.6, 3))
            gamma = entry(rng.uniform(-1, 1)) if rng.random() < 0.2 else 0.0
            theta = entry(rng.uniform(-1, 1)) if rng.random() < 0.3 else 0.0
            rows.append(MDHRow(sigma, gamma, b, alpha, d, theta, r))
        q = rng.uniform(0.4, 1.2, 3)
        steps = 1e-6 * np.eye(3)
        jacobian = [(chain_end(rows, q + h) - chain_end(rows, q - h)) / 2e-6 for h in steps]
        if np.linalg.cond(jacobian) < 20:
            return rows, q


def mixed_robot(seed: int) -> tuple[RobotDescription, np.ndarray]:
    """Four different legs on a platform free in space, and joint variables at home."""
    rng = np.random.default_rng(seed)
    platform = Platform((1,) * 6, "zyx", random_body(rng))
    home = rng.uniform(-0.5, 0.5, 6)
    r, R = (np.asarray(part, dtype=float) for part in PlatformCoordinates(platform).pose(home))
    legs, joints, motors = [], [], []
    for i, count in enumerate(MOTORS_PER_LEG):
        rows, q = random_table(rng, f"p{i}")
        base = (("x", float(rng.choice([0.0, QUARTER]))), ("y", Parameter(f"tilt{i}", 0.3)), ("z", 0.4))
        kappa = rng.uniform(-0.5, 0.5, 3)
        start = r.ravel() + R @ kappa - product_of(base) @ chain_end(rows, q)
        bodies = tuple(random_body(rng) for _ in range(3))
        rows += [MDHRow(alpha=QUARTER), MDHRow(alpha=QUARTER)]
        legs.append(SerialLeg(tuple(rows), 3, bodies, base, tuple(start), tuple(kappa), guess=tuple(q)))
        joints.append(q)
        motors += [(i, int(j)) for j in rng.permutation(3)[:count]]
    robot = RobotDescription("mixed", tuple(legs), platform, tuple(motors), home, rng.uniform(-9, 9, 3))
    return robot, np.column_stack(joints)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(3, 12))])
def test_random_legs(seed):
    robot, q = mixed_robot(seed)
    kinematics = Kinematics(robot)
    rng = np.random.default_rng(seed)
    s, sd = rng.uniform(-1, 1, (2, 6))
    motion = kinematics.motion(robot.home, s, list(q.T), complete=False)
    expected = quasi_terms(kinematics, motion, robot.gravity).force(sd)
    jacobian = kinematics.actuated_jacobian(motion)
    found = lean_function(robot, ("tau", "J_a"), form="S")(robot.home, s, sd, q)
    assert error(found["tau"], expected) < 1e-10
    assert error(found["J_a"], jacobian) < 1e-10
    if seed == 0 and not THOROUGH:  # robots of test_lean have the motors' form
        return
    motors = lean_function(robot, form="A", dynpar=3)(robot.home, s, sd, q)["tau"]
    assert error(motors, np.linalg.solve(jacobian.T, expected)) < 1e-14 * np.linalg.cond(jacobian) + 1e-10


@pytest.mark.parametrize(
    "mask",
    [
        (1, 0, 1, 0, 1, 0),
        *(pytest.param(mask, marks=pytest.mark.slow) for mask in ((1, 1, 0, 0, 0, 1), (0, 1, 1, 1, 0, 0))),
    ],
)
def test_planar_robots_in_any_coordinate_plane(mask):
    """A PRR leg in each of the three planes; planes differ only by a rotation of the base frames."""
    normal = mask.index(0)
    turn = {2: (), 1: (("x", QUARTER),), 0: (("y", QUARTER),)}[normal]
    rng = np.random.default_rng(5)
    platform = Platform(mask, inertia=random_body(rng))
    home = np.array([0.1, -0.2, 0.3])
    r, R = (np.asarray(part, dtype=float) for part in PlatformCoordinates(platform).pose(home))
    legs, joints = [], []
    for i in range(3):
        rows = (
            MDHRow(PRISMATIC, alpha=QUARTER, gamma=Parameter(f"lane{i}", 0.3 + 2.0 * i)),
            MDHRow(alpha=-QUARTER),
            MDHRow(d=Parameter("l", 0.7)),
        )
        q = rng.uniform(0.4, 1.0, 2)
        kappa = rng.uniform(-0.3, 0.3, 3)
        kappa[normal] = 0.0
        start = r.ravel() + R @ kappa - product_of(turn) @ chain_end(rows, q)
        legs.append(
            SerialLeg(
                rows,
                2,
                (random_body(rng), random_body(rng)),
                turn,
                tuple(start),
                tuple(kappa),
                guess=tuple(q),
            )
        )
        joints.append(q)
    robot = RobotDescription("planar", tuple(legs), platform, ((0, 0), (1, 0), (2, 0)), home)
    kinematics, q = Kinematics(robot), np.column_stack(joints)
    s, sd = rng.uniform(-1, 1, (2, 3))
    motion = kinematics.motion(home, s, joints, complete=False)
    expected = quasi_terms(kinematics, motion, robot.gravity)
    found = lean_function(robot, ("tau", "J_a"), form="S")(home, s, sd, q)
    assert error(found["tau"], expected.force(sd)) < 1e-10
    motors = lean_function(robot, form="A", dynpar=3)(home, s, sd, q)["tau"]
    assert error(motors, np.linalg.solve(found["J_a"].T, found["tau"])) < 1e-10
