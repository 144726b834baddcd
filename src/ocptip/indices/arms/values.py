"""All indices of an arm in many poses at once.

Each is computed only when it is asked for; what several of them need is computed once.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import ArmPose, arm_pose
from ocptip.indices.arms.distance import (
    INNER,
    SingularityDistance,
    singularity_distance,
    stationary_curvatures,
    stationary_motion_angle,
)
from ocptip.indices.arms.operation import OperationIndices, operation_indices
from ocptip.indices.meanings import ARM
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.reviewed import inv_cdn, inv_cdn_cl, inv_cdn_points, manipulability
from ocptip.robots.model import ArmModel

DEFAULT_ELLIPSOID = OperationEllipsoid.sphere(0.1)
"""Taken if no ellipsoid is given: a sphere of 0.1 m about the gripper point."""

SIX_AXES = "defined for six axes only"

ARM_INDICES = tuple(ARM)
"""Names of all indices of an arm, as in `index_values` and `ArmRating`; sigma rates a motion."""


def index_values(
    model: ArmModel,
    q: np.ndarray,
    *,
    ellipsoid: OperationEllipsoid | None = None,
    rates: np.ndarray | None = None,
    names: Iterable[str] | None = None,
) -> dict[str, np.ndarray]:
    """Indices of an arm in many poses.

    Args:
        model: arm of n >= 6 axes.
        q: (N, n) or (n,), rad.
        ellipsoid: operation ellipsoid in the gripper frame; default: `DEFAULT_ELLIPSOID`.
        rates: (N, n) or (n,) joint rates for sigma; None: no sigma.
        names: of `ARM_INDICES`; default: all.

    Returns:
        For every name (N,), or a number for a single pose; NaN where an index is not defined: see
        `ArmRating`, which says why.

    Raises:
        InputError: fewer than six axes, unknown name, wrong shape or not finite.
    """
    wanted = checked_names(names, rates)
    return Evaluation(model, arm_pose(six_or_more(model), q), ellipsoid, rates).values(wanted)


class Evaluation:
    """The indices of poses, for :func:`index_values` and `rate_arm`.

    Arguments as for `index_values`, but the poses as `ArmPose`.
    """

    def __init__(
        self,
        model: ArmModel,
        pose: ArmPose,
        ellipsoid: OperationEllipsoid | None,
        rates: np.ndarray | None,
    ) -> None:
        self.model, self.pose = model, pose
        self.ellipsoid = DEFAULT_ELLIPSOID if ellipsoid is None else ellipsoid
        self.rates = rates

    def values(self, names: Iterable[str]) -> dict[str, np.ndarray]:
        """(N,) or a number for every name."""
        return {name: getattr(self, f"_{name}")() for name in names}

    def status(self, name: str, value: float) -> str:
        """ "ok", or what is special about an index of a single pose."""
        if self.model.n != 6 and name.startswith(("pi_", "dm_", "sigma")):
            return SIX_AXES
        if name.endswith("_weighted") and np.isnan(value):
            return "the arm has no masses" if self.pose.inertias is None else self._lacking(name)
        if name == "sigma":
            return self._sigma_status(value)
        if name.startswith("dm_"):
            return "ok" if self.distance.status == "regular" else str(self.distance.status)
        return "singular" if value == 0.0 else "ok"

    @cached_property
    def distance(self) -> SingularityDistance:
        """Behind DM, its weighted forms and sigma."""
        if self.pose.inertias is None or not self._movable(INNER).any():
            return singularity_distance(self.pose.jacobian)
        inertias = np.where(self._movable(INNER)[..., None], self.pose.inertias, 1.0)
        return singularity_distance(self.pose.jacobian, inertias=inertias)

    @cached_property
    def operation(self) -> OperationIndices:
        """Behind PI_OE and CDN_OE."""
        return operation_indices(self.pose.jacobian, self.ellipsoid, self.pose.rotation, self.pose.position)

    @cached_property
    def _weighted_operation(self) -> OperationIndices | None:
        if self.pose.inertias is None:
            return None
        return operation_indices(
            self.pose.jacobian,
            self.ellipsoid,
            self.pose.rotation,
            self.pose.position,
            inertias=np.where(self._movable(slice(None))[..., None], self.pose.inertias, 1.0),
        )

    @cached_property
    def _center(self) -> np.ndarray:
        return self.pose.rotation @ self.ellipsoid.center + self.pose.position

    def _movable(self, joints: slice) -> np.ndarray:
        return (self.pose.inertias[..., joints] > 0).all(axis=-1)

    def _undefined(self) -> np.ndarray:
        return np.full(self.pose.jacobian.shape[:-2], np.nan)[()]

    def _lacking(self, name: str) -> str:
        joints = range(1, 5) if name.startswith("dm_") else range(self.model.n)
        without = [str(k + 1) for k in joints if self.pose.inertias[k] <= 0]
        return f"axis {', '.join(without)} moves no inertia: mass of the tool or of rotors is missing"

    def _sigma_status(self, value: float) -> str:
        if self.distance.singular:
            return "not defined in a singular pose"
        if np.isnan(value):
            return "not defined: joints 2 to 5 rest"
        return "stationary: along the most negative curvature" if self.distance.stationary else "ok"

    def _pi_oe(self) -> np.ndarray:
        return self.operation.pi_oe

    def _inv_cdn_oe(self) -> np.ndarray:
        return self.operation.inv_cdn_oe

    def _dm_inf(self) -> np.ndarray:
        return self.distance.dm_inf if self.model.n == 6 else self._undefined()

    def _dm_2(self) -> np.ndarray:
        return self.distance.dm_2 if self.model.n == 6 else self._undefined()

    def _manipulability(self) -> np.ndarray:
        if self.model.n == 6:
            return np.abs(self.distance.determinant)
        return manipulability(self.pose.jacobian)

    def _inv_cdn(self) -> np.ndarray:
        return inv_cdn(self.pose.jacobian)

    def _inv_cdn_cl(self) -> np.ndarray:
        return inv_cdn_cl(self.pose.jacobian, self._center, self.ellipsoid.characteristic_length)

    def _inv_cdn_points(self) -> np.ndarray:
        half_axes = (self.ellipsoid.axes * self.ellipsoid.half_axes).T
        tips = half_axes @ np.swapaxes(self.pose.rotation, -1, -2) + self._center[..., None, :]
        return inv_cdn_points(self.pose.jacobian, tips)

    def _pi_oe_weighted(self) -> np.ndarray:
        if self._weighted_operation is None:
            return self._undefined()
        return np.where(self._movable(slice(None)), self._weighted_operation.pi_oe, np.nan)[()]

    def _inv_cdn_oe_weighted(self) -> np.ndarray:
        if self._weighted_operation is None:
            return self._undefined()
        return np.where(self._movable(slice(None)), self._weighted_operation.inv_cdn_oe, np.nan)[()]

    def _dm_inf_weighted(self) -> np.ndarray:
        if self.model.n != 6 or self.distance.energy_inf is None:
            return self._undefined()
        return np.where(self._movable(INNER), self.distance.energy_inf, np.nan)[()]

    def _dm_2_weighted(self) -> np.ndarray:
        if self.model.n != 6 or self.distance.energy_2 is None:
            return self._undefined()
        return np.where(self._movable(INNER), self.distance.energy_2, np.nan)[()]

    def _sigma(self) -> np.ndarray:
        if self.model.n != 6:
            return self._undefined()
        angle = np.array(self.distance.motion_angle(self.rates))
        rates = np.broadcast_to(self.rates, (*angle.shape, 6))
        flat = self.distance.stationary & ~self.distance.singular & rates[..., INNER].any(axis=-1)
        for place in zip(*np.nonzero(np.atleast_1d(flat)), strict=True):
            at = place if angle.ndim else ()
            curvatures = stationary_curvatures(self.pose.jacobian[at])
            angle[at] = stationary_motion_angle(curvatures, rates[at])
        return angle[()]


def six_or_more(model: ArmModel) -> ArmModel:
    """Return the arm, or raise InputError if it has fewer than six axes."""
    if model.n < 6:
        raise InputError(f"arm: {model.name} has {model.n} axes; the indices need six or more")
    return model


def checked_names(names: Iterable[str] | None, rates: np.ndarray | None) -> tuple[str, ...]:
    """Return the names of indices asked for (None: all that can be), or raise InputError."""
    if names is None:
        return tuple(name for name in ARM_INDICES if name != "sigma" or rates is not None)
    chosen = (names,) if isinstance(names, str) else tuple(names)
    for name in chosen:
        if name not in ARM_INDICES:
            raise InputError(f"names: no index {name!r}; there are {', '.join(ARM_INDICES)}")
    if "sigma" in chosen and rates is None:
        raise InputError("names: sigma needs rates")
    return chosen
