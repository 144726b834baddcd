"""Base parameters of a whole parallel robot: which they are, and what makes them from all parameters."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import finite_array


@dataclass(frozen=True, eq=False)
class NumericBaseParameters:
    """Base parameters of the whole robot from a stacked regressor, p_base = p_1 + K p_2.

    Attributes:
        names: of p_1, each the name of the parameter into which others were grouped.
        independent: indices (in the inertia layout) of p_1.
        dependent: indices of p_2, whose columns are combinations of those of p_1.
        without_effect: indices of columns that are zero.
        grouping: K, (len(independent), len(dependent)).
        singular_values: of the scaled regressor, largest first.
        gap: decades between the smallest singular value that counts and the largest that does not.
        residual: largest relative difference between W p and W_1 p_base over the stacked rows.
    """

    names: tuple[str, ...]
    independent: tuple[int, ...]
    dependent: tuple[int, ...]
    without_effect: tuple[int, ...]
    grouping: np.ndarray
    singular_values: np.ndarray
    gap: float
    residual: float

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    @property
    def size(self) -> int:
        """Number of all parameters (DynPar 2)."""
        return self.rank + len(self.dependent) + len(self.without_effect)

    @property
    def matrix(self) -> np.ndarray:
        """(rank, size): p_base = matrix p, from DynPar 2 to the whole robot's DynPar 3."""
        matrix = np.zeros((self.rank, self.size))
        matrix[:, list(self.independent)] = np.eye(self.rank)
        matrix[:, list(self.dependent)] = self.grouping
        return matrix

    def values(self, parameters: ArrayLike) -> np.ndarray:
        """(rank,) base parameters of a parameter vector in the order of the layout."""
        return self.matrix @ finite_array("parameters", parameters, (self.size,))

    def embedded(self, parameters: ArrayLike) -> np.ndarray:
        """The full vector (p_base, 0) that has the same motor forces."""
        full = np.zeros(self.size)
        full[list(self.independent)] = self.values(parameters)
        return full

    def function(self) -> cs.Function:
        """`base_parameters`: `p` (size,) to `p_base` (rank,), for C code beside generated functions."""
        p = cs.SX.sym("p", self.size)
        return cs.Function("base_parameters", [p], [cs.sparsify(cs.DM(self.matrix)) @ p], ["p"], ["p_base"])
