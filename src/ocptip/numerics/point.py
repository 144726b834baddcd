"""CasADi functions evaluated at single points from NumPy, without CasADi's per-call conversions."""

from __future__ import annotations

import threading

import casadi as cs
import numpy as np


class PointFunction:
    """A CasADi function of column vectors and matrices, evaluated at one point at a time.

    For batches of many states `BatchFunction` is faster; for the one to ten states of a placement CasADi's
    own machine is.

    Args:
        function: the function.

    Sparse outputs are made dense. Safe to share between threads.
    """

    def __init__(self, function: cs.Function) -> None:
        if not function.is_a("SXFunction"):
            function = function.expand()
        dense = function
        if not all(function.sparsity_out(i).is_dense() for i in range(function.n_out())):
            symbols = function.sx_in()
            dense = cs.Function(function.name(), symbols, [cs.densify(out) for out in function.call(symbols)])
        self._buffer, self._run = dense.buffer()
        self._arguments = [np.zeros(dense.numel_in(i)) for i in range(dense.n_in())]
        self._results = [np.zeros(dense.size_out(i), order="F") for i in range(dense.n_out())]
        # CasADi's type hints count a buffer's size as an argument of its own
        for i, array in enumerate(self._arguments):
            self._buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
        for i, array in enumerate(self._results):
            self._buffer.set_res(i, array.reshape(-1, order="F").data)  # pyright: ignore[reportCallIssue]
        self._lock = threading.Lock()

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Evaluate.

        Args:
            arguments: one per input: (rows,) for a column vector, (rows, columns) for a matrix.

        Returns:
            One new array per output: (rows,) for a column vector, (rows, columns) for a matrix.
        """
        with self._lock:
            for own, given in zip(self._arguments, arguments, strict=True):
                own[:] = np.ravel(given, order="F")
            self._run()
            return [r[:, 0].copy() if r.shape[1] == 1 else r.copy() for r in self._results]
