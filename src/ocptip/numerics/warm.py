"""What Numba loads at the first call of any compiled function (0.3 s of CPU): done where this is imported.

For the process that workers are forked from: it does so while the command loads other modules, and no worker
has to, see `ocptip.numerics.fork_server`.
"""

from __future__ import annotations

from ocptip.numerics.jit.compiled import compiled


@compiled
def _same(x: float) -> float:
    return x


_same(0.0)
