"""Motions at the worst of a tolerance: no sample is worse, and the named worst is attained."""

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.certificate.describe import motion_data
from ocptip.certificate.trusted.forms import K
from ocptip.certificate.trusted.late import Late
from ocptip.motion.check import check_motion
from ocptip.motion.multi_start import tolerable, too_much
from ocptip.published.tasks import experiment_task
from ocptip.reserves import fractional
from ocptip.reserves.tipping import TipMap
from ocptip.standing.limits import Limits
from ocptip.standing.objects import Object
from ocptip.standing.tolerance import SITE, WORKSHOP, Uncertainty
from ocptip.standing.within.in_motion import worst_within
from ocptip.standing.within.late_joints import jump_states, on_time
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.tolerance.samples import sampled_wrenches
from tests.places import EXAMPLES
from tests.quick import some


@pytest.fixture(scope="module")
def task():
    return experiment_task("B", "effective")


def slow(task, factor):
    limits = task.robot.limits
    rates = limits.speed / factor, limits.acceleration / factor**2
    return Trajectory.ending_together(task.start, task.goal, [None] * task.robot.n, *rates)


@pytest.mark.parametrize("factor", some(1, [1.6, 3.0]))
def test_no_sample_is_worse_than_the_worst_case(task, factor):
    robot, motion = task.robot, slow(task, factor)
    checked = check_motion(robot, motion, dataclasses.replace(task.limits, tolerance=WORKSHOP))
    within, cases = checked.within, worst_case_of(robot, WORKSHOP)
    wrenches = sampled_wrenches(robot, motion, WORKSHOP, np.random.default_rng(0), 4000)
    states = cases.footing.contact_states(wrenches)
    moments = TipMap(cases.footing.tip_over)(wrenches)[0]
    least = float(cases.tip_ratio(moments.min()))
    assert least <= within.tip.bound + 1e-3  # of delays inside the window, up to their second order
    assert within.tip.value <= within.tip.bound
    assert within.tip.bound - within.tip.value < 0.01 * within.tip.value
    assert least > checked.worst["GN"].value  # samples find something
    if within.tip.bound < 1:
        GT = cases.footing.slip.evaluate(states, derivatives=False).GT
        assert GT.max() <= within.slip.value + 1e-3
        assert states.persistent.all()


def forces_of_three_feet(support, wrenches):
    """Normal forces (N, 3) by equilibrium, N, of contacts on a horizontal plane: no contact solver."""
    arms = np.array([contact.position for contact in support.contacts]) - support.center_of_mass
    (height,) = np.unique(np.round(arms[:, 2], 9))
    fx, fy, fz, mx, my, _ = wrenches.T
    balance = np.array([np.ones(3), arms[:, 1], -arms[:, 0]])
    return np.linalg.solve(balance, -np.stack([fz, mx + height * fy, my - height * fx])).T


@pytest.mark.slow
@pytest.mark.parametrize("case", some(1, ["C", "A"]))
def test_three_feet_have_a_minimum_force_in_the_worst_case(case):
    """C stands on a clamp, which lets go where it would have to pull more than it holds."""
    task = experiment_task(case, "effective")
    robot, motion = task.robot, slow(task, 3.0)
    within = worst_within(robot, motion, WORKSHOP, np.linspace(0.0, motion.end, 60))
    found, cases = within.foot_force, worst_case_of(robot, WORKSHOP)
    lets_go = np.array([min(p.normal_min for p in c.force_pieces()) for c in robot.support.contacts])
    wrenches = sampled_wrenches(robot, motion, WORKSHOP, np.random.default_rng(0), 6000)
    sampled = (forces_of_three_feet(robot.support, wrenches) - lets_go).min()
    assert found.value - 1e-3 <= sampled < found.value + 2.0
    (foot,), acting = found.contacts, robot.during(motion)
    at = on_time(motion, WORKSHOP, np.array([found.time]), acting)
    at = at.joined(jump_states(motion, WORKSHOP, cases, acting))
    at = at.some(np.flatnonzero(np.abs(at.times - found.time) < 1e-9))
    extremes = cases.deviations.least(np.random.default_rng(1).normal(size=(500, cases.deviations.size)))
    forces = forces_of_three_feet(
        robot.support, cases.deviations.wrench(np.tile(at.s[:1], (500, 1)), extremes)[0]
    )
    assert forces[:, foot - 1].min() - lets_go[foot - 1] >= found.value - 1e-3
    axis = int(np.flatnonzero(robot.tip_over.lifts[:, foot - 1])[0])
    theta = cases.moments(at.s, np.full(len(at.s), axis), max_delay=at.max_delay).theta
    attained = forces_of_three_feet(robot.support, cases.deviations.wrench(at.s, theta)[0])[:, foot - 1]
    assert attained.min() - lets_go[foot - 1] == pytest.approx(found.value, abs=1e-6)


@pytest.mark.slow
def test_how_much_of_a_tolerance_a_motion_can_have(task):
    motion, tolerance = slow(task, 2.0), Uncertainty(tilt=np.radians(3.0), friction=0.2, damping=0.05)
    limits = dataclasses.replace(task.limits, tolerance=tolerance)
    share = tolerable(task.robot, motion, limits)
    alone, factor, why = too_much(task.robot, motion, limits)
    assert 0.1 < share < 0.9
    assert (alone, share < factor) == (Uncertainty(tilt=tolerance.tilt), True)
    assert why.startswith("floor tilt 3 deg alone is too much, possible is floor tilt ")
    for factor, kept in ((share - 0.03, True), (share + 0.05, False)):
        scaled = dataclasses.replace(limits, tolerance=tolerance.scaled(factor))
        worst = check_motion(task.robot, motion, scaled).worst.values()
        assert all(own.excess <= 0 for own in worst if own.name.endswith("_worst_case")) == kept


@pytest.mark.slow
def test_motions_with_objects_keep_a_small_tolerance_as_a_whole():
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    up = {"rotation": np.diag([1.0, -1.0, -1.0]), "position": (0.1, 0.0, -0.05)}
    robot = task.robot.carrying([Object.box("tall", 0.5, (0.06, 0.06, 0.18), friction=0.9, **up)])
    ramps = [(RampCommand(0.001, 0.05, 0.05),), *[(RampCommand(q, 1.0, 1.0),) for q in task.start[1:]]]
    limits = dataclasses.replace(task.limits, tolerance=Uncertainty(tilt=np.radians(1.0)))
    assert tolerable(robot, Trajectory.from_profiles(task.start, ramps), limits) == 1.0


@pytest.mark.slow
def test_verified_only_if_the_worst_case_is(task):
    motion = slow(task, 3.0)
    loose = dataclasses.replace(task.limits, tolerance=Uncertainty(tilt=np.radians(0.5)))
    assert check_motion(task.robot, motion, task.limits).verified
    assert check_motion(task.robot, motion, loose).verified
    strict = dataclasses.replace(task.limits, tolerance=SITE)
    checked = check_motion(task.robot, motion, strict)
    assert not checked.verified
    assert any(broken.name == "GN_worst_case" for broken in checked.violations)
    assert "tilt 1.5 deg towards" in checked.within.tip.how
    assert checked.to_dict()["within_tolerance"]["tolerance"]["push"] == 20
    assert "contact" in checked.within.tip.left


def test_jumps_overshoot_together_if_nothing_is_late(task):
    motion = slow(task, 2.0)
    found = jump_states(motion, Uncertainty(damping=0.05))
    assert len(found.times) == len(motion.event_times)
    start = found.s[np.argmin(found.times), 12:]
    acceleration = motion.states(np.array([1e-4]))[2][0]
    assert np.allclose(start, (1 + np.exp(-np.pi * 0.05 / np.sqrt(1 - 0.05**2))) * acceleration)
    assert jump_states(motion, Uncertainty(tilt=0.01)).s.shape == (0, 18)
    assert not on_time(motion, Uncertainty(damping=0.05), found.times).max_delay.any()
    assert not on_time(motion, Uncertainty(damping=0.05), found.times).max_delay.any()
    assert not on_time(motion, Uncertainty(damping=0.05), found.times).max_delay.any()


def test_late_joints_are_combined_in_all_ways(task):
    motion = slow(task, 2.0)
    found = jump_states(motion, Uncertainty(delay=0.01))
    first = found.s[found.times == 0.0, 12:]
    moving = np.flatnonzero(motion.states(np.array([1e-4]))[2][0])
    assert len(first) == 2 ** len(moving)
    assert len(np.unique(first, axis=0)) == len(first)
    assert "delayed" in found.words[0]


# C on its effective base, planned: joint 1 jumps twice within 4 ms (phi_e, speed, acceleration)
CLOSE = (
    ((1.063572394, 2.617976236, 3.802761455), (2.752244625, 2.612391551, 1.439386596),
     (1.569159277, 2.617823035, 2.897254065)),
    ((0.615407066, 0.005007178, 0.050813831), (0.567141118, 0.150812919, 1.523038299),
     (0.526421450, 0.272572356, 1.418380153)),
    ((-0.350685167, 0.039398056, 0.050008860), (-0.142233253, 1.004390580, 10.463802706),
     (-0.142213985, 0.416666577, 10.459621767)),
    ((0.780501537, 2.356194490, 0.004915190),),
    ((0.319572729, 3.769911184, 0.971046382),),
    ((0.004088808, 5.934119457, 3.147725267),),
)  # fmt: skip


@pytest.fixture(scope="module")
def close_jumps():
    task = experiment_task("C", "effective")
    commands = [[RampCommand(*numbers) for numbers in own] for own in CLOSE]
    return task.robot, Trajectory.from_profiles(task.start, commands)


def test_the_last_of_two_near_jumps_overshoots_alone(close_jumps):
    """At 1.0108 s joint 1 overshoots its second step, joints 2 and 3 are 4 ms late and overshoot: C tips."""
    robot, motion = close_jumps
    events, cases = motion.event_times, worst_case_of(robot, WORKSHOP)
    at = [float(events[np.argmin(np.abs(events - t))]) for t in (1.010778, 1.006898, 1.006941)]
    state = np.hstack(motion.states([at[0] + 1e-6]))[0]
    for j, event in enumerate(at):
        before, after = (np.hstack(motion.states([event + side]))[0, j::6] for side in (-1e-6, 1e-6))
        state[j::6] = after + np.array([0, 0, WORKSHOP.overshoot]) * (after - before)
    s, max_delay = np.tile(state, (cases.axes, 1)), np.zeros((cases.axes, 6))
    least = cases.moments(s, np.arange(cases.axes), max_delay=max_delay).values.min()
    assert -0.03 < least < 0
    found = worst_within(robot, motion, WORKSHOP, motion.both_sides(0.01))
    assert found.tip.value >= float(cases.tip_ratio(least)) > 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(1, range(4)))
def test_no_admissible_delays_are_worse_than_the_check_says(close_jumps, seed):
    """Random motions with jumps close together; every joint late and overshooting by itself."""
    robot, motion = close_jumps
    rng = np.random.default_rng(seed)
    if seed:
        way, middle = rng.uniform(0.5, 1.0, 6) * rng.choice([-1, 1], 6), 0.5 + rng.uniform(-0.02, 0.02, 6)
        turns = [
            [RampCommand(a + share * x, 1.0, 2.0), RampCommand(a + x, 1.0, 2.0)]
            for a, x, share in zip(motion.start, way, middle, strict=True)
        ]
        motion = Trajectory.from_profiles(motion.start, turns)
    tolerance = dataclasses.replace(WORKSHOP, delay=float(rng.choice([0.004, 0.02])))
    cases = worst_case_of(robot, tolerance)
    found = worst_within(robot, motion, tolerance, motion.both_sides(0.005))
    wrenches = sampled_wrenches(robot, motion, tolerance, rng, 5000)
    least = TipMap(cases.footing.tip_over)(wrenches)[0].min()
    assert float(cases.tip_ratio(least)) <= found.tip.bound * (1 + 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("delay", some(1, [0.01, 0.003]))
def test_the_check_looks_at_what_certificates_are_about(close_jumps, delay):
    """Joint by joint the ends of its stretches are those of the branches that a certificate encloses."""
    robot, motion = close_jumps
    n, tolerance = robot.n, dataclasses.replace(WORKSHOP, delay=delay)
    late = Late(motion_data(motion), delay * (1 + tolerance.speed), tolerance.overshoot)
    found, most = jump_states(motion, tolerance), 0
    for t in np.unique(found.times):
        own = found.some(np.flatnonzero(found.times == t))
        inside, steps, smooth = (part[0] for part in late._changes(np.array([t]), np.array([t + 1e-7])))
        for j in range(n):
            branches = late._branches(j, t, t + 1e-7, inside, steps[:, j], smooth[j])
            most = max(most, len(branches))
            forms = [form.c for form in late._states(branches)]
            proved = [np.array([c[0] + side * c[K] + c[K + 2] for c in forms]).T for side in (-1, 1)]
            state, max_delay = own.s[:, j::n], own.max_delay[:, j, None]
            early = state - max_delay * np.column_stack([state[:, 1:], np.zeros(len(state))])
            early[:, :1] += max_delay**2 / 2 * state[:, 2:]
            apart = np.abs(np.vstack([early, state])[:, None] - np.vstack(proved)[None]).max(axis=2)
            assert apart.min(axis=1).max() < 1e-4
            just = branches[-1].low[0] > t - 1e-6  # between having jumped not yet, and overshooting
            kept = [k for k in range(2 * len(branches)) if not just or k % len(branches) < len(branches) - 1]
            assert apart[:, kept].min(axis=0).max() < 1e-4
    assert most > 3


def test_late_s_curves_are_no_worse_than_the_states_that_are_looked_at(task):
    """Random delays of all joints at random instants: moments about the tipping axes, which are affine."""
    delay, robot = 0.015, task.robot
    motion = slow(task, 1.3).with_rise_times(0.04)
    found = jump_states(motion, Uncertainty(delay=delay))
    assert any("delayed" in words for words in found.words)
    rng = np.random.default_rng(4)
    times = rng.uniform(0, motion.end + delay, 4000)
    late = np.where(
        rng.random((4000, 6)) < 0.5, rng.choice([0.0, delay], (4000, 6)), rng.uniform(0, delay, (4000, 6))
    )
    states = [np.empty((4000, 6)) for _ in range(3)]
    for j in range(6):
        for state, own in zip(states, motion.states(times - late[:, j]), strict=True):
            state[:, j] = own[:, j]

    def moments(q, qd, qdd):
        return TipMap(robot.tip_over)(robot.loads(q, qd, qdd)[1])[0]

    looked, on_time = moments(*np.hsplit(found.s, 3)), moments(*motion.states(times))
    least = np.minimum(looked.min(axis=0), on_time.min(axis=0))
    reference = robot.tip_over.reference_moment
    # angles and speeds of late joints are looked at elsewhere
    assert np.all(moments(*states).min(axis=0) > least - 0.01 * reference)
    then = moments(*motion.states(found.times))
    assert np.all((then - looked).max(axis=0) > 0.1 * reference)


def test_parallel_robots_are_refused():
    task = load_task(EXAMPLES / "tasks" / "delta_cart.toml")
    with pytest.raises(InputError, match="tolerance: parallel robots have only damping"):
        worst_case_of(task.robot, WORKSHOP)


def test_limits_say_what_is_asked_of_the_worst_case():
    limits = Limits(tolerance=WORKSHOP)
    assert limits.to_dict()["GN_worst_case"] == 0.999
    assert limits.to_dict()["tolerance"]["speed"] == 0.03
    assert "tolerance" not in Limits().to_dict()


@pytest.mark.slow
def test_half_spaces_tell_of_postures_what_the_search_for_the_worst_slip_finds():
    """On four feet; where they say that GT is kept, no search finds more, and they say it of most."""
    task = load_task(EXAMPLES / "tasks" / "ur5_sander.toml")
    q = np.random.default_rng(4).uniform(-1.5, 1.5, (6, 6)) * [1, 0.5, 1, 1, 1, 1] - [0, 1.2, 0, 0, 0, 0]
    s = np.hstack([q, np.zeros((6, 12))])
    cases = worst_case_of(task.robot, Uncertainty(arm_mass=0.05, friction=0.2, tilt=0.01, push=5.0))
    worst = cases.slip(s, starts=3).values
    for GT in (0.9 * worst.min(), np.median(worst), 1.1 * worst.max()):
        told = np.array([cases.keeps_slip(s[k : k + 1], GT) for k in range(len(s))])
        assert np.all(worst[told] <= GT)
        assert np.all(told[worst < 0.95 * GT])
    assert not cases.keeps_slip(s, np.median(worst))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "factor", "seed"), some(1, [("B", 1.3, 0), ("E", 1.6, 1)]))
def test_joints_of_s_curves_are_late_between_events_too(name, factor, seed):
    """Random combinations of late joints at random instants are no worse than what is found."""
    task, tolerance = experiment_task(name, "effective"), dataclasses.replace(WORKSHOP, damping=None)
    motion = task.reference.time_scaled(factor).with_rise_times(0.2)
    found = worst_within(task.robot, motion, tolerance, motion.both_sides(0.02))
    rng, count = np.random.default_rng(seed), 20_000
    late = rng.choice([0.0, 0.5 * tolerance.late, tolerance.late], size=(count, motion.n), p=[0.4, 0.2, 0.4])
    times = rng.uniform(0, motion.end + tolerance.late, count)
    s = np.empty((count, 3 * motion.n))
    for j in range(motion.n):
        s[:, j :: motion.n] = np.stack([part[:, j] for part in motion.states(times - late[:, j])], axis=1)
    cases = worst_case_of(task.robot, dataclasses.replace(tolerance, delay=0.0))
    least = float(cases.estimated_moments(s).min())
    worst = float(cases.tip_ratio(np.array(least)))
    assert worst < found.tip.bound + 5e-3
    assert worst > found.tip.value - 0.1  # and it comes near


def test_the_greatest_slips_are_those_of_all_states():
    """Of four feet, whose normal forces are redistributed: what half spaces leave out is less."""
    robot = load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot
    rates = robot.limits.speed / 2, robot.limits.acceleration / 4
    motion = Trajectory.ending_together(np.zeros(6), np.full(6, 0.8), [None] * 6, *rates)
    cases, late = worst_case_of(robot, WORKSHOP), np.full((1, robot.n), WORKSHOP.delay)
    states = on_time(motion, WORKSHOP, np.linspace(0, motion.end, 60), robot).s
    max_delay = np.tile(late, (len(states), 1))
    found, every = cases.greatest_slips(states, max_delay), cases.slip(states, max_delay=max_delay).values
    assert np.argmax(found) == np.argmax(every)
    assert every.max() < 1
    large = every > 0.95 * every.max()
    assert large.sum() < 0.8 * len(states)
    np.testing.assert_allclose(found[large], every[large], rtol=2e-3)
    assert np.all(found[~large] <= 0.95 * every.max())
    assert np.all(every >= cases.estimated_slip(states, max_delay) * (1 - 2e-3))


def test_slip_at_the_worst_costs_programs_only_where_it_is_large(monkeypatch):
    """Elsewhere half spaces bound it."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    robot, motion = task.robot, slow(task, 3.0)
    cases, times = worst_case_of(robot, WORKSHOP), motion.both_sides(0.01)
    at = on_time(motion, WORKSHOP, times, robot.during(motion))
    programs = []
    solve = fractional.largest_growth
    monkeypatch.setattr(
        fractional, "largest_growth", lambda A, *loads: programs.append(len(A)) or solve(A, *loads)
    )
    exact = cases.slip(at.s, max_delay=at.max_delay)
    all_programs = sum(programs)
    programs.clear()
    found = cases.greatest_slips(at.s, at.max_delay)
    assert sum(programs) < 0.5 * all_programs
    large = exact.values > 0.97 * exact.values.max()
    np.testing.assert_allclose(found[large], exact.values[large], rtol=5e-3)
    assert np.argmax(found) == np.argmax(exact.values)
    assert np.all(found[~large] <= exact.values.max())
