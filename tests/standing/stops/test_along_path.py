"""Stops along the path: against Pinocchio by differences of the time law, and all stops by brute force."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.stops.tables import StoppedPath
from ocptip.published.tasks import experiment_task
from ocptip.robots.model import JointLimits
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.stops.along_path import Path, PathStops, StopPoints
from tests.quick import examples
from tests.robots.pinocchio_twin import dynamics, twin

ASKED = Limits(stops=PathStops())


@pytest.fixture(scope="module")
def task():
    return experiment_task("C", "effective")


def points_at(task, times, time=0.0):
    path = Path.of(task.robot, task.reference.states(times), 1.0, time)
    return path, StopPoints.of(path)


def test_wrenches_are_those_of_pinocchio_by_differences_of_the_time_law(task):
    """Of a time law s(t) with these s' and s'' only angles are used."""
    robot, motion = task.robot, task.reference
    left, right = motion.intervals[np.argmax(np.diff(motion.intervals, axis=1))]
    times = np.linspace(left, right, 9)[1:-1]
    _, points = points_at(task, times)
    model = twin(robot.arm)
    support = robot.support
    checked = 0
    for place, x, u, wrench in zip(times[points.owner], points.x, points.u, points.wrenches, strict=True):
        h = 1e-4 * (right - left) / (1 + abs(u))
        law = place + np.sqrt(x) * np.array([-h, 0, h]) + 0.5 * u * h**2
        law[1] = place
        q = motion.states(law)[0]
        qd, qdd = (q[2] - q[0]) / (2 * h), (q[2] - 2 * q[1] + q[0]) / h**2
        _, found = dynamics(
            model, q[1], qd, qdd, support.gravity, np.zeros(3), np.zeros(3), support.center_of_mass
        )
        np.testing.assert_allclose(wrench, found + support.weight, atol=2e-4 * np.abs(wrench).max())
        checked += 1
    assert checked >= 2 * len(times)


def test_the_rest_after_a_stop_counts():
    """Where decelerations relieve the base, it is loaded most when everything rests."""
    robot = experiment_task("A", "effective").robot
    rng = np.random.default_rng(0)
    states = rng.uniform(-1, 1, (3, 200, 6)) * np.array([2.0, 1.0, 5.0])[:, None, None]
    points = StopPoints.of(Path.of(robot, tuple(states), 1.0, 0.3))
    rest = robot.loads(states[0], 0 * states[0], 0 * states[0])[1]
    found, alone = (robot.tip_over.evaluate(robot.contact_states(w)).GN for w in (points.wrenches, rest))
    worst, which = points.worst(found[:, None])
    assert np.all(worst[:, 0] >= alone - 1e-12)
    where = which[:, 0][worst[:, 0] < alone + 1e-12]
    assert len(where) > 0
    assert not np.any(points.u[where])
    assert not np.any(points.x[where])


def test_the_deceleration_is_the_largest_that_the_drives_allow(task):
    robot, motion = task.robot, task.reference
    times = np.linspace(0.01, motion.end - 0.01, 40)
    _, points = points_at(task, times)
    q, qd, qdd = (part[points.owner] for part in motion.states(times))

    def use(u):
        accelerations = qd * u[:, None] + qdd * points.x[:, None]
        torques = robot.loads(q, qd * np.sqrt(points.x)[:, None], accelerations)[0]
        return np.maximum(
            np.max(np.abs(accelerations) / robot.limits.acceleration, axis=1),
            np.max(np.abs(torques) / robot.limits.torque, axis=1),
        )

    braking, rest = points.u < 0, (points.x == 0) & (points.u == 0)
    assert rest.sum() >= len(times)
    assert braking[~rest].mean() > 0.9
    np.testing.assert_allclose(use(points.u)[braking], 1.0, atol=1e-9)
    assert np.all(use(1.01 * points.u)[braking] > 1 + 1e-6)


def stops_by_hand(task, begins, gentler=None, seed=0):
    """States (s, x, u) of stops from some instants, the time law integrated in small steps."""
    rng, found = np.random.default_rng(seed), []
    motion, step = task.reference, 2e-3
    grid = np.arange(0, motion.end, step)
    path, _ = points_at(task, grid)
    c, d = path.bounds.lines
    for begin in begins:
        x, k = 1.0, int(begin / step)
        while x > 0 and k < len(grid):
            u = min(float(np.max(c[k] + d[k] * x)), 0.0)
            u *= 1.0 if gentler is None else rng.uniform(0, 1)
            found.append((k, x, u))
            x, k = x + 2 * step * u, k + 1
    k, x, u = np.array(found).T
    of_u, of_x, rest = (part[k.astype(int)] for part in path.wrenches)
    return grid[k.astype(int)], rest + x[:, None] * of_x + u[:, None] * of_u


@pytest.mark.parametrize("case", ["C", "G"])
def test_no_stop_is_worse_than_the_check_says(case):
    task = experiment_task(case, "effective")
    checked = check_motion(task.robot, task.reference, ASKED)
    for gentler in (None, True):
        _, wrenches = stops_by_hand(task, np.linspace(0.01, task.reference.end, 60)[:-1], gentler)
        states = task.robot.contact_states(wrenches)
        GN = np.max(task.robot.tip_over.evaluate(states).GN)
        GT = np.max(task.robot.slip.evaluate(states, derivatives=False).GT)
        assert max(checked.worst[n].value for n in ("GN_stop", "GN")) + 1e-6 >= GN
        assert max(checked.worst[n].value for n in ("GT_stop", "GT")) + 1e-6 >= GT
        if gentler is None:  # and the bound is not idle
            assert 0.97 * checked.worst["GN_stop"].value < GN
            assert 0.97 * checked.worst["GT_stop"].value < GT


@examples(25)
@given(seed=st.integers(0, 10**6))
def test_corners_are_all_corners_of_the_curve(seed):
    """u_min by brute force over x, and rest; no value of an affine function there is below the corners'."""
    rng = np.random.default_rng(seed)
    task = experiment_task("ABCH"[seed % 4], "effective")
    times = rng.uniform(0.02, 0.98, 5) * task.reference.end
    path, points = points_at(task, times, time=rng.choice([0.0, 0.3]))
    c, d = path.bounds.lines
    x = np.linspace(0, 1, 201)
    u = np.max(c[:, None] + d[:, None] * x[:, None], axis=2)
    g = rng.normal(size=2) / [np.max(np.abs(u)), 1]
    values = g[0] * points.u + g[1] * points.x
    least = -points.worst(-values[:, None])[0][:, 0]
    by_hand = np.minimum(np.min(g[0] * u + g[1] * x, axis=1), 0.0)
    assert np.all(least <= by_hand + 1e-9)
    assert np.all(least >= by_hand - 0.02 * np.ptp(g[0] * u + g[1] * x, axis=1) - 1e-9)


def test_safe_speeds_are_the_brink(task):
    robot, motion = task.robot, task.reference
    path = StoppedPath(robot, motion, ASKED)
    safe = path.safe_speeds()
    some = np.flatnonzero((safe > 0.1) & (safe < 0.98))
    assert len(some) > 20

    def stands(k, speed):
        stop = path.stop(path.places[k], speed)
        x = stop.speeds**2
        own = Path.of(robot, motion.states(stop.places), 1.0, 0.0)
        c, d = own.bounds.lines
        u = np.minimum(np.max(c + d * x[:, None], axis=1), 0.0)
        of_u, of_x, rest = own.wrenches
        states = robot.contact_states(rest + x[:, None] * of_x + u[:, None] * of_u)
        GT = robot.slip.evaluate(states, derivatives=False).GT
        return max(np.max(robot.tip_over.evaluate(states).GN), np.max(GT)) <= 0.9 * (1 + 1e-3)

    for k in some[:: len(some) // 8]:
        assert stands(k, 0.98 * safe[k])
        assert not stands(k, min(1.03 * safe[k] + 0.01, 1.0))


def test_a_stop_takes_the_time_that_its_law_takes(task):
    path = StoppedPath(task.robot, task.reference, replace(ASKED, stops=PathStops(time=0.4)))
    begin = 0.3 * task.reference.end
    stop = path.stop(begin)
    assert 0.4 - 1e-9 <= stop.times[-1] < 0.5
    assert stop.speeds[0] == 1.0
    assert stop.speeds[-1] == 0.0
    middle = len(stop.places) // 2
    assert path.begun(stop.places[middle], stop.speeds[middle]) == pytest.approx(begin, abs=0.01)


def test_programs_have_exact_derivatives_of_stops(task):
    formulation = Formulation(task.robot, task.start, task.goal, task.optimised, task.commands)
    order, x = order_of(formulation, formulation.variables(task.reference))
    program = formulation.ordered_program(replace(task.limits, stops=PathStops()), order, x, [])
    near, rows = program.near_rows(x, 0.6), program.no_rows()
    names = "tip-over in stops", "slip in stops"
    for name in names:
        rows[name][:] = near[name]
    assert min(np.count_nonzero(near[name]) for name in names) > 3
    program = program.with_rows(rows)
    count = len(program.structure.lower)
    values = program.values(x)[1][count:]
    tips = np.count_nonzero(near[names[0]])
    on = np.concatenate([np.zeros(count), np.random.default_rng(0).normal(size=len(values))])
    on[count + tips :] = 0.0  # the curvature of GT is left out
    J, H, h = program.jacobian(x), program.hessian(x, 0.0, on), 1e-6
    for j in range(0, len(x) - 2, 3):
        step = h * (np.arange(len(x)) == j)
        slope = (program.values(x + step)[1] - program.values(x - step)[1])[count:] / (2 * h)
        np.testing.assert_allclose(J[count:, j], slope, atol=1e-5 * np.abs(J[count:]).max())
        bend = on @ (program.jacobian(x + step) - program.jacobian(x - step)) / (2 * h)
        np.testing.assert_allclose(H[j], bend, atol=1e-5 * np.abs(H).max())


def test_limits_of_stops_are_looked_at_only_where_asked_for(task):
    plain, asked = (check_motion(task.robot, task.reference, limits) for limits in (None, ASKED))
    assert set(asked.worst) - set(plain.worst) == {"GN_stop", "GT_stop"}
    for name, worst in plain.worst.items():
        assert asked.worst[name].value == pytest.approx(worst.value, abs=1e-6)


def test_rules_that_mean_nothing_are_refused(task):
    for wrong in ({"GN": 1.1}, {"GT": 0.0}, {"time": -1.0}):
        with pytest.raises(InputError, match=f"stops.{next(iter(wrong))}: "):
            PathStops(**wrong)
    own = task.robot
    endless = JointLimits(
        own.limits.angle_min, own.limits.angle_max, own.limits.speed, *2 * [np.full(6, np.inf)]
    )
    robot = Robot(replace(own.arm, limits=endless), own.support, own.motors)
    with pytest.raises(InputError, match="give \\[stops\\] time"):
        Path.of(robot, task.reference.states(np.array([0.3])), 1.0, 0.0)
    assert np.isfinite(Path.of(robot, task.reference.states(np.array([0.3])), 1.0, 0.5).bounds.lines[0]).any()


def test_stops_stay_what_they_are_under_scaling_of_time(task):
    """Half as fast and a quarter of the drives' accelerations: the inertial wrench is a quarter."""
    fast, slow = task.reference, task.reference.time_scaled(2.0)
    times = np.array([0.2, 0.5, 0.9]) * fast.end
    limits = task.robot.limits
    weak = replace(limits, acceleration=limits.acceleration / 4, torque=np.full(6, np.inf))
    strong = replace(limits, torque=np.full(6, np.inf))
    found = []
    for motion, own, scale in ((fast, strong, 1.0), (slow, weak, 2.0)):
        robot = Robot(replace(task.robot.arm, limits=own), task.robot.support, task.robot.motors)
        path = Path.of(robot, motion.states(scale * times), 1.0, 0.0)
        points = StopPoints.of(path)
        found.append((points.wrenches - path.wrenches[2][points.owner]) * scale**2)
    np.testing.assert_allclose(found[0], found[1], atol=1e-8)
