"""Cell files: at a place they are the file of a cycle in base axes; what they cannot be is refused."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.toml import toml_text
from ocptip.motion.check import NO_FLOOR, scope_of
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.result import evaluate_placement
from ocptip.robots.kinematics import gripper_batch
from ocptip.robots.process import ProcessWrench
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.cell import load_cell
from ocptip.task_files.placement import load_placement
from tests.placement.placement_scenes import placed_robot
from tests.places import EXAMPLES
from tests.quick import some

FILE = EXAMPLES / "tasks/cell_ur5.toml"
TEXT = FILE.read_text(encoding="utf-8")
PLACE = np.array([0.3, 0.2, 2.5])


@pytest.fixture
def changed(tmp_path):
    """Reads the example with some text replaced."""
    (tmp_path / "ur5.urdf").write_bytes((FILE.parent / "ur5.urdf").read_bytes())

    def read(old: str, new: str):
        assert old in TEXT
        (tmp_path / "cell.toml").write_text(TEXT.replace(old, new), encoding="utf-8")
        return load_cell(tmp_path / "cell.toml", WORKSHOP)

    return read


def at(cell, parameters):
    angles = np.tile([0.1, -1.5, 1.2, -1.0, -1.5, 0.3], (len(cell.problem.tasks), 1))
    return evaluate_placement(Evaluator(cell.problem), 0, parameters, angles)


@pytest.mark.parametrize("slope", some(1, ["incline_deg = 6\nuphill_deg = 40\n", ""]))
def test_placed_cycle_is_the_robot_at_its_place(changed, slope):
    cell = changed('name = "workshop"\n', f'name = "workshop"\n{slope}')
    placement = at(cell, PLACE)
    expected = placed_robot(placement)
    own = cell.placed(placement).segments[-1].task.robot
    np.testing.assert_allclose(own.support.gravity, expected.support.gravity, atol=1e-12)
    assert own.tip_over.reference_moment == pytest.approx(expected.tip_over.reference_moment, rel=1e-12)
    q = np.random.default_rng(3).uniform(-2, 2, (20, 6))
    np.testing.assert_allclose(own.collision.gaps(q), expected.collision.gaps(q), atol=1e-9)


DECK = re.search(r"\[\[base_obstacle\]\](.*\n)+?\n", TEXT)[0]


@pytest.mark.slow
@pytest.mark.parametrize(("key", "level"), some(1, [("", 0.0), ("floor = false\n", None)]))
def test_the_floor_of_a_place_is_that_of_the_cycle_there(changed, key, level):
    """Without the deck of the example it is what the contacts stand on, wherever the base stands."""
    bare = TEXT.replace(DECK, "").replace("[base]", f"[base]\n{key}", 1)
    cell = changed(TEXT, bare)
    placement = at(cell, PLACE)
    robots = [cell.problem.robot, placed_robot(placement)]
    robots += [segment.task.robot for segment in cell.placed(placement).segments]
    expected = [] if level is None else [{"name": "floor", "normal": [0.0, 0.0, 1.0], "level_m": level}]
    for robot in robots:
        assert robot.collision.to_dict()["floor"] == expected
    assert scope_of(cell.problem.collision) == ("" if expected else NO_FLOOR)


def test_poses_are_those_of_the_world(changed):
    cell = changed("mass = 2.0", "mass = 2.5")
    placement = at(cell, PLACE)
    task = cell.placed(placement)
    for world, (_, postures, _) in zip(cell.problem.tasks, task.ends[:-1], strict=True):
        values = gripper_batch(task.robot.arm)(postures)
        points = placement.base_position + values[0] @ placement.base_rotation.T
        np.testing.assert_allclose(points, np.tile(world.position, (len(points), 1)), atol=1e-8)
    assert task.limits.tolerance.to_table() == WORKSHOP.to_table()
    assert task.source is not None
    assert tomllib.loads(toml_text(task.source.data))["segment"][0]["name"] == "carry"


def test_what_is_held_weighs_at_rest(changed):
    cell = changed("mass = 2.0", "mass = 2.5")
    start, goal = cell.problem.tasks
    for task in (start, goal):  # the part is held as it leaves the one, and as it arrives at the other
        [load] = task.loads
        np.testing.assert_allclose(load.force, [0, 0, -2.5 * 9.81], atol=1e-12)
        np.testing.assert_allclose(load.moment, 0, atol=1e-9)  # its centre is below the gripper
    assert cell.problem.unloaded
    assert 0 < len(cell.problem.tolerance.given) < len(WORKSHOP.given)


@pytest.mark.slow
@pytest.mark.parametrize(
    "process",
    some(
        2,
        [
            'force = [7, -3, 2], moment = [0.2, 0.1, -0.3], axes = "world"',
            "force = [7, -3, 2], moment = [0.2, 0.1, -0.3]",
            'file = "force.csv"',
        ],
    ),
)
def test_processes_act_at_rest_where_the_base_is_placed(changed, tmp_path, process):
    """Weight of the part and process, as a load of the pose, are what the planned robot feels there."""
    (tmp_path / "force.csv").write_text("share,fx_N,my_Nm\n0,4,0.3\n1,9,0.1\n")
    cell = changed('payload = "part"', f'payload = "part"\nprocess = {{ {process} }}')
    placement = at(cell, PLACE)
    task, turn = cell.placed(placement), placement.base_rotation
    pressed = task.segments[0].task.robot
    bare = pressed.arm.with_payload(None).with_process(None)
    for share, pose in ((0, cell.problem.tasks[0]), (1, cell.problem.tasks[1])):
        [load] = pose.loads
        assert load.name == "payload and process 1"
        q = task.ends[share][1]
        here = bare.with_process(ProcessWrench(turn.T @ load.force, turn.T @ load.moment, "base"))
        still = np.zeros_like(q)
        found, expected = (
            robot.loads(q, still, still) for robot in (pressed.resting(share), pressed.varied(arm=here))
        )
        np.testing.assert_allclose(found[0], expected[0], atol=1e-10)
        np.testing.assert_allclose(found[1], expected[1], atol=1e-10)
    assert cell.problem.unloaded  # the way back


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[[terrain]]", "[[keep_off]]", "cell.toml: terrain: a cell needs the ground"),
        ("[[segment]]", "[[segments]]", "cell.toml: segment: a cell needs the motions"),
        ("base_clearance", "base_clearanc", "cell.toml: limits.base_clearanc: unknown key"),
        ("position = [0.92, 0.0, 1.10]", "position = [0.92, 0.0]", "segment[1].goal_pose.position"),
        (
            "position = [0.92, 0.0, 1.10]",
            "free = { x = [-0.1, 0.1] }, position = [0.92, 0.0, 1.10]",
            "be free",
        ),
        ("[0.0, 0.0, -9.81]", "[1.0, 0.0, -9.81]", "cell.toml: gravity: of a cell points along -z"),
        ("x = [-0.6, 0.8] ", "stroke = [-0.1, 0.1] #", "cell.toml: terrain[1]: cells"),
        ('payload = "part"', 'payload = "box"', "cell.toml: segment[1].payload"),
        (
            'payload = "part"',
            'payload = "part"\nprocess = { force = [1, 0, 0], axes = "base" }',
            "cell.toml: process.axes: of a cell is in axes of the tool or the world, got 'base'",
        ),
        (
            "rpy_deg = [180, 0, -90] }",
            'rpy_deg = [180, 0, -90], symmetric_about = "z" }\nprocess = { force = [1, 0, 0] }',
            "process: turns with a gripper that turns freely at a pose",
        ),
        (
            'goal = "start" ',
            'objective = "time"\ngoal = "start" ',
            "cell.toml: segment: segments of a cell have",
        ),
    ],
)
def test_bad_input_is_named(changed, old, new, expected):
    with pytest.raises(InputError) as caught:
        changed(old, new)
    assert expected in str(caught.value)


def test_other_kinds_are_sent_to_their_command():
    with pytest.raises(InputError, match=r"is a cell \(ocptip cell\), not a placement task"):
        load_placement(FILE)
    with pytest.raises(InputError, match=r"ocptip place\), not a cell"):
        load_cell(FILE.parent / "place_ur5_wall.toml")
