"""The cheapest timing for drives of any power: a local solution, by Ipopt, from a given timing."""

from __future__ import annotations

import casadi as cs
import numpy as np

from ocptip.numerics.ipopt import nlpsol
from ocptip.retiming.cheapest import Price
from ocptip.retiming.fastest import Grid, Polygons
from ocptip.retiming.late import Couplings
from ocptip.robots.motors import Motors

_OPTIONS = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-7, "max_iter": 200, "mu_init": 1e-3},
}


class PoweredTiming:
    """Cost of timings of a grid, in the quadrature of the cone program.

    Args:
        grid: nodes and rows.
        motors: of the robot, at its joints.
        price: of energy and time.
    """

    def __init__(self, grid: Grid, motors: Motors, price: Price) -> None:
        self._grid, self._motors, self._price = grid, motors, price
        left, right, w = grid.left, grid.right, grid.widths
        of_u, of_x, rest = grid.places.loads[0]
        turn = 0.5 * (of_u[left] + of_u[right]) / (2 * w)[:, None]
        self._on_p, self._on_q = 0.5 * of_x[left] - turn, 0.5 * of_x[right] + turn
        self._rest, self._dq = (
            0.5 * (rest[left] + rest[right]),
            0.5 * (grid.places.dq[left] + grid.places.dq[right]),
        )

    def cost(self, x: np.ndarray) -> float:
        """Cost of a timing, x (N + 1,) in 1/s^2."""
        z = 0.5 * (np.sqrt(x[1:]) + np.sqrt(x[:-1]))
        torque = self._on_p * x[:-1, None] + self._on_q * x[1:, None] + self._rest
        power = self._motors.power(torque, self._dq * z[:, None], np.where(self._dq < 0, -1.0, 1.0))
        price = self._price
        return float(np.sum(self._grid.widths / z * (price.energy * power.sum(axis=1) + price.time)))

    def local(self, polygons: Polygons, start: np.ndarray, couplings: Couplings) -> np.ndarray | None:
        """x (N + 1,) of a timing that is locally cheapest; None where Ipopt finds none.

        Args:
            polygons: of the rows.
            start: (N + 1,), 1/s^2.
            couplings: rows of several nodes.
        """
        unit = float(np.sqrt(np.mean(start)))
        z = cs.SX.sym("z", len(start))
        x, cost, price = (unit * z) ** 2, 0, self._price
        pace = 0.5 * unit * (z[1:] + z[:-1])
        signs = np.where(self._dq < 0, -1.0, 1.0)
        for i, width in enumerate(self._grid.widths):
            torque = cs.DM(self._on_p[i]) * x[i] + cs.DM(self._on_q[i]) * x[i + 1] + cs.DM(self._rest[i])
            power = self._motors.power_expression(torque, cs.DM(self._dq[i]) * pace[i], cs.DM(signs[i]))
            cost += width / pace[i] * (price.energy * cs.sum1(power) + price.time)
        i, rows = polygons.all_rows()
        a, b, c = rows.T
        size = np.maximum(np.maximum(np.abs(a), np.abs(b)) * unit**2, np.abs(c))
        own = np.flatnonzero(size > 0)
        i, a, b, c, size = i[own], a[own], b[own], c[own], size[own]
        rows = cs.DM(a / size) * x[i.tolist()] + cs.DM(b / size) * x[(i + 1).tolist()]
        top = c / size
        if len(couplings):
            rows = cs.vertcat(rows, cs.DM(couplings.A) @ x)
            top = np.append(top, couplings.b)
        if np.isfinite(price.longest):
            rows, top = (
                cs.vertcat(rows, cs.sum1(cs.DM(self._grid.widths) / pace)),
                np.append(top, price.longest),
            )
        solver = nlpsol({"x": z, "f": cost, "g": rows}, _OPTIONS)
        least, most = np.sqrt(self._grid.bounds.T) / unit
        guess = np.clip(np.sqrt(start) / unit, least, most)
        found = solver(x0=guess, lbx=least, ubx=np.minimum(most, 1e6), lbg=-np.inf, ubg=top)
        if not solver.stats()["success"]:
            return None
        return np.clip((unit * np.array(found["x"])[:, 0]) ** 2, *self._grid.bounds.T)
