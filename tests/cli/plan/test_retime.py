"""`ocptip retime`: what it says, writes and refuses; its folder is read by `ocptip check`."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.api.check import retimed
from ocptip.cli.main import main
from ocptip.cli.plan.retime import slowed_text
from ocptip.motion.check import check_motion
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.motion import load_task
from ocptip.task_files.plan_folder import read_plan_folder
from ocptip.trajectories.read import load_motion
from tests.places import EXAMPLES
from tests.quick import some

TASK = str(EXAMPLES / "tasks" / "ur5_cart.toml")
PLAIN = ("--tolerance", "none")
SWEEP, TOO_FAST = (str(EXAMPLES / "paths" / f"ur5_sweep.{end}") for end in ("toml", "json"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A motion that tips, timed anew."""
    out = tmp_path_factory.mktemp("retimed") / "out"
    assert main(["retime", TOO_FAST, "--task", TASK, *PLAIN, "--out", str(out), "--no-figures"]) == 0
    return out


def test_a_motion_that_tips_stands_with_another_timing_on_its_path(folder: Path) -> None:
    data = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    own = data["retimed"]
    assert data["controller"]["certified"]
    assert data["controller"]["worst"]["GN"]["value"] <= 0.9
    assert not own["as_given"]["verified"]
    assert own["as_given"]["worst"]["GN"]["value"] > 1
    assert data["worst"]["GN"]["value"] <= 0.9
    assert data["duration_s"] < 1.03 * own["as_given"]["duration_s"]
    points = json.loads((folder / "trajectory.json").read_text(encoding="utf-8"))["points"]
    given = json.loads(Path(TOO_FAST).read_text(encoding="utf-8"))["points"]
    for ours, theirs in ((points[0], given[0]), (points[-1], given[-1])):
        assert ours["positions"] == pytest.approx(theirs["positions"], abs=1e-6)


@pytest.mark.slow
def test_a_path_with_its_timing_is_checked_without_a_controller(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    data.pop("controller")
    path = tmp_path / "path.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    assert main(["certify", str(path), "--task", TASK, *PLAIN]) == 0
    assert "friction used <= " in capsys.readouterr().out
    assert main(["certify", str(path), "--task", TASK, *PLAIN, "--rise-time", "0.02"]) == 2
    assert "--rise-time: " in (said := capsys.readouterr().err)
    assert "already has a timing" in said


def test_its_gripper_is_on_the_given_path(folder: Path) -> None:
    """Every gripper position of the result is near one of the given motion, whose points are 10 ms apart."""
    arm = load_task(TASK).robot.arm
    points, given = (
        gripper_pose(arm, np.array([p["positions"] for p in json.loads(Path(f).read_text())["points"]]))[0]
        for f in (folder / "trajectory.json", TOO_FAST)
    )
    fine = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(given)])
    assert max(np.min(np.linalg.norm(fine - p, axis=1)) for p in points) < 1e-3


@pytest.mark.slow
def test_the_folder_is_checked_as_any(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The motion that is read back is that of the controller, to the last bit."""
    capsys.readouterr()
    assert main(["check", str(folder), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    assert data["worst"]["GN"]["value"] == plan["controller"]["worst"]["GN"]["value"]
    assert data["duration_s"] == plan["controller"]["duration_s"]
    found = read_plan_folder(folder)
    assert found.task.name == "UR5 on a cart"


@pytest.mark.slow
def test_check_says_what_another_timing_of_the_path_takes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is said where the motion is good, or where no timing helps."""
    capsys.readouterr()
    assert main(["check", TOO_FAST, "--task", TASK, *PLAIN, "--json"]) == 1
    text = json.loads(capsys.readouterr().out)["retimed"]
    found = re.match(r"along this path the limits allow about (\d\.\d+) instead of 1\.000 s", text)
    timed = json.loads((folder / "plan.json").read_text(encoding="utf-8"))["duration_s"]
    assert found
    assert float(found[1]) == pytest.approx(timed, rel=0.01)
    task = load_task(TASK)
    motion = load_motion(TOO_FAST, task.robot.names, task.robot.units)
    good = check_motion(task.robot, motion.time_scaled(2.0), task.limits, step=0.1)
    assert not retimed(task, motion.time_scaled(2.0), good)
    tight = replace(task, limits=replace(task.limits, clearance=0.05))
    assert not retimed(tight, motion, check_motion(task.robot, motion, tight.limits, step=0.1))
    still = replace(task, limits=replace(task.limits, GN=0.05))
    bad = check_motion(task.robot, motion, still.limits, step=0.1)
    assert "no timing of its path from rest to rest keeps the limits" in retimed(still, motion, bad)
    within = replace(task, limits=replace(task.limits, tolerance=WORKSHOP))
    found = re.search(
        r"allow (\d\.\d+) instead of 1\.000 s, within the uncertainty", retimed(within, motion, bad)
    )
    assert found
    assert 1.02 * timed < float(found[1]) < 1.1 * timed


def test_files_of_waypoints_are_refused_before_the_task_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """That of the robot may have to be compiled; the file is named once, and so is the key."""
    path = tmp_path / "arcs.toml"
    path.write_text('between = "arcs"\n[[waypoint]]\nat_deg = [0]\n', encoding="utf-8")
    assert main(["retime", str(path), "--task", str(tmp_path / "none.toml")]) == 2
    text = "ocptip: arcs.toml: between: expected one of spline, lines, tool lines, got 'arcs'"
    assert capsys.readouterr().err.strip() == text


@pytest.mark.slow
def test_the_example_is_certified_within_a_workshop(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["retime", TOO_FAST, "--task", TASK, "--no-figures", "--out", str(tmp_path / "out")]
    assert main(call) == 0
    assert "PROVED for 'workshop' uncertainty" in capsys.readouterr().out
    data = json.loads((tmp_path / "out" / "plan.json").read_text(encoding="utf-8"))
    assert data["controller"]["certificate"]["sampled_only"] == []
    assert data["duration_s"] < 1.07
    assert data["controller"]["duration_s"] < 1.09


@pytest.mark.slow
def test_segments_of_a_cycle_have_their_own_paths_and_payloads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From a file with a path for each, and from the folder that came of it."""
    task, path = str(EXAMPLES / "tasks" / "ur5_pick_and_place.toml"), tmp_path / "cycle.toml"
    home = "at_deg = [0, -90, 90, -90, -90, 0]"
    left, right = (
        f"at_pose = {{ position = {at}, rpy_deg = [180, 0, {yaw}] }}"
        for at, yaw in (([0.30, 0.50, 0.90], 0), ([0.30, -0.50, 1.05], -90))
    )
    pairs = ((home, left), (left, right), (right, home))
    text = ("[[segment]]\n" + "".join(f"[[segment.waypoint]]\n{point}\n" for point in pair) for pair in pairs)
    path.write_text("".join(text), encoding="utf-8")
    call = ["--task", task, *PLAIN, "--no-figures", "--out"]
    outs = [str(tmp_path / name) for name in ("a", "b")]
    assert main(["retime", str(path), *call, outs[0]]) == 0
    assert "(segment carry)" in capsys.readouterr().out
    assert main(["check", outs[0]]) == 0
    call.remove("--no-figures")
    assert main(["retime", outs[0], *call, outs[1]]) == 0
    for k in (1, 2, 3):
        assert Path(outs[1], f"phase_plane-{k}.png").stat().st_size > 10_000
    path.write_text(2 * f"[[segment]]\n[[segment.waypoint]]\n{home}\n", encoding="utf-8")
    capsys.readouterr()
    assert main(["retime", str(path), *call, outs[1]]) == 2
    assert "2 paths" in capsys.readouterr().err


@pytest.mark.slow
def test_waypoints_and_the_cheapest_timing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["retime", SWEEP, "--task", TASK, *PLAIN, "--no-figures", "--overwrite"]
    call += ["--out", str(tmp_path / "out")]
    assert main(call) == 0
    fast = capsys.readouterr().out
    assert "s (fastest" in fast
    assert re.search(
        r"smooth curve through 3 points; between them at most [\d.]+ deg, [\d.]+\s+mm of the\s+gripper\s+off "
        r"the straight lines \(between = \"lines\" keeps to them\)",
        " ".join(fast.split()),
    )
    assert main([*call, "--objective", "energy", "--max-duration", "1.8"]) == 0
    cheap = capsys.readouterr().out
    assert "s (minimum energy" in cheap


@pytest.mark.slow
def test_timings_are_within_a_workshop_unless_something_else_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder holds the tolerance, and `check` finds the same worst case."""
    out = str(tmp_path / "out")
    assert main(["retime", SWEEP, "--task", TASK, "--no-figures", "--out", out]) == 0
    assert "acceleration steps overshoot at 5 % damping" in capsys.readouterr().out
    plan = json.loads(Path(out, "plan.json").read_text(encoding="utf-8"))
    worst = plan["controller"]["worst"]["GN_worst_case"]
    assert 0.8 < worst["value"] <= 0.999
    assert main(["check", out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["worst"]["GN_worst_case"]["value"] == worst["value"]


@pytest.mark.slow
def test_figures_are_those_of_a_plan_and_the_phase_plane(tmp_path: Path) -> None:
    assert main(["retime", TOO_FAST, "--task", TASK, *PLAIN, "--out", str(tmp_path / "out")]) == 0
    for name in ("plan", "phase_plane"):
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    some(
        7,
        [
            ([SWEEP], "or --task TASK.toml"),
            ([SWEEP, "--task", TASK, "--path-tolerance", "-1"], "--path-tolerance"),
            ([SWEEP, "--task", TASK, "--objective", "both"], "price_per_second"),
            ([SWEEP, "--task", TASK, "--max-duration", "0"], "--max-duration"),
            ([SWEEP, "--task", TASK, "--rate", "0"], "--rate"),
            ([TASK, "--task", TASK], "is a motion task (ocptip plan), not a path"),
            (["missing.json", "--task", TASK], "missing.json"),
            ([SWEEP, "--task", TASK, "--tolerance", "garage"], "--tolerance: "),
            ([SWEEP, "--task", TASK, "--controller", "quintic"], "quintics need --jerk"),
        ],
    ),
)
def test_bad_arguments_are_one_line(
    tmp_path: Path, arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["retime", *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert len(error.splitlines()) == 1


def test_a_path_that_cannot_be_timed_says_where_and_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "far.toml"
    path.write_text(
        "".join(f"[[waypoint]]\nat_deg = [{pan}, 0, 0, -90, -90, 0]\n" for pan in (90, 40)), encoding="utf-8"
    )
    code = main(["retime", str(path), "--task", TASK, *PLAIN, "--gn", "0.05", "--out", str(tmp_path / "out")])
    assert code == 2
    error = capsys.readouterr().err
    assert "far.toml" in error
    assert "at s = 0.0000, " in error
    assert " 90 deg, " in error
    assert "at rest the tipping margin is" in error
    assert "move the path there" in error


@pytest.mark.slow
def test_a_limit_of_the_jerk_is_kept_by_the_timing(tmp_path: Path) -> None:
    """In degrees; the written points, which are further apart than the timing, are checked as they are."""
    line = tmp_path / "line.toml"
    ends = ([0, -90, 90, -90, -90, 0], [20, -80, 80, -90, -90, 0])
    line.write_text("".join(f"[[waypoint]]\nat_deg = {angles}\n" for angles in ends))
    durations, call = [], ["retime", str(line), "--task", TASK, *PLAIN, "--no-figures"]
    for jerk in ((), ("--jerk", "3000", "--controller", "quintic")):
        out = tmp_path / f"out{len(jerk)}"
        assert main([*call, "--out", str(out), *jerk]) == 0
        own = json.loads((out / "plan.json").read_text(encoding="utf-8"))
        durations.append(own["duration_s"])
        assert (own["retimed"]["jerk_ratio"] is None) == (not jerk)
    assert own["retimed"]["jerk_ratio"] <= 1 + 1e-9
    assert durations[1] > 1.05 * durations[0]


def test_a_jerk_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["retime", SWEEP, "--task", TASK, "--jerk", "-1"]) == 2
    assert "--jerk: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("cured", "slower", "jerk", "text"),
    [
        (True, 1.004, None, r"^$"),
        (True, 1.4429, None, r"multiplied by 1\.443, .* in the check; --jerk, .* may be faster$"),
        (True, 1.4429, 50.0, r"multiplied by 1\.443, so that all limits hold in the check$"),
        (False, 1.0, None, r"also up to 4 times slower, .*: try another path or --jerk$"),
    ],
)
def test_a_timing_that_the_check_slows_down_says_by_what_factor(cured, slower, jerk, text):
    limits = SimpleNamespace(tolerance=SimpleNamespace(overshoot=0.85))
    timed = SimpleNamespace(check=SimpleNamespace(timed_well=cured, violations=()), slower=slower, jerk=jerk)
    found = slowed_text(SimpleNamespace(task=SimpleNamespace(limits=limits), timed=timed))
    assert re.search(text, found)
