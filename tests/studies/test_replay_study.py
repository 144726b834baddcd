"""The study of replays: worlds within a tolerance, named worst ones, what is kept, and its table."""

import numpy as np
import pytest

from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.objects.replays import UNCERTAINTY, arrangements, text_of
from studies.replay.run import CHUNK, FEET, markdown
from studies.replay.tasks import on_feet, tasks
from studies.replay.worlds import random_world, worst_worlds
from tests.places import EXAMPLES

START = np.array([1.2187, -2.374, -1.1654, 1.9687, -1.5708, 2.7895])  # the gripper points down


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_worlds_of_objects_are_corners_and_their_worst_ones():
    robot = load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot.carrying(arrangements()["stack of two"])
    world = random_world(robot, UNCERTAINTY, np.random.default_rng(0), corner=True)
    assert len(world.masses) == 1 + robot.arm.links + 2
    assert set(np.round(np.abs(np.array(world.masses[-2:]) - 1), 3)) == {0.05}
    np.testing.assert_allclose(np.abs(world.shifts), 3e-3)
    rest = [(RampCommand(angle, 1.0, 1.0),) for angle in START[1:]]
    motion = Trajectory.from_profiles(START, [(RampCommand(0.3, 1.0, 1.0),), *rest])
    worst, _, _ = worst_worlds(robot, motion, UNCERTAINTY, 1, 5, 2)["tips"]
    assert {abs(round(share - 1, 3)) for share in worst.masses[-2:]} == {0.05}
    assert np.all(np.abs(worst.shifts) <= 3e-3 + 1e-12)
    assert np.any(worst.shifts)


def test_table_of_objects():
    kept = {"lift_m": 1e-5, "slide_m": 1e-4}
    beyond = {"object": "tall", "1.1": {"stays": True}, "1.2": {"stays": False}}
    row = {"plan": "", "objects": "tall box", "duration_s": 1.0, "beyond": [beyond, beyond]}
    rows = [{**row, "worlds_seen": [kept, {**kept, "slide_m": 6e-4}]}]
    text = text_of([*rows, {"plan": "two", "objects": "two glasses", "refused": "why"}], [])
    assert "| tall box | 1 | 1.00 to 1.00 | 2 | 0.0100 | 0.6000 | 1 | 2 | 0 | 2 |" in text
    assert "Of 2 worlds of 1 plans 1 have" in text
    assert "two: no plan (why)" in text


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
