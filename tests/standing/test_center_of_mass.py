"""The centre of mass of base and arm, and the tilt of the floor that tips both."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.contact.support import Support
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.robots.payload import Payload


def turned(robot, rotation):
    own = robot.support
    gravity = rotation.apply(own.gravity)
    return robot.varied(
        support=Support(own.contacts, mass=own.mass, center_of_mass=own.center_of_mass, gravity=gravity)
    )


@pytest.fixture(scope="module")
def robot():
    robot = experiment_robot(motion_case("A"), "printed")
    return robot.varied(arm=robot.arm.with_payload(Payload(2.0, [0.03, 0.0, 0.1])))


def test_weight_acts_there(robot):
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (5, robot.n))
    centers = robot.center_of_mass(q)
    wrenches = robot.loads(q, 0 * q, 0 * q)[1]
    arms = centers - robot.support.center_of_mass
    np.testing.assert_allclose(np.cross(arms, wrenches[:, :3]), wrenches[:, 3:], atol=1e-9)
    skewed = turned(robot, Rotation.from_euler("xy", [0.3, -0.2])).loads(q, 0 * q, 0 * q)[1]
    np.testing.assert_allclose(np.cross(arms, skewed[:, :3]), skewed[:, 3:], atol=1e-9)


def test_static_angle_is_the_floor_tilt_that_tips_base_and_arm(robot):
    q = np.zeros(robot.n)
    angle = float(robot.classical(q).static_angle)
    slope, offset = robot.tip_over.affine_moments

    def least(tilt):
        """Minimum tipping moment on floors tilted by so much, in 24 directions and 24 near the worst."""

        def moment(around):
            axis = np.array([np.cos(around), np.sin(around), 0.0])
            other = turned(robot, Rotation.from_rotvec(tilt * axis))
            wrench = other.loads(q[None], 0 * q[None], 0 * q[None])[1][0]
            return np.min(slope @ wrench + offset)

        coarse = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        return min(map(moment, min(coarse, key=moment) + np.linspace(-0.27, 0.27, 25)))

    assert least(0.999 * angle) > 0
    assert least(1.001 * angle) < 0
