"""Robots with known answers, and random ones that close by construction."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ocptip.parallel.description.frames import PlatformCoordinates
from ocptip.parallel.description.platform import BodyInertia, elementary_rotation, product_of, value_of
from ocptip.parallel.description.ready_made import KINDS, make_robot
from ocptip.parallel.description.robot_description import PRISMATIC, RobotDescription
from ocptip.parallel.kinematics.platform import Kinematics

KIND_NAMES = tuple(KINDS)
_FILE = Path(__file__).with_name("golden_cases.json")


@dataclass(frozen=True)
class Golden:
    """A robot, its state (Euler rates; q is n x N) and the published-style numbers of its equations."""

    robot: RobotDescription
    z: np.ndarray
    zd: np.ndarray
    zdd: np.ndarray
    q: np.ndarray
    expected: dict[str, np.ndarray]


@cache
def golden(kind: str) -> Golden:
    """The golden case of a kind: tau_s, M (of z''), c, g, J_a, tau_a."""
    case = json.loads(_FILE.read_text())[kind]
    rows = np.array(case["mdh_rows"])
    bodies = [
        BodyInertia.about_center(m, r, inertia, grouped=True)  # random numbers, no bodies
        for m, r, inertia in zip(case["m"], case["rS"], case["Ic"], strict=True)
    ]
    angles = []
    for matrix in np.array(case["R0"]):
        turned = product_of(KINDS[kind].base_rotation(0.0)).T @ matrix
        # The free angle is the middle one of Rx Ry Rz for the Delta, that of Rz for the others.
        if kind == "Delta":
            matrix = elementary_rotation("x", -np.pi / 2).T @ matrix @ elementary_rotation("z", -np.pi / 2).T
            angles.append(np.arctan2(matrix[0, 2], matrix[0, 0]))
        else:
            angles.append(np.arctan2(turned[1, 0], turned[0, 0]))
    robot = make_robot(
        kind,
        lengths=rows[rows[:, 4] != 0, 4],
        base_angles=angles,
        base_positions=case["rA"],
        coupling_points=case["kap"],
        bodies=bodies[:-1],
        platform=bodies[-1],
        home=case["x"],
        gravity=case["g"],
    )
    names = {"tau_s": "tau_s", "M": "M_sH", "c": "c_s", "g": "g_s", "J_a": "Jinv", "tau_a": "tau_a"}
    expected = {ours: np.array(case[theirs]) for ours, theirs in names.items()}
    z, zd, zdd, q = (np.array(case[name]) for name in ("x", "xd", "xdd", "q"))
    return Golden(robot, z, zd, zdd, q, expected)


@dataclass(frozen=True)
class State:
    """A robot in a closed configuration with random quasi-rates."""

    robot: RobotDescription
    kinematics: Kinematics
    z: np.ndarray
    s: np.ndarray
    sd: np.ndarray
    q: np.ndarray

    @property
    def joints(self) -> list[np.ndarray]:
        """Joint variables leg by leg."""
        return list(self.q.T)


def random_body(rng: np.random.Generator) -> BodyInertia:
    """All ten parameters, physically possible."""
    root = rng.uniform(-0.5, 0.5, (3, 3))
    tensor = root @ root.T + 0.1 * np.eye(3)
    inertia = np.trace(tensor) * np.eye(3) - tensor
    return BodyInertia.about_center(rng.uniform(0.5, 3.0), rng.uniform(-0.3, 0.3, 3), inertia)


def random_state(kind: str, seed: int, convention: str = "xyz") -> State:
    """A random robot of a kind: bases are put where the legs of a random pose begin."""
    rng = np.random.default_rng(seed)
    k = KINDS[kind]
    count = len(k.actuated)
    lengths = rng.uniform(0.5, 1.0, k.lengths)
    angles = rng.uniform(-np.pi, np.pi, count)
    points = rng.uniform(-0.5, 0.5, (count, 3)) * [1, 1, 0 if k.planar else 1]
    z = rng.uniform(-0.4, 0.4, sum(k.mask)) + 0.2
    q = rng.uniform(0.5, 1.2, (k.n, count)) * np.where(rng.random((k.n, count)) < 0.5, 1, -1)
    rows = k.rows(*lengths)
    for joint, row in enumerate(rows[: k.n]):
        if row.sigma == PRISMATIC:
            q[joint] = np.abs(q[joint])
    bodies = [random_body(rng) for _ in range(k.n + 1)]
    gravity = rng.uniform(-10, 10, 3)

    def robot(bases: np.ndarray) -> RobotDescription:
        return make_robot(
            kind,
            lengths=lengths,
            base_angles=angles,
            base_positions=bases,
            coupling_points=points,
            bodies=bodies[:-1],
            platform=bodies[-1],
            home=z,
            convention=convention,
            gravity=gravity,
        )

    draft = robot(np.zeros((count, 3)))
    r, R = PlatformCoordinates(draft.platform).pose(z)
    bases = np.array(
        [
            np.asarray(r, float).ravel()
            + np.asarray(R, float) @ leg.coupling_point
            - leg.base_matrix @ chain_end(rows[: k.n + 1], q[:, i])
            for i, leg in enumerate(draft.legs)
        ]
    )
    made = robot(bases * [1, 1, 0 if k.planar else 1])
    s, sd = rng.uniform(-1, 1, (2, len(z)))
    return State(made, Kinematics(made), z, s, 5 * sd, q)


def chain_end(rows, q: np.ndarray) -> np.ndarray:
    """(3,) origin of the last row's frame, in the leg's base axes: plain products of (2.11)."""
    R, p = np.eye(3), np.zeros(3)
    for joint, row in enumerate(rows):
        value = q[joint] if joint < len(q) else 0.0
        gamma, b, alpha, d, theta, r = (value_of(entry) for entry in row.entries)
        theta, r = (theta, r + value) if row.sigma == PRISMATIC else (theta + value, r)
        R = R @ elementary_rotation("z", gamma)
        p = p + R @ [0.0, 0.0, b]
        R = R @ elementary_rotation("x", alpha)
        p = p + R @ [d, 0.0, 0.0]
        R = R @ elementary_rotation("z", theta)
        p = p + R @ [0.0, 0.0, r]
    return p


def error(value: object, expected: object) -> float:
    """Largest difference relative to the largest expected entry."""
    expected = np.asarray(expected, dtype=float)
    return float(np.abs(np.asarray(value, dtype=float) - expected).max() / np.abs(expected).max())
