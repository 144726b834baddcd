"""Lower bounds of the distances of pairs of solids, for all pairs and states at once; and of straight lines
in joint space, whether all their states keep a clearance.

Bounds come from capsules that enclose the solids, and from the planes of boxes and half spaces, which are
much closer for a board of a shelf.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from ocptip.numerics.jit.compiled import compiled
from ocptip.robots.collision.gaps import Collisions
from ocptip.robots.collision.shapes import Box, HalfSpace, Shape, enclosing_capsule
from ocptip.robots.model import ArmModel

_TINY = 1e-12
_ROUNDED = 1e-8  # m: of bounds by planes, which may be exact


class DistanceBounds:
    """Lower bounds of the distances of pairs.

    Args:
        shapes: of the solids.
        bodies: (S,) of each solid; the last body is the one at rest, or -1.
    """

    def __init__(self, shapes: Sequence[Shape], bodies: np.ndarray) -> None:
        self._bodies = bodies
        self._ends, self._radii = np.zeros((len(shapes), 2, 3)), np.full(len(shapes), np.inf)
        for s, shape in enumerate(shapes):
            if not isinstance(shape, HalfSpace):
                self._ends[s], self._radii[s] = enclosing_capsule(shape)
        planes = [_planes(shape) for shape in shapes]
        self._planes = np.concatenate([np.empty((0, 4)), *planes])
        self._begins = np.cumsum([0, *(len(plane) for plane in planes)])
        self._pairs = np.empty((0, 2), dtype=int)

    def of(self, pairs: np.ndarray) -> DistanceBounds:
        """Those of these pairs (m, 2) of numbers of solids."""
        other = copy(self)
        other._pairs = pairs
        return other

    def __call__(
        self, axes: np.ndarray, origins: np.ndarray, enough: float | np.ndarray = np.inf
    ) -> np.ndarray:
        """(N, m), m, where the bodies have these axes (N, K, 3, 3) and origins (N, K, 3).

        Bounds above `enough` (m; one for all, or (m,)) need not be close.
        """
        values = np.empty((len(axes), len(self._pairs)))
        bodies = self._bodies % axes.shape[1]
        solids = self._ends, self._radii, self._planes, self._begins
        wanted = np.asarray(enough, dtype=float) if np.ndim(enough) else np.full(len(self._pairs), enough)
        _bounds(axes, origins, bodies, *solids, self._pairs, wanted, values)
        return values

    def on_line(
        self, arm: ArmModel, steepest: np.ndarray, begin: np.ndarray, end: np.ndarray, clearance: float
    ) -> tuple[bool, int]:
        """Whether the bounds prove that a line keeps a clearance, and of how many states they were computed.

        Args:
            arm: whose links are the bodies.
            steepest: (m, n) of the pairs, see `steepest_slopes`.
            begin, end: (n,) each, rad (sliding joints: m).
            clearance: m.
        """
        moved = end - begin
        if (coupling := arm.coupling) is not None:
            begin, end = (coupling.ratios * q[coupling.leaders] + coupling.offsets for q in (begin, end))
        chain = arm.mount_rotation, arm.mount_position, arm.rotations, arm.offsets, arm.slides
        solids = self._bodies, self._ends, self._radii, self._planes, self._begins
        tested = _on_line(begin, end, moved, clearance, steepest, *chain, *solids, self._pairs)
        return tested > 0, abs(tested)


def _planes(shape: Shape) -> np.ndarray:
    """Outward normals and levels (f, 4), body axes, of a half space or a box: inside n . p + level <= 0."""
    if isinstance(shape, HalfSpace):
        normal = shape.rotation @ shape.normal
        return np.array([[*-normal, shape.distance + normal @ shape.position]])
    if not isinstance(shape, Box):
        return np.empty((0, 4))
    normals = np.vstack([shape.rotation.T, -shape.rotation.T])
    return np.column_stack([normals, -normals @ shape.position - 0.5 * np.tile(shape.size, 2)])


@compiled
def _bounds(axes, origins, bodies, ends, radii, planes, begins, pairs, enough, result):
    placed, faces = np.empty((len(bodies), 2, 3)), np.empty((len(planes), 4))
    reach = np.empty(len(bodies))  # of balls about the capsules
    for s in range(len(bodies)):
        square = 0.0
        for i in range(3):
            square += (ends[s, 1, i] - ends[s, 0, i]) ** 2
        reach[s] = radii[s] + 0.5 * np.sqrt(square)
    for n in range(len(axes)):
        for s in range(len(bodies)):
            k = bodies[s]
            for i in range(3):
                for end in range(2):
                    placed[s, end, i] = origins[n, k, i]
                    for j in range(3):
                        placed[s, end, i] += axes[n, k, i, j] * ends[s, end, j]
            for p in range(begins[s], begins[s + 1]):
                faces[p, 3] = planes[p, 3]
                for i in range(3):
                    faces[p, i] = 0.0
                    for j in range(3):
                        faces[p, i] += axes[n, k, i, j] * planes[p, j]
                    faces[p, 3] -= faces[p, i] * origins[n, k, i]
        for m in range(len(pairs)):
            a, b = pairs[m, 0], pairs[m, 1]
            square = 0.0
            for i in range(3):
                between = placed[a, 0, i] + placed[a, 1, i] - placed[b, 0, i] - placed[b, 1, i]
                square += between * between
            bound = 0.5 * np.sqrt(square) - (reach[a] + reach[b]) - _ROUNDED
            for side in range(2):
                flat, solid = pairs[m, side], pairs[m, 1 - side]
                for p in range(begins[flat], begins[flat + 1]):
                    if bound < enough[m]:
                        low = high = faces[p, 3]
                        for i in range(3):
                            low += faces[p, i] * placed[solid, 0, i]
                            high += faces[p, i] * placed[solid, 1, i]
                        bound = max(bound, min(low, high) - radii[solid] - _ROUNDED)
            balls = reach[a] == radii[a] and reach[b] == radii[b]
            if bound < enough[m] and radii[a] < np.inf and radii[b] < np.inf and not balls:
                bound = max(bound, between_lines(placed[a], placed[b]) - (radii[a] + radii[b]))
            result[n, m] = bound


@compiled
def between_lines(first, second):
    """Distance, m, of line segments given by their ends (2, 3), m.

    Three exact steps give the nearest points, each within its segment.
    """
    a, b, c, e, f = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        along, across = first[1, i] - first[0, i], second[1, i] - second[0, i]
        between = first[0, i] - second[0, i]
        a += along * along
        b += along * across
        c += along * between
        e += across * across
        f += across * between
    a, e = max(a, _TINY), max(e, _TINY)
    s = min(max((b * f - c * e) / max(a * e - b * b, _TINY * a * e), 0.0), 1.0)
    t = min(max((b * s + f) / e, 0.0), 1.0)
    s = min(max((b * t - c) / a, 0.0), 1.0)
    square = 0.0
    for i in range(3):
        along, across = first[1, i] - first[0, i], second[1, i] - second[0, i]
        apart = first[0, i] - second[0, i] + s * along - t * across
        square += apart * apart
    return np.sqrt(square)


FIRST = 0.1
"""m: what solids move at most between the first sample and the ends of its interval."""

LAST = 5e-4
"""m: of the smallest intervals. A line that is nearer to the clearance than this counts as not clear."""


@compiled
def _on_line(
    begin, end, moved, clearance, steepest, mount, position, rotations, offsets, slides,
    bodies, ends, radii, planes, begins, pairs,
):  # fmt: skip
    """The number of states of which bounds were computed; negative: they prove nothing."""
    links, most, tested, left = len(begin), 0.0, 0, len(pairs)
    swept, near = np.zeros(left), pairs  # of the pairs that are not proved to be apart all the way
    for m in range(left):
        for j in range(len(moved)):
            swept[m] += abs(moved[j]) * steepest[m, j]
        most = max(most, swept[m])
    count = 1 + int(most / (2 * FIRST))
    half, middles = 0.5 / count, np.empty(count)
    for k in range(count):
        middles[k] = (k + 0.5) / count
    joints, bodies_at_rest = np.empty(links), np.empty(len(bodies), np.int64)
    for s in range(len(bodies)):
        bodies_at_rest[s] = bodies[s] if bodies[s] >= 0 else links
    axes, origins = np.empty((1, links + 1, 3, 3)), np.empty((1, links + 1, 3))
    while count > 0:
        needed, gaps, is_near = np.empty(left), np.empty((1, left)), np.zeros(left, np.bool_)
        for m in range(left):
            needed[m] = clearance + half * swept[m]
        halves, kept = np.empty(2 * count), 0
        for k in range(count):
            tested += 1
            for j in range(links):
                joints[j] = begin[j] + middles[k] * (end[j] - begin[j])
            _place(joints, mount, position, rotations, offsets, slides, axes[0], origins[0])
            _bounds(axes, origins, bodies_at_rest, ends, radii, planes, begins, near, needed, gaps)
            nearer = False
            for m in range(left):
                if gaps[0, m] < clearance:
                    return -tested
                if gaps[0, m] < needed[m]:
                    nearer = is_near[m] = True
            if nearer:
                halves[kept], halves[kept + 1] = middles[k] - 0.5 * half, middles[k] + 0.5 * half
                kept += 2
        half *= 0.5
        if kept > 0 and half * most < LAST:
            return -tested
        among, left = left, 0
        for m in range(among):
            left += is_near[m]
        nearest, moves, row = np.empty((left, 2), np.int64), np.empty(left), 0
        for m in range(among):
            if is_near[m]:
                nearest[row, 0], nearest[row, 1], moves[row] = near[m, 0], near[m, 1], swept[m]
                row += 1
        near, swept, middles, count = nearest, moves, halves, kept
    return tested


@compiled
def _place(joints, mount, position, rotations, offsets, slides, axes, origins):
    """Axes (L + 1, 3, 3) and origins (L + 1, 3), m, of an arm's links; the last body rests."""
    links = len(joints)
    turn, place, constant = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    for i in range(3):
        place[i] = position[i]
        origins[links, i] = 0.0
        for j in range(3):
            turn[i, j] = mount[i, j]
            axes[links, i, j] = 1.0 if i == j else 0.0
    for k in range(links):
        for i in range(3):
            for j in range(3):
                constant[i, j] = 0.0
                for other in range(3):
                    constant[i, j] += turn[i, other] * rotations[k, other, j]
        c, s, shift = np.cos(joints[k]), np.sin(joints[k]), 0.0
        if slides[k]:
            c, s, shift = 1.0, 0.0, joints[k]
        for i in range(3):
            turn[i, 0] = c * constant[i, 0] + s * constant[i, 1]
            turn[i, 1] = c * constant[i, 1] - s * constant[i, 0]
            turn[i, 2] = constant[i, 2]
            place[i] += shift * constant[i, 2]
        for i in range(3):
            origins[k, i] = place[i]
            for j in range(3):
                axes[k, i, j] = turn[i, j]
                place[i] += turn[i, j] * offsets[k, j]


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
    values = np.zeros((len(bodies), arm.links))
    for solid, body in enumerate(bodies):
        beyond = about[solid]  # distance of any point from the origin of the link behind the joint
        for joint in range(body, -1, -1):
            turning = across[solid] if joint == body else beside[joint] + beyond
            values[solid, joint] = 1.0 if arm.slides[joint] else turning
            beyond += ranges[joint] + (0.0 if joint == body else lengths[joint])
    return values


def _slide_ranges(arm: ArmModel) -> np.ndarray:
    """(L,), m: how far a sliding joint may be from its zero position; 0 of joints that turn."""
    most = np.maximum(np.abs(arm.limits.angle_min), np.abs(arm.limits.angle_max))
    if arm.coupling is not None:
        most = np.abs(arm.coupling.ratios) * most[arm.coupling.leaders] + np.abs(arm.coupling.offsets)
    return np.where(arm.slides, most, 0.0)


class StraightLines:
    """Decides which states of a mechanism, and straight lines between them, keep a clearance.

    Args:
        collision: its distances.
        clearance: m, that every distance keeps.

    Attributes:
        tested: number of states whose distances were computed.
    """

    def __init__(self, collision: Collisions, clearance: float) -> None:
        self._collision, self._clearance = collision, clearance
        self.tested = 0

    def free(self, q: np.ndarray) -> bool:
        """Whether the state q (n,) keeps the clearance."""
        self.tested += 1
        needed = np.full(len(self._collision.labels), self._clearance)
        return self._collision.proved(q[None], self._clearance, needed) is not None

    def clear(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether every state from begin to end, (n,) each, keeps the clearance; False: not proved."""
        on_line = self._collision.on_line(begin, end, self._clearance)
        if on_line is not None:
            self.tested += on_line[1]
            return on_line[0]
        swept = self._collision.approach((end - begin)[None])[0]
        most = float(np.max(swept, initial=0.0))
        count = max(1, int(np.ceil(most / (2 * FIRST))))
        half, middles = 0.5 / count, (np.arange(count) + 0.5) / count
        while middles.size:
            needed = self._clearance + half * swept
            self.tested += len(middles)
            states = begin + middles[:, None] * (end - begin)
            kept = self._collision.proved(states, self._clearance, needed)
            if kept is None:
                return False
            open_ones = middles[~kept]
            half *= 0.5
            if open_ones.size and half * most < LAST:
                return False
            middles = np.concatenate([open_ones - half, open_ones + half])
        return True
