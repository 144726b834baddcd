"""Arms of Denavit and Hartenberg's tables against models that Pinocchio builds joint by joint."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pinocchio as pin
import pytest

from ocptip.robots.dh import Convention, DHRow, arm_from_dh
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.kinematics import gripper_pose

_GRAVITY = np.array([0.3, -0.5, -9.7])


def _table(rng: np.random.Generator, n: int) -> list[DHRow]:
    rows = []
    for k in range(n):
        spread = rng.normal(size=(3, 3))
        rows.append(
            DHRow(
                *rng.uniform(-1, 1, 4),
                slides=k == 2,
                mass=rng.uniform(0.5, 3),
                center_of_mass=rng.uniform(-0.2, 0.2, 3),
                inertia=0.01 * spread @ spread.T + 0.01 * np.eye(3),
            )
        )
    return rows


def _about(axis: str, angle: float) -> pin.SE3:
    return pin.SE3(pin.utils.rotate(axis, angle), np.zeros(3))


def _along(x: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, 0.0, z]))


def _model(rows: list[DHRow], convention: str) -> tuple[pin.Model, pin.SE3]:
    """The model, and its last frame in the last joint's."""
    model, before = pin.Model(), pin.SE3.Identity()
    model.gravity = pin.Motion(_GRAVITY, np.zeros(3))
    joint = 0
    for k, row in enumerate(rows):
        if convention == "standard":
            place, after = before * _about("z", row.theta), _along(row.a, row.d) * _about("x", row.alpha)
        else:
            place = _about("x", row.alpha) * _along(row.a, 0.0) * _about("z", row.theta) * _along(0.0, row.d)
            after = pin.SE3.Identity()
        kind = pin.JointModelPZ() if row.slides else pin.JointModelRZ()
        joint = model.addJoint(joint, kind, place, f"joint {k}")
        model.appendBodyToJoint(joint, pin.Inertia(row.mass, row.center_of_mass, row.inertia), after)
        before = after
    return model, before


@pytest.mark.parametrize("convention", get_args(Convention))
@pytest.mark.parametrize("seed", range(3))
def test_poses_and_torques_are_those_of_pinocchio(seed: int, convention: Convention) -> None:
    rng = np.random.default_rng(seed)
    rows = _table(rng, 6)
    arm = arm_from_dh("arm", rows, convention)
    model, last = _model(rows, convention)
    data = model.createData()
    q, qd, qdd = rng.uniform(-1, 1, (3, 6))
    pin.forwardKinematics(model, data, q)
    frame = data.oMi[6] * last
    position, rotation = gripper_pose(arm, q)
    assert np.abs(position - frame.translation).max() < 1e-12
    assert np.abs(np.reshape(rotation, (3, 3)) - frame.rotation).max() < 1e-12
    torque = evaluate_dynamics(arm, q[None], qd[None], qdd[None], gravity=_GRAVITY).torque[0]
    expected = pin.rnea(model, data, q, qd, qdd)
    assert np.abs(torque - expected).max() < 1e-12 * max(1.0, np.abs(expected).max())
