"""What stands on contacts and may carry objects that only contacts hold."""

from __future__ import annotations

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.robots.base_motion import BaseMotion, inertial_wrench_of
from ocptip.robots.model import ArmModel
from ocptip.standing.acting import Acting
from ocptip.standing.footing import Footing
from ocptip.standing.objects import CarriedObject, Object, carrier_expressions, carrier_motions


class Carrier(Footing):
    """A base on its contacts, and the interfaces of what it carries.

    Attributes:
        objects: as given.
        carried: the objects in the axes of what carries them.
    """

    objects: tuple[Object, ...] = ()
    carried: tuple[CarriedObject, ...] = ()

    @property
    def arm(self) -> ArmModel | None:
        """The serial arm; None where the mechanism is no arm."""
        return None

    @property
    def acts(self) -> Acting:
        """What acts on it besides its motion: a process that varies, a base that drives."""
        return Acting()

    @property
    def interfaces(self) -> tuple[Footing, ...]:
        """What only contacts hold: the base on the ground, then each object on what it stands on."""
        return (self, *(held.footing for held in self.carried))

    def object_wrenches(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, base_motion: BaseMotion | None = None
    ) -> tuple[np.ndarray, ...]:
        """Wrenches (N, 6) on the objects, weight included, in the order of `interfaces`.

        About the centre of mass of what stands on the contacts, in axes of the gripper or the base.
        """
        if not self.carried or self.arm is None:
            return ()
        motions = carrier_motions(self.arm, self.support.gravity, q, qd, qdd, base_motion)
        return tuple(motions[held.carrier].inertial_wrench(held.footing.support) for held in self.carried)

    def object_expressions(
        self, q: cs.SX, qd: cs.SX, qdd: cs.SX, acting: cs.SX | None = None
    ) -> tuple[cs.SX, ...]:
        """The wrenches on the objects as CasADi columns (6,); `acting` as in `load_expressions`."""
        if not self.carried or self.arm is None:
            return ()
        base = self.acts.expressions(acting)[1]
        motions = carrier_expressions(self.arm, self.support.gravity, q, qd, qdd, base)
        return tuple(inertial_wrench_of(motions[held.carrier], held.footing.support) for held in self.carried)

    def require_no_objects(self, what: str) -> None:
        """Raise InputError if it carries objects, which `what` does not take."""
        if names := ", ".join(interface.name for interface in self.interfaces[1:]):
            raise InputError(
                f"object: {what} does not take objects ({names}): it knows the contacts of the base alone; "
                "stand, check, certify, plan, retime, drive, simulate and view do; held fast they are payload"
            )
