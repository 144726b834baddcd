"""A gripper pose to be reached, exactly or up to a rotation that a symmetric gripper does not feel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import get_args

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array, is_whole, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.basics.values import rotations
from ocptip.numerics.vectors import perpendicular
from ocptip.robots.inverse.closed_form import closed_form_family
from ocptip.robots.inverse.inverse_kinematics import (
    SINGULAR_TOLERANCE,
    distinct,
    miss_text,
    solve_inverse_kinematics,
)
from ocptip.robots.inverse.joint_angles import search_box
from ocptip.robots.inverse.joint_angles import within_limits as copies_within_limits
from ocptip.robots.inverse.pose_search import (
    Orientation,
    effective_axes,
    miss_sizes,
    pose_errors,
    reached,
    search,
)
from ocptip.robots.kinematics import chain, gripper_batch
from ocptip.robots.model import ArmModel

AXES = ("x", "y", "z")
SAMPLED_TURNS = 12  # of a symmetric gripper, where an arm has but a few branches for each of them
SAMPLED = 64  # postures of a continuum
REACHED = 1e-9  # m and rad, by which a sampled posture may miss
MOST_FOLDS = 12
_ROTATION_TOLERANCE = 1e-8
_UNIT_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """Where the gripper is to be.

    Attributes:
        position: (3,), m, of the TCP in the base frame.
        rotation: (3, 3), gripper to base axes.
        symmetric_about: gripper axis "x", "y" or "z" about which the gripper may be turned; "": it may not.
            Without `fold` it is short for the orientation "axis" with this `tool_axis`.
        fold: the turns that are allowed are the multiples of a full turn divided by `fold`; 0: any turn.
        orientation: "full"; "axis": only the direction of `tool_axis` counts; "free": only the position.
        tool_axis: (3,), unit vector, gripper axes.
        free: (3, 2), m: how far from `position` the TCP may be, from and to, along the axes of the base
            frame; 0 is among them.
    """

    position: np.ndarray
    rotation: np.ndarray
    symmetric_about: str = ""
    fold: int = 0
    orientation: Orientation = "full"
    tool_axis: Sequence[float] = (0.0, 0.0, 1.0)
    free: np.ndarray = field(default_factory=lambda: np.zeros((3, 2)))

    def __post_init__(self) -> None:
        """Raise InputError for what is no pose, or no symmetry."""
        settle(self, position=finite_array("position", self.position, (3,)))
        turn = rotation_matrix("rotation", self.rotation, tolerance=_ROTATION_TOLERANCE)
        settle(self, rotation=turn)
        if self.symmetric_about not in ("", *AXES):
            raise InputError(f"symmetric_about: must be x, y or z, got {self.symmetric_about!r}")
        if not is_whole(self.fold) or self.fold not in (0, *range(2, MOST_FOLDS + 1)):
            raise InputError(f"fold: must be a whole number of 2 to {MOST_FOLDS}, got {self.fold!r}")
        if self.fold and not self.symmetric_about:
            raise InputError("fold: needs symmetric_about, the axis of the symmetry")
        self._settle_orientation()
        settle(self, free=finite_array("free", self.free, (3, 2)))
        if not ((self.free[:, 0] <= 0) & (self.free[:, 1] >= 0)).all():
            raise InputError(f"free: 0 must be within each range, got {self.free.tolist()}")

    def _settle_orientation(self) -> None:
        """Raise InputError for what is no orientation, or not that of the symmetry."""
        if self.orientation not in get_args(Orientation):
            raise InputError(
                f"orientation: must be one of {', '.join(get_args(Orientation))}, got {self.orientation!r}"
            )
        axis = finite_array("tool_axis", self.tool_axis, (3,))
        if abs(np.linalg.norm(axis) - 1) > _UNIT_TOLERANCE:
            raise InputError(f"tool_axis: must have length 1, got {axis.tolist()}")
        settle(self, tool_axis=axis)
        if not self.symmetric_about:
            return
        free_axis = np.eye(3)[AXES.index(self.symmetric_about)]
        meant = ("full", axis) if self.fold else ("axis", free_axis)
        if self.orientation not in ("full", meant[0]):
            raise InputError(
                f"orientation: {self.orientation!r} contradicts symmetric_about; give one of the two"
            )
        settle(self, orientation=meant[0], tool_axis=meant[1])

    @property
    def turns_freely(self) -> bool:
        """Whether part of the orientation is free, all of it or the turn about `tool_axis`."""
        return self.orientation != "full"

    @property
    def conditions(self) -> int:
        """Number of equations that the joint angles have to fulfil."""
        return {"full": 6, "axis": 5, "free": 3}[self.orientation]

    @property
    def how(self) -> tuple[Orientation, np.ndarray]:
        """What of the orientation counts, and the tool axis: the last arguments of `pose_search.search`."""
        return self.orientation, np.asarray(self.tool_axis)

    def independent(self, arm: ArmModel) -> int:
        """Number of the conditions that an arm can fulfil independently; its axes may be too few for all."""
        return effective_axes(arm, *self.how)

    def postures(self, arm: ArmModel, *, seed: int = 0) -> np.ndarray:
        """Joint angles (k, n), rad (sliding joints: m), within the joint limits, that bring it there.

        All IK solutions where their number is finite, else some out of each continuum: up to 64 (of arms with
        closed-form solutions those for 12 turns of a gripper that may turn freely). Of an arm that lacks an
        axis there: the nearest postures, see `pose_search.reached`.

        Raises:
            InputError: out of reach, as `solve_inverse_kinematics` says.
        """
        searched = self.orientation == "free" or (self.turns_freely and closed_form_family(arm) is None)
        result = self._searched(arm, seed) if searched else self._solved(arm, seed)
        exact = self.residuals(arm, result) <= SINGULAR_TOLERANCE
        return result[exact] if exact.any() else result

    def _solved(self, arm: ArmModel, seed: int) -> np.ndarray:
        """Postures by inverse kinematics for each of the rotations."""
        results, refusal = [], None
        for turn in self._rotations:
            try:
                results.append(solve_inverse_kinematics(arm, self.position, turn, seed=seed).branches)
            except InputError as error:
                refusal = refusal or error
        if not results:
            assert refusal is not None
            raise refusal
        return np.vstack(results)

    def _searched(self, arm: ArmModel, seed: int) -> np.ndarray:
        """Postures by iteration from random ones."""
        low, high = search_box(arm)
        starts = low + np.random.default_rng(seed).random((4 * SAMPLED, arm.n)) * (high - low)
        ends, _ = search(arm, starts, self.position, self.rotation, *self.how)
        q = ends[self.reached(arm, ends, REACHED)]
        q = copies_within_limits(arm, q)
        q = distinct(arm, np.empty((0, arm.n)), q[np.isfinite(q).all(axis=1)])
        if not len(q):
            miss = miss_text(pose_errors(arm, ends, self.position, self.rotation, *self.how)[0])
            raise InputError(
                f"pose: arm {arm.name!r} does not reach it within the joint limits; the nearest of "
                f"{len(ends)} tries misses by {miss}"
            )
        return copies_within_limits(arm, q)

    def offsets(self, arm: ArmModel, q: np.ndarray) -> np.ndarray:
        """(N, 3) m: the allowed part of the offset from `position` to the TCP at q (N, n), rad."""
        if not self.free.any():
            return np.zeros((len(q), 3))
        return np.clip(gripper_batch(arm)(q)[0] - self.position, *self.free.T)

    def at(self, offset: np.ndarray) -> PoseTarget:
        """This target with the TCP exactly at `position` + offset (3,), m."""
        return replace(self, position=self.position + offset, free=np.zeros((3, 2)))

    def residuals(self, arm: ArmModel, q: np.ndarray) -> np.ndarray:
        """(N,) By how much the gripper misses at q (N, n), rad: the largest component, m and rad."""
        return np.min([np.abs(errors).max(axis=1) for errors, _ in self._errors(arm, q)], axis=0)

    def misses(self, arm: ArmModel, q: np.ndarray) -> np.ndarray:
        """(N, 2), m and rad: by how much TCP and orientation miss at q (N, n), rad."""
        sizes = np.array([miss_sizes(errors) for errors, _ in self._errors(arm, q)])
        return sizes[np.argmin(sizes.max(axis=2), axis=0), np.arange(len(q))]

    def reached(self, arm: ArmModel, q: np.ndarray, exactly: float) -> np.ndarray:
        """(N,) Whether q (N, n), rad, are postures of this pose, see `pose_search.reached`."""
        return np.any([reached(*result, exactly) for result in self._errors(arm, q)], axis=0)

    def _errors(self, arm: ArmModel, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """`pose_errors` for each of the rotations that are as good as the one given."""
        position = self.position + self.offsets(arm, q)
        turns = self._rotations if self.fold else [self.rotation]
        return [pose_errors(arm, q, position, turn, *self.how) for turn in turns]

    def nearest(self, arm: ArmModel, q: np.ndarray) -> PoseTarget:
        """This target without `fold`: of the rotations that it allows, the nearest one at q (n,), rad."""
        if not self.fold:
            return self
        position = self.position + self.offsets(arm, q[None])
        misses = [np.abs(pose_errors(arm, q[None], position, turn)[0]).max() for turn in self._rotations]
        turn = self._rotations[int(np.argmin(misses))]
        return replace(self, rotation=turn, symmetric_about="", fold=0)

    @property
    def _rotations(self) -> list[np.ndarray]:
        """The rotations that are as good as the one given; of a free turn, some."""
        if not self.fold and not self.turns_freely:
            return [self.rotation]
        count = self.fold or SAMPLED_TURNS
        return [self.rotation @ turn for turn in self._turns(2 * np.pi * np.arange(count) / count)]

    def _turns(self, angles: np.ndarray) -> np.ndarray:
        """(N, 3, 3) Rotations by angles (N,), rad, about the axis of symmetry or the tool axis."""
        axis = np.eye(3)[AXES.index(self.symmetric_about)] if self.fold else self.tool_axis
        return rotations().from_rotvec(angles[:, None] * axis).as_matrix()

    def equations(self, arm: ArmModel, q: cs.SX) -> cs.SX:
        """(conditions, 1), m and rad near a solution: zero where the gripper is where it should be.

        Those of the orientation also vanish where the gripper is turned by half a turn; see `residuals`.
        Without the turns that `fold` allows, see `nearest`.
        """
        rotations, origins = chain(arm, q)
        miss = origins[-1] - self.position
        if self.orientation == "free":
            return miss
        turn = cs.DM(self.rotation.T) @ rotations[-1]
        if self.orientation == "full":
            rows = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
            return cs.vertcat(miss, *(0.5 * row for row in rows))
        axis = np.asarray(self.tool_axis)
        across = perpendicular(axis)
        return cs.vertcat(miss, cs.DM(np.array([across, np.cross(axis, across)])) @ turn @ cs.DM(axis))
