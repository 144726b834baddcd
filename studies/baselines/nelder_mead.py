"""The Nelder-Mead downhill simplex of appendix D: a centroid that leans to the better points, and bounds.

A simplex of n + 1 points moves through the space of n parameters by reflecting, expanding and contracting
its worst point, and shrinks about its best point where that does not help. To the method of Nelder and Mead
(D.1), the source adds

1. the *adapted centroid* (D.6): the mean of the n better points is weighted with what each is better than the
   worst, which turns the search towards the better points;
2. *bounds* and linear limits A p <= b (D.2), in three cases: (1) the centroid lies on one: inside contraction
   at once; (2) the reflected point lies outside: it is drawn back along its ray to the bound, and not
   expanded; (3) the expanded point lies outside: it is drawn back to the bound.

It ends when the simplex' volume |det V| / n! is below a bound (D.5). In 24 dimensions that volume leaves the
range of floating point numbers long before the simplex is small (24! = 6e23, edges of 1e-13 give 1e-336), so
the same criterion is written for its logarithm and for the n-th root: |det V| ^ (1 / n), the edge of a cube
as large as the parallelepiped on V, below `tolerance`.

The source's additions can be switched off to measure what they bring. Not built: general linear constraints.
"""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import Bounds, LinearConstraint, OptimizeResult

from ocptip.basics.errors import InputError, finite_array, positive_number

RHO, CHI, GAMMA, SIGMA = 1.0, 2.0, 0.5, 0.5
"""Reflection, expansion, contraction, shrinking (D.1)."""

MESSAGES = (
    "the simplex is smaller than the tolerance",
    "stopped: the number of function evaluations reached maxfev; allow more, or start again from x",
    "stopped: the time reached max_seconds; allow more, or start again from x",
    "stopped by the callback",
)
_SMALL, _EVALUATIONS, _SECONDS, _CALLBACK = range(4)

_ON_BOUND = 1e-12  # distance from a bound, relative to the range (or to 1), that is rounding
_HALVINGS = 30  # of a first step that leaves linear limits


def nelder_mead(
    fun: Callable[..., float],
    x0: ArrayLike,
    args: tuple = (),
    *,
    bounds: Bounds | Sequence[tuple[float | None, float | None]] | None = None,
    constraints: LinearConstraint | Sequence[LinearConstraint] = (),
    callback: Callable[..., None] | None = None,
    adapted: bool = True,
    tolerance: float = 1e-4,
    maxfev: int | None = None,
    max_seconds: float | None = None,
    initial_step: float | ArrayLike = 0.1,
    initial_simplex: ArrayLike | None = None,
    history: bool = False,
    **unused: Any,
) -> OptimizeResult:
    """Minimise a function without derivatives, see the module.

    Called directly, or as `scipy.optimize.minimize(fun, x0, method=nelder_mead, bounds=..., options={...})`.

    Args:
        fun: fun(x, *args) with x (n,); NaN counts as infinity.
        x0: (n,), the first point of the simplex, within the bounds.
        args: further arguments of fun.
        bounds: `scipy.optimize.Bounds` or n pairs (lower, upper) with None or infinity for none; None: the
            method without bounds.
        constraints: linear limits, one or several `scipy.optimize.LinearConstraint`, that leave room; x0
            keeps them.
        callback: called after every iteration, with the point (n,), or, if its parameter is called
            `intermediate_result`, with a result so far (x, fun, nfev, nit). It may raise StopIteration.
        adapted: weighted centroid (D.6), else the plain one (D.1).
        tolerance: of the edge |det V| ^ (1 / n), in units of x; the source's bound of the volume is
            tolerance ^ n / n!. 0: go on to the other limits.
        maxfev: function evaluations at most, default 1000 n.
        max_seconds: wall time at most.
        initial_step: of each parameter, one number or (n,): point k + 1 of the simplex is x0 with parameter k
            changed by it, upwards if the bounds leave room for that, else towards the farther bound; where
            that breaks a linear limit, to the other side or less far.
        initial_simplex: (n + 1, n) instead; x0 then only gives n.
        history: keep every improvement of the best value.

    Returns:
        x, fun, success (the simplex became small), status, message, nfev, nit, final_simplex (points (n + 1,
        n), values (n + 1,), best first), shrinks (number of times the whole simplex shrank), and `history` if
        asked for: list of (nfev, seconds, fun).

    Raises:
        InputError: an argument cannot be used; limits that are not linear, or derivatives, are given.
    """
    _refuse(unused)
    x0 = finite_array("x0", x0, (None,))
    if not len(x0):
        raise InputError("x0: at least one parameter is needed, got none")
    lower, upper = _bounds(bounds, len(x0))
    rows, most = _linear_limits(constraints, len(x0))
    points = _start_simplex(x0, lower, upper, (rows, most), initial_step, initial_simplex)
    tolerance = positive_number("tolerance", tolerance, zero_allowed=True)
    maxfev = 1000 * len(x0) if maxfev is None else maxfev
    if isinstance(maxfev, bool) or not isinstance(maxfev, int | np.integer) or maxfev < 1:
        raise InputError(f"maxfev: must be a whole number >= 1, got {maxfev!r}")
    limit = math.inf if max_seconds is None else positive_number("max_seconds", max_seconds)
    budget = _Budget(fun, tuple(args), int(maxfev), limit, history)
    simplex = _Simplex(points, np.full(len(points), np.inf), lower, upper, rows, most, adapted)
    nit = 0
    try:
        for k, point in enumerate(points):
            simplex.values[k] = budget(point)
        simplex.sort()
        status = None
        while status is None:
            nit += 1
            contracted = simplex.step(budget)
            if contracted and simplex.edge() < tolerance:  # step 7: only then the volume has shrunk
                status = _SMALL
            _report(callback, simplex, budget, nit)
    except _BudgetError as spent:
        status = spent.status
    except StopIteration:
        status = _CALLBACK
    simplex.sort()
    result = OptimizeResult(
        x=simplex.points[0].copy(),
        fun=float(simplex.values[0]),
        success=status == _SMALL,
        status=status,
        message=MESSAGES[status],
        nfev=budget.count,
        nit=nit,
        shrinks=simplex.shrinks,
        final_simplex=(simplex.points, simplex.values),
    )
    if history:
        result.history = budget.history
    return result


class _BudgetError(Exception):
    def __init__(self, status: int) -> None:
        super().__init__(MESSAGES[status])
        self.status = status


class _Budget:
    """The function with its count, time limit and history of improvements."""

    def __init__(self, fun: Callable, args: tuple, maxfev: int, seconds: float, keep: bool) -> None:
        self.fun, self.args, self.maxfev, self.seconds, self.keep = fun, args, maxfev, seconds, keep
        self.count, self.best, self.began = 0, np.inf, time.perf_counter()
        self.history: list[tuple[int, float, float]] = []

    def __call__(self, x: np.ndarray) -> float:
        if self.count >= self.maxfev:
            raise _BudgetError(_EVALUATIONS)
        if self.count and time.perf_counter() - self.began >= self.seconds:
            raise _BudgetError(_SECONDS)
        value = float(self.fun(x.copy(), *self.args))
        self.count += 1
        value = np.inf if np.isnan(value) else value
        if value < self.best:
            self.best = value
            if self.keep:
                self.history.append((self.count, time.perf_counter() - self.began, value))
        return value


@dataclass
class _Simplex:
    """n + 1 points with their values, best first after `sort`; one iteration is `step`.

    Linear limits are `rows` (m, n) of length 1, and what they are `most` (m,).
    """

    points: np.ndarray
    values: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rows: np.ndarray
    most: np.ndarray
    adapted: bool
    shrinks: int = 0

    def sort(self) -> None:
        order = np.argsort(self.values, kind="stable")
        self.points, self.values = self.points[order], self.values[order]

    def edge(self) -> float:
        """|det V| ^ (1 / n) with the rows p_h - p_1 of V (D.5)."""
        sign, log_det = np.linalg.slogdet(self.points[1:] - self.points[0])
        return math.exp(log_det / len(self.lower)) if sign else 0.0

    def step(self, f: Callable[[np.ndarray], float]) -> bool:
        """Steps 2 to 6 of the method with the three cases of bounds; True if the volume shrank."""
        values, worst = self.values, self.points[-1]
        centroid = self._centroid()
        if self._on_bound(centroid):  # case 1
            return self._contract(centroid, worst, f, values[-1])
        direction = centroid - worst
        reach = self._reach(centroid, direction)
        cut = reach < RHO  # case 2
        reflected = self._on_ray(centroid, direction, min(RHO, reach))
        f_r = f(reflected)
        if f_r < values[0] and not cut:
            expanded = self._on_ray(centroid, direction, min(CHI * RHO, reach))  # case 3: cut at the bound
            f_e = f(expanded)
            self._replace(*((expanded, f_e) if f_e < f_r else (reflected, f_r)))
            return False
        if f_r < values[-2]:
            self._replace(reflected, f_r)
            return False
        if f_r < values[-1]:
            return self._contract(centroid, reflected, f, f_r)
        return self._contract(centroid, worst, f, values[-1])

    def _centroid(self) -> np.ndarray:
        better = self.points[:-1]
        if self.adapted and np.isfinite(self.values[-1]):
            gain = self.values[-1] - self.values[:-1]
            if np.isfinite(gain[0]) and gain[0] > 0:
                weights = gain / np.max(gain)  # the sum of tiny gains must not vanish
                return weights @ better / np.sum(weights)
        finite = np.isfinite(self.values[:-1])
        return np.mean(better[finite] if self.adapted and finite.any() else better, axis=0)

    def _contract(self, centroid: np.ndarray, towards: np.ndarray, f: Callable, at_most: float) -> bool:
        """Outside or inside contraction (5.3, 5.4); the simplex shrinks about its best point if it fails."""
        point = centroid + GAMMA * (towards - centroid)
        value = f(point)
        if value < at_most or (value == at_most and np.isfinite(value)):
            self._replace(point, value)
            return True
        self.shrinks += 1
        best = self.points[0].copy()
        shrunk = best + SIGMA * (self.points[1:] - best)
        for k, point in enumerate(shrunk, 1):
            value = f(point)  # may end the search: point and value are stored together
            self.points[k], self.values[k] = point, value
        self.sort()
        return True

    def _replace(self, point: np.ndarray, value: float) -> None:
        self.points[-1], self.values[-1] = point, value
        self.sort()

    def _range(self) -> np.ndarray:
        span = self.upper - self.lower
        return np.where(np.isfinite(span), span, 1.0)

    def _on_bound(self, point: np.ndarray) -> bool:
        near = _ON_BOUND * self._range()
        on = np.any((point <= self.lower + near) | (point >= self.upper - near))
        return bool(on or np.any(self.rows @ point >= self.most - _rounding(self.most)))

    def _reach(self, origin: np.ndarray, direction: np.ndarray) -> float:
        """How far the ray goes until it leaves the bounds, in units of the direction."""
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(direction > 0, self.upper - origin, self.lower - origin) / direction
            rise = self.rows @ direction
            left = np.maximum(self.most - self.rows @ origin, 0.0) / rise
        reach = np.min(room[direction != 0], initial=np.inf)
        return float(np.min(left[rise > 0], initial=reach))

    def _on_ray(self, origin: np.ndarray, direction: np.ndarray, reach: float) -> np.ndarray:
        """The point there; components within rounding of a bound are put on it."""
        point = origin + reach * direction
        near = _ON_BOUND * self._range()
        point = np.where(point <= self.lower + near, self.lower, point)
        return np.where(point >= self.upper - near, self.upper, point)


def _report(callback: Callable | None, simplex: _Simplex, budget: _Budget, nit: int) -> None:
    if callback is None:
        return
    x = simplex.points[0].copy()
    if "intermediate_result" in inspect.signature(callback).parameters:
        fun = float(simplex.values[0])
        callback(intermediate_result=OptimizeResult(x=x, fun=fun, nfev=budget.count, nit=nit))
    else:
        callback(x)


def _refuse(unused: dict[str, Any]) -> None:
    """`scipy.optimize.minimize` passes on arguments that mean nothing here."""
    for name, value in unused.items():
        if name not in ("jac", "hess", "hessp"):
            raise InputError(f"{name}: there is no such option")
        if value is not None and value is not False and (not isinstance(value, tuple | list) or len(value)):
            raise InputError(f"{name}: this method cannot use it")


def _bounds(
    bounds: Bounds | Sequence[tuple[float | None, float | None]] | None, n: int
) -> tuple[np.ndarray, np.ndarray]:
    if bounds is None:
        return np.full(n, -np.inf), np.full(n, np.inf)
    if isinstance(bounds, Bounds):
        lower, upper = np.broadcast_to(bounds.lb, n), np.broadcast_to(bounds.ub, n)
    else:
        pairs = list(bounds)
        if len(pairs) != n or not all(np.shape(pair) == (2,) for pair in pairs):
            raise InputError(f"bounds: expected {n} pairs (lower, upper), got {bounds!r}")
        lower = np.array([-np.inf if low is None else low for low, _ in pairs], dtype=float)
        upper = np.array([np.inf if high is None else high for _, high in pairs], dtype=float)
    for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
        if not low < high:
            raise InputError(f"bounds: parameter {k} has no room between {low!r} and {high!r}; leave it out")
    return np.array(lower, dtype=float), np.array(upper, dtype=float)


def _linear_limits(
    constraints: LinearConstraint | Sequence[LinearConstraint], n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m, n) of length 1 and what they are at most, (m,)."""
    several = constraints if isinstance(constraints, tuple | list) else [constraints]
    rows, most = [np.empty((0, n))], [np.empty(0)]
    for own in several:
        if not isinstance(own, LinearConstraint):
            raise InputError(f"constraints: only linear ones can be used, got {own!r}; use a penalty")
        A = finite_array("constraints: A", np.atleast_2d(own.A), (None, n))
        low, high = (np.broadcast_to(np.asarray(b, dtype=float), len(A)) for b in (own.lb, own.ub))
        if not (low < high).all():
            k = int(np.argmin(low < high))
            raise InputError(f"constraints: row {k} leaves no room between {low[k]:g} and {high[k]:g}")
        rows += [A[np.isfinite(high)], -A[np.isfinite(low)]]
        most += [high[np.isfinite(high)], -low[np.isfinite(low)]]
    A, b = np.vstack(rows), np.concatenate(most)
    sizes = np.linalg.norm(A, axis=1)
    if not sizes.all():
        raise InputError("constraints: A has a row of zeros")
    return A / sizes[:, None], b / sizes


def _rounding(most: np.ndarray) -> np.ndarray:
    return _ON_BOUND * np.maximum(1.0, np.abs(most))


def _within(point: np.ndarray, rows: np.ndarray, most: np.ndarray) -> bool:
    return bool(np.all(rows @ point <= most + _rounding(most)))


def _stepped(x0: np.ndarray, step: np.ndarray, keeps: Callable[[np.ndarray], bool]) -> np.ndarray:
    """x0 + step, or a point on the other side of x0, or one nearer to it, that keeps all limits."""
    for size in SIGMA ** np.arange(_HALVINGS):
        for sign in (1.0, -1.0):
            if keeps(point := x0 + sign * size * step):
                return point
    raise InputError("x0: linear constraints leave no room beside it")


def _start_simplex(
    x0: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    step: float | ArrayLike,
    simplex: ArrayLike | None,
) -> np.ndarray:
    n = len(x0)
    if simplex is not None:
        points = finite_array("initial_simplex", simplex, (n + 1, n))
        if np.linalg.matrix_rank(points[1:] - points[0]) < n:
            raise InputError("initial_simplex: its points lie in a plane, so that it has no volume")
    else:
        steps = finite_array("initial_step", np.broadcast_to(step, n) if np.ndim(step) == 0 else step, (n,))
        if not np.all(steps > 0):
            raise InputError(f"initial_step: must be > 0, got {step!r}")
        up = (upper - x0 >= steps) | (upper - x0 >= x0 - lower)
        moved = np.where(up, np.minimum(x0 + steps, upper), np.maximum(x0 - steps, lower))
        points = np.vstack([x0, np.where(np.eye(n, dtype=bool), moved, x0)])
        if len(limits[0]) and _within(x0, *limits):

            def keeps(point: np.ndarray) -> bool:
                return _within(point, *limits) and bool(np.all((point >= lower) & (point <= upper)))

            points[1:] = [_stepped(x0, point - x0, keeps) for point in points[1:]]
    outside = np.any((points < lower) | (points > upper), axis=0)
    if outside.any():
        k = int(np.argmax(outside))
        name = "x0" if simplex is None else "initial_simplex"
        raise InputError(f"{name}: parameter {k} is outside its bounds {lower[k]:g} to {upper[k]:g}")
    if not all(_within(point, *limits) for point in points):
        name = "x0" if simplex is None else "initial_simplex"
        raise InputError(f"{name}: breaks a linear constraint")
    return points
