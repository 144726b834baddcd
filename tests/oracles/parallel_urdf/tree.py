"""A URDF tree as the reader of parallel robots needs it: joint chains, axes, link frames, inertias."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.basics.errors import InputError, naming, number_from
from ocptip.basics.text import did_you_mean
from ocptip.parallel.description.frames import Frame, compose, inverse
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.robot_description import PRISMATIC, REVOLUTE
from ocptip.robots.pinocchio import load_pinocchio
from ocptip.robots.urdf.parser import pinocchio_model
from tests.oracles.parallel_urdf.chain import JointAxis

if TYPE_CHECKING:
    pass


class UrdfTree:
    """A URDF read by Pinocchio: links on fixed joints belong to the body before; mimic tags do not count.

    Joints are Pinocchio's numbers, 1 to `n`; 0 is the root link. World axes are the root link's.

    Attributes:
        name: of the robot.
        links: names of all links, the root first.
        joints: names of the joints that move.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        file = Path(path)
        if not file.is_file():
            raise InputError(f"{file}: no such file")
        pin = load_pinocchio()
        self._model = pinocchio_model(file)
        model = self._model
        self.name = model.name
        self._frames = {f.name: f for f in model.frames if f.type == pin.FrameType.BODY}
        self.links = list(self._frames)
        self.joints = list(model.names)[1:]
        self._axes: dict[int, tuple[int, np.ndarray]] = {}
        for joint in range(1, model.njoints):
            self._axes[joint] = self._local_axis(joint)
        self._zero = self._placements(pin.neutral(model))

    def link(self, argument: str, name: str) -> int:
        """Joint that moves a link; 0 if it rests.

        Raises:
            InputError: there is no such link; the message lists those there are.
        """
        require_name(argument, "link", name, self.links)
        return self._frames[name].parentJoint

    def joint(self, argument: str, name: str) -> int:
        """Number of a joint that moves.

        Raises:
            InputError: there is none of this name; the message lists those there are.
        """
        require_name(argument, "moving joint", name, self.joints)
        return self._model.getJointId(name)

    def joint_name(self, joint: int) -> str:
        """Name of a joint."""
        return self._model.names[joint]

    def chain(self, joint: int) -> list[int]:
        """All joints from the root to one, itself included."""
        return list(self._model.supports[joint])[1:]

    def axis(self, joint: int) -> JointAxis:
        """Axis of a joint at zero joint positions."""
        sigma, local = self._axes[joint]
        R, p = self._zero[joint]
        return JointAxis(sigma, p, R @ local)

    def joint_positions(self, values: Mapping[str, float]) -> np.ndarray:
        """(n,) positions of all joints, rad or m; those that are not given are zero.

        Raises:
            InputError: unknown joint, or not a number.
        """
        q = np.zeros(len(self.joints))
        for name, value in values.items():
            q[self.joint("home", name) - 1] = number_from(f"home[{name!r}]", value)
        return q

    def frames(self, q: np.ndarray) -> dict[str, Frame]:
        """Frames of all links at joint positions (n,), world axes."""
        configuration = load_pinocchio().neutral(self._model)
        for joint, value in enumerate(q, start=1):
            model = self._model.joints[joint]
            first = model.idx_q
            if model.nq == 1:
                configuration[first] = value
            else:  # continuous: cosine and sine
                configuration[first : first + 2] = np.cos(value), np.sin(value)
        placed = self._placements(configuration)
        return {
            name: compose(placed[frame.parentJoint], _pair(frame.placement))
            for name, frame in self._frames.items()
        }

    def inertia(self, joint: int, frame: Frame) -> BodyInertia:
        """Inertia of a joint's body about a frame of it, given at zero joint positions in world axes."""
        R, p = compose(inverse(frame), self._zero[joint])
        moved = load_pinocchio().SE3(R, p).act(self._model.inertias[joint])
        with naming(f"body behind joint {self._model.names[joint]}"):
            return BodyInertia.about_center(moved.mass, moved.lever, 0.5 * (moved.inertia + moved.inertia.T))

    def damping(self, joint: int) -> tuple[float, float]:
        """Viscous and Coulomb friction of a joint, as the file's `dynamics` says."""
        at = self._model.joints[joint].idx_v
        return float(self._model.damping[at]), float(self._model.upperDryFrictionLimit[at])

    def _local_axis(self, joint: int) -> tuple[int, np.ndarray]:
        model = self._model.joints[joint]
        if model.nv != 1:
            raise InputError(
                f"joint {self.joint_name(joint)!r}: only revolute, continuous, prismatic and fixed joints "
                f"can be read, got {model.shortname().removeprefix('JointModel')}"
            )
        subspace = np.ravel(model.createData().S)
        sigma = REVOLUTE if np.linalg.norm(subspace[3:]) > 0.5 else PRISMATIC
        axis = subspace[3:] if sigma == REVOLUTE else subspace[:3]
        return sigma, axis / np.linalg.norm(axis)

    def _placements(self, configuration: np.ndarray) -> list[Frame]:
        data = self._model.createData()
        load_pinocchio().forwardKinematics(self._model, data, configuration)
        return [_pair(placement) for placement in data.oMi]


def require_name(argument: str, kind: str, name: object, known: Iterable[str]) -> None:
    """Raise InputError with all known names unless `name` is one of them."""
    known = list(known)
    if name not in known:
        hint = did_you_mean(name, known)
        raise InputError(f"{argument}: there is no {kind} {name!r}; there are {', '.join(known)}{hint}")


def _pair(placement: Any) -> Frame:
    return placement.rotation.copy(), placement.translation.copy()
