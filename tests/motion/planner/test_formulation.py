"""Order of events, merging, and how near the smooth programs come to the exact energy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.motion.planner.event_order import SLOWEST, order_of
from ocptip.motion.planner.formulation import Formulation, Smoothing
from ocptip.motion.planner.random_start import random_start
from ocptip.published.tasks import experiment_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from ocptip.trajectories.velocity_profiles import earliest_end
from tests.quick import examples, some

TASKS = {name: experiment_task(name, "effective") for name in ("A", "D")}
FORMULATIONS = {
    name: Formulation(task.robot, task.start, task.goal, task.optimised, task.commands)
    for name, task in TASKS.items()
}
SEEDS = st.integers(0, 10**6)
NAMES = st.sampled_from(sorted(TASKS))


def drawn(name, seed):
    """A random motion of a task: formulation, motion, its variables; no ramps too short for variables."""
    task, formulation = TASKS[name], FORMULATIONS[name]
    rng = np.random.default_rng(seed)
    shortest = 0.0
    while shortest <= 1e-3:
        motion = random_start(
            task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng
        )
        shortest = min(np.min(motion.joints[joint].ramps) for joint in task.optimised)
    x = formulation.variables(motion)
    return formulation, formulation.motion(x), x  # once around: a slowed-down start has other passive ramps


@examples(25)
@given(name=NAMES, seed=SEEDS)
def test_variables_and_motion_are_inverse(name, seed):
    formulation, motion, x = drawn(name, seed)
    np.testing.assert_allclose(formulation.variables(motion), x, atol=1e-9)
    again = formulation.motion(x)
    np.testing.assert_array_equal(again.goal, formulation.goal)
    times = np.linspace(0, motion.end, 50)
    for a, b in zip(motion.states(times)[:2], again.states(times)[:2], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)


def test_joints_with_fewer_commands_have_variables_too():
    """Such as one that rests; what is left of its commands does nothing."""
    task, formulation = TASKS["A"], FORMULATIONS["A"]
    goal = task.goal.copy()
    goal[0] = task.start[0]
    motion = Trajectory.from_profiles(task.start, [[RampCommand(angle, 0.5, 0.5)] for angle in goal])
    x, layout = formulation.variables(motion), formulation.layout
    for j, joint in enumerate(task.optimised):
        w, d, c = x[layout.w(j)], x[layout.d(j)], x[layout.c(j)]
        before = np.append(0.0, w[:-1])
        way = 0.5 * (before + w) @ d[:-1] + w @ c + 0.5 * w[-1] * d[-1]
        assert way == pytest.approx(goal[joint] - task.start[joint], abs=1e-12)
        assert np.all(d >= 1e-3)


@examples(25)
@given(name=NAMES, seed=SEEDS)
def test_order_has_all_events_sorted(name, seed):
    formulation, motion, x = drawn(name, seed)
    order, x = order_of(formulation, x)
    assert all(abs((order.times[a] - order.times[b]) @ x) < 1e-12 for a, b in order.equalities)
    layout = formulation.layout
    names = [name for group in order.groups for name in group]
    assert sorted(names) == sorted(order.times)
    expected = {f"{j + 1}.{k}" for j in layout.joints for k in range(1, 2 * layout.commands + 2)}
    crossings = {name for name in names if ".x" in name}
    assert expected | {"start", "end"} <= set(names)
    assert names[0] == "start"
    assert "end" in order.groups[-1]
    assert len(crossings) == len(motion.crossings) == order.layout.crossings
    times = order.rows @ x
    assert times[0] == 0
    assert times[-1] == pytest.approx(motion.end, abs=1e-12)
    assert np.all(np.diff(times) >= -1e-12)
    # each event of the motion is one of these, and the other way round
    for ones, others in ((times, motion.event_times), (motion.event_times, times)):
        assert np.max(np.min(np.abs(ones[:, None] - others), axis=1)) < 2e-9
    np.testing.assert_allclose(np.sort([order.times[c] @ x for c in crossings]), motion.crossings, atol=1e-12)


@pytest.mark.slow
@examples(25)
@given(name=NAMES, seed=SEEDS)
def test_directions_are_the_signs_of_the_speeds(name, seed):
    formulation, motion, x = drawn(name, seed)
    order, x = order_of(formulation, x)
    times = order.rows @ x
    inside = np.flatnonzero(np.diff(times) > 1e-6)
    middles = 0.5 * (times[inside] + times[inside + 1])
    speeds = motion.states(middles)[1]
    moving = np.abs(speeds) > 1e-6
    np.testing.assert_array_equal(order.directions[inside][moving], np.sign(speeds[moving]))


@pytest.mark.slow
@examples(25)
@given(name=NAMES, seed=SEEDS)
def test_corner_positions_are_those_of_the_times(name, seed):
    formulation, motion, x = drawn(name, seed)
    order, x = order_of(formulation, x)
    times = order.rows @ x
    for joint in order.layout.joints:
        used = order.corner_positions[joint, : 2 * order.layout.commands + 2]
        np.testing.assert_allclose(times[used], motion.joints[joint].times, atol=1e-9)
    for joint in set(range(6)) - set(order.layout.joints):
        if motion.joints[joint].end > 0:
            np.testing.assert_allclose(
                times[order.corner_positions[joint, :4]], motion.joints[joint].times, atol=1e-8
            )


@pytest.mark.slow
@examples(25)
@given(name=NAMES, seed=SEEDS, merge=st.sampled_from([0.01, 0.05, 0.2]))
def test_merged_events_are_near_each_other_and_of_different_joints(name, seed, merge):
    formulation, _, x = drawn(name, seed)
    single, _ = order_of(formulation, x)
    order, x = order_of(formulation, x, merge)
    assert len(order.groups) <= len(single.groups)
    assert sorted(n for g in order.groups for n in g) == sorted(n for g in single.groups for n in g)
    assert order.groups[0] == ("start",)
    assert "end" in order.groups[-1]
    assert order.groups[-1][0] == "end"
    for group in order.groups:
        times = np.array([order.times[name] @ x for name in group])
        assert np.ptp(times) < merge
        by_joint = {}
        for name in group:
            joint, corner = name.partition(".")[::2]
            by_joint.setdefault(joint, set()).add(corner)
        last = 2 * order.layout.commands
        for corners in by_joint.values():
            assert len(corners) == 1 or corners in ({"1", "2"}, {str(last - 1), str(last)})
    firsts = [order.times[group[0]] for group in order.groups]
    np.testing.assert_array_equal(order.rows, firsts)
    tied = sum(len(group) - 1 for group in order.groups)
    assert len(order.equalities) == tied


def test_events_do_merge():
    formulation, _, x = drawn("A", 1)
    assert max(len(group) for group in order_of(formulation, x, 0.2)[0].groups) > 1


def test_speeds_near_zero_get_a_sign():
    """A command that all but rests gets the direction it came with, at a speed the drive can have."""
    formulation, _, x = drawn("A", 1)
    layout = formulation.layout
    x[layout.w(1)] = [0.4, 0.0, -1e-9]
    order, moved = order_of(formulation, x)
    np.testing.assert_array_equal(order.speed_signs[1], [1, 1, -1])
    w = moved[order.layout.w(1)]
    assert w[0] == 0.4
    assert np.all(np.abs(w[1:]) >= SLOWEST)
    assert "2.x2" in order.times
    assert x[layout.w(1)][1] == 0.0  # the argument is left as it was


def test_passive_joints_limit_the_end():
    task, formulation = TASKS["A"], FORMULATIONS["A"]
    arm = task.robot.arm.limits
    way = task.goal - task.start
    ends = [float(earliest_end(way[j], arm.speed[j], arm.acceleration[j])) for j in (3, 4, 5)]
    assert formulation.earliest == max(ends)
    _, motion, x = drawn("A", 2)
    order, x = order_of(formulation, x)
    structure = formulation.ordered_program(task.limits, order, x, []).structure
    assert structure.x_lower[formulation.layout.end] >= formulation.earliest
    assert (
        structure.x_lower[formulation.layout.end] <= motion.end <= structure.x_upper[formulation.layout.end]
    )


def test_phases_without_commands_are_refused():
    formulation, _, x = drawn("A", 3)
    x[formulation.layout.d(0).stop - 1] *= 1.5  # the drive brakes with the last ramp's acceleration
    with pytest.raises(InputError, match="braking"):
        formulation.motion(x)


def test_a_joint_without_way_may_rest():
    """Start and goal equal in an optimised joint: phases of next to no speed become one command."""
    task = TASKS["A"]
    goal = task.goal.copy()
    goal[1] = task.start[1]
    formulation = Formulation(task.robot, task.start, goal, task.optimised, 1)
    commands = [[RampCommand(phi, 0.5, 1.0)] for phi in goal]
    x = formulation.variables(Trajectory.from_profiles(task.start, commands))
    motion = formulation.motion(x)
    assert motion.joints[1].end == 0
    assert len(motion.joints[1].commands) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TASKS))
def test_smooth_energies_are_near_the_exact_one(name):
    """Printed solution and random motions: coarse within 2 %, fine within 1 %."""
    task, formulation = TASKS[name], FORMULATIONS[name]
    for seed in range(5):
        motion = drawn(name, seed)[1] if seed else task.reference
        x = formulation.variables(motion)
        exact = task.robot.energy(motion)
        coarse = formulation.coarse_program(task.limits, motion.end)
        assert coarse.energy(x) == pytest.approx(exact, rel=0.02)
        for width in (0.010, 0.004):
            smoothing = Smoothing(width, 3 * width, 1.5 * width, 2.0)
            fine = formulation.fine_program(task.limits, smoothing, x)
            assert fine.energy(x) == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("seed", some(2, range(4)))
def test_nodes_of_all_programs_cover_the_motion(seed):
    formulation, motion, x = drawn("A", seed)
    limits = TASKS["A"].limits
    order, crossed = order_of(formulation, x)
    programs = [
        (formulation.coarse_program(limits, motion.end), x),
        (formulation.fine_program(limits, Smoothing(0.01, 0.03, 0.015, 2.0), x), x),
        (formulation.ordered_program(limits, order, crossed, []), crossed),
    ]
    for program, z in programs:
        times, weights = program.nodes.times @ z, program.weights @ z
        assert weights.sum() == pytest.approx(motion.end, rel=1e-12)
        assert weights @ times == pytest.approx(motion.end**2 / 2, rel=1e-9)  # a line is integrated exactly
        assert np.all(weights >= -1e-12)
        assert np.all((times >= 0) & (times <= motion.end + 1e-12))
        assert np.all(np.diff(times) >= -1e-12)


def test_further_nodes_carry_no_weight_and_stand_where_they_should():
    formulation, _, x = drawn("A", 1)
    order, x = order_of(formulation, x)
    extra = [(0, 0.0), (3, 0.25), (len(order.rows) - 2, 1.0)]
    program = formulation.ordered_program(TASKS["A"].limits, order, x, extra)
    events = order.rows @ x
    expected = [events[i] + s * (events[i + 1] - events[i]) for i, s in extra]
    np.testing.assert_allclose((program.nodes.times @ x)[-3:], expected, rtol=1e-12)
    np.testing.assert_array_equal(program.weights[-3:], 0)
    own = formulation.ordered_program(TASKS["A"].limits, order, x, [])
    assert program.n_nodes == own.n_nodes + 3
    assert program.energy(x) == own.energy(x)
