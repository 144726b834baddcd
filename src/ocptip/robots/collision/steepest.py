"""How fast distances may change at most: by the lever arms of joints."""

from __future__ import annotations

import numpy as np

from ocptip.robots.model import ArmModel

_ENDLESS = 1e6  # m: stands for infinite, of arms whose sliding joints have no limits


def steepest_slopes(
    arm: ArmModel, pairs: np.ndarray, bodies: np.ndarray, across: np.ndarray, about: np.ndarray
) -> np.ndarray:
    """Upper bounds (m, n), m/rad (sliding joints: 1), of the slopes of distances in any posture.

    A distance changes at most by what the joints between its two bodies move one relative to the other.

    Args:
        arm: whose links carry the solids.
        pairs: (m, 2) numbers of solids.
        bodies: (s,) numbers of the solids' links, counted from 0; -1: at rest.
        across: (s,), m: largest distance of a point of the solid from the axis of its link's joint.
        about: (s,), m: largest distance of a point of the solid from its link's origin.
    """
    if not len(pairs):
        return np.zeros((0, arm.n))
    arms = _lever_arms(arm, bodies, across, about)
    low, high = np.sort(bodies[pairs], axis=1).T
    outer = np.where(bodies[pairs[:, 0]] == high, pairs[:, 0], pairs[:, 1])
    joints = np.arange(arm.links)
    moves = (joints > low[:, None]) & (joints <= high[:, None])
    slopes = np.where(moves, arms[outer], 0.0)
    slopes = np.minimum(slopes, _ENDLESS)
    return slopes if arm.coupling is None else slopes @ np.abs(arm.coupling.matrix)


def _lever_arms(arm: ArmModel, bodies: np.ndarray, across: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Largest distance (s, L), m, of any point of solids from the axis of each joint; 1 where it slides."""
    ranges, lengths = _slide_ranges(arm), np.linalg.norm(arm.offsets, axis=1)
    beside = np.linalg.norm(arm.offsets[:, :2], axis=1)  # of the next origin from the axis
    found = np.zeros((len(bodies), arm.links))
    for solid, body in enumerate(bodies):
        beyond = about[solid]  # distance of any point from the origin of the link behind the joint
        for joint in range(body, -1, -1):
            turning = across[solid] if joint == body else beside[joint] + beyond
            found[solid, joint] = 1.0 if arm.slides[joint] else turning
            beyond += ranges[joint] + (0.0 if joint == body else lengths[joint])
    return found


def _slide_ranges(arm: ArmModel) -> np.ndarray:
    """(L,), m: how far a sliding joint may be from its zero position; 0 of joints that turn."""
    most = np.maximum(np.abs(arm.limits.angle_min), np.abs(arm.limits.angle_max))
    if arm.coupling is not None:
        most = np.abs(arm.coupling.ratios) * most[arm.coupling.leaders] + np.abs(arm.coupling.offsets)
    return np.where(arm.slides, most, 0.0)
