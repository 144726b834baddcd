"""The methods of the comparison with Nelder-Mead.

Each searches from a point until it ends or time is up, and returns a sentence on how it ended; the recorder
has the result.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize

from studies.baselines.nelder_mead import nelder_mead
from studies.baselines.penalty import WEIGHT, Between, MotionPenalty, PenaltyValue

METHODS = ("ours", "nelder-mead", "nelder-mead-plain", "cma", "slsqp")
CMA_SIGMA = 0.2
SIMPLEX_STEP = 0.25  # better than 0.05 in trials with cases A and B
SIMPLEX_TOLERANCE = 1e-6
DIFFERENCE = 1e-6
ENERGY_UNIT = 100.0  # J, of SLSQP's cost
HISTORY_STEP = 0.005  # relative improvement that is worth a point of the history


@dataclass(frozen=True)
class Settings:
    """What a run depends on besides case, start and method.

    Attributes:
        seed: of the random starts.
        max_seconds: CPU time of a search at most.
        weight: S of the penalty.
        between: how maxima in time are found.
    """

    seed: int = 0
    max_seconds: float = 120.0
    weight: float = WEIGHT
    between: Between = "sides"


class TimeIsUpError(Exception):
    """Ends a search whose library has no time limit."""


class Recorder:
    """Evaluates a penalty, keeps the best point, count and history of the best cost; ends when time is up."""

    def __init__(self, penalty: MotionPenalty, max_seconds: float) -> None:
        self.penalty, self.max_seconds = penalty, max_seconds
        self.count, self.best, self.best_p = 0, np.inf, None
        self.began = time.process_time()
        self.history: list[tuple[float, int, float]] = []

    @property
    def over(self) -> bool:
        return self.cpu >= self.max_seconds

    @property
    def cpu(self) -> float:
        """CPU seconds so far."""
        return time.process_time() - self.began

    def evaluate(self, p: np.ndarray) -> PenaltyValue:
        if self.count and self.over:
            raise TimeIsUpError
        value = self.penalty.evaluate(p)
        self.count += 1
        if value.cost < self.best:
            self.best, self.best_p = value.cost, np.clip(p, 0.0, 1.0)
            if not self.history or value.cost < (1 - HISTORY_STEP) * self.history[-1][2]:
                self.history.append((self.cpu, self.count, value.cost))
        return value

    def cost(self, p: np.ndarray) -> float:
        return self.evaluate(p).cost


def search_nelder_mead(recorder: Recorder, p: np.ndarray, seed: int, adapted: bool = True) -> str:
    result = nelder_mead(
        recorder.cost,
        p,
        bounds=recorder.penalty.bounds,
        adapted=adapted,
        initial_step=SIMPLEX_STEP,
        tolerance=SIMPLEX_TOLERANCE,
        maxfev=10**9,
    )
    return result.message


def search_nelder_mead_plain(recorder: Recorder, p: np.ndarray, seed: int) -> str:
    return search_nelder_mead(recorder, p, seed, adapted=False)


def search_cma(recorder: Recorder, p: np.ndarray, seed: int) -> str:
    import cma  # an extra that only this method needs

    restarts, population = 0, None
    while not recorder.over:
        options = {"bounds": [0, 1], "seed": seed + 1 + restarts, "verbose": -9, "verb_log": 0}
        if population:
            options["popsize"] = population
        strategy = cma.CMAEvolutionStrategy(p, CMA_SIGMA, options)
        population = 2 * strategy.popsize
        while not strategy.stop():
            points = strategy.ask()
            strategy.tell(points, [recorder.cost(np.asarray(x)) for x in points])
        restarts += 1
    return f"time is up after {restarts} restarts"


def search_slsqp(recorder: Recorder, p: np.ndarray, seed: int) -> str:
    @lru_cache(maxsize=4)
    def at(key: bytes) -> PenaltyValue:
        return recorder.evaluate(np.clip(np.frombuffer(key), 0.0, 1.0))

    @lru_cache(maxsize=2)
    def slopes(key: bytes) -> np.ndarray:
        """Derivatives of (cost, limits), one column per parameter."""
        x, here = np.frombuffer(key), numbers(at(key))
        columns = []
        for k in range(len(x)):
            step = DIFFERENCE if x[k] + DIFFERENCE <= 1 else -DIFFERENCE
            moved = x.copy()
            moved[k] += step
            columns.append((numbers(recorder.evaluate(moved)) - here) / step)
        return np.column_stack(columns)

    def numbers(value: PenaltyValue) -> np.ndarray:
        return np.append(value.energy / ENERGY_UNIT, -value.limits)

    result = minimize(
        lambda x: numbers(at(x.tobytes()))[0],
        p,
        jac=lambda x: slopes(x.tobytes())[0],
        bounds=recorder.penalty.bounds,
        constraints={
            "type": "ineq",
            "fun": lambda x: numbers(at(x.tobytes()))[1:],
            "jac": lambda x: slopes(x.tobytes())[1:],
        },
        method="SLSQP",
        options={"maxiter": 10_000, "ftol": 1e-7},
    )
    return result.message


SEARCHES: dict[str, Callable[[Recorder, np.ndarray, int], str]] = {
    "nelder-mead": search_nelder_mead,
    "nelder-mead-plain": search_nelder_mead_plain,
    "cma": search_cma,
    "slsqp": search_slsqp,
}
