"""Limits of the contacts in the nominal motion: one quantity, at its instants and at nodes of programs."""

from __future__ import annotations

from itertools import product

import numpy as np

from ocptip.standing.instants import Instants, Loaded
from ocptip.standing.limit_kinds.limit import AskedLimit, InstantAt, WrenchLimit
from ocptip.standing.limit_kinds.quantities import SlipQuantity, TipOverQuantity
from ocptip.standing.limit_kinds.quantity import ContactQuantity
from ocptip.standing.limit_kinds.rows import NodeRows, RowNodes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism

OF_OBJECTS = 0.02
"""By how much limits of objects are tightened at once, at most."""


class ContactLimit(AskedLimit):
    """A quantity of the contacts in one scenario.

    Args:
        robot, asked, joints: see `Limit`.
        quantity: which.
        interface: of the robot's `interfaces`; 0: the base.

    Attributes:
        words: name and result in this scenario, to be filled with those of the quantity.
        after_steps: the number asked for is that of loads after acceleration steps.
        takes_objects: there is also one of each object.
        smooth: rows of objects may be of a smooth function.
    """

    of_contacts = True
    words = "{}", "{}"
    after_steps = takes_objects = False
    smooth = True

    def __init__(
        self,
        robot: StandingMechanism,
        asked: Limits,
        joints: tuple[int, ...],
        quantity: type[ContactQuantity],
        interface: int = 0,
    ) -> None:
        super().__init__(robot, asked, joints)
        self.name, self.result = self.words[0].format(quantity.name), self.words[1].format(quantity.symbol)
        self.setting, self.interface = self.setting_of(quantity), interface
        footing = robot.interfaces[interface]
        self.result = footing.result(self.result)
        if interface:
            self.name = f"{self.name} of {footing.name}"
            # Proofs share friction among the contacts by a rule, which needs up to 2 % more than the optimum.
            self.largest_step = max(self.largest_step, OF_OBJECTS)
        # Objects have many contacts, whose exact friction utilisation takes ten times as long.
        self.quantity = quantity(footing, self.number, smooth=self.smooth and interface > 0)

    @property
    def width(self) -> int:
        return self.quantity.width

    @classmethod
    def setting_of(cls, quantity: type[ContactQuantity]) -> str:
        """The field of the numbers asked for."""
        return quantity.at_steps if cls.after_steps else quantity.symbol

    @classmethod
    def of(cls, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> tuple[ContactLimit, ...]:
        interfaces = range(len(robot.interfaces) if cls.takes_objects else 1)
        pairs = product(interfaces, (TipOverQuantity, SlipQuantity))
        return tuple(cls(robot, asked, joints, quantity, interface) for interface, quantity in pairs)


class ContactRowsLimit(ContactLimit):
    """A quantity of the contacts with rows in programs, by how bad the loads of a node are."""

    def badness(self, instants: Instants, share: float) -> np.ndarray:
        """(N, width) of the loads in this scenario; exact above about `share` of the limit."""
        raise NotImplementedError(f"{self.name}: no rows")

    def uses(self, instants: Instants) -> np.ndarray:
        return self.quantity.uses(self.badness(instants, 1.0))

    def near(self, instants: Instants, share: float) -> np.ndarray:
        return self.quantity.near(self.badness(instants, share), share)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.quantity.bounds()


class NominalLimit(WrenchLimit, ContactRowsLimit):
    """A quantity of the contacts of the base or of an object, as the motion loads them."""

    takes_objects = True

    def _loads(self, instants: Instants) -> Loaded:
        """Of the interface."""
        return instants.interfaces[self.interface]

    @property
    def affine(self) -> bool:
        return self.quantity.affine

    @property
    def unit(self) -> float:
        return self.quantity.unit

    def measure(self, instants: Instants) -> np.ndarray:
        return self.quantity.measure(self._loads(instants))[:, None]

    def detail(self, instant_at: InstantAt, time: float) -> str:
        return self.quantity.detail(self._loads(instant_at(time)))

    def kept(self, instants: Instants) -> bool:
        return self.quantity.kept(self._loads(instants))

    def refusals(self, instants: Instants) -> list[str]:
        result = self.quantity.refusals(self._loads(instants))
        return [f"{self.quantity.footing.name}: {text}" for text in result] if self.interface else result

    def path_excess(self, instants: Instants) -> float:
        return self.quantity.path_excess(self._loads(instants))

    def half_spaces(self) -> np.ndarray | None:
        return self.quantity.half_spaces()

    def badness(self, instants: Instants, share: float) -> np.ndarray:
        return self.quantity.badness(self._loads(instants))

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        values, slopes, bends = self.quantity.rows(
            row_nodes.y[:, row_nodes.columns.wrenches[self.interface]], i, k
        )
        return NodeRows(row_nodes, i, k, values / self.unit, slopes, bends=bends)
