"""Stops by brakes as limits of programs: derivatives, and quick verdicts against the plain ones."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.published.tasks import experiment_task
from ocptip.robots.braking import brake
from ocptip.standing.limit_kinds.stops import closing_of
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, stops_of_motion
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES


@pytest.fixture(scope="module", params=["A", "ur5"])
def robot(request):
    if request.param == "A":
        return experiment_task("A", "effective").robot
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot


def states(robot, count=3):
    rng = np.random.default_rng(0)
    q, qd = rng.normal(size=(2, count, robot.n))
    qd[0, 1] = 0.0
    return q, qd, rng.normal(size=(count, 6))


def test_slopes_and_curvature_against_differences(robot):
    q, qd, weights = states(robot)
    closing, n, step = closing_of(robot), robot.n, 1e-5
    torques = BrakeCheck(robot, Brakes((5.0,) * n, (30.0,) * n)).worst_corners(q, qd)[1][:, 0]
    slopes, bends = (f(np.hstack([q, qd]), torques, weights) for f in (closing.gradient, closing.hessian))
    assert not slopes[:, 2 * n :].any()
    for j in range(2 * n):
        d = step * np.eye(2 * n)[j]
        sides = [np.hstack([q + sign * d[:n], qd + sign * d[n:]]) for sign in (1, -1)]
        values = [np.sum(weights * closing.wrenches(side, torques), axis=1) for side in sides]
        numeric = (values[0] - values[1]) / (2 * step)
        np.testing.assert_allclose(slopes[:, j], numeric, atol=3e-5 * np.abs(slopes).max())
        found = [closing.gradient(side, torques, weights) for side in sides]
        numeric = (found[0] - found[1]) / (2 * step)
        np.testing.assert_allclose(bends[:, j], numeric, atol=1e-4 * np.abs(bends).max())


def test_worst_corners_are_worst_of_random_torques(robot):
    q, qd, _ = states(robot)
    least, greatest = np.full(robot.n, 5.0), np.full(robot.n, 30.0)
    check = BrakeCheck(robot, Brakes(tuple(least), tuple(greatest)))
    moments, torques = check.worst_corners(q, qd)
    slope, offset = robot.tip_over.affine_moments
    for axis in range(moments.shape[1]):
        own = closing_of(robot).wrenches(np.hstack([q, qd]), torques[:, axis]) @ slope.T + offset
        np.testing.assert_allclose(own[:, axis], moments[:, axis], atol=1e-8)
    rng = np.random.default_rng(1)
    for _ in range(30):
        some = -np.sign(qd) * rng.uniform(least, greatest, (len(q), robot.n))
        assert np.all(
            closing_of(robot).wrenches(np.hstack([q, qd]), some) @ slope.T + offset >= moments - 1e-8
        )


def test_the_rest_after_a_stop_counts():
    """Where braking relieves the base, it is loaded most when everything rests."""
    robot = experiment_task("A", "effective").robot
    robot = robot.varied(support=robot.support.varied(mass=70.0))
    rng = np.random.default_rng(0)
    q, qd = rng.uniform(-2, 2, (15, 6)), rng.uniform(-1, 1, (15, 6))
    least = np.array([1.7, 17.0, 7.6, 1.7, 1.7, 1.7])
    found = BrakeCheck(robot, Brakes(tuple(least), tuple(least))).stops(q, qd)
    ends = brake(robot.arm, q, qd, robot.support.gravity, least).angles[-1]
    states = robot.contact_states(robot.loads(ends, 0 * ends, 0 * ends)[1])
    assert np.all(found.GN >= robot.tip_over.evaluate(states).GN - 1e-9)


def test_half_spaces_give_the_verdicts_of_the_contact_solver(robot):
    rng = np.random.default_rng(2)
    weight = robot.support.weight
    wrenches = weight + rng.normal(size=(300, 6)) * np.linalg.norm(weight) * [0.2, 0.2, 0.1, 0.02, 0.02, 0.02]
    owner = np.repeat(np.arange(30), 10)
    n = robot.n
    check = BrakeCheck(robot, Brakes((5.0,) * n, (30.0,) * n, GN=0.9, GT=0.7))
    GN, GT = check._reserves(wrenches, owner)
    check._kept_inside = None
    plain = check._reserves(wrenches, owner)
    assert 0 < np.sum(plain[1] > 0.7) < 300
    standing = (plain[0] < 1) & (plain[1] < 1)
    np.testing.assert_allclose(GN[standing], plain[0][standing], rtol=1e-9)
    assert np.all(GN[plain[1] < 1][plain[0][plain[1] < 1] >= 1] >= 1)
    for values in (GT, plain[1]):
        assert np.all(values >= 0)
    worst = [np.array([np.max(values[owner == k]) for k in range(30)]) for values in (GT, plain[1])]
    np.testing.assert_array_equal(worst[0] <= 0.7, worst[1] <= 0.7)


def test_stops_of_a_motion_are_kept():
    task = experiment_task("A", "effective")
    brakes = Brakes((20.0,) * 6, (40.0,) * 6)
    once = stops_of_motion(task.robot, task.reference, brakes)
    assert stops_of_motion(task.robot, task.reference, brakes) is once
