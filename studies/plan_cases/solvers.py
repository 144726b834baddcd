"""Other solvers that CasADi ships, on the programs of one start: the same functions, the same starts.

Each program that a start of a case solves with Ipopt is given to each solver, with exact first and second
derivatives. It counts as solved if no bound or row is broken by more than Ipopt's tolerance there; costs are
compared with Ipopt's. CPU seconds. A solver is stopped after 20 times what Ipopt takes, at least 2 s. Not
among them: blockSQP (its linear solver MA27 is not shipped), ALPAQA (asks for derivatives that callbacks
lack), Uno and fatrop (had solved at most one of five programs when a minute of a busy machine had passed).
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import casadi as cs
import numpy as np

from ocptip.basics.write import versions, write_json
from ocptip.motion.planner.one_start import Search
from ocptip.motion.planner.program import MotionProgram
from ocptip.numerics.threads import one_thread
from ocptip.published.tasks import experiment_task
from studies.common import RESULTS, ended, machine, number, table

QUIET = {"print_time": False, "error_on_fail": False}
SILENT_QP = {"error_on_fail": False}
SQP = {"print_header": False, "print_iteration": False, "print_status": False, "max_iter": 100}


def _sqp(qp: str, **options: Any) -> tuple[str, dict[str, Any]]:
    own = {"qpsol": qp, "qpsol_options": {**SILENT_QP, **options}, "convexify_strategy": "regularize"}
    own["elastic_mode"] = True
    return "sqpmethod", {**QUIET, **SQP, **own}


SOLVERS: dict[str, tuple[str, dict[str, Any]]] = {
    "SQP, qrqp": _sqp("qrqp", print_iter=False, print_header=False, print_info=False),
    "SQP, DAQP": _sqp("daqp"),
    "SQP, ProxQP": _sqp("proxqp"),
    "SLEQP": ("sleqp", QUIET),
}


@dataclass(frozen=True, eq=False)
class Solve:
    """One solve of a start with Ipopt.

    Attributes:
        stage: "smooth" or "exact".
        program, x0, tolerance: what was solved, from where.
        seconds, iterations, cost, violation: what Ipopt took and found.
    """

    stage: str
    program: MotionProgram
    x0: np.ndarray
    tolerance: float
    seconds: float
    iterations: int
    cost: float
    violation: float


def solves(case: str, number_: int) -> list[Solve]:
    """All solves of a start of seed 0."""
    found: list[Solve] = []
    own = MotionProgram.solve

    def solve(program: MotionProgram, x: np.ndarray, **options: Any) -> Any:
        x, began = x.copy(), time.process_time()
        solution = own(program, x, **options)
        spent, tolerance = time.process_time() - began, options["tolerance"]
        stage = "exact" if tolerance < 1e-3 else "smooth"
        rest = solution.iterations, solution.objective, solution.violation
        found.append(Solve(stage, program, x, tolerance, spent, *rest))
        return solution

    with one_thread:
        search = Search(experiment_task(case, "effective"))
        search.run(0, 0)  # compiles and loads
        with mock.patch.object(MotionProgram, "solve", solve):
            search.run(number_, 0)
    return found


class Values(cs.Callback):
    """Objective and rows of a program; CasADi asks for derivatives by `get_reverse`."""

    def __init__(self, program: MotionProgram) -> None:
        super().__init__()
        self.program, self.rows = program, len(program.bounds()[0])
        self._parts: list[cs.Callback] = []
        self.construct("values", {"enable_fd": False})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 2

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self.program.layout.size, 1)

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self.rows if i else 1, 1)

    def eval(self, arg: list) -> list:
        return list(self.program.values(np.array(arg[0]).ravel()))

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inames: list, onames: list, options: dict) -> cs.Function:
        def slopes(x: np.ndarray, *_: np.ndarray) -> list:
            self.program.values(x)
            return [self.program.gradient(x)[None], self.program.jacobian(x)]

        nx = self.program.layout.size
        outputs = [(1, nx), (self.rows, nx)]
        return self._kept(Given(name, [(nx, 1), (1, 1), (self.rows, 1)], outputs, slopes, inames, onames))

    def has_reverse(self, count: int) -> bool:
        return count == 1

    def get_reverse(self, _: int, name: str, inames: list, onames: list, options: dict) -> cs.Function:
        program, nx = self.program, self.program.layout.size

        def pulled(x: np.ndarray, _f: Any, _g: Any, on_f: np.ndarray, on_g: np.ndarray) -> list:
            program.values(x)
            return [on_f[0] * program.gradient(x) + program.jacobian(x).T @ on_g]

        def curved(x: np.ndarray, _f: Any, _g: Any, on_f: np.ndarray, on_g: np.ndarray, *_: Any) -> list:
            program.values(x)
            parts = program.hessian(x, float(on_f[0]), on_g), program.gradient(x), program.jacobian(x).T
            none = np.zeros((nx, 1)), np.zeros((nx, self.rows))
            return [parts[0], *none, parts[1][:, None], parts[2]]

        inputs = [(nx, 1), (1, 1), (self.rows, 1), (1, 1), (self.rows, 1)]
        return self._kept(Given(name, inputs, [(nx, 1)], pulled, inames, onames, curved))

    def _kept(self, part: cs.Callback) -> cs.Function:
        self._parts.append(part)
        return part


class Given(cs.Callback):
    """A function of NumPy arrays, with its Jacobian blocks if they are given."""

    def __init__(
        self,
        name: str,
        inputs: list[tuple[int, int]],
        outputs: list[tuple[int, int]],
        function: Callable[..., list],
        inames: list[str],
        onames: list[str],
        slopes: Callable[..., list] | None = None,
    ) -> None:
        super().__init__()
        self._shapes, self._names = (inputs, outputs), (inames, onames)
        self._function, self._slopes = function, slopes
        self._parts: list[cs.Callback] = []
        self.construct(name, {"enable_fd": False})

    def get_n_in(self) -> int:
        return len(self._shapes[0])

    def get_n_out(self) -> int:
        return len(self._shapes[1])

    def get_name_in(self, i: int) -> str:
        return self._names[0][i]

    def get_name_out(self, i: int) -> str:
        return self._names[1][i]

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        return cs.Sparsity.dense(*self._shapes[0][i])

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        return cs.Sparsity.dense(*self._shapes[1][i])

    def eval(self, arg: list) -> list:
        return self._function(*(np.array(a).ravel() for a in arg))

    def has_jacobian(self) -> bool:
        return self._slopes is not None

    def get_jacobian(self, name: str, inames: list, onames: list, options: dict) -> cs.Function:
        assert self._slopes is not None
        inputs, [(rows, _)] = self._shapes
        outputs = [(rows, size) for size, _ in inputs]
        part = Given(name, [*inputs, (rows, 1)], outputs, self._slopes, inames, onames)
        self._parts.append(part)
        return part


class TooLongError(Exception):
    """A solver takes its time."""


def tried(solve: Solve, plugin: str, options: dict[str, Any], seconds: float) -> dict[str, Any]:
    """What a solver finds."""
    program = solve.program
    x = cs.MX.sym("x", program.layout.size)
    values = Values(program)
    f, g = values(x)
    structure, bounds = program.structure, program.bounds()
    began = time.process_time()

    def stop(*_: Any) -> None:
        raise TooLongError

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        solver = cs.nlpsol("solver", plugin, {"x": x, "f": f, "g": g}, options)
        ends = {"lbx": structure.x_lower, "ubx": structure.x_upper, "lbg": bounds[0], "ubg": bounds[1]}
        start = np.clip(solve.x0, structure.x_lower, structure.x_upper)
        result = solver(x0=start, **ends)
        at = np.array(result["x"]).ravel()
        cost, rows = program.values(at)
        broken = [bounds[0] - rows, rows - bounds[1], structure.x_lower - at, at - structure.x_upper]
        violation = max(float(np.max(part, initial=0.0)) for part in broken)
    except (RuntimeError, TooLongError, NotImplementedError, ArithmeticError):
        cost, violation = np.inf, np.inf
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return {"cost": cost, "violation": violation, "seconds": time.process_time() - began}


def all_tried(case: str, name: str, number_: int) -> None:
    """Print what a solver finds for each solve of a start, as JSON, a line each."""
    plugin, options = SOLVERS[name]
    for solve in solves(case, number_):
        found = tried(solve, plugin, options, max(2.0, 20 * solve.seconds))
        line = {"stage": solve.stage, "tolerance": solve.tolerance, "ipopt_s": solve.seconds}
        line |= {"ipopt_cost": solve.cost, "ipopt_violation": solve.violation}
        print("LINE", json.dumps(line | found), flush=True)


def study(cases: list[str], number_: int) -> list[dict[str, Any]]:
    """Every solver on every case, each in a process: some do not come back."""
    rows = []
    for case in cases:
        for name in SOLVERS:
            call = f"all_tried({case!r}, {name!r}, {number_})"
            line = f"from studies.plan_cases.solvers import all_tried; {call}"
            try:
                told = subprocess.run(
                    [sys.executable, "-c", line], capture_output=True, text=True, timeout=600
                ).stdout
            except subprocess.TimeoutExpired as late:
                told = (late.stdout or b"").decode()
            found = [json.loads(one[5:]) for one in told.splitlines() if one.startswith("LINE ")]
            rows.append({"case": case, "solver": name, "solves": found})
    return rows


def text(rows: list[dict[str, Any]]) -> str:
    """The table."""
    head = ("case", "solver", "solved", "of", "CPU s", "Ipopt's", "same cost", "better", "worse")
    lines = []
    for row in rows:
        own = row["solves"]
        good = [s for s in own if s["violation"] <= max(s["tolerance"], 2 * s["ipopt_violation"])]
        gain = np.array([s["cost"] / s["ipopt_cost"] - 1 for s in good])
        seconds = sum(s["seconds"] for s in own), sum(s["ipopt_s"] for s in own)
        counts = np.sum(np.abs(gain) <= 1e-3), np.sum(gain < -1e-3), np.sum(gain > 1e-3)
        cells = [str(len(good)), str(len(own)), *(number(s, 2) for s in seconds), *map(str, counts)]
        lines.append([row["case"], row["solver"], *cells])
    return "\n".join([*table(head, lines, left=2), ""])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=RESULTS, metavar="DIR")
    parser.add_argument("--cases", default="A")
    parser.add_argument("--start", type=int, default=1)
    options = parser.parse_args()

    def run() -> str:
        rows = study(options.cases.split(","), options.start)
        data = {"versions": versions(), "machine": machine(), "rows": rows}
        write_json(options.out / "plan_solvers.json", data, indent=1)
        (options.out / "plan_solvers.md").write_text(text(rows))
        return text(rows)

    return ended("solvers", run)


if __name__ == "__main__":
    sys.exit(main())
