"""CasADi functions evaluated on NumPy arrays of many states, without CasADi's per-call conversions."""

from __future__ import annotations

import casadi as cs
import numpy as np

_BLOCK = 64  # states per mapped call: large enough to hide Python, small enough to waste little on padding


class BatchFunction:
    """A CasADi function of column vectors and matrices, evaluated for N states at once.

    Args:
        function: the single-state function; it stays available as attribute `function`.
        block: states per mapped call; numbers of states are padded to a multiple of it.

    Sparse outputs are made dense. Safe to share between threads: every call checks out its own memory.
    """

    def __init__(self, function: cs.Function, block: int = _BLOCK) -> None:
        symbols = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
        dense = [cs.densify(out) for out in function.call(symbols)]
        names = function.name_in(), function.name_out()
        self.function = cs.Function(function.name(), symbols, dense, *names)
        self._block = block
        self._mapped = self.function.map(block)
        self._in = [function.size_in(i) for i in range(function.n_in())]
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
        function, block = (self.function, 1) if count < self._block // 4 else (self._mapped, self._block)
        padded = -(-count // block) * block
        inputs = []
        for argument, (rows, columns) in zip(arguments, self._in, strict=True):
            store = np.zeros((padded, rows * columns))
            store[:count] = argument
            inputs.append(store)
        outputs = [np.empty((padded, rows * columns)) for rows, columns in self._out]
        buffer, evaluate = function.buffer()
        for start in range(0, padded, block):
            chunk = slice(start, start + block)
            for index, store in enumerate(inputs):
                buffer.set_arg(index, memoryview(store[chunk]))
            for index, store in enumerate(outputs):
                buffer.set_res(index, memoryview(store[chunk]))
            evaluate()
        return [
            store[:count] if columns == 1 else store[:count].reshape(count, columns, rows).transpose(0, 2, 1)
            for store, (rows, columns) in zip(outputs, self._out, strict=True)
        ]
