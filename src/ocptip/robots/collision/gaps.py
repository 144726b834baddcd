"""Signed distances of a mechanism, the pairs that they are between, and nearest points."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.robots.model import ArmModel

CLEARANCE = 0.01
"""m: smallest distance of what may collide where none is asked for: models and drives are not exact."""

SAME = 1e-6
"""m: distances that differ less are of bodies that do not move towards each other."""

POSTURES = 200
"""Random postures in which pairs that never part are detected."""

NEVER = "never part"
"""Why such pairs are left out."""

UNSEEN = "never part as convex solids, their meshes do"
"""Begins the reason where a collision of the meshes may go unseen."""

MEETING = "neighbours over two joints whose axes meet, convex solids mostly overlap"
"""Begins the reason of such pairs; a collision of them may go unseen."""

TOUCHING = 1e-3
"""Solids nearer than this, m, in all of these postures never part."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Nearest points of some pairs at some states, r rows.

    Attributes:
        states, pairs: (r,).
        distances: (r,), m; negative: by how much they overlap.
        normals: (r, 3), unit vectors from the first to the second.
        points: (r, 2, 3), m, on the surfaces; of spheres normals and points are not known.
    """

    states: np.ndarray
    pairs: np.ndarray
    distances: np.ndarray
    normals: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 2, 3)))


@dataclass(frozen=True)
class GapLabel:
    """The two bodies that a signed distance is between.

    Attributes:
        first: sphere set and number of its sphere, counted from 1, e.g. "5[2]".
        second: another such, or the obstacle's name; solids have no number.
    """

    first: str
    second: str

    def __str__(self) -> str:
        return " and ".join(name.split("[")[0] for name in (self.first, self.second))


class Collisions:
    """Signed distances of a mechanism with n coordinates; this one has nothing to hit.

    Attributes:
        labels: one per signed distance.
        source: in words, what stands for the mechanism.
        floors: name, upward normal (3,) and level (m, along it) of each floor among the obstacles.
        apart: pairs of names that are left out, with the reason.
        links: names of links, pairs of which `excluded_links` may leave out.
        payload_unseen: the arm holds a payload without a solid.
    """

    labels: tuple[GapLabel, ...] = ()
    source = ""
    floors: tuple[tuple[str, np.ndarray, float], ...] = ()
    links: frozenset[str] = frozenset()
    payload_unseen = False
    apart: dict[frozenset[str], str]

    def __init__(self, n: int) -> None:
        self.n, self.apart = n, {}

    @cached_property
    def steepest(self) -> np.ndarray:
        """Upper bounds (m, n), m/rad, of the slopes of the signed distances in any posture."""
        return np.zeros((0, self.n))

    def gaps(self, q: np.ndarray, below: float | np.ndarray = np.inf) -> np.ndarray:
        """Signed distances (N, m) or (m,), m, at q (N, n) or (n,), rad, in the order of `labels`.

        Those above `below` (m; one for all, or (m,)) may be replaced by lower bounds above it.

        Raises:
            InputError: wrong shape or not finite.
        """
        return np.empty((*np.shape(q)[:-1], 0))

    def proved(self, q: np.ndarray, least: float, needed: np.ndarray) -> np.ndarray | None:
        """Which states q (N, n) keep the distances `needed` (m,), m: (N,) booleans.

        None as soon as one distance of any state is below `least`, m.
        """
        gaps = self.gaps(q, needed)
        return None if np.any(gaps < least) else np.all(gaps >= needed, axis=1)

    def on_line(self, begin: np.ndarray, end: np.ndarray, clearance: float) -> tuple[bool, int] | None:
        """Whether a line is clear, and of how many states that was computed, where one call of machine code
        says it, see `DistanceBounds.on_line`; else None.
        """
        return None

    def slopes(
        self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray, *, once: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances (r,), m, and slopes (r, n) over q (N, n) in rows of states and numbers of pairs (r,).

        Args:
            once: nobody will ask for just these pairs again; nothing is made ready for them.
        """
        raise NotImplementedError

    def curvature(self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray, on: np.ndarray) -> np.ndarray:
        """(N, n, n): second derivatives over q (N, n) of the sum of on (r,) times the distances, by state."""
        raise NotImplementedError

    def nearest(self, q: np.ndarray) -> Contact:
        """The nearest pair at each of the states q (N, n), rad, in their order; there must be a pair."""
        raise NotImplementedError

    def least(self, q: np.ndarray) -> np.ndarray:
        """(N,), m: smallest signed distances; infinite where there is nothing to hit."""
        return self.nearest(q).distances if self.labels else np.full(len(q), np.inf)

    def worst(self, q: np.ndarray) -> tuple[float, GapLabel | None, int]:
        """Smallest signed distance (m) over all states, what it is between, and the state's index.

        Infinite and without label if there is nothing to collide with.
        """
        if not self.labels or not np.size(q):
            return np.inf, None, 0
        result = self.nearest(np.atleast_2d(q))
        state = int(np.argmin(result.distances))
        return float(result.distances[state]), self.labels[result.pairs[state]], state

    def approach(self, moved: np.ndarray) -> np.ndarray:
        """(N, m), m: how much nearer each pair can come while joints move by up to moved (N, n), rad or m."""
        return np.abs(moved) @ self.steepest.T

    def on_meshes(self, q: np.ndarray, label: GapLabel) -> float | None:
        """Distance, m, of the surfaces of the meshes that solids of these names enclose, at q (n,), rad.

        None where neither has a mesh. It is that of surfaces: it is also positive if one is within the other.
        """
        return None

    def hidden(self, q: np.ndarray, least: float) -> list[GapLabel]:
        """Pairs of which solids are nearer than `least`, m, at q (n,), and meshes are not."""
        near = np.flatnonzero(self.gaps(q, least) < least)
        result = {f"{self.labels[k]}": self.labels[k] for k in near}.values()
        apart = [self.on_meshes(q, label) for label in result]
        return [label for label, gap in zip(result, apart, strict=True) if gap is not None and gap >= least]

    def attainable(self, postures: np.ndarray, most: float) -> tuple[float, GapLabel | None]:
        """Largest distance, m, up to `most`, that every two names have in some posture (N, n).

        With the pair that is never farther apart; None where all are.
        """
        result, limiting = most, None
        names = [str(label) for label in self.labels]
        near = np.arange(len(names))
        for q in (postures[:10], postures):  # most pairs drop out with the first ones
            gaps = self.gaps(q, most)[:, near]
            groups = {names[k]: np.flatnonzero([names[j] == names[k] for j in near]) for k in near}
            widest = {name: float(gaps[:, group].min(axis=1).max()) for name, group in groups.items()}
            near = np.array([k for k in near if widest[names[k]] < most], dtype=int)
        for k in near:
            if widest[names[k]] < result:
                result, limiting = widest[names[k]], self.labels[k]
        return max(result, 0.0), limiting

    def to_dict(self, q: np.ndarray | None = None, others: np.ndarray | None = None) -> dict[str, Any]:
        """The scope of the check, as plain data for JSON.

        Args:
            q: (n,), rad, of the smallest distance; with it that distance, its names and nearest points (m,
                base axes) are given.
            others: (N, n), rad, of the same motion; if it does not change the smallest distance, that is
                noted as `constant`.
        """
        if not self.labels:
            return {"checked": False}
        data: dict[str, Any] = {"checked": True, "source": self.source, "pairs": len(self.labels)}
        data["floor"] = [
            {"name": name, "normal": normal.tolist(), "level_m": level} for name, normal, level in self.floors
        ]
        data["unseen"] = [
            sorted(pair) for pair, why in self.apart.items() if why.startswith((UNSEEN, MEETING))
        ]
        data["payload_unseen"] = self.payload_unseen
        data["left_out"] = [{"pair": sorted(pair), "reason": why} for pair, why in self.apart.items()]
        if q is not None:
            result = self.nearest(q[None])
            label = self.labels[result.pairs[0]]
            data["least"] = {
                "distance_m": float(result.distances[0]),
                "between": [label.first, label.second],
                "points_m": result.points.reshape(-1, 3).tolist() or None,
            }
            if others is not None:
                least = result.distances[0]
                along = self.gaps(others, least + 0.5)[:, result.pairs[0]]
                if np.all(np.abs(along - least) < SAME):
                    data["least"]["constant"] = True
        return data


def usual_clearance(arm: ArmModel, collision: Collisions) -> tuple[float, GapLabel | None]:
    """Smallest distance, m, that counts where none is given, and the pair because of which it is no default.

    It is half the distance of a pair that is nearer than the default in all random postures.
    """
    widest, pair = collision.attainable(random_postures(arm, POSTURES), CLEARANCE)
    return (CLEARANCE, None) if pair is None else (0.5 * widest, pair)


def random_postures(arm: ArmModel, count: int) -> np.ndarray:
    """(count, n) joint angles, rad: the neutral ones first, then seeded random ones within the limits."""
    low, high = arm.limits.angle_min, arm.limits.angle_max
    low, high = np.where(np.isfinite(low), low, -np.pi), np.where(np.isfinite(high), high, np.pi)
    drawn = np.random.default_rng(0).uniform(low, high, (count, arm.n))
    drawn[0] = np.clip(0.0, low, high)
    return drawn
