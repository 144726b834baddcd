"""The fastest timing: closed forms, a dynamic program, Pinocchio's dynamics, explicit contact forces."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import clarabel
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import sparse

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.files.execution import SLOWEST, execute
from ocptip.motion.objective import ENERGY, TIME
from ocptip.published.tasks import experiment_task
from ocptip.retiming.fastest import ExtraRows, Grid, enough, fastest, spaced
from ocptip.retiming.retime import _slowed as slowed_as_needed
from ocptip.retiming.retime import least_cost, retime
from ocptip.retiming.rows import Places, TimingLimits
from ocptip.retiming.whole_body import Run
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.path_fit import path_of_motion, spline_through
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from ocptip.trajectories.velocity_profiles import earliest_end
from tests.places import EXAMPLES, RESULTS
from tests.quick import examples, some
from tests.retiming.paths import cart, delta, random_path, tripod


def test_a_straight_line_is_a_trapezoid():
    task = tripod()
    way = task.goal - task.start
    path = JointPath([0.0, 1.0], np.stack([way, task.start])[:, None])
    found = retime(task.robot, path, Limits(GN=0.999, GT=0.999, torque_ratio=100.0))
    limits = task.robot.limits
    pace = np.min(limits.speed / np.abs(way)), np.min(limits.acceleration / np.abs(way))
    assert found.verified
    assert found.motion.end == pytest.approx(float(earliest_end(1.0, *pace)), rel=2e-3)
    assert found.motion.end >= float(earliest_end(1.0, *pace)) * (1 - 1e-9)


@pytest.mark.slow
def test_splines_that_turn_back_are_timed_as_well_as_others():
    """To and fro on one line: the optimum is the sum of bang-bang motions between the extremes."""
    task = tripod()
    way = 0.05 * np.where(np.arange(task.robot.n) % 2, -1.0, 1.0)
    shares = np.arange(17) % 2 * (1 + 0.1 * np.sin(np.arange(17.0)))
    path = spline_through(task.start + shares[:, None] * way).path
    place = (path.at(np.linspace(0, 1, 100_001))[0][:, 0] - task.start[0]) / way[0]
    turning = np.flatnonzero(np.diff(np.sign(np.diff(place)))) + 1
    extremes = place[np.concatenate([[0], turning, [len(place) - 1]])]
    limits = task.robot.limits
    times = 2 * np.sqrt(np.abs(np.diff(extremes)) * np.max(np.abs(way) / limits.acceleration))
    assert np.all(2 * np.abs(np.diff(extremes)) / times < np.min(limits.speed / np.abs(way)))
    optimum, loose = float(np.sum(times)), Limits(GN=0.999, GT=0.999, torque_ratio=100.0)
    few, more = (least_cost(task.robot, path, loose, TIME, n) for n in (300, enough(path, 300)))
    assert enough(path, 300) > 600
    assert 1 - 1e-6 < more / optimum < 1.004
    assert few / optimum > 1.006
    assert enough(random_path(task, 1, 0.1), 300) <= 600


@pytest.mark.slow
@examples(3, derandomize=True)
@given(st.integers(0, 10_000))
def test_random_paths_keep_all_limits(seed):
    for task, limits in ((tripod(), Limits()), (delta(), delta().limits)):
        path = random_path(task, seed, 0.1)
        found = retime(task.robot, path, limits, nodes=100)
        assert found.verified, found.check.violations
        assert found.slower < 1.002
        assert "" not in found.active
        faster = found.motion.time_scaled(0.99)
        states = faster.states(faster.both_sides(0.002))
        assert _use(task.robot, limits, states) > 1.0


def _use(robot: StandingMechanism, limits: Limits, states) -> float:
    """Largest use of what limits the timing."""
    q, qd, qdd = states
    samples = robot.samples_of(np.arange(len(q)), q, qd, qdd)
    ratios = [
        np.max(np.abs(qd) / robot.limits.speed),
        np.max(np.abs(qdd) / robot.limits.acceleration),
        np.max(np.abs(samples.torques) / robot.limits.torque) / limits.torque_ratio,
        np.nanmax(samples.tip.GN) / limits.GN,
        np.nanmax(samples.slip.GT) / limits.GT,
        1 + np.max(robot.further_limits.excess(samples.further), initial=-1.0),
    ]
    return float(max(ratios))


def test_reduced_rows_are_all_rows():
    task = tripod()
    path, rng = random_path(task, 4), np.random.default_rng(0)
    timing = TimingLimits(task.robot, Limits(GN=0.7, GT=0.5))
    grid = Grid(task.robot, path, timing, spaced(path, 20))
    planes, polygons = grid.planes, grid.polygons(ExtraRows.none())
    for i, width in enumerate(grid.widths):
        p, q = rng.uniform(0, 1.05, (2, 300)) * grid.places.caps[[grid.left[i], grid.right[i]]][:, None]
        u, slack = (q - p) / (2 * width), np.full(300, np.inf)
        for place, x in ((grid.left[i], p), (grid.right[i], q)):
            rows = (own[place][:, None] for own in (planes.gamma, planes.alpha, planes.beta))
            gamma, alpha, beta = rows
            slack = np.minimum(slack, np.min(gamma - alpha * u - beta * x, axis=0))
            slack = np.minimum(slack, grid.places.caps[place] - x)
        a, b, c = polygons.rows[i, : polygons.counts[i]].T
        inside = np.all(a[:, None] * p + b[:, None] * q <= c[:, None], axis=0)
        clear = np.abs(slack) > 1e-9
        assert np.array_equal(inside[clear], slack[clear] > 0)


def test_active_limits_are_used_up():
    """Those of speeding up, braking and speed, each recomputed from the motion itself."""
    task = tripod()
    found = retime(task.robot, random_path(task, 0), Limits(GN=0.7), nodes=100)
    motion, robot = found.motion, task.robot
    begins, ends = motion.timing.node_times[:-1] + 1e-7, motion.timing.node_times[1:] - 1e-7
    use: dict[str, np.ndarray] = {}
    for times in (begins, ends):
        _, qd, qdd = motion.states(times)
        samples = robot.samples(motion, times)
        own = {
            "speed": np.max(np.abs(qd) / robot.limits.speed, axis=1),
            "acceleration": np.max(np.abs(qdd) / robot.limits.acceleration, axis=1),
            "tip-over": samples.tip.GN / 0.7,
        }
        use = {name: np.maximum(use.get(name, 0.0), values) for name, values in own.items()}
    assert set(found.active) <= set(use)
    assert len(set(found.active)) > 1
    kept = np.array([use[name][i] for i, name in enumerate(found.active)])
    assert np.sum(kept < 0.98) <= 2  # where it turns from one to the other between two nodes
    assert np.min(kept) > 0.85
    assert sum(a != b for a, b in pairwise(found.active)) < 10


@pytest.mark.slow
def test_what_timing_can_cure_is_cured_although_clearance_is_not():
    task, limits = cart(), Limits(clearance=0.6)
    found = retime(task.robot, random_path(task, 5), limits, nodes=30)
    hasty = found.motion.time_scaled(0.97)
    before = check_motion(task.robot, hasty, limits)
    assert len(before.violations) > 1
    slowed, checked, factor = slowed_as_needed(Run(task.robot, hasty, False), limits, before, SLOWEST)
    run = execute(task.robot, hasty, limits, "cubic")
    assert run.slower == pytest.approx(factor, abs=2e-3)
    for after in (found.check, checked, run.check):
        assert [name for name, worst in after.worst.items() if worst.broken] == ["clearance_m"]
        assert len(after.violations) == 1
    assert slowed.motion.end == pytest.approx(factor * hasty.end)
    assert 1.0 < factor < 1.05


@pytest.mark.slow
def test_against_a_dynamic_program():
    """On the same intervals and levels of x at every node; with more nodes it hardly gets faster."""
    task = tripod()
    path = random_path(task, 1)
    timing = TimingLimits(task.robot, Limits(GN=0.7))
    grid = Grid(task.robot, path, timing, spaced(path, 30))
    found = Trajectory.from_path(path, grid.s, fastest(grid, ExtraRows.none()).x)
    best = _dynamic_program(grid, 700)
    assert found.end <= best * (1 + 1e-9)
    assert found.end == pytest.approx(best, rel=2e-2)
    ends = [retime(task.robot, path, Limits(GN=0.7), nodes=nodes).motion.end for nodes in (300, 1200)]
    assert ends[0] == pytest.approx(ends[1], rel=2e-3)


def _dynamic_program(grid: Grid, levels: int) -> float:
    """Least duration over x in a list of levels at every node."""
    polygons = grid.polygons(ExtraRows.none())
    x = np.linspace(0, 1, levels) ** 2 * np.max(grid.places.caps)
    speed, later = np.sqrt(x), np.where(np.arange(levels) == 0, 0.0, np.inf)
    for i in range(len(grid.widths) - 1, -1, -1):
        ok = np.isfinite(later)[None] & np.ones((levels, 1), dtype=bool)
        for a, b, c in polygons.rows[i, : polygons.counts[i]]:
            ok &= a * x[:, None] + b * x[None] <= c + 1e-12 * abs(c)
        with np.errstate(divide="ignore"):
            time = 2 * grid.widths[i] / (speed[:, None] + speed[None])
        later = np.min(np.where(ok, time + later[None], np.inf), axis=1)
    return float(later[0])


def test_coefficients_are_those_of_pinocchio():
    task = cart()
    path = random_path(task, 3)
    places = Places.of(task.robot, path, np.linspace(0, 1, 7), np.zeros(7, dtype=bool))
    (of_u, of_x, rest), _ = places.loads
    model = pin.buildModelFromUrdf(str(EXAMPLES / "tasks" / "ur5.urdf"))
    data, armature = model.createData(), task.robot.arm.armature
    for k in range(7):
        q, dq, ddq = places.q[k], places.dq[k], places.ddq[k]
        still = np.zeros(model.nv)
        gravity = pin.rnea(model, data, q, still, still)
        assert np.allclose(rest[k], gravity, atol=1e-6)
        assert np.allclose(of_u[k], pin.rnea(model, data, q, still, dq) - gravity + armature * dq, atol=1e-6)
        assert np.allclose(of_x[k], pin.rnea(model, data, q, dq, ddq) - gravity + armature * ddq, atol=1e-6)


@pytest.mark.slow
def test_contact_forces_exist_at_the_nodes():
    """Where slip ends the speed, explicit forces within the friction asked for hold the base."""
    task, limits = delta(), delta().limits
    robot = task.robot
    found = retime(robot, random_path(task, 0, 0.1), limits, nodes=60)
    times = found.motion.timing.node_times[:-1][[name == "slip" for name in found.active]] + 1e-6
    assert len(times) > 5
    samples = robot.samples(found.motion, times)
    support, frictions = robot.support, [contact.friction for contact in robot.support.contacts]
    n = len(frictions)
    for wrench in samples.wrenches:
        shares = [_least_usage(support.wrench_matrix, wrench, np.array(frictions), n)]
        assert shares[0] <= limits.GT * (1 + 1e-6)


def _least_usage(matrix: np.ndarray, wrench: np.ndarray, friction: np.ndarray, n: int) -> float:
    """Least excess share t: |f_t| <= mu f_n + t, found as the least t with forces f in balance."""
    low, high = 0.0, 2.0
    for _ in range(30):
        share = 0.5 * (low + high)
        rows = np.zeros((3 * n, 3 * n))
        for k in range(n):
            rows[3 * k, 3 * k] = -share * friction[k]
            rows[3 * k + 1, 3 * k + 1] = rows[3 * k + 2, 3 * k + 2] = -1.0
        A = sparse.csc_matrix(np.vstack([matrix / 100, rows]))
        b = np.concatenate([-wrench / 100, np.zeros(3 * n)])
        settings_ = clarabel.DefaultSettings()
        settings_.verbose = False
        cones = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(3)] * n]
        nothing = sparse.csc_matrix((3 * n, 3 * n))
        solution = clarabel.DefaultSolver(nothing, np.zeros(3 * n), A, b, cones, settings_).solve()
        if str(solution.status) in ("Solved", "AlmostSolved"):
            high = share
        else:
            low = share
    return high


def test_nodes_hold_breakpoints_and_corners():
    corner = JointPath([0.0, 0.4, 1.0], [[[1.0, 0.5], [1.0, -0.5]], [[0.0, 0.0], [0.4, 0.2]]])
    s = spaced(corner, 50)
    assert {0.0, 0.4, 1.0} <= set(s)
    assert np.all(np.diff(s) > 1e-4)
    first = np.diff(s)[[0, -1]]
    assert np.all(first < 0.3 * np.max(np.diff(s)))


def test_stops_at_corners():
    task = tripod()
    middle = 0.5 * (task.start + task.goal) + [0.2, 0, 0, 0, 0, 0]
    ends = np.array([0.0, 0.5, 1.0])
    way = 2 * np.array([middle - task.start, task.goal - middle])
    path = JointPath(ends, np.stack([way, [task.start, middle]]))
    found = retime(task.robot, path, Limits(), nodes=60)
    assert found.verified
    assert found.motion.timing.x[list(found.motion.timing.s).index(0.5)] == 0.0


def test_start_and_end_speeds():
    task = tripod()
    path = random_path(task, 0)
    whole = retime(task.robot, path, nodes=100).motion
    begun = retime(task.robot, path, nodes=100, ends=(0.1, 0.05)).motion
    assert begun.timing.x[[0, -1]] == pytest.approx([0.01, 0.0025], rel=1e-3)
    assert begun.end < whole.end
    with pytest.raises(InputError, match=r"cannot begin|cannot be timed"):
        retime(task.robot, path, nodes=100, ends=(50.0, 0.0))


def test_minimum_duration():
    task = tripod()
    found = retime(task.robot, random_path(task, 0), Limits(min_duration=9.0), nodes=60)
    assert found.verified
    assert found.motion.end == pytest.approx(9.0)


def test_refusals():
    task = tripod()
    path = random_path(task, 0)
    lean = experiment_task("B")
    with pytest.raises(InputError, match=r"at s = 0\.\d+, .* deg: at rest the tipping margin is .*, must"):
        retime(lean.robot, random_path(lean, 1))
    with pytest.raises(InputError, match="has 6 joints, the robot has 3"):
        retime(delta().robot, path)
    with pytest.raises(InputError, match="nodes"):
        retime(task.robot, path, nodes=2)


@pytest.mark.parametrize("nodes", [100, 300])
def test_intervals_that_are_short_as_events_of_ramps_are(nodes):
    """At the end of plan D: ds of 4e-5, in which what is allowed is a strip up to x of half a million."""
    task = experiment_task("D", "effective")
    folder = RESULTS / "plans" / "D-effective" / "plan.json"
    plan = load_motion(folder, task.robot.names, task.robot.units)
    path = path_of_motion(plan).path
    assert np.min(np.diff(path.breakpoints)) < 1e-4
    limits = replace(task.limits, max_duration=np.inf)
    grid = Grid(task.robot, path, TimingLimits(task.robot, limits), spaced(path, nodes))
    found = Trajectory.from_path(path, grid.s, fastest(grid, ExtraRows.none()).x)
    assert 0.999 * plan.end < found.end <= plan.end * (1 + 1e-6)


@pytest.mark.parametrize("objective", some(1, [TIME, ENERGY]))
def test_ramps_on_their_own_path_are_not_worse_with_a_free_law_of_time(objective):
    task = tripod()
    start = 0.5 * (task.start + task.goal)
    ways = (0.4, 0.3, 0.2, -0.5, 0.1, 0.6)
    commands = [
        [RampCommand(way, 1.5, 2.0 + k), RampCommand(way / 3, 0.8, 4.0)] for k, way in enumerate(ways)
    ]
    ramps = Trajectory.from_profiles(start, commands)
    before = check_motion(task.robot, ramps, Limits())
    assert before.verified
    found = retime(task.robot, path_of_motion(ramps).path, Limits(), objective, nodes=200)
    assert found.verified
    assert found.motion.end <= ramps.end * (1 + 1e-3) or objective is ENERGY
    assert found.check.energy <= before.energy * (1 + 1e-3) or objective is TIME
