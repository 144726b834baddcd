"""Electric power, joint torques and base wrench at the nodes of a motion, with two derivatives."""

from __future__ import annotations

from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.standing.instants import NodeColumns
from ocptip.standing.mechanism import StandingMechanism


class NodePhysics:
    """Quantities y = (power; torques (n); wrench (6); further (k)) of a robot over s = (q, qd, qdd) (3 n).

    Power is the sum over the joints, W; torques in N m; the wrench acts on the base about its centre of mass,
    its weight included, N and N m; further quantities: see `StandingMechanism`. Where a drive's power jumps
    with the direction of motion, one more input says how: the direction itself (+1 or -1 per joint), or in
    the smooth form a speed r (rad/s): the jump is then spread over speeds from -r to r.

    The power of a motor depends on its own torque and speed alone: its derivatives are joined to those of the
    dynamics here, which keeps CasADi's expressions a third as long. In this class the motors' speeds are
    those of the joints; see :func:`node_physics` for robots in general.

    Args:
        robot: on its support.
        smooth: in the smooth form.

    Attributes:
        columns: of y.
    """

    def __init__(self, robot: StandingMechanism, smooth: bool = False) -> None:
        self.robot, self.smooth = robot, smooth
        n = self.n = robot.n
        self.columns = NodeColumns(n, robot.further_limits.count)
        self._s = cs.SX.sym("s", 3 * n)
        q, qd, qdd = cs.vertsplit(self._s, n)
        self._z = cs.vertcat(*robot.load_expressions(q, qd, qdd), robot.further_expressions(q, qd))
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
        """y (N, 7 + n + k) at s (N, 3 n) and directions or rounding speeds (N, n)."""
        n = self.n
        z = self._values(s)[0]
        power = self._power(z[:, :n], self._speeds(s, z), direction)[0]
        return np.concatenate([power, z], axis=1)

    def jacobian(self, s: np.ndarray, direction: np.ndarray) -> NodeJacobian:
        """y and its first derivatives, and what the second ones need."""
        n = self.n
        z, slope = self._jacobian(s)
        power, on_torque, on_speed, *bends = self._power(z[:, :n], self._speeds(s, z), direction)
        row = np.matmul(on_torque[:, None, :], slope[:, :n])
        self._add_speeds(row, on_speed, slope)
        y, slope = np.concatenate([power, z], axis=1), np.concatenate([row, slope], axis=1)
        return NodeJacobian(s, y, slope, on_torque, on_speed, bends)

    def _speeds(self, s: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Speeds of the motors (N, n)."""
        return s[:, self.n : 2 * self.n]

    def _add_speeds(self, row: np.ndarray, on_speed: np.ndarray, slope: np.ndarray) -> None:
        """Add the speeds' part to the slope of the power, (N, 1, 3 n)."""
        row[:, 0, self.n : 2 * self.n] += on_speed

    def hessian(self, at: NodeJacobian, weights: np.ndarray) -> np.ndarray:
        """Second derivative (N, 3 n, 3 n) of the sum of weights (N, 7 + n + k) times y."""
        n = self.n
        on_power, inner = weights[:, :1], weights[:, 1:].copy()
        inner[:, :n] += on_power * at.on_torque
        result = self._hessian(at.s, inner)[0]
        slope = at.slope[:, self.columns.torque]
        twice, mixed, speeds = (on_power * bend for bend in at.bends)
        result = result + np.matmul(slope.transpose(0, 2, 1) * twice[:, None, :], slope)
        mixed = mixed[:, :, None] * slope  # (N, n speeds, 3 n)
        result[:, n : 2 * n] += mixed
        result[:, :, n : 2 * n] += mixed.transpose(0, 2, 1)
        joints = np.arange(n, 2 * n)
        result[:, joints, joints] += speeds
        return result


class CoupledNodePhysics(NodePhysics):
    """The same where the motors' speeds are functions of the state: the last n of the further quantities.

    A coordinate's direction then says nothing about the motors': only the smooth form exists.
    """

    def __init__(self, robot: StandingMechanism) -> None:
        super().__init__(robot, smooth=True)

    def _speeds(self, s: np.ndarray, z: np.ndarray) -> np.ndarray:
        return z[:, -self.n :]

    def _add_speeds(self, row: np.ndarray, on_speed: np.ndarray, slope: np.ndarray) -> None:
        row += np.matmul(on_speed[:, None, :], slope[:, -self.n :])

    def hessian(self, at: NodeJacobian, weights: np.ndarray) -> np.ndarray:
        """Second derivative (N, 3 n, 3 n) of the sum of weights (N, 7 + n + k) times y."""
        n = self.n
        on_power, inner = weights[:, :1], weights[:, 1:].copy()
        inner[:, :n] += on_power * at.on_torque
        inner[:, -n:] += on_power * at.on_speed
        torque, speed = at.slope[:, self.columns.torque], at.slope[:, -n:]
        twice, mixed, speeds = ((on_power * bend)[:, :, None] for bend in at.bends)
        back = torque.transpose(0, 2, 1)
        cross = np.matmul(back, mixed * speed)
        result = self._hessian(at.s, inner)[0] + np.matmul(back, twice * torque)
        return result + np.matmul(speed.transpose(0, 2, 1), speeds * speed) + cross + cross.transpose(0, 2, 1)


def node_physics(robot: StandingMechanism, smooth: bool = False) -> NodePhysics:
    """Quantities at nodes; the smooth form if asked for, or where the motors are not the joints' own."""
    return NodePhysics(robot, smooth) if robot.direct_drives else CoupledNodePhysics(robot)


class NodeJacobian:
    """Values y and slopes (N, 7 + n + k, 3 n) at s (N, 3 n), with the power's inner derivatives."""

    def __init__(
        self,
        s: np.ndarray,
        y: np.ndarray,
        slope: np.ndarray,
        on_torque: np.ndarray,
        on_speed: np.ndarray,
        bends: list[np.ndarray],
    ) -> None:
        self.s, self.y, self.slope = s, y, slope
        self.on_torque, self.on_speed, self.bends = on_torque, on_speed, bends

    def at(self, nodes: np.ndarray) -> NodeJacobian:
        """The same of some nodes only."""
        return NodeJacobian(
            self.s[nodes],
            self.y[nodes],
            self.slope[nodes],
            self.on_torque[nodes],
            self.on_speed[nodes],
            [bend[nodes] for bend in self.bends],
        )
