"""A limit of the jerk, as a second stage: a timing below a given one with continuous accelerations.

Between nodes the third derivative of s over t is constant. Unknown are ds/dt and d2s/dt2 at the nodes and the
times between them; Ipopt minimises the duration subject to all rows, and to the jerk of every joint, q'''
s'^3 + 3 q'' s' s'' + q' s''', at both ends of every interval. The limit of the jerk is not convex, so that
the solution is a local one.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, SolverError
from ocptip.basics.interrupts import interrupts_after
from ocptip.numerics.ipopt import ending, nlpsol
from ocptip.retiming.fastest import Grid
from ocptip.retiming.kernels import MOST, clipped
from ocptip.trajectories.path import derivatives
from ocptip.trajectories.trajectory import Trajectory

_OPTIONS = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 400, "mu_init": 1e-2},
}
_BEGIN = 0.7  # of the given speed, from which the solver starts
_SHORTEST, _LONGEST = 0.2, 100.0  # of that begin: durations of intervals
_FAR = 1e3  # times the given d2s/dt2: there are no greater ones
_BEYOND = 1e-7  # excess of tangents, in units of the limits, that is none
_ROUNDS = 8  # of tangents


def steady(grid: Grid, before: Trajectory, jerk: np.ndarray) -> Trajectory:
    """A timing on the nodes of another one, nowhere faster, within limits of the jerk at the nodes.

    Args:
        grid: nodes and rows.
        before: the timing on them.
        jerk: (n,), rad/s^3 or m/s^3; infinite: not limited.

    Raises:
        InputError: the path's curvature has a step where it does not stop: says where.
        SolverError: Ipopt ends without one.
    """
    program = _Program(grid, before, jerk)
    rows = program.rows_at_nodes()
    start = program.start()
    for _ in range(_ROUNDS):
        start = program.solve(rows, start)
        if not (more := program.tangents(start)).size:
            break
        rows = np.hstack([rows, more])
    motion = program.motion(start)
    return motion.time_scaled(max(1.0, before.end / motion.end))


class _Program:
    """Unknown are v = ds/dt and a = d2s/dt2 at N + 1 nodes and h, N durations, in units of `before.end`.

    Rows (4, R) are node, alpha, beta, gamma: alpha u + beta x <= gamma.
    """

    def __init__(self, grid: Grid, before: Trajectory, jerk: np.ndarray) -> None:
        assert before.timing is not None
        self.grid, self.jerk, self.unit, self.before = grid, jerk, before.end, before.timing
        self.count = len(grid.widths)
        self.most = np.sqrt(before.timing.x)
        self.still = grid.bounds[:, 1] == 0
        self.nodes = np.zeros(len(grid.places), dtype=int)  # of the places
        self.nodes[grid.left], self.nodes[grid.right] = np.arange(self.count), np.arange(1, self.count + 1)
        if grid.path.bends.size:
            step, end = grid.path.breakpoints[[grid.path.bends[0], -1]]
            raise InputError(
                f"jerk: the path's curvature has a step at s = {step:.4f} of {end:.4f}, "
                "and so would accelerations. Retime points or samples of the motion instead "
                "(trajectory.json, motion.csv): --path-tolerance 0.1 smooths them; or leave out the limit"
            )

    def start(self) -> np.ndarray:
        """Slower than the given timing everywhere, with d2s/dt2 as means of neighbours."""
        fixed = self.grid.bounds[:, 0] == self.grid.bounds[:, 1]
        v = np.where(fixed, self.most, _BEGIN * self.most) * self.unit
        h = 2 * self.grid.widths / (v[1:] + v[:-1])
        rate = np.diff(v) / h
        a = np.where(self.still, 0.0, 0.5 * (np.append(rate, rate[-1]) + np.append(rate[0], rate)))
        return np.concatenate([v, a, h])

    def solve(self, rows: np.ndarray, start: np.ndarray) -> np.ndarray:
        """The unknowns, from a start."""
        v, a, h = (cs.SX.sym(name, self.count + (name != "h")) for name in "vah")
        width, unit = cs.DM(self.grid.widths), self.unit
        node = rows[0].astype(int).tolist()
        alpha, beta, gamma = rows[1] / unit**2, rows[2] / unit**2, rows[3]
        size = np.maximum(np.maximum(np.abs(alpha), np.abs(beta)), np.abs(gamma))
        even = [
            v[1:] - v[:-1] - 0.5 * h * (a[:-1] + a[1:]),
            (v[:-1] * h + h**2 * (2 * a[:-1] + a[1:]) / 6) / width - 1,
        ]
        less = [cs.DM(alpha / size) * a[node] + cs.DM(beta / size) * v[node] ** 2 - cs.DM(gamma / size)]
        for share in self._jerks(v, a, h):
            less += [share - 1, -share - 1]
        g = cs.vertcat(*even, *less)
        low = np.where(np.arange(g.numel()) < 2 * self.count, 0.0, -np.inf)
        with interrupts_after([]):
            solver = nlpsol({"x": cs.vertcat(v, a, h), "f": cs.sum1(h), "g": g}, _OPTIONS)
            result = solver(x0=start, lbg=low, ubg=0.0, **self._bounds())
        if not solver.stats()["success"]:
            why = ending(solver.stats()["return_status"])
            raise SolverError(f"jerk: no timing within all limits ({why}); more jerk may help")
        return np.array(result["x"])[:, 0]

    def _bounds(self) -> dict[str, np.ndarray]:
        fixed, most = self.grid.bounds[:, 0] == self.grid.bounds[:, 1], self.most * self.unit
        rate = np.where(self.still, 0.0, np.inf)
        h = self.start()[2 * self.count + 2 :]
        least = np.concatenate([np.where(fixed, most, 0.0), -rate, _SHORTEST * h])
        return {"lbx": least, "ubx": np.concatenate([most, rate, _LONGEST * h])}

    def _jerks(self, v: cs.SX, a: cs.SX, h: cs.SX) -> Iterator[cs.SX]:
        """Shares of the limits, (N,) each, of every joint at begins and ends of the intervals."""
        grid, path, third = self.grid, self.grid.path, (a[1:] - a[:-1]) / h
        middles = 0.5 * (grid.s[1:] + grid.s[:-1])
        piece = np.searchsorted(path.breakpoints, middles) - 1
        for places, begin in ((grid.left, 0), (grid.right, 1)):
            block = slice(begin, begin + self.count)
            beyond = (grid.s[block] - path.breakpoints[piece])[:, None]
            dddq = derivatives(path.coefficients[:, piece], beyond, 3)
            for joint in np.flatnonzero(np.isfinite(self.jerk)):
                d1, d2 = grid.places.dq[places, joint], grid.places.ddq[places, joint]
                scale = 1 / (self.jerk[joint] * self.unit**3)
                yield (
                    cs.DM(scale * dddq[:, joint]) * v[block] ** 3
                    + cs.DM(3 * scale * d2) * v[block] * a[block]
                    + cs.DM(scale * d1) * third
                )

    def rows_at_nodes(self) -> np.ndarray:
        """Rows that matter below the given timing."""
        planes, far = self.grid.planes, _FAR * float(np.max(np.abs(self.before.u)))
        other, other_names, results = np.empty((MOST, 2)), np.empty(MOST, dtype=np.int64), [np.empty((4, 0))]
        for place, node in enumerate(self.nodes):
            top = self.most[node] ** 2
            polygon, names, n = np.zeros((MOST, 2)), np.full(MOST, -1, dtype=np.int64), 4
            polygon[:4] = [[-far, 0.0], [far, 0.0], [far, top], [-far, top]]
            form = np.stack([planes.alpha[place], planes.beta[place], planes.gamma[place]])
            for k, (alpha, beta, gamma) in enumerate(form.T):
                n = clipped(polygon, names, n, alpha, beta, gamma, k, other, other_names)
            kept = form[:, np.setdiff1d(names[:n], [-1])]
            if not self.still[node]:
                results.append(np.vstack([np.full(kept.shape[1], node), kept]))
        return np.hstack(results)

    def tangents(self, unknown: np.ndarray) -> np.ndarray:
        """Rows of limits of which there are only tangents, where they are broken."""
        v, a = np.split(unknown[: 2 * self.count + 2], 2)
        u, x = (a / self.unit**2)[self.nodes], ((v / self.unit) ** 2)[self.nodes]
        if not self.grid.limits.curved:
            return np.empty((4, 0))
        result = self.grid.limits.tangents(self.grid.places, u, x)
        places = result.places
        bad = result.alpha * u[places] + result.beta * x[places] - result.gamma > _BEYOND
        bad &= ~self.still[self.nodes[places]]
        return np.stack([self.nodes[places], result.alpha, result.beta, result.gamma])[:, bad]

    def motion(self, unknown: np.ndarray) -> Trajectory:
        """The timing: cubics in t with the speeds and the times of the solution."""
        v = np.where(self.still, 0.0, np.maximum(unknown[: self.count + 1], 0.0)) / self.unit
        times = np.append(0.0, np.cumsum(unknown[2 * self.count + 2 :])) * self.unit
        return Trajectory.from_path(self.grid.path, self.grid.s, v**2, times)
