"""Poses of a cycle that leave a continuum of postures: where the cycle costs least is looked for."""

import dataclasses
import json
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.cli.main import main
from ocptip.motion.cycles.choices import layers_of, leg_cost, likely_sequences
from ocptip.motion.cycles.free_poses import MovedWay, free_ends, moved_sequences, posture_near
from ocptip.motion.files.plan_files import write_plan
from ocptip.motion.plan import plan_motion
from ocptip.robots.kinematics import gripper_pose
from ocptip.task_files.cycle import load_cycle
from ocptip.trajectories.read import load_motion
from tests.motion.cycles.cycle_files import CYCLE, written

GOAL = "goal_deg = [20, 30, -8, 45, -18, 150]"
FREE = "free = { y = [-0.06, 0.02], z = [-0.05, 0.05] }"
RANGES = np.array([[-0.06, 0.02], [-0.05, 0.05]])


@pytest.fixture(scope="module")
def with_pose(tmp_path_factory):
    """The file of the cycle whose first goal is a pose, and what is free of it."""
    folder = tmp_path_factory.mktemp("free")
    arm = load_cycle(written(folder)).robot.arm
    position, rotation = gripper_pose(arm, np.deg2rad([20, 30, -8, 45, -18, 150]))
    turn = np.degrees(Rotation.from_matrix(rotation).as_rotvec()).tolist()

    def text(free):
        pose = f"goal_pose = {{ position = {position.tolist()}, rotation_vector_deg = {turn}, {free} }}"
        return CYCLE.replace(GOAL, pose)

    return text


@pytest.fixture(scope="module")
def plans(with_pose, tmp_path_factory):
    """Makes a plan of the pose as it is, or of the pose that is free sideways and in its height."""
    folder = tmp_path_factory.mktemp("free")
    texts = {"fixed": with_pose("fold = 0"), "free": with_pose(FREE)}

    @cache
    def plan(name):
        return plan_motion(load_cycle(written(folder, texts[name], f"{name}.toml")), starts=1, jobs=1)

    return plan


def first_way(task):
    layers = layers_of(task)
    return [layer[i] for layer, i in zip(layers, likely_sequences(task, layers)[0], strict=True)]


@pytest.mark.slow
def test_a_free_pose_spares_energy(plans):
    assert plans("fixed").verified
    assert plans("free").verified
    assert plans("free").energy < 0.95 * plans("fixed").energy


@pytest.mark.slow
def test_the_written_trajectory_is_within_the_range_and_says_where(plans, tmp_path, capsys):
    plan = plans("free")
    folder = tmp_path / "out"
    write_plan(folder, plan)
    points = load_motion(folder / "trajectory.json", plan.task.robot.names, plan.task.robot.units)
    own = plan.task.segments[0].target
    seam = points.points.angles[np.argmin(np.abs(points.points.times - plan.parts[0].duration))]
    position, rotation = gripper_pose(plan.task.robot.arm, seam)
    x, *offsets = position - own.position
    assert abs(x) < 1e-6
    np.testing.assert_allclose(rotation, own.rotation, atol=1e-6)
    assert np.all((RANGES[:, 0] - 1e-6 <= offsets) & (offsets <= RANGES[:, 1] + 1e-6))
    assert np.abs(offsets).max() > 0.01
    data = json.loads((folder / "plan.json").read_text())
    assert data["segments"][0]["goal_offset_m"] == pytest.approx(
        dict(zip("yz", offsets, strict=True)), abs=1e-6
    )
    assert "goal_offset_m" not in data["segments"][1]
    assert main(["check", str(folder / "trajectory.json"), "--tolerance", "none"]) == 0
    assert "gripper pose" not in capsys.readouterr().out


@pytest.mark.slow
def test_a_motion_outside_the_range_is_told_apart(plans, with_pose, tmp_path, capsys):
    write_plan(tmp_path / "out", plans("free"))
    narrow = written(tmp_path, with_pose("free = { z = [-0.0001, 0.0] }"))
    plan_json = str(tmp_path / "out" / "plan.json")
    assert main(["check", plan_json, "--task", str(narrow), "--tolerance", "none"]) == 0
    assert "the goal of segment out misses its gripper pose by 0.0" in " ".join(
        capsys.readouterr().out.split()
    )


@pytest.mark.slow
def test_the_best_height_is_found(with_pose, tmp_path):
    """Against heights all over the range."""
    task = load_cycle(written(tmp_path, with_pose("free = { z = [-0.1, 0.1] }")))
    way = first_way(task)
    free = free_ends(task)
    assert list(free) == [1]
    moved = MovedWay(task, free, way)
    before = moved.cost
    moved.descend()
    costs = []
    out, back = task.segments
    for height in np.linspace(-0.1, 0.1, 17):
        q, there = posture_near(task.robot.arm, free[1].at([0.0, 0.0, height]), way[1])
        assert there
        costs.append(leg_cost(out, way[0], q) + leg_cost(back, q, way[0]))
    assert min(costs) < 0.995 * before
    assert moved.cost <= 1.005 * min(costs)
    assert free[1].residuals(task.robot.arm, moved.postures[1][None])[0] < 1e-8


def test_a_gripper_that_may_be_turned_is(with_pose, tmp_path):
    task = load_cycle(written(tmp_path, with_pose('symmetric_about = "z"')))
    free = free_ends(task)
    way = first_way(task)
    way[1][5] += 1.0  # the last joint turns about this axis
    assert free[1].residuals(task.robot.arm, way[1][None])[0] < 1e-8
    moved = MovedWay(task, free, way)
    before = moved.cost
    moved.descend()
    assert moved.cost < 0.99 * before
    assert free[1].residuals(task.robot.arm, moved.postures[1][None])[0] < 1e-8


@pytest.mark.slow
def test_ways_as_they_are_stay_among_those_that_are_planned(with_pose, tmp_path):
    task = load_cycle(written(tmp_path, with_pose(FREE)))
    layers = layers_of(task)
    ways = likely_sequences(task, layers)
    more, moved = moved_sequences(task, layers, ways)
    assert moved[-1] == ways[0]
    assert moved[0] != ways[0]
    assert all(way[0] == way[-1] for way in moved)
    for layer, other in zip(layers, more, strict=True):
        np.testing.assert_array_equal(other[: len(layer)], layer)


@pytest.mark.slow
def test_an_open_cycle_may_end_and_begin_free(with_pose, tmp_path):
    pose = with_pose(FREE).split("goal_pose")[1].splitlines()[0]
    text = with_pose(FREE).replace("start_deg = [-40, 35, -18, 45, -37, 180]", f"start_pose{pose}")
    text = text.replace('goal = "start"', "goal_deg = [-40, 35, -18, 45, -37, 180]").replace(
        f"goal_pose{pose}", "goal_deg = [0, 30, -8, 45, -18, 150]"
    )
    task = load_cycle(written(tmp_path, text))
    assert list(free_ends(task)) == [0]
    last = dataclasses.replace(task, starts=task.segments[1].goals, target=None)
    swapped = dataclasses.replace(last.segments[1], goals=task.starts, target=task.target)
    last = dataclasses.replace(last, segments=(last.segments[0], swapped))
    for open_task in (task, last):
        moved = MovedWay(open_task, free_ends(open_task), first_way(open_task))
        before = moved.cost
        moved.descend()
        assert moved.cost < before


@pytest.mark.parametrize(
    ("free", "refusal"),
    [
        ("free = { z = [0.1, 0.2] }", "segment[1].goal_pose.free: 0 must be within each range"),
        ("free = { z = 0.1 }", "segment[1].goal_pose.free.z: expected a list of 2 numbers"),
        ("free = { up = [0, 0.1] }", "segment[1].goal_pose.free.up: unknown key"),
    ],
)
def test_what_is_no_range_is_refused(with_pose, tmp_path, capsys, free, refusal):
    assert main(["plan", str(written(tmp_path, with_pose(free)))]) == 2
    assert refusal in capsys.readouterr().err


def test_single_motions_have_no_free_poses(with_pose, tmp_path, capsys):
    text = with_pose(FREE).split("[[segment]]")
    goal = text[1].split("\n")[2]
    single = text[0].replace("[payload.part]", "[payload]") + goal + "\n"
    assert main(["plan", str(written(tmp_path, single))]) == 2
    assert "goal_pose.free: is for poses of cycles, in a [[segment]]" in capsys.readouterr().err
