"""Random motions to start from: they stand, stay within joint limits and lead to the goal."""

import numpy as np
import pytest

from ocptip.motion.planner.random_start import DETOUR, random_start
from ocptip.published.tasks import experiment_task
from ocptip.standing.instants import Instants
from ocptip.standing.limits import Limits
from ocptip.task_files.motion import load_task
from tests.quick import some


def start_of(task, seed, limits=None, commands=None):
    return random_start(
        task.robot,
        task.start,
        task.goal,
        task.optimised,
        commands or task.commands,
        limits or task.limits,
        np.random.default_rng(seed),
    )


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


@pytest.fixture(scope="module")
def ur5(root):
    return load_task(root / "src/ocptip/examples/tasks" / "ur5_cart.toml")


def assert_stands(task, motion, limits):
    times, _ = motion.quadrature(4)
    samples = task.robot.samples(motion, times)
    assert samples.states.persistent.all()
    assert np.max(samples.tip.GN) <= limits.GN + 2e-3  # checked at four nodes per interval
    assert np.max(samples.slip.GT) <= limits.GT + 2e-3


@pytest.mark.parametrize("seed", some(2, range(8)))
def test_it_stands(task, seed):
    assert_stands(task, start_of(task, seed), task.limits)


@pytest.mark.slow
def test_it_stands_with_small_reserves_left(task):
    """With tight limits it is slower, and stands, too."""
    tight = Limits(GN=0.35, GT=0.35)
    loose = Limits(GN=0.35, GT=0.9)
    ends = []
    for seed in range(4):
        motion = start_of(task, seed, tight)
        assert_stands(task, motion, tight)
        ends.append((motion.end, start_of(task, seed, loose).end))
    tight_ends, loose_ends = np.array(ends).T
    assert np.sum(tight_ends) > 1.1 * np.sum(loose_ends)


@pytest.mark.parametrize("name", some(1, ["task", "ur5"]))
def test_it_leads_from_start_to_goal_within_the_joint_limits(request, name):
    task = request.getfixturevalue(name)
    arm = task.robot.arm.limits
    for seed in range(5):
        motion = start_of(task, seed)
        np.testing.assert_array_equal(motion.start, task.start)
        np.testing.assert_allclose(motion.goal, task.goal, atol=1e-12)
        q, qd, _ = motion.states(np.array([0.0, motion.end]))
        np.testing.assert_allclose(q, [task.start, task.goal], atol=1e-9)
        np.testing.assert_allclose(qd, 0, atol=1e-9)
        assert np.all(motion.speed_peaks <= arm.speed * (1 + 1e-12))
        assert np.all(motion.acceleration_peaks <= arm.acceleration * (1 + 1e-12))
        for joint, ramps in enumerate(motion.joints):
            targets = np.array([command.phi_e for command in ramps.commands])
            assert np.all((targets >= arm.angle_min[joint]) & (targets <= arm.angle_max[joint]))
            low, high = sorted((task.start[joint], task.goal[joint]))
            assert np.all((targets >= low - DETOUR) & (targets <= high + DETOUR))


@pytest.mark.parametrize("commands", [1, 2, 4])
def test_number_of_commands(task, commands):
    motion = start_of(task, 2, commands=commands)
    expected = [commands if j in task.optimised else 1 for j in range(6)]
    assert [len(joint.commands) for joint in motion.joints] == expected


def test_passive_joints_end_with_the_motion(task):
    motion = start_of(task, 3)
    for joint in set(range(6)) - set(task.optimised):
        if task.goal[joint] != task.start[joint]:
            assert motion.joints[joint].end == pytest.approx(motion.end, rel=1e-9)


@pytest.mark.slow
def test_the_seed_decides(task):
    first, again, other = (start_of(task, seed).to_dict() for seed in (5, 5, 6))
    assert first == again
    assert first != other


@pytest.mark.slow
def test_the_path_collides_nowhere(ur5):
    for seed in range(5):
        motion = start_of(ur5, seed)
        q = motion.states(np.linspace(0, motion.end, 400))[0]
        assert np.min(ur5.robot.collision.gaps(q)) > ur5.limits.clearance - 5e-3  # looked at 40 instants


@pytest.mark.parametrize("straight", some(1, [True, False]))
def test_starts_of_a_robot_with_objects_keep_the_tray_level_enough(root, straight):
    """Draws come nearer to the straight line; the straight one keeps all joints in proportion."""
    task = load_task(root / "src/ocptip/examples/tasks" / "ur5_waiter.toml")
    own = task.robot, task.start, task.goal, task.optimised, task.commands, task.limits
    motion = random_start(*own, np.random.default_rng(0), straight=straight)
    q = motion.states(np.linspace(0, motion.end, 40))[0]
    way = task.goal - task.start
    aside = q - task.start - (q - task.start) @ way[:, None] * way / (way @ way)
    assert (np.max(np.abs(aside)) < 1e-5) == straight
    np.testing.assert_allclose(q[-1], task.goal, atol=1e-9)
    for glass in Instants.at_rest(task.robot, q).interfaces[1:]:
        assert np.max(glass.tip.GN) < 0.9
        assert np.max(glass.largest_slip.GT) < 0.9
