"""Motions broken on purpose for less than a millisecond between sampled instants: none may be certified.

The plans of A and B on the effective base get a bump in the acceleration of their first joint. Most are
broken in the world as described: a joint's limit, GN or GT. Every twentieth, plan A run slower,
is broken within `workshop` only. What is broken is judged at 21 instants inside the bump.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ocptip.certificate.find import certify
from ocptip.motion.check import check_motion
from ocptip.motion.task import MotionTask
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import PRESETS
from ocptip.standing.within.in_motion import worst_within
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from studies.common import RESULTS, progress

BROKEN = "broken on purpose"
_SLOWER = 1.4  # times of plan A, so that it keeps the tolerance
_TRIES = 400


def broken_on_purpose(count: int, seed: int = 5) -> dict[str, Any]:
    """How many of so many motions were broken and certified all the same; of how many others the proof names
    an interval of time at the bump."""
    rng, certified, named, within = np.random.default_rng(seed), 0, 0, 0
    for number in range(count):
        progress(number, count, BROKEN)
        key = ("A", "workshop") if number % 20 == 19 else ("AB"[number % 2], "none")
        task, motion, worst = _scene(*key)
        broken, start, end = _broken(task, motion, rng)
        found = certify(task.robot, broken, task.limits, worst)
        certified += found.certified
        late = task.limits.tolerance.late
        named += any(one.start <= end + late and one.end >= start for one in found.undecided)
        within += key[1] == "workshop"
    text = (
        f"Of {count} motions broken on purpose for 0.2 to 0.9 ms between instants of the check ({within} "
        f"of them within `workshop` only) {certified} are certified; of {named} the proof names where (seed "
        f"{seed})."
    )
    return {"certified": certified, "named": named, "within": within, "seed": seed, "text": text}


@cache
def _scene(case: str, name: str) -> tuple[MotionTask, Trajectory, Any]:
    task, motion = experiment_task(case), load_motion(RESULTS / "plans" / f"{case}-effective" / "plan.json")
    if name != "none":
        motion = motion.time_scaled(_SLOWER)
        task = replace(task, limits=replace(task.limits, tolerance=PRESETS[name]))
    checked = check_motion(task.robot, motion, task.limits)
    assert checked.verified, f"{case} {name}: {checked.violations}"
    return task, motion, checked.worst


def _broken(
    task: MotionTask, motion: Trajectory, rng: np.random.Generator
) -> tuple[Trajectory, float, float]:
    """With a bump that the limits do not allow, and from when to when that is, s."""
    given = task.limits.tolerance.given
    for _ in range(_TRIES):
        time, width = rng.uniform(0.05, 0.95) * motion.end, rng.uniform(2e-4, 9e-4)
        time = rng.uniform(0.001, 0.009) if given else time  # where the tolerance is nearly used up
        height = rng.choice([-1, 1]) * rng.uniform(*((2, 40) if given else (5, 200)))
        if np.min(np.abs(motion.event_times - time)) < width:
            continue
        found = _bumped(motion, time, width, height)
        start, end = time - width / 2, time + width / 2
        instants = np.linspace(start, end, 21)
        lost = _lost(task, found, instants)
        if given and not lost:
            worst = worst_within(task.robot, found, task.limits.tolerance, instants)
            if max(worst.slip.value, worst.tip.value if worst.tip else 0.0) > 1:
                return found, start, end
        if not given and lost:
            return found, start, end
    raise RuntimeError("no bump breaks the motion")


def _lost(task: MotionTask, motion: Trajectory, times: np.ndarray) -> bool:
    """Whether a limit is exceeded at instants, as described."""
    robot, limits, states = task.robot, task.limits, motion.states(times)
    assert isinstance(robot, Robot)
    own = robot.contact_states(robot.loads(*states)[1])
    GN, GT = robot.tip_over.evaluate(own).GN, robot.slip.evaluate(own, derivatives=False).GT
    fast = np.max(np.abs(states[2]) / robot.limits.acceleration)
    return bool(fast > 1.001 or not np.all(GN <= limits.GN + 1e-3) or not np.all(GT <= limits.GT + 1e-3))


def _bumped(motion: Trajectory, time: float, width: float, height: float) -> Trajectory:
    """As samples, with a bump of the first joint's acceleration."""
    inner = np.linspace(time - width / 2, time + width / 2, 9)
    times = np.unique(np.concatenate([motion.event_times, inner]))
    q, qd, qdd = motion.states(times)
    inside = (times > inner[0]) & (times < inner[-1])
    qdd = qdd.copy()
    qdd[:, 0] += height * np.where(inside, (1 - 4 * ((times - time) / width) ** 2) ** 3, 0.0)
    return Trajectory.from_points(times, q, qd, qdd)
