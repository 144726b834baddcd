"""Start and goal as variables of the planner: exact derivatives, postures that reach the pose."""

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.plan import plan_motion
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.formulation import Smoothing
from ocptip.motion.planner.one_start import Search
from ocptip.motion.planner.random_start import random_start
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.limits import Limits
from tests.motion.planner.test_program import geared_task
from tests.quick import some


def symmetric(which, limits=None):
    """A gripper that may turn about z at start, at goal, or at both; two commands per joint."""
    task = geared_task()
    targets = tuple(
        PoseTarget(*gripper_pose(task.robot.arm, q), symmetric_about="z") if name in which else None
        for name, q in (("start", task.start), ("goal", task.goal))
    )
    more = {"limits": limits} if limits else {}
    return dataclasses.replace(task, targets=targets, optimised=tuple(range(6)), commands=2, **more)


@pytest.fixture(scope="module")
def search():
    return Search(symmetric(("start", "goal")))


def motion_of(search, seed):
    task = search.task
    rng = np.random.default_rng(seed)
    return random_start(task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng)


def programs(search, seed):
    """The three kinds of programs with x near a random motion, ends moved away from the postures."""
    formulation, limits = search.formulation, search.task.limits
    motion = motion_of(search, seed)
    x = formulation.variables(motion)
    x[formulation.layout.start] += 0.02
    x[formulation.layout.goal] -= 0.03
    yield formulation.coarse_program(limits, motion.end, nodes=12), x
    yield formulation.fine_program(limits, Smoothing(0.02, 0.06, 0.03, 2.0), x), x
    order, x = order_of(formulation, x)
    yield formulation.ordered_program(limits, order, x, [(2, 0.3)]), x


def with_rows(program, seed):
    rng = np.random.default_rng(seed)
    rows = program.no_rows()
    for name, mask in rows.masks.items():
        mask[...] = rng.random(mask.shape) < (0.01 if name == "clearance" else 0.1)
    rows["slip"][:] = False  # its curvature is left out
    rows["torque"][-3:] = True  # the nodes at rest
    return program.with_rows(rows)


@pytest.mark.parametrize("kind", some(1, [0, 1, 2]))
def test_derivatives_are_those_of_differences(search, kind):
    program, x = list(programs(search, 3))[kind]
    program = with_rows(program, kind)
    rng = np.random.default_rng(kind)
    on = rng.normal(size=len(program.bounds()[0]))
    layout = search.formulation.layout
    directions = [rng.normal(size=len(x)) * 0.1, *np.eye(len(x))[[layout.start.start + 2, layout.goal.start]]]
    for direction in directions:
        h = 1e-6
        low, high = x - h * direction, x + h * direction
        values = [np.append(program.values(at)[1], program.values(at)[0]) for at in (low, high)]
        slope = np.append(program.jacobian(x) @ direction, program.gradient(x) @ direction)
        np.testing.assert_allclose(slope, (values[1] - values[0]) / (2 * h), rtol=1e-5, atol=1e-5)
        slopes = [program.gradient(at) + on @ program.jacobian(at) for at in (low, high)]
        second = program.hessian(x, 1.0, on) @ direction
        difference = (slopes[1] - slopes[0]) / (2 * h)
        scale = np.abs(difference).max()
        np.testing.assert_allclose(second, difference, rtol=1e-4, atol=2e-5 * scale)


def test_there_are_nodes_at_rest_in_both_postures(search):
    n = search.task.robot.n
    layout = search.formulation.layout
    for number, (program, x) in enumerate(programs(search, 5)):
        states = program.nodes.values(x).T
        rest = states[-3:-1] if number == 2 else states[-2:]  # before the further node of the ordered one
        np.testing.assert_allclose(rest[:, n:], 0.0, atol=1e-9)
        np.testing.assert_allclose(rest[0, :n], x[layout.start], atol=1e-12)
        if number < 2:  # from the start by the ramps, which the shifted ends do not fit
            continue
        motion = motion_of(search, 5)
        way = motion.goal - motion.start
        np.testing.assert_allclose(rest[1, :n], x[layout.start] + way, atol=1e-9)


def test_only_ends_with_more_angles_than_equations_are_free():
    task = symmetric(("goal",))
    assert Search(task).ends.free == (False, True)
    assert not Search(dataclasses.replace(task, optimised=(0, 1, 2))).ends
    exact = tuple(t and PoseTarget(t.position, t.rotation) for t in task.targets)
    assert not Search(dataclasses.replace(task, targets=exact)).ends


def test_start_and_goal_have_to_be_postures_of_their_poses():
    task = symmetric(("goal",))
    with pytest.raises(InputError, match=r"targets: goal misses its gripper pose by 0\.\d+ \(m, rad\)"):
        dataclasses.replace(task, goal=task.goal + 0.1)


@pytest.fixture(scope="module")
def planned():
    task = symmetric(("start", "goal"))
    fixed = dataclasses.replace(task, targets=(None, None))
    return [plan_motion(t, starts=1, jobs=1) for t in (task, fixed)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(1, [2, 3]))
def test_a_start_whose_exact_program_is_left_early_goes_on(search, seed):
    """Its iterations end before equations hold: no commands have such phases, another round finds some."""
    attempt = search.run(0, seed)
    assert attempt.result.status == "verified"
    assert attempt.check.energy < 26.5


@pytest.mark.slow
def test_a_free_turn_saves_energy_and_the_poses_are_kept(planned):
    free, fixed = planned
    assert free.verified
    assert fixed.verified
    assert free.energy < 0.97 * fixed.energy
    arm = free.task.robot.arm
    for posture, target, given in (
        (free.motion.start, free.task.targets[0], fixed.task.start),
        (free.motion.goal, free.task.targets[1], fixed.task.goal),
    ):
        position, rotation = gripper_pose(arm, posture)
        np.testing.assert_allclose(position, target.position, atol=1e-7)
        np.testing.assert_allclose(rotation[:, 2], target.rotation[:, 2], atol=1e-7)
        assert np.abs(posture - given).max() > 0.05
    np.testing.assert_array_equal(free.task.start, free.motion.start)
    np.testing.assert_array_equal(free.task.goal, free.motion.goal)
    assert check_motion(free.task.robot, free.motion, free.task.limits).verified


@pytest.mark.slow
def test_margins_to_angle_limits_are_kept(planned):
    """A margin that start and goal just keep binds the motion; one that is wider refuses them."""
    free = planned[0]
    limits, q = free.task.robot.limits, np.array([free.task.start, free.task.goal])
    least = min(np.min(q - limits.angle_min), np.min(limits.angle_max - q))
    used = np.deg2rad(free.check.worst["angle_margin_deg"].value)
    assert used <= least + 1e-9
    task = dataclasses.replace(free.task, limits=Limits(angle_margin=least - 0.02), targets=(None, None))
    plan = plan_motion(task, starts=4, jobs=1)
    worst = plan.check.worst["angle_margin_deg"]
    assert plan.verified
    assert worst.limit == pytest.approx(np.rad2deg(least - 0.02))
    assert worst.value >= worst.limit - 1e-6
    broken = check_motion(task.robot, plan.motion, Limits(angle_margin=least + 0.1))
    assert any(violation.name == "angle_margin_deg" for violation in broken.violations)
