"""A base on its contacts, with the margins of its contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ocptip.contact.resting import solve_resting
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.reserves.slip import Redistribution, Slip
from ocptip.reserves.tipping import TipOver
from ocptip.standing.tolerance import Uncertainty


def center_by_weights(support: Support, loads_on: Callable[[Support], np.ndarray]) -> np.ndarray:
    """Centre of mass of a base and all on it, (N, 3), m, base axes, from weights along three axes.

    What acts besides weights cancels.

    Args:
        own: the base.
        loads_on: wrenches (N, 6), N and N m about its centre of mass, on the base under another gravity.
    """
    size = float(np.linalg.norm(support.gravity)) or 1.0
    loads = [
        loads_on(
            Support(
                support.contacts,
                mass=support.mass,
                center_of_mass=support.center_of_mass,
                gravity=size * axis,
            )
        )
        for axis in np.eye(3)
    ]
    weights = np.stack([loads[0] - loads[2], loads[1] - loads[2]], axis=1)  # (N, 2, 6)
    # A moment is the sum of c_k (e_k x force) over the coordinates c_k of the centre.
    levers = np.cross(np.eye(3)[:, None, None], weights[..., :3]).transpose(1, 2, 3, 0)
    moments = weights[..., 3:].reshape(-1, 6, 1)
    return support.center_of_mass + (np.linalg.pinv(levers.reshape(-1, 6, 3)) @ moments)[..., 0]


class Footing:
    """A body on contacts, the base or an object: where it meets what it stands on.

    Args:
        support: in base axes.
        reference_moment: M0 of the tip-over index, N m; default: see `TipOver`.
        redistribution: of the friction utilisation, see `reserves.slip.Slip`.
        name: of what stands on the contacts.

    Attributes:
        support, name: as given.
        tip_over, slip: its margins.
    """

    def __init__(
        self,
        support: Support,
        reference_moment: float | None = None,
        redistribution: Redistribution | None = None,
        name: str = "base",
    ) -> None:
        self.support, self.name = support, name
        self.tip_over, self.slip = TipOver(support, reference_moment), Slip(support, redistribution)

    def result(self, name: str) -> str:
        """The name of a result of these contacts, from that of the base."""
        return name if self.name == "base" else f"{name}[{self.name}]"

    def on(self, support: Support) -> Footing:
        """These margins for another support."""
        return Footing(support, self.tip_over.reference_moment, self.slip.redistribution, self.name)

    def weakest(self, tolerance: Uncertainty) -> Footing:
        """These margins with the minimum friction within the uncertainty."""
        if not tolerance.friction:
            return self
        return self.on(self.support.varied(tolerance.contacts(self.support.contacts)))

    def contact_states(self, wrenches: np.ndarray, **how: Any) -> ContactStates:
        """States of the contacts under total wrenches (N, 6) on the base; `how`: see `solve_resting`."""
        return solve_resting(self.support, wrenches, **how)
