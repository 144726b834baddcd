"""The objective of the nonlinear program (4.38): weighted criteria, most of them variables in rows."""

from __future__ import annotations

import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.placement.limits.layout import Hessian, Point, Variables


class PlacementObjective:
    """Weighted sum of the normalised criteria.

    Args:
        layout: of the variables.
        power: of torques (1, n): power, its gradient and the diagonal of its Hessian; None for a torque cost.
    """

    def __init__(self, layout: Variables, power: BatchFunction | None) -> None:
        self._layout, self._function, self._weights = layout, power, layout.weights
        self._share = layout.weights[3] / len(layout.counting)
        self._powered = layout.counting if self._share > 0 and power is not None else []
        self._linear = [
            (layout.slack[name], weight)
            for name, weight in zip(("slip", "force"), layout.weights[1:3], strict=True)
            if name in layout.slack
        ]
        self._amounts = np.concatenate([np.empty(0, dtype=int), *layout.amounts.values()])
        if layout.amounts:
            cost = self._share * layout.problem.energy.cost[layout.costly]
            self._cost = np.tile(cost, len(layout.amounts))

    def _power(self, at: Point) -> dict[int, list[np.ndarray]]:
        """Per counting case power, its gradient (n,) and the diagonal of its Hessian (n,) by the torques."""
        power, n = self._function, self._layout.n
        assert power is not None  # else no case is powered
        return at.once(
            self, lambda: {i: [part[0] for part in power(at.loads[i][None, :n])] for i in self._powered}
        )

    def value(self, at: Point) -> float:
        """At a point."""
        value, x = 0.0, at.x
        if (s := self._layout.slack.get("moment")) is not None:
            value += self._weights[0] / (1 + 2 * x[s])  # GN of a moment in units of 2 M0
        for column, weight in self._linear:
            value += weight * x[column]
        if len(self._amounts):
            value += float(self._cost @ x[self._amounts])
        for i in self._powered:
            value += self._share * float(self._power(at)[i][0][0])
        return value

    def gradient(self, at: Point) -> np.ndarray:
        """(nx,)."""
        layout, gradient = self._layout, np.zeros(self._layout.size)
        if (s := self._layout.slack.get("moment")) is not None:
            gradient[s] = -2 * self._weights[0] / (1 + 2 * at.x[s]) ** 2
        for column, weight in self._linear:
            gradient[column] = weight
        if len(self._amounts):
            gradient[self._amounts] = self._cost
        for i in self._powered:
            slope = self._power(at)[i][1] @ at.slopes[i][: layout.n]
            gradient[layout.y[layout.cases[i].task]] += self._share * slope
        return gradient

    def add_hessian(self, sums: Hessian, at: Point, sigma: float) -> None:
        """Add sigma times its second derivatives."""
        if (s := self._layout.slack.get("moment")) is not None:
            sums.matrix[s, s] += sigma * 8 * self._weights[0] / (1 + 2 * at.x[s]) ** 3
        joints, share = np.arange(self._layout.n), sigma * self._weights[3] / len(self._layout.counting)
        for i in self._powered:
            _, slope, bend = self._power(at)[i]
            sums.on_loads[i][joints] += share * slope
            sums.of_loads[i][joints, joints] += share * bend
