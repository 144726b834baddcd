"""What is raised in postures until a limit is reached: the payload, the tilt of the floor, a horizontal push.

Margins about tipping axes and from facets of the friction cone are affine in the payload and in the push, and
a cosine of the tilt. So each kind says where such a margin is zero, with all else as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from ocptip.robots.kinematics import gripper_batch
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.slope import MOST_TILT
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.deviations import Deviations
from ocptip.standing.within.torques import maximum_torques
from ocptip.standing.within.worst_case import WorstCase, WorstDeviations

_FLAT = 1e-300


@dataclass(frozen=True, eq=False)
class Broken:
    """Limits that are broken in k states at their levels.

    Attributes:
        deviations, s, worst: there.
        levels: (k,) that are too high.
        left: (k,) what is left of each limit, negative.
        per_level: (k,) what else it changes per level.
    """

    deviations: Deviations
    s: np.ndarray
    worst: WorstDeviations
    levels: np.ndarray
    left: np.ndarray
    per_level: np.ndarray


class Raised:
    """What is raised.

    Attributes:
        name, unit, scale: in words; what a value in SI units is multiplied by for the unit.
        title: what is charted, in words.
        convex: whether torques are convex in it.
        by_deviations: whether `raised` has all of it.
        reference_slope: N m per level: by how much the reference moment of the tip-over index grows.
        robot: whose limits count.
        arms: at level zero, and at level one as far as torques of motion depend on it.
        most: the largest level that is tried by default.
        replaces: what of the robot levels stand for, in words; empty: they come on top.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    scale: ClassVar[float] = 1.0
    convex: ClassVar[bool] = True
    by_deviations: ClassVar[bool] = True
    reference_slope: float = 0.0
    title: str
    most: float
    replaces: str = ""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.arms = robot, (robot.arm, robot.arm)

    def at(self, q: np.ndarray) -> Self:
        """The same in postures (N, n), which `rows` count from here on."""
        return self

    def counted(self, tolerance: Uncertainty) -> Uncertainty:
        """An uncertainty that has all deviations which this kind needs."""
        return tolerance

    def raised(self, cases: WorstCase, levels: np.ndarray) -> WorstCase:
        """The worst case of N states at their levels (N,)."""
        return cases

    def lost(self, rows: np.ndarray, a: np.ndarray) -> np.ndarray:
        """What functionals a of the wrench lose per level besides, at most; of postures by rows."""
        return np.zeros(1)

    def zero(self, broken: Broken) -> np.ndarray:
        """(k,) levels at which margins are zero with these deviations; -1: at none."""
        raise NotImplementedError

    def torques(
        self, tolerance: Uncertainty, rows: np.ndarray, s: np.ndarray, levels: np.ndarray
    ) -> np.ndarray:
        """(k, n) largest absolute torques in states (k, 3 n) of postures by rows, at their levels."""
        raise NotImplementedError

    def _torques(
        self,
        tolerance: Uncertainty,
        s: np.ndarray,
        payload: float | np.ndarray = 1.0,
        tilt: float | np.ndarray = 0.0,
    ) -> np.ndarray:
        q, qd, qdd = np.split(s, 3, axis=1)
        none = np.empty((len(s), 0))
        return maximum_torques(self.robot, tolerance, q, qd, qdd, none, payload, tilt)


class RaisedPayload(Raised):
    """The mass of the payload, kg, with the centre of mass of the robot's payload, else at the TCP."""

    name, unit, title = "payload", "kg", "largest payload"

    def __init__(self, robot: Robot) -> None:
        centre = np.zeros(3) if robot.payload is None else robot.payload.center_of_mass
        # With 1 kg the factor of the payload's mass, which is a deviation, is the mass in kg.
        self.robot = robot.varied(arm=robot.arm.with_payload(Payload(1.0, centre)))
        self.arms = robot.arm.with_payload(None), self.robot.arm
        rated = robot.payload.mass if robot.payload else None
        self.replaces = f"the task's {rated:g} kg" if rated else ""
        self.most = 10.0 * rated if rated else robot.mass
        if robot.argument("reference_moment") is None:  # the default counts the weight of everything
            self.reference_slope = (self.robot.tip_over.reference_moment or 0.0) / self.robot.mass

    def counted(self, tolerance: Uncertainty) -> Uncertainty:
        """See `Raised`."""
        return replace(tolerance, payload_mass=tolerance.payload_mass or 0.5)

    def raised(self, cases: WorstCase, levels: np.ndarray) -> WorstCase:
        """See `Raised`."""
        return cases.loaded(levels)

    def zero(self, broken: Broken) -> np.ndarray:
        """See `Raised`: tangents."""
        deviations, s, theta = broken.deviations, broken.s, broken.worst.theta
        more = theta.copy()
        more[:, deviations.places["payload_mass"].start] += 1.0
        per_kg = deviations.wrench(s, more)[0] - deviations.wrench(s, theta)[0]
        change = np.einsum("nw,nw->n", broken.worst.slopes, per_kg)
        share = deviations.tolerance.payload_mass
        rise = change * np.where(change < 0, 1 + share, 1 - share) + broken.per_level
        levels = broken.levels - broken.left / np.minimum(rise, -_FLAT)
        return np.where(rise < 0, np.maximum(levels, 0.0), -1.0)

    def torques(
        self, tolerance: Uncertainty, rows: np.ndarray, s: np.ndarray, levels: np.ndarray
    ) -> np.ndarray:
        """See `Raised`."""
        return self._torques(tolerance, s, levels)


class RaisedTilt(Raised):
    """The tilt of the floor in any direction, rad, beyond the tilt of the uncertainty."""

    name, unit, scale, most, convex = "tilt", "deg", 180 / np.pi, MOST_TILT, False
    title = "largest tilt of the floor in any direction"

    def counted(self, tolerance: Uncertainty) -> Uncertainty:
        """See `Raised`."""
        return replace(tolerance, tilt=tolerance.tilt or 0.1)

    def raised(self, cases: WorstCase, levels: np.ndarray) -> WorstCase:
        """See `Raised`."""
        return cases.tilted(levels)

    def zero(self, broken: Broken) -> np.ndarray:
        """See `Raised`: the margin is that of all else plus a cosine of the tilt."""
        deviations, worst, down = broken.deviations, broken.worst, self.robot.support.gravity
        place = deviations.places["gravity"]
        over = deviations.wrench_and_slopes(broken.s, worst.theta)[1][:, :, place]
        pull = np.einsum("nw,nwt->nt", worst.slopes, over)
        size = np.linalg.norm(pull, axis=1) * np.linalg.norm(down)
        besides = broken.left - np.sum(pull * (down + worst.theta[:, place]), axis=1)
        angle = np.arctan2(np.linalg.norm(np.cross(pull, down), axis=1), pull @ down)
        tilt = np.arccos(np.clip(-besides / np.maximum(size, _FLAT), -1.0, 1.0)) - angle
        return tilt - deviations.tolerance.tilt

    def torques(
        self, tolerance: Uncertainty, rows: np.ndarray, s: np.ndarray, levels: np.ndarray
    ) -> np.ndarray:
        """See `Raised`."""
        return self._torques(tolerance, s, tilt=levels[:, None])


class RaisedPush(Raised):
    """A horizontal push in any direction, N, at the TCP, or at the base at a height.

    Args:
        robot: that is pushed.
        height: m, above the lowest contact, in line with the centre of the contacts; None: at the TCP.
    """

    name, unit, by_deviations = "push", "N", False
    _q: np.ndarray

    def __init__(self, robot: Robot, height: float | None = None) -> None:
        super().__init__(robot)
        self._height = height
        place = "at the TCP" if height is None else f"{height:g} m above the lowest contact"
        self.title = f"largest push along the floor in any direction {place}"
        self.most = 2.0 * float(np.linalg.norm(robot.support.weight[:3]))
        down = robot.support.gravity
        self._up = -down / np.linalg.norm(down)

    def at(self, q: np.ndarray) -> Self:
        """See `Raised`."""
        other = type(self)(self.robot, self._height)
        other._q = q
        return other

    @cached_property
    def _places(self) -> np.ndarray:
        """(N, 3), m, from the centre of mass of the base."""
        about = self.robot.support.center_of_mass
        if self._height is None:
            return self.robot.tool(self._q) - about
        feet = np.array([contact.position for contact in self.robot.support.contacts])
        middle = feet.mean(axis=0)
        lift = self._height + np.min(feet @ self._up) - middle @ self._up
        return np.tile(middle + lift * self._up - about, (len(self._q), 1))

    @cached_property
    def _torques_per_newton(self) -> np.ndarray:
        """(N, n)."""
        if self._height is not None:
            return np.zeros(self._q.shape)
        return self._level(np.swapaxes(gripper_batch(self.robot.arm)(self._q)[2][:, :3], 1, 2))

    def _level(self, vectors: np.ndarray) -> np.ndarray:
        """Lengths of the horizontal parts of vectors (..., 3)."""
        return np.linalg.norm(vectors - (vectors @ self._up)[..., None] * self._up, axis=-1)

    def lost(self, rows: np.ndarray, a: np.ndarray) -> np.ndarray:
        """See `Raised`."""
        places = self._places[rows] if a.ndim == 2 else self._places[rows][:, None]
        return self._level(a[..., :3] + np.cross(a[..., 3:], places))

    def zero(self, broken: Broken) -> np.ndarray:
        """See `Raised`."""
        return broken.levels - broken.left / np.minimum(broken.per_level, -_FLAT)

    def torques(
        self, tolerance: Uncertainty, rows: np.ndarray, s: np.ndarray, levels: np.ndarray
    ) -> np.ndarray:
        """See `Raised`."""
        return self._torques(tolerance, s) + levels[:, None] * self._torques_per_newton[rows]
