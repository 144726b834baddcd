"""Parameters of Nav2's velocity smoother: those for driving forward, and those that also hold backwards."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

_COST_OF_REVERSE = 0.05  # share of the limits forward that driving backwards may cost


@dataclass(frozen=True, eq=False)
class Smoother:
    """Limits that hold all at once: x, y, turning, by the names of parameters.

    The smoother accelerates backwards by max_accel and brakes then by max_decel: reverse needs one limit for
    both, and is allowed where that costs no more than `_COST_OF_REVERSE`.

    Attributes:
        ahead: while the base drives forward.
        reversible: while it drives forward or backwards.
    """

    ahead: dict[str, list[float]]
    reversible: dict[str, list[float]]

    @property
    def parameters(self) -> dict[str, list[float]]:
        """Those to set."""
        return self.reversible if self.reverses else self.ahead

    @property
    def reverses(self) -> bool:
        """Whether they let the base reverse."""
        return self._cost <= _COST_OF_REVERSE

    @cached_property
    def _cost(self) -> float:
        """Share by which limits that hold in both directions are lower than those ahead, at most."""
        names = ("max_velocity", "max_accel", "max_decel")
        ahead, both = (np.abs([limits[name] for name in names]) for limits in (self.ahead, self.reversible))
        return 1 - float(np.min(np.divide(both, ahead, out=np.ones(ahead.shape), where=ahead > 0)))

    @property
    def reverse(self) -> str:
        """Whether they let the base reverse, what that costs, and what would allow it, in words."""
        cost = f"up to {100 * max(self._cost, 0.0):.2g} % of the limits"
        if self.reverses:
            return f"reverse: as fast as forward, with one limit for both directions; it costs {cost}"
        values = ", ".join(
            f"{name} [{', '.join(f'{np.trunc(1e3 * value) / 1e3 + 0.0:.3f}' for value in vector)}]"
            for name, vector in self.reversible.items()
        )
        return f"reverse: no, one limit for both directions costs {cost}. To allow it set {values}"
