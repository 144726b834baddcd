"""Torques (of sliding joints: forces) of the drives within a tolerance, over intervals of time, from above.

All joints are on time here, also after a cancel. Then a torque is a sum over bodies: a weight in an interval
times what the body asks of the joint. That has a part proportional to the square of the speed factor, and one
that is linear in gravity. The maximum over weights, speed factors, tilted gravity and a push at the gripper
has a closed form that is convex in these parts. They are polynomials of s, and so means of their Bernstein
coefficients: on the whole interval no torque is greater than the form's largest value at these. Plain data
and NumPy only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ocptip.certificate.trusted.arm import Arm, Driven, crossed, times_rows, turned
from ocptip.certificate.trusted.bodies import bodies, paces
from ocptip.certificate.trusted.forms import BERNSTEIN, Form, K, U, dot, linear, stack
from ocptip.certificate.trusted.late import Rows
from ocptip.certificate.trusted.plain import SPRING_SHARE


class Drives:
    """Maximum torques.

    Args:
        model, tolerance: of a certificate.
    """

    def __init__(self, model: Mapping[str, Any], tolerance: Mapping[str, Any]) -> None:
        self._own, self._payload = tolerance, model["payload"]
        self._gravity = np.array(model["base"]["gravity"], dtype=float)
        self._arm = Arm(model["arm"], np.zeros(3), np.zeros(3))

    def greatest(
        self, q: Form, qd: Form, qdd: Form, ends: np.ndarray, driven: Driven | None = None
    ) -> np.ndarray:
        """(n, N): upper bounds of the torques' absolute values, N m or N; q, qd, qdd (n, N).

        ends (2, N), s: from when to when, for what acts on the gripper; driven: None: the base rests.
        """
        arm = self._arm
        turns = arm.turns(q)
        frames = arm.frames(turns)[1:]
        factors, bent = paces(self._own, driven is not None)
        shares = [
            bodies(arm, self._payload, self._own, frames, moved)
            for moved, _ in arm.shares(turns, qd, qdd, driven)
        ]
        share = shares[0][0]
        along, about = self._screws(frames)  # (links, 3, N): a torque is about . moment + along . force
        last, origin = frames[-1]
        tool = origin + times_rows(last, arm.offsets[-1])
        force, moment = (-turned(last, part) for part in arm.process_load(turns, ends))
        process = _of_joints(along, about, force[None], (moment + crossed(origin, force))[None])[:, 0]
        moved = np.array([[i <= body.k for body in share] for i in range(arm.n)], dtype=float)[:, :, None]
        needs = [
            [stack(*(getattr(body, name) for body in coordinates)) for name in ("force", "moment")]
            for coordinates, _ in shares
        ]
        moving = [
            _of_joints(along, about, *coordinates) * moved for coordinates in needs
        ]  # (links, bodies, N)
        lever = stack(*(body.lever for body in share))
        masses = np.array([body.mass for body in share])[:, None]
        pulls = [
            -(_cross(about, lever, axis) + along[:, axis][:, None] * masses) * moved for axis in range(3)
        ]
        pushes = [_cross(about, tool[None], axis)[:, 0] + along[:, axis] for axis in range(3)]
        loose = np.zeros(moving[0].r[:, 0].shape)
        for most, (_, second) in zip(np.max(factors, axis=0), shares, strict=True):
            if second:
                turning = about[:, None] * stack(*second)[None]
                loose += most * np.sum(turning.size + turning.r, axis=(1, 2))
        coordinates = [self._coordinates(form) for form in (*pulls, *pushes, process)]
        moving = [self._coordinates(form) for form in moving]
        rotor = qdd * arm.armature[:, None]
        weights = np.array([(body.low, body.high) for body in share]).T[:, :, None]
        springs = arm.against_springs(q)
        off = springs * np.full((len(arm.armature), 1), float(self._own.get(SPRING_SHARE, 0.0)))
        share = self._greatest(
            weights,
            moving,
            coordinates[:3],
            coordinates[3:6],
            coordinates[6] + springs,
            rotor,
            off,
            factors,
            bent,
        )
        return share + np.abs(arm.ratios.T) @ loose

    def shares(self, rows: Rows, limits: np.ndarray) -> np.ndarray:
        """(R,): upper bounds of torques over limits (n,), for all values of further numbers in the states."""
        q, qd, qdd = (
            Form(form.c[:K], form.r + np.sum(np.abs(form.c[K:]), axis=0) * (1 + U))
            for form in (rows.q, rows.qd, rows.qdd)
        )
        return np.max(self.greatest(q, qd, qdd, rows.ends) / limits[:, None], axis=0) * (1 + U)

    def _coordinates(self, form: Form) -> Form:
        """Torques, or their parts, of joints, (links, ...), as those of the drives' coordinates."""
        flat = linear(
            self._arm.ratios.T, Form(form.c.reshape(K, self._arm.n, -1), form.r.reshape(self._arm.n, -1))
        )
        shape = (len(flat.r), *form.r.shape[1:])
        return Form(flat.c.reshape(K, *shape), flat.r.reshape(shape))

    def _screws(self, frames: list[tuple[Form, Form]]) -> tuple[Form, Form]:
        along, about = [], []
        for (R, p), slides in zip(frames, self._arm.slides, strict=True):
            axis, nothing = R[:, 2], Form.of(np.zeros(p.r.shape))
            along.append(axis if slides else crossed(p, axis))
            about.append(nothing if slides else axis)
        return stack(*along), stack(*about)

    def _greatest(
        self,
        weights: np.ndarray,
        moving: list[Form],
        pulls: list[Form],
        pushes: list[Form],
        process: Form,
        rotor: Form,
        springs: Form,
        factors: np.ndarray,
        bent: np.ndarray,
    ) -> np.ndarray:
        """The closed form.

        Args:
            weights: (2, bodies, 1), minimum and maximum.
            moving: shares (n, bodies, N) of what motion asks for, see `Arm.shares`.
            pulls: three of these, by the components of gravity.
            pushes: three (n, N), by those of a push at the gripper.
            process, rotor: (n, N), constant, springs included, and proportional to the square of the speed
                factor for rotors.
            springs: (n, N), by which these may be off, of either sign.
            factors, bent: see `paces`; the first factor is the square of the speed factor.
        """
        g, tilt, push = self._gravity, float(self._own["tilt"]), float(self._own["push"])
        mean, half = 0.5 * (weights[0] + weights[1]), 0.5 * (weights[1] - weights[0])
        off = float(np.linalg.norm(g)) * tilt * (1 + U)  # by so much gravity changes at most
        forms = (*pulls, *pushes, process, rotor, springs)
        at_nodes = [np.tensordot(BERNSTEIN, form.c, axes=1) for form in forms]
        shares = np.stack([np.tensordot(BERNSTEIN, form.c, axes=1) for form in moving])
        pulled, level = np.stack(at_nodes[:3]), sum(g[axis] * at_nodes[axis] for axis in range(3))
        y = np.sum(mean * pulled, axis=3)  # (3, nodes, n, N)
        along, across = np.tensordot(g, y, axes=1), np.linalg.norm(np.cross(y, g, axis=0), axis=0)
        pushed = push * np.linalg.norm(np.stack(at_nodes[3:6]), axis=0) + np.abs(at_nodes[8])
        turned_by = np.sum(half * off * np.linalg.norm(pulled, axis=0), axis=2)
        best = np.full(along.shape, -np.inf)
        for factor in factors:
            moved = np.tensordot(factor, shares, axes=1)
            still = np.sum(mean * moved, axis=2) + factor[0] * at_nodes[7] + at_nodes[6]
            spread = np.sum(half * np.abs(moved + level), axis=2) + turned_by + pushed
            for sign in (1.0, -1.0):
                best = np.maximum(best, sign * still + _over_cap(sign * along, across, tilt) + spread)
        most = np.maximum(np.abs(weights[0]), np.abs(weights[1]))
        far, fast = np.abs(g) + off, np.max(factors, axis=0)

        def whole(of: Callable[[Form], np.ndarray]) -> np.ndarray:
            bodies = sum(
                f * of(body_form) for f, body_form in zip((*fast, *far), (*moving, *pulls), strict=True)
            )
            rest = of(process) + fast[0] * of(rotor) + push * sum(map(of, pushes)) + of(springs)
            return np.sum(most * bodies, axis=1) + rest

        error, size = whole(lambda form: form.r), whole(lambda form: form.size)
        # Factors that are not between their ends alone, see `paces`.
        error += np.sum(
            most * sum(b * (factor.size + factor.r) for b, factor in zip(bent, moving, strict=True)), axis=1
        )
        return (np.max(best, axis=0) + error) * (1 + U) + 16 * U * size


def _of_joints(along: Form, about: Form, force: Form, moment: Form) -> Form:
    """(links, bodies, N) of screws (links, 3, N) and forces and moments (bodies, 3, N)."""
    lines, wrenches = _sides(along, about), _sides(force, moment)
    return dot(_first(lines)[:, :, None], _first(wrenches)[:, None])


def _sides(a: Form, b: Form) -> Form:
    """(m, 6, N) of two (m, 3, N)."""
    return Form(np.concatenate([a.c, b.c], axis=2), np.concatenate([a.r, b.r], axis=1))


def _first(form: Form) -> Form:
    """(m, 6, N) as (6, m, N)."""
    return Form(np.swapaxes(form.c, 1, 2), np.swapaxes(form.r, 0, 1))


def _cross(about: Form, lever: Form, axis: int) -> Form:
    """(links, bodies, N): a component of about (links, 3, N) x lever (bodies, 3, N)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    return about[:, i][:, None] * lever[:, j][None] - about[:, j][:, None] * lever[:, i][None]


def _over_cap(along: np.ndarray, across: np.ndarray, tilt: float) -> np.ndarray:
    """Maximum y . g with g tilted by up to `tilt`, from y . g and norm(y x g) before."""
    rim = along * np.cos(tilt) + across * np.sin(tilt)
    inside = (along > 0) & (across * np.cos(tilt) <= along * np.sin(tilt))
    return np.where(inside, np.hypot(along, across), rim)
