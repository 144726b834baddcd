"""Joint reactions against Pinocchio's free bodies, the motor forces and the wrench on the base."""

import numpy as np
import pinocchio as pin
import pytest

from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.robot import ParallelRobot, base_wrench
from tests.parallel.parallel_examples import extra_leg, five_axes, spu6
from tests.parallel.parallel_twin import Twin, rod_delta
from tests.parallel.test_dependent_coordinates import MECHANISMS, robot_of
from tests.quick import some

ROBOTS = {
    **READY_MADE,
    "3T2R": lambda: five_axes(coupling_mass=True),
    "6SPU": spu6,
    "rods": rod_delta,
    "4RRR": extra_leg,
}
UNIQUE = {
    "6UPS": True,
    "6SPU": True,
    "3RRR": False,
    "Delta": True,
    "4RRR": False,
    "rps3": True,
    "sps6": True,
    "exechon": False,
}


def any_robot(name):
    return robot_of(name) if name in MECHANISMS else ParallelRobot(ROBOTS[name]())


def state_of(robot, seed):
    rng = np.random.default_rng(seed)
    return robot.description.home + 0.02 * rng.uniform(-1, 1, robot.m), *rng.uniform(-0.5, 0.5, (2, robot.m))


@pytest.mark.parametrize("name", some(5, [*ROBOTS, *MECHANISMS]))
def test_joints_carry_motors_base_and_platform(name):
    robot = any_robot(name)
    z, zd, zdd = state_of(robot, 1)
    load = np.array([3.0, -2.0, 5.0, 0.4, 0.3, -0.2]) if name in ("6UPS", "rps3") else np.zeros(6)
    found = robot.joint_reactions(z, zd, zdd, wrench=load)
    assert found.unique == UNIQUE.get(name, found.unique)
    if found.motors.size == robot.m:
        np.testing.assert_allclose(
            found.motors, robot.inverse_dynamics(z, zd, zdd, wrench=load).motors, atol=1e-7
        )
    q = robot.ik(z).q
    on_base, on_platform = np.zeros(6), load.copy()
    R = robot.kinematics.pose(z, q)[1]
    for i, (leg, joints) in enumerate(zip(robot.kinematics.legs, q, strict=True)):
        turns, origins = leg.frames(joints)
        for k, (row, joint) in enumerate(zip(leg.topology.rows, leg.topology.joints, strict=True)):
            own = found.joints[i][k]
            if leg.topology.parents[k] < 0:
                on_base -= np.concatenate([own[:3], own[3:] + np.cross(origins[k], own[:3])])
            if joint is not None:  # along the axis: the motor, nothing in passive joints
                along = turns[k][:, 2] @ (own[3:] if row.sigma == 0 else own[:3])
                motors = dict(zip(robot.description.actuated, found.motors, strict=True))
                assert along == pytest.approx(
                    motors.get((i, joint), 0.0), abs=1e-8 * np.abs(own).max() + 1e-9
                )
        for end, kappa in zip(found.ends[i], leg.couplings, strict=True):
            on_platform += np.concatenate([end[:3], end[3:] + np.cross(R @ kappa, end[:3])])
    np.testing.assert_allclose(
        on_base, base_wrench(robot, z, zd, zdd, load=load), atol=1e-7 * np.abs(on_base).max()
    )
    motion = robot.kinematics.motion(z, robot.kinematics.quasi(z, zd, zdd)[0], q, complete=True)
    body, g = robot.description.platform.inertia, robot.description.gravity
    acceleration = motion.T @ robot.kinematics.quasi(z, zd, zdd)[1] + motion.T_drift
    omega, s = motion.t[3:], R @ body.first_moment
    force = (
        body.mass * (acceleration[:3] - g)
        + np.cross(acceleration[3:], s)
        + np.cross(omega, np.cross(omega, s))
    )
    np.testing.assert_allclose(on_platform[:3], force, atol=1e-7 * np.abs(force).max())


@pytest.mark.parametrize("name", ["6UPS", "6SPU"])
def test_reactions_are_pinocchios(name):
    """Pinocchio's multipliers as forces on its bodies, its Newton-Euler recursion, where they are unique."""
    robot = any_robot(name)
    z, zd, zdd = state_of(robot, 2)
    twin, rates = Twin(robot), robot.passive(z, zd, zdd)
    q, v, a = twin.state(rates, z, zd, zdd)
    right, J = pin.rnea(twin.model, twin.data, q, v, a), twin.closures(q)
    starts = np.concatenate([[0], np.cumsum([leg.n for leg in robot.kinematics.legs])])
    S = np.zeros((twin.model.nv, 6))
    for k, (leg, joint) in enumerate(robot.description.actuated):
        S[starts[leg] + joint, k] = 1
    multipliers = np.linalg.lstsq(np.hstack([S, J.T]), right, rcond=1e-11)[0][6:].reshape(-1, 6)
    outside = pin.StdVec_Force()
    outside.extend([pin.Force.Zero() for _ in range(twin.model.njoints)])
    for (joint, _), wrench in zip(twin.ends, multipliers, strict=True):
        turn = twin.data.oMi[joint].rotation.T
        outside[joint] = pin.Force(turn @ wrench[:3], turn @ wrench[3:])
    pin.rnea(twin.model, twin.data, q, v, a, outside)
    found, joint = robot.joint_reactions(z, zd, zdd), 1
    for leg in found.joints:
        for own in leg:
            turn = twin.data.oMi[joint].rotation
            theirs = np.concatenate([turn @ twin.data.f[joint].linear, turn @ twin.data.f[joint].angular])
            np.testing.assert_allclose(own, theirs, atol=1e-9 * np.abs(leg).max())
            joint += 1
