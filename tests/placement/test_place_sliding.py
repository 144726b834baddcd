"""Placements of an arm on a lift: its position is searched and told in metres."""

import numpy as np
import pytest

from ocptip.placement.place import place
from ocptip.robots.kinematics import gripper_pose
from ocptip.task_files.placement import load_placement
from tests.task_files.test_arm_files import ON_A_LIFT, SHORT

PLACE = (
    SHORT.split("[motion]")[0]
    + """
[limits]
condition = 200
[[task]]
position = [0.9, 0.2, 0.95]
orientation = "free"
[[task.load]]
force = [0, 0, -20]
"""
)


@pytest.mark.slow
def test_a_lift_is_part_of_the_posture(tmp_path):
    (tmp_path / "lift.urdf").write_text(ON_A_LIFT, encoding="utf-8")
    (tmp_path / "place.toml").write_text(PLACE, encoding="utf-8")
    problem = load_placement(tmp_path / "place.toml").problem
    best = place(problem, starts=1, seed=0).best
    arm, q = problem.robot.arm, best.angles[0]
    assert (q >= arm.limits.angle_min - 1e-9).all()
    assert (q <= arm.limits.angle_max + 1e-9).all()
    reached = best.base_position + best.base_rotation @ gripper_pose(arm, q)[0]
    np.testing.assert_allclose(reached, [0.9, 0.2, 0.95], atol=1e-5)
    data = best.to_dict()
    assert data["units"] == ["m", "deg", "deg"]
    assert data["angles_deg"]["task 1"][0] == pytest.approx(q[0])
    lift = [margin for margin in best.margins if margin.name.startswith("joint 1: ")]
    assert {margin.unit for margin in lift} == {"m"}
    assert {margin.unit for margin in best.margins if margin.kind == "torque"} == {"N", "N m"}
