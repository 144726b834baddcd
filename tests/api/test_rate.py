"""`ocptip.rate` on arms, platforms and parallel robots: the numbers of the library however one is named."""

import json

import numpy as np
import pytest

import ocptip
from ocptip.indices.arms.values import rate_arm
from ocptip.indices.platforms.parallel_robots import platform_of_robot
from ocptip.indices.workspace_maps import index_maps
from ocptip.parallel import ParallelRobot, delta
from ocptip.parallel.description.ready_made import ups6
from ocptip.published.arms import arm_by_name
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES, UR5

POSE = np.radians([10, 20, -30, 40, 50, 60])


def test_an_arm_is_an_object_a_name_a_urdf_or_a_task():
    for name, arm in (("FP1W2F", arm_by_name("FP1W2F")), (UR5, arm_from_urdf(UR5))):
        expected = rate_arm(arm, POSE)
        for given in (name, arm):
            rating = ocptip.rate(given, POSE)
            assert rating["dm_2"].value == expected["dm_2"].value
            assert rating.singular == expected.singular
    task = EXAMPLES / "tasks" / "ur5_cart.toml"
    robot = load_task(task).robot
    values = [ocptip.rate(given, POSE)["manipulability"].value for given in (task, robot, robot.arm)]
    assert len(set(values)) == 1


def test_platforms_and_parallel_robots_have_a_home_pose(tmp_path):
    hexapod = ocptip.rate("6UPS")
    assert hexapod.data["kind"] == "platform"
    assert hexapod["ctn"].value == ocptip.rate(platform_of_robot(ups6()))["ctn"].value
    moved = ocptip.rate("6UPS", [*(hexapod.data["position"] + np.array([0.01, 0, 0])), 0, 0, 0.1])
    assert moved["ctn"].value != hexapod["ctn"].value
    robot = ParallelRobot(delta())
    at = ocptip.rate(robot, robot.description.home)
    assert at.entries == ocptip.rate("delta").entries
    data = json.loads(at.save(tmp_path / "delta.json").read_text(encoding="utf-8"))
    assert data["kind"] == "parallel"
    assert {entry["name"] for entry in data["indices"]} == {entry.name for entry in at.entries}


def test_its_repr_says_regular_or_singular_with_values_and_units():
    assert "regular pose; " in repr(ocptip.rate("FP1W2F", POSE))
    assert "singular pose; " in repr(ocptip.rate("FP1W2F", np.zeros(6)))


def test_along_a_motion_and_over_a_workspace_the_values_are_those_of_single_poses(tmp_path):
    arm, path = arm_by_name("FP1W2F"), tmp_path / "motion.csv"
    rows = ["time_s," + ",".join(f"q{k}_deg" for k in range(1, 7))]
    rows += [f"{0.1 * k}," + ",".join(f"{v:.17g}" for v in np.degrees(POSE + 0.1 * k)) for k in range(3)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    found = ocptip.rate_along(arm, path, indices=["dm_2"])
    expected = [ocptip.rate(arm, POSE + 0.1 * k)["dm_2"].value for k in range(3)]
    np.testing.assert_allclose(found.values["dm_2"], expected, rtol=1e-9)
    assert found.regular
    assert found.to_dict()["indices"]["dm_2"]["minimum"] == pytest.approx(min(expected))
    assert found.save(tmp_path / "indices.svg").stat().st_size > 1000
    hexapod, ranges = platform_of_robot(ups6()), {"x": (-0.1, 0.1)}
    maps = ocptip.rate_workspace(hexapod, ranges, cells=3, indices=["ctn"])
    np.testing.assert_array_equal(
        maps.maps["ctn"], index_maps(hexapod, ranges, cells=3, names=["ctn"]).maps["ctn"]
    )


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("FP1W2F",), {}, "pose: missing; FP1W2F has 6 joints"),
        (("FP1W2F", [0.0]), {}, "pose: expected shape 6, got 1"),
        (("FP1W2", POSE), {}, "FP1W2"),
        (("delta", [0.0]), {}, "pose: expected shape"),
        (("delta",), {"rates": [1.0]}, "rates: of the joints of an arm only"),
        (("nowhere.toml",), {}, "nowhere"),
    ],
)
def test_what_cannot_be_used_is_named(arguments, options, message):
    with pytest.raises(ocptip.InputError, match=message):
        ocptip.rate(*arguments, **options)
    with pytest.raises(ocptip.InputError, match="index: no 'nothing' here"):
        ocptip.rate("FP1W2F", POSE)["nothing"]
