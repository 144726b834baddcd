"""Rise times of accelerations in task files and on the command line, from reading to files and back."""

import json

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.task_files.motion import load_task
from ocptip.trajectories.read import load_motion
from tests.places import EXAMPLES, RESULTS
from tests.quick import ONE_START


def written(folder, line, more=""):
    """A task file of an example, with this line in its limits."""
    path = folder / "task.toml"
    text = (EXAMPLES / "tasks" / "delta_cart.toml").read_text()
    path.write_text(f"{text.partition('[limits]')[0]}\n[limits]\n{line}\n{more}")
    return path


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rise_time = 0", ()),
        ("rise_time = [0.03, 0.0, 0.05]", (0.03, 0.0, 0.05)),
        ("jerk = [4000, 2000, 8000]", (0.03, 0.06, 0.015)),  # 2 * 60 m/s^2 / jerk
        ("jerk = 1e9", (1e-4,) * 3),
        ("rise_time = 0.1\njerk = 100", (0.1,) * 3),
    ],
)
def test_task_files(tmp_path, line, expected):
    assert load_task(written(tmp_path, line)).rise_times == pytest.approx(expected)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("rise_time = -1", "limits.rise_time: must be >= 0"),
        ("rise_time = 1e-9", "limits.rise_time: must be 0 or at least 0.0001 s"),
        ("rise_time = [0.1]", "limits.rise_time: "),
        ("jerk = 0", "limits.jerk: must be > 0"),
        ("risetime = 0.1", "limits.risetime: unknown key"),
    ],
)
def test_bad_numbers_are_named(tmp_path, line, message):
    with pytest.raises(InputError, match=message):
        load_task(written(tmp_path, line))


def test_published_cases_in_files(tmp_path):
    path = tmp_path / "task.toml"
    path.write_text('case = "A"\n[limits]\nrise_time = 0.02\n[tolerance]\ndamping = 0.1\n')
    task = load_task(path)
    assert task.rise_times == (0.02,) * 6
    assert task.limits.tolerance.overshoot > 0.7


@pytest.mark.slow
@pytest.mark.parametrize("chosen", [None, ()])
def test_sources_leave_a_choice_where_there_was_one(tmp_path, chosen):
    task = load_task(written(tmp_path, "GN = 0.9"))
    assert task.rise_times is None
    (tmp_path / "again.toml").write_text(task.source.text(task.name, task.limits, task.objective, chosen))
    assert load_task(tmp_path / "again.toml").rise_times == chosen


def test_sources_hold_what_was_planned(tmp_path):
    task = load_task(written(tmp_path, "jerk = 4000", "[tolerance]\ndamping = 0.05\n"))
    text = task.source.text(task.name, task.limits, task.objective, task.rise_times)
    (tmp_path / "again.toml").write_text(text)
    again = load_task(tmp_path / "again.toml")
    assert again.rise_times == task.rise_times
    assert again.limits.jerk == (4000.0,) * 3
    assert again.limits == task.limits
    assert again.limits.overshoot > 0.8  # parallel robots: as described


@pytest.mark.slow
def test_a_plan_is_checked_as_it_was_planned(tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["plan", "A", *ONE_START, "--rise-time", "0.05"]
    assert main([*arguments, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "accelerations rise within 50 ms" in said.splitlines()[1]
    assert "executed by" not in said
    data = json.loads((out / "plan.json").read_text())
    assert data["rise_time_s"] == 0.05
    for name in ("plan.json", "trajectory.json"):  # quintics between points are the S-curves
        assert main(["check", str(out / name), "--case", "A", "--tolerance", "none", "--json"]) == 0
        checked = json.loads(capsys.readouterr().out)
        assert checked["verified"]
        assert checked["energy_J"] == pytest.approx(data["energy_J"], rel=1e-6)
        assert checked["duration_s"] == pytest.approx(data["duration_s"], abs=1e-8)
    points = load_motion(out / "trajectory.json")
    assert points.points.accelerations is not None
    assert np.all(np.abs(points.points.accelerations[[0, -1]]) == 0)
    assert main(["check", str(out / "trajectory.json"), "--case", "A", "--rise-time", "0.1"]) == 2
    assert "--rise-time: " in capsys.readouterr().err


@pytest.mark.slow
def test_commands_run_with_the_rise_time_of_the_option_the_file_or_the_task(tmp_path, capsys):
    ramps = RESULTS / "plans" / "A-effective" / "plan.json"
    durations = {}
    data = json.loads(ramps.read_text())
    named = tmp_path / "named.json"
    named.write_text(json.dumps({**data, "rise_time_s": 0.03}))
    task = tmp_path / "task.toml"
    task.write_text('case = "A"\n[limits]\nrise_time = 0.01\n')
    for motion in (ramps, named):
        for option in ([], ["--rise-time", "0.02"], ["--rise-time", "0"]):
            main(["check", str(motion), "--task", str(task), "--tolerance", "none", "--json", *option])
            duration = json.loads(capsys.readouterr().out)["duration_s"] - data["duration_s"]
            durations[motion.name, *option] = round(duration, 6)
    assert list(durations.values()) == [0.01, 0.02, 0.0, 0.03, 0.02, 0.0]
