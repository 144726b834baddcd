"""Classical measures of tip-over stability, for comparison: they do not ask whether the contacts can hold.

All need ordinary contacts on one plane. [PR00] and [MA07] are in docs/bibliography.md.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.reserves.tipping import TipOver


@dataclass(frozen=True, eq=False)
class ClassicalMeasures:
    """Measures of N states; negative where the base tips over an edge of the support polygon.

    Attributes:
        zero_moment_point: (N,) m, distance of the zero-moment point from the nearest edge.
        static_angle: (N,) rad, smallest angle by which the load at the centre of mass of all bodies has to
            turn about an edge to pass through it. Of weight alone it is the tilt of the floor that tips it.
        static_angles: (N, A) the same about each edge, in the order of `TipOver.axes`.
        force_angle: (N,) rad N m, force-angle measure [PR00]: minimum of angle times lever arm times force.
        moment_height: (N,) kg^2 m^4/s^2 where positive, else 1/s^2: moment-height measure [MA07], minimum of
            tipping moment times moment of inertia of the base about the edge (divided by it where the moment
            is negative). The inertia of an arm is not included.
        load_transfer: (N, 2) difference of the normal forces on both sides of the polygon's centre over their
            sum, along x and y of the base: 1 where all load is on the side of positive coordinates. NaN
            without load.
    """

    zero_moment_point: np.ndarray
    static_angle: np.ndarray
    static_angles: np.ndarray
    force_angle: np.ndarray
    moment_height: np.ndarray
    load_transfer: np.ndarray

    @classmethod
    def under(
        cls,
        wrenches: np.ndarray,
        tip_over: TipOver,
        normal_forces: np.ndarray,
        centers: np.ndarray | None = None,
    ) -> ClassicalMeasures:
        """Measures under loads on a base.

        Args:
            wrenches: (N, 6), N and N m about the centre of mass of the base, base axes; weight included.
            tip_over: of the base.
            normal_forces: (N, n) N, of the contacts.
            centers: (N, 3), m, base axes: centre of mass of the base and what it carries, for the static
                angle; default: that of the base. The published force-angle measure takes the base's.

        Raises:
            InputError: contacts are not ordinary ones on one plane, or bound no area.
        """
        if not tip_over.on_polygon or tip_over.affine_moments is None:
            raise InputError(
                "classical measures: need ordinary contacts on one plane that bounds an area", ""
            )
        support, axes = tip_over.support, tip_over.axes
        directions = np.array([axis.direction for axis in axes])
        slope, offset = tip_over.affine_moments
        moments = wrenches @ slope.T + offset
        of_base = np.broadcast_to(support.center_of_mass, (len(wrenches), 3))
        angles, heights = _angles(wrenches, tip_over, of_base)
        static = angles if centers is None else _angles(wrenches, tip_over, centers)[0]
        angles, static = np.sign(moments) * angles, np.sign(moments) * static
        inertia = np.einsum("ad,de,ae->a", directions, support.inertia, directions)
        inertia = inertia + support.mass * heights[0] ** 2
        total = np.sum(normal_forces, axis=1)
        plane = support.frames[0, :, 0]
        return cls(
            zero_moment_point=np.min(moments, axis=1) / (-wrenches[:, :3] @ plane),
            static_angle=np.min(static, axis=1),
            static_angles=static,
            force_angle=np.min(angles * np.abs(moments), axis=1),  # lever arm times force is the moment
            moment_height=np.min(np.where(moments > 0, moments * inertia, moments / inertia), axis=1),
            load_transfer=_load_transfer(support.arms[:, :2], normal_forces, total),
        )

    def __getitem__(self, k: int) -> ClassicalMeasures:
        """Those of one state."""
        return ClassicalMeasures(**{name: values[k] for name, values in vars(self).items()})

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


def _angles(wrenches: np.ndarray, tip_over: TipOver, centers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles, rad, between loads at centres (N, 3) and perpendiculars to edges; their lengths, (N, A)."""
    directions = np.array([axis.direction for axis in tip_over.axes])
    forces = wrenches[:, None, :3]
    torques = wrenches[:, 3:] - np.cross(centers - tip_over.support.center_of_mass, wrenches[:, :3])
    # From the centre of mass perpendicularly to each edge.
    arms = np.array([axis.point for axis in tip_over.axes]) - centers[:, None]
    arms = arms - np.sum(arms * directions, axis=2, keepdims=True) * directions
    heights = np.linalg.norm(arms, axis=2, keepdims=True)
    # The part of the load that acts about the edge, as one force at the centre of mass.
    across = forces - np.sum(forces * directions, axis=2, keepdims=True) * directions
    about = np.sum(torques[:, None] * directions, axis=2, keepdims=True) * directions
    across = across + np.cross(arms / heights, about) / heights
    size = np.linalg.norm(across, axis=2)
    cosine = np.sum(across * arms / heights, axis=2) / np.where(size > 0, size, 1.0)
    return np.arccos(np.clip(cosine, -1.0, 1.0)), heights[..., 0]


def _load_transfer(places: np.ndarray, normal_forces: np.ndarray, total: np.ndarray) -> np.ndarray:
    """(N, 2), see `ClassicalMeasures`; contacts on the centre line belong to no side."""
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    sides = np.where(np.abs(places - middle) > 1e-9 * np.ptp(places), np.sign(places - middle), 0.0)
    return np.divide(
        normal_forces @ sides, total[:, None], out=np.full((len(total), 2), np.nan), where=total[:, None] > 0
    )
