"""The robot at its place, and placements ranked by the energy of the motions planned there."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.for_motion import place_for_motion, placed_robot, shortest_way
from ocptip.placement.problem import GripperTask, PlacementProblem, Weights
from ocptip.placement.result import evaluate_placement
from ocptip.placement.terrain import plane
from ocptip.published.arms import experiment_poses
from ocptip.robots.geometry import Pillar, Wall
from tests.placement.placement_scenes import drilling, four_feet, modular_robot


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
def test_placements_are_ranked_by_planned_energy(swing):
    result = place_for_motion(swing, candidates=2, starts=1, placement_starts=3)
    energies = [m.energy for m in result.ranked]
    assert energies == sorted(energies)
    best = result.best
    assert best.verified
    assert best.placement.feasible
    plan = best.plans[0]
    assert plan.task.start == pytest.approx(best.placement.angles[0])
    assert plan.task.goal == pytest.approx(best.placement.angles[1])
    assert plan.check.worst["GN"].value <= 0.9 + 1e-6
    data = result.to_dict()
    assert data["ranked"][0]["energy_J"] == pytest.approx(best.energy)


def test_shortest_way_keeps_poses_and_constraints(swing):
    from ocptip.placement.place import place

    placement = place(swing, starts=1).best
    evaluator = Evaluator(swing)
    shorter = shortest_way(evaluator, placement)
    assert shorter.feasible
    assert shorter.parameters == pytest.approx(placement.parameters)
    speed = swing.robot.arm.limits.speed
    before, after = (np.abs(np.diff(p.angles, axis=0)[0]) @ (1 / speed) for p in (placement, shorter))
    assert after <= before + 1e-9


def test_one_task_is_no_motion():
    with pytest.raises(InputError, match="a motion needs two gripper tasks"):
        place_for_motion(drilling())


@pytest.mark.parametrize("name", ["candidates", "starts", "jobs", "placement_starts"])
def test_numbers_are_checked_before_anything_is_computed(monkeypatch, name):
    def fail(*arguments, **options):
        raise AssertionError("computed")

    monkeypatch.setattr("ocptip.placement.for_motion.place", fail)
    tasks = [GripperTask([0.4, 0.0, z], orientation="free", name=f"at {z}") for z in (0.5, 0.6)]
    with pytest.raises(InputError, match=f"^{name}: must be a whole number >= 1, got 0"):
        place_for_motion(drilling(tasks=tasks), **{name: 0})
