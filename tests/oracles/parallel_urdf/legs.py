"""One leg of a robot read from URDF: its chain of joints, the joints its cut adds, as MDH rows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.frames import Frame, compose, fixed_row, inverse, rotation_angles
from ocptip.parallel.description.platform import BodyInertia, elementary_rotation, product_of
from ocptip.parallel.description.robot_description import REVOLUTE, SerialLeg
from tests.oracles.parallel_urdf.chain import JointAxis, MDHChain, joints_to_coupling, mdh_chain

if TYPE_CHECKING:
    from tests.oracles.parallel_urdf.tree import UrdfTree

CUT_KINDS = {"fixed": 0, "revolute": 1, "universal": 2, "spherical": 3}
"""Kinds of cut joints and the number of joints they add to the leg."""

_CROSS = elementary_rotation("x", math.pi / 2)


@dataclass(frozen=True)
class Cut:
    """A joint that was cut to make a tree of the robot.

    Attributes:
        leg: link (frame) at the end of a leg.
        platform: link (frame) fixed on the platform that coincides with it in the real robot.
        kind: "fixed", "revolute", "universal" or "spherical", see the module.
    """

    leg: str
    platform: str
    kind: str = "fixed"

    def __post_init__(self) -> None:
        if self.kind not in CUT_KINDS:
            raise InputError(f"cut.kind: must be one of {', '.join(CUT_KINDS)}, got {self.kind!r}")


class UrdfLeg:
    """A leg as the URDF has it, at zero joint positions.

    Attributes:
        cut: its end; for leg 1 the platform's link itself.
        chain: joints of the URDF from the base on.
        names: of all joints, those of the cut included.
        frames: of all MDH rows at zero joint positions, world axes.
    """

    def __init__(self, tree: UrdfTree, number: int, cut: Cut, chain: list[int], snap: float) -> None:
        self.cut, self.chain, self._snap = cut, chain, snap
        added = CUT_KINDS[cut.kind]
        own = tuple(tree.joint_name(joint) for joint in chain)
        self.names = (*own, *(f"cut{number} {cut.kind} {k}" for k in range(1, added + 1)))
        self._zero = tree.frames(np.zeros(len(tree.joints)))[cut.leg]
        self._axes = [tree.axis(joint) for joint in chain]
        self._axes += _cut_axes(added, self._zero, self._axes[-1].direction)
        self.frames = self._chain(None)[1].frames

    @property
    def platform_link(self) -> str:
        """Link on the platform at which the leg ends."""
        return self.cut.platform

    def home(self, q: np.ndarray, frames: Mapping[str, Frame]) -> np.ndarray:
        """(n,) joint positions of the leg in the home pose.

        Args:
            q: (N,) positions of all joints of the URDF.
            frames: of all links there.
        """
        own = [q[joint - 1] for joint in self.chain]
        turned = frames[self.cut.leg][0].T @ frames[self.cut.platform][0]
        if self.cut.kind == "revolute":
            own.append(math.atan2(turned[1, 0], turned[0, 0]))
        elif self.cut.kind == "universal":
            # turned = Rz(a) Rx(pi/2) Rz(b)
            own += [math.atan2(turned[0, 2], -turned[1, 2]), math.atan2(turned[2, 0], turned[2, 1])]
        elif self.cut.kind == "spherical":
            own += [0.0, 0.0, 0.0]
        return np.array(own)

    def end(self, frames: Mapping[str, Frame]) -> Frame:
        """Frame on the platform's side of the cut at zero joint positions, world axes.

        Args:
            frames: of all links in the home pose; a spherical joint is at zero there.
        """
        turn = _CROSS if self.cut.kind == "universal" else np.eye(3)
        if self.cut.kind == "spherical":
            turn = frames[self.cut.leg][0].T @ frames[self.cut.platform][0]
        return compose(self._zero, (turn, np.zeros(3)))

    def leg(self, tree: UrdfTree, side: Frame, end: Frame, q: np.ndarray, *, wanted: int | None) -> SerialLeg:
        """The leg of a description.

        Args:
            tree: the URDF.
            side: frame on the platform's side of the cut, in the platform frame.
            end: the same at zero joint positions, world axes.
            q: (n,) joint positions in the home pose.
            wanted: number of joints up to the coupling point, if there is a choice.
        """
        n, chain = self._chain(wanted)
        rows, last = chain.rows, chain.frames[-1]
        if n == len(rows):
            row = fixed_row(compose(inverse(last), end), self._snap)
            rows, last = (*rows, row), end
        in_last = compose(inverse(last), end)
        kappa = compose(side, inverse(in_last))[1]
        bodies = [tree.inertia(joint, frame) for joint, frame in zip(self.chain, chain.frames, strict=False)]
        bodies += [BodyInertia()] * (n - len(bodies))
        friction = [tree.damping(joint) for joint in self.chain]
        R, p = chain.base
        return SerialLeg(
            rows,
            n,
            _light(bodies, n),
            base_rotation=rotation_angles(R, self._snap),
            base_position=tuple(p),
            coupling=tuple(kappa),
            end_rotation=product_of(rotation_angles(in_last[0] @ side[0].T, self._snap)),
            viscous=tuple(v for v, _ in friction),
            coulomb=tuple(c for _, c in friction),
            guess=tuple(q),
        )

    def without_last_body(self, tree: UrdfTree, leg: SerialLeg, side: Frame) -> tuple[SerialLeg, BodyInertia]:
        """The leg without the body behind its last joint if that is rigid with the platform, and the body.

        Args:
            tree: the URDF.
            leg: as made by :meth:`leg`.
            side: as there.

        Returns:
            The leg; the body's inertia about the platform frame.
        """
        if self.cut.kind != "fixed":
            return leg, BodyInertia()
        count = len(self.chain)
        bodies = list(leg.bodies[: count - 1])
        bodies += [BodyInertia()] * (leg.n - len(bodies))
        body = tree.inertia(self.chain[-1], compose(self._zero, inverse(side)))
        return replace(leg, bodies=_light(bodies, leg.n)), body

    def _chain(self, wanted: int | None) -> tuple[int, MDHChain]:
        """Number of joints up to the coupling point, and the rows."""
        n = joints_to_coupling(self._axes, wanted, self._snap)
        return n, mdh_chain(self._axes, self._snap, n)


def _light(bodies: list[BodyInertia], n: int) -> tuple[BodyInertia, ...]:
    """The bodies without massless ones at the end, but at least n."""
    count = len(bodies)
    while count > n and bodies[count - 1].massless:
        count -= 1
    return tuple(bodies[:count])


def _cut_axes(count: int, frame: Frame, before: np.ndarray) -> list[JointAxis]:
    """Axes of the joints that a cut adds, at its frame.

    Args:
        count: number of joints.
        frame: at the leg's end.
        before: direction of the leg's last axis: a spherical joint starts with it, so that rows stay simple.
    """
    R, p = frame
    if count < 3:
        # The second axis of a cross is the z axis of the platform's frame, which is R Rx(pi/2) at zero.
        return [JointAxis(REVOLUTE, p, axis) for axis in (R[:, 2], -R[:, 1])[:count]]
    across = np.cross(before, np.eye(3)[int(np.argmin(np.abs(before)))])
    across /= np.linalg.norm(across)
    return [JointAxis(REVOLUTE, p, axis) for axis in (before, across, np.cross(before, across))]
