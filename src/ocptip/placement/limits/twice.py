"""Smooth vector functions with two derivatives, from CasADi expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.numerics.point import PointFunction


@dataclass(frozen=True, eq=False)
class Twice:
    """A vector function with two derivatives.

    Attributes:
        first: y and further arguments -> values (m,), Jacobian (m, ny).
        second: the same and multipliers (m,) -> Hessian (ny, ny) of their product with the values.
        size: m.
        labels: m names, where the values are rows of a limit.
        dropped: how far rows miss that no variable can change; they are left out.
    """

    first: PointFunction
    second: PointFunction
    size: int
    labels: tuple
    dropped: float

    @classmethod
    def of(
        cls,
        y: cs.SX,
        arguments: list[cs.SX],
        values: cs.SX,
        labels: Sequence = (),
        dropped: float = 0.0,
    ) -> Twice:
        """From expressions."""
        lam = cs.SX.sym("lam", values.numel())
        hessian, _ = cs.hessian(cs.dot(lam, values), y)
        return cls(
            PointFunction(cs.Function("first", [y, *arguments], [values, cs.vec(cs.jacobian(values, y))])),
            PointFunction(cs.Function("second", [y, *arguments, lam], [hessian])),
            values.numel(),
            tuple(labels),
            dropped,
        )

    def jacobian(self, *arguments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (m,) and Jacobian (m, ny)."""
        values, slope = self.first(*arguments)
        return values, slope.reshape(-1, len(values)).T

    def hessian(self, *arguments: np.ndarray) -> np.ndarray:
        """(ny, ny)."""
        result = self.second(*arguments)[0]
        return result.reshape(len(arguments[0]), -1)
