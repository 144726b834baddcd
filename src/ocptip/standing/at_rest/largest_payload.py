"""The largest payload that a robot at rest can hold in each of many postures, and what limits it.

The wrench on the base and the torques are affine in the mass of the payload. So are, with contacts on a
plane, the moments about the tipping axes and the distances from the facets of the friction cone. The nominal
maximum is a closed form. The worst case of an uncertainty is a minimum of such functions, one per deviation:
it is concave in the mass. Tangents from above end at its zero after few steps, because the worst deviations
change at few masses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.bisection import borders
from ocptip.reserves.tipping import TipMap
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE
from ocptip.standing.within.tolerable import AT_REST
from ocptip.standing.within.torques import maximum_torques
from ocptip.standing.within.worst_case import WorstCase


@dataclass(frozen=True)
class ChartCell:
    """Postures whose TCP is in one cell of the chart.

    Attributes:
        azimuth: rad, ends of the sector; None: all around.
        reach: m, ends.
        height: m, ends; None: all heights.
        postures: that were sampled there and do not collide.
        any_posture: kg, the smallest of their largest payloads: whatever the posture.
        best_posture: kg, the largest of them.
        limit, limit_best: what decides there.
    """

    azimuth: tuple[float, float] | None
    reach: tuple[float, float]
    height: tuple[float, float] | None
    postures: int
    any_posture: float
    best_posture: float
    limit: str
    limit_best: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data: degrees, m and kg."""
        azimuth = self.azimuth and [float(round(np.degrees(end), 9)) for end in self.azimuth]
        return {
            "azimuth_deg": azimuth,
            "reach_m": list(self.reach),
            "height_m": self.height and list(self.height),
            "postures": self.postures,
            "payload_any_posture_kg": self.any_posture,
            "limit": self.limit,
            "payload_best_posture_kg": self.best_posture,
            "limit_best_posture": self.limit_best,
        }


@dataclass(frozen=True)
class ReachBySector:
    """Largest reaches of one payload, m, by sector; None where no posture was sampled.

    Attributes:
        payload: kg.
        any_posture: within it every sampled posture holds the payload.
        best_posture: the largest one of a posture that holds the payload; None where none does.
    """

    payload: float
    any_posture: tuple[float | None, ...]
    best_posture: tuple[float | None, ...]


LARGEST_TRIED = "largest payload tried"
"""Name of the maximum asked for among the limits."""

_ROUNDS = 40
_CLOSE = 1e-12  # relative: values nearer to their bound keep it
_HALVINGS = 40  # of friction without facets
_CHUNK = 2_000  # postures at once, times all facets
_SAME = 1e-6  # cosines: a facet that is a tipping axis
_PRODUCTS = 3.0  # times all relative deviations: what their products add, at most, to the sum of changes
_AT_ONCE = 8  # facets of a posture that are evaluated exactly, the nearest first


@dataclass(frozen=True, eq=False)
class LargestPayloads:
    """The largest payloads in N postures.

    Attributes:
        masses: (N,), kg; 0 where a limit is broken without payload.
        limits: (N,) which of `names` decides.
        names: of the limits: tipping axes, friction, torques of joints, and last the maximum asked for.
        unloaded: (N,) True where all limits are kept without payload.
    """

    masses: np.ndarray
    limits: np.ndarray
    names: tuple[str, ...]
    unloaded: np.ndarray


def largest_payloads(robot: Robot, limits: Limits, q: np.ndarray, most: float) -> LargestPayloads:
    """The largest payload with which all limits at rest are kept, nominal and within the uncertainty.

    Limits are GN, GT and torques, as those of a motion that rests. The payload has the centre of mass of the
    robot's payload; without one it is a point mass at the TCP. A payload is counted as long as every smaller
    one keeps the limits.

    Args:
        robot: on its base, as it rests.
        limits: with the uncertainty.
        q: (N, n), rad (prismatic joints: m).
        most: kg: no larger payload is tried.

    Raises:
        InputError: nothing resists a rotation of the base.
    """
    search = _PayloadSearch(robot, limits, q, most)
    if len(q):
        search.nominal()
        if search.tolerance.given:
            search.within()
    return LargestPayloads(search.masses, search.which, search.names, search.unloaded)


class _PayloadSearch:
    """Payloads (N,) that are lowered limit by limit.

    Args:
        robot, limits, q, most: see `largest_payloads`.

    Attributes:
        masses: (N,), kg, upper bounds.
        which, unloaded, names: see `LargestPayloads`.
        tolerance: the part of the uncertainty that counts at rest.
    """

    def __init__(self, robot: Robot, limits: Limits, q: np.ndarray, most: float) -> None:
        centre = np.zeros(3) if robot.payload is None else robot.payload.center_of_mass
        # With 1 kg the factor of the payload's mass, which is a deviation, is the mass in kg.
        self.robot = robot.varied(arm=robot.arm.with_payload(Payload(1.0, centre)))
        if self.robot.tip_over.free_rotation:
            raise InputError("chart: nothing resists a rotation of the base about its contacts")
        self.limits, self.q, still = limits, q, np.zeros(q.shape)
        given = [name for name in AT_REST if name in limits.tolerance.given]
        self.tolerance = limits.tolerance.only(*given)
        padded = replace(self.tolerance, payload_mass=self.tolerance.payload_mass or 0.5)
        self._cases = WorstCase(self.robot, padded)  # knows the payload's mass as a deviation
        self._cases.loaded(np.ones(1))  # builds what all that is derived from it shares
        self._s = np.hstack([q, still, still])

        support, arm = self.robot.support, self.robot.arm
        gravity, about = support.gravity, support.center_of_mass
        empty, held = (
            self.robot.pushed(pair, q, still, still, None, gravity=gravity, about=about)
            for pair in (arm.with_payload(None), arm)
        )
        self._wrench = empty.wrench + support.weight, held.wrench - empty.wrench
        self._torque = empty.torque, held.torque - empty.torque
        slope = 0.0
        reference = self.robot.tip_over.reference_moment or 0.0
        if robot.argument("reference_moment") is None:
            slope = reference / self.robot.mass  # the default counts the weight of everything
        self._reference = np.array([reference - slope, slope])

        pairs = [sorted({k + 1 for k in axis.contacts}) for axis in self.robot.tip_over.axes]
        tips = [f"tipping about {' and '.join(map(str, pair))}" for pair in pairs]
        torques = [f"torque of {name}" for name in self.robot.names]
        self.names = (*tips, "friction", *torques, LARGEST_TRIED)
        self._axes = len(tips)
        self.masses = np.full(len(q), float(most))
        self.which = np.full(len(q), len(self.names) - 1)
        self.unloaded = np.ones(len(q), dtype=bool)

    def _lower(self, rows: np.ndarray, masses: np.ndarray, which: np.ndarray) -> None:
        """Lower the payloads of postures `rows` to `masses`, where these are smaller; below 0: none keeps."""
        smaller = masses < self.masses[rows]
        # The smallest one last: of entries with the same posture the last assignment counts.
        order = np.flatnonzero(smaller)[np.argsort(-masses[smaller], kind="stable")]
        rows, masses = rows[order], masses[order]
        self.masses[rows], self.which[rows] = np.maximum(masses, 0.0), which[order]
        self.unloaded[rows[masses < 0]] = False

    # --- nominal ------------------------------------------------------------------------------------------

    def nominal(self) -> None:
        """Lower all to what the nominal limits allow."""
        rows, allowed = np.arange(len(self.q)), self.limits.torque_ratio * self.robot.limits.torque
        torque, more = self._torque
        with np.errstate(divide="ignore", invalid="ignore"):
            roots = np.where(more == 0, np.inf, (np.sign(more) * allowed - torque) / more)
        roots = np.where(np.abs(torque) > allowed, -1.0, roots)
        j = np.argmin(roots, axis=1)
        self._lower(rows, roots[rows, j], self._axes + 1 + j)
        cases = self._cases.within(NONE)
        need = self._needed(self.limits.GN)
        if (affine := cases.footing.tip_over.affine_moments) is not None:
            self._closed(-affine[0], affine[1] - need[0], -need[1], np.arange(self._axes))
        else:
            self._tip(cases, need)
        self._friction(cases, self.limits.GT)

    def _needed(self, GN: float) -> np.ndarray:
        """Moment about every axis, N m, that keeps GN without payload, and its change per kg."""
        return self._reference * (1 / GN - 1)

    def _closed(self, a: np.ndarray, bound: np.ndarray, more: float, names: np.ndarray) -> None:
        """Lower all to a . wrench <= bound + more * mass, of rows a (R, 6)."""
        for begin in range(0, len(self.q) if len(a) else 0, _CHUNK):
            rows = np.arange(begin, min(begin + _CHUNK, len(self.q)))
            left = bound - self._wrench[0][rows] @ a.T
            rise = self._wrench[1][rows] @ a.T - more
            with np.errstate(divide="ignore", invalid="ignore"):
                roots = np.where(rise > 0, left / rise, np.inf)
            roots = np.where(left < -_CLOSE * self._scale, -1.0, roots)
            k = np.argmin(roots, axis=1)
            self._lower(rows, roots[np.arange(len(rows)), k], names[k])

    @property
    def _scale(self) -> float:
        """N and N m: of the wrench on the base."""
        return float(np.linalg.norm(self.robot.support.weight)) * max(1.0, self.robot.support.length)

    # --- within the uncertainty ---------------------------------------------------------------------------

    def within(self) -> None:
        """Lower all to what the limits within the uncertainty allow."""
        cases, loaded = self._cases.within(self.tolerance), self.masses
        # Without payload first: what a payload balances would go unseen from above.
        for self.masses in (np.zeros_like(loaded), loaded):
            self._torques_within()
            self._tip(cases, self._needed(self.limits.GN_worst_case))
            self._friction(cases, self.limits.GT_worst_case)
            loaded[~self.unloaded] = 0.0

    def _tip(self, cases: WorstCase, need: np.ndarray) -> None:
        """Lower all to moments about the tipping axes, by tangents."""
        near = self._near_axes(cases, need)
        for axis in range(self._axes):
            todo = np.flatnonzero(near[:, axis])
            for _ in range(_ROUNDS):
                loaded = cases.loaded(self.masses[todo])
                worst = loaded.moments(self._s[todo], np.full(len(todo), axis))
                left = worst.values - need[0] - need[1] * self.masses[todo]
                rise = self._per_kg(loaded, todo, worst.theta, worst.slopes) - need[1]
                todo = self._by_tangent(todo, left, rise, axis)
                if not len(todo):
                    break

    def _near_axes(self, cases: WorstCase, need: np.ndarray) -> np.ndarray:
        """(N, axes) whether a posture may break the limit of a tipping axis with its present payload."""
        tip_map = TipMap(cases.footing.tip_over)
        if not tip_map.affine:
            return np.ones((len(self.q), self._axes), dtype=bool)
        loaded = cases.loaded(self.masses)
        wrenches, over = loaded.deviations.wrench_and_slopes(self._s, loaded.deviations.nominal(len(self.q)))
        values, slopes = tip_map(wrenches)
        spread = [self._spread(loaded, over, slopes[:, axis]) for axis in range(self._axes)]
        return values - np.array(spread).T < (need[0] + need[1] * self.masses)[:, None]

    def _spread(self, loaded: WorstCase, over: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """(N,) by how much functionals (N, 6) of the wrench may be less within the uncertainty, at most."""
        change = np.einsum("nw,nwt->nt", slopes, over)
        deviations = loaded.deviations
        off = deviations.least(change) - deviations.nominal(len(change))
        return np.abs(change * off) @ self._safe

    @cached_property
    def _safe(self) -> np.ndarray:
        """(size,) factors of the changes by deviations, so that their sum covers products of deviations."""
        tolerance, deviations = self.tolerance, self._cases.deviations
        base = max(np.abs(np.array(tolerance.masses(self.robot.support.mass)) / self.robot.support.mass - 1))
        factors = np.full(
            deviations.size,
            1 + _PRODUCTS * (tolerance.tilt + tolerance.arm_mass + tolerance.payload_mass + base),
        )
        for name in ("push", *(() if any(tolerance.center_of_mass) else ("base_push",))):
            factors[deviations.places.get(name, slice(0, 0))] = 1.0  # these multiply nothing
        return factors

    def _per_kg(
        self, loaded: WorstCase, rows: np.ndarray, theta: np.ndarray, slopes: np.ndarray
    ) -> np.ndarray:
        """(k,) change of functionals with slopes (k, 6) per kg of nominal payload, at these deviations."""
        deviations = loaded.deviations
        start = deviations.places["payload_mass"].start
        more = theta.copy()
        more[:, start] += 1.0
        s = self._s[rows]
        per_kg = deviations.wrench(s, more)[0] - deviations.wrench(s, theta)[0]
        change = np.einsum("nw,nw->n", slopes, per_kg)
        share = deviations.tolerance.payload_mass
        return change * np.where(change < 0, 1 + share, 1 - share)

    def _by_tangent(self, rows: np.ndarray, left: np.ndarray, rise: np.ndarray, name: int) -> np.ndarray:
        """Lower payloads to where tangents are zero; the postures that were lowered and hold something.

        Args:
            rows: (k,) postures.
            left: (k,) what is left of the limit; negative where it is broken.
            rise: (k,) its change per kg.
            name: of the limit.
        """
        broken = left < -_CLOSE * self._scale
        rows, left, rise = rows[broken], left[broken], rise[broken]
        masses = np.where(rise < 0, self.masses[rows] - left / np.minimum(rise, -1e-300), -1.0)
        empty = self.masses[rows] == 0  # broken without any payload
        masses = np.where(empty, -1.0, np.maximum(masses, np.where(rise < 0, 0.0, -1.0)))
        self._lower(rows, masses, np.full(len(rows), name))
        return rows[(masses >= 0) & ~empty]

    # --- friction -----------------------------------------------------------------------------------------

    def _friction(self, cases: WorstCase, GT: float) -> None:
        """Lower all to a friction utilisation.

        Half spaces of the friction cone lie inside it, see `reserves.wrench_cone`: at most 1.9 % of the
        friction is not counted. Where there are none, payloads are bisected.
        """
        facets = cases.footing.slip.half_spaces(GT)
        if facets is None:
            self._friction_by_bisection(cases, GT)
            return
        affine = cases.footing.tip_over.affine_moments
        if affine is not None and len(facets):
            unit = [normal / np.linalg.norm(normal, axis=1, keepdims=True) for normal in (facets, -affine[0])]
            facets = facets[np.max(unit[0] @ unit[1].T, axis=1) < 1 - _SAME]  # tipping has its own limit
        name = np.full(len(facets), self._axes)
        if not cases.deviations.tolerance.given:
            self._closed(facets, np.zeros(len(facets)), 0.0, name)
            return
        for begin in range(0, len(self.q), _CHUNK):
            rows = np.arange(begin, min(begin + _CHUNK, len(self.q)))
            kept = np.zeros((len(self.q), len(facets)), dtype=bool)
            while len(rows := rows[self.unloaded[rows]]):
                n, k = self._near_facets(cases, facets, rows, kept)
                if not len(n):
                    break
                loaded, a = cases.loaded(self.masses[n]), -facets[k]

                def distance(w: np.ndarray, a: np.ndarray = a) -> tuple[np.ndarray, np.ndarray]:
                    return np.einsum("nw,nw->n", a, w), a

                worst = loaded.least(self._s[n], distance)
                broken = worst.values < -_CLOSE * self._scale
                kept[n[~broken], k[~broken]] = True
                rise = self._per_kg(loaded, n, worst.theta, a)
                self._by_tangent(n, worst.values, rise, self._axes)
                rows = np.unique(n)

    def _near_facets(
        self, cases: WorstCase, facets: np.ndarray, rows: np.ndarray, kept: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of postures and the nearest facets, not known to be kept, that may be broken at the worst."""
        loaded = cases.loaded(self.masses[rows])
        deviations = loaded.deviations
        nominal = deviations.nominal(len(rows))
        wrenches, over = deviations.wrench_and_slopes(self._s[rows], nominal)
        beyond = wrenches @ facets.T
        reach = np.maximum(np.abs(deviations.low - nominal), np.abs(deviations.high - nominal))
        for name, radius in deviations.radii.items():
            reach[:, deviations.places[name]] = radius
        rough = beyond + np.einsum("nwt,nt->nw", np.abs(over), reach * self._safe) @ np.abs(facets).T
        n, k = np.nonzero((rough > 0) & ~kept[rows])
        worst = beyond[n, k] + self._spread(cases.loaded(self.masses[rows[n]]), over[n], -facets[k])
        order = np.lexsort((-worst, n))
        n, k, worst = n[order], k[order], worst[order]
        place = np.arange(len(n)) - np.searchsorted(n, n)
        near = (worst > 0) & (place < _AT_ONCE)
        return rows[n[near]], k[near]

    def _friction_by_bisection(self, cases: WorstCase, GT: float) -> None:
        def kept(rows: np.ndarray, masses: np.ndarray) -> np.ndarray:
            return cases.loaded(masses).slip(self._s[rows]).values <= GT

        rows = np.arange(len(self.q))
        rows = rows[~kept(rows, self.masses)]
        none = np.zeros(len(rows))
        empty = kept(rows, none)
        low, _ = borders(partial(kept, rows), none, self.masses[rows], _HALVINGS)
        self._lower(rows, np.where(empty, low, -1.0), np.full(len(rows), self._axes))

    # --- torques ------------------------------------------------------------------------------------------

    def _torques_within(self) -> None:
        """Lower all to the largest torques within the uncertainty, which are convex in the mass.

        A chord lies above a convex function, the line through two points beyond them below it: both narrow
        the interval of the zero.
        """
        allowed = self.limits.torque_ratio_worst_case * self.robot.limits.torque
        if not len(self.q) or not np.any(np.isfinite(allowed)):
            return

        def excess(rows: np.ndarray, masses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            q, still = self.q[rows], np.zeros((len(rows), self.q.shape[1]))
            none = np.empty((len(rows), 0))
            result = maximum_torques(self.robot, self.tolerance, q, still, still, none, masses) / allowed - 1
            j = np.argmax(result, axis=1)
            return result[np.arange(len(rows)), j], self._axes + 1 + j

        rows = np.arange(len(self.q))
        above = excess(rows, self.masses)[0]
        rows, above = rows[above > _CLOSE], above[above > _CLOSE]
        below, which = excess(rows, np.zeros(len(rows)))
        held = below <= _CLOSE
        self._lower(rows[~held], np.full(len(rows), -1.0)[~held], which[~held])
        rows, below, above = rows[held], below[held], above[held]
        low, high = np.zeros(len(rows)), self.masses[rows]
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
