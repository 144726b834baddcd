"""How fast a base may accelerate, brake and turn with an arm at rest on it: until it tips, until it slips.

A manoeuvre is a family of base motions with one parameter x >= 0: an acceleration or a speed. The wrench on
the base is then a polynomial of degree two in x. Its moments about the tipping axes have first zeros in
closed form. For friction, a cone program finds how far a load may go along a line, and the half space that
limits it there; the first zero of the polynomial in that half space bounds x, and these bounds end where the
friction is used up.

Within an uncertainty each choice of deviations gives an upper bound of x. The worst deviations are chosen at
the bound, and lower it, until none do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ocptip.basics.errors import InputError, SolverError
from ocptip.contact.force_programs import LoadRays
from ocptip.numerics.bisection import borders
from ocptip.reserves.equal_compliance import (
    ENOUGH,
    friction_differs,
    normal_map_of,
    slides_beyond,
)
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.manoeuvres import LARGEST, Manoeuvres
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.standing.within.deviations import Deviations
from ocptip.standing.within.moving import driving_case_of
from ocptip.standing.within.worst_case import WorstCase

_ROUNDS = 12
_SAME = 1e-6  # relative: friction that lasts so nearly until a wheel lifts does not end before
_NEARLY, _HALVINGS = 1e-3, 12  # relative, of an end; of what friction of lifted wheels is searched in
_CLOSE = 1e-9  # relative: a bound that falls by less is the result
_STAYS = 4  # rounds in which a bound does not fall: in a corner of the cones deviations may take turns
_HELD = 1 - 1e-9  # share of a load that counts as all of it
_STEP = 1e-3  # least parameter between which differences are taken
_CHOICES = 2  # of deviations that are worst for a half space: the second counts products
_INSIDE = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of a bound at which the worst deviations are chosen


@dataclass(frozen=True, eq=False)
class LargestManoeuvres:
    """Largest parameters of P manoeuvres; `LARGEST` where nothing limits them up to there.

    Attributes:
        tip: (P,) up to which the base does not tip.
        contacts: (P, 2) of the axis about which the base tips there, from 1; 0 for none.
        lift: (P,) up to which no wheel lifts, if wheels are equally compliant; NaN where that is not known.
        slip: (P,) up to which friction holds; as large as `tip` where the base tips first.
        normals: (P, 6) of half spaces that limit the load there.
        alike: (P,) up to which friction holds if wheels are equally compliant, or as stiff as declared;
            `LARGEST` where it holds as long as otherwise, and where only one sharing of the load is possible,
            or all wheels have the same friction.
        times: (P,) s, of the worst instant of a motion; None: of a posture.
    """

    tip: np.ndarray
    contacts: np.ndarray
    lift: np.ndarray
    slip: np.ndarray
    normals: np.ndarray
    alike: np.ndarray
    times: np.ndarray | None = None

    @property
    def largest(self) -> np.ndarray:
        """(P,) up to which the contacts are maintained, however the wheels share the load."""
        return np.minimum(np.minimum(self.tip, self.slip), self.alike)

    def lower(self, other: LargestManoeuvres) -> LargestManoeuvres:
        """The lower limits of two families of each manoeuvre."""
        tip, slip = other.tip < self.tip, other.slip < self.slip
        pairs = (("tip", tip), ("contacts", tip[:, None]), ("slip", slip), ("normals", slip[:, None]))
        parts = {name: np.where(less, getattr(other, name), getattr(self, name)) for name, less in pairs}
        if self.times is not None and other.times is not None:
            parts["times"] = np.where(other.largest < self.largest, other.times, self.times)
        least = {name: np.minimum(getattr(self, name), getattr(other, name)) for name in ("lift", "alike")}
        return replace(self, **parts, **least)

    def repeated(self, count: int) -> LargestManoeuvres:
        """Each manoeuvre `count` times in a row."""
        parts = {name: value for name, value in vars(self).items() if value is not None}
        return LargestManoeuvres(**{name: np.repeat(value, count, axis=0) for name, value in parts.items()})

    def at_worst(self, times: np.ndarray) -> LargestManoeuvres:
        """At the worst of K instants (P, K), s, of each manoeuvre; the present rows are at all of them."""
        rows = np.arange(len(times))

        def least(values: np.ndarray) -> np.ndarray:
            return times.shape[1] * rows + np.argmin(values.reshape(times.shape), axis=1)

        tip, slip = least(self.tip), least(self.slip)
        lift, alike = (np.min(part.reshape(times.shape), axis=1) for part in (self.lift, self.alike))
        parts = self.tip[tip], self.contacts[tip], lift, self.slip[slip], self.normals[slip], alike
        return LargestManoeuvres(*parts, times.ravel()[least(self.largest)])


def largest_manoeuvres(
    robot: Robot,
    q: np.ndarray,
    manoeuvres: Manoeuvres,
    tolerance: Uncertainty = NONE,
    interface: int = 0,
    nominal: LargestManoeuvres | None = None,
    below: LargestManoeuvres | None = None,
) -> LargestManoeuvres:
    """Largest parameters with which the base keeps its contacts, for an arm at rest or in motion.

    Args:
        robot: on its base, with contacts on one plane.
        q: (n,), rad (prismatic joints: m), a posture; or a state of each manoeuvre, (P, 3 n): angles, speeds,
            accelerations, and a process that varies.
        manoeuvres: of the base.
        tolerance: of floor, base, arm and payload; deviations of a motion do not count.
        interface: of the robot's `interfaces`, whose contacts are kept instead; 0: the base.
        nominal: the result without uncertainty, if it is known, from which the search begins.
        below: limits, above which no parameter is searched.

    Raises:
        InputError: contacts that do not lie on one plane, or whose set of forces is not convex.
        SolverError: upper bounds that did not settle.
    """
    search = ManoeuvreSearch(robot, q, manoeuvres, tolerance, interface)
    tip, contacts = search.tip(below)
    lift = search.lift(tip)
    most = tip if below is None else np.minimum(tip, below.slip)
    slip, normals = search.slip(most, nominal and nominal.normals)
    return LargestManoeuvres(tip, contacts, lift, slip, normals, search.alike(lift, slip, normals))


class ManoeuvreSearch:
    """Upper bounds of the parameters that fall until the worst deviations keep them.

    Args:
        robot, q, manoeuvres, tolerance, interface: see `largest_manoeuvres`.
    """

    def __init__(
        self, robot: Robot, q: np.ndarray, manoeuvres: Manoeuvres, tolerance: Uncertainty, interface: int
    ) -> None:
        self._given = robot, q, manoeuvres, tolerance, interface
        self._cases = driving_case_of(robot, tolerance, interface)
        posture = np.concatenate([q, np.zeros(2 * robot.n)]) if q.ndim == 1 else q
        self._s = np.broadcast_to(posture, (len(manoeuvres), posture.shape[-1]))
        self._manoeuvres = manoeuvres
        tip_over = self._cases.footing.tip_over
        if self._cases.axes and tip_over.affine_moments is None:
            raise InputError("contacts: a base that drives needs contacts on one plane")
        curved = np.any(manoeuvres.square) or np.any(manoeuvres.linear[:, 3:6])
        # Loads inside the friction pyramids need no cone program.
        self._facets = self._cases.footing.slip.half_spaces(1.0)
        self._shares = np.array(_INSIDE if curved else (0.0, 1.0))

    @property
    def deviations(self) -> Deviations:
        """Those of the uncertainty."""
        return self._cases.deviations

    def _moving(self, which: np.ndarray, x: np.ndarray) -> tuple[WorstCase, np.ndarray]:
        """The worst case of families (R,) at parameters (R,), and their states (R, 3 n + 9)."""
        rows, gravity = self._manoeuvres.at(which, x)
        return self._cases.on_slopes(gravity), np.hstack([self._s[which], rows])

    def _wrenches(self, which: np.ndarray, x: np.ndarray, off: np.ndarray) -> np.ndarray:
        """(R, 6): of families (R,) at parameters (R,) with deviations (R, size) from the nominal model."""
        cases, s = self._moving(which, x)
        return cases.deviations.wrench(s, off + cases.deviations.nominal(len(which)))[0]

    def polynomials(self, which: np.ndarray, off: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """(R, 3, 6): coefficients of the wrenches over x, from values at 0, scale and 2 scale."""
        values = [self._wrenches(which, k * scale, off) for k in range(3)]
        bend = (values[2] - 2 * values[1] + values[0]) / 2
        parts = values[0], (values[1] - values[0] - bend) / scale[:, None], bend / scale[:, None] ** 2
        return np.stack(parts, axis=1)

    # --- tip-over -----------------------------------------------------------------------------------------

    def tip(self, below: LargestManoeuvres | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(P,) parameters up to which the base does not tip, and (P, 2) contacts of the axis, see
        `LargestManoeuvres`.
        """
        count, tip_over = len(self._manoeuvres), self._cases.footing.tip_over
        if not self._cases.axes:
            free = tip_over.free_rotation
            return np.full(count, 0.0 if free else LARGEST), np.zeros((count, 2), dtype=int)
        affine = tip_over.affine_moments
        assert affine is not None  # the contacts lie on one plane
        most = np.full(count, LARGEST) if below is None else below.tip
        least, first = self._first(*affine, self._cases.reference, most)
        pairs = np.array(tip_over.edges)
        return least, np.where(least[:, None] < LARGEST, pairs[first], 0)

    def lift(self, tip: np.ndarray) -> np.ndarray:
        """(P,) parameters up to which no wheel lifts, see `LargestManoeuvres`."""
        footing, normals = self._cases.footing, normal_map_of(self._cases.footing.support)
        if normals is None:
            unique = footing.slip.redistribution == "tangential"
            return tip if unique else np.full(len(tip), np.nan)
        size = float(np.linalg.norm(footing.support.weight))
        return self._first(normals, np.zeros(len(normals)), size, tip)[0]

    def _first(
        self, slopes: np.ndarray, offsets: np.ndarray, unit: float, most: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(P,) first parameters at which one of k affine functions of the wrench is negative, and which one.

        Args:
            slopes, offsets: (k, 6) and (k,).
            unit: of the functions; values of rounding count as zero.
            most: (P,) upper bounds to begin with.
        """
        count, size = len(self._manoeuvres), len(slopes)
        which, row = np.repeat(np.arange(count), size), np.tile(np.arange(size), count)
        bounds, todo = np.repeat(most, size), np.arange(len(which))
        off = np.zeros((len(which), self.deviations.size))
        for _ in range(_ROUNDS):
            polynomials = self.polynomials(which[todo], off[todo], np.maximum(bounds[todo], _STEP) / 2)
            coefficients = np.einsum("rkw,rw->rk", polynomials, slopes[row[todo]])
            coefficients[:, 0] += offsets[row[todo]]
            bounds[todo] = np.minimum(first_zero(coefficients), bounds[todo])
            slopes_here = slopes[row[todo]], offsets[row[todo]]
            worst, off[todo] = self._worst_values(which[todo], *slopes_here, bounds[todo])
            todo = todo[(worst < -_CLOSE * unit) & (bounds[todo] > 0)]
            if not len(todo):
                break
        _require_settled(which[todo])
        bounds = bounds.reshape(count, size)
        first = np.argmin(bounds, axis=1)
        return bounds[np.arange(count), first], first

    def _worst_values(
        self, which: np.ndarray, slopes: np.ndarray, offsets: np.ndarray, bounds: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Minima (R,) of affine functions of the wrench and their deviations (R, size), up to bounds."""
        shares = self._shares
        many, a, more = (np.repeat(part, len(shares), axis=0) for part in (which, slopes, offsets))
        cases, s = self._moving(many, (bounds[:, None] * shares).ravel())
        worst = cases.least(s, lambda w: (np.einsum("rw,rw->r", a, w) + more, a))
        values = worst.values.reshape(len(which), -1)
        off = (worst.theta - cases.deviations.nominal(len(many))).reshape(*values.shape, -1)
        k, rows = np.argmin(values, axis=1), np.arange(len(which))
        return values[rows, k], off[rows, k]

    # --- friction -----------------------------------------------------------------------------------------

    def alike(self, lift: np.ndarray, slip: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(P,) parameters up to which friction holds, see `LargestManoeuvres`."""
        support = self._cases.footing.support
        matters = bool(support.elastic) or friction_differs(support)
        if not matters or (normal_map := normal_map_of(support)) is None:
            return np.full(len(lift), LARGEST)
        most = np.minimum(lift, slip)
        values = self.slip(most, normals, normal_map)[0]
        values = np.where(values < most * (1 - _SAME), values, LARGEST)
        lifted = np.flatnonzero((values == LARGEST) & (lift < slip * (1 - _SAME)))
        if self._springs is not None and len(lifted):
            values[lifted] = self._springs.lifted(lifted, lift[lifted], slip[lifted])
        return values

    @cached_property
    def _springs(self) -> ManoeuvreSearch | None:
        """This search on springs, which only push; None where these are not known."""
        if self._cases.footing.support.elastic:
            return self
        robot, q, manoeuvres, tolerance, interface = self._given
        if interface or robot.if_alike is None:
            return None
        return ManoeuvreSearch(robot.if_alike, q, manoeuvres, tolerance, interface)

    def lifted(self, which: np.ndarray, lift: np.ndarray, most: np.ndarray) -> np.ndarray:
        """(R,) parameters of families (R,), from where a wheel lifts, up to which friction holds on springs;
        `LARGEST` where it does at `most`.
        """

        def kept(x: np.ndarray) -> np.ndarray:
            cases, s = self._moving(which, x)
            return cases.slip(s).values < 1.0

        # Inside, for at its end friction may end in every sharing.
        inside = most * (1 - _NEARLY)
        held = kept(inside)
        return np.where(held, LARGEST, borders(kept, lift, inside, _HALVINGS)[0])

    def slip(
        self, most: np.ndarray, first: np.ndarray | None, normal_map: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(P,) parameters up to which the friction cones hold, at most those given, and normals (P, 6).

        Args:
            most: (P,).
            first: (P, 6) normals of half spaces, for which the first deviations are the worst.
            normal_map: (n, 6) normal forces, N, per wrench, if springs determine them.
        """
        support, facets = self._cases.footing.support, self._facets
        if normal_map is not None:
            facets = slides_beyond(support, normal_map, ENOUGH, fine=True)
        if facets is not None:
            facets = facets / np.linalg.norm(facets, axis=1, keepdims=True)
        rays = LoadRays(support, normal_map)
        values, todo = most.copy(), np.arange(len(most))
        off, held = np.zeros((len(most), self.deviations.size)), {}
        if first is not None:
            off = self._worst_for(todo, most, off, first)[0]
        limits, stays = np.zeros((len(most), 6)), np.zeros(len(most), dtype=int)
        for _ in range(_ROUNDS):
            polynomials = self.polynomials(todo, off[todo], np.maximum(values[todo], _STEP) / 2)
            slips = [
                self._slips(rays, facets, polynomial, values[k], held)
                for k, polynomial in zip(todo, polynomials, strict=True)
            ]
            x, normals = map(np.array, zip(*slips, strict=True))
            off[todo], gain = self._worst_for(todo, x, off[todo], normals)
            stays[todo] = np.where(x < values[todo] * (1 - _CLOSE), 0, stays[todo] + 1)
            values[todo], limits[todo] = x, normals
            todo = todo[(x > 0) & (gain > _CLOSE) & (stays[todo] < _STAYS)]
            if not len(todo):
                break
        _require_settled(todo)
        return values, limits

    def _slips(
        self,
        rays: LoadRays,
        facets: np.ndarray | None,
        coefficients: np.ndarray,
        most: float,
        held: dict[bytes, tuple[float, np.ndarray]],
    ) -> tuple[float, np.ndarray]:
        """The first parameter, at most `most`, at which friction does not hold wrenches (3, 6) over it.

        With it, the normal (6,) of the half space that limits it. `held`: results for loads at x = 0.
        """

        def inside(wrench: np.ndarray) -> bool:
            return facets is not None and bool(np.all(facets @ wrench <= _CLOSE * np.linalg.norm(wrench)))

        start, slope, bend = coefficients
        key = start.tobytes()
        if key not in held:
            held[key] = (1.0, 0 * start) if inside(start) else rays.farthest(0 * start, start)
        share, normal = held[key]
        if share < _HELD:
            return 0.0, normal
        x, straight = most, np.linalg.norm(bend) * most < _CLOSE * np.linalg.norm(slope)
        for _ in range(_ROUNDS):
            end = start + x * slope + x**2 * bend
            share, normal = (1.0, 0 * end) if inside(end) else rays.farthest(start, end)
            if share >= _HELD:  # no half space limits it: the deviations are worst that add to the change
                return x, (end - start) / max(np.linalg.norm(end - start), 1e-300)
            if straight:
                return share * x, normal
            along = coefficients @ normal
            along[0] -= (start + share * (end - start)) @ normal
            x = min(x * (1 - _CLOSE), float(first_zero(-along[None])[0]))
        raise SolverError(f"drive envelope: friction is not bounded after {_ROUNDS} cone programs")

    def _worst_for(
        self, which: np.ndarray, x: np.ndarray, off: np.ndarray, normals: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R, size) deviations that push the load farthest out of half spaces with normals (R, 6).

        With them, (R,) by how much farther than the present ones do, relative to the load.
        """
        cases, s = self._moving(which, x)
        deviations, nominal = cases.deviations, cases.deviations.nominal(len(which))
        size = np.linalg.norm(self._cases.footing.support.weight)

        def beyond(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            wrenches, over = deviations.wrench_and_slopes(s, theta)
            return np.einsum("rw,rw->r", normals, wrenches) / size, -np.einsum("rw,rwt->rt", normals, over)

        theta = off + nominal
        before, slopes = beyond(theta)
        present = before
        for _ in range(_CHOICES):
            theta = deviations.least(slopes)
            present, slopes = beyond(theta)
        return theta - nominal, present - before


def _require_settled(left: np.ndarray) -> None:
    """Raise SolverError if upper bounds of families (R,) still fall: they are no limits then."""
    if len(left):
        count = len(np.unique(left))
        raise SolverError(f"drive envelope: bounds of {count} manoeuvres fall after {_ROUNDS} rounds")


def first_zero(coefficients: np.ndarray) -> np.ndarray:
    """(R,) first x >= 0 at which c0 + c1 x + c2 x^2 is not positive, of rows (R, 3); infinite for none."""
    c0, c1, c2 = coefficients.T
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(c1**2 - 4 * c2 * c0, 0.0))
        # Either quotient avoids the difference of nearly equal numbers for one sign of c1.
        stable = -(c1 + np.where(c1 >= 0, root, -root)) / 2
        candidates = np.stack([stable / c2, c0 / stable])
        real = c1**2 - 4 * c2 * c0 >= 0
        candidates = np.where(real & (candidates > 0) & np.isfinite(candidates), candidates, np.inf)
    return np.where(c0 <= 0, 0.0, np.min(candidates, axis=0))
