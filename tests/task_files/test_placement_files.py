"""Placement files: what they mean in numbers, and what is wrong with wrong ones, by file and key."""

from __future__ import annotations

import re

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.placement.power import HoldingPower, TorqueCost
from ocptip.robots.geometry import Floor, Pillar, Wall
from ocptip.task_files.placement import load_placement
from tests.pictures.placed_example import ROBOT
from tests.places import EXAMPLES

TASKS = EXAMPLES / "tasks"

MINIMAL = (
    ROBOT
    + """
[[task]]
position = [0.5, 0.0, 0.5]
"""
)


@pytest.fixture
def load(tmp_path):
    """Reads a text as a placement file; `more` goes below it, `above` above all tables."""

    def read(more="", *, above="", text=MINIMAL):
        path = tmp_path / "stand.toml"
        path.write_text(above + text + more, encoding="utf-8")
        return load_placement(path)

    return read


def test_defaults(load):
    task = load()
    problem = task.problem
    assert task.name == "stand"
    assert problem.robot.arm.name == "FP1W2F"
    assert [(t.name, t.orientation, len(t.loads)) for t in problem.tasks] == [("task 1", "full", 0)]
    np.testing.assert_array_equal(problem.tasks[0].rotation, np.eye(3))
    np.testing.assert_allclose(problem.weights.array(), 0.25)
    assert (problem.limits.GN, problem.limits.GT, problem.unloaded) == (0.9, 0.9, True)
    assert [p.name for p in problem.terrain] == ["floor"]
    position, rotation = problem.terrain[0].poses(np.array([[1.0, 2.0, np.pi / 2]]))
    np.testing.assert_allclose(position[0], [1, 2, 0])
    np.testing.assert_allclose(rotation[0] @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    assert isinstance(problem.energy, HoldingPower)
    assert len(problem.robot.shapes) == 0


def test_everything_in_numbers(load):
    problem = load(
        """
rpy_deg = [180, 0, 90]
orientation = "axis"
tool_axis = [0, 0, 2]
name = "drill"

[[task.load]]
name = "thrust"
force = [-10, 0, 5]
moment = [1, 0, 0]

[[task.load]]
magnitude = 7.0
directions = 5
axis = [1, 0, 0]
half_angle_deg = 30

[[task]]
position = [0.5, 0.1, 0.5]
rotation = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]

[[terrain]]
incline_deg = 10
uphill_deg = 90
height = 0.2
x = [-1, 1]
angle_deg = [-90, 45]

[[terrain]]
name = "ramp"
slope = [0.1, 0.0]
y = [2, 3]
contacts_inside = true

[[base_obstacle]]
kind = "floor"
height = 0.05

[[obstacle]]
kind = "wall"
normal = [2, 0, 0]
distance = 3

[[obstacle]]
kind = "pillar"
point = [1, 1, 0]
radius = 0.2

[[keep_out]]
kind = "pillar"
point = [2, 2, 0]
radius = 0.3
name = "hole"

[weights]
GN = 1
GE = 3

[references]
GE = 50

[limits]
GN = 0.8
GT = false
torque_ratio = 0.7
condition = 30
jacobian_length = 0.4
reference_moment = 4.5

[energy]
kind = "torque"
cost = [1, 1.2, 0, 0, 0, 0]
""",
        above="unloaded = false\n",
    ).problem
    drill, second = problem.tasks
    np.testing.assert_allclose(drill.rotation @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(drill.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(drill.tool_axis, [0, 0, 1])
    np.testing.assert_array_equal(drill.loads[0].moment, [1, 0, 0])
    sampled = np.array([p.force for p in drill.loads[1:]])
    assert len(sampled) == 5
    amounts = np.linalg.norm(sampled, axis=1)
    assert (amounts >= 7).all()
    assert (amounts < 8).all()
    assert (sampled[:, 0] >= 7 * np.cos(np.deg2rad(30)) - 1e-12).all()
    assert (second.name, second.rotation[2, 2]) == ("task 2", -1)
    first, ramp = problem.terrain
    assert (first.name, ramp.name) == ("plane 1", "ramp")
    position, rotation = first.poses(np.array([[0.0, 1.0, 0.0]]))
    assert position[0, 2] == pytest.approx(0.2 + np.tan(np.deg2rad(10)))
    assert rotation[0, 2, 2] == pytest.approx(np.cos(np.deg2rad(10)))
    np.testing.assert_allclose(first.lower, [-1, -np.inf, -np.pi / 2])
    np.testing.assert_allclose(first.upper, [1, np.inf, np.pi / 4])
    assert first.contact_area is None
    np.testing.assert_array_equal(ramp.contact_area[:, 1], [2, 3])
    wall, pillar = problem.obstacles
    assert isinstance(wall, Wall)
    assert not isinstance(wall, Floor)
    np.testing.assert_array_equal(wall.normal, [1, 0, 0])
    assert isinstance(pillar, Pillar)
    assert [o.name for o in (wall, pillar)] == ["wall 1", "pillar 2"]
    assert [o.name for o in problem.keep_out] == ["hole"]
    assert problem.robot.collision.labels
    assert problem.robot.collision.labels[0].second == "floor"
    np.testing.assert_allclose(problem.weights.array(), [0.25, 0, 0, 0.75])
    assert problem.references["GE"] == 50
    assert (problem.limits.GN, problem.limits.GT, problem.limits.condition) == (0.8, None, 30)
    assert problem.robot.tip_over.reference_moment == 4.5
    assert isinstance(problem.energy, TorqueCost)
    np.testing.assert_array_equal(problem.energy.cost, [1, 1.2, 0, 0, 0, 0])
    assert problem.unloaded is False


def test_performance_index_as_a_limit(load):
    limits = load("\n[limits]\nindex = 'dm_2'\nindex_min = 0.1\n").problem.limits
    assert (limits.index, limits.index_min) == ("dm_2", 0.1)


def test_spheres_of_the_base_and_ground_point(load):
    text = MINIMAL.replace(
        "mass = 10.0",
        "mass = 10.0\nground = [0.1, 0.0, -0.05]\n"
        'shape = [{ kind = "sphere", position = [0, 0, 0.1], radius = 0.3 }]',
    )
    problem = load(text=text).problem
    (ball,) = problem.robot.shapes
    np.testing.assert_array_equal(ball.shape.position, [0, 0, 0.1])
    assert ball.shape.radius == 0.3
    np.testing.assert_array_equal(problem.ground_frame[0], [0.1, 0, -0.05])
    origin, _ = problem.base_pose(0, np.zeros((1, 3)))
    np.testing.assert_allclose(origin[0], [-0.1, 0, 0.05])


ROUGH = """
[[terrain]]
name = "hill"
height = 0.1
slope = [0.1, 0.0]
x = [-1, 1]
y = [-1, 1]
[[terrain.bump]]
at = [0.5, 0.0]
height = 0.2
radius = 0.3
[[terrain.wave]]
amplitude = 0.05
length = 0.8
direction_deg = 90
phase_deg = 90
"""
GRID = "[terrain.grid]\nx = [-2, 2]\ny = [-1, 2]\n"


def test_uneven_ground(load, tmp_path):
    rows = [[0.01 * (i + j) ** 2 for i in range(5)] for j in range(4)]
    (tmp_path / "survey.csv").write_text("\n".join(", ".join(map(str, row)) for row in rows) + "\n")
    ends = ("heights = " + str(rows), "file = 'survey.csv'")
    for text in (ROUGH + GRID + end for end in ends):
        patch = load(text).problem.terrain[0]
        assert (patch.name, patch.parameters) == ("hill", ("x", "y", "angle"))
        point = np.array([[-1.0, 1.0]])
        along = np.exp(-(1.5**2 + 1) / (2 * 0.3**2))
        expected = 0.1 - 0.1 + 0.2 * along + 0.05 * np.sin(2 * np.pi / 0.8 + np.pi / 2) + rows[2][1]
        assert patch.conforming.field.heights(point) == pytest.approx([expected])
    legs = load(ROUGH.replace("x = [-1, 1]", "stroke = [0.0, 0.2]\nattitude = 'level'")).problem.terrain[0]
    assert legs.parameters == ("x", "y", "angle", "stroke")
    assert (legs.conforming.stroke.tolist(), legs.conforming.attitude) == ([0.0, 0.2], "level")


def test_tolerance(load):
    problem = load("\n[tolerance]\nbase_mass = 0.1\nfriction = 0.2\n").problem
    assert [c.name for c in problem.corners] == [f"base mass {m} %, friction -20 %" for m in ("-10", "+10")]
    problem = load("\n[tolerance]\nbase_mass = [9, 12]\ncenter_of_mass = [0.01, 0, 0]\n").problem
    assert {corner.mass for corner in problem.corners} == {9, 12}
    assert problem.corners[0].name == "base mass -10 %, centre of mass -10 mm in x"


@pytest.mark.parametrize("name", sorted(path.name for path in TASKS.glob("place_*.toml")))
def test_examples_are_read(name):
    task = load_placement(TASKS / name)
    assert task.problem.cases
    assert len(task.name) > 5


@pytest.mark.parametrize(
    ("more", "above", "message"),
    [
        (
            "\nrpy_deg = [0, 0, 0]\nrotation = 1",
            "",
            "task[1].rpy_deg: expected either rpy_deg, quaternion, rotation_vector_deg or rotation, "
            "got rpy_deg and rotation",
        ),
        ("\n[[task.load]]\nname = 'x'", "", "task[1].load[1].force: missing"),
        ("\n[[task.load]]\nforce = [1, nan, 0]", "", "task[1].load[1].force: must be finite"),
        ("\n[[task.load]]\nmagnitude = 3\ndirections = 3", "", "task[1].load[1].directions: must be a whole"),
        (
            "\n[[task.load]]\nmagnitude = -3\ndirections = 4",
            "",
            "task[1].load[1].magnitude: must be > 0, got -3",
        ),
        ("\n[[task.load]]\nmagnitude = 3\ndirections = 0", "", "task[1].load[1].directions: must be a whole"),
        ("\n[[task]]\nname = 'a'", "", "task[2].position: missing"),
        ("\n[[task]]\nposition = [1,0,0]\nname = 'task 1'", "", "names must differ"),
        ("\n[[terrain]]\nslope = [0, 0]\nincline_deg = 3", "", "terrain[1].incline_deg: expected either"),
        ("\n[[terrain]]\nuphill_deg = 3", "", "terrain[1].uphill_deg: belongs to incline_deg"),
        ("\n[[terrain]]\nincline_deg = 90", "", "terrain[1].incline_deg: must be between 0 and 80, got 90"),
        ("\n[[terrain]]\nx = [1, 0]", "", "terrain[1].x: the first bound must not be above"),
        ("\n[[terrain]]\nattitude = 'level'", "", "only a base on legs can be level"),
        ("\n[[terrain]]\nstroke = [1, 0]", "", "terrain[1].stroke: the first must not be above the second"),
        (
            "\n[[terrain]]\n[[terrain.wave]]\namplitude = 1\nlength = 0",
            "",
            "wave[1].length: must be > 0, got 0",
        ),
        (
            "\n[[terrain]]\n" + GRID + "heights = [[1, 2]]",
            "",
            "terrain[1].grid.x: expected 4 increasing numbers",
        ),
        ("\n[[terrain]]\n" + GRID + "file = 'none.csv'", "", "none.csv: no such file"),
        (
            "\n[tolerance]\nbase_mass = [3, 4]",
            "",
            "tolerance.base_mass: 3 to 4 kg without the base's mass 10 kg",
        ),
        ("\n[tolerance]\nfriction = 1", "", "tolerance.friction: must be >= 0 and below 1, got 1"),
        ("\n[[obstacle]]\nkind = 'floor'\nheight = 0", "", "obstacle[1].kind: a floor belongs to the base"),
        (
            "\n[[keep_out]]\nkind='pillar'\npoint=[0,0,0]\nradius=0.1\n[[keep_out]]\nkind='pillar'\npoint=[0,0,0]",
            "",
            "keep_out[2].radius: missing",
        ),
        ("\n[weights]\nGN = 0", "", "weights: at least one must be > 0"),
        ("\n[references]\nGE = 0", "", "references.GE: must be > 0"),
        ("\n[limits]\nGN = true", "", "limits.GN: expected a number, got true"),
        ("\n[limits]\nGN = 1.5", "", "limits.GN: must be above 0 and at most 1"),
        ("\n[limits]\nindex = 'dm'\nindex_min = 0.1", "", "limits.index: expected one of"),
        ("\n[limits]\nindex = 'dm_2'", "", "limits: index, index_min: give both or none"),
        ("\n[energy]\nkind = 'torque'\ncost = [1, 2]", "", "energy.cost: expected 6 numbers, got 2"),
    ],
)
def test_wrong_files_are_refused_by_key(load, more, above, message):
    with pytest.raises(InputError, match=r"^stand\.toml: ") as caught:
        load(more, above=above)
    text = str(caught.value)
    assert message in text
    assert "\n" not in text
    assert text.count("stand.toml") == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[[task]]\nposition = [0.5, 0.0, 0.5]", "", "task: at least one [[task]] is needed"),
        (
            "mass = 10.0",
            "mass = 10.0\nspheres = [[0, 0, 0, 1]]",
            "base.spheres: is now a shape each: shape = ",
        ),
        (
            "mass = 10.0",
            'mass = 10.0\nshape = [{ kind = "sphere", radius = -1 }]',
            "base.shape[1].radius: must be > 0",
        ),
        ("mass = 10.0", "mass = 10.0\nground = [0, 0]", "base.ground: expected 3 numbers"),
        ("mass = 10.0", "weight = 3", "base.weight: unknown key"),
        ("[-0.2, 0.0, 0.0]", "[-0.2, 0.0, 0.1]", "base.ground: the contacts have different heights"),
        ('name = "FP1W2F"', 'name = "FP"', "arm.name: no arm 'FP'"),
    ],
)
def test_wrong_scenes_are_refused(load, old, new, message):
    with pytest.raises(InputError, match=re.escape(message)):
        load(text=MINIMAL.replace(old, new))


def test_obstacles_need_spheres_of_the_arm_keep_out_zones_do_not(tmp_path):
    text = (TASKS / "place_ur5_wall.toml").read_text(encoding="utf-8")
    text = re.sub(r"sphere_radius = .*", "", text).replace('"ur5.urdf"', f'"{TASKS / "ur5.urdf"}"')
    text = re.sub(r"\[\[base_obstacle\]\][^\[]*", "", text)
    path = tmp_path / "t.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"obstacle: the arm has no collision geometry .* \[\[keep_out\]\]"):
        load_placement(path)
    path.write_text(text.replace("[[obstacle]]", "[[keep_out]]"), encoding="utf-8")
    assert len(load_placement(path).problem.keep_out) == 3


def test_files_that_are_none(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_placement(tmp_path / "absent.toml")
    (tmp_path / "broken.toml").write_text("a = [", encoding="utf-8")
    with pytest.raises(InputError, match=r"^broken\.toml: broken TOML"):
        load_placement(tmp_path / "broken.toml")
