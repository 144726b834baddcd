"""Sparse matrices as Clarabel reads them, without scipy.sparse: its import takes longer than a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np


@dataclass(frozen=True, eq=False)
class Columns:
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
    """The non-zero entries of a dense matrix, as `Columns`; Clarabel's types ask for SciPy's class."""
    column, row = np.nonzero(matrix.T)
    counts = np.bincount(column, minlength=matrix.shape[1])
    starts = np.concatenate([[0], np.cumsum(counts)])
    return Columns(np.asarray(matrix[row, column], dtype=float), row, starts, matrix.shape)


def no_columns(size: int) -> Any:
    """A square matrix of zeros, as `Columns`: the quadratic cost of a linear program."""
    return Columns(np.empty(0), np.empty(0, dtype=np.int64), np.zeros(size + 1, dtype=np.int64), (size, size))
