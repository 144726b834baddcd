"""`ocptip.plan` among obstacles: which method, what it gives, and the end of the time."""

from __future__ import annotations

import signal
import time
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ocptip
from ocptip.api.methods import FEW_STATES, methods_for, of_segments, searched
from ocptip.api.results.plan import Plan
from ocptip.basics.errors import InputError, InputWarning, PlanningError, SolverError
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.cli.plan.plan_report import PlanReport
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.multi_start import MultiStart
from ocptip.motion.paths.search import MOST_STATES
from ocptip.numerics.time_limit import TimeBudget, interrupted_after
from ocptip.retiming.among import slow_plan
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from tests.motion.paths.among_boxes import WALL, task_among, task_file
from tests.places import EXAMPLES

pytest.importorskip("ompl")
BESIDE = WALL.replace("0.75, 0.0", "0.75, -0.9")


def budgets(seconds):
    """Of the search with the checks after it, without a limit, and of the search."""
    return TimeBudget(None), TimeBudget(seconds)


def joined(text):
    return " ".join(text.split())


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return ocptip.plan(task_file(tmp_path_factory.mktemp("wall")), seed=1)


@pytest.mark.slow
def test_a_motion_around_a_wall_is_proved(plan):
    assert plan.planned.options["method"] == "path"
    assert plan.verified
    assert plan.check.certified
    motion, robot = plan.motion, plan.task.robot
    q = motion(np.arange(0, motion.end, 1e-3))
    assert robot.collision.gaps(q).min() >= plan.task.limits.clearance
    assert plan.executions[0].controller == "cubic"


@pytest.mark.slow
def test_of_the_path_and_the_smoothed_one_the_better_motion_is_the_plan(plan):
    smooth = Plan.of(plan.planned, smooth=True)
    path = smooth.planned.options["path"]
    assert path["smoothed"]
    assert smooth.check.certified
    assert smooth.check.energy / plan.check.energy - 1 == pytest.approx(path["smoothed_costs_more"])
    assert path["smoothed_costs_more"] < 0
    motion, robot = smooth.motion, smooth.task.robot
    assert motion.goal == pytest.approx(plan.motion.goal)
    q = motion(np.arange(0, motion.end, 1e-3))
    assert robot.collision.gaps(q).min() >= smooth.task.limits.clearance
    assert "of the smoothed path, which costs" in PlanReport(smooth).to_text()


@pytest.mark.slow
def test_without_time_the_path_stays_as_it_is(plan):
    rushed = Plan.of(plan.planned, smooth=True, budget=TimeBudget(1e-6))
    assert rushed.motion.end == plan.motion.end
    assert not rushed.planned.options["path"]["smoothed"]


@pytest.mark.slow
def test_the_method_follows_from_the_straight_line(tmp_path, monkeypatch):
    assert methods_for(task_among(tmp_path)) == ("path", "direct")
    assert methods_for(task_among(tmp_path, BESIDE)) == ("direct",)
    touched = WALL.replace("0.75, 0.0", "1.05, 0.0")
    assert methods_for(task_among(tmp_path, touched)) == ("direct", "path")
    for wall in (BESIDE, touched):
        assert methods_for(task_among(tmp_path, wall), limited=True) == ("path", "direct")
    alone = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    assert [solid.name for solid in alone.robot.obstacles] == ["floor"]
    assert methods_for(alone, limited=True) == ("direct", "path")
    monkeypatch.setattr("ocptip.api.methods.find_spec", lambda name: None)
    assert methods_for(task_among(tmp_path, BESIDE)) == ("direct",)
    with pytest.warns(
        InputWarning,
        match=r"straight line .*link2 and box overlap by 32.6 mm; .* needs OMPL \(pip install ",
    ):
        assert methods_for(task_among(tmp_path)) == ("direct",)


def test_a_path_is_not_for_cycles_nor_without_geometry(tmp_path):
    file = task_file(tmp_path)
    text = file.read_text().split("[[obstacle]]")[0]
    file.write_text(text.replace("[arm]", "[arm]\ncollision = false"))
    with pytest.raises(InputError, match="method: path needs collision geometry"):
        ocptip.plan(load_task(file), method="path")


@pytest.mark.slow
def test_a_cycle_goes_along_paths(tmp_path):
    file = task_file(tmp_path)
    file.write_text(file.read_text().replace("goal_deg = [45", "[[segment]]\ngoal_deg = [45"))
    plan = ocptip.plan(file, method="path", seed=1)
    assert plan.verified
    assert all(run.check.certified for run in plan.executions)
    assert [part.options["method"] for part in plan.planned.parts] == ["path"]
    assert "method: path (straight lines" in PlanReport(plan).to_text()
    with pytest.raises(InputError, match="smooth is for single motions"):
        ocptip.plan(file, method="smooth")


def test_a_segment_that_the_direct_search_does_not_reach_goes_along_a_path(tmp_path):
    def fails(**_):
        raise PlanningError("no start gave a motion")

    said = []
    unlimited = TimeBudget(None)
    touched = task_among(tmp_path, WALL.replace("0.75, 0.0", "1.05, 0.0"))
    plan = of_segments(None, 1, said.append)(touched, fails, unlimited, False)
    assert plan.options["method"] == "path"
    assert said == ["no start gave a motion", "searching and timing a path ..."]
    with pytest.raises(PlanningError, match=r"^no start gave a motion$"):
        of_segments("direct", 1, said.append)(task_among(tmp_path), fails, unlimited, True)


def test_a_segment_through_a_wall_goes_along_a_path_first(tmp_path, monkeypatch):
    """Where the cycle may do without it, the direct search does not follow."""
    searched, failure = [], PlanningError("no way")

    def fails(*_, **options):
        searched.append(options.get("states", "direct"))
        raise failure

    monkeypatch.setattr("ocptip.retiming.among.plan_along_path", fails)
    search, task = of_segments(None, 1, lambda _: None), task_among(tmp_path)
    for needed in (False, True):
        with pytest.raises(PlanningError, match="no way"):
            search(task, fails, TimeBudget(None), needed)
    assert searched == [FEW_STATES, MOST_STATES, "direct"]


def test_when_the_time_is_up_there_is_a_plan_or_the_reason(tmp_path):
    with pytest.raises(
        ocptip.NoPlanError, match=r"in the given time, .*; more --seconds may help, or --method path"
    ):
        ocptip.plan(task_file(tmp_path), seconds=1e-3)


@pytest.mark.slow
def test_where_the_time_is_limited_a_path_goes_before_or_follows_the_direct_search(tmp_path, monkeypatch):
    def too_slow(**_):
        raise TimeIsUpError

    task, said = task_among(tmp_path, BESIDE), []
    with pytest.raises(TimeIsUpError):  # of what is around it
        searched(task, None, *budgets(None), too_slow, 0, said.append)
    with pytest.raises(PlanningError, match=r"^direct method: no verified motion in the given time, 100 s$"):
        searched(task, "direct", *budgets(100.0), too_slow, 0, said.append)
    plan = searched(task, None, *budgets(100.0), too_slow, 0, said.append)
    assert plan.verified
    assert plan.options["method"] == "path"
    assert said == ["searching and timing a path ..."]  # among obstacles
    said.clear()
    monkeypatch.setattr("ocptip.retiming.among.plan_along_path", lambda *_, **__: plan)
    alone = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    assert searched(alone, None, *budgets(100.0), too_slow, 0, said.append) is plan
    assert said[0] == "direct method: no verified motion in the given time, 60 s"
    assert said[1:] == ["searching and timing a path ..."]


@pytest.mark.slow
@pytest.mark.parametrize(("rise_times", "compared"), [(None, True), ((0.02,), False)])
def test_a_plan_for_cancels_is_compared_with_the_straight_line(monkeypatch, rise_times, compared):
    """Not with S-curves, which a timing has not, nor without cancels."""
    task, said = load_task(EXAMPLES / "tasks" / "ur5_cart.toml"), []
    safe = replace(task, limits=replace(task.limits, cancel=Cancel((2.0,) * task.robot.n)))
    cost = {"energy": 1.0, "duration": 1.0}
    plan = SimpleNamespace(motion=SimpleNamespace(rise_times=rise_times), **cost)
    other = SimpleNamespace(**cost)
    monkeypatch.setattr("ocptip.retiming.among.no_worse_than_line", lambda found: other)
    known = (None, *budgets(None), lambda **_: plan, 0, said.append)
    assert searched(task, *known) is plan
    assert searched(safe, *known) is (other if compared else plan)
    assert any("the straight line" in text for text in said) is compared


@pytest.mark.slow
def test_an_interrupt_while_the_straight_line_is_timed_keeps_the_plan(monkeypatch):
    def interrupted(plan):
        raise KeyboardInterrupt

    monkeypatch.setattr("ocptip.retiming.among.no_worse_than_line", interrupted)
    task, said = load_task(EXAMPLES / "tasks" / "ur5_cart.toml"), []
    safe = replace(task, limits=replace(task.limits, cancel=Cancel((2.0,) * task.robot.n)))
    plan = SimpleNamespace(motion=SimpleNamespace(rise_times=None), energy=1.0, duration=1.0)
    assert searched(safe, None, *budgets(None), lambda **_: plan, 0, said.append) is plan
    assert said[-1] == "interrupted; the plan without the line is kept"


def test_a_failed_solver_of_one_method_leaves_the_other(tmp_path, monkeypatch):
    def fails(*_, **__):
        raise SolverError("timing: status X")

    monkeypatch.setattr("ocptip.retiming.among.plan_along_path", fails)
    task, said = task_among(tmp_path), []
    plan = object()
    assert searched(task, None, *budgets(None), lambda **_: plan, 0, said.append) is plan
    assert said[-1] == "path method: no verified motion, a solver failed: timing: status X"
    why = r"^path method: no verified motion, a solver failed: timing: status X \(without --method, "
    with pytest.raises(PlanningError, match=why):
        searched(task, "path", *budgets(None), lambda **_: plan, 0, said.append)


def test_a_time_limit_interrupts_and_leaves_no_trace():
    before = signal.getsignal(signal.SIGALRM)

    def slow():
        with interrupted_after(0.01), suppress(TimeIsUpError):
            time.sleep(5)
        time.sleep(5)

    with pytest.raises(TimeIsUpError), interrupted_after(0.02):
        slow()
    with pytest.raises(TimeIsUpError), interrupted_after(0.01):
        time.sleep(5)
    with interrupted_after(30.0):
        pass
    assert signal.getsignal(signal.SIGALRM) == before
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0


@pytest.mark.slow
def test_where_a_search_has_no_time_a_slow_motion_is_the_plan(tmp_path, monkeypatch):
    def too_slow(*_):
        raise PlanningError("direct method: no verified motion in the given time")

    task = task_among(tmp_path, BESIDE)
    monkeypatch.setattr("ocptip.api.methods._searched", too_slow)
    plan = ocptip.plan(task, seconds=60.0)
    assert plan.verified
    assert plan.motion.goal == pytest.approx(task.goal)
    assert "a slow motion of all joints in step: the search gave" in joined(PlanReport(plan).to_text())
    with pytest.raises(ocptip.NoPlanError, match="in the given time"):
        ocptip.plan(task)


def test_a_task_with_cancels_has_the_slow_motion_before_a_search_in_limited_time(tmp_path, monkeypatch):
    order = []

    def search(*_):
        order.append("search")
        raise PlanningError("nothing")

    monkeypatch.setattr("ocptip.retiming.among.slow_plan", lambda *_, **__: order.append("slow"))
    monkeypatch.setattr("ocptip.api.methods._searched", search)
    with pytest.raises(ocptip.NoPlanError, match="nothing; a slow motion of all joints in step"):
        ocptip.plan(task_among(tmp_path, BESIDE), stops="cancel", seconds=0.5)
    assert order == ["slow", "search", "slow"]


def slow_of(task, cost=50.0):
    """A stand-in for the checked slow motion of a task; only its cost is read."""
    robot = task.robot
    motion = Trajectory.ending_together(
        task.start, task.goal, [None] * robot.n, robot.limits.speed, robot.limits.acceleration
    )
    check = SimpleNamespace(energy=cost, duration=motion.end, verified=True)
    options = {"starts": 0, "slow": True}
    return MotionPlan(task, motion, check, (), 0, 0, 1.0, interrupted=False, options=options)


@pytest.mark.parametrize("of_cycle", [False, True])
def test_an_interrupt_keeps_the_slow_motion_checked_before_the_search(tmp_path, monkeypatch, of_cycle):
    """Without a limit of time as well; progress shows its cost from the first step on."""
    task = cancelled(task_among(tmp_path, BESIDE))
    monkeypatch.setattr("ocptip.retiming.among.slow_plan", lambda *_, **__: slow_of(task))

    def direct(known):
        assert known == 50.0
        raise KeyboardInterrupt

    if of_cycle:
        plan = of_segments(None, 0, print)(task, direct, TimeBudget(None), True)
    else:
        plan = searched(task, None, *2 * [TimeBudget(None)], direct, 0, print)
    assert plan.motion.end == slow_of(task).motion.end
    assert plan.stopped


def test_an_interrupt_without_a_verified_motion_is_one(tmp_path):
    def direct(**_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        searched(task_among(tmp_path, BESIDE), None, *2 * [TimeBudget(None)], direct, 0, print)


@pytest.mark.parametrize(("cost", "slow"), [(40.0, False), (60.0, True)])
def test_the_cheaper_of_the_slow_motion_and_that_of_the_search_is_the_plan(tmp_path, monkeypatch, cost, slow):
    task = cancelled(task_among(tmp_path, BESIDE))
    other = replace(slow_of(task, cost), options={"method": "path"})
    monkeypatch.setattr("ocptip.retiming.among.slow_plan", lambda *_, **__: slow_of(task))
    plan = of_segments(None, 0, print)(task, lambda **_: other, TimeBudget(None), True)
    assert ("slow" in plan.options) == slow
    assert plan.energy == min(cost, 50.0)


def test_an_interrupt_while_a_faster_slow_motion_is_sought_keeps_the_slowest(tmp_path, monkeypatch):
    task, checked = task_among(tmp_path, BESIDE), []

    def check(robot, motion, limits):
        checked.append(motion.end)
        if len(checked) == 3:
            raise KeyboardInterrupt
        return SimpleNamespace(verified=len(checked) == 2, violations=())

    monkeypatch.setattr("ocptip.retiming.among.check_motion", check)
    plan = slow_plan(task)
    assert plan.interrupted
    assert plan.motion.end == checked[1] == max(checked)


def test_progress_shows_what_is_verified_before_the_search(tmp_path):
    told = []
    MultiStart(task_among(tmp_path, BESIDE), range(2), 0, lambda *step: told.append(step), known=50.0)
    MultiStart(task_among(tmp_path, BESIDE), range(2), 0, lambda *step: told.append(step))
    assert [best for *_, best in told] == [50.0, None]


def cancelled(task):
    """Safe when cancelled."""
    cancel = Cancel(tuple(task.robot.limits.acceleration.tolist()))
    return replace(task, limits=replace(task.limits, cancel=cancel))
