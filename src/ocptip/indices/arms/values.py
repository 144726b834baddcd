"""All indices of an arm in many poses at once.

Each is computed only when it is asked for; what several of them need is computed once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.indices.arms.axes import ArmPose, arm_pose, require_turning
from ocptip.indices.arms.distance import (
    INNER,
    SingularityDistance,
    singularity_distance,
    stationary_curvatures,
    stationary_motion_angle,
)
from ocptip.indices.arms.operation import OperationIndices, operation_indices
from ocptip.indices.meanings import ARM, IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.reviewed import inv_cdn, inv_cdn_cl, inv_cdn_points, manipulability
from ocptip.robots.model import ArmModel

DEFAULT_ELLIPSOID = OperationEllipsoid.sphere(0.1)
"""Taken if no ellipsoid is given: a sphere of 0.1 m about the TCP."""

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
    return ArmEvaluation(model, arm_pose(six_or_more(model), q), ellipsoid, rates).values(wanted)


class ArmEvaluation:
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
        undefined = np.full(self.pose.jacobian.shape[:-2], np.nan)
        six = self.model.n == 6
        return {
            name: _VALUES[name](self) if six or name not in _OF_SIX_AXES else undefined[()] for name in names
        }

    def status(self, name: str, value: float) -> str:
        """ "ok", or what is special about an index of a single pose."""
        if self.model.n != 6 and name.startswith(("pi_", *_OF_SIX_AXES)):
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
        if not self._movable(INNER).any():
            return singularity_distance(self.pose.jacobian)
        return singularity_distance(self.pose.jacobian, inertias=self._inertias(INNER))

    @cached_property
    def operation(self) -> OperationIndices:
        """Behind PI_OE and CDN_OE."""
        return operation_indices(self.pose.jacobian, self.ellipsoid, self.pose.rotation, self.pose.position)

    @cached_property
    def _weighted_operation(self) -> OperationIndices:
        place = self.pose.rotation, self.pose.position
        return operation_indices(self.pose.jacobian, self.ellipsoid, *place, inertias=self._inertias(_ALL))

    @cached_property
    def _center(self) -> np.ndarray:
        return self.pose.rotation @ self.ellipsoid.center + self.pose.position

    def _movable(self, joints: slice) -> np.ndarray:
        if self.pose.inertias is None:
            return np.zeros(self.pose.jacobian.shape[:-2], dtype=bool)
        return np.asarray((self.pose.inertias[..., joints] > 0).all(axis=-1))

    def _inertias(self, joints: slice) -> np.ndarray:
        """(N, n), kg m^2; ones where one of the joints moves no inertia."""
        assert self.pose.inertias is not None
        return np.where(self._movable(joints)[..., None], self.pose.inertias, 1.0)

    def _lacking(self, name: str) -> str:
        joints = range(1, 5) if name.startswith("dm_") else range(self.model.n)
        inertias = self.pose.inertias
        without = [str(k + 1) for k in joints if inertias is None or inertias[k] <= 0]
        return f"axis {', '.join(without)} moves no inertia: mass of the tool or of rotors is missing"

    def _sigma_status(self, value: float) -> str:
        if self.distance.singular:
            return "not defined in a singular pose"
        if np.isnan(value):
            return "not defined: joints 2 to 5 rest"
        return "stationary: along the most negative curvature" if self.distance.stationary else "ok"

    def _inv_cdn_points(self) -> np.ndarray:
        half_axes = (self.ellipsoid.axes * self.ellipsoid.half_axes).T
        tips = half_axes @ np.swapaxes(self.pose.rotation, -1, -2) + self._center[..., None, :]
        return inv_cdn_points(self.pose.jacobian, tips)

    def _weighted(self, values: Callable[[], np.ndarray | None], joints: slice) -> np.ndarray:
        """NaN where one of the joints moves no inertia."""
        movable = self._movable(joints)
        weighted = values() if movable.any() else None
        return np.where(movable, np.nan if weighted is None else weighted, np.nan)[()]

    def _sigma(self) -> np.ndarray:
        angle = np.array(self.distance.motion_angle(self.rates))
        assert self.rates is not None  # see `checked_names`
        rates = np.broadcast_to(self.rates, (*angle.shape, 6))
        flat = self.distance.stationary & ~self.distance.singular & rates[..., INNER].any(axis=-1)
        for place in zip(*np.nonzero(np.atleast_1d(flat)), strict=True):
            location = place if angle.ndim else ()
            curvatures = stationary_curvatures(self.pose.jacobian[location])
            angle[location] = stationary_motion_angle(curvatures, rates[location])
        return angle[()]


_ALL = slice(None)
_OF_SIX_AXES = ("dm_inf", "dm_2", "dm_inf_weighted", "dm_2_weighted", "sigma")
_VALUES: dict[str, Callable[[ArmEvaluation], np.ndarray]] = {
    "pi_oe": lambda e: e.operation.pi_oe,
    "inv_cdn_oe": lambda e: e.operation.inv_cdn_oe,
    "dm_inf": lambda e: e.distance.dm_inf,
    "dm_2": lambda e: e.distance.dm_2,
    "manipulability": lambda e: (
        np.abs(e.distance.determinant) if e.model.n == 6 else manipulability(e.pose.jacobian)
    ),
    "inv_cdn": lambda e: inv_cdn(e.pose.jacobian),
    "inv_cdn_cl": lambda e: inv_cdn_cl(e.pose.jacobian, e._center, e.ellipsoid.characteristic_length),
    "inv_cdn_points": ArmEvaluation._inv_cdn_points,
    "pi_oe_weighted": lambda e: e._weighted(lambda: e._weighted_operation.pi_oe, _ALL),
    "inv_cdn_oe_weighted": lambda e: e._weighted(lambda: e._weighted_operation.inv_cdn_oe, _ALL),
    "dm_inf_weighted": lambda e: e._weighted(lambda: e.distance.energy_inf, INNER),
    "dm_2_weighted": lambda e: e._weighted(lambda: e.distance.energy_2, INNER),
    "sigma": ArmEvaluation._sigma,
}
"""The functions that compute the indices, by name."""


def six_or_more(model: ArmModel) -> ArmModel:
    """Return the arm, or raise InputError if it has fewer than six axes, or joints that slide."""
    require_turning(model)
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


@dataclass(frozen=True, eq=False)
class ArmRating:
    """All indices of an arm in one pose.

    Attributes:
        arm: name of the arm.
        q: (n,), rad.
        ellipsoid: operation ellipsoid in the gripper frame.
        entries: one per index.
        operation: eigenvalues and worst joint rates behind PI_OE and CDN_OE.
        distance: steps to the nearest singularity behind DM; None for more than six axes.
        rates: (n,) joint rates of sigma, or None.
    """

    arm: str
    q: np.ndarray
    ellipsoid: OperationEllipsoid
    entries: tuple[IndexEntry, ...]
    operation: OperationIndices
    distance: SingularityDistance | None
    rates: np.ndarray | None

    def __getitem__(self, name: str) -> IndexEntry:
        """The entry of that name.

        Raises:
            InputError: there is none.
        """
        for entry in self.entries:
            if entry.name == name:
                return entry
        raise InputError(f"index: no {name!r} here; there are {', '.join(e.name for e in self.entries)}")

    @property
    def singular(self) -> bool:
        """True if some joint rates leave the end-effector at rest."""
        return bool(self.operation.singular)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; infinity and NaN as None."""
        return {
            "robot": self.arm,
            "kind": "arm",
            "q": self.q.tolist(),
            "rates": None if self.rates is None else self.rates.tolist(),
            "singular": self.singular,
            "ellipsoid": self.ellipsoid.to_dict(),
            "indices": [entry.to_dict() for entry in self.entries],
            "operation": self.operation.to_dict(),
            "distance": None if self.distance is None else self.distance.to_dict(),
        }


def rate_arm(
    model: ArmModel,
    q: np.ndarray,
    *,
    ellipsoid: OperationEllipsoid | None = None,
    rates: np.ndarray | None = None,
) -> ArmRating:
    """All indices of an arm in a pose, with their meaning.

    Args and errors: as for `index_values`, for a single pose.
    """
    angles = finite_array("q", q, (model.n,))
    motion = None if rates is None else finite_array("rates", rates, (model.n,))
    evaluation = ArmEvaluation(model, arm_pose(six_or_more(model), angles), ellipsoid, motion)
    names = checked_names(None, motion)
    values = evaluation.values(names)
    entries = tuple(
        ARM[name].entry(name, value := float(values[name]), evaluation.status(name, value)) for name in names
    )
    return ArmRating(
        model.name,
        angles,
        evaluation.ellipsoid,
        entries,
        evaluation.operation,
        evaluation.distance if model.n == 6 else None,
        motion,
    )
