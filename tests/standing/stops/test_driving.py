"""Cancels of an arm whose base drives on, or brakes at the same time."""

import dataclasses

import numpy as np
import pytest

import ocptip
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.stops.by_cancel import Cancel, CancelCheck, meanwhile
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.cancelled import worst_of_cancels
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES

SPEEDS = np.array([[0.2, 0.1, 0.3], [0.8, 0.1, 0.5], [0.8, 0.1, 0.5], [0, 0, 0]])
RATE, STEP = 1.6, 1e-4


@pytest.fixture(scope="module")
def task():
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml")


@pytest.fixture(scope="module")
def robot(task):
    return task.robot.driving(DriveProfile.of_velocities(np.array([0, 0.4, 0.9, 1.4]), SPEEDS))


@pytest.fixture(scope="module")
def motion(task):
    rates = task.robot.limits.speed / 2, task.robot.limits.acceleration / 4
    return Trajectory.ending_together(task.start, task.start + 0.5, [None] * 6, *rates)


def braking(v, rate, t):
    """Velocities (3,) in base axes of a base that brakes: its curve stays."""
    return v * max(0.0, 1 - rate * t / np.hypot(*v[:2]))


def driven(v_of, t):
    """Acceleration of the origin and yaw rate and acceleration, by differences in the world."""
    v = [v_of(t + k * STEP) for k in (-1, 0, 1)]
    yaw = [(v[1][2] + k * 0.5 * (v[2][2] - v[0][2]) / 4) * k * STEP for k in (-1, 1)]
    world = [
        np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) @ u[:2]
        for a, u in zip(yaw, (v[0], v[2]), strict=True)
    ]
    return (world[1] - world[0]) / (2 * STEP), v[1][2], (v[2][2] - v[0][2]) / (2 * STEP)


@pytest.mark.parametrize("rate", [0.0, RATE])
def test_the_base_moves_as_it_does_in_the_world(robot, motion, rate):
    cancel = Cancel(tuple(robot.limits.acceleration / 3), base_deceleration=rate)
    times = np.array([0.11, 0.35, 0.62])
    q, qd, _ = motion.states(times)
    states, acts = meanwhile(robot, cancel, (times, q, qd), robot.acting(times))
    velocities = robot.drive_profile.velocities
    checked = 0
    for owner, after, row in zip(states.owner, states.after, acts[:, -9:], strict=True):
        t = times[owner] + after
        v0 = velocities.at(times[owner : owner + 1], range(1))[0][0]
        lasts = np.hypot(*v0[:2]) / RATE
        corners = [*(robot.acts.knots - times[owner]), 0.0] if not rate else [0.0, lasts]
        if np.min(np.abs(np.array(corners) - after)) < 1e-3:
            continue

        def v_of(at, v0=v0, begun=times[owner]):
            if rate:
                return braking(v0, rate, at - begun)
            return velocities.at(np.array([at]), range(1))[0][0]

        acceleration, w, al = driven(v_of, t)
        np.testing.assert_allclose(row[:2], acceleration, atol=1e-5)
        np.testing.assert_allclose(row[[5, 8]], [w, al], atol=1e-7)
        checked += 1
    assert checked > 10


def test_a_base_that_brakes_with_a_cancelled_arm_tips_as_by_hand(task, robot, motion):
    """Braking straight takes mass times rate times height from the moment that the stop of the arm leaves."""
    straight = np.array([[0.8, 0, 0], [0.8, 0, 0]])
    robot = task.robot.driving(DriveProfile.of_velocities(np.array([0, 2.0]), straight))
    times = np.linspace(0.05, motion.end - 0.05, 6)
    q, qd, _ = motion.states(times)
    full = tuple(robot.limits.acceleration / 3)
    found = CancelCheck(robot, Cancel(full, base_deceleration=RATE)).stops(q, qd, robot.acting(times), times)
    alone = Cancel(full).states(q, qd)
    slopes, offsets = robot.tip_over.affine_moments
    drives = BaseMotion(np.tile([-RATE, 0, 0], (len(alone.q), 1)))
    wrench = task.robot.loads(alone.q, alone.qd, alone.qdd, base_motion=drives)[1]
    moments = np.min(wrench @ slopes.T + offsets, axis=1)
    lasts = 0.8 / RATE
    assert np.all(alone.after < lasts)
    least = np.full(len(times), np.inf)
    np.minimum.at(least, alone.owner, moments)
    # ends of the base's braking lie in the same posture as the end of the arm's stop
    np.testing.assert_allclose(found.GN, robot.tip_over.ratio(least), rtol=1e-6)
    still = CancelCheck(robot, Cancel(full)).stops(q, qd, robot.acting(times), times)
    assert np.all(found.GN >= still.GN)
    assert np.max(found.GN - still.GN) > 0.01


@pytest.mark.parametrize("rate", [0.0, RATE])
def test_no_drawn_state_is_worse_within_the_uncertainty(robot, motion, rate):
    """Joints and base on time, or both overshooting when the stop begins, at random instants of stops."""
    own, rng = Uncertainty(damping=0.2, tilt=0.005), np.random.default_rng(3)
    cancel = Cancel(tuple(robot.limits.acceleration / 3), base_deceleration=rate)
    cases = worst_case_of(robot, own)
    times = np.linspace(0, motion.end, 30)
    tip = next(iter(worst_of_cancels(cases, motion, cancel, times)))
    profile, worst = robot.drive_profile, []

    def planned(t):
        return profile.velocities.at(np.array([t]), range(1))[0][0]

    def base_at(v, t, begun):
        return braking(v, rate, t - begun) if rate else planned(t)

    def row_of(parts):
        return np.r_[parts[0], 0, 0, 0, parts[1], 0, 0, parts[2]]

    for begun in (0.0, *rng.choice(times[1:], 40)):
        q, qd, _ = motion.states(np.array([begun]))
        v0 = profile.velocities.at(np.array([begun]), range(1))[0][0]
        for after in (0.0, *rng.uniform(0, 1.0, 4)):
            state = cancel.states_at(q, qd, np.zeros(1, int), np.array([after]))
            now, then = begun + after + 2 * STEP, begun + 2 * STEP * (-1 if begun else 1)
            parts = driven(lambda t, v=v0, begun=begun: base_at(v, t, begun), now)
            row, qdd = row_of(parts), state.qdd
            if after == 0.0:
                row = row + own.overshoot * (row - row_of(driven(planned, then)))
                before = motion.states(np.array([then]))[2]
                steps = qdd + own.overshoot * (qdd - before), (1 + own.overshoot) * before
                qdd = steps[0 if begun else 1]  # where it starts, that step of the motion is worse
            worst.append(float(cases.all_moments(np.hstack([state.q, state.qd, qdd, row[None]])).min()))
    drawn = float(cases.tip_ratio(np.array(min(worst))))
    assert drawn <= tip.most + 2e-3
    assert drawn > 0.7 * tip.most


def test_check_says_what_the_base_does_while_the_arm_is_cancelled(task, motion):
    profile = DriveProfile.of_velocities(
        np.array([0, 0.5, 3.0]), np.array([[0.0, 0, 0], [0.4, 0, 0], [0.4, 0, 0]])
    )
    plain = ocptip.check(
        ocptip.load_task(task, uncertainty="none"), motion, drive_profile=profile, stops="cancel"
    )
    assert plain.stops[""].worst["cancel"]["GN"] > 0
    assert any("the base drives on" in text for text in plain.stops[""].assumed)
    rules = dataclasses.replace(plain.task.segments[0].task.stops, base_deceleration=6.0)
    harder = dataclasses.replace(ocptip.load_task(task, uncertainty="none"), stops=rules)
    braked = ocptip.check(harder, motion, drive_profile=profile, stops="cancel")
    assert braked.stops[""].worst["cancel"]["GN"] > plain.stops[""].worst["cancel"]["GN"]
    assert any("the base brakes with 6 m/s^2" in text for text in braked.stops[""].assumed)
