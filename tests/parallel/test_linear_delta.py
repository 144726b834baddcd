"""A Delta with vertical slides, described by hand: joints, forces of a slide at rest, workspace."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.parallel.analysis.workspace import workspace
from ocptip.parallel.robot import ParallelRobot
from ocptip.task_files.parallel import read_parallel_robot

ROD = 0.45
BASES = np.array([[0.35, 0.0], [-0.17, 0.30], [-0.17, -0.30]])
ENDS = np.array([[0.06, 0.0], [-0.03, 0.05], [-0.03, -0.05]])
TEXT = """
name = "linear Delta"
gravity = [0.0, 0.0, -9.81]
free = ["x", "y", "z"]
home = [0.02, 0.01, -0.4]

[platform]
mass = 0.6
center = [0.0, 0.0, -0.02]
inertia = [0.001, 0.001, 0.002]

[table.PUU]
joints_to_coupling = 3
rows = [
    { joint = "prismatic" },
    { joint = "revolute", alpha = "pi/2" },
    { joint = "revolute", alpha = "pi/2" },
    { joint = "revolute", d = 0.45 },
    { joint = "revolute", alpha = "-pi/2" },
]
bodies = [{ mass = 0.9 }, {}, { mass = 0.25, center = [0.225, 0.0, 0.0], inertia = [0.0, 0.0042, 0.0042] }]
"""
LEG = """
[[leg]]
table = "PUU"
base_position = [{0}, {1}, 0.0]
base_rotation = [["z", "{4}*pi/3"]]
coupling = [{2}, {3}, 0.0]
actuated = [1]
"""


def described(tmp_path, text=TEXT):
    file = tmp_path / "linear_delta.toml"
    legs = [LEG.format(*base, *end, 2 * k) for k, (base, end) in enumerate(zip(BASES, ENDS, strict=True))]
    file.write_text(text + "".join(legs))
    return read_parallel_robot(file)


def across(z):
    """Square of the horizontal way from each slide to its end of the platform."""
    return np.sum((np.asarray(z)[..., None, :2] + ENDS - BASES) ** 2, axis=-1)


def test_the_upper_ends_of_the_rods_are_where_geometry_has_them(tmp_path):
    robot = ParallelRobot(described(tmp_path))
    for z in robot.description.home + 0.08 * np.random.default_rng(0).uniform(-1, 1, (5, 3)):
        drop = np.sqrt(ROD**2 - across(z))
        slides = np.array([q[0] for q in robot.ik(z).q])
        np.testing.assert_allclose(np.abs(slides - z[2]), drop, atol=1e-12)
        assert abs(robot.inverse_dynamics(z, np.zeros(3), np.zeros(3)).motors.sum() - 9.81 * 4.05) < 1e-10


@pytest.mark.slow
def test_its_workspace_is_where_all_rods_reach(tmp_path, monkeypatch):
    robot = ParallelRobot(described(tmp_path))
    told = []
    found = workspace(
        robot,
        {"x": (-0.19, 0.19), "y": (-0.19, 0.19)},
        cells=8,
        progress=lambda done, total, _: told.append((done, total)),
    )
    x, y = np.meshgrid(*found.values, indexing="ij")
    inside = np.all(across(np.stack([x, y], axis=-1)) < ROD**2, axis=-1)
    np.testing.assert_array_equal(found.inside, inside)
    assert 0.4 < inside.mean() < 0.9
    assert told == [(0, 64), (16, 64), (32, 64), (48, 64)]
    monkeypatch.setattr(robot.kinematics, "joints_nearby", lambda z, q: None)
    alone = workspace(robot, {"x": (-0.05, 0.05), "y": (-0.05, 0.05)}, cells=3)
    monkeypatch.undo()
    near = workspace(robot, {"x": (-0.05, 0.05), "y": (-0.05, 0.05)}, cells=3)
    np.testing.assert_allclose(near.dexterity, alone.dexterity, atol=1e-12)


@pytest.mark.slow
def test_axes_that_hold_the_platform_otherwise_are_named(tmp_path):
    twisted = TEXT.replace('alpha = "-pi/2"', 'alpha = "-pi/3"')
    with pytest.raises(InputError, match="give `end_rotation` or a `guess` of all joints"):
        ParallelRobot(described(tmp_path, twisted))
