"""Every file that a plan is written to, for every controller, read back: the same verdict and values."""

from functools import cache

import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.files.execution import Execution, execute
from ocptip.motion.files.output import MOTION, PLAN, TRAJECTORY
from ocptip.motion.files.plan_files import write_plan
from ocptip.published.tasks import experiment_task
from ocptip.task_files.motion import load_task
from ocptip.trajectories.controllers import CONTROLLERS
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES
from tests.quick import some


def published():
    """A printed motion, with accelerations at their limits."""
    task = experiment_task("C", "effective")
    return task, task.reference


def cart():
    """An arm of a URDF; its first joint turns back on its way, two others move in one ramp."""
    pytest.importorskip("pinocchio")
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    limits, goal = task.robot.limits, task.goal
    commands = [None] * task.robot.n
    speed, acceleration = 0.5 * limits.speed[0], 0.3 * limits.acceleration[0]
    commands[0] = [RampCommand(goal[0] + 0.3, speed, acceleration), RampCommand(goal[0], speed, acceleration)]
    slow = 0.6 * limits.speed, 0.2 * limits.acceleration
    return task, Trajectory.ending_together(task.start, goal, commands, *slow)


@cache
def planned(make):
    task, motion = make()
    return task, motion, check_motion(task.robot, motion, task.limits)


@pytest.mark.parametrize(
    ("make", "controller"),
    some(
        2,
        [
            *((published, controller) for controller in ("ramps", "S-curves", *CONTROLLERS)),
            *(pytest.param(cart, how, marks=pytest.mark.slow) for how in ("S-curves", "ramps", *CONTROLLERS)),
        ],
    ),
)
def test_files_say_what_was_checked(make, controller, tmp_path):
    task, motion, checked = planned(make)
    if controller in ("S-curves", "quintic"):
        motion = motion.with_rise_times(0.02)
        checked = check_motion(task.robot, motion, task.limits)
    run = Execution.of_drives(task.robot, motion, task.limits, checked)
    if controller in CONTROLLERS:
        run = execute(task.robot, motion, task.limits, controller, step=0.03)
    write_plan(tmp_path, plan_of(task, motion, checked), executions=[run])
    for name in (PLAN, MOTION, TRAJECTORY):
        rate = 1 / 0.03 if controller == "linear" else None  # which messages do not hold
        read = load_motion(tmp_path / name, task.robot.names, task.robot.units, rate=rate)
        again = check_motion(task.robot, read, task.limits)
        assert again.verified == run.check.verified, name
        assert again.stands == run.check.stands, name
        assert again.duration == pytest.approx(run.check.duration, abs=2e-9), name
        assert again.energy == pytest.approx(run.check.energy, rel=2e-5), name  # by quadrature
        assert list(again.worst) == list(run.check.worst)
        for key, worst in run.check.worst.items():
            assert again.worst[key].value == pytest.approx(worst.value, abs=1e-6), (name, key)
