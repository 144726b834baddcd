"""Limits of stops by brakes (category 0): reserves while every joint brakes by itself, see `stops.by_brakes`.

Checks look at whole stops. Rows of a program are those of the moment when the brakes close, where nearly all
stops are worst: what brakes do does not depend on the speed, and later fewer joints brake. The arm's own
accelerations then follow from the torques on the joints in motion, those at rest stay at rest. What is worse
later in a stop is found by the check, and rows are tightened until none is. Which joints move, which way, and
which ends of the brakes' intervals are worst is taken where a solve begins and stays while it lasts, so that
rows are smooth, with exact derivatives (the curvature of GT over the wrench is left out).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.reserves.slip import known
from ocptip.robots.braking import Terms
from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import WHOLE, MomentLimit, Sampled, StateLimit, TableLimit, Worst
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_brakes import BrakeCheck, stops_of_motion

FAR = 0.5  # use of the slip limit where half spaces tell that it is kept


@dataclass(frozen=True, eq=False)
class BrakeRows(NodeRows):
    """Rows of stops: torques on the joints (rows, n), and weights of the wrench (rows, 6)."""

    torques: np.ndarray = field(default_factory=lambda: np.empty(0))
    weights: np.ndarray = field(default_factory=lambda: np.empty(0))


class BrakeLimit(StateLimit, TableLimit):
    """One reserve during all stops by brakes."""

    of_contacts, of_motion = True, False
    scenario = WHOLE
    table, largest_step, rows_first = "brakes", 0.05, True

    def __init__(self, robot: StandingMechanism, asked: MotionLimits, joints: tuple[int, ...]) -> None:
        assert isinstance(robot, Robot)
        super().__init__(robot, asked, joints)
        assert asked.brakes is not None
        self._arm, self._brakes = robot, asked.brakes
        self._check = BrakeCheck(robot, asked.brakes)
        self._fixed: np.ndarray | None = None  # (N, width, n) torques at the nodes of a program

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: MotionLimits) -> bool:
        return asked.brakes is not None and isinstance(robot, Robot)

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        times, found = stops_of_motion(self._arm, at.motion, self._brakes)
        values = np.where(np.isfinite(found.rests), getattr(found, self.setting), np.inf)
        k = int(np.argmax(values))
        detail = f"a stop by brakes, worst {1e3 * found.after[k]:.3g} ms later"
        if not np.isfinite(found.rests[k]):
            detail = "brakes that close then do not bring the arm to rest"
        return [self.found(float(values[k]), float(times[k]), detail)]

    # --- rows of a program --------------------------------------------------------------------------------

    def chosen(self, at: Instants) -> BrakeLimit:
        other = copy(self)
        other._fixed = self._torques(at.angles, at.speeds)
        return other

    def _torques(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, width, n) of the brakes on the joints, at which each row is worst; 0 for joints at rest."""
        raise NotImplementedError

    def _rows_of(self, wrenches: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (rows,) of rows `places` and slopes (rows, 6) over the wrench."""
        raise NotImplementedError

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        q, qd, _ = at.motion_states
        if self._fixed is not None:
            torques = self._fixed[i, k]
        else:
            nodes, place = np.unique(i, return_inverse=True)
            torques = self._torques(q[nodes], qd[nodes])[place, k]
        closing = closing_of(self._arm)
        values, weights = self._rows_of(closing.wrenches(q[i], qd[i], torques), k)
        slopes = closing.gradient(q[i], qd[i], torques, weights)
        return BrakeRows(at, i, k, values, slopes, torques=torques, weights=weights)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(rows, BrakeRows)
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        q, qd, _ = (part[rows.nodes[some]] for part in rows.at.motion_states)
        weights = on[some, None] * rows.weights[some]
        return some, closing_of(self._arm).hessian(q, qd, rows.torques[some], weights)


class BrakeTipLimit(BrakeLimit, MomentLimit):
    """Tip-over reserve; in programs the moments about the tipping axes."""

    name, quantity, setting = "tip-over in stops by brakes", "GN_brakes", "GN"

    def _torques(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        return self._check.worst_corners(q, qd)[1]

    def _rows_of(self, wrenches: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moments, slopes = self._map(wrenches)
        own = np.arange(len(places))
        return moments[own, places] / self.unit, slopes[own, places] / self.unit

    def moments(self, at: Instants) -> np.ndarray:
        return self._check.worst_corners(at.angles, at.speeds)[0]

    def near(self, at: Instants, share: float) -> np.ndarray:
        return self.moments(at) - self.least_moment <= (1 - share) * self.unit


class BrakeSlipLimit(BrakeLimit):
    """Slip reserve."""

    name, quantity, setting = "slip in stops by brakes", "GT_brakes", "GT"
    width = 1

    def _torques(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        wrenches, torques = self._check.combinations(q, qd)
        rows = self.robot.slip.half_spaces(self.number)
        if rows is None:
            return torques[:, :1]
        worst = np.argmax(np.max(wrenches @ rows.T, axis=2), axis=1)
        return torques[np.arange(len(q)), worst][:, None]

    def _rows_of(self, wrenches: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, slopes, _ = self.robot.slip.map(up_to=self.number)(wrenches)
        return values, slopes

    def near(self, at: Instants, share: float) -> np.ndarray:
        return self._use(at, share)[:, None] >= share

    def use(self, at: Instants) -> np.ndarray:
        return self._use(at, 1.0)

    def _use(self, at: Instants, share: float) -> np.ndarray:
        """(N,), exact above about `share`."""
        torques = self._torques(at.angles, at.speeds)[:, 0]
        wrenches = closing_of(self._arm).wrenches(at.angles, at.speeds, torques)
        rows = self.robot.slip.half_spaces(share * self.number)
        use = np.full(len(at), min(FAR, share / 2))
        todo = np.arange(len(at)) if rows is None else np.flatnonzero(np.max(wrenches @ rows.T, axis=1) > 0)
        if len(todo):
            states = self.robot.contact_states(wrenches[todo])
            use[todo] = known(self.robot.slip.evaluate(states, derivatives=False).GT) / self.number
        return use

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([-np.inf]), np.array([self.number])


@lru_cache(maxsize=8)
def closing_of(robot: Robot) -> Closing:
    """That of a robot, made once."""
    return Closing(robot)


class Closing:
    """The wrench on the base when brakes close, as a function of angles and speeds, with derivatives.

    With inverse dynamics T(q, qd, a) and wrench w(q, qd, a), a the accelerations at which T is what the
    brakes give on all joints that move (their torque is not zero), the slope of l . w(q, qd, a(q, qd)) is
    that of l . w - m . T at constant a and m, where m annuls the slope over a.

    Args:
        robot: the arm on its support.
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.n
        s, weights, forces = cs.SX.sym("s", 3 * n), cs.SX.sym("weights", 6), cs.SX.sym("forces", n)
        torque, wrench = robot.load_expressions(*cs.vertsplit(s, n))
        hessian, gradient = cs.hessian(cs.dot(weights, wrench) - cs.dot(forces, torque), s)
        arguments = [s, weights, forces]
        self._robot = robot
        self._gradient = BatchFunction(cs.Function("closing_slopes", arguments, [gradient]))
        self._second = BatchFunction(cs.Function("closing_bends", arguments, [hessian]))
        self._torque = BatchFunction(cs.Function("closing_torque", [s], [cs.jacobian(torque, s)]))

    def wrenches(self, q: np.ndarray, qd: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """(N, 6) with these torques (N, n) of the brakes on the joints."""
        found, _, a = self._accelerations(q, qd, torques)
        return found.rest + self._robot.support.weight + np.einsum("sij,sj->si", found.per_acceleration, a)

    def gradient(self, q: np.ndarray, qd: np.ndarray, torques: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Slopes (N, 3 n) of weights . wrench; zero over the motion's own accelerations."""
        s, forces, _ = self._at(q, qd, torques, weights)
        slopes = self._gradient(s, weights, forces)[0]
        slopes[:, 2 * self._robot.n :] = 0.0
        return slopes

    def hessian(self, q: np.ndarray, qd: np.ndarray, torques: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Curvature (N, 3 n, 3 n) of the same."""
        n = self._robot.n
        s, forces, inverse = self._at(q, qd, torques, weights)
        whole, torque = self._second(s, weights, forces)[0], self._torque(s)[0]
        turn = np.zeros((len(q), 3 * n, 3 * n))  # how s changes with angles and speeds
        turn[:, : 2 * n, : 2 * n] = np.eye(2 * n)
        turn[:, 2 * n :, : 2 * n] = -inverse @ torque[:, :, : 2 * n]
        return turn.transpose(0, 2, 1) @ whole @ turn

    def _at(
        self, q: np.ndarray, qd: np.ndarray, torques: np.ndarray, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (N, 3 n) with the accelerations, m (N, n), inverse inertia of the joints that move."""
        found, inverse, a = self._accelerations(q, qd, torques)
        forces = np.einsum("si,sij,sjk->sk", weights, found.per_acceleration, inverse)
        return np.hstack([q, qd, a]), forces, inverse

    def _accelerations(
        self, q: np.ndarray, qd: np.ndarray, torques: np.ndarray
    ) -> tuple[Terms, np.ndarray, np.ndarray]:
        found, inverse = BrakeCheck.response(self._robot, q, qd, torques != 0)
        return found, inverse, np.einsum("sij,sj->si", inverse, torques - found.bias)
