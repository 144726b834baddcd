"""Limits of stops by brakes (category 0): margins while every joint brakes by itself, see `stops.by_brakes`.

Checks cover whole stops. Rows of a program are those of the moment when the brakes close, where nearly all
stops are worst: what brakes do does not depend on the speed, and later fewer joints brake. The accelerations
of the arm then follow from the torques on the joints in motion, those at rest stay at rest. The check detects
what is worse later in a stop, and rows are tightened until nothing is. The moving joints, their directions
and the worst ends of the brakes' intervals are chosen at the start of a solve and kept during it. So rows are
smooth, with exact derivatives; only the curvature of GT over the wrench is left out.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import WHOLE, Sampled, StateLimit, TableLimit, Worst
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, closing_of, stops_of_motion


@dataclass(frozen=True, eq=False)
class BrakeRows(NodeRows):
    """Rows of stops: torques on the joints (rows, n), and weights of the wrench (rows, 6)."""

    torques: np.ndarray = field(default_factory=lambda: np.empty(0))
    weights: np.ndarray = field(default_factory=lambda: np.empty(0))


class BrakeLimit(StateLimit, TableLimit, ContactLimit):
    """One quantity during all stops by brakes."""

    words = "{} in stops by brakes", "{}_brakes"
    of_motion = False
    scenario = WHOLE
    table, largest_step, rows_first = "brakes", 0.05, True

    _fixed: np.ndarray | None = None  # (N, width, n) torques at the nodes of a program

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return asked.brakes is not None and isinstance(robot, Robot)

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        times, found = stops_of_motion(self._arm, at.motion, self._brakes)
        values = np.where(np.isfinite(found.rests), getattr(found, self.setting), np.inf)
        k = int(np.argmax(values))
        detail = f"a stop by brakes, worst {1e3 * found.after[k]:.3g} ms later"
        if not np.isfinite(found.rests[k]):
            detail = "brakes that close then do not bring the arm to rest"
        return [self.found(float(values[k]), float(times[k]), detail)]

    @cached_property
    def _arm(self) -> Robot:
        assert isinstance(self.robot, Robot)  # it was wanted
        return self.robot

    @cached_property
    def _brakes(self) -> Brakes:
        assert self.asked.brakes is not None
        return self.asked.brakes

    @cached_property
    def _check(self) -> BrakeCheck:
        return BrakeCheck(self._arm, self._brakes)

    # --- rows of a program --------------------------------------------------------------------------------

    def chosen(self, at: Instants) -> BrakeLimit:
        other = copy(self)
        other._fixed = self._torques(at.angles, at.speeds)
        return other

    def _torques(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, width, n) of the brakes on the joints, at which each row is worst; 0 for joints at rest."""
        return self.quantity.brake_torques(self._check, q, qd)

    def _badness(self, at: Instants, share: float) -> np.ndarray:
        closing = closing_of(self._arm)
        return self.quantity.brake_badness(self._check, closing, at.angles, at.speeds, share)

    def near(self, at: Instants, share: float) -> np.ndarray:
        return self.quantity.near_by_difference(self._badness(at, share), share)

    def use(self, at: Instants) -> np.ndarray:
        return self.quantity.use(self._badness(at, 1.0))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.quantity.bounds()

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        q, qd, _ = at.motion_states
        if self._fixed is not None:
            torques = self._fixed[i, k]
        else:
            nodes, place = np.unique(i, return_inverse=True)
            torques = self._torques(q[nodes], qd[nodes])[place, k]
        closing = closing_of(self._arm)
        wrenches, unit = closing.wrenches(q[i], qd[i], torques), self.quantity.unit
        values, weights, _ = self.quantity.rows(wrenches, np.arange(len(k)), k)
        weights = weights / unit
        slopes = closing.gradient(q[i], qd[i], torques, weights)
        return BrakeRows(at, i, k, values / unit, slopes, torques=torques, weights=weights)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(rows, BrakeRows)
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        q, qd, _ = (part[rows.nodes[some]] for part in rows.at.motion_states)
        weights = on[some, None] * rows.weights[some]
        return some, closing_of(self._arm).hessian(q, qd, rows.torques[some], weights)
