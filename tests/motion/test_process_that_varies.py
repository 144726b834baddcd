"""Plans and timings with a process that varies over time or over the way of the gripper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.certificate.checks import certified
from ocptip.motion.plan import plan_motion
from ocptip.published.tasks import experiment_task
from ocptip.retiming.retime import retime
from ocptip.robots.process import ProcessWrench
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from ocptip.trajectories.path import JointPath
from tests.motion.planner.test_program import Planned
from tests.motion.test_process_in_motion import case, varying
from tests.places import EXAMPLES
from tests.quick import some


class Given(Planned):
    """With a random motion of the robot on whose gripper nothing acts."""

    def motion(self, seed):
        return Planned(experiment_task("B")).motion(seed)


def test_what_varies_over_the_way_is_for_given_paths_the_rest_for_plans():
    task, bare = case("A")
    over = {
        key: bare.varied(arm=bare.arm.with_process(varying(key, [0.0, 1.0]))) for key in ("path", "share")
    }
    with pytest.raises(InputError, match="process: varies over path, which is not known before"):
        plan_motion(replace(task, robot=over["path"]), starts=1, jobs=1)
    path = JointPath(np.array([0.0, 1.0]), np.stack([task.goal - task.start, task.start])[:, None])
    with pytest.raises(InputError, match="process: varies over share, which a path does not know"):
        retime(over["share"], path)


@pytest.mark.parametrize("kind", some(2, ["ordered", "fine", "coarse"]))
@pytest.mark.parametrize("over", some(1, ["share", "time"]))
def test_derivatives_of_programs_with_what_varies(over, kind):
    """Central differences of objective and rows, between knots; twice the shares of the end are in it."""
    task, bare = case("B")
    knots = np.linspace(-0.05, 1.05, 4) * (task.reference.end if over == "time" else 1.0)
    process = varying(over, knots)
    planned = Given(replace(task, robot=bare.varied(arm=bare.arm.with_process(process))))
    program, x = planned.of_kind(3, kind)
    rows = program.no_rows()
    rows["tip-over"][::4] = True
    rows["torque"][::7] = True
    program = program.with_rows(rows)
    rng, h = np.random.default_rng(0), 1e-6
    on = rng.normal(size=len(program.bounds()[0]))
    gradient, jacobian, hessian = program.gradient(x), program.jacobian(x), program.hessian(x, 0.7, on)
    free = program.structure.x_lower < program.structure.x_upper
    for _ in range(4):
        v = rng.normal(size=len(x)) * free
        ahead, behind = x + h * v, x - h * v
        objective = (program.values(ahead)[0] - program.values(behind)[0]) / (2 * h)
        assert gradient @ v == pytest.approx(objective, abs=1e-6 * np.abs(gradient).max())
        slope = (program.values(ahead)[1] - program.values(behind)[1]) / (2 * h)
        np.testing.assert_allclose(jacobian @ v, slope, atol=2e-5 * np.abs(jacobian).max())
        bend = [0.7 * program.gradient(z) + on @ program.jacobian(z) for z in (ahead, behind)]
        reference = (bend[0] - bend[1]) / (2 * h)
        assert np.max(np.abs(hessian @ v - reference)) < 2e-5 * np.max(np.abs(reference))


@pytest.mark.slow
@pytest.mark.parametrize("over", [pytest.param("share", marks=pytest.mark.slow), "time"])
def test_plans_follow_what_varies(over):
    """Their energy is that of the check; a force in the middle costs between none and one all the time."""
    task, bare = case("A")
    end = task.reference.end if over == "time" else 1.0
    force = 8.0 * np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 0]])
    ways = {
        "none": None,
        "varying": ProcessWrench(force, 0 * force, "base", over, np.array([0.2, 0.4, 0.6, 0.8]) * end),
        "all": ProcessWrench(force[1], 0 * force[1], "base"),
    }
    energy = {}
    for name, process in ways.items():
        robot = bare.varied(arm=bare.arm.with_process(process))
        plan = plan_motion(replace(task, robot=robot), starts=4, jobs=1, prove=certified)
        assert plan.verified
        energy[name] = plan.check.energy
        if name == "varying":
            assert plan.check.certified
            assert robot.energy(plan.motion) == pytest.approx(plan.check.energy)
    assert min(energy["none"], energy["all"]) < energy["varying"] < max(energy["none"], energy["all"])


@pytest.mark.parametrize("over", ["time", "share"])
def test_ends_of_a_motion_that_is_not_known(over):
    _, bare = case("A")
    robot = bare.varied(arm=bare.arm.with_process(process := varying(over, [0.0, 0.4, 1.0])))
    begin, end = robot.resting(0).arm.process, robot.resting(1).arm.process
    np.testing.assert_array_equal(begin.wrench, np.hstack([process.force[0], process.moment[0]]))
    if over == "time":
        assert end is None
    else:
        np.testing.assert_array_equal(end.wrench, np.hstack([process.force[2], process.moment[2]]))


@pytest.mark.slow
def test_timings_follow_what_varies_over_the_way():
    """Of the sander that presses only early; one whose values are all the same is a constant one."""
    task = load_task(EXAMPLES / "tasks" / "ur5_sander.toml")
    path = load_path(EXAMPLES / "paths" / "ur5_sander.toml", task).paths[0].path
    own = task.robot.arm.process

    def timed(over, factors):
        shares = np.asarray(factors)[:, None]
        process = ProcessWrench(shares * own.force, shares * own.moment, own.axes, "path", over)
        return retime(task.robot.varied(arm=task.robot.arm.with_process(process)), path, Limits())

    constant, same = retime(task.robot, path, Limits()), timed([0.1, 0.2], [1.0, 1.0])
    assert same.motion.end == pytest.approx(constant.motion.end, rel=1e-9)
    early, gently = timed([0.1, 0.2], [1.0, 0.0]), timed([0.1, 0.2], [0.0, 0.0])
    assert early.check.verified
    assert early.slower < 1.001
    assert 0.89 < early.check.worst["GN"].value <= 0.9
    assert gently.check.worst["GN"].value < 0.7
    assert gently.motion.end + 5e-5 < early.motion.end < constant.motion.end + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("over", ["share", "time"])
def test_plans_within_a_tolerance_follow_what_varies(over):
    """Of a force that pulls in the middle a plan of its own; the check knows that of the whole time."""
    task, bare = case("A")
    end = task.reference.end if over == "time" else 1.0
    force = 6.0 * np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 0]])
    process = ProcessWrench(force, 0 * force, "base", over, np.array([0.2, 0.4, 0.6, 0.8]) * end)
    robot = bare.varied(arm=bare.arm.with_process(process))
    limits = replace(task.limits, tolerance=WORKSHOP)
    plan = plan_motion(replace(task, robot=robot, limits=limits), starts=1, jobs=1, prove=certified)
    assert plan.check.certified
    assert plan.check.within is not None
    assert 0.5 < plan.check.worst["GT_worst_case"].value < 1
    assert plan.check.worst["GN"].value < plan.check.worst["GN_worst_case"].value < 1
