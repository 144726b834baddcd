"""Electric power, joint torques and base wrench at the nodes of a motion, with two derivatives."""

from __future__ import annotations

from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.compiled import compiled
from ocptip.standing.instants import NodeColumns
from ocptip.standing.mechanism import StandingMechanism


class NodePhysics:
    """Quantities y = (power; torques (n); wrench (6); further (k)) of a robot over s = (q, qd, qdd) (3 n).

    Of a robot with a process that varies s has this process's present value, too: (3 n + 6).

    Power is the sum over the joints, W; torques in N m; the wrench acts on the base about its centre of mass,
    its weight included, N and N m; further quantities: see `StandingMechanism`. Where a drive's power jumps
    with the direction of motion, one more input says how: the direction itself (+1 or -1 per joint), or in
    the smooth form a speed r (rad/s): the jump is then spread over speeds from -r to r.

    The power of a motor depends on its own torque and speed alone: its derivatives are joined to those of the
    dynamics here, which keeps CasADi's expressions a third as long.

    Args:
        robot: on its support. Where the motors' speeds are functions of the state, the last n of the further
            quantities, a coordinate's direction says nothing about the motors': then there is the smooth
            form only.
        smooth: in the smooth form.

    Attributes:
        columns: of y.
        smooth: in the smooth form.
    """

    def __init__(self, robot: StandingMechanism, smooth: bool = False) -> None:
        self.robot, self.smooth = robot, smooth or not robot.direct_drives
        n = self.n = robot.n
        self._size = 3 * n + 6 * (robot.varying is not None)
        self.columns = NodeColumns(n, robot.further_limits.count)
        self._s = cs.SX.sym("s", self._size)
        q, qd, qdd, *process = cs.vertsplit(self._s, sorted({0, n, 2 * n, 3 * n, self._size}))
        loads = robot.load_expressions(q, qd, qdd, *process)
        self._z = cs.vertcat(*loads, robot.further_expressions(q, qd))
        self._speeds = -1 if robot.direct_drives else self._z.numel() - n  # where they stand in z
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
        z = self._values.in_columns(s.T)
        return np.ascontiguousarray(np.vstack([self._powers(s, z, direction)[:1], z]).T)

    def jacobian(self, s: np.ndarray, direction: np.ndarray) -> NodeJacobian:
        """y and its first derivatives, and what the second ones need."""
        found = self._jacobian.in_columns(s.T)
        count = self._z.numel()
        power = self._powers(s, found[:count], direction)
        y, slope = np.empty((len(s), 1 + count)), np.empty((len(s), 1 + count, self._size))
        _join(found, power, self.n, self._speeds, y, slope)
        return NodeJacobian(s, y, slope, power[1:])

    def _powers(self, s: np.ndarray, z: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Power and its derivatives over the motors' torques and speeds, (1 + 5 n, N)."""
        n = self.n
        speeds = s[:, n : 2 * n].T if self._speeds < 0 else z[self._speeds :]
        return self._power.in_columns(np.vstack([z[:n], speeds, direction.T]))

    def hessian(self, at: NodeJacobian, weights: np.ndarray) -> np.ndarray:
        """Second derivative (N, 3 n, 3 n) of the sum of weights (N, 7 + n + k) times y."""
        inputs = np.empty((self._size + self._z.numel(), len(at.s)))
        _weigh(at.s, weights, at.of_power, self.n, self._speeds, inputs)
        result = np.empty((len(at.s), self._size, self._size))
        _bend(self._hessian.in_columns(inputs), at.slope, at.of_power, weights, self.n, self._speeds, result)
        return result


class NodeJacobian:
    """Values y and slopes (N, 7 + n + k, 3 n) at s (N, 3 n), with the power's own derivatives (5 n, N).

    Those are over torques and speeds, then twice over torques, over both, and twice over speeds.
    """

    def __init__(self, s: np.ndarray, y: np.ndarray, slope: np.ndarray, of_power: np.ndarray) -> None:
        self.s, self.y, self.slope, self.of_power = s, y, slope, of_power

    def at(self, nodes: np.ndarray) -> NodeJacobian:
        """The same of some nodes only."""
        return NodeJacobian(self.s[nodes], self.y[nodes], self.slope[nodes], self.of_power[:, nodes])


@compiled
def _join(found, power, n, speeds, y, slope):
    """Put z, its slopes and the power's into y (N, 1 + m) and slope (N, 1 + m, 3 n or more)."""
    N, rows, columns = slope.shape
    m = rows - 1
    for i in range(N):
        y[i, 0] = power[0, i]
        for k in range(m):
            y[i, 1 + k] = found[k, i]
        for c in range(columns):
            first, total = m + c * m, 0.0
            for k in range(m):
                slope[i, 1 + k, c] = found[first + k, i]
            for j in range(n):
                total += power[1 + j, i] * slope[i, 1 + j, c]
            if speeds >= 0:
                for j in range(n):
                    total += power[1 + n + j, i] * slope[i, 1 + speeds + j, c]
            elif n <= c < 2 * n:
                total += power[1 + c, i]
            slope[i, 0, c] = total


@compiled
def _weigh(s, weights, of_power, n, speeds, inputs):
    """Put states, and the weights of z with the power's part, into inputs (3 n + m, N)."""
    N, columns = s.shape
    m = weights.shape[1] - 1
    for i in range(N):
        for c in range(columns):
            inputs[c, i] = s[i, c]
        for k in range(m):
            inputs[columns + k, i] = weights[i, 1 + k]
        for j in range(n):
            inputs[columns + j, i] += weights[i, 0] * of_power[j, i]
            if speeds >= 0:
                inputs[columns + speeds + j, i] += weights[i, 0] * of_power[n + j, i]


@compiled
def _bend(inner, slope, of_power, weights, n, speeds, result):
    """Put inner second derivatives (9 n^2, N), and what the power's own add, into result (N, 3 n, 3 n)."""
    N, size, _ = result.shape
    for i in range(N):
        H, on = result[i], weights[i, 0]
        for c in range(size):
            for r in range(size):
                H[r, c] = inner[c * size + r, i]
        if on == 0.0:
            continue
        for j in range(n):
            torque = slope[i, 1 + j]
            twice, mixed = on * of_power[2 * n + j, i], on * of_power[3 * n + j, i]
            bent = on * of_power[4 * n + j, i]
            for r in range(size):
                across = twice * torque[r]
                for c in range(size):
                    H[r, c] += across * torque[c]
            if speeds < 0:
                for r in range(size):
                    H[n + j, r] += mixed * torque[r]
                    H[r, n + j] += mixed * torque[r]
                H[n + j, n + j] += bent
            else:
                speed = slope[i, 1 + speeds + j]
                for r in range(size):
                    for c in range(size):
                        H[r, c] += mixed * (torque[r] * speed[c] + speed[r] * torque[c])
                        H[r, c] += bent * speed[r] * speed[c]
