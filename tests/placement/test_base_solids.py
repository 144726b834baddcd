"""Solids of the base that its URDF describes count in placements as those of the task file do."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.placement.evaluate import Evaluator
from ocptip.placement.place import place
from ocptip.placement.result import NoPlacementError, evaluate_placement
from ocptip.published.arms import load_arm
from ocptip.robots.geometry import Pillar
from ocptip.standing.arm import Robot
from ocptip.task_files.placement import load_placement
from tests.placement.placement_scenes import drilling, four_feet
from tests.standing.test_ground import BASE, URDF

PARAMETERS = np.array([[-0.2, 0.0, 0.3], [0.4, 0.1, -0.5], [0.9, -0.6, 2.0]])
ZONE = """[[keep_out]]
kind = "box"
name = "hatch"
size = [0.4, 0.4, 1.0]
position = [0.0, 0.1, 0.5]
"""
PLACE = f"""{BASE}[arm]
urdf = "bars.urdf"
mount_position = [0.0, 0.0, 0.3]
[motors]
kind = "estimated"
[tolerance]
preset = "none"
[[terrain]]
x = [-0.1, 0.1]
y = [-0.1, 0.1]
angle_deg = [-20, 20]
[[task]]
orientation = "free"
position = [0.6, 0.0, 0.5]
{ZONE}"""
SHAPE = 'shape = [{ kind = "box", name = "typed", size = [0.2, 0.2, 0.6], position = [0, 0, 0.3] }]\n'


def read(folder, text):
    (folder / "bars.urdf").write_text(URDF)
    (folder / "place.toml").write_text(text)
    return load_placement(folder / "place.toml").problem


@pytest.fixture
def problem(tmp_path):
    return read(tmp_path, PLACE.replace("[arm]", f"{SHAPE}[arm]", 1))


def rows_of(problem, parameters):
    found = Evaluator(problem).task(0, 0, parameters[None], np.array([[0.6, 0.9]]))
    rows = [row for row in found.rows if row.kind == "clearance"]
    return {label: float(v) for row in rows for label, v in zip(row.labels, row.values[0], strict=True)}


def test_a_base_of_the_urdf_is_as_far_from_a_keep_out_as_coal_says(problem):
    rng = np.random.default_rng(0)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    for _ in range(20):
        parameters = rng.uniform([-0.6, -0.6, -1], [0.6, 0.6, 1])
        turn = Rotation.from_euler("z", parameters[2]).as_matrix()
        base = coal.Transform3s(turn, np.array([*parameters[:2], 0.3]))
        zone = coal.Transform3s(np.eye(3), np.array([0.0, 0.1, 0.5]))
        result.clear()
        gap = coal.distance(coal.Box(0.2, 0.2, 0.6), base, coal.Box(0.4, 0.4, 1.0), zone, request, result)
        found = rows_of(problem, parameters)
        assert found["base and hatch"] == pytest.approx(found["typed and hatch"], abs=1e-6)
        if gap < 0.2:  # farther ones may be lower bounds
            assert found["base and hatch"] == pytest.approx(gap, abs=1e-6)


@pytest.mark.slow
def test_no_placement_is_found_with_the_base_in_a_keep_out(tmp_path):
    problem = read(tmp_path, PLACE)
    with pytest.raises(NoPlacementError) as error:
        place(problem, starts=1)
    assert "base and hatch" in {margin.name for margin in error.value.nearest.violations}
    free = place(read(tmp_path, PLACE.replace(ZONE, "")), starts=1)
    assert free.best.feasible


def test_spheres_before_the_first_joint_are_balls_of_the_base():
    robot = four_feet()
    arm = load_arm("FP1W2F")
    (own,) = (s for s in arm.sphere_sets if s.link == 0)
    problem = drilling(Robot(arm, robot.support, robot.motors), keep_out=[Pillar([-0.4, 0.3, 0.0], 0.1)])
    rows = [r for r in Evaluator(problem).ground(0, PARAMETERS) if r.kind == "base clearance"]
    labels = [label for row in rows for label in row.labels]
    values = np.hstack([row.values for row in rows])
    origins, turns = problem.base_pose(0, PARAMETERS)
    centres = arm.mount_position + own.centres @ arm.mount_rotation.T
    for k, radius in enumerate(own.radii):
        at = [c for c, label in enumerate(labels) if label == f"{own.name} and pillar"][k]
        there = origins + turns @ centres[k]
        gaps = np.linalg.norm(there[:, :2] - [-0.4, 0.3], axis=1) - 0.1 - radius
        np.testing.assert_allclose(values[:, at], gaps, atol=1e-9)
    assert evaluate_placement(Evaluator(problem), 0, PARAMETERS[0], np.zeros((1, 6))).problem is problem
