"""The centre of mass of a base and all that it carries."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ocptip.contact.support import Support


def center_by_weights(own: Support, loads_on: Callable[[Support], np.ndarray]) -> np.ndarray:
    """Centre of mass of a base and all on it, (N, 3), m, base axes, from weights along three axes.

    What acts besides weights cancels.

    Args:
        own: the base.
        loads_on: wrenches (N, 6), N and N m about its centre of mass, on the base under another gravity.
    """
    size = float(np.linalg.norm(own.gravity)) or 1.0
    loads = [
        loads_on(Support(own.contacts, mass=own.mass, center_of_mass=own.center_of_mass, gravity=size * axis))
        for axis in np.eye(3)
    ]
    weights = np.stack([loads[0] - loads[2], loads[1] - loads[2]], axis=1)  # (N, 2, 6)
    # A moment is the sum of c_k (e_k x force) over the coordinates c_k of the centre.
    levers = np.cross(np.eye(3)[:, None, None], weights[..., :3]).transpose(1, 2, 3, 0)
    moments = weights[..., 3:].reshape(-1, 6, 1)
    return own.center_of_mass + (np.linalg.pinv(levers.reshape(-1, 6, 3)) @ moments)[..., 0]
