"""Electric power, joint torques and base wrench at the nodes of a motion, with two derivatives."""

from __future__ import annotations

from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from ocptip.motion.planner.profile_kernels import place
from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.jit.compiled import compiled, compiled_in_any_order
from ocptip.standing.instants import NodeColumns
from ocptip.standing.mechanism import StandingMechanism


class _NodeLoads:
    """The quantities but for the power, z, as functions of s; the power is the one that has a smooth form."""

    def __init__(self, robot: StandingMechanism) -> None:
        n = robot.n
        self.size = 3 * n + robot.acts.size
        self.columns = NodeColumns(n, robot.further_limits.count, len(robot.interfaces))
        self._s = cs.SX.sym("s", self.size)
        q, qd, qdd, *process = cs.vertsplit(self._s, sorted({0, n, 2 * n, 3 * n, self.size}))
        loads = robot.load_expressions(q, qd, qdd, *process)
        further, objects = robot.further_expressions(q, qd), robot.object_expressions(q, qd, qdd, *process)
        self._z = cs.vertcat(*loads, further, *objects)
        self.count = self._z.numel()
        self.values = _batch("values", [self._s], [self._z])
        self.jacobian = _batch("jacobian", [self._s], [self._z, cs.jacobian(self._z, self._s)])

    @cached_property
    def hessian(self) -> BatchFunction:
        """Of s and weights of z: the upper half of the second derivatives of their product."""
        weights = cs.SX.sym("weights", self.count)
        hessian, _ = cs.hessian(cs.dot(weights, self._z), self._s)
        upper = [hessian[r, c] for c in range(self.size) for r in range(c + 1)]
        return _batch("hessian", [self._s, weights], [cs.vertcat(*upper)])


@lru_cache(maxsize=16)
def _loads_of(robot: StandingMechanism) -> _NodeLoads:
    """Built once: all programs of a robot, and both forms of the power, have the same."""
    return _NodeLoads(robot)


def _batch(name: str, arguments: list[cs.SX], out: list[cs.SX]) -> BatchFunction:
    return BatchFunction(cs.Function(name, arguments, out))


class NodePhysics:
    """Quantities y = (power; torques (n); wrench (6); further (k); wrenches on objects (6 each)) of a robot.

    They are functions of s = (q, qd, qdd) (3 n). Where something acts on the robot, s also has its present
    values, see `standing.acting`: (3 n + k).

    Power is the sum over the joints, W; torques in N m; the wrench acts on the base about its centre of mass,
    its weight included, N and N m; further quantities: see `StandingMechanism`. Where a drive's power has a
    step at zero speed, one more input is needed: the direction of motion itself (+1 or -1 per joint), or in
    the smooth form a speed r (rad/s): the step is then spread over speeds from -r to r.

    The power of a motor depends on the torque and speed of this motor alone: its derivatives are joined to
    those of the dynamics here, which keeps CasADi's expressions a third as long.

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
        self._loads = _loads_of(robot)
        n, self.columns = robot.n, self._loads.columns
        self.n, self._size = n, self._loads.size
        self._speeds = (
            -1 if robot.direct_drives else self.columns.further.stop - 1 - n
        )  # where they stand in z
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
        return _batch("power", [torque, speed, direction], [total, *slopes, *bends])

    def values(self, s: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """y (N, 7 + n + k) at s (3 n, N) and directions or rounding speeds (n, N)."""
        z = self._loads.values.in_columns(s)
        return np.ascontiguousarray(np.vstack([self._powers(s, z, direction)[:1], z]).T)

    def jacobian(self, s: np.ndarray, direction: np.ndarray) -> NodeJacobian:
        """y and its first derivatives, and what the second ones need."""
        result = self._loads.jacobian.in_columns(s)
        count = self._loads.count
        power = self._powers(s, result[:count], direction)
        y, slope = _join(result, power, self.n, self._size, self._speeds)
        return NodeJacobian(s, y, result[count:], slope, power[1:])

    def _powers(self, s: np.ndarray, z: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Power and its derivatives over the motors' torques and speeds, (1 + 5 n, N)."""
        n = self.n
        speeds = s[n : 2 * n] if self._speeds < 0 else z[self._speeds :]
        return self._power.in_columns(np.concatenate([z[:n], speeds, direction]))

    def hessian(self, node_jacobian: NodeJacobian, weights: np.ndarray) -> NodeHessian:
        """Derivatives of the sum of weights (N, 7 + n + k) times y."""
        inputs = _weigh(node_jacobian.s, weights, node_jacobian.of_power, self.n, self._speeds)
        upper, slopes = self._loads.hessian.in_columns(inputs), np.empty(node_jacobian.s.shape)
        _bend(
            upper,
            slopes,
            node_jacobian.slopes,
            node_jacobian.of_power,
            inputs,
            weights[:, 0].copy(),
            self.n,
            self._speeds,
        )
        return NodeHessian(node_jacobian, upper, slopes)


class NodeJacobian:
    """Values y (N, 1 + m) and slopes at s (S, N).

    Attributes:
        slopes: (S m, N) of y but for power, state after state.
        power: (S, N), slopes of the power.
        of_power: (5 n, N), derivatives of the power over torques and speeds, then twice over torques, over
            both, and twice over speeds.
    """

    def __init__(
        self, s: np.ndarray, y: np.ndarray, slopes: np.ndarray, power: np.ndarray, of_power: np.ndarray
    ) -> None:
        self.s, self.y, self.slopes, self.power, self.of_power = s, y, slopes, power, of_power

    def over_states(self, nodes: np.ndarray, first: int | np.ndarray, on: np.ndarray) -> np.ndarray:
        """Slopes (R, S) over the states of functions at nodes (R,) with slopes on (R, k) over columns of y.

        Args:
            first: of the columns, not that of the power; one number or (R,).
        """
        assert np.all(first > 0), "the power has separate slopes"
        first = np.full(len(nodes), 1) * (first - 1)
        contiguous = np.ascontiguousarray
        return _over_states(contiguous(nodes), first, contiguous(on), self.slopes, self.y.shape[1] - 1)


class NodeHessian:
    """Second derivatives over the states of a sum of functions of each node, that others can be added to.

    Attributes:
        upper: (S (S + 1) / 2, N) upper halves of the second derivatives, column below column.
        slopes: (S, N) the first ones.
    """

    def __init__(self, node_jacobian: NodeJacobian, upper: np.ndarray, slopes: np.ndarray) -> None:
        self._at, self.upper, self.slopes = node_jacobian, upper, slopes

    def add(self, nodes: np.ndarray, bends: np.ndarray) -> None:
        """Add second derivatives (R, k, k) at nodes (R,) over the first k states."""
        assert bends.shape[1] <= len(self.slopes)
        _add_bends(self.upper, np.ascontiguousarray(nodes), np.ascontiguousarray(bends))

    def add_over_quantities(self, nodes: np.ndarray, first: int, bends: np.ndarray) -> None:
        """Add second derivatives (R, k, k) at nodes (R,) over k columns of y from the first on."""
        assert first > 0, "the power has separate slopes"
        contiguous, states = np.ascontiguousarray, self._at
        own_bends, m = contiguous(bends), states.y.shape[1] - 1
        _add_bends_over_quantities(self.upper, contiguous(nodes), first - 1, own_bends, states.slopes, m)


@compiled_in_any_order
def _join(result, power, n, size, speeds):
    """y (N, 1 + m), and the slopes (S, N) of the power, of z with its slopes (m + S m, N)."""
    N = result.shape[1]
    m = len(result) // (1 + size)
    y, slope = np.empty((N, 1 + m)), np.zeros((size, N))
    for i in range(N):
        y[i, 0] = power[0, i]
        for k in range(m):
            y[i, 1 + k] = result[k, i]
    for c in range(size):
        for j in range(n):
            row = m + c * m + j
            for i in range(N):
                slope[c, i] += power[1 + j, i] * result[row, i]
        if speeds >= 0:
            for j in range(n):
                row = m + c * m + speeds + j
                for i in range(N):
                    slope[c, i] += power[1 + n + j, i] * result[row, i]
        elif n <= c < 2 * n:
            for i in range(N):
                slope[c, i] += power[1 + c, i]
    return y, slope


@compiled
def _over_states(nodes, first, on, slopes, m):
    """See `NodeJacobian.over_states`; first is counted without the power."""
    count, k = on.shape
    size = len(slopes) // m
    values = np.zeros((count, size))
    for r in range(count):
        i = nodes[r]
        for c in range(size):
            row = c * m + first[r]
            for j in range(k):
                values[r, c] += on[r, j] * slopes[row + j, i]
    return values


@compiled
def _add_bends(upper, nodes, bends):
    for r in range(len(nodes)):
        i = nodes[r]
        for c in range(bends.shape[1]):
            for k in range(c + 1):
                upper[place(k, c), i] += bends[r, k, c]


@compiled
def _add_bends_over_quantities(upper, nodes, first, bends, slopes, m):
    size, k = len(slopes) // m, bends.shape[1]
    bent = np.empty(k)
    for r in range(len(nodes)):
        i = nodes[r]
        for c in range(size):
            column = c * m + first
            for a in range(k):
                bent[a] = 0.0
                for b in range(k):
                    bent[a] += bends[r, a, b] * slopes[column + b, i]
            for other in range(c + 1):
                row = other * m + first
                for a in range(k):
                    upper[place(other, c), i] += slopes[row + a, i] * bent[a]


@compiled
def _weigh(s, weights, of_power, n, speeds):
    """States, and the weights of z with the power's part: (S + m, N)."""
    size, N = s.shape
    m = weights.shape[1] - 1
    inputs = np.empty((size + m, N))
    for c in range(size):
        for i in range(N):
            inputs[c, i] = s[c, i]
    for k in range(m):
        for i in range(N):
            inputs[size + k, i] = weights[i, 1 + k]
    for j in range(n):
        for i in range(N):
            inputs[size + j, i] += weights[i, 0] * of_power[j, i]
        if speeds >= 0:
            for i in range(N):
                inputs[size + speeds + j, i] += weights[i, 0] * of_power[n + j, i]
    return inputs


@compiled_in_any_order
def _bend(upper, on_s, slopes, of_power, inputs, on_power, n, speeds):
    """Add the second derivatives of the power to upper; put the sum's slopes into on_s (S, N)."""
    size, N = on_s.shape
    m = len(inputs) - size
    for c in range(size):
        for i in range(N):
            on_s[c, i] = 0.0
        for k in range(m):
            for i in range(N):
                on_s[c, i] += inputs[size + k, i] * slopes[c * m + k, i]
    if speeds < 0:
        for j in range(n):
            for i in range(N):
                on_s[n + j, i] += on_power[i] * of_power[n + j, i]
    bent, speed = np.empty((n, N)), np.empty((n, N))
    for c in range(size):
        for j in range(n):
            torque = slopes[c * m + j]
            for i in range(N):
                bent[j, i] = on_power[i] * of_power[2 * n + j, i] * torque[i]
            if speeds < 0:
                row, twice = place(c, n + j), 2.0 if c == n + j else 1.0
                for i in range(N):
                    upper[row, i] += twice * on_power[i] * of_power[3 * n + j, i] * torque[i]
                if c == n + j:
                    for i in range(N):
                        upper[row, i] += on_power[i] * of_power[4 * n + j, i]
            else:
                of = slopes[c * m + speeds + j]
                for i in range(N):
                    bent[j, i] += on_power[i] * of_power[3 * n + j, i] * of[i]
                for i in range(N):
                    speed[j, i] = on_power[i] * of_power[3 * n + j, i] * torque[i]
                for i in range(N):
                    speed[j, i] += on_power[i] * of_power[4 * n + j, i] * of[i]
        for r in range(c + 1):
            row = place(r, c)
            for j in range(n):
                other = r * m + j
                for i in range(N):
                    upper[row, i] += bent[j, i] * slopes[other, i]
            if speeds >= 0:
                for j in range(n):
                    other = r * m + speeds + j
                    for i in range(N):
                        upper[row, i] += speed[j, i] * slopes[other, i]
