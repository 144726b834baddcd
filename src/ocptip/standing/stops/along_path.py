"""Stops along the path (category 1 and 2): a mechanism brakes on its path until it rests.

Along the path q(s), s = t as planned, a stop is another time law s(t): with x = s'^2 (1: the planned speed)
and u = s'' the accelerations are q' u + q'' x; torques and the wrench on the base are affine in (u, x). The
largest deceleration that the drives allow, u_min(x), is at every place the maximum of the lower bounds of u
that the limits of torques and accelerations give: convex and piecewise linear in x. Stops begun at all
instants before pass a place with all x from 0 to 1 (with a limit `time`: from some x on near the start). So
what all stops do there is the curve u_min(x), 0 <= x <= 1, and between its corners tipping moments and the
friction needed are worst at an end. Gentler stops lie in the convex hull of this curve, the motion itself (u
= 0, x = 1) and rest (u = 0, x = 0), where every stop ends: where all these stand, so do they.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number, share_of_one
from ocptip.numerics.batch import BatchFunction
from ocptip.standing.footing import Footing
from ocptip.standing.instants import Loaded, wrench_expression
from ocptip.standing.mechanism import StandingMechanism

_NO_PULL = 1e-9  # share of the largest coefficient of u below which a bound says nothing about u


@dataclass(frozen=True)
class PathStops:
    """The limits of stops along the path.

    Attributes:
        GN, GT: maximum during any stop, at most 1.
        time: s, that the time law takes at least from the planned speed to rest; 0: as little as the drives
            can.
    """

    GN: float = 0.9
    GT: float = 0.9
    time: float = 0.0

    def __post_init__(self) -> None:
        for name in ("GN", "GT"):
            share_of_one(f"stops.{name}", getattr(self, name))
        positive_number("stops.time", self.time, zero_allowed=True)


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds alpha u + beta x + gamma <= 1 at N states, (N, L) each.

    In the order: accelerations of the coordinates, positive and negative, torques likewise, the time law.
    """

    alpha: np.ndarray
    beta: np.ndarray
    gamma: np.ndarray

    @cached_property
    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower bounds u >= c + d x, (N, L) each; c is -inf where a bound gives none."""
        # A bound whose coefficient of u is rounding says nothing about u: division by it would invent a
        # limit.
        least = -_NO_PULL * np.max(np.abs(self.alpha), axis=1, keepdims=True, initial=0.0)
        lower = self.alpha < np.minimum(least, -1e-300)
        alpha = np.where(lower, self.alpha, -1.0)
        c = np.where(lower, (1 - self.gamma) / alpha, -np.inf)
        return c, np.where(lower, -self.beta / alpha, 0.0)


@dataclass(frozen=True, eq=False)
class Path:
    """Loads of N states of a path, affine in (u, x): of u, of x, and at rest.

    Attributes:
        torques: three (N, n), N m.
        wrenches: three (N, 6), N and N m, on the base or an object.
        bounds: of u and x.
        footing: what the wrenches act on.
    """

    torques: tuple[np.ndarray, np.ndarray, np.ndarray]
    wrenches: tuple[np.ndarray, np.ndarray, np.ndarray]
    bounds: Bounds
    footing: Footing

    @classmethod
    def of(
        cls,
        robot: StandingMechanism,
        states: tuple[np.ndarray, np.ndarray, np.ndarray],
        torque_ratio: float,
        time: float,
        process: np.ndarray | None = None,
        interface: int = 0,
    ) -> Path:
        """Loads at angles, speeds and accelerations, (N, n) each.

        Args:
            robot: whose.
            states: of the motion as planned.
            torque_ratio: share of the torque limits that may be used.
            time: see `PathStops`.
            process: (N, 6) there, of one that varies: in stops as it is as planned, place by place.
            interface: of the robot's `interfaces`, on which the wrenches are; 0: the base.

        Raises:
            InputError: nothing bounds the deceleration.
        """
        q, qd, qdd = states
        limits, still, count = robot.limits, np.zeros_like(q), len(q)
        known = np.isfinite(limits.acceleration).all() or np.isfinite(limits.torque).all()
        if not known and time == 0:
            raise InputError(
                "stops: some drive has neither a limit of torque nor of acceleration, so that nothing bounds "
                "the deceleration; give [stops] time, in s"
            )
        torques, *wrenches = affine_loads(robot, q, qd, qdd, process)
        by_acceleration, by_torque = 1 / limits.acceleration, 1 / (torque_ratio * limits.torque)
        rates = [part * by_acceleration for part in (qd, qdd, still)]
        efforts = [part * by_torque for part in torques]
        law = -time, 0.0, 0.0
        columns = [
            np.hstack([rate, -rate, effort, -effort, np.full((count, 1), value)])
            for rate, effort, value in zip(rates, efforts, law, strict=True)
        ]
        return cls(torques, wrenches[interface], Bounds(*columns), robot.interfaces[interface])


Affine = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Coefficients of u, of x, and of 1."""


def affine_loads(
    robot: StandingMechanism,
    q: np.ndarray,
    dq: np.ndarray,
    ddq: np.ndarray,
    process: np.ndarray | None = None,
    rate: np.ndarray | None = None,
) -> tuple[Affine, ...]:
    """Torques (N, n) and wrenches (N, 6) on each interface as affine functions of u = s'' and x = s'^2.

    Args:
        robot: whose.
        q, dq, ddq: (N, n), a path and its first two derivatives over s.
        process: (N, k) there, of what acts, see `StandingMechanism.acting`; or (3, N, k): where it is affine
            in u and x itself, at u = 1, at x = 1, and at rest.
        rate: (N,) > 0: on a base that turns, Coriolis forces grow with s', which is no affine function of
            x; they are those of its tangent at this s'. None: the base does not turn.
    """
    states, acting = _states(q, dq, ddq, rate), None
    if process is not None:  # the same in each of the states, or another in each
        rows = process if process.ndim == 2 else np.concatenate(process)
        acting = np.tile(rows, (len(states[0]) // max(len(rows), 1), 1))
    objects = robot.object_wrenches(*states, robot.acts.split(acting)[1])
    return tuple(_affine(values, rate) for values in (*robot.loads(*states, acting), *objects))


def _states(
    q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, rate: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States (3 N, n) that give affine functions: with q'' alone, with speed and path curvature, at rest.

    With a path speed (4 N, n): also with the speed backward.
    """
    still = np.zeros_like(q)
    rates = [(still, dq), (dq, ddq), (still, still), *[(-dq, ddq)] * (rate is not None)]
    qd, qdd = (np.vstack(rates_of) for rates_of in zip(*rates, strict=True))
    return np.vstack([q] * len(rates)), qd, qdd


def _affine(values: np.ndarray, rate: np.ndarray | None) -> Affine:
    """Coefficients of u and x, and the rest, from the values in such states."""
    of_u, of_x, rest, *back = np.split(values, 3 if rate is None else 4)
    of_u, of_x = of_u - rest, of_x - rest
    if rate is None:
        return of_u, of_x, rest
    backward, rate = back[0] - rest, rate[:, None]
    of_rate = 0.5 * (of_x - backward)
    return of_u, 0.5 * (of_x + backward) + of_rate / (2 * rate), rest + 0.5 * rate * of_rate


@dataclass(frozen=True, eq=False)
class StopPoints(Loaded):
    """Corners of the curves u_min(x) at N states, and rest after a stop: P moments of stops, the worst there.

    Attributes:
        footing: the base or an object on its contacts.
        starts: (N,) number of the first point of each state.
        owner: (P,) the state.
        x, u: (P,): square of the share of the planned speed; second derivative of the time law, 1/s.
        first: (P,) number of the bound that holds there; -1: none, u = 0; so at rest, with x = 0.
        second: (P,) number of the other one, at a corner inside; -1 and -2 at the ends, x = 0 and x = 1.
        wrenches: (P, 6), N and N m.
    """

    footing: Footing
    starts: np.ndarray
    owner: np.ndarray
    x: np.ndarray
    u: np.ndarray
    first: np.ndarray
    second: np.ndarray
    wrenches: np.ndarray

    @classmethod
    def of(cls, path: Path) -> StopPoints:
        """Points of all states of a path."""
        c, d = path.bounds.lines
        state = np.arange(len(c))
        x, line, end = np.zeros(len(c)), _steepest(c, d, state), np.full(len(c), -1)
        results = [(state, x, end, end), (state, x, line, end)]
        while len(state):
            slope, value = d[state, line], c[state, line]
            with np.errstate(divide="ignore", invalid="ignore"):
                cross = (value[:, None] - c[state]) / (d[state] - slope[:, None])
            cross = np.where(np.isfinite(c[state]) & (d[state] > slope[:, None]), cross, np.inf)
            cross = np.maximum(cross, x[:, None])
            following = np.argmin(cross, axis=1)
            nearest = cross[np.arange(len(state)), following]
            inside = nearest < 1
            last = ~inside
            if last.any():
                results.append((state[last], np.ones(last.sum()), line[last], np.full(last.sum(), -2)))
            state, x = state[inside], nearest[inside]
            first, line = line[inside], following[inside]
            if len(state):
                results.append((state, x, line, first))
        owner, x, first, second = (np.concatenate(parts) for parts in zip(*results, strict=True))
        order = np.lexsort((x, owner))
        owner, x, first, second = owner[order], x[order], first[order], second[order]
        u = c[owner, first] + d[owner, first] * x
        free = (first < 0) | ~(u < 0) | ~np.isfinite(u)  # rest; nothing moves; limits are broken already
        u, first = np.where(free, 0.0, u), np.where(free, -1, first)
        of_u, of_x, rest = path.wrenches
        wrenches = rest[owner] + x[:, None] * of_x[owner] + u[:, None] * of_u[owner]
        starts = np.searchsorted(owner, np.arange(len(c)))
        return cls(path.footing, starts, owner, x, u, first, second, wrenches)

    def select(self, some: np.ndarray) -> StopPoints:
        """Some points; they no longer know their states' first points."""
        parts = (getattr(self, name)[some] for name in ("owner", "x", "u", "first", "second", "wrenches"))
        return StopPoints(self.footing, np.empty(0, dtype=int), *parts)

    def worst(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Maximum of values (P, ...) at each state, (N, ...), and the number of its point."""
        greatest = np.maximum.reduceat(values, self.starts, axis=0)
        number = np.arange(len(values)).reshape(-1, *[1] * (values.ndim - 1))
        number = np.where(values == greatest[self.owner], number, len(values) - 1)
        return greatest, np.minimum.reduceat(number, self.starts, axis=0)


def _steepest(c: np.ndarray, d: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Number of the bound that is the maximum at x = 0, and just after."""
    greatest = np.max(c, axis=1, keepdims=True)
    return np.argmax(np.where(c == greatest, d, -np.inf), axis=1)[state]


@lru_cache(maxsize=8)
def stop_slopes(robot: StandingMechanism, time: float, interface: int = 0) -> StopSlopes:
    """Those of a robot; their functions take a second to build."""
    return StopSlopes(robot, time, interface)


class StopSlopes:
    """Derivatives of functions of the wrench at stop points over the state s = (q, qd, qdd).

    Args:
        robot: whose.
        time, interface: as for `Path.of`.
    """

    def __init__(self, robot: StandingMechanism, time: float, interface: int = 0) -> None:
        n, limits = robot.n, robot.limits
        size = 3 * n + robot.acts.size
        s, on_wrench, ratio = cs.SX.sym("s", size), cs.SX.sym("on_wrench", 6), cs.SX.sym("ratio")
        q, qd, qdd, *process = cs.vertsplit(s, sorted({0, n, 2 * n, 3 * n, size}))
        still = cs.SX.zeros(n)
        states = (still, qd), (qd, qdd), (still, still)
        *moving, rest = (robot.load_expressions(q, *rates, *process)[0] for rates in states)
        rates, efforts = [qd, qdd, still], [*(torque - rest for torque in moving), rest]
        by_acceleration, by_torque = cs.DM(1 / limits.acceleration), cs.DM(1 / limits.torque) / ratio
        columns = []
        for rate, effort, law in zip(rates, efforts, (-time, 0.0, 0.0), strict=True):
            by_speed = rate * by_acceleration, effort * by_torque
            columns.append(cs.vertcat(by_speed[0], -by_speed[0], by_speed[1], -by_speed[1], law))
        self._count = columns[0].numel()
        one, other = cs.SX.sym("one", self._count), cs.SX.sym("other", self._count)
        fixed = cs.SX.sym("fixed", 4)  # u = 0 ?, right-hand side; x given ?, right-hand side
        (a, b, e), (f, g, h) = ([cs.dot(which, column) for column in columns] for which in (one, other))
        a, g, e, h = a + fixed[0], g + fixed[2], fixed[1] - e, fixed[3] - h
        determinant = a * g - b * f
        u, x = (e * g - b * h) / determinant, (a * h - e * f) / determinant
        of_u, of_x, rest = (wrench_expression(robot, interface, q, *rates, *process) for rates in states)
        wrench = rest + (of_x - rest) * x + (of_u - rest) * u
        hessian, gradient = cs.hessian(cs.dot(on_wrench, wrench), s)
        arguments = [s, ratio, one, other, fixed, on_wrench]
        self._gradient = BatchFunction(cs.Function("stop_slopes", arguments, [gradient]))
        self._hessian = BatchFunction(cs.Function("stop_bends", arguments, [hessian]))

    def gradient(self, s: np.ndarray, ratio: float, points: StopPoints, on_wrench: np.ndarray) -> np.ndarray:
        """Slopes (P, 3 n) of on_wrench . wrench.

        Args:
            s: (P, 3 n), states of the points' owners.
            ratio: share of the torque limits that may be used.
            points: P of them.
            on_wrench: (P, 6).
        """
        return self._gradient(s, np.array([ratio]), *self._chosen(points), on_wrench)[0]

    def hessian(self, s: np.ndarray, ratio: float, points: StopPoints, on_wrench: np.ndarray) -> np.ndarray:
        """Curvature (P, 3 n, 3 n) of the same."""
        return self._hessian(s, np.array([ratio]), *self._chosen(points), on_wrench)[0]

    def _chosen(self, points: StopPoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        numbers, free = np.arange(self._count), points.first < 0
        one = (points.first[:, None] == numbers).astype(float)
        other = ((points.second[:, None] == numbers) & ~free[:, None]).astype(float)
        given = (points.second < 0) | free
        return one, other, np.column_stack([free, ~free, given, np.where(given, points.x, 1.0)])
