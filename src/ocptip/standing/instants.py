"""A standing mechanism at some instants, as limits evaluate it; names of the columns of node quantities."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ocptip.contact.solver import ContactStates
from ocptip.reserves.slip import SlipReserve
from ocptip.reserves.tipping import TipOverReserve
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.footing import Footing
from ocptip.standing.mechanism import StandingMechanism


class NodeColumns:
    """Where the quantities y of a node stand: power, torques, wrench, further quantities, then objects.

    Args:
        n: number of torques.
        further: number of further quantities, see `FurtherLimits`.
        interfaces: number of the robot's `interfaces`.

    Attributes:
        wrenches: on the base and on each object.
    """

    power = 0

    def __init__(self, n: int, further: int, interfaces: int = 1) -> None:
        self.n = n
        self.torque, self.wrench = slice(1, 1 + n), slice(1 + n, 7 + n)
        self.further = slice(7 + n, 7 + n + further)
        ends = range(self.further.stop, self.further.stop + 6 * (interfaces - 1), 6)
        self.wrenches = (self.wrench, *(slice(end, end + 6) for end in ends))


class Loaded:
    """Wrenches on a base or an object; contact states and margins are computed when first asked for.

    Args:
        footing: what is on its contacts; a mechanism is one.
        wrenches: (N, 6) about its centre of mass, its weight included, N and N m.

    Attributes:
        memo: what limits compute of the instants for each other.
    """

    def __init__(self, footing: Footing, wrenches: np.ndarray) -> None:
        self.footing, self.wrenches = footing, wrenches
        self.memo: dict[object, Any] = {}

    @cached_property
    def states(self) -> ContactStates:
        """Contact states under the wrenches."""
        return self.footing.contact_states(self.wrenches)

    @cached_property
    def tip(self) -> TipOverReserve:
        """Tip-over indices."""
        return self.footing.tip_over.evaluate(self.states)

    @cached_property
    def slip(self) -> SlipReserve:
        """Friction utilisation, without derivatives."""
        return self.footing.slip.evaluate(self.states, derivatives=False)

    @cached_property
    def largest_slip(self) -> SlipReserve:
        """Friction utilisation, exact only where it is largest; elsewhere an upper bound, see
        `Slip.evaluate`.
        """
        if "slip" in vars(self):
            return self.slip
        return self.footing.slip.evaluate(self.states, derivatives=False, only_maximum=True)


class Instants(Loaded):
    """A mechanism at N instants; contact states, margins and distances are computed when first asked for.

    Args:
        robot: on its support.
        angles: (N, n), rad (straight coordinates: m).
        torques: (N, n), N m, or forces of linear motors, N.
        wrenches: (N, 6) on the base about its centre of mass, its weight included, N and N m.
        further: (N, k), of the robot's `FurtherLimits`.
        speeds, accelerations: (N, n), rad/s and rad/s^2 (m/s and m/s^2).
        process: (N, 6) of one that varies, else (N, 0).
        base_motion: of a base that drives.
        before: (N, n) accelerations before their steps within the delay of an uncertainty; None: not known.
    """

    def __init__(
        self,
        robot: StandingMechanism,
        angles: np.ndarray,
        torques: np.ndarray,
        wrenches: np.ndarray,
        further: np.ndarray,
        speeds: np.ndarray,
        accelerations: np.ndarray,
        process: np.ndarray | None = None,
        base_motion: BaseMotion | None = None,
        before: np.ndarray | None = None,
    ) -> None:
        super().__init__(robot, wrenches)
        self.process = np.empty((len(angles), 0)) if process is None else process
        self.robot, self.speeds, self.accelerations = robot, speeds, accelerations
        self.angles, self.torques, self.further = angles, torques, further
        self.base_motion, self.before = base_motion, before
        self._gaps: tuple[float, np.ndarray] | None = None

    @classmethod
    def of_states(
        cls,
        robot: StandingMechanism,
        q: np.ndarray,
        qd: np.ndarray,
        qdd: np.ndarray,
        times: np.ndarray | None = None,
        base_motion: BaseMotion | None = None,
    ) -> Instants:
        """At angles, speeds and accelerations, (N, n) each, and times (N,), s."""
        process = np.empty((len(q), 0)) if times is None else robot.acting(times)
        loads = robot.loads(q, qd, qdd, process if process.size else None, base_motion)
        return cls(robot, q, *loads, robot.further(q, qd), qd, qdd, process, base_motion)

    @classmethod
    def at_rest(cls, robot: StandingMechanism, q: np.ndarray, times: np.ndarray | None = None) -> Instants:
        """At angles (N, n) without motion, and times (N,), s."""
        still = np.zeros_like(q)
        return cls.of_states(robot, q, still, still, times)

    def __len__(self) -> int:
        """Number of instants."""
        return len(self.angles)

    def some(self, rows: np.ndarray) -> Instants:
        """Some of the instants."""
        parts = self.angles, self.torques, self.wrenches, self.further, self.speeds, self.accelerations
        before = None if self.before is None else self.before[rows]
        selected = (part[rows] for part in (*parts, self.process))
        moves = self.base_motion and self.base_motion.some(rows)
        return Instants(self.robot, *selected, base_motion=moves, before=before)

    @cached_property
    def interfaces(self) -> tuple[Loaded, ...]:
        """The base and each object under their wrenches, in the order of the robot's `interfaces`."""
        wrenches = self.robot.object_wrenches(
            *self.motion_states, self.base_motion or self.robot.acts.split(self.process)[1]
        )
        return (self, *map(Loaded, self.robot.interfaces[1:], wrenches))

    @property
    def motion_states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, speeds, accelerations, (N, n) each."""
        return self.angles, self.speeds, self.accelerations

    @property
    def s(self) -> np.ndarray:
        """(N, 3 n): angles, speeds, accelerations; what a process is that varies, 6 more."""
        return np.hstack([self.angles, self.speeds, self.accelerations, self.process])

    def gaps(self, below: float) -> np.ndarray:
        """Signed distances (N, m), m; those above `below` (m) may be lower bounds above it."""
        if self._gaps is None or self._gaps[0] < below:
            self._gaps = below, self.robot.collision.gaps(self.angles, below)
        return self._gaps[1]


def wrenches_on(
    robot: StandingMechanism,
    interface: int,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    acting: np.ndarray | None = None,
) -> np.ndarray:
    """Wrenches (N, 6) on one of the robot's `interfaces`, weight included, in states (N, n) each."""
    if not interface:
        return robot.loads(q, qd, qdd, acting)[1]
    return robot.object_wrenches(q, qd, qdd, robot.acts.split(acting)[1])[interface - 1]


def wrench_expression(
    robot: StandingMechanism, interface: int, q: cs.SX, qd: cs.SX, qdd: cs.SX, *acting: cs.SX
) -> cs.SX:
    """The same as a CasADi column (6,)."""
    if not interface:
        return robot.load_expressions(q, qd, qdd, *acting)[1]
    return robot.object_expressions(q, qd, qdd, *acting)[interface - 1]
