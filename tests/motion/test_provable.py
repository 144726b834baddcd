"""Motions are a little slower where that proves that cancels lose no contact."""

import dataclasses
from types import SimpleNamespace

import pytest

from ocptip.api.results.plan import Plan
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.certificate.checks import certified
from ocptip.certificate.result import Certificate
from ocptip.certificate.trusted.checker import Verdict, check_certificate
from ocptip.cli.plan.plan_report import PlanReport
from ocptip.motion.check import check_motion
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.plan import proved_part
from ocptip.motion.provable import UNTIL_CANCELS, proved_slower, sampled_near
from ocptip.numerics.time_limit import TimeBudget
from ocptip.published.tasks import experiment_task
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.tolerance import Uncertainty
from tests.certificate.test_find import _nod
from tests.pictures.plan_stand_in import stand_in_plan


def _proof(lacking):
    """Of a motion; of its cancels a worst value is sampled."""
    return Certificate({}, Verdict(True, (), {}, 1), kept=True, sampled=("GN_cancel_worst_case",) * lacking)


def test_the_smallest_step_is_taken_that_proves_the_cancels():
    tried = list[float]()

    def again(factor, enough):
        tried.append(factor)
        lacks = factor < enough
        known = {"proved_while_moving": True, "lacks_cancels": lacks}
        return SimpleNamespace(check=SimpleNamespace(**known, not_proved=lambda asked: []))

    for enough, steps in ((1.01, 1), (1.03, 2), (1.1, 2)):
        tried.clear()
        slower = proved_slower(again(1.0, enough), lambda factor, most=enough: again(factor, most), [])
        assert tried[1:] == list(UNTIL_CANCELS[:steps])
        assert (slower is None) == (enough == 1.1)


@pytest.mark.parametrize(
    ("excess", "gain", "factors"),
    [
        (0.0, 2.0, [1.004]),
        (0.0, 0.3, [1.004, 1.02]),
        (0.0, 0.15, [1.004]),
        (-0.03, 0.3, [1.016]),  # samples are far from the limit
    ],
)
def test_what_gains_little_of_time_is_as_slow_as_is_allowed_if_that_is_enough(excess, gain, factors):
    tried, limit = list[float](), SimpleNamespace(number=1.0, largest_step=0.02, of_place=False, result="GT")
    worst = {"GT": SimpleNamespace(excess=excess)}

    def again(factor):
        tried.append(factor)
        short = 0.004 - gain * (factor - 1)
        faults = [(limit, short, [0.0])] if short > 0 else []
        known = {"proved_while_moving": not faults, "lacks_cancels": False}
        return SimpleNamespace(check=SimpleNamespace(**known, worst=worst, not_proved=lambda asked: faults))

    slower = proved_slower(again(1.0), again, [])
    assert tried[1:] == pytest.approx(factors)
    assert (slower is None) == (gain == 0.15)


def test_tighter_numbers_help_only_where_samples_are_near_them():
    limit = SimpleNamespace(result="GT_worst_case")
    for excess, near in ((-0.03, False), (-0.01, True)):
        checked = SimpleNamespace(worst={"GT_worst_case": SimpleNamespace(excess=excess)})
        assert sampled_near(checked, [(limit, 0.004, [0.0])]) == near


@pytest.mark.parametrize("ends", [False, True])
def test_a_slow_motion_of_all_joints_is_slower_until_its_cancels_are_proved(ends):
    """Where the time is up before, the proof of the motion stays."""
    planned, factors = dataclasses.replace(stand_in_plan("C"), starts=()), list[float]()

    def prove(robot, motion, checked, limits):
        if factors and ends:
            raise TimeIsUpError
        factors.append(motion.end / planned.motion.end)
        return dataclasses.replace(checked, certificate=_proof(lacking=len(factors) < 2))

    part = proved_part(planned, prove)
    assert part.check.proved_while_moving
    assert part.check.lacks_cancels == ends
    assert part.slower == (1.0 if ends else 1.02)
    assert factors == pytest.approx([1.0] if ends else [1.0, 1.02])
    assert part.motion.end == pytest.approx(part.slower * planned.motion.end)


def test_an_answer_says_by_how_much_a_motion_is_slower():
    planned = dataclasses.replace(stand_in_plan("C"), slower=1.02)
    plan = Plan.of(planned, budget=TimeBudget(0.0))
    assert "2 % slower than planned, so that its proof is complete" in PlanReport(plan).to_text()
    assert plan.to_dict()["slower_to_prove"] == 1.02


@pytest.mark.slow
def test_a_nod_whose_cancels_are_too_close_to_a_limit_is_slower_and_proved(monkeypatch):
    """Its own steps of acceleration are as large as those of gentle cancels; slower, they are smaller.

    Samples have GN 0.343437. Few boxes, enough for the slower motion, do not prove 0.34344 for this one.
    """
    monkeypatch.setattr("ocptip.certificate.find_cancels._MOST", 400)
    task = experiment_task("B")
    tolerance = Uncertainty(delay=0.01, speed=0.02, friction=0.05, damping=0.2, tilt=0.005)
    cancel = Cancel(tuple((0.03 * task.robot.limits.acceleration).tolist()), longest=9.0)
    limits = dataclasses.replace(task.limits, tolerance=tolerance, cancel=cancel, GN_worst_case=0.34344)
    task, motion = dataclasses.replace(task, limits=limits), _nod(task)
    checked = check_motion(task.robot, motion, limits)
    assert checked.verified
    assert certified(task.robot, motion, checked, limits).lacks_cancels
    planned = MotionPlan(task, motion, checked, (), 0, 0, 0.0, False, {})
    part = proved_part(planned, certified)
    assert part.slower == UNTIL_CANCELS[0]
    assert part.motion.end == pytest.approx(part.slower * motion.end)
    assert part.check.certificate.cancels
    assert check_certificate(part.check.certificate.data).holds
