"""Margins of a motion in N m, N, m and shares: turned back from the indices, and which one decides."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.margins import (
    CLEARANCE,
    FOOT_FORCE,
    FRICTION,
    TIPPING,
    TORQUE,
    critical,
    motion_margins,
)
from ocptip.motion.summary import at_text, margin_rows, margin_table
from ocptip.motion.violations import broken_words, quantity_title, stated, statement
from ocptip.published.tasks import experiment_task
from ocptip.standing.contact_margins import Margin
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, Limits
from ocptip.trajectories.trajectory import Trajectory


@pytest.fixture(scope="module")
def task():
    return experiment_task("C", "effective", Limits(GN=0.9, GT=0.8))


@pytest.fixture(scope="module")
def checked(task):
    return check_motion(task.robot, task.reference, task.limits)


def by_name(margins):
    return {margin.name: margin for margin in margins}


def test_nominal_margins_are_those_of_the_check(task, checked):
    found = by_name(motion_margins(task.robot, checked))
    moment, friction = checked.contacts.moment, checked.contacts.friction
    assert (found[TIPPING].nominal.value, found[TIPPING].nominal.time) == (moment.value, moment.time)
    assert found[FRICTION].nominal.value == friction.value
    assert found[FRICTION].limit == 0.8
    assert found[TORQUE].nominal.value == checked.worst["torque_ratio"].value
    assert found[CLEARANCE].nominal.value == checked.worst["clearance_m"].value
    assert all(margin.worst_case is None for margin in found.values())
    # GN is computed from the same moment by another part of the code.
    reference = task.robot.tip_over.reference_moment
    assert reference / (reference + moment.value) == pytest.approx(checked.worst["GN"].value, rel=1e-9)


@pytest.mark.parametrize("index", [1e-3, 0.3, 0.999])
def test_a_worst_case_index_is_turned_back_into_newton_metres(task, checked, index):
    tip = replace(checked.worst["GN"], value=index, limit=0.999, name=TIP_WITHIN)
    slip = replace(checked.worst["GT"], value=0.7, limit=0.999, name=SLIP_WITHIN)
    within = replace(checked, worst={**checked.worst, TIP_WITHIN: tip, SLIP_WITHIN: slip})
    found = by_name(motion_margins(task.robot, within))
    left, reference = found[TIPPING].worst_case.value, task.robot.tip_over.reference_moment
    assert reference / (reference + left) == pytest.approx(index, rel=1e-12)
    limit = found[TIPPING].limit_worst_case
    assert reference / (reference + limit) == pytest.approx(0.999, rel=1e-12)
    assert found[FRICTION].worst_case.value == 0.7


def test_beyond_a_lost_contact_the_margin_is_what_is_missing(task, checked):
    tip = replace(checked.worst["GN"], value=3.2, name=TIP_WITHIN)
    within = replace(checked, worst={**checked.worst, TIP_WITHIN: tip})
    margin = by_name(motion_margins(task.robot, within))[TIPPING]
    assert margin.worst_case.value == pytest.approx(-2.2 * task.robot.tip_over.reference_moment)
    assert margin.used > 1


def test_the_critical_margin_uses_its_limit_most(task, checked):
    margins = motion_margins(task.robot, checked)
    worst = max(("GN", "GT", "torque_ratio"), key=lambda n: checked.worst[n].value / checked.worst[n].limit)
    names = {"GN": TIPPING, "GT": FRICTION, "torque_ratio": TORQUE}
    assert critical(margins).name == names[worst]
    assert critical([]) is None
    data = by_name(motion_margins(task.robot, checked))[TIPPING].to_dict()
    assert data["nominal"]["contacts"] == tuple(checked.contacts.moment.contacts)


@pytest.mark.parametrize("pulls", [-12.0, 5.0])
def test_foot_forces_that_can_be_shared_differently_have_no_limit(task, checked, pulls):
    alike = replace(checked.contacts.force, value=pulls)
    contacts = replace(checked.contacts, unique=False, alike=alike)
    margin = by_name(motion_margins(task.robot, replace(checked, contacts=contacts)))[FOOT_FORCE]
    assert (margin.nominal.value, margin.limit) == (pulls, None)
    row = next(
        line for line in margin_table(task.robot, replace(checked, contacts=contacts)) if "foot" in line
    )
    assert row.split()[3:5] == [f"{pulls:.3g}", "N"]
    assert row.endswith("  equal compliance")


def test_a_broken_limit_without_a_margin_has_a_row():
    task = experiment_task("A")
    checked = check_motion(task.robot, task.reference.time_scaled(0.7), task.limits)
    rows = {row[0]: row[1:] for row in margin_rows(task.robot, checked)}
    ratio = checked.worst["acceleration_ratio"].value
    assert ratio > 1
    detail = checked.worst["acceleration_ratio"].detail
    assert rows["Acceleration"] == [f"{100 * ratio:.3g} % {detail}", "<= 100", "BROKEN"]
    assert "Angle margin" not in rows


@pytest.mark.parametrize(("index", "mark"), [(1.5, "BROKEN"), (0.5, "")])
def test_a_zero_moment_point_outside_is_marked_where_the_base_tips(task, checked, index, mark):
    """Not where clamps hold it, so that the table never contradicts the verdict."""
    tip = replace(checked.worst["GN"], value=index, excess=index - checked.worst["GN"].limit)
    edge = replace(checked.contacts.force, value=-0.2)
    outside = replace(
        checked, worst={**checked.worst, "GN": tip}, contacts=replace(checked.contacts, edge=edge)
    )
    (row,) = [row for row in margin_rows(task.robot, outside) if row[0] == "ZMP to edge"]
    assert row[-1] == mark


def test_a_limit_of_the_drives_that_is_reached_has_a_row():
    task = experiment_task("A")
    slow = check_motion(task.robot, task.reference.time_scaled(2.0), task.limits)
    assert "Joint speed" not in {row[0] for row in margin_rows(task.robot, slow)}
    worst = slow.worst["speed_ratio"]
    reached = replace(slow, worst={**slow.worst, "speed_ratio": replace(worst, value=0.997)})
    (row,) = [row for row in margin_rows(task.robot, reached) if row[0] == "Joint speed"]
    assert row[1:] == [f"99.7 % {worst.detail}", "<= 100", "reached"]


def test_what_is_infinite_is_said_in_words(task, checked):
    rows = by_name(motion_margins(task.robot, checked))
    endless = Margin(math.inf, 0.0)
    assert at_text(rows[FRICTION], endless) == "none holds"
    assert at_text(replace(rows[FRICTION], name=CLEARANCE), endless) == "unlimited"


def test_sentences_on_broken_limits_have_margins_with_their_units(task):
    reference = task.robot.tip_over.reference_moment
    left, least = (f"{reference * (1 / index - 1):.4g} N m" for index in (0.95, 0.9))
    known = (
        (
            Worst("GN", 0.95, 0.1, 0.9, "", 0.05),
            "tip_over_index is 0.95 at 0.1000 s, must be <= 0.9",
            f"tipping margin is {left} at 0.1000 s, must be >= {least}",
        ),
        (
            Worst("GN", 0.9 + 2e-8, 0.1, 0.9, "", 2e-8),
            "tip_over_index is 0.9 + 2e-08 at 0.1000 s, must be <= 0.9",
            f"tipping margin is just below {least} at 0.1000 s, must be >= {least}",
        ),
        (
            Worst("GN_worst_case", 1.2, 0.1, 0.999, "joint 1 delayed, GN 0.5", 0.2),
            "tip_over_index_worst_case is 1.2 at 0.1000 s (joint 1 delayed, GN 0.5), must be <= 0.999",
            "the base tips in the worst case at 0.1000 s (joint 1 delayed, GN 0.5)",
        ),
        (
            Worst("GN", 1.2, 0.1, 0.999, " within the uncertainty (tilt)", 0.2, scenario="cancel"),
            "tip_over_index is 1.2 in a cancel begun at 0.1000 s within the uncertainty (tilt), "
            "must be <= 0.999",
            "the base tips in a cancel begun at 0.1000 s within the uncertainty (tilt)",
        ),
        (
            Worst("jump_GT", 0.95, math.nan, 0.9, "segment lift", 0.05),
            "jump_friction_utilisation is 0.95 (segment lift), must be <= 0.9",
            "friction used at acceleration steps is 95 % (segment lift), must be <= 90 %",
        ),
        (
            Worst("GT[glass]", 8.07, 1.0, 0.9, "segment lift", 7.17),
            "GT[glass] is 8.07 at 1.0000 s (segment lift), must be <= 0.9",
            "glass slips at 1.0000 s (segment lift)",
        ),
        (
            Worst("clearance_m", 0.001, math.nan, 0.01, "", 0.009, least=True),
            "clearance_m is 0.001, must be >= 0.01",
            "clearance is 1 mm, must be >= 10 mm",
        ),
        (
            Worst("clearance", 1.0, math.nan, 10.0, ", between a and b", 9.0, True, "cancel", "mm"),
            "clearance is 1.0 mm in a cancel, between a and b, must be >= 10.0 mm",
            "clearance is 1 mm in a cancel, between a and b, must be >= 10 mm",
        ),
        (
            Worst("torque_ratio_worst_case", 1.2, 1.0, 1.0, "joint 2", 0.2),
            "torque_ratio_worst_case is 1.2 at 1.0000 s (joint 2), must be <= 1",
            "torque, worst case is 120 % at 1.0000 s (joint 2), must be <= 100 %",
        ),
        (statement("a contact slips or lifts off"), *["a contact slips or lifts off"] * 2),
    )
    for broken, in_json, for_people in known:
        assert stated([broken]) == [in_json]
        assert broken_words(task.robot, [broken]) == [for_people]


def test_titles_name_the_quantity_instead_of_the_index():
    names = ("GN", "GT_stop", "jump_GN[glass]", "GN_cancel_worst_case", "clearance_m")
    assert [quantity_title(name) for name in names] == [
        "tipping margin",
        "friction used in stops on the path",
        "tipping margin of glass at acceleration steps",
        "tipping margin in cancels in the worst case",
        "clearance",
    ]


@pytest.mark.parametrize(("turned", "constant"), [(5, True), (1, False)])
def test_a_clearance_that_the_motion_does_not_change_is_of_no_instant(task, turned, constant):
    """Only the last joint turns: the bodies that are nearest to each other stay where they are."""
    robot, goal = task.robot, task.start + 0.4 * (np.arange(task.robot.n) == turned)
    none, limits = [None] * robot.n, (robot.limits.speed, robot.limits.acceleration)
    motion = Trajectory.ending_together(task.start, goal, none, *(0.2 * one for one in limits))
    nearest = check_motion(robot, motion, task.limits).worst["clearance_m"].value
    found = check_motion(robot, motion, replace(task.limits, clearance=0.99 * nearest))
    row = by_name(motion_margins(robot, found))[CLEARANCE]
    assert row.nominal.value == nearest
    assert (row.nominal.time is None) == constant
    assert (critical(motion_margins(robot, found)).name == CLEARANCE) == (not constant)
    beyond = check_motion(robot, motion, replace(task.limits, clearance=1.01 * nearest))
    assert critical(motion_margins(robot, beyond)).name == CLEARANCE
