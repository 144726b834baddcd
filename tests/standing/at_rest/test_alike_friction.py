"""Wheels amid casters: equally compliant ones slip long before the best sharing of the load does."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.api.chart import halton_postures
from ocptip.api.inputs.postures import RestingPosture
from ocptip.api.stand import stand
from ocptip.api.tasks import load_task
from ocptip.cli.verify.stand import StandReport
from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.tolerated import tolerated
from ocptip.published.tasks import experiment_task
from ocptip.reserves.equal_compliance import equal_sharing, equally_compliant
from ocptip.robots.process import ProcessWrench
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.alike_friction import AlikeFriction
from ocptip.standing.at_rest.directions import around, pushes, tilted
from ocptip.standing.at_rest.largest_level import largest_levels_kept
from ocptip.standing.at_rest.load_cases import RestLoads
from ocptip.standing.at_rest.loss_search import LossSearch
from ocptip.standing.at_rest.raised import RaisedPush, RaisedTilt
from ocptip.standing.at_rest.slope import largest_slope, tilted_wrench
from ocptip.standing.footing import Footing
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.standing.within.in_motion import worst_within
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES
from tests.standing.test_base_motion import carried

FRICTION = 0.6


def on_wheels(height: float, shift: float = 0.0) -> Support:
    """Two wheels in the middle of four casters."""
    wheels = [UnilateralContact(position=[shift, y, 0], friction=FRICTION) for y in (-0.22, 0.22)]
    places = [[x, y, 0] for x in (-0.3, 0.3) for y in (-0.2, 0.2)]
    casters = [UnilateralContact(position=place, friction=0.0) for place in places]
    return Support([*wheels, *casters], mass=59.0, center_of_mass=[0, 0, height])


def test_a_slope_leaves_the_wheels_a_third_of_the_weight():
    support = on_wheels(1e-4)
    found = largest_slope(Footing(support), support.gravity, tilted_wrench(support, ()))
    assert found is not None
    assert found.angle == pytest.approx(np.arctan(FRICTION / 3), abs=2e-4)
    assert (found.loss, found.alike) == ("slides", True)


def test_the_floor_may_tilt_as_much_under_a_motion():
    robot = carried(on_wheels(1e-4))
    rests = Trajectory.from_points(np.array([0.0, 0.1]), np.zeros((2, 1)))
    found = {one.quantity: one for one in tolerated(robot, rests)}
    assert found["tilt"].value == pytest.approx(np.degrees(np.arctan(FRICTION / 3)), rel=3e-3)
    assert found["tilt"].how.endswith("slips if equally compliant")


def test_the_worst_case_of_a_tilt_and_less_friction_is_that_by_hand():
    robot, tilt = carried(on_wheels(1e-4)), np.radians(2.0)
    rests = Trajectory.from_points(np.array([0.0, 0.1]), np.zeros((2, 1)))
    found = worst_within(robot, rests, Uncertainty(tilt=tilt, friction=0.2), np.array([0.0]))
    assert found.alike_friction is not None
    assert found.alike_friction.value == pytest.approx(3 * np.tan(tilt) / (0.8 * FRICTION), rel=2e-3)
    assert found.slip.value < 0.6 * found.alike_friction.value


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_what_is_not_solved_is_held(shift):
    """Each of some wrenches alone: the functions that leave states out agree with their forces."""
    support, rng = on_wheels(0.3, shift), np.random.default_rng(0)
    footing = Footing(support)
    every, weight = AlikeFriction(footing), 59.0 * 9.81
    wrenches = np.tile(support.weight, (300, 1))
    wrenches += weight * rng.normal(size=(300, 6)) * [0.1, 0.1, 0.05, 0.04, 0.04, 0.02]
    equal = equal_sharing(footing.contact_states(wrenches))
    assert equal is not None
    assert 60 < np.count_nonzero(equal.stands) < 240
    for wrench, stands in zip(wrenches, equal.stands, strict=True):
        assert (every.slips(wrench[None]) is None) == stands


def test_the_largest_push_on_a_posture_is_what_the_wheels_bear():
    """Nearly so much in some sampled direction, and no more in any, of the search's first ones."""
    support = on_wheels(1e-4)
    posture = RestingPosture.of("cart", "given", carried(support), np.zeros(1), Limits())
    found = posture.largest_push
    assert found is not None
    search, loads = (
        LossSearch(posture.robot, AlikeFriction(posture.robot)),
        RestLoads(posture.robot, posture.q[None]),
    )
    for share, holds in ((0.99, True), (1.01, False)):
        pushed = [
            loads.wrenches(support.gravity) + loads.at_tool(share * found.level * side)
            for side in pushes(support.gravity).sides
        ]
        assert (search.lost(np.vstack(pushed)) is None) == holds
    assert found.how.endswith("slips if equally compliant")


def test_the_largest_horizontal_push_is_horizontal_and_no_smaller():
    support = on_wheels(1e-4)
    posture = RestingPosture.of("cart", "given", carried(support), np.zeros(1), Limits())
    level, any_push = posture.largest_horizontal_push, posture.largest_push
    assert level is not None
    assert any_push is not None
    assert level.level >= any_push.level * (1 - 2e-3)
    loads = RestLoads(posture.robot, posture.q[None])
    search = LossSearch(posture.robot, AlikeFriction(posture.robot))
    for share, holds in ((0.99, True), (1.01, False)):
        pushed = [
            loads.wrenches(support.gravity) + loads.at_tool(share * level.level * side)
            for side in around(support.gravity, 180)
        ]
        assert (search.lost(np.vstack(pushed)) is None) == holds


def test_the_first_contact_to_lift_pulls_beyond_its_push_and_no_other_push_lifts_one():
    """Normal forces by least squares of the balance about the ground."""
    support = on_wheels(0.3, 0.1)
    posture = RestingPosture.of("cart", "given", carried(support), np.zeros(1), Limits())
    lift = posture.first_lift
    assert lift is not None
    places = np.array([contact.position for contact in support.contacts]) - support.center_of_mass
    balance = np.linalg.pinv(np.array([np.ones(6), places[:, 1], -places[:, 0]]))
    loads = RestLoads(posture.robot, posture.q[None])

    def pressing(push: np.ndarray) -> np.ndarray:
        w = (loads.wrenches(support.gravity) + loads.at_tool(push))[0]
        height = support.center_of_mass[2]
        return balance @ -np.array([w[2], w[3] - height * w[1], w[4] + height * w[0]])

    worst = lift.force * np.array(lift.towards)
    assert lift.towards[2] == pytest.approx(0.0, abs=1e-12)
    assert pressing(0.999 * worst).min() > 0
    assert np.flatnonzero(pressing(1.001 * worst) < 0) + 1 == lift.contact
    for side in around(support.gravity, 180):
        assert pressing(0.999 * lift.force * side).min() > 0


def test_a_rigid_clamp_is_not_named_as_the_first_to_lift():
    """It never lets go, though its force may be negative; the two feet beside it do."""
    task = experiment_task("A")
    old, *feet = (replace(contact, stiffness=1e6) for contact in task.robot.support.contacts)  # pyright: ignore
    jaws = {"friction_upper": 0.5, "friction_lower": 0.5}
    clamp = RigidClamp(position=old.position, normal=old.normal, stiffness=1e6, **jaws)
    robot = task.robot.varied(support=task.robot.support.varied([clamp, *feet]))
    lift = RestingPosture.of("A", "given", robot, task.start, Limits()).first_lift
    assert lift is None or lift.contact != 1


def test_equally_compliant_wheels_bear_a_third_of_the_process_that_the_best_sharing_does():
    """A horizontal force along the ground: casters take no load at best, two thirds of it if compliant."""
    robot = carried(on_wheels(1e-4))
    weight, tool = 60 * 9.81, RestLoads(robot, np.zeros((1, 1))).tool[0]
    force = np.array([2 * FRICTION * weight, 0.0, 0.0])
    process = ProcessWrench(force, -np.cross(tool, force), "base")
    robot = robot.varied(arm=robot.arm.with_process(process))
    posture = RestingPosture.of("cart", "given", robot, np.zeros(1), Limits())
    found = posture.possible_process(NONE)
    assert found is not None
    assert found.best_sharing == pytest.approx(1 / 2, abs=6e-3)
    assert found.equally_compliant == pytest.approx(1 / 6, abs=6e-3)
    text = " ".join(StandReport(stand(posture, uncertainty="none")).to_text().split())
    assert "16 % of it keep all contacts with equally compliant feet, " in text


def test_pushes_are_reported_with_the_contact_that_lifts_first():
    posture = RestingPosture.of("cart", "given", carried(on_wheels(0.3, 0.1)), np.zeros(1), Limits())
    text = " ".join(StandReport(stand(posture, uncertainty="none")).to_text().split())
    lift = posture.first_lift
    assert "horizontal: " in text
    assert f"contact {lift.contact} lifts first, at {lift.force:.4g} N towards" in text


@pytest.mark.parametrize("kind", [RaisedTilt, RaisedPush])
@pytest.mark.parametrize("stiffness", [None, 1e5])
@pytest.mark.parametrize("within", [NONE, Uncertainty(friction=0.2, tilt=np.radians(1.0))])
def test_charts_leave_the_wheels_a_third_of_the_weight(kind, stiffness, within):
    """Amid casters; feet of equal friction with declared springs use all. At most 5 % is left out."""
    support = on_wheels(1e-4)
    springs = equally_compliant(support)
    if stiffness:
        springs = support.varied(
            [replace(c, friction=FRICTION / 3, stiffness=stiffness) for c in support.contacts]  # pyright: ignore
        )
    assert springs is not None
    raised = kind(carried(springs), *([0.0] if kind is RaisedPush else []))
    limits = Limits(tolerance=within)
    found = largest_levels_kept(raised, limits, np.zeros((1, 1)), raised.most)
    share = min(limits.GT, limits.GT_worst_case * (1 - within.friction)) * FRICTION / 3
    by_hand = np.arctan(share) - within.tilt
    if kind is RaisedPush:
        by_hand = 60 * 9.81 * np.sin(by_hand) / np.cos(np.arctan(share))
    assert 0.94 * by_hand < found.levels[0] <= by_hand * (1 + 1e-6)
    assert found.names[found.limits[0]] == "friction"


@pytest.mark.parametrize("mass", [100.0, pytest.param(15.0, marks=pytest.mark.slow)])
def test_charts_of_tilts_count_wheels_that_lift(mass):
    """Of a light cart some do: no tilted floor of a fine fan slips at the level, one does a little above."""
    cart = Robot.of(load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot)
    support = cart.support.varied(on_wheels(0.3).contacts, mass=mass)
    robot = cart.varied(support=support, reference_moment=None)
    raised = RaisedTilt(robot.varied(support=equally_compliant(support)))
    q = halton_postures(robot, Limits(), 4, 0)
    found = largest_levels_kept(raised, Limits(), q, raised.most)
    sides = around(support.gravity, 72)
    for posture, level in zip(q, found.levels, strict=True):
        loads = RestLoads(robot, posture[None])
        most = []
        for share in (1.0, 1.06):
            floors = tilted(support.gravity, sides, np.full(72, share * level))
            equal = equal_sharing(robot.contact_states(np.vstack([loads.wrenches(g) for g in floors])))
            assert equal is not None
            most.append(np.max(np.nan_to_num(equal.GT, nan=np.inf)))
        assert most[0] < 0.9 < most[1]
