"""Jumps of the load with their overshoot: against a swinging mass, in checks, programs and plans."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given
from hypothesis import strategies as st
from scipy.signal import StateSpace, lsim, step

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.planner.one_start import Search
from ocptip.motion.planner.random_start import random_start
from ocptip.motion.task import refusals
from ocptip.published.tasks import experiment_task
from ocptip.standing.limit_kinds.jumps import Jumps
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import JUMP
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty, overshoot_of, overshoot_of_rise, overshoot_of_rises
from ocptip.standing.within.in_motion import worst_within
from ocptip.task_files.motion import load_task
from ocptip.trajectories.controllers import controller_points
from tests.places import EXAMPLES
from tests.quick import examples, some

KAPPA = overshoot_of(0.05)
LIMITS = Limits(damping=0.05)


@pytest.fixture(scope="module")
def task():
    return replace(experiment_task("B"), limits=LIMITS)


@pytest.mark.parametrize("damping", some(2, [0.0, 0.3, 0.02, 0.05, 0.7]))
def test_overshoot_is_that_of_a_mass_on_spring_and_damper(damping):
    swing = StateSpace([[0, 1], [-1, -2 * damping]], [[0], [1]], [[1, 0]], [[0]])
    times = np.linspace(0, 2 * np.pi, 20001)
    assert overshoot_of(damping) == pytest.approx(step(swing, T=times)[1].max() - 1, abs=1e-6)


@examples(30)
@given(damping=st.floats(0.0, 0.7), periods=st.floats(0.02, 4.0))
def test_rises_overshoot_as_a_mass_on_spring_and_damper_whose_load_rises_evenly(damping, periods):
    """In time of 1 rad per undamped radian; the greatest of the whole swing, the rise included."""
    swing = StateSpace([[0, 1], [-1, -2 * damping]], [[0], [1]], [[1, 0]], [[0]])
    rise = 2 * np.pi * periods
    times = np.linspace(0, rise + 4 * np.pi, 8001)
    greatest = lsim(swing, np.minimum(times / rise, 1.0), times)[1].max() - 1
    expected = float(overshoot_of_rise(damping, np.array(periods)))
    assert expected == pytest.approx(max(greatest, 0.0), abs=2e-3)
    assert expected <= overshoot_of(damping) + 1e-6
    assert expected <= 1 / (np.pi * periods)
    if periods >= 1:
        assert expected <= overshoot_of_rises(damping) + 1e-3


@pytest.mark.parametrize("damping", [-0.1, 1.1, float("nan"), "soft"])
def test_dampings_without_overshoot_are_refused(damping):
    with pytest.raises(InputError, match="damping: "):
        overshoot_of(damping)


@examples(8)
@given(seed=st.integers(0, 10**6), kappa=st.floats(0, 1))
def test_loads_at_jumps_are_combined_from_those_of_both_sides(seed, kappa):
    task = experiment_task("B")
    rng = np.random.default_rng(seed)
    own = task.robot, task.start, task.goal, task.optimised, task.commands, task.limits
    motion = random_start(*own, rng)
    jumps = Jumps.of(motion)
    edges = np.concatenate([joint.times for joint in motion.joints])
    assert np.max(np.min(np.abs(jumps.times[:, None] - edges), axis=1)) < 2e-7
    assert {0.0, motion.end} <= set(jumps.times)
    before = motion.states(jumps.times - 2e-7)[2]
    after = motion.states(jumps.times + 2e-7)[2]
    np.testing.assert_allclose(jumps.before, before, atol=1e-12)
    np.testing.assert_allclose(jumps.after, after, atol=1e-12)
    sides = [task.robot.loads(jumps.angles, jumps.speeds, a)[1] for a in (before, after)]
    combined = sides[1] + kappa * (sides[1] - sides[0])
    np.testing.assert_allclose(jumps.loads(task.robot, kappa).wrenches, combined, atol=1e-9)


@examples(4, phases=[Phase.generate])
@given(
    seed=st.integers(0, 10**6),
    case=st.sampled_from(["A", "B", "G"]),
    damping=st.floats(0.0, 0.3),
    less=st.floats(0.0, 1.0),
    delay=st.sampled_from([0.0, 0.002, 0.01]),
    tilt=st.sampled_from([0.0, 0.005]),
)
def test_a_tolerance_asks_for_all_that_limits_ask_of_jumps(seed, case, damping, less, delay, tilt):
    """So damping of feet and gears needs no rows where that of `[tolerance]` overshoots at least as much."""
    task = experiment_task(case)
    rng = np.random.default_rng(seed)
    own = task.robot, task.start, task.goal, task.optimised, task.commands, task.limits
    motion = random_start(*own, rng).time_scaled(rng.uniform(1.0, 3.0))
    tolerance = Uncertainty(damping=less * damping, delay=delay, tilt=tilt)
    asked = Limits(damping=damping, tolerance=tolerance)
    assert not any(
        getattr(limit, "result", "").startswith("jump_G") for limit in limits_of(task.robot, asked)
    )
    jumps = Jumps.of(motion).loads(task.robot, asked.overshoot)
    times = np.linspace(0, motion.end, 60)
    within = worst_within(task.robot, motion, tolerance, times)
    M0 = task.robot.tip_over.reference_moment
    slope, offset = task.robot.tip_over.affine_moments
    least = float(np.min(jumps.wrenches @ slope.T + offset))
    worst = float(within.tip.bound if within.tip.bound is not None else within.tip.value)
    assert worst >= task.robot.tip_over.ratio(np.array(least)) - 1e-6 * (1 + abs(least) / M0)
    if np.max(jumps.tip.GN) < 1:  # else GT at falling bases has no meaning of its own
        assert within.slip.value >= np.max(jumps.slip.GT) * (1 - 1e-3) or within.slip.value >= 1


def test_between_two_steps_of_one_joint_that_joint_is_named(task):
    jumps = Jumps.of(task.reference)
    for k, time in enumerate(jumps.times):
        named = [
            j for j, joint in enumerate(task.reference.joints, 1) if np.min(np.abs(joint.times - time)) < 2e-7
        ]
        assert set(jumps.words(k).split(maxsplit=1)[1].split(", ")) <= set(map(str, named))


def test_the_check_sees_the_worst_jump(task):
    motion, robot = task.reference, task.robot
    worst = check_motion(robot, motion, LIMITS).worst
    at = Jumps.of(motion).loads(robot, KAPPA)
    slope, offset = robot.tip_over.affine_moments
    least = np.min(at.wrenches @ slope.T + offset, axis=1)
    assert worst["jump_GN"].value == pytest.approx(np.max(robot.tip_over.ratio(least)), rel=1e-12)
    np.testing.assert_array_equal(robot.tip_over.ratio(least) < 1, at.tip.GN < 1)
    assert np.min(least) < 0  # on the scale of tolerances: no lift acceleration
    M0 = robot.tip_over.reference_moment
    assert worst["jump_GN"].value == pytest.approx(1 - np.min(least) / M0)
    assert worst["jump_GN"].time == Jumps.of(motion).times[np.argmax(at.tip.GN)]
    assert worst["jump_GT"].value == np.nan_to_num(at.slip.GT, nan=np.inf).max()
    assert worst["jump_GN"].detail.startswith("joint")
    assert "jump_GN" not in check_motion(robot, motion).worst


def test_slow_motions_and_continuous_accelerations_pass(task):
    slow = check_motion(task.robot, task.reference.time_scaled(6), LIMITS)
    assert slow.verified
    assert slow.worst["jump_GN"].value < 0.5
    points = controller_points(task.reference.with_rise_times(0.02), "quintic")
    assert len(Jumps.of(points)) == 0
    assert check_motion(task.robot, points, LIMITS).worst["jump_GN"].detail == "no acceleration steps"


@pytest.mark.parametrize("merge", some(2, [0.0, 0.05]))
@pytest.mark.parametrize("seed", [1, 4])
def test_nodes_of_the_exact_program_have_the_loads_of_the_jumps(task, seed, merge):
    program, x, motion, order = ordered(task, seed, merge)
    at = program._instants(x)
    jumping = program.nodes.kinds == JUMP
    assert np.sum(jumping) == len(order.groups)
    assert np.all(program.weights[jumping] == 0)
    times, wrenches = (program.nodes.times @ x)[jumping], at.wrenches[jumping]
    jumps = Jumps.of(motion)
    loads = jumps.loads(task.robot, KAPPA).wrenches
    for k, time in enumerate(jumps.times):
        nearest = np.argmin(np.abs(times - time))
        assert abs(times[nearest] - time) < 1e-7
        if np.sum(np.abs(times - time) < 1e-6) == 1:
            np.testing.assert_allclose(wrenches[nearest], loads[k], atol=1e-5)
    about = {limit.name: JUMP in limit.node_kinds for limit in limits_of(task.robot, LIMITS)}
    for name, rows in program.near_rows(x, -100.0).masks.items():
        assert not rows[jumping != about[name]].any()
    assert program.near_rows(x, -100.0)["slip at acceleration steps"][jumping].all()


def ordered(task, seed, merge=0.0):
    """Exact program near a random motion, its variables (equalities kept), the motion, the order."""
    own = task.robot, task.start, task.goal, task.optimised, task.commands
    formulation = Formulation(*own)
    motion = random_start(*own, Limits(), np.random.default_rng(seed))
    order, x = order_of(formulation, formulation.variables(motion), merge)
    x = formulation.polished(order, formulation.ordered_program(LIMITS, order, x, []).structure, x)
    program = formulation.ordered_program(LIMITS, order, x, [(1, 0.5)])
    return program, x, formulation.motion(x), order


@pytest.mark.parametrize("seed", [1, 4])
def test_derivatives_of_the_rows_at_jumps(task, seed):
    program, x, _, _ = ordered(task, seed)
    rows = program.no_rows()
    rows["tip-over at acceleration steps"][program.nodes.kinds == JUMP] = True
    program, count = program.with_rows(rows), len(program.structure.lower)
    on = np.random.default_rng(seed).normal(size=len(program.bounds()[0]))
    on[:count] = 0.0
    J, H, h = program.jacobian(x), program.hessian(x, 0.0, on), 1e-6
    for j in range(0, len(x) - 2, 3):
        moved = h * (np.arange(len(x)) == j)
        slope = (program.values(x + moved)[1] - program.values(x - moved)[1]) / (2 * h)
        np.testing.assert_allclose(J[count:, j], slope[count:], atol=1e-5 * np.abs(J[count:]).max())
        bend = on @ (program.jacobian(x + moved) - program.jacobian(x - moved)) / (2 * h)
        np.testing.assert_allclose(H[j], bend, atol=1e-5 * np.abs(H).max())


@pytest.mark.slow
def test_plans_carry_their_jumps(task):
    """A plan that takes no notice of jumps does not."""
    attempt = Search(task).run(1, 0)
    assert attempt.result.verified
    assert 0.9 < attempt.check.worst["jump_GN"].value <= 1
    plain = Search(experiment_task("B")).run(1, 0)
    assert plain.result.verified
    assert plain.check.energy < attempt.check.energy
    checked = check_motion(task.robot, plain.motion, LIMITS)
    assert not checked.verified
    assert checked.stands
    assert checked.worst["jump_GN"].value > 1.5
    assert any(v.name == "jump_GN" for v in checked.violations)


@pytest.mark.parametrize(
    ("line", "expected"),
    [("damping = 0.05", KAPPA), ("damping = 0", 1.0), ('preset = "none"', 0.0)],
)
def test_task_files_ask_for_it(tmp_path, line, expected):
    assert load_task(written(tmp_path, line)).limits.overshoot == pytest.approx(expected)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("damping = 1.5", "tolerance.damping: must be >= 0 and below 1, got 1.5"),
        ("overshoot = 0.5", "tolerance.overshoot: unknown key; known: .* damping"),
        ("[limits]\ndamping = 0.5", r"limits.damping: is now damping in \[tolerance\], for all robots$"),
    ],
)
def test_bad_numbers_are_named(tmp_path, line, message):
    with pytest.raises(InputError, match=message):
        load_task(written(tmp_path, line))


def written(folder, line):
    path = folder / "task.toml"
    path = folder / "task.toml"
    text = (EXAMPLES / "tasks" / "delta_cart.toml").read_text()
    path.write_text(f"{text.partition('[limits]')[0]}\n[tolerance]\n{line}\n")
    return path


def test_other_tolerances_of_parallel_robots_are_refused(tmp_path):
    task = load_task(written(tmp_path, "damping = 0.05\nspeed = 0.03"))
    with pytest.raises(InputError, match="tolerance: parallel robots have only damping"):
        refusals(task)
