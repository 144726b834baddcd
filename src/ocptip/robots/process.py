"""What a process does to the gripper while the arm moves: a force and a moment (2.45)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, bounded_array

AXES = ("tool", "base", "world")
NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class ProcessWrench:
    """What acts on the gripper, at rest and in motion, before, during and after it.

    The base rests: axes of the world are those of the base, also where a tolerance tilts the floor.

    Attributes:
        force: (3,), N, on the gripper, at the gripper point G.
        moment: (3,), N m, on the gripper.
        axes: "tool": of the gripper, it turns with it; "base" or "world".

    Raises:
        InputError: naming what cannot be used.
    """

    force: ArrayLike = NOWHERE
    moment: ArrayLike = NOWHERE
    axes: str = "tool"

    def __post_init__(self) -> None:
        for name in ("force", "moment"):
            values = bounded_array(name, getattr(self, name), (3,))
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if self.axes not in AXES:
            raise InputError(f"axes: expected one of {', '.join(AXES)}, got {self.axes!r}")

    @property
    def wrench(self) -> np.ndarray:
        """(6,): force, then moment, in its axes."""
        return np.concatenate([self.force, self.moment])

    @property
    def turns_with_tool(self) -> bool:
        """Whether it is constant in the axes of the gripper, not in those of the base."""
        return self.axes == "tool"

    def seen_from(self, rotation: np.ndarray) -> ProcessWrench:
        """The same for a base frame to which `rotation` (3, 3) maps the present one's axes."""
        if self.turns_with_tool:
            return self
        return ProcessWrench(rotation @ self.force, rotation @ self.moment, self.axes)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {"force_N": list(self.force), "moment_Nm": list(self.moment), "axes": self.axes}

    def __str__(self) -> str:
        """In words."""
        parts = [("N", self.force), ("N m", self.moment)]
        words = [f"({', '.join(f'{x:.4g}' for x in v)}) {unit}" for unit, v in parts if np.any(v)]
        return f"{' and '.join(words) or 'nothing'} on the gripper, in axes of the {self.axes}"
