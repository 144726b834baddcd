"""Nodes at which joints are late or overshoot; rows within a tolerance and their derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.planner.deviating import deviating_places
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.exact import Refiner
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.planner.one_start import Search
from ocptip.motion.planner.random_start import random_start
from ocptip.motion.task import require_plannable
from ocptip.published.tasks import experiment_task
from ocptip.standing.limit_kinds.limit import DEVIATING
from ocptip.standing.limits import Limits
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.tolerance import SITE, WORKSHOP, Uncertainty
from ocptip.standing.within.late_joints import jump_states
from tests.quick import some

LIMITS = Limits(tolerance=replace(WORKSHOP, push=5.0))
WITHIN = ("tip-over within tolerance", "slip within tolerance")


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


def planned(task, seed, tolerance, rise_times=None):
    own = task.robot, task.start, task.goal, task.optimised, task.commands
    formulation = Formulation(*own, rise_times=rise_times)
    motion = random_start(*own, Limits(), np.random.default_rng(seed))
    order, x = order_of(formulation, formulation.variables(motion))
    limits = replace(LIMITS, tolerance=tolerance)
    x = formulation.polished(order, formulation.ordered_program(limits, order, x, []).structure, x)
    places = deviating_places(order, x, tolerance)
    return formulation.ordered_program(limits, order, x, places), x, formulation.motion(x), places


@pytest.mark.parametrize("tolerance", [Uncertainty(damping=0.05), Uncertainty(delay=0.002, damping=0.1)])
@pytest.mark.parametrize("seed", some(1, [1, 4]))
def test_nodes_have_the_states_that_the_check_looks_at(task, seed, tolerance):
    program, x, motion, _ = planned(task, seed, tolerance)
    deviating = program.nodes.kinds == DEVIATING
    assert np.all(program.weights[deviating] == 0)
    times, found = (program.nodes.times @ x)[deviating], program._instants(x).s[deviating]
    expected = jump_states(motion, tolerance)
    deviating_all = ["on time" not in words for words in expected.words]
    expected = expected.some(np.flatnonzero(deviating_all))
    single, n = 0, motion.n
    for time in np.unique(np.round(times, 9)):
        near = np.abs(motion.event_times - time)
        own = found[np.abs(times - time) < 1e-8]
        same = np.abs(expected.times - time) < 1e-6
        if np.sum(near < 2 * max(tolerance.delay, 1e-4)) > 1 or not same.any():
            continue  # several events in one window: the nodes run on to the last one
        apart = np.abs(own[:, None] - expected.s[same][None])
        assert np.all(apart[:, :, 2 * n :].max(axis=2).min(axis=0) < 1e-4)  # all of the check
        if near.min() < 1e-8:  # after an event the nodes' angles and speeds are those of their own time
            assert np.all(apart.max(axis=2).min(axis=0) < 1e-4)
            single += 1
    assert single > 5


def test_nodes_know_accelerations_of_the_delay_before_where_motions_are_cancelled(task):
    own = task.robot, task.start, task.goal, task.optimised, task.commands
    formulation = Formulation(*own)
    order, x = order_of(formulation, formulation.variables(task.reference))
    cancel, places = Cancel(tuple(task.robot.limits.acceleration)), [(1, 0.0), (1, 1e-3), (2, 1.0)]
    limits = replace(LIMITS, tolerance=WORKSHOP, cancel=cancel)
    x = formulation.polished(order, formulation.ordered_program(limits, order, x, []).structure, x)
    program = formulation.ordered_program(limits, order, x, places)
    times, motion = program.nodes.times @ x, formulation.motion(x)
    before = program.instants(x, np.arange(program.n_nodes)[::2]).before
    expected = motion.states(times[::2] - WORKSHOP.late - 2e-6)[2]
    np.testing.assert_allclose(before, expected, atol=1e-6 * np.abs(expected).max())
    assert np.any(before != program.instants(x, np.arange(program.n_nodes)[::2]).accelerations)
    nominal = replace(limits, tolerance=Uncertainty())
    assert formulation.ordered_program(nominal, order, x, places)._instants(x).before is None


@pytest.mark.parametrize("seed", some(1, [1, 4]))
def test_nodes_of_s_curves_have_joints_that_are_late(task, seed):
    tolerance = Uncertainty(delay=0.01, speed=0.03)
    program, x, motion, places = planned(task, seed, tolerance, np.full(6, 0.04))
    deviating = program.nodes.kinds == DEVIATING
    assert np.all(program.weights[deviating] == 0)
    times, found = (program.nodes.times @ x)[deviating], program._instants(x).s[deviating]
    late = np.zeros((len(places), motion.n), dtype=bool)
    for node, place in enumerate(places):
        late[node, list(place.late.joints)] = True
    assert late.any(axis=0).all()
    own, then = (np.array(motion.states(t)).transpose(1, 0, 2) for t in (times, times - 0.0103))
    expected = np.where(late[:, None], then, own)
    np.testing.assert_allclose(found.reshape(expected.shape), expected, atol=2e-5)


@pytest.mark.parametrize("rise_times", some(1, [None, np.full(6, 0.04)]))
@pytest.mark.parametrize("seed", some(1, [1, 4]))
def test_derivatives_of_the_rows_within_a_tolerance(task, seed, rise_times):
    program, x, _, _ = planned(task, seed, LIMITS.tolerance, rise_times)
    rng, rows = np.random.default_rng(seed), program.no_rows()
    for name in WITHIN:
        rows[name][...] = rng.random(rows[name].shape) < 0.04
        deviating = program.nodes.kinds == DEVIATING
        rows[name][deviating & (rng.random(len(deviating)) < 0.9)] = False
    program, count = program.with_rows(rows, near=x), len(program.structure.lower)
    on = rng.normal(size=len(program.bounds()[0]))
    on[:count] = 0.0
    J, H, h = program.jacobian(x), program.hessian(x, 0.0, on), 1e-6
    for j in range(0, len(x) - 2, 3):
        moved = h * (np.arange(len(x)) == j)
        slope = (program.values(x + moved)[1] - program.values(x - moved)[1]) / (2 * h)
        np.testing.assert_allclose(J[count:, j], slope[count:], atol=2e-5 * np.abs(J[count:]).max())
        bend = on @ (program.jacobian(x + moved) - program.jacobian(x - moved)) / (2 * h)
        np.testing.assert_allclose(H[j], bend, atol=2e-5 * np.abs(H).max())


def test_rows_near_some_variables_are_the_worst_case_there(task):
    """Deviations chosen there stay while a program is solved; elsewhere they are not worse than the worst."""
    program, x, _, _ = planned(task, 1, LIMITS.tolerance)
    rows = program.no_rows()
    for name in WITHIN:
        rows[name][::9] = True
    plain, chosen = program.with_rows(rows), program.with_rows(rows, near=x)
    np.testing.assert_allclose(chosen.values(x)[1], plain.values(x)[1], rtol=1e-9)
    count, tips = len(program.structure.lower), np.count_nonzero(rows[WITHIN[0]])
    moved = x * 1.02
    difference = (plain.values(moved)[1] - chosen.values(moved)[1])[count : count + tips]
    assert np.all(difference <= 1e-3)
    assert np.any(np.abs(difference) > 1e-6)


def test_other_limits_look_at_other_nodes(task):
    program, x, _, places = planned(task, 1, LIMITS.tolerance)
    deviating = program.nodes.kinds == DEVIATING
    assert deviating.sum() == len(places)
    for name, rows in program.near_rows(x, -100.0).masks.items():
        assert rows[deviating].any() == (name in WITHIN)


@pytest.mark.parametrize("seed", some(1, [1, 4, 7]))
def test_events_more_than_a_delay_apart_stay_so(task, seed):
    """Rows keep every pair apart that is, and no other pair."""
    own, delay = (task.robot, task.start, task.goal, task.optimised, task.commands), 0.03
    formulation = Formulation(*own)
    motion = random_start(*own, Limits(), np.random.default_rng(seed))
    order, x = order_of(formulation, formulation.variables(motion), 0.004)
    kept, times = order.kept_apart(x, delay), order.rows @ x
    gaps = np.subtract.outer(times, times)
    assert np.sum((gaps > 0) & (gaps <= delay)) > 0
    assert np.all(kept.steps @ x >= -1e-12)
    near, rng = [], np.random.default_rng(seed)
    for _ in range(400):
        moved = x + 0.02 * rng.normal(size=x.shape) * (x > 0) * (np.arange(len(x)) != order.layout.one)
        now = order.rows @ moved
        later = np.subtract.outer(now, now)
        if np.all(np.diff(now) >= 0):
            stays = bool(np.all(later[gaps > delay] > delay - 1e-12))
            assert np.all(kept.steps @ moved >= -1e-12) == stays
            near.append(stays)
    assert len(set(near)) == 2
    assert len(order.kept_apart(x, 2 * times[-1]).apart) == 0


@pytest.mark.slow
def test_a_path_costs_more_slowed_down_until_it_has_a_tolerance(task):
    """And nothing is as slow as that where the floor is too steep at rest."""
    motion = random_start(
        *(task.robot, task.start, task.goal, task.optimised, task.commands, Limits()),
        np.random.default_rng(1),
    )

    def cost(tolerance):
        search = Search(replace(task, limits=replace(LIMITS, tolerance=tolerance)))
        return Refiner(search.formulation, search.inner).slowed_cost(search.formulation.variables(motion))

    costs = [cost(own) for own in (Uncertainty(tilt=1e-3), WORKSHOP, replace(WORKSHOP, tilt=np.radians(6)))]
    assert costs[0] < costs[1] < costs[2] < np.inf
    assert cost(Uncertainty(tilt=np.radians(12))) == np.inf


@pytest.mark.slow
def test_a_plan_keeps_its_tolerance_where_a_nominal_one_does_not(task):
    small = replace(WORKSHOP, tilt=np.radians(0.3), delay=0.005)
    limits = replace(task.limits, tolerance=small)
    attempt = Search(replace(task, limits=limits)).run(1, 0)
    assert attempt.result.verified
    assert 0.9 < max(attempt.check.worst[f"{name}_worst_case"].value for name in ("GN", "GT")) <= 0.999
    nominal = Search(task).run(1, 0)
    assert nominal.check.energy < attempt.check.energy
    checked = check_motion(task.robot, nominal.motion, limits)
    assert not checked.verified
    assert checked.stands


@pytest.mark.slow
def test_what_cannot_have_its_tolerance_at_rest_is_refused():
    """H with the effective base stands at rest up to a tilt of 0.45 degrees; a push of 20 N lifts all."""
    task = experiment_task("H", "effective")
    within = replace(task, limits=replace(task.limits, tolerance=WORKSHOP))
    with pytest.raises(
        InputError, match=r"floor tilt 0\.5 deg alone is too much, possible is floor tilt 0\.45\d* deg"
    ):
        require_plannable(within)
    task = experiment_task("A", "effective")
    with pytest.raises(InputError, match=r"goal: within .* at rest .* all together at \d+ %"):
        require_plannable(replace(task, limits=replace(task.limits, tolerance=SITE)))
