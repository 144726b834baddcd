"""What a start does with motions that are all but verified."""

from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.planner.one_start import SLOWED, Clock, Search
from ocptip.published.tasks import experiment_task


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


def at_share(task, share):
    """The printed motion at this share of the speeds and accelerations that are allowed."""
    worst = check_motion(task.robot, task.reference, task.limits).worst
    ratio = max(worst["speed_ratio"].value, np.sqrt(worst["acceleration_ratio"].value))
    return task.reference.time_scaled(ratio / share)


@pytest.mark.parametrize(("share", "helped"), [(1 + 5e-5, True), (SLOWED + 1e-3, False)])
def test_what_exceeds_accelerations_by_rounding_is_slowed_down(task, share, helped):
    motion = at_share(task, share)
    assert not check_motion(task.robot, motion, task.limits).verified
    refiner = SimpleNamespace(motion=lambda exact: motion)
    found, checked = Search(task)._motion_and_check(refiner, None, Clock())
    assert checked.verified == helped
    assert found.end == pytest.approx(motion.end * (share if helped else 1.0), rel=1e-6)
