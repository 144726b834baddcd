"""The smallest base under a motion, against the check on bases just beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.design import motion_design
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits


def test_the_check_keeps_the_smallest_base_and_not_a_smaller_one():
    task = experiment_task("A", "effective")
    task = replace(task, limits=Limits())
    robot, motion, support = task.robot, task.reference, task.robot.support
    design = motion_design(task, motion)
    assert design.feet is not None
    assert design.base_mass_kg is not None
    places = np.array([contact.position for contact in support.contacts])
    for factor, kept in ((1.0, True), (0.985, False)):
        level = (factor * design.feet - 1) * (places - places.mean(axis=0)) * [1, 1, 0]
        feet = [replace(c, position=p) for c, p in zip(support.contacts, places + level, strict=True)]
        for other in (support.varied(feet), support.varied(mass=factor * design.base_mass_kg)):
            worst = check_motion(robot.varied(support=other), motion, task.limits).worst
            uses = [worst[name].value / worst[name].limit for name in ("GN", "GT")]
            assert (max(uses) <= 1 + 1e-6) == kept
            assert max(uses) == pytest.approx(1, abs=0.25)
