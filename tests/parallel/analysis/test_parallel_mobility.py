"""Mobility of good and bad robots; singular poses of every type."""

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.analysis.mobility import mobility, require_mobility
from ocptip.parallel.analysis.singularity import free_screw
from ocptip.parallel.description.ready_made import READY_MADE, delta, rpr3, rrr3, ups6
from ocptip.parallel.kinematics.platform import Kinematics
from ocptip.parallel.robot import ParallelRobot
from tests.parallel.parallel_examples import five_axes, redundant_leg, vertical_delta
from tests.parallel.parallel_twin import rod_delta

DEGREES = {"3RRR": 3, "3RPR": 3, "Delta": 3, "4PRRR": 4, "6UPS": 6}


@pytest.mark.parametrize("name", DEGREES)
def test_ready_made_robots_move_as_described(name):
    found = require_mobility(Kinematics(READY_MADE[name]()))
    assert found.dof == found.platform_dof == found.coordinates == found.motors == DEGREES[name]
    assert found.internal_dof == 0
    assert found.gap > 1e6
    assert found.consistent
    assert found.to_dict()["dof"] == DEGREES[name]


def test_over_constraints_are_counted():
    assert (
        mobility(Kinematics(rrr3())).over_constraints == 6
    )  # three planar loops less one: 3 per leg but one
    assert mobility(Kinematics(ups6())).over_constraints == 0
    rods = mobility(Kinematics(rod_delta()))
    assert (rods.dof, rods.over_constraints) == (3, 6)


def test_vertical_delta_is_refused_with_its_mobility():
    with pytest.raises(InputError, match="mobility 4, but 3 coordinates"):
        ParallelRobot(vertical_delta())
    looked_at = ParallelRobot(vertical_delta(), check=False).mobility()
    assert (looked_at.dof, looked_at.platform_dof) == (4, 4)
    assert not looked_at.consistent


def test_coordinates_that_the_legs_do_not_allow():
    planar = rrr3()
    tilted = dataclasses.replace(planar.platform, mask=(1, 1, 0, 1, 0, 0))
    with pytest.raises(InputError, match=r"can be assembled|does not allow"):
        ParallelRobot(dataclasses.replace(planar, platform=tilted))


@pytest.mark.parametrize("make", [rrr3, rpr3])
@pytest.mark.parametrize(
    "changed",
    [
        lambda leg: {"base_position": (*leg.base_position[:2], 0.1)},
        lambda leg: {"base_position": (*leg.base_position[:2], 1e-7)},
        lambda leg: {"base_rotation": (("x", 0.01), *leg.base_rotation)},
        lambda leg: {"base_rotation": (*leg.base_rotation, ("y", 0.01))},
        lambda leg: {"coupling": (*leg.coupling[:2], 0.1)},
    ],
)
def test_planar_robots_with_a_leg_off_the_plane_are_refused(make, changed):
    robot = make()
    leg = robot.legs[1]
    legs = (robot.legs[0], dataclasses.replace(leg, **changed(leg)), robot.legs[2])
    with pytest.raises(
        InputError, match=r"leg 2 does not reach .* m beside the plane|leg 2 does not reach it"
    ):
        ParallelRobot(dataclasses.replace(robot, legs=legs))


def test_internal_motions():
    found = mobility(Kinematics(redundant_leg()))
    assert (found.dof, found.internal_dof, found.platform_dof) == (4, 1, 3)
    assert found.consistent
    forgotten = dataclasses.replace(redundant_leg(), redundant=(), home=np.zeros(3))
    with pytest.raises(InputError, match="motions of the legs leave the platform at rest"):
        ParallelRobot(forgotten)


def test_five_axes():
    found = mobility(Kinematics(five_axes()))
    assert (found.dof, found.over_constraints, found.consistent) == (5, 4, True)


@pytest.mark.slow
def test_similar_hexagons_are_singular_everywhere():
    with pytest.raises(
        InputError, match=r"singular in every checked pose.*platform \(type II\).* do not hold the rot"
    ):
        ParallelRobot(ups6(gap=np.pi / 3))
    robot = ParallelRobot(ups6(gap=np.pi / 3), check=False)
    assert not robot.mobility().consistent
    rng = np.random.default_rng(0)
    for _ in range(5):
        z = robot.description.home + rng.uniform(-0.05, 0.05, 6) * [1, 1, 1, 0, 0, 1]
        found = robot.singularity(z)
        assert found.platform < 1e-12
        assert found.kinds == ("platform (type II)",)
        with pytest.raises(SolverError, match=r"singular pose .*platform \(type II\)"):
            robot.inverse_dynamics(z, np.zeros(6), np.zeros(6))
    paired = ParallelRobot(ups6())
    assert paired.singularity(paired.description.home).platform > 0.1


def test_stretched_leg_is_type_one():
    robot = ParallelRobot(rrr3())
    stretched = robot.singularity([0.0, -0.5, 0.0])
    assert stretched.kinds == ("leg 1 (type I)",)
    assert abs(stretched.pair.b[0]) < 1e-12
    assert abs(np.linalg.det(stretched.pair.A)) > 1e-3
    assert stretched.to_dict()["singular"] == ["leg 1 (type I)"]
    for dynamics in (
        lambda z: robot.inverse_dynamics(z, np.zeros(3), np.zeros(3)),
        lambda z: robot.forward_dynamics(z, np.zeros(3), np.zeros(3)),
    ):
        with pytest.raises(SolverError, match=r"leg 1 \(type I\)"):
            dynamics([0.0, -0.5, 0.0])
    assert robot.singularity([0.0, -0.45, 0.0]).regular


def test_poses_next_to_singular_ones_are_refused_with_the_leg_or_the_screw():
    planar, hexapod = ParallelRobot(rrr3()), ParallelRobot(ups6())
    for ahead in (1e-13, 1e-9):
        with pytest.raises(SolverError, match=r"leg 1 \(type I\); measures"):
            planar.inverse_dynamics([0.0, ahead - 0.5, 0.0], np.ones(3), np.zeros(3))
    rest = np.zeros(6)
    for ahead in (1e-6, 1e-4):
        with pytest.raises(SolverError, match=r"do not hold the rotation about \[0.0, 0.0, 1.0\] through"):
            hexapod.inverse_dynamics([0, 0, 0.6, 0, 0, np.pi / 2 - ahead], rest, rest)
    assert np.isfinite(hexapod.inverse_dynamics([0, 0, 0.6, 0, 0, np.pi / 2 - 0.1], rest, rest).motors).all()


def test_screw_that_the_motors_do_not_hold_leaves_their_lengths():
    robot = ParallelRobot(ups6())
    z = np.array([0, 0, 0.6, 0, 0, np.pi / 2])
    q = robot.ik(z).q
    screw = free_screw(robot.kinematics, z, q, complete=True)
    omega = screw.direction
    v = screw.pitch * omega - np.cross(omega, screw.point - z[:3])
    assert np.abs(robot.jacobian(z, q) @ np.concatenate([v, omega])).max() < 1e-12
    # Similar triangles whose legs are parallel: the motors hold no translation across them.
    z = np.array([1.0, 0.0, 0.0])
    parallel = ParallelRobot(dataclasses.replace(rpr3(base=0.3, twist=0.0), home=z))
    screw = free_screw(parallel.kinematics, z, parallel.ik(z).q, complete=True)
    assert screw.point is None
    assert str(screw) == "translation along [0.0, 1.0, 0.0]"


def test_concurrent_legs_are_type_two_and_the_pair_changes_sign():
    robot = ParallelRobot(rpr3(twist=0.0))
    home = robot.singularity(np.zeros(3))
    assert home.kinds == ("platform (type II)",)
    sides = [np.linalg.det(robot.singularity([0.01, 0.0, phi]).pair.A) for phi in (-0.05, 0.05)]
    assert sides[0] * sides[1] < 0
    # The platform flies freely there all the same: forward dynamics does not need the motors to hold it.
    assert np.all(np.isfinite(robot.forward_dynamics(np.zeros(3), np.zeros(3), np.zeros(3))))


@pytest.mark.parametrize("name", DEGREES)
def test_implicit_pair_is_the_jacobian(name):
    robot = ParallelRobot(READY_MADE[name]())
    z = robot.description.home + 0.03
    pair = robot.singularity(z).pair
    np.testing.assert_allclose(pair.A, pair.b[:, None] * robot.jacobian(z), atol=1e-12)


@pytest.mark.parametrize(("convention", "angle"), [("xyz", np.pi / 2), ("zyx", np.pi / 2), ("zxz", 0.0)])
def test_singular_euler_angles(convention, angle):
    robot = ParallelRobot(ups6())
    turned = dataclasses.replace(robot.description.platform, convention=convention)
    euler = Kinematics(dataclasses.replace(robot.description, platform=turned)).platform
    z = np.array([0, 0, 0.6, 0.1, angle, 0.2])
    assert euler.conditioning(z) < 1e-12
    assert euler.conditioning(z + 0.3 * np.eye(6)[4]) > 0.1


def test_delta_workspace_end():
    robot = ParallelRobot(delta())
    with pytest.raises(InputError, match="leg 1 does not reach"):
        robot.inverse_dynamics([0, 0, -2.0], np.zeros(3), np.zeros(3))


def test_crossings_between_samples_are_found():
    flat = ParallelRobot(rpr3(twist=0.0))
    path = np.array([[0.01, 0.0, phi] for phi in (-0.3, -0.1, 0.12, 0.3)])
    assert all(flat.singularity(z).regular for z in path)
    (crossing,) = flat.crossings(path)
    assert (crossing.sample, crossing.kinds) == (1, ("platform (type II)",))
    assert flat.singularity(crossing.z).platform < 1e-6
    assert crossing.to_dict()["sample"] == 1
    assert not flat.crossings(path[:2])
    (there,) = flat.crossings([[0.0, 0.0, -0.2], [0.0, 0.0, 0.0], [0.0, 0.0, 0.2]])
    assert (there.sample, there.share) == (1, 0.0)
    more = dataclasses.replace(flat.description, actuated=((0, 0), (0, 1), (1, 0), (2, 0)))
    with pytest.raises(InputError, match="as many motors"):
        ParallelRobot(more).crossings(path)


def test_other_elbow_changes_the_sign_of_its_leg_only():
    robot = ParallelRobot(rrr3())
    elbows = [leg.home[:2] for leg in robot.kinematics.legs]
    one = robot.singularity(np.zeros(3), elbows).pair
    # In the home pose the coupling point lies on the leg's own x axis, so that mirroring is negation.
    other = robot.singularity(np.zeros(3), [-elbows[0], *elbows[1:]]).pair
    assert one.b[0] == pytest.approx(-other.b[0])
    np.testing.assert_allclose(one.b[1:], other.b[1:])
