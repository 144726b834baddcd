"""All assembly modes: known numbers, closed forms, poses that are there, independence of size and place."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.numerics.quadrics import Deformation, distinct, follow, polished, total_degree
from ocptip.parallel.analysis.leg_surfaces import held_leg
from ocptip.parallel.description.platform import BodyInertia, Platform
from ocptip.parallel.description.ready_made import READY_MADE, delta, make_robot, rpr3, rrr3, ups6
from ocptip.parallel.description.robot_description import MDHRow, RobotDescription, SerialLeg
from ocptip.parallel.kinematics.leg_solver import LegSolver
from ocptip.parallel.robot import ParallelRobot
from ocptip.task_files.parallel import read_parallel_robot
from tests.places import EXAMPLES
from tests.quick import some

_BODY = BodyInertia.about_center(1.0)


def _motors(robot: ParallelRobot, z: np.ndarray) -> np.ndarray:
    q = robot.ik(z).q
    return np.array([q[leg][joint] for leg, joint in robot.description.actuated])


def _example(name: str) -> ParallelRobot:
    return ParallelRobot(read_parallel_robot(EXAMPLES / "robots" / f"{name}.toml"))


@pytest.mark.parametrize(
    ("name", "paths"), some(2, [("3RRR", 6), ("3RPR", 6), ("Delta", 2), ("4PRRR", 6), ("6UPS", 40)])
)
def test_modes_hold_the_pose_that_the_motors_come_from(name: str, paths: int) -> None:
    robot = ParallelRobot(READY_MADE[name]())
    z = robot.description.home + 0.03 * np.random.default_rng(3).normal(size=robot.m)
    found = robot.assembly_modes(_motors(robot, z))
    assert found.paths == paths
    assert found.complete
    assert all(mode.certified and mode.residual < 1e-12 for mode in found.modes)
    gaps = [np.abs(mode.z - z).max() for mode in found.modes if mode.home_branches]
    assert min(gaps) < 1e-9
    for mode in found.modes:
        if mode.home_branches:
            assert np.abs(_motors(robot, mode.z) - found.qa).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("name", "modes"), some(1, [("rps3", 16), ("prs3", 8), ("sps6", 8)]))
def test_example_files(name: str, modes: int) -> None:
    robot = _example(name)
    found = robot.assembly_modes(_motors(robot, robot.description.home))
    assert found.complete
    assert len(found.modes) == modes
    assert min(np.abs(mode.z[: robot.m] - robot.description.home).max() for mode in found.modes) < 1e-9


def test_delta_by_three_spheres() -> None:
    robot = ParallelRobot(delta())
    z = np.array([0.05, -0.03, -0.4])
    found = robot.assembly_modes(_motors(robot, z))
    assert len(found.modes) == 2
    q = robot.ik(z).q
    knees = np.array(
        [leg.frames(own)[1][1] - leg.couplings[0] for leg, own in zip(robot.kinematics.legs, q, strict=True)]
    )
    normal = np.cross(knees[1] - knees[0], knees[2] - knees[0])
    mirrored = z - 2 * normal * (normal @ (z - knees[0])) / (normal @ normal)
    assert min(np.abs(mode.z - mirrored).max() for mode in found.modes) < 1e-12


@pytest.mark.parametrize("make", [rrr3, rpr3])
def test_planar_robots_by_the_coupler_curve(make) -> None:
    """Legs 1 and 2 let the platform follow a curve; where it meets the circle of leg 3 are the poses."""
    robot = ParallelRobot(make())
    z = np.array([0.07, -0.04, 0.3])
    found = robot.assembly_modes(_motors(robot, z))
    q = robot.ik(z).q
    rrr = make is rrr3
    ends = [
        (leg.frames(own)[1][1 if rrr else 0][:2], 0.6 if rrr else own[1])
        for leg, own in zip(robot.kinematics.legs, q, strict=True)
    ]
    kappas = np.array([leg.couplings[0][:2] for leg in robot.kinematics.legs])
    phi = np.linspace(-np.pi, np.pi, 200_001)
    turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
    places = np.einsum("ijp,kj->kpi", turn, kappas)
    first, second = (ends[i][0] - places[i] for i in range(2))  # circles of r about them
    between = second - first
    square = np.sum(between**2, axis=1)
    along = (ends[0][1] ** 2 - ends[1][1] ** 2 + square) / (2 * square)
    height = ends[0][1] ** 2 / square - along**2
    count = 0
    for sign in (1, -1):
        side = np.sqrt(np.where(height >= 0, height, np.nan))[:, None] * between[:, ::-1] * [-sign, sign]
        r = first + along[:, None] * between + side
        miss = np.linalg.norm(r + places[2] - ends[2][0], axis=1) - ends[2][1]
        count += np.count_nonzero(miss[1:] * miss[:-1] < 0)
    assert found.complete
    assert len(found.modes) == count


def _direction_leg(angle: float, tilt: float, arc: float, end: np.ndarray) -> SerialLeg:
    rows = (MDHRow(), MDHRow(alpha=arc), MDHRow(alpha=arc))
    return SerialLeg(
        rows,
        2,
        (_BODY, _BODY),
        base_rotation=(("z", angle), ("x", tilt)),
        end_rotation=end,
        guess=(0.3, 0.9, 0.2),
    )


@pytest.mark.slow
def test_spherical_robot_has_at_most_eight() -> None:
    legs = []
    for k in range(3):
        leg = _direction_leg(2.1 * k, 0.9 + 0.05 * k, 1.2, np.eye(3))
        rotations, _ = LegSolver(k, leg).frames(np.array([0.3 + 0.1 * k, 0.9, 0.2]))
        legs.append(dataclasses.replace(leg, end_rotation=rotations[-1].T))
    description = RobotDescription(
        "3-RRR sphere",
        tuple(legs),
        Platform((0, 0, 0, 1, 1, 1), "xyz", BodyInertia.about_center(1.0, (0, 0, 0), (1, 1, 1))),
        ((0, 0), (1, 0), (2, 0)),
        np.zeros(3),
    )
    robot = ParallelRobot(description)
    found = robot.assembly_modes(_motors(robot, np.zeros(3)))
    assert found.paths == 8
    assert found.complete
    assert min(np.abs(mode.z).max() for mode in found.modes) < 1e-9


@pytest.mark.slow
def test_general_hexapods_have_forty_complex_solutions_wherever_they_stand() -> None:
    rng = np.random.default_rng(11)
    base, platform = rng.normal(size=(2, 6, 3))
    counts = []
    for scale, shift in ((1.0, 0.0), (30.0, 100.0)):
        robot = make_robot(
            "6UPS",
            base_angles=np.zeros(6),
            base_positions=base * scale + shift,
            coupling_points=platform * scale,
            bodies=(_BODY,) * 3,
            platform=_BODY,
            home=[shift + 0.3 * scale, shift, shift + scale, 0.4, 0.2, -0.3],
        )
        robot = ParallelRobot(robot)
        found = robot.assembly_modes(_motors(robot, robot.description.home))
        assert found.regular == 40
        assert found.complete
        counts.append(len(found.modes))
    assert counts[0] == counts[1] > 0


@pytest.mark.slow
def test_all_modes_of_a_hexapod_with_forty_real_ones() -> None:
    """P. Dietmaier, The Stewart-Gough platform of general geometry can have 40 real postures, 1998."""
    base = [(0, 0, 0), (1.107915, 0, 0), (0.549094, 0.756063, 0), (0.735077, -0.223935, 0.525991)]
    base += [(0.514188, -0.526063, -0.368418), (0.590473, 0.094733, -0.205018)]
    tool = [(0, 0, 0), (0.542805, 0, 0), (0.956919, -0.528915, 0), (0.665885, -0.353482, 1.402538)]
    tool += [(0.478359, 1.158742, 0.107672), (-0.137087, -0.235121, 0.353913)]
    robot = ups6()
    legs = [
        dataclasses.replace(leg, base_position=foot, coupling=hold, base_rotation=())
        for leg, foot, hold in zip(robot.legs, base, tool, strict=True)
    ]
    home = np.array([0.3, 0.2, 1.0, 0.1, 0.2, 0.3])
    robot = dataclasses.replace(robot, legs=tuple(legs), home=home)
    found = ParallelRobot(robot).assembly_modes([1.0, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071])
    assert (found.regular, found.complete, len(found.modes)) == (40, True, 40)
    assert all(mode.certified and mode.residual < 1e-12 for mode in found.modes)


def test_five_bar_by_circles() -> None:
    """Its distal links meet where two circles about the elbows do."""
    robot = _example("five_bar")
    motors, rng = _motors(robot, robot.description.home), np.random.default_rng(1)
    for _ in range(5):
        qa = motors + 0.4 * rng.uniform(-1, 1, 2)
        elbows = np.array([[-0.15, 0.0], [0.15, 0.0]]) + 0.25 * np.column_stack([np.cos(qa), np.sin(qa)])
        between = elbows[1] - elbows[0]
        across = np.array([-between[1], between[0]]) / np.linalg.norm(between)
        height = np.sqrt(0.35**2 - between @ between / 4)
        expected = [elbows.mean(axis=0) + sign * height * across for sign in (-1, 1)]
        found = robot.assembly_modes(qa)
        assert (found.paths, found.complete) == (2, True)
        for mode, point in zip(found.modes, sorted(expected, key=tuple), strict=True):
            np.testing.assert_allclose(mode.z[:2], point, atol=1e-12)
            direction = (point - elbows[0]) / 0.35
            np.testing.assert_allclose(mode.rotation[:2, 0], _home_axis(robot, direction), atol=1e-12)
            assert mode.certified
    assert robot.assembly_modes([np.pi, 0.0]).modes == ()


def _home_axis(robot: ParallelRobot, link: np.ndarray) -> np.ndarray:
    """x axis of the platform, rigid with the distal link of the first arm, whose direction is given."""
    q = robot.description.home, robot.ik(robot.description.home).q[0]
    start = q[1][0] + q[1][1] - robot.kinematics.moving(q[0])[2]
    turn = np.array([[np.cos(start), np.sin(start)], [-np.sin(start), np.cos(start)]])
    return turn @ link


@pytest.mark.slow
@pytest.mark.parametrize(("name", "modes"), some(1, [("tricept", 8), ("exechon", 8)]))
def test_legs_rigid_with_the_platform_by_newton_from_everywhere(name: str, modes: int) -> None:
    """One leg's passive joints carry the platform; the others' lengths close it: no start finds more."""
    robot = _example(name)
    z = robot.description.home + np.array([0.02, 0.03, 0.05])
    q, (r, R) = robot.ik(z).q, robot.kinematics.pose(z)
    found = robot.assembly_modes(_motors(robot, z))
    assert (found.complete, len(found.modes)) == (True, modes)
    assert all(mode.certified and mode.residual < 1e-12 for mode in found.modes)
    for mode in found.modes:  # the coordinates say the pose
        np.testing.assert_allclose(robot.kinematics.platform.pose(mode.z)[1], mode.rotation, atol=1e-12)
    legs, carrier = robot.kinematics.legs, 3 if name == "tricept" else 0
    leg, free = legs[carrier], [0, 1, 2] if name == "tricept" else [0, 1, 3]
    others = [k for k in range(3) if k != carrier]
    bases, ends = (np.array([(o.origin, o.couplings[0]) for o in legs])[:, i] for i in (0, 1))
    last = R.T @ legs[2].frames(q[2])[0][-1][:, 2]  # of the Exechon: its base joint stays across this axis

    def pose(own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        joints = q[carrier].copy()
        joints[free] = own
        rotations, origins = leg.frames(joints)
        turn = rotations[leg.end_rows[0]] @ leg.end_rotations[0]
        return origins[leg.point] - turn @ leg.couplings[0], turn

    def measures(own: np.ndarray) -> np.ndarray:
        at, turn = pose(own)
        lengths = np.sum((at + ends[others] @ turn.T - bases[others]) ** 2, axis=1)
        return np.append(lengths, (bases[2] - at) @ turn @ last)[:3]

    wanted, rng, seen = measures(q[carrier][free]), np.random.default_rng(4), set()
    np.testing.assert_allclose(pose(q[carrier][free])[0], r, atol=1e-9)
    listed = np.array([[*mode.position, *mode.rotation.ravel()] for mode in found.modes])
    for _ in range(120):
        own = rng.uniform(-np.pi, np.pi, 3)
        for _ in range(25):
            miss = measures(own) - wanted
            slope = np.array([measures(own + step) - wanted - miss for step in 1e-7 * np.eye(3)]).T / 1e-7
            change = np.linalg.lstsq(slope, -miss, rcond=1e-12)[0]
            own = own + change / max(1.0, np.abs(change).max())
            if np.abs(miss).max() < 1e-12:
                at, turn = pose(own)
                gaps = np.abs(listed - np.array([*at, *turn.ravel()])).max(axis=1)
                assert gaps.min() < 1e-6
                seen.add(int(gaps.argmin()))
                break
    assert len(seen) == modes


def test_motors_that_reach_no_pose() -> None:
    robot = ParallelRobot(rpr3())
    assert robot.assembly_modes([0.1, 0.1, 0.1]).modes == ()


def test_refusals() -> None:
    robot = ParallelRobot(ups6())
    with pytest.raises(InputError, match="qa"):
        robot.assembly_modes(np.ones(5))
    with pytest.raises(InputError, match="serial legs"):
        _example("delta_parallelograms").assembly_modes(np.ones(3))
    with pytest.raises(InputError, match=r"leg 1: its unactuated joints \(R, R, R\) .* ball joints"):
        held_leg(ParallelRobot(rrr3()).kinematics.legs[0], {})
    with pytest.raises(InputError, match="leg 1: assembly modes need serial legs"):
        held_leg(_example("delta_parallelograms").kinematics.legs[0], {})


def test_quadrics_with_factors_that_are_known() -> None:
    """Products of two planes each: the solutions are all choices of one plane per equation."""
    rng = np.random.default_rng(5)
    planes = rng.normal(size=(3, 2, 4))
    forms = np.einsum("na,nb->nab", planes[:, 0], planes[:, 1])
    forms = 0.5 * (forms + forms.transpose(0, 2, 1))
    first, known = total_degree(4)
    turn = np.exp(1j * rng.uniform(0, 6, 3))[:, None, None]
    ends, arrived = follow(Deformation.between(first * turn, forms), known)
    assert np.all(arrived == 1.0)
    assert len(distinct(ends)) == 8
    found, around, _ = polished(forms, ends)
    assert np.all(np.isfinite(around))
    for choice in range(8):
        own = [planes[n, choice >> n & 1] for n in range(3)]
        exact = np.linalg.svd(np.array(own))[2][-1]
        assert np.abs(np.abs(found.conj() @ exact) - 1).min() < 1e-12
