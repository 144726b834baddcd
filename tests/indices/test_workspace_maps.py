"""Maps of indices against finite differences, other code for the same, and single poses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.indices.arms.axes import arm_from_spears
from ocptip.indices.arms.values import rate_arm
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_numbers
from ocptip.indices.platforms.parallel_robots import ParallelIndices, platform_of_robot
from ocptip.indices.workspace_maps import index_maps
from ocptip.parallel.analysis.workspace import workspace
from ocptip.parallel.description.ready_made import rpr3, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.pictures.workspace import index_maps_figure
from ocptip.published.arms import arm_by_name
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.kinematics import gripper_pose
from ocptip.task_files.platform_points import read_platform
from tests.indices.sample_axes import random_axes
from tests.places import EXAMPLES
from tests.quick import some

SIMULATOR = EXAMPLES / "platforms" / "flight_simulator.toml"
BENT = np.radians([0, 30, 20, 0, 45, 0])


def _determinant(model, q):
    """|det J| by finite differences of the forward kinematics."""
    columns, h = [], 1e-6
    for k in range(6):
        step = h * np.eye(6)[k]
        (p1, r1), (p2, r2) = gripper_pose(model, q - step), gripper_pose(model, q + step)
        columns.append(np.concatenate([Rotation.from_matrix(r2 @ r1.T).as_rotvec(), p2 - p1]) / (2 * h))
    return abs(np.linalg.det(np.array(columns)))


@pytest.mark.slow
def test_arms_have_the_best_of_all_branches():
    model = arm_by_name("IRB2000")
    found = index_maps(model, {"x": (0.5, 2.0), "ry": (-0.6, 0.6)}, pose=BENT, cells=[6, 5])
    assert 3 < found.inside.sum() < 30
    position, rotation = gripper_pose(model, BENT)
    for place in np.argwhere(found.inside)[::4]:
        x, angle = found.values[0][place[0]], found.values[1][place[1]]
        goal = np.array([x, *position[1:]]), Rotation.from_rotvec([0, angle, 0]).as_matrix() @ rotation
        branches = solve_inverse_kinematics(model, *goal, method="search").branches
        at = tuple(place)
        for name in ("dm_2", "inv_cdn_oe"):
            best = max(rate_arm(model, q)[name].value for q in branches)
            assert found.maps[name][at] == pytest.approx(best, rel=1e-6)
        best = max(_determinant(model, q) for q in branches)
        assert found.maps["manipulability"][at] == pytest.approx(best, rel=1e-6)


@pytest.mark.slow
def test_arms_without_closed_form_are_searched():
    axes = random_axes(np.random.default_rng(3)).T
    model = arm_from_spears("six axes", axes, tool_position=[0.5, 0.2, 1.0])
    position, _ = gripper_pose(model, np.zeros(6))
    ranges = {"z": (float(position[2]) - 0.01, float(position[2]) + 0.01)}
    found = index_maps(model, ranges, pose=np.zeros(6), cells=2, names=["manipulability"])
    assert found.inside.all()
    for z, value in zip(found.values[0], found.maps["manipulability"], strict=True):
        goal = np.array([*position[:2], z]), gripper_pose(model, np.zeros(6))[1]
        branches = solve_inverse_kinematics(model, *goal, seed=5).branches
        assert value == pytest.approx(max(_determinant(model, q) for q in branches), rel=1e-5)


def _leg_rates(robot, z):
    """(6, 6) leg rates per velocity of the platform's origin and angular velocity, by finite differences."""
    h = 1e-5
    lengths = [np.array([leg[2] for leg in robot.ik(z + s * h * e).q]) for e in np.eye(6) for s in (1, -1)]
    J = np.array([up - down for up, down in zip(lengths[::2], lengths[1::2], strict=True)]).T / (2 * h)
    turns = [[robot.kinematics.pose(z + s * h * e)[1] for s in (1, -1)] for e in np.eye(6)[3:]]
    spin = [Rotation.from_matrix(up @ down.T).as_rotvec() / (2 * h) for up, down in turns]
    return np.hstack([J[:, :3], J[:, 3:] @ np.linalg.inv(np.array(spin).T)])


@pytest.mark.slow
def test_hexapods_against_finite_differences_of_the_leg_lengths():
    robot = ParallelRobot(ups6().with_joint_ranges({2: (0.5, 0.75)}))
    ranges = {"x": (-0.3, 0.3), "phi1": (-0.8, 0.8)}
    sphere = OperationEllipsoid.sphere(0.1)
    names = ["dexterity", "platform", "conditioning", "ctn", "inv_cdn_oe"]
    found = index_maps(robot, ranges, names=names, cells=6, ellipsoid=sphere)
    space = workspace(robot, ranges, cells=6)
    assert np.array_equal(found.inside, space.inside)
    assert 3 < found.inside.sum() < 33
    length = np.mean([np.linalg.norm(leg.coupling_point) for leg in robot.description.legs])
    scale = np.array([1.0] * 3 + [1 / length] * 3)
    platform = platform_of_robot(robot.description).platform

    for place in np.argwhere(found.inside)[::3]:
        z, at = robot.description.home.copy(), tuple(place)
        z[0], z[3] = found.values[0][place[0]], found.values[1][place[1]]
        values = np.linalg.svd(_leg_rates(robot, z) * scale, compute_uv=False)
        assert found.maps["platform"][at] == pytest.approx(values[-1], rel=1e-6)
        assert found.maps["conditioning"][at] == pytest.approx(values[-1] / values[0], rel=1e-6)
        p, R = robot.kinematics.pose(z)
        assert found.maps["ctn"][at] == pytest.approx(control_numbers(platform, p, R)[0], rel=1e-9)
        J = _leg_rates(robot, z)[:, [3, 4, 5, 0, 1, 2]]  # about the centre of the sphere
        W = np.diag([4 * 0.01] * 3 + [6.0] * 3)
        ratios = np.linalg.eigvals(np.linalg.solve(W, J.T @ J)).real
        expected = np.sqrt(ratios.min() / ratios.max())
        assert found.maps["inv_cdn_oe"][at] == pytest.approx(expected, rel=1e-6)
    assert np.nanmax(np.abs(found.maps["dexterity"] - np.where(found.inside, space.dexterity, np.nan))) == 0


def test_platforms_and_their_singularity_surface():
    file = read_platform(SIMULATOR)
    found = index_maps(file, {"z": (0.2, 0.8), "rz": (-2.5, 2.5)}, cells=[3, 20])
    assert found.inside.all()
    assert found.crosses
    p = np.tile(file.position, (60, 1))
    p[:, 2] = np.repeat(found.values[0], 20)
    turns = Rotation.from_rotvec(np.outer(np.tile(found.values[1], 3), [0, 0, 1])).as_matrix()
    expected = control_numbers(file.platform, p, turns @ file.rotation)
    assert found.maps["ctn"].ravel() == pytest.approx(expected, rel=1e-9)
    # turned by a quarter it is singular, whatever the height
    beyond = np.abs(found.values[1]) > np.pi / 2
    assert np.array_equal(np.sign(found.signed) < 0, np.broadcast_to(beyond, (3, 20))) or np.array_equal(
        np.sign(found.signed) > 0, np.broadcast_to(beyond, (3, 20))
    )
    assert not index_maps(file, {"rz": (-1.5, 1.5)}, cells=5, names=["sigma_s"]).crosses


def test_what_is_refused():
    arm, hexapod, file = arm_by_name("IRB2000"), ParallelRobot(ups6()), read_platform(SIMULATOR)
    for robot, ranges, options, text in (
        (arm, {"x": (0, 1)}, {}, "joint angles"),
        (arm, {"phi1": (0, 1)}, {"pose": BENT}, "expected one to three of x, y, z, rx"),
        (arm, {"x": (0, 1)}, {"pose": BENT, "names": ["sigma"]}, "no index 'sigma'"),
        (hexapod, {"x": (0, 1)}, {"names": ["inv_cdn_oe"]}, "no index"),
        (ParallelRobot(rpr3()), {"x": (0, 1)}, {"names": ["sigma_r"]}, "there are dexterity"),
        (file, {"x": (1, 0)}, {}, "a lower and a higher end"),
    ):
        with pytest.raises(InputError, match=text):
            index_maps(robot, ranges, cells=3, **options)
    far = index_maps(arm, {"x": (5, 6)}, pose=BENT, cells=3)
    assert not far.inside.any()
    assert far.to_dict()["indices"]["dm_2"]["maximum"] is None
    assert ParallelIndices(ParallelRobot(rpr3())).names[-1] == "ctn"


@pytest.mark.parametrize("names", some(1, [["z"], ["x", "z"], ["x", "rz", "z"]]))
def test_figures(names):
    ranges = dict.fromkeys(names, (-1.0, 1.5))
    for robot, pose in ((arm_by_name("IRB2000"), BENT), (read_platform(SIMULATOR), None)):
        found = index_maps(robot, ranges, pose=pose, cells=4, names=["manipulability", "inv_cdn_oe"])
        figure = index_maps_figure(found)
        labels = [ax.get_ylabel() for ax in figure.axes]
        assert {"MPB [m^3], 0 and up", "1/CDN_OE [-], 0 to 1"} <= set(labels)
        assert figure.get_suptitle().startswith(found.robot)
        figure.canvas.draw()


def test_singular_poses_are_marked_where_they_are():
    of_platform = index_maps(read_platform(SIMULATOR), {"rz": (-2.5, 2.5)}, cells=50, names=["ctn"])
    (marks,) = index_maps_figure(of_platform).axes[0].collections
    assert sorted(line[0, 0] for line in marks.get_segments()) == pytest.approx(
        [-90, 90], abs=180 / np.pi * 0.1
    )
    of_arm = index_maps(arm_by_name("IRB2000"), {"x": (0.5, 2.5)}, pose=BENT, cells=20, names=["dm_2"])
    assert 0 < of_arm.inside.sum() < 20
    assert not index_maps_figure(of_arm).axes[0].collections[0].get_segments()


def test_command(capsys, tmp_path):
    figure = tmp_path / "maps.png"
    words = [
        "IRB2000",
        "0",
        "30",
        "20",
        "0",
        "45",
        "0",
        "--workspace",
        "x=0.5:2",
        "ry=-30:30",
        "--cells",
        "5",
    ]
    assert main(["rate", *words, "--index", "dm_2", "--plot", str(figure), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    ranges = {"x": (0.5, 2.0), "ry": (-np.pi / 6, np.pi / 6)}
    found = index_maps(arm_by_name("IRB2000"), ranges, pose=BENT, cells=5, names=["dm_2"])
    assert told["indices"]["dm_2"]["maximum"] == pytest.approx(np.nanmax(found.maps["dm_2"]))
    assert told["size"] == pytest.approx(found.size)
    assert figure.stat().st_size > 10_000
    assert main(["rate", str(SIMULATOR), "--workspace", "rz=-120:120", "--cells", "9"]) == 1
    assert "SINGULAR: the singularity surface" in capsys.readouterr().out
    assert (
        main(["rate", "6UPS", "--workspace", "x=-0.1:0.1", "--cells", "2", "--range", "3", "0.1", "0.2"]) == 1
    )
    assert "0.0 % inside" in capsys.readouterr().out
    for wrong, text in (
        (["--workspace", "x=0"], "expected NAME=LOW:HIGH"),
        (["--cells", "5"], "--cells: needs --workspace"),
        (["--index", "ctn"], "--index: needs --along or --workspace"),
        (["--workspace", "x=0:1", "--along", "m.csv"], "not together with --along"),
        (["--workspace", "x=0:1", "--range", "1", "0", "1"], "--range: not for platforms"),
    ):
        assert main(["rate", str(SIMULATOR), *wrong]) == 2
        assert text in capsys.readouterr().err
