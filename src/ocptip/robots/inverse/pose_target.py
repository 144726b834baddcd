"""A gripper pose to be reached, exactly or up to a rotation that a symmetric gripper does not feel."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array, is_whole, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.robots.inverse.inverse_kinematics import pose_residuals, solve_inverse_kinematics
from ocptip.robots.inverse.joint_angles import search_box
from ocptip.robots.inverse.joint_angles import within_limits as copies_within_limits
from ocptip.robots.inverse.pose_search import pose_errors, search
from ocptip.robots.kinematics import chain, gripper_batch
from ocptip.robots.model import ArmModel

AXES = ("x", "y", "z")
SAMPLED_TURNS = 12  # of a symmetric gripper, where an arm has but a few branches for each of them
SAMPLED = 64  # postures of a continuum
REACHED = 1e-9  # m and rad, by which a sampled posture may miss
MOST_FOLDS = 12
_ROTATION_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """Where the gripper is to be.

    Attributes:
        position: (3,), m, of the gripper point in the base frame.
        rotation: (3, 3), gripper to base axes.
        symmetric_about: gripper axis "x", "y" or "z" about which the gripper may be turned; "": it may not.
        fold: the turns that are allowed are the multiples of a full turn divided by `fold`; 0: any turn.
        free: (3, 2), m: how far from `position` the gripper point may be, from and to, along the axes of the
            base frame; 0 is among them.
    """

    position: np.ndarray
    rotation: np.ndarray
    symmetric_about: str = ""
    fold: int = 0
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
        settle(self, free=finite_array("free", self.free, (3, 2)))
        if not ((self.free[:, 0] <= 0) & (self.free[:, 1] >= 0)).all():
            raise InputError(f"free: 0 must be within each range, got {self.free.tolist()}")

    @property
    def turns_freely(self) -> bool:
        """Whether any rotation about the axis of symmetry will do."""
        return bool(self.symmetric_about) and not self.fold

    @property
    def conditions(self) -> int:
        """Number of equations that the joint angles have to fulfil."""
        return 5 if self.turns_freely else 6

    @property
    def axis(self) -> np.ndarray:
        """(3,) The axis of symmetry, gripper axes."""
        return np.eye(3)[AXES.index(self.symmetric_about)]

    def postures(self, arm: ArmModel, *, seed: int = 0) -> np.ndarray:
        """Joint angles (k, n), rad (sliding joints: m), within the joint limits, that bring it there.

        All branches where their number is finite, else some out of each continuum: up to 64 (of arms with at
        most six joints the branches for 12 turns of a gripper that may turn freely).

        Raises:
            InputError: out of reach, as `solve_inverse_kinematics` says.
        """
        if self.turns_freely and arm.n > self.conditions + 1:
            return self._searched(arm, seed)
        found, refusal = [], None
        for turn in self._rotations:
            try:
                found.append(solve_inverse_kinematics(arm, self.position, turn, seed=seed).branches)
            except InputError as error:
                refusal = refusal or error
        if not found:
            assert refusal is not None
            raise refusal
        return np.vstack(found)

    def _searched(self, arm: ArmModel, seed: int) -> np.ndarray:
        """Postures found by iteration from random ones."""
        low, high = search_box(arm)
        starts = low + np.random.default_rng(seed).random((4 * SAMPLED, arm.n)) * (high - low)
        q, error = search(arm, starts, self.position, self.rotation, "axis", self.axis)
        q = q[error <= REACHED]
        q = copies_within_limits(arm, q)
        q = q[np.isfinite(q).all(axis=1)]
        if not len(q):
            miss = float(error.min())
            raise InputError(
                f"pose: not reached within the joint limits; the nearest misses it by {miss:.2g} (m, rad)"
            )
        return q[:SAMPLED]

    def offsets(self, arm: ArmModel, q: np.ndarray) -> np.ndarray:
        """(N, 3) m: what is allowed of the way from `position` to the gripper point at q (N, n), rad."""
        if not self.free.any():
            return np.zeros((len(q), 3))
        return np.clip(gripper_batch(arm)(q)[0] - self.position, *self.free.T)

    def at(self, offset: np.ndarray) -> PoseTarget:
        """The same with the gripper point at `position` + offset (3,), m, exactly."""
        return replace(self, position=self.position + offset, free=np.zeros((3, 2)))

    def residuals(self, arm: ArmModel, q: np.ndarray) -> np.ndarray:
        """(N,) By how much the gripper misses at q (N, n), rad: the largest component, m and rad."""
        position = self.position + self.offsets(arm, q)
        if self.turns_freely:
            errors = pose_errors(arm, q, position, self.rotation, "axis", self.axis)[0]
            return np.abs(errors).max(axis=1)
        return np.min([pose_residuals(arm, q, position, turn) for turn in self._rotations], axis=0)

    def nearest(self, arm: ArmModel, q: np.ndarray) -> PoseTarget:
        """The same without `fold`: of the turns that it allows, the one that is nearest at q (n,), rad."""
        if not self.fold:
            return self
        position = self.position + self.offsets(arm, q[None])
        misses = [pose_residuals(arm, q[None], position, turn)[0] for turn in self._rotations]
        turn = self._rotations[int(np.argmin(misses))]
        return replace(self, rotation=turn, symmetric_about="", fold=0)

    @property
    def _rotations(self) -> list[np.ndarray]:
        """The rotations that are as good as the one given; of a free turn, some."""
        if not self.symmetric_about:
            return [self.rotation]
        count = self.fold or SAMPLED_TURNS
        return [self.rotation @ turn for turn in self._turns(2 * np.pi * np.arange(count) / count)]

    def _turns(self, angles: np.ndarray) -> np.ndarray:
        """(N, 3, 3) Rotations by angles (N,), rad, about the axis of symmetry."""
        from scipy.spatial.transform import Rotation  # loads for 0.2 s, and most tasks have angles

        return Rotation.from_rotvec(angles[:, None] * self.axis).as_matrix()

    def equations(self, arm: ArmModel, q: cs.SX) -> cs.SX:
        """(conditions, 1), m and rad near a solution: zero where the gripper is where it should be.

        Those of the orientation vanish, too, where the gripper is turned by half a turn; see `residuals`.
        Without the turns that `fold` allows, see `nearest`.
        """
        rotations, origins = chain(arm, q)
        miss = origins[-1] - self.position
        turn = cs.DM(self.rotation.T) @ rotations[-1]
        if not self.turns_freely:
            rows = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
            return cs.vertcat(miss, *(0.5 * row for row in rows))
        along = AXES.index(self.symmetric_about)
        return cs.vertcat(miss, *(turn[across, along] for across in range(3) if across != along))
