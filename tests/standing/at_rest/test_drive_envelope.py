"""Largest accelerations of a base by hand, by bisection on `stand`, and by cone programs of another kind."""

import dataclasses

import numpy as np
import pytest

import ocptip
from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.bindings.wheel import DrivenWheel, FreeWheel
from ocptip.contact.force_programs import LoadRays
from ocptip.contact.support import Support
from ocptip.reserves.equal_compliance import equal_sharing
from ocptip.standing.at_rest.directions import tilted
from ocptip.standing.at_rest.drive_envelope import first_zero, largest_manoeuvres
from ocptip.standing.at_rest.manoeuvres import Manoeuvres
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from ocptip.standing.within.in_motion import worst_within
from ocptip.standing.within.moving import MovingCase, driving_case_of
from ocptip.standing.within.tolerable import AT_REST
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES
from tests.standing.at_rest.test_alike_friction import on_wheels
from tests.standing.test_base_motion import G, carried, feet

Q = np.zeros(1)
ROUGH = WORKSHOP.only(*(name for name in WORKSHOP.given if name in AT_REST))


def around(count):
    angles = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])


@pytest.fixture(scope="module")
def task():
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml")


def test_a_block_tips_or_slips_where_it_does_by_hand():
    long, wide, high, friction = 0.8, 0.6, 0.5, 0.7
    places = [[x, y, 0.0] for x in (-long / 2, long / 2) for y in (-wide / 2, wide / 2)]
    support = Support(feet(places, friction), mass=40.0, center_of_mass=[0, 0, high])
    robot = carried(support)
    found = largest_manoeuvres(robot, Q, Manoeuvres.accelerations(around(8), support.gravity))
    across = np.abs(around(8)[:, :2])
    with np.errstate(divide="ignore"):
        tip = np.min(G * np.array([long, wide]) / (2 * high) / across, axis=1)
    np.testing.assert_allclose(found.tip, tip, rtol=1e-9)
    np.testing.assert_allclose(found.slip, np.minimum(friction * G, tip), rtol=1e-8)
    assert found.contacts[4].tolist() == [3, 4]  # an acceleration backwards: it brakes


def test_a_tricycle_turns_as_fast_as_by_hand():
    long, wide, behind, high, speed = 1.2, 0.7, 0.4, 0.6, 1.5
    support = Support(
        feet([[long, 0, 0], [0, wide / 2, 0], [0, -wide / 2, 0]]), mass=30.0, center_of_mass=[behind, 0, high]
    )
    turn = np.zeros((1, 9))
    turn[0, [1, 5]] = speed, 1.0
    found = largest_manoeuvres(carried(support), Q, Manoeuvres.along(turn, support.gravity))
    rate = np.roots([high * behind * wide / 2, high * speed * long, -G * (long - behind) * wide / 2]).max()
    assert found.tip[0] == pytest.approx(rate, rel=1e-9)
    assert found.slip[0] == found.tip[0]


def test_casters_carry_no_tangential_force():
    friction, wheels = 0.5, [[0, 0.25, 0], [0, -0.25, 0]]
    casters = [UnilateralContact(position=[0.4, y, 0], friction=0.0) for y in (-0.2, 0.2)]
    support = Support([*feet(wheels, friction), *casters], mass=39.0, center_of_mass=[0.2, 0, 0.3])
    found = largest_manoeuvres(
        carried(support), Q, Manoeuvres.accelerations(np.array([[1.0, 0, 0]]), support.gravity)
    )
    # Wheels bear m (g (l - x) + a h) / l, and friction of that is m a.
    by_hand = friction * G * 0.2 / (0.4 - friction * 0.3)
    assert found.slip[0] == pytest.approx(by_hand, rel=1e-8)


@pytest.mark.parametrize(("stiffness", "share"), [((None, None), 1 / 6), ((2e5, 1e5), 1 / 4)])
def test_wheels_amid_casters_brake_with_their_share_of_the_weight(stiffness, share):
    """Wheels in the middle of four casters: pitch leaves their load as it is. Shared ideally, it is more."""
    friction, (wheel, caster) = 0.6, ({} if k is None else {"stiffness": k} for k in stiffness)
    wheels = [UnilateralContact(position=[0, y, 0], friction=friction, **wheel) for y in (-0.22, 0.22)]
    places = [[x, y, 0] for x in (-0.3, 0.3) for y in (-0.2, 0.2)]
    casters = [UnilateralContact(position=place, friction=0.0, **caster) for place in places]
    support = Support([*wheels, *casters], mass=59.0, center_of_mass=[0, 0, 0.2])
    paths = Manoeuvres.accelerations(np.array([[-1.0, 0, 0], [0.4, 1, 0]]), support.gravity)
    found = largest_manoeuvres(carried(support), Q, paths)
    assert found.alike[0] == found.largest[0] == pytest.approx(2 * share * friction * G, rel=1e-7)
    assert found.slip[0] > 1.4 * found.alike[0]
    assert np.all(largest_manoeuvres(carried(support), Q, paths, ROUGH).alike < found.alike)


def test_driven_wheels_amid_casters_share_the_weight_likewise():
    friction, places = 0.6, [[0, y, 0] for y in (-0.22, 0.22)]
    around_them = [[x, y, 0] for x in (-0.3, 0.32) for y in (-0.2, 0.2)]
    casters = [UnilateralContact(position=place, friction=0.0) for place in around_them]
    strong = [DrivenWheel(position=p, friction=friction, torque=1e4, radius=0.1) for p in places]
    found = []
    for wheels in (strong, feet(places, friction)):
        support = Support([*wheels, *casters], mass=59.0, center_of_mass=[0.02, 0, 0.2])
        paths = Manoeuvres.accelerations(around(5), support.gravity)
        found.append(largest_manoeuvres(carried(support), Q, paths))
    np.testing.assert_allclose(found[0].alike, found[1].alike, rtol=1e-7)
    np.testing.assert_allclose(found[0].lift, found[1].lift, rtol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 2.0, 4.0])
def test_friction_of_equally_compliant_wheels_ends_where_their_forces_say_so(angle):
    wheels = feet([[0, -0.22, 0], [0.05, 0.22, 0]], 0.6)
    places = [[x, y, 0] for x in (-0.3, 0.32) for y in (-0.2, 0.25)]
    casters = [UnilateralContact(position=place, friction=0.0) for place in places]
    support = Support([*wheels, *casters], mass=59.0, center_of_mass=[0.02, 0.01, 0.2])
    robot = carried(support)
    side = np.array([np.cos(angle), np.sin(angle), 0])
    (alike,) = largest_manoeuvres(robot, Q, Manoeuvres.accelerations(side[None], support.gravity)).alike
    for share, holds in ((1 - 1e-6, True), (1 + 1e-6, False)):
        motion = ocptip.BaseMotion(share * alike * side)
        standing = ocptip.stand(robot, Q, uncertainty="none", base_motion=motion)
        assert bool(standing.equal.stands[0]) == holds


@pytest.mark.slow
def test_limits_are_those_at_which_stand_changes(task):
    kinds = np.array([[-1.0, 0, 0], [0.4, 1, 0]])
    robot, q = task.robot, task.start
    paths = Manoeuvres.accelerations(kinds, robot.support.gravity)
    nominal = largest_manoeuvres(robot, q, paths)
    found = largest_manoeuvres(robot, q, paths, ROUGH, 0, nominal)
    cases = driving_case_of(robot, ROUGH)
    for kind, largest, worst in zip(kinds, nominal.largest, found.largest, strict=True):
        for share, holds in ((1 - 1e-4, True), (1 + 1e-4, False)):
            motion = ocptip.BaseMotion(share * largest * kind)
            assert ocptip.stand(robot, q, uncertainty="none", base_motion=motion).stable == holds
            case = MovingCase(cases, q, ocptip.BaseMotion(share * worst * kind), ROUGH)
            assert (max(case.tip()[0], case.slip()[0]) < 1) == holds


def test_friction_within_the_uncertainty_does_not_depend_on_where_the_search_begins(task):
    paths = Manoeuvres.accelerations(around(12), task.robot.support.gravity)
    nominal = largest_manoeuvres(task.robot, task.start, paths)
    from_nominal = largest_manoeuvres(task.robot, task.start, paths, WORKSHOP, 0, nominal)
    anew = largest_manoeuvres(task.robot, task.start, paths, WORKSHOP)
    np.testing.assert_allclose(from_nominal.slip, anew.slip, rtol=1e-6)
    assert np.all(anew.largest < nominal.largest)


@pytest.mark.slow
def test_limits_within_pushes_and_on_free_wheels_are_those_of_the_worst_case(task):
    robot, q = task.robot, task.start
    front, rear = robot.support.contacts[:2], robot.support.contacts[2:]
    rolling = [FreeWheel(position=contact.position, friction=contact.friction) for contact in rear]
    wheeled = robot.varied(support=robot.support.varied([*front, *rolling]))
    pushed = dataclasses.replace(ROUGH, push=20.0, base_push=20.0, center_of_mass=(0.01, 0.02, 0.03))
    kinds = np.array([[0.4, 1, 0], [1, 0.3, 0]])
    for model, tolerance in ((robot, pushed), (wheeled, ROUGH)):
        paths = Manoeuvres.accelerations(kinds, robot.support.gravity)
        found = largest_manoeuvres(model, q, paths, tolerance)
        cases = driving_case_of(model, tolerance)
        assert np.any(found.slip < found.tip)
        for kind, largest in zip(kinds, np.minimum(found.tip, found.slip), strict=True):
            for share, holds in ((1 - 1e-4, True), (1 + 1e-4, False)):
                case = MovingCase(cases, q, ocptip.BaseMotion(share * largest * kind), tolerance)
                assert (max(case.tip()[0], case.slip()[0]) < 1) == holds


@pytest.mark.slow
def test_the_first_of_four_wheels_lifts_where_equal_springs_say_so(task):
    robot, q = task.robot, task.start
    paths = Manoeuvres.accelerations(np.array([[-1.0, 0, 0], [0, -1, 0]]), robot.support.gravity)
    found = largest_manoeuvres(robot, q, paths)
    assert np.all(found.lift < found.tip)
    worst = largest_manoeuvres(robot, q, paths, WORKSHOP)
    assert np.all(worst.lift < found.lift)
    for kind, lift in zip(paths.linear[:, :3], found.lift, strict=True):
        for share, lifts in ((0.999, False), (1.001, True)):
            motion = ocptip.BaseMotion(share * lift * kind)
            standing = ocptip.stand(robot, q, uncertainty="none", base_motion=motion)
            assert bool(standing.equal.lifts[0].any()) == lifts
    # By hand, a block whose centre of mass is off the middle: N = m g / 4 (1 - x / l - y / w) of a wheel.
    long, wide = 0.4, 0.3
    places = [[x, y, 0] for x in (-long, long) for y in (-wide, wide)]
    block = carried(Support(feet(places), mass=40.0, center_of_mass=[0.1, 0.05, 0.5]))
    found = largest_manoeuvres(block, Q, Manoeuvres.accelerations(np.array([[-1.0, 0, 0]]), [0, 0, -G]))
    assert found.lift[0] == pytest.approx(G / 0.5 * (long * (1 - 0.05 / wide) - 0.1), rel=1e-9)


def test_a_slope_is_another_gravity(task):
    down = G * np.array([[np.sin(0.1), 0, -np.cos(0.1)]])
    paths = Manoeuvres.accelerations(np.array([[-1.0, 0, 0]]), down)
    found = largest_manoeuvres(task.robot, task.start, paths, WORKSHOP)
    support = task.robot.support.varied(gravity=down[0])
    reference = task.robot.tip_over.reference_moment
    tilted = task.robot.varied(support=support, reference_moment=reference)
    own = largest_manoeuvres(
        tilted, task.start, Manoeuvres.accelerations(np.array([[-1.0, 0, 0]]), down[0]), WORKSHOP
    )
    assert found.tip[0] == pytest.approx(own.tip[0], rel=1e-9)
    assert found.slip[0] == pytest.approx(own.slip[0], rel=1e-7)


def test_a_load_ray_ends_at_the_friction_and_its_normal_supports_the_set():
    support = Support(feet([[x, y, 0] for x in (-0.3, 0.3) for y in (-0.2, 0.2)], 0.3), mass=50.0)
    rays, weight = LoadRays(support), support.weight
    share, normal = rays.farthest(weight, weight + np.r_[1000.0, 0, 0, 0, 0, 0])
    assert share * 1000 == pytest.approx(0.3 * 50 * G, rel=1e-8)
    cones = [np.r_[1.0, 0.3 * np.cos(t), 0.3 * np.sin(t)] for t in np.linspace(0, 2 * np.pi, 25)]
    for k in range(4):
        held = -support.wrench_matrix[:, 3 * k : 3 * k + 3] @ np.array(cones).T
        assert np.all(normal @ held <= 1e-9)
    assert normal @ (weight + np.r_[share * 1000, 0, 0, 0, 0, 0]) == pytest.approx(0.0, abs=1e-6)
    assert rays.farthest(weight, 2 * weight)[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("coefficients", "zero"),
    [
        ((2, -1, 0), 2.0),
        ((2, 1, 0), np.inf),
        ((-1, 5, 0), 0.0),
        ((2, 1, -1), 2.0),
        ((6, -5, 1), 2.0),
        ((1, 0, 1), np.inf),
    ],
)
def test_first_zeros_of_parabolas(coefficients, zero):
    assert first_zero(np.array([coefficients], dtype=float))[0] == pytest.approx(zero)


def test_contacts_without_a_convex_set_of_forces_are_refused():
    clamps = [
        RigidClamp(position=[x, y, 0], friction_upper=0.5, friction_lower=0.5)
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    robot = carried(Support(clamps, mass=10.0))
    with pytest.raises(ocptip.InputError, match="has no convex set of forces"):
        largest_manoeuvres(robot, Q, Manoeuvres.accelerations(around(4), [0, 0, -G]))


def on_four_pairs(stiffness=None):
    """Of the pairs one has friction; the centre of mass is 2 m high."""
    pairs = [(0.0, 0.6), (0.3, 0.0), (0.15, 0.0), (-0.3, 0.0)]
    contacts = [
        UnilateralContact(position=[x, y, 0], friction=mu, stiffness=stiffness)
        for x, mu in pairs
        for y in (-0.3, 0.3)
    ]
    return carried(Support(contacts, mass=59.0, center_of_mass=[0, 0, 2.0]))


@pytest.mark.parametrize("stiffness", [None, 1e5])
@pytest.mark.parametrize("less", [0.0, 0.1])
def test_friction_ends_after_a_caster_lifts_where_the_springs_that_still_press_leave_too_little(
    stiffness, less
):
    """Three pairs of four press, at x = 0 (wheels), 0.15 and 0.3 m: a line through their forces by hand."""
    height, friction, robot = 2.0, 0.6 * (1 - less), on_four_pairs(stiffness)
    braking = Manoeuvres.accelerations(np.array([[-1.0, 0.0, 0.0]]), robot.support.gravity)
    found = largest_manoeuvres(robot, Q, braking, Uncertainty(friction=less))
    # Of the weight the wheels bear 1/3 - (h a - 0.15) 0.15 / 0.045, with a in units of gravity.
    by_hand = G * friction * (1 / 3 + 0.5) / (1 + friction * height / 0.3)
    assert found.lift[0] < by_hand < found.slip[0]
    np.testing.assert_allclose(found.alike, by_hand, rtol=1e-3)
    np.testing.assert_allclose(found.largest, found.alike)


def test_friction_of_wheels_amid_lifted_casters_ends_where_solved_forces_slip():
    """In directions near that of travel, by forces of springs that only push at single loads."""
    support = on_wheels(1.5)
    robot = carried(support)
    angles = np.radians([10.0, 15.0, 165.0, 195.0, 340.0])
    sides = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(5)])
    found = largest_manoeuvres(robot, Q, Manoeuvres.accelerations(sides, support.gravity))
    ends = (found.alike < found.slip) & (found.lift < found.alike)
    assert np.count_nonzero(ends) >= 3
    for share, holds in ((0.995, True), (1.005, False)):
        accelerations = share * found.alike[ends, None] * sides[ends]
        loads = np.hstack([60.0 * (support.gravity - accelerations), np.zeros(accelerations.shape)])
        equal = equal_sharing(robot.contact_states(loads))
        assert equal is not None
        assert np.all(equal.stands == holds)


def test_the_worst_case_of_a_tilt_counts_casters_that_lift():
    """The same pairs on slopes of 0.095 in a fan of directions, by forces of springs that only push.

    Uphill along x the load acts at 0.19 m, the rear pair lifts, and the others share as above.
    """
    robot, angle = on_four_pairs(), np.arctan(0.095)
    gravity, rests = robot.support.gravity, Trajectory.from_points(np.array([0.0, 0.1]), np.zeros((2, 1)))
    found = worst_within(robot, rests, Uncertainty(tilt=angle), np.array([0.0])).alike_friction
    floors = tilted(gravity, around(72), np.full(72, angle))
    equal = equal_sharing(robot.contact_states(np.hstack([60.0 * floors, np.zeros((72, 3))])))
    assert found is not None
    assert equal is not None
    assert equal.GT[0] == pytest.approx(0.095 / (0.6 * (1 / 3 - 0.04 * 0.15 / 0.045)), rel=1e-6)
    assert found.value == pytest.approx(np.max(equal.GT), rel=1e-2)
    assert found.value > 1.4 * equal.GT[0]
