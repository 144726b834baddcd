"""The worst that a tolerance allows for the contacts, over intervals of time, from below.

With the joints' states given, the wrench on the base is a sum of terms, one per body: a weight times what the
body needs, which is affine in gravity and in the square of the speed factor. A moment about a tipping axis,
and every facet of a friction cone under a fixed rule that shares the wrench among the contacts, is a
functional h of the wrench. Its minimum within the tolerance is a minimum of linear functions of the terms, so
a concave function of them. The terms are polynomials of s, and so means of their Bernstein coefficients: the
minimum is at least that at one of these. There it is a closed form.

Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from ocptip.certificate.trusted.arm import Arm, Driven, Motion, crossed, driven, turned
from ocptip.certificate.trusted.bodies import base_bodies, bodies, carried_bodies, paces, term_of, tilted
from ocptip.certificate.trusted.forms import (
    BERNSTEIN,
    ORDER,
    Form,
    K,
    U,
    alike,
    joined,
    numbers_of,
    stack,
)
from ocptip.certificate.trusted.late import Rows
from ocptip.certificate.trusted.plain import VELOCITIES
from ocptip.certificate.trusted.terms import Terms, moment_bounds, wrench_bounds

_NODES = np.linspace(-1.0, 1.0, ORDER + 1)  # Bernstein coefficients of s
_AT_ONCE = 8000  # functionals times rows
_ROWS = 200  # whose terms are made at once: those of more leave the processor's cache, and take twice as long
_HALVINGS = 2  # of numbers e where a bound is short


class Within:
    """Minimum values of functionals of the wrench.

    Args:
        model, tolerance, motion: of a certificate; without motion the base rests.
        carried: one of the model's objects, of whose wrench they are; None: of that on the base.
    """

    def __init__(
        self,
        model: Mapping[str, Any],
        tolerance: Mapping[str, Any],
        motion: Mapping[str, Any] | None = None,
        carried: Mapping[str, Any] | None = None,
    ) -> None:
        base = model["base"]
        self._own, self._drives = tolerance, motion is not None and VELOCITIES in motion
        half = np.array(tolerance["center_of_mass"], dtype=float)
        self._shifts = np.diag(half)[half > 0]  # (axes, 3) m, of the base's centre of mass: the last terms
        self._gravity = np.array(base["gravity"], dtype=float)
        self._about = np.array(base["center_of_mass"], dtype=float)
        self._base, self._payload = base, model["payload"]
        self._arm = Arm(model["arm"], np.zeros(3), self._about)
        self._size = float(np.linalg.norm(self._gravity))
        self._tilt = float(tolerance["tilt"])
        self._off = self._size * self._tilt * (1 + U)  # by so much gravity changes at most
        self._paces, self._bent = paces(tolerance, self._drives)
        self._push, self._base_push = float(tolerance["push"]), float(tolerance["base_push"])
        self._carried, self._pull = carried, self._gravity
        if carried is not None:  # gravity is a share of its own, its tilt a push at the object's middle
            self._shifts, self._tilt, self._gravity = self._shifts[:0], 0.0, np.zeros(3)
            weight, self._far = (self._off * most for most in tilted(carried, tolerance))
            self._push, self._base_push, self._off = weight, 0.0, 0.0
            self._paces = np.column_stack([self._paces, np.ones(len(self._paces))])
            self._bent = np.append(self._bent, 0.0)
        self._fastest = np.max(self._paces, axis=0)

    # --- what the wrench is made of -----------------------------------------------------------------------

    def terms(self, rows: Rows) -> Terms:
        """The terms of the wrench in these rows."""
        groups = [rows.some(slice(k, k + _ROWS)) for k in range(0, len(rows.number), _ROWS)]
        return Terms.joined([self._terms_of(group) for group in groups or [rows]])

    def _terms_of(self, rows_here: Rows) -> Terms:
        settings, arm, n = self._own, self._arm, len(self._arm.armature)
        q, qd, qdd = rows_here.q[:n], rows_here.qd[:n], rows_here.qdd[:n]
        drives = driven(rows_here.qd[n:], rows_here.qdd[n:]) if self._drives else None
        turns = arm.turns(q)
        nothing = Form.of(np.zeros((3, rows_here.q.r.shape[-1])))
        if self._carried is not None:
            still = arm.accelerations(turns, qd * 0.0, qdd * 0.0, self._pull)
            return self._terms_of_carried([*arm.shares(turns, qd, qdd, drives), (still, None)], nothing)
        frames = arm.frames(turns)[1:]
        of_bodies, of_base, second = [], [], []
        for moved, base in arm.shares(turns, qd, qdd, drives):
            rows, products = bodies(arm, self._payload, settings, frames, moved)
            base_rows, more = base_bodies(self._base, settings, self._shifts, base, nothing)
            of_bodies, of_base, second = [*of_bodies, rows], [*of_base, base_rows], [*second, products + more]
        terms = [term_of(*same) for same in zip(*of_bodies, strict=True)]
        tool = len(terms) - 1
        if any(second):
            loose = [sum((m.size + m.r for m in products), nothing.r) for products in second]
            turning = [Form.of(np.zeros(nothing.r.shape), radius=settings) for settings in loose]
            terms.append((1.0, 1.0, 0.0, joined(nothing, *(x for m in turning for x in (nothing, m)))))
        terms += [term_of(*same) for same in zip(*of_base, strict=True)]
        ends = np.array([(low, high, mass) for low, high, mass, _ in terms]).T
        process = joined(nothing, nothing)
        if any(np.any(settings) for settings in arm.process):
            R, p = frames[-1]
            force, moment = (turned(R, v) for v in arm.process_load(turns, rows_here.ends))
            process = joined(force, moment + crossed(p + -self._about[:, None], force))
        return self._terms(ends, stack(*(part for *_, part in terms)), process, tool)

    def _terms_of_carried(self, shares: Sequence[tuple[list[Motion], Driven | None]], nothing: Form) -> Terms:
        """Of an object, in axes of its link; the last share is gravity."""
        carried, rows, loose = self._carried, [], []
        assert carried is not None
        for k, (moved, base) in enumerate(shares):
            level = -self._pull[:, None] if k == len(shares) - 1 else np.zeros((3, 1))
            rest = nothing + level, nothing, Form.of(np.zeros((6, nothing.r.shape[1])))
            frame = moved[carried["link"] - 1] if carried["link"] else rest if base is None else base[1]
            bodies_, second = carried_bodies(carried, self._own, frame)
            rows.append(bodies_)
            loose.append(sum((m.size + m.r for m in second), nothing.r + self._far * (level.any())))
        results = [term_of(*same) for same in zip(*rows, strict=True)]
        turning = [Form.of(np.zeros(nothing.r.shape), radius=frame) for frame in loose]
        results.append((1.0, 1.0, 0.0, joined(nothing, *(x for m in turning for x in (nothing, m)))))
        ends = np.array([(low, high, mass) for low, high, mass, _ in results]).T
        parts = stack(*(part for *_, part in results))
        return self._terms(ends, parts, joined(nothing, nothing), len(results) - 2)

    def _terms(self, ends: np.ndarray, parts: Form, process: Form, tool: int) -> Terms:
        """With bounds of the terms for any speed factor and any tilt of gravity."""
        low, high, masses = ends
        most = np.maximum(np.abs(low), np.abs(high))[:, None, None]
        fast, off, push = self._fastest, np.full(3, self._off), np.full(3, self._push)
        gravity = np.abs(self._gravity) + off
        first, size = np.abs(parts.c[0]), (parts.size + parts.r) * (1 + U)
        half = size - first + U * first
        middle, spread = self._middle(masses, parts.c[0]), wrench_bounds(half, gravity, fast, 0.0 * masses)
        spread = spread + wrench_bounds(first, off, fast - 1, masses)
        error = np.sum(most * wrench_bounds(parts.r, gravity, fast, 0.0 * masses), axis=0)
        if np.any(self._bent):  # no factor of shares is between its ends alone
            error += np.sum(most * wrench_bounds(size, 0.0 * gravity, self._bent, 0.0 * masses), axis=0)
        error[3:] += moment_bounds(parts.r[tool, :3], push)
        at_base = np.full(3, self._base_push)
        forces = np.broadcast_to((push + at_base)[:, None], error[3:].shape)
        turning = (
            moment_bounds(size[tool, :3], push)
            + moment_bounds(np.sum(self._shifts, axis=0), at_base)[:, None]
        )
        pushes = np.concatenate([forces, turning])
        process, still = Form(alike(process.c, parts.c)[0], process.r), np.abs(process.c[0])
        acts = (process.size + process.r) * (1 + U)
        size = np.sum(most * wrench_bounds(size, gravity, fast, masses), axis=0) + pushes + acts
        mean, width = (0.5 * x[:, None, None] for x in (high + low, high - low))
        centre, error = np.sum(mean * middle, axis=0) + process.c[0], error + process.r
        half = np.sum(most * spread + width * np.abs(middle), axis=0) + pushes + error + acts - still
        half = (half + 8 * U * size) * (1 + U)
        numbers = tool, self._gravity, size, error, middle, spread, centre, half
        return Terms(low, high, masses, parts, process, *numbers)

    def _middle(self, masses: np.ndarray, c: np.ndarray) -> np.ndarray:
        """(T, 6, R): wrenches of terms (T, 3 + 6 G, R) as they are in the middle."""
        weight, needed = (masses[:, None] * self._gravity)[:, :, None], Terms.needed(c)
        moment = np.cross(c[:, :3], self._gravity, axisa=1, axisc=1)
        return np.concatenate([weight + needed[:, :3], moment + needed[:, 3:]], axis=1)

    # --- what is worst ------------------------------------------------------------------------------------

    def least(self, terms: Terms, h: np.ndarray, constant: np.ndarray, closely: bool = True) -> np.ndarray:
        """Lower bounds (A, R) of constant + h . wrench within the tolerance.

        Args:
            terms: of R rows.
            h: (A, 6, R).
            constant: (2, A, R), at s = -1 and s = 1 of what is linear between.
            closely: of what is below zero.
        """
        count = max(1, _AT_ONCE // max(1, len(h)))
        parts = [slice(k, k + count) for k in range(0, h.shape[2], count)]
        return np.concatenate(
            [self._least(terms.some(k), h[..., k], constant[..., k], _HALVINGS * closely) for k in parts],
            axis=1,
        )

    def _least(self, terms: Terms, h: np.ndarray, constant: np.ndarray, halvings: int) -> np.ndarray:
        """With this number of halvings of numbers e where signs of terms are in doubt; 0: a coarse bound."""
        middle = np.einsum("air,tir->tar", h, terms.middle)
        spread = np.einsum("air,tir->tar", np.abs(h), terms.spread)
        low, high = terms.low[:, None, None], terms.high[:, None, None]
        size, either = np.abs(middle), 3 * np.abs(middle) < spread  # either: no end is better than the middle
        weights = np.where(either, 0.5 * (low + high), np.where(middle > 0, low, high))
        doubt = (high - low) * np.where(either, 0.5 * (spread + size), np.maximum(spread - size, 0.0))
        sure = (high - low) * np.maximum(size - spread, 0.0)  # by so much the other end brings more
        size = np.einsum("air,ir->ar", np.abs(h), terms.size) + np.max(np.abs(constant), axis=0)
        error = np.einsum("air,ir->ar", np.abs(h), terms.error) + 4 * U * size
        error = error + self._pushed_base(h, weights, sure)
        bound = self._weighted(terms, h, constant, weights) - (np.sum(doubt, axis=0) + error) * (1 + U)
        if not halvings:
            return bound
        short = (bound < 0) & (bound + np.sum(np.sort(doubt, axis=0)[-2:], axis=0) >= 0)
        if len(rows := np.flatnonzero(np.any(short, axis=0))):
            some = terms.some(rows), h[..., rows], constant[..., rows]
            closer = self._at_ends(*some, weights[..., rows], doubt[..., rows], error[:, rows])
            bound[:, rows] = np.where(short[:, rows], np.maximum(bound[:, rows], closer), bound[:, rows])
        short = (bound < 0) & (bound + 2 * np.sum(doubt, axis=0) >= 0)
        if terms.numbers and len(rows := np.flatnonzero(np.any(short, axis=0))):
            some = terms.some(rows), h[..., rows], constant[..., rows], doubt[..., rows]
            bound[:, rows] = np.maximum(bound[:, rows], self._in_halves(*some, halvings - 1))
        return bound

    def _in_halves(
        self, terms: Terms, h: np.ndarray, constant: np.ndarray, doubt: np.ndarray, halvings: int
    ) -> np.ndarray:
        """The same, each row in halves of the number that does most for the terms in doubt."""
        c, (low, high, masses) = terms.parts.c, terms.ends
        strength = []
        for k in range(terms.numbers):
            does = np.einsum("air,tir->tar", h, self._middle(0.0 * masses, c[K + k]))
            does = np.where(doubt > 0, (high - low)[:, None, None] * np.abs(does), 0.0)
            strength.append(np.max(np.sum(does, axis=0), axis=0))
        chosen, values = np.argmax(strength, axis=0), np.empty(doubt.shape[1:])
        for k in np.unique(chosen):
            rows = np.flatnonzero(chosen == k)
            some = terms.some(rows)
            halves = [
                self._terms(terms.ends, some.parts.half(k, side), some.process.half(k, side), terms.tool)
                for side in (-1.0, 1.0)
            ]
            halved = h[..., rows], constant[..., rows], halvings
            values[:, rows] = np.min([self._least(half, *halved) for half in halves], axis=0)
        return values

    def _at_ends(
        self,
        terms: Terms,
        h: np.ndarray,
        constant: np.ndarray,
        weights: np.ndarray,
        doubt: np.ndarray,
        error: np.ndarray,
    ) -> np.ndarray:
        """The same with both ends of the two weights that are most in doubt: the minimum is concave."""
        chosen = np.argsort(doubt, axis=0)[-2:]
        doubt = doubt.copy()
        np.put_along_axis(doubt, chosen, 0.0, axis=0)
        value = np.full(error.shape, np.inf)
        for ends in product((terms.low, terms.high), repeat=len(chosen)):
            ends_taken = np.array([end[k] for end, k in zip(ends, chosen, strict=True)])
            np.put_along_axis(weights, chosen, ends_taken, axis=0)
            value = np.minimum(value, self._weighted(terms, h, constant, weights))
        return value - (np.sum(doubt, axis=0) + error) * (1 + U)

    def _weighted(self, terms: Terms, h: np.ndarray, constant: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(A, R): with weights (T, A, R), but for errors."""
        c = np.moveaxis(terms.parts.c, (3, 1), (0, 3)).reshape(len(h[0, 0]), -1, len(weights))
        shares = len(self._fastest)
        sums = (c @ np.moveaxis(weights, 2, 0)).reshape(len(c), -1, 3 + 6 * shares, len(h))
        sums = np.moveaxis(sums, 0, -1)  # (coefficients, 3 + 6 G, A, R)
        lever = sums[:, :3], terms.parts.c[:, terms.tool, :3, None]
        force, turn = np.moveaxis(h[:, :3], 1, 0), np.moveaxis(h[:, 3:], 1, 0)  # (3, A, R)
        # with the paces, gravity, a push at the tool, nothing
        X = np.empty((len(sums), shares + 7, *sums.shape[2:]))
        for k in range(shares):
            X[:, k] = np.einsum("air,miar->mar", h, sums[:, 3 + 6 * k : 9 + 6 * k])
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            for place, arm in zip((shares, shares + 3), lever, strict=True):
                X[:, place + k] = turn[i] * arm[:, j] - turn[j] * arm[:, i]
        X[:, -1] = np.einsum("air,mir->mar", h, terms.process.c)
        X[0, shares : shares + 3] += np.einsum("tar,t->ar", weights, terms.masses) * force
        X[0, shares + 3 : shares + 6] += force
        ends = 0.5 * ((1 - _NODES)[:, None, None] * constant[0] + (1 + _NODES)[:, None, None] * constant[1])
        return np.min(self._least_at_nodes(X) + ends, axis=0)

    def _pushed_base(self, h: np.ndarray, weights: np.ndarray, sure: np.ndarray) -> np.ndarray:
        """(A, R): what a push at the base's centre of mass takes at most, wherever that is in its box.

        At the worst push the minimum is a concave function of that place, so it is at a corner of the box. At
        corners that the weights (T, A, R) of the shifts do not name, each such weight brings at least `sure`,
        (T, A, R), more.
        """
        push, shifts = self._base_push, self._shifts
        first, most = len(weights) - len(shifts), np.full(sure.shape[1:], -np.inf if push else 0.0)
        force, turn = np.moveaxis(h[:, :3], 1, 0), np.moveaxis(h[:, 3:], 1, 0)  # (3, A, R)
        for signs in product((-1.0, 1.0), repeat=len(shifts)) if push else ():
            place, more = np.array(signs) @ shifts, np.zeros(most.shape)
            for k, sign in enumerate(signs, first):
                more += np.where(weights[k] * sign < 0, sure[k], 0.0)
            slope = force + np.cross(turn, place[:, None, None], axis=0)
            most = np.maximum(most, push * np.linalg.norm(slope, axis=0) - more)
        return most

    def _least_at_nodes(self, X: np.ndarray) -> np.ndarray:
        """Minimum values (vertices, A, R) over speed factor, gravity, pushes at the tool and numbers e."""
        (m, i, j), g = numbers_of(len(X)), len(self._fastest)
        at_nodes = np.tensordot(BERNSTEIN, X[:K], axes=1)  # (V, G + 7, A, R)
        pull_, push_, free = np.s_[:, g : g + 3], np.s_[:, g + 3 : g + 6], np.s_[:, -1]
        by_node = _NODES.reshape(-1, 1, 1, 1)
        slopes = [X[K + k] + by_node * X[K + m + k] for k in range(m)]
        bends = X[K + 2 * m :]
        push = self._push
        reach = np.linalg.norm(at_nodes[push_], axis=1)
        unit = at_nodes[push_] / np.maximum(reach, 1e-300)[:, None]
        pushed = [slope[free] - push * np.sum(unit * slope[push_], axis=1) for slope in slopes]
        tilted = self._off * np.linalg.norm(bends[pull_], axis=1)
        turns = [
            self._off * np.linalg.norm(slope[pull_], axis=1)
            + np.sum(tilted[i == k], axis=0)
            + np.sum(tilted[j == k], axis=0)
            for k, slope in enumerate(slopes)
        ]
        bent = np.linalg.norm(bends[push_], axis=1)
        moved = sum(np.linalg.norm(slope[push_], axis=1) for slope in slopes) + np.sum(bent, axis=0)
        lost = push * (
            np.minimum(2 * moved, 0.5 * moved**2 / np.maximum(reach, 1e-300)) + np.sum(bent, axis=0)
        )
        lost = lost + np.sum(np.abs(bends[free]), axis=0)
        best, gravity = np.full(reach.shape, np.inf), self._gravity
        for pace in self._paces:
            here, result = at_nodes[:, : g + 3].copy(), at_nodes[free] - push * reach - lost
            level = np.concatenate([pace, gravity])
            bent = np.tensordot(level, bends[:, : g + 3], axes=(0, 1))
            linear = [
                np.tensordot(level, slope[:, : g + 3], axes=(0, 1)) + other
                for slope, other in zip(slopes, pushed, strict=True)
            ]
            sides, beyond = _sides(linear, bent, i, j)
            for side, slope, other, turn, more in zip(sides, slopes, pushed, turns, beyond, strict=True):
                result = result + side * other - 2 * np.maximum(turn + more, 0.0)
                here += side[:, None] * slope[:, : g + 3]
            for bend, first, second in zip(bends, i, j, strict=True):
                here += (sides[first] * sides[second])[:, None] * bend[: g + 3]
            moving = np.tensordot(pace, here[:, :g], axes=(0, 1))
            best = np.minimum(best, moving + self._under_cap(here[:, g:]) + result)
        return best

    def _under_cap(self, y: np.ndarray) -> np.ndarray:
        """Minimum y . g of y (V, 3, A, R) and gravity g tilted by up to the tolerance."""
        along = np.tensordot(self._gravity, y, axes=(0, 1))
        g = self._gravity
        across = np.sqrt(
            (y[:, 1] * g[2] - y[:, 2] * g[1]) ** 2
            + (y[:, 2] * g[0] - y[:, 0] * g[2]) ** 2
            + (y[:, 0] * g[1] - y[:, 1] * g[0]) ** 2
        )
        inside = (along < 0) & (across * np.cos(self._tilt) <= -along * np.sin(self._tilt))
        rim = along * np.cos(self._tilt) - across * np.sin(self._tilt)
        return np.where(inside, -np.hypot(along, across), rim)


def _sides(
    linear: list[np.ndarray], bends: np.ndarray, i: np.ndarray, j: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Ends of m numbers e in [-1, 1] near the minimum of linear . e + sum of bend e_i e_j.

    The numbers differ from these ends by 2 x, x in [0, 1]. A product of two x is at most any mean of both:
    here the number that does more counts more.

    Args:
        linear: m slopes, (V, A, R) each.
        bends: (pairs, A, R) of the pairs i <= j.

    Returns:
        The ends, (V, A, R) each; and half the slope over each x by which it may become less.
    """
    m, size = len(linear), [np.max(np.abs(way), axis=0) for way in linear]
    between, squares = np.zeros((m, m, *bends.shape[1:])), bends[i == j]
    between[i, j] = between[j, i] = bends
    between[np.arange(m), np.arange(m)] = 0.0
    sides = np.array([np.where(way > 0, -1.0, 1.0) for way in linear])
    bent = [k for k in range(m) if between[k].any()]
    for k in bent:
        way = linear[k] + np.einsum("jar,jvar->var", between[k], sides)
        sides[k] = np.where(way > 0, -1.0, 1.0)
    beyond = [
        side * way + 2 * np.maximum(x, 0.0) for side, way, x in zip(sides, linear, squares, strict=True)
    ]
    for k in bent:
        both = size[k] + np.array(size)
        share = np.where(both > 0, size[k] / np.where(both > 0, both, 1.0), 0.5)
        fixed = np.sum(share * np.abs(between[k]), axis=0)
        beyond[k] += fixed + sides[k] * np.einsum("jar,jvar->var", (1 - share) * between[k], sides)
    return list(sides), beyond
