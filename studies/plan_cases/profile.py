"""Where the time of a plan goes: evaluation, callbacks, Ipopt's own, building, check; imports and processes.

One start of each case runs with clocks around the program's functions, the callbacks and the solves, after
another one that has compiled and loaded everything. CPU times of the thread. Whole commands run in a process
each, CPU time by part, the least of two. Imports and processes are timed from outside, wall time, the least
of three. With `--others` only starts: of task files, and of cases of which all axes are optimised.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

from ocptip.basics.write import versions, write_json
from ocptip.motion.planner.one_start import Search
from ocptip.motion.planner.program import MotionProgram
from ocptip.motion.task import MotionTask
from ocptip.numerics import ipopt
from ocptip.numerics.threads import one_thread
from ocptip.numerics.workers import worker_pool
from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import NONE
from ocptip.task_files.cycle import read_task
from studies.common import RESULTS, ended, machine, number, table

PARTS = ("values", "gradient", "jacobian", "hessian")
COMMANDS = {
    "python": "pass",
    "numpy, casadi, llvmlite": "import numpy, casadi, llvmlite",
    "planner": "import ocptip.motion.plan",
    "command line, plan": "import ocptip.cli.plan.plan",
    "a worker that is ready": "from studies.plan_cases.profile import ready; ready()",
}
HEAD = (
    "case",
    "iterations",
    "ms per iteration",
    *PARTS,
    "callbacks",
    "Ipopt's own",
    "nodes, rows of the last",
)
WHOLE = {  # parts of a command: the functions that do them
    "task": "ocptip.cli.plan.plan._asked",
    "search": "ocptip.api.plan.plan_motion",
    "controller": "ocptip.motion.files.execution.execute",
    "tolerated": "ocptip.api.results.plan.robustness",
    "figures": "ocptip.pictures.frame.png",
}
STAGES = ("case", "building s", "start", "coarse", "fine", "exact", "check", "all but building")


class Clocks:
    """CPU seconds by name; what a clock inside another one counts is counted there, too."""

    def __init__(self, clock: Callable[[], float] = time.thread_time) -> None:
        self.clock, self.seconds = clock, Counter[str]()
        self.last: MotionProgram | None = None

    def around(self, name: str, function: Callable) -> Callable:
        def timed(*arguments: Any, **options: Any) -> Any:
            began = self.clock()
            try:
                return function(*arguments, **options)
            finally:
                self.seconds[name] += self.clock() - began
                if name == "solve":
                    self.last = arguments[0]

        return timed

    @contextmanager
    def running(self) -> Iterator[None]:
        watched = [(MotionProgram, name) for name in (*PARTS, "solve")] + [(ipopt._Function, "eval_buffer")]
        patches = [mock.patch.object(of, name, self.around(name, getattr(of, name))) for of, name in watched]
        for patch in patches:
            patch.start()
        try:
            yield
        finally:
            for patch in patches:
                patch.stop()


def other_task(name: str) -> tuple[str, MotionTask]:
    """Of "UR5e=folder/task.toml", as described; "B" is the case with all its axes optimised."""
    title, _, path = name.partition("=")
    if path:
        task = read_task(path, NONE)
        assert isinstance(task, MotionTask), f"{path}: a cycle"
        return title, task
    task = experiment_task(name, "effective")
    return f"{name}, all axes", replace(task, optimised=tuple(range(task.robot.n)))


def profile(case: str, task: MotionTask) -> dict[str, Any]:
    """Seconds of one start, number 1; of `solve` those of the parts, of callbacks and of Ipopt are shares."""
    clocks = Clocks()
    with one_thread:
        began = time.thread_time()
        search = Search(task)
        building = time.thread_time() - began
        search.run(0, 0)
        with clocks.running():
            result = search.run(1, 0).result
    seconds, last = clocks.seconds, clocks.last
    assert last is not None
    evaluation = sum(seconds[name] for name in PARTS)
    return {
        "case": case,
        "iterations": result.iterations,
        "per_iteration_s": seconds["solve"] / result.iterations,
        "parts_s": {name: seconds[name] / result.iterations for name in PARTS},
        "callbacks_s": (seconds["eval_buffer"] - evaluation) / result.iterations,
        "ipopt_s": (seconds["solve"] - seconds["eval_buffer"]) / result.iterations,
        "nodes": last.n_nodes,
        "rows": len(last.bounds()[0]),
        "building_s": building,
        "stages_s": result.stages,
        "start_s": result.cpu_seconds,
    }


def whole(case: str) -> None:
    """Plan a case as `ocptip plan` does with one job, and print CPU seconds by part as JSON."""
    from ocptip.cli import main

    clocks = Clocks(time.process_time)
    parts = {name: resolve_name(function) for name, function in WHOLE.items()}
    clocks.seconds["imports"] = time.process_time()  # since the process began
    with TemporaryDirectory() as folder, redirect_stdout(StringIO()), ExitStack() as patches:
        for name, function in WHOLE.items():
            timed = clocks.around(name, parts[name])
            patches.enter_context(mock.patch(function, timed))
        main.main(["plan", case, "--tolerance", "none", "--jobs", "1", "--out", folder, "--overwrite"])
    clocks.seconds["all"] = time.process_time()
    print(json.dumps(clocks.seconds))


def commands(cases: list[str]) -> dict[str, dict[str, float]]:
    """CPU seconds of whole commands by part, the least of two runs."""
    found = {}
    for case in cases:
        line = f"from studies.plan_cases.profile import whole; whole({case!r})"
        how = {"check": True, "capture_output": True, "text": True}
        runs = [json.loads(subprocess.run([sys.executable, "-c", line], **how).stdout) for _ in range(2)]
        found[case] = min(runs, key=lambda run: run["all"])
    return found


def ready() -> None:
    """Start a worker as plans do, and wait until it has loaded the planner."""
    with worker_pool(None, 1, 1) as pool:
        pool.submit(len, b"").result()
        pool.submit(loaded_planner).result()


def loaded_planner() -> None:
    """Nothing: this module loads the planner."""


def processes() -> dict[str, float]:
    """Wall seconds of each of COMMANDS."""
    found = {}
    for name, command in COMMANDS.items():
        times = []
        for _ in range(3):
            began = time.perf_counter()
            subprocess.run([sys.executable, "-c", command], check=True)
            times.append(time.perf_counter() - began)
        found[name] = min(times)
    return found


def text(rows: list[dict[str, Any]], wholes: dict[str, dict[str, float]], loaded: dict[str, float]) -> str:
    """Four tables."""
    lines = [
        "CPU ms per iteration of Ipopt, effective base, start 1 of seed 0; values include what they keep for "
        "gradient and Jacobian.",
        "",
        *of_starts(rows),
        "",
        "CPU s of `ocptip plan CASE --tolerance none --jobs 1` by part.",
        "",
        *table(
            ("case", "imports", *WHOLE, "all"),
            [
                [case, *(number(own[k], 2) for k in ("imports", *WHOLE, "all"))]
                for case, own in wholes.items()
            ],
        ),
        "",
    ]
    return "\n".join([*lines, *table(("wall s", ""), [[k, number(v, 2)] for k, v in loaded.items()]), ""])


def of_starts(rows: list[dict[str, Any]]) -> list[str]:
    """Two tables: by iteration, by stage."""
    evaluation, stages = [], []
    for row in rows:
        parts = [row["per_iteration_s"], *row["parts_s"].values(), row["callbacks_s"], row["ipopt_s"]]
        own = [number(1e3 * part, 2) for part in parts]
        evaluation.append([row["case"], str(row["iterations"]), *own, f"{row['nodes']}, {row['rows']}"])
        times = [
            row["building_s"],
            *(row["stages_s"].get(name, 0.0) for name in STAGES[2:-1]),
            row["start_s"],
        ]
        stages.append([row["case"], *(number(seconds, 2) for seconds in times)])
    between = ["", "CPU s of that start by stage.", ""]
    return [*table(HEAD, evaluation), *between, *table(STAGES, stages)]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=RESULTS, metavar="DIR")
    parser.add_argument("--cases", default="A,B,C,D,E,F,G,H")
    text_ = "cases, all of whose axes are optimised, and NAME=TASK.toml: profiled instead"
    parser.add_argument("--others", metavar="LIST", help=text_)
    options = parser.parse_args()

    def others() -> str:
        rows = [profile(*other_task(name)) for name in options.others.split(",")]
        loads = ", ".join(number(load) for load in os.getloadavg())
        title = "CPU ms per iteration of Ipopt, start 1 of seed 0, as described (no tolerance)."
        lines = [
            f"{title} Load of the machine over 1, 5 and 15 min when it ended: {loads}.",
            "",
            *of_starts(rows),
        ]
        (options.out / "plan_profile_others.md").write_text("\n".join([*lines, ""]))
        return "\n".join([*lines, ""])

    def study() -> str:
        cases = options.cases.split(",")
        tasks = [(case, experiment_task(case, "effective")) for case in cases]
        rows, parts, loaded = [profile(*one) for one in tasks], commands(cases), processes()
        data = {"versions": versions(), "machine": machine(), "rows": rows, "commands_s": parts}
        write_json(options.out / "plan_profile.json", data | {"processes_s": loaded}, indent=1)
        (options.out / "plan_profile.md").write_text(text(rows, parts, loaded))
        return text(rows, parts, loaded)

    return ended("profile", others if options.others else study)


if __name__ == "__main__":
    sys.exit(main())
