"""The worst that a tolerance allows for a base at rest: weights, fixed loads, a tilted floor, pushes.

At rest everything that weighs is a point mass, so that a functional h = a . w of the wrench is, for bodies of
masses m_k at c_k + d_k and gravity g,

    h = sum_k m_k g . (a_F + a_M x (c_k + d_k)) + fixed loads + pushes .

It is linear in each of masses, shifts d_k, gravity and pushes, so that the worst of each is a closed form: an
end, a corner, the edge of the cap of gravity, the push along the gradient. A push at the centre of mass of a
body moves with it, f . (a_F + a_M x (c_k + d_k)): minimised over the push this is concave in d_k, so all
corners are tried. The worst masses and shifts depend on gravity a little and conversely: the choices are
repeated, from many directions of tilt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product
from typing import Any, Protocol

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.text import enumerated, margin_text, numbered, quantity, towards
from ocptip.contact.support import Load, Support
from ocptip.numerics.inertia import RigidBody
from ocptip.numerics.vectors import cross
from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.reserves.tipping import TipMap, TipOver, moment_at
from ocptip.standing.at_rest.directions import around, tilted
from ocptip.standing.at_rest.slope import Weight, fixed_and_hanging
from ocptip.standing.footing import Footing
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.deviations import least_tilt
from ocptip.standing.within.tolerable import why_not

SEARCHED = ("tilt", "base_mass", "center_of_mass", "friction", "base_push")
"""Quantities that a scene can have; a scene knows no arm, payload or motion."""

OF_OBJECTS = ("tilt", "payload_center", "payload_mass", "friction")
"""Quantities that objects have at rest."""

ROUNDS = 3
_LOST = 1 - 1e-9
_SAME = 1e-9  # relative: deviations that matter so little more are alike
_CORNERS = np.array(sorted(product((0.0, -1.0, 1.0), repeat=3), key=np.count_nonzero))  # the middle first


@dataclass(frozen=True, eq=False)
class Push:
    """A force of unknown direction.

    Attributes:
        name: in words.
        size: N, at most.
        point: (3,), m, from the base's nominal centre of mass, base axes.
        weight: number of the weight with whose centre the point moves; None: it is fixed.
    """

    name: str
    size: float
    point: np.ndarray
    weight: int | None = None


@dataclass(frozen=True, eq=False)
class Off:
    """How far everything is off.

    Attributes:
        masses: (K,), kg, of the weights.
        shifts: (K, 3), m.
        gravity: (3,), m/s^2.
        pushes: (P, 3), N.
    """

    masses: np.ndarray
    shifts: np.ndarray
    gravity: np.ndarray
    pushes: np.ndarray


@dataclass(frozen=True)
class WithinAtRest:
    """The worst of a base at rest.

    Attributes:
        tolerance: the part of the uncertainty that counts.
        scope: name of the uncertainty.
        GN, GT: at the worst.
        demand: of friction, there.
        GN_worst, GT_worst: what is off there, in words.
        stands: no contact is lost.
        reason: where one is, which quantity alone is too much and how much of it is not.
        possible: share, 0 to 1, of what `reason` names with which no contact is lost; 1 if none is.
        ignored: quantities given that a scene cannot have.
    """

    tolerance: Uncertainty
    scope: str
    GN: float
    GT: float
    demand: FrictionDemand
    GN_worst: str
    GT_worst: str
    stands: bool
    reason: str
    possible: float
    ignored: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        values = {
            name: getattr(self, name) for name in ("GN", "GT", "GN_worst", "GT_worst", "stands", "reason")
        }
        missing = {"friction_missing_N": max(self.demand.missing, 0.0)}
        return {"tolerance": self.tolerance.to_dict(), **values, **missing, "ignored": list(self.ignored)}

    def tipping_margin(self, reference: float) -> float:
        """N m, at the worst, by M0 of GN, N m; negative where the base tips: so much is missing."""
        return moment_at(self.GN, reference)

    @property
    def friction_used(self) -> str:
        """Share of the friction at the worst, and the deviations there: "81.2 % (friction -10 %)"."""
        used = quantity(100 * self.GT, "%", 3) if self.GT <= 1 else self.demand.used
        return f"{used} ({self.GT_worst or 'nominal'})"

    def lines(self, reference: float | None) -> list[str]:
        """In words.

        Args:
            reference: M0 of GN, N m; None where nothing tips.
        """
        verdict = "no contact is lost" if self.stands else f"A CONTACT IS LOST: {self.reason}"
        results = [f"{self.tolerance}: {verdict}"]
        if reference:
            left = margin_text(self.tipping_margin(reference), "N m", 4)
            results.append(f"tipping margin >= {left} ({self.GN_worst or 'nominal'})")
        results.append(f"friction used <= {self.friction_used}")
        return results + ([f"not included at rest: {', '.join(self.ignored)}"] if self.ignored else [])


def scene_within(
    support: Support, loads: Sequence[Load], tolerance: Uncertainty, reference_moment: float | None = None
) -> WithinAtRest:
    """The worst of a scene. Loads along gravity count as weights, which turn with gravity; others do not.

    Args:
        support: the base.
        loads: on it, nominal.
        tolerance: of it; what a scene cannot have is left out, with a remark.
        reference_moment: M0 of GN, N m; default that of the nominal base.

    Raises:
        InputError: a planar scene, or one without gravity; a base mass outside its interval.
    """
    if support.dimension != 3:
        raise InputError("tolerance: only for spatial scenes (--tolerance none)")
    if not np.any(support.gravity):
        raise InputError("tolerance: without gravity there is no tilt and no weight (--tolerance none)")
    moment = reference_moment or TipOver(support).reference_moment
    return found_within([partial(scene_case, support, loads, moment)], tolerance, SEARCHED)


def scene_case(
    support: Support, loads: Sequence[Load], moment: float | None, tolerance: Uncertainty
) -> RestCase:
    """A scene within an uncertainty; see `scene_within`."""
    fixed, hanging = fixed_and_hanging(support, loads)
    weights = [base_weight(support, tolerance), *hanging]
    return RestCase(support, weights, fixed, tolerance, base_pushes(tolerance), moment)


def object_within(
    footing: Footing, bodies: Mapping[str, RigidBody], gravity: np.ndarray, tolerance: Uncertainty
) -> WithinAtRest:
    """The worst of an object and all that stands on it, at rest.

    Args:
        footing: of the object.
        bodies: all, by name, in the axes of what carries them.
        gravity: (3,), m/s^2, in these axes.
        tolerance: each mass and centre is as uncertain as those of a payload, and the friction.
    """
    support, moment = footing.support, footing.tip_over.reference_moment

    def case(some: Uncertainty) -> RestCase:
        half, share = np.asarray(some.payload_center, dtype=float), some.payload_mass
        weights = [
            Weight(name, mass, center - support.center_of_mass, -share * mass, share * mass, half)
            for name, (mass, center, _) in bodies.items()
        ]
        return RestCase(support, weights, np.zeros(6), some, (), moment, gravity=gravity)

    return replace(found_within([case], tolerance, OF_OBJECTS), ignored=())


def base_weight(support: Support, tolerance: Uncertainty) -> Weight:
    """The base as far as it is known."""
    low, high = np.array(tolerance.masses(support.mass))[[0, -1]] - support.mass
    half = np.asarray(tolerance.center_of_mass, dtype=float)
    return Weight("base mass", support.mass, np.zeros(3), float(low), float(high), half)


def base_pushes(tolerance: Uncertainty) -> list[Push]:
    """The push at the base's centre of mass, wherever that is; the base is the first of the weights."""
    return [Push("base", tolerance.base_push, np.zeros(3), weight=0)] if tolerance.base_push else []


class CaseWithin(Protocol):
    """A base under loads, within an uncertainty; deviations are of a type that it alone knows."""

    def tip(self) -> tuple[float, Any]:
        """GN at the worst, and the deviations there."""
        ...

    def slip(self) -> tuple[float, Any]:
        """GT at the worst, and the deviations there."""
        ...

    def demand(self, off: Any) -> FrictionDemand:
        """Of friction, with these deviations."""
        ...

    def words(self, off: Any) -> str:
        """Deviations in words."""
        ...


def found_within(
    cases: Sequence[Callable[[Uncertainty], CaseWithin]],
    tolerance: Uncertainty,
    searched: Sequence[str],
) -> WithinAtRest:
    """The worst of several cases within an uncertainty, each made by a function of it; a reason if one fails.

    Args:
        cases: postures or loads.
        tolerance: the uncertainty.
        searched: names of what counts, likely culprits first; the rest is left out, with a remark.
    """
    scope, given = tolerance.scope, tolerance.given
    ignored = tuple(str(tolerance.only(name)) for name in given if name not in searched)
    tolerance = tolerance.only(*(name for name in searched if name in given))
    made = [case(tolerance) for case in cases]
    (GN, tip, first), (GT, slip, other) = (
        max(((*one, case) for one, case in zip(result, made, strict=True)), key=lambda item: item[0])
        for result in ([case.tip() for case in made], [case.slip() for case in made])
    )
    stands = GN < _LOST and GT < _LOST

    def kept(within: Uncertainty) -> bool:
        made = (case(within) for case in cases)
        return all(case.tip()[0] < _LOST and case.slip()[0] < _LOST for case in made)

    reason, possible = ("", 1.0) if stands else why_not(tolerance, searched, kept)
    worst = first.words(tip), other.words(slip)
    demand = other.demand(slip)
    return WithinAtRest(tolerance, scope, GN, GT, demand, *worst, stands, reason, possible, ignored)


@lru_cache(maxsize=16)
def _weakest(support: Support, friction: Uncertainty, moment: float | None) -> Footing:
    """A support on contacts with the minimum friction, made once for all its loads."""
    return Footing(support.varied(friction.contacts(support.contacts)), moment)


class RestCase:
    """Bodies on contacts with the minimum friction, within an uncertainty.

    Args:
        support: nominal.
        weights: all bodies, the base first.
        fixed: (6,), wrench of all else, N and N m about the base's centre of mass.
        tolerance: of tilt and friction; that of weights and pushes is theirs.
        pushes: that may be there.
        moment: M0 of GN, N m.
        name: put in front of messages.
        gravity: (3,), m/s^2, that acts; default: that of the support.
    """

    def __init__(
        self,
        support: Support,
        weights: Sequence[Weight],
        fixed: np.ndarray,
        tolerance: Uncertainty,
        pushes: Sequence[Push] = (),
        moment: float | None = None,
        name: str = "",
        gravity: np.ndarray | None = None,
    ) -> None:
        self._gravity = support.gravity if gravity is None else gravity
        self._tolerance, self._fixed, self._name = tolerance, fixed, name
        self._size = float(np.linalg.norm(self._gravity))
        self._down = self._gravity / self._size
        self._weights, self._pushes = tuple(weights), tuple(pushes)
        columns = ("mass", "less", "more", "center", "half")
        arrays = [np.array([getattr(w, column) for w in weights], dtype=float) for column in columns]
        self._masses, self._less, self._more, self._centers, self._half = arrays
        self.footing = _weakest(support, tolerance.only("friction"), moment)
        self._map = TipMap(self.footing.tip_over)

    def tip(self) -> tuple[float, Off]:
        """GN at the worst, more than 1 where the base tips, and what is off there."""
        nominal = self._off(self._gravity)
        if not self._map.count:
            ratio = 1.0 if self.footing.tip_over.free_rotation else 0.0
            return ratio, nominal
        starts = np.array(list(self._starts()))
        slopes = self._map(self._wrenches([self._off(gravity) for gravity in starts]))[1]
        axes = slopes.shape[1]
        offs = [nominal, *self._worst(slopes.reshape(-1, 6), np.repeat(starts, axes, axis=0))]
        moments = self._map(self._wrenches(offs))[0].min(axis=1)
        k = int(np.argmin(moments))
        return float(self.footing.tip_over.ratio(moments[k])), offs[k]

    def slip(self) -> tuple[float, Off]:
        """The maximum GT of the search, and the deviations there."""
        offs = [self._off(gravity) for gravity in self._starts()]
        if self._pushes:  # from pushes on, too: a base without tangential load says nothing of where to push
            offs += [self._pushed(side, self._gravity) for side in around(self._gravity)]
        best, result = -1.0, offs[0]
        for _ in range(ROUNDS + 1):
            states = self.footing.contact_states(self._wrenches(offs), warm_start=False)
            reserve = self.footing.slip.evaluate(states)
            GT = np.where(np.isnan(reserve.GT), np.inf, reserve.GT)
            k = int(np.argmax(GT))
            if GT[k] > best + _SAME * abs(best):  # what is worse by rounding alone has needless deviations
                result = offs[k]
            best = max(best, float(GT[k]))
            assert reserve.gradient is not None  # it was asked for
            slopes = -np.nan_to_num(reserve.gradient)
            offs = self._worst(slopes, np.array([off.gravity for off in offs]))
        return best, result

    def demand(self, off: Off) -> FrictionDemand:
        """Of friction, with these deviations."""
        return FrictionDemand.of(self.footing.support, self._wrenches([off])[0])

    def words(self, off: Off) -> str:
        """The deviations in words: "links 1 to 3 and base mass -5 %, tilt 0.5 deg towards -y"."""
        changed: dict[str, list[Weight]] = {}
        for weight, more in zip(self._weights, off.masses - self._masses, strict=True):
            if more:
                change = f"{100 * more / weight.mass:+.3g} %" if weight.mass else f"{more:+.3g} kg"
                changed.setdefault(change, []).append(weight)
        results = [self._name] if self._name else []
        for change, weights in changed.items():
            links = [weight.link for weight in weights if weight.link]
            names = [numbered("link", links)] if links else []
            names += [weight.name for weight in weights if not weight.link]
            results.append(f"{enumerated(names)} {change}")
        for weight, shift in zip(self._weights, off.shifts, strict=True):
            if shift.any():
                moved = [f"{1e3 * d:+.3g} mm in {axis}" for axis, d in zip("xyz", shift, strict=True) if d]
                results.append(f"centre of {weight.name.removesuffix(' mass')} {' and '.join(moved)}")
        side = off.gravity - (off.gravity @ self._down) * self._down
        angle = np.degrees(np.arctan2(np.linalg.norm(side), off.gravity @ self._down))
        if angle > 1e-9:
            results.append(f"tilt {angle:.3g} deg {towards(side)}")
        for push, force in zip(self._pushes, off.pushes, strict=True):
            if force.any():
                results.append(f"push of {np.linalg.norm(force):.3g} N at the {push.name} {towards(force)}")
        if self._tolerance.friction:
            results.append(f"friction {-100 * self._tolerance.friction:.3g} %")
        return ", ".join(results)

    def _pushed(self, side: np.ndarray, gravity: np.ndarray) -> Off:
        pushes = np.array([push.size * side for push in self._pushes])
        return Off(self._masses, np.zeros_like(self._half), gravity, pushes)

    def _off(self, gravity: np.ndarray) -> Off:
        return Off(self._masses, np.zeros_like(self._half), gravity, np.zeros((len(self._pushes), 3)))

    def _starts(self) -> Iterator[np.ndarray]:
        """Nominal gravity, and tilted by the whole tilt in directions around."""
        yield self._gravity
        if self._tolerance.tilt:
            yield from tilted(self._gravity, around(self._gravity), self._tolerance.tilt)

    def _worst(self, a: np.ndarray, gravity: np.ndarray) -> list[Off]:
        """Deviations that minimise a . w for each row of a (N, 6), from directions of gravity (N, 3) on."""
        force, moment = a[:, None, :3], a[:, None, 3:]
        masses, shifts = np.tile(self._masses, (len(a), 1)), np.zeros((len(a), *self._half.shape))
        for _ in range(ROUNDS):
            shifts = self._shifted(force, moment, masses, gravity)
            per_mass = force + cross(moment, self._centers + shifts)
            heavier = np.einsum("nki,ni->nk", per_mass, gravity) > 0
            masses = self._masses + np.where(heavier, self._less, self._more)
            if self._tolerance.tilt:
                slopes = np.einsum("nk,nki->ni", masses, per_mass)
                gravity = self._gravity + least_tilt(slopes, self._gravity, self._tolerance.tilt)
        pushes = np.zeros((len(a), len(self._pushes), 3))
        for k, push in enumerate(self._pushes):
            slope = force[:, 0] + cross(moment[:, 0], self._point(push, shifts))
            size = np.linalg.norm(slope, axis=1, keepdims=True)
            pushes[:, k] = -push.size * np.divide(slope, size, out=np.zeros(slope.shape), where=size > 0)
        return [Off(masses[k], shifts[k], gravity[k], pushes[k]) for k in range(len(a))]

    def _shifted(
        self, force: np.ndarray, moment: np.ndarray, masses: np.ndarray, gravity: np.ndarray
    ) -> np.ndarray:
        """Shifts (N, K, 3) of the centres that are worst with these masses and pushes along the gradient."""
        # a_M . (d x g) = d . (g x a_M)
        pull = masses[:, :, None] * cross(gravity[:, None], moment)
        least = _SAME * self._size * np.linalg.norm(moment, axis=2) * np.abs(masses)
        shifts = np.where(np.abs(pull) > least[:, :, None], -np.sign(pull) * self._half, 0.0)
        for push in self._pushes:
            if (k := push.weight) is not None:
                corners = _CORNERS * self._half[k]
                arms = force + cross(moment, push.point + corners)
                values = pull[:, k] @ corners.T - push.size * np.linalg.norm(arms, axis=2)
                near = values.min(axis=1) + _SAME * np.abs(values).max(axis=1)
                # What does not matter stays in the middle.
                shifts[:, k] = corners[np.argmax(values <= near[:, None], axis=1)]
        return shifts

    def _wrenches(self, offs: Sequence[Off]) -> np.ndarray:
        """(N, 6), N and N m about the nominal centre of mass of the base."""
        columns = ("masses", "shifts", "gravity", "pushes")
        masses, shifts, gravity, pushes = (np.array([getattr(off, name) for off in offs]) for name in columns)
        force = masses.sum(axis=1)[:, None] * gravity + pushes.sum(axis=1)
        moment = cross(np.einsum("nk,nki->ni", masses, self._centers + shifts), gravity)
        for k, push in enumerate(self._pushes):
            moment += cross(self._point(push, shifts), pushes[:, k])
        return self._fixed + np.hstack([force, moment])

    @staticmethod
    def _point(push: Push, shifts: np.ndarray) -> np.ndarray:
        """(3,) or (N, 3) with shifts (N, K, 3)."""
        return push.point if push.weight is None else push.point + shifts[:, push.weight]
