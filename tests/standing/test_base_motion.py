"""A base that drives: the wrench by Pinocchio with a root that moves, and tipping by hand."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import ocptip
from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import NONE, WORKSHOP
from ocptip.standing.within.posture import posture_within
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES
from tests.robots.pinocchio_twin import twin
from tests.robots.sample_arms import random_arm

FEET = [0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]
G = 9.81


def feet(places, friction=5.0):
    return [UnilateralContact(position=place, friction=friction) for place in places]


def carried(support: Support, mass: float = 1.0) -> Robot:
    """A base with an arm of one joint whose link has its centre of mass in that of the base."""
    arm = dataclasses.replace(
        random_arm(0, 1),
        masses=np.array([mass]),
        centres=np.zeros((1, 3)),
        inertias=np.zeros((1, 3, 3)),
        mount_position=support.center_of_mass,
    )
    return Robot(arm, support, load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot.motors, floor=False)


@pytest.fixture(scope="module")
def cart() -> Robot:
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot


def on_free_flyer(robot: Robot) -> pin.Model:
    """The arm and the body of its base on a root that moves freely."""
    support, root = robot.support, pin.Model()
    root.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    body = pin.Inertia(support.mass, support.center_of_mass, support.inertia)
    root.appendBodyToJoint(1, body, pin.SE3.Identity())
    frame = root.addFrame(pin.Frame("base", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model = pin.appendModel(root, twin(robot.arm), frame, pin.SE3.Identity())
    model.armature = np.concatenate([np.zeros(6), robot.arm.armature])
    model.gravity.linear = support.gravity
    return model


@pytest.mark.parametrize("seed", [0, 1])
def test_wrench_and_torques_are_those_of_a_root_that_moves(seed):
    rng, count, n = np.random.default_rng(seed), 40, 4
    half = rng.normal(size=(3, 3))
    support = Support(
        feet(FEET),
        mass=20.0,
        center_of_mass=rng.normal(size=3),
        inertia=half @ half.T + np.eye(3),
        gravity=rng.normal(size=3),
    )
    arm = dataclasses.replace(random_arm(seed, n), inertias=np.array([np.eye(3) * 0.3] * n))
    robot = Robot(arm, support, carried(support).motors, reference_moment=1.0, floor=False)
    states, motion = rng.normal(size=(3, count, n)), rng.normal(size=(3, count, 3))
    torques, wrenches = robot.loads(*states, base_motion=BaseMotion(*motion))
    model = on_free_flyer(robot)
    data = model.createData()
    for k in range(count):
        (q, qd, qdd), (a, w, al), v = states[:, k], motion[:, k], rng.normal(size=3)
        spatial = a - np.cross(w, v)  # Pinocchio's acceleration is not that of the origin
        needed = pin.rnea(model, data, np.r_[np.zeros(6), 1.0, q], np.r_[v, w, qd], np.r_[spatial, al, qdd])
        force, moment = -needed[:3], -needed[3:6] + np.cross(support.center_of_mass, needed[:3])
        np.testing.assert_allclose(wrenches[k], [*force, *moment], atol=1e-10 * np.abs(wrenches).max())
        np.testing.assert_allclose(torques[k], needed[6:], atol=1e-10 * np.abs(torques).max())


def test_without_motion_nothing_changes(cart):
    rng = np.random.default_rng(0)
    states = rng.normal(size=(3, 5, 6))
    moving = cart.loads(*states, base_motion=BaseMotion())
    for resting, still in zip(cart.loads(*states), moving, strict=True):
        np.testing.assert_array_equal(resting, still)


def test_a_block_on_two_axles_tips_when_it_brakes_at_half_its_length_over_its_height():
    long, high, mass = 0.8, 0.5, 41.0
    places = [[x, y, 0.0] for x in (-long / 2, long / 2) for y in (-1, 1)]
    robot = carried(Support(feet(places), mass=mass - 1.0, center_of_mass=[0, 0, high]))
    limit = G * long / (2 * high)
    for share in (0.2, 0.99, 1.01):
        motion = BaseMotion([-share * limit, 0, 0])
        margins = robot.margins([0.0], base_motion=motion)
        assert margins.stable == (share < 1)
        assert margins.tipping_moment == pytest.approx(mass * G * long / 2 * (1 - share), rel=1e-9)
        assert set(margins.tipping_contacts.tolist()) == {3, 4}
    assert robot.margins([0.0], base_motion=BaseMotion([-limit, 0, 0])).tipping_moment == pytest.approx(
        0.0, abs=1e-9 * mass * G * long
    )


def test_a_tricycle_in_a_turn_tips_about_the_line_from_front_to_rear_wheel():
    long, wide, behind, high, speed = 1.2, 0.7, 0.4, 0.6, 1.5
    places = [long, 0, 0], [0, wide / 2, 0], [0, -wide / 2, 0]
    robot = carried(Support(feet(places), mass=30.0, center_of_mass=[behind, 0, high]))
    # The rear axle is the origin: it turns at w with speed v, and the centre of mass is ahead of it.
    # Its acceleration is (-w^2 x, v w); about the line g (l - x) b / 2 = h (v w l + w^2 x b / 2) tips it.
    rate = np.roots([high * behind * wide / 2, high * speed * long, -G * (long - behind) * wide / 2]).max()
    for share, stands in ((1 - 1e-7, True), (1 + 1e-7, False)):
        w = share * rate
        motion = BaseMotion([0, speed * w, 0], [0, 0, w])
        margins = robot.margins([0.0], base_motion=motion)
        assert margins.stable == stands
        assert (margins.tipping_moment > 0) == stands
        assert margins.tipping_moment == pytest.approx(0.0, abs=1e-4)
    assert margins.tipping_contacts.tolist() == [1, 3]


def test_a_base_that_starts_to_turn_needs_its_moment_of_inertia_from_friction():
    support = Support(feet(FEET, 0.4), mass=40.0, inertia=[2.0, 2.0, 3.0])
    robot = carried(support)
    wrench = robot.loads(*np.zeros((3, 1, 1)), base_motion=BaseMotion(angular_acceleration=[0, 0, 2.0]))[1]
    np.testing.assert_allclose(wrench[0], [0, 0, -41 * G, 0, 0, -6.0], atol=1e-12)


@pytest.mark.slow
def test_the_worst_of_a_moving_base_is_that_at_rest_where_it_does_not_move(cart):
    q = load_task(EXAMPLES / "tasks" / "ur5_cart.toml").start
    tolerance = dataclasses.replace(WORKSHOP, base_push=5.0, center_of_mass=[0.01, 0.02, 0.0])
    resting, still = posture_within(cart, q, tolerance), posture_within(cart, q, tolerance, BaseMotion())
    assert pytest.approx(resting.GN, rel=1e-9) == still.GN
    assert pytest.approx(resting.GT, rel=2e-3) == still.GT


def test_braking_within_the_uncertainty_leaves_less_and_names_what_is_off(cart):
    q = load_task(EXAMPLES / "tasks" / "ur5_cart.toml").start
    found = [
        ocptip.stand(cart, q, uncertainty=tolerance, base_motion=BaseMotion([-2.0, 0, 0], [0, 0, 0.5]))
        for tolerance in (NONE, WORKSHOP)
    ]
    assert found[0].within is None
    assert found[0].tip.GN[0] < found[1].within.GN
    assert "tilt 0.5 deg towards +x" in found[1].within.GN_worst
    margins = cart.margins(q, base_motion=BaseMotion([-2.0, 0, 0], [0, 0, 0.5]))
    assert pytest.approx(found[0].tip.GN[0], rel=1e-9) == margins.GN


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (lambda: BaseMotion([1.0, 2.0]), "base_motion.acceleration: expected shape 3"),
        (lambda: BaseMotion([[0, 0, 0]] * 2, [[0, 0, 0]] * 3), "base_motion: numbers of instants differ"),
        (lambda: BaseMotion(angular_velocity=[0, 0, np.nan]), "base_motion.angular_velocity: contains NaN"),
    ],
)
def test_mistakes_are_named(motion, message):
    with pytest.raises(InputError, match=message):
        motion()


def test_bases_that_cannot_drive_are_refused(cart):
    two = BaseMotion([[0, 0, 0]] * 2)
    with pytest.raises(InputError, match="expected 1 instants"):
        cart.margins(np.zeros(6), base_motion=two)
    delta = load_task(EXAMPLES / "tasks" / "delta_cart.toml")
    with pytest.raises(InputError, match="base_motion: of arms only"):
        delta.robot.margins(delta.start, base_motion=BaseMotion([1.0, 0, 0]))
    scene = ocptip.read_scene(EXAMPLES / "scenes" / "pushed_cart.toml")
    with pytest.raises(InputError, match="base_motion: belongs to a robot"):
        ocptip.stand(scene, base_motion=BaseMotion())
