"""Postures to choose from: which are planned, and that the better one wins."""

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.choices import APART, PLANNED, first_round, likely_choices, plainest_cost, second_round
from ocptip.motion.plan import plan_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES


@pytest.fixture(scope="module")
def task():
    """Case A; its goal may be reached by a shorter way, too, or by a longer one."""
    task = experiment_task("A", "effective")
    near = 0.5 * (task.start + task.goal)
    far = task.goal + 0.2 * (task.goal - task.start)
    return dataclasses.replace(
        task, reference=None, choices=tuple((task.start, g) for g in (far, task.goal, near))
    )


def test_the_cost_of_the_plainest_motion_is_that_of_single_ramps(task):
    robot, limits = task.robot, task.robot.limits
    costs = [
        robot.energy(
            Trajectory.ending_together(
                task.start, task.goal, [None] * robot.n, limits.speed / f, limits.acceleration / f**2
            )
        )
        for f in (1.0, 1.15, 1.3, 1.5, 1.8, 2.2)
    ]
    assert plainest_cost(task) in [pytest.approx(cost, rel=1e-12) for cost in costs]
    harder = dataclasses.replace(task, limits=Limits(GN=0.3, GT=0.3))
    assert plainest_cost(harder) >= plainest_cost(task)


def test_the_most_promising_come_first(task):
    chosen = likely_choices(task)
    assert 1 <= len(chosen) <= PLANNED
    np.testing.assert_array_equal(chosen[0].goal, task.choices[2][1])
    assert all(one.choices == () for one in chosen)
    alone = dataclasses.replace(task, choices=())
    assert likely_choices(alone) == [alone]


def test_pairs_that_cannot_be_planned_are_left_out(task):
    beyond = task.goal.copy()
    beyond[0] = 100.0
    chosen = likely_choices(
        dataclasses.replace(task, choices=((task.start, beyond), (task.start, task.goal)))
    )
    assert len(chosen) == 1
    np.testing.assert_array_equal(chosen[0].goal, task.goal)


def test_starts_are_dealt_in_two_rounds():
    tasks = ["a", "b", "c"]
    assert first_round(tasks, range(7)) == [("a", 0), ("b", 1), ("c", 2)]
    costs = {1: 10.0, 2: 10.2, 0: 20.0}
    assert second_round(tasks, range(7), costs) == [("c", 3), ("b", 4), ("c", 5), ("b", 6)]
    for one, numbers, begun in ("a", range(3), "aaa"), ("a", range(2, 5), "aaa"), ("abc", range(2), "ab"):
        assert first_round([*one], numbers) == [*zip(begun, numbers, strict=True)]
        assert second_round([*one], numbers, {}) == []
    assert second_round(tasks, range(5), {}) == [("a", 3), ("b", 4)]  # where all have failed


def test_the_plan_is_of_the_pair_that_was_chosen(task):
    plan = plan_motion(task, starts=1, jobs=1)
    assert plan.verified
    np.testing.assert_array_equal(plan.task.goal, task.choices[2][1])
    np.testing.assert_allclose(plan.motion.goal, plan.task.goal, atol=1e-9)
    assert plan.options["choices"]["pairs"] == 3


@pytest.mark.slow
def test_the_ur5_has_many_pairs_and_the_cheapest_is_not_the_shortest():
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    assert len(task.choices) == 24
    np.testing.assert_array_equal(task.choices[0][1], task.goal)
    chosen = likely_choices(task)
    assert plainest_cost(chosen[0]) < 0.9 * plainest_cost(dataclasses.replace(task, choices=()))


@pytest.mark.slow
def test_pairs_of_a_continuum_are_apart(tmp_path):
    """A gripper that may turn: without that every twelfth of a turn would be looked at."""
    text = (EXAMPLES / "tasks" / "ur5_cart.toml").read_text(encoding="utf-8")
    text = text.replace("rpy_deg = [180, 0, -90]", 'rpy_deg = [180, 0, -90], symmetric_about = "z"')
    lines = [line for line in text.splitlines() if not line.startswith("optimised")]
    (tmp_path / "ur5.urdf").write_bytes((EXAMPLES / "tasks" / "ur5.urdf").read_bytes())
    (tmp_path / "task.toml").write_text("\n".join(lines), encoding="utf-8")
    chosen = likely_choices(load_task(tmp_path / "task.toml"))
    ends = [np.append(one.start, one.goal) for one in chosen]
    assert len(ends) > 1
    for k, one in enumerate(ends):
        for other in ends[:k]:
            assert np.abs(one - other).max() >= APART


def test_choices_of_another_shape_are_refused(task):
    with pytest.raises(InputError, match="choices: goal"):
        dataclasses.replace(task, choices=((task.start, np.zeros(3)),))
