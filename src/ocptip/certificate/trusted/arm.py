"""Torques and base wrench of a serial arm, and where its links are, over intervals of time, in Taylor forms.

Newton and Euler's recursion in link axes, written again for forms; `robots.dynamics` has the same for numbers
and symbols. Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ocptip.certificate.trusted.forms import Form, U, cos_sin, dot, joined, linear, stack, times_rows

Turns = list[tuple[Form, tuple[Form, Form] | None]]


Motion = tuple[Form, Form, Form]
"""Of a frame, in its axes: acceleration and angular acceleration, (3, N); products (6, N) of its angular
velocity."""

Driven = tuple[Form, Motion]
"""Of a base that drives, in its axes: angular velocity (3, N), and its motion."""

PROCESS = "process_in_base", "process_on_link"
"""Keys of what acts on the gripper, about it, (6,) each: in base axes, and in those of the last link."""

SPRINGS = "spring_torque", "spring_stiffness"
"""Keys of springs beside the drives, (m,) each: torque at 0, and what it falls by per rad or m."""

TIMES = "process_times"
"""Key of times (K,), s, if it varies: then it is (K, 6) each; straight between them, constant outside."""

_SLACK = 2e-9  # s: by so much further than an interval of time what varies is looked at


def skew(v: np.ndarray) -> np.ndarray:
    """Matrix of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


_SQUARES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _centripetal(lever: np.ndarray) -> np.ndarray:
    """(3, 6): omega x (omega x lever) as a linear map of the products of omega."""
    x, y, z = lever
    return np.array([[0, -x, -x, y, z, 0], [-y, 0, -y, x, 0, z], [-z, -z, 0, 0, x, y]], dtype=float)


def _gyroscopic(inertia: np.ndarray) -> np.ndarray:
    """(3, 6): omega x (inertia omega) likewise."""
    out = np.zeros((3, 6))
    for column, (i, j) in enumerate(_SQUARES):
        outer = np.zeros((3, 3))
        outer[i, j] = outer[j, i] = 1.0
        turned = inertia @ outer  # of omega omega^T, row k of I omega omega^T
        out[:, column] = [
            turned[2, 1] - turned[1, 2],
            turned[0, 2] - turned[2, 0],
            turned[1, 0] - turned[0, 1],
        ]
    return out


def _into(A: np.ndarray, turn: tuple[Form, Form] | None, v: Form) -> Form:
    """Vectors (3, m, N) of the frame before a joint in that behind it."""
    return _turned(_apply(A.T, v), turn, -1.0)


def _out_of(A: np.ndarray, turn: tuple[Form, Form] | None, v: Form) -> Form:
    """The inverse of `_into`."""
    return _apply(A, _turned(v, turn, 1.0))


def _apply(A: np.ndarray, v: Form) -> Form:
    flat = Form(v.c.reshape(len(v.c), 3, -1), v.r.reshape(3, -1))
    out = linear(A, flat)
    return Form(out.c.reshape(v.c.shape), out.r.reshape(v.r.shape))


def _turned(v: Form, turn: tuple[Form, Form] | None, sign: float) -> Form:
    if turn is None:
        return v
    cosine, sine = turn
    swapped = v[[1, 0]]
    signs = np.array([-sign, sign]).reshape(2, *[1] * (v.r.ndim - 1))
    xy = v[:2] * cosine + swapped * signs * sine
    return joined(xy, v[2:])


class Arm:
    """Torques and base wrench of an arm over intervals (Newton and Euler's recursion in forms).

    Args:
        data: of a certificate's model.
        gravity: (3,), m/s^2, base axes.
        about: (3,), m, base frame: reference point of the moment on the base.
    """

    def __init__(self, data: Mapping[str, Any], gravity: np.ndarray, about: np.ndarray) -> None:
        number = {key: np.array(value, dtype=float) for key, value in data.items()}
        self.rotations = number["rotations"].copy()
        self.rotations[0] = number["mount_rotation"] @ self.rotations[0]
        self.offsets, self.masses, self.centres = number["offsets"], number["masses"], number["centres"]
        self.inertias, self.armature = number["inertias"], number["armature"]
        self.slides = number["slides"].astype(bool)
        self.ratios, self.shift = number["ratios"], number["shift"]
        self.process = [number.get(key, np.zeros(6)) for key in PROCESS]
        self._springs = [number.get(key, np.zeros(len(self.armature))) for key in SPRINGS]
        self._knots = number.get(TIMES)
        self.mount, self.mount_rotation = number["mount_position"], number["mount_rotation"]
        self.gravity, self.about = gravity, about
        self.n = len(self.masses)

    def turns(self, q: Form) -> Turns:
        """The value (N,) of each joint and, if it turns, its cosine and sine; q (n, N) coordinates."""
        values = linear(self.ratios, q) + self.shift[:, None]
        return [(values[i], None if self.slides[i] else cos_sin(values[i])) for i in range(self.n)]

    def against_springs(self, q: Form) -> Form:
        """Torques (m, N) of drives that springs beside them ask for, at coordinates q (m, N).

        Both ends of a spring act on links beside its joint, or on the base, so that the wrench on the base is
        as without it.
        """
        at_zero, stiffness = (entry[:, None] for entry in self._springs)
        return q * stiffness + -at_zero

    def loads(
        self, q: Form, turns: Turns, qd: Form, qdd: Form, ends: np.ndarray, driven: Driven | None = None
    ) -> tuple[Form, Form]:
        """Torques (m, N) and the wrench (6, N) on the base about its centre of mass, without what it needs
        itself.

        q (m, N) are coordinates, turns of them; ends (2, N), s: from when to when; driven: None: it rests.
        """
        moved = self.accelerations(turns, qd, qdd, self.gravity, driven)
        bodies_moved = zip(self.masses, self.centres, self.inertias, moved, strict=True)
        forces, moments = zip(
            *(inertial(m, centre, inertia, placed) for m, centre, inertia, placed in bodies_moved),
            strict=True,
        )
        F, M = (-part for part in self.process_load(turns, ends))
        needed: list[Form] = []
        for i in reversed(range(self.n)):
            if i < self.n - 1:
                lever = self.offsets[i]
                M = M + linear(skew(lever), F)
                if self.slides[i + 1]:
                    M = M + linear(skew(self.rotations[i + 1][:, 2]), F) * turns[i + 1][0]
            F, M = F + forces[i], M + moments[i]
            needed.insert(0, (F if self.slides[i] else M)[2])
            moved = _out_of(self.rotations[i], turns[i][1], _columns(F, M))
            F, M = moved[:, 0], moved[:, 1]
        M = M + linear(skew(self.mount - self.about), F)
        if self.slides[0]:
            M = M + linear(skew(self.rotations[0][:, 2]), F) * turns[0][0]
        torques = linear(self.ratios.T, stack(*needed)) + qdd * self.armature[:, None]
        return torques + self.against_springs(q), -joined(F, M)

    def process_load(self, turns: Turns, ends: np.ndarray) -> tuple[Form, Form]:
        """Force and moment (3, N) of the process on the last link, about its frame's origin, in its axes.

        ends (2, N), s: from when to when.
        """
        both = [self._process_between(part, ends) for part in self.process]
        (F, M), on_link = ([form[:3], form[3:]] for form in both)
        if np.any(self.process[0]):
            moved = _columns(F, M)
            for A, (_, turn) in zip(self.rotations, turns, strict=True):
                moved = _into(A, turn, moved)
            F, M = moved[:, 0], moved[:, 1]
        F = F + on_link[0]
        return F, M + on_link[1] + linear(skew(self.offsets[-1]), F)

    def _process_between(self, part: np.ndarray, ends: np.ndarray) -> Form:
        """(6, N): the line between its values at both ends, and how far it is from that in between."""
        if self._knots is None:
            return Form.of(np.broadcast_to(part[:, None], (6, ends.shape[1])))
        left, right = (np.array([np.interp(end, self._knots, column) for column in part.T]) for end in ends)
        middle, half = 0.5 * (left + right), 0.5 * (right - left)
        steep = np.max(np.abs(np.diff(part, axis=0)) / np.diff(self._knots)[:, None], axis=0, initial=0.0)
        off = np.repeat((_SLACK * steep)[:, None], ends.shape[1], axis=1)
        first, last = np.searchsorted(self._knots, ends)
        for k in range(int(np.max(last - first, initial=0))):
            inside = np.flatnonzero(first + k < last)
            knot = first[inside] + k
            s = 2 * (self._knots[knot] - ends[0, inside]) / (ends[1] - ends[0])[inside] - 1
            away = np.abs(part[knot].T - middle[:, inside] - half[:, inside] * s)
            off[:, inside] = np.maximum(off[:, inside], away + (_SLACK * steep)[:, None])
        size = np.abs(left) + np.abs(right) + np.max(np.abs(part), axis=0, initial=0.0)[:, None]
        return Form.of(middle, half, radius=off + U * size)

    def shares(
        self, turns: Turns, qd: Form, qdd: Form, driven: Driven | None
    ) -> list[tuple[list[Motion], Driven | None]]:
        """Motions of the links' frames without gravity, and of the base, as a sum.

        It is of what is proportional to the square of the joints' speeds, to these times those of the base,
        and to the square of the base's speeds; of a base that rests it is the first alone.
        """
        none = np.zeros(3)
        joints = self.accelerations(turns, qd, qdd, none)
        if driven is None:
            return [(joints, None)]
        both = self.accelerations(turns, qd, qdd, none, driven)
        base = self.accelerations(turns, qd * 0.0, qdd * 0.0, none, driven)
        rows = zip(both, joints, base, strict=True)
        mixed = [_less(*row) for row in rows]
        return [(joints, None), (mixed, None), (base, driven)]

    def accelerations(
        self, turns: Turns, qd: Form, qdd: Form, gravity: np.ndarray, driven: Driven | None = None
    ) -> list[Motion]:
        """Motion of each link's frame, accelerations less gravity."""
        speeds, changes = linear(self.ratios, qd), linear(self.ratios, qdd)
        count = qd.r.shape[-1]
        omega = domega = Form.of(np.zeros((3, count)))
        acceleration = Form.of(np.broadcast_to(-gravity[:, None], (3, count)))
        squares = Form.of(np.zeros((6, count)))
        if driven is not None:
            omega, (origin, domega, squares) = driven
            acceleration = acceleration + origin + _swing(self.mount, domega, squares)
        results = []
        for i in range(self.n):
            if i or self.slides[i]:
                lever = self.offsets[i - 1] if i else np.zeros(3)
                acceleration = acceleration + _swing(lever, domega, squares)
                if self.slides[i]:
                    along = _swing(self.rotations[i][:, 2], domega, squares)
                    acceleration = acceleration + along * turns[i][0]
            moved = _into(self.rotations[i], turns[i][1], _columns(acceleration, omega, domega))
            acceleration, omega, domega = moved[:, 0], moved[:, 1], moved[:, 2]
            cross = stack(omega[1], -omega[0]) * speeds[i]  # omega x z qd
            if self.slides[i]:
                acceleration = _plus(acceleration, cross * 2.0, changes[i])
            else:
                domega = _plus(domega, cross, changes[i])
                omega = _plus(omega, None, speeds[i])
            squares = _products(omega)
            results.append((acceleration, domega, squares))
        return results

    def velocities(self, turns: Turns, qd: Form) -> list[tuple[Form, Form]]:
        """Velocity of the origin of each link's frame, and angular velocity, (3, N), in its axes."""
        speeds = linear(self.ratios, qd)
        v = omega = Form.of(np.zeros((3, qd.r.shape[-1])))
        results = []
        for i in range(self.n):
            if i:
                v = v + linear(-skew(self.offsets[i - 1]), omega)  # omega x lever
            if i and self.slides[i]:
                v = v + linear(-skew(self.rotations[i][:, 2]), omega) * turns[i][0]
            moved = _into(self.rotations[i], turns[i][1], _columns(v, omega))
            v, omega = moved[:, 0], moved[:, 1]
            if self.slides[i]:
                v = _plus(v, None, speeds[i])
            else:
                omega = _plus(omega, None, speeds[i])
            results.append((v, omega))
        return results

    def frames(self, turns: Turns) -> list[tuple[Form, Form]]:
        """Rotation (3, 3, N) of each link to base axes, first the mount's, and its origin (3, N)."""
        count = turns[0][0].r.shape[-1]
        R = Form.of(np.broadcast_to(np.eye(3)[:, :, None], (3, 3, count)))
        p = Form.of(np.broadcast_to(self.mount[:, None], (3, count)))
        out = [(times_rows(R, self.mount_rotation), p)]
        for i, (value, turn) in enumerate(turns):
            if i:
                p = p + times_rows(R, self.offsets[i - 1])
            R = times_rows(R, self.rotations[i])
            if turn is None:
                p = p + R[:, 2] * value
            else:
                x, y = R[:, 0], R[:, 1]
                R = _columns(x * turn[0] + y * turn[1], y * turn[0] - x * turn[1], R[:, 2])
            out.append((R, p))
        return out


def driven(velocities: Form, rates: Form) -> Driven:
    """Of a base with velocities forward, sideways and turning, in its axes, and rates of change, (3, N)."""
    v, w = velocities[:2], velocities[2]
    nothing = w * 0.0
    omega = stack(nothing, nothing, w)
    acceleration = stack(rates[0] - v[1] * w, rates[1] + v[0] * w, nothing)
    return omega, (acceleration, stack(nothing, nothing, rates[2]), _products(omega))


def inertial(mass: float, centre: np.ndarray, inertia: np.ndarray, motion: Motion) -> tuple[Form, Form]:
    """Force and moment (3, N), about its frame's origin, that a body in a frame that moves so needs."""
    acceleration, domega, squares = motion
    f = (acceleration + _swing(centre, domega, squares)) * mass
    return f, linear(inertia, domega) + linear(_gyroscopic(inertia), squares) + linear(skew(centre), f)


def turned(R: Form, v: Form) -> Form:
    """R (3, 3, N) times v (3, N)."""
    return dot(Form(np.swapaxes(R.c, 1, 2), np.swapaxes(R.r, 0, 1)), v[:, None])


def crossed(a: Form, b: Form) -> Form:
    """a x b, (3, N) each."""
    return a[[1, 2, 0]] * b[[2, 0, 1]] - a[[2, 0, 1]] * b[[1, 2, 0]]


def _less(whole: Motion, *parts: Motion) -> Motion:
    a, b, c = (x - y - z for x, y, z in zip(whole, *parts, strict=True))
    return a, b, c


def _products(omega: Form) -> Form:
    return omega[[0, 1, 2, 0, 0, 1]] * omega[[0, 1, 2, 1, 2, 2]]


def _swing(lever: np.ndarray, domega: Form, squares: Form) -> Form:
    return linear(-skew(lever), domega) + linear(_centripetal(lever), squares)


def _plus(v: Form, xy: Form | None, z: Form) -> Form:
    """v (3, N) plus (x, y, z)."""
    head = v[:2] if xy is None else v[:2] + xy
    tail = v[2] + z
    return joined(head, tail[None])


def _columns(*vectors: Form) -> Form:
    return stack(*vectors, axis=1)
