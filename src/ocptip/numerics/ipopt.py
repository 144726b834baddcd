"""Ipopt on a program that evaluates itself in NumPy, through CasADi callbacks with all derivatives given."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import casadi as cs
import numpy as np

from ocptip.basics.interrupts import interrupts_after
from ocptip.numerics.threads import one_thread

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
"""Status of a program that met its tolerance, or the acceptable one."""

_ENDINGS = {
    "Infeasible_Problem_Detected": "nothing near it keeps all of them",
    "Restoration_Failed": "the restoration reached no point where all of them are kept",
    "Maximum_Iterations_Exceeded": "no end after the allowed number of iterations",
    "Maximum_CpuTime_Exceeded": "no end within the allowed time",
    "Maximum_WallTime_Exceeded": "no end within the allowed time",
    "Search_Direction_Becomes_Too_Small": "steps too small to get anywhere",
    "Diverging_Iterates": "steps that lead ever farther away",
    "Invalid_Number_Detected": "numbers that are not finite",
    "Error_In_Step_Computation": "no step could be computed",
    "User_Requested_Stop": "stopped",
}


def ending(status: str) -> str:
    """An explanation of Ipopt's status of an unsolved program, and the status, for brackets in a message."""
    return f"{_ENDINGS.get(status, 'the search was given up')}; Ipopt: {status}"


class Program(Protocol):
    """A smooth nonlinear program: values and derivatives at x (nx,)."""

    def values(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective and rows."""
        ...

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Gradient of the objective, (nx,)."""
        ...

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Jacobian of the rows, (rows, nx)."""
        ...

    def hessian(self, x: np.ndarray, sigma: float, multipliers: np.ndarray) -> np.ndarray:
        """Hessian of sigma * objective + multipliers . rows, (nx, nx)."""
        ...


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of an Ipopt run.

    Attributes:
        x: (nx,).
        objective: at x.
        violation: largest violation of a bound or row at x.
        multipliers, bound_multipliers: of rows and of x; positive at an upper bound, negative at a lower one.
        status: Ipopt's word.
        converged: it met its tolerance, or the acceptable one.
        iterations: of this solve.
        seconds: wall time.
    """

    x: np.ndarray
    objective: float
    violation: float
    multipliers: np.ndarray
    bound_multipliers: np.ndarray
    status: str
    converged: bool
    iterations: int
    seconds: float


class _Function(cs.Callback):
    """A CasADi function of dense arguments that runs `evaluate(arguments, results)` on NumPy arrays.

    Results are views. Arguments are copies: views cannot be written, and kernels would be compiled again for
    such.

    What that raises goes into `errors`. Where there are some, all functions that share the list fail at once:
    Ipopt takes a failure for a step that was too long, and would try dozens of shorter ones.
    """

    def __init__(
        self,
        name: str,
        inputs: dict[str, cs.Sparsity],
        outputs: dict[str, cs.Sparsity],
        evaluate: Callable[[list, list], None],
        errors: list[BaseException],
    ) -> None:
        super().__init__()
        self._inputs, self._outputs, self._evaluate = list(inputs.items()), list(outputs.items()), evaluate
        self.errors = errors
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_name_in(self, i: int) -> str:
        return self._inputs[i][0]

    def get_name_out(self, i: int) -> str:
        return self._outputs[i][0]

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        return self._inputs[i][1]

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        return self._outputs[i][1]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arg: tuple, res: tuple) -> int:
        if self.errors:
            return 1
        try:
            self._evaluate(
                [None if a is None else np.array(np.frombuffer(a)) for a in arg],
                [None if r is None else np.frombuffer(r) for r in res],
            )
        except BaseException as error:  # handed on behind the solver, which would swallow it
            self.errors.append(error)
        return int(bool(self.errors))


def solve(
    program: Program,
    x0: np.ndarray,
    x_bounds: tuple[np.ndarray, np.ndarray],
    bounds: tuple[np.ndarray, np.ndarray],
    *,
    multipliers: tuple[np.ndarray, np.ndarray] | None = None,
    start_mu: float = 0.1,
    tolerance: float = 1e-6,
    max_iterations: int = 150,
    seconds: float | None = None,
    strategy: str = "monotone",
    push: float = 1e-2,
    pattern: tuple[np.ndarray, np.ndarray] | None = None,
) -> Solution:
    """Solve a program from x0.

    Args:
        program: what to solve.
        x0: (nx,).
        x_bounds: lower and upper bounds of x.
        bounds: of the rows.
        multipliers: of rows and x, to start from.
        start_mu: first barrier parameter; small where x0 is nearly optimal.
        tolerance: Ipopt's.
        max_iterations: then it stops, not converged.
        seconds: wall time after which it stops, not converged.
        pattern: where the Jacobian (rows, nx) and the Hessian (nx, nx) may differ from zero; default
            everywhere.

    Raises:
        Exception: whatever the program's functions raise, KeyboardInterrupt included.
    """
    limits: dict[str, Any] = {"max_iter": max_iterations}
    if seconds is not None:
        limits["max_wall_time"] = max(seconds, 1e-3)
    warm = {} if multipliers is None else _warm_start(start_mu, push)
    start, errors = time.perf_counter(), list[BaseException]()
    # CasADi gets callbacks instead of expressions: rows and derivatives come from compiled kernels.
    with interrupts_after(errors):
        functions = _functions(program, len(x0), len(bounds[0]), pattern, errors)
        options = {
            "grad_f": functions[1],
            "jac_g": functions[2],
            "hess_lag": functions[3],
            "print_time": False,
            "no_nlp_grad": True,
            "calc_lam_p": False,
            "error_on_fail": False,
            "show_eval_warnings": False,
            "ipopt": _ipopt_options(tolerance, start_mu, strategy, push) | limits | warm,
        }
        solver = nlpsol(functions[0], options)
        arguments = {
            "x0": np.clip(x0, *x_bounds),
            "lbx": x_bounds[0],
            "ubx": x_bounds[1],
            "lbg": bounds[0],
            "ubg": bounds[1],
        }
        if multipliers is not None:
            arguments["lam_g0"], arguments["lam_x0"] = multipliers
        result = solver(**arguments)
        stats = solver.stats()
        x, g = np.array(result["x"]).ravel(), np.array(result["g"]).ravel()
    status = stats["return_status"]
    return Solution(
        x=x,
        objective=float(result["f"]),
        violation=max(_violation(x, x_bounds), _violation(g, bounds)),
        multipliers=np.array(result["lam_g"]).ravel(),
        bound_multipliers=np.array(result["lam_x"]).ravel(),
        status=status,
        converged=status in SOLVED,
        iterations=int(stats["iter_count"]),
        seconds=time.perf_counter() - start,
    )


def nlpsol(program: cs.Function | dict[str, Any], options: dict[str, Any]) -> cs.Function:
    """CasADi's solver of a program by Ipopt."""
    _load()
    return cs.nlpsol("solver", "ipopt", program, options)


@cache
def _load() -> None:
    """Loads Ipopt with its linear algebra."""
    cs.load_nlpsol("ipopt")
    one_thread.loaded()


def _functions(
    program: Program,
    nx: int,
    ng: int,
    pattern: tuple[np.ndarray, np.ndarray] | None,
    errors: list[BaseException],
) -> list[_Function]:
    """The program as CasADi wants it: values, gradient, Jacobian and Hessian, with the names it expects."""
    dense = cs.Sparsity.dense
    filled = (np.ones((ng, nx), dtype=bool), np.ones((nx, nx), dtype=bool)) if pattern is None else pattern
    slopes, bends = _places(filled[0]), _places(np.triu(filled[1]))

    def values(a: list, r: list) -> None:
        f, g = program.values(a[0])
        if r[0] is not None:
            r[0][:] = f
        if r[1] is not None:
            r[1][:] = g

    def gradient(a: list, r: list) -> None:
        if r[0] is not None:
            r[0][:] = program.values(a[0])[0]
        if r[1] is not None:
            r[1][:] = program.gradient(a[0])

    def jacobian(a: list, r: list) -> None:
        if r[0] is not None:
            r[0][:] = program.values(a[0])[1]
        if r[1] is not None:
            r[1][:] = program.jacobian(a[0])[slopes]

    def hessian(a: list, r: list) -> None:
        if r[0] is not None:
            r[0][:] = program.hessian(a[0], float(a[2][0]), a[3])[bends]

    at_x, f1 = {"x": dense(nx, 1), "p": dense(0, 0)}, dense(1, 1)
    return [
        _Function("nlp", at_x, {"f": f1, "g": dense(ng, 1)}, values, errors),
        _Function("nlp_grad_f", at_x, {"f": f1, "grad_f_x": dense(nx, 1)}, gradient, errors),
        _Function(
            "nlp_jac_g", at_x, {"g": dense(ng, 1), "jac_g_x": _sparsity(ng, nx, slopes)}, jacobian, errors
        ),
        _Function(
            "nlp_hess_l",
            at_x | {"lam_f": f1, "lam_g": dense(ng, 1)},
            {"triu_hess_gamma_x_x": _sparsity(nx, nx, bends)},
            hessian,
            errors,
        ),
    ]


def _places(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a matrix's entries, column by column."""
    columns, rows = np.nonzero(mask.T)
    return rows, columns


def _sparsity(rows: int, columns: int, places: tuple[np.ndarray, np.ndarray]) -> cs.Sparsity:
    """The same for CasADi."""
    first = np.searchsorted(places[1], np.arange(columns + 1))
    return cs.Sparsity(rows, columns, first.tolist(), places[0].tolist())


def _ipopt_options(tolerance: float, start_mu: float, strategy: str, push: float) -> dict[str, Any]:
    return {
        "print_level": 0,
        "sb": "yes",
        "linear_solver": "mumps",
        "tol": tolerance,
        # Rows with corners may keep Ipopt from its tolerance: five nearly optimal iterations in a row are
        # enough.
        "acceptable_tol": 100 * tolerance,
        "acceptable_iter": 5,
        "acceptable_obj_change_tol": tolerance,
        "acceptable_constr_viol_tol": tolerance,
        "mu_init": start_mu,
        "mu_strategy": strategy,
        # By default Ipopt relaxes bounds by 1e-8, which a check would report as violations.
        "bound_relax_factor": 0.0,
        "bound_push": push,
        "bound_frac": push,
        "slack_bound_push": push,
        "slack_bound_frac": push,
    }


def _warm_start(start_mu: float, push: float) -> dict[str, Any]:
    """Options of a start with multipliers."""
    return {
        "warm_start_init_point": "yes",
        "warm_start_bound_push": push,
        "warm_start_bound_frac": push,
        "warm_start_slack_bound_push": push,
        "warm_start_slack_bound_frac": push,
        # Multipliers of bounds that are nearly 0 would stall the barrier method: they are pushed to its size.
        "warm_start_mult_bound_push": start_mu,
    }


def _violation(values: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> float:
    """By how much values leave their bounds at most; 0 inside."""
    low, high = bounds
    return max(float(np.max(low - values, initial=0.0)), float(np.max(values - high, initial=0.0)))
