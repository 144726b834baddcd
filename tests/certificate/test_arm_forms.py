"""Torques and wrenches of random arms over random intervals, in ball arithmetic and in numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.certificate.describe import model_data
from ocptip.certificate.trusted.arm import Arm
from ocptip.certificate.trusted.forms import Form, times_rows
from ocptip.published.tasks import experiment_task
from ocptip.robots.kinematics import link_frames

flint = pytest.importorskip("flint")
from tests.oracles import arm_in_balls as balls  # noqa: E402

GRAVITY, ABOUT = np.array([0.3, -1.0, -9.7]), np.array([0.1, -0.2, -0.4])


def _random_arm(rng):
    links = int(rng.integers(2, 8))
    coordinates = links if rng.random() < 0.7 else links - 1
    ratios = np.eye(links)[:, :coordinates]
    if coordinates < links:
        ratios[-1, rng.integers(coordinates)] = rng.uniform(-2, 2)
    half = rng.normal(size=(links, 3, 3))
    return {
        "rotations": Rotation.random(links, random_state=rng).as_matrix(),
        "offsets": rng.uniform(-0.5, 0.5, (links, 3)),
        "masses": rng.uniform(0, 5, links),
        "centres": rng.uniform(-0.2, 0.2, (links, 3)),
        "inertias": 0.01 * (half @ half.transpose(0, 2, 1)),
        "slides": rng.random(links) < 0.25,
        "armature": rng.uniform(0, 0.1, coordinates),
        "spring_torque": rng.uniform(-30, 30, coordinates),
        "spring_stiffness": rng.uniform(0, 50, coordinates),
        "ratios": ratios,
        "shift": np.where(np.arange(links) < coordinates, 0.0, 0.3),
        "mount_position": rng.uniform(-0.5, 0.5, 3),
        "mount_rotation": Rotation.random(random_state=rng).as_matrix(),
        "process_in_base": rng.uniform(-20, 20, 6) * (rng.random() < 0.5),
        "process_on_link": rng.uniform(-20, 20, 6) * (rng.random() < 0.5),
    }


def _contains(form, number, values, s):
    return all(
        abs(value - balls.polynomial(form.c[:, k, number], flint.arb(s)))
        <= flint.arb(float(form.r[k, number]))
        for k, value in enumerate(values)
    )


def _check_random_arms(arms, intervals, seed):
    rng = np.random.default_rng(seed)
    for _ in range(arms):
        data = _random_arm(rng)
        n, h = len(data["armature"]), rng.uniform(1e-4, 0.02, intervals)
        q = rng.uniform(-3, 3, (n, intervals))
        v, a, j = (rng.uniform(-k, k, (n, intervals)) for k in (3, 20, 300))
        c = [q, v * h, a * h**2 / 2, j * h**3 / 6]
        forms = Form.of(*c), Form.of(v, a * h, j * h**2 / 2), Form.of(a, j * h)
        arm = Arm(data, GRAVITY, ABOUT)
        torques, wrench = arm.loads(forms[0], arm.turns(forms[0]), *forms[1:], np.zeros((2, intervals)))
        assert np.max(wrench.r) < 1e-2 * np.max(wrench.size)
        for number in range(intervals):
            for s in (-1.0, float(rng.uniform(-1, 1)), 1.0):
                states = [
                    [balls.polynomial(f.c[:, k, number], flint.arb(s)) for k in range(n)] for f in forms
                ]
                tau, w = balls.loads(_rounded(data), *states, GRAVITY, ABOUT)
                assert _contains(torques, number, tau, s)
                assert _contains(wrench, number, w, s)


def test_velocities_are_those_of_the_frames():
    """Of random arms, by differences of the places and rotations of their links."""
    rng, step = np.random.default_rng(5), 1e-5
    for _ in range(8):
        data = _random_arm(rng)
        arm, n = Arm(data, GRAVITY, ABOUT), len(data["armature"])
        q, qd = rng.uniform(-2, 2, (2, n, 3))
        moved = arm.velocities(arm.turns(Form.of(q)), Form.of(qd))
        now, ahead, behind = (arm.frames(arm.turns(Form.of(q + x * qd)))[1:] for x in (0.0, step, -step))
        for (v, omega), (R, _), (R1, p1), (R0, p0) in zip(moved, now, ahead, behind, strict=True):
            in_base = np.einsum("abk,bk->ak", R.c[0], v.c[0])
            np.testing.assert_allclose(in_base, (p1.c[0] - p0.c[0]) / (2 * step), atol=1e-7)
            turn = np.einsum("bak,bck->ack", R.c[0], (R1.c[0] - R0.c[0]) / (2 * step))  # omega x, link axes
            np.testing.assert_allclose(omega.c[0], [turn[2, 1], turn[0, 2], turn[1, 0]], atol=1e-7)
            assert np.max(v.r) < 1e-10


def _rounded(data):
    """With the mount's rotation in the first joint's, rounded once, as the certificate's model is read."""
    first = data["mount_rotation"] @ data["rotations"][0]
    return {
        **data,
        "mount_rotation": np.eye(3),
        "rotations": np.concatenate([first[None], data["rotations"][1:]]),
    }


def test_random_arms_against_ball_arithmetic():
    _check_random_arms(arms=4, intervals=5, seed=1)


@pytest.mark.slow
def test_a_thousand_intervals_against_ball_arithmetic():
    _check_random_arms(arms=50, intervals=20, seed=2)


@pytest.mark.parametrize("springs", [False, True])
def test_frames_and_loads_are_those_of_the_library(springs):
    robot = experiment_task("B").robot
    if springs:
        robot = robot.varied(
            arm=replace(robot.arm, spring_torque=np.arange(6.0), spring_stiffness=np.ones(6))
        )
    model = model_data(robot)
    arm = Arm(model["arm"], robot.support.gravity, robot.support.center_of_mass)
    rng = np.random.default_rng(0)
    q, qd, qdd = (rng.uniform(-k, k, (20, robot.n)) for k in (3, 2, 10))
    turns = arm.turns(Form.of(q.T))
    torques, wrench = arm.loads(Form.of(q.T), turns, Form.of(qd.T), Form.of(qdd.T), np.zeros((2, 20)))
    expected = robot.loads(q, qd, qdd)
    np.testing.assert_allclose(torques.c[0].T, expected[0], atol=1e-10)
    np.testing.assert_allclose(wrench.c[0].T + robot.support.weight, expected[1], atol=1e-10)
    frames = link_frames(robot.arm, q)
    for k, (R, p) in enumerate(arm.frames(turns)[1:]):
        np.testing.assert_allclose(np.moveaxis(R.c[0], 2, 0), frames.rotations[:, k], atol=1e-12)
        np.testing.assert_allclose(p.c[0].T, frames.origins[:, k], atol=1e-12)
    point = np.array([0.1, 0.2, 0.3])
    moved = times_rows(arm.frames(turns)[3][0], point)
    np.testing.assert_allclose(moved.c[0].T, frames.rotations[:, 2] @ point, atol=1e-12)
