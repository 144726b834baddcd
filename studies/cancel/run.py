"""How cancelled motions end in MuJoCo, at decelerations below and above the maximum safe one of the check.

    python -m studies.cancel.run --out DIR [--together]

Plans without uncertainty; limit GN 1, where the base begins to turn about an edge. Replays and verdicts have
a friction of `FRICTION`, so that tipping is what decides. The maximum is found by
bisection from verdicts at the check's own instants. It may exceed the acceleration limits, so that the
scenario binds in every plan. Replays begin at instants at equal distances and at the worst ones of
the check. Rows of finished plans and decelerations are kept. With `--together` joints come to rest together,
as `stopj` of Universal Robots commands it.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.motion.objective import TIME
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask
from ocptip.standing.arm import Robot
from ocptip.standing.stops.by_cancel import Cancel, CancelCheck, cancelled_motion
from ocptip.standing.tolerance import NONE
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from studies.cancel.world import AFTER, BEFORE, DRIVE, LOST, STEP, STIFF, World
from studies.common import EXAMPLES, PLANNING, RowFile, ended, say, software, source_state, state_notes, table

FACTORS = (0.8, 0.99, 1.1, 1.3, 1.6)
MOST, CLOSE = 8.0, 1e-3  # share of the acceleration limits
FRICTION = 3.0
FINER = ((STEP / 2, STIFF), (STEP / 4, STIFF / 4), (STEP / 8, STIFF / 8))
"""s: steps and time constants with which tips below the maximum are repeated."""
CLEAR = 5e-3  # s: so long a negative moment is expected to tip the base


def example(name: str, mass: float, fast: bool) -> MotionTask:
    """An example's arm on a base of this mass, kg; fast: of least time, else of least energy."""
    task = load_task(EXAMPLES / "tasks" / f"{name}.toml")
    own = task.robot.support
    robot = task.robot.varied(support=own.varied(own.contacts, mass=mass))
    task = replace(task, robot=robot, reference=None, source=None)
    return replace(task, objective=TIME) if fast else task


def tasks() -> dict[str, Callable[[], MotionTask]]:
    """How to make the tasks of ten plans.

    Link inertias of the published cases are those of no bodies, MuJoCo refuses them.
    """
    rows = [("ur5_cart", mass, False) for mass in (30, 35, 40, 50, 60)]
    rows += [("ur5_cart", mass, True) for mass in (35, 60)]
    rows += [("arm_of_parts", 25, False), ("arm_of_parts", 15, False), ("arm_of_parts", 25, True)]
    return {f"{row[0]}, {row[1]} kg{', least time' * row[2]}": partial(example, *row) for row in rows}


def maximum(robot: Robot, motion: Trajectory, together: bool) -> float:
    """Share of the acceleration limits up to which no checked cancel loses a contact."""

    def lost(share: float) -> bool:
        found = cancelled_motion(robot, motion, _cancel(robot, share, together))[1]
        return bool(np.max(found.GN) > 1)

    low, high = 0.0, MOST
    if not lost(high):
        return high
    while high - low > CLOSE:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if lost(middle) else (middle, high)
    return low


def _cancel(robot: Robot, share: float, together: bool) -> Cancel:
    rates = tuple(share * robot.limits.acceleration)
    return Cancel(rates, longest=1e3, GN=1.0, GT=1.0, together=together)


def _instants(robot: Robot, motion: Trajectory, cancel: Cancel, count: int) -> np.ndarray:
    """Half of them at equal distances, and half the worst of the check at the maximum."""
    times, found = cancelled_motion(robot, motion, cancel)
    worst = times[np.argsort(-found.GN, kind="stable")[: count // 2]]
    left = count - len(worst)
    return np.sort(np.append((np.arange(left) + 0.5) * motion.end / left, worst))


def rows_of(name: str, count: int, together: bool, file: RowFile) -> Iterator[dict[str, Any]]:
    """What is missing of a task."""
    if all(file.find(task=name, factor=factor) is not None for factor in FACTORS):
        return
    task = tasks()[name]()
    task = replace(task, limits=replace(task.limits, tolerance=NONE))
    say(f"{name}: planning")
    motion, robot = plan_motion(task, starts=1, seed=0, jobs=1).motion, task.robot
    assert isinstance(robot, Robot)
    contacts = [replace(contact, friction=FRICTION) for contact in robot.support.contacts]
    robot = robot.varied(support=robot.support.varied(contacts))
    share, world = maximum(robot, motion, together), World(robot)
    fine = [World(robot, step, stiff) for step, stiff in FINER]
    times = _instants(robot, motion, _cancel(robot, share, together), count)
    q, qd, _ = motion.states(times)
    for factor in FACTORS:
        if file.find(task=name, factor=factor) is not None:
            continue
        say(f"{name}: {factor:g} of the maximum, {share:.3f} of the limits")
        began = time.process_time()
        cancel = _cancel(robot, factor * share, together)
        rates = np.array(cancel.decelerations)
        found = CancelCheck(robot, cancel).stops(q, qd)
        replays = [world.cancelled(motion, t, rates, together) for t in times.tolist()]
        tips = [t for t, replay in zip(times.tolist(), replays, strict=True) if replay.tips and factor < 1]
        finer = [[w.cancelled(motion, t, rates, together).longest for w in fine] for t in tips]
        yield {
            "task": name,
            "factor": factor,
            "maximum_share": share,
            "duration_s": motion.end,
            "GN": found.GN,
            "tips": [replay.tips for replay in replays],
            "longest_s": [replay.longest for replay in replays],
            "finer_s": finer,
            "predicted_s": [replay.predicted for replay in replays],
            "lift_m": [replay.lift for replay in replays],
            "slide_m": [replay.slide for replay in replays],
            "cpu_s": time.process_time() - began,
        }


def markdown(rows: Sequence[dict[str, Any]], notes: list[str], law: str) -> str:
    """A row per plan and deceleration, and sums."""
    lines = []
    for row in rows:
        GN, tips, lift = np.array(row["GN"]), np.array(row["tips"]), np.array(row["lift_m"])
        clear = np.array(row["predicted_s"]) >= CLEAR
        lines.append(
            [
                row["task"],
                f"{row['maximum_share']:.3f}",
                f"{row['factor']:g}",
                f"{len(GN)}",
                f"{np.max(GN):.2f}",
                f"{np.sum(GN >= 1)}",
                f"{np.sum(clear)}",
                f"{np.sum(tips)}",
                f"{np.sum(tips & (GN < 1))}",
                f"{np.sum(~tips & clear)}",
                f"{1e3 * np.max(lift):.2f}",
            ]
        )
    head = [
        "plan",
        "max share",
        "x max",
        "instants",
        "largest GN",
        "GN >= 1",
        f"for {1e3 * CLEAR:g} ms",
        "tips",
    ]
    head += ["tips, GN < 1", "expected, no tip", "lift mm"]
    every = {key: np.concatenate([row[key] for row in rows]) for key in ("GN", "tips", "predicted_s")}
    factors = np.concatenate([np.full(len(row["tips"]), row["factor"]) for row in rows])
    tips, expected = every["tips"].astype(bool), every["predicted_s"] >= CLEAR
    below, above = factors < 1, factors >= 1.1
    sums = [
        f"- {len(tips)} replays of {len({row['task'] for row in rows})} plans.",
        f"- Below the maximum: {np.sum(tips & below)} tips of {np.sum(below)}.",
        f"- Tips where GN is below 1 at that instant: {np.sum(tips & (every['GN'] < 1))}.",
        f"- From 1.1 times the maximum on, where a moment is negative for {1e3 * CLEAR:g} ms or more: "
        f"{np.sum(tips & expected & above)} tips of {np.sum(expected & above)}.",
    ]
    if finer := [times for row in rows for times in row.get("finer_s", ())]:
        longest = ", ".join(f"{1e3 * value:.2f}" for value in np.max(finer, axis=0))
        steps = ", ".join(f"{1e3 * step:g} and {1e3 * stiff:g}" for step, stiff in FINER)
        sums.append(
            f"- These {len(finer)} repeated with steps and time constants of {steps} ms: without load for at "
            f"most {longest} ms."
        )
    text = [
        f"# Cancelled motions in MuJoCo, joints that stop {law}",
        "",
        *notes,
        "",
        *sums,
        "",
        *table(head, lines),
        "",
    ]
    return "\n".join(text) + "\n"


def run(out: Path, count: int, names: Sequence[str] | None, together: bool) -> str:
    """Compute what is missing, task by task, and write the table."""
    out.mkdir(parents=True, exist_ok=True)
    state, own = source_state(*PLANNING), f"cancel{'_together' * together}"
    law = "together" if together else "each by itself"
    file = RowFile(out / f"{own}.json", {"instants": count, "step": STEP}, ("task", "factor"), state)
    for name in names or tasks():
        for row in rows_of(name, count, together, file):
            file.put(row)
            write_text(out / f"{own}.md", text_of(file, state, law))
    return text_of(file, state, law)


def text_of(file: RowFile, state: str, law: str) -> str:
    """The table of all rows so far."""
    rows = file.own
    notes = [
        f"{software(versions(('numpy', 'casadi')))}, MuJoCo {mujoco.__version__}. Model written for this "
        f"study: steps of {1e3 * STEP:g} ms, contacts with a time constant of {1e3 * STIFF:g} ms, critically "
        f"damped, joints with position loops of {DRIVE / (2 * np.pi):g} Hz and feed-forward torques of "
        f"Pinocchio, friction {FRICTION:g}. "
        f"A replay runs from {1e3 * BEFORE:g} ms before the cancel to {1e3 * AFTER:g} ms after the stop. It "
        f"tips where no foot beside some tipping axis carries load for {1e3 * LOST:g} ms."
    ]
    return markdown(rows, notes, law) + "\n".join(state_notes([r.get("state") for r in rows], state)) + "\n"


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--instants", type=int, default=200, help="per plan and deceleration")
    parser.add_argument("--only", nargs="+", help="only these tasks")
    parser.add_argument("--together", action="store_true", help="joints come to rest together (stopj)")
    given = parser.parse_args(argv)
    return ended(
        "cancel", lambda: run(given.out, given.instants, given.only, given.together), "rows are kept."
    )


if __name__ == "__main__":
    sys.exit(main())
