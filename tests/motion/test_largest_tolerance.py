"""The largest tolerance of a motion by bisection: what it says is what the plans it made say."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.basics.errors import PlanningError
from ocptip.motion import largest_tolerance as module
from ocptip.motion import multi_start
from ocptip.motion.multi_start import ToleranceError
from ocptip.published.tasks import experiment_task
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from tests.quick import some


class _Plan:
    energy, interrupted = 1.0, False


def bisected(monkeypatch, most: float, error: ToleranceError, **how):
    """With a planner that finds a motion up to a tilt of `most`, degrees."""
    tried = []

    def plan_motion(task, starts, **_):
        tried.append(task.limits.tolerance.tilt)
        if tried[-1] > most:
            raise PlanningError("none")
        return _Plan()

    monkeypatch.setattr(module, "plan_motion", plan_motion)
    task = experiment_task("A", "effective")
    task = replace(task, limits=replace(task.limits, tolerance=error.too_much))
    return module.largest_tolerance(task, error, **how), tried


def too_much(tilt: float, factor: float) -> ToleranceError:
    error = ToleranceError("no motion")
    error.too_much, error.factor = Uncertainty(tilt=tilt), factor
    return error


@pytest.mark.parametrize("most", some(2, [0.011, 0.0199, 0.014]))
def test_the_answer_lies_between_a_motion_and_none(monkeypatch, most):
    found, tried = bisected(monkeypatch, most, too_much(0.02, 0.5))
    assert found.plans == len(tried) <= module.PLANS
    assert found.had.tilt <= most < found.not_had.tilt
    assert found.not_had.tilt - found.had.tilt <= 0.01 * 0.75 * 0.5**2
    assert str(found).startswith("a motion with floor tilt ")
    assert "; none with floor tilt " in str(found)
    assert found.to_dict()["found"] == {"tilt": found.had.tilt}


def test_what_motions_can_have_that_were_not_verified_narrows_the_bracket(monkeypatch):
    """The best of the motions found where none is verified can have 69 %, none more than 70 %."""

    def plan_motion(task, starts, **_):
        asked = task.limits.tolerance.tilt
        if asked > 0.014:
            error = too_much(asked, 0.69 * 0.02 / asked)
            raise error
        return _Plan()

    monkeypatch.setattr(module, "plan_motion", plan_motion)
    task = experiment_task("A", "effective")
    error = too_much(0.02, 0.0)
    error.at_rest = 1.0 - 1e-9
    found = module.largest_tolerance(task, error)
    assert found.had.tilt == pytest.approx(0.69 * 0.02)
    assert found.plan is None  # it is that of a motion that was not verified with more
    assert 0.014 < found.not_had.tilt <= 0.0143
    assert found.plans <= module.PLANS  # halving alone comes to within 1/32 of all
    assert found.not_had.tilt - found.had.tilt < module.CLOSE * found.not_had.tilt
    error.factor = 0.98
    assert module.largest_tolerance(task, error).plans == 0  # narrow enough


def test_all_of_a_quantity_alone_may_be_had(monkeypatch):
    found, tried = bisected(monkeypatch, 1.0, too_much(0.02, 0.5))
    assert tried == [0.02]
    assert found.not_had is None
    assert "none with" not in str(found)


def test_what_no_plan_has_is_what_the_best_motion_has(monkeypatch):
    found, _ = bisected(monkeypatch, 0.0, too_much(0.02, 0.5))
    assert (found.had.tilt, found.plan) == (pytest.approx(0.01), None)


def test_no_plan_is_begun_when_time_is_over(monkeypatch):
    found, tried = bisected(monkeypatch, 0.0, too_much(0.02, 0.5), seconds=0.0)
    assert (tried, found.plans, found.not_had) == ([], 0, None)


def test_an_interrupt_keeps_what_was_found(monkeypatch):
    tried = []

    def plan_motion(task, **_):
        tried.append(task.limits.tolerance.tilt)
        if len(tried) == 2:
            raise KeyboardInterrupt
        return _Plan()

    error = too_much(0.02, 0.5)
    task = experiment_task("A", "effective")
    monkeypatch.setattr(module, "plan_motion", plan_motion)
    found = module.largest_tolerance(task, error)
    assert tried == pytest.approx([0.02])  # all of it alone: there is no more
    assert not found.interrupted
    tried.clear()
    error.too_much, error.factor, error.at_rest = Uncertainty(tilt=0.02), 0.0, 0.5
    found = module.largest_tolerance(task, error)
    assert tried == pytest.approx([0.0075, 0.009375])
    assert (found.had.tilt, found.not_had, found.interrupted) == (pytest.approx(0.0075), None, True)
    assert f"{found}".endswith("(2 plans of 2 starts, then interrupted)")
    assert found.to_dict()["interrupted"] is True


def test_a_plan_that_was_interrupted_with_a_motion_is_the_last(monkeypatch):
    plan = _Plan()
    plan.interrupted = True
    monkeypatch.setattr(module, "plan_motion", lambda *_, **__: plan)
    error = too_much(0.02, 0.0)
    error.at_rest = 0.5
    found = module.largest_tolerance(experiment_task("A", "effective"), error)
    assert (found.had.tilt, found.plans, found.interrupted) == (pytest.approx(0.0075), 1, True)


@pytest.mark.slow
def test_where_ends_cannot_have_it_at_rest_bisection_begins_with_what_they_can(monkeypatch):
    task = experiment_task("H", "effective")
    task = replace(task, limits=replace(task.limits, tolerance=WORKSHOP))
    error = module.too_much_at_rest(task)
    assert error.too_much == Uncertainty(tilt=WORKSHOP.tilt)
    assert math.degrees(error.at_rest * WORKSHOP.tilt) == pytest.approx(0.451, abs=1e-3)
    most = 0.7 * error.at_rest * WORKSHOP.tilt
    found, tried = bisected(monkeypatch, most, error)
    assert max(tried) < error.at_rest * WORKSHOP.tilt
    assert found.had.tilt <= most < found.not_had.tilt
    assert str(found.at_rest) == "floor tilt 0.451 deg"
    assert "; start and goal stand at rest with up to floor tilt 0.451 deg (" in str(found)


def test_other_refusals_are_not_about_tolerance():
    task = experiment_task("A", "effective")
    assert module.too_much_at_rest(task) is None
    limits = replace(task.limits, tolerance=WORKSHOP, max_duration=0.01)
    assert module.too_much_at_rest(replace(task, limits=limits)) is None


def test_errors_travel_between_processes():
    error = pickle.loads(pickle.dumps(too_much(0.02, 0.5)))
    assert (error.too_much, error.factor, error.alone) == (Uncertainty(tilt=0.02), 0.5, True)


@pytest.mark.parametrize(
    ("share", "expected"), [(1.0, "the tolerance is not what they lack"), (0.997, " 99 % of it")]
)
def test_a_refusal_does_not_say_that_all_of_the_tolerance_can_be_had(monkeypatch, share, expected):
    """A motion that keeps the whole tolerance was refused for something else, here stops."""
    monkeypatch.setattr(multi_start, "tolerable", lambda *_: share)
    monkeypatch.setattr(multi_start, "too_much", lambda *_: (WORKSHOP, share, "why"))
    task = experiment_task("A", "effective")
    task = replace(task, limits=replace(task.limits, tolerance=WORKSHOP))
    check, result = (
        SimpleNamespace(violations=(Worst("", 0.0, np.nan, 0.0, "GT is 2", np.inf),)),
        SimpleNamespace(energy=1.0, number=3),
    )
    error = multi_start._refusal(task, [SimpleNamespace(check=check, result=result, motion=task.reference)])
    assert expected in str(error)
    assert "100 %" not in str(error)
    assert str(error).endswith("start 3: GT is 2")
    assert isinstance(error, ToleranceError) == (share < 1)
