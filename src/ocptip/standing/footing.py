"""A base on its contacts, with the margins of its contacts."""

from __future__ import annotations

from typing import Any

import numpy as np

from ocptip.contact.resting import solve_resting
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.reserves.slip import Redistribution, Slip
from ocptip.reserves.tipping import TipOver
from ocptip.standing.tolerance import Uncertainty


class Footing:
    """A base on its contacts: where everything that stands meets the ground.

    Args:
        support: in base axes.
        reference_moment: M0 of the tip-over index, N m; default: see `TipOver`.
        redistribution: of the friction utilisation, see `reserves.slip.Slip`.

    Attributes:
        support: as given.
        tip_over, slip: its margins.
    """

    def __init__(
        self,
        support: Support,
        reference_moment: float | None = None,
        redistribution: Redistribution | None = None,
    ) -> None:
        self.support = support
        self.tip_over, self.slip = TipOver(support, reference_moment), Slip(support, redistribution)

    def on(self, support: Support) -> Footing:
        """These margins for another support."""
        return Footing(support, self.tip_over.reference_moment, self.slip.redistribution)

    def weakest(self, tolerance: Uncertainty) -> Footing:
        """These margins with the minimum friction within the uncertainty."""
        if not tolerance.friction:
            return self
        return self.on(self.support.varied(tolerance.contacts(self.support.contacts)))

    def contact_states(self, wrenches: np.ndarray, **how: Any) -> ContactStates:
        """States of the contacts under total wrenches (N, 6) on the base; `how`: see `solve_resting`."""
        return solve_resting(self.support, wrenches, **how)
