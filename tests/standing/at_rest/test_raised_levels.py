"""Largest tilts, pushes, and payloads of joints that move: against other computations, posture by posture."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ocptip.api.inputs.postures import rests_of
from ocptip.robots.collision.gaps import random_postures
from ocptip.robots.payload import Payload
from ocptip.robots.process import ProcessWrench
from ocptip.standing.at_rest.directions import around, tilted
from ocptip.standing.at_rest.joint_box import JointBox
from ocptip.standing.at_rest.largest_level import largest_levels_kept
from ocptip.standing.at_rest.raised import RaisedPayload, RaisedPush, RaisedTilt
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.cycle import read_task
from tests.places import EXAMPLES
from tests.quick import some

LARGE = Uncertainty(tilt=0.02, push=4.0, payload_mass=0.05, arm_mass=0.03)


@pytest.fixture(scope="module")
def kit():
    robot, _, limits = rests_of(read_task(EXAMPLES / "tasks/kit_arm.toml", NONE))["start"]
    return robot, replace(limits, tolerance=NONE)


def moments(robot, q, qd=None, qdd=None, *, arm=None, gravity=None):
    """(N, axes) moments about tipping axes, N m, and (N, n) torques."""
    still, support = np.zeros(q.shape), robot.support
    rates = [still if rate is None else rate for rate in (qd, qdd)]
    gravity = support.gravity if gravity is None else gravity
    loads = robot.pushed(arm or robot.arm, q, *rates, None, gravity=gravity, about=support.center_of_mass)
    slope, offset = robot.tip_over.affine_moments
    weight = np.r_[support.mass * gravity, np.zeros(3)]
    return (loads.wrench + weight) @ slope.T + offset, loads.torque


def tipping(found):
    return [k for k, name in enumerate(found.limits) if found.names[name].startswith("tipping")]


def worst_of(values):
    """The minimum over all directions of values at three directions, a constant plus a linear function."""
    constant = np.mean(values)
    x, y = (
        2
        / 3
        * sum(
            value * np.array([np.cos(turn), np.sin(turn)])
            for value, turn in zip(values, 2 * np.pi * np.arange(3) / 3, strict=True)
        )
    )
    return constant - np.hypot(x, y)


def test_at_the_largest_tilt_the_moment_is_the_smallest_allowed(kit):
    robot, limits = kit
    q = random_postures(robot.arm, 20)
    found = largest_levels_kept(RaisedTilt(robot), limits, q, np.pi / 3)
    need, rows = robot.tip_over.reference_moment * (1 / limits.GN - 1), tipping(found)
    assert len(rows) > 5
    down = robot.support.gravity
    for k in rows:
        floors = [tilted(down, side, found.levels[k]) for side in around(down, 3)]
        values = np.array([moments(robot, q[k][None], gravity=floor)[0][0] for floor in floors])
        least = min(worst_of(column) for column in values.T)
        assert least == pytest.approx(need, abs=1e-9 * robot.mass)


def test_postures_whose_torques_are_too_large_on_a_level_floor_keep_no_tilt(kit):
    """Where the torques of all others allow the largest tilt, none is left to be searched."""
    robot, limits = kit
    q = random_postures(robot.arm, 20)
    found = largest_levels_kept(RaisedTilt(robot), replace(limits, torque_ratio=1e-6), q, np.pi / 3)
    assert not found.kept_at_zero.any()
    assert (found.levels == 0).all()


@pytest.mark.parametrize("height", some(1, [0.7, None]))
def test_at_the_largest_push_the_moment_is_the_smallest_allowed(kit, height):
    robot, limits = kit
    q = random_postures(robot.arm, 20)
    found = largest_levels_kept(RaisedPush(robot, height), limits, q, 500.0)
    need, rows = robot.tip_over.reference_moment * (1 / limits.GN - 1), tipping(found)
    assert len(rows) > 5
    feet = np.array([contact.position for contact in robot.support.contacts])
    place = np.array([*feet[:, :2].mean(axis=0), feet[:, 2].min() + (height or 0.0)])
    for k in rows:
        values = []
        for side in around(robot.support.gravity, 3):
            push = found.levels[k] * side
            if height is None:
                arm = robot.arm.with_process(ProcessWrench(push, np.zeros(3), "base"))
                values.append(moments(robot, q[k][None], arm=arm)[0][0])
            else:
                lever = place - robot.support.center_of_mass
                more = np.concatenate([push, np.cross(lever, push)])
                values.append(moments(robot, q[k][None])[0][0] + robot.tip_over.affine_moments[0] @ more)
        least = min(worst_of(column) for column in np.array(values).T)
        assert least == pytest.approx(need, abs=1e-9 * robot.mass)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [RaisedTilt, RaisedPush])
def test_within_an_uncertainty_levels_are_smaller_and_kept_by_random_deviations(kit, kind):
    robot, limits = kit
    q = random_postures(robot.arm, 8)
    raised = kind(robot)
    nominal = largest_levels_kept(raised, limits, q, raised.most)
    within = largest_levels_kept(raised, replace(limits, tolerance=LARGE), q, raised.most)
    assert (within.levels <= nominal.levels).all()
    assert (within.levels < 0.95 * nominal.levels).mean() > 0.5
    need, draw = robot.tip_over.reference_moment * (1 / limits.GN_worst_case - 1), np.random.default_rng(4)
    down, nearest = robot.support.gravity, []
    for k in np.flatnonzero(within.kept_at_zero):
        for _ in range(30):
            payload = robot.payload
            mass = payload.mass * (1 + draw.choice([-1, 1]) * LARGE.payload_mass)
            first, second, third = around(down, 24)[draw.integers(24, size=3)]
            tilt, push = LARGE.tilt, LARGE.push * first
            if kind is RaisedTilt:
                tilt += within.levels[k]
            else:
                push = push + within.levels[k] * second
            arm = robot.arm.with_payload(Payload(mass, payload.center_of_mass))
            arm = arm.with_process(ProcessWrench(push, np.zeros(3), "base"))
            floor = tilted(down, third, tilt)
            nearest.append(moments(robot, q[k][None], arm=arm, gravity=floor)[0].min() - need)
    assert min(nearest) > -1e-9
    assert min(nearest) < 0.5 * np.median(nearest)


@pytest.mark.parametrize(("speed", "acceleration"), some(1, [(0.0, 0.3), (0.3, 0.0), (0.3, 0.3)]))
def test_payloads_of_moving_joints_are_those_of_the_worst_of_all_ends(kit, speed, acceleration):
    """All ends of accelerations and speeds, and random motions between them, one by one."""
    robot, limits = kit
    q, n = random_postures(robot.arm, 6), robot.n
    box = JointBox(speed * robot.limits.speed, acceleration * robot.limits.acceleration)
    found = largest_levels_kept(RaisedPayload(robot), limits, q, 20.0, box)
    ends = np.array(list(product((-1.0, 1.0), repeat=n)))
    fast = np.vstack([np.zeros(n), ends[: len(ends) // 2]]) if speed else np.zeros((1, n))
    sharp = ends if acceleration else np.zeros((1, n))
    shares = [np.hstack(pair) for pair in product(fast, sharp)]
    between = np.random.default_rng(1).uniform(-1, 1, (2000, 2 * n))
    moves = np.vstack([shares, between]) * np.r_[box.speed, box.acceleration]
    decided = 0
    for k in np.flatnonzero(found.kept_at_zero):
        centre = robot.payload.center_of_mass
        loaded = robot.varied(arm=robot.arm.with_payload(Payload(found.levels[k], centre)))
        many = np.tile(q[k], (len(moves), 1))
        values, torques = moments(robot, many, *np.split(moves, 2, axis=1), arm=loaded.arm)
        left = values.min() - loaded.tip_over.reference_moment * (1 / limits.GN - 1)
        use = np.max(np.abs(torques) / robot.limits.torque) / limits.torque_ratio
        assert left > -1e-9 * robot.mass
        assert use < 1 + 1e-9
        decided += min(left / robot.mass, 1 - use) < (1e-9 if not speed else 2e-2)
    assert decided > 1


def test_speeds_that_help_are_not_counted():
    """A quadratic form with both signs: the search is as good as a fine grid, and never outside."""
    draw = np.random.default_rng(3)
    box = JointBox(np.array([1.0, 2.0, 0.5]), np.ones(3))
    forms = draw.normal(size=(30, 3, 3))
    forms = forms + np.swapaxes(forms, 1, 2)
    parts = np.zeros((30, 1, 3)), forms[:, None]
    change, values = box.least(parts, np.ones((30, 1)))
    speeds = change[:, 3:6]
    assert (np.abs(speeds) <= box.speed).all()
    grid = np.array(list(product(np.linspace(-1, 1, 21), repeat=3))) * box.speed
    fine = np.einsum("pi,kij,pj->kp", grid, forms, grid).min(axis=1)
    assert values == pytest.approx(np.einsum("ki,kij,kj->k", speeds, forms, speeds))
    assert (values <= fine + 1e-9).mean() > 0.85
    assert (values <= 0.9 * fine + 1e-9).all()
