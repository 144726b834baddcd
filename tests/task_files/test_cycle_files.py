"""Files with [[segment]]: what they mean, and what is refused in one line."""

import dataclasses

import numpy as np
import pytest

import ocptip
from ocptip.basics.errors import InputError, InputWarning
from ocptip.motion.objective import ENERGY, TIME, priced
from ocptip.motion.task import MotionTask
from ocptip.robots.payload import Payload
from ocptip.task_files.cycle import load_cycle, read_task
from ocptip.task_files.motion import load_task
from tests.motion.cycles.cycle_files import CYCLE, written
from tests.motion.test_task import MODULAR, TWO_JOINTS, URDF
from tests.places import EXAMPLES


def changed(text, *pairs):
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


@pytest.fixture(scope="module")
def cycle(tmp_path_factory):
    return load_cycle(written(tmp_path_factory.mktemp("cycle")))


def test_segments_follow_each_other_with_their_loads(cycle):
    out, back = cycle.segments
    assert (cycle.name, out.name, back.name) == ("swing", "out", "back")
    assert (out.dwell, back.dwell, cycle.closed) == (0.3, 0.0, True)
    assert out.task.robot.payload is None
    assert back.task.robot.payload.mass == 1.0
    assert back.task.robot.mass == pytest.approx(out.task.robot.mass + 1.0)
    np.testing.assert_allclose(back.task.start, out.task.goal)
    np.testing.assert_allclose(back.task.goal, cycle.starts[0])
    assert out.task.optimised == back.task.optimised == (0, 1)
    assert out.task.robot.support is back.task.robot.support


def test_a_robot_that_holds_the_same_is_the_same(tmp_path):
    text = CYCLE.replace('goal = "start"', "goal_deg = [0, 30, -8, 45, -18, 150]")
    text += '[[segment]]\npayload = "none"\ngoal = "start"\n'
    with pytest.warns(InputWarning, match=r"segment\[2\]: the load of the gripper changes"):
        task = load_cycle(written(tmp_path, text))
    out, back, home = (segment.task.robot for segment in task.segments)
    assert out is not back
    assert home.payload is None
    assert task.segments[2].name == "3"


def test_shared_values_and_own_ones(tmp_path):
    text = changed(
        CYCLE,
        ("commands = 2", 'commands = 2\nobjective = "both"\nprice_per_second = 20'),
        ('name = "out"', 'name = "out"\nduration = 2.5\nlimits = { GN = 0.5 }'),
        ('name = "back"', 'name = "back"\nobjective = "time"\noptimised = [1]\nmax_duration = 3'),
    )
    out, back = (segment.task for segment in load_cycle(written(tmp_path, text)).segments)
    assert (out.objective, back.objective) == (priced(20), TIME)
    assert (out.limits.GN, back.limits.GN) == (0.5, 0.9)
    assert (out.limits.min_duration, out.limits.max_duration) == (2.5, 2.5)
    assert (back.limits.min_duration, back.limits.max_duration) == (0, 3)
    assert (out.optimised, back.optimised) == ((0, 1), (0,))


def test_what_is_held_without_a_word_and_in_place(tmp_path):
    text = changed(CYCLE, ("[payload.part]", "[payload]"), ('payload = "part"', "payload = { mass = 2.0 }"))
    out, back = (segment.task.robot for segment in load_cycle(written(tmp_path, text)).segments)
    assert (out.payload.mass, back.payload.mass) == (1.0, 2.0)


def test_the_gripper_changes_its_state(tmp_path):
    (tmp_path / "two.urdf").write_text(
        TWO_JOINTS.replace(
            '<link name="finger"/>',
            '<link name="finger"><inertial><mass value="0.5"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" '
            'iyz="0" izz="1e-4"/></inertial></link>',
        )
    )
    head = URDF[: URDF.index("[motion]")]
    text = (
        head
        + "[motion]\nstart_deg = [10, 80]\noptimised = [1, 2]\n"
        + '[[segment]]\nname = "a"\ngoal_deg = [40, 50]\nlocked_m = { grip = 0.08 }\ndwell = 1\n'
        + '[[segment]]\nname = "b"\ngoal = "start"\n'
    )
    one, other = (segment.task.robot.arm for segment in load_cycle(written(tmp_path, text)).segments)
    assert (one.resting["grip"], other.resting["grip"]) == (0.08, 0.02)
    moved = one.masses[-1] * (one.centres[-1] - other.centres[-1])
    assert np.linalg.norm(moved) == pytest.approx(0.5 * 0.06)


def test_a_file_with_one_motion_is_one_motion(tmp_path):
    path = written(tmp_path, MODULAR)
    assert isinstance(read_task(path), MotionTask)
    with pytest.raises(InputError, match=r"swing.toml: segment: several motions are a cycle"):
        load_task(written(tmp_path))


def test_changes_of_all_segments(cycle):
    tight = ocptip.load_task(cycle, GN=0.4, objective="time")
    assert {s.task.limits.GN for s in tight.segments} == {0.4}
    assert {s.task.objective for s in tight.segments} == {TIME}
    assert {s.task.objective for s in cycle.segments} == {ENERGY}
    assert ocptip.load_task(cycle) is cycle
    assert dataclasses.replace(cycle.robot.arm, payload=Payload(1.0)) is not cycle.robot.arm


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'payload = "part"',
            'payload = "prt"',
            r"segment\[2\].payload: expected one of 'none', a table, 'part'",
        ),
        ('payload = "part"', "", r"payload.part: no segment carries it"),
        ('payload = "part"', "payload = { mass = -1 }", r"segment\[2\].payload.mass: must be >= 0"),
        ('goal = "start"', 'goal = "home"', r"segment\[2\].goal: no state 'home'"),
        ('goal = "start"', "", r"segment\[2\].goal_deg: expected either goal_deg or goal_pose, got none"),
        (
            'goal = "start"',
            'goal = "start"\ngoal_deg = [1]',
            r"segment\[2\].goal_deg: not together with goal",
        ),
        ("dwell = 0.3", "dwell = -1", r"segment\[1\].dwell: must be >= 0"),
        ("dwell = 0.3", "dwel = 1", r"segment\[1\].dwel: unknown key; did you mean 'dwell'"),
        ("dwell = 0.3", "optimised = [9]", r"segment\[1\].optimised: no joint 9"),
        ("optimised = [1, 2]", "optimised = [9]", r"motion.optimised: no joint 9"),
        ("commands = 2", "duration = 2", r"motion.duration: of a cycle belongs to its \[\[segment\]\]s"),
        ("commands = 2", "goal_deg = [1]", r"motion.goal_deg: of a cycle belongs to its"),
        ("commands = 2", "comands = 2", r"motion.comands: unknown key"),
        ("dwell = 0.3", "locked_deg = { a = 10 }", r"segment\[1\].locked_deg: only joints of a URDF"),
        ("dwell = 0.3", "limits = { GM = 1 }", r"segment\[1\].limits.GM: unknown key; known: GN"),
    ],
)
def test_what_is_refused(tmp_path, old, new, message):
    with pytest.raises(InputError, match=rf"^swing.toml: {message}") as error:
        read_task(written(tmp_path, changed(CYCLE, (old, new))))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["mass", "box"])
def test_a_load_is_not_named_like_a_key(tmp_path, name):
    text = (EXAMPLES / "tasks" / "ur5_pick_and_place.toml").read_text(encoding="utf-8")
    known = text.split("[payload.")[1].split("]")[0]
    text = text.replace(f"[payload.{known}", f"[payload.{name}").replace(f'"{known}"', f'"{name}"')
    text = text.replace("ur5.urdf", str(EXAMPLES / "tasks" / "ur5.urdf").replace("\\", "/"))
    file = tmp_path / "task.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"payload\.{name}: '{name}' is a key of \[payload\]"):
        ocptip.load_task(file)
