"""Descriptions: exact right angles, inertias, checks at the door, files."""

import dataclasses
import math
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.parallel.description.branched import BranchedLeg, LegEnd
from ocptip.parallel.description.platform import (
    BodyInertia,
    Parameter,
    Platform,
    elementary_rotation,
    exact_cos_sin,
    right_angles,
    value_of,
)
from ocptip.parallel.description.ready_made import READY_MADE, make_robot, rrr3
from ocptip.parallel.description.robot_description import DYNPAR2, FIXED, PRISMATIC, MDHRow, SerialLeg
from ocptip.parallel.robot import ParallelRobot
from ocptip.task_files.parallel import read_parallel_robot
from tests.parallel.parallel_cases import random_body
from tests.parallel.parallel_twin import relative, rod_delta
from tests.quick import examples


def test_right_angles_are_exact_numbers_but_parameters_are_not():
    assert exact_cos_sin(math.pi / 2) == (0.0, 1.0)
    assert exact_cos_sin(-math.pi) == (-1.0, 0.0)
    assert exact_cos_sin(7 * math.pi / 2) == (0.0, -1.0)
    assert right_angles(Parameter("gamma", math.pi / 2)) is None
    assert right_angles(0.3) is None
    assert exact_cos_sin(0.3) == (math.cos(0.3), math.sin(0.3))
    assert value_of(Parameter("l", 2)) == 2.0
    assert np.array_equal(elementary_rotation("x", math.pi / 2), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])


@given(seed=st.integers(0, 10**6))
@examples(30)
def test_inertia_forms(seed):
    rng = np.random.default_rng(seed)
    mass, center = rng.uniform(0.1, 3), rng.uniform(-1, 1, 3)
    root = rng.uniform(-1, 1, (3, 3))
    about = np.trace(root @ root.T) * np.eye(3) - root @ root.T
    body = BodyInertia.about_center(mass, center, about)
    # Points on a cube around the centre as an independent sum: parallel axes.
    shift = mass * (center @ center * np.eye(3) - np.outer(center, center))
    np.testing.assert_allclose(body.inertia, about + shift, atol=1e-12)
    np.testing.assert_allclose(body.first_moment, mass * center)
    six = [about[0, 0], about[0, 1], about[0, 2], about[1, 1], about[1, 2], about[2, 2]]
    np.testing.assert_allclose(BodyInertia.about_center(mass, center, six).vector, body.vector, atol=1e-12)
    np.testing.assert_allclose(BodyInertia.from_vector(body.vector).vector, body.vector)
    assert len(DYNPAR2) == 10
    assert body.vector[DYNPAR2.index("M")] == mass
    assert body.vector[DYNPAR2.index("XZ")] == body.inertia[0, 2]


def test_bodies_of_idealised_models_are_accepted():
    point, rod = (
        BodyInertia.about_center(2.0, (3, 4, 5)),
        BodyInertia.about_center(1.0, inertia=(0, 0.3, 0.3)),
    )
    disc = BodyInertia.about_center(1.0, (0.1, 0, 0), (0.1, 0.1, 0.2000001))  # rounded in a file
    planar = BodyInertia.about_center(1.0, (0.5, 0.2, 0), (0, 0, 0.3))
    grouped = BodyInertia.about_center(1.0, (0.5, 0.2, 0), (0, 0.1, 0.3), grouped=True)
    np.testing.assert_allclose(rod.central, np.diag([0, 0.3, 0.3]))
    np.testing.assert_allclose(planar.central, np.diag([0, 0, 0.3]), atol=1e-15)
    for body in (point, rod, disc, planar, grouped):
        np.testing.assert_array_equal(BodyInertia.from_vector(body.vector).vector, body.vector)


def test_named_parameters_are_shared():
    robot = rrr3(links=(0.5, 0.7))
    assert robot.parameters["l1"] == 0.5
    assert list(robot.parameters)[:2] == ["l1", "l2"]
    assert len(robot.inertia_vector) == 10 * (3 * 2 + 1)
    other = dataclasses.replace(robot.legs[1], rows=(MDHRow(), MDHRow(d=Parameter("l1", 0.6)), MDHRow(d=0.7)))
    with pytest.raises(InputError, match=r"parameter l1: has the values 0\.5 and 0\.6"):
        dataclasses.replace(robot, legs=(robot.legs[0], other, robot.legs[2]))


def test_forms_that_need_complete_legs():
    assert all(make().coupling_form for make in READY_MADE.values())
    assert not rod_delta().coupling_form
    robot = rrr3()
    assert not dataclasses.replace(robot, actuated=((0, 0), (1, 0), (2, 2))).coupling_form


LEG = rrr3().legs[0]
BODY = BodyInertia()
BAD = [
    (lambda: Parameter("two words", 1.0), "identifier"),
    (lambda: Parameter("l", float("nan")), "parameter l: must be finite"),
    (lambda: MDHRow(sigma=3), "sigma: must be 0"),
    (lambda: MDHRow(alpha="pi"), "alpha: expected a number"),
    (lambda: MDHRow(d=float("inf")), "d: must be finite"),
    (lambda: BodyInertia(1.0, [0, 0, 0], np.diag([1, 1, 2.1])), "inertia: no body has .*1, 1, 2.1 kg m"),
    (lambda: BodyInertia(1.0, [1, 0, 0], np.diag([0, 0.9, 0.9])), "none may be negative"),
    (lambda: BodyInertia(0.0, [1, 0, 0]), "first_moment: must be zero without mass"),
    (lambda: BodyInertia.about_center(1.0, (1, 2, 3), (1.0, 0.2, 0.2)), "inertia: no body has"),
    (lambda: BodyInertia(-1.0), "mass: must be >= 0"),
    (lambda: BodyInertia(1.0, [0, 0], np.eye(3)), "first_moment: expected shape 3"),
    (lambda: BodyInertia(1.0, [0, 0, 0], [[1, 2, 0], [0, 1, 0], [0, 0, 1]]), "inertia: must be symmetric"),
    (lambda: BodyInertia.about_center(-1.0), "mass: must be >= 0"),
    (
        lambda: SerialLeg((MDHRow(), MDHRow()), 2, (BODY, BODY)),
        "n: joints up to the coupling point, must be 1..1",
    ),
    (lambda: SerialLeg((MDHRow(), MDHRow()), 1, ()), "bodies: expected 1 to 2"),
    (lambda: SerialLeg((MDHRow(), "row"), 1, (BODY,)), r"rows\[2\]: expected an MDHRow"),
    (lambda: SerialLeg((MDHRow(), MDHRow(PRISMATIC)), 1, (BODY,)), "must turn about it"),
    (lambda: SerialLeg((MDHRow(), MDHRow(), MDHRow(d=0.1)), 1, (BODY,)), r"rows\[3\]: the joints behind"),
    (lambda: SerialLeg((MDHRow(FIXED), MDHRow()), 1, (BODY,)), r"rows\[1\].sigma: only the row"),
    (lambda: dataclasses.replace(LEG, base_rotation=(("w", 1.0),)), "the axis must be x, y or z"),
    (lambda: dataclasses.replace(LEG, coupling=(0, 1)), "coupling: expected 3 entries"),
    (lambda: dataclasses.replace(LEG, end_rotation=2 * np.eye(3)), "not a rotation matrix"),
    (lambda: dataclasses.replace(LEG, viscous=(-1.0,)), r"viscous\[1\]: must be >= 0"),
    (lambda: dataclasses.replace(LEG, viscous=(1.0,) * 4), "viscous: expected at most 3"),
    (lambda: dataclasses.replace(LEG, branch=(2,)), "branch: expected signs"),
    (lambda: dataclasses.replace(LEG, guess=(1.0,)), "guess: expected 2 or 3 numbers"),
    (lambda: Platform((1, 1, 0)), "mask: expected six"),
    (lambda: Platform((0,) * 6), "at least one platform coordinate"),
    (lambda: Platform((1,) * 6, "xxy"), "convention: must be one of"),
    (lambda: dataclasses.replace(rrr3(), actuated=((3, 0),)), "there is no leg 4"),
    (lambda: dataclasses.replace(rrr3(), actuated=((0, 3),)), "leg 1 has 3 joints, got 4"),
    (lambda: dataclasses.replace(rrr3(), actuated=((0, 0), (0, 0))), "listed twice"),
    (lambda: dataclasses.replace(rrr3(), actuated=()), "at least one motor"),
    (lambda: dataclasses.replace(rrr3(), home=np.zeros(4)), "home: expected shape 3"),
    (lambda: dataclasses.replace(rrr3(), legs=()), "at least one leg"),
    (
        lambda: BranchedLeg((MDHRow(),), (0,), (LegEnd(0, (0, 0, 0)),), (BODY,)),
        "parents: expected one earlier",
    ),
    (lambda: BranchedLeg((MDHRow(),), (-1,), (LegEnd(1, (0, 0, 0)),), (BODY,)), "there is no row 2"),
    (lambda: BranchedLeg((MDHRow(),), (-1,), (), (BODY,)), "at least one end"),
]


@pytest.mark.parametrize(("make", "message"), BAD)
def test_bad_descriptions_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "5RRR"}, "kind: must be one of"),
        ({"lengths": [0.5]}, "lengths: expected shape 2"),
        ({"base_positions": np.ones((3, 3))}, "must lie in the plane"),
        ({"base_angles": [0, 1]}, "base_angles: expected shape 3"),
    ],
)
def test_bad_robots_of_a_kind(changes, message):
    arguments = {
        "kind": "3RRR",
        "lengths": [0.5, 0.5],
        "base_angles": [0, 2, 4],
        "base_positions": np.zeros((3, 3)),
        "coupling_points": np.zeros((3, 3)),
        "bodies": (BODY, BODY),
        "platform": BODY,
        "home": np.zeros(3),
    }
    with pytest.raises(InputError, match=message):
        make_robot(**{**arguments, **changes})


FILE = """
name = "planar three"
gravity = [0.0, -9.81, 0.0]
free = ["x", "y", "phi3"]
home = [0.0, 0.0, 0.0]

[parameters]
l1 = 0.6
l2 = 0.6
gamma3 = 8.901179185171081

[platform]
mass = 2.0
inertia = [0.045, 0.045, 0.09]

[table.RRR]
joints_to_coupling = 2
rows = [
    { joint = "revolute" },
    { joint = "revolute", d = "l1" },
    { joint = "revolute", d = "l2" },
]
bodies = [
    { mass = 1.5, center = [0.3, 0.0, 0.0], inertia = [0.0003, 0.04515, 0.04515] },
    { mass = 1.2, center = [0.3, 0.0, 0.0], inertia = [0.00024, 0.03612, 0.03612] },
]

[[leg]]
table = "RRR"
base_position = [0.0, 1.0, 0.0]
base_rotation = [["z", "3*pi/2"]]
coupling = [0.0, 0.3, 0.0]
actuated = [1]

[[leg]]
table = "RRR"
base_position = [-0.8660254037844387, -0.5, 0.0]
base_rotation = [["z", "pi/6"]]
coupling = [-0.2598076211353316, -0.15, 0.0]
actuated = [1]

[[leg]]
table = "RRR"
base_position = [0.8660254037844387, -0.5, 0.0]
base_rotation = [["z", "gamma3"]]
coupling = [0.2598076211353316, -0.15, 0.0]
actuated = [1]
"""


def test_file_describes_the_same_robot_as_the_constructor(tmp_path):
    path = tmp_path / "three.toml"
    path.write_text(FILE)
    description = read_parallel_robot(path)
    assert description.actuated == ((0, 0), (1, 0), (2, 0))
    assert description.parameters == {"l1": 0.6, "l2": 0.6, "gamma3": 8.901179185171081}
    z, zd, zdd = [0.05, 0.02, 0.1], [1.0, -0.5, 2.0], [3.0, 4.0, -5.0]
    built = ParallelRobot(rrr3()).inverse_dynamics(z, zd, zdd).motors
    assert relative(ParallelRobot(description).inverse_dynamics(z, zd, zdd).motors, built) < 1e-12


STANDARD = (
    FILE.replace('{ joint = "revolute" },', '{ joint = "revolute", a = "l1" },', 1)
    .replace('{ joint = "revolute", d = "l1" }', '{ joint = "revolute", a = "l2" }')
    .replace('{ joint = "revolute", d = "l2" }', '{ joint = "revolute", alpha = "pi/2" }')
    .replace("joints_to_coupling = 2", 'joints_to_coupling = 2\ndh = "standard"')
    .replace("center = [0.3, 0.0, 0.0]", "center = [-0.3, 0.0, 0.0]")
)


def test_standard_rows_have_bodies_in_frames_at_the_ends_of_links():
    """The left columns of table 5.1 of thesis P; named lengths stay symbols."""
    modified, standard = (read_parallel_robot(tomllib.loads(text)) for text in (FILE, STANDARD))
    for one, other in zip(modified.legs, standard.legs, strict=True):
        assert one.rows == other.rows
    z, zd, zdd = [0.05, 0.02, 0.1], [1.0, -0.5, 2.0], [3.0, 4.0, -5.0]
    forces = [ParallelRobot(each).inverse_dynamics(z, zd, zdd).motors for each in (modified, standard)]
    assert relative(*forces) < 1e-12


def test_the_last_standard_frame_turns_by_its_alpha():
    turned = [["z", "pi/2"], ["x", 0.3]]
    end = f"coupling = [0.0, 0.3, 0.0]\nend_rotation = {turned}".replace("'", '"')
    ends = [
        read_parallel_robot(tomllib.loads(text.replace("coupling = [0.0, 0.3, 0.0]", end)))
        .legs[0]
        .end_rotation
        for text in (FILE, STANDARD)
    ]
    np.testing.assert_allclose(ends[1], np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ ends[0], atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('a = "l1"', 'gamma = "l1"', r"table.RRR.rows\[1\].gamma: standard rows have theta, d, a, alpha"),
        ('alpha = "pi/2"', "a = 0.1", "table.RRR.rows: a of the last row must be 0"),
        ('dh = "standard"', 'dh = "modified"', r"table.RRR.rows\[1\].a: modified rows have gamma, b"),
        ('dh = "standard"', 'dh = "craig"', "table.RRR.dh: expected one of"),
    ],
)
def test_rows_of_the_other_convention_are_refused(old, new, message):
    with pytest.raises(InputError, match=message):
        read_parallel_robot(tomllib.loads(STANDARD.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('free = ["x", "y", "phi3"]', 'free = ["x", "up"]', "free: expected names among"),
        (
            'free = ["x", "y", "phi3"]',
            'free = ["phi3", "x", "y"]',
            r"free: expected the order \['x', 'y', 'phi3'\]",
        ),
        ('free = ["x", "y", "phi3"]', 'free = ["x", "y", "y", "phi3"]', "free: a coordinate is listed twice"),
        ("home = [0.0, 0.0, 0.0]", "", "home: missing"),
        ("home = [0.0, 0.0, 0.0]", "home = [0.0]", "home: expected shape 3"),
        ('d = "l1"', 'd = "l9"', r"table.RRR.rows\[2\].d: 'l9' is neither .*known: l1, l2"),
        ('"gamma3"', '"gama3"', r"base_rotation\[1\]: 'gama3' .* did you mean 'gamma3'"),
        ('d = "l1"', 'd = "pi/0"', "division by zero"),
        ('joint = "revolute", d = "l1"', 'joint = "ball"', r"table.RRR.rows\[2\].joint: expected one of"),
        ("joints_to_coupling = 2", "joints_to_coupling = 3", "table.RRR.joints_to_coupling: joints .* got 3"),
        ("joints_to_coupling = 2", "", "table.RRR.joints_to_coupling: missing"),
        ("mass = 2.0", 'mass = "2"', "platform.mass: expected a number"),
        (
            "[0.045, 0.045, 0.09]",
            "[0.045, 0.04, 0.09]",
            "platform.inertia: no body has these principal values",
        ),
        ("[0.00024, 0.03612,", "[0.24, 0.03612,", r"table.RRR.bodies\[2\].inertia: no body has"),
        ("mass = 2.0", "mas = 2.0", "platform.mas: unknown key; did you mean 'mass'"),
        ("l1 = 0.6", "l1 = true", "parameters.l1: expected a number"),
        ("l1 = 0.6", "pi = 3.0\nl1 = 0.6", "parameters.pi: not a usable name"),
        ('table = "RRR"', 'table = "PRR"', r"leg\[1\].table: there is no \[table.PRR\]"),
        ('["z", "pi/6"]', '"z"', r"leg\[2\].base_rotation: expected pairs"),
        (
            "actuated = [1]",
            "actuated = [0]",
            r"leg\[1\].actuated: must be a whole number >= 1 and <= 3, got 0",
        ),
        ("actuated = [1]", "actuated = 1", r"leg\[1\].actuated: expected a list"),
        ("[platform]", "[plattform]", "plattform: unknown key; did you mean 'platform'"),
        ("[0.0, 1.0, 0.0]", "[0.0, 1.0]", r"leg\[1\].base_position: expected 3 entries"),
        ('name = "planar three"', "name = 3", "name: expected a text"),
        ("gravity =", "gravity", "broken TOML"),
    ],
)
def test_bad_files_name_file_and_key(tmp_path, old, new, message):
    assert old in FILE
    path = tmp_path / "bad.toml"
    path.write_text(FILE.replace(old, new))
    with pytest.raises(InputError, match=f"bad.toml: .*{message}|bad.toml: {message}"):
        read_parallel_robot(path)


def test_unreadable_files(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_parallel_robot(tmp_path / "none.toml")
    path = tmp_path / "latin.toml"
    path.write_bytes(b"name = '\xe9'")
    with pytest.raises(InputError, match="UTF-8"):
        read_parallel_robot(path)
    with pytest.raises(InputError, match="is a folder; expected a file"):
        read_parallel_robot(tmp_path)
    with pytest.raises(InputError, match=r"leg: at least one \[\[leg\]\] is needed"):
        read_parallel_robot({"free": ["x"], "home": [0.0], "table": {"a": {}}})


def test_random_bodies_are_physical():
    body = random_body(np.random.default_rng(0))
    assert np.linalg.eigvalsh(body.inertia)[0] > 0
