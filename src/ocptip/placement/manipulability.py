"""Distance from singular poses: Frobenius condition number (4.34, 4.35), ratio of singular values (4.37).

The first two come from the singular values of the gripper's geometric Jacobian, whose translational rows are
divided by a length. For arms of n != 6 joints the min(6, n) singular values count, which makes |J| |J^+| of
|J| |J^-1|. The third is a performance index of `ocptip.indices`.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ocptip.indices.arms.symbolic import index_function
from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.numerics.batch import BatchFunction
from ocptip.placement.problem import PlacementLimits
from ocptip.robots.kinematics import gripper_batch, gripper_kinematics
from ocptip.robots.model import ArmModel

MEASURES = ("condition", "singular_ratio")
_STEP = 1e-5  # rad; second derivatives are central differences of exact gradients
_SMALLEST = 1e-12
_POWER = 16  # of the smooth forms of PI_OE and CDN_OE: at most 6 and 11 % below the index


def measures(model: ArmModel, q: np.ndarray, length: float = 1.0) -> np.ndarray:
    """Condition number |J| |J^-1| and ratio of extreme singular values, (N, 2), at q (N, n), rad."""
    jacobian = gripper_batch(model)(q)[2].copy()
    jacobian[:, :3] /= length
    s = np.maximum(np.linalg.svd(jacobian, compute_uv=False), _SMALLEST)
    condition = np.sqrt(np.sum(s**2, axis=1) * np.sum(1 / s**2, axis=1))
    return np.column_stack([condition, s[:, 0] / s[:, -1]])


def limited(limits: PlacementLimits) -> dict[str, float]:
    """Limited measures with the upper bounds of what `LogMeasures` evaluates."""
    bounds = {name: np.log(most) for name in MEASURES if (most := getattr(limits, name)) is not None}
    if limits.index is not None and limits.index_min is not None:
        bounds[limits.index] = -np.log(limits.index_min)
    return bounds


def index_of(model: ArmModel, q: np.ndarray, limits: PlacementLimits) -> np.ndarray:
    """The limited performance index (N,) at q (N, n), rad."""
    assert limits.index is not None  # it is limited
    ellipsoid = OperationEllipsoid.sphere(limits.tool_radius)
    return index_values(model, q, ellipsoid=ellipsoid, names=[limits.index])[limits.index]


class LogMeasures:
    """Logarithms of the limited measures with two derivatives, for the nonlinear program.

    Upper bounds are wanted: of an index it is the negative logarithm of its amount.

    Args:
        model: the arm.
        limits: with at least one of the measures limited.
    """

    def __init__(self, model: ArmModel, limits: PlacementLimits) -> None:
        self.bounds, self.n = limited(limits), model.n
        q = cs.SX.sym("q", model.n)
        jacobian = gripper_kinematics(model)(q)[2]
        scaled = cs.vertcat(jacobian[:3, :] / limits.jacobian_length, jacobian[3:, :])
        flat = cs.vec(scaled)
        self._function = BatchFunction(cs.Function("J", [q], [flat, cs.jacobian(flat, q)]))
        if limits.index is not None:
            options = {}
            if limits.index in ("pi_oe", "inv_cdn_oe"):
                options = {"ellipsoid": OperationEllipsoid.sphere(limits.tool_radius), "p": _POWER}
            value = index_function(model, limits.index, **options)(q)
            amount = -0.5 * cs.log(value**2 + _SMALLEST**2)
            self._index = BatchFunction(cs.Function("index", [q], [amount, cs.jacobian(amount, q)]))

    def gradient(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (N, m) and gradients (N, m, n) at q (N, n)."""
        flat, slope = self._function(q)
        u, s, vt = np.linalg.svd(flat.reshape(len(q), self.n, 6).transpose(0, 2, 1), full_matrices=False)
        s = np.maximum(s, _SMALLEST)
        # d sigma_i = u_i' dJ v_i
        on_entries = (vt[:, :, :, None] * u.transpose(0, 2, 1)[:, :, None]).reshape(*s.shape, -1)
        slopes = on_entries @ slope
        values, gradients = [], []
        for name in self.bounds:
            if name == "condition":
                a, b = np.sum(s**2, axis=1), np.sum(s**-2, axis=1)
                values.append(0.5 * np.log(a * b))
                on = s / a[:, None] - s**-3 / b[:, None]
                gradients.append((on[:, None] @ slopes)[:, 0])
            elif name == "singular_ratio":
                values.append(np.log(s[:, 0] / s[:, -1]))
                gradients.append(slopes[:, 0] / s[:, :1] - slopes[:, -1] / s[:, -1:])
            else:
                value, slope_of_index = self._index(q)
                values.append(value[:, 0])
                gradients.append(slope_of_index[:, 0])
        return np.stack(values, axis=1), np.stack(gradients, axis=1)

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Second derivatives (N, n, n) of multipliers (N, m) . values at q (N, n)."""
        steps = _STEP * np.concatenate([np.eye(self.n), -np.eye(self.n)])
        slopes = self.gradient((q[:, None] + steps).reshape(-1, self.n))[1]
        slopes = multipliers[:, None, None] @ slopes.reshape(len(q), 2 * self.n, -1, self.n)
        forward, backward = slopes[:, : self.n, 0], slopes[:, self.n :, 0]
        result = (forward - backward) / (2 * _STEP)
        return (result + result.transpose(0, 2, 1)) / 2
