"""The robot at its place, and places ranked by the best timing of a path through the gripper tasks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.objective import ENERGY
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.place import place
from ocptip.placement.problem import GripperTask, PlacementProblem, Weights
from ocptip.placement.result import evaluate_placement
from ocptip.placement.terrain import plane
from ocptip.published.arms import experiment_poses
from ocptip.retiming.retime import retime
from ocptip.robots.geometry import Pillar, Wall
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.tolerance import Uncertainty
from ocptip.task_files.path import load_path
from studies.placement import for_path
from studies.placement.for_path import motion_limits, shortest_way
from tests.placement.placement_scenes import drilling, four_feet, modular_robot, placed_robot
from tests.places import EXAMPLES
from tests.retiming.paths import cart


@pytest.fixture(scope="module")
def sweep():
    """The sweep of the examples as gripper tasks, and the place where the cart stands."""
    return for_path.sweep()


@pytest.fixture(autouse=True)
def only_known_places(monkeypatch: pytest.MonkeyPatch):
    """No others, and a short search."""
    monkeypatch.setattr(for_path, "place", lambda *a, **k: SimpleNamespace(places=(), placements=()))
    monkeypatch.setattr(for_path, "sampled_places", lambda *a: [])
    monkeypatch.setattr(for_path, "_ROUNDS", 4)


@pytest.mark.slow
def test_a_place_where_the_same_path_is_faster(sweep):
    problem, here = sweep
    given = retime(placed_robot(here), load_path(EXAMPLES / "paths" / "ur5_sweep.toml", cart()).paths[0].path)
    (found,) = for_path.place_for_path(problem, known=[here])
    assert found.verified
    assert found.timed.motion.end < 0.995 * given.motion.end
    assert not np.array_equal(found.placement.parameters, here.parameters)
    checked = check_motion(placed_robot(found.placement), found.timed.motion, motion_limits(problem))
    assert checked.verified
    for k, task in enumerate(problem.tasks):
        where = found.placement.angles[k]
        assert np.min(np.abs(found.path.samples - where).max(axis=1)) < 1e-9
        position = gripper_pose(problem.robot.arm, where)[0]
        there = found.placement.base_position + found.placement.base_rotation @ position
        np.testing.assert_allclose(there, task.position, atol=1e-6)
    data = found.to_dict()
    assert data["cost"] == found.cost < data["timing"]["duration_s"] * 1.01


@pytest.mark.slow
def test_the_gripper_keeps_its_lines_in_the_world(sweep):
    every, there = sweep
    problem = PlacementProblem(every.robot, every.tasks[:2], plane(), limits=every.limits)
    here = evaluate_placement(Evaluator(problem), 0, there.parameters, there.angles[:2])
    (found,) = for_path.place_for_path(problem, ENERGY, between="tool lines", known=[here])
    assert found.verified
    assert found.cost == pytest.approx(found.timed.check.energy)
    position = gripper_pose(problem.robot.arm, found.timed.motion.states(np.linspace(0, 0.3, 20))[0])[0]
    there = found.placement.base_position + position @ found.placement.base_rotation.T
    ends = [np.asarray(task.position) for task in problem.tasks[:2]]
    way = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    off = there - ends[0] - np.outer((there - ends[0]) @ way, way)
    assert np.abs(off).max() < 2e-4
    assert (there[-1] - ends[0]) @ way > 0.01


def test_bad_input_is_refused(sweep):
    problem, here = sweep
    with pytest.raises(InputError, match="a motion needs two gripper tasks"):
        for_path.place_for_path(drilling())
    own = drilling(tolerance=Uncertainty(friction=0.2))
    own = replace(own, tasks=(own.tasks[0], replace(own.tasks[0], name="other")))
    with pytest.raises(InputError, match="tolerance: motions are planned for the nominal base"):
        for_path.place_for_path(own)
    with pytest.raises(InputError, match=r"^between: expected one of spline, lines, tool lines, got 'arcs'"):
        for_path.place_for_path(problem, between="arcs", known=[here])  # pyright: ignore
    with pytest.raises(InputError, match=r"^candidates: must be a whole number >= 1, got 0"):
        for_path.place_for_path(problem, candidates=0)


def test_placed_robot_feels_the_loads_of_the_evaluation():
    problem = drilling(terrain=plane((0.2, -0.1)))
    q = np.full(6, 0.3)
    evaluator = Evaluator(problem)
    placement = evaluate_placement(evaluator, 0, np.array([-0.5, 0.1, 0.7]), q[None])
    torques, wrench = placed_robot(placement).loads(q[None], np.zeros((1, 6)), np.zeros((1, 6)))
    found = evaluator.task(0, 0, placement.parameters[None], q[None])
    assert torques[0] == pytest.approx(found.torques[0, 0])
    assert wrench[0] == pytest.approx(found.wrenches[0, 0])
    assert placed_robot(placement).tip_over.reference_moment == four_feet().tip_over.reference_moment


def test_obstacles_keep_their_distance_in_base_axes():
    problem = drilling()
    origin, base = Evaluator(problem).place(0, np.array([[-0.5, 0.1, 0.7]]))
    origin, base = origin[0], base[0]
    point = np.array([0.3, -0.2, 0.6])
    local = base.T @ (point - origin)
    wall = Wall(np.array([0.6, 0.0, 0.8]), 0.4)
    moved = wall.placed(base.T, -base.T @ origin)
    assert moved.distance - moved.normal @ local == pytest.approx(wall.distance - wall.normal @ point)
    pillar = Pillar([0.1, 0.5, 0.0], 0.2)
    turned = pillar.placed(base.T, -base.T @ origin)
    arm = local - turned.point
    across = np.linalg.norm(arm - (arm @ turned.axis) * turned.axis)
    assert across == pytest.approx(np.hypot(*(point - pillar.point)[:2]))


@pytest.fixture(scope="module")
def swing():
    robot = modular_robot()
    start, goal = experiment_poses()
    up = np.array([0.0, 0.0, 0.298])
    tasks = [
        GripperTask(start.position + up, start.rotation, name="start"),
        GripperTask(goal.position + up, goal.rotation, name="goal"),
    ]
    return PlacementProblem(robot, tasks, plane((0.03, 0.0)), weights=Weights(0.3, 0.3, 0.0, 0.4))


@pytest.mark.slow
def test_shortest_way_keeps_poses_and_constraints(swing):
    placement = place(swing, starts=1).best
    evaluator = Evaluator(swing)
    shorter = shortest_way(evaluator, placement)
    assert shorter.feasible
    assert shorter.parameters == pytest.approx(placement.parameters)
    speed = swing.robot.arm.limits.speed
    before, after = (np.abs(np.diff(p.angles, axis=0)[0]) @ (1 / speed) for p in (placement, shorter))
    assert after <= before + 1e-9
