"""`ocptip check` and `certify` of joint trajectories: what a controller runs, not what the points promise."""

import json

import numpy as np
import pytest

from ocptip.cli.main import main
from tests.places import EXAMPLES

pytestmark = pytest.mark.filterwarnings("ignore::ocptip.basics.errors.InputWarning")

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
CORNERS = np.radians(
    [[65, -140, -55, 110, -95, 160], [-20, -105, -25, 105, -100, 145], [-60, -120, -30, 110, -105, 130]]
)


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    """The UR5 on a cart, at rest at the first corner."""
    text = (EXAMPLES / "tasks" / "ur5_cart.toml").read_text()
    text = text.replace('urdf = "', f'urdf = "{EXAMPLES}/tasks/')
    lines = [line for line in text.splitlines() if not line.startswith(("start_pose", "goal_pose"))]
    ends = [
        f"{key}_deg = {np.degrees(q).tolist()}" for key, q in (("start", CORNERS[0]), ("goal", CORNERS[2]))
    ]
    at = lines.index("[motion]") + 1
    path = tmp_path_factory.mktemp("cart") / "cart.toml"
    path.write_text("\n".join([*lines[:at], *ends, *lines[at:]]))
    return path


def write(path, times, positions, **columns):
    rows = []
    for k, (time, q) in enumerate(zip(times, positions, strict=True)):
        stamp = dict(zip(("sec", "nanosec"), divmod(round(time * 1e9), 10**9), strict=True))
        rows.append({"positions": q.tolist(), "time_from_start": stamp})
        rows[-1] |= {name: values[k].tolist() for name, values in columns.items()}
    path.write_text(json.dumps({"joint_names": [f"{name}_joint" for name in JOINTS], "points": rows}))
    return path


PLAIN = ("--tolerance", "none")


def answer(capsys, *arguments):
    code = main([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_three_points_with_positions_only_are_no_gentle_motion(cart, tmp_path, capsys):
    """Their lines have corners: 85 degrees per second arise within one update, whatever the gap of points."""
    sparse = write(tmp_path / "sparse.json", [0, 1, 2], CORNERS)
    times = np.arange(0, 2.001, 0.008)
    lines = np.column_stack([np.interp(times, [0, 1, 2], q) for q in CORNERS.T])
    dense = write(tmp_path / "dense.json", times, lines)
    found = []
    for path in (sparse, dense):
        code, data = answer(capsys, "check", path, "--task", cart, "--rate", "125", *PLAIN)
        assert (code, data["verified"]) == (1, False)
        assert data["worst"]["acceleration_ratio"]["value"] == pytest.approx(85 / 0.008 / 800, rel=1e-6)
        assert "8 ms (125 Hz)" in data["interpolation"]
        found.append({name: worst["value"] for name, worst in data["worst"].items()})
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    assert found[0]["GN"] > 10


@pytest.mark.slow
def test_the_way_to_a_first_point_is_judged(cart, tmp_path, capsys):
    """85 degrees in 0.7 s from rest to rest by a quintic: at most 15/8 and 10/sqrt(3) of that, per s, s^2."""
    rest = {name: np.zeros((2, 6)) for name in ("velocities", "accelerations")}
    path = write(tmp_path / "later.json", [0.7, 5.0], CORNERS[1:], **rest)
    code, data = answer(capsys, "check", path, "--task", cart, *PLAIN)
    assert (code, data["verified"]) == (1, False)
    assert data["worst"]["acceleration_ratio"]["value"] == pytest.approx(
        85 * 10 / 3**0.5 / 0.7**2 / 800, rel=1e-6
    )
    assert data["worst"]["speed_ratio"]["value"] == pytest.approx(85 * 15 / 8 / 0.7 / 180, rel=1e-3)
    assert data["worst"]["GN"]["value"] > 1
    assert any("point at 0 s is the task's start" in text for text in data["assumed"])
    assert main(["check", str(path), "--task", str(cart), *PLAIN]) == 1
    assert "the file's first is at 0.7 s" in " ".join(capsys.readouterr().out.split())
    code, data = answer(capsys, "certify", path, "--task", cart, *PLAIN)
    assert (code, data["certified"]) == (1, False)
    assert any("point at 0 s is the task's start" in text for text in data["assumed"])


def test_motions_that_begin_or_end_moving_are_refused(cart, tmp_path, capsys):
    """Not the piece is judged: check says what it takes for granted, and what to check instead."""
    moving = np.zeros((2, 6))
    path = write(tmp_path / "rest.json", [0, 4], CORNERS[[0, 2]], velocities=moving)
    _, data = answer(capsys, "check", path, "--task", cart, *PLAIN)
    assert "the robot rests before 0 s and after 4 s" in data["assumed"]
    moving[1, 2] = 0.1
    path = write(tmp_path / "moving.json", [0, 4], CORNERS[[0, 2]], velocities=moving)
    assert main(["check", str(path), "--task", str(cart)]) == 2
    said = capsys.readouterr().err
    assert "joint 3 moves with 5.73 deg/s at the last sample; a motion goes from rest to rest" in said
    assert "as one trajectory with what comes before and after" in said


@pytest.mark.slow
def test_the_trajectory_of_a_plan_has_the_rate_of_its_plan(cart, tmp_path, capsys):
    slow = write(tmp_path / "slow.json", [0, 4], CORNERS[[0, 2]], velocities=np.zeros((2, 6)))
    out = tmp_path / "out"
    options = "--tolerance", "none", "--controller", "linear", "--rate", "80", "--no-figures"
    code, _ = answer(capsys, "retime", slow, "--task", cart, "--out", out, *options)
    assert code == 0
    code, data = answer(capsys, "check", out / "trajectory.json")
    assert (code, data["verified"]) == (0, True)
    assert "12.5 ms (80 Hz)" in data["interpolation"]
    again = tmp_path / "elsewhere.json"
    again.write_text((out / "trajectory.json").read_text())
    _, data = answer(capsys, "check", again, "--task", out / "task" / "task.toml")
    assert "2 ms (500 Hz)" in data["interpolation"]
    assert data["worst"]["acceleration_ratio"]["value"] > 1
