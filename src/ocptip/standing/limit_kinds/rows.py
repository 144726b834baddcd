"""Rows of a nonlinear program: nodes, values, slopes and second derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ocptip.standing.instants import NodeColumns


class RowNodes(ABC):
    """The nodes that rows of a program belong to: N states and quantities, functions of its nx variables x.

    Args:
        columns: of y.
        s: (N, S): angles, speeds, accelerations, and a process that varies, 6 more.
        y: (N, ny): quantities.
    """

    def __init__(self, columns: NodeColumns, s: np.ndarray, y: np.ndarray) -> None:
        self.columns, self.s, self.y = columns, s, y

    @abstractmethod
    def by_states(self, nodes: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Slopes (R, nx) over x of functions at nodes (R,) with slopes (R, S) over the states."""

    @abstractmethod
    def by_quantities(self, nodes: np.ndarray, first: int | np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Slopes over x of functions with slopes (R, k) over columns of y from `first` (one, or (R,)) on.

        The column of the power is not one of them.
        """

    @property
    def angles(self) -> np.ndarray:
        """(N, n)."""
        return self.s[:, : self.columns.n]

    @property
    def process(self) -> np.ndarray:
        """(N, k) of what acts, see `standing.acting`."""
        return self.s[:, 3 * self.columns.n :]

    @property
    def motion_states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, speeds, accelerations, (N, n) each."""
        n = self.columns.n
        return self.s[:, :n], self.s[:, n : 2 * n], self.s[:, 2 * n : 3 * n]


class NodeSlopes(RowNodes):
    """Nodes with all their slopes over x.

    Args:
        columns, s, y: as above.
        s_x, y_x: (N, S, nx), (N, ny, nx).
    """

    def __init__(
        self, columns: NodeColumns, s: np.ndarray, s_x: np.ndarray, y: np.ndarray, y_x: np.ndarray
    ) -> None:
        super().__init__(columns, s, y)
        self.s_x, self.y_x = s_x, y_x

    def by_states(self, nodes: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        return np.einsum("rs,rsx->rx", slopes, self.s_x[nodes])

    def by_quantities(self, nodes: np.ndarray, first: int | np.ndarray, slopes: np.ndarray) -> np.ndarray:
        columns = np.reshape(first, (-1, 1)) + np.arange(slopes.shape[1])
        return np.einsum("rk,rkx->rx", slopes, self.y_x[nodes[:, None], columns])


class Curvature(Protocol):
    """Second derivatives over the states of a sum of functions of the nodes, that others are added to."""

    def add(self, nodes: np.ndarray, bends: np.ndarray) -> None:
        """Add second derivatives (R, k, k) at nodes (R,) over the first k states."""
        ...

    def add_over_quantities(self, nodes: np.ndarray, first: int, bends: np.ndarray) -> None:
        """Add second derivatives (R, k, k) at nodes (R,) over columns of y from `first` on; not of power."""
        ...


NEGLIGIBLE = 1e-9  # a row whose multiplier is below this is left out of the Hessian


@dataclass(frozen=True, eq=False)
class NodeRows:
    """The rows of one limit that take part in a program, at one x.

    Attributes:
        at: all nodes.
        nodes, places: (rows,) node, and number among the limit's rows there.
        values: (rows,).
        slopes: (rows, ...) over what the limit is a function of; empty where that is plain.
        bends: (rows, 6, 6) second derivatives over the wrench; empty where there are none.
        chosen: what rows are evaluated at that is kept fixed, such as deviations, each of R rows.
        weights: (rows, 6) slopes over the wrench at what is chosen.
    """

    at: RowNodes
    nodes: np.ndarray
    places: np.ndarray
    values: np.ndarray
    slopes: np.ndarray = field(default_factory=lambda: np.empty(0))
    bends: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)
    chosen: tuple[Any, ...] = field(default=(), kw_only=True)
    weights: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)
