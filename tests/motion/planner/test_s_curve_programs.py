"""Programs of S-curves: order of the doubled events, states, energy, derivatives, and whole plans."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.motion.check import check_motion
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.exact import Refiner
from ocptip.motion.planner.formulation import Formulation, Smoothing
from ocptip.motion.planner.one_start import Search
from ocptip.motion.planner.random_start import random_start
from ocptip.motion.task import refusals
from ocptip.published.tasks import experiment_task
from tests.quick import examples, some

TASK = experiment_task("B")
RISES = {
    "one": np.full(6, 0.06),
    "long": np.full(6, 0.5),
    "each": np.array([0.02, 0.05, 0.0, 0.03, 0.07, 0.01]),
}
SEEDS = st.integers(0, 10**6)
KINDS = st.sampled_from(sorted(RISES))


OWN = TASK.robot, TASK.start, TASK.goal, TASK.optimised, TASK.commands


@cache
def formulation_of(kind):
    return Formulation(*OWN, rise_times=RISES[kind])


def drawn(seed, kind):
    """Formulation, a random S-curve motion, its variables."""
    formulation = formulation_of(kind)
    rng, shortest = np.random.default_rng(seed), 0.0
    while shortest <= 1e-3:
        motion = random_start(*OWN, TASK.limits, rng)
        shortest = min(np.min(motion.joints[joint].ramps) for joint in TASK.optimised)
    x = formulation.variables(motion)
    return formulation, formulation.motion(x), x


@pytest.mark.slow
@examples(8)
@given(seed=SEEDS, kind=KINDS)
def test_order_has_all_events_of_the_motion(seed, kind):
    formulation, motion, x = drawn(seed, kind)
    np.testing.assert_allclose(formulation.variables(motion), x, atol=1e-9)
    order, x = order_of(formulation, x)
    times = order.rows @ x
    assert times[0] == 0
    assert times[-1] == pytest.approx(motion.end, abs=1e-12)
    assert np.all(np.diff(times) >= -1e-12)
    for instants, others in ((times, motion.event_times), (motion.event_times, times)):
        assert np.max(np.min(np.abs(instants[:, None] - others), axis=1)) < 2e-7
    crossings = [times[group] for _, group in order.crossings]
    np.testing.assert_allclose(np.sort(crossings), motion.crossings, atol=1e-9)
    np.testing.assert_allclose(crossings, x[order.layout.one + 1 :], atol=1e-12)
    assert np.all(order.steps @ x >= -1e-12)
    for joint, ramps in enumerate(motion.joints):
        used = 2 * TASK.commands + 2 if joint in TASK.optimised else 4
        for places, late in ((order.corner_positions, 0.0), (order.late_positions, RISES[kind][joint])):
            if ramps.end > 0:
                np.testing.assert_allclose(times[places[joint, :used]], ramps.times + late, atol=1e-8)


@pytest.mark.slow
@examples(8)
@given(seed=SEEDS, kind=KINDS)
def test_directions_are_the_signs_of_the_speeds(seed, kind):
    formulation, motion, x = drawn(seed, kind)
    order, x = order_of(formulation, x)
    times = order.rows @ x
    inside = np.flatnonzero(np.diff(times) > 1e-6)
    speeds = motion.states(0.5 * (times[inside] + times[inside + 1]))[1]
    moving = np.abs(speeds) > 1e-6
    np.testing.assert_array_equal(order.directions[inside][moving], np.sign(speeds[moving]))


@pytest.mark.parametrize("merge", some(1, [0.004, 0.0]))
@pytest.mark.parametrize("kind", sorted(RISES))
@pytest.mark.parametrize("seed", some(1, [1, 4]))
def test_the_exact_program_is_the_motion_at_its_nodes(seed, kind, merge):
    formulation, motion, x = drawn(seed, kind)
    order, x = order_of(formulation, x, merge)
    program = formulation.ordered_program(TASK.limits, order, x, [(1, 0.5)])
    if merge:
        x = formulation.polished(order, program.structure, x)
        motion = formulation.motion(x)
        assert np.all(order.steps @ x > -1e-9)
        program = formulation.ordered_program(TASK.limits, order, x, [(1, 0.5)])
    structure = program.structure
    values, equal = structure.rows(x)[0], structure.lower == structure.upper
    assert np.max(np.abs(values[equal])) < 1e-8
    count = len(order.steps)
    np.testing.assert_allclose(values[-count:], order.steps @ x, atol=1e-15)
    assert len(np.unique(structure.rows(x)[1][-count:], axis=0)) == count
    times = program.nodes.times @ x
    states = np.hstack(motion.states(times))
    found = program.nodes.values(x).T
    away = np.min(np.abs(times[:, None] - motion.event_times), axis=1) > 1e-6
    np.testing.assert_allclose(found[:, :12], states[:, :12], atol=1e-6)
    np.testing.assert_allclose(found[away, 12:], states[away, 12:], atol=1e-4)
    assert program.weights @ x @ times == pytest.approx(motion.end**2 / 2, rel=1e-9)
    energy = TASK.robot.energy(motion, order=6)
    assert program.energy(x) == pytest.approx(energy, rel=1e-6)
    z = x[: formulation.layout.size]
    smooth = [formulation.coarse_program(TASK.limits, motion.end)]
    for width in (0.01, 0.004):
        smooth.append(formulation.fine_program(TASK.limits, Smoothing(width, 3 * width, 1.5 * width, 2.0), z))
    for near in smooth:
        assert near.energy(z) == pytest.approx(energy, rel=0.01)
        assert np.sum(near.weights @ z) == pytest.approx(motion.end, rel=1e-12)


@pytest.mark.parametrize("kind", some(1, sorted(RISES)))
def test_derivatives_of_the_exact_program(kind):
    formulation, _, x = drawn(3, kind)
    order, x = order_of(formulation, x)
    program = formulation.ordered_program(TASK.limits, order, x, [(2, 0.3)])
    rows = program.no_rows()
    rows["tip-over"][::4] = True
    rows["torque"][::7] = True
    program = program.with_rows(rows)
    rng = np.random.default_rng(0)
    on = rng.normal(size=len(program.bounds()[0]))
    gradient, jacobian, hessian = program.gradient(x), program.jacobian(x), program.hessian(x, 0.7, on)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-9 * np.abs(hessian).max())
    free = program.structure.x_lower < program.structure.x_upper
    h = 1e-6
    for _ in range(4):
        v = rng.normal(size=len(x)) * free
        ahead, behind = x + h * v, x - h * v
        objective = (program.values(ahead)[0] - program.values(behind)[0]) / (2 * h)
        assert gradient @ v == pytest.approx(objective, abs=1e-6 * np.abs(gradient).max())
        slope = (program.values(ahead)[1] - program.values(behind)[1]) / (2 * h)
        np.testing.assert_allclose(jacobian @ v, slope, atol=2e-5 * np.abs(jacobian).max())
        bend = [0.7 * program.gradient(z) + on @ program.jacobian(z) for z in (ahead, behind)]
        reference = (bend[0] - bend[1]) / (2 * h)
        assert np.max(np.abs(hessian @ v - reference)) < 2e-5 * np.max(np.abs(reference))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["each", pytest.param("one", marks=pytest.mark.slow)])
def test_plans_are_verified_and_keep_their_rise_times(kind):
    task = replace(TASK, rise_times=tuple(RISES[kind]))
    search = Search(task)
    attempt = search.run(3, 0)
    assert attempt.result.verified, attempt.result.status
    assert attempt.motion.rise_times == tuple(RISES[kind])
    checked = check_motion(task.robot, attempt.motion, task.limits, step=0.002)
    assert checked.verified
    assert checked.worst["GN"].value > 0.85
    # the exact program's own numbers are those of the check
    formulation = search.formulation
    refiner = Refiner(formulation, search.inner)
    exact = refiner.first(formulation.variables(attempt.motion), 0.004)
    x = formulation.polished(exact.order, exact.program.structure, exact.solution.x)
    motion = refiner.motion(exact)
    assert exact.solution.violation < 1e-5
    assert exact.program.energy(x) == pytest.approx(task.robot.energy(motion, order=6), rel=1e-6)
    worst = check_motion(task.robot, motion, task.limits).worst
    assert worst["GN"].value < 0.9 + 5e-3
    assert max(worst[name].value for name in ("speed_ratio", "acceleration_ratio")) < 1 + 1e-6


@pytest.mark.slow
def test_short_rise_times_are_next_to_ramps():
    ramps = Search(experiment_task("A")).run(1, 0)
    curves = Search(replace(experiment_task("A"), rise_times=1e-3)).run(1, 0)
    assert ramps.result.verified
    assert curves.result.verified
    assert curves.check.energy == pytest.approx(ramps.check.energy, rel=0.02)


@pytest.mark.slow
def test_durations_include_the_rise():
    task = experiment_task("A")
    limits = replace(task.limits, min_duration=2.0, max_duration=2.0)
    attempt = Search(replace(task, limits=limits, rise_times=0.1)).run(0, 0)
    assert attempt.result.verified
    assert attempt.check.duration == pytest.approx(2.0, abs=1e-7)
    short = replace(task, limits=replace(task.limits, max_duration=1.6))
    assert not refusals(short)
    assert "max_duration: joint" in refusals(replace(short, rise_times=1.0))[0]
