"""How the feet of a base stand on a patch of terrain: pose of the base, places and normals of the contacts.

On uneven ground three rigid feet, or legs with different strokes, decide height and slopes of the base: they
solve, for parameters p, the equations of U = (height, slopes by x and y, strokes)

    z of foot k = field(x, y of foot k),    two equations of the attitude,    mean stroke = given stroke.

With three feet and no stroke this is the plane of a tripod. Newton's method solves them for many p at once.
The nonlinear program takes U, and the slopes of the ground under the feet, as Taylor polynomials of second
order about its point, from implicit differentiation, so that its derivatives are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.numerics.batch import BatchFunction, PointFunction
from ocptip.placement.ground import ORDERS
from ocptip.placement.terrain import Patch
from ocptip.standing.arm import Robot
from ocptip.standing.footing import Footing
from ocptip.standing.tolerance import Uncertainty

GAP_TOLERANCE = 1e-7
"""Largest distance, m, of a foot from the ground where it counts as standing on it."""

_STEPS = 30
_CLOSE = 1e-13  # m
_STEEPEST = 3.0  # slope of the base up to which Newton's steps are taken
_PARALLEL = 1e-9
_THIN = 1e-4  # extents of feet on one line, relative


class Feet:
    """The contacts of a robot with the minimum friction that its tolerance allows, wherever they are.

    Args:
        robot: the robot.
        tolerance: of its base.

    Attributes:
        usual: the contacts where the robot's description has them.
    """

    def __init__(self, robot: Robot, tolerance: Uncertainty) -> None:
        self.usual = robot.weakest(tolerance)

    def at(self, places: np.ndarray, frames: np.ndarray) -> Footing:
        """Contacts at places (n, 3), m, with frames (n, 3, 3), columns n, t1, t2; base axes."""
        support = self.usual.support
        moved = [
            replace(contact, position=place, normal=frame[:, 0], tangent=frame[:, 1])
            for contact, place, frame in zip(support.contacts, places, frames, strict=True)
        ]
        return Footing(support.varied(moved), self.usual.tip_over.reference_moment)


@dataclass(frozen=True, eq=False)
class Stood:
    """Where the base stands at N parameters.

    Attributes:
        origin: (N, 3), m, base origins in the world.
        base: (N, 3, 3), base to world axes.
        contacts: (N, n, 3), m, base axes.
        frames: (N, n, 3, 3), contact frames, columns n, t1, t2 in base axes.
        strokes: (N, n), m; (N, 0) without legs.
        missed: (N,), m, how far a foot is from the ground.
    """

    origin: np.ndarray
    base: np.ndarray
    contacts: np.ndarray
    frames: np.ndarray
    strokes: np.ndarray
    missed: np.ndarray


class Stand:
    """The base of a robot on one patch.

    Args:
        patch: the patch.
        feet: of the robot.
        ground_frame: position (3,), m, and rotation (3, 3) of the ground frame in base axes.

    Attributes:
        patch, feet: as given.
        conforms: contacts move within the base as it moves over the ground.
        given: symbols of the numbers that `local` returns, for expressions of p about a point.

    Raises:
        InputError: feet that cannot conform to the ground of the patch.
    """

    def __init__(self, patch: Patch, feet: Feet, ground_frame: tuple[np.ndarray, np.ndarray]) -> None:
        self.patch, self.feet, self._frame = patch, feet, ground_frame
        self.conforms, self.given = patch.conforming is not None, []
        self._support = feet.usual.support
        if patch.conforming is None:
            return
        self._ground = patch.conforming
        position, rotation = ground_frame
        contacts = self._support.contacts
        self.n = len(contacts)
        self._refuse(rotation)
        self._places = (np.array([c.position for c in contacts]) - position) @ rotation
        k, n = self.patch.size, self.n
        p, U = cs.SX.sym("p", k), cs.SX.sym("U", 3 + n)
        near, field = cs.SX.sym("near", 2, n), cs.SX.sym("field", len(ORDERS), n)
        ground, turn = self.patch.function(p, U[:3])
        world = cs.repmat(ground, 1, n) + turn @ self._in_ground_axes(U[3:])
        heights, slopes = _expanded(world[:2, :] - near, field)
        w = cs.vertcat(U, p)
        rows = cs.vertcat(world[2, :].T - heights, self._attitude(p, U))
        v = cs.vertcat(U, cs.vec(slopes))
        self._at_feet = BatchFunction(cs.Function("feet", [p, U], [world[:2, :]]))
        jacobian = cs.jacobian(rows, U)
        self._newton = BatchFunction(cs.Function("newton", [w, near, field], [rows, jacobian]))
        results = [e for of in (rows, v) for e in (of, cs.jacobian(of, w), _twice(of, w))]
        self._derivatives = PointFunction(cs.Function("derivatives", [w, near, field], results))
        size = 3 + 3 * n
        self.given = [cs.SX.sym(name, *shape) for name, *shape in
                      (("p0", k), ("v0", size), ("v1", size, k), ("v2", size, k * k))]  # fmt: skip
        v = cs.SX.sym("v", size)
        self._geometry = BatchFunction(cs.Function("geometry", [p, v], [*self._expressions(p, v)[:4]]))
        self._last: tuple[np.ndarray, list[np.ndarray]] | None = None

    def _refuse(self, rotation: np.ndarray) -> None:
        """Raise InputError for feet that cannot conform."""
        contacts, rigid = self._support.contacts, self._ground.stroke is None
        ordinary = [isinstance(contact, UnilateralContact) for contact in contacts]
        upright = [bool(np.linalg.norm(c.normal - rotation[:, 2]) <= _PARALLEL) for c in contacts]
        reason = ""
        if not all(ordinary):
            number = ordinary.index(False)
            reason = f"needs ordinary contacts, contact {number + 1} is {contacts[number].kind!r}"
        elif not all(upright):
            reason = f"contact {upright.index(False) + 1} has a normal; normals follow from the ground"
        elif rigid and len(contacts) != 3:
            reason = f"{len(contacts)} feet need legs (stroke); without legs there are three"
        elif len(contacts) < 3 or np.divide(*self._spread()[1::-1]) < _THIN:
            reason = "needs three feet that are not on one line"
        if reason:
            raise InputError(f"terrain {self.patch.name!r}: uneven ground: {reason}")

    def _spread(self) -> np.ndarray:
        """Extents of the feet, the largest first, m."""
        arms = self._support.arms
        return np.maximum(np.linalg.svd(arms - arms.mean(axis=0), compute_uv=False), GAP_TOLERANCE)

    # --- equations -----------------------------------------------------------------------------------------

    def _in_ground_axes(self, strokes: cs.SX) -> cs.SX:
        """Feet (3, n), m, in the axes of the ground frame."""
        return cs.SX(self._places.T) - cs.vertcat(cs.SX.zeros(2, self.n), strokes.T)

    def _attitude(self, p: cs.SX, U: cs.SX) -> cs.SX:
        """Three rows that vanish where the base has its attitude and the legs their mean stroke."""
        wanted = p[3] if self._ground.stroke is not None else 0.0
        mean = cs.sum1(U[3:]) / self.n - wanted
        if self._ground.attitude == "level":
            return cs.vertcat(U[1:3], mean)
        across = self._places[:, :2] - self._places[:, :2].mean(axis=0)
        return cs.vertcat(cs.SX(across.T) @ U[3:], mean)

    def _expressions(self, p: cs.SX, v: cs.SX) -> tuple[cs.SX, cs.SX, cs.SX, cs.SX, cs.SX]:
        """Origin (3,), base (3, 3), contacts (3, n), frames (9, n) by columns, strokes (n,), from p and v."""
        n, (position, rotation) = self.n, self._frame
        U, slopes = v[: 3 + n], cs.reshape(v[3 + n :], 2, n)
        ground, turn = self.patch.function(p, U[:3])
        base = turn @ cs.SX(rotation.T)
        contacts = cs.repmat(cs.SX(position), 1, n) + cs.SX(rotation) @ self._in_ground_axes(U[3:])
        frames = []
        for k, contact in enumerate(self._support.contacts):
            normal = cs.vertcat(-slopes[:, k], 1) / cs.sqrt(1 + cs.sumsqr(slopes[:, k]))
            tilt = _least_turn(np.asarray(contact.normal), base.T @ normal)
            frames.append(cs.vec(tilt @ cs.SX(contact.frame)))
        return ground - base @ cs.SX(position), base, contacts, cs.horzcat(*frames), U[3:]

    def _solved(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """U (N, 3 + n), the ground's slopes (N, n, 2) under the feet, and how far feet are off it (N,), m."""
        field, N, n = self._ground.field, len(parameters), self.n
        U = np.zeros((N, 3 + n))
        if self._ground.stroke is not None:
            U[:, 3:] = parameters[:, 3:]
        U[:, 0] = field.heights(parameters[:, :2]) + U[:, 3]
        if self._ground.attitude == "ground":
            places = self._at_feet(parameters, U)[0].transpose(0, 2, 1)
            heights = field.heights(places.reshape(-1, 2)).reshape(N, n)
            middle = places - places.mean(axis=1, keepdims=True)
            U[:, 1:3] = (np.linalg.pinv(middle) @ heights[:, :, None])[:, :, 0]
        known, missed = np.zeros((N, n, len(ORDERS))), np.full(N, np.inf)
        moving = np.arange(N)
        for _ in range(_STEPS):
            places = self._at_feet(parameters[moving], U[moving])[0].transpose(0, 2, 1)
            known[moving, :, :3] = field.slopes(places.reshape(-1, 2)).reshape(len(moving), n, 3)
            w = np.hstack([U[moving], parameters[moving]])
            rows, jacobian = self._newton(
                w, places.reshape(len(moving), -1), known[moving].reshape(len(moving), -1)
            )
            missed[moving] = np.max(np.abs(rows), axis=1)
            step = np.linalg.solve(jacobian, rows[:, :, None])[:, :, 0]
            going = (missed[moving] > _CLOSE) & np.all(np.isfinite(step), axis=1)
            moving, step = moving[going], step[going]
            if not len(moving):
                break
            U[moving] -= step
            U[moving, 1:3] = np.clip(U[moving, 1:3], -_STEEPEST, _STEEPEST)
        return U, known[:, :, 1:3], missed

    # --- places --------------------------------------------------------------------------------------------

    def ground(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origins (N, 3), m, and rotations (N, 3, 3) of the ground frame in the world."""
        if not self.conforms:
            return self.patch.poses(parameters)
        stood, (position, rotation) = self.at(parameters), self._frame
        return stood.origin + stood.base @ position, stood.base @ rotation

    def at(self, parameters: np.ndarray) -> Stood:
        """Where the base and its contacts are at parameters (N, k)."""
        parameters = np.atleast_2d(parameters)
        position, rotation = self._frame
        N, support = len(parameters), self._support
        if not self.conforms:
            ground, turn = self.patch.poses(parameters)
            base = turn @ rotation.T
            contacts = np.broadcast_to(support.arms + support.center_of_mass, (N, support.n_contacts, 3))
            frames = np.broadcast_to(support.frames, (N, *support.frames.shape))
            return Stood(ground - base @ position, base, contacts, frames, np.empty((N, 0)), np.zeros(N))
        U, slopes, missed = self._solved(parameters)
        v = np.hstack([U, slopes.reshape(N, -1)])
        origin, base, contacts, frames = self._geometry(parameters, v)
        strokes = U[:, 3:] if self._ground.stroke is not None else np.empty((N, 0))
        frames = frames.transpose(0, 2, 1).reshape(N, self.n, 3, 3).transpose(0, 1, 3, 2)
        return Stood(origin, base, contacts.transpose(0, 2, 1), frames, strokes, missed)

    def footing(self, parameters: np.ndarray) -> Footing:
        """The contacts at one place, parameters (k,)."""
        if not self.conforms:
            return self.feet.usual
        stood = self.at(parameters)
        return self.feet.at(stood.contacts[0], stood.frames[0])

    # --- expressions ---------------------------------------------------------------------------------------

    def expressions(self, p: cs.SX) -> tuple[cs.SX, cs.SX, cs.SX, cs.SX, cs.SX]:
        """Origin (3,), m, base (3, 3), contacts (3, n), m, frames (9, n) by columns, strokes (n,), m.

        They have exact values and two exact derivatives by p at the point for which `local` gives the numbers
        for the symbols `given`.
        """
        if self.conforms:
            p0, v0, v1, v2 = self.given
            step = p - p0
            return self._expressions(p, v0 + v1 @ step + v2 @ cs.vec(step @ step.T) / 2)
        position, rotation = self._frame
        ground, turn = self.patch.function(p)
        base, support = turn @ cs.SX(rotation.T), self._support
        contacts = cs.SX((support.arms + support.center_of_mass).T)
        frames = cs.SX(np.array([frame.ravel(order="F") for frame in support.frames]).T)
        return ground - base @ cs.SX(position), base, contacts, frames, cs.SX.zeros(support.n_contacts)

    def local(self, p: np.ndarray) -> list[np.ndarray]:
        """Numbers for `given` at parameters p (k,)."""
        if not self.conforms:
            return []
        if self._last is None or not np.array_equal(self._last[0], p):
            self._last = p.copy(), self._expanded_at(p)
        return self._last[1]

    def _expanded_at(self, p: np.ndarray) -> list[np.ndarray]:
        U = self._solved(p[None])[0][0]
        near = self._at_feet(p[None], U[None])[0][0]
        field = self._ground.field.derivatives(near.T).T
        w, k, m = np.concatenate([U, p]), len(p), len(U)
        _, F1, F2, v, E1, E2 = self._derivatives(w, near, field)
        inverse = np.linalg.inv(F1[:, :m])
        along = np.vstack([-inverse @ F1[:, m:], np.eye(k)])

        def bent(second: np.ndarray) -> np.ndarray:
            return np.einsum("ai,rab,bj->rij", along, second.reshape(-1, m + k, m + k), along)

        twice = -np.tensordot(inverse, bent(F2), axes=1)
        second = bent(E2) + np.tensordot(E1[:, :m], twice, axes=1)
        return [p.copy(), v, E1 @ along, second.reshape(len(v), k * k)]


def _twice(rows: cs.SX, w: cs.SX) -> cs.SX:
    """Second derivatives (rows, size^2)."""
    return cs.vertcat(*(cs.vec(cs.hessian(row, w)[0]).T for row in cs.vertsplit(rows)))


def _expanded(step: cs.SX, field: cs.SX) -> tuple[cs.SX, cs.SX]:
    """Heights (n,) and slopes (2, n) of the Taylor polynomials of `ORDERS` (10, n) at steps (2, n)."""
    x, y, rows = step[0, :], step[1, :], [cs.SX.zeros(1, step.size2()) for _ in range(3)]
    for r, (i, j) in enumerate(ORDERS):
        share = field[r, :] / (factorial(i) * factorial(j))
        rows[0] += share * x**i * y**j
        rows[1] += i * share * x ** max(i - 1, 0) * y**j
        rows[2] += j * share * x**i * y ** max(j - 1, 0)
    return rows[0].T, cs.vertcat(*rows[1:])


def _least_turn(start: np.ndarray, end: cs.SX) -> cs.SX:
    """The rotation (3, 3) by the smallest angle that turns one unit vector into another."""
    v, c = cs.cross(cs.SX(start), end), cs.dot(cs.SX(start), end)
    skew = cs.skew(v)
    return cs.SX.eye(3) + skew + skew @ skew / (1 + c)
