"""`ocptip check`: verdicts, exit codes, numbers of the library, and mistakes in one line."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.api.check import offsets_of
from ocptip.cli.layout import headline_of
from ocptip.cli.main import main
from ocptip.motion.check import check_motion
from ocptip.motion.files.output import sample_motion, write_motion_csv
from ocptip.published.tasks import experiment_task
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES

pytestmark = pytest.mark.usefixtures("without_robustness")
PLAIN = ("--tolerance", "none")


@pytest.fixture(scope="module")
def task():
    return experiment_task("C", "effective")


@pytest.fixture
def plan(tmp_path, task):
    path = tmp_path / "plan.json"
    data = {"case": "C", "base": "effective", "energy_J": 1.0, **task.reference.to_dict()}
    path.write_text(json.dumps(data))
    return path


def check_json(capsys, *arguments):
    within = () if "--tolerance" in arguments else PLAIN
    code = main(["check", *map(str, arguments), *within, "--json"])

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    return code, json.loads(capsys.readouterr().out, parse_constant=refuse)


def test_json_holds_the_check_of_the_library(capsys, plan, task):
    code, result = check_json(capsys, plan)
    checked = check_motion(task.robot, task.reference, task.limits)
    assert (code, result["verified"], result["motion"], result["task"]) == (0, True, "plan.json", "C")
    assert result["energy_J"] == pytest.approx(checked.energy, rel=1e-9)
    assert result["duration_s"] == pytest.approx(checked.duration, rel=1e-9)
    for name, worst in checked.worst.items():
        assert result["worst"][name]["value"] == pytest.approx(worst.value, rel=1e-6), name
        assert result["worst"][name]["limit"] == worst.limit
    assert result["worst"]["GN"]["time"] == pytest.approx(checked.worst["GN"].time, abs=1e-3)
    assert result["worst"]["speed_ratio"]["time"] is None
    numbers = {"GN": 0.9, "GT": 0.9, "torque_ratio": 1.0, "clearance": 0.0, "angle_margin": 0.0}
    jumps = {"damping": 1.0, "jump_tip_over": 1.0, "jump_slip": 1.0}
    feet = {"foot_lift": 0.0, "foot_force": 0.0, "jump_foot_force": 0.0}
    assert result["limits"] == {**numbers, **jumps, **feet, "min_duration": 0.0, "max_duration": None}
    assert (result["violations"], result["time_scale"]) == ([], [])
    assert max(result["start_offset_deg"], result["goal_offset_deg"]) < 1e-6
    assert "ocptip" in result["versions"]
    assert result["masses_kg"] == pytest.approx({"base": 3.45, "arm": 15.711, "total": 19.161})
    assert (result["payload"], result["warnings"]) == (None, [])


def test_table_says_the_same(capsys, plan):
    _, result = check_json(capsys, plan)
    assert main(["check", str(plan), *PLAIN, "-v"]) == 0
    text = capsys.readouterr().out
    lines = text.splitlines()
    assert lines[0] == "plan.json on C   PROVED for the nominal model only (no uncertainty)"
    assert lines[1] == f"Motion  {result['duration_s']:.3f} s   {result['energy_J']:.4g} J"
    worst = result["worst"]
    row = next(line for line in lines if line.startswith("tip-over GN"))
    assert row.split()[2:] == [
        f"{worst['GN']['value']:.3g}",
        "<=",
        "0.9",
        f"{worst['GN']['time']:.3f}",
        "s",
        "-",
    ]
    first, last = (
        next(k for k, line in enumerate(lines) if line.startswith(w)) for w in ("quantity", "instants")
    )
    assert len([line for line in lines[first:last] if "<=" in line or ">=" in line]) == len(worst)
    assert any(line.endswith("base 3.45 kg, arm 15.71 kg; together 19.16 kg") for line in lines)
    assert "BROKEN" not in text
    assert "Note" not in text
    assert text.isascii()


def test_a_broken_limit_is_exit_code_1_and_marked(capsys, plan):
    assert main(["check", str(plan), *PLAIN, "--gn", "0.5"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "plan.json on C   LIMITS BROKEN"
    assert lines[2].startswith("Broken  tipping margin is ")
    assert lines[2].endswith(" N m")
    assert [line.split()[0] for line in lines[1:] if line.endswith("BROKEN")] == ["Tipping"]


def test_every_limit_can_be_set(capsys, plan):
    limits = {"GT": 0.1, "torque_ratio": 0.1, "clearance_m": 1.5}
    code, result = check_json(capsys, plan, "--gt", 0.1, "--torque-ratio", 0.1, "--clearance", 1.5)
    assert code == 1
    assert {name: result["worst"][name]["limit"] for name in limits} == limits
    stated = [violation.split()[0] for violation in result["violations"]]
    assert sorted(stated) == ["clearance_m", "friction_utilisation", "torque_ratio"]


@pytest.mark.slow
def test_time_scale_lists_each_factor_and_keeps_the_exit_code(capsys, plan, task):
    code, result = check_json(capsys, plan, "--time-scale", 1.2, 0.9)
    assert code == 0
    assert [(entry["factor"], entry["verified"]) for entry in result["time_scale"]] == [
        (1.2, True),
        (0.9, False),
    ]
    fast = check_motion(task.robot, task.reference.time_scaled(0.9), task.limits)
    assert result["time_scale"][1]["worst"]["GN"]["value"] == pytest.approx(fast.worst["GN"].value, rel=1e-6)
    assert main(["check", str(plan), *PLAIN, "-v", "--time-scale", "1.2", "0.9"]) == 0
    lines = capsys.readouterr().out.splitlines()
    slow, quick = (next(line for line in lines if line.split()[:1] == [f]) for f in ("1.2", "0.9"))
    assert slow.split()[:2] == ["1.2", "CHECKED"]
    assert fast.worst["GN"].value > 1
    assert quick.split()[:3] == ["0.9", "NOT", "STABLE"]
    assert f"{fast.worst['GN'].value:.3g}" in quick.split()


@pytest.mark.slow
def test_samples_are_checked_like_commands(capsys, plan, task, tmp_path):
    csv = tmp_path / "motion.csv"
    write_motion_csv(csv, sample_motion(task.robot, task.reference))
    _, commands = check_json(capsys, plan)
    code, samples = check_json(capsys, csv, "--case", "C", "--base", "effective", "--step", "0.02")
    assert code == 0
    assert samples["worst"]["GN"]["value"] == pytest.approx(commands["worst"]["GN"]["value"], rel=1e-3)
    assert (commands["interpolation"], samples["interpolation"]) == (None, "quintic Hermite polynomials")
    assert main(["check", str(csv), *PLAIN, "--case", "C", "--base", "effective"]) == 0
    assert "Note    checked is the curve through the samples" in capsys.readouterr().out
    assert samples["energy_J"] == pytest.approx(commands["energy_J"], rel=1e-5)


@pytest.mark.slow
def test_case_and_base_are_those_of_the_file_unless_given(capsys, plan):
    by_file = check_json(capsys, plan)[1]["worst"]["GN"]["value"]
    printed = check_json(capsys, plan, "--base", "printed")[1]["worst"]["GN"]["value"]
    same = check_json(capsys, plan, "--case", "C")[1]["worst"]["GN"]["value"]
    other = check_json(capsys, plan, "--case", "A")[1]
    assert by_file == same
    assert printed < 0.5 < by_file
    assert (other["task"], other["worst"]["GN"]["value"] < 0.5) == ("A", True)


def test_a_task_file(capsys, root, tmp_path):
    file = root / "src/ocptip/examples/tasks" / "ur5_cart.toml"
    task = load_task(file)
    limits = task.robot.arm.limits
    ramps = zip(task.goal, limits.speed, limits.acceleration, strict=True)
    motion = Trajectory.from_profiles(task.start, [[RampCommand(*ramp)] for ramp in ramps])
    path = tmp_path / "fast.json"
    path.write_text(json.dumps(motion.to_dict()))
    code, result = check_json(capsys, path, "--task", file, "--time-scale", 1.5)
    assert (code, result["task"], result["verified"]) == (1, "UR5 on a cart", False)
    assert any("slips or lifts off" in violation for violation in result["violations"])
    assert result["time_scale"][0]["verified"] is True


def test_a_motion_that_does_not_fit_start_and_goal_is_noted(capsys, plan, tmp_path):
    data = json.loads(plan.read_text())
    data["start"][1] += 0.5
    moved = tmp_path / "moved.json"
    moved.write_text(json.dumps(data))
    main(["check", str(moved), *PLAIN])
    assert "Note    the motion starts 0.5 deg off the task's start" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["{dir}/none.json"], "{dir}/none.json: no such file"),
        (["{plan}", "--case", "Q"], "case: there is no 'Q'; there are A, B"),
        (["{plan}", "--base", "steel"], "--base: there is no 'steel'; there are printed, effective"),
        (["{plan}", "--task", "{dir}/none.toml"], "{dir}/none.toml: no such file"),
        (["{plan}", "--task", "x.toml", "--base", "printed"], "--base: only for --case"),
        (["{anonymous}"], "{anonymous}: names no case; say which robot by --case A..H or --task TASK.toml"),
        (
            ["{other}"],
            "{other}: is for 'UR5 on a cart', which is no printed case (A, B, C, D, E, F, G, H); say which "
            "robot by --task TASK.toml or --case A..H",
        ),
        (["{broken}"], "broken.json: broken JSON"),
        (["{short}", "--case", "A"], "short.json: motion: has 1 joints, the arm has 6"),
        (["{plan}", "--gn", "0"], "--gn: must be above 0 and at most 1"),
        (["{plan}", "--gt", "5"], "--gt: must be above 0 and at most 1"),
        (["{plan}", "--gt", "nan"], "--gt: must be finite"),
        (["{plan}", "--clearance", "-1"], "--clearance: must be >= 0"),
        (["{plan}", "--step", "0"], "--step: must be > 0"),
        (["{plan}", "--step", "1e-9"], "plan.json: step: the motion lasts"),
        (["{plan}", "--time-scale", "1e300"], "--time-scale: must be between 1e-06 and 1e+06"),
        (["{huge}", "--case", "A"], "huge.json: commands[1][1].phi_e: magnitudes above 1e+12 (SI units)"),
        (["{plan}", "--time-scale", "1", "-2"], "--time-scale: must be > 0"),
        (["{plan}", "--deceleration", "50%"], "--deceleration: is of cancels; add --stops cancel"),
        (["{plan}", "--stops", "path", "--reaction", "8"], "--reaction: is of cancels; add --stops cancel"),
    ],
)
def test_bad_input_is_exit_code_2_in_one_line(capsys, plan, tmp_path, arguments, expected):
    names = {"dir": tmp_path, "plan": plan}
    one_joint = '{"start": [0], "commands": [[{"phi_e": 9, "speed": 9, "acceleration": 9}]]'
    for name, text in (
        ("anonymous", one_joint + "}"),
        ("other", one_joint + ', "case": "UR5 on a cart"}'),
        ("huge", one_joint.replace('"phi_e": 9', '"phi_e": 1e300') + "}"),
        ("short", one_joint + "}"),
        ("broken", "{"),
    ):
        names[name] = tmp_path / f"{name}.json"
        names[name].write_text(text)
    assert main(["check", *(a.format(**names) for a in arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"ocptip: {expected.format(**names)}")
    assert err.count("\n") == 1


@pytest.mark.parametrize("arguments", [[], ["m", "--case", "A", "--task", "t"], ["m", "--gn", "x"]])
def test_wrong_command_line_is_one_line(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(["check", *arguments])
    assert caught.value.code == 2
    assert capsys.readouterr().err.startswith("ocptip: ")


def test_offsets_of_lengths_are_lengths(task):
    cart = load_task(EXAMPLES / "tasks" / "delta_cart.toml")
    off = np.full_like(cart.start, 1e-3)
    moved = SimpleNamespace(start=cart.start + off, goal=cart.goal)
    assert offsets_of(moved, cart) == {"m": (pytest.approx(1e-3), 0.0)}
    assert offsets_of(task.reference, task)["deg"] == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.slow
def test_within_a_tolerance(capsys, plan, tmp_path):
    """Plans that use the limits as described fall at the worst of a tolerance, and the report says where."""
    code, data = check_json(capsys, plan, "--tolerance", "workshop")
    assert code == 1
    worst = data["within_tolerance"]["tip"]
    assert data["worst"]["GN_worst_case"]["value"] == worst["bound"] >= worst["value"] > 1
    assert data["limits"]["tolerance"]["tilt"] == pytest.approx(np.radians(0.5))
    small = tmp_path / "small.toml"
    small.write_text("[tolerance]\ntilt_deg = 0.01\n")
    main(["check", f"{plan}", "-v", "--tolerance", f"{small}"])
    text = capsys.readouterr().out
    assert "PROVED for the given uncertainty" in text.splitlines()[0]
    assert "tip-over GN, worst case" in text
    assert re.search(
        r"^uncertainty +floor tilt 0\.01 deg\n +worst tipping: tilt 0\.01 deg towards \(", text, re.M
    )
    code, data = check_json(capsys, plan, "--tolerance", "none")
    assert "within_tolerance" not in data
    assert main(["check", f"{plan}", "--tolerance", "shop"]) == 2
    assert "--tolerance: expected none, workshop, site or a TOML file" in capsys.readouterr().err


@pytest.mark.slow
def test_samples_with_noise_are_said_to_be_such(capsys, task, tmp_path):
    """By names of joints, in any order; the verdict is of a fit, and the headline does not hide the noise."""
    motion, names = task.reference, task.robot.names[::-1]
    times = np.append(np.arange(0, motion.end, 0.01), motion.end)
    noise = 1e-3 * np.random.default_rng(2).normal(size=(len(times), 6))
    header = ",".join(["time", *(f"position.{name}" for name in names)])
    head = ["check", str(tmp_path / "m.csv"), "--case", "C"]
    for samples, noisy in ((motion.states(times)[0], False), (motion.states(times)[0] + noise, True)):
        rows = np.column_stack([times, samples[:, ::-1]])
        lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
        (tmp_path / "m.csv").write_text("\n".join([header, *lines]) + "\n")
        assert main(head) == 2
        assert "says neither degrees nor radians; give --unit deg or --unit rad" in capsys.readouterr().err
        code = main([*head, *PLAIN, "--unit", "rad"])
        out = capsys.readouterr().out
        assert code in (0, 1)
        assert ("(the calmest motion within the noise of the samples, see note)" in headline_of(out)) == noisy
        text = " ".join(out.split())
        assert ("noise of the samples; its maximum distance is 0.2" in text) == noisy
        assert ("rounding of the file; its maximum distance is 0.0001" in text) != noisy
        _, data = check_json(capsys, *head[1:], "--unit", "rad")
        assert any(data["fit"]["noisy"]) == noisy
        assert data["fit"]["samples"] == len(times)
        assert max(data["fit"]["distance"]) == pytest.approx(4e-3 if noisy else 2e-6, rel=0.5)
        assert data["fit"]["limits_exceeded_by"] == 0.01
