"""What the velocity-ramp form costs: ramp plans against the free-form optimum of the same task.

The free-form problem has the same arm, base, power maps and limits as `ocptip plan`, but every joint may move
as it likes: six speeds that are piecewise quadratic in time on N equal intervals, continuous at their ends,
while the accelerations may jump there (as those of ramps do). Doubling N keeps every motion of the coarser
grid, so the energies fall from grid to grid (but for the tightening below) and bound the optimum from above.

In an interval of length h the speed is the Bernstein polynomial of v0, b, v1. Hence

    q1 = q0 + h (v0 + b + v1) / 3,      acceleration from 2 (b - v0) / h to 2 (v1 - b) / h, linear,

and bounds on v0, b, v1 bound the speed at all instants. Energy and limits are taken at Gauss-Lobatto nodes
(ends included, since torques jump there). GN: the moments about the tipping axes of three feet on a plane are
linear in the wrench. GT: tangential forces that balance the wrench within the friction circles, as
variables; exact where all feet stay loaded. Limits the motion does not come near (slip, torque, collision
pairs) are left out until the check on a dense grid finds them broken; GN and GT are tightened where they are
broken between nodes.

The power maps jump where a joint turns. First they are blended over speeds of +-eps with tanh(speed / eps),
eps falling (continuation); then every joint gets a fixed sign of speed in every interval, those of the
blended solution, and the exact maps hold throughout. A joint at rest may take the cheaper side of its map: it
creeps in that direction, by less than 0.01 degrees per second. Ramps can do so, too; the results also tell
the energy if such joints count as at rest, where the maps are read for positive direction. All energies are
those of the exact maps, integrated between the turning points.

    python studies/ramp_gap.py --out results [--plans plans] [--cases A B] [--grids 20 40 80] [--seed 0]

`--plans DIR`: ramp plans as DIR/A-effective/plan.json with `start` (degrees), `commands` and `energy_J`.
Finished pairs of case and base are kept; start again to go on.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Literal

import casadi as cs
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ocptip.contact import solve_many
from ocptip.errors import OcptipError
from ocptip.motion import ArmMotion, StandingRobot, experiment_robot, motion_case, motion_cases
from ocptip.motion.robot import BASES
from ocptip.robots import inverse_dynamics

LIMIT = 0.9  # of GN and GT
NODES = 0.5 + 0.5 * np.array([-1.0, -(5**-0.5), 5**-0.5, 1.0])  # Gauss-Lobatto, on [0, 1]
WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12
SMOOTHING = (0.2, 0.05, 0.0125)  # eps, rad/s
CREEP = (
    1e-4  # rad/s: least middle coefficient |b| where the sign is fixed, so that the sign is seen at "rest"
)
DENSE_STEP = 1e-3  # s
MARGIN = 1e-5  # of GN and GT at the nodes, for Ipopt's tolerance
ROUNDS = 6  # of solve, check, add what is broken


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """A motion with piecewise quadratic speeds on N equal intervals, n joints.

    Attributes:
        duration: s.
        angles, speeds: at the ends of the intervals, (N + 1, n), rad, rad/s.
        middles: middle Bernstein coefficients b of the speed, (N, n), rad/s.
    """

    duration: float
    angles: np.ndarray
    speeds: np.ndarray
    middles: np.ndarray

    @classmethod
    def through(cls, duration: float, angles: np.ndarray, speeds: np.ndarray) -> FreeMotion:
        """The motion with these angles and speeds at the ends of the intervals."""
        h = duration / (len(angles) - 1)
        middles = 3 / h * np.diff(angles, axis=0) - speeds[:-1] - speeds[1:]
        return cls(duration, angles, speeds, middles)

    @property
    def h(self) -> float:
        """Length of an interval, s."""
        return self.duration / len(self.middles)

    @property
    def signs(self) -> np.ndarray:
        """(N, n), in which direction each joint goes in each interval: +1 or -1."""
        return np.where(np.diff(self.angles, axis=0) < 0, -1.0, 1.0)

    def inside(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, speeds, accelerations at fractions x (K,) of all intervals: three arrays (N, K, n)."""
        v0, b, v1 = self.speeds[:-1, None], self.middles[:, None], self.speeds[1:, None]
        return curve(self.angles[:-1, None], v0, b, v1, self.h, np.asarray(x)[:, None])

    def refined(self) -> FreeMotion:
        """The same motion on twice as many intervals."""
        q, v, _ = self.inside(np.array([0.0, 0.5]))
        both = [np.concatenate([x.reshape(-1, x.shape[2]), end[-1:]]) for x, end in
                ((q, self.angles), (v, self.speeds))]  # fmt: skip
        return FreeMotion.through(self.duration, *both)

    def turning_points(self) -> np.ndarray:
        """Times at which a joint's speed passes zero inside an interval, (T,), s."""
        v0, b, v1 = self.speeds[:-1], self.middles, self.speeds[1:]
        found = []
        for k, j in np.argwhere(
            (np.minimum(np.minimum(v0, b), v1) < 0) & (np.maximum(np.maximum(v0, b), v1) > 0)
        ):
            roots = np.roots([v0[k, j] - 2 * b[k, j] + v1[k, j], 2 * (b[k, j] - v0[k, j]), v0[k, j]])
            roots = roots[np.isreal(roots)].real
            found += (self.h * (k + roots[(roots > 0) & (roots < 1)])).tolist()
        return np.array(found)

    def states(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, speeds, accelerations at times (T,), s, at jumps those after it: three arrays (T, n)."""
        k = np.clip((np.asarray(times) / self.h).astype(int), 0, len(self.middles) - 1)
        x = (times - k * self.h) / self.h
        return curve(self.angles[k], self.speeds[k], self.middles[k], self.speeds[k + 1], self.h, x[:, None])


def curve(q0, v0, b, v1, h, x):
    """Angle, speed, acceleration at fraction x of an interval; NumPy or CasADi."""
    q = q0 + h * x * (v0 + x * ((b - v0) + x * (v0 - 2 * b + v1) / 3))
    v = v0 + x * (2 * (b - v0) + x * (v0 - 2 * b + v1))
    a = 2 / h * ((b - v0) + x * (v0 - 2 * b + v1))
    return q, v, a


class FreeForm:
    """The free-form problem of a robot on N intervals, as CasADi and Ipopt see it.

    Args:
        robot: on three unilateral contacts in a plane.
        start, goal: (n,), rad.
        intervals: N.
        active: names of the limits to include besides GN, speed and acceleration: "slip", "torque", and
            labels of collision pairs.
        passive: joints (from 0) that must follow the ramp of a passive joint: a symmetric triangle of speed.
        iterations: at most, per solve.

    Raises:
        ValueError: the moments about the tipping axes are not linear in the wrench; N is odd with passive
            joints.
    """

    def __init__(
        self,
        robot: StandingRobot,
        start: np.ndarray,
        goal: np.ndarray,
        intervals: int,
        active: frozenset[str] = frozenset(),
        passive: tuple[int, ...] = (),
        iterations: int = 250,
    ) -> None:
        if passive and intervals % 2:
            raise ValueError(f"intervals: must be even with passive joints, got {intervals}")
        self.robot, self.start, self.goal, self.active = robot, start, goal, active
        self.passive = list(passive)
        self.intervals, self.n = intervals, robot.arm.n
        self.slip = "slip" in active
        n = self.n
        index = 1 + np.arange(n * (3 * intervals + 2)).reshape(-1, n)
        q, v, b = np.split(index, [intervals + 1, 2 * intervals + 2])
        free = index[-1, -1] + 1 + np.arange((12 if self.slip else 0) * intervals).reshape(intervals, -1)
        # of the unknowns (h, q, v, b, free forces): those of an interval, (local unknowns, N)
        self._place = np.hstack([np.zeros((intervals, 1), int), q[:-1], v[:-1], b, v[1:], q[1:], free]).T
        self._bounds = self._simple_bounds()
        self._solver = self._problem(*self._interval(), iterations)

    def _interval(self) -> tuple[cs.Function, cs.Function, cs.Function]:
        """Cost (in 100 J), equations (= 0; of passive joints: = their constants) and limits (<= 0).

        In: unknowns h; q0, v0, b, v1, q1 (n,); tangential forces' free parts (3 per node). Parameters: sign
        (n,), 0: blended; eps; the GN and GT limits. The second and third function give the nonzeros of the
        Jacobian and, with multipliers of cost, equations and limits, of the Lagrangian's Hessian.
        """
        robot, n = self.robot, self.n
        limits, support = robot.arm.limits, robot.support
        h, eps, GN, GT = (cs.SX.sym(name) for name in ("h", "eps", "GN", "GT"))
        q0, v0, b, v1, q1, sign = (cs.SX.sym(name, n) for name in ("q0", "v0", "b", "v1", "q1", "sign"))
        free = cs.SX.sym("free", 3 * len(NODES) if self.slip else 0)
        dynamics = inverse_dynamics(robot.arm)
        zero, about = np.zeros(3), support.center_of_mass
        A, b_moment = tipping_moments(robot)
        gaps = [str(label) in self.active for label in robot.collision.labels]
        cost, rows = 0, []
        for node, (x, weight) in enumerate(zip(NODES, WEIGHTS, strict=True)):
            q, v, a = curve(q0, v0, b, v1, h, x)
            torque, wrench = dynamics(q, v, a, support.gravity, zero, zero, about)
            wrench += support.weight
            side = sign + (1 - sign**2) * cs.tanh(v / eps)
            forward = robot.motors.power_expression(torque, v, np.ones(n))
            backward = robot.motors.power_expression(torque, v, -np.ones(n))
            cost += weight * h * cs.sum1((1 + side) / 2 * forward + (1 - side) / 2 * backward)
            needed = robot.tip_over.reference_moment * (1 / GN - 1)
            rows.append((needed - A @ wrench - b_moment) / robot.tip_over.reference_moment)
            if self.slip:
                rows.append(self._slip_rows(wrench, free[3 * node : 3 * node + 3], GT))
            if "torque" in self.active:
                rows += [torque / limits.torque - 1, -torque / limits.torque - 1]
            if any(gaps):
                near = robot.collision.function(q)[np.flatnonzero(gaps).tolist()]
                rows.append(-10 * near)
        for change in (b - v0, v1 - b):
            rate = 2 * change / (h * limits.acceleration)
            rows += [rate - 1, -rate - 1]
        y, p = cs.vertcat(h, q0, v0, b, v1, q1, free), cs.vertcat(sign, eps, GN, GT)
        equations = [q1 - q0 - h / 3 * (v0 + b + v1), h * v0[self.passive], h * b[self.passive]]
        outputs = [cost / 100, cs.vertcat(*equations), cs.vertcat(*rows)]
        multipliers = [cs.SX.sym("l", out.numel()) for out in outputs]
        lagrangian = sum(cs.dot(one, out) for one, out in zip(multipliers, outputs, strict=True))
        jacobian = cs.jacobian(cs.vertcat(*outputs[1:]), y)
        hessian = cs.hessian(lagrangian, y)[0]
        self._jacobian_entries = np.array(jacobian.sparsity().get_triplet())
        self._hessian_entries = np.array(hessian.sparsity().get_triplet())
        return (
            cs.Function("interval", [y, p], outputs),
            cs.Function("jacobian", [y, p], [cs.vertcat(*jacobian.nonzeros())]),
            cs.Function("hessian", [y, p, *multipliers], [cs.vertcat(*hessian.nonzeros())]),
        )

    def _slip_rows(self, wrench: cs.SX, free: cs.SX, GT: cs.SX) -> cs.SX:
        """|tangential force|^2 - (GT mu N)^2 of the contacts, relative to the mean friction limit squared."""
        support = self.robot.support
        matrix = support.wrench_matrix  # forces, contact by contact (normal, t1, t2), to the wrench they make
        tangential = np.delete(matrix, np.s_[::3], axis=1)
        if np.linalg.matrix_rank(tangential) != 3:
            raise ValueError("support: the contacts must lie in one plane")
        flat = np.linalg.svd(tangential)[2][3:].T  # forces in the plane that cancel each other
        forces = -cs.DM(np.linalg.pinv(matrix)) @ wrench
        N, f = forces[::3], cs.vertcat(*[forces[k] for k in range(9) if k % 3])
        f += cs.DM(flat) @ free
        mu = np.array([contact.friction for contact in support.contacts])
        used = cs.vertcat(*[f[2 * k] ** 2 + f[2 * k + 1] ** 2 for k in range(3)])
        scale = (float(np.mean(mu)) * self.robot.mass * 9.81 / 3) ** 2
        return (used - (GT * cs.DM(mu) * N) ** 2) / scale

    def _simple_bounds(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Lower and upper bounds of q, v (N + 1, n) and b (N, n)."""
        N, limits = self.intervals, self.robot.arm.limits
        bounds = {
            "q": (np.tile(limits.angle_min, (N + 1, 1)), np.tile(limits.angle_max, (N + 1, 1))),
            "v": (np.tile(-limits.speed, (N + 1, 1)), np.tile(limits.speed, (N + 1, 1))),
            "b": (np.tile(-limits.speed, (N, 1)), np.tile(limits.speed, (N, 1))),
        }
        for side, limit in enumerate((limits.angle_min, limits.angle_max)):
            bounds["v"][side][[0, -1]] = 0.0
            bounds["q"][side][[0, -1]] = self.start, self.goal
            bounds["q"][side][-1, self.passive] = limit[self.passive]  # their ramps end at the goal anyway
        return bounds

    def _problem(
        self, piece: cs.Function, jacobian: cs.Function, hessian: cs.Function, iterations: int
    ) -> cs.Function:
        """Ipopt on all intervals; derivatives are put together from those of the intervals.

        CasADi's own derivatives of the mapped function take two and a half times as long.
        """
        N, n, place = self.intervals, self.n, self._place
        equations, limits = (piece.size1_out(k) for k in (1, 2))
        self._equations, self._rows = equations * N, limits * N
        x, p = cs.MX.sym("x", int(place.max()) + 1), cs.MX.sym("p", n * N + 3)
        y = cs.reshape(x[place.ravel(order="F").tolist()], *place.shape)
        shared = cs.vertcat(cs.reshape(p[: n * N], n, N), cs.repmat(p[n * N :], 1, N))
        cost, equal, limit = piece.map(N)(y, shared)
        f, g = cs.sum2(cost), cs.veccat(equal, limit)

        row, column = self._jacobian_entries
        k = np.arange(N)
        rows = np.where(
            row[:, None] < equations,
            row[:, None] + k * equations,
            row[:, None] - equations + k * limits + self._equations,
        )
        J = scattered(jacobian.map(N)(y, shared), rows, place[column], (g.numel(), x.numel()))
        lam_f, lam_g = cs.MX.sym("lam_f"), cs.MX.sym("lam_g", g.numel())
        multipliers = [
            cs.repmat(lam_f, 1, N),
            cs.reshape(lam_g[: self._equations], equations, N),
            cs.reshape(lam_g[self._equations :], limits, N),
        ]
        row, column = self._hessian_entries
        values = hessian.map(N)(y, shared, *multipliers)
        H = scattered(values, place[row], place[column], (x.numel(), x.numel()), upper=True)
        options = {
            "print_time": False,
            "record_time": True,
            "jac_g": cs.Function("nlp_jac_g", [x, p], [g, J], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": cs.Function(
                "nlp_hess_l", [x, p, lam_f, lam_g], [H], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
            ),
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "max_iter": iterations,
                "tol": 1e-7,
                "acceptable_tol": 1e-5,
                "honor_original_bounds": "yes",
                "mu_strategy": "adaptive",
                "fixed_variable_treatment": "make_parameter",
            },
        }
        return cs.nlpsol("free_form", "ipopt", {"x": x, "p": p, "f": f, "g": g}, options)

    def _equation_bounds(self, kind: Literal["lower", "upper"]) -> np.ndarray:
        """Right sides of the equations, (equations of all intervals,)."""
        N, rest = self.intervals, np.inf if kind == "upper" else -np.inf
        ramp = with_triangles(minimum_jerk(self.start, self.goal, 1.0, N), self.passive)
        starts = ramp.h * ramp.speeds[:-1, self.passive]
        starts[0] = rest  # at rest in any case
        return np.hstack([np.zeros((N, self.n)), starts, ramp.h * ramp.middles[:, self.passive]]).ravel()

    def solve(
        self,
        guess: FreeMotion,
        *,
        eps: float | None = None,
        signs: np.ndarray | None = None,
        GN: float = LIMIT,
        GT: float = LIMIT,
    ) -> tuple[FreeMotion, dict]:
        """The optimum near a guess, and Ipopt's status, iterations and seconds.

        Args:
            guess: on N intervals.
            eps: rad/s, for blended power maps.
            signs: (N, n), +1 or -1: the speeds' signs, for exact maps. One of the two must be given.
            GN, GT: limits.
        """
        N, n = self.intervals, self.n
        low, high = ({key: bound[side].copy() for key, bound in self._bounds.items()} for side in (0, 1))
        if signs is None:
            signs = np.zeros((N, n))
        for key, rows in (("v", slice(0, -1)), ("v", slice(1, None)), ("b", slice(None))):
            creep = CREEP if key == "b" else 0.0
            low[key][rows] = np.where(signs > 0, np.maximum(low[key][rows], creep), low[key][rows])
            high[key][rows] = np.where(signs < 0, np.minimum(high[key][rows], -creep), high[key][rows])
        for bound in (low, high):
            bound["b"][:, self.passive] = self._bounds["b"][int(bound is high)][:, self.passive]
        forces = np.zeros(self._solver.size1_in("x0") - 1 - n * (3 * N + 2))
        infinite = np.full(len(forces), np.inf)

        def pack(h: float, q: np.ndarray, v: np.ndarray, b: np.ndarray, rest: np.ndarray) -> np.ndarray:
            return np.concatenate([[h], q.ravel(), v.ravel(), b.ravel(), rest])

        found = self._solver(
            x0=pack(guess.h, guess.angles, guess.speeds, guess.middles, forces),
            lbx=pack(0.1 / N, low["q"], low["v"], low["b"], -infinite),
            ubx=pack(60.0 / N, high["q"], high["v"], high["b"], infinite),
            lbg=np.r_[self._equation_bounds("lower"), np.full(self._rows, -np.inf)],
            ubg=np.r_[self._equation_bounds("upper"), np.zeros(self._rows)],
            p=np.r_[signs.ravel(), eps or 1.0, GN, GT],
        )
        x = np.asarray(found["x"]).ravel()
        q, v, b = np.split(x[1 : 1 + n * (3 * N + 2)].reshape(-1, n), [N + 1, 2 * N + 2])
        stats = self._solver.stats()
        report = {
            "status": stats["return_status"],
            "iterations": stats["iter_count"],
            "seconds": stats["t_wall_total"],
            "success": bool(stats["success"]),
        }
        return FreeMotion(float(x[0]) * N, q, v, b), report


def scattered(
    values: cs.MX, rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int], *, upper: bool = False
) -> cs.MX:
    """A sparse matrix: values (m, N) added up at rows, columns (m, N); if asked, its upper triangle only."""
    rows, columns = rows.ravel(order="F"), columns.ravel(order="F")
    kept = np.flatnonzero(rows <= columns) if upper else np.arange(len(rows))
    keys, entry = np.unique(columns[kept] * shape[0] + rows[kept], return_inverse=True)
    ones = cs.DM.ones(len(kept))
    collect = cs.DM.triplet(entry.tolist(), kept.tolist(), ones, len(keys), len(rows))
    columns, rows = np.divmod(keys, shape[0])
    sparsity = cs.Sparsity.triplet(*shape, rows.tolist(), columns.tolist())
    return cs.MX(sparsity, collect @ cs.vec(values))


def tipping_moments(robot: StandingRobot) -> tuple[np.ndarray, np.ndarray]:
    """A (axes, 6) and b (axes,) of the moments about the tipping axes M = A wrench + b; 20 wrenches checked.

    Raises:
        ValueError: the moments are not linear.
    """
    support = robot.support
    if [contact.kind for contact in support.contacts] != ["unilateral"] * 3:
        raise ValueError("support: three unilateral contacts are needed")
    weight = support.weight * robot.mass / support.mass
    rng = np.random.default_rng(0)
    size = abs(weight[2]) * np.r_[0.02 * np.ones(3), 0.02 * support.length * np.ones(3)]
    states = solve_many(support, weight + np.vstack([np.zeros(6), rng.uniform(-1, 1, (20, 6)) * size]))
    tip = robot.tip_over.evaluate(states)
    A = tip.moment_gradients[0]
    b = tip.moments[0] - A @ states.wrenches[0]
    error = np.abs(states.wrenches @ A.T + b - tip.moments).max()
    if not (states.persistent.all() and error < 1e-9 * robot.tip_over.reference_moment):
        raise ValueError(f"tipping moments are not linear in the wrench (error {error:.1e} N m)")
    return A, b


def exact_energy(robot: StandingRobot, motion: FreeMotion, resting: float = 0.0) -> float:
    """Electric energy, J: exact power maps, eight Gauss nodes between interval ends and turning points.

    Args:
        robot: with the power maps.
        motion: of its arm.
        resting: rad/s; a slower joint counts as at rest, where the maps are read for positive direction.
    """
    ends = motion.h * np.arange(len(motion.middles) + 1)
    edges = np.unique(np.concatenate([ends, motion.turning_points()]))
    x, w = np.polynomial.legendre.leggauss(8)
    half, middle = np.diff(edges) / 2, (edges[1:] + edges[:-1]) / 2
    times = (middle[:, None] + half[:, None] * x).ravel()
    _, v, _ = states = motion.states(times)
    torques, _ = robot.loads(*states)
    direction = np.where(v < -resting, -1.0, 1.0)
    return float((half[:, None] * w).ravel() @ robot.motors.power(torques, v, direction).sum(axis=1))


@dataclass(frozen=True)
class Worst:
    """Worst values of a motion on a dense grid, both ends of every interval included.

    Attributes:
        GN, GT: reserves.
        moment: smallest moment about a tipping axis, as share of M0; negative: it tips.
        torque, speed, acceleration: as shares of their limits.
        clearance: m.
        touched: labels of collision pairs that meet.
        standing: all contact states are solved and persist.
    """

    GN: float
    GT: float
    moment: float
    torque: float
    speed: float
    acceleration: float
    clearance: float
    touched: tuple[str, ...]
    standing: bool

    @property
    def kept(self) -> bool:
        """All limits hold, to 1e-6."""
        ratios = max(self.GN / LIMIT, self.GT / LIMIT, self.torque, self.speed, self.acceleration)
        return self.standing and ratios <= 1 + 1e-6 and self.clearance >= -1e-6


def dense_check(robot: StandingRobot, motion: FreeMotion, step: float = DENSE_STEP) -> Worst:
    """Evaluate a motion every `step` seconds with the library's own functions."""
    x = np.linspace(0, 1, max(2, int(np.ceil(motion.h / step)) + 1))
    q, v, a = (values.reshape(-1, robot.arm.n) for values in motion.inside(x))
    torques, wrenches = robot.loads(q, v, a)
    states = solve_many(robot.support, wrenches)
    slip = robot.slip.evaluate(states, derivatives=False)
    gaps = robot.collision.gaps(q)
    limits = robot.arm.limits
    A, b = tipping_moments(robot)
    touched = [str(robot.collision.labels[k]) for k in np.flatnonzero((gaps < 0).any(axis=0))]
    return Worst(
        GN=float(np.nan_to_num(robot.tip_over.evaluate(states).GN, nan=np.inf).max()),
        GT=float(np.nan_to_num(slip.GT, nan=np.inf).max()),
        moment=float(np.min(wrenches @ A.T + b) / robot.tip_over.reference_moment),
        torque=float(np.max(np.abs(torques) / limits.torque)),
        speed=float(np.max(np.abs(v) / limits.speed)),
        acceleration=float(np.max(np.abs(a) / limits.acceleration)),
        clearance=float(gaps.min(initial=np.inf)),
        touched=tuple(touched),
        standing=bool(np.all(states.persistent & states.solved & slip.solved)),
    )


def minimum_jerk(start: np.ndarray, goal: np.ndarray, duration: float, intervals: int) -> FreeMotion:
    """The fifth-order polynomial from rest to rest."""
    return via_motion(start, goal, np.zeros_like(start), duration, intervals)


def via_motion(
    start: np.ndarray, goal: np.ndarray, detour: np.ndarray, duration: float, intervals: int
) -> FreeMotion:
    """Minimum jerk plus a detour (n,), rad, that is largest halfway."""
    s = np.linspace(0, 1, intervals + 1)[:, None]
    q = start + (goal - start) * s**3 * (10 - 15 * s + 6 * s**2) + detour * 64 * (s * (1 - s)) ** 3
    v = (goal - start) * 30 * (s * (1 - s)) ** 2 + detour * 192 * (s * (1 - s)) ** 2 * (1 - 2 * s)
    return FreeMotion.through(duration, q, v / duration)


def sampled(motion: ArmMotion, intervals: int) -> FreeMotion:
    """A ramp motion at the ends of equal intervals."""
    q, v, _ = motion.states(np.linspace(0, motion.end, intervals + 1))
    v[[0, -1]] = 0.0
    return FreeMotion.through(motion.end, q, v)


def with_triangles(motion: FreeMotion, joints: Sequence[int]) -> FreeMotion:
    """The motion with these joints on symmetric triangles of speed, the passive ramp (5.17); N even."""
    if not joints:
        return motion
    ramps = [(motion.angles[0, j], motion.angles[-1, j], motion.duration) for j in joints]
    s = np.linspace(0, 1, len(motion.angles))
    q, v = motion.angles.copy(), motion.speeds.copy()
    for j, (first, last, duration) in zip(joints, ramps, strict=True):
        way = np.where(s < 0.5, 2 * s**2, 1 - 2 * (1 - s) ** 2)
        q[:, j] = first + (last - first) * way
        v[:, j] = (last - first) / duration * 4 * np.minimum(s, 1 - s)
    return FreeMotion.through(motion.duration, q, v)


def cheaper_signs(robot: StandingRobot, motion: FreeMotion) -> np.ndarray:
    """Signs of speed (N, n): those of the motion, and where a joint nearly rests the one that costs less."""
    q, v, a = motion.inside(NODES)
    shape, n = q.shape, robot.arm.n
    torque, _ = robot.loads(*(x.reshape(-1, n) for x in (q, v, a)))
    rest, ones = np.zeros_like(torque), np.ones_like(torque)
    costs = [
        np.einsum("k,ikj->ij", WEIGHTS, robot.motors.power(torque, rest, side * ones).reshape(shape))
        for side in (1.0, -1.0)
    ]
    rests = np.abs(np.diff(motion.angles, axis=0)) < SMOOTHING[-1] * motion.h
    return np.where(rests, np.where(costs[0] <= costs[1], 1.0, -1.0), motion.signs)


class Search:
    """Free-form motions of one case on one base, from several starts and on finer and finer grids.

    Args:
        robot: arm, base, limits.
        start, goal: (n,), rad.
        passive: joints on passive ramps.
        iterations: of Ipopt, at most, per solve.
        active: limits to include from the beginning, see `FreeForm`; grows as limits turn out to be broken.
    """

    def __init__(
        self,
        robot: StandingRobot,
        start: np.ndarray,
        goal: np.ndarray,
        *,
        passive: tuple[int, ...] = (),
        iterations: int = 250,
        active: frozenset[str] = frozenset(),
    ) -> None:
        self.robot, self.start, self.goal, self.passive = robot, start, goal, passive
        self.iterations, self.active = iterations, active
        self._problems: dict[tuple[int, frozenset[str]], FreeForm] = {}

    def problem(self, intervals: int) -> FreeForm:
        """The problem on a grid with the limits found active so far."""
        key = intervals, self.active
        if key not in self._problems:
            self._problems[key] = FreeForm(
                self.robot, self.start, self.goal, intervals, self.active, self.passive, self.iterations
            )
        return self._problems[key]

    def from_guess(self, guess: FreeMotion) -> Found | None:
        """Continuation in eps, then signs fixed; None without success."""
        motion = with_triangles(guess, self.passive)
        for eps in SMOOTHING:
            motion, _ = self.problem(len(motion.middles)).solve(motion, eps=eps)
        return self._exact(motion)

    def refine(self, found: Found) -> Found | None:
        """The optimum on twice as many intervals: the better of the old signs and of newly blended ones."""
        finer = found.motion.refined()
        kept = self._exact(finer, np.repeat(found.signs, 2, axis=0))
        blended, _ = self.problem(len(finer.middles)).solve(finer, eps=SMOOTHING[-1])
        both = [candidate for candidate in (kept, self._exact(blended)) if candidate]
        return min(both, key=lambda candidate: candidate.energy, default=None)

    def _exact(self, guess: FreeMotion, signs: np.ndarray | None = None) -> Found | None:
        """Solve with fixed signs until the dense check is passed and signs at rest are the cheaper ones."""
        best, GN, GT = None, LIMIT - MARGIN, LIMIT - MARGIN
        signs = cheaper_signs(self.robot, guess) if signs is None else signs
        motion = guess
        for _ in range(ROUNDS):
            problem = self.problem(len(guess.middles))
            motion, report = problem.solve(motion, signs=signs, GN=GN, GT=GT)
            if not report["success"]:
                break
            worst = dense_check(self.robot, motion)
            if not worst.kept:
                self.active |= broken(worst)
                if worst.GN > LIMIT:
                    GN = 1 / (1 / GN + 1.2 * (1 / LIMIT - 1 - worst.moment) + 1e-3)
                if problem.slip:
                    GT -= 1.2 * max(0.0, worst.GT - LIMIT + MARGIN)
                continue
            energy = exact_energy(self.robot, motion)
            if best is None or energy < best.energy - 1e-3:
                best = Found(motion, signs, energy, worst)
            better = cheaper_signs(self.robot, motion)
            if np.array_equal(better, signs):
                break
            signs = better
        return best


@dataclass(frozen=True, eq=False)
class Found:
    """A verified motion, the signs of its speeds (N, n), its exact energy (J) and worst values."""

    motion: FreeMotion
    signs: np.ndarray
    energy: float
    worst: Worst


def broken(worst: Worst) -> frozenset[str]:
    """Names of limits to include because a motion breaks them."""
    names = {"slip": worst.GT > LIMIT, "torque": worst.torque > 1}
    return frozenset(name for name, is_broken in names.items() if is_broken) | frozenset(worst.touched)


@dataclass(frozen=True)
class Options:
    """What a result depends on, besides versions and the ramp plan.

    Attributes:
        grids: numbers of intervals, each twice the one before.
        randoms: number of random detours among the starts.
        seed: of these.
        iterations: of Ipopt, at most, per solve.
        wrists: whether the problem with passive joints 4 to 6 is solved, too.
    """

    grids: tuple[int, ...] = (20, 40, 80)
    randoms: int = 3
    seed: int = 0
    iterations: int = 250
    wrists: bool = True


def starts_of(
    reference: ArmMotion, plan: ArmMotion | None, goal: np.ndarray, options: Options
) -> dict[str, FreeMotion]:
    """Guesses on the coarsest grid by name."""
    N, start, T = options.grids[0], reference.start, reference.end
    rng = np.random.default_rng(options.seed)
    guesses = {} if plan is None else {"ramp plan": sampled(plan, N)}
    guesses["reference"] = sampled(reference, N)
    for factor in (0.8, 1.5):
        guesses[f"minimum jerk {factor:g} T"] = minimum_jerk(start, goal, factor * T, N)
    for number in range(1, options.randoms + 1):
        detour = rng.uniform(-0.6, 0.6, len(start))
        guesses[f"random {number}"] = via_motion(start, goal, detour, rng.uniform(0.7, 2.0) * T, N)
    return guesses


def climb(
    search: Search, guesses: dict[str, FreeMotion], options: Options, say: Callable[[str], None]
) -> tuple[list[dict], Found | None, Found | None]:
    """Solve from all guesses, and go on with the better half on each finer grid.

    Returns:
        One record per start and grid, the best motion, the best on the coarsest grid.
    """
    records: list[dict] = []
    going: dict[str, Found | None] = dict.fromkeys(guesses)
    best, coarse = None, None
    for N in options.grids:
        results: dict[str, Found] = {}
        for name, before in going.items():
            begin = time.process_time()
            found = search.from_guess(guesses[name]) if before is None else search.refine(before)
            record = {"start": name, "intervals": N, "cpu_s": time.process_time() - begin}
            record["energy_J"] = found.energy if found else None
            record["duration_s"] = found.motion.duration if found else None
            records.append(record)
            say(f"grid {N}, {name}: " + (f"{found.energy:.2f} J" if found else "no solution"))
            if found:
                results[name] = found
        ranking = sorted(results, key=lambda name: results[name].energy)
        if ranking and (best is None or results[ranking[0]].energy < best.energy):
            best = results[ranking[0]]
        coarse = coarse or best
        going = {name: results[name] for name in ranking[: max(1, len(guesses) // 2)]}
        guesses = {name: guesses[name] for name in going}
    return records, best, coarse


def run_pair(
    case_name: str, base: str, plan: ArmMotion | None, options: Options, say: Callable[[str], None]
) -> dict:
    """Everything found for one case on one base, as plain data."""
    case = motion_case(case_name)
    robot = experiment_robot(case, base)
    limits = robot.arm.limits
    reference = case.reference_motion(limits.speed, limits.acceleration)
    guesses = starts_of(reference, plan, case.goal, options)
    begin = time.process_time()
    result = {
        "case": case_name,
        "base": base,
        "reference_J": robot.energy(reference),
        "ramp_plan_J": None if plan is None else robot.energy(plan),
        "ramp_plan_s": None if plan is None else plan.end,
        "reference_s": reference.end,
    }
    active: frozenset[str] = frozenset()
    for kind, passive in (("passive_wrists", (3, 4, 5)), ("free", ())):
        if passive and not options.wrists:
            result[kind] = None
            continue
        search = Search(
            robot, case.start, case.goal, passive=passive, iterations=options.iterations, active=active
        )
        records, best, coarse = climb(
            search, guesses, options, lambda text, kind=kind: say(f"{kind}, {text}")
        )
        active = search.active
        if (
            passive
            and best
            and np.max(np.abs(best.motion.speeds[:, passive]) / limits.speed[[passive]]) > 0.999
        ):
            best = coarse = None  # their ramp would not be a triangle
        if coarse:
            guesses = {"passive wrists": coarse.motion, **guesses}
        result[kind] = {
            "energy_J": best.energy if best else None,
            "energy_resting_J": exact_energy(robot, best.motion, 2 * CREEP) if best else None,
            "duration_s": best.motion.duration if best else None,
            "worst": dict(vars(best.worst)) if best else None,
            "limits_included": sorted(search.active),
            "records": records,
            "motion": motion_dict(best.motion) if best else None,
        }
    result["cpu_s"] = time.process_time() - begin
    return result


def motion_dict(motion: FreeMotion) -> dict:
    """A motion as plain data, degrees."""
    columns = {"angles_deg": motion.angles, "speeds_deg_s": motion.speeds, "middles_deg_s": motion.middles}
    return {"duration_s": motion.duration, **{k: np.rad2deg(x).tolist() for k, x in columns.items()}}


def motion_from(data: dict) -> FreeMotion:
    """The inverse of `motion_dict`."""
    columns = (np.deg2rad(data[key]) for key in ("angles_deg", "speeds_deg_s", "middles_deg_s"))
    return FreeMotion(data["duration_s"], *columns)


def read_plan(folder: Path | None, case: str, base: str) -> ArmMotion | None:
    """The ramp plan of a case on a base; None if there is no such file.

    Raises:
        ValueError: it leads elsewhere, or its energy is not that of this model.
    """
    path = folder / f"{case}-{base}" / "plan.json" if folder else None
    if path is None or not path.exists():
        return None
    data = json.loads(path.read_text())
    motion, task = ArmMotion.from_dict(data), motion_case(case)
    if not (
        np.allclose(motion.start, task.start, atol=1e-4) and np.allclose(motion.goal, task.goal, atol=1e-4)
    ):
        raise ValueError(f"{path}: does not lead from start to goal of case {case}")
    energy = experiment_robot(task, base).energy(motion)
    if abs(energy - data["energy_J"]) > 1e-3 * energy:
        raise ValueError(f"{path}: energy_J is {data['energy_J']}, but the commands take {energy:.3f} J")
    return motion


def price(result: dict) -> float | None:
    """How much more the ramp plan takes than the free-form motion, as a share."""
    free, ramps = result["free"]["energy_J"], result["ramp_plan_J"]
    return ramps / free - 1 if free and ramps else None


def markdown(results: list[dict], options: Options) -> str:
    """Energies, convergence and worst values as Markdown tables."""

    def number(value: float | None, digits: int = 2) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    def percent(value: float | None) -> str:
        return "-" if value is None else f"{100 * value:.2f} %"

    lines = [
        "| case | base | reference [J] | ramp plan [J] | passive wrists [J] | free form [J] | resting [J] | "
        "price of the ramp form | reference [s] | ramp plan [s] | free form [s] |",
        "| --- | --- " + "| ---: " * 9 + "|",
    ]
    for r in results:
        wrists = r["passive_wrists"] or {"energy_J": None}
        columns = [
            r["case"], r["base"], number(r["reference_J"]), number(r["ramp_plan_J"]),
            number(wrists["energy_J"]), number(r["free"]["energy_J"]),
            number(r["free"]["energy_resting_J"]), percent(price(r)),
            number(r["reference_s"], 3), number(r["ramp_plan_s"], 3), number(r["free"]["duration_s"], 3),
        ]  # fmt: skip
        lines.append(f"| {' | '.join(columns)} |")
    heads = [f"best, {N} intervals [J]" for N in options.grids]
    heads += [f"starts at {options.grids[0]}", "solved", "spread", "GN", "GT", "torque", "speed", "CPU [s]"]
    lines += ["", f"| case | base | {' | '.join(heads)} |", "| --- | --- " + "| ---: " * len(heads) + "|"]
    for r in results:
        records = r["free"]["records"]
        by_grid = [
            [x["energy_J"] for x in records if x["intervals"] == N and x["energy_J"]] for N in options.grids
        ]
        first, worst = by_grid[0], r["free"]["worst"]
        spread = percent(max(first) / min(first) - 1) if first else "-"
        columns = [r["case"], r["base"], *(number(min(e, default=None), 3) for e in by_grid)]
        columns += [str(sum(x["intervals"] == options.grids[0] for x in records)), str(len(first)), spread]
        columns += [number(worst[key] if worst else None, 3) for key in ("GN", "GT", "torque", "speed")]
        lines.append(f"| {' | '.join([*columns, number(r['cpu_s'], 0)])} |")
    return "\n".join([*lines, "", NOTES, ""])


NOTES = """\
- *free form*: six free joints with piecewise quadratic speeds, checked every millisecond; an upper bound of
  the true optimum, as good as the convergence over the grids shows.
- *passive wrists*: the same, but joints 4 to 6 on the passive joints' ramp; the difference to *free form* is
  what the passive joints cost, the difference to *ramp plan* what the ramps of joints 1 to 3 cost.
- *resting*: the free-form motion if joints that creep at less than 0.01 degrees per second count as at rest,
  where the power maps are read for positive direction; creeping chooses the cheaper side.
- *price*: ramp plan / free form - 1. *spread*: worst / best start on the coarsest grid - 1.
- GN, GT: worst values of the best motion, limit 0.9; torque, speed: shares of their limits."""


def draw(case_name: str, results: list[dict], plans: dict[str, ArmMotion | None], path: Path) -> None:
    """Angles, speeds, power and reserves of the free-form motion and of the ramps; one column per base."""
    case = motion_case(case_name)
    figure = Figure(figsize=(6.4 * len(results), 11), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, len(results), squeeze=False, sharex=True, sharey="row")
    for r, column in zip(results, axes.T, strict=True):
        robot = experiment_robot(case, r["base"])
        limits = robot.arm.limits
        plan = plans[r["base"]]
        name = "reference motion" if plan is None else "ramp plan"
        ramps = plan or case.reference_motion(limits.speed, limits.acceleration)
        histories = [(name, "--", 1.1, r["ramp_plan_J"] or r["reference_J"], _ramp_history(robot, ramps))]
        if r["free"]["motion"]:
            history = _free_history(robot, motion_from(r["free"]["motion"]))
            histories.append(("free form", "-", 1.8, r["free"]["energy_J"], history))
        for name, style, width, energy, (times, q, v, power, GN, GT) in histories:
            for j in range(robot.arm.n):
                look = {"color": f"C{j}", "ls": style, "lw": width}
                column[0].plot(times, np.rad2deg(q[:, j] - case.start[j]), **look)
                column[1].plot(times, np.rad2deg(v[:, j]), **look)
            column[2].plot(times, power, "k", ls=style, lw=width, label=f"{name}: {energy:.1f} J")
            for values, color, label in ((GN, "C3", "GN"), (GT, "C0", "GT")):
                column[3].plot(times, values, color=color, ls=style, lw=width, label=f"{label}, {name}")
        column[3].axhline(LIMIT, color="#888888", lw=0.9)
        place = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points", "xytext": (-3, 2)}
        column[3].annotate("limit", (1, LIMIT), ha="right", va="bottom", color="#666666", fontsize=8, **place)
        column[0].set_title(f"case {case_name}, {r['base']} base")
        column[3].set_xlabel("time [s]")
        column[2].legend(fontsize=8, loc="upper right")
        column[3].legend(fontsize=8, ncols=2, loc="upper left")
    joints = [Line2D([], [], color=f"C{j}", lw=1.8, label=f"joint {j + 1}") for j in range(6)]
    joints += [Line2D([], [], color="k", ls="-", lw=1.8, label="free form"),
               Line2D([], [], color="k", ls="--", lw=1.1, label="ramps")]  # fmt: skip
    axes[0, 0].legend(handles=joints, fontsize=8, ncols=2, loc="upper left")
    names = ("angle from start [deg]", "speed [deg/s]", "electric power [W]", "reserve values")
    for row, name in zip(axes, names, strict=True):
        row[0].set_ylabel(name)
        for axis in row:
            axis.grid(color="#e4e4e4", lw=0.6)
            axis.set_axisbelow(True)
            axis.tick_params(labelbottom=True)
    axes[2, 0].set_ylim(top=1.2 * axes[2, 0].get_ylim()[1])  # room for the legends
    axes[3, 0].set_ylim(0, 1.3)
    figure.savefig(path, dpi=110)


def _free_history(robot: StandingRobot, motion: FreeMotion) -> tuple[np.ndarray, ...]:
    x = np.linspace(1e-3, 1 - 1e-3, 11)  # at the ends of intervals a joint may rest between two creeps
    q, v, a = (values.reshape(-1, robot.arm.n) for values in motion.inside(x))
    times = (motion.h * (np.arange(len(motion.middles))[:, None] + x)).ravel()
    torques, wrenches = robot.loads(q, v, a)
    states = solve_many(robot.support, wrenches)
    power = robot.motors.power(torques, v).sum(axis=1)
    GT = robot.slip.evaluate(states, derivatives=False).GT
    return times, q, v, power, robot.tip_over.evaluate(states).GN, GT


def _ramp_history(robot: StandingRobot, motion: ArmMotion) -> tuple[np.ndarray, ...]:
    margin = 1e-6 * np.diff(motion.intervals, axis=1)  # both sides of every jump, not the jump itself
    times = np.linspace(*motion.intervals.T, 41)[1:-1].ravel()
    times = np.sort(np.concatenate([times, (motion.intervals + margin * [1, -1]).ravel()]))
    s = robot.samples(motion, times)
    return times, s.angles, s.speeds, s.powers.sum(axis=1), s.tip.GN, s.slip.GT


def write_whole(path: Path, text: str) -> None:
    """Write a file so that an interruption leaves either the old or the new one."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text)
    temporary.replace(path)


def run(out: Path, cases: Sequence[str], plans: Path | None, options: Options) -> str:
    """Solve what is not there yet, write all files, return the Markdown text."""
    folder = out / "ramp_gap_pairs"
    folder.mkdir(parents=True, exist_ok=True)
    results, motions = [], {}
    for case in cases:
        for base in BASES:
            plan = motions[case, base] = read_plan(plans, case, base)
            key = {**asdict(options), "grids": list(options.grids), "plan": plan.to_dict() if plan else None}
            path = folder / f"{case}-{base}.json"
            saved = json.loads(path.read_text()) if path.exists() else {}
            if saved.get("options") != key:
                saved = {
                    "options": key,
                    **run_pair(case, base, plan, options, progress(f"{case}, {base} base")),
                }
                write_whole(path, json.dumps(saved))
            results.append(saved)
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr)
    head = {
        "versions": {
            "python": platform.python_version(),
            "numpy": np.__version__,
            "casadi": cs.__version__,
            "ocptip": version("ocptip"),
        },
        "machine": {"architecture": platform.machine(), "cores": os.cpu_count()},
        "options": asdict(options),
        "smoothing_rad_s": SMOOTHING,
        "dense_step_s": DENSE_STEP,
        "pairs": [without_motions(r) for r in results],
    }
    text = markdown(results, options)
    write_whole(out / "ramp_gap.json", json.dumps(head, indent=1))
    write_whole(out / "ramp_gap.md", text)
    for case in cases:
        mine = [r for r in results if r["case"] == case]
        draw(case, mine, {base: motions[case, base] for base in BASES}, out / f"ramp_gap_{case}.png")
    return text


def without_motions(result: dict) -> dict:
    """A result without options and motions, which stay in the pair's file; with the price."""
    short = {key: value for key, value in result.items() if key != "options"}
    for kind in ("free", "passive_wrists"):
        if short[kind]:
            short[kind] = {key: value for key, value in short[kind].items() if key != "motion"}
    return {**short, "price": price(result)}


def progress(what: str) -> Callable[[str], None]:
    """One line on a terminal, nothing elsewhere."""

    def say(text: str) -> None:
        if sys.stderr.isatty():
            print(f"\r\033[K{what}: {text}", end="", file=sys.stderr, flush=True)

    return say


def main(argv: Sequence[str] | None = None) -> int:
    unclamped = [name for name, case in motion_cases().items() if not case.clamped]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results, table and figures")
    parser.add_argument("--plans", type=Path, help="folder with ramp plans, e.g. A-effective/plan.json")
    parser.add_argument("--cases", nargs="+", choices=unclamped, default=["A", "B"])
    parser.add_argument("--grids", type=int, nargs="+", default=list(Options.grids), help="20 40 80 ...")
    parser.add_argument("--randoms", type=int, default=Options.randoms, help="random starts")
    parser.add_argument("--seed", type=int, default=Options.seed)
    parser.add_argument("--iterations", type=int, default=Options.iterations, help="of Ipopt, per solve")
    parser.add_argument("--no-wrists", action="store_true", help="leave out the problem with passive wrists")
    given = parser.parse_args(argv)
    grids = given.grids
    if grids[0] < 2 or grids[0] % 2 or any(2 * a != b for a, b in pairwise(grids)):
        parser.error(f"--grids must be even numbers, each twice the one before, got {grids}")
    if given.randoms < 0 or given.iterations < 1:
        parser.error("--randoms must be at least 0 and --iterations at least 1")
    if given.plans and not given.plans.is_dir():
        parser.error(f"--plans: there is no folder {given.plans}")
    options = Options(tuple(grids), given.randoms, given.seed, given.iterations, not given.no_wrists)
    try:
        print(run(given.out, given.cases, given.plans, options), end="")
    except (ValueError, OcptipError) as error:
        print(f"ramp_gap: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nInterrupted; finished pairs are kept, start again to go on.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
