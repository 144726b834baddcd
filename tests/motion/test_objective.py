"""Objectives: costs, derivatives in the programs, and plans that are faster or of a given duration."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.api.plan import price_of_stops
from ocptip.basics.errors import InputError
from ocptip.cli.layout import price_line
from ocptip.motion.objective import ENERGY, TIME, Objective, objective_of, priced
from ocptip.motion.plan import plan_motion
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.task import refusals
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.limit_kinds.kinds import DurationLimit
from ocptip.standing.limits import Limits


@pytest.fixture(scope="module")
def task():
    """Case A with faster drives, so that haste costs something."""
    task = experiment_task("A", "effective")
    robot, limits = task.robot, task.robot.arm.limits
    arm = robot.arm.with_limits(speed=2 * limits.speed, acceleration=1.5 * limits.acceleration)
    faster = Robot(arm, robot.support, robot.motors, obstacles=robot.obstacles)
    return dataclasses.replace(task, robot=faster, reference=None, commands=1)


def planned(task, objective=ENERGY, **limits):
    limits = dataclasses.replace(task.limits, **limits)
    return plan_motion(dataclasses.replace(task, objective=objective, limits=limits), starts=1, jobs=1)


@pytest.fixture(scope="module")
def least_energy(task):
    return planned(task)


def test_costs():
    assert ENERGY.cost(200.0, 1.5) == 200.0
    assert TIME.cost(200.0, 1.5) == pytest.approx(1.502)
    assert priced(40.0).cost(200.0, 1.5) == 260.0
    assert objective_of(None, None) is ENERGY
    assert objective_of("time", None) is TIME
    assert objective_of(None, 3.0) == objective_of("both", 3.0) == priced(3.0)


@pytest.mark.parametrize(
    ("name", "price", "message"),
    [
        ("speed", None, "objective: expected energy, time or both, got 'speed'"),
        ("both", None, "objective: both needs price_per_second"),
        ("time", 3.0, "price_per_second: belongs to the objective both, not to time"),
        (None, 0.0, "price_per_second: must be > 0"),
        (None, float("nan"), "price_per_second: must be finite"),
    ],
)
def test_bad_objectives_are_named(name, price, message):
    with pytest.raises(InputError, match=message):
        objective_of(name, price)


@pytest.mark.parametrize("objective", [TIME, priced(70.0)], ids=lambda o: o.name)
def test_derivatives_of_the_objective_by_differences(objective):
    task = experiment_task("A", "effective")
    formulation = Formulation(
        task.robot, task.start, task.goal, task.optimised, task.commands, objective=objective
    )
    order, x = order_of(formulation, formulation.variables(task.reference))
    program = formulation.ordered_program(task.limits, order, x, [])
    energy, end = program.energy(x), x[formulation.layout.end]
    assert program.values(x)[0] * objective.size == pytest.approx(objective.cost(energy, end), rel=1e-12)
    step = 1e-6
    shifts = step * np.eye(len(x))
    values = [(program.values(x + s)[0] - program.values(x - s)[0]) / (2 * step) for s in shifts]
    np.testing.assert_allclose(program.gradient(x), values, rtol=1e-5, atol=1e-6)
    if objective is TIME:  # whose curvature is lost in the rounding of differences
        return
    slopes = np.array([(program.gradient(x + s) - program.gradient(x - s)) / (2 * step) for s in shifts])
    none = np.zeros(len(program.bounds()[0]))
    hessian = program.hessian(x, 1.0, none)
    scale = np.abs(hessian).max()
    np.testing.assert_allclose(hessian, slopes, rtol=1e-4, atol=1e-6 * scale)


def test_the_fastest_motion_is_faster_and_costs_more(task, least_energy):
    fastest = planned(task, TIME)
    assert fastest.verified
    assert fastest.duration < 0.95 * least_energy.duration
    assert fastest.energy > least_energy.energy


@pytest.mark.slow
def test_a_price_lies_between(task, least_energy):
    objective = priced(100.0)
    plan = planned(task, objective)
    assert plan.verified
    assert plan.duration < least_energy.duration
    here, there = (objective.cost(p.energy, p.duration) for p in (plan, least_energy))
    assert here < there


@pytest.mark.slow
def test_a_duration_is_met_and_a_greatest_one_kept(task, least_energy):
    slow = least_energy.duration + 0.2
    exact = planned(task, min_duration=slow, max_duration=slow)
    assert exact.verified
    assert exact.duration == pytest.approx(slow, abs=1e-9)
    assert exact.energy > least_energy.energy
    bound = 0.95 * least_energy.duration  # the fastest motion takes 0.927
    short = planned(task, max_duration=bound)
    assert short.verified
    assert short.duration <= bound + 1e-9


def test_durations_are_checked_and_refused(task, least_energy):
    def duration(least, most):
        limits = Limits(min_duration=least, max_duration=most)
        return DurationLimit(task.robot, limits, (0, 1, 2)).worst(
            np.empty((0, 0)), SimpleNamespace(motion=least_energy.motion)
        )

    end = least_energy.duration
    assert duration(0.0, np.inf) == []
    assert not duration(0.0, end + 0.1)[0].broken
    short, long = duration(0.0, end - 0.1)[0], duration(end + 0.1, end + 0.2)[0]
    assert short.broken
    assert long.broken
    assert (short.least, long.least) == (False, True)
    (reason,) = refusals(dataclasses.replace(task, limits=Limits(max_duration=0.2)))
    assert "max_duration: joint" in reason
    with pytest.raises(InputError, match="max_duration: must be >= min_duration"):
        Limits(min_duration=2.0, max_duration=1.0)
    with pytest.raises(InputError, match="max_duration: must be > 0"):
        Limits(max_duration=float("nan"))


def test_an_objective_is_data():
    assert priced(2.0).to_dict() == {
        "name": "both",
        "energy_weight": 1.0,
        "time_weight": 2.0,
        "unit": "J",
    }
    assert isinstance(TIME, Objective)


@pytest.mark.parametrize(("objective", "words"), [(ENERGY, "+50.0 % energy"), (TIME, "+20.0 % duration")])
def test_the_cost_of_stops_is_that_of_the_objective(objective, words):
    task = SimpleNamespace(objective=objective)
    task.segments = [SimpleNamespace(task=task)]
    plan, without = (
        SimpleNamespace(task=task, energy=energy, duration=duration)
        for energy, duration in ((300.0, 1.2), (200.0, 1.0))
    )
    [line] = price_line(price_of_stops(plan, without))
    assert line == f"cost of stops: {words} against the plan without, 200.0 J in 1.000 s"
