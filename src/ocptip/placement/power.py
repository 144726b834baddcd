"""The cost of standing still (4.20): electric holding power of the drives, or of torque amounts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.motors import Motors


class HoldingPower:
    """Electric power at standstill as a smooth function of the torques.

    Power maps have a step at zero speed, where friction changes its sign, and leave open which side holds at
    rest. Taken is the mean of both, so that the cost of a torque does not depend on its sign.

    Args:
        motors: of the joints.
        clamps: W, drawn by actuators of clamps, all the time.
    """

    unit = "W"
    cost = np.empty(0)  # it is no sum of torque amounts

    def __init__(self, motors: Motors, clamps: float = 0.0) -> None:
        self.motors, self.clamps = motors, clamps

    def values(self, torques: np.ndarray) -> np.ndarray:
        """Power (N,), W, at torques (N, n), N m."""
        still, up = np.zeros_like(torques), np.ones_like(torques)
        power = self.motors.power(torques, still, up) + self.motors.power(torques, still, -up)
        return np.sum(power, axis=1) / 2 + self.clamps

    def derivatives(self, joints: int) -> BatchFunction:
        """Function of torques (n,): power, its gradient (n,) and the diagonal of its Hessian (n,)."""
        torque, still = cs.SX.sym("torque", joints), cs.SX.zeros(joints)
        up, down = (self.motors.power_expression(torque, still, [e] * joints) for e in (1.0, -1.0))
        power = cs.sum1(up + down) / 2 + self.clamps
        slope = cs.gradient(power, torque)
        bend = cs.diag(cs.jacobian(slope, torque))
        return BatchFunction(cs.Function("power", [torque], [power, slope, bend]))


class TorqueCost:
    """Weighted sum of torque amounts, as in the planar example (4.41).

    Args:
        cost: (n,), per N m, >= 0.
    """

    unit = ""

    def __init__(self, cost: Sequence[float]) -> None:
        self.cost = finite_array("cost", cost, (None,))
        if (self.cost < 0).any():
            raise InputError(f"cost: must be >= 0, got {self.cost}")

    def values(self, torques: np.ndarray) -> np.ndarray:
        """Cost (N,) at torques (N, n), N m."""
        return np.abs(torques) @ self.cost

    @cached_property
    def joints(self) -> np.ndarray:
        """Numbers of the joints that cost something."""
        return np.flatnonzero(self.cost > 0)
