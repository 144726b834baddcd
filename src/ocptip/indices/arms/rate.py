"""All indices of an arm in one pose: values, bounds, units, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import SingularityDistance
from ocptip.indices.arms.operation import OperationIndices
from ocptip.indices.arms.values import Evaluation, checked_names, six_or_more
from ocptip.indices.entry import IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.robots.model import ArmModel

_RATIO = (0.0, 1.0, "1")
_INDICES = {
    "pi_oe": (
        "PI_OE",
        *_RATIO,
        "slowest motion of the operation ellipsoid at unit joint rates, relative to turning axis 6; "
        "0 singular, 1 nothing is slower than axis 6",
    ),
    "inv_cdn_oe": (
        "1/CDN_OE",
        *_RATIO,
        "slowest over fastest motion of the operation ellipsoid at unit joint rates; 0 singular, 1 isotropic",
    ),
    "dm_inf": (
        "DM_inf",
        0.0,
        np.inf,
        "rad",
        "angle by which joints 2 to 5 would all have to turn to reach a singularity (linearised); "
        "independent of the tool",
    ),
    "dm_2": (
        "DM_2",
        0.0,
        np.inf,
        "rad",
        "shortest way of joints 2 to 5 to a singularity, root of summed squares (linearised); independent of "
        "the tool",
    ),
    "manipulability": (
        "MPB",
        0.0,
        np.inf,
        "m^3",
        "|det J|; 0 singular; grows with the cube of the arm's size, so compare poses of one arm only",
    ),
    "inv_cdn": (
        "1/CDN",
        *_RATIO,
        "inverse condition number of the Jacobian in metres about the base origin; changes with unit and "
        "frame",
    ),
    "inv_cdn_cl": (
        "1/CDN_CL",
        *_RATIO,
        "inverse condition number about the centre of the ellipsoid, lengths divided by its characteristic "
        "length",
    ),
    "inv_cdn_points": (
        "1/CDN_3P",
        *_RATIO,
        "inverse condition number of the velocities of three points (the ends of the ellipsoid's half-axes); "
        "depends on their choice",
    ),
    "pi_oe_weighted": ("PI^G_OE", *_RATIO, "PI_OE at unit rotational energy instead of unit joint rates"),
    "inv_cdn_oe_weighted": (
        "1/CDN^G_OE",
        *_RATIO,
        "1/CDN_OE at unit rotational energy instead of unit joint rates",
    ),
    "dm_inf_weighted": (
        "DM^G_inf",
        0.0,
        np.inf,
        "J",
        "rotational energy that each of joints 2 to 5 needs to reach a singularity in one second "
        "(linearised)",
    ),
    "dm_2_weighted": (
        "DM^G_2",
        0.0,
        np.inf,
        "J",
        "smallest rotational energy of joints 2 to 5 to reach a singularity in one second (linearised)",
    ),
    "sigma": (
        "sigma",
        -np.pi / 2,
        np.pi / 2,
        "rad",
        "where the motion heads: -pi/2 straight to the singularity, 0 parallel to it, pi/2 straight away",
    ),
}


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
    evaluation = Evaluation(model, arm_pose(six_or_more(model), angles), ellipsoid, motion)
    names = checked_names(None, motion)
    values = evaluation.values(names)
    entries = tuple(
        IndexEntry(
            name,
            symbol,
            float(values[name]),
            lower,
            upper,
            unit,
            meaning,
            evaluation.status(name, values[name]),
        )
        for name, (symbol, lower, upper, unit, meaning) in ((name, _INDICES[name]) for name in names)
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
