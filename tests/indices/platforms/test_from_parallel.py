import dataclasses
import math

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.parallel_robots import planar_pose_of_robot, platform_of_robot
from ocptip.parallel.description.ready_made import delta, rpr3, rrr3, ups6


def test_hexapod():
    content = platform_of_robot(ups6(base=0.5, platform=0.2, height=0.6))
    np.testing.assert_allclose(np.linalg.norm(content.platform.base, axis=1), 0.5)
    np.testing.assert_allclose(np.linalg.norm(content.platform.platform, axis=1), 0.2)
    np.testing.assert_allclose(content.position, [0, 0, 0.6])
    np.testing.assert_array_equal(content.rotation, np.eye(3))
    pose = content.platform.at(content.position, content.rotation)
    assert 0.01 < control_number(pose).value < 1
    similar = platform_of_robot(ups6(gap=math.pi / 3))
    assert control_number(similar.platform.at(similar.position)).value == 0.0


def test_home_pose_uses_the_convention_of_the_robot():
    robot = ups6()
    home = np.array([0.0, 0.1, 0.6, 0.1, 0.2, 0.3])
    turned = dataclasses.replace(
        robot, home=home, platform=dataclasses.replace(robot.platform, convention="zyx")
    )
    content = platform_of_robot(turned)
    c, s = math.cos(0.1), math.sin(0.1)
    Rz = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = math.cos(0.2), math.sin(0.2)
    Ry = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = math.cos(0.3), math.sin(0.3)
    Rx = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    np.testing.assert_allclose(content.rotation, Rz @ Ry @ Rx, atol=1e-14)
    np.testing.assert_allclose(content.position, home[:3])


def test_planar_robot():
    pose = planar_pose_of_robot(rpr3(base=1.0, platform=0.3))
    np.testing.assert_allclose(np.linalg.norm(pose.base, axis=1), 1.0)
    moved = planar_pose_of_robot(rpr3(base=1.0, platform=0.3), [0.1, -0.2, 0.4])
    centre = moved.platform.mean(axis=0)
    np.testing.assert_allclose(centre, [0.1, -0.2], atol=1e-12)
    still = planar_pose_of_robot(rpr3(base=1.0, platform=0.3), [0.0, 0.0, 0.0]).platform
    c, s = math.cos(0.4), math.sin(0.4)
    np.testing.assert_allclose(moved.platform - centre, still @ [[c, s], [-s, c]], atol=1e-12)
    assert 0 < control_number(pose).value < 1


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: platform_of_robot(delta()), "not of kind UPS: its platform moves in x, y, z"),
        (lambda: platform_of_robot("6UPS"), "expected a RobotDescription"),
        (lambda: planar_pose_of_robot(rrr3()), "leg 1 is not of kind RPR"),
        (lambda: planar_pose_of_robot(ups6()), "not of kind RPR: its platform moves in x, y, z, phi1"),
        (lambda: planar_pose_of_robot(rpr3(), [0.0, 0.0]), "coordinates: expected shape 3"),
        (
            lambda: platform_of_robot(dataclasses.replace(ups6(), actuated=tuple((k, 0) for k in range(6)))),
            "needs one motor in the prismatic joint of every leg",
        ),
    ],
)
def test_other_robots_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
