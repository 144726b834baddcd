"""Distances of solids over intervals of time, from below.

A solid is the convex hull of points, thickened. Two are apart where balls about them are, or a ball and a box
along the axes about one at rest, or where along some direction all points of one lie beyond all points of the
other. Any direction proves a bound.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ocptip.certificate.trusted.forms import Form, U, dot, linear, times_rows
from ocptip.certificate.trusted.plain import ROUNDED

Frame = tuple[Form, Form]
Directions = Callable[[np.ndarray, np.ndarray], np.ndarray]
_BASE = -1  # the link of what rests in base axes


def distances(
    frames: list[Frame], bodies: Sequence[Mapping[str, Any]], pairs: np.ndarray, asked: float,
    directions: Directions,
) -> np.ndarray:  # fmt: skip
    """Lower bounds of the distances of pairs, (pairs, N), m; NaN where no direction separates them.

    Args:
        frames: rotation (3, 3, N) and origin (3, N) of the mount and of all links, base axes.
        bodies, pairs: of a certificate's model.
        asked: m: directions are asked for where balls and boxes come nearer.
        directions: of intervals and pairs, (R,) each: (R, 4), 0 (base axes) or 1 (those of the first's link),
            and a direction along which the pair's second is beyond the first.
    """
    count = frames[0][1].r.shape[-1]
    centres, radii = np.zeros((len(bodies), 3, count)), np.full((len(bodies), count), np.inf)
    for k, body in enumerate(bodies):
        if "normal" not in body:
            centres[k], radii[k] = _ball(frames, body)
    a, b = pairs.T
    gaps = np.linalg.norm(centres[a] - centres[b], axis=1) * (1 - U) - (radii[a] + radii[b]) * (1 + U)
    solid = np.ones(len(pairs), dtype=bool)
    boxes = [_box(body) if body.get("link") == _BASE and "points" in body else None for body in bodies]
    for pair, (i, j) in enumerate(pairs):
        if "normal" in bodies[j]:
            solid[pair], gaps[pair] = False, _above(frames, bodies[i], bodies[j])
        for resting, other in ((i, j), (j, i)):
            if (box := boxes[resting]) is not None and solid[pair]:
                gaps[pair] = np.maximum(gaps[pair], _beside(box, centres[other], radii[other]))
    near = np.argwhere(~(gaps >= asked) & solid[:, None])
    towards = directions(near[:, 1], near[:, 0]) if len(near) else np.empty((0, 4))
    keys = np.column_stack([near[:, 0], towards[:, 0] == 1])
    for pair, linked in np.unique(keys, axis=0):
        rows = np.all(keys == (pair, linked), axis=1)
        intervals, d = near[rows, 1], towards[rows, 1:].T
        d = d / np.linalg.norm(d, axis=0)  # not a number where it is too short to have a length
        i, j = pairs[pair]
        gaps[pair, intervals] = _apart(frames, intervals, bodies[i], bodies[j], d, bool(linked))
    return gaps


def _apart(
    frames: list[Frame],
    intervals: np.ndarray,
    first: Mapping[str, Any],
    second: Mapping[str, Any],
    d: np.ndarray,
    linked: bool,
) -> np.ndarray:
    """Lower bound, (N,), m, of how far along d (3, N), of length 1, the second is beyond the first in N of
    the intervals.

    d is in base axes or, linked, turns with the first; what both do in common counts for nothing.
    """
    poses = (_pose(frames, body["link"]) for body in (first, second))
    (R, p), (Q, q) = ((turn[..., intervals], origin[..., intervals]) for turn, origin in poses)
    points = np.array(first["points"])
    middle = points.mean(axis=0)
    towards = dot(_transposed(R), Form.of(d)[:, None]) if linked else Form.of(d)  # base axes
    direction = Form.of(d) if linked else dot(R, towards[:, None])  # axes of the first
    top = np.max(linear(_foremost(points - middle, direction), direction).range[1], axis=0)
    origin, along = dot(q - (p + times_rows(R, middle)), towards), dot(Q, towards[:, None])
    nearest = _foremost(np.array(second["points"]), -along)
    heights = linear(nearest, along) + Form(origin.c[:, None], origin.r[None])
    low, radii = np.min(heights.range[0], axis=0), first["radius"] + second["radius"]
    loose = U + 6 * len(frames) * ROUNDED  # rounded subtractions, and axes that are not quite orthonormal
    return low - top - radii - loose * (1 + np.abs(points).sum(axis=1).max() + np.abs(low) + top + radii)


def _above(frames: list[Frame], body: Mapping[str, Any], half_space: Mapping[str, Any]) -> np.ndarray:
    """Lower bound, (N,), m, of the distance of a body from the points with normal . p >= level."""
    R, p = _pose(frames, body["link"])
    normal = np.tile(np.array(half_space["normal"], dtype=float)[:, None], p.r.shape[-1])
    d, level = Form.of(normal), half_space["level"]
    along, origin = dot(R, d[:, None]), dot(p, d)
    points = _foremost(np.array(body["points"]), along)
    heights = linear(points, along) + Form(origin.c[:, None], origin.r[None])
    height = np.max(heights.range[1], axis=0) + body["radius"] * np.linalg.norm(normal, axis=0) * (1 + U)
    return level - height - (U + 2 * ROUNDED) * (1 + abs(level) + np.abs(height))


def _foremost(points: np.ndarray, along: Form) -> np.ndarray:
    """Those of the points (P, 3) that may be the farthest along forms (3, N) in some interval.

    The others stay behind the point with the highest lower bound; hulls of meshes have thousands of them.
    """
    low, high = along.range
    above, below = np.maximum(points, 0.0), np.minimum(points, 0.0)
    slack = U * (np.abs(points) @ np.maximum(np.abs(low), np.abs(high)))  # of rounding
    least = above @ low + below @ high - slack
    most = above @ high + below @ low + slack
    return points[np.any(~(most < np.max(least, axis=0)), axis=1)]  # what is not a number stays


def _transposed(R: Form) -> Form:
    return Form(np.swapaxes(R.c, 1, 2), np.swapaxes(R.r, 0, 1))


def _pose(frames: list[Frame], link: int) -> Frame:
    """Rotation (3, 3, N) and origin (3, N) of a link; -1: the base."""
    if link != _BASE:
        return frames[link]
    count = frames[0][1].r.shape[-1]
    return Form.of(np.tile(np.eye(3)[:, :, None], count)), Form.of(np.zeros((3, count)))


def _box(body: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, float]:
    """Lowest and highest coordinates (3, 1), m, of points at rest in base axes, and what thickens them, m."""
    points = np.array(body["points"])
    return points.min(axis=0)[:, None], points.max(axis=0)[:, None], body["radius"]


def _beside(box: tuple[np.ndarray, np.ndarray, float], centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Lower bound, (N,), m, of the distance of balls, with centres (3, N) and radii (N,), from a box."""
    low, high, thick = box
    apart = np.maximum(np.maximum(low - centres, centres - high), 0.0)
    return np.linalg.norm(apart, axis=0) * (1 - U) - (radii + thick) * (1 + U)


def _ball(frames: list[Frame], body: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Centre (3, N) and radius (N,), m, base axes, of balls that hold a body throughout the intervals."""
    points = np.array(body["points"])
    middle = points.mean(axis=0)
    reach = (np.max(np.linalg.norm(points - middle, axis=1)) + body["radius"]) * (1 + U)
    R, p = _pose(frames, body["link"])
    place = p + times_rows(R, middle)
    moved = place.size - np.abs(place.c[0]) + place.r + U * np.abs(place.c[0])
    return place.c[0], reach + np.linalg.norm(moved, axis=0) * (1 + U)
