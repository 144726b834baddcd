"""All indices of an arm in one pose: values, bounds, units, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import SingularityDistance
from ocptip.indices.arms.operation import OperationIndices
from ocptip.indices.arms.values import ArmEvaluation, checked_names, six_or_more
from ocptip.indices.meanings import ARM, IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.robots.model import ArmModel


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
