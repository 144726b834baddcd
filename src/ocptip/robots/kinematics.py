"""Forward kinematics and geometric Jacobian: one definition in CasADi, evaluated for many states in NumPy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.text import did_you_mean
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.model import ArmModel, joint_states

_CACHED_MODELS = 64


def relative_rotation(model: ArmModel, index: int, q: cs.SX) -> cs.SX:
    """A_{i-1,i} (3, 3) of joint i = index + 1; for the first joint A_{B,1}, from frame 1 to base axes."""
    constant = model.mount_rotation @ model.rotations[0] if index == 0 else model.rotations[index]
    if model.slides[index]:
        return cs.SX(constant)
    c, s = cs.cos(q), cs.sin(q)
    turn = cs.vertcat(cs.horzcat(c, -s, 0), cs.horzcat(s, c, 0), cs.horzcat(0, 0, 1))
    return cs.SX(constant) @ turn


def slide(model: ArmModel, index: int, q: cs.SX) -> cs.SX:
    """(3, 1), m, frame i: how far joint i = index + 1 moves Q_i; zero if it turns."""
    return cs.vertcat(0, 0, q) if model.slides[index] else cs.SX.zeros(3)


def joint_values(model: ArmModel, q: cs.SX) -> list[cs.SX]:
    """Values of the joints of all links, rad or m; q (n,)."""
    return cs.vertsplit(q) if model.coupling is None else model.coupling.joints(q)


def joint_rates(model: ArmModel, rates: cs.SX) -> list[cs.SX]:
    """Speeds, or accelerations, of the links' joints from those of the coordinates."""
    return cs.vertsplit(rates) if model.coupling is None else model.coupling.rates(rates)


def chain(model: ArmModel, q: cs.SX) -> tuple[list[cs.SX], list[cs.SX]]:
    """Link frames as CasADi expressions (2.32, 2.33, 2.38).

    Args:
        q: (n,), rad (sliding joints: m, here and below).

    Returns:
        rotations: A_{B,1} .. A_{B,L}, A_{B,G}, each (3, 3).
        origins: Q_1 .. Q_L, G, each (3, 1), m, base frame.
    """
    rotations: list[cs.SX] = []
    origins: list[cs.SX] = []
    rotation, origin = cs.SX.eye(3), cs.SX(model.mount_position)
    for index, value in enumerate(joint_values(model, q)):
        rotation = rotation @ relative_rotation(model, index, value)
        origin = origin + rotation @ slide(model, index, value)
        rotations.append(rotation)
        origins.append(origin)
        origin = origin + rotation @ cs.SX(model.offsets[index])
    return [*rotations, rotation @ cs.SX(model.tool_rotation)], [*origins, origin]


@lru_cache(maxsize=_CACHED_MODELS)
def forward_kinematics(model: ArmModel) -> cs.Function:
    """CasADi function of the link frames; built once per model.

    In: q (n,), rad. Out: `rotations` (3, 3 (L+1)), the blocks A_{B,1} .. A_{B,L}, A_{B,G} side by side;
    `origins` (3, L+1), m, base frame: Q_1 .. Q_L, G.
    """
    q = cs.SX.sym("q", model.n)
    rotations, origins = chain(model, q)
    outputs = [cs.horzcat(*rotations), cs.horzcat(*origins)]
    return cs.Function("forward_kinematics", [q], outputs, ["q"], ["rotations", "origins"])


@lru_cache(maxsize=_CACHED_MODELS)
def gripper_kinematics(model: ArmModel) -> cs.Function:
    """CasADi function of gripper pose and geometric Jacobian; built once per model.

    In: q (n,), rad. Out: `position` (3,), m, base frame; `rotation` (3, 3), gripper to base axes; `jacobian`
    (6, n), base axes: rows 1-3 velocity of G per joint speed, m (sliding joints: 1); rows 4-6 angular
    velocity.
    """
    q = cs.SX.sym("q", model.n)
    rotations, origins = chain(model, q)
    tip = origins[-1]
    columns = []
    for rotation, origin, slides in zip(rotations[:-1], origins[:-1], model.slides, strict=True):
        axis = rotation[:, 2]
        turning = cs.vertcat(cs.cross(axis, tip - origin), axis)
        columns.append(cs.vertcat(axis, cs.SX.zeros(3)) if slides else turning)
    if model.coupling is not None:
        columns = model.coupling.gathered(columns)
    outputs = [tip, rotations[-1], cs.horzcat(*columns)]
    return cs.Function("gripper_kinematics", [q], outputs, ["q"], ["position", "rotation", "jacobian"])


@dataclass(frozen=True, eq=False)
class LinkFrames:
    """Frames of all links and the gripper at N states (no leading N for a single state).

    Attributes:
        rotations: (N, L+1, 3, 3): A_{B,1} .. A_{B,L}, A_{B,G}.
        origins: (N, L+1, 3), m, base frame: Q_1 .. Q_L, G.
    """

    rotations: np.ndarray
    origins: np.ndarray


def link_frames(model: ArmModel, q: np.ndarray) -> LinkFrames:
    """Frames of all links and the gripper.

    Args:
        q: (N, n) or (n,), rad.

    Raises:
        InputError: wrong shape or not finite.
    """
    states, single = joint_states("q", q, model.n)
    rotations, origins = _frames_batch(model)(states)
    blocks = rotations.reshape(len(states), 3, model.links + 1, 3).transpose(0, 2, 1, 3)
    points = origins.transpose(0, 2, 1)
    return LinkFrames(blocks[0], points[0]) if single else LinkFrames(blocks, points)


def gripper_pose(model: ArmModel, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position (N, 3), m, and rotation (N, 3, 3) of the gripper in the base frame at q (N, n) or (n,), rad.

    Raises:
        InputError: wrong shape or not finite.
    """
    states, single = joint_states("q", q, model.n)
    position, rotation, _ = gripper_batch(model)(states)
    return (position[0], rotation[0]) if single else (position, rotation)


def jacobian(model: ArmModel, q: np.ndarray) -> np.ndarray:
    """Geometric Jacobian (N, 6, n) of the gripper at q (N, n) or (n,), rad; base axes, linear rows first.

    Raises:
        InputError: wrong shape or not finite.
    """
    states, single = joint_states("q", q, model.n)
    result = gripper_batch(model)(states)[2]
    return result[0] if single else result


@lru_cache(maxsize=_CACHED_MODELS)
def _frames_batch(model: ArmModel) -> BatchFunction:
    return BatchFunction(forward_kinematics(model))


@lru_cache(maxsize=_CACHED_MODELS)
def gripper_batch(model: ArmModel) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """`gripper_kinematics` for many states (N, n): (N, 3), (N, 3, 3), (N, 6, n)."""
    evaluate = BatchFunction(gripper_kinematics(model))

    def batch(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        position, rotation, columns = evaluate(q)
        return position, rotation, columns.reshape(-1, 6, model.n)  # of one joint a single column

    return batch


TCP = "tcp"
_STILL = 1e-12  # (m/s)^2 below the root, so that a point at rest has derivatives


def checked_points(arm: ArmModel, limits: Mapping[str, float] | None) -> dict[str, float]:
    """Speed limits of points by name, m/s: `TCP`, or a joint, where its link begins.

    Raises:
        InputError: there is no such joint, or a value is not above 0.
    """
    table, joints = {}, joint_names(arm)
    for name, value in (limits or {}).items():
        if name not in (TCP, *joints):
            known = f"there are {', '.join(joints)}{did_you_mean(name, joints)}"
            raise InputError(f"no joint {name!r}; {known}", "speed_limits")
        table[name] = positive_number(f"speed_limits.{name}", value)
    return table


class PointSpeeds:
    """Speeds of some points of an arm.

    Args:
        arm: whose.
        points: names, see `checked_points`.
    """

    def __init__(self, arm: ArmModel, points: Iterable[str]) -> None:
        self._arm, self._points = arm, tuple(points)

    @cached_property
    def _function(self) -> BatchFunction:
        q, qd = cs.SX.sym("q", self._arm.n), cs.SX.sym("qd", self._arm.n)
        places = dict(zip((*joint_names(self._arm), TCP), chain(self._arm, q)[1], strict=True))
        velocities = [cs.jtimes(places[name], q, qd) for name in self._points]
        speeds = cs.vertcat(*(cs.sqrt(cs.sumsqr(velocity) + _STILL) for velocity in velocities))
        return BatchFunction(cs.Function("point_speeds", [q, qd], [speeds]))

    def __call__(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, k), m/s, at joint values and speeds (N, n)."""
        return self._function(q, qd)[0] if self._points else np.empty((len(q), 0))

    def expressions(self, q: cs.SX, qd: cs.SX) -> cs.SX:
        """Speeds of the points as CasADi column (k,), m/s."""
        return self._function.function(q, qd) if self._points else cs.SX(0, 1)


def joint_names(arm: ArmModel) -> tuple[str, ...]:
    """Names of all joints, one per link."""
    return arm.joint_names if arm.coupling is None else arm.coupling.names
