"""Does a base on ordinary feet in one plane have a solution that moves? Decided on Coulomb's true cones.

A rigid base that moves does one of few things with its feet: all of them stay in the plane, or those of an
edge or a corner of the support polygon do and the others lift off, or all lift off. In each of these cases
the sliding of all feet follows from three numbers, the motion in the plane (two translations, one
rotation). The direction d of that motion is a point of a sphere, and for a given d everything is linear:

    M (P d s + E e) = w + sum_k N_k (n - mu_k u_k(d) / |u_k(d)|),    s, e, N_k >= 0    (columns E: tipping)

The search covers the sphere by triangles. In a triangle the velocity u_k of a foot lies in the cone of its
velocities at the corners, so its friction in the arc between them; put instead the polygon around that arc,
or around the whole circle if the velocity may vanish, and a linear program with six equations is left that
has a solution wherever the triangle holds a motion. A triangle without one is discarded with a certificate
(Farkas: z with z'column <= 0 for all columns and z'w > 0), others are cut in four. Candidates are
refined by Newton's method on the laws themselves. So the work grows with the number of feet times that
of the triangles, not with the number of mode combinations, and there are no facets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.cone_motion import (
    CLEAR_MOTION,
    SEPARATE,
    SLIDE,
    STICK,
    ConeProblem,
    MotionSearch,
    ordinary_contacts,
)
from ocptip.contact.mode_search import EXHAUSTED, FOUND, LIMIT, linear_program
from ocptip.contact.states import ContactState
from ocptip.contact.support import Support
from ocptip.numerics.non_negative import non_negative
from ocptip.numerics.vectors import skew

_IN_PLANE = 1e-9  # relative to the support's length, and of the unit normals
_ARC_POINTS = 5
_DISC_POINTS = 8  # at the first depth; doubled at every second one
_MOST_DISC_POINTS = 256
_INFEASIBLE = 1e-7  # residual, relative to the load, from which a triangle counts as empty
_POWERLESS = 1e-10
_DEEPEST = 16
_CANDIDATES = 6  # per case and depth
_IN_PLANE_AXES, _TIPPING_AXES = [0, 1, 5], [2, 3, 4]


def feet_share_a_plane(support: Support) -> bool:
    """True for ordinary contacts with equal normals and positions in one plane across them."""
    if support.dimension != 3 or not all(type(c) is UnilateralContact for c in support.contacts):
        return False
    normals = support.frames[:, :, 0]
    heights = (support.arms - support.arms[0]) @ normals[0]
    return bool(
        np.max(np.abs(normals - normals[0])) <= _IN_PLANE
        and np.max(np.abs(heights)) <= _IN_PLANE * support.length
    )


def find_planar_motion(problem: ConeProblem, max_programs: int) -> MotionSearch:
    """Search for a solution that moves; the problem's feet must share a plane.

    Args:
        problem: feet and wrench.
        max_programs: limit of the number of linear programs.
    """
    if not np.any(problem.load):
        return MotionSearch(EXHAUSTED, None, 0)
    search = _FeetCaseSearch(problem, max_programs)
    result = search.run()
    status = FOUND if result is not None else LIMIT if search.resolution else EXHAUSTED
    return MotionSearch(status, result, search.programs, search.resolution)


class _Plane:
    """The problem in axes of the plane (t1, t2, n) about the feet's centre, in units of length, mass, force.

    Attributes:
        mass_matrix: (6, 6) about the centre, divided by the mass and (for rotations) the length.
        load: (6,) the wrench there, largest element 1.
        feet: (n, 2) positions.
        velocity: (n, 2, 3) velocity of each foot in the plane per planar motion (vx, vy, rotation).
        normal: (6, n) wrench of a unit normal force; tangential: (n, 6, 2) of unit forces along t1, t2.
    """

    def __init__(self, support: Support, wrench: np.ndarray) -> None:
        self.support = support
        axes = support.frames[0][:, [1, 2, 0]]
        center = support.arms.mean(axis=0)
        self.length = float(np.max(np.linalg.norm(support.arms - center, axis=1))) or support.length
        to_mass = -center @ axes / self.length  # centre of mass seen from the centre
        turned = np.kron(np.eye(2), axes)
        motion = np.eye(6)
        motion[:3, 3:] = -skew(to_mass)
        scaling = np.r_[np.ones(3), np.full(3, 1 / self.length)]
        self.motion = turned @ (scaling[:, None] * motion)
        # the velocity of the centre of mass is v + w x p with w = rotation / length, p = to_mass * length
        mass = np.linalg.inv(support.inverse_mass)
        self.mass_matrix = self.motion.T @ mass @ self.motion / support.mass
        load = self.motion.T @ wrench
        self.unit = float(np.max(np.abs(load)))
        self.load = load / (self.unit or 1.0)
        self.feet = (support.arms - center) @ axes[:, :2] / self.length
        self.friction = np.array([c.friction for c in ordinary_contacts(support)])
        n, (x, y) = len(self.feet), self.feet.T
        self.velocity = np.zeros((n, 2, 3))
        self.velocity[:, 0, 0] = self.velocity[:, 1, 1] = 1.0
        self.velocity[:, 0, 2], self.velocity[:, 1, 2] = -y, x
        self.heights = np.column_stack([np.ones(n), y, -x])  # lift of each foot per (vz, rotations x, y)
        self.normal = np.zeros((6, n))
        self.normal[_TIPPING_AXES] = self.heights.T
        self.tangential = np.zeros((n, 6, 2))
        self.tangential[:, _IN_PLANE_AXES] = self.velocity.swapaxes(1, 2)
        self.axes = axes

    def in_contact_axes(self, forces: np.ndarray) -> np.ndarray:
        """(n, 3) forces t1, t2, n in plane axes and units to contact axes, N."""
        base = forces @ self.axes.T * self.unit
        return np.einsum("kji,kj->ki", self.support.frames, base)

    def acceleration(self, motion: np.ndarray) -> np.ndarray:
        """(6,) acceleration of the base about its centre of mass, m/s^2, rad/s^2, in base axes."""
        return self.motion @ motion * self.unit / self.support.mass


@dataclass(frozen=True)
class _FeetCase:
    """Which feet stay down, and the tipping motions (6, e) that lift the others, each with a factor >= 0."""

    feet: np.ndarray
    tipping: np.ndarray


def _cases(plane: _Plane) -> Iterator[_FeetCase]:
    """All feet down; those of an edge of their hull; those of a corner."""
    feet, everyone = plane.feet, np.arange(len(plane.feet))
    spread, directions = np.linalg.svd(feet, full_matrices=True)[1:]
    rank = int(np.sum(spread > _IN_PLANE))
    about = []  # rotations about the line or the point that all feet share
    for direction in directions[rank:]:
        about += [direction, -direction]
    free = [np.r_[0.0, g] for g in about]
    yield _FeetCase(everyone, _tipping(free))
    if rank == 0:
        return
    if rank == 1:
        along = feet @ directions[0]
        for sign in (1.0, -1.0):
            lowest = np.min(sign * along)
            up = np.r_[-lowest, sign * directions[0]]
            yield _FeetCase(np.flatnonzero(sign * along <= lowest + _IN_PLANE), _tipping([*free, up]))
        return
    edges: dict[tuple[int, ...], np.ndarray] = {}
    for i in everyone:
        for j in everyone:
            side = feet[j] - feet[i]
            size = np.linalg.norm(side)
            if size <= _IN_PLANE:
                continue
            inward = np.array([-side[1], side[0]]) / size
            lift = (feet - feet[i]) @ inward
            if np.min(lift) >= -_IN_PLANE:
                members = tuple(np.flatnonzero(lift <= _IN_PLANE).tolist())
                edges.setdefault(members, np.r_[-feet[i] @ inward, inward])
    for members, lift in edges.items():
        yield _FeetCase(np.array(members), _tipping([lift]))
    corners: dict[tuple[int, ...], list[np.ndarray]] = {}
    for k in everyone:
        here = tuple(np.flatnonzero(np.linalg.norm(feet - feet[k], axis=1) <= _IN_PLANE).tolist())
        lifts = [lift for members, lift in edges.items() if k in members]
        if len(lifts) == 2:
            corners[here] = lifts
    for members, lifts in corners.items():
        yield _FeetCase(np.array(members), _tipping(lifts))


def _tipping(lifts: list[np.ndarray]) -> np.ndarray:
    """(6, e) motions out of the plane whose lift is c + g'position, for (c, g) in lifts."""
    motions = np.zeros((6, len(lifts)))
    for j, (c, gx, gy) in enumerate(lifts):
        motions[_TIPPING_AXES, j] = c, gy, -gx
    return motions


class _FeetCaseSearch:
    """The search over all cases."""

    def __init__(self, problem: ConeProblem, max_programs: int) -> None:
        self.problem, self.max_programs = problem, max_programs
        self.plane = plane = _Plane(problem.support, problem.wrench)
        self.programs = 0
        self.resolution = 0.0  # rad, above zero if the search is cut short
        self.free = np.linalg.solve(plane.mass_matrix, plane.load)
        self.clear = CLEAR_MOTION * float(np.linalg.norm(self.free))
        # bound of the sum of all unknowns, from the power: a'Ma <= load'a
        smallest, *_, largest = np.linalg.eigvalsh(plane.mass_matrix)
        motion = np.sqrt(plane.load @ self.free / smallest)
        self.largest = float(10 * (np.linalg.norm(plane.load) + (1 + largest) * motion))

    def run(self) -> ContactState | None:
        """A moving solution; None if there is none, or if the search was cut short."""
        plane = self.plane
        if np.min(plane.heights @ self.free[_TIPPING_AXES]) >= 0.0:
            return self._proved(
                _FeetCase(np.arange(0), np.zeros((6, 0))), self.free, np.zeros((len(plane.feet), 3))
            )
        open_cases = []
        for case in _cases(plane):
            result = self._without_sliding(case)
            if result is not None:
                return result
            open_cases.append((case, _octahedron(), set()))
        for depth in range(_DEEPEST + 1):
            left = []
            for case, triangles, pivots in open_cases:
                if self.programs + len(triangles) > self.max_programs:
                    self.resolution = _size(triangles)
                    return None
                kept, guesses, turned = self._filter(case, triangles, depth)
                for result in self._candidates(case, guesses, turned - pivots if depth else set()):
                    return result
                pivots |= turned
                if len(kept):
                    left.append((case, _quartered(kept), pivots if depth else set()))
            open_cases = left
        if open_cases:
            self.resolution = max(_size(triangles) for _, triangles, _ in open_cases)
        return None

    def _candidates(self, case: _FeetCase, guesses, turned: set[int]) -> Iterator[ContactState]:
        """Moving solutions that turn about a foot, or near the guesses."""
        for foot in turned:
            x, y = self.plane.feet[case.feet[foot]]
            for sign in (1.0, -1.0):  # either way
                yield from self._along(case, sign * np.array([y, -x, 1.0]), outer=False)[1]
        for y, normal in guesses[:_CANDIDATES]:
            result = self._sliding(case, y, normal)
            if result is not None:
                yield result

    def _filter(self, case: _FeetCase, triangles: np.ndarray, depth: int):
        """Triangles that may hold a motion, guesses (motion, normal forces) in them, and feet turned about.

        Triangles are (T, 3, 3): a corner per row.
        """
        plane = self.plane
        tipping_power = plane.load @ case.tipping
        power = triangles @ plane.load[_IN_PLANE_AXES]
        hopeful = np.max(power, axis=1) > _POWERLESS
        if np.any(tipping_power > _POWERLESS):
            hopeful[:] = True
        triangles = triangles[hopeful]
        m = len(case.feet)
        velocity, normal = plane.velocity[case.feet], plane.normal[:, case.feet]
        tangential, friction = plane.tangential[case.feet], plane.friction[case.feet]
        corners = np.einsum("kir,tcr->tkci", velocity, triangles)  # (T, m, 3, 2)
        starts, widths = _arcs(corners)
        whole = np.isnan(widths)
        points = _arc_points(np.where(whole, 0.0, starts), np.where(whole, 0.0, widths))  # (T, m, q, 2)
        # column of a force N (n - mu t): minus its wrench
        arcs = np.einsum("kir,tkqr->tikq", np.asarray(friction)[:, None, None] * tangential, points)
        arcs -= normal[None, :, :, None]
        arcs[np.broadcast_to(whole[:, None, :, None], arcs.shape)] = 0.0
        arcs = arcs.reshape(len(triangles), 6, m * _ARC_POINTS)
        count = min(_DISC_POINTS * 2 ** (depth // 2), _MOST_DISC_POINTS)
        discs = [
            friction[k] * tangential[k] @ _polygon(count, outer=True).T - normal[:, k : k + 1]
            for k in range(m)
        ]
        inertia = np.einsum("ir,tcr->tic", plane.mass_matrix[:, _IN_PLANE_AXES], triangles)
        tipping = plane.mass_matrix @ case.tipping
        e = tipping.shape[1]
        kept, guesses, turned = [], [], set()
        for t in range(len(triangles)):
            full = np.flatnonzero(whole[t])
            A = np.hstack([inertia[t], tipping, arcs[t], *(discs[k] for k in full)])
            x = self._feasible(A)
            if x is None:
                continue
            kept.append(t)
            if len(full) < m or m == 1:
                turned |= {int(k) for k in full}
            shares = x[3 + e : 3 + e + m * _ARC_POINTS].reshape(m, -1).sum(axis=1)
            for i, k in enumerate(full):
                index = 3 + e + m * _ARC_POINTS + i * count
                shares[k] = np.sum(x[index : index + count])
            guesses.append((x[:3] @ triangles[t], shares))
        guesses.sort(key=lambda guess: -np.linalg.norm(guess[0]))
        return triangles[kept], guesses, turned

    def _feasible(self, A: np.ndarray) -> np.ndarray | None:
        """x >= 0 with A x = load, or nearly so; None only with a certificate that there is none."""
        self.programs += 1
        try:
            x, residual = non_negative(A, self.plane.load)
        except RuntimeError:  # iterations
            return np.zeros(A.shape[1])
        if residual <= _INFEASIBLE:
            return x
        z = self.plane.load - A @ x
        worst = max(float(np.max(z @ A)), 0.0)
        if z @ self.plane.load > self.largest * worst:
            return None
        return x

    def _sliding(self, case: _FeetCase, y: np.ndarray, normal: np.ndarray) -> ContactState | None:
        """A moving solution near a motion in the plane, in which every foot of the case slides."""
        plane = self.plane
        u = plane.velocity[case.feet] @ y
        speed = np.linalg.norm(u, axis=1, keepdims=True)
        if np.min(speed) <= _IN_PLANE * np.linalg.norm(y):
            return None
        forces = np.zeros((len(plane.feet), 3))
        forces[case.feet, :2] = -(plane.friction[case.feet] * normal)[:, None] * u / speed
        forces[case.feet, 2] = normal
        motion = np.zeros(6)
        motion[_IN_PLANE_AXES] = y
        return self._proved(case, motion, forces)

    def _proved(self, case: _FeetCase, motion: np.ndarray, forces: np.ndarray) -> ContactState | None:
        """A moving solution near a motion (6,) and forces (n, 3), in the plane's axes and units."""
        plane = self.plane
        u = plane.velocity @ motion[_IN_PLANE_AXES]
        slides = np.linalg.norm(u, axis=1) > _IN_PLANE * np.linalg.norm(motion)
        what = np.full(len(plane.feet), SEPARATE, dtype=object)
        what[case.feet] = np.where(slides[case.feet], SLIDE, STICK)
        return self.problem.motion(list(what), plane.acceleration(motion), plane.in_contact_axes(forces))

    def _without_sliding(self, case: _FeetCase) -> ContactState | None:
        """A moving solution that tips while the feet that stay down stick."""
        if np.max(self.plane.load @ case.tipping, initial=0.0) <= _POWERLESS:
            return None
        speed, _ = self._along(case, None, outer=True)
        if speed <= self.clear:
            return None
        for result in self._along(case, None, outer=False)[1]:
            return result
        self.resolution = max(self.resolution, 2 * np.pi / _MOST_DISC_POINTS)
        return None

    def _along(self, case: _FeetCase, direction: np.ndarray | None, outer: bool):
        """Largest motion in one direction of the plane (or none) and tipping, and the solution, if proved.

        Feet without velocity stick; their circle of friction is replaced by a polygon in or around it.
        """
        plane = self.plane
        motions = case.tipping
        if direction is not None:
            sliding = np.zeros((6, 1))
            sliding[_IN_PLANE_AXES, 0] = direction
            motions = np.hstack([sliding, motions])
        forces = []
        for foot in case.feet:
            u = np.zeros(2) if direction is None else plane.velocity[foot] @ direction
            speed = np.linalg.norm(u)
            t = _polygon(_MOST_DISC_POINTS, outer) if speed <= _IN_PLANE else u[None] / speed
            forces.append(np.column_stack([-plane.friction[foot] * t, np.ones(len(t))]))
        owner = np.repeat(case.feet, [len(f) for f in forces])
        forces = np.vstack(forces)
        pushes = plane.normal[:, owner] + np.einsum("jic,jc->ij", plane.tangential[owner], forces[:, :2])
        A = np.hstack([plane.mass_matrix @ motions, -pushes])
        if self._feasible(A) is None:
            return 0.0, []
        sizes = np.linalg.norm(motions, axis=0)
        cost = np.r_[-sizes, np.zeros(len(owner))]
        program = linear_program(cost, A, plane.load)
        self.programs += 1
        if program is None or program.status != 0 or -program.fun <= self.clear:
            return 0.0, []
        rates, shares = np.split(program.x, [len(sizes)])
        total = np.zeros((len(plane.feet), 3))
        np.add.at(total, owner, shares[:, None] * forces)
        result = None if outer else self._proved(case, motions @ rates, total)
        return -program.fun, [] if result is None else [result]


def _octahedron() -> np.ndarray:
    """(8, 3, 3) triangles of unit vectors that cover the sphere."""
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)], dtype=float)
    return signs[:, :, None] * np.eye(3)


def _quartered(triangles: np.ndarray) -> np.ndarray:
    """(4 T, 3, 3) triangles between the corners and the middles of the sides."""
    a, b, c = triangles.swapaxes(0, 1)
    ab, bc, ca = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a + b, b + c, c + a))
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def _size(triangles: np.ndarray) -> float:
    """Longest side of all triangles (rad)."""
    return float(np.max(np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2), initial=0.0))


def _arcs(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start, width of the arc of directions in the cone of vectors (..., 3, 2); width NaN: any direction."""
    angles = np.sort(np.arctan2(corners[..., 1], corners[..., 0]), axis=-1)
    gaps = np.append(angles[..., 1:], angles[..., :1] + 2 * np.pi, axis=-1) - angles
    widest = np.argmax(gaps, axis=-1)[..., None]
    width = 2 * np.pi - np.take_along_axis(gaps, widest, axis=-1)[..., 0]
    start = np.take_along_axis(angles, (widest + 1) % 3, axis=-1)[..., 0]
    vanishing = np.min(np.linalg.norm(corners, axis=-1), axis=-1) <= _IN_PLANE
    return start, np.where(vanishing | (width >= np.pi - 1e-6), np.nan, width)


def _arc_points(start: np.ndarray, width: np.ndarray) -> np.ndarray:
    """(..., _ARC_POINTS, 2) corners of a polygon around an arc of the unit circle, its ends among them."""
    parts = _ARC_POINTS - 2
    shares = np.r_[0.0, (np.arange(parts) + 0.5) / parts, 1.0]
    angles = start[..., None] + width[..., None] * shares
    radius = np.ones((*width.shape, _ARC_POINTS))
    radius[..., 1:-1] = 1 / np.cos(width / (2 * parts))[..., None]
    return radius[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _polygon(count: int, outer: bool) -> np.ndarray:
    """(count, 2) corners of a regular polygon around the unit circle, or in it."""
    angles = 2 * np.pi * np.arange(count) / count
    radius = 1 / np.cos(np.pi / count) if outer else 1.0
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])
