"""A process that varies within tolerances, in certificates, stops and simulation.

It keeps the motion's clock: at every instant the world is that of the constant process of this instant.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.certificate.checks import certified
from ocptip.certificate.describe import model_data, motion_data, tolerance_data
from ocptip.certificate.trusted.arm import PROCESS, TIMES, Arm
from ocptip.certificate.trusted.checker import check_certificate, digest
from ocptip.certificate.trusted.sharing import Sharing
from ocptip.motion.check import check_motion
from ocptip.motion.stops.tables import StoppedPath
from ocptip.robots.process import ProcessWrench
from ocptip.standing.limits import Limits
from ocptip.standing.parts import Part
from ocptip.standing.simulation.mjcf import to_mjcf
from ocptip.standing.simulation.replay import Simulator, compared
from ocptip.standing.simulation.world import World
from ocptip.standing.stops.along_path import PathStops, affine_loads, stop_slopes
from ocptip.standing.tolerance import WORKSHOP
from ocptip.standing.within.deviations import Deviations
from ocptip.standing.within.late_joints import jump_states
from ocptip.standing.within.worst_case import worst_case_of
from tests.motion.test_process_in_motion import SMALL, case, varying
from tests.quick import examples, some

LATE = replace(SMALL, delay=0.01, damping=0.1)


def acted(bare, process):
    return bare.varied(arm=bare.arm.with_process(process))


def mild(over, knots, axes):
    process = varying(over, knots, axes)
    return replace(process, moment=0.1 * process.moment)


@pytest.fixture(scope="module", params=some(1, ["tool", "base"]))
def both(request):
    """Robot with a process that varies over the share, the same without one, motion."""
    task, bare = case("A", request.param)
    process = mild("share", [0.0, 0.3, 0.31, 0.7, 1.0], request.param)
    return acted(bare, process), bare, task.reference.time_scaled(1.5)


def test_the_worst_within_a_tolerance_is_that_of_the_constant_one(both):
    robot, bare, motion = both
    times = np.linspace(0.01, motion.end - 0.01, 5)
    acting, states = robot.during(motion).acting(times), np.hstack(motion.states(times))
    own = Deviations(robot, WORKSHOP)
    theta = np.random.default_rng(3).uniform(-0.02, 0.02, (len(times), own.size))
    found, slopes = own.wrench_and_slopes(np.hstack([states, acting]), theta)
    for k, wrench in enumerate(acting):
        constant = ProcessWrench(wrench[:3], wrench[3:], robot.arm.process.axes)
        other = Deviations(acted(bare, constant), WORKSHOP)
        alone = other.wrench_and_slopes(states[k : k + 1], theta[k : k + 1])
        np.testing.assert_allclose(found[k], alone[0][0], atol=1e-10)
        np.testing.assert_allclose(slopes[k], alone[1][0], atol=1e-9)


@pytest.mark.slow
def test_what_is_the_same_all_the_time_is_a_constant_one(both):
    robot, bare, motion = both
    force, moment, axes = [3.0, -2.0, 5.0], [0.3, 0.2, -0.1], robot.arm.process.axes
    same = ProcessWrench([force] * 3, [moment] * 3, axes, "share", [0.1, 0.5, 0.8])
    limits = Limits(tolerance=SMALL, stops=PathStops())
    checks = []
    for process in (ProcessWrench(force, moment, axes), same):
        own = acted(bare, process)
        checks.append(certified(own, motion, check_motion(own, motion, limits), limits))
    for name, worst in checks[0].worst.items():
        assert checks[1].worst[name].value == pytest.approx(worst.value, rel=2e-5), name
    assert checks[1].verified
    assert not checks[1].certificate.undecided
    bounds = [check.certificate.verdict.bounds for check in checks]
    assert bounds[1] == pytest.approx(bounds[0], rel=2e-2)


@pytest.mark.slow
def test_a_certificate_of_what_varies_encloses_what_late_joints_do(both):
    robot, _, motion = both
    limits = Limits(tolerance=LATE)
    checked = certified(robot, motion, check_motion(robot, motion, limits), limits)
    assert checked.certified
    assert checked.headline == "PROVED for the given uncertainty"
    bounds, acting = checked.certificate.verdict.bounds, robot.during(motion)
    samples = robot.samples(motion, np.linspace(0, motion.end, 3001))
    assert 0.99 * bounds["GN"] < samples.tip.GN.max() <= bounds["GN"]
    assert samples.slip.GT.max() <= bounds["GT"]
    assert (np.abs(samples.torques) / robot.limits.torque).max() <= bounds["torque_ratio"]
    cases = worst_case_of(robot, LATE)
    looked = jump_states(motion, LATE, None, acting)
    assert looked.s.shape[1] == 3 * robot.n + 6
    axes = range(cases.axes)
    moments = min(
        cases.moments(looked.s, np.full(len(looked.s), axis), max_delay=looked.max_delay).values.min()
        for axis in axes
    )
    assert float(cases.tip_ratio(np.array(moments))) <= bounds["GN_worst_case"] <= 1
    assert check_certificate(checked.certificate.data).holds


def test_what_goes_on_changing_after_a_motion_is_no_part_of_its_certificate():
    task, bare = case("A", "base")
    motion = task.reference.time_scaled(1.5)
    knots = [-0.5, 0.3 * motion.end, 0.5 * motion.end, 2 * motion.end]
    process = mild("time", knots, "base")
    robot, limits = acted(bare, process), Limits()
    checked = certified(robot, motion, check_motion(robot, motion, limits), limits)
    assert checked.headline == "PROVED for the nominal model only (no uncertainty)"
    arm = checked.certificate.data["model"]["arm"]
    assert arm["process_times"] == [0.0, *knots[1:3], motion.end]
    expected = np.hstack(process.at(np.array(arm["process_times"])))
    np.testing.assert_allclose(arm["process_in_base"], expected, atol=1e-12)


def test_nothing_within_a_tolerance_is_below_what_is_proved_of_what_varies(both):
    robot, _, motion = both
    acting, own = robot.during(motion), replace(SMALL, speed=0.05)
    asked = {"GN_worst_case": 0.999, "GT_worst_case": 0.999}
    data = model_data(acting), motion_data(motion), tolerance_data(own, robot.support)
    sharing = Sharing(*data, asked)
    ends = np.unique(np.concatenate([np.linspace(0, sharing.late.end, 400), sharing.late.events]))
    [rows] = sharing.late.rows(ends[:-1], ends[1:])
    proved = np.min(sharing.moments(sharing.terms(rows)))
    times = np.linspace(1e-6, motion.end - 1e-6, 1000)
    states = np.hstack([*motion.states(times), acting.acting(times)])
    found = np.min(worst_case_of(robot, own).all_moments(states))
    assert -1e-6 <= (found - proved) / robot.tip_over.reference_moment <= 0.02


def test_a_certificate_with_another_process_does_not_hold():
    task, bare = case("A")
    robot = acted(bare, varying("share", [0.0, 0.5, 1.0]))
    checked = certified(robot, task.reference, check_motion(robot, task.reference))
    data = checked.certificate.data
    assert check_certificate(data).holds
    arm = data["model"]["arm"]
    on_link = np.array(arm[PROCESS[1]])
    for change in (
        {PROCESS[1]: (30 * on_link).tolist()},
        {PROCESS[1]: on_link[0].tolist()},
        {TIMES: arm[TIMES][::-1]},
        {TIMES: [0.0, 0.0, 1.0]},
        {TIMES: []},
    ):
        model = {**data["model"], "arm": {**arm, **change}}
        other = {**data, "model": model, "sha256": {**data["sha256"], "model": digest(model)}}
        assert not check_certificate(other).holds


@examples(60, derandomize=True)
@given(
    st.lists(st.floats(-1, 3), min_size=1, max_size=6, unique=True),
    st.lists(st.tuples(st.floats(-1.5, 3.5), st.floats(0, 2)), min_size=1, max_size=4),
    st.integers(0, 1000),
)
def test_forms_enclose_what_is_interpolated(knots, intervals, seed):
    _, bare = case("A")
    data = dict(model_data(bare)["arm"])
    knots = np.unique(np.round(knots, 6))
    values = np.random.default_rng(seed).normal(size=(len(knots), 6)) * 50
    data[PROCESS[0]], data[PROCESS[1]], data[TIMES] = values, 0 * values, knots
    arm = Arm(data, np.zeros(3), np.zeros(3))
    ends = np.array([(a, a + length) for a, length in intervals]).T
    form = arm._process_between(arm.process[0], ends)
    for s in np.linspace(-1, 1, 41):
        times = 0.5 * (ends[0] + ends[1]) + 0.5 * s * (ends[1] - ends[0])
        exact = np.array([np.interp(times, knots, column) for column in values.T])
        middle = form.c[0] + form.c[1] * s
        assert np.all(np.abs(exact - middle) <= form.r)
    for a, b in ends.T:  # no more than it must be where there is no knot
        if not np.any((knots > a) & (knots < b)):
            alone = arm._process_between(arm.process[0], np.array([[a], [b]]))
            steep = np.max(np.abs(np.diff(values, axis=0)) / np.diff(knots)[:, None], axis=0, initial=0.0)
            assert np.all(alone.r[:, 0] <= 1e-8 * (1 + steep + np.max(np.abs(values))))


@pytest.mark.slow
def test_stops_along_the_path_have_the_process_of_the_place(both):
    robot, bare, motion = both
    times = np.array([0.2, 0.45, 0.8]) * motion.end
    q, qd, qdd = motion.states(times)
    acting = robot.during(motion).acting(times)
    wrenches = affine_loads(robot, q, qd, qdd, acting)[1]
    for k, wrench in enumerate(acting):
        constant = acted(bare, ProcessWrench(wrench[:3], wrench[3:], robot.arm.process.axes))
        alone = affine_loads(constant, q[k : k + 1], qd[k : k + 1], qdd[k : k + 1])[1]
        for mine, other in zip(wrenches, alone, strict=True):
            np.testing.assert_allclose(mine[k], other[0], atol=1e-9)
    limits = Limits(stops=PathStops())
    checked = check_motion(robot, motion, limits)
    shares = StoppedPath(robot, motion, limits).safe_speeds()
    assert (checked.worst["GN_stop"].value <= 0.9) == bool(np.all(shares >= 1 - 1e-9))
    slopes = stop_slopes(robot, 0.0)
    assert slopes._gradient.function.size1_in(0) == 3 * robot.n + 6


@pytest.mark.slow
@pytest.mark.parametrize("speed", some(1, [1.1, 1.0]))
def test_forces_are_those_of_a_simulation_of_what_varies(both, speed):
    """Also at another pace, with which the process goes; without the process they are off."""
    pytest.importorskip("mujoco")
    robot, bare, motion = both
    knots = np.array([0.0, 0.3, 0.5, 0.7, 1.0]) * motion.end
    own = acted(bare, mild("time", knots, robot.arm.process.axes))
    parts = [(Part(one, motion),) for one in (own, bare)]
    replay = Simulator(parts[0]).run(World(speed=speed))
    beside, without = (compared(part, replay) for part in parts)
    assert beside.rms < 0.15  # N
    assert without.rms > 10 * beside.rms
    text = to_mjcf(own, motion)
    assert "process moment z" in text
    assert "the process varies: controls of process force x" in text


def test_shares_are_not_times():
    task, bare = case("A")
    robot = acted(bare, varying("share", [0.0, 1.0]))
    with pytest.raises(InputError, match="varies over share, which the time alone does not tell"):
        robot.acting(np.zeros(1))
    assert robot.during(task.reference).acting(np.zeros(3)).shape == (3, 6)
    assert bare.acting(np.zeros(3)).shape == (3, 0)
