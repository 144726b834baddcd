"""Joint motions as functions of the optimisation variables, with first and second derivatives.

Variables x, per optimised joint: signed cruise speeds w_1 .. w_K (rad/s), ramp durations d_1 .. d_K and the
brake duration d_{K+1} (s), cruise durations c_1 .. c_K (s); then the end t_E (s), a constant 1 (so that
affine expressions are linear in x) and the zero crossings of speeds (s). A joint's acceleration is a sum of
steps alpha_k at its corner times tau_k, so that

    acceleration = sum alpha_k phi0(t - tau_k),  speed = sum alpha_k phi1,  angle = start + sum alpha_k phi2

with phi0 the unit step and phi1, phi2 its integrals. The steps alpha depend on speeds and durations, the
times tau on durations only, node times t are linear in x: all derivatives follow by hand. A smoothed step
makes the motion a smooth function of x whatever the order of the corners (see `SmoothStep`); with
the order fixed the step is the exact one (`phi0` a mask of zeros and ones).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


class Layout:
    """Where the variables of `joints` optimised joints with `commands` ramp commands stand in x.

    Args:
        n: joints of the arm.
        joints: optimised joints, 0-based.
        commands: K, ramp commands of each.
        crossings: number of zero-crossing variables at the end of x.
    """

    def __init__(self, n: int, joints: tuple[int, ...], commands: int, crossings: int = 0) -> None:
        self.n, self.joints, self.commands, self.crossings = n, joints, commands, crossings
        K = commands
        self.per_joint = 3 * K + 1
        self.end = self.per_joint * len(joints)
        self.one = self.end + 1
        self.size = self.end + 2 + crossings

    def w(self, j: int) -> slice:
        """Speeds of the j-th optimised joint."""
        return slice(j * self.per_joint, j * self.per_joint + self.commands)

    def d(self, j: int) -> slice:
        """Its ramp durations, the brake's last."""
        start = j * self.per_joint + self.commands
        return slice(start, start + self.commands + 1)

    def c(self, j: int) -> slice:
        """Its cruise durations."""
        start = j * self.per_joint + 2 * self.commands + 1
        return slice(start, start + self.commands)

    def extended(self, crossings: int) -> Layout:
        """The same with another number of crossings."""
        return Layout(self.n, self.joints, self.commands, crossings)


@dataclass(frozen=True, eq=False)
class Corners:
    """Steps and times of all joints' corners at one x; C corners per joint, unused ones with step 0.

    Attributes:
        steps, times: (n, C), rad/s^2 and s.
        d_steps, d_times: (n, C, nx).
        ramps: (joints optimised, K + 1) accelerations of the ramps, for second derivatives.
        passive: (n, 2) second derivatives of acceleration and of t' with respect to t_E.
    """

    steps: np.ndarray
    times: np.ndarray
    d_steps: np.ndarray
    d_times: np.ndarray
    ramps: np.ndarray
    passive: np.ndarray


class Profiles:
    """Corner times and steps of all joints as functions of x.

    Args:
        layout: of x.
        start, goal: (n,), rad.
        speed_limits: (n,), rad/s; those of the passive joints are what their ramps aim at.
        rounding: s; width of the rounded transition of passive joints from triangle to trapezoid, 0 for
            the exact rule.
    """

    def __init__(
        self,
        layout: Layout,
        start: np.ndarray,
        goal: np.ndarray,
        speed_limits: np.ndarray,
        rounding: float = 0.0,
    ) -> None:
        self.layout, self.start, self.way = layout, start, goal - start
        self.speed_limits, self.rounding = speed_limits, rounding
        n, K, nx = layout.n, layout.commands, layout.size
        self.corners = 2 * K + 2 if layout.joints else 4
        self.corners = max(self.corners, 4)
        self._constant_d_times = np.zeros((n, self.corners, nx))
        for j, joint in enumerate(layout.joints):
            row = np.zeros(nx)
            d, c = range(nx)[layout.d(j)], range(nx)[layout.c(j)]
            for k in range(2 * K + 2):
                self._constant_d_times[joint, k] = row
                if k < 2 * K + 1:
                    row[d[k // 2] if k % 2 == 0 else c[k // 2]] = 1.0
        self.passive_joints = [
            joint for joint in range(n) if joint not in layout.joints and abs(self.way[joint]) > 0
        ]

    def corner_time(self, joint: int, k: int) -> np.ndarray:
        """Time of a corner of an optimised joint as a row (nx,) times x."""
        return self._constant_d_times[joint, k].copy()

    def regime(self, end: float) -> dict[int, bool]:
        """Whether each moving passive joint's ramp is a trapezoid (else a triangle) at this t_E."""
        return {
            joint: bool(abs(self.way[joint]) > 0.5 * self.speed_limits[joint] * end)
            for joint in self.passive_joints
        }

    def __call__(self, x: np.ndarray, regime: dict[int, bool] | None = None) -> Corners:
        """Corners at x ((nx,)); passive joints in the given regime, in the one that fits t_E by default."""
        layout = self.layout
        n, K, nx, C = layout.n, layout.commands, layout.size, self.corners
        steps, times = np.zeros((n, C)), np.zeros((n, C))
        d_steps, d_times = np.zeros((n, C, nx)), self._constant_d_times.copy()
        ramps = np.zeros((len(layout.joints), K + 1))
        for j, joint in enumerate(layout.joints):
            w, d = x[layout.w(j)], x[layout.d(j)]
            iw, idd = layout.w(j).start, layout.d(j).start
            a = np.diff(w, prepend=0.0, append=0.0) / d
            ramps[j] = a
            steps[joint, : 2 * K + 2 : 2], steps[joint, 1 : 2 * K + 2 : 2] = a, -a
            times[joint, : 2 * K + 2] = self._constant_d_times[joint, : 2 * K + 2] @ x
            for k in range(K + 1):
                row = np.zeros(nx)
                if k < K:
                    row[iw + k] = 1.0 / d[k]
                if k > 0:
                    row[iw + k - 1] = -1.0 / d[k]
                row[idd + k] = -a[k] / d[k]
                d_steps[joint, 2 * k], d_steps[joint, 2 * k + 1] = row, -row
        end = x[layout.end]
        regime = self.regime(end) if regime is None else regime
        second = np.zeros((n, 2))
        for joint in self.passive_joints:
            p, p1, p2 = self._ramp_end(joint, end, regime)
            way = self.way[joint]
            g, g1 = p * (end - p), p1 * (end - p) + p * (1 - p1)
            g2 = p2 * (end - p) + 2 * p1 * (1 - p1) - p * p2
            a, a1 = way / g, -way * g1 / g**2
            second[joint] = way * (2 * g1**2 / g**3 - g2 / g**2), p2
            sign = np.array([1.0, -1.0, -1.0, 1.0])
            steps[joint, :4], times[joint, :4] = a * sign, [0.0, p, end - p, end]
            d_steps[joint, :4, layout.end] = a1 * sign
            d_times[joint, :4, layout.end] = [0.0, p1, 1 - p1, 1.0]
        return Corners(steps, times, d_steps, d_times, ramps, second)

    def _ramp_end(self, joint: int, end: float, regime: dict[int, bool]) -> tuple[float, float, float]:
        """t' of a passive joint and its first two derivatives with respect to t_E: (5.16), (5.17)."""
        cruise = abs(self.way[joint]) / self.speed_limits[joint]
        if self.rounding == 0:
            return (end - cruise, 1.0, 0.0) if regime[joint] else (end / 2, 0.5, 0.0)
        u, v, r = end / 2, end - cruise, self.rounding
        root = np.sqrt((u - v) ** 2 + r**2)
        slope = -0.5 * (u - v) / root
        return (u + v - root) / 2, (1.5 - slope) / 2, -0.5 * 0.25 * r**2 / root**3

    def second(
        self, hessian: np.ndarray, corners: Corners, x: np.ndarray, on_steps: np.ndarray, on_times: np.ndarray
    ) -> None:
        """Add sum of on_steps * (second derivative of steps) + on_times * (that of times), both (n, C)."""
        layout = self.layout
        K = layout.commands
        for j, joint in enumerate(layout.joints):
            d, a = x[layout.d(j)], corners.ramps[j]
            iw, idd = layout.w(j).start, layout.d(j).start
            weight = on_steps[joint, : 2 * K + 2 : 2] - on_steps[joint, 1 : 2 * K + 2 : 2]
            for k in range(K + 1):
                cross = weight[k] / d[k] ** 2
                if k < K:
                    hessian[iw + k, idd + k] -= cross
                    hessian[idd + k, iw + k] -= cross
                if k > 0:
                    hessian[iw + k - 1, idd + k] += cross
                    hessian[idd + k, iw + k - 1] += cross
                hessian[idd + k, idd + k] += 2 * a[k] * cross
        e = layout.end
        for joint in self.passive_joints:
            a2, p2 = corners.passive[joint]
            s, t = on_steps[joint], on_times[joint]
            hessian[e, e] += a2 * (s[0] - s[1] - s[2] + s[3]) + p2 * (t[1] - t[2])


class SmoothStep:
    """A unit step spread over [-half_width, half_width], twice continuously differentiable.

    Evaluates (phi', phi0, phi1, phi2) at times t - tau and phi'' for second derivatives. Behind the step
    phi1 is exactly t - tau, so that a motion of steps that add to zero ends exactly where the sharp one does.
    """

    def __init__(self, half_width: float) -> None:
        self.half_width = half_width

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return phi2, phi1, phi0, phi', phi'' at t."""
        e = self.half_width
        u = np.clip((t + e) / (2 * e), 0.0, 1.0)
        over = np.maximum(t - e, 0.0)
        v = 1 - u
        phi0 = u**3 * (10 - 15 * u + 6 * u * u)
        phi1 = 2 * e * u**4 * (2.5 - 3 * u + u * u) + over
        phi2 = 4 * e * e * u**5 * (0.5 - 0.5 * u + u * u / 7) + over * (0.5 * over + e)
        slope = 30 * u * u * v * v / (2 * e)
        bend = 60 * u * v * (v - u) / (4 * e * e)
        return phi2, phi1, phi0, slope, bend


@dataclass(frozen=True, eq=False)
class NodeStates:
    """Joint states at N nodes and their derivatives with respect to x.

    Attributes:
        values: (N, 3 n): angles, speeds, accelerations.
        jacobian: (N, 3 n, nx).
    """

    values: np.ndarray
    jacobian: np.ndarray
    _steps: tuple[np.ndarray, ...]
    _corners: Corners


class Nodes:
    """Nodes at times linear in x.

    Args:
        profiles: the joints' motion.
        times: (N, nx): node times are times @ x.
        masks: (N, n, C) of 0 and 1, which corners have passed at each node; None with a smooth step.
        step: the smooth step.
        regime: of the passive joints, see `Profiles`.
    """

    def __init__(
        self,
        profiles: Profiles,
        times: np.ndarray,
        *,
        masks: np.ndarray | None = None,
        step: SmoothStep | None = None,
        regime: dict[int, bool] | None = None,
    ) -> None:
        self.profiles, self.times, self.masks, self.step, self.regime = profiles, times, masks, step, regime

    def states(self, x: np.ndarray) -> NodeStates:
        """States of all joints at all nodes."""
        profiles = self.profiles
        corners = profiles(x, self.regime)
        since = (self.times @ x)[:, None, None] - corners.times  # (N, n, C)
        if self.masks is not None:
            phi0 = self.masks
            phi1 = since * phi0
            phi2 = 0.5 * since * phi1
            slope = bend = None
        else:
            phi2, phi1, phi0, slope, bend = self.step(since)
        alpha = corners.steps
        values = np.concatenate([np.einsum("ijk,jk->ij", phi, alpha) for phi in (phi2, phi1, phi0)], axis=1)
        n = profiles.layout.n
        values[:, :n] += profiles.start
        # d/dx = phi d_alpha + alpha phi' (d_t - d_tau)
        parts = []
        for phi, rate in ((phi2, phi1), (phi1, phi0), (phi0, slope)):
            own = np.matmul(phi.transpose(1, 0, 2), corners.d_steps)  # (n, N, nx)
            if rate is not None:
                weighted = (rate * alpha).transpose(1, 0, 2)
                own -= np.matmul(weighted, corners.d_times)
                own += weighted.sum(axis=2)[:, :, None] * self.times
            parts.append(own.transpose(1, 0, 2))
        return NodeStates(values, np.concatenate(parts, axis=1), (phi2, phi1, phi0, slope, bend), corners)

    def second(self, hessian: np.ndarray, x: np.ndarray, states: NodeStates, weights: np.ndarray) -> None:
        """Add sum over nodes and states of weights ((N, 3 n)) times the states' second derivatives."""
        n = self.profiles.layout.n
        corners = states._corners
        phi2, phi1, phi0, slope, bend = states._steps
        on_q, on_w, on_a = (weights[:, k * n : (k + 1) * n, None] for k in range(3))
        alpha = corners.steps
        on_steps = on_q * phi2 + on_w * phi1 + on_a * phi0
        cross = on_q * phi1 + on_w * phi0  # d alpha with d(t - tau)
        twice = on_q * phi0
        if slope is not None:
            cross = cross + on_a * slope
            twice = twice + on_w * slope + on_a * bend
        on_times = -alpha * cross
        self.profiles.second(hessian, corners, x, on_steps.sum(axis=0), on_times.sum(axis=0))
        twice = twice * alpha
        T, d_tau, d_alpha = self.times, corners.d_times, corners.d_steps
        both = T.T @ (twice.sum(axis=(1, 2))[:, None] * T)
        N = len(T)
        flat_tau, flat_alpha = d_tau.reshape(-1, d_tau.shape[-1]), d_alpha.reshape(-1, d_alpha.shape[-1])
        mixed = (T.T @ twice.reshape(N, -1)) @ flat_tau
        both -= mixed + mixed.T
        both += flat_tau.T @ (twice.sum(axis=0).reshape(-1, 1) * flat_tau)
        mixed = (T.T @ cross.reshape(N, -1)) @ flat_alpha
        mixed -= flat_tau.T @ (cross.sum(axis=0).reshape(-1, 1) * flat_alpha)
        hessian += both + mixed + mixed.T
