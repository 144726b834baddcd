"""An arm with elastic joints, as an arm with more joints: each of these is two in line, a drive and a spring.

So everything known of arms, above all their dynamics, is known of those with elastic joints: Spong's model
with the rotor's whole motion. Between drive and spring there is nothing, or the spin of a rotor behind a
gear, which turns with the drive and not with the link. `ArmModel.armature` is also on the drive's side: it
loads the drive only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.inertia import RigidBody, union
from ocptip.robots.bodies import real_bodies
from ocptip.robots.gears import Gears
from ocptip.robots.model import ArmModel, JointLimits

_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class SpringChain:
    """The arm with a joint more for each of m springs.

    Attributes:
        arm: of n + m joints, with what the gripper holds and a process.
        drives: (n,) numbers of its joints that are the drives, from 0.
        springs: (m,) of those that are springs.
        gears: that it was made of.
    """

    arm: ArmModel
    drives: np.ndarray
    springs: np.ndarray
    gears: Gears

    def spread(self, drives: np.ndarray, springs: np.ndarray | float = 0.0) -> np.ndarray:
        """Values (N, n + m) of its joints by those of the drives, (N, n), and of the springs, (N, m)."""
        values = np.empty((len(drives), self.arm.n))
        values[:, self.drives], values[:, self.springs] = drives, springs
        return values


@lru_cache(maxsize=16)
def spring_chain(arm: ArmModel) -> SpringChain:
    """The arm as one with springs.

    Link inertias that no body has are parted into bodies and fast rotors first, see `real_bodies`.

    Raises:
        InputError: joints follow others, or no bodies have these inertias.
    """
    gears = arm.gears
    assert gears is not None  # else there is nothing to make
    if arm.coupling is not None:
        raise InputError(f"gear_stiffness: arm {arm.name} has joints that follow others; leave it out")
    bodies = real_bodies(arm)
    links: list[RigidBody] = [*bodies.links]
    spins = np.zeros(arm.n)
    for rotor in bodies.rotors:
        k = rotor.joint
        spins[k] += rotor.ratio * rotor.axial
        turn = arm.rotations[k]
        tensor = np.diag([rotor.transverse, rotor.transverse, rotor.axial * (1 - rotor.ratio)])
        links[k - 1] = union(links[k - 1], (rotor.mass, arm.offsets[k - 1], turn @ tensor @ turn.T))
    parts: list[tuple[str, np.ndarray, np.ndarray, RigidBody]] = []
    drives, springs = [], []
    for k, (mass, centre, inertia) in enumerate(links):
        name, turn, spin = arm.joint_names[k], arm.rotations[k], spins[k] * np.outer(_Z, _Z)
        drives.append(len(parts))
        if k in gears.elastic:
            parts.append((name, turn, np.zeros(3), (0.0, np.zeros(3), spin)))
            springs.append(len(parts))
            name, turn, spin = f"{name} spring", np.eye(3), 0.0
        parts.append((name, turn, arm.offsets[k], (mass, centre, inertia + spin)))
    names, turns, offsets, drives_of = zip(*parts, strict=True)
    masses, centres, inertias = (np.array(values) for values in zip(*drives_of, strict=True))
    slides = np.zeros(len(parts), dtype=bool)
    slides[drives] = arm.prismatic
    slides[springs] = arm.prismatic[gears.elastic]
    chain = ArmModel(
        arm.name, names, np.array(turns), np.array(offsets), masses, centres, inertias,
        JointLimits.unlimited(len(parts)), arm.tool_rotation, arm.mount_position, arm.mount_rotation,
        prismatic=slides,
    ).with_payload(arm.payload)  # fmt: skip
    return SpringChain(chain.with_process(arm.process), np.array(drives), np.array(springs), gears)
