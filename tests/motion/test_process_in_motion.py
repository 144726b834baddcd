"""Motions while a process acts on the gripper: files, checks, certificates, plans, retiming, simulation."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import casadi as cs
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.certificate.checks import certified
from ocptip.certificate.describe import model_data, motion_data, tolerance_data
from ocptip.certificate.trusted.sharing import Sharing
from ocptip.cli.main import main
from ocptip.motion.check import check_motion
from ocptip.motion.files.output import sample_motion
from ocptip.motion.files.plan_files import write_plan
from ocptip.motion.plan import plan_motion
from ocptip.motion.planner.node_physics import NodePhysics
from ocptip.motion.tolerated import tolerated
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.problem import GripperTask, PlacementProblem, ProcessLoad
from ocptip.placement.terrain import plane
from ocptip.published.tasks import experiment_task
from ocptip.retiming.retime import retime
from ocptip.robots.process import AXES, ProcessWrench
from ocptip.standing.at_rest.load_cases import (
    LoadCaseGrid,
    MotionLoads,
    RestLoads,
    largest_payload,
    load_cases,
    tilt_by_direction,
)
from ocptip.standing.limits import Limits
from ocptip.standing.parts import Part
from ocptip.standing.simulation.mjcf import to_mjcf
from ocptip.standing.simulation.replay import Simulator, compared
from ocptip.standing.simulation.urdf import to_urdf
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, Closing
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.cycle import load_cycle
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from ocptip.task_files.placement import load_placement
from tests.motion.planner.node_derivatives import all_slopes, bends
from tests.pictures.plan_stand_in import plan_of
from tests.placement.placement_scenes import drilling
from tests.places import EXAMPLES
from tests.quick import some

SMALL = Uncertainty(speed=0.02, arm_mass=0.01, tilt=0.005, push=1.0)


def case(name="A", axes="tool"):
    """A published case on whose gripper a process acts, its robot without it."""
    task = experiment_task(name)
    process = ProcessWrench([3.0, -2.0, 5.0], [0.3, 0.2, -0.1], axes)
    return replace(task, robot=task.robot.varied(arm=task.robot.arm.with_process(process))), task.robot


def test_at_rest_it_is_the_placements_load():
    """Torques and base wrench to 1e-10; the placement's own code hands loads over, ours are the model's."""
    problem = drilling()
    rng = np.random.default_rng(2)
    q = rng.uniform(-2, 2, (5, problem.robot.n))
    where = np.column_stack([rng.uniform(-0.6, -0.4, 5), rng.uniform(-0.2, 0.2, 5), rng.uniform(-3, 3, 5)])
    load = ProcessLoad([-40.0, 25.0, 10.0], [1.0, -2.0, 3.0])
    task = GripperTask(problem.tasks[0].position, problem.tasks[0].rotation, [load])
    asked = PlacementProblem(problem.robot, task, plane(), unloaded=False)
    found = Evaluator(asked).task(0, 0, where, q, contacts=False, clearances=False)
    _, base = Evaluator(asked).place(0, where)
    still = np.zeros((1, problem.robot.n))
    for k in range(5):
        process = ProcessWrench(base[k].T @ load.force, base[k].T @ load.moment, "world")
        robot = problem.robot.varied(arm=problem.robot.arm.with_process(process))
        torque, wrench = robot.loads(q[k : k + 1], still, still)
        np.testing.assert_allclose(torque[0], found.torques[k, -1], atol=1e-10)
        np.testing.assert_allclose(wrench[0], found.wrenches[k, -1], atol=1e-10)


@pytest.mark.parametrize("axes", some(1, AXES))
def test_derivatives_of_the_planners_loads(axes):
    """Central differences of what the check computes; second ones of the first."""
    task, _ = case("B", axes)
    robot, rng = task.robot, np.random.default_rng(5)
    physics, s = NodePhysics(robot), rng.uniform(-1, 1, (3, 18))
    direction = np.ones((3, 6))
    at = physics.jacobian(s.T, direction.T)
    torque, wrench = robot.loads(s[:, :6], s[:, 6:12], s[:, 12:])
    np.testing.assert_allclose(at.y[:, 1:13], np.hstack([torque, wrench]), atol=1e-10)
    weights = rng.normal(size=at.y.shape) * (np.arange(at.y.shape[1]) > 0)
    bend, slope, h = bends(physics.hessian(at, weights)), all_slopes(at), 1e-5
    for column in range(18):
        step = h * (np.arange(18) == column)
        above, below = (np.hstack(robot.loads(*np.split(s + e * step, 3, axis=1))) for e in (1, -1))
        np.testing.assert_allclose(slope[:, 1:13, column], (above - below) / (2 * h), atol=1e-6)
        ahead, back = (all_slopes(physics.jacobian((s + e * step).T, direction.T)) for e in (1, -1))
        slopes = np.einsum("ny,nys->ns", weights, (ahead - back) / (2 * h))
        np.testing.assert_allclose(bend[:, column], slopes, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("axes", some(1, ["tool", "base"]))
def test_a_certificate_encloses_what_samples_show(axes):
    task, bare = case("A", axes)
    robot, motion, limits = task.robot, task.reference, Limits(tolerance=SMALL)
    checked = certified(robot, motion, check_motion(robot, motion, limits), limits)
    assert checked.certified
    assert checked.headline == "PROVED for the given uncertainty"
    bounds = checked.certificate.verdict.bounds
    samples = robot.samples(motion, np.linspace(0, motion.end, 3001))
    assert 0.99 * bounds["GN"] < samples.tip.GN.max() <= bounds["GN"]
    assert samples.slip.GT.max() <= bounds["GT"]
    assert (np.abs(samples.torques) / robot.limits.torque).max() <= bounds["torque_ratio"]
    other = check_motion(bare, motion, Limits())
    assert abs(other.worst["GT"].value - checked.worst["GT"].value) > 0.01


@pytest.mark.parametrize("axes", ["tool", "base"])
def test_nothing_within_a_tolerance_is_below_what_is_proved(axes):
    """The process does not grow with the pace, the moments of masses do."""
    task, _ = case("B", axes)
    robot, motion = task.robot, task.reference
    own = replace(SMALL, speed=0.05)
    asked = {"GN_worst_case": 0.999, "GT_worst_case": 0.999}
    sharing = Sharing(model_data(robot), motion_data(motion), tolerance_data(own, robot.support), asked)
    ends = np.unique(np.concatenate([np.linspace(0, sharing.late.end, 60), sharing.late.events]))
    [rows] = sharing.late.rows(ends[:-1], ends[1:])
    proved = np.min(sharing.moments(sharing.terms(rows)))
    times = np.linspace(1e-6, motion.end - 1e-6, 1000)
    found = np.min(worst_case_of(robot, own).all_moments(np.hstack(motion.states(times))))
    unit = robot.tip_over.reference_moment
    assert -1e-6 <= (found - proved) / unit <= 0.01


def test_loads_at_rest_and_what_is_tolerated_count_it_once():
    task, _ = case("A")
    robot, motion = task.robot, task.reference
    times = np.linspace(0.01, motion.end - 0.01, 9)
    q, qd, qdd = motion.states(times)
    rest = RestLoads(robot, q).wrenches(robot.support.gravity)
    np.testing.assert_allclose(rest, robot.loads(q, 0 * q, 0 * q)[1], atol=1e-10)
    parts = MotionLoads(robot, motion, times)
    np.testing.assert_allclose(parts.total(speed=1.3), robot.loads(q, 1.3 * qd, 1.69 * qdd)[1], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("axes", some(1, ["tool", "base"]))
def test_forces_are_those_of_a_simulation(axes):
    """MuJoCo with a free base and an actuator at the TCP; without the process they are 4 N off."""
    pytest.importorskip("mujoco")
    task, bare = case("A", axes)
    replay = Simulator((Part(task.robot, task.reference),)).run()
    assert replay.stands
    beside, without = (compared((Part(robot, task.reference),), replay) for robot in (task.robot, bare))
    assert beside.rms < 0.1  # N
    assert without.rms > 2.0
    assert "actuator 'process'" in to_mjcf(task.robot)
    with pytest.raises(InputError, match="process: a URDF cannot have one"):
        to_urdf(task.robot)


@pytest.mark.slow
def test_a_sander_on_a_cart_in_the_time_that_its_weight_allows():
    task = load_task(EXAMPLES / "tasks" / "ur5_sander.toml")
    path = load_path(EXAMPLES / "paths" / "ur5_sander.toml", task).paths[0].path
    limits = Limits()
    found = retime(task.robot, path, limits)
    checked = found.check
    assert checked.verified
    assert 0.88 < checked.worst["GN"].value <= 0.9
    bare = task.robot.varied(arm=task.robot.arm.with_process(None))
    assert check_motion(bare, found.motion, limits).worst["GN"].value < 0.7
    assert any(note.startswith("process: (-40, 12, 0) N") for note in task.robot.notes)


SEGMENTS = """
[process.grinding]
force = [0, 0, 4]

[[segment]]
name = "grind"
goal_deg = [20, -10, 30, 0, 20, 0]
process = "grinding"
dwell = 0.1

[[segment]]
name = "back"
goal = "start"
"""


def _cycle(segments=SEGMENTS):
    text = (EXAMPLES / "tasks" / "ur5_sander.toml").read_text(encoding="utf-8")
    head, rest = text.split("[process]")[0], text.split("[motion]")[1]
    motion = "[motion]\nstart_deg = [0, -90, 90, -90, -90, 0]\n"
    return head.replace("ur5.urdf", str(EXAMPLES / "tasks" / "ur5.urdf")) + motion + segments, rest


def test_segments_have_their_own(tmp_path):
    path = tmp_path / "cycle.toml"
    path.write_text(_cycle()[0])
    task = load_cycle(path)
    grinding, back = (segment.task.robot.arm.process for segment in task.segments)
    assert grinding.force.tolist() == [0, 0, 4]
    assert back is None
    path.write_text(_cycle(SEGMENTS.replace('process = "grinding"\n', ""))[0])
    with pytest.raises(InputError, match=r"cycle.toml: process.grinding: no segment carries it"):
        load_cycle(path)


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ("axes = 'tool'", "process.force: missing (a process needs a force or a moment, or a file)"),
        ("force = [1, 2]", "process.force: expected 3 numbers, got 2"),
        (
            "force = [1, 2, 3]\naxes = 'gripper'",
            "process.axes: expected one of tool, base, world, got 'gripper'",
        ),
        ("force = [1, 2, 3]\ntorque = [1, 2, 3]", "process.torque: unknown key"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, lines, complaint):
    path = tmp_path / "task.toml"
    path.write_text(f'case = "A"\n[process]\n{lines}\n')
    with pytest.raises(InputError) as error:
        load_task(path)
    assert str(error.value).startswith(f"task.toml: {complaint}")


def test_a_published_case_keeps_its_process_in_its_files(tmp_path):
    path = tmp_path / "task.toml"
    path.write_text('case = "A"\n[process]\nforce = [1, 2, 3]\n')
    task = load_task(path)
    (tmp_path / "again.toml").write_text(task.source.text(task.name, task.limits, task.objective))
    again = load_task(tmp_path / "again.toml")
    assert again.robot.arm.process.wrench.tolist() == [1, 2, 3, 0, 0, 0]


def test_what_does_not_look_at_it_says_so(tmp_path):
    task, _ = case("A")
    with pytest.raises(InputError, match="robot: what acts on its gripper belongs to the tasks"):
        PlacementProblem(task.robot, GripperTask([0.4, 0, 0.5]), plane())
    name = "place_ur5_wall.toml"
    text = (EXAMPLES / "tasks" / name).read_text(encoding="utf-8")
    (tmp_path / name).write_text(text + "\n[process]\nforce = [1, 0, 0]\n")
    with pytest.raises(InputError, match=rf"{name}: process: of a placement belongs to its poses: \[\[task"):
        load_placement(tmp_path / name)


@pytest.mark.slow
def test_a_plan_bears_it():
    """Slower than without: the planner pays for what presses."""
    task, _ = case("A", "base")
    process = ProcessWrench([0.0, 0.0, -12.0], axes="base")
    pressed = replace(task, robot=task.robot.varied(arm=task.robot.arm.with_process(process)))
    plan = plan_motion(pressed, starts=1, jobs=1)
    assert plan.verified
    check = check_motion(pressed.robot, plan.motion, pressed.limits)
    assert check.energy == pytest.approx(plan.energy, rel=1e-9)
    assert plan.energy > 1.01 * 185.6


def varying(over, knots, axes="tool"):
    rng = np.random.default_rng(7)
    return ProcessWrench(*rng.normal(size=(2, len(knots), 3)) * 3, axes, over, knots)


@pytest.mark.slow
@pytest.mark.parametrize("axes", some(1, ["tool", "base"]))
def test_a_process_over_time_is_at_every_instant_the_constant_one(axes):
    task, bare = case("A", axes)
    motion = task.reference
    process = varying("time", np.linspace(0.1, 0.9 * motion.end, 5), axes)
    robot = bare.varied(arm=bare.arm.with_process(process))
    times = np.linspace(0.0, motion.end, 7)
    samples = robot.samples(motion, times)
    for k, time in enumerate(times):
        force, moment = process.at(times[k : k + 1])
        frozen = bare.varied(arm=bare.arm.with_process(ProcessWrench(force[0], moment[0], axes)))
        one = frozen.samples(motion, times[k : k + 1])
        np.testing.assert_allclose(samples.torques[k], one.torques[0], atol=1e-11, err_msg=f"{time}")
        np.testing.assert_allclose(samples.wrenches[k], one.wrenches[0], atol=1e-11)


def test_checks_and_energy_follow_what_varies():
    """Knots are ends of intervals: a short peak between instants of the grid is seen."""
    task, bare = case("A")
    motion = task.reference
    at = 0.43217 * motion.end
    knots = [0.0, at - 1e-4, at, at + 1e-4, motion.end]
    force = np.array([[0, 0, z] for z in (-1.0, -1.0, -40.0, -1.0, -1.0)])
    robot = bare.varied(arm=bare.arm.with_process(ProcessWrench(force, 0 * force, "base", "time", knots)))
    checked = check_motion(robot, motion)
    peak = robot.samples(motion, np.array([at]))
    assert checked.worst["torque_ratio"].time == pytest.approx(at, abs=1e-6)
    assert checked.worst["torque_ratio"].value == pytest.approx(
        (np.abs(peak.torques) / robot.limits.torque).max(),
        rel=1e-3,  # 0.15 us beside the knot
    )
    samples = robot.samples(motion, times := np.linspace(0, motion.end, 20001))
    assert np.trapezoid(samples.powers.sum(axis=1), times) == pytest.approx(checked.energy, rel=1e-4)
    assert checked.verified


@pytest.mark.slow
def test_shares_and_ways_become_times():
    task, bare = case("B")
    motion = task.reference
    over_share = bare.varied(arm=bare.arm.with_process(varying("share", [0.0, 0.3, 1.0])))
    halves = over_share.during(motion).arm.process
    np.testing.assert_allclose(halves.knots, motion.end * np.array([0.0, 0.3, 1.0]), atol=1e-12)
    slower = over_share.during(motion.time_scaled(2.0)).arm.process
    np.testing.assert_allclose(slower.knots, 2 * halves.knots, atol=1e-12)
    times = np.linspace(0, motion.end, 200001)
    steps = np.linalg.norm(np.diff(bare.tool(motion.states(times)[0]), axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    process = varying("path", [0.1, 0.5 * way[-1], way[-1]])
    found = bare.varied(arm=bare.arm.with_process(process)).during(motion).arm.process
    for mine, exact in zip(found.at(times), process.at(way), strict=True):
        np.testing.assert_allclose(mine, exact, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("over", some(1, ["time", "share", "path"]))
def test_what_is_tolerated_knows_one_that_varies(over):
    """Wrenches are those of the robot's loads; deviations are lost at the brink only, by these loads."""
    task, bare = case("A")
    process = replace(varying(over, [0.2, 0.7]), axes="base")
    robot = bare.varied(arm=bare.arm.with_process(process)).during(task.reference)
    motion, times = task.reference, np.linspace(0.01, task.reference.end - 0.01, 9)
    q, qd, qdd = motion.states(times)
    rest = RestLoads(robot, q, robot.acting(times)).wrenches(robot.support.gravity)
    np.testing.assert_allclose(rest, robot.loads(q, 0 * q, 0 * q, robot.acting(times))[1], atol=1e-10)
    parts = MotionLoads(robot, motion, times)
    expected = robot.loads(q, 1.3 * qd, 1.69 * qdd, robot.acting(times))[1]
    np.testing.assert_allclose(parts.total(speed=1.3), expected, atol=1e-9)
    found = {one.quantity: one for one in tolerated(robot, motion)}
    everywhere = np.linspace(1e-6, motion.end - 1e-6, 2000)
    for speed, stands in ((0.995, True), (1.01, False)):
        factor = 1 + speed * found["faster"].value / 100
        q, qd, qdd = motion.states(everywhere)
        states = robot.contact_states(
            robot.loads(q, factor * qd, factor**2 * qdd, robot.acting(everywhere))[1]
        )
        worst = robot.tip_over.evaluate(states).GN.max(), robot.slip.evaluate(states).GT.max()
        assert bool(max(worst) < 1) == stands


@pytest.mark.slow
def test_load_cases_know_one_that_varies():
    """What acts in the pose, if that is known; else the worst of its rows."""
    task, bare = case("A")
    rows = np.array([[0, 0, 0], [30.0, 0, -60.0], [-20.0, 10.0, 5.0]])
    process = ProcessWrench(rows, 0 * rows, "base", "time", [0.1, 0.2, 0.4])
    robot, pose = bare.varied(arm=bare.arm.with_process(process)), task.start
    alone = [bare.varied(arm=bare.arm.with_process(ProcessWrench(row, 0 * row, "base"))) for row in rows]
    given = {"tilts": (0.0, 0.03), "pushes": (0.0,), "payloads": (0.5,)}
    found = {one.pose: one for one in load_cases(robot, LoadCaseGrid(
        {"any": pose, "then": pose}, acting={"then": np.append(rows[1], np.zeros(3))}, **given
    ))}  # fmt: skip
    each = [load_cases(own, LoadCaseGrid({"any": pose}, **given))[-1] for own in alone]
    worst = [max(one.GN for one in each), max(one.GT for one in each)]
    np.testing.assert_allclose([found["any"].GN, found["any"].GT], worst, atol=1e-6)
    np.testing.assert_allclose([found["then"].GN, found["then"].GT], [each[1].GN, each[1].GT], atol=1e-6)
    assert each[0].GN < each[1].GN  # it does something
    tilts = [tilt_by_direction(own, pose, 12)[1] for own in alone]
    np.testing.assert_allclose(tilt_by_direction(robot, pose, 12)[1], np.min(tilts, axis=0), atol=1e-5)
    held = [largest_payload(own, pose[None])[0] for own in alone]
    both = largest_payload(robot, np.tile(pose, (3, 1)), np.hstack([rows, 0 * rows]))
    np.testing.assert_allclose(both, held, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("axes", some(1, ["tool", "base"]))
def test_stops_by_brakes_have_what_acts_when_they_begin(axes):
    """Each is that of a robot on which it acts all the time."""
    task, bare = case("A")
    motion, process = task.reference, replace(varying("share", [0.2, 0.5, 0.7]), axes=axes)
    robot = bare.varied(arm=bare.arm.with_process(process)).during(motion)
    hold = np.maximum(0.8 * robot.limits.torque, 15.0)
    brakes = Brakes(tuple(hold), tuple(1.5 * hold))
    times = np.linspace(0.1, 0.9, 4) * motion.end
    q, qd, _ = motion.states(times)
    found = BrakeCheck(robot, brakes).stops(q, qd, robot.acting(times))
    assert np.isfinite(found.rests).all()
    for k, (force, moment) in enumerate(zip(*process.at(times / motion.end), strict=True)):
        own = bare.varied(arm=bare.arm.with_process(ProcessWrench(force, moment, axes)))
        alone = BrakeCheck(own, brakes).stops(q, qd)
        np.testing.assert_allclose(found.GN[k], alone.GN[k], rtol=1e-6)
        np.testing.assert_allclose(found.displacements[k], alone.displacements[k], atol=1e-9)
    assert np.abs(BrakeCheck(bare, brakes).stops(q, qd).GN - found.GN).max() > 1e-3 * found.GN.max()
    assert check_motion(robot, motion, Limits(brakes=brakes)).worst["GN_brakes"].value > 0


def test_tables_of_a_motion_have_one_over_the_path():
    """As at the instants alone, but for the sides of jumps."""
    task, bare = case("A")
    robot = bare.varied(arm=bare.arm.with_process(varying("path", [0.1, 0.6])))
    found = sample_motion(robot, task.reference, 0.05)
    inside = np.flatnonzero(np.abs(found.times[:, None] - task.reference.event_times).min(axis=1) > 1e-6)
    alone = robot.samples(task.reference, found.times[inside])
    np.testing.assert_allclose(found.torques[inside], alone.torques, atol=1e-9)
    assert np.abs(alone.torques - bare.samples(task.reference, alone.times).torques).max() > 0.5


def test_what_does_not_follow_it_refuses_it():
    task, bare = case("A")
    for over in ("time", "share", "path"):
        robot, q = bare.varied(arm=bare.arm.with_process(varying(over, [0.0, 1.0]))), np.zeros((1, 6))
        for ask in (
            partial(robot.loads, q, q, q),
            partial(robot.load_expressions, *[cs.SX.zeros(6)] * 3),
            partial(Closing, robot),
        ):
            with pytest.raises(InputError, match=r"process: varies over .*; plans for stops by brakes"):
                ask()
        if over != "time":
            with pytest.raises(InputError, match="which the time alone does not tell"):
                robot.acting(np.zeros(1))
        assert not robot.samples(task.reference, np.array([0.1])).tip.GN[0] > 1


CHECKED = """
case = "A"
[limits]
GN = 0.9
[tolerance]
preset = "none"
[process]
file = "force.csv"
axes = "base"
"""


def test_files_of_forces(tmp_path, capsys, without_robustness):
    (tmp_path / "force.csv").write_text("share,fz_N,mx_Nm\n0,0,0\n0.5,-3,0.1\n1,0,0\n")
    path = tmp_path / "task.toml"
    path.write_text(CHECKED)
    task = load_task(path)
    process = task.robot.arm.process
    assert (process.over, process.force[1].tolist()) == ("share", [0, 0, -3])
    (tmp_path / "motion.json").write_text(json.dumps(task.reference.to_dict()))
    assert main(["check", str(tmp_path / "motion.json"), "--task", str(path)]) == 0
    assert "up to 3 N and 0.1 N m on the gripper, in axes of the base, over share" in " ".join(
        capsys.readouterr().out.split()
    )
    write_plan(tmp_path / "plan", plan_of(task, task.reference))
    (tmp_path / "force.csv").unlink()
    assert main(["check", str(tmp_path / "plan")]) == 0
    assert "N m on the gripper, in axes of the base, over share" in " ".join(capsys.readouterr().out.split())
    for content, complaint in (
        ("share,time_s,fx_N\n0,0,1\n", "expected one column of time_s, share, path_m and some of"),
        ("share,Fx\n0,1\n", "column 'Fx': expected one each of"),
        ("share,fx_N\n0,a\n", "line 2, fx_N: expected a number, got 'a'"),
        ("time_s,fx_N\n1,2\n1,3\n", "knots: must increase"),
        ("", "is empty"),
    ):
        (tmp_path / "force.csv").write_text(content)
        with pytest.raises(InputError, match=r"task.toml: process.file: ") as error:
            load_task(path)
        assert complaint in str(error.value)
