"""The study of replays: worlds within a tolerance, named worst ones, what is kept, and its table."""

import numpy as np
import pytest

from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import WORKSHOP
from studies.replay.run import CHUNK, FEET, markdown
from studies.replay.tasks import on_feet, tasks
from studies.replay.worlds import random_world, worst_worlds


@pytest.mark.parametrize("corner", [True, False])
def test_worlds_are_within_the_tolerance(corner):
    robot, rng = experiment_task("A").robot, np.random.default_rng(0)
    worlds = [random_world(robot, WORKSHOP, rng, corner) for _ in range(50)]
    for world in worlds:
        assert 0 <= world.tilt <= WORKSHOP.tilt
        assert 0.8 - 1e-12 <= world.friction <= 1
        assert 0 <= world.payload <= 0.1
        assert np.all(np.abs(np.array(world.masses) - 1) <= 0.05 + 1e-12)
        assert len(world.masses) == 1 + robot.arm.links
        assert all(0 <= late <= 0.010 for late in world.late)
        assert abs(world.speed - 1) <= 0.03 + 1e-12
    if corner:
        assert {round(world.speed, 2) for world in worlds} == {0.97, 1.03}
        assert {late for world in worlds for late in world.late} == {0.0, 0.010}


def test_worst_worlds_are_the_tolerance_and_beyond():
    task = experiment_task("A")
    robot, motion = task.robot, task.reference
    inside = worst_worlds(robot, motion, WORKSHOP)
    beyond = worst_worlds(robot, motion, WORKSHOP.scaled(1.1))
    assert beyond["tips"][2] < inside["tips"][2]
    assert beyond["slips"][2] > inside["slips"][2]
    world = beyond["tips"][0]
    assert world.tilt == pytest.approx(1.1 * WORKSHOP.tilt)
    assert world.friction == pytest.approx(1 - 1.1 * 0.2)
    assert max(world.late) in (0.0, pytest.approx(0.011))


def test_tasks_have_their_feet():
    assert len(tasks()) == 24
    robot = on_feet("A", 15.0, 0.25, 4).robot
    assert robot.support.n_contacts == 4
    assert robot.support.mass == 15.0


def test_table():
    def row(feet, highest):
        lifts = [0.0] * (CHUNK - 1) + [highest]
        return {
            "task": "A",
            "feet": feet,
            "chunk": 0,
            "lifts_m": lifts,
            "slides_m": [1e-4] * CHUNK,
            "falls": 0,
        }

    rows = [row(feet, highest) for feet, highest in zip(FEET, (0.0, 1e-4), strict=True)]
    one = {"least_N": 0.0, "lift_m": 0.0, "slide_m": 0.0}
    other = {**one, "least_N": 5.0}
    within = {"GN": 0.99, "GT": 0.4}
    worst = {"value": -0.1, "lost": True, "world": "", "stiff": other, "1e6": one}
    slips = {**worst, "lost": False}
    rows.append({"task": "A", "feet": "beyond", "chunk": -1, "tips": worst, "slips": slips, **within})
    rows.append({"task": "A", "feet": "samples", "chunk": -1, "lost": 0, "count": 300})
    text = markdown(rows, {"B": "why not"}, [])
    stiff, soft = "20 | 0.0000 | 0.100 | 0", "20 | 0.1000 | 0.100 | 1"
    assert f"| A | {stiff} | {soft} | 0 | 0.990 | 0.400 | -0.10 | -0.10 | yes | no | yes |" in text
    assert "On stiff feet 1 of 1 plans" in text
    assert "On feet of 1e6 N/m 0 of 1 plans" in text
    assert "Of 300 random instants within the tolerances of 1 plans 0 lose a contact." in text
    assert "feet of 1e6 N/m loses a contact in 1 of 1 plans that bind" in text
    assert "stiff feet loses a contact in 0 of 1 plans that bind" in text
    assert "B: no plan (why not)" in text
