"""The wrench under deviations against a robot built anew; nothing in a tolerance is worse than found."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.published.tasks import experiment_task
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import SITE, Uncertainty
from ocptip.standing.within.deviations import Deviations, towards
from ocptip.standing.within.moving import driving_case_of
from ocptip.standing.within.worst_case import WorstCase
from studies.tolerance.samples import random_deviations
from tests.quick import examples

WIDE = dataclasses.replace(
    SITE, base_push=10.0, center_of_mass=[0.01, 0.02, 0.03], payload_center=[0.03, 0.02, 0.01]
)


@pytest.fixture(scope="module")
def robot():
    own = experiment_task("B", "effective").robot
    arm = own.arm.with_payload(Payload(0.4, [0.02, 0.0, 0.05], [1e-3, 2e-3, 2.5e-3]))
    return own.varied(arm=arm)


@pytest.fixture(scope="module")
def cases(robot):
    return WorstCase(robot, WIDE)


def states(rng, count, n=6):
    ends = np.repeat([1.5, 0.7, 4.0], n)
    return rng.uniform(-ends, ends, (count, 3 * n))


def built_anew(robot, own: Deviations, theta, s, base_motion=None):
    """Wrench (6,) of a robot made with the deviations, about the nominal centre of mass."""
    parts = {name: theta[at] for name, at in own.places.items()}
    support = robot.support
    gravity = support.gravity + parts["gravity"]
    factors = 1 + parts["arm_mass"]
    bare = robot.arm.with_payload(None)
    arm = dataclasses.replace(
        bare, masses=factors * bare.masses, inertias=factors[:, None, None] * bare.inertias
    )
    held, share = robot.payload, 1 + parts["payload_mass"][0]
    centre = held.center_of_mass + parts["payload_center"]
    held = Payload(share * held.mass, centre, share * held.inertia)
    moved = support.center_of_mass + parts["center_of_mass"]
    mass = support.mass * (1 + parts["base_mass"][0])
    inertia = (1 + parts["base_mass"][0]) * support.inertia
    base = Support(support.contacts, mass=mass, center_of_mass=moved, gravity=gravity, inertia=inertia)
    q, qd, qdd = np.split(s, 3)
    late, pace = parts["delay"], 1 + parts["speed"][0]
    q, qd = q - late * qd + late**2 / 2 * qdd, qd - late * qdd
    state = q[None], np.sqrt(pace) * qd[None], pace * qdd[None]

    def wrench(model):
        return Robot(model, base, robot.motors).loads(*state, base_motion=base_motion)[1][0]

    total = wrench(arm.with_payload(held))
    point = wrench(arm.with_payload(Payload(1.0))) - wrench(arm)  # linear in what is held
    total = total + parts["extra_mass"][0] * point
    tool = gripper_pose(arm, q)[0]
    for force, where in ((parts["push"], tool), (parts["base_push"], moved)):
        total = total + np.concatenate([force, np.cross(where - moved, force)])
    total[3:] += np.cross(moved - support.center_of_mass, total[:3])
    return total


def test_the_wrench_is_that_of_a_robot_built_anew(robot, cases):
    rng, own = np.random.default_rng(1), cases.deviations
    s = states(rng, 5)
    theta = random_deviations(own, rng, 5)
    found = own.wrench(s, theta)[0]
    for row in range(5):
        expected = built_anew(robot, own, theta[row], s[row])
        assert np.allclose(found[row], expected, rtol=1e-10, atol=1e-10)


@pytest.mark.slow
def test_the_wrench_on_a_moving_base_is_that_of_a_robot_built_anew(robot):
    rng, tolerance = np.random.default_rng(3), dataclasses.replace(WIDE, drive_speed=0.2)
    own = driving_case_of(robot, tolerance).deviations
    s, motions = states(rng, 3), rng.normal(size=(3, 9))
    off = random_deviations(own, rng, 3)
    found = own.wrench(np.hstack([s, motions]), off)[0]
    for row in range(3):
        a, w, al = motions[row].reshape(3, 3)
        rush = 1 + float(off[row, own.places["drive_speed"]][0])
        motion = BaseMotion(rush * a, np.sqrt(rush) * w, rush * al)
        expected = built_anew(robot, own, off[row], s[row], motion)
        assert np.allclose(found[row], expected, rtol=1e-10, atol=1e-10)


def test_slopes_are_finite_differences(cases):
    rng, own = np.random.default_rng(2), cases.deviations
    s, theta, a = states(rng, 1), random_deviations(own, rng, 1), rng.normal(size=(1, 6))
    step = 1e-6

    def value(s, theta):
        return float((a @ own.wrench(s, theta)[0].T)[0, 0])

    over = own.wrench_and_slopes(s, theta)[1]
    for k in range(own.size):
        d = step * np.eye(own.size)[k]
        assert a[0] @ over[0, :, k] == pytest.approx(
            (value(s, theta + d) - value(s, theta - d)) / 2e-6, abs=1e-5
        )
    slopes, bend = own.state_slopes(s, theta, a)[0][0], own.state_curvature(s, theta, a)[0][0]
    for k in range(18):
        d = step * np.eye(18)[k]
        assert slopes[k] == pytest.approx((value(s + d, theta) - value(s - d, theta)) / 2e-6, abs=1e-4)
        change = own.state_slopes(s + d, theta, a)[0][0] - own.state_slopes(s - d, theta, a)[0][0]
        assert np.allclose(bend[k], change / 2e-6, atol=1e-4)


@examples(25, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_nothing_within_the_tolerance_is_worse_than_the_bound(cases, seed):
    rng, own = np.random.default_rng(seed), cases.deviations
    s = np.repeat(states(rng, 1), cases.axes, axis=0)
    axis = np.arange(cases.axes)
    found = cases.moments(s, axis)
    assert found.values == pytest.approx(np.einsum("nw,nw->n", found.slopes, own.wrench(s, found.theta)[0]))
    least = found.values - own.missed(s, found.theta, found.slopes)
    many = own.wrench(np.repeat(s[:1], 300, axis=0), random_deviations(own, rng, 300))[0]
    moments = many @ found.slopes.T
    assert np.all(moments >= least - 1e-9)
    nominal = own.wrench(s[:1], np.zeros((1, own.size)))[0] @ found.slopes.T
    drop = nominal[0] - found.values
    assert np.all(nominal[0] - moments.min(axis=0) > 0.5 * drop)  # the bound is not idle


def test_the_gap_of_the_bound_is_small(cases):
    rng, own = np.random.default_rng(3), cases.deviations
    s, axis = states(rng, 300), rng.integers(0, cases.axes, 300)
    found = cases.moments(s, axis)
    nominal = np.einsum("nw,nw->n", found.slopes, own.wrench(s, np.zeros((300, own.size)))[0])
    share = own.missed(s, found.theta, found.slopes) / (nominal - found.values)
    assert np.median(share) < 0.02
    assert np.max(share) < 0.15


def test_no_sample_slips_more_than_the_worst_that_was_found(cases):
    rng, own = np.random.default_rng(4), cases.deviations
    s = 0.3 * states(rng, 12)
    worst = cases.slip(s, starts=5)
    for row in range(len(s)):
        many = own.wrench(np.repeat(s[row : row + 1], 200, axis=0), random_deviations(own, rng, 200))[0]
        GT = cases.footing.slip.evaluate(solve_many(cases.footing.support, many), derivatives=False).GT
        assert np.all(worst.values[row] + 1e-9 >= GT)
    again = cases.footing.slip.evaluate(solve_many(cases.footing.support, own.wrench(s, worst.theta)[0])).GT
    assert np.allclose(again, worst.values)


def test_a_tilt_alone_is_statics_by_hand(robot):
    """About an axis with slope a, (a . w) over the cap of gravity: norm(b) norm(g) cos(angle + tilt)."""
    own = WorstCase(robot, Uncertainty(tilt=np.radians(2)))
    s = np.zeros((1, 18))
    per_gravity = []
    for g in np.eye(3):
        theta = np.zeros((1, own.deviations.size))
        theta[0, own.deviations.places["gravity"]] = g - robot.support.gravity
        per_gravity.append(own.deviations.wrench(s, theta)[0][0])
    for k in range(own.axes):
        found = own.moments(s, np.array([k]))
        b, g = np.array(per_gravity) @ found.slopes[0], robot.support.gravity
        angle = np.arccos(b @ g / np.linalg.norm(b) / np.linalg.norm(g))
        expected = np.linalg.norm(b) * np.linalg.norm(g) * np.cos(min(angle + np.radians(2), np.pi))
        assert found.values[0] == pytest.approx(expected, abs=1e-12)


def test_words(robot):
    own = Deviations(
        robot, Uncertainty(tilt=np.radians(0.5), extra_mass=0.1, delay=0.01, speed=0.03, friction=0.2)
    )
    theta = np.zeros(own.size)
    theta[own.places["gravity"]] = 9.81 * np.array([0, -np.sin(np.radians(0.5)), 1 - np.cos(np.radians(0.5))])
    theta[own.places["extra_mass"]], theta[own.places["speed"]] = 0.1, 1.03**2 - 1
    theta[own.places["delay"]] = [0, 0.01, 0, 0, 0.01, 0]
    assert own.words(theta) == (
        "tilt 0.5 deg towards -y, 0.1 kg more at the TCP, 3 % faster, "
        "joints 2, 5 delayed by 10 ms, friction -20 %"
    )
    assert towards(np.array([1.0, 1.0, 0.0])) == "towards (0.71, 0.71, 0)"
