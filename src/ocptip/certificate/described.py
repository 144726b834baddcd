"""What is claimed of a motion in the world as described: contacts, limits and distances over intervals.

Over one interval the contact forces are those at its ends, interpolated, and corrected by one fixed linear
map so that they hold the base exactly. If these forces stay in their sets, the contacts can hold the base
throughout; the share of the friction that they use bounds GT from above. NumPy and plain data only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Any

import numpy as np

from ocptip.certificate.arm import Arm, Turns, linear_rows, skew
from ocptip.certificate.forms import Form, U, linear
from ocptip.certificate.plain import ROUNDED

RELATIVE = 1e-5  # of themselves: by so much may speeds and accelerations exceed their limits: rounded times
ANGLE = 1e-7  # rad or m, likewise
_FLAT = 1e-9

Directions = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Intervals:
    """Coordinates, speeds and accelerations of a motion over intervals, forms (n, N).

    Args:
        motion: of a certificate.
        piece: (N,) of which piece.
        start, end: (N,) ends of the intervals in u.
    """

    def __init__(
        self, motion: Mapping[str, Any], piece: np.ndarray, start: np.ndarray, end: np.ndarray
    ) -> None:
        times = np.array(motion["times"], dtype=float)[piece]
        c = np.moveaxis(np.array(motion["angles"], dtype=float)[piece], 0, 2)  # (n, degrees, N)
        self.piece, middle = piece, 0.5 * (start + end)
        u = Form.of(middle, 0.5 * (end - start) * (1 + U) + U)  # a little further than both ends
        half_time = 0.5 * (times[:, 1] - times[:, 0])
        rate = np.where(half_time > 0, 1 / np.where(half_time > 0, half_time, 1.0), 0.0)
        values = []
        for order in range(3):
            values.append(_horner(c, u) * rate**order)
            c = c[:, 1:] * np.arange(1, c.shape[1])[:, None]
        self.q, self.qd, self.qdd = values
        self.times = 0.5 * (times[:, 0] + times[:, 1]) + middle * half_time


def _horner(c: np.ndarray, u: Form) -> Form:
    """Polynomials (n, degrees, N) at u (N,); their coefficients may be rounded."""
    value = Form.of(np.zeros_like(c[:, 0]))
    for k in reversed(range(c.shape[1])):
        value = value * u + Form.of(c[:, k], radius=U * np.abs(c[:, k]))
    return value


class Checker:
    """What is claimed of a motion, interval by interval.

    Args:
        model, bounds: of a certificate.

    Attributes:
        flat: all contacts lie on one plane: moments about tipping axes follow from the wrench alone.
        couples: (axes, 6): wrenches that a motion must bear besides its own, each alone, where they are not.
    """

    def __init__(self, model: Mapping[str, Any], bounds: Mapping[str, float]) -> None:
        self.bounds = bounds
        base, contacts = model["base"], model["contacts"]
        gravity, about = np.array(base["gravity"], dtype=float), np.array(base["center_of_mass"], dtype=float)
        self.weight = np.concatenate([base["mass"] * gravity, np.zeros(3)])
        self.arm = Arm(model["arm"], gravity, about)
        self.limits = {
            key: np.array([_end(x, key == "angle_min") for x in own]) for key, own in model["limits"].items()
        }
        positions, frames = np.array(contacts["positions"]), np.array(contacts["frames"])
        levers = np.array([skew(arm) for arm in positions - about])
        self.grasp = np.concatenate([np.hstack(list(frames)), np.hstack(list(levers @ frames))])
        reach = np.concatenate([np.hstack(list(frames)), np.hstack(list(np.abs(levers) @ np.abs(frames)))])
        self.rounded = U * np.abs(reach)
        self.sets = [
            [(_end(low, True), _end(high), radius, slope) for low, high, radius, slope in pieces]
            for pieces in contacts["sets"]
        ]
        self.flat = _one_plane(positions, frames[:, :, 0])
        self.axes, self.added = _tipping_axes(positions, frames[:, :, 0], about, self.sets)
        self.lever = float(np.max(np.abs(about)) + np.max(np.abs(positions)))
        self.blurred = U * np.array([[4 * self.lever] * 3 + [4.0] * 3])
        self.scale = max(float(np.linalg.norm(self.weight)), 1e-9)
        self.unit = float(base["reference_moment"] or 1.0)
        self.needed = self.unit * (1 / bounds["GN"] - 1)  # N m that must be left about each axis
        if base["reference_moment"] is None and len(self.axes):
            self.needed = np.inf  # nothing says what is asked for
        self.couples = np.zeros((0 if self.flat else len(self.axes), 6))
        self.couples[:, 3:] = -self.needed * self.axes[: len(self.couples), 3:]
        self.bodies, self.pairs = model["bodies"], np.array(model["pairs"], dtype=int).reshape(-1, 2)
        self._inverses: dict[bytes, tuple[np.ndarray, float]] = {}

    def loads(self, at: Intervals) -> tuple[Turns, Form, Form]:
        """Cosines and sines, torques (n, N) and the wrench (6, N) that the contacts have to hold."""
        turns = self.arm.turns(at.q)
        torques, wrench = self.arm.loads(turns, at.qd, at.qdd)
        return turns, torques, wrench + self.weight[:, None]

    @np.errstate(invalid="ignore", over="ignore", divide="ignore")
    def margins(
        self, at: Intervals, loads: tuple[Turns, Form, Form], forces: np.ndarray, directions: Directions
    ) -> dict[str, np.ndarray]:
        """By how much each claim is kept, (N,) each: proved where >= 0; -inf where nothing is known.

        Args:
            at: N intervals.
            loads: of them.
            forces: (2, 1 + couples, contacts, 3, N) at their ends, normal and tangential, N. A contact
                without force at both ends carries none.
            directions: of intervals and pairs, (R,) each: (R, 4), 0 (base axes) or 1 (those of the first's
                link), and a direction along which the pair's second is beyond the first.
                Asked where balls about the two come nearer than claimed.
        """
        limits, bounds = self.limits, self.bounds
        turns, torques, wrench = loads
        found = self.contact_margins(wrench, forces)
        found["torque"] = 1 - _share(torques, bounds["torque_ratio"] * limits["torque"])
        found["speed"] = 1 + RELATIVE - _share(at.qd, limits["speed"])
        found["acceleration"] = 1 + RELATIVE - _share(at.qdd, limits["acceleration"])
        low, high = at.q.range
        room = np.minimum(low - limits["angle_min"][:, None], limits["angle_max"][:, None] - high)
        found["angle"] = np.min(room, axis=0) + ANGLE
        if len(self.pairs):
            found["clearance"] = np.min(self._gaps(at, turns, directions), axis=0) - bounds["clearance"]
        return {name: np.where(np.isnan(value), -np.inf, value) for name, value in found.items()}

    @np.errstate(invalid="ignore", over="ignore")
    def contact_margins(self, wrench: Form, forces: np.ndarray) -> dict[str, np.ndarray]:
        """Those of `margins` that are about the contacts; wrench (6, N) on the base."""
        margins = {
            "contacts": self._held(wrench, forces[:, 0], self.bounds["GT"]),
            "tip-over": self._upright(wrench, forces),
        }
        return {name: np.where(np.isnan(value), -np.inf, value) for name, value in margins.items()}

    def _upright(self, wrench: Form, forces: np.ndarray) -> np.ndarray:
        count = wrench.r.shape[-1]
        if self.flat:
            least = linear(self.axes, wrench).range[0] + self.added[:, None]
            least -= self.blurred @ wrench.size  # of the axes' own rounding
            return (np.min(least, axis=0, initial=np.inf) - self.needed) / self.unit
        held = [
            self._held(wrench + couple[:, None], forces[:, 1 + k], 1.0)
            for k, couple in enumerate(self.couples)
        ]
        return np.min(held, axis=0) if held else np.full(count, np.inf)

    def _held(self, wrench: Form, forces: np.ndarray, share: float) -> np.ndarray:
        """How far forces that hold wrenches (6, N) are inside a share of their sets, per weight."""
        count = wrench.r.shape[-1]
        room = np.full(count, np.inf)
        patterns, which = np.unique(np.any(forces != 0, axis=(0, 2)), axis=1, return_inverse=True)
        for number, pattern in enumerate(patterns.T):
            here = np.flatnonzero(which.reshape(-1) == number)
            columns = np.repeat(pattern, 3)
            correction, defect = self.inverse(columns)
            if not np.isfinite(defect):  # these contacts cannot hold every wrench
                room[here] = -np.inf
                continue
            ends = forces[:, pattern][..., here].reshape(2, -1, len(here))
            chosen = Form.of(0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]))
            rest = linear(self.grasp[:, columns], chosen)
            rest = Form(rest.c, rest.r + self.rounded[:, columns] @ chosen.size) + wrench[:, here]
            left = defect * np.max(rest.size + rest.r, axis=0)  # what the correction leaves, corrected again
            f = chosen - linear(correction, rest)
            f = Form(f.c, f.r + np.abs(correction).sum(axis=1)[:, None] * left)
            for k, contact in enumerate(np.flatnonzero(pattern)):
                own = [self._inside(f[3 * k : 3 * k + 3], *piece, share) for piece in self.sets[contact]]
                room[here] = np.minimum(room[here], np.max(own, axis=0))
            for contact in np.flatnonzero(~pattern):
                if not any(low <= 0 <= high and radius >= 0 for low, high, radius, _ in self.sets[contact]):
                    room[here] = -np.inf
        return room

    def _inside(
        self, f: Form, low: float, high: float, radius: float, slope: float, share: float
    ) -> np.ndarray:
        """Of forces (3, N) and one piece of their set: normal force from low to high, tangential force at
        most the share of radius + slope times the normal force."""
        normal, first, second = f[0], f[1], f[2]
        least, greatest = normal.range
        limit = (normal * slope + radius) * share
        cone = (limit * limit - first * first - second * second).range[0] / self.scale
        return np.min([least - low, high - greatest, limit.range[0], cone], axis=0) / self.scale

    def inverse(self, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """A right inverse F of some contacts' grasp matrix G, and a bound of d / (1 - d) with d = |1 - G F|.

        Without one, or with a poor one, the bound is infinite, and nothing is proved.
        """
        key = columns.tobytes()
        if key not in self._inverses:
            G = self.grasp[:, columns]
            F = np.linalg.pinv(G) if G.shape[1] else np.zeros((0, 6))
            rounding = (self.rounded[:, columns] + U * G.shape[1] * np.abs(G)) @ np.abs(F)
            defect = float(np.max(np.sum(np.abs(np.eye(6) - G @ F) + rounding, axis=1)))
            self._inverses[key] = F, (defect / (1 - defect) if defect < 0.5 else np.inf)
        return self._inverses[key]

    def _gaps(self, at: Intervals, turns: Turns, directions: Directions) -> np.ndarray:
        """Lower bounds of the distances of pairs, (pairs, N), m; NaN where no direction separates them."""
        frames, count = self.arm.frames(turns), len(at.piece)
        centres, radii = np.zeros((len(self.bodies), 3, count)), np.full((len(self.bodies), count), np.inf)
        for k, body in enumerate(self.bodies):
            if "normal" not in body:
                centres[k], radii[k] = _ball(frames, body, count)
        a, b = self.pairs.T
        gaps = np.linalg.norm(centres[a] - centres[b], axis=1) * (1 - U) - (radii[a] + radii[b]) * (1 + U)
        for pair, (i, j) in enumerate(self.pairs):
            if "normal" in (half_space := self.bodies[j]):  # the points with normal . p >= level
                normal = np.tile(np.array(half_space["normal"])[:, None], count)
                height, level = self._height(frames, self.bodies[i], normal), half_space["level"]
                gaps[pair] = level - height - (U + 2 * ROUNDED) * (1 + abs(level) + np.abs(height))
        near = np.argwhere(~(gaps >= self.bounds["clearance"]))
        near = near[["normal" not in self.bodies[self.pairs[pair, 1]] for pair in near[:, 0]]]
        towards = directions(near[:, 1], near[:, 0]) if len(near) else np.empty((0, 4))
        keys = np.column_stack([near[:, 0], towards[:, 0] == 1]) if len(near) else near
        for pair, linked in np.unique(keys, axis=0):
            rows = np.all(keys == (pair, linked), axis=1)
            intervals, d = near[rows, 1], towards[rows, 1:].T
            d = d / np.linalg.norm(d, axis=0)  # not a number where it is too short to have a length
            some = [(R[..., intervals], p[..., intervals]) for R, p in frames]
            i, j = self.pairs[pair]
            gaps[pair, intervals] = self._apart(some, self.bodies[i], self.bodies[j], d, bool(linked))
        return gaps

    def _apart(
        self,
        frames: list[tuple[Form, Form]],
        first: Mapping[str, Any],
        second: Mapping[str, Any],
        d: np.ndarray,
        linked: bool,
    ) -> np.ndarray:
        """Lower bound, (N,), m, of how far along d (3, N), of length 1, the second is beyond the first.

        d is in base axes or, linked, turns with the first; what both do in common counts for nothing.
        """
        (R, p), (Q, q) = (_pose(frames, body["link"], d.shape[1]) for body in (first, second))
        points = np.array(first["points"])
        middle = points.mean(axis=0)
        terms = R * d[None]
        towards = terms[:, 0] + terms[:, 1] + terms[:, 2] if linked else Form.of(d)  # base axes
        terms = R * towards[:, None]
        own = Form.of(d) if linked else terms[0] + terms[1] + terms[2]  # axes of the first
        top = np.max(linear(points - middle, own).range[1], axis=0)
        parts, turned = (q - (p + linear_rows(R, middle))) * towards, Q * towards[:, None]
        along, origin = turned[0] + turned[1] + turned[2], parts[0] + parts[1] + parts[2]
        heights = linear(np.array(second["points"]), along) + Form(origin.c[:, None], origin.r[None])
        low, radii = np.min(heights.range[0], axis=0), first["radius"] + second["radius"]
        loose = U + 6 * len(frames) * ROUNDED  # rounded subtractions, and axes that are not quite orthonormal
        return low - top - radii - loose * (1 + np.abs(points).sum(axis=1).max() + np.abs(low) + top + radii)

    def _height(self, frames: list[tuple[Form, Form]], body: Mapping[str, Any], d: np.ndarray) -> np.ndarray:
        """Upper bound of d . p of all points p of a body, (N,), m times |d|; d (3, N), base axes."""
        R, p = _pose(frames, body["link"], d.shape[1])
        turned, moved = R * d[:, None], p * d
        along, origin = turned[0] + turned[1] + turned[2], moved[0] + moved[1] + moved[2]
        heights = linear(np.array(body["points"]), along) + Form(origin.c[:, None], origin.r[None])
        return np.max(heights.range[1], axis=0) + body["radius"] * np.linalg.norm(d, axis=0) * (1 + U)


def _pose(frames: list[tuple[Form, Form]], link: int, count: int) -> tuple[Form, Form]:
    """Rotation (3, 3, N) and origin (3, N) of a link; -1: the base."""
    if link >= 0:
        return frames[link]
    return Form.of(np.tile(np.eye(3)[:, :, None], count)), Form.of(np.zeros((3, count)))


def _ball(
    frames: list[tuple[Form, Form]], body: Mapping[str, Any], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Centre (3, N) and radius (N,), m, base axes, of balls that hold a body throughout the intervals."""
    points = np.array(body["points"])
    middle = points.mean(axis=0)
    reach = (np.max(np.linalg.norm(points - middle, axis=1)) + body["radius"]) * (1 + U)
    R, p = _pose(frames, body["link"], count)
    place = p + linear_rows(R, middle)
    moved = place.size - np.abs(place.c[0]) + place.r + U * np.abs(place.c[0])
    return place.c[0], reach + np.linalg.norm(moved, axis=0) * (1 + U)


def _end(value: float | None, least: bool = False) -> float:
    """A number; None: none, minus infinity for least ones."""
    return (-np.inf if least else np.inf) if value is None else float(value)


def _share(values: Form, limits: np.ndarray) -> np.ndarray:
    """Greatest share of limits (n,) that values (n, N) use."""
    low, high = values.range
    return np.max(np.maximum(high, -low) / limits[:, None], axis=0) * (1 + U)


def _one_plane(positions: np.ndarray, normals: np.ndarray) -> bool:
    centred = positions - positions.mean(axis=0)
    extent = float(np.max(np.linalg.norm(centred, axis=1)))
    level = np.max(np.abs(centred @ normals[0])) <= _FLAT * extent
    return bool(level and np.max(np.linalg.norm(normals - normals[0], axis=1)) <= _FLAT)


def _tipping_axes(
    positions: np.ndarray, normals: np.ndarray, about: np.ndarray, sets: list[list[Any]]
) -> tuple[np.ndarray, np.ndarray]:
    """Lines of two contacts round which all others can only let go: rows (axes, 6) and numbers (axes,).

    Row times wrench (about `about`) plus number is the moment about the line of what the normal forces have
    left before their contacts let go, for contacts on one plane.
    """
    rows, added, extent = [], [], float(np.max(np.linalg.norm(positions - positions.mean(axis=0), axis=1)))
    lower = np.array([min(piece[0] for piece in pieces) for pieces in sets])
    upper = np.array([max(piece[1] for piece in pieces) for pieces in sets])
    for i, j in combinations(range(len(positions)), 2):
        e = positions[j] - positions[i]
        if np.linalg.norm(e) <= _FLAT * extent:
            continue
        e = e / np.linalg.norm(e)
        lifts = np.einsum("kd,kd->k", normals, np.cross(e, positions - positions[i]))
        lifts[np.abs(lifts) <= _FLAT * extent] = 0.0
        for lift, axis in ((lifts, e), (-lifts, -e)):
            up, down = lift > 0, lift < 0
            if np.any(lift) and np.all(np.isfinite(lower[up])) and np.all(np.isfinite(upper[down])):
                rows.append(-np.concatenate([np.cross(axis, about - positions[i]), axis]))
                added.append(float(-lift[down] @ upper[down] - lift[up] @ lower[up]))
    return np.array(rows).reshape(-1, 6), np.array(added)
