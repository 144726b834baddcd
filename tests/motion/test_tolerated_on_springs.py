"""Robustness on declared springs: a foot that lifts on them is a lost contact, also by vibration."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.motion.summary import robustness_lines
from ocptip.motion.tolerated import tolerated
from ocptip.robots.payload import Payload
from ocptip.standing.at_rest.directions import tilted
from ocptip.standing.at_rest.load_cases import RestLoads
from ocptip.standing.at_rest.loss_search import ON_SPRINGS, LossSearch
from ocptip.standing.elastic.feet import first_lift, on_its_feet
from ocptip.standing.limits import Limits
from ocptip.trajectories.trajectory import Trajectory
from tests.standing.elastic.test_feet import plan_of, softened


@cache
def case():
    """Case A on springs, slow enough that no foot lifts."""
    robot, motion = plan_of("A")
    return softened(robot, 3e5), motion.time_scaled(1.3)


@cache
def found():
    return {one.quantity: one for one in tolerated(*case())}


def lifts(robot, motion):
    """By the simulation in which feet lift and land, or by the sharing among feet that only press."""
    wrenches = robot.loads(*motion.states(motion.both_sides(0.01)))[1]
    pressing = robot.support.elastic.share(wrenches).pressing
    return bool(on_its_feet(robot, motion).lifts) or not pressing.all()


def test_the_speed_is_the_brink_of_what_vibrates_on_the_springs():
    (robot, motion), speed = case(), found()["faster"]
    assert not speed.at_most
    assert speed.how.endswith(ON_SPRINGS)
    assert not lifts(robot, motion.time_scaled(1 / (1 + 0.0099 * speed.value)))
    assert lifts(robot, motion.time_scaled(1 / (1 + 0.0102 * speed.value)))


def test_the_payload_is_the_brink_of_what_vibrates_on_the_springs():
    (robot, motion), mass = case(), found()["extra_mass"]
    assert robot.payload is None
    for share, lifted in ((0.99, False), (1.02, True)):
        held = robot.varied(arm=robot.arm.with_payload(Payload(share * mass.value)))
        assert lifts(held, motion) == lifted
    assert mass.drives > 0


@pytest.mark.slow
def test_what_is_held_counts_beside_more_payload():
    """A body and a point mass are the two bodies that Pinocchio would join, here by hand."""
    (robot, motion), body = case(), Payload.box(0.5, (0.1, 0.1, 0.2), (0.0, 0.0, 0.1))
    holding = robot.varied(arm=robot.arm.with_payload(body))
    mass = next(one.value for one in tolerated(holding, motion) if one.quantity == "extra_mass")
    total, centre = body.mass + mass, body.center_of_mass * body.mass / (body.mass + mass)
    inertia = body.inertia + body.mass * mass / total * 0.1**2 * np.diag([1.0, 1.0, 0.0])
    for more, lifted in ((0.0, False), (0.02 * mass, True)):
        both = Payload(total + more, centre * total / (total + more), inertia)
        assert lifts(robot.varied(arm=robot.arm.with_payload(both)), motion) == lifted


@pytest.mark.slow
def test_the_tilt_is_the_brink_of_forces_on_the_springs():
    """At rest against the exact sharing with feet that only press."""
    robot, q = case()[0], plan_of("A")[1].start
    rough = [replace(contact, friction=5.0) for contact in robot.support.contacts]
    robot = robot.varied(support=robot.support.varied(rough))
    still = Trajectory.from_points(np.array([0.0, 1.0]), np.array([q, q]))
    tilt = next(one for one in tolerated(robot, still) if one.quantity == "tilt")
    side = np.array([float(x) for x in tilt.how.split("(")[1].split(")")[0].split(",")])
    loads, gravity = RestLoads(robot, q[None]), robot.support.gravity

    def presses(share):
        floor = tilted(gravity, side / np.linalg.norm(side), np.radians(share * tilt.value))
        return robot.support.elastic.share(loads.wrenches(floor)).pressing.all()

    assert tilt.how.endswith(ON_SPRINGS)
    assert presses(0.99)
    assert not presses(1.01)


def test_a_foot_is_lost_where_the_sharing_of_springs_has_it_lifted():
    robot = case()[0]
    rng, search = np.random.default_rng(3), LossSearch(robot, lifts=True)
    weight = robot.mass * np.linalg.norm(robot.support.gravity)
    wrenches = weight * (rng.normal(0, 0.08, (200, 6)) - [0, 0, 1, 0, 0, 0])
    shared = robot.support.elastic.share(wrenches)
    lifted = ~shared.pressing.all(axis=1)
    assert 20 < lifted.sum() < 180
    ways = [search.lost(wrench[None]) for wrench in wrenches]
    assert [bool(way and way[1].endswith(ON_SPRINGS)) for way in ways] == lifted.tolist()


@pytest.mark.parametrize("factor", [1.0, 1.2, 1.3])
def test_a_foot_lifts_first_where_the_simulation_of_lifts_says(factor):
    robot, motion = plan_of("A")
    robot, motion = softened(robot, 3e5), motion.time_scaled(factor)
    lift, feet = first_lift(robot, motion), on_its_feet(robot, motion)
    assert (lift is not None) == bool(feet.lifts)


@pytest.mark.slow
def test_vibration_ends_the_speed_before_the_forces_that_the_loads_need():
    """Acceleration steps overshoot where the loads change slowly enough for the springs to follow."""
    robot, motion = softened(plan_of("A")[0], 1e6), plan_of("A")[1].time_scaled(1.6)
    speed = next(one for one in tolerated(robot, motion) if one.quantity == "faster")
    faster = motion.time_scaled(1 / (1 + 0.0101 * speed.value))
    wrenches = robot.loads(*faster.states(faster.both_sides(0.01)))[1]
    assert robot.support.elastic.share(wrenches).pressing.all()
    assert on_its_feet(robot, faster).lifts


@pytest.mark.slow
def test_nothing_is_tolerated_where_a_foot_lifts_nominally():
    robot, motion = plan_of("A")
    robot = softened(robot, 3e5)
    assert lifts(robot, motion)
    rows = tolerated(robot, motion)
    values = {one.quantity: one.value for one in rows if one.quantity not in ("friction", "foot_stiffness")}
    assert set(values.values()) == {0.0}
    assert "Robust to nothing: the nominal model loses a contact (contact" in robustness_lines(rows)[0]


def test_the_line_says_that_lifts_count_and_which_vibration_does_not():
    rows, task = list(found().values()), SimpleNamespace(robot=case()[0], limits=Limits())
    text = " ".join(" ".join(robustness_lines(rows, [task])).split())
    assert "until a contact is lost, or lifts on its declared springs" in text
    assert text.endswith("torques, vibration on the declared springs except for payload and speed")
    assert max(map(len, robustness_lines(rows, [task]))) <= 80
    lifting = SimpleNamespace(robot=task.robot, limits=Limits(foot_lift=1e-3))
    text = " ".join(" ".join(robustness_lines(rows, [lifting])).split())
    assert "until a contact is lost;" in text
    assert text.endswith("torques, lifts on the declared springs")
    rigid = SimpleNamespace(robot=plan_of("A")[0], limits=Limits())
    assert "declared" not in " ".join(robustness_lines(rows, [rigid]))


@pytest.mark.slow
def test_where_feet_may_lift_those_of_rigid_feet_count():
    robot, motion = case()
    cases = (robot, motion), (plan_of("A")[0], motion)
    on_springs, rigid = ({row.quantity: row.value for row in tolerated(*one, may_lift=True)} for one in cases)
    assert on_springs["faster"] == pytest.approx(rigid["faster"], rel=0.01)
    assert on_springs["faster"] > 2 * found()["faster"].value
