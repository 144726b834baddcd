"""Torques within a tolerance: none is greater than what is proved, and the greatest comes near to it."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.certificate.checks import certified
from ocptip.certificate.describe import model_data, tolerance_data
from ocptip.certificate.trusted.checker import check_certificate, digest
from ocptip.certificate.trusted.described import TORQUES
from ocptip.certificate.trusted.drives import Drives
from ocptip.certificate.trusted.forms import Form
from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE, SITE, WORKSHOP, Uncertainty

flint = pytest.importorskip("flint")
from tests.certificate.test_find import _swing  # noqa: E402
from tests.certificate.test_within_in_balls import _random_model, _random_tolerance  # noqa: E402
from tests.oracles import arm_in_balls as balls  # noqa: E402
from tests.oracles import world_in_balls as worlds  # noqa: E402

_STEP = 1e-6


def _torques(model, world, state):
    """Those of the oracle and of the push at the TCP, by differences of its place."""
    state = np.array(state)
    found = np.array([float(x.mid()) for x in worlds.loads(model, world, state)[0]])
    for k in range(len(found)):
        ends = []
        for side in (_STEP, -_STEP):
            q = [flint.arb(float(x)) for x in state[0]]
            q[k] += flint.arb(side)
            ends.append([float(x.mid()) for x in worlds.tool(model, q, np.zeros(3))])
        found[k] -= np.subtract(*ends) / (2 * _STEP) @ world.push
    return found


def _check_random_arms(arms, intervals, seed):
    rng, nearest = np.random.default_rng(seed), 0.0
    for _ in range(arms):
        model, tolerance = _random_model(rng), _random_tolerance(rng)
        n, h = len(model["arm"]["armature"]), rng.uniform(1e-4, 0.01, intervals)
        model["arm"]["spring_torque"] = rng.uniform(-30, 30, n).tolist()
        model["arm"]["spring_stiffness"] = rng.uniform(0, 50, n).tolist()
        q, v, a, j = (rng.uniform(-k, k, (n, intervals)) for k in (3, 3, 20, 300))
        forms = [
            Form.of(q, v * h, a * h**2 / 2, j * h**3 / 6),
            Form.of(v, a * h, j * h**2 / 2),
            Form.of(a, j * h),
        ]
        share = float(rng.uniform(0, 0.5))
        more = {**tolerance, "springs": share}
        most = Drives(model, more).greatest(*forms, np.zeros((2, forms[0].r.shape[1])))
        assert most.shape == (n, intervals)
        for k in range(intervals):
            for s in (-1.0, float(rng.uniform(-1, 1)), 1.0):
                state = [
                    [float(balls.polynomial(f.c[:, i, k], flint.arb(s)).mid()) for i in range(n)]
                    for f in forms
                ]
                world = worlds.random_world(model, tolerance, rng, ends=0.9)
                springs = model["arm"]["spring_stiffness"] * np.array(state[0], dtype=float)
                springs -= model["arm"]["spring_torque"]
                found = np.abs(_torques(model, world, state)) + share * np.abs(springs)  # of the worse sign
                assert np.all(found <= most[:, k] * (1 + 1e-7) + 1e-7), (model, tolerance, state)
                nearest = max(nearest, float(np.max(found / most[:, k])))
    return nearest


def test_no_torque_of_a_random_world_is_greater_than_is_proved():
    assert _check_random_arms(arms=2, intervals=2, seed=0) > 0.9


@pytest.mark.slow
def test_a_thousand_worlds():
    assert _check_random_arms(arms=70, intervals=5, seed=1) > 0.97


@pytest.mark.parametrize(("case", "spring"), [("B", 0.0), ("G", 0.0), ("B", 7.0)])
def test_nothing_uncertain_is_the_world_as_described(case, spring):
    robot = experiment_task(case).robot
    springs = {"spring_torque": np.full(robot.n, spring), "spring_stiffness": np.full(robot.n, spring)}
    robot = robot.varied(arm=replace(robot.arm, **springs))
    rng = np.random.default_rng(2)
    states = [rng.uniform(-k, k, (20, robot.n)) for k in (3, 2, 10)]
    drives = Drives(model_data(robot), tolerance_data(NONE, robot.support))
    found = drives.greatest(*(Form.of(part.T) for part in states), np.zeros((2, len(states[0]))))
    np.testing.assert_allclose(found.T, np.abs(robot.loads(*states)[0]), rtol=1e-9, atol=1e-7)


@pytest.mark.slow
def test_the_greatest_is_reached_but_for_products():
    """Weights, pace and tilt chosen for one torque, one after the other."""
    robot = experiment_task("B").robot
    tolerance = Uncertainty(arm_mass=0.1, payload_mass=0.2, extra_mass=0.5, tilt=0.02, speed=0.05)
    model, data = model_data(robot), tolerance_data(tolerance, robot.support)
    state = np.stack([np.linspace(-0.5, 0.9, robot.n), np.full(robot.n, 0.7), np.full(robot.n, -2.0)])
    most = Drives(model, data).greatest(*(Form.of(part[:, None]) for part in state), np.zeros((2, 1)))[:, 0]
    gravity, joint = robot.support.gravity, int(np.argmax(most))
    world = worlds.described(model)
    sign = np.sign(_torques(model, world, state)[joint])

    def value(world):
        return sign * _torques(model, world, state)[joint]

    ways = [replace(world, pace=pace) for pace in (0.95, 1.05)]
    world = max(ways, key=value)
    for k in range(len(world.links)):
        own = [world.links.copy(), world.links.copy()]
        own[0][k], own[1][k] = 0.9, 1.1
        world = max((replace(world, links=links) for links in own), key=value)
    world = max((replace(world, payload=w) for w in (0.8, 1.2)), key=value)
    world = max((replace(world, extra=w) for w in (0.0, 0.5)), key=value)
    down = gravity / np.linalg.norm(gravity)
    sides = [np.cross(down, [np.cos(t), np.sin(t), 0.0]) for t in np.linspace(0, 2 * np.pi, 18)]
    tilted = [np.linalg.norm(gravity) * (np.cos(0.02) * down + np.sin(0.02) * side) for side in sides]
    world = max((replace(world, gravity=g) for g in tilted), key=value)
    assert 0.995 * most[joint] <= value(world) <= most[joint]


@pytest.mark.slow
def test_what_drives_do_not_have_within_the_tolerance_is_found_and_not_proved():
    task, motion = _swing("G")
    limits = Limits(tolerance=WORKSHOP, clearance=0.0)
    checked = certified(task.robot, motion, check_motion(task.robot, motion, limits), limits)
    assert checked.verified
    worst, data = checked.worst[TORQUES], checked.certificate.data
    assert checked.worst["torque_ratio"].value < worst.value <= data["bounds"][TORQUES]
    assert data["bounds"][TORQUES] <= worst.value + 3e-4 * max(worst.value, 0.1)
    assert checked.within.torque.joint == int(worst.detail.split()[-1])
    less = {**data, "bounds": {**data["bounds"], TORQUES: 0.99 * worst.value}}
    assert "torque within tolerance" in check_certificate(less).problems[0]
    alone = {**data, "tolerance": None, "cover_within": None, "bounds": {**data["bounds"]}}
    alone["bounds"] = {k: v for k, v in data["bounds"].items() if not k.startswith(("GN_", "GT_"))}
    alone["sha256"] = {**data["sha256"], "tolerance": digest(None)}
    assert "unknown claims" in check_certificate(alone).problems[0]
    weak = replace(task.robot.limits, torque=task.robot.limits.torque * worst.value * 0.99)
    arm = replace(task.robot.arm, limits=weak)
    found = check_motion(task.robot.varied(arm=arm), motion, limits)
    assert found.worst["torque_ratio"].value < 1
    assert [broken.name for broken in found.violations] == [TORQUES]
    pushed = check_motion(task.robot, motion, replace(limits, tolerance=SITE))
    assert pushed.worst[TORQUES].value > worst.value
