"""Cone programs: Clarabel, quiet, fed without scipy.sparse, whose import takes longer than a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import clarabel
import numpy as np

USABLE = ("Solved", "AlmostSolved")
"""Status of a program whose answer can be used."""

INFEASIBLE = ("PrimalInfeasible", "AlmostPrimalInfeasible")
"""Status of a program that is shown to have no answer."""


@dataclass(frozen=True, eq=False)
class ConeColumns:
    """A matrix of non-zero entries, column by column.

    Attributes:
        data: (k,) the entries.
        indices: (k,) their rows, ascending in every column.
        indptr: (columns + 1,) where in `data` every column begins, and the end.
        shape: numbers of rows and columns.
    """

    data: np.ndarray
    indices: np.ndarray
    indptr: np.ndarray
    shape: tuple[int, int]
    has_canonical_format: ClassVar[bool] = True


def columns_of(matrix: np.ndarray) -> Any:
    """The non-zero entries of a dense matrix, as `ConeColumns`; Clarabel's types ask for SciPy's class."""
    column, row = np.nonzero(matrix.T)
    counts = np.bincount(column, minlength=matrix.shape[1])
    starts = np.concatenate([[0], np.cumsum(counts)])
    return ConeColumns(np.asarray(matrix[row, column], dtype=float), row, starts, matrix.shape)


def no_columns(size: int) -> Any:
    """A square matrix of zeros, as `ConeColumns`: the quadratic cost of a linear program."""
    return ConeColumns(
        np.empty(0), np.empty(0, dtype=np.int64), np.zeros(size + 1, dtype=np.int64), (size, size)
    )


def triangle(matrix: np.ndarray) -> np.ndarray:
    """Upper triangle column by column, off the diagonal times sqrt 2: a matrix of a semidefinite cone."""
    i, j = np.tril_indices(len(matrix))
    return matrix[j, i] * np.where(i == j, 1.0, np.sqrt(2))


def quiet_settings(tolerance: float | None = None) -> Any:
    """Clarabel's settings, silent and on one core; `tolerance` of gap and feasibility, None: Clarabel's
    default.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    if tolerance is not None:
        settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = tolerance
    return settings


def solve_cones(
    cost: np.ndarray, A: Any, b: np.ndarray, cones: list, settings: Any, quadratic: np.ndarray | None = None
) -> Any:
    """Minimise x'Px / 2 + cost'x with b - A x in a product of cones: Clarabel's solution.

    Args:
        cost: (n,).
        A: (m, n), dense or sparse.
        b: (m,).
        cones: Clarabel cones in the order of the rows.
        settings: see `quiet_settings`.
        quadratic: P (n, n), upper triangle; zero by default.
    """
    P = no_columns(len(cost)) if quadratic is None else columns_of(quadratic)
    A = columns_of(A) if isinstance(A, np.ndarray) else A
    return clarabel.DefaultSolver(P, cost, A, b, cones, settings).solve()
