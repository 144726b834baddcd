"""The free-form problem as CasADi and Ipopt see it: least energy under the limits of `ocptip plan`.

Energy and limits are taken at Gauss-Lobatto nodes (ends included, since torques jump there). GN: the moments
about the tipping axes of three feet on a plane are linear in the wrench. GT: tangential forces that balance
the wrench within the friction circles, as variables; exact where all feet stay loaded.
"""

from __future__ import annotations

from typing import Literal

import casadi as cs
import numpy as np

from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.reserves.force_sets import ForceSets
from ocptip.robots.dynamics import inverse_dynamics
from ocptip.standing.arm import Robot
from studies.ramp_gap.free_motion import FreeMotion, curve, minimum_jerk, with_triangles

LIMIT = 0.9  # of GN and GT
NODES = 0.5 + 0.5 * np.array([-1.0, -(5**-0.5), 5**-0.5, 1.0])  # Gauss-Lobatto, on [0, 1]
WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12
CREEP = (
    1e-4  # rad/s: least middle coefficient |b| where the sign is fixed, so that the sign is seen at "rest"
)


class FreeForm:
    """The free-form problem of a robot on N intervals, as CasADi and Ipopt see it.

    Args:
        robot: on three contacts in a plane.
        start, goal: (n,), rad.
        intervals: N.
        active: names of the limits to include besides GN, speed and acceleration: "slip", "torque", and
            labels of collision pairs.
        passive: joints (from 0) that must follow the ramp of a passive joint: a symmetric triangle of speed.
        iterations: at most, per solve.
        even: accelerations are constant within each interval: ramps of equal length.

    Raises:
        ValueError: the moments about the tipping axes are not linear in the wrench; N is odd with passive
            joints.
    """

    def __init__(
        self,
        robot: Robot,
        start: np.ndarray,
        goal: np.ndarray,
        intervals: int,
        active: frozenset[str] = frozenset(),
        passive: tuple[int, ...] = (),
        iterations: int = 250,
        even: bool = False,
    ) -> None:
        if passive and intervals % 2:
            raise ValueError(f"intervals: must be even with passive joints, got {intervals}")
        self.robot, self.start, self.goal, self.active = robot, start, goal, active
        self.passive, self.even = list(passive), list(range(robot.arm.n)) if even else []
        self.intervals, self.n = intervals, robot.arm.n
        self.slips = self._slips()
        n = self.n
        index = 1 + np.arange(n * (3 * intervals + 2)).reshape(-1, n)
        q, v, b = np.split(index, [intervals + 1, 2 * intervals + 2])
        free = index[-1, -1] + 1 + np.arange(3 * len(NODES) * self.slips * intervals).reshape(intervals, -1)
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
        free = cs.SX.sym("free", 3 * self.slips, len(NODES))
        dynamics = inverse_dynamics(robot.arm)
        zero, about = np.zeros(3), support.center_of_mass
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
            state = cs.vertcat(q, v, a)
            rows.append(self._tipping_rows(state, wrench, GN))
            rows += [
                self._slip_rows(own, free[3 * k : 3 * k + 3, node], GT)
                for k, own in enumerate(self._slip_wrenches(state, wrench))
            ]
            if "torque" in self.active:
                rows += [torque / limits.torque - 1, -torque / limits.torque - 1]
            if any(gaps):
                near = robot.collision.function(q)[np.flatnonzero(gaps).tolist()]
                rows.append(-10 * near)
        for change in (b - v0, v1 - b):
            rate = 2 * change / (h * limits.acceleration)
            rows += [rate - 1, -rate - 1]
        y, p = cs.vertcat(h, q0, v0, b, v1, q1, cs.vec(free)), cs.vertcat(sign, eps, GN, GT)
        equations = [q1 - q0 - h / 3 * (v0 + b + v1), h * v0[self.passive], h * b[self.passive]]
        equations.append((b - (v0 + v1) / 2)[self.even])
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

    def _tipping_rows(self, state: cs.SX, wrench: cs.SX, GN: cs.SX) -> cs.SX:
        """What moments about the tipping axes lack, in M0; state: angles, speeds, accelerations (3 n,)."""
        A, b = tipping_moments(self.robot)
        M0 = self.robot.tip_over.reference_moment
        return (M0 * (1 / GN - 1) - A @ wrench - b) / M0

    def _slips(self) -> int:
        """In how many wrenches at a node slip counts."""
        return int("slip" in self.active)

    def _slip_wrenches(self, state: cs.SX, wrench: cs.SX) -> list[cs.SX]:
        """Those wrenches (6,)."""
        return [wrench] * self.slips

    def _slip_support(self) -> Support:
        """Whose tangential limits count."""
        return self.robot.support

    def _slip_rows(self, wrench: cs.SX, free: cs.SX, GT: cs.SX) -> cs.SX:
        """|tangential force|^2 - (GT limit)^2 of the contacts, over the square of the mean friction limit."""
        support = self._slip_support()
        matrix = support.wrench_matrix  # forces, contact by contact (normal, t1, t2), to the wrench they make
        tangential = np.delete(matrix, np.s_[::3], axis=1)
        if np.linalg.matrix_rank(tangential) != 3:
            raise ValueError("support: the contacts must lie in one plane")
        flat = np.linalg.svd(tangential)[2][3:].T  # forces in the plane that cancel each other
        forces = -cs.DM(np.linalg.pinv(matrix)) @ wrench
        N, f = forces[::3], cs.vertcat(*[forces[k] for k in range(9) if k % 3])
        f += cs.DM(flat) @ free
        limits = ForceSets(support).limits(np.zeros((1, 3)), np.ones(1))
        mu, constant = limits.slope[0], limits.radius[0]
        used = cs.vertcat(*[f[2 * k] ** 2 + f[2 * k + 1] ** 2 for k in range(3)])
        scale = (float(np.mean(mu)) * self.robot.mass * 9.81 / 3) ** 2
        return (used - (GT * (cs.DM(mu) * N + cs.DM(constant))) ** 2) / scale

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
        moved = [np.zeros((N, self.n)), starts, ramp.h * ramp.middles[:, self.passive]]
        return np.hstack([*moved, np.zeros((N, len(self.even)))]).ravel()

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


def tipping_moments(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
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
