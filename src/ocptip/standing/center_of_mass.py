"""The centre of mass of a base and all that it carries."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ocptip.contact.support import Support

if TYPE_CHECKING:
    from ocptip.standing.mechanism import StandingMechanism


def total_center_of_mass(robot: StandingMechanism, q: np.ndarray) -> np.ndarray:
    """Centre of mass of base, mechanism and payload, (N, 3), m, base axes, at joint values (N, n).

    It follows from the wrenches under gravity along three axes. What acts on the gripper cancels.
    """
    own, still = robot.support, np.zeros_like(q)
    size = float(np.linalg.norm(own.gravity)) or 1.0
    loads = []
    for axis in np.eye(3):
        turned = Support(own.contacts, mass=own.mass, center_of_mass=own.center_of_mass, gravity=size * axis)
        loads.append(robot.varied(support=turned).loads(q, still, still)[1])
    weights = np.stack([loads[0] - loads[2], loads[1] - loads[2]], axis=1)  # (N, 2, 6)
    # A moment is the sum of c_k (e_k x force) over the coordinates c_k of the centre.
    levers = np.cross(np.eye(3)[:, None, None], weights[..., :3]).transpose(1, 2, 3, 0)
    moments = weights[..., 3:].reshape(len(q), 6, 1)
    return own.center_of_mass + (np.linalg.pinv(levers.reshape(len(q), 6, 3)) @ moments)[..., 0]
