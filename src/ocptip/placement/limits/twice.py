"""Smooth vector functions with two derivatives, from CasADi expressions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.numerics.batch import PointFunction


@dataclass(frozen=True, eq=False)
class Local:
    """Numbers that go into expressions about a point.

    Attributes:
        symbols: that stand for them.
        at: variables, of which the first are those that the numbers depend on -> the numbers.
    """

    symbols: Sequence[cs.SX] = ()
    at: Callable[[np.ndarray], Sequence[np.ndarray]] = lambda _: ()


@dataclass(frozen=True, eq=False)
class Twice:
    """A vector function with two derivatives.

    Attributes:
        first: y and further arguments -> values (m,), Jacobian (m, ny).
        second: the same and multipliers (m,) -> Hessian (ny, ny) of their product with the values.
        size: m.
        labels: m names, where the values are rows of a limit.
        dropped: how far rows miss that no variable can change; they are left out.
        local: numbers that are further arguments of `first` and `second`, behind the others.
    """

    first: PointFunction
    second: PointFunction
    size: int
    labels: tuple
    dropped: float
    local: Local

    @classmethod
    def of(
        cls,
        y: cs.SX,
        arguments: list[cs.SX],
        values: cs.SX,
        labels: Sequence = (),
        dropped: float = 0.0,
        local: Local | None = None,
    ) -> Twice:
        """From expressions."""
        lam, local = cs.SX.sym("lam", values.numel()), local or Local()
        hessian, _ = cs.hessian(cs.dot(lam, values), y)
        return cls(
            PointFunction(
                cs.Function(
                    "first", [y, *arguments, *local.symbols], [values, cs.vec(cs.jacobian(values, y))]
                )
            ),
            PointFunction(cs.Function("second", [y, *arguments, lam, *local.symbols], [hessian])),
            values.numel(),
            tuple(labels),
            dropped,
            local,
        )

    def values(self, *arguments: np.ndarray) -> np.ndarray:
        """Values (m,)."""
        return self.first(*arguments, *self.local.at(arguments[0]))[0]

    def jacobian(self, *arguments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (m,) and Jacobian (m, ny)."""
        values, slope = self.first(*arguments, *self.local.at(arguments[0]))
        return values, slope.reshape(-1, len(values)).T

    def hessian(self, *arguments: np.ndarray) -> np.ndarray:
        """(ny, ny)."""
        result = self.second(*arguments, *self.local.at(arguments[0]))[0]
        return result.reshape(len(arguments[0]), -1)
