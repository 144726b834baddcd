"""The placement as a nonlinear program with exact derivatives (4.38, 4.39).

Variables x = (p, q of each task, s). The criteria that are a maximum or a sum of amounts enter through
variables s: a moment that all tipping moments exceed, a bound of all slip reserves, of the force space's use,
of torque amounts. Tip-over moments and slip reserves come from the contact solver with its exact derivatives;
where all contact forces may be redistributed, they are variables themselves (`forces`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.contact.solver import solve_many
from ocptip.placement.evaluate import LOG_UNIT
from ocptip.placement.power import TorqueCost
from ocptip.placement.search.forces import ContactForces, Piece
from ocptip.placement.search.physics import PatchPhysics

_UNSOLVED = 10.0  # stands in for a slip reserve without a contact solution
_STEP = 1e-5  # of the largest wrench component, for the curvature of GT
_MOST_CURVATURE = 1e3  # per squared largest wrench: beyond it a kink lies between, which has no curvature


@dataclass(frozen=True, eq=False)
class RowLabel:
    """Kind and name of a row."""

    kind: str
    name: str


@dataclass(eq=False)
class _Case:
    """Loads of one case with derivatives with respect to y."""

    z: np.ndarray
    slope: np.ndarray
    power: list[np.ndarray] | None


@dataclass(eq=False)
class _Point:
    """First-order data at one x."""

    x: np.ndarray
    cases: list[_Case]
    tip: tuple[np.ndarray, np.ndarray]
    slip: tuple[np.ndarray, np.ndarray]
    objective: float
    gradient: np.ndarray
    rows: np.ndarray
    jacobian: np.ndarray


class PlacementProgram:
    """Values and derivatives for `ocptip.numerics.ipopt.solve`.

    Args:
        physics: of the patch.
        near: per task (m,) which gaps take part.
        held: numbers of the load cases whose slip takes part: the counting ones if GT has a weight, and those
            that may come to their limit.
        pieces: per held case the pieces of the force sets, where forces are variables.
        criteria: False: only the constraints, with objective zero.
    """

    def __init__(
        self,
        physics: PatchPhysics,
        near: list[np.ndarray],
        held: list[int],
        pieces: list[Piece] | None = None,
        criteria: bool = True,
    ) -> None:
        self.physics, self.near, self.pieces = physics, near, pieces
        self.forces: ContactForces | None = physics.forces
        self.problem, self.evaluator = physics.problem, physics.evaluator
        problem, self.k, self.n = self.problem, physics.k, physics.n
        self.cases = problem.cases
        self.weights = problem.weights.array() / [problem.references[c] for c in ("GN", "GT", "GK", "GE")]
        if not criteria:
            self.weights = np.zeros(4)
        tip = problem.robot.tip_over
        self._tips = self.evaluator.tip_map.count > 0 and not tip.free_rotation
        self.unit = self.evaluator.moment_unit
        self.most = problem.limits.torque_ratio * problem.robot.arm.limits.torque
        self.limited = np.flatnonzero(np.isfinite(self.most))
        self.counting = [i for i, c in enumerate(self.cases) if c.counts]
        self._held = held
        self._lay_out()
        self._last: _Point | None = None

    def _lay_out(self) -> None:
        """Places of the variables, bounds of x, bounds and labels of the rows."""
        problem, k, n = self.problem, self.k, self.n
        tasks, size = len(problem.tasks), self.k + len(problem.tasks) * self.n
        self.y_index = [np.r_[np.arange(k), np.arange(k + t * n, k + (t + 1) * n)] for t in range(tasks)]
        self.slack: dict[str, int] = {}
        arm = problem.robot.arm.limits
        low, high = [*self.physics.terrain.lower], [*self.physics.terrain.upper]
        for _ in range(tasks):
            low += [*arm.angle_min]
            high += [*arm.angle_max]
        GT = problem.limits.GT or 1.0
        self.least = self.evaluator.least_moment / self.unit
        loaded = any(self.cases[i].load >= 0 for i in self.counting) and len(self.limited) > 0
        for name, wanted, bounds in (
            ("moment", self.weights[0] > 0 and self._tips, (self.least, np.inf)),
            ("slip", self.weights[1] > 0, (0.0, GT)),
            ("force", self.weights[2] > 0 and loaded, (0.0, np.inf)),
        ):
            if wanted:
                self.slack[name] = size
                low.append(bounds[0])
                high.append(bounds[1])
                size += 1
        self.amounts = size
        self._costly = np.empty(0, dtype=int)
        if self.weights[3] > 0 and isinstance(problem.energy, TorqueCost):
            self._costly = problem.energy.joints
            count = len(self.counting) * len(self._costly)
            low, high, size = [*low, *[0.0] * count], [*high, *[np.inf] * count], size + count
        self.grip = size
        if self.forces is not None:
            for piece in self.pieces:
                ends = piece.bounds()
                low, high, size = [*low, *ends[0]], [*high, *ends[1]], size + len(ends[0])
        self.size = size
        self.x_bounds = np.array(low), np.array(high)
        self._row_bounds()

    def _row_bounds(self) -> None:
        """Bounds and labels of all rows in their order."""
        problem, physics = self.problem, self.physics
        lower, upper, labels = [], [], []

        def add(count: int, low: float, high: float, make: list[RowLabel]) -> None:
            lower.extend([low] * count)
            upper.extend([high] * count)
            labels.extend(make)

        for t, task in enumerate(problem.tasks):
            name = f"{task.name}: " if len(problem.tasks) > 1 else ""
            count = physics.pose[t].size
            position = [RowLabel("reach", f"{name}gripper position")] * min(3, count)
            turn = [RowLabel("reach", f"{name}gripper orientation")] * (count - len(position))
            add(count, 0.0, 0.0, position + turn)
        axes = self.evaluator.tip_map.count if self._tips else 0
        for case in self.cases:
            free = not case.constrained
            bound = 0.0 if "moment" in self.slack and case.counts else self.least
            label = RowLabel("tip-over", case.name)
            add(axes, -np.inf if free else bound, np.inf, [label] * axes)
        self._slips = self._held if self.forces is None else []
        for i in self._slips:
            own = "slip" in self.slack and self.cases[i].counts
            label = RowLabel("slip", self.cases[i].name)
            add(1, -np.inf, 0.0 if own else problem.limits.GT or 1.0, [label])
        for i in self._held if self.forces is not None else []:
            name, count = self.cases[i].name, problem.robot.support.n_contacts
            add(6, 0.0, 0.0, [RowLabel("tip-over or slip", name)] * 6)
            add(count, -np.inf, 0.0, [RowLabel("slip", name)] * count)
        for case in self.cases:
            for j in self.limited:
                wide = 1.0 if case.constrained else np.inf
                add(1, -wide, wide, [RowLabel("torque", f"joint {j + 1} ({case.name})")])
        self._pushes = [i for i in self.counting if self.cases[i].load >= 0] if "force" in self.slack else []
        for i in self._pushes:
            count = 2 * len(self.limited)
            add(count, -np.inf, 0.0, [RowLabel("force space", self.cases[i].name)] * count)
        for i in self.counting:
            count = 2 * len(self._costly)
            add(count, 0.0, np.inf, [RowLabel("torque cost", self.cases[i].name)] * count)
        for t in range(len(problem.tasks)):
            for g in np.flatnonzero(self.near[t]):
                add(1, 0.0, np.inf, [RowLabel("clearance", physics.gap_labels[g])])
        if physics.manipulability:
            for name, bound in physics.manipulability.bounds.items():
                label = RowLabel("manipulability", name.replace("_", " "))
                for _ in problem.tasks:
                    add(1, -np.inf, bound / LOG_UNIT, [label])
        for kind, name in physics.ground_labels:
            add(1, 0.0, np.inf, [RowLabel(kind, name)])
        self.bounds = np.array(lower), np.array(upper)
        self.labels = tuple(labels)

    # --- start ---------------------------------------------------------------------------------------------

    def start(self, p: np.ndarray, q: np.ndarray) -> np.ndarray:
        """x for parameters (k,) and joint angles (tasks, n), with the values s just as large as needed."""
        x = np.zeros(self.size)
        x[: self.k] = p
        x[self.k : self.k + q.size] = q.ravel()
        loads = self._loads(x)
        wrenches = np.array([case.z[self.n :] for case in loads])
        if self.forces is not None and self._held:
            x[self.grip :] = self.forces.start(wrenches[self._held])[0].ravel()
        at = self._point(x)
        if "moment" in self.slack:
            own = at.tip[0][self.counting]
            x[self.slack["moment"]] = max(
                float(np.min(own)) / self.unit, self.x_bounds[0][self.slack["moment"]]
            )
        if "slip" in self.slack:
            reserve = self._slip(wrenches[self.counting], derivatives=False)[0]
            x[self.slack["slip"]] = min(np.max(reserve), self.x_bounds[1][self.slack["slip"]])
        if "force" in self.slack:
            x[self.slack["force"]] = max(self._force_space(at, i) for i in self._pushes)
        torques = np.array([at.cases[i].z[self._costly] for i in self.counting])
        x[self.amounts : self.grip] = np.abs(torques).ravel()
        return np.clip(x, *self.x_bounds)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (k,) and joint angles (tasks, n) of x."""
        tasks = len(self.problem.tasks)
        return x[: self.k].copy(), x[self.k : self.k + tasks * self.n].reshape(tasks, self.n).copy()

    def _force_space(self, at: _Point, i: int) -> float:
        own, change, most = self._pushed(at, i)
        room = np.where(change > 0, most - own, most + own)
        return float(np.max(np.abs(change) / np.maximum(room, 1e-6 * most)))

    def _pushed(self, at: _Point, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unloaded torques, their change by the load, limits; of the limited joints."""
        own = at.cases[self._unloaded(i)].z[self.limited]
        return own, at.cases[i].z[self.limited] - own, self.most[self.limited]

    def _unloaded(self, i: int) -> int:
        task = self.cases[i].task
        return next(c for c, case in enumerate(self.cases) if case.task == task)

    # --- values --------------------------------------------------------------------------------------------

    def values(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective and rows."""
        at = self._point(x)
        return at.objective, at.rows

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Of the objective, (nx,)."""
        return self._point(x).gradient

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Of the rows, (rows, nx)."""
        return self._point(x).jacobian

    def _point(self, x: np.ndarray) -> _Point:
        if self._last is not None and np.array_equal(self._last.x, x):
            return self._last
        cases = self._loads(x)
        wrenches = np.array([case.z[self.n :] for case in cases])
        tip = self.evaluator.tip_map(wrenches) if self._tips else (np.empty((len(cases), 0)), None)
        at = _Point(x.copy(), cases, tip, self._slip(wrenches[self._slips]), 0.0, None, None, None)
        self._add_objective(at)
        self._add_rows(at)
        self._last = at
        return at

    def _loads(self, x: np.ndarray) -> list[_Case]:
        cases, physics = [], self.physics
        for i, case in enumerate(self.cases):
            z, slope = physics.loads.jacobian(x[self.y_index[case.task]], case.force, case.moment)
            power = None
            if physics.power is not None and self.weights[3] > 0 and i in self.counting:
                power = [part[0] for part in physics.power(z[None, : self.n])]
            cases.append(_Case(z, slope, power))
        return cases

    def _slip(self, wrenches: np.ndarray, derivatives: bool = True) -> tuple[np.ndarray, np.ndarray | None]:
        """GT (N,) and its derivative (N, 6)."""
        if not len(wrenches):
            return np.empty(0), np.empty((0, 6))
        robot = self.problem.robot
        reserve = robot.slip.evaluate(solve_many(robot.support, wrenches), derivatives)
        GT = np.where(np.isfinite(reserve.GT), reserve.GT, _UNSOLVED)
        return GT, np.nan_to_num(reserve.gradient) if derivatives else None

    def _held_forces(self, x: np.ndarray) -> np.ndarray:
        """Contact forces (held cases, 3 n)."""
        return x[self.grip :].reshape(-1, self.forces.size)

    def _bound_of(self, i: int, x: np.ndarray) -> tuple[float, int | None]:
        """Largest usage of friction allowed in a case, and the variable that it is."""
        if "slip" in self.slack and self.cases[i].counts:
            return x[self.slack["slip"]], self.slack["slip"]
        return self.problem.limits.GT or 1.0, None

    def _add_objective(self, at: _Point) -> None:
        value, gradient, x = 0.0, np.zeros(self.size), at.x
        if "moment" in self.slack:
            s = self.slack["moment"]
            value += self.weights[0] / (1 + 2 * x[s])  # GN of a moment in units of 2 M0
            gradient[s] = -2 * self.weights[0] / (1 + 2 * x[s]) ** 2
        for weight, name in ((self.weights[1], "slip"), (self.weights[2], "force")):
            if name in self.slack:
                value += weight * x[self.slack[name]]
                gradient[self.slack[name]] = weight
        share = self.weights[3] / len(self.counting)
        if len(self._costly):
            cost = np.tile(share * self.problem.energy.cost[self._costly], len(self.counting))
            value += cost @ x[self.amounts : self.grip]
            gradient[self.amounts : self.grip] = cost
        elif share > 0:
            for i in self.counting:
                case = at.cases[i]
                value += share * float(case.power[0][0])
                gradient[self.y_index[self.cases[i].task]] += share * (case.power[1] @ case.slope[: self.n])
        at.objective, at.gradient = value, gradient

    def _add_rows(self, at: _Point) -> None:
        rows, blocks, physics, x, n = [], [], self.physics, at.x, self.n

        def add(values: np.ndarray, slope: np.ndarray, index: np.ndarray, extra: tuple | None = None) -> None:
            block = np.zeros((len(values), self.size))
            block[:, index] = slope
            if extra is not None:
                block[:, extra[0]] = extra[1]
            rows.append(values)
            blocks.append(block)

        for t, index in enumerate(self.y_index):
            add(*physics.pose[t].jacobian(x[index]), index)
        index = [self.y_index[case.task] for case in self.cases]
        if self._tips:
            for i, case in enumerate(self.cases):
                slope = at.tip[1][i] @ at.cases[i].slope[n:] / self.unit
                values, extra = at.tip[0][i] / self.unit, None
                if "moment" in self.slack and case.counts:
                    s = self.slack["moment"]
                    values, extra = values - x[s], (s, -1.0)
                add(values, slope, index[i], extra)
        for r, i in enumerate(self._slips):
            slope = (at.slip[1][r] @ at.cases[i].slope[n:])[None]
            values, extra = at.slip[0][r : r + 1], None
            if "slip" in self.slack and self.cases[i].counts:
                s = self.slack["slip"]
                values, extra = values - x[s], (s, -1.0)
            add(values, slope, index[i], extra)
        for h, i in enumerate(self._held if self.forces is not None else []):
            F, places = self._held_forces(x)[h], self.grip + h * self.forces.size
            inside = np.arange(places, places + self.forces.size)
            slope = self.forces.per_wrench @ at.cases[i].slope[n:]
            values = self.forces.balance(F, at.cases[i].z[n:])
            add(values, slope, index[i], (inside, self.forces.per_force))
            bound, variable = self._bound_of(i, x)
            values, slope, by_bound = self.pieces[h].rows(F, bound)
            add(values, slope, inside, None if variable is None else (variable, by_bound))
        most = self.most[self.limited]
        for i in range(len(self.cases)):
            case = at.cases[i]
            add(case.z[self.limited] / most, case.slope[self.limited] / most[:, None], index[i])
        for i in self._pushes:
            own, change, most = self._pushed(at, i)
            s = self.slack["force"]
            t = x[s]
            own_slope = at.cases[self._unloaded(i)].slope[self.limited] / most[:, None]
            change_slope = at.cases[i].slope[self.limited] / most[:, None] - own_slope
            for sign in (1.0, -1.0):
                room = 1 - sign * own / most
                add(
                    sign * change / most - t * room,
                    sign * change_slope + t * sign * own_slope,
                    index[i],
                    (s, -room),
                )
        for a, i in enumerate(self.counting):
            if not len(self._costly):
                break
            places = self.amounts + a * len(self._costly) + np.arange(len(self._costly))
            for sign in (1.0, -1.0):
                values = x[places] - sign * at.cases[i].z[self._costly]
                add(values, -sign * at.cases[i].slope[self._costly], index[i])
                blocks[-1][np.arange(len(places)), places] = 1.0
        for t, own in enumerate(self.y_index):
            if self.near[t].any():
                values, slope = physics.gaps.jacobian(x[own])
                add(values[self.near[t]], slope[self.near[t]], own)
        if physics.manipulability:
            found = [physics.manipulability.gradient(x[own[self.k :]]) for own in self.y_index]
            for m in range(len(physics.manipulability.bounds)):
                for own, (values, slope) in zip(self.y_index, found, strict=True):
                    add(values[m : m + 1] / LOG_UNIT, slope[m : m + 1] / LOG_UNIT, own[self.k :])
        if physics.ground:
            add(*physics.ground.jacobian(x[: self.k]), np.arange(self.k))
        at.rows, at.jacobian = np.concatenate(rows), np.concatenate(blocks)

    # --- second derivatives --------------------------------------------------------------------------------

    def hessian(self, x: np.ndarray, sigma: float, multipliers: np.ndarray) -> np.ndarray:
        """Of sigma * objective + multipliers . rows, (nx, nx)."""
        at, physics, n = self._point(x), self.physics, self.n
        H = np.zeros((self.size, self.size))
        on_z = [np.zeros(n + 6) for _ in self.cases]
        curvature = [np.zeros((n + 6, n + 6)) for _ in self.cases]
        left = multipliers

        def take(count: int) -> np.ndarray:
            nonlocal left
            taken, left = left[:count], left[count:]
            return taken

        for t, index in enumerate(self.y_index):
            H[np.ix_(index, index)] += physics.pose[t].hessian(x[index], take(physics.pose[t].size))
        if self._tips:
            for i in range(len(self.cases)):
                on_z[i][n:] += take(self.evaluator.tip_map.count) @ at.tip[1][i] / self.unit
        on_slip = take(len(self._slips))
        for r, i in enumerate(self._slips):
            on_z[i][n:] += on_slip[r] * at.slip[1][r]
        self._add_slip_curvature(at, on_slip, curvature)
        for h, i in enumerate(self._held if self.forces is not None else []):
            on_z[i][n:] += take(6) @ self.forces.per_wrench
            inside = self.grip + h * self.forces.size + np.arange(self.forces.size)
            on_cone = take(self.forces.size // 3)
            bound, variable = self._bound_of(i, x)
            F = self._held_forces(x)[h]
            H[np.ix_(inside, inside)], mixed, twice = self.pieces[h].hessian(F, bound, on_cone)
            if variable is not None:
                H[variable, inside] += mixed
                H[inside, variable] += mixed
                H[variable, variable] += twice
        most = self.most[self.limited]
        for i in range(len(self.cases)):
            on_z[i][self.limited] += take(len(self.limited)) / most
        for i in self._pushes:
            t, s, own = x[self.slack["force"]], self.slack["force"], self._unloaded(i)
            index = self.y_index[self.cases[i].task]
            for sign in (1.0, -1.0):
                on = sign * take(len(self.limited)) / most
                on_z[i][self.limited] += on
                on_z[own][self.limited] += (t - 1) * on
                mixed = on @ at.cases[own].slope[self.limited]
                H[s, index] += mixed
                H[index, s] += mixed
        for i in self.counting:
            if len(self._costly):
                for sign in (1.0, -1.0):
                    on_z[i][self._costly] -= sign * take(len(self._costly))
            elif self.weights[3] > 0:
                share = sigma * self.weights[3] / len(self.counting)
                on_z[i][:n] += share * at.cases[i].power[1]
                curvature[i][np.arange(n), np.arange(n)] += share * at.cases[i].power[2]
        for i, case in enumerate(self.cases):
            index, own = self.y_index[case.task], at.cases[i]
            inner = physics.loads.hessian(x[index], case.force, case.moment, on_z[i])
            H[np.ix_(index, index)] += inner + own.slope.T @ curvature[i] @ own.slope
        for t, index in enumerate(self.y_index):
            if (count := int(np.count_nonzero(self.near[t]))) > 0:
                on_gaps = np.zeros(len(self.near[t]))
                on_gaps[self.near[t]] = take(count)
                H[np.ix_(index, index)] += physics.gaps.hessian(x[index], on_gaps)
        self._add_plain_hessians(H, at, sigma, left)
        return H

    def _add_plain_hessians(self, H: np.ndarray, at: _Point, sigma: float, left: np.ndarray) -> None:
        """Manipulability, ground, and the tip-over term of the objective."""
        physics, x = self.physics, at.x
        if physics.manipulability:
            tasks = len(self.y_index)
            count = tasks * len(physics.manipulability.bounds)
            on, left = left[:count].reshape(-1, tasks) / LOG_UNIT, left[count:]
            for t, index in enumerate(self.y_index):
                q = index[self.k :]
                H[np.ix_(q, q)] += physics.manipulability.hessian(x[q], on[:, t])
        if physics.ground:
            H[: self.k, : self.k] += physics.ground.hessian(x[: self.k], left)
        if "moment" in self.slack:
            s = self.slack["moment"]
            H[s, s] += sigma * 8 * self.weights[0] / (1 + 2 * x[s]) ** 3

    def _add_slip_curvature(self, at: _Point, on_slip: np.ndarray, curvature: list[np.ndarray]) -> None:
        """Second derivatives of GT with respect to the wrench, by differences of its exact gradient."""
        weighty = [(r, i) for r, i in enumerate(self._slips) if abs(on_slip[r]) > 1e-9]
        if not weighty:
            return
        length = self.problem.robot.support.length
        wrenches = np.array([at.cases[i].z[self.n :] for _, i in weighty])
        size = np.max(np.abs(wrenches * np.r_[1, 1, 1, np.ones(3) / length]), axis=1)
        steps = _STEP * size[:, None] * np.r_[1, 1, 1, np.full(3, length)]
        moved = wrenches[:, None] + steps[:, :, None] * np.eye(6)
        gradients = self._slip(moved.reshape(-1, 6))[1].reshape(-1, 6, 6)
        for w, (r, i) in enumerate(weighty):
            bend = (gradients[w] - at.slip[1][r]) / steps[w][:, None]
            relative = np.max(np.abs(bend * np.outer(steps[w], steps[w]))) / _STEP**2
            if relative < _MOST_CURVATURE:
                curvature[i][self.n :, self.n :] += on_slip[r] * (bend + bend.T) / 2
