"""Times of the eight cases: building the programs, one evaluation."""

from __future__ import annotations

import json
import multiprocessing
import pickle
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from ocptip.basics.write import write_json
from ocptip.motion.planner.exact import Refiner
from ocptip.motion.planner.one_start import COARSE_ROWS, WIDTHS, Search
from ocptip.motion.planner.program import MotionProgram
from ocptip.motion.planner.random_start import random_start
from ocptip.motion.task import MotionTask
from ocptip.numerics.threads import one_thread
from ocptip.trajectories.trajectory import Trajectory
from studies.common import leave_interrupts_to_parent
from studies.plan_cases.journal import Journal, Options, best_plan, state

PARTS = ("values", "gradient", "Jacobian", "Hessian")
CALLS, BUILDINGS = 50, 3


def time_case(task: MotionTask, motion: Trajectory) -> dict:
    """Seconds for building the programs of a task and for evaluating the exact one at its solution.

    Building: `Search`, a random start, its coarse program, cost, rows and all derivatives for
    the first time. Evaluation: cost, rows and all derivatives of the exact program that has `motion` as its
    solution, cache cleared.
    """
    with one_thread:
        building = [_building_seconds(task) for _ in range(BUILDINGS)]
        search = Search(task)
        exact = Refiner(search.formulation, search.inner).first(
            search.formulation.variables(motion), merge=WIDTHS[-1]
        )
        program, solution = exact.program, exact.solution
        calls = np.array([evaluate(program, solution.x, solution.multipliers) for _ in range(CALLS)])
    return {
        "nodes": program.n_nodes,
        "variables": len(solution.x),
        "rows": len(solution.multipliers),
        "building_first_s": building[0],
        "building_s": float(np.median(building)),
        "evaluation_s": float(np.median(calls.sum(axis=1))),
        "parts_s": dict(zip(PARTS, np.median(calls, axis=0).tolist(), strict=True)),
    }


def _building_seconds(task: MotionTask) -> float:
    task = pickle.loads(pickle.dumps(task))  # without functions that its robot keeps
    rng = np.random.default_rng(0)
    began = time.perf_counter()
    formulation = Search(task).formulation
    start = random_start(task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng)
    x = formulation.variables(start)
    end = x[formulation.layout.end] = max(x[formulation.layout.end], formulation.earliest)
    program = formulation.coarse_program(task.limits, end)
    program = program.with_rows(program.near_rows(x, COARSE_ROWS))
    evaluate(program, x, np.ones(len(program.bounds()[0])))
    return time.perf_counter() - began


def evaluate(program: MotionProgram, x: np.ndarray, multipliers: np.ndarray) -> list[float]:
    """Seconds for objective and rows, gradient, Jacobian, Hessian, one after the other."""
    program = program.with_rows(program.rows)  # which keeps nothing of the last evaluation
    calls = (
        lambda: program.values(x),
        lambda: program.gradient(x),
        lambda: program.jacobian(x),
        lambda: program.hessian(x, 1.0, multipliers),
    )
    times = [time.perf_counter()]
    for call in calls:
        call()
        times.append(time.perf_counter())
    return np.diff(times).tolist()


def measure_times(path: Path, journal: Journal, options: Options, say: Callable[[str], None]) -> None:
    """Time each case with a plan in a process of its own, unless done with this state of the planner."""
    timed = read_times(path)
    for case in options.cases:
        plans = (best_plan(journal, name, case, options) for name in options.sets)
        plan = next((plan for plan in plans if plan), None)
        if plan is None or timed.get(case, {}).get("state") == state():
            continue
        say(f"times of case {case}")
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=spawn, initializer=leave_interrupts_to_parent) as pool:
            timed[case] = {"state": state(), **pool.submit(time_case, plan.task, plan.motion).result()}
        write_json(path, timed, indent=1)


def read_times(path: Path) -> dict[str, dict]:
    """By case; empty if nothing was timed."""
    return json.loads(path.read_text()) if path.exists() else {}


def times_path(out: Path) -> Path:
    """Where the times of building and evaluation are kept."""
    return out / "plan_cases_times.json"
