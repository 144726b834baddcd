"""What was checked is what is written: plans as controllers run them, written, read back, checked again."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, seed
from hypothesis import strategies as st

from ocptip.api import methods
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.motion.check import check_motion
from ocptip.motion.files.execution import SLOWEST, Execution, execute, slowed_as_needed
from ocptip.motion.files.output import joint_trajectory
from ocptip.motion.files.plan_files import write_plan
from ocptip.numerics.time_limit import TimeBudget
from ocptip.published.tasks import experiment_task
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.read import load_motion, motion_of_points
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import stand_in_plan
from tests.quick import examples, some


@pytest.fixture(scope="module")
def task():
    return experiment_task("C", "effective")


@pytest.fixture(scope="module")
def tight(task):
    """Limits that the printed motion just keeps."""
    worst = check_motion(task.robot, task.reference, Limits(GN=1.0, GT=1.0)).worst
    return Limits(GN=worst["GN"].value * (1 + 1e-9), GT=worst["GT"].value * (1 + 1e-9))


@pytest.fixture(
    scope="module",
    params=["cubic", *(pytest.param(c, marks=pytest.mark.slow) for c in ("linear", "quintic"))],
)
def executed(request, task, tight):
    motion = task.reference
    if request.param == "quintic":
        motion = motion.with_rise_times(0.02)
    return execute(task.robot, motion, tight, request.param)


def test_all_limits_are_kept_a_little_slower_if_need_be(task, tight, executed):
    assert executed.check.verified
    assert 1 <= executed.slower < 1.02
    if executed.controller == "cubic":
        assert executed.slower == 1
        assert executed.check.energy == pytest.approx(task.robot.energy(task.reference), rel=1e-6)
    longer = {"quintic": 0.02, "linear": 0.02}.get(executed.controller, 0)
    expected = executed.slower * task.reference.end  # rise times stay
    assert expected - 1e-6 <= executed.check.duration <= expected + longer + 1e-6


@pytest.mark.parametrize("ending", ["json", "yaml"])
def test_what_is_read_back_is_what_was_checked(task, tight, executed, tmp_path, ending):
    path = tmp_path / f"trajectory.{ending}"
    data = joint_trajectory(task.robot, executed.points)
    path.write_text(json.dumps(data) if ending == "json" else yaml.safe_dump(data) + "---\n")
    again = check_motion(task.robot, load_motion(path, task.robot.names), tight)
    assert again.verified
    for name, worst in executed.check.worst.items():
        assert again.worst[name].value == pytest.approx(worst.value, abs=1e-6)
    assert again.duration == pytest.approx(executed.check.duration, abs=1e-9)
    assert again.energy == pytest.approx(executed.check.energy, rel=1e-6)


@pytest.mark.slow
def test_where_slowness_does_not_help_the_violations_stay(task, tight):
    limits = Limits(GN=tight.GN / 4, GT=tight.GT / 4)
    executed = execute(task.robot, task.reference.with_rise_times(0.02), limits, "quintic")
    assert not executed.check.verified
    assert executed.slower == 1
    slowest = execute(task.robot, task.reference.time_scaled(SLOWEST), limits, "cubic")
    assert not slowest.check.verified


@pytest.mark.parametrize("needed", [1.0, 1.0003, 1.0123, 1.2, 1.3])
@pytest.mark.parametrize("foretold", [0.0, 0.7, 1.0])
def test_the_minimum_slowing_is_determined_with_few_checks(needed, foretold):
    tried = []

    def run(factor):
        tried.append(factor)
        well = factor >= needed
        slowing = 1.0 if well else (needed / factor) ** foretold
        check = SimpleNamespace(timed_well=well, slowing=slowing, worst={})
        return SimpleNamespace(check=check, factor=factor)

    found = slowed_as_needed(run)
    if needed > SLOWEST:
        assert found is None
        assert tried[-1] == SLOWEST
    else:
        assert needed <= found.factor <= needed + max(1e-4, 0.1 * (found.factor - 1))
    assert len(tried) <= (7 if foretold == 1 else 13)


@pytest.mark.parametrize(("pressing", "slowest", "checks"), [(1.0, 4.0, 4), (0.8, 4.0, 4), (0.8, 1.25, 2)])
def test_a_friction_that_is_used_up_foretells_how_much_slower(pressing, slowest, checks):
    """The force on a contact falls with accelerations, by their share `pressing` less where they press it."""
    tried = []

    def run(factor):
        tried.append(factor)
        used = 2.6 / (factor**2 - 1 + pressing)
        worst = Worst("GT", used, 0.0, 1.0, "", used - 1)
        check = SimpleNamespace(timed_well=used <= 1, slowing=max(used, 1.0) ** 0.5, worst={"GT": worst})
        return SimpleNamespace(check=check, factor=factor)

    found, needed = slowed_as_needed(run, slowest=slowest), (3.6 - pressing) ** 0.5
    assert len(tried) <= checks
    if slowest < needed:
        assert found is None
    else:
        assert needed <= found.factor <= needed + 0.1 * (found.factor - 1)


def test_joints_come_in_any_order(task, executed, tmp_path):
    data = joint_trajectory(task.robot, executed.points)
    turned = {**data, "joint_names": data["joint_names"][::-1]}
    keys = ("positions", "velocities", "accelerations")
    turned["points"] = [{**p, **{key: p[key][::-1] for key in keys}} for p in data["points"]]
    (tmp_path / "t.json").write_text(json.dumps(turned))
    motion = load_motion(tmp_path / "t.json", task.robot.names)
    np.testing.assert_array_equal(motion.points.angles, executed.points.angles)


def test_efforts_are_the_torques(task, executed):
    points = joint_trajectory(task.robot, executed.points, effort=True)["points"]
    efforts = np.array([p["effort"] for p in points])
    times = executed.points.times
    if executed.controller == "linear":  # corners are half a period late, and of the last one there is a rest
        times = times + 0.5 * executed.points.period
    torques = task.robot.samples(executed.motion, times).torques
    np.testing.assert_allclose(efforts[:-1], torques[:-1], rtol=1e-12)
    held = task.robot.loads(executed.motion.goal[None], *np.zeros((2, 1, executed.motion.n)))[0][0]
    np.testing.assert_allclose(efforts[-1], held, atol=1e-6)


def test_files_of_a_plan_are_of_what_the_controller_runs(task, executed, tmp_path):
    plan = stand_in_plan("C")
    paths = write_plan(tmp_path, plan, executions=[executed])
    assert json.loads(paths[0].read_text())["controller"]["verified"] is True
    for path in paths[1:3]:
        motion = load_motion(path, task.robot.names)
        assert motion.end == pytest.approx(executed.motion.end, abs=executed.points.period or 1e-9)


@pytest.mark.slow
def test_the_command_reads_it(task, executed, tmp_path, capsys):
    path = tmp_path / "trajectory.json"
    path.write_text(json.dumps(joint_trajectory(task.robot, executed.points)))
    code = main(["check", str(path), "--case", "C", "--tolerance", "none", "--gn", "1", "--gt", "1"])
    out = capsys.readouterr().out
    assert code == 0, out
    kind = {"linear": "straight lines", "cubic": "cubic Hermite", "quintic": "quintic Hermite"}
    assert kind[executed.controller] in " ".join(out.split())


def points(**changes):
    base = {"positions": [0.0], "velocities": [0.0], "accelerations": []}
    rows = [{**base, "time_from_start": {"sec": k, "nanosec": 0}} for k in range(3)]
    data = {"joint_names": ["a"], "points": rows}
    for key, value in changes.items():
        (data if key in data else rows[1])[key] = value
    return data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (points(points=3), "points: expected a joint trajectory"),
        (points(joint_names="a"), "joint_names: expected a list of names"),
        (points(joint_names=["b"]), "joint_names: expected a, got b"),
        (points(positions=[0.0, 1.0]), r"points\[2\].positions: expected 1 numbers"),
        (points(positions=["x"]), r"points\[2\].positions"),
        (points(velocities=[]), r"points\[2\].velocities: expected 1 numbers"),
        (points(accelerations=[1.0]), r"points\[1\].accelerations: expected 1 numbers"),
        (points(velocities=[float("nan")]), r"points\[2\].velocities"),
        (points(time_from_start=1.0), r"points\[2\].time_from_start: expected sec and nanosec, .*got 1.0"),
        (points(time_from_start={"sec": 5}), "times: must increase"),
        (points(points=[]), "times: at least two samples"),
    ],
)
def test_bad_trajectories_are_one_line(tmp_path, data, message):
    path = tmp_path / "t.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=message) as caught:
        load_motion(path, ["a"])
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("t.json: ")


def test_broken_yaml_is_one_line(tmp_path):
    (tmp_path / "t.yaml").write_text("points: [")
    with pytest.raises(InputError, match=r"t\.yaml: broken YAML") as caught:
        load_motion(tmp_path / "t.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("apart", some(1, [1.3e-5, 2e-6, 9.1e-5]))
def test_points_of_drives_keep_limits_in_whole_nanoseconds(task, apart, tmp_path):
    """Two joints at their acceleration limits switch one just after the other."""
    robot, start = task.robot, task.start
    most, commands, ways = robot.limits.acceleration, [], [0, 0, 0, 0, 0.9, 0.9]
    for j, way in enumerate(ways):
        ramp = 0.12345678951 + apart * (j == 5)
        commands.append([RampCommand(start[j] + way, most[j] * ramp, most[j])])
    motion, limits = Trajectory.from_profiles(start, commands), Limits()
    checked = check_motion(robot, motion, limits)
    assert checked.verified
    assert not check_motion(robot, controller_points(motion, "cubic"), limits).verified
    run = Execution.of_drives(robot, motion, limits, checked)
    assert run.verified
    assert run.motion is motion
    assert run.written is not None
    assert 1 < run.written.slower < 1.01
    assert "its points keep all limits" in run.trajectory_text
    path = tmp_path / "trajectory.json"
    path.write_text(json.dumps(joint_trajectory(robot, run.points)))
    again = check_motion(robot, load_motion(path, robot.names), limits)
    assert again.verified
    assert again.worst == run.written.check.worst  # to the last bit


@pytest.mark.slow
@seed(3)
@examples(8)
@given(st.integers(0, 10**6))
def test_points_of_random_ramps_read_back_keep_their_limits(task, number):
    """Of joints whose events lie anywhere, or near to each other."""
    rng = np.random.default_rng(number)
    robot, start = task.robot, task.start
    most, commands = robot.limits.acceleration, []
    for j in range(6):
        ramp = 0.1 + rng.choice([1e-6, 1e-5, 1e-4, 1e-2]) * rng.random()
        way = (0.02 if j < 4 else 0.3) * rng.choice([-1, 1])
        low = min(most[j], abs(way) / ramp**2) * (0.05 if j < 4 else 1)
        commands.append([RampCommand(start[j] + way, low * ramp, low)])
    motion, limits = Trajectory.from_profiles(start, commands), Limits(GN=0.99, GT=0.99)
    checked = check_motion(robot, motion, limits)
    assume(checked.verified)
    run = Execution.of_drives(robot, motion, limits, checked)
    assert run.verified
    points = joint_trajectory(robot, run.points)
    again = motion_of_points(json.loads(json.dumps(points)), robot.names)
    assert np.array_equal(again.points.times, run.points.times)
    assert check_motion(robot, again, limits).verified


@pytest.mark.slow
def test_slower_ones_are_looked_for_without_the_tolerance_first(task, monkeypatch):
    """A limit of the described world that the motion breaks by a little decides by how much."""
    motion, given = task.reference.slowed(1.3), []
    plain = check_motion(task.robot, motion, Limits(GN=1.0, GT=1.0)).worst
    limits = Limits(GN=0.97 * plain["GN"].value, GT=1.0, tolerance=Uncertainty(tilt=1e-3), GN_worst_case=0.99)

    def counted(robot, motion, limits):
        given.append(bool(limits.tolerance.given))
        return check_motion(robot, motion, limits)

    monkeypatch.setattr("ocptip.motion.files.execution.check_motion", counted)
    found = execute(task.robot, motion, limits, "linear")
    assert found.check.verified
    assert found.check.within is not None
    assert found.slower > 1
    assert given.count(True) == 1
    assert given[-1]
    assert given.count(False) > 2


@pytest.mark.parametrize(("seconds", "why"), [(0.0, "the time was up"), (None, "none was tried")])
def test_a_proof_that_a_time_limit_ended_is_not_called_untried(monkeypatch, seconds, why):
    monkeypatch.setattr("ocptip.api.methods.certified", lambda robot, motion, checked, limits: checked)
    how = {"controller": "ramps", "rate": None, "rise_time": None}
    plan, budget = stand_in_plan(), TimeBudget(seconds)
    (run,) = methods.proved_runs(plan, methods.executed(plan, **how, budget=budget), budget)
    assert run.check.unproved.startswith(f"a proof: {why}")
