"""The cheapest timing of a path for drives with quadratic losses: a second-order cone program.

Between nodes the time is w / z with the width w and the mean z of ds/dt at both ends; motor torques are taken
in the middle. The losses m^2 w / z are jointly convex in (x, z), and z^2 <= x is what a program can have of z
= sqrt(x). It is met with equality wherever going faster saves more time and copper than viscous friction
costs; where it is not, the optimum of the program is a lower bound, and tangents of sqrt(x) lead to a timing
from above (Verscheure et al. 2009; Lipp and Boyd 2016 for the second).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import clarabel
import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, SolverError
from ocptip.basics.interrupts import interrupts_after
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones
from ocptip.numerics.ipopt import nlpsol
from ocptip.retiming.drives import QuadraticDrives
from ocptip.retiming.fastest import Grid, Polygons
from ocptip.retiming.late import Couplings
from ocptip.robots.motors import Motors

GAP = 1e-6
"""Relative gap between a timing's cost and its lower bound that counts as none."""

_TOLERANCES = 1e-8, 1e-6  # the second where the first cannot be had
_ROUNDS = 12


@dataclass(frozen=True)
class Price:
    """The cost of a timing: energy * (J) + time * (s).

    Attributes:
        energy: of 1 J.
        time: of 1 s.
        longest: s, that it may take; infinite: as long as it likes.
    """

    energy: float
    time: float
    longest: float = np.inf


@dataclass(frozen=True, eq=False)
class CheapestTiming:
    """A timing with a bound.

    Attributes:
        x: (N + 1,), 1/s^2, at the nodes.
        cost: of it, in the program's quadrature.
        lower_bound: of the cost of every timing, in the same quadrature.
    """

    x: np.ndarray
    cost: float
    lower_bound: float

    @property
    def gap(self) -> float:
        """Relative."""
        return max(self.cost - self.lower_bound, 0.0) / abs(self.cost)


class CheapestProgram:
    """The program of a grid; unknown are x and z at the nodes, in units of a typical timing, and costs.

    Args:
        grid: nodes and rows.
        drives: of the robot.
        price: of energy and time.
        typical: (N + 1,), x of some timing, for units.
        couplings: rows of several nodes.
    """

    def __init__(
        self, grid: Grid, drives: QuadraticDrives, price: Price, typical: np.ndarray, couplings: Couplings
    ) -> None:
        self.grid, self.drives, self.price, self.couplings = grid, drives, price, couplings
        self.unit = float(np.mean(typical))
        pace = np.sqrt(self.unit)
        left, right, w = grid.left, grid.right, grid.widths
        torque, dq = grid.places.loads[0], 0.5 * (grid.places.dq[left] + grid.places.dq[right])
        of_u, of_x, rest = torque
        turn = 0.5 * (of_u[left] + of_u[right]) / (2 * w)[:, None]
        self.on_p = (0.5 * of_x[left] - turn) * self.unit
        self.on_q = (0.5 * of_x[right] + turn) * self.unit
        self.constant = 0.5 * (rest[left] + rest[right]) + drives.coulomb * np.sign(dq)
        self.width, self.dq = w, dq
        self.straight = w[:, None] * dq * drives.mechanical  # J per N m
        self.rub = w[:, None] * np.abs(dq) * drives.rub  # J
        self.drag = w[:, None] * drives.drag * dq**2 * pace  # J per unit of z
        self.steady = w * max(price.energy * drives.standby + price.time, 0.0) / pace
        self.copper = w[:, None] * drives.loss / pace  # J z / (N m)^2
        self.by_joint = drives.regeneration < 1

    def cost(self, x: np.ndarray) -> float:
        """Cost of a timing, x in 1/s^2."""
        x = x / self.unit
        z = 0.5 * (np.sqrt(x[1:]) + np.sqrt(x[:-1]))[:, None]
        m = self.on_p * x[:-1, None] + self.on_q * x[1:, None] + self.constant
        drawn = self.copper * m**2 / z + self.straight * m + self.rub + self.drag * z
        drawn = np.where(drawn > 0, drawn, self.drives.regeneration * drawn)
        return float(self.price.energy * np.sum(drawn) + np.sum(self.steady / z[:, 0]))

    def solve(self, polygons: Polygons, tangent: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """x (N + 1,), 1/s^2, and the lower bound of the program.

        Args:
            polygons: of the rows.
            tangent: (N + 1,), 1/s^2: sqrt(x) in the viscous losses is replaced by its tangents there.

        Raises:
            InputError: no timing keeps the rows; says where and why.
            SolverError: it is not solved.
        """
        program = _ConeRows(self.columns)
        self._rows(program, polygons)
        self._cones(program)
        cost, offset = self._cost(program, tangent)
        A, b, cones = program.matrices()
        scale = float(np.abs(cost).max()) or 1.0
        status = ""
        for tolerance in _TOLERANCES:
            solution = solve_cones(cost / scale, A, b, cones, quiet_settings(tolerance))
            if (status := str(solution.status)) in USABLE:
                x = np.array(solution.x)[: len(self.grid.s)] * self.unit
                x = np.clip(x, *self.grid.bounds.T)  # up to the solver's tolerance it is
                return x, scale * float(solution.obj_val_dual) + offset
        if status == "PrimalInfeasible":
            if why := self.couplings.why_not(self.grid, polygons, self.unit):
                raise InputError(why)
            if np.isfinite(longest := self.price.longest):
                raise InputError(
                    f"max_duration: no timing within the uncertainty takes {longest:.4g} s or less"
                )
        raise SolverError(f"timing: the cone program has no accurate solution (Clarabel: {status})")

    # columns: x and z of the nodes; per interval the cost of copper, standby and time (by joint: of standby
    # and time only, then copper and energy drawn of every joint), and its duration where that is limited

    @property
    def columns(self) -> int:
        """Number of unknowns."""
        count, n = self.on_p.shape
        return (
            2 * (count + 1) + count + 2 * count * n * self.by_joint + count * np.isfinite(self.price.longest)
        )

    @property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """First columns of z, of costs, of joints' costs (N, n, 2), of durations."""
        count, n = self.on_p.shape
        y = 2 * (count + 1) + np.arange(count)
        columns = 3 * count + 2 + np.arange(2 * count * n * self.by_joint)
        t = 3 * count + 2 + len(columns) + np.arange(count)
        return count + 1 + np.arange(count + 1), y, columns.reshape(-1, n, 2), t

    def _rows(self, program: _ConeRows, polygons: Polygons) -> None:
        z, _, by_joint, t = self._places
        bounds = self.grid.bounds / self.unit
        fixed = np.flatnonzero(bounds[:, 0] == bounds[:, 1])
        program.add("zero", [(fixed, np.ones(len(fixed)))], bounds[fixed, 0])
        still = fixed[bounds[fixed, 0] == 0]
        program.add("zero", [(z[still], np.ones(len(still)))], np.zeros(len(still)))
        i, rows = polygons.all_rows()
        a, b, c = rows.T
        size = np.maximum(np.abs(a), np.abs(b)) * self.unit
        size = np.maximum(size, np.abs(c))
        program.add("positive", [(i, a * self.unit / size), (i + 1, b * self.unit / size)], c / size)
        if len(self.couplings):
            A, b = self.couplings.A.tocoo(), self.couplings.b
            size = np.abs(b)
            np.maximum.at(size, A.row, np.abs(A.data) * self.unit)
            program.add_matrix(A.row, A.col, A.data * self.unit / size[A.row], b / size)
        if self.by_joint:
            self._drawn(program, by_joint)
        if np.isfinite(self.price.longest):
            program.add_sum(t, self.price.longest)

    def _drawn(self, program: _ConeRows, by_joint: np.ndarray) -> None:
        """Energy drawn by a joint in an interval is at least e, and r e."""
        z = self._places[0]
        for share in (1.0, self.drives.regeneration):
            on_m, on_z = share * self.straight, 0.5 * share * self.drag
            for j in range(self.on_p.shape[1]):
                i = np.arange(len(on_m))
                entries = [
                    (by_joint[:, j, 1], -np.ones(len(i))),
                    (by_joint[:, j, 0], np.full(len(i), share)),
                    (i, on_m[:, j] * self.on_p[:, j]),
                    (i + 1, on_m[:, j] * self.on_q[:, j]),
                    (z[:-1], on_z[:, j]),
                    (z[1:], on_z[:, j]),
                ]
                program.add("positive", entries, -on_m[:, j] * self.constant[:, j] - share * self.rub[:, j])

    def _cones(self, program: _ConeRows) -> None:
        z, y, by_joint, t = self._places
        count = len(y)
        i, half = np.arange(count), np.full(count, 0.5)
        nodes, one = np.arange(count + 1), np.ones(count + 1)
        program.add_product([(nodes, one)], [], 1.0, [([(z, one)], np.zeros(count + 1))])
        mean = [(z[:-1], half), (z[1:], half)]
        roots = np.sqrt(self.copper * self.price.energy)
        torques = [
            (
                [(i, roots[:, j] * self.on_p[:, j]), (i + 1, roots[:, j] * self.on_q[:, j])],
                roots[:, j] * self.constant[:, j],
            )
            for j in range(roots.shape[1])
        ]
        steady = ([], np.sqrt(self.steady))
        unit = np.ones(count)
        if self.by_joint:
            if np.any(self.steady > 0):
                program.add_product([(y, unit)], mean, 0.0, [steady])
            for j, torque in enumerate(torques):
                program.add_product([(by_joint[:, j, 0], unit)], mean, 0.0, [torque])
        else:
            program.add_product([(y, unit)], mean, 0.0, [steady, *torques])
        if np.isfinite(self.price.longest):
            pace = ([], np.sqrt(self.width / np.sqrt(self.unit)))
            program.add_product([(t, unit)], mean, 0.0, [pace])

    def _cost(self, program: _ConeRows, tangent: np.ndarray | None) -> tuple[np.ndarray, float]:
        z, y, by_joint, _ = self._places
        cost, energy = np.zeros(self.columns), self.price.energy
        cost[y] = 1.0
        if self.by_joint:
            cost[by_joint[:, :, 1].ravel()] = energy
            return cost, 0.0
        straight = energy * self.straight
        i = np.arange(len(y))
        np.add.at(cost, i, np.sum(straight * self.on_p, axis=1))
        np.add.at(cost, i + 1, np.sum(straight * self.on_q, axis=1))
        offset = float(np.sum(straight * self.constant + energy * self.rub))
        drag = np.zeros(len(z))
        drag[:-1] += 0.5 * energy * np.sum(self.drag, axis=1)
        drag[1:] += 0.5 * energy * np.sum(self.drag, axis=1)
        if tangent is None:
            cost[z] = drag
            return cost, offset
        here = np.maximum(tangent / self.unit, 1e-9)
        cost[: len(z)] += 0.5 * drag / np.sqrt(here)
        return cost, offset + float(np.sum(0.5 * drag * np.sqrt(here)))


class _ConeRows:
    """Rows of a program b - A x in cones, of the same kind together."""

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._kinds: dict[str, list[tuple[list, np.ndarray]]] = {"zero": [], "positive": []}
        self._products: list[tuple[scipy.sparse.csr_matrix, np.ndarray, int]] = []

    def add(self, kind: str, entries: list[tuple[np.ndarray, np.ndarray]], b: np.ndarray) -> None:
        """Rows sum entries <= b (positive), or = b (zero); each entry has a column and a value per row."""
        self._kinds[kind].append(([(np.arange(len(b)), *entry) for entry in entries], b))

    def add_sum(self, columns: np.ndarray, b: float) -> None:
        """The row sum of columns <= b."""
        entries = [(np.zeros(len(columns), dtype=int), columns, np.ones(len(columns)))]
        self._kinds["positive"].append((entries, np.array([b])))

    def add_matrix(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray, b: np.ndarray) -> None:
        """Rows of a sparse matrix <= b."""
        self._kinds["positive"].append(([(rows, columns, values)], b))

    def add_product(
        self,
        first: list[tuple[np.ndarray, np.ndarray]],
        second: list[tuple[np.ndarray, np.ndarray]],
        other: float,
        vectors: list[tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]],
    ) -> None:
        """Cones first (second + other) >= sum of squares of vectors, row by row."""
        count, size = len(first[0][0]), 2 + len(vectors)
        rows, columns, values = [], [], []
        b = np.zeros((count, size))
        b[:, 0], b[:, 1] = other, -other

        def put(place: int, entry: tuple[np.ndarray, np.ndarray], factor: float) -> None:
            rows.append(size * np.arange(count) + place)
            columns.append(entry[0])
            values.append(-factor * entry[1])

        for entry in first:
            put(0, entry, 1.0)
            put(1, entry, 1.0)
        for entry in second:
            put(0, entry, 1.0)
            put(1, entry, -1.0)
        for k, (entries, constant) in enumerate(vectors):
            b[:, 2 + k] = 2 * constant
            for entry in entries:
                put(2 + k, entry, 2.0)
        places = np.concatenate(rows), np.concatenate(columns)
        shape = count * size, self._columns
        self._products.append(
            (scipy.sparse.csr_matrix((np.concatenate(values), places), shape), b.ravel(), size)
        )

    def matrices(self) -> tuple[scipy.sparse.csc_matrix, np.ndarray, list]:
        """A, b and the cones."""
        parts, b, cones = [], [], []
        for kind, blocks in self._kinds.items():
            count = 0
            for entries, right in blocks:
                rows, columns, values = (np.concatenate(entry) for entry in zip(*entries, strict=True))
                parts.append(scipy.sparse.csr_matrix((values, (rows, columns)), (len(right), self._columns)))
                b.append(right)
                count += len(right)
            if count:
                cones.append(
                    clarabel.ZeroConeT(count) if kind == "zero" else clarabel.NonnegativeConeT(count)
                )
        for matrix, right, size in self._products:
            parts.append(matrix)
            b.append(right)
            cones += [clarabel.SecondOrderConeT(size)] * (len(right) // size)
        return scipy.sparse.csc_matrix(scipy.sparse.vstack(parts)), np.concatenate(b), cones


def cheapest(
    grid: Grid,
    polygons: Polygons,
    drives: QuadraticDrives,
    price: Price,
    fast: np.ndarray,
    couplings: Couplings | None = None,
) -> CheapestTiming:
    """The cheapest timing of a grid, with a lower bound.

    Args:
        grid, polygons: the rows.
        drives: of the robot.
        price: of energy and time.
        fast: (N + 1,), x of the fastest timing.
        couplings: rows of several nodes.

    Raises:
        InputError: even the fastest timing takes longer than is allowed.
        SolverError: Clarabel gave nothing.
    """
    pace = np.sqrt(fast)
    shortest = float(np.sum(2 * grid.widths / (pace[1:] + pace[:-1])))
    if shortest > price.longest:
        raise InputError(
            f"max_duration: the fastest timing takes {shortest:.4g} s, {price.longest:.4g} s are allowed"
        )
    program = CheapestProgram(grid, drives, price, fast, couplings or Couplings.none(len(fast)))
    x, lower = program.solve(polygons)
    best = CheapestTiming(x, program.cost(x), lower)
    if program.by_joint or not drives.exact:
        return best
    for _ in range(_ROUNDS):
        if best.gap <= GAP:
            break
        x, _ = program.solve(polygons, best.x)
        cost = program.cost(x)
        if not cost < best.cost * (1 - 0.1 * GAP):
            break
        best = CheapestTiming(x, cost, lower)
    return best


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
        indices = np.flatnonzero(size > 0)
        i, a, b, c, size = i[indices], a[indices], b[indices], c[indices], size[indices]
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
        least, most = np.sqrt(self._grid.bounds.T) / unit
        guess = np.clip(np.sqrt(start) / unit, least, most)
        with interrupts_after([]):
            solver = nlpsol({"x": z, "f": cost, "g": rows}, _OPTIONS)
            result = solver(x0=guess, lbx=least, ubx=np.minimum(most, 1e6), lbg=-np.inf, ubg=top)
        if not solver.stats()["success"]:
            return None
        return np.clip((unit * np.array(result["x"])[:, 0]) ** 2, *self._grid.bounds.T)
