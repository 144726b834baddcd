"""The study that draws index maps: numbers of the library, files, refusals."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.published.arms import arm_by_name
from ocptip.robots.inverse.closed_form import branches_within_limits
from ocptip.robots.kinematics import gripper_pose
from studies.indices import maps as index_maps

SPHERE = OperationEllipsoid.sphere(0.1)


def branches_of(model, position, rotation):
    """(k, 6), rad, of one pose."""
    found = branches_within_limits(model, position[None], rotation[None])[0]
    return found[np.isfinite(found).all(axis=1)]


@pytest.mark.slow
def test_joint_plane_holds_the_published_values():
    fixed = np.radians([0, 0, 0, 0, 60, 0])
    maps = index_maps.joint_plane(arm_by_name("IRB2000"), (2, 3), fixed, 211, SPHERE)
    assert np.degrees(maps["x"][[0, -1]]) == pytest.approx([-110, 100])
    assert np.degrees(maps["y"][[0, -1]]) == pytest.approx([-60, 60])
    row, column = 105, 155
    assert np.degrees([maps["x"][column], maps["y"][row]]) == pytest.approx([45, 0], abs=1e-9)
    assert maps["dm_2"][row, column] == pytest.approx(1.554889, abs=6e-7)
    assert maps["dm_inf"][row, column] == pytest.approx(1.150138, abs=6e-7)
    assert maps["manipulability"][row, column] * 1e9 == pytest.approx(6.227200e8, rel=4e-7)
    assert np.abs(maps["det"]) == pytest.approx(maps["manipulability"], abs=1e-12)


@pytest.mark.parametrize("name", ["IRB2000", "FP1W2F", "W1P1P2W2"])
def test_branches_reach_the_pose_within_the_limits(name):
    model = arm_by_name(name)
    rng, found = np.random.default_rng(0), 0
    for _ in range(10):
        q = rng.uniform(model.limits.angle_min, model.limits.angle_max)
        position, rotation = gripper_pose(model, q)
        branches = branches_of(model, position, rotation)
        assert (branches >= model.limits.angle_min - 1e-9).all()
        assert (branches <= model.limits.angle_max + 1e-9).all()
        for branch in branches:
            reached, turned = gripper_pose(model, branch)
            assert reached == pytest.approx(position, abs=1e-8)
            assert turned == pytest.approx(rotation, abs=1e-8)
        turns = (branches - q) / (2 * np.pi)
        found += (np.abs(turns - np.round(turns)).max(axis=1) < 1e-6).any()
    assert found == 10


def test_workspace_slice_shows_the_best_branch():
    model, rotation = arm_by_name("IRB2000"), index_maps.APPROACHES["down"]
    maps = index_maps.workspace_slice(model, rotation, 7, SPHERE)
    reached = maps["branches"] > 0
    assert 5 < reached.sum() < 49
    assert (np.isfinite(maps["pi_oe"]) == reached).all()
    row, column = np.unravel_index(np.argmax(maps["branches"]), reached.shape)
    position = np.array([maps["x"][column], 0.0, maps["y"][row]])
    branches = branches_of(model, position, rotation)
    for index in index_maps.INDICES:
        best = index_values(model, branches, ellipsoid=SPHERE, names=[index])[index].max()
        assert maps[index][row, column] == pytest.approx(best)


def test_gripper_turned_in_place():
    model, q = arm_by_name("IRB2000"), np.radians([0, 0, 0, 0, 60, 0])
    maps = index_maps.turned_in_place(model, q, 5, SPHERE)
    assert maps["dm_2"][2, 2] >= index_values(model, q, names=["dm_2"])["dm_2"] - 1e-9
    assert maps["x"] == pytest.approx(np.radians([-72, -36, 0, 36, 72]))
    position, rotation = gripper_pose(model, q)
    reached = np.isfinite(maps["dm_2"])
    assert 3 < reached.sum() < 25
    for row, column in np.argwhere(reached)[::3]:
        turn = Rotation.from_rotvec([maps["x"][column], maps["y"][row], 0]).as_matrix()
        branches = branches_of(model, position, turn @ rotation)
        best = index_values(model, branches, names=["dm_2"])["dm_2"].max()
        assert maps["dm_2"][row, column] == pytest.approx(best)


@pytest.mark.slow
def test_files(tmp_path, capsys):
    assert index_maps.main([str(tmp_path), "--grid", "7", "--joints", "3", "5"]) == 0
    assert "joint_plane" in capsys.readouterr().out
    record = json.loads((tmp_path / "index_maps.json").read_text())
    assert record["joints"] == [3, 5]
    for name in ("joint_plane", "workspace", "turned"):
        assert (tmp_path / f"index_maps_{name}.png").stat().st_size > 20_000
        with np.load(tmp_path / f"index_maps_{name}.npz") as arrays:
            assert arrays["pi_oe"].shape == (7, 7)
            assert record[name]["pi_oe"]["max"] == np.nanmax(arrays["pi_oe"])


@pytest.mark.parametrize(
    "options", [["--arm", "KUKA"], ["--joints", "2", "2"], ["--ellipsoid", "1", "1", "0"]]
)
def test_bad_options_are_refused(tmp_path, options, capsys):
    with pytest.raises(SystemExit):
        index_maps.main([str(tmp_path), *options])
    assert "error" in capsys.readouterr().err
