"""The nonlinear programs: objective and rows are those of the motion, derivatives those of differences."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.motion.objective import ENERGY_UNIT
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.formulation import Formulation, Smoothing
from ocptip.motion.planner.program import Pull
from ocptip.motion.planner.random_start import random_start
from ocptip.motion.task import MotionTask
from ocptip.published.arms import load_arm
from ocptip.published.tasks import experiment_task
from ocptip.reserves.tipping import TipMap
from ocptip.robots.geometry import floor
from ocptip.robots.motors import DCMotors
from ocptip.standing.arm import Robot
from ocptip.trajectories.pieces import MERGE
from tests.quick import some

SEEDS = some(1, [1, 4, 9])


def geared_task(heights=(0.0, 0.0, 0.0)):
    """Three feet under an arm with DC motors; a floor to collide with."""
    places = [[0.35, 0.0, heights[0]], [-0.25, 0.3, heights[1]], [-0.25, -0.3, heights[2]]]
    contacts = [UnilateralContact(position=p, friction=0.8) for p in places]
    support = Support(contacts, mass=25.0, center_of_mass=[0.0, 0.0, 0.1])
    arm = dataclasses.replace(load_arm("FSFS"), mount_position=np.array([0.0, 0.0, 0.3]))
    k = np.arange(1.0, 7.0)
    motors = DCMotors(5 + k, 0.3 * k, 0.1 * k, np.full(6, 2.0), regeneration=1.0)
    robot = Robot(arm, support, motors, obstacles=[floor(0.0)])
    printed = experiment_task("A")
    return MotionTask("geared", robot, printed.start, printed.goal, optimised=(0, 1, 2))


class Planned:
    """A task with its formulation, and ordered or smooth programs of random motions."""

    def __init__(self, task):
        self.task = task
        self.formulation = Formulation(task.robot, task.start, task.goal, task.optimised, task.commands)

    def motion(self, seed):
        task = self.task
        rng = np.random.default_rng(seed)
        return random_start(
            task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng
        )

    def ordered(self, seed, extra=()):
        """Program, x, motion, order."""
        motion = self.motion(seed)
        order, x = order_of(self.formulation, self.formulation.variables(motion))
        return self.formulation.ordered_program(self.task.limits, order, x, list(extra)), x, motion, order

    def smooth(self, seed, kind):
        motion = self.motion(seed)
        x = self.formulation.variables(motion)
        if kind == "coarse":
            return self.formulation.coarse_program(self.task.limits, motion.end, nodes=24), x
        return self.formulation.fine_program(self.task.limits, Smoothing(0.02, 0.06, 0.03, 2.0), x), x

    def of_kind(self, seed, kind):
        return self.ordered(seed, [(2, 0.3), (3, 1.0)])[:2] if kind == "ordered" else self.smooth(seed, kind)


@pytest.fixture(scope="module")
def effective():
    return Planned(experiment_task("A", "effective"))


@pytest.fixture(scope="module")
def geared():
    return Planned(geared_task())


@pytest.fixture(scope="module", params=some(1, ["effective", "geared"]))
def planned(request):
    return request.getfixturevalue(request.param)


def some_rows(program, seed, slip=True):
    """A random selection of rows of all limits."""
    rng = np.random.default_rng(seed)
    rows = program.no_rows()
    for name, mask in rows.masks.items():
        share = 0.02 if name == "clearance" else 0.3
        mask[...] = rng.random(mask.shape) < share
    if not slip:
        rows["slip"][:] = False
    return rows


def parts(program, values):
    """Values of the rows by name of the limit, and of the structure."""
    sizes = [len(program.structure.lower), *map(np.count_nonzero, program.rows.masks.values())]
    names = ["structure", *program.rows.masks]
    return dict(zip(names, np.split(values, np.cumsum(sizes[:-1])), strict=True))


@pytest.mark.parametrize("seed", SEEDS)
def test_objective_of_an_ordered_program_is_the_energy_of_the_motion(planned, seed):
    program, x, motion, _ = planned.ordered(seed)
    exact = planned.task.robot.energy(motion)
    assert program.energy(x) == pytest.approx(exact, rel=1e-6)
    assert program.values(x)[0] * ENERGY_UNIT == pytest.approx(program.energy(x), rel=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_quadrature_lies_inside_the_intervals_between_events(planned, seed):
    program, x, motion, _ = planned.ordered(seed)
    times, weights = program.nodes.times @ x, program.weights @ x
    assert weights.sum() == pytest.approx(motion.end, rel=1e-12)
    apart = np.min(np.abs(times[:, None] - motion.event_times), axis=1)
    assert np.all(apart[weights > 1e-9] > 0)
    samples = planned.task.robot.samples(motion, times)
    assert weights @ samples.powers.sum(axis=1) == pytest.approx(program.energy(x), rel=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_are_the_reserves_of_the_motion_at_the_nodes(planned, seed):
    """The same numbers the check looks at: GN, GT, torques, distances, angles."""
    program, x, motion, _ = planned.ordered(seed)
    robot = planned.task.robot
    times = program.nodes.times @ x
    real = program.weights @ x > 1e-9
    samples = robot.samples(motion, times)
    assert samples.states.persistent.all()
    program = program.with_rows(some_rows(program, seed))
    rows, own = program.rows, parts(program, program.values(x)[1])
    expected = samples.tip.moments[rows["tip-over"]] / (2 * robot.tip_over.reference_moment)
    here = real[np.nonzero(rows["tip-over"])[0]]
    np.testing.assert_allclose(own["tip-over"][here], expected[here], rtol=1e-6, atol=1e-9)
    slip = rows["slip"][:, 0]
    np.testing.assert_allclose(own["slip"][real[slip]], samples.slip.GT[slip][real[slip]], rtol=1e-5)
    here = real[np.nonzero(rows["torque"])[0]]
    expected = (samples.torques / robot.arm.limits.torque)[rows["torque"]]
    np.testing.assert_allclose(own["torque"][here], expected[here], rtol=1e-6, atol=1e-9)
    gaps = robot.collision.gaps(samples.angles)[rows["clearance"]]
    np.testing.assert_allclose(own["clearance"], 10 * gaps, atol=1e-7)
    np.testing.assert_allclose(own["angle"], samples.angles[rows["angle"]], atol=1e-8)
    assert not own["further"].size  # an arm has no other limits


@pytest.mark.parametrize("seed", SEEDS)
def test_bounds_are_those_of_the_check(planned, seed):
    """GN at its limit is the tip row at its bound; nodes that use no limit fully break no bound."""
    program, x, motion, _ = planned.ordered(seed)
    limits, tip = planned.task.limits, planned.task.robot.tip_over
    rows = program.no_rows()
    rows["tip-over"][:] = True
    program = program.with_rows(rows)
    lower = program.bounds()[0][-1]
    moment = lower * 2 * tip.reference_moment
    assert tip.reference_moment / (tip.reference_moment + moment) == pytest.approx(limits.GN)
    GN = planned.task.robot.samples(motion, program.nodes.times @ x).tip.GN
    short = np.any(program.values(x)[1][len(program.structure.lower) :].reshape(len(GN), -1) < lower, axis=1)
    np.testing.assert_array_equal(short, limits.GN < GN)


@pytest.mark.parametrize("seed", SEEDS)
def test_use_is_one_exactly_where_the_worst_quantity_is_at_its_limit(effective, seed):
    """Limits moved to a node's own worst values: its use becomes 1 as the largest of all."""
    program, x, motion, order = effective.ordered(seed)
    robot = effective.task.robot
    real = program.weights @ x > 1e-9
    samples = robot.samples(motion, program.nodes.times @ x)
    largest = float(np.max(samples.slip.GT[real]))

    def with_limits(**numbers):
        limits = dataclasses.replace(effective.task.limits, **numbers)
        return effective.formulation.ordered_program(limits, order, x, [])

    use = np.where(real, with_limits(GT=largest, torque_ratio=9.0).use(x), 0)
    assert np.max(use) == pytest.approx(1.0, abs=1e-5)
    assert np.argmax(use) == np.argmax(np.where(real, samples.slip.GT, 0))
    ratios = np.max(np.abs(samples.torques) / robot.arm.limits.torque, axis=1) / 0.01
    use = with_limits(GT=1.0, torque_ratio=0.01).use(x)
    np.testing.assert_allclose(use[real], ratios[real], rtol=1e-6)


def test_near_rows_grow_with_a_smaller_share(planned):
    program, x, _, _ = planned.ordered(1)
    sets = [program.near_rows(x, share) for share in (1.0, 0.6, 0.3, 0.0)]
    for fewer, more in pairwise(sets):
        assert fewer - more == 0
    assert sets[-1] - sets[0] > 0
    for name in ("tip-over", "slip", "torque"):
        assert sets[-1][name].all()
    assert not sets[0]["torque"].any()  # a start keeps its limits
    passive = sorted(set(range(6)) - set(planned.task.optimised))
    assert not sets[-1]["angle"][:, passive].any()


def directional(function, x, direction, step=1e-6):
    return (function(x + step * direction) - function(x - step * direction)) / (2 * step)


def directions(program, x, seed, count=6):
    """Random directions in the variables that are free, each about as long as the variables are."""
    rng = np.random.default_rng(seed)
    free = program.structure.x_lower < program.structure.x_upper
    for _ in range(count):
        yield rng.normal(size=len(x)) * free


@pytest.mark.parametrize("kind", ["ordered", "coarse", "fine"])
@pytest.mark.parametrize("seed", some(1, SEEDS[:2]))
def test_gradient_and_jacobian(planned, kind, seed):
    program, x = planned.of_kind(seed, kind)
    program = program.with_rows(some_rows(program, seed, slip=False), Pull(x + 0.1, 0.3))
    gradient, jacobian = program.gradient(x), program.jacobian(x)
    assert jacobian.shape == (len(program.bounds()[0]), len(x))
    scale = np.maximum(np.max(np.abs(jacobian), axis=1), 1.0)
    for v in directions(program, x, seed):
        objective = directional(lambda z: program.values(z)[0], x, v)
        assert gradient @ v == pytest.approx(objective, abs=1e-6 * np.max(np.abs(gradient)))
        rows = directional(lambda z: program.values(z)[1], x, v)
        assert np.max(np.abs(jacobian @ v - rows) / scale) < 2e-5


@pytest.mark.parametrize("seed", SEEDS[:2])
def test_slopes_of_the_slip_rows(planned, seed):
    program, x, _, _ = planned.ordered(seed)
    rows = program.no_rows()
    rows["slip"][::5] = True
    program = program.with_rows(rows)
    jacobian = program.jacobian(x)[len(program.structure.lower) :]
    scale = np.max(np.abs(jacobian))
    off = []
    for v in directions(program, x, seed, 3):
        rows = directional(lambda z: program.values(z)[1], x, v, 1e-5)[len(program.structure.lower) :]
        off.append(np.abs(jacobian @ v - rows) / scale)
    assert np.mean(np.array(off) < 1e-3) > 0.95  # GT has kinks


@pytest.mark.parametrize("kind", ["ordered", "coarse", "fine"])
@pytest.mark.parametrize("seed", some(1, SEEDS[:2]))
def test_hessian(planned, kind, seed):
    """Differences of the Lagrangian's gradient; GT has kinks, so its multipliers are 0."""
    program, x = planned.of_kind(seed, kind)
    program = program.with_rows(some_rows(program, seed), Pull(x + 0.1, 0.3))
    multipliers = np.random.default_rng(seed).normal(size=len(program.bounds()[0]))
    parts(program, multipliers)["slip"][:] = 0.0  # a view
    hessian = program.hessian(x, 0.7, multipliers)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-9 * np.max(np.abs(hessian)))

    def slope(z):
        return 0.7 * program.gradient(z) + multipliers @ program.jacobian(z)

    for v in directions(program, x, seed):
        reference = directional(slope, x, v)
        assert np.max(np.abs(hessian @ v - reference)) < 1e-5 * np.max(np.abs(reference))


@pytest.mark.parametrize("seed", SEEDS[:2])
def test_slip_rows_put_their_curvature_into_the_hessian(effective, seed):
    """Each row alone: differences of its slope, except where the best forces change their kind."""
    program, x, _, _ = effective.ordered(seed)
    rows = program.no_rows()
    rows["slip"][::7] = True
    program = program.with_rows(rows)
    first = len(program.structure.lower)
    off = []
    for k in range(first, len(program.bounds()[0])):
        multipliers = np.zeros(len(program.bounds()[0]))
        multipliers[k] = 1.0
        hessian = program.hessian(x, 0.0, multipliers)
        for v in directions(program, x, seed, 2):
            reference = directional(lambda z, k=k: program.jacobian(z)[k], x, v)
            off.append(np.max(np.abs(hessian @ v - reference)) / np.max(np.abs(reference)))
    assert np.mean(np.array(off) < 1e-4) > 0.9


def test_the_limit_that_is_broken_most_is_named(effective):
    program, x, *_ = effective.ordered(1)
    limits = dataclasses.replace(effective.task.limits, torque_ratio=1e-3)
    strict = effective.formulation.ordered_program(limits, effective.ordered(1)[3], x, [])
    assert strict.with_rows(strict.near_rows(x, 0.5)).most_broken(x) == "torque"
    assert program.with_rows(program.no_rows()).most_broken(0.5 * x) == "timing"


def test_rows_that_do_not_take_part_do_not_exist(effective):
    program, x, _, _ = effective.ordered(1)
    assert len(program.values(x)[1]) == len(program.structure.lower) == len(program.bounds()[0])
    assert len(program.jacobian(x)) == len(program.structure.lower)


def test_tip_map_of_feet_in_different_planes():
    """Not affine: moments and slopes come from the contact states."""
    robot = geared_task((0.0, 0.05, -0.03)).robot
    tip = TipMap(robot.tip_over)
    assert robot.tip_over.affine_moments is None
    rng = np.random.default_rng(2)
    loaded = np.array([0, 0, -9.81 * robot.mass, 0, 0, 0])
    wrenches = loaded + rng.normal(size=(30, 6)) * [30, 30, 30, 10, 10, 10]
    moments, slopes = tip(wrenches)
    states = robot.contact_states(wrenches)
    assert states.persistent.all()
    np.testing.assert_allclose(moments, robot.tip_over.evaluate(states).moments, rtol=1e-12)
    step, right = 1e-3, []
    for k, e in enumerate(np.eye(6)):
        ahead, behind = robot.contact_states(wrenches + step * e), robot.contact_states(wrenches - step * e)
        same = np.all((ahead.subsets == states.subsets) & (behind.subsets == states.subsets), axis=1)
        change = robot.tip_over.evaluate(ahead).moments - robot.tip_over.evaluate(behind).moments
        right.append(same)
        np.testing.assert_allclose(slopes[same, :, k], change[same] / (2 * step), atol=1e-6)
    assert np.mean(right) > 0.7


@pytest.mark.parametrize("seed", SEEDS)
def test_structure_rows_hold_for_a_motion_of_the_servo_law(planned, seed):
    """Arrival, brake law, crossings are zero; acceleration limits and the order of events hold."""
    program, x, motion, _ = planned.ordered(seed)
    rows = program.values(x)[1]
    lower, upper = program.structure.lower, program.structure.upper
    equal = lower == upper
    assert np.max(np.abs(rows[equal])) < 1e-8
    # a random motion has triangles, whose next command comes at once: middle commands without cruise
    assert np.min(rows[~equal]) > -1e-8
    assert (
        check_motion(planned.task.robot, motion, planned.task.limits).worst["acceleration_ratio"].value <= 1
    )


@pytest.mark.parametrize("merge", [0.0, 0.03])
@pytest.mark.parametrize("seed", SEEDS)
def test_polished_variables_keep_all_equalities_and_rebuild_their_events(effective, seed, merge):
    formulation = effective.formulation
    motion = effective.motion(seed)
    order, x = order_of(formulation, formulation.variables(motion), merge)
    program = formulation.ordered_program(effective.task.limits, order, x, [])
    structure = program.structure
    rng = np.random.default_rng(seed)
    noisy = x + 1e-8 * rng.normal(size=len(x)) * (structure.x_lower < structure.x_upper)
    polished = formulation.polished(order, structure, noisy)
    equal = structure.lower == structure.upper
    rows = np.array(structure.function(polished)).ravel()
    assert np.max(np.abs(rows[equal])) < 1e-12
    assert np.max(np.abs(polished - x)) < (1e-6 if merge == 0 else 10 * merge)
    rebuilt = formulation.motion(polished)
    np.testing.assert_allclose(rebuilt.goal, effective.task.goal, atol=0)
    times = order.rows @ polished
    nearest = np.min(np.abs(times[:, None] - rebuilt.event_times), axis=1)
    assert (
        np.max(nearest) < 1e-10 if merge else np.max(nearest) < 2 * MERGE
    )  # events nearer than that count as one
    if merge:
        assert max(map(len, order.groups)) > 1
    boundaries = np.concatenate([joint.times for joint in rebuilt.joints] + [rebuilt.crossings])
    nearest = np.min(np.abs(times[:, None] - boundaries), axis=1)
    assert np.max(nearest[1:]) < 1e-10
