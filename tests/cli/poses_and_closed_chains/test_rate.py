"""`ocptip rate`: numbers of the library, exit codes, mistakes in one line."""

import json

import numpy as np
import pytest

from ocptip.cli.main import main
from ocptip.indices.arms.values import rate_arm
from ocptip.indices.metric import OperationEllipsoid
from ocptip.published.arms import arm_by_name
from ocptip.robots.payload import Payload
from ocptip.robots.urdf.arm import arm_from_urdf
from tests.places import UR5

POSE = ["10", "20", "-30", "40", "50", "60"]
PLATFORM = """
name = "octahedral"
base = [[1, 0, 0], [1, 0.1, 0], [-0.5, 0.8, 0], [-0.6, 0.8, 0], [-0.5, -0.8, 0], [-0.4, -0.9, 0]]
platform = [[0.3, -0.5, 0], [0.3, 0.5, 0], [0.3, 0.5, 0.1], [-0.6, 0.1, 0], [-0.6, -0.1, 0], [0.3, -0.5, 0.1]]
[home]
position = [0, 0, 0.8]
[operation_ellipsoid]
half_axes = [0.2, 0.2, 0.1]
"""


def rate_json(capsys, *arguments):
    code = main(["rate", *map(str, arguments), "--json"])

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    return code, json.loads(capsys.readouterr().out, parse_constant=refuse)


def values(result):
    return {entry["name"]: entry["value"] for entry in result["indices"]}


def test_json_holds_the_rating_of_the_library(capsys):
    code, result = rate_json(capsys, "FP1W2F", *POSE, "--rates", 1, 2, 3, 4, 5, 6)
    rating = rate_arm(arm_by_name("FP1W2F"), np.radians([10, 20, -30, 40, 50, 60]), rates=np.arange(1.0, 7.0))
    assert (code, result["robot"], result["kind"], result["singular"]) == (0, "FP1W2F", "arm", False)
    for entry in rating.entries:
        expected = None if np.isnan(entry.value) or np.isinf(entry.value) else entry.value
        assert values(result)[entry.name] == expected, entry.name
    assert result["q"] == pytest.approx(np.radians([10, 20, -30, 40, 50, 60]))
    assert "ocptip" in result["versions"]
    assert result["outside_limits"] == []


def test_table_says_the_same(capsys):
    _, result = rate_json(capsys, "FSFS", *POSE)
    assert main(["rate", "FSFS", *POSE]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "FSFS: regular pose."
    for entry in result["indices"]:
        row = next(line for line in lines if line.startswith(entry["symbol"] + " "))
        shown = row.split()[1]
        assert shown == ("-" if entry["value"] is None else f"{entry['value']:.4g}")
        assert entry["meaning"].split()[0] in row
    assert max(map(len, lines)) <= 110
    assert any(line.startswith("shortest path") for line in lines)
    assert not any(line.startswith("sigma") for line in lines)


def test_singular_pose_has_its_own_exit_code(capsys):
    assert main(["rate", "IRB2000", *"000000"]) == 1
    text = capsys.readouterr().out
    assert text.startswith("IRB2000: SINGULAR pose.")
    assert "\nshortest path" not in text


def test_pose_outside_of_the_joint_limits_is_noted(capsys):
    assert main(["rate", "IRB2000", "0", "150", "0", "0", "130", "0"]) == 0
    assert "outside of the joint limits: joint 2, 5" in capsys.readouterr().out


def test_ellipsoid_of_the_user(capsys):
    _, result = rate_json(capsys, "FSFS", *POSE, "--ellipsoid", 0.1, 0.2, 0.3, "--center", 0, 0, 0.15)
    ellipsoid = OperationEllipsoid(np.array([0, 0, 0.15]), half_axes=[0.1, 0.2, 0.3])
    rating = rate_arm(arm_by_name("FSFS"), np.radians(np.array(POSE, dtype=float)), ellipsoid=ellipsoid)
    assert values(result)["pi_oe"] == rating["pi_oe"].value
    assert result["ellipsoid"]["half_axes"] == [0.1, 0.2, 0.3]


def test_urdf(capsys):
    options = ["--base-link", "base_link", "--tool-frame", "tool0"]
    _, result = rate_json(capsys, UR5, *POSE, *options)
    arm = arm_from_urdf(UR5, base_link="base_link", tool_frame="tool0")
    rating = rate_arm(arm, np.radians(np.array(POSE, dtype=float)))
    assert values(result)["dm_2"] == pytest.approx(rating["dm_2"].value)
    assert values(result)["pi_oe_weighted"] == pytest.approx(rating["pi_oe_weighted"].value)


def test_locked_joints_of_a_urdf(capsys, tmp_path):
    slider = '<joint name="lift" type="prismatic"><parent link="world"/><child link="base_link"/>'
    slider += '<axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
    text = UR5.read_text().replace(
        '<link name="base_link"/>', f'<link name="world"/><link name="base_link"/>{slider}'
    )
    path = tmp_path / "lifted.urdf"
    path.write_text(text)
    options = ["--base-link", "world", "--tool-frame", "tool0", "--lock", "lift=0.25m"]
    _, result = rate_json(capsys, path, *POSE, *options)
    _, without = rate_json(capsys, UR5, *POSE, "--base-link", "base_link", "--tool-frame", "tool0")
    assert values(result)["pi_oe"] == pytest.approx(values(without)["pi_oe"])
    assert values(result)["inv_cdn"] != pytest.approx(values(without)["inv_cdn"], rel=1e-3)
    assert (
        main(
            [
                "rate",
                str(UR5),
                *POSE[:5],
                *options[2:4],
                "--base-link",
                "base_link",
                "--lock",
                "wrist_3_joint=30",
            ]
        )
        == 2
    )
    assert "5 axes" in capsys.readouterr().err


def test_ready_made_hexapod(capsys):
    code, result = rate_json(capsys, "6UPS")
    assert (code, result["kind"]) == (0, "platform")
    assert 0 < values(result)["ctn"] <= 1


def test_platform_file(capsys, tmp_path):
    path = tmp_path / "platform.toml"
    path.write_text(PLATFORM)
    code, result = rate_json(capsys, path)
    from ocptip.indices.platforms.reviewed import rate_platform
    from ocptip.task_files.platform_points import read_platform

    file = read_platform(path)
    expected = rate_platform(file.platform, file.position, file.rotation, file.ellipsoid)
    assert (code, result["kind"], result["robot"]) == (0, "platform", "octahedral")
    assert values(result) == {entry.name: pytest.approx(entry.value) for entry in expected}
    _, moved = rate_json(capsys, path, 0.1, 0, 0.9, 0, 0, 10)
    assert moved["position"] == [0.1, 0, 0.9]
    assert moved["rotation"][0][0] == pytest.approx(np.cos(np.radians(10)))
    assert values(moved)["ctn"] != values(result)["ctn"]
    assert main(["rate", str(path)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("octahedral: regular pose.")
    assert "legs close to" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["KUKA", *POSE], "arm: no arm 'KUKA'; there are FP1W2F"),
        (["FSFS", *POSE[:5]], "POSE: FSFS has 6 joints, got 5 angles"),
        (["FSFS", *POSE[:5], "nan"], "POSE: contains NaN"),
        (["6UPS", "0", "0", "1e200", "0", "0", "0"], "POSE: magnitudes above 1e+12 (SI units) are refused"),
        (["FSFS", *POSE, "--rates", "1", "2"], "--rates: FSFS has 6 joints, got 2 rates"),
        (["FSFS", *POSE, "--rates", "1", "2", "3", "4", "5", "inf"], "rates: contains NaN or infinity"),
        (["FSFS", *POSE, "--ellipsoid", "0.1", "0", "0.1"], "--ellipsoid: half_axes"),
        (["FSFS", *POSE, "--center", "0", "0", "0.1"], "--center: needs --ellipsoid"),
        (["FSFS", *POSE, "--tool-frame", "x"], "--tool-frame: only for URDF files"),
        (["no.urdf", *POSE, "--base-link", "a", "--tool-frame", "b"], "no.urdf: no such file"),
        ([str(UR5), *POSE, "--base-link", "a"], "--base-link: no 'a'; candidates: "),
        (
            [str(UR5), *POSE, "--base-link", "base_link", "--tool-frame", "t", "--lock", "x=y"],
            "--lock: expected",
        ),
        (["no.toml"], "no.toml: no such file"),
    ],
)
def test_mistakes_are_told_in_one_line(capsys, arguments, message):
    assert main(["rate", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert captured.err.startswith("ocptip: ")
    assert captured.err.count("\n") == 1


def test_options_of_arms_are_refused_for_platforms(capsys, tmp_path):
    path = tmp_path / "platform.toml"
    path.write_text(PLATFORM)
    assert main(["rate", str(path), "--rates", "1"]) == 2
    assert "--rates: not for platforms" in capsys.readouterr().err
    assert main(["rate", str(path), "1", "2"]) == 2
    assert "got 2 numbers" in capsys.readouterr().err


def test_a_payload_counts_where_masses_do(capsys):
    free, loaded = (
        rate_json(capsys, "FP1W2F", *POSE, *more)[1] for more in ([], ["--payload", 3, 0, 0, 0.1])
    )
    arm = arm_by_name("FP1W2F").with_payload(Payload(3.0, [0, 0, 0.1]))
    expected = rate_arm(arm, np.radians([10, 20, -30, 40, 50, 60]))
    assert values(loaded)["dm_2_weighted"] == expected["dm_2_weighted"].value > values(free)["dm_2_weighted"]
    assert values(loaded)["dm_2"] == values(free)["dm_2"]
    assert (free["payload"], loaded["payload"]["mass"]) == (None, 3.0)
    for bad, said in (
        ([1, 2], "expected KG or KG X Y Z, got 2 numbers"),
        ([0], "mass: must be > 0, got 0.0"),
    ):
        assert main(["rate", "FP1W2F", *POSE, "--payload", *map(str, bad)]) == 2
        assert capsys.readouterr().err == f"ocptip: --payload: {said}\n"
