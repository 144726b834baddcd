"""Limits as objects: names of kinds, and a new kind that everything sees after one line in the list."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.cli.verify.check import worst_rows
from ocptip.motion.check import check_motion
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.planner.random_start import INSTANTS, _path_violation
from ocptip.motion.summary import margin_rows
from ocptip.motion.task import refusals
from ocptip.motion.violations import sentence
from ocptip.published.tasks import experiment_task
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds import kinds as limit_kinds
from ocptip.standing.limit_kinds.kinds import KINDS, AccelerationLimit, limits_of
from ocptip.standing.limit_kinds.limit import AskedLimit, QuantityLimit, Sampled, Worst
from ocptip.standing.limits import Limits
from ocptip.standing.stops.along_path import PathStops
from ocptip.standing.stops.by_brakes import Brakes
from ocptip.standing.tolerance import WORKSHOP


class ShoulderLimit(QuantityLimit):
    """The torque with which the second joint holds up what is behind it: minus the joint's torque."""

    name = "shoulder"
    largest = 14.5  # N m

    def __init__(self, robot, asked, joints):
        super().__init__(robot, asked, joints)
        self.units, self.width = np.array([-self.largest]), 1

    def measure(self, at):
        return -at.torques[:, 1:2]

    def worst(self, values, at):
        k = int(np.argmax(values))
        value, excess = float(values[k, 0]), float(values[k, 0]) - self.largest
        return [Worst("shoulder_Nm", value, float(at.times[k]), self.largest, "joint 2", excess)]

    def refusals(self, at):
        value = self.measure(at)[0, 0]
        return [f"the shoulder holds {value:.4g} N m"] if value > self.largest else []

    def path_excess(self, at):
        return np.max(self.measure(at)) / self.largest - 1

    def uses(self, at):
        return self.measure(at) / self.largest

    def bounds(self):
        return np.array([-np.inf]), np.array([1.0])

    def first(self, columns):
        return columns.torque.start + 1


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


@pytest.fixture
def with_shoulder(monkeypatch):
    monkeypatch.setattr(limit_kinds, "KINDS", (*KINDS, ShoulderLimit))


def test_limits_have_names_of_their_own(task):
    n = task.robot.n
    brakes = Brakes((5.0,) * n, (30.0,) * n)
    asked = replace(task.limits, stops=PathStops(), brakes=brakes, damping=0.02, tolerance=WORKSHOP)
    names = [limit.name for limit in limits_of(task.robot, asked)]
    names += [kind.name for kind in KINDS if kind.name and kind.name not in names]
    assert {
        f"{what} {when}" for what in ("tip-over", "slip") for when in ("at acceleration steps", "in stops")
    } <= {*names}
    assert all(names)
    assert len(set(names)) == len(names)


def test_numbers_asked_for_are_those_of_the_task(task):
    limits = {limit.name: limit for limit in limits_of(task.robot, task.limits)}
    asked = {name: limit for name, limit in limits.items() if isinstance(limit, AskedLimit)}
    times, rest = np.array([1.0, 2.0, 3.0]), Instants.at_rest(task.robot, task.start[None])
    sampled = Sampled(task.robot, task.reference, times, lambda _: rest)
    assert {limit.setting for limit in asked.values()} == {"GN", "GT", "torque_ratio", "clearance"}
    for limit in asked.values():
        sign = -1 if limit.least else 1
        number = getattr(task.limits, limit.setting)
        assert limit.number == number
        (worst,) = limit.worst(sign * np.array([[0.2], [0.5], [0.1]])[::sign], sampled)
        assert (worst.value, worst.time) == ((0.1, 1.0) if limit.least else (0.5, 2.0))
        assert worst.excess == pytest.approx(sign * (worst.value - number))
        for changed in (limit.inner(task.limits), limit.tightened(task.limits, 1e-3)):
            assert 0 < sign * (number - getattr(changed, limit.setting)) < 2e-3
            others = [other.setting for other in asked.values() if other is not limit]
            assert all(getattr(changed, other) == getattr(task.limits, other) for other in others)


def test_instants_are_the_samples_of_a_motion(task):
    times = np.linspace(0.01, task.reference.end, 20)
    samples = task.robot.samples(task.reference, times)
    at = Instants.of_states(task.robot, *task.reference.states(times))
    np.testing.assert_array_equal(at.torques, samples.torques)
    np.testing.assert_array_equal(at.wrenches, samples.wrenches)
    np.testing.assert_array_equal(at.tip.GN, samples.tip.GN)
    np.testing.assert_array_equal(at.slip.GT, samples.slip.GT)
    np.testing.assert_array_equal(at.gaps(np.inf).min(axis=1), samples.clearances)


def test_the_check_sees_a_new_kind(task, with_shoulder):
    motion = task.reference
    checked = check_motion(task.robot, motion, task.limits)
    worst = checked.worst["shoulder_Nm"]
    times = np.append(np.linspace(0.0, motion.end, 2001), worst.time)
    held = -task.robot.samples(motion, times).torques[:, 1]
    assert worst.value == held[-1] == np.max(held)
    assert worst in checked.violations
    assert (worst.detail, worst.limit) == ("joint 2", 14.5)
    (row,) = (row for row in margin_rows(task.robot, checked) if row[0] == "shoulder_Nm")
    assert row == ["shoulder_Nm", f"{worst.value:.3g} @{worst.time:.3f}s", "<= 14.5", "BROKEN"]
    assert ["shoulder_Nm", "BROKEN"] in [[row[0], row[-1]] for row in worst_rows(checked)]


def test_refusals_see_a_new_kind(task, with_shoulder, monkeypatch):
    assert refusals(task) == ()
    monkeypatch.setattr(ShoulderLimit, "largest", 13.5)
    assert refusals(task) == ("start: the shoulder holds 13.96 N m",)


def test_programs_see_a_new_kind(task, with_shoulder):
    """Rows, bounds, use, Jacobian and Hessian by differences."""
    formulation = Formulation(task.robot, task.start, task.goal, task.optimised, task.commands)
    order, x = order_of(formulation, formulation.variables(task.reference))
    program = formulation.ordered_program(task.limits, order, x, [])
    near = program.near_rows(x, 1.0)
    rows = program.no_rows()
    rows["shoulder"][:] = near["shoulder"]
    program = program.with_rows(rows)
    count, own = len(program.structure.lower), np.count_nonzero(near["shoulder"])
    assert own > 3
    assert np.max(program.use(x)) >= np.max(program.values(x)[1][count:])
    np.testing.assert_array_equal(program.bounds()[1][count:], np.ones(own))
    on = np.concatenate([np.zeros(count), np.random.default_rng(0).normal(size=own)])
    J, H, h = program.jacobian(x), program.hessian(x, 0.0, on), 1e-6
    for j in range(0, len(x) - 2, 3):
        step = h * (np.arange(len(x)) == j)
        slope = (program.values(x + step)[1] - program.values(x - step)[1]) / (2 * h)
        np.testing.assert_allclose(J[count:, j], slope[count:], atol=1e-5 * np.abs(J[count:]).max())
        bend = on @ (program.jacobian(x + step) - program.jacobian(x - step)) / (2 * h)
        np.testing.assert_allclose(H[j], bend, atol=1e-5 * np.abs(H).max())


def test_paths_of_random_starts_see_a_new_kind(task, with_shoulder, monkeypatch):
    monkeypatch.setattr(ShoulderLimit, "largest", 10.0)
    limits, motion = limits_of(task.robot, task.limits), task.reference
    q = motion.states(np.linspace(0, motion.end, INSTANTS))[0]
    held = -Instants.at_rest(task.robot, q).torques[:, 1]
    assert _path_violation(task.robot, motion, limits) == pytest.approx(np.max(held) / 10 - 1)
    assert _path_violation(task.robot, motion, limits[:-1]) < 0


def test_rounding_of_samples_breaks_no_peak_and_small_excesses_are_said():
    robot = experiment_task("A", "effective").robot
    limit = AccelerationLimit(robot, Limits(), (0,))
    for excess, rounding, said in (
        (5e-6, 1e-5, ""),
        (2e-5, 1e-5, "acceleration_ratio is 1 + 1e-05 (joint 1), must be <= 1"),
        (5e-6, 0.0, "acceleration_ratio is 1 + 5e-06 (joint 1), must be <= 1"),
        (1.0, 0.0, "acceleration_ratio is 2 (joint 1), must be <= 1"),
    ):
        peaks = robot.limits.acceleration * [1 + excess, 0, 0, 0, 0, 0]
        motion = SimpleNamespace(acceleration_peaks=peaks, peak_rounding=rounding)
        (worst,) = limit.worst(np.empty((0, 0)), SimpleNamespace(motion=motion))
        assert (sentence(worst) if worst.broken else "") == said
