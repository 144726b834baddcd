"""Motions as functions of the optimisation variables: exact states, two derivatives, the smooth form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.motion.planner.profile_kernels import joint_states
from ocptip.motion.planner.profiles import ActingCourse, Layout, Nodes, Profiles
from ocptip.robots.process import SHARE, TIME, ProcessWrench
from ocptip.standing.acting import Acting
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.ramps import JointRamps, phases_to_commands
from ocptip.trajectories.trajectory import Trajectory
from ocptip.trajectories.velocity_profiles import earliest_end, passive_command
from tests.quick import examples, some
from tests.trajectories.strategies import numbers, phases

START = np.array([0.3, -0.2, 0.1])
SPEED = np.array([2.0, 1.5, 3.0])


def reached(start, peaks, ramps, cruises):
    """Where phases lead."""
    before = np.array([0.0, *peaks[:-1]])
    way = np.sum((before + peaks) * ramps[:-1]) / 2 + np.dot(peaks, cruises) + peaks[-1] * ramps[-1] / 2
    return start + way


def with_two_optimised(peaks, ramps, cruises, passive_way=0.8):
    """Joints 1 and 3 by phases (3 slower, backwards), 2 passive: layout, x, start, goal."""
    peaks, ramps, cruises = map(np.array, (peaks, ramps, cruises))
    layout = Layout(3, (0, 2), len(peaks))
    x = np.zeros(layout.size)
    goal = START.copy()
    for j, (speed, time) in enumerate([(1.0, 1.0), (-0.7, 1.3)]):
        x[layout.w(j)], x[layout.d(j)], x[layout.c(j)] = speed * peaks, time * ramps, time * cruises
        goal[2 * j] = reached(START[2 * j], speed * peaks, time * ramps, time * cruises)
    goal[1] += passive_way
    moving = max(np.sum(x[layout.d(j)]) + np.sum(x[layout.c(j)]) for j in (0, 1))
    x[layout.end] = max(moving, 1.2 * abs(passive_way) / SPEED[1])
    x[layout.one] = 1.0
    return layout, x, goal


def seeded(seed, passive_way=0.8, commands=3):
    """The same with moderate random phases, for derivatives."""
    rng = np.random.default_rng(seed)
    peaks = rng.uniform(0.3, 1.5, commands) * rng.choice([-1, 1], commands)
    ramps = rng.uniform(0.2, 0.6, commands + 1)
    return with_two_optimised(peaks, ramps, rng.uniform(0.1, 0.4, commands), passive_way)


def at_shares(layout, shares):
    """Node times as shares of t_E."""
    times = np.zeros((len(shares), layout.size))
    times[:, layout.end] = shares
    return times


def sharp_nodes(profiles, x, shares):
    """Nodes of the exact motion, masks taken from the corner times at x."""
    times = at_shares(profiles.layout, shares)
    since = (times @ x)[:, None, None] - profiles(x).times
    regime = profiles.regime(x[profiles.layout.end])
    masks, late = since >= 0, since - profiles.rise_times[:, None] >= 0
    return Nodes(profiles, times, masks=masks, late=late, regime=regime), since


def exact_states(layout, x, start, goal):
    """Angles, speeds, accelerations of all joints at times, by the commands of these phases."""
    joints = []
    for joint in range(layout.n):
        if joint in layout.joints:
            j = layout.joints.index(joint)
            commands = phases_to_commands(start[joint], x[layout.w(j)], x[layout.d(j)], x[layout.c(j)])
        else:
            commands = [passive_command(start[joint], goal[joint], x[layout.end], SPEED[joint], 1e4)]
        joints.append(JointRamps.from_commands(start[joint], commands))

    def states(times):
        return [np.column_stack(part) for part in zip(*(r.states(times) for r in joints), strict=True)]

    return states


@examples(80)
@given(phases=phases(), way=numbers(-1.5, 1.5), seed=st.integers(0, 10**6))
def test_sharp_states_are_those_of_the_velocity_ramps(phases, way, seed):
    layout, x, goal = with_two_optimised(*phases, passive_way=way)
    profiles = Profiles(layout, START, goal, SPEED)
    nodes, since = sharp_nodes(profiles, x, np.random.default_rng(seed).uniform(0, 1, 40))
    values = nodes.values(x).T
    q, w, a = exact_states(layout, x, START, goal)(nodes.times @ x)
    np.testing.assert_allclose(values[:, :3], q, atol=1e-9)
    np.testing.assert_allclose(values[:, 3:6], w, atol=1e-8)
    inside = np.all(np.abs(since) > 1e-6, axis=(1, 2))
    assert inside.any()
    np.testing.assert_allclose(values[inside, 6:], a[inside], rtol=1e-6, atol=1e-6)


@examples(80)
@given(phases=phases(), way=numbers(-1.5, 1.5), rise=numbers(1e-3, 0.8), seed=st.integers(0, 10**6))
def test_sharp_s_curves_are_those_of_the_joints(phases, way, rise, seed):
    layout, x, goal = with_two_optimised(*phases, passive_way=way)
    rises = np.array([rise, 0.5 * rise, 0.0])
    profiles = Profiles(layout, START, goal, SPEED, rise_times=rises)
    nodes, since = sharp_nodes(profiles, x, np.random.default_rng(seed).uniform(0, 1.3, 40))
    commands = [
        phases_to_commands(START[joint], x[layout.w(j)], x[layout.d(j)], x[layout.c(j)])
        for j, joint in enumerate(layout.joints)
    ]
    commands.insert(1, [passive_command(START[1], goal[1], x[layout.end], SPEED[1], 1e4)])
    motion = Trajectory.from_profiles(START, commands, rises)
    inside = np.all(np.abs(since[:, 2]) > 1e-6, axis=1)  # the third joint's accelerations jump
    states = np.hstack(motion.states(nodes.times @ x))
    found = nodes.values(x).T
    np.testing.assert_allclose(found[:, :6], states[:, :6], atol=1e-7)
    np.testing.assert_allclose(found[inside, 6:], states[inside, 6:], rtol=1e-5, atol=1e-5 + 1e-8 / rise)


def test_corner_times_are_the_sums_of_durations():
    layout, x, goal = seeded(3)
    profiles = Profiles(layout, START, goal, SPEED)
    for j, joint in enumerate(layout.joints):
        d, c = x[layout.d(j)], x[layout.c(j)]
        expected = np.cumsum([0, d[0], c[0], d[1], c[1], d[2], c[2], d[3]])
        found = [profiles.corner_time(joint, k) @ x for k in range(8)]
        np.testing.assert_allclose(found, expected, rtol=1e-14)
        np.testing.assert_allclose(profiles(x).times[joint, :8], expected, rtol=1e-14)


def test_slices_of_the_layout_share_no_variable():
    layout = Layout(6, (0, 2, 5), 4, crossings=2)
    taken = [range(layout.size)[part(j)] for j in range(3) for part in (layout.w, layout.d, layout.c)]
    taken += [[layout.end], [layout.one], range(layout.one + 1, layout.size)]
    assert sorted(i for part in taken for i in part) == list(range(layout.size))
    assert layout.extended(0).size == layout.size - 2


def differences(function, x, step=1e-6):
    """Central differences of a function of x, derivative as last axis."""
    columns = []
    for i in range(len(x)):
        shift = np.zeros(len(x))
        shift[i] = step
        columns.append((function(x + shift) - function(x - shift)) / (2 * step))
    return np.stack(columns, axis=-1)


FORMS = ["sharp", "smooth", "sharp S-curve", "smooth S-curve"]
RISES = np.array([0.25, 0.08, 0.4])
DERIVATIVE_CASES = some(2, [(seed, way) for seed in range(3) for way in (0.8, -2.5)])  # triangles, trapezoids


def forms(seed, way, form):
    """Nodes and x for a form of the steps."""
    layout, x, goal = seeded(seed, way)
    shares = np.random.default_rng(seed).uniform(0.01, 0.99, 25)
    rises = RISES if form.endswith("S-curve") else None
    if form.startswith("sharp"):
        return sharp_nodes(Profiles(layout, START, goal, SPEED, rise_times=rises), x, 1.2 * shares)[0], x
    profiles = Profiles(layout, START, goal, SPEED, rounding=0.05, rise_times=rises)
    return Nodes(profiles, at_shares(layout, shares), half_width=0.1), x


def slopes(states):
    """All slopes (N, S, nx) of states, a unit slope over each of them at a time; two ways."""
    size, count = states.values.shape
    found = np.stack(
        [states.over_all(np.arange(count), np.tile(unit, (count, 1))) for unit in np.eye(size)], axis=1
    )
    for k in range(size):
        every = states.over_all_everywhere(np.repeat(np.eye(size)[:, k : k + 1], count, axis=1))
        np.testing.assert_allclose(every.T, found[:, k], atol=1e-12 * np.max(np.abs(found)))
    return found


def add_second(hessian, x, states, weights):
    """Add the second derivatives of the sum of weights (N, S) times the states."""
    size = len(states.values)
    none = np.zeros((size * (size + 1) // 2, len(weights)))
    states.add_hessian(hessian, x, none, np.ascontiguousarray(weights.T), np.zeros_like(hessian))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("seed", "way"), DERIVATIVE_CASES)
def test_second_derivatives_of_functions_of_the_states(seed, way, form):
    """Of half of s' B s at each node, and of something else that is added."""
    nodes, x = forms(seed, way, form)
    rng, states = np.random.default_rng(seed + 20), nodes.states(x)
    B = rng.normal(size=(25, 9, 9))
    B += B.transpose(0, 2, 1)
    upper = np.array([B[:, r, c] for c in range(9) for r in range(c + 1)])
    other = rng.normal(size=(len(x), len(x)))
    hessian, none = np.zeros_like(other), np.zeros((9, 25))
    states.add_hessian(hessian, x, upper, none, other)
    S = slopes(states)
    expected = np.einsum("nsx,nst,nty->xy", S, B, S) + other + other.T
    np.testing.assert_allclose(hessian, expected, atol=1e-11 * np.max(np.abs(expected)))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("seed", "way"), DERIVATIVE_CASES)
def test_first_derivatives(seed, way, form):
    nodes, x = forms(seed, way, form)
    states = nodes.states(x)
    np.testing.assert_array_equal(states.values, nodes.values(x))
    jacobian = slopes(states)
    reference = differences(lambda z: nodes.values(z).T, x)
    assert np.max(np.abs(jacobian - reference)) < 1e-7 * np.max(np.abs(reference))


@pytest.mark.parametrize("form", some(2, FORMS))
@pytest.mark.parametrize(("seed", "way"), DERIVATIVE_CASES)
def test_second_derivatives(seed, way, form):
    nodes, x = forms(seed, way, form)
    weights = np.random.default_rng(seed + 10).normal(size=(25, 9))
    hessian = np.zeros((len(x), len(x)))
    add_second(hessian, x, nodes.states(x), weights)
    reference = differences(lambda z: np.einsum("ns,nsx->x", weights, slopes(nodes.states(z))), x, step=1e-6)
    assert np.max(np.abs(hessian - reference)) < 1e-6 * np.max(np.abs(reference))
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-10 * np.max(np.abs(hessian)))


@pytest.mark.parametrize("form", some(1, FORMS))
@pytest.mark.parametrize("over", some(1, [SHARE, "", TIME]))
@pytest.mark.parametrize("free", some(1, [*map(pytest.param, [(True, True), (True, False), (False, True)])]))
def test_derivatives_with_free_ends_late_joints_and_a_process_that_varies(form, over, free):
    """The process goes on after the ramps, for the rises; node times depend on all durations."""
    rng = np.random.default_rng(len(form) + len(over) + 2 * free[0] + free[1])
    layout = Layout(3, (0, 2), 2, free=free)
    x, spread = np.zeros(layout.size), np.zeros((20, layout.size))
    for j in (0, 1):
        x[layout.w(j)], x[layout.d(j)] = rng.uniform(-1, 1, 2), rng.uniform(0.2, 0.5, 3)
        x[layout.c(j)] = rng.uniform(0.1, 0.4, 2)
    x[layout.end], x[layout.one] = 2.5, 1.0
    for own in (layout.start, layout.goal):
        x[own] = rng.uniform(-1, 1, own.stop - own.start)
    spread[:, : layout.end], spread[:, layout.end] = rng.uniform(0, 0.05, (20, layout.end)), rng.random(20)
    behind, rises = rng.uniform(0, 0.1, (20, 3)), RISES if form.endswith("S-curve") else None
    sharp = form.startswith("sharp")
    rounding = 0.0 if sharp else 0.05
    profiles = Profiles(layout, START, START + 0.8, SPEED, rounding=rounding, rise_times=rises)
    how = {"behind": behind}
    if over:
        force, moment = rng.normal(size=(2, 4, 3))
        process = ProcessWrench(force, moment, over=over, knots=[0.05, 0.3, 0.7, 1.2])
        end = np.zeros(layout.size)
        end[layout.end], end[layout.one] = 1.0, 0.3
        speeds = rng.normal(size=(3, 3))
        profile = DriveProfile.of_velocities(np.array([0.0, 0.9, 1.9]), speeds) if over == SHARE else None
        how["course"] = ActingCourse.of(Acting(process, profile), end)
    if sharp:
        since = (spread @ x)[:, None, None] - behind[:, :, None] - profiles(x).times
        how |= {"masks": since >= 0, "late": since - profiles.rise_times[:, None] >= 0}
        how["regime"] = profiles.regime(x[layout.end])
    else:
        how["half_width"] = 0.1
    nodes = Nodes(profiles, spread, **how)
    first, size = slopes(nodes.states(x)), 9 + 6 * bool(over) + 9 * (over == SHARE)
    assert first.shape == (20, size, layout.size)
    reference = differences(lambda z: nodes.values(z).T, x)
    assert np.max(np.abs(first - reference)) < 1e-7 * np.max(np.abs(reference))
    weights, hessian = rng.normal(size=(20, size)), np.zeros((len(x), len(x)))
    add_second(hessian, x, nodes.states(x), weights)
    reference = differences(lambda z: np.einsum("ns,nsx->x", weights, slopes(nodes.states(z))), x)
    assert np.max(np.abs(hessian - reference)) < 1e-6 * np.max(np.abs(reference))


def test_slopes_of_a_wrong_size_are_refused():
    nodes, x = forms(0, 0.8, "smooth")
    with pytest.raises(AssertionError):
        nodes.states(x).over_all(np.arange(2), np.ones((2, 3)))


def test_second_derivatives_are_added():
    nodes, x = forms(0, 0.8, "smooth")
    weights = np.ones((25, 9))
    once, twice = np.zeros((len(x), len(x))), np.zeros((len(x), len(x)))
    add_second(once, x, nodes.states(x), weights)
    for _ in range(2):
        add_second(twice, x, nodes.states(x), weights)
    np.testing.assert_allclose(twice, 2 * once)


def smooth_steps(t, half_width):
    """The step's second and first integral, itself, two derivatives, each (N,), at times after a corner."""
    none, one = np.zeros((1, 1, 1)), np.ones((1, 1))
    counts, used = np.zeros(1, int), np.ones(1, int)
    steps = joint_states(
        *(t, np.zeros((0, 0)), none, none, half_width, np.zeros(1), np.zeros(1)),
        *(one, 0 * one, none, none, counts, used, 3, 0),
    )[3]
    return steps[0, 0]


@pytest.mark.parametrize("half_width", [0.004, 0.3])
def test_the_smooth_step_is_the_integral_of_its_slope(half_width):
    t = np.linspace(-1.5, 1.5, 301) * half_width
    h = 1e-5 * half_width
    phi2, phi1, phi0, slope, bend = smooth_steps(t, half_width)
    ahead, behind = (smooth_steps(s, half_width) for s in (t + h, t - h))
    for integral, value, scale in ((0, phi1, half_width), (1, phi0, 1), (2, slope, 1 / half_width)):
        reference = (ahead[integral] - behind[integral]) / (2 * h)
        np.testing.assert_allclose(value, reference, atol=1e-7 * scale)
    np.testing.assert_allclose(bend, (ahead[3] - behind[3]) / (2 * h), atol=2e-3 / half_width**2)
    assert np.all(phi2[t < -half_width] == 0)
    assert np.all(phi1[t < -half_width] == 0)
    behind_step = t > half_width
    np.testing.assert_allclose(phi1[behind_step], t[behind_step], rtol=1e-13)
    np.testing.assert_array_equal(phi0[behind_step], 1.0)


def smooth_and_sharp(seed, half_width, way=0.8):
    """Values of both forms, and how far nodes are from each joint's corners; with the corners."""
    layout, x, goal = seeded(seed, way)
    profiles = Profiles(layout, START, goal, SPEED)
    shares = np.linspace(0, 1.2, 500)
    nodes, since = sharp_nodes(profiles, x, shares)
    smooth = Nodes(profiles, nodes.times, half_width=half_width, regime=nodes.regime)
    used = np.abs(profiles(x).steps) > 0
    away = np.min(np.where(used[None], np.abs(since), np.inf), axis=2)
    return smooth.values(x).T, nodes.values(x).T, away, goal


@pytest.mark.parametrize("seed", some(2, range(4)))
def test_smooth_motion_is_the_sharp_one_outside_its_transitions(seed):
    """Speeds and accelerations are equal, and angles but for acceleration * e^2 / 14 during a ramp."""
    e = 0.04
    smooth, sharp, away, _ = smooth_and_sharp(seed, e)
    clear = away > e
    assert 0.3 < np.mean(clear) < 0.95
    acceleration = sharp[:, 6:]
    np.testing.assert_allclose(smooth[:, 6:][clear], acceleration[clear], atol=1e-11)
    np.testing.assert_allclose(smooth[:, 3:6][clear], sharp[:, 3:6][clear], atol=1e-11)
    shifted = sharp[:, :3] + acceleration * e**2 / 14
    np.testing.assert_allclose(smooth[:, :3][clear], shifted[clear], atol=1e-11)
    assert np.max(np.abs(smooth - sharp)[:, :6]) < 0.25  # within transitions near, but not equal
    assert np.max(np.abs(smooth - sharp)[:, 6:]) > 0.1


@pytest.mark.parametrize("half_width", [0.02, 0.3])
@pytest.mark.parametrize("rise", [0.05, 0.5])
def test_smooth_s_curves_are_means_of_the_smooth_motion(half_width, rise):
    layout, x, goal = seeded(2)
    shares = np.linspace(-0.3, 1.6, 60)
    curves = Nodes(
        Profiles(layout, START, goal, SPEED, rounding=0.05, rise_times=np.full(3, rise)),
        at_shares(layout, shares),
        half_width=half_width,
    )
    profiles = Profiles(layout, START, goal, SPEED, rounding=0.05)
    abscissae, weights = np.polynomial.legendre.leggauss(80)
    means = 0.0
    for share, weight in zip(0.5 * (abscissae + 1), 0.5 * weights, strict=True):
        times = at_shares(layout, shares)
        times[:, layout.one] = -share * rise
        means = means + weight * Nodes(profiles, times, half_width=half_width).values(x)
    np.testing.assert_allclose(curves.values(x), means, atol=2e-4)


@pytest.mark.parametrize("way", [0.8, -2.5])
def test_smooth_motion_ends_at_the_goal(way):
    for seed in range(4):
        smooth, _, _, goal = smooth_and_sharp(seed, 0.04, way)
        np.testing.assert_allclose(smooth[-1, :3], goal, atol=1e-12)
        np.testing.assert_allclose(smooth[-1, 3:], 0, atol=1e-11)


@examples(60)
@given(way=numbers(-3.0, 3.0), slack=numbers(1.0, 4.0))
def test_passive_ramps_are_those_of_the_passive_command(way, slack):
    """Triangle at slow ends, trapezoid at early ones."""
    speed, acceleration = 1.5, 6.0
    end = slack * float(earliest_end(way, speed, acceleration)) + (0.5 if way == 0 else 0.0)
    if abs(way) < 1e-9 or end < 1e-3:
        return
    layout = Layout(1, (), 1)
    x = np.zeros(layout.size)
    x[layout.end], x[layout.one] = end, 1.0
    profiles = Profiles(layout, np.array([0.4]), np.array([0.4 + way]), np.array([speed]))
    ramp = JointRamps.from_commands(0.4, [passive_command(0.4, 0.4 + way, end, speed, acceleration)])
    triangle = 2 * abs(way) <= speed * end
    assert profiles.regime(end) == {0: not triangle}
    corners = profiles(x)
    np.testing.assert_allclose(corners.times[0], ramp.times, atol=1e-8)
    assert ramp.cruises[0] < 1e-8 if triangle else ramp.cruises[0] > 0
    assert corners.steps[0, 0] == pytest.approx(ramp.accelerations[0], rel=1e-7)
    assert corners.steps[0].sum() == pytest.approx(0, abs=1e-12 * abs(corners.steps[0, 0]))


def test_both_regimes_of_a_passive_joint_meet():
    layout = Layout(1, (), 1)
    x = np.zeros(layout.size)
    way, speed = 1.2, 1.5
    x[layout.end], x[layout.one] = 2 * way / speed, 1.0
    profiles = Profiles(layout, np.zeros(1), np.array([way]), np.array([speed]))
    triangle, trapezoid = profiles(x, {0: False}), profiles(x, {0: True})
    np.testing.assert_allclose(triangle.times, trapezoid.times, rtol=1e-14)
    np.testing.assert_allclose(triangle.steps, trapezoid.steps, rtol=1e-14)


@pytest.mark.parametrize("slack", [0.6, 0.95, 1.0, 1.05, 2.0])
def test_the_rounded_rule_is_near_the_exact_one_and_never_faster(slack):
    layout = Layout(1, (), 1)
    x = np.zeros(layout.size)
    way, speed, rounding = 1.2, 1.5, 0.05
    x[layout.end], x[layout.one] = slack * 2 * way / speed, 1.0
    arguments = layout, np.zeros(1), np.array([way]), np.array([speed])
    exact, rounded = Profiles(*arguments)(x), Profiles(*arguments, rounding)(x)
    earlier = exact.times[0, 1] - rounded.times[0, 1]
    assert 0 < earlier <= rounding / 2 + 1e-15
    peak = rounded.steps[0, 0] * rounded.times[0, 1]
    assert peak <= speed
    assert peak * (rounded.times[0, 3] - rounded.times[0, 1]) == pytest.approx(way)


def test_a_joint_with_nowhere_to_go_rests():
    layout, x, goal = seeded(1, passive_way=0.0)
    profiles = Profiles(layout, START, goal, SPEED)
    assert profiles.passive_joints == []
    values = sharp_nodes(profiles, x, np.linspace(0, 1, 20))[0].values(x).T
    np.testing.assert_array_equal(values[:, 1], START[1])
    np.testing.assert_array_equal(values[:, [4, 7]], 0)
