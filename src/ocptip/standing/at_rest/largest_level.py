"""The largest payload, tilt of the floor or push that a robot can have in many postures, and what limits it.

The wrench on the base and the torques are affine in the mass of the payload. So are, with contacts on a
plane, the moments about the tipping axes and the distances from the facets of the friction cone. The nominal
maximum is a closed form. The worst case of an uncertainty, and of joints that move, is a minimum of such
functions, one per deviation and motion: it is concave in the mass. Tangents from above end at its zero after
few steps, because what is worst changes at few masses.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.bisection import borders
from ocptip.reserves.equal_compliance import ENOUGH, slides_beyond
from ocptip.reserves.tipping import TipMap
from ocptip.robots.model import ArmModel
from ocptip.standing.at_rest.directions import beyond_by_tilt
from ocptip.standing.at_rest.joint_box import JointBox
from ocptip.standing.at_rest.levels import LargestLevels, largest_tried
from ocptip.standing.at_rest.raised import Broken, Raised
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.standing.within.deviations import Deviations
from ocptip.standing.within.tolerable import AT_REST
from ocptip.standing.within.worst_case import WorstCase, WorstDeviations, worst_case_of

_ROUNDS = 40
_TURNS = 2  # how often the worst motion is chosen for the worst deviations, and these for it
_CLOSE = 1e-12  # relative: values nearer to their bound keep it
_HALVINGS = 40  # of friction without facets, and of torques that are not convex
_CHUNK = 2_000  # postures at once, times all facets
_MOVING_CHUNK = 200  # the same where joints move
_SAME = 1e-6  # cosines: a facet that is a tipping axis
_PRODUCTS = 3.0  # times all relative deviations: what their products add, at most, to the sum of changes
_SHIFTED = 0.1  # of what motion adds: covers a payload that is elsewhere
_AT_ONCE = 8  # facets of a posture that are evaluated exactly, the nearest first
_AXES = 4  # directions in which a search for the worst tilt begins
_FIRST = 24  # facets of a posture of which the worst case is bounded before all others


def largest_levels_kept(
    raised: Raised, limits: Limits, q: np.ndarray, most: float, box: JointBox | None = None
) -> LargestLevels:
    """The largest level with which all limits are kept, nominal and within the uncertainty.

    Limits are GN, GT and torques. A level is counted as long as every smaller one keeps the limits.

    Args:
        raised: what is raised.
        limits: with the uncertainty.
        q: (N, n), rad (prismatic joints: m).
        most: no larger level is tried.
        box: of joints that move; None: the robot rests.

    Raises:
        InputError: nothing resists a rotation of the base; or friction is not known by half spaces, and
            joints move or a push is raised.
    """
    search = _LevelSearch(raised, limits, q, most, box)
    if len(q):
        search.run()
    return LargestLevels(search.levels, search.which, search.names, search.kept_at_zero)


class _LevelSearch:
    """Levels (N,) that are lowered limit by limit.

    Args:
        raised, limits, q, most, box: see `largest_levels_kept`.

    Attributes:
        levels: (N,), upper bounds.
        which, kept_at_zero, names: see `LargestLevels`.
        tolerance: the part of the uncertainty that counts.
    """

    def __init__(
        self, raised: Raised, limits: Limits, q: np.ndarray, most: float, box: JointBox | None
    ) -> None:
        self.raised, self.robot, self.box = raised.at(q), raised.robot, box
        if self.robot.tip_over.free_rotation:
            raise InputError("chart: nothing resists a rotation of the base about its contacts")
        self.limits, self.q, still = limits, q, np.zeros(q.shape)
        given = [name for name in AT_REST if name in limits.tolerance.given]
        self.tolerance = limits.tolerance.only(*given)
        self._cases = worst_case_of(self.robot, raised.counted(self.tolerance))
        raised.raised(self._cases, np.ones(1))  # builds what all that is derived from it shares
        self._s = np.hstack([q, still, still])
        slope, reference = raised.reference_slope, self.robot.tip_over.reference_moment or 0.0
        # Of a payload the robot of `raised` holds 1 kg.
        self._reference = np.array([reference - slope, slope])

        pairs = [dict.fromkeys(edge) for edge in self.robot.tip_over.edges]
        tips = [f"tipping about contacts {' and '.join(map(str, pair))}" for pair in pairs]
        torques = [f"torque of {name}" for name in self.robot.names]
        self.names = (*tips, "friction", *torques, largest_tried(raised.name))
        self._axes = len(tips)
        self.levels = np.full(len(q), float(most))
        self.which = np.full(len(q), len(self.names) - 1)
        self.kept_at_zero = np.ones(len(q), dtype=bool)

    def _lower(self, rows: np.ndarray, levels: np.ndarray, which: np.ndarray) -> None:
        """Lower the levels of postures `rows` to `levels`, where these are smaller; below 0: none keeps."""
        smaller = levels < self.levels[rows]
        # The smallest one last: of entries with the same posture the last assignment counts.
        order = np.flatnonzero(smaller)[np.argsort(-levels[smaller], kind="stable")]
        rows, levels = rows[order], levels[order]
        self.levels[rows], self.which[rows] = np.maximum(levels, 0.0), which[order]
        self.kept_at_zero[rows[levels < 0]] = False

    def run(self) -> None:
        """Lower all to what the limits allow, nominal and within the uncertainty."""
        limits = self.limits
        cases = [(NONE, limits.GN, limits.GT, limits.torque_ratio)]
        if self.tolerance.given:
            worst = limits.GN_worst_case, limits.GT_worst_case, limits.torque_ratio_worst_case
            cases.append((self.tolerance, *worst))
        for tolerance, GN, GT, torque_ratio in cases:
            within, levels = self._cases.within(tolerance), self.levels
            # Level zero first: what a payload balances would go unseen from above.
            for self.levels in (np.zeros_like(levels), levels):
                self._tip(within, self._reference * (1 / GN - 1))
                self._friction(within, GT)
                self._torques(tolerance, torque_ratio * self.robot.limits.torque)
                levels[~self.kept_at_zero] = 0.0

    @property
    def _scale(self) -> float:
        """N and N m: of the wrench on the base."""
        return float(np.linalg.norm(self.robot.support.weight)) * max(1.0, self.robot.support.length)

    # --- tipping ------------------------------------------------------------------------------------------

    def _tip(self, cases: WorstCase, need: np.ndarray) -> None:
        """Lower all to moments about the tipping axes; `need`: N m, and its change per level."""
        near = self._near_axes(cases, need)
        for axis in range(self._axes):
            todo = np.flatnonzero(near[:, axis])
            for _ in range(_ROUNDS):
                if not len(todo):
                    break
                loaded = self.raised.raised(cases, self.levels[todo])
                axes = np.full(len(todo), axis)
                worst, s = self._worst(loaded, todo, lambda s, f=loaded.moments, axes=axes: f(s, axes))
                besides = self.raised.lost(todo, worst.slopes) + need[1]
                todo = self._to_zero(todo, loaded, s, worst, need[0], besides, np.full(len(todo), axis))

    def _near_axes(self, cases: WorstCase, need: np.ndarray) -> np.ndarray:
        """(N, axes) whether a posture may break the limit of a tipping axis at its present level."""
        tip_map = TipMap(cases.footing.tip_over)
        if not tip_map.affine:
            return np.ones((len(self.q), self._axes), dtype=bool)
        loaded, rows = self.raised.raised(cases, self.levels), np.arange(len(self.q))
        theta = loaded.deviations.nominal(len(rows))
        wrenches, over = loaded.deviations.wrench_and_slopes(self._s, theta)
        values, slopes = tip_map(wrenches)
        if not len(rows) or not self._axes:
            return values < 0
        values -= np.array([self._spread(loaded, over, slopes[:, k]) for k in range(self._axes)]).T
        if box := self.box:
            parts, factor = self._motion(box, loaded, rows)
            values += factor * np.array([box.least(parts, slopes[:, k])[1] for k in range(self._axes)]).T
        lost = self.raised.lost(rows, slopes[:1]) + need[1]
        return values < need[0] + lost * self.levels[:, None]

    # --- what is worst ------------------------------------------------------------------------------------

    def _worst(
        self, loaded: WorstCase, rows: np.ndarray, measure: Callable[[np.ndarray], WorstDeviations]
    ) -> tuple[WorstDeviations, np.ndarray]:
        """The minimum of a quantity of states, over deviations and motions, and the states there."""
        rest = s = self._s[rows]
        worst = measure(s)
        for box in [self.box] * _TURNS if self.box else ():
            parts = self._parts(box, loaded.deviations, rest, worst.theta)
            moving = rest + box.least(parts, worst.slopes)[0]
            new = measure(moving)
            s = np.where((new.values < worst.values)[:, None], moving, s)
            worst = worst.worse(new, -1.0)
        return worst, s

    def _parts(
        self, box: JointBox, deviations: Deviations, s: np.ndarray, theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Parts of the wrench that joints add by moving, see `JointBox.parts`."""
        return box.parts(lambda moving, rows: deviations.wrench(moving, theta[rows])[0], s)

    def _motion(
        self, box: JointBox, loaded: WorstCase, rows: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        """Parts of the wrench that joints add, and by which factor deviations may change them."""
        deviations = loaded.deviations
        theta, tolerance = deviations.nominal(len(rows)), deviations.tolerance
        if (more := deviations.places.get("extra_mass")) is not None:
            theta[:, more] = tolerance.extra_mass
        factor = 1 + _PRODUCTS * (tolerance.arm_mass + tolerance.payload_mass)
        return self._parts(box, deviations, self._s[rows], theta), factor + _SHIFTED * any(
            tolerance.payload_center
        )

    def _spread(self, loaded: WorstCase, over: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """(N,) by how much functionals (N, 6) of the wrench may be less within the uncertainty, at most."""
        change = np.einsum("nw,nwt->nt", slopes, over)
        deviations = loaded.deviations
        off = deviations.least(change) - deviations.nominal(len(change))
        return np.abs(change * off) @ self._safe(deviations)

    def _safe(self, deviations: Deviations) -> np.ndarray:
        """(size,) factors of the changes by deviations, so that their sum covers products of deviations."""
        tolerance = self.tolerance
        base = max(np.abs(np.array(tolerance.masses(self.robot.support.mass)) / self.robot.support.mass - 1))
        masses = tolerance.arm_mass + tolerance.payload_mass + base
        tilt = float(np.max(deviations.tilt, initial=0.0))
        factors = np.full(deviations.size, 1 + _PRODUCTS * (masses + tilt))
        factors[deviations.places.get("gravity", slice(0, 0))] = 1 + masses  # it multiplies nothing else
        for name in ("push", *(() if any(tolerance.center_of_mass) else ("base_push",))):
            factors[deviations.places.get(name, slice(0, 0))] = 1.0  # these multiply nothing
        return factors

    def _to_zero(
        self,
        rows: np.ndarray,
        loaded: WorstCase,
        s: np.ndarray,
        worst: WorstDeviations,
        need: float,
        besides: np.ndarray,
        names: np.ndarray,
    ) -> np.ndarray:
        """Lower levels to where margins are zero; the postures that were lowered and have a level.

        Args:
            rows: (k,) postures.
            loaded, s, worst: at their levels; what is worst.
            need: what the margin must be at level zero.
            besides: (k,) or (1,) what is lost of the margin per level besides.
            names: (k,) of the limits.
        """
        left = worst.values - need - besides * (levels := self.levels[rows])
        broken = np.flatnonzero(left < -_CLOSE * self._scale)
        rows, levels, names = rows[broken], levels[broken], names[broken]
        if not len(rows):
            return rows
        besides = np.broadcast_to(besides, left.shape)
        some = WorstDeviations(worst.values[broken], worst.theta[broken], worst.slopes[broken])
        now = levels, left[broken], -besides[broken]
        levels = self.raised.zero(Broken(loaded.deviations, s[broken], some, *now))
        empty = self.levels[rows] == 0  # broken at level zero
        self._lower(rows, np.where(empty, -1.0, levels), names)
        return rows[(levels >= 0) & ~empty]

    # --- friction -----------------------------------------------------------------------------------------

    def _friction(self, cases: WorstCase, GT: float) -> None:
        """Lower all to a friction utilisation.

        Half spaces of the friction cone lie inside it, see `reserves.wrench_cone`: at most 1.9 % of the
        friction is not counted. On springs they are those of sliding while all contacts press, with 5 % less
        friction. Where contacts lift, and where there are no half spaces, payloads and tilts are bisected.
        """
        facets, springs = cases.footing.slip.half_spaces(GT), cases.footing.support.elastic
        if facets is None and springs:
            share = ENOUGH * GT
            facets = slides_beyond(cases.footing.support, springs.normal_map, share, fine=True)
        if facets is None:
            self._friction_by_bisection(cases, GT, np.flatnonzero(self.kept_at_zero))
            return
        affine = cases.footing.tip_over.affine_moments
        if affine is not None and len(facets):
            unit = [normal / np.linalg.norm(normal, axis=1, keepdims=True) for normal in (facets, -affine[0])]
            facets = facets[np.max(unit[0] @ unit[1].T, axis=1) < 1 - _SAME]  # tipping has its own limit
        chunk = _MOVING_CHUNK if self.box else _CHUNK
        for begin in range(0, len(self.q), chunk):
            rows = np.arange(begin, min(begin + chunk, len(self.q)))
            kept = np.zeros((len(self.q), len(facets)), dtype=bool)
            while len(rows := rows[self.kept_at_zero[rows]]):
                n, k = self._near_facets(cases, facets, rows, kept)
                if not len(n):
                    break
                loaded, a = self.raised.raised(cases, self.levels[n]), -facets[k]

                def distance(w: np.ndarray, a: np.ndarray = a) -> tuple[np.ndarray, np.ndarray]:
                    return np.einsum("nw,nw->n", a, w), a

                worst, s = self._worst(loaded, n, lambda s, f=loaded.least, distance=distance: f(s, distance))
                lost = self.raised.lost(n, a)
                broken = worst.values - lost * self.levels[n] < -_CLOSE * self._scale
                kept[n[~broken], k[~broken]] = True
                self._to_zero(n, loaded, s, worst, 0.0, lost, np.full(len(n), self._axes))
                rows = np.unique(n)
        if springs and self.box is None and self.raised.by_deviations:
            rows, lifts = np.flatnonzero(self.kept_at_zero), -springs.normal_map
            if len(rows):
                n, _ = self._near_facets(cases, lifts, rows, np.zeros((len(self.q), len(lifts)), dtype=bool))
                self._friction_by_bisection(cases, GT, np.unique(n))

    def _near_facets(
        self, cases: WorstCase, facets: np.ndarray, rows: np.ndarray, kept: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of postures and the nearest facets, not known to be kept, that may be broken at the worst."""
        loaded = self.raised.raised(cases, self.levels[rows])
        deviations = loaded.deviations
        nominal = deviations.nominal(len(rows))
        wrenches, over = deviations.wrench_and_slopes(self._s[rows], nominal)
        beyond = wrenches @ facets.T
        beyond += self.raised.lost(rows, facets[None]) * self.levels[rows][:, None]
        safe = self._safe(deviations)
        reach = np.maximum(np.abs(deviations.low - nominal), np.abs(deviations.high - nominal))
        for name, radius in deviations.radii.items():
            reach[:, deviations.places[name]] = radius
        reach[:, (place := deviations.places.get("gravity", slice(0, 0)))] = 0.0
        rough = beyond + np.einsum("nwt,nt->nw", np.abs(over), reach * safe) @ np.abs(facets).T
        parts, factor = (np.empty(0), np.empty(0)), 0.0
        if box := self.box:
            parts, factor = self._motion(box, loaded, rows)
            rough += factor * box.most(parts, facets)
        if place.stop:
            more, tilt = safe[place.start], np.broadcast_to(deviations.tilt, (len(rows), 1))
            tilted = self.robot.support.gravity, tilt, over[:, :, place]
            rough += more * beyond_by_tilt(*tilted, facets, -rough / more)
        near = (rough > 0) & ~kept[rows]
        # Most of many facets are far beyond at a large level: those that may be broken most come first, the
        # others only where none of these is broken.
        first = np.zeros_like(near)
        order = np.argpartition(np.where(near, -rough, np.inf), min(_FIRST, near.shape[1]) - 1, axis=1)
        np.put_along_axis(first, order[:, :_FIRST], True, axis=1)

        def broken(pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            n, k = np.nonzero(pairs)
            some = self.raised.raised(cases, self.levels[rows[n]])
            worst = beyond[n, k] + self._spread(some, over[n], -facets[k])
            if box:
                worst -= factor * box.least((parts[0][n], parts[1][n]), -facets[k])[1]
            return n[worst > 0], k[worst > 0], worst[worst > 0]

        n, k, worst = broken(near & first)
        left = near & ~first
        left[n] = False
        if left.any():
            n, k, worst = (np.concatenate(both) for both in zip((n, k, worst), broken(left), strict=True))
        order = np.lexsort((-worst, n))
        n, k = n[order], k[order]
        nearest = np.arange(len(n)) - np.searchsorted(n, n) < _AT_ONCE
        return rows[n[nearest]], k[nearest]

    def _friction_by_bisection(self, cases: WorstCase, GT: float, rows: np.ndarray) -> None:
        if self.box or not self.raised.by_deviations:
            raise InputError(
                f"chart: friction of these contacts is not known by half spaces, which charts of a "
                f"{self.raised.name} {'of joints that move ' * bool(self.box)}need"
            )

        # Without any tilt no friction may be needed: then no slope says towards where to tilt.
        starts = 1 if self.raised.convex else 1 + _AXES

        def kept(rows: np.ndarray, levels: np.ndarray) -> np.ndarray:
            return self.raised.raised(cases, levels).slip(self._s[rows], starts).values <= GT

        rows = rows[~kept(rows, self.levels[rows])]
        none = np.zeros(len(rows))
        empty = kept(rows, none)
        low, _ = borders(partial(kept, rows), none, self.levels[rows], _HALVINGS)
        self._lower(rows, np.where(empty, low, -1.0), np.full(len(rows), self._axes))

    # --- torques ------------------------------------------------------------------------------------------

    def _torques(self, tolerance: Uncertainty, allowed: np.ndarray) -> None:
        """Lower all to the largest torques within the uncertainty.

        Where they are convex in the level a chord lies above them, the line through two points beyond them
        below: both narrow the interval of the zero. Else it is bisected.
        """
        if not np.any(np.isfinite(allowed)):
            return

        def excess(rows: np.ndarray, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            states, owners = self._torque_states(rows, levels)
            torques = self.raised.torques(tolerance, rows[owners], states, levels[owners]) / allowed - 1
            result = np.max(torques.reshape(len(rows), -1, self.q.shape[1]), axis=1)
            j = np.argmax(result, axis=1)
            return result[np.arange(len(rows)), j], self._axes + 1 + j

        rows = np.flatnonzero(self.kept_at_zero)
        if not len(rows):
            return
        above = excess(rows, self.levels[rows])[0]
        rows, above = rows[above > _CLOSE], above[above > _CLOSE]
        if not len(rows):
            return
        below, which = excess(rows, np.zeros(len(rows)))
        held = below <= _CLOSE
        self._lower(rows[~held], np.full(len(rows), -1.0)[~held], which[~held])
        rows, below, above = rows[held], below[held], above[held]
        if not len(rows):
            return
        low, high = np.zeros(len(rows)), self.levels[rows]
        if not self.raised.convex:
            low, high = borders(lambda levels: excess(rows, levels)[0] <= 0, low, high, _HALVINGS)
            self._lower(rows, low, excess(rows, high)[1])
            return
        for _ in range(_ROUNDS):
            if not len(rows):
                return
            middle = low + (high - low) * np.minimum(-below / (above - below), 1.0)
            value, which = excess(rows, middle)
            rise = np.where(value > below, (middle - low) / np.maximum(value - below, 1e-300), np.inf)
            high = np.minimum(high, np.where(value < 0, middle - value * rise, middle))
            low, below = middle, np.minimum(value, 0.0)
            done = (value > -_CLOSE) | (high - low <= _CLOSE * high)
            self._lower(rows[done], low[done], which[done])
            rows, low, high, below = rows[~done], low[~done], high[~done], below[~done]
            if len(rows):
                above = np.maximum(excess(rows, high)[0], 1e-300)
        self._lower(rows, low, excess(rows, low)[1])

    def _torque_states(self, rows: np.ndarray, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States in which some joint needs most torque, and which of `rows` each is of."""
        box = self.box
        if box is None:
            return self._s[rows], np.arange(len(rows))
        parts = [
            part[0][rows] + levels.reshape(-1, *[1] * (part[0].ndim - 1)) * part[1][rows]
            for part in self._torque_parts
        ]
        n, states = self.q.shape[1], []
        for axis in np.vstack([np.eye(n), -np.eye(n)]):
            functional = np.tile(axis, (len(rows), 1))
            states.append(self._s[rows] + box.least((parts[0], parts[1]), functional)[0])
        return np.stack(states, axis=1).reshape(-1, 3 * n), np.repeat(np.arange(len(rows)), 2 * n)

    @cached_property
    def _torque_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Parts of torques by motion, at level zero and per level, see `JointBox.parts`."""
        robot, about, box = self.robot, self.robot.support.center_of_mass, self.box
        assert box is not None  # only asked for then

        def torques(arm: ArmModel, moving: np.ndarray) -> np.ndarray:
            given = {"gravity": np.zeros(3), "about": about}
            q, qd, qdd = np.split(moving, 3, axis=1)
            return robot.pushed(arm, q, qd, qdd, None, **given).torque

        parts = [
            box.parts(lambda moving, _, arm=arm: torques(arm, moving), self._s) for arm in self.raised.arms
        ]
        return [(first, second - first) for first, second in zip(*parts, strict=True)]
