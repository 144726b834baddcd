"""A foot with a magnet that pulls the base down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ocptip.contact.bindings.binding import ForcePiece, positive_parameters
from ocptip.contact.bindings.unilateral import UnilateralContact


@dataclass(frozen=True, kw_only=True, eq=False)
class MagneticFoot(UnilateralContact):
    """An ordinary contact with a magnet that pulls the base down with a constant force.

    Attributes:
        adhesion: Force of the magnet, N.
    """

    kind: ClassVar[str] = "magnetic-foot"

    adhesion: float

    def check_parameters(self) -> None:
        super().check_parameters()
        positive_parameters(self, "adhesion")

    def force_offset(self) -> np.ndarray:
        return -self.adhesion * np.eye(self.dimension)[0]

    def force_pieces(self) -> list[ForcePiece]:
        return [ForcePiece(-self.adhesion, np.inf, self.friction * self.adhesion, self.friction)]
