"""Workspaces against the geometry of shells, circles and Newton's joints."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.parallel.analysis import workspace as module
from ocptip.parallel.analysis.workspace import OUT_OF_REACH, workspace
from ocptip.parallel.description.ready_made import delta, rpr3, rrr3, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.pictures.workspace import workspace_figure
from ocptip.task_files.parallel import read_parallel_robot
from tests.places import EXAMPLES
from tests.quick import some

_STROKE = (0.5, 0.75)


@pytest.mark.slow
def test_constant_orientation_workspace_of_a_hexapod_is_an_intersection_of_shells() -> None:
    """Volume by exact intervals along vertical lines, within 1 %."""
    description = ups6().with_joint_ranges({2: _STROKE})
    robot = ParallelRobot(description)
    angles = [0.1, -0.05, 0.2]
    found = workspace(
        robot,
        {"x": (-0.35, 0.35), "y": (-0.35, 0.35), "z": (0.3, 0.75)},
        at=[0, 0, 0.6, *angles],
        cells=48,
    )
    _, R = robot.kinematics.pose(np.array([0, 0, 0, *angles]))
    centers = np.array([leg.origin - R @ leg.coupling_point for leg in description.legs])
    edges = np.linspace(-0.35, 0.35, 401)
    middles = 0.5 * (edges[1:] + edges[:-1])
    x, y = np.meshgrid(middles, middles, indexing="ij")
    low, high = np.full(x.shape, 0.3), np.full(x.shape, 0.75)
    holes = []
    for c in centers:
        far = (x - c[0]) ** 2 + (y - c[1]) ** 2
        top = c[2] + np.sqrt(np.maximum(_STROKE[1] ** 2 - far, 0.0))
        high = np.where(far < _STROKE[1] ** 2, np.minimum(high, top), low)
        hole = c[2] + np.sqrt(np.maximum(_STROKE[0] ** 2 - far, 0.0))
        holes.append(np.where(far < _STROKE[0] ** 2, hole, 0.3))
    low = np.maximum(low, np.max(holes, axis=0))
    exact = np.maximum(high - low, 0.0).sum() * (edges[1] - edges[0]) ** 2
    assert exact > 0.01
    assert found.size == pytest.approx(exact, rel=0.01)


def test_planar_workspace_is_an_intersection_of_rings() -> None:
    """3RPR: area by the rings of the legs on the same grid, cell by cell."""
    robot = ParallelRobot(rpr3().with_joint_ranges({1: (0.4, 1.3)}))
    found = workspace(robot, {"x": (-1, 1), "y": (-1, 1)}, at=[0, 0, 0.2], cells=60)
    _, R = robot.kinematics.pose(np.array([0, 0, 0.2]))
    x, y = np.meshgrid(*found.values, indexing="ij")
    inside = np.ones(x.shape, dtype=bool)
    for leg in robot.description.legs:
        c = leg.origin - R @ leg.coupling_point
        distance = np.hypot(x - c[0], y - c[1])
        inside &= (distance >= 0.4) & (distance <= 1.3)
    assert np.array_equal(inside, found.inside)
    assert 0.05 < inside.mean() < 0.95


@pytest.mark.slow
@pytest.mark.parametrize(("make", "joint", "span"), some(1, [(rrr3, 1, (0.2, 2.2)), (delta, 1, (1.2, 1.9))]))
def test_both_ways_agree(make, joint, span, monkeypatch):
    robot = ParallelRobot(make().with_joint_ranges({joint: span}))
    ranges = {"x": (-0.5, 0.5), "y": (-0.5, 0.5)}
    fast = workspace(robot, ranges, cells=11)
    monkeypatch.setattr(module, "minimal_obstacle", lambda robot: "as if")
    slow = workspace(robot, ranges, cells=11)
    assert np.array_equal(fast.cause, slow.cause)
    assert len(set(fast.cause.ravel().tolist())) > 2
    assert np.nanmax(np.abs(fast.dexterity - slow.dexterity)) < 1e-9
    assert 0 < fast.inside.mean() < 1


def test_dexterity_changes_its_sign_at_singular_poses() -> None:
    robot = ParallelRobot(rpr3())
    found = workspace(robot, {"phi3": (-3.0, 3.0)}, cells=400)
    turn = np.flatnonzero(np.diff(np.sign(found.dexterity[:])))
    assert turn.size
    for k in turn:
        angle = 0.5 * (found.values[0][k] + found.values[0][k + 1])
        assert robot.singularity([0.0, 0.0, angle]).platform < 0.02
    assert found.shares["beyond a singularity"] > 0


@pytest.mark.slow
def test_ball_joints_with_ranges_and_robots_in_numbers() -> None:
    free = workspace(ParallelRobot(ups6()), {"phi1": (-1, 1), "phi2": (-1, 1)}, cells=6)
    tilt = ParallelRobot(ups6().with_joint_ranges({4: (0.9, 2.2)}))
    held = workspace(tilt, {"phi1": (-1, 1), "phi2": (-1, 1)}, cells=6)
    assert free.inside.all()
    assert 0 < held.inside.sum() < free.inside.sum()
    for k, one in enumerate(held.values[0]):
        q = np.array([leg[4] for leg in tilt.ik([0, 0, 0.6, one, held.values[1][k], 0]).q])
        assert bool(np.all((q >= 0.9) & (q <= 2.2))) == held.inside[k, k]
    rps = ParallelRobot(read_parallel_robot(EXAMPLES / "robots" / "rps3.toml"))
    found = workspace(rps, {"z": (0.5, 0.7), "phi1": (-0.2, 0.2)}, cells=3)
    assert found.inside.all()
    assert np.all(found.dexterity > 0)


def test_ranges_in_files(tmp_path) -> None:
    text = (EXAMPLES / "robots" / "planar_3rrr.toml").read_text()
    file = tmp_path / "robot.toml"
    file.write_text(text.replace('joint = "revolute"', 'joint = "revolute", range = ["-pi/2", 1.5]', 1))
    row = read_parallel_robot(file).legs[0].rows[0]
    assert row.range == pytest.approx((-np.pi / 2, 1.5))
    file.write_text(text.replace('joint = "revolute"', 'joint = "revolute", range = [2, 1]', 1))
    with pytest.raises(InputError, match="range"):
        read_parallel_robot(file)


@pytest.mark.slow
def test_refusals_and_figures() -> None:
    robot = ParallelRobot(rrr3())
    for ranges, cells in (({"q": (0, 1)}, 5), ({}, 5), ({"x": (1, 0)}, 5), ({"x": (0, 1)}, 1)):
        with pytest.raises(InputError, match="workspace"):
            workspace(robot, ranges, cells=cells)
    far = workspace(robot, {"x": (8, 9)}, cells=4)
    assert far.causes[0] == OUT_OF_REACH
    assert not far.inside.any()
    for names in (["x"], ["x", "y"], ["x", "y", "phi3"]):
        found = workspace(robot, dict.fromkeys(names, (-1, 1)), cells=5)
        workspace_figure(found).canvas.draw()
