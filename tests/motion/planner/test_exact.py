"""Exact solutions: better than what they start from, limits kept between nodes, further nodes where asked."""

import numpy as np
import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.objective import ENERGY_UNIT
from ocptip.motion.planner.exact import FEASIBLE, MET, SHARES, Refiner
from ocptip.motion.planner.formulation import Formulation
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits

LIMITS = Limits(GN=0.85, GT=0.7)


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


@pytest.fixture(scope="module")
def refined(task):
    """An exact solution from the printed motion: refiner, solution, variables it started from."""
    formulation = Formulation(task.robot, task.start, task.goal, task.optimised, task.commands)
    refiner = Refiner(formulation, LIMITS)
    x = formulation.variables(task.reference)
    return refiner, refiner.first(x, merge=0.0), x


def energy(exact):
    return exact.solution.objective * ENERGY_UNIT


def test_a_solution_with_the_order_of_the_printed_motion_needs_less_energy(task, refined):
    refiner, exact, _ = refined
    assert exact.solution.violation <= FEASIBLE
    assert energy(exact) < 0.95 * task.robot.energy(task.reference)
    assert 0 < exact.solution.iterations <= refiner.iterations
    assert refiner.solves >= 1


def test_its_motion_has_its_energy_and_its_order(task, refined):
    refiner, exact, _ = refined
    motion = refiner.motion(exact)
    assert task.robot.energy(motion) == pytest.approx(energy(exact), rel=1e-4)
    np.testing.assert_array_equal(motion.goal, task.goal)
    x = refiner.formulation.polished(exact.order, exact.program.structure, exact.solution.x, MET)
    times = exact.order.rows @ x
    boundaries = np.concatenate([joint.times for joint in motion.joints] + [motion.crossings])
    assert np.max(np.min(np.abs(times[:, None] - boundaries), axis=1)) < 1e-10


def test_limits_bind_and_hold_between_the_nodes(task, refined):
    """The motion uses a limit up, and on a dense grid breaks none by more than the watch's blind spots."""
    refiner, exact, _ = refined
    worst = check_motion(task.robot, refiner.motion(exact), LIMITS).worst
    use = {name: worst[name].value / worst[name].limit for name in ("GN", "GT", "torque_ratio")}
    assert max(use.values()) < 1.005
    assert max(use["GN"], use["GT"], worst["speed_ratio"].value) > 0.999
    for name in ("speed_ratio", "acceleration_ratio"):
        assert worst[name].value <= 1 + 1e-5  # what meets is moved a little: the search slows down by as much
    assert worst["angle_margin_deg"].value > -1e-6


def test_it_is_a_local_optimum(refined):
    """Along feasible directions (null space of the binding rows) nothing is to be gained."""
    _, exact, _ = refined
    program, solution = exact.program, exact.solution
    x = solution.x
    rows, jacobian = program.values(x)[1], program.jacobian(x)
    lower, upper = program.bounds()
    binding = (rows < lower + 1e-4) | (rows > upper - 1e-4)
    structure = program.structure
    free = (x > structure.x_lower + 1e-4) & (x < structure.x_upper - 1e-4)
    _, s, vt = np.linalg.svd(jacobian[binding][:, free])
    null = vt[np.count_nonzero(s > 1e-8 * s[0]) :]
    gradient = program.gradient(x)[free]
    assert np.linalg.norm(null @ gradient) < 2e-2 * np.linalg.norm(gradient)


def test_tighter_limits_cost_energy(task, refined):
    refiner, exact, x = refined
    tight = Refiner(refiner.formulation, Limits(GN=0.8, GT=0.5)).first(x, merge=0.0)
    assert tight.solution.violation <= FEASIBLE
    assert energy(tight) > energy(exact)


def test_further_nodes_stand_at_the_given_instants(refined):
    refiner, exact, _ = refined
    x = refiner.formulation.polished(exact.order, exact.program.structure, exact.solution.x)
    times = exact.order.rows @ x
    instants = [0.3 * times[-1], 0.7 * times[-1], times[-1] + 1e-9]
    solves = refiner.solves
    again = refiner.again(exact, instants)
    assert refiner.solves > solves
    added = again.extra[len(exact.extra) : len(exact.extra) + 3]
    assert again.extra[: len(exact.extra)] == exact.extra
    placed = [times[i] + share * (times[i + 1] - times[i]) for i, share in added]
    np.testing.assert_allclose(placed, [*instants[:2], times[-1]], atol=1e-12)
    assert energy(again) == pytest.approx(energy(exact), rel=2e-3)  # it was optimal


class Watched:
    """Stands in for a program: uses at SHARES of each interval behind `own` nodes."""

    def __init__(self, own, uses):
        self.uses = np.concatenate([np.zeros(own), np.ravel(uses)])

    def use(self, x, nodes):
        return self.uses[nodes]


def broken(uses):
    watch = [(i, float(share)) for i in range(len(uses)) for share in SHARES]
    return Refiner._watch_out(Watched(5, uses), 5, watch, None, 1.0)


def test_nodes_are_added_at_the_summits_of_broken_limits():
    s = SHARES
    inside = 1.1 - (s - 0.43) ** 2  # summit between the shares
    two = 0.9 + 0.3 * np.cos(4 * np.pi * s)  # at both ends and in the middle
    found = broken([0.99 - 0 * s, inside, two])
    assert [i for i, _ in found] == [1, 2, 2, 2]
    np.testing.assert_allclose([share for _, share in found], [0.43, 0.0, 0.5, 1.0], atol=1e-12)


def test_kept_limits_add_nothing():
    assert broken([0.9 * np.sin(np.pi * SHARES)]) == []


def test_summits_stay_within_their_interval():
    """Even where three points are nearly on a line."""
    rising = 1.0 + 0.1 * SHARES
    rising[-2] = rising[-1]
    shares = [share for _, share in broken([rising])]
    assert shares
    assert all(0 <= share <= 1 for share in shares)


@pytest.mark.slow
def test_a_solution_goes_on_beyond_the_end_time_where_a_passive_ramp_changes_its_shape():
    """Joint 4 of case D has a triangle of speed in motions longer than 3.75 s; the best one takes 2.1 s."""
    task = experiment_task("D", "effective")
    formulation = Formulation(task.robot, task.start, task.goal, task.optimised, task.commands)
    edge = formulation.profiles(formulation.layout).edge(3)
    refiner = Refiner(formulation, LIMITS)
    plain = formulation.variables(task.reference)
    x = formulation.slowed(plain, 1.02 * edge / plain[formulation.layout.end])
    exact = refiner.first(x, merge=0.004)
    assert exact.solution.violation <= FEASIBLE
    assert exact.order.regime[3]
    assert exact.solution.x[formulation.layout.end] < 0.7 * edge
