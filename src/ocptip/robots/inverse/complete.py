"""All IK solutions of a six-axis arm of any geometry, by continuation.

The pose of the gripper fixes the line of axis 6. Its place beside axis 3 has four invariants under rotations
of joint 3: z3 . z6, z3 . (p6 - o3), |p6 - o3|^2 and (p6 - o3) . z6. From the base they are sums of products
of cosines and sines of joints 1 and 2, from the hand of joints 5 and 4 (Tsai and Morgan, J. Mechanisms,
Transmissions and Automation in Design 107, 1985). With c^2 + s^2 = 1 of these joints they are eight quadratic
equations in eight unknowns. A system of the same monomials with random complex coefficients has 64 finite
solutions; following them to the equations of the arm reaches every isolated solution.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ocptip.numerics.quadrics import Deformation, distinct, follow, polished, total_degree
from ocptip.robots.kinematics import gripper_pose, link_frames
from ocptip.robots.model import ArmModel

_ONE = 8  # index of the constant; 0 to 7: cosine and sine of joints 1, 2, 4, 5
_SEED = 1985
_FINITE = 1e-6  # share of the constant in a solution of length 1
_REAL = 1e-7
_NEAR = 1e-6  # m and rad: mirrored solutions miss the pose by more


def all_solutions(arm: ArmModel, position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, int, int]:
    """All isolated solutions of a pose.

    Args:
        arm: six joints that turn.
        position, rotation: (3,), m, and (3, 3), of the gripper in the base frame.

    Returns:
        Joint angles (k, 6), rad, from -pi to pi; how many of them are proved to exist, to be distinct and
        real (Kantorovich); and the number of complex solutions that were followed.
    """
    forms, (general, starts) = _forms(arm, position, rotation), _general()
    way = Deformation.between(general, forms)
    for tolerance in ({}, {"tolerance": 1e-7}):
        ends, arrived = follow(way, starts, **tolerance)
        ends = ends[(arrived == 1.0) & (np.abs(ends[:, _ONE]) > _FINITE)]
        if len(distinct(ends)) == len(ends):  # else two paths became one: smaller steps
            break
    ends = ends / ends[:, _ONE:]
    real = ends[np.abs(ends.imag).max(axis=1, initial=0.0) < _REAL].real
    result, around, _ = polished(np.real(forms), real)
    result, kept, proved = result / result[:, _ONE:], [], 0
    for k in distinct(result):
        q = _joints(arm, result[k], position, rotation)
        reached, turned = gripper_pose(arm, q)
        if max(np.abs(reached - position).max(), np.abs(turned - rotation).max()) < _NEAR:
            kept.append(q)
            proved += bool(np.isfinite(around[k]))
    return np.array(kept).reshape(-1, 6), proved, len(starts)


def _lines(arm: ArmModel) -> tuple[np.ndarray, np.ndarray]:
    """Directions and points (6, 3) of the axes at joint values 0, base axes."""
    frames = link_frames(arm, np.zeros(6))
    return frames.rotations[:6, :, 2], frames.origins[:6]


def _turn(axis: np.ndarray) -> list[np.ndarray]:
    """Matrices (3, 3) of cosine, sine and 1: the rotation about the axis is c C + s S + K."""
    x, y, z = axis
    along = np.outer(axis, axis)
    return [np.eye(3) - along, np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), along]


def _forms(arm: ArmModel, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """The eight equations as symmetric forms (8, 9, 9)."""
    axes, points = _lines(arm)
    at_zero, turned = gripper_pose(arm, np.zeros(6))
    R = rotation @ turned.T  # moves axis 6 from where it is at zero
    lines = list(zip(axes, points, strict=True))
    last = R @ axes[5], R @ (points[5] - at_zero) + position
    first = _invariants(lines[0], lines[1], lines[2], last, 0)
    # In the frame of link 3 joints 4 and 5 carry axis 6, and axis 3 is fixed.
    second = _invariants(lines[3], lines[4], lines[5], lines[2], 4)
    swapped = second[[0, 3, 2, 1]] * np.array([1.0, -1.0, 1.0, -1.0])[:, None, None]
    forms = first - swapped
    forms = np.concatenate([_circles(), (forms + forms.transpose(0, 2, 1)) / 2])
    return (forms / np.abs(forms).max(axis=(1, 2), keepdims=True)).astype(complex)


def _invariants(
    near: tuple[np.ndarray, np.ndarray],
    far: tuple[np.ndarray, np.ndarray],
    carried: tuple[np.ndarray, np.ndarray],
    fixed: tuple[np.ndarray, np.ndarray],
    column: int,
) -> np.ndarray:
    """Invariants of a line that two joints carry beside a fixed line, as upper parts of forms (4, 9, 9).

    With direction c and point C of the carried line, z and p of the fixed one: c . z, c . (p - C), |p - C|^2
    and (p - C) . z.

    Args:
        near, far: direction and point (3,) of the axis next to the fixed line's body, and of the one behind.
        carried, fixed: the lines, likewise.
        at: index of the cosine of the near joint; that of the far one is at + 2.
    """
    (a, A), (b, B), (c, C), (z, p) = near, far, carried, fixed
    first, second = _turn(a), _turn(b)
    i, j = [column, column + 1, _ONE], [column + 2, column + 3, _ONE]
    forms = np.zeros((4, 9, 9))
    h, k = B - A, C - B  # C = A + Ra (h + Rb k), c = Ra Rb c
    for u, Ra in zip(i, first, strict=True):
        moved = Ra.T @ (p - A)
        forms[3, u, _ONE] -= z @ Ra @ h
        forms[2, u, _ONE] -= 2 * moved @ h
        for v, Rb in zip(j, second, strict=True):
            forms[0, u, v] += z @ Ra @ Rb @ c
            forms[1, u, v] += moved @ Rb @ c
            forms[2, u, v] -= 2 * moved @ Rb @ k
            forms[3, u, v] -= z @ Ra @ Rb @ k
    for v, Rb in zip(j, second, strict=True):
        forms[1, _ONE, v] -= h @ Rb @ c
        forms[2, _ONE, v] += 2 * h @ Rb @ k
    forms[1, _ONE, _ONE] -= k @ c
    forms[2, _ONE, _ONE] += (p - A) @ (p - A) + h @ h + k @ k
    forms[3, _ONE, _ONE] += (p - A) @ z
    return forms


@lru_cache(maxsize=1)
def _general() -> tuple[np.ndarray, np.ndarray]:
    """A random complex system with the monomials of all arms, and its finite solutions (P, 9)."""
    rng = np.random.default_rng(_SEED)
    forms = np.concatenate([_circles(), np.zeros((4, 9, 9))]).astype(complex)
    for first in (0, 4):
        monomials = [(u, v) for u in (first, first + 1, _ONE) for v in (first + 2, first + 3, _ONE)]
        for u, v in monomials:
            forms[4:, u, v] = forms[4:, v, u] = rng.normal(size=4) + 1j * rng.normal(size=4)
    order = [*range(1, 9), 0]  # the constant is first there
    known, starts = total_degree(9)
    known = known[:, order][:, :, order] * np.exp(2j * np.pi * rng.uniform(size=8))[:, None, None]
    ends, _ = follow(Deformation.between(known, forms), starts[:, order])
    ends, around, _ = polished(forms, ends)
    ends = ends[np.isfinite(around) & (np.abs(ends[:, _ONE]) > 1e-8)]
    return forms, ends[distinct(ends)]


def _circles() -> np.ndarray:
    """c^2 + s^2 - 1 of four joints, (4, 9, 9)."""
    forms = np.zeros((4, 9, 9))
    for k in range(4):
        forms[k, 2 * k, 2 * k] = forms[k, 2 * k + 1, 2 * k + 1] = 1.0
        forms[k, _ONE, _ONE] = -1.0
    return forms


def _joints(arm: ArmModel, result: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Joint angles (6,) of a solution; joints 3 and 6 from the directions that the others leave them."""
    q = np.zeros(6)
    q[[0, 1, 3, 4]] = np.arctan2(result[1:8:2], result[0:8:2])
    axes, points = _lines(arm)
    at_zero, turned = gripper_pose(arm, np.zeros(6))
    R = [_rotation(axis, angle) for axis, angle in zip(axes, q, strict=True)]
    before, behind = R[0] @ R[1], R[3] @ R[4]
    carried = points[0] + R[0] @ (points[1] - points[0] + R[1] @ (points[2] - points[1]))
    motion = rotation @ turned.T
    wanted = np.concatenate([motion @ axes[5], motion @ (points[5] - at_zero) + position - carried]).reshape(
        2, 3
    )
    hand = points[3] + R[3] @ (points[4] - points[3] + R[4] @ (points[5] - points[4]))
    shown = np.stack([behind @ axes[5], hand - points[2]])
    q[2] = _angle(axes[2], shown, wanted @ before)
    rest = (before @ _rotation(axes[2], q[2]) @ behind).T @ motion
    across = np.linalg.svd(axes[5][None])[2][1:]
    q[5] = _angle(axes[5], across, across @ rest.T)
    return q


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    c, s, one = _turn(axis)
    return np.cos(angle) * c + np.sin(angle) * s + one


def _angle(axis: np.ndarray, vectors: np.ndarray, turned: np.ndarray) -> float:
    """The angle about an axis that brings vectors (k, 3) nearest to others."""
    c, s, _ = _turn(axis)
    return float(np.arctan2(np.sum(turned * (vectors @ s.T)), np.sum(turned * (vectors @ c.T))))
