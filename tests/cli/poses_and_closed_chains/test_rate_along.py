"""`ocptip rate` for parallel robots, and along motions."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.api.rate import rate_along
from ocptip.cli.main import main
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import singularity_distance
from ocptip.indices.arms.values import index_values
from ocptip.indices.platforms.controllability import control_numbers
from ocptip.indices.platforms.parallel_robots import ParallelIndices, platform_of_robot, rate_parallel
from ocptip.parallel.analysis.workspace import workspace
from ocptip.parallel.description.ready_made import READY_MADE, rpr3, rrr3, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.published.arms import arm_by_name
from ocptip.task_files.platform_points import read_platform
from tests.places import EXAMPLES


def _report(capsys, *arguments, code=0):
    assert main(["rate", *map(str, arguments), "--json"]) == code
    return json.loads(capsys.readouterr().out)


def _values(description, z=(0, 0, 0)):
    indices = ParallelIndices(ParallelRobot(description))
    return indices.values(z, indices.names)


@pytest.mark.parametrize("name", ["3RRR", "delta", "4PRRR"])
def test_parallel_robots_at_home(capsys, name):
    found = _report(capsys, name)
    make = {known.lower(): one for known, one in READY_MADE.items()}[name.lower()]
    robot = ParallelRobot(make())
    values = {one["name"]: one["value"] for one in found["indices"]}
    expected = robot.singularity(robot.description.home)
    assert values["platform"] == pytest.approx(expected.platform, rel=1e-9)
    assert values["legs"] == pytest.approx(expected.legs.min(), rel=1e-9)


def test_robot_files_and_poses_in_degrees(capsys):
    file = EXAMPLES / "robots" / "planar_3rrr.toml"
    found = _report(capsys, file, 0.05, 0.02, 20)
    assert found["z"] == pytest.approx([0.05, 0.02, np.radians(20)])
    assert main(["rate", str(file), "1"]) == 2
    assert "POSE: expected x, y, phi3" in capsys.readouterr().err


def test_singular_pose_is_said(capsys):
    robot = ParallelRobot(rpr3())
    grid = workspace(robot, {"phi3": (-1.2, 0.0)}, cells=4000)
    k = int(np.argmin(np.abs(grid.dexterity)))
    found = _report(capsys, "3RPR", 0, 0, np.degrees(grid.values[0][k]), code=1)
    assert found["kinds"] == ["platform (type II)"]


def test_hexapods_have_the_indices_of_platforms_and_planar_ones_ctn():
    hexapod = ParallelRobot(ups6())
    entries, kinds = rate_parallel(hexapod, hexapod.description.home)
    assert kinds == ()
    assert {"dexterity", "ctn", "sigma_r"} <= {entry.name for entry in entries}
    assert 0 < _values(rpr3())["ctn"] < 1
    assert "ctn" not in _values(rrr3())


def test_along_a_motion_of_an_arm(capsys, tmp_path):
    q = np.radians([0, 40, -60, 10, 50, 20]) + np.linspace(0, 0.3, 9)[:, None]
    file, figure = tmp_path / "motion.csv", tmp_path / "indices.png"
    lines = [",".join(["time_s", *(f"q{k}_deg" for k in range(1, 7))])]
    lines += [",".join(map(repr, [0.1 * k, *np.degrees(row).tolist()])) for k, row in enumerate(q)]
    file.write_text("\n".join(lines) + "\n")
    found = _report(capsys, "FP1W2F", "--along", file, "--plot", figure)
    expected = index_values(arm_by_name("FP1W2F"), q, names=["dm_2"])["dm_2"]
    assert found["indices"]["dm_2"]["minimum"] == pytest.approx(expected.min())
    assert found["indices"]["dm_2"]["at_s"] == pytest.approx(0.1 * np.argmin(expected))
    assert figure.stat().st_size > 5000


def _motion(q, rates, times):
    """A CSV file with angles in degrees and speeds in rad/s, all digits."""
    joints = range(1, q.shape[1] + 1)
    lines = [",".join(["time_s", *(f"q{k}_deg" for k in joints), *(f"qd{k}_rad_s" for k in joints)])]
    for t, *row in zip(times, np.degrees(q), rates, strict=True):
        lines.append(",".join(map(repr, [float(t), *np.concatenate(row).tolist()])))
    return "\n".join(lines) + "\n"


@pytest.mark.slow
def test_sigma_is_the_slope_of_the_manipulability(capsys, tmp_path):
    """[Naw07] (4.8), (4.10): d|det J|/dt = |grad| |rates of joints 2 to 5| sin sigma, by differences."""
    times = np.linspace(0, 1, 2001)
    first, ways = np.radians([0, 40, -60, 10, 50, 20]), np.array([0.5, 0.8, -0.9, 1.5, -2.0, 3.0])
    q, rates = first + np.sin(2 * times)[:, None] * ways, 2 * np.cos(2 * times)[:, None] * ways
    file, figure = tmp_path / "motion.csv", tmp_path / "sigma.png"
    file.write_text(_motion(q, rates, times))
    rated = rate_along("IRB2000", file, indices=["sigma", "manipulability"])
    distance = singularity_distance(arm_pose(arm_by_name("IRB2000"), q).jacobian)
    size = np.linalg.norm(distance.gradient, axis=1) * np.linalg.norm(rates[:, 1:5], axis=1)
    slope = np.gradient(rated.values["manipulability"], times)
    clear = rated.values["manipulability"] > 1e-3  # |det J| has a kink where it is 0
    clear[[0, -1]] = False  # differences to one side
    assert clear.sum() > 1900
    np.testing.assert_allclose((size * np.sin(rated.values["sigma"]))[clear], slope[clear], atol=1e-5)
    options = ["--along", file, "--index", "sigma", "--plot", figure]
    least = _report(capsys, "IRB2000", *options, code=1)["indices"]["sigma"]  # it passes a singular pose
    assert least["minimum"] == rated.values["sigma"].min() < 0 < least["maximum"]
    assert figure.stat().st_size > 5000


def test_sigma_without_rates_and_at_rest(capsys, tmp_path):
    q = np.radians([[0, 40, -60, 10, 50, 20], [5, 40, -60, 10, 50, 20]])
    file = tmp_path / "motion.csv"
    file.write_text(_motion(q, np.array([[1.0, 0, 0, 0, 0, 0]] * 2), [0, 1]))
    assert main(["rate", "FP1W2F", "--along", str(file), "--index", "sigma"]) == 0
    assert re.search(r"sigma +- +- +- +-", capsys.readouterr().out)
    file.write_text(file.read_text().replace("qd3_rad_s", "speed3"))
    assert main(["rate", "FP1W2F", "--along", str(file), "--index", "sigma"]) == 2
    assert "sigma needs a column qd3_deg_s or qd3_rad_s" in capsys.readouterr().err


def test_along_a_motion_of_a_parallel_robot(capsys, tmp_path):
    file = tmp_path / "motion.csv"
    file.write_text("time_s,q1_m,q2_m,q3_deg\n0,0,0,0\n1,0.05,0.02,10\n")
    found = _report(capsys, "3RRR", "--along", file)
    second = _values(rrr3(), [0.05, 0.02, np.radians(10)])
    first = _values(rrr3())
    for name, rated in found["indices"].items():
        assert rated["minimum"] == pytest.approx(min(first[name], second[name]), rel=1e-9)
        assert rated["maximum"] == pytest.approx(max(first[name], second[name]), rel=1e-9)
    file.write_text("time_s,q1_m,q2_m,q3_deg\n0,0,0,0\n1,5,0,0\n")
    assert main(["rate", "3RRR", "--along", str(file)]) == 2
    assert "row 2" in capsys.readouterr().err
    file.write_text("time_s,q1_m,q2_m\n0,0,0\n")
    assert main(["rate", "3RRR", "--along", str(file)]) == 2
    assert "expected a column q3_deg or q3_rad" in capsys.readouterr().err


def test_hexapods_and_platform_files_along_a_motion(capsys, tmp_path):
    """A hexapod's angles are its own, a platform file's a rotation vector."""
    file = tmp_path / "motion.csv"
    file.write_text("time_s,q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg\n0,0,0,0.6,0,0,10\n1,0.1,0,0.6,0,0,50\n")
    found = _report(capsys, "6UPS", "--along", file, "--index", "ctn", "sigma_r")
    platform = platform_of_robot(ups6()).platform
    turns = Rotation.from_euler("z", [[10], [50]], degrees=True).as_matrix()
    expected = control_numbers(platform, [[0, 0, 0.6], [0.1, 0, 0.6]], turns)
    assert found["indices"]["ctn"]["minimum"] == pytest.approx(expected.min(), rel=1e-9)
    assert found["indices"]["ctn"]["maximum"] == pytest.approx(expected.max(), rel=1e-9)
    assert list(found["indices"]) == ["ctn", "sigma_r"]
    simulator = EXAMPLES / "platforms" / "flight_simulator.toml"
    told = _report(capsys, simulator, "--along", file)
    expected = control_numbers(read_platform(simulator).platform, [[0, 0, 0.6], [0.1, 0, 0.6]], turns)
    assert told["indices"]["ctn"]["minimum"] == pytest.approx(expected.min(), rel=1e-9)
    assert "inv_cdn_oe" in told["indices"]
    file.write_text("q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg\n0,0,0.6,0,0,0\n0,0,0.6,0,0,90\n")
    assert main(["rate", str(simulator), "--along", str(file)]) == 1
    assert "PASSES A SINGULAR POSE" in capsys.readouterr().out


def test_plot_needs_a_motion(capsys):
    assert main(["rate", "FP1W2F", "0", "40", "-60", "10", "50", "20", "--plot", "x.png"]) == 2
    assert "--plot: needs --along or --workspace" in capsys.readouterr().err
