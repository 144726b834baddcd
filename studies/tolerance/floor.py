"""What no motion of any form seems to get below within a tolerance: the price with most of it left out.

Every motion that has `workshop` keeps, at all instants, the torques' limits as described, and in some chosen
worlds of the tolerance the moments about the tipping axes, in others the slip reserve, with the least
friction: first the world that is worst about each axis where start or goal rests, and the one as described;
then, of the optimum found so far, those that are worst at its instants. Left out are all other worlds,
clearance, late joints, jumps with their overshoot, and the ramp form: every joint moves as it likes
(`studies.ramp_gap.free_form`). The least energy of that is below that of all motions within the
tolerance, ramps and S-curves among them, as far as the optimum found is the least (several starts, how
near they are to each other is said) and 20 intervals are fine enough (20 to 80 lower the free-form optimum
of B by 0.4 %). It is computed, not proved.
Beside it: the same, in the worlds found, where every acceleration is constant in each of the intervals, as in
20 ramps of equal length of each joint; those of a plan are fewer, but change where they like.

    python -m studies.tolerance.floor --prices results/tolerance.json --out results
        [--tasks B C E F] [--rounds 5]

Goes on: finished tasks are kept.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.contact.support import Support
from ocptip.motion.task import MotionTask
from ocptip.standing.tolerance import NONE, PRESETS, Uncertainty
from ocptip.standing.within.worst_case import WorstCase, worst_case_of
from ocptip.trajectories.trajectory import Trajectory
from studies.common import PLANNING, RowFile, ended, number, percent, say, software, source_state, table
from studies.ramp_gap.free_form import NODES, FreeForm
from studies.ramp_gap.free_motion import FreeMotion, minimum_jerk, sampled
from studies.ramp_gap.search import SMOOTHING, cheaper_signs, exact_energy
from studies.tolerance.run import ALL, JUMPS, NOMINAL, tasks

INTERVALS, ITERATIONS = 20, 400
MOMENT_ROOM, SLIP_ROOM = 1e-3, 1e-3  # N m, and of GT: kept where less than that is missing
STARTS = (0.9, 1.5)  # times the duration of the nominal plan, minimum jerk

World = tuple[int, np.ndarray]
"""A tipping axis, and deviations (size,) in which its moment is kept."""


class InWorlds(FreeForm):
    """Free-form motions that keep moments about tipping axes and slip in some worlds.

    Args:
        task: start, goal, robot.
        cases: of its robot within the tolerance that has the worlds.
        worlds: in which moments are kept.
        slip_worlds: deviations (size,) in which the slip reserve is at most 1.
        even: as of `FreeForm`: ramps of equal length.
    """

    def __init__(
        self,
        task: MotionTask,
        cases: WorstCase,
        worlds: Sequence[World],
        slip_worlds: Sequence[np.ndarray],
        even: bool = False,
    ) -> None:
        self.cases, self.worlds, self.slip_worlds = cases, worlds, slip_worlds
        kinds = frozenset(("slip", "torque"))
        ends = task.start, task.goal
        super().__init__(task.robot, *ends, INTERVALS, kinds, iterations=ITERATIONS, even=even)

    def _tipping_rows(self, state: cs.SX, wrench: cs.SX, GN: cs.SX) -> cs.SX:
        return -moments_in(self.cases, self.worlds, state) / self.cases.reference

    def _slips(self) -> int:
        return len(self.slip_worlds)

    def _slip_wrenches(self, state: cs.SX, wrench: cs.SX) -> list[cs.SX]:
        s, theta, expression = self.cases.deviations._expressions
        in_world = cs.Function("world", [s, theta], [expression])
        return [in_world(state, own) for own in self.slip_worlds]

    def _slip_support(self) -> Support:
        return self.cases.footing.support


def moments_in(cases: WorstCase, worlds: Sequence[World], state: cs.SX) -> cs.SX:
    """Moment (N m) about its axis in each world, as an expression of angles, speeds, accelerations (3 n,)."""
    s, theta, wrench = cases.deviations._expressions
    in_world, affine = cs.Function("world", [s, theta], [wrench]), cases.footing.tip_over.affine_moments
    assert affine is not None
    A, b = affine
    return cs.vertcat(*[cs.dot(cs.DM(A[k]), in_world(state, own)) + b[k] for k, own in worlds])


def worst_worlds(cases: WorstCase, s: np.ndarray) -> tuple[list[World], float]:
    """Of each tipping axis the world in which a state of s (N, 3 n) is worst; the least moment, N m."""
    found, least_moment = [], np.inf
    for axis in range(cases.axes):
        worst = cases.moments(s, np.full(len(s), axis))
        k = int(np.argmin(worst.values))
        found.append((axis, worst.theta[k]))
        least_moment = min(least_moment, float(worst.values[k]))
    return found, least_moment


def slipping_worlds(cases: WorstCase, s: np.ndarray) -> tuple[list[np.ndarray], float]:
    """Worlds of the two instants of s (N, 3 n) that slip most, if any does; the greatest GT."""
    worst = cases.slip(s, 3)
    order = [k for k in np.argsort(-worst.values) if worst.values[k] > 1 + SLIP_ROOM]
    found: list[np.ndarray] = []
    for theta in worst.theta[order]:
        if len(found) < 2 and not any(np.allclose(theta, other, rtol=1e-3) for other in found):
            found.append(theta)
    return found, float(worst.values.max())


def least(problem: FreeForm, guess: FreeMotion, smoothing: Sequence[float] = SMOOTHING) -> FreeMotion | None:
    """The optimum near a guess, as `ramp_gap.search` finds it; None without success."""
    motion = guess
    for eps in smoothing:
        motion, _ = problem.solve(motion, eps=eps, GT=1.0)
    signs, report = None, {}
    for _ in range(3):
        new = cheaper_signs(problem.robot, motion)
        if signs is not None and np.array_equal(new, signs):
            break
        signs = new
        motion, report = problem.solve(motion, signs=signs, GT=1.0)
    return motion if report["success"] else None


def floor(
    task: MotionTask, tolerance: Uncertainty, plans: Sequence[Trajectory], rounds: int
) -> dict[str, Any]:
    """Least energies found: of all starts in the first worlds, then with more worlds, each from the last."""
    began, cases = time.process_time(), worst_case_of(task.robot, tolerance)
    s = np.hstack([np.array([task.start, task.goal]), np.zeros((2, 2 * task.robot.n))])
    worlds, _ = worst_worlds(cases, s)
    slip_worlds = [np.zeros(cases.deviations.size)]
    guesses = [sampled(plan, INTERVALS) for plan in plans]
    guesses += [minimum_jerk(task.start, task.goal, share * plans[0].end, INTERVALS) for share in STARTS]
    steps: list[dict[str, Any]] = []
    for round_ in range(1 + rounds):
        problem = InWorlds(task, cases, worlds, slip_worlds)
        smoothing = SMOOTHING[-1:] if round_ else SMOOTHING
        found = [motion for guess in guesses if (motion := least(problem, guess, smoothing)) is not None]
        if not found:
            break
        costs = [exact_energy(task.robot, motion) for motion in found]
        best = found[int(np.argmin(costs))]
        s = np.hstack([part.reshape(-1, task.robot.n) for part in best.inside(NODES)])
        more, short = worst_worlds(cases, s)
        slipping, GT = slipping_worlds(cases, s)
        counts = {"worlds": len(worlds), "slip_worlds": len(slip_worlds)}
        steps.append({"energies_J": sorted(costs), **counts, "short_Nm": short, "GT": GT})
        say(f"  {counts}: {min(costs):.1f} J in {best.duration:.3f} s, {short:.2f} N m, GT {GT:.3f}")
        if short > -MOMENT_ROOM and not slipping:
            break
        worlds += more if short <= -MOMENT_ROOM else []
        slip_worlds, guesses = [*slip_worlds, *slipping], [best]
    problem = InWorlds(task, cases, worlds, slip_worlds, even=True)
    even = [
        motion for guess in (guesses[0], sampled(plans[-1], INTERVALS)) if (motion := least(problem, guess))
    ]
    ramps = min((exact_energy(task.robot, motion) for motion in even), default=None)
    say(f"  the same by {INTERVALS} ramps of equal length: {ramps and number(ramps, 1)} J")
    cpu = time.process_time() - began
    return {"steps": steps, "even_J": ramps, "duration_s": best.duration, "cpu_s": cpu}


def markdown(rows: Sequence[dict[str, Any]], notes: list[str]) -> str:
    """What is found below which nothing seems to get."""
    lines = []
    for row in rows:
        nominal, first, last = row["nominal_J"], row["steps"][0]["energies_J"], row["steps"][-1]
        least_of_all = last["energies_J"][0]
        shown = [number(nominal, 1), number(row["free_J"], 1), number(least_of_all, 1)]
        shown += [percent(least_of_all / nominal - 1, 1), percent(least_of_all / row["free_J"] - 1, 1)]
        shown += [percent(row["even_J"] / nominal - 1, 1) if row["even_J"] else "-"]
        shown += [percent(row["within_J"] / nominal - 1, 1) if row["within_J"] else "-"]
        spread = percent(first[-1] / first[0] - 1, 2)
        shown += [f"{len(first)}, {spread}", f"{last['worlds']}, {last['slip_worlds']}"]
        shown += [number(last["short_Nm"], 2), number(last["GT"], 3)]
        lines.append([row["task"], *shown])
    head = ["task", "nominal ramps J", "nominal free form J", "floor J", "floor over nominal ramps"]
    head += [
        "over nominal free form",
        f"{INTERVALS} equal ramps over nominal ramps",
        "planned over nominal ramps",
        "starts, spread",
        "worlds of moments, of slip",
    ]
    head += ["least moment in all worlds N m", "greatest GT found"]
    text = ["# What no motion seems to get below within `workshop`", "", *table(head, lines), ""]
    return "\n".join([*text, *notes]) + "\n"


def run(prices: Path, out: Path, names: Sequence[str], rounds: int) -> str:
    """Compute what is missing, write the table."""
    out.mkdir(parents=True, exist_ok=True)
    file = RowFile(out / "tolerance_floor.json", {"rounds": rounds}, ("task",), source_state(*PLANNING))
    by = {(row["task"], row["part"]): row for row in json.loads(prices.read_text())["rows"]}
    for name in names:
        if file.find(task=name) is not None:
            continue
        task, preset = tasks()[name]
        static = replace(PRESETS[preset], **{key: getattr(NONE, key) for key in JUMPS})
        plans = [Trajectory.from_dict(by[name, part]["motion"]) for part in (NOMINAL, ALL)]
        say(f"{name}, as described")
        free = floor(task, NONE, plans[:1], 0)
        say(f"{name}, within {preset}")
        own = floor(task, static, plans, rounds)
        energies = {"nominal_J": by[name, NOMINAL]["energy_J"], "within_J": by[name, ALL].get("energy_J")}
        file.put({"task": name, **energies, "free_J": free["steps"][-1]["energies_J"][0], **own})
    notes = [f"- {software(versions(('numpy', 'casadi')))}; {INTERVALS} intervals."]
    text = markdown(file.own, notes)
    write_text(out / "tolerance_floor.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="What no motion seems to get below within a tolerance.")
    parser.add_argument("--prices", type=Path, required=True, help="tolerance.json of `tolerance.run`")
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--tasks", nargs="+", default=["B", "C", "E", "F"])
    parser.add_argument("--rounds", type=int, default=5, help="of adding worlds")
    given = parser.parse_args(argv)
    return ended(
        "floor", lambda: run(given.prices, given.out, given.tasks, given.rounds), "finished tasks are kept."
    )


if __name__ == "__main__":
    sys.exit(main())
