"""A robot from the path of a URDF, its text, or a Pinocchio model: the same as that of a task file."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES
from tests.quick import some

URDF = EXAMPLES / "tasks" / "ur5.urdf"
FEET = [[0.25, 0.2, 0.0], [0.25, -0.2, 0.0], [-0.25, -0.2, 0.0], [-0.25, 0.2, 0.0]]
CART = {"base_mass": 35.0, "base_com": [0, 0, 0.3], "mount_position": [0, 0, 0.75]}


OF_MODEL = {"base_link": "base_link", "tool_frame": "tool0"}
SOURCES = {
    "path": (URDF, {}),
    "name": (str(URDF), {}),
    "text": (URDF.read_text(encoding="utf-8"), {}),
    "model": (pin.buildModelFromUrdf(str(URDF)), OF_MODEL),
}


@pytest.mark.parametrize("kind", some(1, SOURCES))
def test_it_loads_its_base_as_the_robot_of_the_task_file(kind):
    source, names = SOURCES[kind]
    expected = load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot
    robot = Robot.from_urdf(source, contacts=FEET, friction=0.6, **CART, **names)
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 5, 6))
    for own, other in zip(robot.loads(q, qd, qdd), expected.loads(q, qd, qdd), strict=True):
        np.testing.assert_allclose(own, other, atol=1e-9)
    assert robot.tip_over.reference_moment == pytest.approx(expected.tip_over.reference_moment)


def test_contacts_payload_and_motors_may_be_objects():
    contacts = [UnilateralContact(position=p, friction=0.6, facets=12) for p in FEET]
    held = Payload(2.0, (0.0, 0.0, 0.1))
    bare = Robot.from_urdf(URDF, contacts=contacts, **CART)
    robot = Robot.from_urdf(URDF, contacts=contacts, payload=held, motors=bare.motors, **CART)
    assert robot.support.contacts == tuple(contacts)
    assert robot.motors is bare.motors
    assert robot.mass == pytest.approx(bare.mass + 2.0)
    light = Robot.from_urdf(URDF, contacts=contacts, payload=2.0, **CART)
    assert light.payload is not None
    assert light.payload.is_point
    assert light.payload.mass == 2.0


def test_its_repr_shows_joints_with_units_masses_contacts_and_payload():
    text = repr(Robot.from_urdf(URDF, contacts=FEET, friction=0.6, payload=2.0, **CART))
    for part in ("ur5", "elbow_joint (rad)", "base 35 kg", "arm 16.99 kg", "payload 2 kg", "4 unilateral"):
        assert part in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"friction": None}, "friction: missing"),
        ({"contacts": [[0, 0]]}, "contacts: expected shape n x 3"),
        ({"contacts": [UnilateralContact(position=FEET[0], friction=1.0)]}, "friction: for positions only"),
        ({"base_mass": 0.0}, "mass: must be > 0"),
        ({"source": Path("nowhere.urdf")}, "nowhere.urdf: no such file"),
        ({"source": "<robot name='r'><link name='a'/></robot>"}, "base_link: no joint moves behind 'a'"),
        ({"source": "<robot name='r'>"}, "^robot.urdf: broken XML"),
        ({"source": 7}, "source: expected the path of a URDF, its text, or a pinocchio.Model, got int"),
        ({"source": pin.buildSampleModelManipulator()}, "tool_frame: missing; a Pinocchio model needs it"),
        ({"tool_frame": "tol0"}, "tool_frame: no 'tol0'"),
    ],
)
def test_what_cannot_be_used_is_named(changes, message):
    given = {"source": URDF, "contacts": FEET, "friction": 0.6, **CART, **changes}
    with pytest.raises(InputError, match=message):
        Robot.from_urdf(given.pop("source"), **given)


def with_base(mass, x):
    """The URDF with a mass in its base link, its centre at x, m."""
    text = URDF.read_text(encoding="utf-8")
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    body = f'<inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>{inertia}</inertial>'
    heavy = text.replace('<link name="base_link">', f'<link name="base_link">{body}')
    return heavy.replace('<link name="base_link"/>', f'<link name="base_link">{body}</link>')


def test_a_base_lighter_than_the_urdf_says_is_refused():
    with pytest.raises(InputError, match=r"base_mass: 35 kg is less than the 5\d kg"):
        Robot.from_urdf(with_base(50, 0), contacts=FEET, friction=0.6, **CART)


def test_mass_and_centre_of_the_base_are_those_of_the_links_that_rest():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mounted = {"mount_position": [0, 0, 0.75], "mount_rotation": turn}
    robot = Robot.from_urdf(with_base(50, 0.1), contacts=FEET, friction=0.6, **mounted)
    assert robot.support.mass == pytest.approx(robot.arm.base_mass)
    share = 50 / robot.support.mass
    assert robot.support.center_of_mass == pytest.approx(
        [0, 0.1 * share, 0.75], abs=0.02 * (1 - share) + 1e-9
    )
    with pytest.raises(InputError, match="base_mass: missing; the links of the arm's file that rest have no"):
        Robot.from_urdf(URDF, contacts=FEET, friction=0.6)
    with pytest.raises(InputError, match="base_com: missing"):
        Robot.from_urdf(URDF, contacts=FEET, friction=0.6, base_mass=35.0)
