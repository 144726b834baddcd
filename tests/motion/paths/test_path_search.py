"""Paths among obstacles: clear everywhere, the same for the same seed, silent, and refused with a reason."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError, PlanningError
from ocptip.motion.paths.search import joint_bounds, search_path
from ocptip.task_files.motion import load_task
from tests.motion.paths.among_boxes import WALL, task_among, task_file

pytest.importorskip("ompl")


def test_a_path_around_a_wall_keeps_the_clearance_everywhere(tmp_path, capfd):
    task = task_among(tmp_path)
    straight = task.start + np.linspace(0, 1, 200)[:, None] * (task.goal - task.start)
    assert task.robot.collision.gaps(straight).min() < 0
    path = search_path(task, seed=1).path
    assert path.start == pytest.approx(task.start)
    assert path.goal == pytest.approx(task.goal)
    assert task.robot.collision.gaps(path.at(np.linspace(0, 1, 4000))[0]).min() >= task.limits.clearance
    assert not len(path.corners)
    assert capfd.readouterr() == ("", "")


def test_joints_without_limits_have_one_turn_around_the_ends(tmp_path):
    file = task_file(tmp_path)
    urdf = (tmp_path / "arm.urdf").read_text()
    for number in (2, 3):
        urdf = urdf.replace(f'name="j{number}" type="revolute"', f'name="j{number}" type="continuous"')
    (tmp_path / "arm.urdf").write_text(urdf)
    ends = np.array([[0.0, 1.0, -4.0], [0.5, 2.0, 4.0]])
    low, high = np.array(list(joint_bounds(load_task(file), ends))).T
    assert (low[0], high[0]) == pytest.approx((-2.9, 2.9))
    assert (low[1], high[1]) == pytest.approx((1.5 - np.pi, 1.5 + np.pi))
    assert (low[2], high[2]) == (-4.0, 4.0)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_path_and_another_one_another(tmp_path):
    task = task_among(tmp_path)
    first, again, other = (search_path(task, seed=seed).path.coefficients for seed in (0, 0, 5))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.slow
def test_it_goes_to_the_goal_that_can_be_reached(tmp_path):
    task = task_among(tmp_path)
    within = np.array([0.0, 0.0, 0.0])  # in the wall
    task = replace(task, goal=within, choices=((task.start, within), (task.start, task.goal)))
    assert search_path(task).path.goal == pytest.approx(task.choices[1][1])


@pytest.mark.parametrize("end", ["start", "goal"])
def test_an_end_in_an_obstacle_is_refused(tmp_path, end):
    task = replace(task_among(tmp_path), **{end: np.zeros(3)})
    with pytest.raises(PlanningError, match=rf"^{end}: collision: link2? ?.*overlap"):
        search_path(task)


def test_where_no_path_exists_the_message_counts_what_was_tried(tmp_path, monkeypatch):
    """A wall as long as the arm, in front and behind: neither side can be left."""
    monkeypatch.setattr("ocptip.motion.paths.search.MOST_STATES", 2000)
    walls = [WALL.replace("[0.3,", "[1.0,").replace("[0.75,", f"[{x},") for x in (0.65, -0.65)]
    with pytest.raises(PlanningError, match=r"no path among the obstacles after \d+ tested states"):
        search_path(task_among(tmp_path, *walls))


def test_without_ompl_the_message_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ompl.base", None)
    with pytest.raises(InputError, match=r"need OMPL \(pip install 'ocptip\[paths\]'\)"):
        search_path(task_among(tmp_path))
