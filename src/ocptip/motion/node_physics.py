"""Electric power, joint torques and base wrench at the nodes of a motion, with two derivatives."""

from __future__ import annotations

from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.motion.robot import StandingRobot
from ocptip.robots import BatchFunction, inverse_dynamics


class NodePhysics:
    """Quantities y = (power; torques (n); wrench (6)) of a robot as functions of s = (q, qd, qdd) (3 n).

    Power is the sum over the joints, W; torques in N m; the wrench acts on the base about its centre of mass,
    its weight included, N and N m. Where a drive's power jumps with the direction of motion, a further input
    says how: the direction itself (+1 or -1 per joint), or in the smooth form a speed r (rad/s): the jump is
    then spread over speeds from -r to r.

    The power of a joint depends on its own torque and speed alone: its derivatives are joined to those of the
    dynamics here, which keeps CasADi's expressions a third as long.

    Args:
        robot: the arm on its support.
        smooth: in the smooth form.
    """

    def __init__(self, robot: StandingRobot, smooth: bool = False) -> None:
        self.robot, self.smooth = robot, smooth
        n = self.n = robot.arm.n
        self._s = cs.SX.sym("s", 3 * n)
        support = robot.support
        torque, wrench = inverse_dynamics(robot.arm)(
            *cs.vertsplit(self._s, n), support.gravity, [0, 0, 0], [0, 0, 0], support.center_of_mass
        )
        self._z = cs.vertcat(torque, wrench + support.weight)
        jacobian = cs.jacobian(self._z, self._s)
        self._values = self._batch("values", [self._s], [self._z])
        self._jacobian = self._batch("jacobian", [self._s], [self._z, jacobian])
        self._power = self._power_function()

    def _power_function(self) -> BatchFunction:
        """Power of all joints and its derivatives with respect to torques and speeds, (n,) each."""
        n = self.n
        torque, speed, direction = (cs.SX.sym(name, n) for name in ("torque", "speed", "direction"))
        if not self.smooth:
            power = self.robot.motors.power_expression(torque, speed, direction)
        else:
            u = cs.fmin(cs.fmax((1 + speed / direction) / 2, 0), 1)
            share = u**3 * (10 - 15 * u + 6 * u * u)
            forward, backward = (
                self.robot.motors.power_expression(torque, speed, [e] * n) for e in (1.0, -1.0)
            )
            power = share * forward + (1 - share) * backward
        total = cs.sum1(power)
        slopes = cs.gradient(total, torque), cs.gradient(total, speed)
        bends = [
            cs.diag(cs.jacobian(of, by))
            for of, by in ((slopes[0], torque), (slopes[0], speed), (slopes[1], speed))
        ]
        return self._batch("power", [torque, speed, direction], [total, *slopes, *bends])

    @staticmethod
    def _batch(name: str, arguments: list[cs.SX], out: list[cs.SX]) -> BatchFunction:
        return BatchFunction(cs.Function(name, arguments, out))

    @cached_property
    def _hessian(self) -> BatchFunction:
        weights = cs.SX.sym("weights", self._z.numel())
        hessian, _ = cs.hessian(cs.dot(weights, self._z), self._s)
        return self._batch("hessian", [self._s, weights], [hessian])

    def values(self, s: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """y (N, 7 + n) at s (N, 3 n) and directions or rounding speeds (N, n)."""
        n = self.n
        z = self._values(s)[0]
        power = self._power(z[:, :n], s[:, n : 2 * n], direction)[0]
        return np.concatenate([power, z], axis=1)

    def jacobian(self, s: np.ndarray, direction: np.ndarray) -> NodeJacobian:
        """y and its first derivatives, and what the second ones need."""
        n = self.n
        z, slope = self._jacobian(s)
        power, on_torque, on_speed, *bends = self._power(z[:, :n], s[:, n : 2 * n], direction)
        row = np.matmul(on_torque[:, None, :], slope[:, :n])
        row[:, 0, n : 2 * n] += on_speed
        return NodeJacobian(
            s, np.concatenate([power, z], axis=1), np.concatenate([row, slope], axis=1), on_torque, bends
        )

    def hessian(self, at: NodeJacobian, weights: np.ndarray) -> np.ndarray:
        """Second derivative (N, 3 n, 3 n) of the sum of weights (N, 7 + n) times y."""
        n = self.n
        on_power, inner = weights[:, :1], weights[:, 1:].copy()
        inner[:, :n] += on_power * at.on_torque
        result = self._hessian(at.s, inner)[0]
        slope = at.slope[:, 1 : 1 + n]
        twice, mixed, speeds = (on_power * bend for bend in at.bends)
        result = result + np.matmul(slope.transpose(0, 2, 1) * twice[:, None, :], slope)
        mixed = mixed[:, :, None] * slope  # (N, n speeds, 3 n)
        result[:, n : 2 * n] += mixed
        result[:, :, n : 2 * n] += mixed.transpose(0, 2, 1)
        joints = np.arange(n, 2 * n)
        result[:, joints, joints] += speeds
        return result


class NodeJacobian:
    """Values y (N, 7 + n) and slopes (N, 7 + n, 3 n) at s (N, 3 n), with the power's inner derivatives."""

    def __init__(
        self, s: np.ndarray, y: np.ndarray, slope: np.ndarray, on_torque: np.ndarray, bends: list[np.ndarray]
    ) -> None:
        self.s, self.y, self.slope, self.on_torque, self.bends = s, y, slope, on_torque, bends

    def at(self, nodes: np.ndarray) -> NodeJacobian:
        """The same of some nodes only."""
        return NodeJacobian(
            self.s[nodes],
            self.y[nodes],
            self.slope[nodes],
            self.on_torque[nodes],
            [bend[nodes] for bend in self.bends],
        )
