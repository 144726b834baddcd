"""Payloads on platforms against bodies welded to the platform of the twin in Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from ocptip.parallel.description.ready_made import delta
from ocptip.parallel.robot import ParallelRobot, base_wrench
from ocptip.robots.payload import Payload
from tests.parallel.parallel_cases import KIND_NAMES
from tests.parallel.parallel_twin import Twin, random_robot, relative

PART = Payload(3.0, [0.03, -0.05, 0.12], [0.04, 0.002, -0.001, 0.05, 0.003, 0.03])


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_motor_forces_and_base_wrench_are_those_of_a_welded_body(kind):
    robot, z, zd, zdd = random_robot(kind, 4)
    twin = Twin(robot)
    body = pin.Inertia(PART.mass, PART.center_of_mass.copy(), PART.inertia.copy())
    twin.model.appendBodyToJoint(twin.platform, body, pin.SE3.Identity())
    twin.data = twin.model.createData()
    loaded = ParallelRobot(robot.description.with_payload(PART))
    q = [leg.home for leg in loaded.kinematics.legs]
    expected, residual, _ = twin.motor_forces(z, zd, zdd)
    assert residual < 1e-11
    assert relative(loaded.inverse_dynamics(z, zd, zdd, q).motors, expected) < 1e-11
    assert relative(base_wrench(loaded, z, zd, zdd, q=q), twin.base_wrench(z, zd, zdd)) < 1e-12
    assert loaded.description.moving_mass == pytest.approx(robot.description.moving_mass + 3.0)


def test_a_payload_is_replaced_and_taken_away_to_the_last_bit():
    robot = delta()
    loaded = robot.with_payload(Payload(1.0)).with_payload(PART)
    assert loaded.platform.payload is PART
    np.testing.assert_array_equal(loaded.inertia_vector, robot.with_payload(PART).inertia_vector)
    free = loaded.with_payload(None)
    assert (free.platform.payload, free.platform.bare) == (None, None)
    np.testing.assert_array_equal(free.inertia_vector, robot.inertia_vector)
