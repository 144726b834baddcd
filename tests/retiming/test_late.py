"""Timings within a tolerance: joints that are late, or overshoot where they jump, each by itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy

from ocptip.basics.errors import InputError
from ocptip.certificate.describe import motion_data, tolerance_data
from ocptip.motion.objective import TIME, priced
from ocptip.motion.task import MotionTask
from ocptip.retiming.cheapest import Price, cheapest
from ocptip.retiming.drives import QuadraticDrives
from ocptip.retiming.fastest import ExtraRows, Grid, fastest, spaced
from ocptip.retiming.late import NAMES, Couplings, LateJoints
from ocptip.retiming.retime import Retimed, retime
from ocptip.retiming.rows import TimingLimits
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from ocptip.standing.within import late_joints
from ocptip.standing.within.in_motion import worst_within
from ocptip.standing.within.late_joints import DelayCase, delay_cases
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from ocptip.trajectories.path import JointPath
from tests.places import EXAMPLES
from tests.quick import some
from tests.retiming.paths import cart, random_path, tripod

NODES = 16


@cache
def waiter() -> tuple[MotionTask, JointPath]:
    """A UR5 with three glasses on a tray, and a path on which the tray stays level."""
    task = load_task(EXAMPLES / "tasks" / "ur5_waiter.toml")
    return task, load_path(EXAMPLES / "paths" / "ur5_waiter.toml", task).paths[0].path


@cache
def within(objective=TIME) -> Retimed:
    """A timing within the tolerances of a workshop."""
    task = cart()
    limits = replace(task.limits, tolerance=WORKSHOP)
    return retime(task.robot, random_path(task, 0, 0.1), limits, objective, nodes=NODES)


def test_rows_that_no_timing_keeps_are_told_with_place_limit_and_amount():
    """x at a node is never negative, so a row x <= -0.02 is missed by 0.02 of its reference."""
    task = cart()
    path, limits = random_path(task, 0, 0.1), TimingLimits(task.robot, task.limits)
    grid = Grid(task.robot, path, limits, spaced(path, NODES))
    fast = fastest(grid, ExtraRows.none())
    row, typical = np.zeros((1, len(grid.s))), float(np.mean(fast.x))
    row[0, 5] = 1 / typical

    def solved(b: float, longest: float = np.inf):
        rows = Couplings(scipy.sparse.csr_matrix(row), np.array([b]), (NAMES[1],))
        drives = QuadraticDrives.free(task.robot.n)
        return cheapest(grid, fast.polygons, drives, Price(0.0, 1.0, longest), fast.x, rows).x[5]

    assert solved(0.2) <= 0.2 * typical * (1 + 1e-6)
    told = rf"slip within tolerance exceeds its limit by 2 % .* near s = {grid.s[5]:.4f} of .* move the path"
    with pytest.raises(InputError, match=told):
        solved(-0.02)
    shortest = float(np.sum(2 * grid.widths / (np.sqrt(fast.x[1:]) + np.sqrt(fast.x[:-1]))))
    with pytest.raises(InputError, match="max_duration: no timing within the uncertainty takes"):
        solved(0.01 * fast.x[5] / typical, 1.001 * shortest)


@pytest.mark.slow
def test_a_timing_within_a_tolerance_keeps_every_contact():
    """By its check, and in 4,000 worlds: masses, tilt, pace, and of each joint its own delay."""
    found, robot = within(), cart().robot
    assert found.verified
    assert found.check.within is not None
    assert 0.9 < found.check.worst["GN_worst_case"].value <= 0.999
    assert found.motion.end > 1.005 * found.fastest
    assert found.slower < 1.003
    rng, cases, n = np.random.default_rng(0), worst_case_of(robot, WORKSHOP), robot.n
    deviations = cases.deviations
    for t in rng.uniform(0, found.motion.end, 40):
        late = (t - rng.uniform(0, WORKSHOP.delay * (1 + WORKSHOP.speed), (100, n))).ravel()
        parts = [part.reshape(100, n, n) for part in found.motion.states(late)]
        states = [part[:, np.arange(n), np.arange(n)] for part in parts]
        theta = rng.uniform(deviations.low, deviations.high, (100, deviations.size))
        theta[:, deviations.places["delay"]] = 0.0
        theta[:, deviations.places["gravity"]] = deviations.least(rng.normal(size=theta.shape))[
            :, deviations.places["gravity"]
        ]
        for axis in range(cases.axes):
            moments = cases.moments(np.hstack(states), np.full(100, axis), theta).values
            assert np.all(moments > 0)


@pytest.mark.slow
def test_accelerations_that_change_between_jumps_are_late_too():
    """Moments in worlds that are searched for, with joints late or overshooting, are no less than in the
    check; without what joints were the longest delay before they would be."""
    pytest.importorskip("flint")
    from tests.oracles.world_in_balls import LateJoints as Worlds

    task, rng = cart(), np.random.default_rng(0)
    motion = retime(task.robot, random_path(task, 2, 0.1), task.limits, nodes=40).motion.time_scaled(1.3)
    found = worst_within(task.robot, motion, WORKSHOP, motion.both_sides(0.01)).tip
    assert found is not None
    late = Worlds(motion_data(motion), tolerance_data(WORKSHOP, task.robot.support))
    cases = worst_case_of(task.robot, replace(WORKSHOP, delay=0.0, damping=None))

    def moments(choices: list) -> np.ndarray:
        states = np.array([late.state(choice).ravel() for choice in choices])
        return np.min(cases.all_moments(states), axis=1)

    best = [late.draw(found.time, rng) for _ in range(2000)]
    values = moments(best)
    best, values = [best[k] for k in np.argsort(values)[:40]], np.sort(values)[:40]
    for k in range(20):
        others = [late.moved(choice, 0.8**k, rng) for choice in best]
        new = moments(others)
        best = [b if y < x else a for a, b, x, y in zip(best, others, values, new, strict=True)]
        values = np.minimum(values, new)
    GN = cases.tip_ratio(np.min(values, keepdims=True))[0]
    assert found.bound + 1e-3 >= GN
    assert GN > 0.748  # what the check said before


@pytest.mark.slow
def test_the_cheapest_timing_within_a_tolerance():
    found = within(priced(20.0))
    assert found.verified
    assert found.cheapest is not None
    assert found.cheapest.gap < 1e-4
    assert found.motion.end > within().motion.end
    assert found.check.energy < within().check.energy


@pytest.mark.parametrize("glasses", [False, True])
def test_rows_of_late_joints_are_slopes(glasses: bool):
    """Of what they bound, by finite differences, but for angles, by which late joints tilt a tray."""
    task, path = waiter() if glasses else (cart(), random_path(cart(), 0, 0.1))
    limits = TimingLimits(task.robot, replace(task.limits, tolerance=WORKSHOP))
    grid = Grid(task.robot, path, limits, spaced(path, NODES))
    x = fastest(grid, ExtraRows.none()).x
    late, rng = LateJoints(grid), np.random.default_rng(1)
    rows = late._broken(x)[2]
    assert len(rows) > 5
    step = 1e-6 * x * rng.normal(size=len(x))
    other = late._broken(x + step)[2]
    assert other.names == rows.names
    assert any("of glass" in name for name in rows.names) == glasses
    excess = [own.A @ at - own.b for own, at in ((rows, x), (other, x + step))]
    change = rows.A @ step
    np.testing.assert_allclose(
        excess[1] - excess[0], change, atol=(5e-3 if glasses else 2e-3) * np.max(np.abs(change))
    )


@pytest.mark.parametrize("driven", some(1, [slice(0, 2), slice(2, 4)]))
def test_rows_of_a_base_that_slides_leave_slower_timings(driven: slice):
    """On two wheels and two casters: what keeps the limits keeps the rows that a sliding timing gives."""
    task = cart()
    contacts = np.array(task.robot.support.contacts, dtype=object)
    for k, contact in enumerate(contacts):
        contacts[k] = replace(contact, friction=0.15 if k in range(4)[driven] else 0.0)
    robot = task.robot.varied(support=task.robot.support.varied(list(contacts)))
    path = random_path(task, 0, 0.1)
    limits = TimingLimits(robot, replace(task.limits, tolerance=WORKSHOP))
    late = LateJoints(grid := Grid(robot, path, limits, spaced(path, NODES)))
    x = fastest(grid, ExtraRows.none()).x
    excess, rows = late.broken(x)
    assert excess > 0.05  # of the weight
    assert len(rows) > 0
    assert np.any(rows.A @ x > rows.b)
    kept = [share for share in (0.1, 0.2, 0.3) if late.broken(share * x)[0] <= 0]
    assert kept
    assert all(np.all(rows.A @ (share * x) <= rows.b + 1e-6) for share in [0, *kept])


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(1, [7, 20]))
def test_of_too_many_combinations_the_worst_is_found(monkeypatch: pytest.MonkeyPatch, seed: int):
    """As bad as the worst of all of them."""
    task = tripod()
    motion = retime(task.robot, random_path(task, seed, 0.1), task.limits, nodes=12).motion
    cases = worst_case_of(task.robot, WORKSHOP)
    every = late_joints.jump_states(motion, WORKSHOP)
    assert 5000 < len(every.times) < 150_000
    monkeypatch.setattr(late_joints, "MOST_OF_ALL", 100)
    few = late_joints.jump_states(motion, WORKSHOP, cases)
    assert len(few.times) < len(every.times) / 20
    for own in (few, every):
        assert len(own.words) == len(own.times) == len(own.s) == len(own.max_delay)
    worst = [cases.estimated_moments(own.s, own.max_delay).min(axis=0) for own in (few, every)]
    np.testing.assert_allclose(*worst, atol=1e-9 * cases.reference)
    slips = [cases.estimated_slip(own.s, own.max_delay).max() for own in (few, every)]
    assert slips[0] == pytest.approx(slips[1], rel=3e-3)


@pytest.mark.parametrize("overshoots", [False, True])
def test_what_a_joint_may_be_doing(overshoots: bool):
    """Events 6 and 2 ms before: late up to each, overshooting its step or the last two, or on time."""
    found = delay_cases([0.994, 0.998], 1.0, 0.010, overshoots)
    late = [DelayCase(0, 0, pytest.approx(0.004)), DelayCase(1, 0, pytest.approx(0.004))]
    over = [DelayCase(0, 1, 0.0), DelayCase(1, 1, 0.0), DelayCase(1, 2, 0.0)] if overshoots else []
    on_time = DelayCase(None, 0, pytest.approx(0.002))
    assert sorted(found, key=str) == sorted([*late, *over, on_time], key=str)
    assert found[-1] == on_time
    at_once = delay_cases([1.0], 1.0, 0.010, overshoots)
    assert at_once[0] == DelayCase(0, 0, pytest.approx(0.010))
    assert at_once[1:] == ([DelayCase(0, 1, 0.0)] if overshoots else [DelayCase(None, 0, 0.0)])
    assert delay_cases([], 1.0, 0.010, overshoots) == [DelayCase(None, 0, 0.010)]
    assert delay_cases([0.994], 1.0, 0.0, overshoots=False) == [DelayCase(None, 0, 0.0)]


@pytest.mark.slow
def test_a_timing_within_a_tolerance_keeps_a_glass_on_its_tray():
    """Rows of its contacts are those of late joints, too: the timing need not be slowed until it stands."""
    task, path = waiter()
    limits = replace(task.limits, tolerance=Uncertainty(friction=0.1, delay=0.004))
    found = retime(task.robot, path, limits, nodes=NODES)
    assert found.verified
    assert found.slower < 1.001
    critical = max(value.value for name, value in found.check.worst.items() if "worst_case[glass" in name)
    assert 0.93 < critical < 0.96
