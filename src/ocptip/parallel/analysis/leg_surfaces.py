"""Where a leg's coupling point can be while its motors are locked: sphere, circle, plane, cylinder, line.

Also legs of spherical robots, of which two unactuated joints keep the angle between their axes, and legs
whose last joint, or the whole end, is rigid with the platform: these also hold axes and points of the base in
it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.robot_description import REVOLUTE, MDHRow
from ocptip.parallel.kinematics.leg_solver import LegSolver

_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class LegSurface:
    """The constraint on the coupling point p = r + R kappa of a leg with locked motors.

    Attributes:
        kappa: (3,), m, platform axes.
        center, radius: |p - center| = radius, m, world axes; None if it does not hold. With `axis` only the
            distance from the axis through the centre counts.
        axis: (3,) unit vector of a cylinder's axis; None: a sphere.
        planes: pairs of a normal (3,) and a number d, m, with normal . p = d.
        angles: axes a (3,) of the base and u (3,) of the platform and a number c with a . R u = c.
        slots: points b (3,), m, of the base, normals n (3,) of the platform and numbers d, m, with
            n . R' (b - r) = d: planes of the platform in which the points stay.
        reach: (3,) point, smallest and largest distance of p from it; empty: no further limit.
    """

    kappa: np.ndarray
    center: np.ndarray | None = None
    radius: float = 0.0
    axis: np.ndarray | None = None
    planes: tuple[tuple[np.ndarray, float], ...] = ()
    angles: tuple[tuple[np.ndarray, np.ndarray, float], ...] = ()
    slots: tuple[tuple[np.ndarray, np.ndarray, float], ...] = ()
    reach: tuple[np.ndarray, float, float] | tuple[()] = field(default=())

    def error(self, r: np.ndarray, R: np.ndarray) -> float:
        """How far p is from where it should be, m; axes by the sine of their angle."""
        p = r + R @ self.kappa
        errors = [abs(float(normal @ p) - d) for normal, d in self.planes]
        errors += [abs(float(a @ R @ u) - c) for a, u, c in self.angles]
        errors += [abs(float((b - r) @ R @ n) - d) for b, n, d in self.slots]
        if self.center is not None:
            arm = p - self.center
            arm = arm if self.axis is None else arm - self.axis * (self.axis @ arm)
            errors.append(abs(float(np.linalg.norm(arm)) - self.radius))
        if self.reach:
            point, least, most = self.reach
            distance = float(np.linalg.norm(p - point))
            errors.append(max(least - distance, distance - most, 0.0))
        return max(errors, default=0.0)


def leg_surface(
    leg: LegSolver, locked: dict[int, float], *, turning: bool, planar: bool = False
) -> LegSurface:
    """The surface of a leg.

    Args:
        leg: assembled.
        locked: positions of its motors' joints, rad or m.
        turning: the platform only turns about its origin: orientation of the leg's axes counts.
        planar: the platform turns about one axis: of a leg that is rigid with it, the last joint counts.

    Raises:
        InputError: the point moves on none of the surfaces.
    """
    rows, q = _assembled(leg, locked)
    if turning:
        return _fixed_angle(leg, q, [j for j in range(leg.n) if j not in locked])
    passive = [j for j in range(leg.point) if j not in locked]
    slides = [rows[j].sigma != REVOLUTE for j in passive]
    rotations, origins = leg.frames(q)
    axes, points, p = rotations[passive, :, 2], origins[passive], origins[leg.point]
    kappa, scale = leg.couplings[0], _SAME * leg.length
    turn = leg.end_rotations[0]
    if planar and leg.n == leg.point and turn is not None:
        if passive[-1:] != [leg.n - 1] or slides[-1]:
            raise InputError(
                f"leg {leg.number + 1}: it is rigid with the platform; assembly modes need its last joint to "
                "turn freely"
            )
        hinge = points[-1]
        kappa = kappa + (rotations[leg.end_rows[0]] @ turn).T @ (hinge - p)
        axes, points, slides, p = axes[:-1], points[:-1], slides[:-1], hinge
    kind = "".join("P" if s else "R" for s in slides)
    if not kind:
        return LegSurface(kappa, planes=tuple((e, float(e @ p)) for e in np.eye(3)))
    if kind == "P":
        normals = np.linalg.svd(axes)[2][1:]
        return LegSurface(kappa, planes=tuple((e, float(e @ p)) for e in normals))
    if kind == "R":
        foot = points[0] + axes[0] * (axes[0] @ (p - points[0]))
        radius = float(np.linalg.norm(p - foot))
        return LegSurface(kappa, foot, radius, planes=((axes[0], float(axes[0] @ p)),))
    parallel = bool(np.linalg.norm(np.cross(axes[0], axes[1])) < _SAME)
    if kind in ("PR", "RP") and parallel:
        hinge = kind.index("R")
        arm = p - points[hinge]
        arm = arm - axes[hinge] * (axes[hinge] @ arm)
        return LegSurface(kappa, p - arm, float(np.linalg.norm(arm)), axis=axes[hinge])
    if kind == "RR" and parallel:
        return _disc(kappa, axes[0], points, p)
    if kind in ("RR", "RRR"):
        center = _meeting_point(axes, points)
        arm = p - center
        whole = kind == "RRR" or max(abs(axes[0] @ axes[1]), abs(axes[1] @ arm) / leg.length) < _SAME
        if whole and _distance(axes, points, center) < scale:
            return LegSurface(kappa, center, float(np.linalg.norm(arm)))
    raise InputError(
        f"leg {leg.number + 1}: with its motors locked, its coupling point moves on no sphere, circle, "
        "plane, cylinder or line; assembly modes need one of them"
    )


def held_leg(leg: LegSolver, locked: dict[int, float]) -> LegSurface:
    """What a leg without a ball joint at the platform holds: unactuated joints U and P, or U and R with
    parallel last axes, or S and R, the last joint next to the platform.

    Args:
        leg: assembled.
        locked: positions of its motors' joints, rad or m.

    Raises:
        InputError: another kind of leg.
    """
    rows, q = _assembled(leg, locked)
    passive = [j for j in range(leg.n) if j not in locked]
    kind = "".join("R" if rows[j].sigma == REVOLUTE else "P" for j in passive)
    turn = leg.end_rotations[0]
    if kind in ("RRP", "RRR", "RRRR") and passive[-1] == leg.n - 1 and turn is not None:
        rotations, origins = leg.frames(q)
        R, axes, points = rotations[leg.end_rows[0]] @ turn, rotations[passive, :, 2], origins[passive]
        kappa, p, last = leg.couplings[0], origins[leg.point], R.T @ axes[-1]
        center = _meeting_point(axes[: len(kind) - 1], points[: len(kind) - 1])
        met = _distance(axes[:-1], points[:-1], center) < _SAME * leg.length
        arm = R.T @ (center - p) + kappa
        angle = (axes[0], R.T @ axes[1], float(axes[0] @ axes[1]))
        if kind == "RRP" and met:
            normals = np.linalg.svd(last[None])[2][1:]
            return LegSurface(
                kappa, angles=(angle,), slots=tuple((center, n, float(n @ arm)) for n in normals)
            )
        parallel = float(np.linalg.norm(np.cross(axes[-2], axes[-1]))) < _SAME
        if met and leg.n == leg.point + 1 and (kind == "RRRR" or parallel):
            angles = (angle,) if kind == "RRR" else ()
            slots, radius = ((center, last, float(last @ arm)),), float(np.linalg.norm(p - center))
            return LegSurface(kappa, center, radius, angles=angles, slots=slots)
    raise InputError(
        f"leg {leg.number + 1}: its unactuated joints ({', '.join(kind) or 'none'}) have no known assembly "
        "modes; known are ball joints at the platform, or UP, UR with parallel last axes or SR to it"
    )


def _assembled(leg: LegSolver, locked: dict[int, float]) -> tuple[tuple[MDHRow, ...], np.ndarray]:
    """Joint rows, and joint positions with those of the motors."""
    if not leg.leg.serial or leg.locked:
        raise InputError(f"leg {leg.number + 1}: assembly modes need serial legs without redundant joints")
    q = np.array(leg.home)
    for joint, value in locked.items():
        q[joint] = value
    return leg.leg.joint_rows, q


def _fixed_angle(leg: LegSolver, q: np.ndarray, passive: list[int]) -> LegSurface:
    """The last passive axis, fixed in the platform, keeps its angle with the first one."""
    turn, rows = leg.end_rotations[0], leg.leg.joint_rows
    if len(passive) != 2 or turn is None or any(rows[j].sigma != REVOLUTE for j in passive):
        raise InputError(
            f"leg {leg.number + 1}: assembly modes of a spherical robot need two passive turning joints"
        )
    rotations, _ = leg.frames(q)
    end = leg.end_rows[0]
    first, last = rotations[passive[0]][:, 2], rotations[passive[1]][:, 2]
    return LegSurface((rotations[end] @ turn).T @ last, planes=((first, float(first @ last)),))


def _disc(kappa: np.ndarray, axis: np.ndarray, points: np.ndarray, p: np.ndarray) -> LegSurface:
    """Two links in a plane."""

    def length(a: np.ndarray) -> float:
        return float(np.linalg.norm(a - axis * (axis @ a)))

    first, second = length(points[1] - points[0]), length(p - points[1])
    hub = points[0] + axis * (axis @ (p - points[0]))
    return LegSurface(
        kappa, planes=((axis, float(axis @ p)),), reach=(hub, abs(first - second), first + second)
    )


def _meeting_point(axes: np.ndarray, points: np.ndarray) -> np.ndarray:
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    right = np.einsum("nij,nj->i", across, points)
    return np.linalg.lstsq(across.sum(axis=0), right, rcond=None)[0]


def _distance(axes: np.ndarray, points: np.ndarray, center: np.ndarray) -> float:
    return float(np.linalg.norm(np.cross(axes, center - points), axis=1).max())


def sphere_form(c: np.ndarray, k: np.ndarray, number: complex) -> np.ndarray:
    """(8, 8): |p - c| is the radius, with number = |k|^2 + |c|^2 - radius^2."""
    left, right = _left(np.append(0, c)), _right(np.append(0, k))
    out = np.zeros((8, 8), dtype=np.result_type(c, k, number))
    both = left.T @ right
    out[4:, 4:] = np.eye(4)
    out[:4, :4] = number * np.eye(4) - both - both.T
    out[4:, :4] = right - left
    out[:4, 4:] = (right - left).T
    return out


def plane_form(n: np.ndarray, k: np.ndarray, d: complex) -> np.ndarray:
    """(8, 8): n . p = d."""
    left = _left(np.append(0, n))
    out = angle_form(n, k, d)
    out[4:, :4] = 0.5 * left
    out[:4, 4:] = 0.5 * left.T
    return out


def angle_form(a: np.ndarray, u: np.ndarray, c: complex) -> np.ndarray:
    """(8, 8): a . R u = c."""
    out = np.zeros((8, 8), dtype=np.result_type(a, u, c))
    both = _left(np.append(0, a)).T @ _right(np.append(0, u))
    out[:4, :4] = 0.5 * (both + both.T) - c * np.eye(4)
    return out


def slot_form(b: np.ndarray, n: np.ndarray, d: complex) -> np.ndarray:
    """(8, 8): n . R' (b - r) = d."""
    right = _right(np.append(0, n))
    out = angle_form(b, n, d)
    out[4:, :4] = -0.5 * right
    out[:4, 4:] = -0.5 * right.T
    return out


def position_of(e: np.ndarray, h: np.ndarray) -> np.ndarray:
    """r (3,) of the quaternions e and h."""
    return (_right(e * [1, -1, -1, -1]) @ h)[1:] / (e @ e)


def _left(a: np.ndarray) -> np.ndarray:
    """(4, 4): a b of quaternions, scalar first."""
    w, x, y, z = a
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def _right(b: np.ndarray) -> np.ndarray:
    """(4, 4): a b of quaternions as a matrix times a."""
    w, x, y, z = b
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
