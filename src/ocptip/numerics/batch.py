"""CasADi functions evaluated on NumPy arrays, of many states or one, without CasADi's conversions."""

from __future__ import annotations

import threading
from collections.abc import Callable

import casadi as cs
import numpy as np

from ocptip.numerics.jit.tape import Tape


class BatchFunction:
    """A CasADi function of column vectors and matrices, evaluated for N states at once.

    Args:
        function: the single-state function; it stays available as attribute `function`.

    Sparse outputs are made dense. Safe to share between threads. Instructions that `Tape` does not know are
    left to CasADi's virtual machine, which takes one state at a time.
    """

    def __init__(self, function: cs.Function) -> None:
        if not function.is_a("SXFunction"):
            function = function.expand()
        symbols = function.sx_in()
        dense = [cs.densify(out) for out in function.call(symbols)]
        names = function.name_in(), function.name_out()
        self.function = cs.Function(function.name(), symbols, dense, *names)
        try:
            self._run: Callable[[np.ndarray], np.ndarray] = Tape(self.function)
        except NotImplementedError:
            self._run = _by_casadi(self.function)
        self._in = [function.numel_in(i) for i in range(function.n_in())]
        self._out = [function.size_out(i) for i in range(function.n_out())]

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Evaluate at N states.

        Args:
            arguments: one per input, (N, rows) for a column vector, or (rows,) if it is the same for all
                states.

        Returns:
            One array per output: (N, rows) for a column vector, (N, rows, columns) for a matrix.
        """
        count = max((len(a) for a in arguments if np.ndim(a) > 1), default=1)
        if count == 1:  # a third of the time of what follows
            pairs = zip(arguments, self._in, strict=True)
            inputs = np.concatenate([np.asarray(a, dtype=float).reshape(size, 1) for a, size in pairs])
        else:
            inputs, row = np.empty((sum(self._in), count)), 0
            for argument, size in zip(arguments, self._in, strict=True):
                inputs[row : row + size] = (
                    np.asarray(argument).T if np.ndim(argument) > 1 else np.reshape(argument, (-1, 1))
                )
                row += size
        outputs = np.ascontiguousarray(self.in_columns(inputs).T)
        results, row = [], 0
        for rows, columns in self._out:
            part = outputs[:, row : row + rows * columns]
            row += rows * columns
            results.append(part if columns == 1 else part.reshape(count, columns, rows).transpose(0, 2, 1))
        return results

    def in_columns(self, inputs: np.ndarray) -> np.ndarray:
        """All outputs, one below the other and column by column, (rows, N), at such inputs (rows, N)."""
        return self._run(inputs)


def _by_casadi(function: cs.Function) -> Callable[[np.ndarray], np.ndarray]:
    """A function from all arguments (arguments, N) to all results (results, N)."""
    sizes = [function.numel_in(i) for i in range(function.n_in())]
    arguments = cs.SX.sym("arguments", sum(sizes))
    parts = cs.vertsplit(arguments, [0, *np.cumsum(sizes).tolist()])
    shaped = [cs.reshape(part, *function.size_in(i)) for i, part in enumerate(parts)]
    flat = cs.Function("flat", [arguments], [cs.vertcat(*map(cs.vec, function.call(shaped)))])
    nothing = np.empty((flat.numel_out(), 0))
    return lambda inputs: flat(inputs).full() if inputs.size else nothing


class PointFunction:
    """A CasADi function of column vectors and matrices, evaluated at one point at a time.

    For batches of many states `BatchFunction` is faster; for the one to ten states of a placement CasADi's
    virtual machine is.

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
            for argument, given in zip(self._arguments, arguments, strict=True):
                argument[:] = np.ravel(given, order="F")
            self._run()
            return [r[:, 0].copy() if r.shape[1] == 1 else r.copy() for r in self._results]
